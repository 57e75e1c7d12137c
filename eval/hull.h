/* hull.h: the visual hull of views, a reconstruction that learns nothing.       [method.md 5a.9]
 *
 * The largest object that the views' outlines allow:
 *   h(p) = 1/2 - min over the views k that have p before them of m_k(u_k, v_k)
 * m_k is the mask of view k, 0 ... 1, bilinear at the projection of p, and beyond the image what it
 * is at the nearest place of the image: an object whose outline ends within the image is nowhere
 * else. Inside: h < 0, that is in all the masks. A point behind every camera is invalid, which
 * isosurface.h takes as outside.
 *
 * h is no distance: it goes from -1/2 to 1/2 within two pixels of an outline and is flat elsewhere.
 * A thin part can hide between coarse points, so extract it with lf_iso_options.dense.
 *
 * Cost: points x views bilinear samples, at most; in parallel over points. A value depends on its
 * own point alone, not on the number of threads.
 */
#ifndef LF_EVAL_HULL_H
#define LF_EVAL_HULL_H

#include "datasets/shapes.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct lf_hull {
    const lf_shape_views *views; /* borrowed, with images of the cameras' sizes, all the same */
    int channels;                /* of the images; the last is the mask */
    int count;                   /* of views that are looked at, 1 ... LF_CUBE_VIEWS */
    int view[LF_CUBE_VIEWS];     /* [count] their numbers */
} lf_hull;

/* An lf_field_fn whose context is a const lf_hull *: h at points of the shape. */
void lf_hull_field(void *hull, long n, const double (*points)[3], float *value, uint8_t *valid);

/* The definition for reports. */
const char *lf_hull_text(void);

#ifdef __cplusplus
}
#endif
#endif
