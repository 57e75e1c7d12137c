/* procedural.h: made-up chairs, airplanes and cars, for training without data and for tests.
 *
 * A shape is a union of closed parts (lofts: boxes, bars, cylinders, ellipsoids, wings), each one
 * consistently oriented, counter-clockwise seen from outside; parts overlap where they join. Hence
 * an exact inside test: a point is inside iff the winding number of some part is 1.
 *
 * Frame and unit as of real collections (ShapeNetCore.v2): y up, front towards -z (bonnet, nose,
 * the seated person's look), bounding box centred at the origin with a diagonal of 1. Chairs have
 * no part thinner than about 0.025 of the diagonal, so that a 65 x 65 picture shows them all.
 *
 * (seed, family, index) names a shape: the same on every machine up to the last bits of libm.
 */
#ifndef LF_DATASETS_PROCEDURAL_H
#define LF_DATASETS_PROCEDURAL_H

#include "datasets/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { LF_PARTS_MAX = 64 };

/* Part i has the faces [first[i], first[i + 1]) of the mesh. */
typedef struct lf_parts {
    int count;
    long first[LF_PARTS_MAX + 1];
} lf_parts;

/* Shape `index` of a family: "chair", "airplane" or "car". `parts` may be NULL. The caller frees
 * *out. LF_BAD_INPUT: unknown family. */
lf_status lf_procedural_mesh(const char *family, uint64_t seed, uint64_t index, lf_mesh **out,
                             lf_parts *parts, lf_error *err);

/* Whether p lies inside some part. Costs one pass over all faces. */
bool lf_procedural_inside(const lf_mesh *mesh, const lf_parts *parts, const double p[3]);

#ifdef __cplusplus
}
#endif
#endif
