/* task.h: what the training loop trains: a model with its data, behind one face.
 *
 * The loop (trainer.c) knows parameters, optimiser, schedule, checkpoints and logs. A task knows
 * the model, the data and the loss: reconstruction (task_recon.c) or rendering (task_render.c),
 * chosen by model.type. A step is a pure function of (config, parameters, step).
 */
#ifndef LF_TRAIN_TASK_H
#define LF_TRAIN_TASK_H

#include <jansson.h>

#include "autograd/profile.h"
#include "configs/configs.h"

typedef struct lf_task_options {
    bool quiet, check_finite;
} lf_task_options;

/* How well the model does on the validation split; a scene without one is validated on views that
 * it is trained on, and `split` says so. */
typedef struct lf_validation {
    double loss;       /* the lower the better: picks the best checkpoint */
    const char *name;  /* of the figure for people, a key of metrics.jsonl: "val_iou" */
    const char *label; /* the same in words: "IoU of signs" */
    double figure;
    const char *split; /* of what it was measured on: "val", "train", "val, train" */
} lf_validation;

/* What a model costs, by formula: multiply-adds, forward, of one view, point, ray, ... */
enum { LF_COST_PARTS = 4, LF_COST_TEXT = 96 };
typedef struct lf_cost_part {
    const char *name;
    long parameters;
    double macs;
    char of[LF_COST_TEXT]; /* of what: "a view of 97 x 97" */
} lf_cost_part;
typedef struct lf_cost {
    int parts;
    lf_cost_part part[LF_COST_PARTS];
    double step_macs;
    char step[LF_COST_TEXT]; /* what a training step is: "2 shapes, 512 points" */
} lf_cost;
void lf_cost_add(lf_cost *cost, const char *name, long parameters, double macs, const char *of);
/* Trainable numbers of the arrays whose names begin with `prefix`. */
long lf_trainable_in(const lf_store *store, const char *prefix);

typedef struct lf_task lf_task;
struct lf_task {
    void *self;
    lf_store *store; /* owned */
    /* What the model costs; neither data nor a step are needed. */
    void (*count)(const void *self, lf_cost *out);
    /* Refuse what this machine cannot hold; nothing is read yet. */
    lf_status (*check)(void *self, lf_error *err);
    /* Open and prepare the data; the sizes are printed unless quiet. */
    lf_status (*open)(void *self, lf_error *err);
    /* Print model and memory, by running `step` once on a copy. */
    void (*print_plan)(void *self, long step);
    /* Forward and backward: gradients in the store, the mean loss in *loss; *data_seconds: what was
     * not computing. LF_BAD_INPUT, LF_FAILED: the data cannot be read. */
    lf_status (*step)(void *self, long step, double *loss, double *data_seconds, lf_error *err);
    /* Put down in `profile` where later steps spend their time; NULL: no longer. */
    void (*watch)(void *self, lf_profile *profile);
    /* Bytes of tapes and lanes at their largest. */
    size_t (*work_bytes)(const void *self);
    /* Add what the task counts to a line of metrics.jsonl, and begin to count anew; may be NULL. */
    void (*log)(void *self, json_t *line);
    /* The first op of the last step that was not finite, or NULL. */
    const char *(*nonfinite)(const void *self);
    /* False: there is nothing to validate on. */
    bool (*validates)(const void *self);
    lf_status (*validate)(void *self, lf_validation *out, lf_error *err);
    void (*free)(void *self);
};

/* The task of a config, its model built; cfg and options must outlive it. */
void lf_task_create(const lf_config *cfg, const lf_task_options *options, lf_task *out);
void lf_task_free(lf_task *task);

/* The two kinds. */
void lf_task_recon(const lf_config *cfg, const lf_task_options *options, lf_task *out);
void lf_task_render(const lf_config *cfg, const lf_task_options *options, lf_task *out);

#endif
