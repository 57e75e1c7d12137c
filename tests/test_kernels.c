/* test_kernels.c: every kernel against its plain C reference over plain and odd shapes, the adjoint
 * identities <A x, y> = <x, A' y>, and the same bits with one thread, with two and inside a
 * parallel region. Arrays are allocated at their exact size, so that the address sanitizer sees a
 * read or write beyond them.
 */
#include <omp.h>
#include <string.h>

#include "autograd/kernels/kernels.h"
#include "autograd/random.h"
#include "autograd/status.h"
#include "tests/close.h"

/* The reference sums in double. A sum of n terms in order errs by about sqrt(n) roundings; the
 * longest here has 4608. */
#ifdef LF_DOUBLE
static const double TOLERANCE = 1e-12;
#else
static const double TOLERANCE = 5e-6;
#endif

static lf_real *numbers(long n, uint64_t item)
{
    lf_real *x = malloc((size_t)(n > 0 ? n : 1) * sizeof *x);
    LF_REQUIRE(x, "no memory for %ld numbers", n);
    lf_stream s = lf_stream_at(1, LF_RANDOM_TEST, 0, item);
    for (long i = 0; i < n; i++)
        x[i] = (lf_real)(2 * lf_uniform(&s) - 1);
    return x;
}

static lf_real *copy(const lf_real *x, long n)
{
    lf_real *y = numbers(0, 0);
    y = realloc(y, (size_t)(n > 0 ? n : 1) * sizeof *y);
    LF_REQUIRE(y, "no memory for %ld numbers", n);
    memcpy(y, x, (size_t)n * sizeof *y);
    return y;
}

static double dot(const lf_real *a, const lf_real *b, long n)
{
    double sum = 0;
    for (long i = 0; i < n; i++)
        sum += (double)a[i] * (double)b[i];
    return sum;
}

/* Compare and free both. */
static void expect_same(const char *what, lf_real *fast, lf_real *ref, long n, double tolerance)
{
    const double error = relative_error(fast, ref, n);
    if (!(error <= tolerance))
        fail_msg("%s: relative error %.3g, must be <= %.3g", what, error, tolerance);
    free(fast);
    free(ref);
}

/* ---- linear maps ----------------------------------------------------------------------------- */

typedef struct linear_arrays {
    long rows, in, out;
    lf_real *x, *w, *b, *dy;
} linear_arrays;

static linear_arrays linear_make(long rows, long in, long out)
{
    return (linear_arrays){rows,
                           in,
                           out,
                           numbers(rows * in, 1),
                           numbers(in * out, 2),
                           numbers(out, 3),
                           numbers(rows * out, 4)};
}

static void linear_free(linear_arrays *a)
{
    free(a->x);
    free(a->w);
    free(a->b);
    free(a->dy);
}

static void check_forward(const linear_arrays *a, const lf_real *b, lf_activation act)
{
    lf_real *y = numbers(a->rows * a->out, 5), *r = numbers(a->rows * a->out, 6);
    lf_kernel_linear(a->rows, a->in, a->out, a->x, a->w, b, act, y);
    lf_ref_linear(a->rows, a->in, a->out, a->x, a->w, b, act, r);
    expect_same("linear", y, r, a->rows * a->out, TOLERANCE);
}

