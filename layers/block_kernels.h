/* block_kernels.h: the arithmetic of fields in blocks: LF_BLOCK_POINTS points side by side, one
 * vector a number. [layers/light_blocks.h]
 *
 * x [n, LF_BLOCK_POINTS] holds n numbers of each point of a block. Vectors are the machine's
 * (LF_LANES), so that sums stay in registers: a block has LF_PARTS of them. Weights are scalars
 * that all points share, read at any two strides: a transposed matrix costs nothing.
 */
#ifndef LF_LAYERS_BLOCK_KERNELS_H
#define LF_LAYERS_BLOCK_KERNELS_H

#include <stdbool.h>

#include "autograd/kernels/vector_math.h"
#include "layers/light_blocks.h"

enum {
    LF_PARTS = LF_BLOCK_POINTS / LF_LANES,
    LF_BLOCK_TILE = 12 / LF_PARTS,         /* outputs of a tile */
    LF_BLOCK_SIDE = LF_PARTS == 1 ? 2 : 1, /* groups of a tile: a weight loaded serves two sums */
    LF_TURN_TILE = LF_PARTS == 1   ? 8
                   : LF_PARTS == 2 ? 2
                                   : 1 /* complex outputs of a tile */
};

/* Part h of number i of a block. */
LF_INLINE lf_vec lf_block_get(const lf_real *x, long i, int h)
{
    return lf_vec_load(x + i * LF_BLOCK_POINTS + h * LF_LANES);
}

LF_INLINE void lf_block_set(lf_real *x, long i, int h, lf_vec v)
{
    lf_vec_store(x + i * LF_BLOCK_POINTS + h * LF_LANES, v);
}

LF_INLINE void lf_block_add(lf_real *x, long i, int h, lf_vec v)
{
    lf_block_set(x, i, h, lf_block_get(x, i, h) + v);
}

/* Sums of the lanes of four vectors. */
LF_INLINE void lf_vec_totals(const lf_vec v[4], lf_real out[4])
{
#if LF_VEC_BYTES == 64 && !defined(LF_DOUBLE)
    const __m512 ab = _mm512_add_ps(_mm512_unpacklo_ps((__m512)v[0], (__m512)v[1]),
                                    _mm512_unpackhi_ps((__m512)v[0], (__m512)v[1]));
    const __m512 cd = _mm512_add_ps(_mm512_unpacklo_ps((__m512)v[2], (__m512)v[3]),
                                    _mm512_unpackhi_ps((__m512)v[2], (__m512)v[3]));
    const __m512 four =
        _mm512_add_ps(_mm512_shuffle_ps(ab, cd, 0x44), _mm512_shuffle_ps(ab, cd, 0xee));
    const __m256 half =
        _mm256_add_ps(_mm512_castps512_ps256(four),
                      _mm256_castpd_ps(_mm512_extractf64x4_pd(_mm512_castps_pd(four), 1)));
    _mm_storeu_ps(out, _mm_add_ps(_mm256_castps256_ps128(half), _mm256_extractf128_ps(half, 1)));
#elif LF_VEC_BYTES == 32 && !defined(LF_DOUBLE)
    const __m256 sums = _mm256_hadd_ps(_mm256_hadd_ps((__m256)v[0], (__m256)v[1]),
                                       _mm256_hadd_ps((__m256)v[2], (__m256)v[3]));
    _mm_storeu_ps(out, _mm_add_ps(_mm256_castps256_ps128(sums), _mm256_extractf128_ps(sums, 1)));
#else
    for (int i = 0; i < 4; i++)
        out[i] = lf_vec_total(v[i]);
#endif
}

/* ---- products ----------------------------------------------------------------------------------
 */

/* A matrix with elements w[i * in_step + o * out_step]. */
typedef struct lf_block_matrix {
    const lf_real *w;
    long in_step, out_step;
} lf_block_matrix;

/* y = or += x w + bias for `groups` groups, which are x_step and y_step numbers apart. */
typedef struct lf_block_terms {
    long in;
    const lf_real *x;
    lf_block_matrix w;
    const lf_real *bias; /* [out] or NULL */
    bool accumulate;
    long groups, x_step, y_step; /* 0 groups: one */
} lf_block_terms;

