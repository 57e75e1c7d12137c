/* tile.c: the register tiles (tile.h), one function for each number of rows and vectors.
 *
 * The bodies are inlined with constant sizes, so that the accumulators live in registers; a table
 * picks the function. With 12 x 2 vectors, a step of the sum is 24 multiply-adds on 14 loads.
 */
#include "autograd/kernels/tile.h"

#define UNROLL _Pragma("GCC unroll 16")

/* ---- product --------------------------------------------------------------------------------- */

typedef void product_fn(const lf_product *p, const lf_real *const *x, lf_real *const *y);

/* Load or store one row of a tile whose last vector holds `width` % LF_LANES numbers or is whole.
 */
LF_INLINE void load_row(const int vectors, const lf_real *y, long width, lf_vec *row)
{
    const long last = width - (vectors - 1) * LF_LANES;
    if (vectors == 2)
        row[0] = lf_vec_load(y);
    row[vectors - 1] = last == LF_LANES ? lf_vec_load(y + (vectors - 1) * LF_LANES)
                                        : lf_vec_load_part(y + (vectors - 1) * LF_LANES, last);
}

LF_INLINE void store_row(const int vectors, lf_real *y, long width, const lf_vec *row)
{
    const long last = width - (vectors - 1) * LF_LANES;
    if (vectors == 2)
        lf_vec_store(y, row[0]);
    if (last == LF_LANES)
        lf_vec_store(y + (vectors - 1) * LF_LANES, row[vectors - 1]);
    else
        lf_vec_store_part(y + (vectors - 1) * LF_LANES, last, row[vectors - 1]);
}

LF_INLINE void product(const int rows, const int vectors, const lf_product *p,
                       const lf_real *const *x, lf_real *const *y)
{
    lf_vec sum[LF_TILE][2];
    const lf_real *from[LF_TILE];
    const lf_real *b = p->panel;
    UNROLL for (int r = 0; r < rows; r++) from[r] = x[r];
    if (p->start)
        UNROLL for (int r = 0; r < rows; r++) UNROLL for (int v = 0; v < vectors; v++) sum[r][v] =
            lf_vec_load(p->start + v * LF_LANES);
    else
        UNROLL for (int r = 0; r < rows; r++) load_row(vectors, y[r] + p->column, p->width, sum[r]);
    for (long s = 0; s < p->window.segments; s++) {
        for (long k = 0; k < p->window.run; k++, b += p->panel_step) {
            lf_vec bv[2];
            UNROLL for (int v = 0; v < vectors; v++) bv[v] = lf_vec_load(b + v * LF_LANES);
            UNROLL for (int r = 0; r < rows; r++)
            {
                const lf_vec a = lf_vec_all(from[r][k]);
                UNROLL for (int v = 0; v < vectors; v++) sum[r][v] += a * bv[v];
            }
        }
        UNROLL for (int r = 0; r < rows; r++) from[r] += p->window.step;
    }
    if (p->act == LF_RELU)
        UNROLL for (int r = 0; r < rows; r++) UNROLL for (int v = 0; v < vectors; v++) sum[r][v] =
            lf_vec_relu(sum[r][v]);
    UNROLL for (int r = 0; r < rows; r++) store_row(vectors, y[r] + p->column, p->width, sum[r]);
}

/* ---- outer ----------------------------------------------------------------------------------- */

typedef void outer_fn(const lf_pixels *g, long width, const lf_real *x, const lf_real *y,
                      lf_real *w, long w_step);

LF_INLINE void outer(const int rows, const int vectors, const lf_pixels *g, long width,
                     const lf_real *x, const lf_real *y, lf_real *w, long w_step)
{
    lf_vec sum[LF_TILE][2];
    UNROLL for (int i = 0; i < rows; i++) load_row(vectors, w + i * w_step, width, sum[i]);
    for (long l = 0; l < g->lines; l++) {
        const lf_real *xp = x + l * g->x_line, *yp = y + l * g->y_line;
        for (long j = 0; j < g->columns; j++, xp += g->x_step, yp += g->y_step) {
            lf_vec yv[2];
            UNROLL for (int v = 0; v < vectors; v++) yv[v] = lf_vec_load(yp + v * LF_LANES);
            UNROLL for (int i = 0; i < rows; i++)
            {
                const lf_vec a = lf_vec_all(xp[i]);
                UNROLL for (int v = 0; v < vectors; v++) sum[i][v] += a * yv[v];
            }
        }
    }
    UNROLL for (int i = 0; i < rows; i++) store_row(vectors, w + i * w_step, width, sum[i]);
}

/* ---- one function a size --------------------------------------------------------------------- */

#define TILE(rows, vectors)                                                                        \
    static void product_##rows##x##vectors(const lf_product *p, const lf_real *const *x,           \
                                           lf_real *const *y)                                      \
    {                                                                                              \
        product(rows, vectors, p, x, y);                                                           \
    }                                                                                              \
    static void outer_##rows##x##vectors(const lf_pixels *g, long width, const lf_real *x,         \
                                         const lf_real *y, lf_real *w, long w_step)                \
    {                                                                                              \
        outer(rows, vectors, g, width, x, y, w, w_step);                                           \
    }
#define TILES(rows) TILE(rows, 1) TILE(rows, 2)
TILES(1)
TILES(2)
TILES(3) TILES(4) TILES(5) TILES(6)
#define PRODUCTS_6(v)                                                                              \
    product_1x##v, product_2x##v, product_3x##v, product_4x##v, product_5x##v, product_6x##v
#define OUTERS_6(v) outer_1x##v, outer_2x##v, outer_3x##v, outer_4x##v, outer_5x##v, outer_6x##v
#if defined(__AVX512F__) || defined(__aarch64__)
    TILES(7) TILES(8) TILES(9) TILES(10) TILES(11) TILES(12)
#define PRODUCTS(v)                                                                                \
    PRODUCTS_6(v), product_7x##v, product_8x##v, product_9x##v, product_10x##v, product_11x##v,    \
        product_12x##v
#define OUTERS(v)                                                                                  \
    OUTERS_6(v), outer_7x##v, outer_8x##v, outer_9x##v, outer_10x##v, outer_11x##v, outer_12x##v
#else
#define PRODUCTS(v) PRODUCTS_6(v)
#define OUTERS(v) OUTERS_6(v)
#endif

        static product_fn *const products[2][LF_TILE] = {{PRODUCTS(1)}, {PRODUCTS(2)}};
static outer_fn *const outers[2][LF_TILE] = {{OUTERS(1)}, {OUTERS(2)}};

void lf_tile_product(const lf_product *p, long rows, const lf_real *const *x, lf_real *const *y)
{
    products[p->width > LF_LANES][rows - 1](p, x, y);
}

void lf_tile_outer(const lf_pixels *g, long rows, long width, const lf_real *x, const lf_real *y,
                   lf_real *w, long w_step)
{
    outers[width > LF_LANES][rows - 1](g, width, x, y, w, w_step);
}
