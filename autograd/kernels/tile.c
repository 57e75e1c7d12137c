/* tile.c: the register tiles (tile.h), one function for each number of rows and vectors.
 *
 * The bodies are inlined with constant sizes, so that the accumulators live in registers; a table
 * picks the function. With 12 x 2 vectors, a step of the sum is 24 multiply-adds on 14 loads.
 * Where rows share their last vector, the function is another one; the sums are the same, bit for
 * bit.
 */
#include "autograd/kernels/tile.h"
#include "autograd/kernels/vector_math.h"

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

/* ---- rows that share a vector ------------------------------------------------------------------
 *
 * Where the last vector of a row is at most half full, two rows stand in it side by side, or four
 * where it is at most a quarter full: 24 columns of 16 lanes cost 1.5 vectors a row, not 2.
 */

#if LF_VEC_BYTES == 64 && !defined(LF_DOUBLE)
#define SHARES 1
#else
#define SHARES 0
#endif

/* The first lanes of v, `share` times. */
LF_INLINE lf_vec repeat(const int share, lf_vec v)
{
    const lf_vec_bits p = LF_VEC_COUNT;
    return share == 1 ? v : __builtin_shuffle(v, p & (LF_LANES / share - 1));
}

/* Lanes of a[0], then of a[1], ..; `rows` of them exist. */
LF_INLINE lf_vec join_rows(const int share, const int rows, const lf_vec *a)
{
    const lf_vec_bits p = LF_VEC_COUNT, half = (p & LF_LANES / 2) * 2;
    const lf_vec_bits quarter = (p & LF_LANES / 4) * 4;
    if (rows == 1)
        return a[0];
    if (share == 2)
        return __builtin_shuffle(a[0], a[1], p + half);
    const lf_vec low = __builtin_shuffle(a[0], a[1], p + quarter);
    if (rows == 2)
        return low;
    const lf_vec high = rows == 3 ? a[2] : __builtin_shuffle(a[2], a[3], p + quarter);
    return __builtin_shuffle(low, high, p + half);
}

/* The last vectors of rows -> shared ones. */
LF_INLINE void share_rows(const int rows, const int vectors, const int share, lf_vec sum[][3])
{
    if (share > 1)
        UNROLL for (int r = 0; r < rows; r += share)
        {
            lf_vec last[4];
            UNROLL for (int i = 0; i < share; i++) last[i] =
                repeat(share, sum[r + i < rows ? r + i : r][vectors - 1]);
            sum[r][vectors - 1] = join_rows(share, rows - r, last);
        }
}

/* And back, each in its first lanes. */
LF_INLINE void part_rows(const int rows, const int vectors, const int share, lf_vec sum[][3])
{
    const lf_vec_bits p = LF_VEC_COUNT;
    if (share > 1)
        UNROLL for (int r = 0; r < rows; r++) if (r % share) sum[r][vectors - 1] =
            __builtin_shuffle(sum[r - r % share][vectors - 1],
                              (p + r % share * (LF_LANES / share)) & (LF_LANES - 1));
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

/* x in all lanes of a register: the compiler would rather load it again for every use. */
LF_INLINE lf_vec broadcast(lf_real x)
{
    lf_vec v = lf_vec_all(x);
#if SHARES
    __asm__("" : "+v"(v));
#endif
    return v;
}

/* sum[r][v] += x_r b[v]. The last vector of a row is shared by `share` rows: it stands with the
 * first of them. */
#define ADD_PRODUCTS(x_r, b)                                                                       \
    UNROLL for (int r = 0; r < rows; r++)                                                          \
    {                                                                                              \
        a[r % share] = share > 1 ? broadcast(x_r) : lf_vec_all(x_r);                               \
        UNROLL for (int v = 0; v < vectors - (share > 1); v++) sum[r][v] += a[r % share] * b[v];   \
        if (share > 1 && (r % share == share - 1 || r == rows - 1))                                \
            sum[r - r % share][vectors - 1] +=                                                     \
                join_rows(share, r % share + 1, a) * b[vectors - 1];                               \
    }

LF_INLINE void product(const int rows, const int vectors, const int share, const bool even,
                       const lf_product *p, const places *at)
{
    sums sum;
    const lf_real *from[LF_TILE];
    const lf_real *b = p->panel;
    UNROLL for (int r = 0; r < rows; r++) from[r] = even ? at->x0 + r * at->x_step : at->x[r];
    UNROLL for (int r = 0; r < rows; r++) UNROLL for (int v = 0; v < vectors; v++) sum[r][v] =
        p->start ? lf_vec_load(p->start + v * LF_LANES) : (lf_vec){0};
    share_rows(rows, vectors, share, sum);
    for (long s = 0; s < p->window.segments; s++) {
        for (long k = 0; k < p->window.run; k++, b += p->panel_step) {
            lf_vec bv[3], a[4];
            UNROLL for (int v = 0; v < vectors; v++) bv[v] = lf_vec_load(b + v * LF_LANES);
            bv[vectors - 1] = repeat(share, bv[vectors - 1]);
            ADD_PRODUCTS(from[r][k], bv)
        }
        UNROLL for (int r = 0; r < rows; r++) from[r] += p->window.step;
    }
    part_rows(rows, vectors, share, sum);
    /* copies, which stores to results do not change */
    const lf_product own = *p;
    const places there = *at;
    if (own.width == vectors * LF_LANES)
        finish(rows, vectors, even, true, &own, &there, sum);
    else
        finish(rows, vectors, even, false, &own, &there, sum);
}

/* ---- outer ----------------------------------------------------------------------------------- */

LF_INLINE void outer(const int rows, const int vectors, const int share, const lf_pixels *g,
                     long width, const lf_real *x, const lf_real *y, lf_real *w, long w_step)
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
            lf_vec yv[3], a[4];
            UNROLL for (int v = 0; v < vectors; v++) yv[v] = lf_vec_load(yp + v * LF_LANES);
            yv[vectors - 1] = repeat(share, yv[vectors - 1]);
            ADD_PRODUCTS(xp[r], yv)
        }
    }
    part_rows(rows, vectors, share, sum);
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

