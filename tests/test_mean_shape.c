/* test_mean_shape.c: the mean of built-in shapes against their distances, and beyond the grid. */
#include <omp.h>

#include "eval/mean_shape.h"
#include "tests/close.h"

enum { SHAPES = 5, N = LF_MEAN_NODES };

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

/* At every 7th node: level - how many of the shapes are there. */
static void test_shares(void **state)
{
    (void)state;
    lf_mean_shape mean = mean_of(SHAPES);
    assert_int_equal(mean.shapes, SHAPES);
    lf_shapes *shapes = open_shapes(SHAPES);
    lf_shape shape[SHAPES];
    for (long k = 0; k < SHAPES; k++)
        assert_int_equal(lf_shapes_load(shapes, k, &shape[k], NULL), LF_OK);
    long somewhere = 0;
    for (long i = 0; i < (long)N * N * N; i += 7) {
        double p[1][3], sdf;
        long in = 0;
        for (int c = 0; c < 3; c++)
            p[0][c] = (double)(c == 0 ? i % N : c == 1 ? i / N % N : i / N / N) / (N - 1) - 0.5;
        for (long k = 0; k < SHAPES; k++) {
            lf_sdf_eval(shape[k].sdf, 1, (const double(*)[3])p, &sdf, NULL);
            in += sdf < 0;
        }
        assert_close(value_at(&mean, p[0][0], p[0][1], p[0][2]), mean.level - (double)in / SHAPES,
                     0, 1e-6);
        somewhere += in > 0;
    }
    assert_true(somewhere > 100);
    for (long k = 0; k < SHAPES; k++)
        lf_shape_release(&shape[k]);
    lf_shapes_close(shapes);
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

/* Of one shape the share is 0 or 1, and every level fits it alike: the lowest is taken. */
static void test_one_shape(void **state)
{
    (void)state;
    lf_mean_shape mean = mean_of(1);
    assert_close(mean.level, 0.05, 1e-12, 0);
    for (long i = 0; i < (long)N * N * N; i++)
        assert_true(mean.share[i] == 0 || mean.share[i] == 1);
    lf_mean_shape_free(&mean);
}

static void test_threads(void **state)
{
    (void)state;
    omp_set_num_threads(1);
    lf_mean_shape one = mean_of(3);
    omp_set_num_threads(3);
    lf_mean_shape three = mean_of(3);
    assert_memory_equal(one.share, three.share, (size_t)N * N * N * sizeof *one.share);
    assert_true(one.level == three.level);
    lf_mean_shape_free(&one);
    lf_mean_shape_free(&three);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_shares), cmocka_unit_test(test_between_and_beyond),
        cmocka_unit_test(test_one_shape), cmocka_unit_test(test_threads)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
