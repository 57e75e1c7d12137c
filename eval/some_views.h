/* some_views.h: fewer than the eight views of an object. The eight stand at the corners of a cube,
 * in the order of lf_camera_cube; of n of them those are taken that see the object from the most
 * different sides: opposite corners, the corners of a tetrahedron, these and others.
 */
#ifndef LF_EVAL_SOME_VIEWS_H
#define LF_EVAL_SOME_VIEWS_H

#include "datasets/projection.h"

/* The numbers of `count` views, 1 ... LF_CUBE_VIEWS, rising, into view[count]. */
void lf_some_views(int count, int view[LF_CUBE_VIEWS]);

/* Keep these `count` views, rising, of the first `points` points, packed: uv [points, count, 2] and
 * so on. */
void lf_keep_views(lf_projection *p, long points, int count, const int *view);

#endif
