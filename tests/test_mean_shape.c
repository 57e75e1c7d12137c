/* test_mean_shape.c: the mean of built-in shapes against their distances, and beyond the grid. */
#include <omp.h>

#include "eval/mean_shape.h"
#include "tests/close.h"

enum { SHAPES = 5, N = LF_MEAN_NODES, NODES = N * N * N };

static lf_shapes *open_shapes(long builtin)
{
    const lf_shapes_options o = {.root = LF_BUILTIN,
                                 .category = "chair",
                                 .split = "train",
                                 .builtin = builtin,
                                 .thickness = -1,
                                 .points_uniform = 10,
                                 .points_near = 10,
                                 .views = {LF_SETTING_I, 33, lf_render_defaults()},
                                 .draws = 1};
    lf_shapes *shapes;
    lf_error err = {""};
    if (lf_shapes_open(&o, &shapes, &err) != LF_OK)
        fail_msg("%s", err.text);
    return shapes;
}

static lf_mean_shape mean_of(long builtin)
{
    lf_shapes *shapes = open_shapes(builtin);
    lf_mean_shape mean;
    assert_int_equal(lf_mean_shape_make(shapes, &mean, NULL), LF_OK);
    lf_shapes_close(shapes);
    return mean;
}

static double value_at(lf_mean_shape *mean, double x, double y, double z)
{
    const double point[1][3] = {{x, y, z}};
    float value;
    uint8_t valid = 0;
    lf_mean_shape_field(mean, 1, point, &value, &valid);
    assert_int_equal(valid, 1);
    return value;
}

/* inside[SHAPES][NODES] by the shapes' own distances; the caller frees it. */
static bool (*insides(void))[NODES]
{
    bool(*inside)[NODES] = malloc(SHAPES * sizeof *inside);
    double(*p)[3] = malloc(NODES * sizeof *p), *sdf = malloc(NODES * sizeof *sdf);
    lf_shapes *shapes = open_shapes(SHAPES);
    if (!inside || !p || !sdf)
        fail_msg("out of memory");
    for (long i = 0; i < NODES; i++)
        for (int c = 0; c < 3; c++)
            p[i][c] = (double)(c == 0 ? i % N : c == 1 ? i / N % N : i / N / N) / (N - 1) - 0.5;
    for (long k = 0; k < SHAPES; k++) {
        lf_shape shape;
        assert_int_equal(lf_shapes_load(shapes, k, &shape, NULL), LF_OK);
        lf_sdf_eval(shape.sdf, NODES, (const double(*)[3])p, sdf, NULL);
        for (long i = 0; i < NODES; i++)
            inside[k][i] = sdf[i] < 0;
        lf_shape_release(&shape);
    }
    free(p);
    free(sdf);
    lf_shapes_close(shapes);
    return inside;
}

/* At a node: level - how many of the shapes are there. */
static void test_shares(void **state)
{
    (void)state;
    lf_mean_shape mean = mean_of(SHAPES);
    bool(*inside)[NODES] = insides();
    assert_int_equal(mean.shapes, SHAPES);
    long somewhere = 0;
    for (long i = 0; i < NODES; i++) {
        long in = 0;
        for (long k = 0; k < SHAPES; k++)
            in += inside[k][i];
        assert_close(mean.share[i], (double)in / SHAPES, 0, 1e-7);
        if (i % 97 == 0)
            assert_close(value_at(&mean, (double)(i % N) / (N - 1) - 0.5,
                                  (double)(i / N % N) / (N - 1) - 0.5,
                                  (double)(i / N / N) / (N - 1) - 0.5),
                         mean.level - (double)in / SHAPES, 0, 1e-6);
        somewhere += in > 0;
    }
    assert_true(somewhere > 1000);
    free(inside);
    lf_mean_shape_free(&mean);
}

/* Halfway between nodes it is their mean; beyond the cube nothing is inside. */
static void test_between_and_beyond(void **state)
{
    (void)state;
    lf_mean_shape mean = mean_of(SHAPES);
    const double step = 1.0 / (N - 1);
    for (int i = 0; i + 1 < N; i++) {
        const double x = i * step - 0.5;
        const double left = value_at(&mean, x, 0, 0.1), right = value_at(&mean, x + step, 0, 0.1);
        assert_close(value_at(&mean, x + step / 2, 0, 0.1), (left + right) / 2, 0, 1e-6);
    }
    assert_close(value_at(&mean, 0.51, 0, 0), mean.level, 1e-7, 0);
    assert_close(value_at(&mean, 0, -0.51, 0), mean.level, 1e-7, 0);
    assert_close(value_at(&mean, 0, 0, NAN), mean.level, 1e-7, 0);
    assert_true(isfinite(value_at(&mean, 0.5, 0.5, 0.5)));
    lf_mean_shape_free(&mean);
}

/* The level fits the shapes at least as well as any other share between two that nodes have. */
static void test_level(void **state)
{
    (void)state;
    lf_mean_shape mean = mean_of(SHAPES);
    bool(*inside)[NODES] = insides();
    double iou[SHAPES] = {0};
    int best = 0;
    for (int l = 0; l < SHAPES; l++) { /* more than l of the shapes */
        for (long k = 0; k < SHAPES; k++) {
            long both = 0, either = 0;
            for (long i = 0; i < NODES; i++) {
                const bool in = mean.share[i] > (l + 0.5) / SHAPES;
                both += in && inside[k][i];
                either += in || inside[k][i];
            }
            iou[l] += (double)both / (double)either;
        }
        best = iou[l] > iou[best] ? l : best;
    }
    assert_close(mean.level, (best + 0.5) / SHAPES, 1e-12, 0);
    free(inside);
    lf_mean_shape_free(&mean);
}

/* Of one shape the share is 0 or 1: one level. */
static void test_one_shape(void **state)
{
    (void)state;
    lf_mean_shape mean = mean_of(1);
    assert_close(mean.level, 0.5, 1e-12, 0);
    for (long i = 0; i < NODES; i++)
        assert_true(mean.share[i] == 0 || mean.share[i] == 1);
    lf_mean_shape_free(&mean);
}

static void test_threads(void **state)
{
    (void)state;
    const int threads = omp_get_max_threads();
    omp_set_num_threads(1);
    lf_mean_shape one = mean_of(3);
    omp_set_num_threads(3);
    lf_mean_shape three = mean_of(3);
    assert_memory_equal(one.share, three.share, NODES * sizeof *one.share);
    omp_set_num_threads(threads);
    assert_true(one.level == three.level);
    lf_mean_shape_free(&one);
    lf_mean_shape_free(&three);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_shares), cmocka_unit_test(test_between_and_beyond),
        cmocka_unit_test(test_level), cmocka_unit_test(test_one_shape),
        cmocka_unit_test(test_threads)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