static void check_backward(const linear_arrays *a)
{
    lf_real *dx = numbers(a->rows * a->in, 7), *rx = copy(dx, a->rows * a->in);
    lf_kernel_linear_dx(a->rows, a->in, a->out, a->dy, a->w, dx);
    lf_ref_linear_dx(a->rows, a->in, a->out, a->dy, a->w, rx);
    expect_same("linear_dx", dx, rx, a->rows * a->in, TOLERANCE);

    const long size = a->in * a->out;
    lf_real *dw = numbers(size, 8), *rw = copy(dw, size), *lw = copy(dw, size);
    lf_real *db = numbers(a->out, 9), *rb = copy(db, a->out), *lb = copy(db, a->out);
    lf_real *scratch = numbers(lf_linear_dw_scratch(a->rows, a->in, a->out), 10);
    lf_kernel_linear_dw(a->rows, a->in, a->out, a->x, a->dy, dw, db);
    lf_kernel_linear_dw_lanes(a->rows, a->in, a->out, a->x, a->dy, lw, lb, scratch);
    lf_ref_linear_dw(a->rows, a->in, a->out, a->x, a->dy, rw, rb);
    expect_same("linear_dw_lanes", lw, copy(rw, size), size, TOLERANCE);
    expect_same("linear_dw_lanes, db", lb, copy(rb, a->out), a->out, TOLERANCE);
    expect_same("linear_dw", dw, rw, size, TOLERANCE);
    expect_same("linear_dw, db", db, rb, a->out, TOLERANCE);
    free(scratch);
}

static void linear_like_reference(void **state)
{
    (void)state;
    static const long widths[] = {1,  2,  3,  8,  15, 16, 17, 20, 21, 24, 31,
                                  32, 33, 34, 36, 37, 40, 48, 66, 72, 130};
    static const long rows[] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 25, 131};
    enum { WIDTHS = sizeof widths / sizeof *widths, ROWS = sizeof rows / sizeof *rows };
    for (int i = 0; i < WIDTHS; i++)
        for (int o = 0; o < WIDTHS; o++) {
            linear_arrays a = linear_make(rows[(i + o) % ROWS], widths[i], widths[o]);
            check_forward(&a, a.b, LF_RELU);
            check_forward(&a, NULL, LF_IDENTITY);
            check_backward(&a);
            linear_free(&a);
        }
}

static void linear_large(void **state)
{
    (void)state;
    static const long shapes[][3] = {{480, 32, 32}, {1000, 64, 66}, {5000, 34, 24},
                                     {4500, 40, 1}, {300, 300, 40}, {97, 600, 34},
                                     {0, 4, 5},     {513, 512, 256}};
    for (size_t k = 0; k < sizeof shapes / sizeof *shapes; k++) {
        linear_arrays a = linear_make(shapes[k][0], shapes[k][1], shapes[k][2]);
        check_forward(&a, a.b, LF_RELU);
        check_backward(&a);
        linear_free(&a);
    }
}

static void linear_keeps_nan(void **state)
{
    (void)state;
    linear_arrays a = linear_make(5, 4, 3);
    a.x[4] = (lf_real)NAN;
    lf_real y[15];
    lf_kernel_linear(5, 4, 3, a.x, a.w, a.b, LF_RELU, y);
    for (int i = 0; i < 15; i++)
        assert_int_equal(isnan(y[i]) != 0, i / 3 == 1);
    linear_free(&a);
}

static void linear_adjoint(void **state)
{
    (void)state;
    linear_arrays a = linear_make(301, 72, 48);
    lf_real *y = numbers(301 * 48, 5), *dx = calloc(301 * 72, sizeof *dx);
    lf_real *dw = calloc(72 * 48, sizeof *dw);
    LF_REQUIRE(dx && dw, "no memory");
    lf_kernel_linear(301, 72, 48, a.x, a.w, NULL, LF_IDENTITY, y);
    lf_kernel_linear_dx(301, 72, 48, a.dy, a.w, dx);
    lf_kernel_linear_dw(301, 72, 48, a.x, a.dy, dw, NULL);
    const double forward = dot(y, a.dy, 301 * 48), scale = sqrt(301 * 48 * 72.0);
    assert_close(dot(a.x, dx, 301 * 72) / scale, forward / scale, TOLERANCE, TOLERANCE);
    assert_close(dot(a.w, dw, 72 * 48) / scale, forward / scale, TOLERANCE, TOLERANCE);
    free(y);
    free(dx);
    free(dw);
    linear_free(&a);
}

