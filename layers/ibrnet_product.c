/* ibrnet_product.c: see ibrnet_product.h.
 *
 * Register tiles; a vector holds one channel of the L points of a row:
 *   product   two rows by OUTS results; a term is two loads of x and OUTS numbers of w
 *   outer     OUTER_IN by OUTER_OUT numbers of w, each a vector of partial sums over the points,
 *             added up across the vector at the end
 * Both operands of outer are copied to where a tile reads them in order: rows of 32 or 64 channels
 * would meet in a few sets of the cache.
 * Each sum has one order, whatever the tile's size.
 */
#include "autograd/kernels/tile.h"
#include "layers/ibrnet_product.h"
#include "autograd/kernels/vector_math.h"

#if defined(__AVX512F__) || defined(__aarch64__)
enum { OUTS = 12, OUTER_IN = 6, OUTER_OUT = 4 }; /* of 32 registers */
#else
enum { OUTS = 6, OUTER_IN = 4, OUTER_OUT = 3 }; /* of 16 */
#endif

/* ---- product -----------------------------------------------------------------------------------
 */

/* Results o .. o + outs - 1 of `rows` rows from `row` on. */
LF_INLINE void product_tile(const lf_lanes_product *p, long row, long o, const bool turned,
                            const int rows, const int outs)
{
    const long down = turned ? 1 : p->step, across = turned ? p->step : 1;
    lf_vec sum[LF_LANES_ROWS][OUTS];
    lf_real *y[LF_LANES_ROWS];
    for (int r = 0; r < rows; r++) {
        y[r] = p->y + ((row + r) * p->out + o) * LF_LANES;
        for (int t = 0; t < outs; t++)
            sum[r][t] = p->accumulate ? lf_vec_load(y[r] + t * LF_LANES)
                                      : lf_vec_all(p->bias ? p->bias[o + t] : 0);
    }
    const lf_real *w = p->w + o * across;
    for (int part = 0; part < p->parts; part++) {
        const long c = p->c[part];
        const lf_real *x = p->x[part] + row * c * LF_LANES;
        for (long i = 0; i < c; i++, w += down) {
            lf_vec a[LF_LANES_ROWS];
            for (int r = 0; r < rows; r++)
                a[r] = lf_vec_load(x + (r * c + i) * LF_LANES);
#pragma GCC unroll 12
            for (int t = 0; t < outs; t++) {
                const lf_vec factor = lf_vec_all(w[t * across]);
                for (int r = 0; r < rows; r++)
                    sum[r][t] += a[r] * factor;
            }
        }
    }
    for (int r = 0; r < rows; r++)
        for (int t = 0; t < outs; t++)
            lf_vec_store(y[r] + t * LF_LANES, sum[r][t]);
}

#define TILE(turned, rows, outs)                                                                   \
    case outs:                                                                                     \
        product_tile(p, first, o, turned, rows, outs);                                             \
        break;
#if defined(__AVX512F__) || defined(__aarch64__)
#define LARGE_TILES(turned, rows)                                                                  \
    TILE(turned, rows, 7)                                                                          \
    TILE(turned, rows, 8)                                                                          \
    TILE(turned, rows, 9)                                                                          \
    TILE(turned, rows, 10)                                                                         \
    TILE(turned, rows, 11)                                                                         \
    TILE(turned, rows, 12)
#else
#define LARGE_TILES(turned, rows)
#endif
#define TILES(turned, rows)                                                                        \
    switch (outs) {                                                                                \
        TILE(turned, rows, 1)                                                                      \
        TILE(turned, rows, 2)                                                                      \
        TILE(turned, rows, 3)                                                                      \
        TILE(turned, rows, 4)                                                                      \
        TILE(turned, rows, 5)                                                                      \
        TILE(turned, rows, 6)                                                                      \
        LARGE_TILES(turned, rows)                                                                  \
    }

void lf_lanes_product_rows(const lf_lanes_product *p, long first, long rows)
{
    for (long o = 0, outs; o < p->out; o += outs) {
        outs = lf_next_part(p->out - o, OUTS);
        if (p->turned && rows == 2)
            TILES(true, 2)
        else if (p->turned)
            TILES(true, 1)
        else if (rows == 2)
            TILES(false, 2)
        else
            TILES(false, 1)
    }
}

