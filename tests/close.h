/* close.h: comparisons of numbers for the tests (cmocka's own casts to float). */
#ifndef LF_TESTS_CLOSE_H
#define LF_TESTS_CLOSE_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <cmocka.h>

/* |actual - expected| <= atol + rtol |expected|; NaN never passes. */
static inline int is_close(double actual, double expected, double rtol, double atol)
{
    return fabs(actual - expected) <= atol + rtol * fabs(expected);
}

/* The larger of two; a NaN stays, which fmax would drop. */
static inline double larger(double a, double b)
{
    return a > b || isnan(a) ? a : b;
}

#define assert_close(actual, expected, rtol, atol)                                                 \
    do {                                                                                           \
        const double close_a = (double)(actual), close_e = (double)(expected);                     \
        if (!is_close(close_a, close_e, rtol, atol))                                               \
            fail_msg("%s = %.9g, expected %.9g (difference %.3g)", #actual, close_a, close_e,      \
                     close_a - close_e);                                                           \
    } while (0)

/* Largest |a - b| over n numbers divided by the largest |b| (or by 1e-300 if all are 0). */
#define relative_error(a, b, n)                                                                    \
    __extension__({                                                                                \
        double re_worst = 0, re_size = 1e-300;                                                     \
        for (long re_i = 0; re_i < (long)(n); re_i++) {                                            \
            const double re_d = fabs((double)(a)[re_i] - (double)(b)[re_i]);                       \
            re_worst = re_d > re_worst || isnan(re_d) ? re_d : re_worst;                           \
            if (fabs((double)(b)[re_i]) > re_size)                                                 \
                re_size = fabs((double)(b)[re_i]);                                                 \
        }                                                                                          \
        re_worst / re_size;                                                                        \
    })

#define assert_below(value, limit)                                                                 \
    do {                                                                                           \
        const double below_v = (double)(value);                                                    \
        if (!(below_v <= (double)(limit)))                                                         \
            fail_msg("%s = %.6g, must be <= %.3g", #value, below_v, (double)(limit));              \
    } while (0)

#endif
