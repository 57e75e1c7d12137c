/* recon_work.h: how a training step and an evaluation of a reconstruction model run.
 *
 * Features of all views are computed once on one tape; query points are split into tiles, each with
 * a small tape of its own that a worker resets and reuses. Tile gradients of the head's parameters
 * go to a fixed number of lanes chosen by tile number and are summed in lane order, so the result
 * has the same bits for any number of threads.                             [docs/architecture.md]
 */
#ifndef LF_MODELS_RECON_WORK_H
#define LF_MODELS_RECON_WORK_H

#include "autograd/profile.h"
#include "models/recon.h"

enum { LF_RECON_LANES = 8 };

/* The images of a step or of an object. */
typedef struct lf_recon_images {
    long count;
    long views;           /* of an object, which are in a row; they divide count */
    const lf_real *pixel; /* [count, H, W, C], read only */
    /* How the views see the points of the network's grid, one object after the other; NULL for a
     * network without one. */
    const lf_recon_points *grid;
} lf_recon_images;

typedef struct lf_recon_work lf_recon_work;

/* Workspace of a model; `tile` points a tile. Free it before the model. */
lf_recon_work *lf_recon_work_create(const lf_recon *model, long tile);
void lf_recon_work_free(lf_recon_work *work);
/* Check every op for NaN and infinities: slower. See lf_recon_nonfinite. */
void lf_recon_work_check(lf_recon_work *work, bool on);
/* Put down in `profile` what later steps do, with as many threads as there are now; NULL: no
 * longer.
 */
void lf_recon_work_watch(lf_recon_work *work, lf_profile *profile);
/* The first op that produced one in the last step ("forward of softmax"), or NULL. */
const char *lf_recon_nonfinite(const lf_recon_work *work);
/* Bytes of all tapes, lanes and buffers at their largest. */
size_t lf_recon_work_bytes(const lf_recon_work *work);

/* Forward and backward of one batch with true distances sdf [Q]. Sets the store's gradients (of the
 * mean over the points) and updates running statistics. Returns the mean loss. */
double lf_recon_step(lf_recon_work *work, const lf_recon_images *images,
                     const lf_recon_points *points, const float *sdf,
                     const lf_sdf_loss_config *loss);

/* Evaluation: features of one object's views, kept until the next call; then distances (divided by
 * `scale` already) of any points. valid[q] = some view sees the point. Not for two threads at once;
 * points are spread over threads inside. */
void lf_recon_encode(lf_recon_work *work, const lf_recon_images *images);
void lf_recon_predict(lf_recon_work *work, const lf_recon_points *points, double scale,
                      lf_real *sdf, uint8_t *valid);

/* Multiply-adds of one training step by formula (useful operations, forward; a step is about three
 * times that): of `images`, of the objects that they show in `views` each, and of `points`. */
double lf_recon_macs(const lf_recon *model, long images, long points, long views);

#endif
