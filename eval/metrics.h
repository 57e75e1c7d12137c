/* metrics.h: how far a predicted surface is from the true one.                  [method.md 5a.9]
 *
 * Unit: the longest edge of the bounding box of the TRUTH is 1; the prediction is taken in the same
 * frame and is never fitted to the truth. Nothing here is multiplied by 10: the report does that.
 *
 * IoU        |A and B| / |A or B| over `samples` points (100000), uniform in the cube of edge 1.1
 *            round the centre of the truth's box, a Kronecker sequence with a random shift: every
 *            point is uniform, together they spread more evenly than independent ones (error about
 *            10 times smaller). A union without points gives 1 (both solids are empty).
 * Chamfer    (accuracy + completeness) / 2 with `samples` area-uniform points on each surface:
 *            accuracy      mean over samples of the prediction of the distance to the truth
 *            completeness  mean over samples of the truth of the distance to the prediction
 *            Euclidean distances, not squared. The distance is to the nearest SAMPLE of the other
 *            surface, as the papers do; that adds about half the spacing of the samples where the
 *            surfaces coincide (0.004 for a unit cube and 100000 samples: identical meshes do not
 *            score 0). `exact` measures to the surface itself instead.
 * Empty      a prediction without a face of positive area scores IoU 0 and Chamfer sqrt(3); it is
 *            marked, and stays in every mean.
 *
 * Occupancy of a closed mesh is its winding number, exact. Of a truth that is not closed it is the
 * sign of datasets/sdf.h.
 *
 * Randomness: LF_RANDOM_METRIC and LF_RANDOM_SURFACE at (seed, item). Results do not depend on the
 * thread count. Errors: outputs untouched, *err filled (may be NULL).
 */
#ifndef LF_EVAL_METRICS_H
#define LF_EVAL_METRICS_H

#include <stdbool.h>
#include <stdint.h>

#include "autograd/status.h"
#include "datasets/mesh.h"
#include "datasets/sdf.h"

#ifdef __cplusplus
extern "C" {
#endif

#define LF_METRIC_SAMPLES 100000
#define LF_METRIC_SAMPLES_MAX 100000000
#define LF_METRIC_CUBE 1.1                  /* edge of the IoU cube in longest box edges */
#define LF_CHAMFER_EMPTY 1.7320508075688772 /* of an empty prediction */
#define LF_CHAMFER_FACTOR 10 /* what reports multiply Chamfer by, as the papers' tables */

typedef struct lf_metric_options {
    long samples;  /* points of IoU, and samples on each surface; 1 ... LF_METRIC_SAMPLES_MAX */
    bool exact;    /* Chamfer to the surface instead of to its samples */
    uint64_t seed; /* which points */
    uint64_t item; /* of which shape */
} lf_metric_options;

/* 100000 samples, sample to sample, seed 0, item 0. */
lf_metric_options lf_metric_defaults(void);

/* The definitions above for people, a few lines with unit, sample count, normalisation and factor.
 */
const char *lf_metric_text(void);

typedef enum lf_occupancy { LF_OCCUPANCY_WINDING, LF_OCCUPANCY_SDF } lf_occupancy;
/* "winding number", "signed distance". */
const char *lf_occupancy_name(lf_occupancy occupancy);

typedef struct lf_score {
    double iou;
    double chamfer_l1;   /* in longest box edges of the truth, not times 10 */
    double accuracy;     /* the same unit */
    double completeness; /* the same unit */
    bool empty;          /* the prediction has no surface: iou 0, the three others sqrt(3) */
    double edge;         /* longest box edge of the truth in the meshes' own unit */
    long inside_predicted, inside_truth; /* of the IoU points */
    lf_occupancy occupancy_predicted, occupancy_truth;
} lf_score;

/* Score `predicted` against `truth`. `truth_sdf` gives the truth's inside (with the thickness that
 * the training data had, for open meshes); NULL: the winding number if the truth is closed, else
 * an lf_sdf of its own with default options. A prediction that is not closed gets an lf_sdf too.
 * LF_BAD_INPUT: options out of range, a truth without area or extent. */
lf_status lf_score_meshes(const lf_mesh *predicted, const lf_mesh *truth, const lf_sdf *truth_sdf,
                          const lf_metric_options *options, lf_score *out, lf_error *err);

/* ---- the parts ----------------------------------------------------------------------------- */

/* The cube of IoU: n points round the centre of the box low..high into point[n][3]. */
void lf_metric_points(const double low[3], const double high[3], const lf_metric_options *options,
                      double (*point)[3]);

/* |a and b| / |a or b| of n flags each; 1 if neither has any. */
double lf_iou(long n, const uint8_t *a, const uint8_t *b);

/* Winding number of a closed mesh round n points, inside[i] = it is not 0. Crossings are counted
 * along +z with shared edges decided alike for both faces, so the count is exact for every closed
 * mesh; points on the surface may fall on either side. A mesh that is not closed gives nonsense. */
lf_status lf_winding_occupancy(const lf_mesh *closed, long n, const double (*point)[3],
                               uint8_t *inside, lf_error *err);

/* Mean distance of from[n] to the nearest of to[m], n and m >= 1. */
double lf_mean_nearest(long n, const double (*from)[3], long m, const double (*to)[3]);

#ifdef __cplusplus
}
#endif
#endif
