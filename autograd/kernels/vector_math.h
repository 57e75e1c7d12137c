/* vector_math.h: exp, expm1, sigmoid and ELU of one machine vector, branch-free; sums across its
 * lanes.
 *
 *   exp(x) = 2^n e^r,  n = round(x / ln 2),  r = x - n ln 2 in two parts, |r| <= 0.35;  e^r - 1 by
 *   its series to r^7 (float) or r^13 (double)
 * Error: below 2 units in the last place (tests/test_vector_math.c). x is cut to +-87 (float) or
 * +-708 (double), so nothing overflows and exp never is 0; NaN stays NaN.
 */
#ifndef LF_AUTOGRAD_KERNELS_VECTOR_MATH_H
#define LF_AUTOGRAD_KERNELS_VECTOR_MATH_H

#include <stdint.h>
#include <string.h>
#ifdef __AVX__
#include <immintrin.h>
#endif

#include "autograd/kernels/vector.h"

#ifdef LF_DOUBLE
typedef int64_t lf_vec_bits __attribute__((vector_size(LF_VEC_BYTES)));
#define LF_EXP_MOST 708.0
#define LF_EXP_ROUND 6755399441055744.0 /* 1.5 * 2^52: adding and taking it off rounds */
#define LF_EXP_LN2_HIGH 6.93147180369123816490e-01
#define LF_EXP_LN2_LOW 1.90821492927058770002e-10
enum { LF_EXP_BIAS = 1023, LF_EXP_MANTISSA = 52 };
#else
typedef int32_t lf_vec_bits __attribute__((vector_size(LF_VEC_BYTES)));
#define LF_EXP_MOST 87.0f
#define LF_EXP_ROUND 12582912.0f /* 1.5 * 2^23 */
#define LF_EXP_LN2_HIGH 0.693359375f
#define LF_EXP_LN2_LOW -2.12194440e-4f
enum { LF_EXP_BIAS = 127, LF_EXP_MANTISSA = 23 };
#endif

/* condition ? a : b, lane by lane; condition is the result of a comparison. */
LF_INLINE lf_vec lf_vec_select(lf_vec_bits condition, lf_vec a, lf_vec b)
{
    return (lf_vec)((condition & (lf_vec_bits)a) | (~condition & (lf_vec_bits)b));
}

/* The smaller and the larger of two; a where one of them is NaN. */
#if defined(__AVX512F__) && defined(LF_DOUBLE)
#define LF_VEC_EXTREME(which, a, b) (lf_vec) _mm512_##which##_pd((__m512d)(b), (__m512d)(a))
#elif defined(__AVX512F__)
#define LF_VEC_EXTREME(which, a, b) (lf_vec) _mm512_##which##_ps((__m512)(b), (__m512)(a))
#elif defined(__AVX__) && defined(LF_DOUBLE)
#define LF_VEC_EXTREME(which, a, b) (lf_vec) _mm256_##which##_pd((__m256d)(b), (__m256d)(a))
#elif defined(__AVX__)
#define LF_VEC_EXTREME(which, a, b) (lf_vec) _mm256_##which##_ps((__m256)(b), (__m256)(a))
#endif

LF_INLINE lf_vec lf_vec_min(lf_vec a, lf_vec b)
{
#ifdef LF_VEC_EXTREME
    return LF_VEC_EXTREME(min, a, b);
#else
    return lf_vec_select(a > b, b, a);
#endif
}

LF_INLINE lf_vec lf_vec_max(lf_vec a, lf_vec b)
{
#ifdef LF_VEC_EXTREME
    return LF_VEC_EXTREME(max, a, b);
#else
    return lf_vec_select(a < b, b, a);
#endif
}

