/* test_camera_path.c: closed forms of both paths, and that they move with the cameras. */
#include "tests/scene_fixture.h"

#include "datasets/camera_path.h"

static const double pi = 3.14159265358979323846;

static void add(lf_scene *scene, const lf_camera *camera)
{
    char name[16];
    uint8_t *rgb = calloc((size_t)camera->width * (size_t)camera->height, 3);
    snprintf(name, sizeof name, "%ld", scene->views);
    lf_scene_add(scene, name, camera, 1, 9, LF_SPLIT_TRAIN, rgb, NULL);
    free(rgb);
}

/* Unrolled cameras at distance 4, elevation 0.4, azimuths from -1 to 1 from the z axis, looking at
 * `focus`; growing focal lengths. */
static lf_scene *arc(const double focus[3], int views)
{
    lf_scene *scene = lf_scene_create("arc");
    for (int v = 0; v < views; v++) {
        const double azimuth = 2.0 * v / (views - 1) - 1;
        const double centre[3] = {focus[0] + 4 * cos(0.4) * sin(azimuth), focus[1] + 4 * sin(0.4),
                                  focus[2] + 4 * cos(0.4) * cos(azimuth)};
        lf_camera c = lf_camera_look_at(centre, focus, 0.3, 8);
        c.fx = 10 + (v * 3) % views;
        add(scene, &c);
    }
    return scene;
}

/* Cameras on a grid, all facing +z, y down. */
static lf_scene *grid(void)
{
    lf_scene *scene = lf_scene_create("grid");
    for (int v = 0; v < 15; v++) {
        lf_camera c = {.fx = 9, .fy = 9, .cx = 3, .cy = 2, .width = 8, .height = 6};
        lf_rotation_identity(c.rotation);
        c.centre[0] = 0.5 * (v % 5 - 2) + 7;
        c.centre[1] = 0.2 * (v / 5 - 1);
        c.centre[2] = v % 2 ? 0.1 : -0.1; /* 7 and 8 of them: mean -0.1 / 15 */
        add(scene, &c);
    }
    return scene;
}

static void path(lf_path_kind kind, const lf_scene *scene, const double focus[3], long frames,
                 lf_camera *out)
{
    lf_error err = {""};
    if (lf_camera_path(kind, scene, focus, frames, out, &err) != LF_OK)
        fail_msg("%s", err.text);
}

static void assert_same(const lf_camera *a, const lf_camera *b, double tolerance)
{
    for (int i = 0; i < 9; i++)
        assert_close(a->rotation[i], b->rotation[i], 0, tolerance);
    for (int i = 0; i < 3; i++)
        assert_close(a->centre[i], b->centre[i], 0, tolerance);
}

/* The first frame is the camera in the middle of the arc; the others are look_at's. */
static void orbit_of_an_arc(void **state)
{
    (void)state;
    enum { FRAMES = 12 };
    const double focus[3] = {1, 2, 3};
    lf_scene *scene = arc(focus, 11);
    lf_camera out[FRAMES];
    path(LF_PATH_ORBIT, scene, focus, FRAMES, out);
    assert_same(&out[0], &scene->view[5].camera, 1e-2); /* the axis is the mean up, a little */
    assert_close(out[0].fx, 15, 0, 0);                  /* the median of 10 ... 20 */
    assert_int_equal(out[0].width, 8);
    for (int k = 0; k < FRAMES; k++) {
        const double p = 2 * pi * k / FRAMES;
        const double centre[3] = {focus[0] + 4 * cos(0.4) * sin(p), focus[1] + 4 * sin(0.4),
                                  focus[2] + 4 * cos(0.4) * cos(p)};
        const lf_camera expected = lf_camera_look_at(centre, focus, 0.3, 8);
        double uv[2], depth;
        assert_same(&out[k], &expected, 1e-2);
        assert_int_equal(lf_camera_check(&out[k], "frame", NULL), LF_OK);
        assert_true(lf_camera_project(&out[k], focus, 0, uv, &depth));
        assert_close(depth, 4, 1e-12, 0);
        assert_close(uv[0], out[k].cx, 0, 1e-9);
        assert_close(uv[1], out[k].cy, 0, 1e-9);
    }
    lf_scene_close(scene);
}

