/* stability_scene.h: some points before the eight built-in cameras, for stability_points.c and
 * stability_far.c. */
#ifndef LF_BENCH_STABILITY_SCENE_H
#define LF_BENCH_STABILITY_SCENE_H

#include "bench/stability.h"
#include "datasets/camera.h"
#include "layers/light_field.h"

enum { LF_STABILITY_POINTS = 3, LF_STABILITY_SEEN = LF_STABILITY_POINTS * LF_CUBE_VIEWS };

typedef struct lf_stability_scene {
    lf_camera camera[LF_CUBE_VIEWS];
    double point[LF_STABILITY_POINTS][3];
    double uv[2 * LF_STABILITY_SEEN], direction[3 * LF_STABILITY_SEEN], distance[LF_STABILITY_SEEN];
    uint8_t mask[LF_STABILITY_SEEN];
} lf_stability_scene;

/* The first point at `near` from the first camera's centre, in front of it (0: in the object),
 * everything moved by `away`. */
void lf_stability_scene_make(lf_stability_scene *scene, double near, double away);
/* Directions and pixels in long double, of the rounded centres and points. */
void lf_stability_scene_exact(const lf_stability_scene *scene,
                              long double direction[3 * LF_STABILITY_SEEN],
                              long double uv[2 * LF_STABILITY_SEEN]);
/* The reconstruction network behind the sampling: input `seen`, output `distance`. */
void lf_stability_scene_head(lf_stability *s, const lf_stability_scene *scene);

#endif
