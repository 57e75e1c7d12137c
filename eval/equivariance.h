/* equivariance.h: what a trained model keeps of what its design promises.        [method.md 10] */
#ifndef LF_EVAL_EQUIVARIANCE_H
#define LF_EVAL_EQUIVARIANCE_H

#include "eval/evaluate.h"

typedef struct lf_equivariance_options {
    long elements;     /* random group elements of each kind of transformation */
    long shapes;       /* shapes of the split to try on */
    const char *split; /* train, val or test */
    const char *json;  /* report, or NULL */
    bool quiet;
} lf_equivariance_options;

/* For views of the split's shapes in setting I and 512 points a shape, apply
 *
 *   motion   g = (R, t) in SE(3), |t| up to 1000 box diagonals, to cameras and points; same images
 *   quarter  a roll of every view by a random multiple of 90 degrees, pixels turned exactly
 *   eighth   a roll of every view by 45 degrees more than that, rendered again
 *
 * and print, for every layer and the output, the largest and mean difference from what the
 * transformation law says, relative to the layer's largest value. Images of 32k + 1 pixels keep the
 * first two at rounding; the third is the cost of pixels. */
lf_status lf_check_equivariance(lf_loaded *loaded, const lf_equivariance_options *options,
                                lf_error *err);

#endif
