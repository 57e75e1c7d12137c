/* ibrnet_product.c: see ibrnet_product.h.
 *
 * Register tiles; a vector holds one channel of the L points of a row:
 *   product   two rows by OUTS results; a term is two loads of x and OUTS numbers of w
 *   outer     OUTER_IN by OUTER_OUT numbers of w, each a vector of partial sums over the points,
 *             added up across the vector at the end
 * Each sum has one order, whatever the tile's size.
 */
#include "autograd/kernels/tile.h"
#include "layers/ibrnet_product.h"
#include "layers/lanes_math.h"

#if defined(__AVX512F__) || defined(__aarch64__)
enum { OUTS = 12, OUTER_IN = 6, OUTER_OUT = 4 }; /* of 32 registers */
#else
enum { OUTS = 6, OUTER_IN = 4, OUTER_OUT = 3 }; /* of 16 */
#endif

/* ---- product -----------------------------------------------------------------------------------
 */

/* Results o .. o + outs - 1 of `rows` rows from `row` on. */
LF_INLINE void product_tile(const lf_lanes_product *p, long row, long o, const int rows,
                            const int outs)
{
    lf_vec sum[LF_LANES_ROWS][OUTS];
    lf_real *y[LF_LANES_ROWS];
    for (int r = 0; r < rows; r++) {
        y[r] = p->y + ((row + r) * p->out + o) * LF_LANES;
        for (int t = 0; t < outs; t++)
            sum[r][t] = p->accumulate ? lf_vec_load(y[r] + t * LF_LANES)
                                      : lf_vec_all(p->bias ? p->bias[o + t] : 0);
    }
    const lf_real *w = p->w + o;
    for (int part = 0; part < p->parts; part++) {
        const long c = p->c[part];
        const lf_real *x = p->x[part] + row * c * LF_LANES;
        for (long i = 0; i < c; i++, w += p->step) {
            lf_vec a[LF_LANES_ROWS];
            for (int r = 0; r < rows; r++)
                a[r] = lf_vec_load(x + (r * c + i) * LF_LANES);
#pragma GCC unroll 12
            for (int t = 0; t < outs; t++) {
                const lf_vec factor = lf_vec_all(w[t]);
                for (int r = 0; r < rows; r++)
                    sum[r][t] += a[r] * factor;
            }
        }
    }
    for (int r = 0; r < rows; r++)
        for (int t = 0; t < outs; t++)
            lf_vec_store(y[r] + t * LF_LANES, sum[r][t]);
}

#define TILE(rows, outs)                                                                           \
    case outs:                                                                                     \
        product_tile(p, first, o, rows, outs);                                                     \
        break;
#if defined(__AVX512F__) || defined(__aarch64__)
#define LARGE_TILES(rows)                                                                          \
    TILE(rows, 7) TILE(rows, 8) TILE(rows, 9) TILE(rows, 10) TILE(rows, 11) TILE(rows, 12)
#else
#define LARGE_TILES(rows)
#endif
#define TILES(rows)                                                                                \
    switch (outs) {                                                                                \
        TILE(rows, 1)                                                                              \
        TILE(rows, 2) TILE(rows, 3) TILE(rows, 4) TILE(rows, 5) TILE(rows, 6) LARGE_TILES(rows)    \
    }

void lf_lanes_product_rows(const lf_lanes_product *p, long first, long rows)
{
    for (long o = 0, outs; o < p->out; o += outs) {
        outs = lf_next_part(p->out - o, OUTS);
        if (rows == 2)
            TILES(2)
        else
            TILES(1)
    }
}

/* ---- outer -------------------------------------------------------------------------------------
 */

#if defined(LF_DOUBLE) && LF_VEC_BYTES == 64 || !defined(LF_DOUBLE) && LF_VEC_BYTES == 32
#define COUNT                                                                                      \
    {                                                                                              \
        0, 1, 2, 3, 4, 5, 6, 7                                                                     \
    }
#elif LF_VEC_BYTES == 64
#define COUNT                                                                                      \
    {                                                                                              \
        0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15                                       \
    }
#elif defined(LF_DOUBLE) && LF_VEC_BYTES == 16
#define COUNT                                                                                      \
    {                                                                                              \
        0, 1                                                                                       \
    }
#else
#define COUNT                                                                                      \
    {                                                                                              \
        0, 1, 2, 3                                                                                 \
    }
