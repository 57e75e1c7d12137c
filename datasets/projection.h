/* projection.h: where the views of shapes see points, as flat arrays.        [method.md 5a.3, 4.4]
 *
 * Made in double; what a view does not see (behind it, outside its image, at its centre) is masked.
 */
#ifndef LF_DATASETS_PROJECTION_H
#define LF_DATASETS_PROJECTION_H

#include "datasets/shapes.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct lf_projection {
    double *uv;        /* [points, 8, 2] pixels */
    double *direction; /* [points, 8, 3] unit, camera to point */
    double *distance;  /* [points, 8] */
    uint8_t *mask;     /* [points, 8] 1 = seen */
    long *first;       /* [points] number of the image of the point's first view */
    double *position;  /* [points, 3] the point itself, in the object's frame */
    double *bearing;   /* [points, 8, 3] the directions in the object's frame */
} lf_projection;

/* Room for so many points; aborts if memory runs out. Free it once. */
lf_projection lf_projection_create(long points);
void lf_projection_free(lf_projection *p);

/* Fill the places [at, at + count) with `point`, seen at object * p by the 8 cameras of `views`,
 * whose images are numbered from `first`. In parallel over the points. */
void lf_projection_fill(lf_projection *p, long at, long count, const double (*point)[3],
                        const lf_shape_views *views, long first);

#ifdef __cplusplus
}
#endif
#endif
