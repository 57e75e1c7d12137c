/* wide.h: LF_WIDE numbers side by side, one of each of LF_WIDE rows, and exp, expm1 and sigmoid of
 * them.
 *
 * A vector of 64 bytes on every machine (the compiler splits it where registers are narrower), so
 * that sums over rows have one order everywhere. All functions are branch-free.
 *
 *   exp(x) = 2^n e^r,  n = round(x / ln 2),  r = x - n ln 2 in two parts, |r| <= 0.35;  e^r - 1 by
 *   its series to r^7 (float) or r^13 (double).
 * Error: below 2 units in the last place (tests/test_wide.c). x is cut to +-87 (float) or +-708
 * (double), so nothing overflows and exp never is 0; NaN stays NaN.
 */
#ifndef LF_AUTOGRAD_KERNELS_WIDE_H
#define LF_AUTOGRAD_KERNELS_WIDE_H

#include <stdint.h>
#include <string.h>

#include "autograd/kernels/vector.h"

typedef lf_real lf_wide __attribute__((vector_size(64), may_alias));
enum { LF_WIDE = 64 / sizeof(lf_real) };

#ifdef LF_DOUBLE
typedef int64_t lf_wide_bits __attribute__((vector_size(64), may_alias));
#define LF_WIDE_MOST 708.0
#define LF_WIDE_ROUND 6755399441055744.0 /* 1.5 * 2^52: adding and taking it off rounds */
#define LF_WIDE_LN2_HIGH 6.93147180369123816490e-01
#define LF_WIDE_LN2_LOW 1.90821492927058770002e-10
enum { LF_WIDE_BIAS = 1023, LF_WIDE_MANTISSA = 52 };
#else
typedef int32_t lf_wide_bits __attribute__((vector_size(64), may_alias));
#define LF_WIDE_MOST 87.0f
#define LF_WIDE_ROUND 12582912.0f /* 1.5 * 2^23 */
#define LF_WIDE_LN2_HIGH 0.693359375f
#define LF_WIDE_LN2_LOW -2.12194440e-4f
enum { LF_WIDE_BIAS = 127, LF_WIDE_MANTISSA = 23 };
#endif

LF_INLINE lf_wide lf_wide_all(lf_real x)
{
    return x - (lf_wide){0};
}

/* Comparisons are loops over single numbers, which compilers make into vectors of the machine's own
 * width; those of wide vectors they would split into single numbers. */

/* x > 0 ? a : b, number by number */
LF_INLINE lf_wide lf_wide_where_positive(lf_wide x, lf_wide a, lf_wide b)
{
    lf_real at[LF_WIDE], from[LF_WIDE], to[LF_WIDE];
    memcpy(at, &x, sizeof at);
    memcpy(from, &a, sizeof from);
    memcpy(to, &b, sizeof to);
    for (int i = 0; i < LF_WIDE; i++)
        to[i] = at[i] > 0 ? from[i] : to[i];
    memcpy(&b, to, sizeof b);
    return b;
}

/* x cut to +-LF_WIDE_MOST; NaN stays NaN. */
LF_INLINE lf_wide lf_wide_cut(lf_wide x)
{
    const lf_real most = LF_WIDE_MOST;
    lf_real at[LF_WIDE];
    memcpy(at, &x, sizeof at);
    for (int i = 0; i < LF_WIDE; i++) {
        const lf_real below = most < at[i] ? most : at[i];
        at[i] = -most > below ? -most : below;
    }
    memcpy(&x, at, sizeof x);
    return x;
}

/* e^x = scale (1 + rest): what exp and expm1 share. */
LF_INLINE lf_wide lf_wide_exp_parts(lf_wide x, lf_wide *rest)
{
    x = lf_wide_cut(x);
    const lf_wide shifted = x * (lf_real)1.44269504088896341 + LF_WIDE_ROUND;
    const lf_wide n = shifted - LF_WIDE_ROUND;
    const lf_wide r = (x - n * LF_WIDE_LN2_HIGH) - n * LF_WIDE_LN2_LOW;
#ifdef LF_DOUBLE
    static const double series[] = {
        1.0 / 6227020800, 1.0 / 479001600, 1.0 / 39916800, 1.0 / 3628800, 1.0 / 362880, 1.0 / 40320,
        1.0 / 5040,       1.0 / 720,       1.0 / 120,      1.0 / 24,      1.0 / 6,      0.5};
    enum { TERMS = 12 };
#else
    static const float series[] = {1.0f / 5040, 1.0f / 720, 1.0f / 120, 1.0f / 24, 1.0f / 6, 0.5f};
    enum { TERMS = 6 };
#endif
    lf_wide p = lf_wide_all(series[0]);
    for (int i = 1; i < TERMS; i++)
        p = p * r + series[i];
    *rest = r + r * r * p;
    /* the integer n stands in the low bits of `shifted` */
    const lf_wide round = lf_wide_all(LF_WIDE_ROUND);
    const lf_wide_bits whole = (lf_wide_bits)shifted - (lf_wide_bits)round;
    return (lf_wide)((whole + LF_WIDE_BIAS) << LF_WIDE_MANTISSA);
}

LF_INLINE lf_wide lf_wide_exp(lf_wide x)
{
    lf_wide rest;
    const lf_wide scale = lf_wide_exp_parts(x, &rest);
    return scale + scale * rest;
}

/* e^x - 1, exact to rounding near 0 */
LF_INLINE lf_wide lf_wide_expm1(lf_wide x)
{
    lf_wide rest;
    const lf_wide scale = lf_wide_exp_parts(x, &rest);
    return scale * rest + (scale - 1);
}

LF_INLINE lf_wide lf_wide_sigmoid(lf_wide x)
{
    return 1 / (1 + lf_wide_exp(-x));
}

/* x > 0 ? x : e^x - 1 */
LF_INLINE lf_wide lf_wide_elu(lf_wide x)
{
    return lf_wide_where_positive(x, x, lf_wide_expm1(x));
}

LF_INLINE lf_real lf_wide_sum(lf_wide v)
{
    lf_real sum = 0;
    for (int i = 0; i < LF_WIDE; i++)
        sum += v[i];
    return sum;
}

/* Any alignment; n <= LF_WIDE numbers, the rest 0. */
LF_INLINE lf_wide lf_wide_load(const lf_real *p, long n)
{
    lf_wide v = {0};
    memcpy(&v, p, (size_t)n * sizeof *p);
    return v;
}

LF_INLINE void lf_wide_store(lf_real *p, long n, lf_wide v)
{
    memcpy(p, &v, (size_t)n * sizeof *p);
}

#endif
