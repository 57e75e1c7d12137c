/* iso_grid.h: the finest grid of an extraction, sparsely filled; of isosurface.c and iso_mesh.c.
 *
 * Points have indices -1 .. resolution + 1 along each axis, cells -1 .. resolution: one layer
 * around the cube whose points are known to be outside (value = infinity). Index i lies at -half +
 * 2 half i / resolution, on every level the same number.
 */
#ifndef LF_EVAL_ISO_GRID_H
#define LF_EVAL_ISO_GRID_H

#include <stdint.h>

#include "autograd/status.h"
#include "datasets/mesh.h"

typedef struct lf_iso_grid {
    double half;
    int resolution;
    float *value;    /* [side + 1]^3, x fastest; +infinity where invalid or around the cube */
    uint8_t *known;  /* [side + 1]^3: value is set, or will be at the next flush */
    uint8_t *active; /* [side]^3: all eight corners of the cell are known */
} lf_iso_grid;

/* Cells a side with the layer around. */
static inline long lf_iso_side(const lf_iso_grid *g)
{
    return g->resolution + 2;
}

static inline long lf_iso_point(const lf_iso_grid *g, long x, long y, long z)
{
    const long n = lf_iso_side(g) + 1;
    return ((z + 1) * n + (y + 1)) * n + (x + 1);
}

static inline long lf_iso_cell(const lf_iso_grid *g, long x, long y, long z)
{
    const long n = lf_iso_side(g);
    return ((z + 1) * n + (y + 1)) * n + (x + 1);
}

static inline double lf_iso_position(const lf_iso_grid *g, long index)
{
    return -g->half + 2 * g->half * (double)index / g->resolution;
}

/* March through the active cells in index order; corners of other cells are never read. */
lf_status lf_iso_mesh(const lf_iso_grid *grid, lf_mesh **out, lf_error *err);

#endif