/* Cameras all around: the axis is exact, and the first frame stands at the first camera. */
static void orbit_of_a_ring(void **state)
{
    (void)state;
    enum { FRAMES = 5 };
    const double focus[3] = {0, 0, 0};
    lf_scene *scene = lf_scene_create("ring");
    for (int v = 0; v < FRAMES; v++) {
        const double p = 0.3 + 2 * pi * v / FRAMES, centre[3] = {sin(p), 0.5, cos(p)};
        const lf_camera c = lf_camera_look_at(centre, focus, 0.3, 8);
        add(scene, &c);
    }
    lf_camera out[FRAMES];
    path(LF_PATH_ORBIT, scene, focus, FRAMES, out);
    for (int k = 0; k < FRAMES; k++)
        assert_same(&out[k], &scene->view[k].camera, 1e-12);
    lf_scene_close(scene);
}

/* |x - 7| of the grid: 3 x 0, 6 x 0.5, 6 x 1, so the 0.9 quantile is 1; |y|: 5 x 0, 10 x 0.2. */
static void spiral_of_a_grid(void **state)
{
    (void)state;
    enum { FRAMES = 16 };
    const double focus[3] = {6, 1, 5}, mid = -0.1 / 15;
    lf_scene *scene = grid();
    lf_camera out[FRAMES];
    path(LF_PATH_SPIRAL, scene, focus, FRAMES, out);
    const double rz = 0.7 * (0.1 - mid); /* of 7 odd views; the even ones are nearer */
    for (int k = 0; k < FRAMES; k++) {
        const double p = 4 * pi * k / FRAMES, target[3] = {7, 0, 5};
        double uv[2], depth;
        assert_close(out[k].centre[0], 7 + 0.7 * cos(p), 0, 1e-12);
        assert_close(out[k].centre[1], 0.14 * sin(p), 0, 1e-12);
        assert_close(out[k].centre[2], mid + rz * sin(p / 2), 0, 1e-12);
        assert_int_equal(lf_camera_check(&out[k], "frame", NULL), LF_OK);
        assert_true(lf_camera_project(&out[k], target, 0, uv, &depth));
        assert_close(uv[0], 3, 0, 1e-9);
        assert_close(uv[1], 2, 0, 1e-9);
        assert_close(out[k].rotation[3], 0, 0, 1e-12); /* right stays level */
        assert_true(out[k].rotation[4] > 0.9);
    }
    lf_scene_close(scene);
}

/* g of all cameras and of the focus gives g of the path; and so it is with the focus found anew. */
static void paths_move_with_the_cameras(void **state)
{
    (void)state;
    enum { FRAMES = 7 };
    const double origin[3] = {0.2, 0.1, -0.3};
    lf_scene *scenes[] = {make_scene(false, false), arc(origin, 6), grid()};
    for (int item = 0; item < 3 * 20; item++) {
        lf_scene *scene = scenes[item % 3];
        const lf_path_kind kind = item % 3 == 2 ? LF_PATH_SPIRAL : LF_PATH_ORBIT;
        lf_stream stream = lf_stream_at(3, LF_RANDOM_TEST, 0, (uint64_t)item);
        const lf_motion g = lf_motion_random(&stream, 10);
        double focus[3], moved_focus[3], found[3];
        lf_camera before[FRAMES], after[FRAMES];
        const bool sure = lf_scene_focus(scene, focus);
        path(kind, scene, focus, FRAMES, before);
        lf_scene *moved = lf_scene_create("moved");
        for (long v = 0; v < scene->views; v++) {
            const lf_camera c = lf_camera_move(&scene->view[v].camera, &g);
            add(moved, &c);
        }
        lf_motion_apply(&g, focus, moved_focus);
        path(kind, moved, moved_focus, FRAMES, after);
        for (int k = 0; k < FRAMES; k++) {
            const lf_camera expected = lf_camera_move(&before[k], &g);
            assert_same(&after[k], &expected, 1e-9);
            assert_close(after[k].fx, before[k].fx, 0, 0);
        }
        assert_int_equal(lf_scene_focus(moved, found), sure);
        path(kind, moved, found, FRAMES, after);
        const lf_camera expected = lf_camera_move(&before[3], &g);
        assert_same(&after[3], &expected, 1e-9);
        lf_scene_close(moved);
    }
    for (int i = 0; i < 3; i++)
        lf_scene_close(scenes[i]);
}

