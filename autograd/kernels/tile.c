/* tile.c: the register tiles (tile.h), one function for each number of rows and vectors.
 *
 * The bodies are inlined with constant sizes, so that the accumulators live in registers; a table
 * picks the function. With 12 x 2 vectors, a step of the sum is 24 multiply-adds on 14 loads.
 */
#include "autograd/kernels/tile.h"

#define UNROLL _Pragma("GCC unroll 16")

/* ---- rows of a result ------------------------------------------------------------------------ */

/* Vectors at y, of which the last has `last` numbers; whole: all of them, known when compiled. */
LF_INLINE void load_row(const int vectors, const bool whole, const lf_real *y, long last,
                        lf_vec *row)
{
    UNROLL for (int v = 0; v < vectors - 1; v++) row[v] = lf_vec_load(y + v * LF_LANES);
    y += (vectors - 1) * LF_LANES;
    row[vectors - 1] = whole ? lf_vec_load(y) : lf_vec_load_part(y, last);
}

LF_INLINE void store_row(const int vectors, const bool whole, lf_real *y, long last,
                         const lf_vec *row)
{
    UNROLL for (int v = 0; v < vectors - 1; v++) lf_vec_store(y + v * LF_LANES, row[v]);
    y += (vectors - 1) * LF_LANES;
    if (whole)
        lf_vec_store(y, row[vectors - 1]);
    else
        lf_vec_store_part(y, last, row[vectors - 1]);
}

/* ---- product --------------------------------------------------------------------------------- */

/* Where a tile's rows are: listed, or evenly spaced. */
typedef struct places {
    const lf_real *const *x;
    lf_real *const *y;
    const lf_real *x0;
    lf_real *y0;
    long x_step, y_step;
} places;

typedef lf_vec sums[LF_TILE][3];

LF_INLINE lf_real *result_row(const bool even, const places *at, long column, int r)
{
    return (even ? at->y0 + r * at->y_step : at->y[r]) + column;
}

/* The results of a tile from its sums. */
LF_INLINE void finish(const int rows, const int vectors, const bool even, const bool whole,
                      const lf_product *p, const places *at, sums sum)
{
    const long last = p->width - (vectors - 1) * LF_LANES, column = p->column;
    const bool relu = p->act == LF_RELU;
    if (!p->start)
        UNROLL for (int r = 0; r < rows; r++)
        {
            lf_vec old[3];
            load_row(vectors, whole, result_row(even, at, column, r), last, old);
            UNROLL for (int v = 0; v < vectors; v++) sum[r][v] += old[v];
        }
    if (relu)
        UNROLL for (int r = 0; r < rows; r++) UNROLL for (int v = 0; v < vectors; v++) sum[r][v] =
            lf_vec_relu(sum[r][v]);
    UNROLL for (int r = 0; r < rows; r++)
        store_row(vectors, whole, result_row(even, at, column, r), last, sum[r]);
}

LF_INLINE void product(const int rows, const int vectors, const bool even, const lf_product *p,
                       const places *at)
{
    sums sum;
    const lf_real *from[LF_TILE];
    const lf_real *b = p->panel;
    UNROLL for (int r = 0; r < rows; r++) from[r] = even ? at->x0 + r * at->x_step : at->x[r];
    UNROLL for (int r = 0; r < rows; r++) UNROLL for (int v = 0; v < vectors; v++) sum[r][v] =
        p->start ? lf_vec_load(p->start + v * LF_LANES) : (lf_vec){0};
    for (long s = 0; s < p->window.segments; s++) {
        for (long k = 0; k < p->window.run; k++, b += p->panel_step) {
            lf_vec bv[3];
            UNROLL for (int v = 0; v < vectors; v++) bv[v] = lf_vec_load(b + v * LF_LANES);
            UNROLL for (int r = 0; r < rows; r++)
            {
                const lf_vec a = lf_vec_all(from[r][k]);
                UNROLL for (int v = 0; v < vectors; v++) sum[r][v] += a * bv[v];
            }
        }
        UNROLL for (int r = 0; r < rows; r++) from[r] += p->window.step;
    }
    /* copies, which stores to results do not change */
    const lf_product own = *p;
    const places there = *at;
    if (own.width == vectors * LF_LANES)
        finish(rows, vectors, even, true, &own, &there, sum);
    else
        finish(rows, vectors, even, false, &own, &there, sum);
}

/* ---- outer ----------------------------------------------------------------------------------- */