#endif

/* Lane p of the result is a[p] + a[p ^ h] where p & h is 0, else b[p] + b[p ^ h]. */
LF_INLINE lf_vec fold(lf_vec a, lf_vec b, const int h)
{
    const lf_vec_bits p = COUNT, second = (p & h) * (LF_LANES / h); /* LF_LANES: take b's */
    const lf_vec there = __builtin_shuffle(a, b, p + second);
    const lf_vec other = __builtin_shuffle(b, a, p + second);
    return there + __builtin_shuffle(other, p ^ h);
}

/* Lane p becomes the sum of all lanes of v[p]; v is overwritten. */
LF_INLINE lf_vec fold_all(lf_vec v[LF_LANES])
{
#pragma GCC unroll 4
    for (int h = LF_LANES / 2; h > 0; h /= 2)
#pragma GCC unroll 8
        for (int i = 0; i < h; i++)
            v[i] = fold(v[i], v[i + h], h);
    return v[0];
}

/* A tile of w[i, o] += sum over rows and lanes of x[r, i, l] z[r, o, l]. */
LF_INLINE void outer_tile(long rows, long ci, const lf_real *x, long co, const lf_real *z,
                          lf_real *w, const int ins, const int outs)
{
    lf_vec sum[OUTER_IN * OUTER_OUT + LF_LANES] = {{0}};
    for (long r = 0; r < rows; r++, x += ci * LF_LANES, z += co * LF_LANES) {
        lf_vec g[OUTER_OUT];
#pragma GCC unroll 4
        for (int o = 0; o < outs; o++)
            g[o] = lf_vec_load(z + o * LF_LANES);
#pragma GCC unroll 6
        for (int i = 0; i < ins; i++) {
            const lf_vec a = lf_vec_load(x + i * LF_LANES);
#pragma GCC unroll 4
            for (int o = 0; o < outs; o++)
                sum[i * outs + o] += a * g[o];
        }
    }
    lf_real total[OUTER_IN * OUTER_OUT + LF_LANES];
#pragma GCC unroll 16
    for (int k = 0; k < ins * outs; k += LF_LANES)
        lf_vec_store(total + k, fold_all(sum + k));
    for (int i = 0; i < ins; i++)
        for (int o = 0; o < outs; o++)
            w[i * co + o] += total[i * outs + o];
}

#define OUTER(ins, outs)                                                                           \
    case outs:                                                                                     \
        outer_tile(rows, ci, x, co, z, w, ins, outs);                                              \
        break;
#if defined(__AVX512F__) || defined(__aarch64__)
#define WIDEST_OUTER(ins) OUTER(ins, 4)
#else
#define WIDEST_OUTER(ins)
#endif
#define OUTERS(ins)                                                                                \
    case ins:                                                                                      \
        switch (outs) {                                                                            \
            OUTER(ins, 1) OUTER(ins, 2) OUTER(ins, 3) WIDEST_OUTER(ins)                            \
        }                                                                                          \
        break;

static void outer_any(long rows, long ci, const lf_real *x, long co, const lf_real *z, lf_real *w,
                      long ins, long outs)
{
    switch (ins) {
        OUTERS(1)
        OUTERS(2)
        OUTERS(3)
        OUTERS(4)
#if defined(__AVX512F__) || defined(__aarch64__)
        OUTERS(5)
        OUTERS(6)
#endif
    }
}

/* The columns of z stay in the cache while x passes. */
void lf_lanes_outer(long rows, long ci, const lf_real *x, long co, const lf_real *z, lf_real *w)
{
    for (long o = 0, outs; o < co; o += outs) {
        outs = lf_next_part(co - o, OUTER_OUT);
        for (long i = 0, ins; i < ci; i += ins) {
            ins = lf_next_part(ci - i, OUTER_IN);
            outer_any(rows, ci, x + i * LF_LANES, co, z + o * LF_LANES, w + i * co + o, ins, outs);
        }
    }
}

void lf_lanes_sums(long rows, long co, const lf_real *z, lf_real *sum)
{
    for (long o = 0; o < co; o++) {
        lf_vec v = {0};
        for (long r = 0; r < rows; r++)
            v += lf_vec_load(z + (r * co + o) * LF_LANES);
        sum[o] += lf_vec_sum(v);
    }
}