/* Outputs [o, o + tile) of `side` groups. */
LF_INLINE void lf_block_tile(const lf_block_terms *t, const int tile, const int side, long o,
                             const lf_real *x, lf_real *y)
{
    lf_vec sum[12][LF_BLOCK_SIDE][LF_PARTS];
    for (int k = 0; k < tile; k++)
        for (int s = 0; s < side; s++)
            for (int h = 0; h < LF_PARTS; h++)
                sum[k][s][h] =
                    lf_vec_all(t->bias ? t->bias[o + k] : 0) +
                    (t->accumulate ? lf_block_get(y + s * t->y_step, o + k, h) : (lf_vec){0});
    const lf_real *w = t->w.w + o * t->w.out_step;
    for (long i = 0; i < t->in; i++, w += t->w.in_step)
        for (int k = 0; k < tile; k++) {
            const lf_vec by = lf_vec_all(w[k * t->w.out_step]);
            for (int s = 0; s < side; s++)
                for (int h = 0; h < LF_PARTS; h++)
                    sum[k][s][h] += by * lf_block_get(x + s * t->x_step, i, h);
        }
    for (int k = 0; k < tile; k++)
        for (int s = 0; s < side; s++)
            for (int h = 0; h < LF_PARTS; h++)
                lf_block_set(y + s * t->y_step, o + k, h, sum[k][s][h]);
}

/* All outputs of `side` groups, in nearly equal tiles. */
LF_INLINE void lf_block_outputs(const lf_block_terms *t, const int side, long out, const lf_real *x,
                                lf_real *y)
{
    const long parts = (out + LF_BLOCK_TILE - 1) / LF_BLOCK_TILE;
    for (long p = 0, o = 0; p < parts; p++) {
        const long size = (out - o + parts - p - 1) / (parts - p);
        switch (size) {
#define TILE(n)                                                                                    \
    case n:                                                                                        \
        lf_block_tile(t, n, side, o, x, y);                                                        \
        break;
            TILE(1)
            TILE(2)
            TILE(3)
#if LF_VEC_BYTES >= 32
            TILE(4)
            TILE(5)
            TILE(6)
#endif
#if LF_VEC_BYTES >= 64
            TILE(7)
            TILE(8)
            TILE(9)
            TILE(10)
            TILE(11)
            TILE(12)
#endif
#undef TILE
        }
        o += size;
    }
}

/* y [out, LF_BLOCK_POINTS] of every group. */
static inline void lf_block_product(const lf_block_terms *t, long out, lf_real *y)
{
    const long groups = t->groups ? t->groups : 1;
    long g = 0;
    for (; g + LF_BLOCK_SIDE <= groups; g += LF_BLOCK_SIDE)
        lf_block_outputs(t, LF_BLOCK_SIDE, out, t->x + g * t->x_step, y + g * t->y_step);
    for (; g < groups; g++)
        lf_block_outputs(t, 1, out, t->x + g * t->x_step, y + g * t->y_step);
}

/* ---- complex products --------------------------------------------------------------------------
 */

/* y = or += (a + i b) x, `conjugate`: (a - i b) x; x and y are [re, im] of `in` and `out` numbers.
 */
typedef struct lf_block_turn_terms {
    long in, out;
    const lf_real *a, *b;
    long in_step, out_step;
    bool conjugate, accumulate;
} lf_block_turn_terms;

LF_INLINE void lf_block_turn_tile(const lf_block_turn_terms *t, const int tile,
                                  const bool conjugate, long o, const lf_real *x, lf_real *y)
{
    lf_vec re[LF_TURN_TILE][LF_PARTS], im[LF_TURN_TILE][LF_PARTS];
    for (int k = 0; k < tile; k++)
        for (int h = 0; h < LF_PARTS; h++) {
            re[k][h] = t->accumulate ? lf_block_get(y, o + k, h) : (lf_vec){0};
            im[k][h] = t->accumulate ? lf_block_get(y, t->out + o + k, h) : (lf_vec){0};
        }
    for (long i = 0; i < t->in; i++)
        for (int k = 0; k < tile; k++) {
            const long at = i * t->in_step + (o + k) * t->out_step;
            const lf_vec a = lf_vec_all(t->a[at]), b = lf_vec_all(t->b[at]);
            for (int h = 0; h < LF_PARTS; h++) {
                const lf_vec u = lf_block_get(x, i, h), v = lf_block_get(x, t->in + i, h);
                re[k][h] += a * u;
                im[k][h] += a * v;
                if (conjugate) {
                    re[k][h] += b * v;
                    im[k][h] -= b * u;
                } else {
                    re[k][h] -= b * v;
                    im[k][h] += b * u;
                }
            }
        }
    for (int k = 0; k < tile; k++)
        for (int h = 0; h < LF_PARTS; h++) {
            lf_block_set(y, o + k, h, re[k][h]);
            lf_block_set(y, t->out + o + k, h, im[k][h]);
        }
}

