/* render.h: pictures of a surface by ray casting, diffuse, no shadows.
 *
 *   shade = 0.2 + 0.3 |<n, v>| + 0.25 (1 + <n, l>)
 * n unit normal turned to the viewer, v unit direction to the viewer, l unit direction to the
 * light. The light belongs to the world: move it with the mesh and the cameras. (Shading from the
 * viewer alone hides the edges of a box seen from a cube's corner: all three |<n, v>| are equal.)
 * A pixel is the mean over rays x rays samples of its square; images are float [height][width][c].
 * Projection and ray directions come from camera.h alone. Rows are rendered in parallel; the result
 * does not depend on the thread count.
 */
#ifndef LF_DATASETS_RENDER_H
#define LF_DATASETS_RENDER_H

#include "datasets/camera.h"
#include "datasets/mesh.h"
#include "datasets/surface.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum lf_render_mode {
    LF_RENDER_SHADE, /* 2 channels: shade x coverage, coverage */
    LF_RENDER_COLOUR /* 4 channels: red, green, blue of the face x shade x coverage, coverage */
} lf_render_mode;

typedef struct lf_light {
    double direction[3]; /* unit, towards the light, in the world */
    bool head;           /* the light is at the viewer instead (l = v) */
} lf_light;

typedef struct lf_render_options {
    lf_render_mode mode;
    int rays; /* rays x rays a pixel, 1 ... 16 */
    lf_light light;
} lf_render_options;

/* Shade and coverage, 3 x 3 rays, light (0.35, 0.8, -0.5)/|.|. */
lf_render_options lf_render_defaults(void);
int lf_render_channels(lf_render_mode mode); /* 2 or 4 */
lf_light lf_light_rotate(const lf_light *light, const double rotation[9]);

/* image [camera->height][camera->width][channels], owned by the caller. */
void lf_render(const lf_surface *surface, const lf_camera *camera, const lf_render_options *options,
               float *image);
/* What one ray that meets the surface adds to the channels of its pixel: a function of its
 * arguments, called from several threads. `point` is where they meet, `direction` (unit) points
 * from the viewer to it. */
typedef void lf_shader(const void *context, const lf_hit *hit, const double point[3],
                       const double direction[3], double *sum);
enum { LF_RENDER_CHANNELS_MAX = 4 };
/* The same pixels with a shade of the caller's: the mean over all rays of a pixel of what `shader`
 * adds, 0 for a ray that meets nothing; image [camera->height][camera->width][channels]. */
void lf_render_shaded(const lf_surface *surface, const lf_camera *camera, int rays, int channels,
                      lf_shader *shader, const void *context, float *image);
/* Depth (camera z) of the first hit at the pixel centres [height][width]; INFINITY: nothing met. */
void lf_render_depth(const lf_surface *surface, const lf_camera *camera, float *depth);

/* A picture for people: face colours shaded, over `background` (RGB, 0 ... 1), 3 x 3 rays;
 * rgb [camera->height][camera->width][3]. Errors as lf_surface_open. */
lf_status lf_render_mesh_picture(const lf_mesh *mesh, const lf_camera *camera,
                                 const float background[3], float *rgb, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
