/* isosurface.h: the surface value = 0 of a scalar field, as a closed triangle mesh.
 *
 * Marching cubes over a grid of resolution^3 cells on the cube [-half, half]^3, resolution =
 * coarse * 2^refinements. Inside iff value < 0, strictly. A vertex lies on a cell edge at the
 * linear zero, its parameter kept within [1e-4, 1 - 1e-4] so that no triangle has zero area
 * [method.md 4.8]. The world beyond the cube counts as outside, so a surface that leaves the cube
 * is closed by the cube's own faces; a point that the field calls invalid (or whose value is NaN)
 * counts as outside too. The mesh is a closed 2-manifold, faces counter-clockwise seen from outside
 * (mc_table.h says why), vertices shared.
 *
 * Coarse to fine [method.md 6, "MISE"]: starting from the coarse grid, the centre of a cell is
 * evaluated if its corners differ in sign or some corner has |value| <= lipschitz * half the cell's
 * diagonal; then an eighth of the cell is kept if its corner and the centre differ in sign or one
 * of the two has |value| <= lipschitz * sqrt(5)/4 of the cell's edge, as no surface can be in any
 * other part of a field with that Lipschitz constant. On the finest grid the surface is then
 * followed into every cell that it enters. So the mesh is always closed, and it is the dense grid's
 * mesh, bit for bit, unless a whole component hides where the field is steeper than that. `dense`
 * evaluates every grid point instead.
 */
#ifndef LF_EVAL_ISOSURFACE_H
#define LF_EVAL_ISOSURFACE_H

#include <stdbool.h>
#include <stdint.h>

#include "autograd/status.h"
#include "datasets/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The field at n points: value[i] (negative inside; the unit of `points` if lipschitz is to mean
 * anything) and valid[i] (1 on entry; 0 = the field has no opinion there). A value must depend on
 * its own point alone, not on the batch. Called from one thread at a time. */
typedef void lf_field_fn(void *context, long n, const double (*points)[3], float *value,
                         uint8_t *valid);

#define LF_ISO_RESOLUTION_MAX 1024

typedef struct lf_iso_options {
    double half;      /* half the cube's edge; default 0.55 */
    int coarse;       /* cells a side of the first grid; default 32 */
    int refinements;  /* how often cells are halved; default 2 (32 -> 128) */
    double lipschitz; /* largest slope of the field that is trusted; default 1 */
    bool dense;       /* evaluate every point of the finest grid */
    long batch;       /* points a call of the field, at most; default 65536 */
} lf_iso_options;

lf_iso_options lf_iso_defaults(void);

typedef struct lf_iso_report {
    int resolution;         /* cells a side of the finest grid */
    long evaluations;       /* points at which the field was evaluated */
    long dense_evaluations; /* (resolution + 1)^3 */
    long steps, steep; /* from split cells' centres to their corners; those steeper than trusted */
    long invalid;      /* evaluated points that were invalid or NaN, taken as outside */
} lf_iso_report;

/* Extract the surface into a new mesh, which the caller frees with lf_mesh_free. A field without an
 * inside gives a mesh without faces and LF_OK. `report` may be NULL. Memory: about 6 bytes a
 * point of the finest grid, beside the mesh.
 * LF_BAD_INPUT: an option out of range (half > 0, coarse >= 2, refinements >= 0, resolution <=
 * LF_ISO_RESOLUTION_MAX, lipschitz >= 0, batch >= 1). LF_FAILED: not enough memory. */
lf_status lf_isosurface(const lf_iso_options *options, lf_field_fn *field, void *context,
                        lf_mesh **out, lf_iso_report *report, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