LF_INLINE void lf_block_turn_outputs(const lf_block_turn_terms *t, const bool conjugate,
                                     const lf_real *x, lf_real *y)
{
    long o = 0;
    for (; o + LF_TURN_TILE <= t->out; o += LF_TURN_TILE)
        lf_block_turn_tile(t, LF_TURN_TILE, conjugate, o, x, y);
    for (; LF_TURN_TILE > 4 && o + 4 <= t->out; o += 4)
        lf_block_turn_tile(t, LF_TURN_TILE > 4 ? 4 : 1, conjugate, o, x, y);
    for (; o < t->out; o++)
        lf_block_turn_tile(t, 1, conjugate, o, x, y);
}

static inline void lf_block_turn(const lf_block_turn_terms *t, const lf_real *x, lf_real *y)
{
    if (t->conjugate)
        lf_block_turn_outputs(t, true, x, y);
    else
        lf_block_turn_outputs(t, false, x, y);
}

/* ---- gradients of weights ---------------------------------------------------------------------
 */

/* dw[i * in_step + o * out_step] += sum over groups and points of x_g[i] y_g[o] (+ sign x2 y2); the
 * groups are x_step and y_step numbers apart. */
typedef struct lf_block_pairs {
    long groups, x_step, y_step;
    const lf_real *x, *y, *x2, *y2;
    lf_real sign;
} lf_block_pairs;

LF_INLINE void lf_block_outer_tile(const lf_block_pairs *t, const int ti, const int to, long i,
                                   long o, lf_real *dw, long in_step, long out_step)
{
    lf_vec sum[16] = {{0}};
    lf_real total[16];
    const lf_real *x = t->x + i * LF_BLOCK_POINTS, *y = t->y + o * LF_BLOCK_POINTS;
    for (long g = 0; g < t->groups; g++, x += t->x_step, y += t->y_step)
        for (int h = 0; h < LF_PARTS; h++)
            for (int a = 0; a < ti; a++)
                for (int b = 0; b < to; b++)
                    sum[a * to + b] += lf_block_get(x, a, h) * lf_block_get(y, b, h);
    if (t->x2) {
        x = t->x2 + i * LF_BLOCK_POINTS;
        y = t->y2 + o * LF_BLOCK_POINTS;
        for (long g = 0; g < t->groups; g++, x += t->x_step, y += t->y_step)
            for (int h = 0; h < LF_PARTS; h++)
                for (int a = 0; a < ti; a++) {
                    const lf_vec by = t->sign * lf_block_get(x, a, h);
                    for (int b = 0; b < to; b++)
                        sum[a * to + b] += by * lf_block_get(y, b, h);
                }
    }
    for (int k = 0; k < ti * to; k += 4)
        lf_vec_totals(sum + k, total + k);
    for (int a = 0; a < ti; a++)
        for (int b = 0; b < to; b++)
            dw[(i + a) * in_step + (o + b) * out_step] += total[a * to + b];
}

/* Points side by side in tiles of 4 x 3 sums, 4 x 4 with 32 registers: every sum ends across a
 * vector, so this is for few outputs. */
static inline void lf_block_outer_across(const lf_block_pairs *t, long in, long out, lf_real *dw,
                                         long in_step, long out_step)
{
    enum { TI = 4, TO = LF_VEC_BYTES >= 64 ? 4 : 3 };
    for (long o = 0; o < out; o += TO)
        for (long i = 0; i < in; i += TI) {
            const long a = in - i < TI ? in - i : TI, b = out - o < TO ? out - o : TO;
            switch (5 * a + b) {
#define TILE(n, m)                                                                                 \
    case 5 * n + m:                                                                                \
        lf_block_outer_tile(t, n, m, i, o, dw, in_step, out_step);                                 \
        break;
#define TILES(n) TILE(n, 1) TILE(n, 2) TILE(n, 3)
                TILES(1)
                TILES(2)
                TILES(3)
                TILES(4)
#if LF_VEC_BYTES >= 64
                TILE(1, 4)
                TILE(2, 4)
                TILE(3, 4)
                TILE(4, 4)
#endif
#undef TILES
#undef TILE
            }
        }
}

enum {
    LF_OUTER_TILE = LF_VEC_BYTES == 64   ? 12
                    : LF_VEC_BYTES == 32 ? 6
                                         : 3,
    LF_OUTER_ROOM = 32768 / sizeof(lf_real) /* numbers of y turned to rows at a time */
};

/* y [out, LF_BLOCK_POINTS] as rows [LF_BLOCK_POINTS, step], zeros behind. */
static inline void lf_block_to_rows(long out, long step, const lf_real *y, lf_real *rows)
{
    for (long o = 0; o < step; o += LF_LANES)
        for (long l = 0; l < LF_BLOCK_POINTS; l += LF_LANES) {
            lf_vec v[LF_LANES];
            for (int i = 0; i < LF_LANES; i++)
                v[i] = o + i < out ? lf_vec_load(y + (o + i) * LF_BLOCK_POINTS + l) : (lf_vec){0};
            lf_vec_transpose(v);
            for (int i = 0; i < LF_LANES; i++)
                lf_vec_store(rows + (l + i) * step + o, v[i]);
        }
}