#define TILE(rows, vectors, share)                                                                 \
    static void listed_##rows##x##vectors##x##share(const lf_product *p, const places *at)         \
    {                                                                                              \
        product(rows, vectors, share, false, p, at);                                               \
    }                                                                                              \
    static void even_##rows##x##vectors##x##share(const lf_product *p, const places *at)           \
    {                                                                                              \
        product(rows, vectors, share, true, p, at);                                                \
    }                                                                                              \
    static void outer_##rows##x##vectors##x##share(const lf_pixels *g, long width,                 \
                                                   const lf_real *x, const lf_real *y, lf_real *w, \
                                                   long w_step)                                    \
    {                                                                                              \
        outer(rows, vectors, share, g, width, x, y, w, w_step);                                    \
    }
#define TILES_4(v, s) TILE(1, v, s) TILE(2, v, s) TILE(3, v, s) TILE(4, v, s)
#define TILES_6(v, s) TILES_4(v, s) TILE(5, v, s) TILE(6, v, s)
#define TILES_8(v, s) TILES_6(v, s) TILE(7, v, s) TILE(8, v, s)
#define TILES_12(v, s) TILES_8(v, s) TILE(9, v, s) TILE(10, v, s) TILE(11, v, s) TILE(12, v, s)
#define NAMES_4(f, v, s) f##_1x##v##x##s, f##_2x##v##x##s, f##_3x##v##x##s, f##_4x##v##x##s
#define NAMES_6(f, v, s) NAMES_4(f, v, s), f##_5x##v##x##s, f##_6x##v##x##s
#define NAMES_8(f, v, s) NAMES_6(f, v, s), f##_7x##v##x##s, f##_8x##v##x##s
#define NAMES_12(f, v, s)                                                                          \
    NAMES_8(f, v, s), f##_9x##v##x##s, f##_10x##v##x##s, f##_11x##v##x##s, f##_12x##v##x##s

/* Rows of a table: 1, 2, 3 vectors; 2, 3 of which two rows share the last; the same for four. */
#if defined(__AVX512F__) || defined(__aarch64__)
TILES_12(1, 1)
TILES_12(2, 1)
TILES_8(3, 1)
#define ALONE(f)                                                                                   \
    {NAMES_12(f, 1, 1)}, {NAMES_12(f, 2, 1)},                                                      \
    {                                                                                              \
        NAMES_8(f, 3, 1)                                                                           \
    }
#else
TILES_6(1, 1)
TILES_6(2, 1)
TILES_4(3, 1)
#define ALONE(f)                                                                                   \
    {NAMES_6(f, 1, 1)}, {NAMES_6(f, 2, 1)},                                                        \
    {                                                                                              \
        NAMES_4(f, 3, 1)                                                                           \
    }
#endif
#if SHARES
TILES_12(2, 2)
TILES_8(3, 2)
TILES_12(2, 4)
TILES_8(3, 4)
#define SHARED(f)                                                                                  \
    , {NAMES_12(f, 2, 2)}, {NAMES_8(f, 3, 2)}, {NAMES_12(f, 2, 4)},                                \
    {                                                                                              \
        NAMES_8(f, 3, 4)                                                                           \
    }
#else
#define SHARED(f)
#endif

enum { TABLE = SHARES ? 7 : 3 };
static product_fn *const listed[TABLE][LF_TILE] = {ALONE(listed) SHARED(listed)};
static product_fn *const even[TABLE][LF_TILE] = {ALONE(even) SHARED(even)};
static outer_fn *const outers[TABLE][LF_TILE] = {ALONE(outer) SHARED(outer)};

/* Row of the tables for a width. */
static long table_row(long width)
{
    const long vectors = (width + LF_LANES - 1) / LF_LANES;
    const long last = width - (vectors - 1) * LF_LANES;
    if (!SHARES || vectors == 1 || 2 * last > LF_LANES)
        return vectors - 1;
    return (4 * last > LF_LANES ? 3 : 5) + vectors - 2;
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
