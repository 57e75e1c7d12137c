/* mean_shape.h: the mean of a split's shapes, a reconstruction that sees no view. [method.md 5a.9]
 *
 * Of up to LF_MEAN_SHAPES shapes, evenly over the split's list, the share s(p) that has p inside,
 * on LF_MEAN_NODES^3 nodes of the cube [-1/2, 1/2]^3, which no normalised shape leaves; trilinear
 * between the nodes, 0 beyond the cube. The mean shape is where s > level, the level
 * near 0.05, 0.10, ..., 0.95 (halfway between two shares that nodes can have) whose IoU with those
 * shapes, over the nodes, is largest on average (the lowest of equals). Field: level - s, no
 * distance, so extract it with lf_iso_options.dense.
 *
 * All shapes stand in the object's frame: this is what a system that is told its pose in that frame
 * can answer without looking.
 */
#ifndef LF_EVAL_MEAN_SHAPE_H
#define LF_EVAL_MEAN_SHAPE_H

#include "datasets/shapes.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { LF_MEAN_SHAPES = 64, LF_MEAN_NODES = 33 };

typedef struct lf_mean_shape {
    long shapes; /* looked at */
    double level;
    float *share; /* [LF_MEAN_NODES^3], x fastest */
} lf_mean_shape;

/* At least one shape; errors of lf_shapes_load. The caller frees it. */
lf_status lf_mean_shape_make(const lf_shapes *shapes, lf_mean_shape *out, lf_error *err);
void lf_mean_shape_free(lf_mean_shape *mean);

/* An lf_field_fn whose context is a const lf_mean_shape *: all points are valid. */
void lf_mean_shape_field(void *mean, long n, const double (*points)[3], float *value,
                         uint8_t *valid);

/* The definition for reports. */
const char *lf_mean_shape_text(void);

#ifdef __cplusplus
}
#endif
#endif
