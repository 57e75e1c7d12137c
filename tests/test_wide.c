/* test_wide.c: exp, expm1, sigmoid and ELU of wide vectors against libm in long double. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>

#include <cmocka.h>

#include "autograd/kernels/wide.h"

#ifdef LF_DOUBLE
static const long double unit = DBL_EPSILON, most = 700;
#else
static const long double unit = FLT_EPSILON, most = 86;
#endif

static long double exp_of(long double x)
{
    return expl(x);
}

static long double expm1_of(long double x)
{
    return expm1l(x);
}

static long double sigmoid_of(long double x)
{
    return 1 / (1 + expl(-x));
}

static long double elu_of(long double x)
{
    return x > 0 ? x : expm1l(x);
}

static lf_wide wide_exp(lf_wide x)
{
    return lf_wide_exp(x);
}

static lf_wide wide_expm1(lf_wide x)
{
    return lf_wide_expm1(x);
}

static lf_wide wide_sigmoid(lf_wide x)
{
    return lf_wide_sigmoid(x);
}

static lf_wide wide_elu(lf_wide x)
{
    return lf_wide_elu(x);
}

/* The largest error in units of the result's last place, over a dense set of arguments. */
static long double worst(lf_wide (*fast)(lf_wide), long double (*exact)(long double))
{
    long double largest = 0;
    for (int i = -200000; i <= 200000; i += LF_WIDE) {
        lf_wide x;
        for (int l = 0; l < LF_WIDE; l++) {
            const long double t = (i + l) / 200000.0L;
            x[l] = (lf_real)(i % 3 ? most * t * t * t : 2 * t);
        }
        const lf_wide y = fast(x);
        for (int l = 0; l < LF_WIDE; l++) {
            const long double truth = exact(x[l]);
            const long double error = fabsl(y[l] - truth) / (unit * fabsl(truth) + LDBL_MIN);
            largest = fmaxl(largest, truth == 0 ? 0 : error);
        }
    }
    return largest;
}

static void accuracy(void **state)
{
    (void)state;
    const struct {
        const char *name;
        lf_wide (*fast)(lf_wide);
        long double (*exact)(long double);
    } row[] = {{"exp", wide_exp, exp_of},
               {"expm1", wide_expm1, expm1_of},
               {"sigmoid", wide_sigmoid, sigmoid_of},
               {"elu", wide_elu, elu_of}};
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        const long double error = worst(row[i].fast, row[i].exact);
        printf("%s: %.2Lf units in the last place\n", row[i].name, error);
        assert_true(error < 2);
    }
}

static void extremes(void **state)
{
    (void)state;
    lf_wide x = {0};
    x[0] = (lf_real)-1e30;
    x[1] = (lf_real)1e30;
    x[2] = (lf_real)NAN;
    x[3] = -INFINITY;
    x[4] = INFINITY;
    const lf_wide e = lf_wide_exp(x), s = lf_wide_sigmoid(x), m = lf_wide_expm1(x);
    assert_true(e[0] >= 0 && e[0] < 1e-37 && isfinite(e[1]) && isnan(e[2]) && e[3] < 1e-37);
    assert_true(isfinite(e[4]) && e[1] > 1e37 && e[5] == 1);
    assert_true(s[0] >= 0 && s[0] < 1e-37 && s[1] == 1 && isnan(s[2]) && s[5] == (lf_real)0.5);
    assert_true(m[0] == -1 && isnan(m[2]) && m[5] == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(accuracy), cmocka_unit_test(extremes)};
    return cmocka_run_group_tests_name("wide", tests, NULL, NULL);
}
