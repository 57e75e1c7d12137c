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

enum { LF_PARTS = LF_BLOCK_POINTS / LF_LANES, LF_BLOCK_TILE = 12 / LF_PARTS };

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
#if LF_VEC_BYTES == 32 && !defined(LF_DOUBLE)
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

/* What a tile of outputs sums: x w, and if x2 is there, sign x2 w2. */
typedef struct lf_block_terms {
    long in;
    const lf_real *x, *x2;
    lf_block_matrix w, w2;
    lf_real sign;
    const lf_real *bias; /* [out] or NULL */
    bool accumulate;     /* y += instead of y = */
} lf_block_terms;

LF_INLINE void lf_block_tile(const lf_block_terms *t, const int tile, long o, lf_real *y)
{
    lf_vec sum[12][LF_PARTS];
    for (int k = 0; k < tile; k++)
        for (int h = 0; h < LF_PARTS; h++)
            sum[k][h] = lf_vec_all(t->bias ? t->bias[o + k] : 0) +
                        (t->accumulate ? lf_block_get(y, o + k, h) : (lf_vec){0});
    const lf_real *w = t->w.w + o * t->w.out_step;
    for (long i = 0; i < t->in; i++, w += t->w.in_step)
        for (int k = 0; k < tile; k++) {
            const lf_vec by = lf_vec_all(w[k * t->w.out_step]);
            for (int h = 0; h < LF_PARTS; h++)
                sum[k][h] += by * lf_block_get(t->x, i, h);
        }
    w = t->w2.w + o * t->w2.out_step;
    for (long i = 0; t->x2 && i < t->in; i++, w += t->w2.in_step)
        for (int k = 0; k < tile; k++) {
            const lf_vec by = lf_vec_all(t->sign * w[k * t->w2.out_step]);
            for (int h = 0; h < LF_PARTS; h++)
                sum[k][h] += by * lf_block_get(t->x2, i, h);
        }
    for (int k = 0; k < tile; k++)
        for (int h = 0; h < LF_PARTS; h++)
            lf_block_set(y, o + k, h, sum[k][h]);
}

/* y [out, LF_BLOCK_POINTS]. */
static inline void lf_block_product(const lf_block_terms *t, long out, lf_real *y)
{
    const long parts = (out + LF_BLOCK_TILE - 1) / LF_BLOCK_TILE;
    for (long p = 0, o = 0; p < parts; p++) {
        const long size = (out - o + parts - p - 1) / (parts - p);
        switch (size) {
#define TILE(n)                                                                                    \
    case n:                                                                                        \
        lf_block_tile(t, n, o, y);                                                                 \
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

/* Tiles of 4 x 3 sums, 4 x 4 with 32 registers. */
static inline void lf_block_outer(const lf_block_pairs *t, long in, long out, lf_real *dw,
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