/* e^x = scale (1 + rest) for |x| <= LF_EXP_MOST */
LF_INLINE lf_vec lf_vec_exp_parts(lf_vec x, lf_vec *rest)
{
    const lf_vec round = lf_vec_all(LF_EXP_ROUND);
    const lf_vec shifted = x * (lf_real)1.44269504088896341 + round, n = shifted - round;
    const lf_vec r = (x - n * LF_EXP_LN2_HIGH) - n * LF_EXP_LN2_LOW;
#ifdef LF_DOUBLE
    enum { TERMS = 12 };
    static const lf_real series[TERMS] = {
        1.0 / 6227020800, 1.0 / 479001600, 1.0 / 39916800, 1.0 / 3628800, 1.0 / 362880, 1.0 / 40320,
        1.0 / 5040,       1.0 / 720,       1.0 / 120,      1.0 / 24,      1.0 / 6,      0.5};
#else
    enum { TERMS = 6 };
    static const lf_real series[TERMS] = {1.0f / 5040, 1.0f / 720, 1.0f / 120,
                                          1.0f / 24,   1.0f / 6,   0.5f};
#endif
    lf_vec p = lf_vec_all(series[0]);
    for (int i = 1; i < TERMS; i++)
        p = p * r + series[i];
    *rest = r + r * r * p;
    /* the integer n stands in the low bits of `shifted` */
    const lf_vec_bits whole = (lf_vec_bits)shifted - (lf_vec_bits)round;
    return (lf_vec)((whole + LF_EXP_BIAS) << LF_EXP_MANTISSA);
}

LF_INLINE lf_vec lf_vec_exp_cut(lf_vec x)
{
    return lf_vec_max(lf_vec_min(x, lf_vec_all(LF_EXP_MOST)), lf_vec_all(-LF_EXP_MOST));
}

LF_INLINE lf_vec lf_vec_exp(lf_vec x)
{
    lf_vec rest;
    const lf_vec scale = lf_vec_exp_parts(lf_vec_exp_cut(x), &rest);
    return scale + scale * rest;
}

/* e^x - 1, exact to rounding near 0 */
LF_INLINE lf_vec lf_vec_expm1(lf_vec x)
{
    lf_vec rest;
    const lf_vec scale = lf_vec_exp_parts(lf_vec_exp_cut(x), &rest);
    return scale * rest + (scale - 1);
}

LF_INLINE lf_vec lf_vec_sigmoid(lf_vec x)
{
    return 1 / (1 + lf_vec_exp(-x));
}

/* max(x, 0) + (e^min(x, 0) - 1) */
LF_INLINE lf_vec lf_vec_elu(lf_vec x)
{
    lf_vec rest;
    const lf_vec zero = {0};
    const lf_vec low = lf_vec_max(lf_vec_min(x, zero), lf_vec_all(-LF_EXP_MOST));
    const lf_vec scale = lf_vec_exp_parts(low, &rest);
    return lf_vec_max(x, zero) + (scale * rest + (scale - 1));
}

/* ELU, and its slope. */
LF_INLINE lf_vec lf_vec_elu_slope(lf_vec x, lf_vec *slope)
{
    lf_vec rest;
    const lf_vec zero = {0};
    const lf_vec low = lf_vec_max(lf_vec_min(x, zero), lf_vec_all(-LF_EXP_MOST));
    const lf_vec scale = lf_vec_exp_parts(low, &rest); /* 1 where x > 0 */
    *slope = scale + scale * rest;
    return lf_vec_max(x, zero) + (scale * rest + (scale - 1));
}

LF_INLINE lf_vec lf_vec_sqrt(lf_vec x)
{
#if defined(__AVX512F__) && defined(LF_DOUBLE)
    return (lf_vec)_mm512_sqrt_pd((__m512d)x);
#elif defined(__AVX512F__)
    return (lf_vec)_mm512_sqrt_ps((__m512)x);
#else
    lf_vec y;
    for (int i = 0; i < LF_LANES; i++)
        y[i] = LF_SQRT(x[i]);
    return y;
#endif
}

/* ---- across lanes -----------------------------------------------------------------------------
 */