static void matmul_like_reference(void **state)
{
    (void)state;
    static const long shapes[][3] = {{1, 1, 1},       {3, 5, 7},     {12, 32, 256}, {13, 33, 257},
                                     {200, 150, 530}, {600, 64, 64}, {2, 3, 0},     {64, 1, 90}};
    for (size_t k = 0; k < sizeof shapes / sizeof *shapes; k++)
        for (int accumulate = 0; accumulate < 2; accumulate++) {
            const long m = shapes[k][0], n = shapes[k][1], depth = shapes[k][2];
            lf_real *a = numbers(m * depth, 1), *b = numbers(depth * n, 2);
            lf_real *c = numbers(m * n, 3), *r = copy(c, m * n);
            lf_kernel_matmul(m, n, depth, a, b, c, accumulate);
            lf_ref_matmul(m, n, depth, a, b, r, accumulate);
            expect_same("matmul", c, r, m * n, TOLERANCE);
            free(a);
            free(b);
        }
}

/* ---- convolution ----------------------------------------------------------------------------- */

typedef struct conv_arrays {
    lf_conv s;
    long xs, ws, ys;
    lf_real *x, *w, *b, *dy, *scratch;
} conv_arrays;

static conv_arrays conv_make(lf_conv s)
{
    conv_arrays a = {.s = s,
                     .xs = s.images * s.height * s.width * s.in,
                     .ws = s.size * s.size * s.in * s.out,
                     .ys = s.images * s.out_height * s.out_width * s.out};
    a.x = numbers(a.xs, 1);
    a.w = numbers(a.ws, 2);
    a.b = numbers(s.out, 3);
    a.dy = numbers(a.ys, 4);
    a.scratch = numbers(lf_conv_scratch(&s), 5);
    return a;
}

static void conv_free(conv_arrays *a)
{
    free(a->x);
    free(a->w);
    free(a->b);
    free(a->dy);
    free(a->scratch);
}

static void check_conv(lf_conv s)
{
    conv_arrays a = conv_make(s);
    lf_real *y = numbers(a.ys, 6), *ry = numbers(a.ys, 7);
    lf_kernel_conv(&s, a.x, a.w, a.b, LF_RELU, y, a.scratch);
    lf_ref_conv(&s, a.x, a.w, a.b, LF_RELU, ry, NULL);
    expect_same("conv", y, ry, a.ys, TOLERANCE);

    lf_real *dx = numbers(a.xs, 8), *rx = copy(dx, a.xs);
    lf_kernel_conv_dx(&s, a.dy, a.w, dx, a.scratch);
    lf_ref_conv_dx(&s, a.dy, a.w, rx, NULL);
    expect_same("conv_dx", dx, rx, a.xs, TOLERANCE);

    lf_real *dw = numbers(a.ws, 9), *rw = copy(dw, a.ws);
    lf_real *db = numbers(s.out, 10), *rb = copy(db, s.out);
    lf_kernel_conv_dw(&s, a.x, a.dy, dw, db, a.scratch);
    lf_ref_conv_dw(&s, a.x, a.dy, rw, rb, NULL);
    expect_same("conv_dw", dw, rw, a.ws, TOLERANCE);
    expect_same("conv_dw, db", db, rb, s.out, TOLERANCE);
    conv_free(&a);
}

/* The layers of the reconstruction backbone, small. */
static void conv_backbone(void **state)
{
    (void)state;
    static const long shapes[][6] = {
        /* side, in, out, size, stride, pad */
        {65, 3, 32, 7, 2, 3},   {33, 32, 32, 3, 2, 1},  {17, 32, 32, 3, 1, 1},
        {17, 32, 64, 3, 2, 1},  {9, 64, 64, 3, 1, 1},   {9, 64, 128, 3, 2, 1},
        {5, 128, 128, 3, 1, 1}, {3, 128, 256, 3, 1, 1}, {17, 32, 64, 1, 2, 0},
        {9, 64, 16, 1, 1, 0},   {33, 2, 8, 5, 1, 2}};
    for (size_t k = 0; k < sizeof shapes / sizeof *shapes; k++)
        check_conv(lf_conv_shape(2, shapes[k][0], shapes[k][0], shapes[k][1], shapes[k][2],
                                 shapes[k][3], shapes[k][4], shapes[k][5]));
}

