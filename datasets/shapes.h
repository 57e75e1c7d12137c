/* shapes.h: a split of a category as training and evaluation see it: views and signed distances.
 *
 * A category is a folder of meshes (category.h) or one of the built-in procedural families
 * (procedural.h). A shape is normalised (box centred, diagonal 1), rendered from eight views in one
 * of the settings, and sampled: points uniform in the cube of 1.1 times its longest box edge and
 * points near its surface. Views are kept with 8 bits a channel, as if they were read from files.
 *
 * Everything is a function of the options: no order of calls and no number of threads changes it.
 * Built-in shapes are the same for every run; train, val and test are disjoint.
 */
#ifndef LF_DATASETS_SHAPES_H
#define LF_DATASETS_SHAPES_H

#include "datasets/sdf.h"
#include "datasets/views.h"

#ifdef __cplusplus
extern "C" {
#endif

#define LF_BUILTIN "builtin" /* the root of the procedural families */

typedef struct lf_shapes_options {
    const char *root, *category, *split; /* split: train, val or test */
    long builtin; /* shapes of a built-in split; of a folder: added built-in ones (train only) */
    long limit;   /* at most so many shapes of a folder; 0: all */
    lf_sdf_method sign;
    double thickness; /* below 0: 0.004 for files, 0 for built-in shapes */
    long points_uniform, points_near;
    lf_views_options views;
    long draws;    /* draws of the setting kept for a shape (1 in setting I) */
    uint64_t seed; /* of the samples and draws */
} lf_shapes_options;

typedef struct lf_shapes lf_shapes;

/* List the shapes; nothing is read yet. Errors as category.h, an unknown built-in family, or no
 * built-in shape asked for. */
lf_status lf_shapes_open(const lf_shapes_options *options, lf_shapes **out, lf_error *err);
void lf_shapes_close(lf_shapes *shapes);
long lf_shapes_count(const lf_shapes *shapes);
const char *lf_shapes_id(const lf_shapes *shapes, long index);
bool lf_shapes_is_builtin(const lf_shapes *shapes, long index);
/* Bytes that all kept views and points will take. */
size_t lf_shapes_bytes(const lf_shapes *shapes);

/* Read, render and sample every shape, in parallel. `progress` (may be NULL) is called with the
 * number done, one call at a time. The first bad shape ends it, with its path in the message. */
typedef void lf_shapes_progress(void *context, long done, long total);
lf_status lf_shapes_prepare(lf_shapes *shapes, lf_shapes_progress *progress, void *context,
                            lf_error *err);
/* Samples where the sign hung on a few rays, over all prepared shapes, and all samples. */
void lf_shapes_doubtful(const lf_shapes *shapes, long *doubtful, long *samples);

/* After prepare. samples[points_uniform + points_near][4] = x, y, z, sdf: uniform first. */
const float (*lf_shapes_samples(const lf_shapes *shapes, long index))[4];
typedef struct lf_shape_views {
    const uint8_t *images; /* [8][size][size][channels], 255 = 1 */
    lf_camera camera[LF_CUBE_VIEWS];
    double object[9]; /* a point p of the shape is at object * p in front of the cameras */
} lf_shape_views;
const lf_shape_views *lf_shapes_views(const lf_shapes *shapes, long index, long draw);
/* 8 bits to 0..1, floats [n]. */
void lf_shapes_pixels(const uint8_t *images, long n, float *out);

/* One shape for evaluation, loaded afresh; release it after use. */
typedef struct lf_shape {
    lf_mesh *mesh; /* normalised */
    lf_surface *surface;
    lf_sdf *sdf;
    double longest_edge; /* of the box */
} lf_shape;
lf_status lf_shapes_load(const lf_shapes *shapes, long index, lf_shape *out, lf_error *err);
void lf_shape_release(lf_shape *shape);
/* Views of a loaded shape at a draw; images [8 size size channels], the caller's. */
lf_status lf_shapes_render(const lf_shapes *shapes, const lf_shape *shape, long index, long draw,
                           lf_shape_views *out, uint8_t *images, lf_error *err);
/* The same from cameras and an object rotation that the caller set in views. */
lf_status lf_shapes_render_views(const lf_shapes *shapes, const lf_shape *shape,
                                 lf_shape_views *views, uint8_t *images, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