#if defined(LF_DOUBLE) && LF_VEC_BYTES == 64 || !defined(LF_DOUBLE) && LF_VEC_BYTES == 32
#define LF_VEC_COUNT                                                                               \
    {                                                                                              \
        0, 1, 2, 3, 4, 5, 6, 7                                                                     \
    }
#elif LF_VEC_BYTES == 64
#define LF_VEC_COUNT                                                                               \
    {                                                                                              \
        0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15                                       \
    }
#elif defined(LF_DOUBLE) && LF_VEC_BYTES == 16
#define LF_VEC_COUNT                                                                               \
    {                                                                                              \
        0, 1                                                                                       \
    }
#else
#define LF_VEC_COUNT                                                                               \
    {                                                                                              \
        0, 1, 2, 3                                                                                 \
    }
#endif

/* One step of adding lanes up: lane p of the result is a[p] + a[p ^ h] where p & h is 0, else b[p]
 * + b[p ^ h]. */
LF_INLINE lf_vec lf_vec_fold_pair(lf_vec a, lf_vec b, const int h)
{
    const lf_vec_bits p = LF_VEC_COUNT, second = (p & h) * (LF_LANES / h); /* LF_LANES: take b's */
    const lf_vec there = __builtin_shuffle(a, b, p + second);
    const lf_vec other = __builtin_shuffle(b, a, p + second);
    return there + __builtin_shuffle(other, p ^ h);
}

/* Lane p becomes the sum of all lanes of v[p]; v is overwritten. */
LF_INLINE lf_vec lf_vec_fold(lf_vec v[LF_LANES])
{
#pragma GCC unroll 4
    for (int h = LF_LANES / 2; h > 0; h /= 2)
#pragma GCC unroll 8
        for (int i = 0; i < h; i++)
            v[i] = lf_vec_fold_pair(v[i], v[i + h], h);
    return v[0];
}

/* The sum of all lanes. */
LF_INLINE lf_real lf_vec_total(lf_vec v)
{
    const lf_vec_bits p = LF_VEC_COUNT;
#pragma GCC unroll 4
    for (int h = LF_LANES / 2; h > 0; h /= 2)
        v += __builtin_shuffle(v, p ^ h);
    return v[0];
}

/* x[i] of the largest w[i] > 0 of n numbers, n in whole vectors; 0 if there is none. */
LF_INLINE lf_real lf_vec_of_largest(long n, const lf_real *w, const lf_real *x)
{
    const lf_vec_bits p = LF_VEC_COUNT;
    lf_vec largest = {0}, found = {0};
    for (long i = 0; i < n; i += LF_LANES) {
        const lf_vec here = lf_vec_load(w + i);
        found = lf_vec_select(here > largest, lf_vec_load(x + i), found);
        largest = lf_vec_max(largest, here);
    }
#pragma GCC unroll 4
    for (int h = LF_LANES / 2; h > 0; h /= 2) {
        const lf_vec other = __builtin_shuffle(largest, p ^ h);
        found = lf_vec_select(other > largest, __builtin_shuffle(found, p ^ h), found);
        largest = lf_vec_max(largest, other);
    }
    return found[0];
}

/* Transpose LF_LANES vectors in place. */
LF_INLINE void lf_vec_transpose(lf_vec v[LF_LANES])
{
    const lf_vec_bits p = LF_VEC_COUNT;
#pragma GCC unroll 4
    for (int h = LF_LANES / 2; h > 0; h /= 2)
#pragma GCC unroll 16
        for (int i = 0; i < LF_LANES; i++) {
            if (i & h)
                continue;
            const lf_vec a = v[i], b = v[i | h];
            const lf_vec_bits second = (p & h) * (LF_LANES / h);
            v[i] = __builtin_shuffle(a, b, (p & ~h) + second);
            v[i | h] = __builtin_shuffle(a, b, (p | h) + second);
        }
}

#endif
