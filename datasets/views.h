/* views.h: the eight views of one object in one setting (method.md 5a.8), rendered on the fly. */
#ifndef LF_DATASETS_VIEWS_H
#define LF_DATASETS_VIEWS_H

#include "datasets/camera.h"
#include "datasets/render.h"
#include "datasets/surface.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct lf_views_options {
    lf_setting setting;
    int size; /* pixels an edge; 32k + 1 keeps quarter turns exact in the backbone */
    lf_render_options render;
} lf_views_options;

/* Number of floats of the images: 8 x size x size x channels. */
long lf_views_floats(const lf_views_options *options);

/* Cameras, rotation of the object and images[8][size][size][channels] of the draw (seed, draw,
 * item): the object at object * p, seen by `camera`, lit from the world's fixed direction. A point
 * p of the mesh is asked for at object * p. The object's box should be centred with diagonal 1.
 * LF_BAD_INPUT: size below 2 or above 8192, rays out of range. */
lf_status lf_views_make(const lf_surface *surface, const lf_views_options *options, uint64_t seed,
                        uint64_t draw, uint64_t item, lf_camera camera[LF_CUBE_VIEWS],
                        double object[9], float *images, lf_error *err);

/* The images alone, of cameras and object rotation that the caller gives (a draw of
 * lf_setting_draw, or one that was turned since): square cameras of options->size pixels;
 * options->setting is not used. Errors as lf_views_make. */
lf_status lf_views_render(const lf_surface *surface, const lf_views_options *options,
                          const lf_camera camera[LF_CUBE_VIEWS], const double object[9],
                          float *images, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