/* Every filter size, stride and border on small images with odd channels and unequal sides. */
static void conv_odd_shapes(void **state)
{
    (void)state;
    for (long size = 1; size <= 5; size++)
        for (long stride = 1; stride <= 5; stride++)
            for (long pad = 0; pad <= 3; pad++) {
                const long h = 5 + (size + stride) % 4, w = 6 + (stride + pad) % 5;
                check_conv(lf_conv_shape(3, h, w, 1 + (7 * size + pad) % 19,
                                         1 + (11 * stride + 5 * pad) % 37, size, stride, pad));
            }
    check_conv(lf_conv_shape(1, 3, 3, 40, 5, 7, 2, 3));
    check_conv(lf_conv_shape(0, 3, 3, 4, 5, 3, 1, 1));
}

/* Windows that fill the cache: lines cut into columns, and one window too large for a block. */
static void conv_wide(void **state)
{
    (void)state;
    check_conv(lf_conv_shape(1, 4, 700, 70, 5, 3, 1, 1));
    check_conv(lf_conv_shape(1, 3, 500, 70, 3, 3, 2, 1));
    check_conv(lf_conv_shape(1, 2, 3, 8000, 2, 3, 1, 1));
    check_conv(lf_conv_shape(1, 300, 2, 3, 4, 3, 1, 1));
}

/* Images of so many pixels that the filter's gradient is summed in parts: of one image, by panels;
 * of several, in lanes. */
static void conv_in_parts(void **state)
{
    (void)state;
    check_conv(lf_conv_shape(1, 131, 260, 2, 72, 3, 1, 1));
    check_conv(lf_conv_shape(3, 130, 129, 3, 5, 3, 1, 1));
}

static void conv_adjoint(void **state)
{
    (void)state;
    for (long stride = 1; stride <= 3; stride++) {
        const lf_conv s = lf_conv_shape(3, 15, 17, 24, 40, 3, stride, 1);
        conv_arrays a = conv_make(s);
        lf_real *y = numbers(a.ys, 6), *dx = calloc((size_t)a.xs, sizeof *dx);
        lf_real *dw = calloc((size_t)a.ws, sizeof *dw);
        LF_REQUIRE(dx && dw, "no memory");
        lf_kernel_conv(&s, a.x, a.w, NULL, LF_IDENTITY, y, a.scratch);
        lf_kernel_conv_dx(&s, a.dy, a.w, dx, a.scratch);
        lf_kernel_conv_dw(&s, a.x, a.dy, dw, NULL, a.scratch);
        const double forward = dot(y, a.dy, a.ys), scale = sqrt((double)a.ys * 9 * 24);
        assert_close(dot(a.x, dx, a.xs) / scale, forward / scale, TOLERANCE, TOLERANCE);
        assert_close(dot(a.w, dw, a.ws) / scale, forward / scale, TOLERANCE, TOLERANCE);
        free(y);
        free(dx);
        free(dw);
        conv_free(&a);
    }
}

/* ---- threads --------------------------------------------------------------------------------- */

