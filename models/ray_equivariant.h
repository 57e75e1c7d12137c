/* ray_equivariant.h: the equivariant network of a sample on a target ray.   [method.md 5b.3 - 5b.5]
 *
 *   x = norm(mean over views of the ray -> ray convolution of `seen`)
 *   x, w = cross attention over the views (residual inside);        x = norm(x), colour = sum w rgb
 *   x = norm(x + attention along the ray),                          if along_ray
 *   x = x + linear(gate(x))
 *   sigma = density(MLP of [invariants of x; share of the views that see the sample - 1/2]),
 *                                                         widths 16, 16, 1, ELU between
 *
 * norm divides by the root mean square over all types and channels and has a gain per type and
 * channel; without layer_norm it is left out. All outputs are invariant: exactly under rotations
 * and translations of the poses' frame, and under the order of the views up to rounding.
 *
 * Parameters are prefix.{convolution, convolution_norm, cross, cross_norm, along, along_norm,
 * gated, mix, density.<i>}; those that the configuration leaves out are absent.
 */
#ifndef LF_MODELS_RAY_EQUIVARIANT_H
#define LF_MODELS_RAY_EQUIVARIANT_H

#include "models/ray_network.h"

typedef struct lf_ray_equivariant_config {
    lf_types types;
    long inputs;   /* F, numbers a sample and view; the first three are red, green, blue */
    long channels; /* C of each type; types say how many times as many scalars */
    long hidden;   /* width of the profiles' MLPs */
    int heads;     /* divides the channels */
    bool layer_norm;
    bool along_ray; /* attention along the ray; false: each sample by itself */
} lf_ray_equivariant_config;

typedef struct lf_ray_equivariant {
    lf_ray_equivariant_config config;
    lf_ray_ray_convolution convolution;
    lf_cross_attention_layer cross;
    lf_along_ray_layer along;
    lf_so2_gated gated;
    lf_so2_map mix;
    const lf_parameter *gain[3]; /* of the norms: [Q C]; NULL without */
    lf_mlp density;
} lf_ray_equivariant;

/* Registers the parameters in `store`; gains start at 1, the last bias of the density at -2. */
void lf_ray_equivariant_init(lf_store *store, lf_ray_equivariant *net, const char *prefix,
                             const lf_ray_equivariant_config *config);

/* in->geometry must have the network's types; in->difference is not read. */
lf_radiance lf_ray_equivariant_apply(lf_tape *tape, const lf_ray_equivariant *net,
                                     const lf_ray_inputs *in);

/* Useful multiply-adds of one sample of a ray of `samples`, forward. Between two samples: the
 * products of keys, values, queries and weights, not the profile of their distance. */
double lf_ray_equivariant_macs(const lf_ray_equivariant *net, long samples, long views);

#endif
