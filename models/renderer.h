/* renderer.h: the renderers: posed source views -> the colour of a ray.              [method.md 5b,
 * 5c]
 *
 *   pictures -> feature network -> maps; samples on the ray, seen by the source views -> colours
 * and features -> the ray network (the paper's equivariant one, or IBRNet's) -> density and colour
 * of each sample -> volume rendering. With fine samples a second network of the same kind sees them
 *   as well; it has its own features.
 */
#ifndef LF_MODELS_RENDERER_H
#define LF_MODELS_RENDERER_H

#include "configs/configs.h"
#include "models/feature_net.h"
#include "models/ibrnet.h"
#include "models/ray_equivariant.h"

enum { LF_COARSE, LF_FINE, LF_RAY_NETWORKS };

typedef struct lf_renderer_config {
    bool equivariant; /* false: IBRNet */
    lf_feature_config features;
    lf_ray_equivariant_config ray;
    lf_ibrnet_config ibrnet;
    long channels; /* features that each network samples */
    long sources, samples, fine;
} lf_renderer_config;

/* The [model] and [render] keys of a config. */
lf_renderer_config lf_renderer_config_from(const lf_config *cfg);

typedef struct lf_renderer {
    lf_renderer_config config;
    lf_store *store; /* the caller's */
    lf_feature_net features;
    int networks; /* 1, or 2 with fine samples */
    lf_ray_equivariant equivariant[LF_RAY_NETWORKS];
    lf_ibrnet ibrnet[LF_RAY_NETWORKS];
    long head_first; /* offset in the store of the first parameter behind the features */
} lf_renderer;

/* Register all parameters in `store`, which must outlive the model. */
void lf_renderer_init(lf_renderer *model, lf_store *store, const lf_renderer_config *config);
void lf_renderer_free(lf_renderer *model);

/* Colours and densities of samples by network LF_COARSE or LF_FINE. */
lf_radiance lf_renderer_radiance(lf_tape *tape, const lf_renderer *model, int network,
                                 const lf_ray_inputs *in);
/* The types that the geometry must have: the model's, or scalars alone for IBRNet. */
lf_types lf_renderer_types(const lf_renderer *model);

/* Multiply-adds, forward: of network LF_COARSE or LF_FINE for one ray, of all of them, and of the
 * feature network for a picture. */
double lf_renderer_network_macs(const lf_renderer *model, int network);
double lf_renderer_ray_macs(const lf_renderer *model);
double lf_renderer_picture_macs(const lf_renderer *model, long height, long width);

#endif