static void refuse(lf_path_kind kind, const lf_scene *scene, const double focus[3],
                   const char *word)
{
    lf_camera out;
    lf_error err = {""};
    assert_int_equal(lf_camera_path(kind, scene, focus, 1, &out, &err), LF_BAD_INPUT);
    if (!strstr(err.text, word))
        fail_msg("\"%s\" does not say %s", err.text, word);
}

static void impossible_paths_are_refused(void **state)
{
    (void)state;
    const double focus[3] = {0, 0, 0}, behind[3] = {7, 0, -3};
    lf_path_kind kind;
    lf_scene *scene = lf_scene_create("refused"), *flat = grid();
    refuse(LF_PATH_ORBIT, scene, focus, "needs cameras");
    lf_camera c = {.fx = 9, .fy = 9, .cx = 3, .cy = 2, .width = 8, .height = 6};
    lf_rotation_identity(c.rotation);
    add(scene, &c);
    refuse(LF_PATH_ORBIT, scene, focus, "at the focus");
    c = lf_camera_roll(&c, pi);
    add(scene, &c);
    refuse(LF_PATH_ORBIT, scene, focus, "cancel");
    refuse(LF_PATH_SPIRAL, scene, focus, "cancel");
    refuse(LF_PATH_SPIRAL, flat, behind, "in front");
    assert_int_equal(lf_path_kind_parse("orbit", &kind, NULL), LF_OK);
    assert_int_equal(kind, LF_PATH_ORBIT);
    assert_int_equal(lf_path_kind_parse("line", &kind, NULL), LF_BAD_INPUT);
    assert_string_equal(lf_path_kind_name(LF_PATH_SPIRAL), "spiral");
    lf_scene_close(scene);
    lf_scene_close(flat);
}

/* What the shell makes of the line: the argument after -i, and the last one. */
static void line_survives_the_shell(void **state)
{
    (void)state;
    const char *cases[][3] = {
        {"out", "./out/frame-%04d.png", "./out/video.mp4"},
        {"/a b/it's $HOME", "/a b/it's $HOME/frame-%04d.png", "/a b/it's $HOME/video.mp4"},
        {"-x 5% `ls`", "./-x 5%% `ls`/frame-%04d.png", "./-x 5% `ls`/video.mp4"}};
    for (int i = 0; i < 3; i++) {
        char line[512], script[1024], expected[512], got[512] = "";
        const size_t length = lf_camera_path_ffmpeg(line, sizeof line, cases[i][0], 24);
        assert_int_equal(length, strlen(line));
        snprintf(script, sizeof script,
                 "ffmpeg() { while [ $# -gt 1 ]; do [ \"$1\" = -i ] && printf '%%s|' \"$2\"; "
                 "shift; done; printf '%%s' \"$1\"; }; %s",
                 line);
        FILE *shell = popen(script, "r");
        assert_non_null(shell);
        assert_non_null(fgets(got, sizeof got, shell));
        assert_int_equal(pclose(shell), 0);
        snprintf(expected, sizeof expected, "%s|%s", cases[i][1], cases[i][2]);
        assert_string_equal(got, expected);
        char small[8] = "x";
        assert_int_equal(lf_camera_path_ffmpeg(small, sizeof small, cases[i][0], 24), length);
        assert_string_equal(small, "");
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(orbit_of_an_arc),
        cmocka_unit_test(orbit_of_a_ring),
        cmocka_unit_test(spiral_of_a_grid),
        cmocka_unit_test(paths_move_with_the_cameras),
        cmocka_unit_test(impossible_paths_are_refused),
        cmocka_unit_test(line_survives_the_shell),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