/* Every kernel's result, one after another, in one array. */
static lf_real *all_results(long *count)
{
    enum { ROWS = 5000, IN = 34, OUT = 40 };
    linear_arrays l = linear_make(ROWS, IN, OUT);
    conv_arrays c = conv_make(lf_conv_shape(5, 17, 17, 24, 40, 3, 2, 1));
    conv_arrays d = conv_make(lf_conv_shape(5, 5, 5, 24, 72, 3, 1, 1));
    lf_real *scratch = numbers(lf_linear_dw_scratch(ROWS, IN, OUT), 5);
    const long n = ROWS * (IN + OUT + 1) + IN * OUT + OUT + c.xs + c.ys + c.ws + 40 + d.xs + d.ys +
                   d.ws + 72 + ROWS * OUT;
    lf_real *all = calloc((size_t)n, sizeof *all), *at = all;
    LF_REQUIRE(all, "no memory");
    lf_kernel_linear(ROWS, IN, OUT, l.x, l.w, l.b, LF_RELU, at);
    lf_kernel_linear_dx(ROWS, IN, OUT, l.dy, l.w, at += ROWS * OUT);
    lf_kernel_linear(ROWS, IN, 1, l.x, l.w, l.b, LF_RELU, at += ROWS * IN);
    at += ROWS;
    lf_kernel_linear_dw_lanes(ROWS, IN, OUT, l.x, l.dy, at, at + IN * OUT, scratch);
    lf_kernel_matmul(ROWS, OUT, IN, l.x, l.w, at += IN * OUT + OUT, false);
    at += ROWS * OUT;
    conv_arrays *convs[] = {&c, &d};
    for (int k = 0; k < 2; k++) {
        conv_arrays *a = convs[k];
        lf_kernel_conv(&a->s, a->x, a->w, a->b, LF_RELU, at, a->scratch);
        lf_kernel_conv_dx(&a->s, a->dy, a->w, at += a->ys, a->scratch);
        at += a->xs;
        lf_kernel_conv_dw(&a->s, a->x, a->dy, at, at + a->ws, a->scratch);
        at += a->ws + a->s.out;
        conv_free(a);
    }
    LF_REQUIRE(at == all + n, "counted %ld, filled %ld", n, (long)(at - all));
    free(scratch);
    linear_free(&l);
    *count = n;
    return all;
}

static void threads_change_nothing(void **state)
{
    (void)state;
    const int threads = omp_get_max_threads();
    long n, n2;
    omp_set_num_threads(1);
    lf_real *one = all_results(&n);
    for (int t = 2; t <= 3; t++) {
        omp_set_num_threads(t);
        lf_real *many = all_results(&n2);
        assert_memory_equal(one, many, (size_t)n * sizeof *one);
        free(many);
    }
    lf_real *inside[2];
#pragma omp parallel for num_threads(2)
    for (int k = 0; k < 2; k++) {
        long unused;
        inside[k] = all_results(&unused);
    }
    for (int k = 0; k < 2; k++) {
        assert_memory_equal(one, inside[k], (size_t)n * sizeof *one);
        free(inside[k]);
    }
    free(one);
    omp_set_num_threads(threads);
}

/* Called inside a team, with nested teams allowed: nothing behind the scratch is written. */
static void conv_in_a_team(void **state)
{
    (void)state;
    enum { BEHIND = 1 << 18 };
    const lf_conv s = lf_conv_shape(1, 4, 4, 128, 128, 3, 1, 1);
    static lf_real x[4 * 4 * 128], w[9 * 128 * 128], y[4 * 4 * 128];
    omp_set_max_active_levels(2);
#pragma omp parallel num_threads(2)
#pragma omp single
    {
        omp_set_num_threads(4); /* of the teams inside */
        const long room = lf_conv_scratch(&s);
        lf_real *scratch = malloc((size_t)(room + BEHIND) * sizeof *scratch);
        memset(scratch + room, 0xff, BEHIND * sizeof *scratch);
        lf_kernel_conv(&s, x, w, NULL, LF_IDENTITY, y, scratch);
        for (long i = 0; i < BEHIND; i++)
            assert_true(isnan(scratch[room + i]));
        free(scratch);
    }
    omp_set_max_active_levels(1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(linear_like_reference),  cmocka_unit_test(linear_large),
        cmocka_unit_test(linear_keeps_nan),       cmocka_unit_test(linear_adjoint),
        cmocka_unit_test(matmul_like_reference),  cmocka_unit_test(conv_backbone),
        cmocka_unit_test(conv_odd_shapes),        cmocka_unit_test(conv_wide),
        cmocka_unit_test(conv_in_parts),          cmocka_unit_test(conv_adjoint),
        cmocka_unit_test(threads_change_nothing), cmocka_unit_test(conv_in_a_team)};
    return cmocka_run_group_tests_name("kernels", tests, NULL, NULL);
}
