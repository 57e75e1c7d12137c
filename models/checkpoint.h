/* checkpoint.h: a model, its optimiser and its config in one safetensors file.  [docs/formats.md]
 *
 * Arrays: every parameter under its name; the optimiser's moments as adam.m.<name>, adam.v.<name>.
 * Metadata: "format" = "elf-checkpoint-1", "step", "adam_steps", "seconds", "skipped",
 * "bad_in_a_row", "loss_sum" and "loss_steps" (0 where they are missing), and "config", the whole
 * resolved INI. Written whole or not at all.
 */
#ifndef LF_MODELS_CHECKPOINT_H
#define LF_MODELS_CHECKPOINT_H

#include "autograd/optim.h"
#include "autograd/safetensors.h"
#include "configs/configs.h"

/* Where a training stands. */
typedef struct lf_training_state {
    long step;         /* steps done */
    long skipped;      /* steps without an update: something was not finite */
    long bad_in_a_row; /* of these, the last ones */
    double seconds;    /* of training so far */
    double loss_sum;   /* of the steps since the last line of metrics, */
    long loss_steps;   /* and their number */
} lf_training_state;

/* `fault` as in safetensors.h (NULL except in tests). */
lf_status lf_checkpoint_write(const char *path, const lf_store *store, const lf_adam *adam,
                              const lf_training_state *state, const lf_config *cfg,
                              const lf_fault *fault, lf_error *err);

/* The config inside a checkpoint and where its training stood (state may be NULL). The caller frees
 * *cfg. LF_BAD_INPUT: not a checkpoint of elf. */
lf_status lf_checkpoint_config(const char *path, lf_config **cfg, lf_training_state *state,
                               lf_error *err);

/* Fill the store, and the optimiser unless NULL. LF_BAD_INPUT, nothing changed in the store, if a
 * parameter is missing, has another shape, or the file has one that the model lacks: it belongs to
 * another model. */
lf_status lf_checkpoint_read(const char *path, lf_store *store, lf_adam *adam, lf_error *err);

#endif