/* ---- outer -------------------------------------------------------------------------------------
 */

/* Loads a vector once: without it GCC reads it from memory in every product. */
#if defined(__AVX512F__)
#define IN_REGISTER(v) __asm__("" : "+v"(v))
#elif defined(__AVX__)
#define IN_REGISTER(v) __asm__("" : "+x"(v))
#else
#define IN_REGISTER(v) (void)0
#endif

/* A tile of w[i, o] += sum over rows and lanes of x[r, i, l] z[r, o, l]: x [R, ins, L], z [R, outs,
 * L]. */
LF_INLINE void outer_tile(long rows, const lf_real *x, const lf_real *z, lf_real *w, long step,
                          const int ins, const int outs)
{
    lf_vec sum[OUTER_IN * OUTER_OUT];
#pragma GCC unroll 24
    for (int k = 0; k < ins * outs; k++)
        sum[k] = (lf_vec){0};
    for (long r = 0; r < rows; r++, x += ins * LF_LANES, z += outs * LF_LANES) {
        lf_vec g[OUTER_OUT];
#pragma GCC unroll 4
        for (int o = 0; o < outs; o++) {
            g[o] = lf_vec_load(z + o * LF_LANES);
            IN_REGISTER(g[o]);
        }
#pragma GCC unroll 6
        for (int i = 0; i < ins; i++) {
            lf_vec a = lf_vec_load(x + i * LF_LANES);
            IN_REGISTER(a);
#pragma GCC unroll 4
            for (int o = 0; o < outs; o++)
                sum[i * outs + o] += a * g[o];
        }
    }
    lf_real total[OUTER_IN * OUTER_OUT + LF_LANES];
#pragma GCC unroll 24
    for (int k = 0; k < ins * outs; k += LF_LANES) {
        lf_vec part[LF_LANES];
#pragma GCC unroll 16
        for (int l = 0; l < LF_LANES; l++)
            part[l] = k + l < ins * outs ? sum[k + l] : (lf_vec){0};
        lf_vec_store(total + k, lf_vec_fold(part));
    }
    for (int i = 0; i < ins; i++)
        for (int o = 0; o < outs; o++)
            w[i * step + o] += total[i * outs + o];
}

#define OUTER(ins, outs)                                                                           \
    case outs:                                                                                     \
        outer_tile(rows, x, z, w, step, ins, outs);                                                \
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

static void outer_any(long rows, const lf_real *x, const lf_real *z, lf_real *w, long step,
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

/* Rows [first, first + count) of x [rows, c, L] into panels of at most `most` channels. */
LF_INLINE void panel_rows(long rows, long first, long count, long c, const lf_real *x,
                          const long most, lf_real *panels)
{
    for (long i = 0, here; i < c; i += here) {
        here = lf_next_part(c - i, most);
        for (long r = first; r < first + count; r++)
            for (long k = 0; k < here; k++)
                lf_vec_store(panels + (i * rows + r * here + k) * LF_LANES,
                             lf_vec_load(x + (r * c + i + k) * LF_LANES));
    }
}

void lf_lanes_left_panels(long rows, long first, long count, long c, const lf_real *x,
                          lf_real *panels)
{
    panel_rows(rows, first, count, c, x, OUTER_IN, panels);
}

void lf_lanes_right_panels(long rows, long first, long count, long c, const lf_real *z,
                           lf_real *panels)
{
    panel_rows(rows, first, count, c, z, OUTER_OUT, panels);
}

void lf_lanes_outer(long rows, long ci, const lf_real *left, long co, const lf_real *right,
                    lf_real *w)
{
    for (long i = 0, ins; i < ci; i += ins) {
        ins = lf_next_part(ci - i, OUTER_IN);
        for (long o = 0, outs; o < co; o += outs) {
            outs = lf_next_part(co - o, OUTER_OUT);
            outer_any(rows, left + i * rows * LF_LANES, right + o * rows * LF_LANES, w + i * co + o,
                      co, ins, outs);
        }
    }
}
