/* test_camera.c: projection and rays agree, motions change nothing but the frame, and the settings
 * draw what method.md 5a.8 says. */
#include <string.h>

#include "datasets/camera.h"
#include "tests/close.h"

static lf_stream test_stream(uint64_t item)
{
    return lf_stream_at(1, LF_RANDOM_TEST, 0, item);
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double length(const double a[3])
{
    return sqrt(dot(a, a));
}

static void assert_rotation(const double r[9])
{
    lf_camera camera = {.fx = 1, .fy = 1, .width = 1, .height = 1};
    lf_error err;
    memcpy(camera.rotation, r, sizeof camera.rotation);
    if (lf_camera_check(&camera, "rotation", &err) != LF_OK)
        fail_msg("%s", err.text);
}

static void test_project_and_ray(void **state)
{
    (void)state;
    lf_camera camera[8];
    lf_camera_cube(65, camera);
    for (uint64_t i = 0; i < 1000; i++) {
        lf_stream s = test_stream(i);
        const lf_camera *c = &camera[i % 8];
        const double u = 64 * lf_uniform(&s), v = 64 * lf_uniform(&s), t = 1 + lf_uniform(&s);
        double d[3], p[3], uv[2], depth;
        lf_camera_ray(c, u, v, d);
        assert_close(length(d), 1, 0, 1e-15);
        for (int k = 0; k < 3; k++)
            p[k] = c->centre[k] + t * d[k];
        assert_true(lf_camera_project(c, p, 1e-3, uv, &depth));
        assert_close(uv[0], u, 0, 1e-11);
        assert_close(uv[1], v, 0, 1e-11);
    }
}

/* The field of view: f = 32 / tan 12 degrees; a ball of radius 0.5 lies within the image. */
static void test_cube_cameras(void **state)
{
    (void)state;
    lf_camera camera[8];
    lf_camera_cube(65, camera);
    for (int v = 0; v < 8; v++) {
        const double origin[3] = {0, 0, 0};
        double uv[2], depth, d[3];
        assert_rotation(camera[v].rotation);
        assert_close(camera[v].fx, 32 / tan(12 * 3.14159265358979 / 180), 1e-12, 0);
        assert_true(lf_camera_project(&camera[v], origin, 0, uv, &depth));
        assert_close(uv[0], 32, 0, 1e-12);
        assert_close(uv[1], 32, 0, 1e-12);
        assert_close(depth, 2.5, 1e-14, 0);
        assert_true(camera[v].rotation[4] < 0); /* down has negative y: up is up */
        lf_camera_ray(&camera[v], 0, 32, d);
        /* distance of the border ray from the centre: sin 12 degrees x 2.5 = 0.52 > 0.5 */
        const double along = -dot(d, camera[v].centre);
        assert_true(sqrt(2.5 * 2.5 - along * along) > 0.5);
    }
}

static void test_axes_are_right_handed(void **state)
{
    (void)state;
    const double centre[3] = {0, 0, -3}, target[3] = {0, 0, 0};
    const lf_camera c = lf_camera_look_at(centre, target, 0.3, 11);
    const double right[3] = {1, 0, 0}, up[3] = {0, 1, 0};
    double uv[2], depth;
    assert_rotation(c.rotation);
    assert_true(lf_camera_project(&c, right, 0, uv, &depth));
    assert_true(uv[0] < 5); /* seen from -z towards +z with y up, +x is on the left */
    assert_true(lf_camera_project(&c, up, 0, uv, &depth));
    assert_true(uv[1] < 5); /* rows grow downwards */
}

static void test_motion(void **state)
{
    (void)state;
    lf_camera camera[8];
    lf_camera_cube(65, camera);
    for (uint64_t i = 0; i < 200; i++) {
        lf_stream s = test_stream(1000 + i);
        const lf_motion g = lf_motion_random(&s, 1000), back = lf_motion_inverse(&g);
        const lf_camera moved = lf_camera_move(&camera[i % 8], &g);
        double p[3], gp[3], again[3], uv[2], guv[2], depth, gdepth;
        assert_rotation(g.rotation);
        assert_true(length(g.translation) <= 1000);
        for (int k = 0; k < 3; k++)
            p[k] = lf_uniform(&s) - 0.5;
        lf_motion_apply(&g, p, gp);
        lf_motion_apply(&back, gp, again);
        assert_true(lf_camera_project(&camera[i % 8], p, 0, uv, &depth));
        assert_true(lf_camera_project(&moved, gp, 0, guv, &gdepth));
        for (int k = 0; k < 3; k++)
            assert_close(again[k], p[k], 0, 1e-11);
        assert_close(guv[0], uv[0], 0, 1e-9);
        assert_close(guv[1], uv[1], 0, 1e-9);
        assert_close(gdepth, depth, 0, 1e-11);
    }
}

static void test_recentre(void **state)
{
    (void)state;
    lf_camera camera[8], moved[8];
    lf_camera_cube(65, camera);
    lf_motion g = {.translation = {1e6, -2e6, 3e6}};
    lf_rotation_identity(g.rotation);
    for (int v = 0; v < 8; v++)
        moved[v] = lf_camera_move(&camera[v], &g);
    double origin[3];
    lf_camera_mean_centre(8, moved, origin);
    lf_camera_recentre(8, moved, origin);
    for (int v = 0; v < 8; v++)
        for (int k = 0; k < 3; k++)
            assert_close(moved[v].centre[k], camera[v].centre[k], 0, 1e-9);
}

static void test_roll(void **state)
{
    (void)state;
    lf_camera camera[8];
    lf_camera_cube(65, camera);
    const double p[3] = {0.1, 0.2, -0.15};
    double uv[2], turned[2], depth;
    const lf_camera quarter = lf_camera_roll(&camera[3], 3.14159265358979323846 / 2);
    assert_true(lf_camera_project(&camera[3], p, 0, uv, &depth));
    assert_true(lf_camera_project(&quarter, p, 0, turned, &depth));
    /* camera axes turned by +90 degrees from x to y: x' = y, y' = -x */
    assert_close(turned[0] - 32, uv[1] - 32, 0, 1e-12);
    assert_close(turned[1] - 32, -(uv[0] - 32), 0, 1e-12);
    const lf_camera full = lf_camera_roll(&camera[3], 2 * 3.14159265358979323846);
    assert_memory_equal(&full, &camera[3], sizeof full); /* quarter turns are exact */
}

static void test_masks(void **state)
{
    (void)state;
    lf_camera camera[8];
    lf_camera_cube(65, camera);
    const double(*c)[3] = &camera[0].centre;
    const double point[6][3] = {{0, 0, 0},
                                {2 * c[0][0], 2 * c[0][1], 2 * c[0][2]}, /* behind camera 0 */
                                {c[0][0], c[0][1], c[0][2]},             /* at camera 0 */
                                {0.9, -0.9, 0},                          /* beside the image */
                                {NAN, 0, 0},
                                {INFINITY, 0, 0}};
    const uint8_t expected[6] = {1, 0, 0, 0, 0, 0};
    double uv[6 * 8][2], direction[6 * 8][3], distance[6 * 8];
    uint8_t mask[6 * 8];
    lf_project_points(8, camera, 6, point, 1e-6, uv[0], direction[0], distance, mask);
    for (int q = 0; q < 6; q++) {
        assert_int_equal(mask[8 * q], expected[q]);
        for (int k = 8 * q; k < 8 * q + 8; k++) {
            const double n = length(direction[k]);
            assert_true(isfinite(n) && isfinite(distance[k]));
            assert_true(uv[k][0] >= 0 && uv[k][0] <= 64 && uv[k][1] >= 0 && uv[k][1] <= 64);
            assert_true(n == 0 || fabs(n - 1) < 1e-14);
        }
    }
    assert_close(length(direction[8 * 2]), 0, 0, 0);
    assert_close(length(direction[8]), 1, 0, 1e-14);
    assert_close(distance[0], 2.5, 1e-14, 0);
    lf_project_points(8, camera, 6, point, 1e-6, NULL, NULL, NULL, NULL);
}

static void test_bad_cameras(void **state)
{
    (void)state;
    lf_camera good[8], bad;
    lf_error err;
    lf_camera_cube(65, good);
    assert_int_equal(lf_camera_check(&good[0], "camera 0", &err), LF_OK);
    bad = good[0];
    for (int i = 0; i < 3; i++)
        bad.rotation[3 * i] = -bad.rotation[3 * i]; /* a mirror */
    assert_int_equal(lf_camera_check(&bad, "camera 0", &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "camera 0"));
    bad = good[0];
    bad.rotation[4] = NAN;
    assert_int_equal(lf_camera_check(&bad, "x", &err), LF_BAD_INPUT);
    bad = good[0];
    bad.rotation[4] *= 1.01; /* a scale */
    assert_int_equal(lf_camera_check(&bad, "x", &err), LF_BAD_INPUT);
    bad = good[0];
    bad.fx = 0;
    assert_int_equal(lf_camera_check(&bad, "x", &err), LF_BAD_INPUT);
    bad = good[0];
    bad.width = 0;
    assert_int_equal(lf_camera_check(&bad, "x", &err), LF_BAD_INPUT);
    bad = good[0];
    bad.centre[1] = INFINITY;
    assert_int_equal(lf_camera_check(&bad, "x", &err), LF_BAD_INPUT);
}

/* ---- settings ----------------------------------------------------------------------------- */

static void test_setting_names(void **state)
{
    (void)state;
    lf_setting setting = LF_SETTING_I;
    lf_error err;
    for (int s = 0; s < LF_SETTINGS; s++) {
        assert_int_equal(lf_setting_parse(lf_setting_name((lf_setting)s), &setting, &err), LF_OK);
        assert_int_equal(setting, s);
    }
    assert_int_equal(lf_setting_parse("SO(3)", &setting, &err), LF_OK);
    assert_int_equal(setting, LF_SETTING_SO3);
    assert_int_equal(lf_setting_parse("z", &setting, &err), LF_OK);
    assert_int_equal(setting, LF_SETTING_Z);
    assert_int_equal(lf_setting_parse("Q", &setting, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "'Q'"));
    assert_int_equal(setting, LF_SETTING_Z);
}

/* Roll of `camera` against the upright camera that looks the same way. */
static double roll_of(const lf_camera *camera)
{
    double target[3];
    for (int i = 0; i < 3; i++)
        target[i] = camera->centre[i] + camera->rotation[3 * i + 2];
    const lf_camera upright = lf_camera_look_at(camera->centre, target, 0.2, 65);
    double r[9];
    lf_rotation_transpose(upright.rotation, r);
    lf_rotation_multiply(r, camera->rotation, r);
    return atan2(r[3], r[0]);
}

/* Distance of the optical axis from the origin. */
static double axis_offset(const lf_camera *camera)
{
    const double *r = camera->rotation, d[3] = {r[2], r[5], r[8]};
    const double along = -dot(d, camera->centre), c2 = dot(camera->centre, camera->centre);
    return sqrt(fmax(0, c2 - along * along));
}

static void test_setting_i(void **state)
{
    (void)state;
    lf_camera camera[8], cube[8];
    double object[9], one[9];
    lf_setting_draw(LF_SETTING_I, 65, 1, 2, 3, camera, object);
    lf_camera_cube(65, cube);
    lf_rotation_identity(one);
    assert_memory_equal(camera, cube, sizeof cube);
    assert_memory_equal(object, one, sizeof one);
}

/* Angles uniform in (-pi, pi]: mean cosines and sines of the first harmonics near 0 (each has a
 * standard deviation of 0.7 / sqrt(n)), independent between views. */
static void check_rolls(lf_setting setting, double largest_offset)
{
    enum { draws = 500, n = 8 * draws };
    double sum[6] = {0}, offset = 0, pair = 0;
    for (uint64_t k = 0; k < draws; k++) {
        lf_camera camera[8];
        double object[9], first = 0;
        lf_setting_draw(setting, 65, 7, k, 11, camera, object);
        for (int v = 0; v < 8; v++) {
            const double a = roll_of(&camera[v]);
            for (int h = 1; h <= 3; h++) {
                sum[2 * h - 2] += cos(h * a) / n;
                sum[2 * h - 1] += sin(h * a) / n;
            }
            first = v == 0 ? a : first;
            pair += v == 1 ? cos(a - first) / draws : 0;
            offset = larger(offset, axis_offset(&camera[v]));
            assert_rotation(camera[v].rotation);
        }
    }
    for (int h = 0; h < 6; h++)
        assert_below(fabs(sum[h]), 5 * 0.71 / sqrt(n));
    assert_below(fabs(pair), 5 * 0.71 / sqrt(draws));
    assert_below(offset, largest_offset);
    if (setting == LF_SETTING_R)
        assert_true(offset > 0.8 * largest_offset);
}

static void test_setting_z(void **state)
{
    (void)state;
    check_rolls(LF_SETTING_Z, 1e-7);
}

static void test_setting_r(void **state)
{
    (void)state;
    check_rolls(LF_SETTING_R, 0.05);
}

static void test_setting_y(void **state)
{
    (void)state;
    double c = 0, s = 0;
    for (uint64_t k = 0; k < 1000; k++) {
        lf_camera camera[8], cube[8];
        double object[9];
        lf_setting_draw(LF_SETTING_Y, 65, 7, k, 11, camera, object);
        lf_camera_cube(65, cube);
        assert_memory_equal(camera, cube, sizeof cube);
        assert_rotation(object);
        assert_close(object[4], 1, 0, 0);
        c += object[0] / 1000;
        s += object[2] / 1000;
    }
    assert_below(fabs(c), 0.12);
    assert_below(fabs(s), 0.12);
}

/* Entries of a uniform rotation have mean 0 and mean square 1/3; its trace has mean square 1. */
static void test_setting_so3(void **state)
{
    (void)state;
    enum { draws = 3000 };
    double mean[9] = {0}, square[9] = {0}, trace2 = 0;
    for (uint64_t k = 0; k < draws; k++) {
        lf_camera camera[8];
        double r[9];
        lf_setting_draw(LF_SETTING_SO3, 65, 7, k, 11, camera, r);
        assert_rotation(r);
        for (int i = 0; i < 9; i++) {
            mean[i] += r[i] / draws;
            square[i] += r[i] * r[i] / draws;
        }
        trace2 += (r[0] + r[4] + r[8]) * (r[0] + r[4] + r[8]) / draws;
    }
    for (int i = 0; i < 9; i++) {
        assert_below(fabs(mean[i]), 0.055);
        assert_close(square[i], 1.0 / 3, 0, 0.03);
    }
    assert_close(trace2, 1, 0, 0.15);
}

static void test_draws_are_named(void **state)
{
    (void)state;
    lf_camera a[8], b[8];
    double object[9];
    lf_setting_draw(LF_SETTING_R, 65, 7, 5, 11, a, object);
    lf_setting_draw(LF_SETTING_R, 65, 7, 5, 11, b, object);
    assert_memory_equal(a, b, sizeof a);
    const uint64_t other[3][3] = {{8, 5, 11}, {7, 6, 11}, {7, 5, 12}};
    for (int k = 0; k < 3; k++) {
        lf_setting_draw(LF_SETTING_R, 65, other[k][0], other[k][1], other[k][2], b, object);
        assert_true(memcmp(a, b, sizeof a) != 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_project_and_ray),
        cmocka_unit_test(test_cube_cameras),
        cmocka_unit_test(test_axes_are_right_handed),
        cmocka_unit_test(test_motion),
        cmocka_unit_test(test_recentre),
        cmocka_unit_test(test_roll),
        cmocka_unit_test(test_masks),
        cmocka_unit_test(test_bad_cameras),
        cmocka_unit_test(test_setting_names),
        cmocka_unit_test(test_setting_i),
        cmocka_unit_test(test_setting_z),
        cmocka_unit_test(test_setting_r),
        cmocka_unit_test(test_setting_y),
        cmocka_unit_test(test_setting_so3),
        cmocka_unit_test(test_draws_are_named),
    };
    return cmocka_run_group_tests_name("camera", tests, NULL, NULL);
}
