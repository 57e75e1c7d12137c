/* test_vector_math.c: exp, expm1, sigmoid and ELU of vectors against libm in long double; the place
 * of the largest number. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "autograd/kernels/vector_math.h"

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

static lf_vec fast_exp(lf_vec x)
{
    return lf_vec_exp(x);
}

static lf_vec fast_expm1(lf_vec x)
{
    return lf_vec_expm1(x);
}

static lf_vec fast_sigmoid(lf_vec x)
{
    return lf_vec_sigmoid(x);
}

static lf_vec fast_elu(lf_vec x)
{
    return lf_vec_elu(x);
}

/* The largest error in units of the result's last place, over a dense set of arguments. */
static long double worst(lf_vec (*fast)(lf_vec), long double (*exact)(long double))
{
    long double largest = 0;
    for (int i = -200000; i <= 200000; i += LF_LANES) {
        lf_vec x;
        for (int l = 0; l < LF_LANES; l++) {
            const long double t = (i + l) / 200000.0L;
            x[l] = (lf_real)(i % 3 ? most * t * t * t : 2 * t);
        }
        const lf_vec y = fast(x);
        for (int l = 0; l < LF_LANES; l++) {
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
        lf_vec (*fast)(lf_vec);
        long double (*exact)(long double);
    } row[] = {{"exp", fast_exp, exp_of},
               {"expm1", fast_expm1, expm1_of},
               {"sigmoid", fast_sigmoid, sigmoid_of},
               {"elu", fast_elu, elu_of}};
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        const long double error = worst(row[i].fast, row[i].exact);
        printf("%s: %.2Lf units in the last place\n", row[i].name, error);
        assert_true(error < 2);
    }
}

/* One number through a function of vectors. */
static lf_real at(lf_vec (*fast)(lf_vec), lf_real x)
{
    return fast(lf_vec_all(x))[0];
}

static void extremes(void **state)
{
    (void)state;
    const lf_real huge = (lf_real)1e30, infinite = (lf_real)INFINITY, nan = (lf_real)NAN;
    assert_true(at(fast_exp, -huge) >= 0 && at(fast_exp, -huge) < 1e-37);
    assert_true(at(fast_exp, -infinite) < 1e-37 && at(fast_exp, 0) == 1);
    assert_true(isfinite(at(fast_exp, infinite)) && at(fast_exp, huge) > 1e37);
    assert_true(at(fast_sigmoid, -huge) >= 0 && at(fast_sigmoid, -huge) < 1e-37);
    assert_true(at(fast_sigmoid, huge) == 1 && at(fast_sigmoid, 0) == (lf_real)0.5);
    assert_true(at(fast_expm1, -huge) == -1 && at(fast_expm1, 0) == 0);
    assert_true(at(fast_elu, -huge) == -1 && at(fast_elu, huge) == huge);
    assert_true(isnan(at(fast_exp, nan)) && isnan(at(fast_sigmoid, nan)));
    assert_true(isnan(at(fast_expm1, nan)) && isnan(at(fast_elu, nan)));
}

/* The largest number at every place, also twice; none at all. */
static void of_largest(void **state)
{
    (void)state;
    enum { N = 3 * LF_LANES };
    lf_real w[N], x[N];
    for (int at = 0; at < N; at++) {
        for (int i = 0; i < N; i++) {
            w[i] = (lf_real)(0.5 / (1 + i % 5));
            x[i] = (lf_real)i;
        }
        w[at] = 2;
        assert_true(lf_vec_of_largest(N, w, x) == (lf_real)at);
        w[(at + 5) % N] = 2;
        const lf_real either = lf_vec_of_largest(N, w, x);
        assert_true(either == (lf_real)at || either == (lf_real)((at + 5) % N));
    }
    memset(w, 0, sizeof w);
    assert_true(lf_vec_of_largest(N, w, x) == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(accuracy), cmocka_unit_test(extremes),
                                       cmocka_unit_test(of_largest)};
    return cmocka_run_group_tests_name("vector_math", tests, NULL, NULL);
}
