/* tile.h: the two register tiles that all products and convolutions are made of.
 *
 * A tile is LF_TILE rows by up to LF_PANEL columns of a result, held in registers while a sum runs:
 *
 *   product   y[r, :] (+)= sum_k x_r[k] b[k, :]          rows anywhere in memory, b a packed panel
 *   outer     w[i, :]  += sum_p x_p[i] y_p[:]            pixels p on a grid of lines and columns
 *
 * Every element's sum runs over k (or p) in order, whatever the tile's size: how a result is cut
 * into tiles changes no bit of it.
 */
#ifndef LF_AUTOGRAD_KERNELS_TILE_H
#define LF_AUTOGRAD_KERNELS_TILE_H

#include "autograd/kernels/kernels.h"
#include "autograd/kernels/vector.h"

/* 12 x 2 accumulators of 32 vector registers, or 6 x 2 of 16. */
#if defined(__AVX512F__) || defined(__aarch64__)
enum { LF_TILE = 12 };
#else
enum { LF_TILE = 6 };
#endif

/* The numbers of one row: `segments` runs of `run` adjacent numbers, `step` numbers apart. */
typedef struct lf_window {
    long segments, run, step;
} lf_window;

/* What is the same for all tiles of a panel. */
typedef struct lf_product {
    lf_window window;
    const lf_real *panel; /* [segments * run][panel_step], readable in whole vectors */
    long panel_step;
    long column, width;   /* the panel's place in a result row; 1 <= width <= LF_PANEL */
    const lf_real *start; /* [LF_PANEL] the sums' first terms, or NULL: the result's own values */
    lf_activation act;
} lf_product;

/* Result rows y[0 .. rows) from window starts x[0 .. rows); 1 <= rows <= LF_TILE. */
void lf_tile_product(const lf_product *p, long rows, const lf_real *const *x, lf_real *const *y);

/* A grid of pixels: `lines` lines of `columns` pixels. */
typedef struct lf_pixels {
    long lines, columns;
    long x_line, x_step; /* from line to line, and from pixel to pixel, in x */
    long y_line, y_step;
} lf_pixels;

/* w[i * w_step + o] += sum over pixels of x[i] y[o], i < rows <= LF_TILE, o < width <= LF_PANEL.
 * y is read in whole vectors. */
void lf_tile_outer(const lf_pixels *g, long rows, long width, const lf_real *x, const lf_real *y,
                   lf_real *w, long w_step);

/* ---- panels ---------------------------------------------------------------------------------- */

/* Columns of a panel that holds `width` numbers a row: one or two whole vectors. */
static inline long lf_panel_step(long width)
{
    return width > LF_LANES ? LF_PANEL : LF_LANES;
}

/* panel[l, j] = b[l * step + j], j < width, l < k; zeros fill the last vector. */
void lf_pack(long k, long width, const lf_real *b, long step, lf_real *panel);
/* panel[l, j] = b[j * step + l] */
void lf_pack_transposed(long k, long width, const lf_real *b, long step, lf_real *panel);

/* sum[j] += sum_r y[r * step + j], r < rows, j < width */
void lf_column_sums(long rows, long width, const lf_real *y, long step, lf_real *sum);

/* Cut `total` into the fewest parts of at most `most`, nearly equal: the length of the next part.
 */
static inline long lf_next_part(long total, long most)
{
    const long parts = (total + most - 1) / most;
    return (total + parts - 1) / parts;
}

#endif