/* dw [tile, out] += sum over groups and points p of x[i, p] rows[p, 0 .. width), one or two
 * vectors. */
LF_INLINE void lf_block_rows_tile(const int tile, const int vectors, long groups, const lf_real *x,
                                  long x_step, const lf_real *rows, long step, long width, long out,
                                  lf_real *dw)
{
    lf_vec sum[LF_OUTER_TILE][2];
    const long last = width - (vectors - 1) * LF_LANES;
    for (int i = 0; i < tile; i++)
        for (int v = 0; v < vectors; v++)
            sum[i][v] =
                lf_vec_load_part(dw + i * out + v * LF_LANES, v + 1 < vectors ? LF_LANES : last);
    for (long g = 0; g < groups; g++, x += x_step)
        for (long p = 0; p < LF_BLOCK_POINTS; p++, rows += step) {
            lf_vec y[2];
            for (int v = 0; v < vectors; v++)
                y[v] = lf_vec_load(rows + v * LF_LANES);
            for (int i = 0; i < tile; i++) {
                const lf_vec by = lf_vec_all(x[i * LF_BLOCK_POINTS + p]);
                for (int v = 0; v < vectors; v++)
                    sum[i][v] += by * y[v];
            }
        }
    for (int i = 0; i < tile; i++)
        for (int v = 0; v < vectors; v++)
            lf_vec_store_part(dw + i * out + v * LF_LANES, v + 1 < vectors ? LF_LANES : last,
                              sum[i][v]);
}

LF_INLINE void lf_block_rows_outer(const int vectors, long groups, long in, const lf_real *x,
                                   long x_step, const lf_real *rows, long step, long width,
                                   long out, lf_real *dw)
{
    const long parts = (in + LF_OUTER_TILE - 1) / LF_OUTER_TILE;
    for (long p = 0, i = 0; p < parts; p++) { /* nearly equal tiles: few sums wait for each other */
        const long size = (in - i + parts - p - 1) / (parts - p);
        switch (size) {
#define TILE(n)                                                                                    \
    case n:                                                                                        \
        lf_block_rows_tile(n, vectors, groups, x + i * LF_BLOCK_POINTS, x_step, rows, step, width, \
                           out, dw + i * out);                                                     \
        break;
            TILE(1)
            TILE(2)
            TILE(3)
#if LF_VEC_BYTES >= 32
            TILE(4)
            TILE(5)
            TILE(6)
#endif
#if LF_VEC_BYTES >= 64
            TILE(7)
            TILE(8)
            TILE(9)
            TILE(10)
            TILE(11)
            TILE(12)
#endif
#undef TILE
        }
        i += size;
    }
}

/* dw [in, out] += sum over groups and points of x_g[i] y_g[o]. */
static inline void lf_block_outer(const lf_block_pairs *t, long in, long out, lf_real *dw)
{
    const long step = (out + LF_LANES - 1) / LF_LANES * LF_LANES;
    const long most = LF_OUTER_ROOM / (LF_BLOCK_POINTS * step);
    if (2 * out < LF_LANES || most < 1 || t->x2) {
        lf_block_outer_across(t, in, out, dw, out, 1);
        return;
    }
    _Alignas(64) lf_real rows[LF_OUTER_ROOM];
    for (long first = 0, n; first < t->groups; first += n) {
        n = t->groups - first < most ? t->groups - first : most;
        for (long g = 0; g < n; g++)
            lf_block_to_rows(out, step, t->y + (first + g) * t->y_step,
                             rows + g * LF_BLOCK_POINTS * step);
        const lf_real *x = t->x + first * t->x_step;
        for (long o = 0; o < out; o += 2 * LF_LANES)
            if (out - o > LF_LANES)
                lf_block_rows_outer(2, n, in, x, t->x_step, rows + o, step,
                                    out - o < 2 * LF_LANES ? out - o : 2 * LF_LANES, out, dw + o);
            else
                lf_block_rows_outer(1, n, in, x, t->x_step, rows + o, step, out - o, out, dw + o);
    }
}

/* db[o] += sum over groups and points of y_g[o]. */
static inline void lf_block_sums(long groups, long step, long out, const lf_real *y, lf_real *db)
{
    for (long o = 0; o < out; o++) {
        lf_vec sum = {0};
        for (long g = 0; g < groups; g++)
            for (int h = 0; h < LF_PARTS; h++)
                sum += lf_block_get(y + g * step, o, h);
        db[o] += lf_vec_total(sum);
    }
}

#endif
