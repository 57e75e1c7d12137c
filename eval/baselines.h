/* baselines.h: three ways to render a view from others that learn nothing.
 *
 * Pixel (u, v) of the target is looked at in S points of its ray, at the camera depths
 *   1 / z_s = 1 / near + (s + 1/2) / S (1 / far - 1 / near),   s = 0 ... S - 1.
 * A source sees a point in front of it that falls inside its picture (pixel centres 0 ... size - 1,
 * to 1e-6); x_sk is its colour there, bilinear, for the n_s sources k that see point s.
 *   copy   the nearest source view at the target's size (image_resize.h); it ignores the cameras
 *   mean   sum_sk x_sk / sum_s n_s: all points and all sources that see them
 *   sweep  the mean of x_sk over k at the point s with the least variance (divisor n_s, summed over
 *          channels) of those with n_s >= 2; the nearer of equal ones. No such point: as mean.
 * Where no source sees any point: `ground`. Nothing is occluded by anything.
 *
 * Cost: pixels x S x sources projections, in parallel over rows; results do not depend on the
 * number of threads.
 */
#ifndef LF_EVAL_BASELINES_H
#define LF_EVAL_BASELINES_H

#include "datasets/image.h"
#include "datasets/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum lf_baseline {
    LF_BASELINE_COPY,
    LF_BASELINE_MEAN,
    LF_BASELINE_SWEEP,
    LF_BASELINES
} lf_baseline;

/* "copy", "mean", "sweep". */
const char *lf_baseline_name(lf_baseline kind);

typedef struct lf_baseline_views {
    lf_camera target;
    double near, far;        /* depths along the target's axis, 0 < near < far */
    int samples;             /* S >= 1 */
    int sources;             /* >= 1 */
    const lf_camera *camera; /* [sources], borrowed; nearest first */
    const lf_pixels
        *pixels;  /* [sources], borrowed; of the cameras' sizes; alpha is not looked at */
    float ground; /* grey where nothing is seen: 1 white, 0 black */
} lf_baseline_views;

/* A new image of three channels, of the target's size. LF_BAD_INPUT: a camera that lf_camera_check
 * refuses, no sources or samples, not 0 < near < far. */
lf_status lf_baseline_render(lf_baseline kind, const lf_baseline_views *views, lf_image **out,
                             lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
