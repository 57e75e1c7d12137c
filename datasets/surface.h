/* surface.h: a triangle mesh with an index for rays and closest points (Embree 3 or 4).
 *
 * Embree works in float. Vertices are recentred at the box and scaled to a diagonal of 1 before it
 * sees them, and what it finds is computed again in double from the mesh's own triangle: the
 * distance of a closest point is exact to 1e-6 of the box's diagonal (usually 1e-12), so is the
 * distance along a ray. Which triangle a ray meets is decided in float: a ray that passes an edge
 * within 1e-7 of the diagonal may take either side (robust mode: never slips between the two).
 *
 * Handles: the surface keeps its own copy of the mesh; close it once; closing NULL does nothing.
 * Threads: queries on one handle may run in parallel; the batch functions do so by themselves.
 */
#ifndef LF_DATASETS_SURFACE_H
#define LF_DATASETS_SURFACE_H

#include <stdbool.h>
#include <stdint.h>

#include "autograd/status.h"
#include "datasets/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct lf_surface lf_surface;

typedef struct lf_hit {
    long face;        /* index into the mesh; -1: nothing met */
    double distance;  /* along the direction, in units of its length */
    double normal[3]; /* unit, by the order of the triangle's corners */
} lf_hit;

typedef struct lf_closest {
    long face;       /* -1: the query point is not finite */
    double distance; /* NAN where the query point is not finite */
    double point[3];
} lf_closest;

/* Index a mesh. LF_BAD_INPUT: no faces, a vertex that is not finite or beyond 1e30, a face whose
 * corner is no vertex, no triangle of positive area. LF_FAILED: Embree or memory.
 * A ray known to hit is cast once, so an Embree that misses everything is refused. */
lf_status lf_surface_open(const lf_mesh *mesh, lf_surface **out, lf_error *err);
/* The same with the faces where keep[face] != 0 only (keep NULL: all). Face numbers stay. */
lf_status lf_surface_open_part(const lf_mesh *mesh, const uint8_t *keep, lf_surface **out,
                               lf_error *err);
void lf_surface_close(lf_surface *surface);

/* The copy that the surface keeps, the centre of its box and the box's diagonal. */
const lf_mesh *lf_surface_mesh(const lf_surface *surface);
void lf_surface_centre(const lf_surface *surface, double out[3]);
double lf_surface_diagonal(const lf_surface *surface);

/* First triangle met by origin + s * direction, s in [from, to]. */
bool lf_surface_first_hit(const lf_surface *surface, const double origin[3],
                          const double direction[3], double from, double to, lf_hit *out);
/* Whether anything is met. */
bool lf_surface_any_hit(const lf_surface *surface, const double origin[3],
                        const double direction[3], double from, double to);
/* Eight directions from one origin, to infinity; returns the bits of those that meet something. */
unsigned lf_surface_any_hit8(const lf_surface *surface, const double origin[3],
                             const float direction[3][8]);

/* Closest point of the surface. */
lf_closest lf_surface_closest(const lf_surface *surface, const double point[3]);

/* The distances of n points, in parallel. */
void lf_surface_distance_all(const lf_surface *surface, long n, const double (*point)[3],
                             double *out);

#ifdef __cplusplus
}
#endif
#endif