LF_INLINE void outer(const int rows, const int vectors, const lf_pixels *g, long width,
                     const lf_real *x, const lf_real *y, lf_real *w, long w_step)
{
    const long last = width - (vectors - 1) * LF_LANES;
    sums sum;
    UNROLL for (int i = 0; i < rows; i++) UNROLL for (int v = 0; v < vectors; v++) sum[i][v] =
        (lf_vec){0};
    UNROLL for (int i = 0; i < rows; i++) UNROLL for (int v = 0; v < vectors; v++)
        __builtin_prefetch(w + i * w_step + v * LF_LANES, 1);
    for (long l = 0, n = 0; n < g->images; l + 1 < g->lines ? l++ : (l = 0, n++)) {
        const lf_real *xp = x + n * g->x_image + l * g->x_line;
        const lf_real *yp = y + n * g->y_image + l * g->y_line;
        for (long j = 0; j < g->columns; j++, xp += g->x_step, yp += g->y_step) {
            lf_vec yv[3];
            UNROLL for (int v = 0; v < vectors; v++) yv[v] = lf_vec_load(yp + v * LF_LANES);
            UNROLL for (int i = 0; i < rows; i++)
            {
                const lf_vec a = lf_vec_all(xp[i]);
                UNROLL for (int v = 0; v < vectors; v++) sum[i][v] += a * yv[v];
            }
        }
    }
    /* All of it at once: each term would be rounded to what w has already. A row that ends within a
     * vector is stored after the next one is loaded, which would wait for it. */
    const bool whole = last == LF_LANES;
    UNROLL for (int i = 0; i < rows; i++)
    {
        lf_vec old[3];
        load_row(vectors, false, w + i * w_step, last, old);
        UNROLL for (int v = 0; v < vectors; v++) sum[i][v] += old[v];
        if (whole)
            store_row(vectors, true, w + i * w_step, last, sum[i]);
    }
    if (!whole)
        UNROLL for (int i = 0; i < rows; i++)
            store_row(vectors, false, w + i * w_step, last, sum[i]);
}

/* ---- one function a size --------------------------------------------------------------------- */

typedef void product_fn(const lf_product *p, const places *at);
typedef void outer_fn(const lf_pixels *g, long width, const lf_real *x, const lf_real *y,
                      lf_real *w, long w_step);

#define TILE(rows, vectors)                                                                        \
    static void listed_##rows##x##vectors(const lf_product *p, const places *at)                   \
    {                                                                                              \
        product(rows, vectors, false, p, at);                                                      \
    }                                                                                              \
    static void even_##rows##x##vectors(const lf_product *p, const places *at)                     \
    {                                                                                              \
        product(rows, vectors, true, p, at);                                                       \
    }                                                                                              \
    static void outer_##rows##x##vectors(const lf_pixels *g, long width, const lf_real *x,         \
                                         const lf_real *y, lf_real *w, long w_step)                \
    {                                                                                              \
        outer(rows, vectors, g, width, x, y, w, w_step);                                           \
    }
#define TILES_4(v) TILE(1, v) TILE(2, v) TILE(3, v) TILE(4, v)
#define TILES_6(v) TILES_4(v) TILE(5, v) TILE(6, v)
#define TILES_8(v) TILES_6(v) TILE(7, v) TILE(8, v)
#define TILES_12(v) TILES_8(v) TILE(9, v) TILE(10, v) TILE(11, v) TILE(12, v)
#define NAMES_4(f, v) f##_1x##v, f##_2x##v, f##_3x##v, f##_4x##v
#define NAMES_6(f, v) NAMES_4(f, v), f##_5x##v, f##_6x##v
#define NAMES_8(f, v) NAMES_6(f, v), f##_7x##v, f##_8x##v
#define NAMES_12(f, v) NAMES_8(f, v), f##_9x##v, f##_10x##v, f##_11x##v, f##_12x##v

#if defined(__AVX512F__) || defined(__aarch64__)
TILES_12(1)
TILES_12(2)
TILES_8(3)
#define TABLE(f)                                                                                   \
    {                                                                                              \
        {NAMES_12(f, 1)}, {NAMES_12(f, 2)},                                                        \
        {                                                                                          \
            NAMES_8(f, 3)                                                                          \
        }                                                                                          \
    }
#else
TILES_6(1)
TILES_6(2)
TILES_4(3)
#define TABLE(f)                                                                                   \
    {                                                                                              \
        {NAMES_6(f, 1)}, {NAMES_6(f, 2)},                                                          \
        {                                                                                          \
            NAMES_4(f, 3)                                                                          \
        }                                                                                          \
    }
#endif

static product_fn *const listed[3][LF_TILE] = TABLE(listed);
static product_fn *const even[3][LF_TILE] = TABLE(even);
static outer_fn *const outers[3][LF_TILE] = TABLE(outer);

/* Row of the tables for a width. */
static long table_row(long width)
{
    return (width - 1) / LF_LANES;
}

void lf_tile_product(const lf_product *p, long rows, const lf_real *const *x, lf_real *const *y)
{
    const long most = lf_tile_rows(p->width);
    places at = {.x = x, .y = y};
    for (long n; rows > 0; rows -= n, at.x += n, at.y += n) {
        n = lf_next_part(rows, most);
        listed[table_row(p->width)][n - 1](p, &at);
    }
}

void lf_tile_product_even(const lf_product *p, long rows, const lf_real *x, long x_step, lf_real *y,
                          long y_step)
{
    const long most = lf_tile_rows(p->width);
    places at = {.x0 = x, .y0 = y, .x_step = x_step, .y_step = y_step};
    for (long n; rows > 0; rows -= n, at.x0 += n * x_step, at.y0 += n * y_step) {
        n = lf_next_part(rows, most);
        even[table_row(p->width)][n - 1](p, &at);
    }
}

void lf_tile_outer(const lf_pixels *g, long rows, long width, const lf_real *x, const lf_real *y,
                   lf_real *w, long w_step)
{
    const long most = lf_tile_rows(width);
    for (long n; rows > 0; rows -= n, x += n, w += n * w_step) {
        n = lf_next_part(rows, most);
        outers[table_row(width)][n - 1](g, width, x, y, w, w_step);
    }
}
