/* test_scene_match.c: corners of a painted wall are found on their epipolar lines, and not there if
 * the poses are wrong; the picture of a scene is drawn. */
#include "tests/scene_fixture.h"

enum { SIZE = 96 };

/* Grey of the wall z = 0: a chequered pattern of unequal cells. */
static double paint(double x, double y)
{
    const double wave =
        sin(9 * x) + sin(8 * y + 1) + sin(5 * x + 7 * y) + 0.7 * sin(13 * x - 6 * y);
    return 0.5 + 0.2 * wave;
}

/* Five views along x, 3 before the wall. */
static lf_scene *make_wall(void)
{
    lf_scene *scene = lf_scene_create("wall");
    for (int v = 0; v < 5; v++) {
        const double centre[3] = {0.25 * v - 0.5, 0.1 * (v % 2), -3}, target[3] = {0, 0, 0};
        const lf_camera c = lf_camera_look_at(centre, target, 0.3, SIZE);
        static uint8_t rgb[SIZE * SIZE * 3];
        for (int i = 0; i < SIZE * SIZE; i++) {
            double d[3];
            lf_camera_ray(&c, i % SIZE, (double)(i / SIZE), d);
            const double t = -c.centre[2] / d[2];
            const double g = paint(c.centre[0] + t * d[0], c.centre[1] + t * d[1]);
            memset(rgb + 3 * i, (int)(255 * fmin(1, fmax(0, g))), 3);
        }
        char name[16];
        snprintf(name, sizeof name, "v%d", v);
        lf_scene_add(scene, name, &c, 2, 4, LF_SPLIT_TRAIN, rgb, NULL);
    }
    return scene;
}

static lf_line_fit fit_of(const lf_scene *scene)
{
    lf_line_fit fit;
    assert_int_equal(lf_scene_fit_lines(scene, 5, &fit, NULL), LF_OK);
    return fit;
}

static void test_lines_fit(void **state)
{
    (void)state;
    lf_scene *scene = make_wall();
    const lf_line_fit good = fit_of(scene);
    assert_int_equal(good.pairs, 5);
    assert_true(good.matches > 60);
    assert_below(good.median, 0.2);
    assert_true(good.within_one > 0.9);
    for (long v = 0; v < scene->views; v += 2) /* three pixels down: lines run across */
        scene->view[v].camera.cy += 3;
    const lf_line_fit shifted = fit_of(scene);
    assert_true(shifted.median > 2);
    lf_scene_close(scene);
}

static void test_one_view(void **state)
{
    char path[512];
    lf_scene *scene = make_wall();
    for (long v = 1; v < scene->views; v++) /* all at one place: there is no line */
        memcpy(scene->view[v].camera.centre, scene->view[0].camera.centre, 24);
    const lf_line_fit none = fit_of(scene);
    assert_int_equal(none.pairs, 0);
    assert_true(isnan(none.median));
    assert_int_equal(lf_scene_draw(scene, place(state, "one.png", path), NULL), LF_OK);
    lf_scene_close(scene);
}

static void test_picture(void **state)
{
    char path[512];
    int width, height, channels;
    lf_error err;
    lf_scene *scene = make_wall();
    assert_int_equal(lf_scene_draw(scene, place(state, "a.png", path), &err), LF_OK);
    assert_int_equal(lf_image_read_size(path, &width, &height, &channels, &err), LF_OK);
    assert_int_equal(width, 1224);
    assert_int_equal(lf_scene_draw(scene, place(state, "a.jpg", path), &err), LF_BAD_INPUT);
    scene->view[0].near = 0;
    assert_int_equal(lf_scene_draw(scene, place(state, "b.png", path), &err), LF_OK);
    lf_scene_close(scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lines_fit),
        cmocka_unit_test_setup_teardown(test_one_view, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_picture, set_up, tear_down),
    };
    return cmocka_run_group_tests_name("scene_match", tests, NULL, NULL);
}
