/* tile.h: the two register tiles that all products and convolutions are made of.
 *
 * A tile is up to 12 rows by one or two vectors, or 8 rows by three, of a result, held in registers
 * while a sum runs:
 *
 *   product   y[r, :] (+)= sum_k x_r[k] b[k, :]          rows anywhere in memory, b a packed panel
 *   outer     w[i, :]  += sum_p x_p[i] y_p[:]            pixels p on a regular grid
 *
 * Every element's sum runs over k (or p) in order, whatever the tile's size: how a result is cut
 * into tiles changes no bit of it. What is in memory is added to it once, at the end, so that a sum
 * of many blocks is rounded to its own size once a block and not once a term.
 *
 * The columns of a result are cut into panels of two vectors; the last panel has what remains, up
 * to three vectors, so that a few columns too many do not cost a pass of their own.
 */
#ifndef LF_AUTOGRAD_KERNELS_TILE_H
#define LF_AUTOGRAD_KERNELS_TILE_H

#include "autograd/kernels/kernels.h"
#include "autograd/kernels/vector.h"

/* 12 x 2 or 8 x 3 accumulators of 32 vector registers; 6 x 2 or 4 x 3 of 16. */
#if defined(__AVX512F__) || defined(__aarch64__)
enum { LF_TILE = 12, LF_TILE_3 = 8 };
#else
enum { LF_TILE = 6, LF_TILE_3 = 4 };
#endif

enum {
    LF_PANEL = 2 * LF_LANES, /* columns of every panel but the last */
    LF_LAST_PANEL = 3 * LF_LANES
};

static inline long lf_panels(long columns)
{
    return columns <= LF_LAST_PANEL ? 1 : (columns - LF_LANES + LF_PANEL - 1) / LF_PANEL;
}

/* Columns of the panel that starts at column `first` of `columns`. */
static inline long lf_panel_width(long columns, long first)
{
    return columns - first <= LF_LAST_PANEL ? columns - first : LF_PANEL;
}

/* Numbers in a row of a panel: whole vectors. */
static inline long lf_panel_step(long width)
{
    return (width + LF_LANES - 1) / LF_LANES * LF_LANES;
}

/* Rows of a tile of that width at most. */
static inline long lf_tile_rows(long width)
{
    return width > LF_PANEL ? LF_TILE_3 : LF_TILE;
}

/* Cut `total` into the fewest parts of at most `most`, nearly equal: the length of the next part.
 */
static inline long lf_next_part(long total, long most)
{
    const long parts = (total + most - 1) / most;
    return (total + parts - 1) / parts;
}

/* ---- product --------------------------------------------------------------------------------- */

/* The numbers of one row: `segments` runs of `run` adjacent numbers, `step` numbers apart. */
typedef struct lf_window {
    long segments, run, step;
} lf_window;

/* What is the same for all tiles of a panel. */
typedef struct lf_product {
    lf_window window;
    const lf_real *panel; /* [segments * run][panel_step], readable in whole vectors */
    long panel_step;
    long column, width;   /* the panel's place in a result row; 1 <= width <= LF_LAST_PANEL */
    const lf_real *start; /* [panel_step] the sums' first terms, or NULL: the result's own values */
    lf_activation act;
} lf_product;

/* Result rows y[0 .. rows) from window starts x[0 .. rows); rows >= 0. */
void lf_tile_product(const lf_product *p, long rows, const lf_real *const *x, lf_real *const *y);
/* The same for evenly spaced rows: x + r * x_step to y + r * y_step. */
void lf_tile_product_even(const lf_product *p, long rows, const lf_real *x, long x_step, lf_real *y,
                          long y_step);

/* ---- outer ----------------------------------------------------------------------------------- */

/* A grid of pixels: `images` images of `lines` lines of `columns` pixels. */
typedef struct lf_pixels {
    long images, lines, columns;
    long x_image, x_line, x_step; /* from image to image, line to line, pixel to pixel, in x */
    long y_image, y_line, y_step;
} lf_pixels;

/* w[i * w_step + o] += sum over pixels of x[i] y[o], i < rows, o < width <= LF_LAST_PANEL.
 * y is read in whole vectors. */
void lf_tile_outer(const lf_pixels *g, long rows, long width, const lf_real *x, const lf_real *y,
                   lf_real *w, long w_step);

/* ---- panels ---------------------------------------------------------------------------------- */

/* panel[l, j] = b[l * step + j], j < width, l < k; zeros fill the last vector. */
void lf_pack(long k, long width, const lf_real *b, long step, lf_real *panel);
/* panel[l, j] = b[j * step + l] */
void lf_pack_transposed(long k, long width, const lf_real *b, long step, lf_real *panel);

/* sum[j] += sum_r y[r * step + j], r < rows, j < width */
void lf_column_sums(long rows, long width, const lf_real *y, long step, lf_real *sum);

#endif
