/* render_work.h: how a training step and an evaluation of the renderers run. [docs/architecture.md]
 *
 * Feature maps of the source views are computed once on one tape; target rays are split into tiles,
 * each with a small tape of its own: samples, network, volume rendering, loss, backward. Gradients
 * of the networks and of the maps go to a fixed number of lanes chosen by tile number and are
 * summed in lane order, so the result has the same bits for any number of threads.
 */
#ifndef LF_MODELS_RENDER_WORK_H
#define LF_MODELS_RENDER_WORK_H

#include "autograd/profile.h"
#include "models/ray_samples.h"
#include "models/renderer.h"

enum { LF_RENDER_LANES = 8 };

typedef struct lf_render_work lf_render_work;

/* Workspace of a model; `tile` rays a tile. Free it before the model. */
lf_render_work *lf_render_work_create(const lf_renderer *model, long tile);
void lf_render_work_free(lf_render_work *work);
/* Check every op for NaN and infinities: slower. */
void lf_render_work_check(lf_render_work *work, bool on);
/* Put down in `profile` what later steps do, with as many threads as there are now; NULL: no
 * longer.
 */
void lf_render_work_watch(lf_render_work *work, lf_profile *profile);
/* The first op that produced one in the last step ("forward of softmax"), or NULL. */
const char *lf_render_nonfinite(const lf_render_work *work);
/* Bytes of all tapes, lanes and buffers at their largest. */
size_t lf_render_work_bytes(const lf_render_work *work);

/* Rays of one target picture, and the views they are rendered from; all arrays are the caller's. */
typedef struct lf_render_batch {
    lf_target_rays rays;
    const float *colour; /* [N, 3] of the target's pixels, 0..1 */
    bool white;          /* what is not covered is white, else black */
    long seen_samples;   /* a ray counts if more than so many samples are seen by two views */
    uint64_t seed;       /* names the places in the strata, with step and ray */
    long step;
    long views;
    const lf_source *source; /* [V]; pictures may differ in size */
} lf_render_batch;

/* Forward and backward of one batch. Sets the store's gradients of the mean squared error over the
 * colours of the rays that count (with two networks: the sum of both errors), and returns that
 * error; 0 and no gradient if no ray counts. *counted (may be NULL): the rays that do. */
double lf_render_step(lf_render_work *work, const lf_render_batch *batch, long *counted);

/* Evaluation: features of the source views, which must stay until the last lf_render_rays. */
void lf_render_encode(lf_render_work *work, long views, const lf_source *source);

/* What evaluation may leave out; all zeros: nothing. */
typedef struct lf_render_savings {
    bool unseen;      /* samples that no view sees. Exact for the equivariant network */
    lf_bounds bounds; /* samples outside this ball, if its radius is not 0 */
    double stop;      /* fine samples behind which less light than this remains */
    double empty;     /* fine samples of rays whose coarse opacity is at most this; below 0: none */
} lf_render_savings;
lf_render_savings lf_render_savings_none(void);

typedef struct lf_ray_image {
    lf_real *colour;  /* [N, 3] */
    lf_real *depth;   /* [N] mean depth (along the camera's axis) of what the ray meets, or far */
    lf_real *opacity; /* [N] */
    long rows; /* (sample, source view) pairs given to the networks, coarse and fine, seen or not */
} lf_ray_image;

/* Render the rays into out's arrays, the caller's. Rays are spread over threads inside. */
void lf_render_rays(lf_render_work *work, const lf_target_rays *rays, bool white,
                    const lf_render_savings *savings, lf_ray_image *out);

#endif
