/* ibrnet.h: IBRNet: colours and densities of samples on target rays from what source views see
 * there. Not equivariant: it is told directions in the frame of the poses.     [method.md 5c]
 *
 *   views      ibrnet_aggregation.h, with the 4 numbers of the differences of direction and first
 *              weights by direction: of each view 32 numbers, of each sample `width`
 *   density    + position code; attention along the ray (4 heads, residual, layer norm);
 *              width -> 16 -> 1
 *   colour     of each view a logit: [32, second weight, differences 4] -> 16 -> 8 -> 1; softmax
 *
 * ELU after every map but the last of colour and density, and where the aggregation has none.
 */
#ifndef LF_MODELS_IBRNET_H
#define LF_MODELS_IBRNET_H

#include "models/ibrnet_aggregation.h"
#include "models/ray_network.h"

typedef struct lf_ibrnet_config {
    long inputs;   /* F = 3 + features */
    long width;    /* numbers of a sample in the ray transformer, a multiple of 4; published: 16 */
    bool softplus; /* density softplus(t), last bias -2 at the start; else ReLU(t), as published */
} lf_ibrnet_config;

typedef struct lf_ibrnet {
    lf_ibrnet_config config;
    const lf_parameter *sharpness; /* [1]: s of the weights by direction */
    lf_ibrnet_aggregation views;
    lf_linear_layer colour[3];
    lf_linear_layer query, key, value, join;
    const lf_parameter *gain, *bias; /* [width] of the layer norm */
    lf_mlp density;
} lf_ibrnet;

/* Maps of base, visibility, point and colour: normal, variance 2 / inputs; the others as
 * lf_linear_init makes them; s = 0.2. */
void lf_ibrnet_init(lf_store *store, lf_ibrnet *net, const char *prefix,
                    const lf_ibrnet_config *config);
/* in->difference is needed, finite also where a view sees nothing: the least inner product counts
 * all views. Of the geometry only mask and count are read. Samples that no view sees have colour 0
 * and density 0; for IBRNet one view alone has no weight by direction. */
lf_radiance lf_ibrnet_apply(lf_tape *tape, const lf_ibrnet *net, const lf_ray_inputs *in);

/* Useful multiply-adds of one sample of a ray of that many, seen by `views` views, forward. */
double lf_ibrnet_macs(const lf_ibrnet *net, long samples, long views);

#endif
