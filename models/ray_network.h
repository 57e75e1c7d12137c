/* ray_network.h: what a renderer's network gets of the samples on target rays, and gives.
 *                                                                        [method.md 5b.1 - 5b.5]
 * Two networks share this face: the paper's equivariant one (ray_equivariant.h) and IBRNet
 * (ibrnet.h). Everything before (features, sampling) and after them (volume rendering, loss) is the
 * same.
 *
 * Sizes: N target rays, S samples a ray, V source views, F numbers a sample and view.
 */
#ifndef LF_MODELS_RAY_NETWORK_H
#define LF_MODELS_RAY_NETWORK_H

#include "layers/light_field.h"

enum { LF_RGB = 3 };

typedef struct lf_ray_inputs {
    lf_tensor *seen; /* [N, S, V, F]: red, green, blue in 0..1, then features; 0 where masked */
    const lf_light_geometry *geometry; /* until the backward is done */
    const lf_tensor *difference; /* [N, S, V, 4]: unit difference of the target's and the source's
                                    direction to the camera, and their inner product less 1 (which
                                    float can tell from 0 where views agree), in the frame of the
                                    poses (IBRNet only; else NULL) */
} lf_ray_inputs;

typedef struct lf_radiance {
    lf_tensor *colour; /* [N, S, 3] a blend of the views' colours; 0 where none sees the sample */
    lf_tensor *sigma;  /* [N, S] >= 0, a sample (no interval lengths); 0 where no view sees it */
} lf_radiance;

#endif
