/* trainer.h: one training from its config: data, model, optimiser, loop.       [docs/tour.md]
 *
 * The same config gives the same bits, whatever the number of threads, and whether the run was
 * stopped and resumed or not.
 */
#ifndef LF_TRAIN_TRAINER_H
#define LF_TRAIN_TRAINER_H

#include <signal.h>

#include "configs/configs.h"
#include "models/checkpoint.h"

typedef struct lf_train_options {
    const char *out;         /* run folder, made if needed */
    const char *resume;      /* checkpoint to start from, or NULL; cfg is then the one inside it */
    lf_training_state start; /* of that checkpoint */
    bool fresh;              /* resume into a new run folder instead of the checkpoint's own */
    bool quiet, overfit, check_finite;
    const volatile sig_atomic_t *stop; /* set by the user's interrupt; may be NULL */
    volatile sig_atomic_t *begun;      /* set to 1 when the data are made, nothing before that is
                                        * worth saving; may be NULL */
    long profile;     /* steps to measure (profile_report.h), writing no run; 0: train */
    const char *json; /* where to write the profile, too; or NULL */
} lf_train_options;

/* Train to the last step. LF_STOPPED: interrupted, the checkpoint is saved. LF_FAILED: too many bad
 * steps in a row, or the disk refused. */
lf_status lf_train(const lf_config *cfg, const lf_train_options *options, lf_error *err);

#endif
