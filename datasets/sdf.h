/* sdf.h: signed distance (negative inside) of triangle meshes as real collections hold them: open,
 * self-intersecting, with inner parts, of either orientation.                    [method.md 4.8]
 *
 * Sign, by `method`:
 *
 *   LF_SDF_ESCAPE    inside iff fewer than 2 of 128 fixed directions leave the mesh without a hit.
 *                    Needs no orientation; a hole of more than 2/128 of the sky opens the inside.
 *
 *   LF_SDF_WINDING   inside iff the generalised winding number is above 1/2, faces oriented by
 *                    visibility: the side that more directions leave from is outside. Bridges
 * holes.
 *
 *   LF_SDF_COMBINED  the default: closed meshes by the winding number, which is whole; others by
 *                    the escape rule or, where that says outside, by the winding number as long as
 *                    less than half of the directions escape.
 *
 * Distance: to the triangles that are seen from outside, then minus `thickness`, so that an open
 * sheet becomes a solid of twice that. Closed meshes need no thickness: 0 is exact.
 */
#ifndef LF_DATASETS_SDF_H
#define LF_DATASETS_SDF_H

#include <stdint.h>

#include "autograd/status.h"
#include "datasets/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum lf_sdf_method { LF_SDF_COMBINED, LF_SDF_ESCAPE, LF_SDF_WINDING } lf_sdf_method;

typedef struct lf_sdf_options {
    lf_sdf_method method;
    int directions;   /* 8 ... 1024, a multiple of 8 */
    double thickness; /* subtracted from the distance; the mesh's unit */
} lf_sdf_options;

/* Combined, 128 directions, thickness 0. */
lf_sdf_options lf_sdf_defaults(void);

/* What the preparation found. */
typedef struct lf_sdf_report {
    long faces;      /* of positive area */
    long hidden;     /* not seen from outside, left out of the distance */
    long open_edges; /* edges (vertices joined by position) with an odd number of faces */
    long edges;
    int closed; /* 1: no edge is open after orienting; the winding number is whole */
} lf_sdf_report;

typedef struct lf_sdf lf_sdf;

/* Prepare a mesh; keeps its own copy. Errors as lf_surface_open, and options out of range. */
lf_status lf_sdf_open(const lf_mesh *mesh, const lf_sdf_options *options, lf_sdf **out,
                      lf_error *err);
void lf_sdf_close(lf_sdf *sdf);
lf_sdf_report lf_sdf_report_of(const lf_sdf *sdf);

/* Signed distance of n points, in parallel; NAN for a point that is not finite. *doubtful (may be
 * NULL) counts the points where 1 to 7 of 128 directions (in proportion) escape: the sign
 * there hangs on a few rays. A closed mesh has none unless the method is LF_SDF_ESCAPE. The values
 * do not depend on the thread count. */
void lf_sdf_eval(const lf_sdf *sdf, long n, const double (*point)[3], double *out, long *doubtful);

/* Training samples out[n_uniform + n_near][4] = x, y, z, sdf: n_uniform uniform in the cube of half
 * edge 0.55 x the longest box edge round the box's centre, then n_near points of the surface
 * (area-uniform, seen from outside) moved by a normal offset of sigma 0.01 or 0.03 (equal chance)
 * an axis, in units of the box's diagonal. A pure function of (mesh, options, seed, item). */
void lf_sdf_samples(const lf_sdf *sdf, long n_uniform, long n_near, uint64_t seed, uint64_t item,
                    float (*out)[4], long *doubtful);

#ifdef __cplusplus
}
#endif
#endif
