/* test_scene.c: what is written is read again, pictures come and go, sources are near. */
#include "tests/scene_fixture.h"

#include "datasets/npy.h"

static void assert_same_camera(const lf_camera *a, const lf_camera *b, double tolerance)
{
    for (int i = 0; i < 9; i++)
        assert_close(a->rotation[i], b->rotation[i], 0, tolerance);
    for (int i = 0; i < 3; i++)
        assert_close(a->centre[i], b->centre[i], 0, 4 * tolerance);
    assert_close(a->fx, b->fx, tolerance, 0);
    assert_close(a->fy, b->fy, tolerance, 0);
    assert_close(a->cx, b->cx, 0, 10 * tolerance);
    assert_close(a->cy, b->cy, 0, 10 * tolerance);
    assert_int_equal(a->width, b->width);
    assert_int_equal(a->height, b->height);
}

static void assert_same_pixels(const lf_scene *a, long i, const lf_scene *b, long j)
{
    lf_pixels p, q;
    assert_int_equal(lf_scene_hold(a, i, &p, NULL), LF_OK);
    assert_int_equal(lf_scene_hold(b, j, &q, NULL), LF_OK);
    assert_int_equal(p.alpha == NULL, q.alpha == NULL);
    for (int k = 0; k < p.width * p.height; k++) {
        for (int c = 0; c < 3; c++)
            assert_true(abs(p.rgb[3 * k + c] - q.rgb[3 * k + c]) <= (p.alpha ? 1 : 0));
        if (p.alpha)
            assert_int_equal(p.alpha[k], q.alpha[k]);
    }
    lf_scene_release(a, i);
    lf_scene_release(b, j);
}

/* The readers sort by split and name: the n-th view of a split stays the n-th. */
static long same_view(const lf_scene *from, long view, const lf_scene *to)
{
    long number = 0;
    for (long i = 0; i < view; i++)
        number += from->view[i].split == from->view[view].split;
    for (long i = 0; i < to->views; i++)
        if (to->view[i].split == from->view[view].split && number-- == 0)
            return i;
    fail_msg("view %ld is gone", view);
    return -1;
}

static void round_trip(void **state, lf_scene_layout layout, bool free_lens, bool alpha)
{
    char name[64], path[512];
    lf_error err = {"no message"};
    lf_scene *scene = make_scene(free_lens, alpha);
    snprintf(name, sizeof name, "round/l%d%d%d", (int)layout, free_lens, alpha);
    if (lf_scene_write(scene, layout, place(state, name, path), &err) != LF_OK)
        fail_msg("%s", err.text);
    lf_scene *again = open_good(state, name);
    assert_int_equal(again->layout, layout);
    assert_int_equal(again->views, scene->views);
    assert_int_equal(again->left, 0);
    for (long v = 0; v < scene->views; v++) {
        const long w = same_view(scene, v, again);
        assert_same_camera(&again->view[w].camera, &scene->view[v].camera, 1e-12);
        assert_same_pixels(again, w, scene, v);
        assert_true(again->view[w].near < again->view[w].far);
        if (layout <= LF_LAYOUT_TRANSFORMS) {
            assert_close(again->view[w].near, 2, 0, 0);
            assert_close(again->view[w].far, 6, 0, 0);
        }
    }
    lf_scene_close(again);
    lf_scene_close(scene);
}

static void test_round_trips(void **state)
{
    for (int layout = 0; layout < LF_LAYOUTS; layout++) {
        round_trip(state, (lf_scene_layout)layout, false, false);
        round_trip(state, (lf_scene_layout)layout, false, true);
    }
    round_trip(state, LF_LAYOUT_TRANSFORMS, true, false);
    round_trip(state, LF_LAYOUT_COLMAP_TEXT, true, false);
    round_trip(state, LF_LAYOUT_COLMAP_BINARY, true, true);
}

static void test_writer_refuses(void **state)
{
    char path[512];
    lf_error err;
    lf_scene *scene = make_scene(true, false);
    static const lf_scene_layout strict[] = {LF_LAYOUT_NERF_SYNTHETIC, LF_LAYOUT_LLFF,
                                             LF_LAYOUT_DEEPVOXELS};
    for (int i = 0; i < 3; i++) {
        place(state, "refused", path);
        assert_int_equal(lf_scene_write(scene, strict[i], path, &err), LF_BAD_INPUT);
        assert_non_null(strstr(err.text, "two focal lengths"));
        assert_int_equal(access(path, F_OK), -1); /* nothing half-written */
    }
    put(state, "full/file", "x");
    assert_int_equal(lf_scene_write(scene, LF_LAYOUT_TRANSFORMS, place(state, "full", path), &err),
                     LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "holds files"));
    lf_scene_close(scene);
}

static void test_cache_is_bounded(void **state)
{
    char path[512];
    const size_t one = FIXTURE_WIDTH * FIXTURE_HEIGHT * 3;
    lf_scene *scene = make_scene(false, false);
    assert_int_equal(lf_scene_write(scene, LF_LAYOUT_LLFF, place(state, "cache", path), NULL),
                     LF_OK);
    lf_scene_options options = lf_scene_defaults();
    options.cache_bytes = 3 * one;
    lf_scene *s = open_with(state, "cache", &options);
    assert_int_equal(lf_scene_bytes(s), 0);
    lf_pixels first, p;
    assert_int_equal(lf_scene_hold(s, 0, &first, NULL), LF_OK);
    const uint8_t value = first.rgb[7];
    for (int turn = 0; turn < 3; turn++)
        for (long v = 1; v < s->views; v++) {
            assert_int_equal(lf_scene_hold(s, v, &p, NULL), LF_OK);
            assert_true(lf_scene_bytes(s) <= 3 * one);
            lf_scene_release(s, v);
        }
    assert_int_equal(first.rgb[7], value); /* the held one stayed */
    for (long v = 1; v < s->views; v++)    /* all held: more than the bound */
        assert_int_equal(lf_scene_hold(s, v, &p, NULL), LF_OK);
    assert_int_equal(lf_scene_bytes(s), (size_t)s->views * one);
    for (long v = 0; v < s->views; v++)
        lf_scene_release(s, v);
    assert_true(lf_scene_bytes(s) <= 3 * one);
    lf_scene_close(s);
    lf_scene_close(scene);
}

/* Reduced by 3 of 24 x 16: 8 x 5, the last row left out; a pixel is the mean of its block, and the
 * camera sees the middle of the block there. */
static void test_reduction(void **state)
{
    char path[512];
    lf_scene *scene = make_scene(true, false);
    assert_int_equal(lf_scene_write(scene, LF_LAYOUT_TRANSFORMS, place(state, "small", path), NULL),
                     LF_OK);
    lf_scene_options options = lf_scene_defaults();
    options.factor = 3;
    lf_scene *s = open_with(state, "small", &options);
    for (long v = 0; v < s->views; v++) {
        const double point[3] = {0.1, -0.2, 0.15};
        double uv[2], small[2], depth;
        lf_pixels p, q;
        assert_true(lf_camera_project(&scene->view[v].camera, point, 0, uv, &depth));
        assert_true(lf_camera_project(&s->view[v].camera, point, 0, small, &depth));
        assert_close(3 * small[0] + 1, uv[0], 0, 1e-10);
        assert_close(3 * small[1] + 1, uv[1], 0, 1e-10);
        assert_int_equal(lf_scene_hold(scene, v, &p, NULL), LF_OK);
        assert_int_equal(lf_scene_hold(s, v, &q, NULL), LF_OK);
        assert_int_equal(q.width, 8);
        assert_int_equal(q.height, 5);
        double mean = 0;
        for (int j = 0; j < 3; j++)
            for (int i = 0; i < 3; i++)
                mean += p.rgb[3 * ((6 + j) * p.width + 3 + i) + 1] / 9.0;
        assert_close(q.rgb[3 * (2 * q.width + 1) + 1], mean, 0, 0.51);
        lf_scene_release(scene, v);
        lf_scene_release(s, v);
    }
    lf_scene_close(s);
    lf_scene_close(scene);
}

static void test_nearest(void **state)
{
    (void)state;
    lf_scene *scene = make_scene(false, false);
    const double centre[3] = {0, 0, 0};
    long all[FIXTURE_VIEWS], out[FIXTURE_VIEWS];
    lf_error err;
    for (long i = 0; i < FIXTURE_VIEWS; i++)
        all[i] = i;
    for (int nearness = 0; nearness < 2; nearness++) {
        const lf_camera *target = &scene->view[4].camera;
        assert_int_equal(lf_scene_nearest(scene, target, (lf_nearness)nearness, centre,
                                          FIXTURE_VIEWS, all, 4, 8, out, &err),
                         LF_OK);
        assert_true((out[0] == 3 && out[1] == 5) || (out[0] == 5 && out[1] == 3));
        for (int i = 0; i < 8; i++)
            assert_true(out[i] != 4);
        assert_int_equal(lf_scene_nearest(scene, target, (lf_nearness)nearness, centre,
                                          FIXTURE_VIEWS, all, -1, 1, out, &err),
                         LF_OK);
        assert_int_equal(out[0], 4);
        assert_int_equal(lf_scene_nearest(scene, target, (lf_nearness)nearness, centre,
                                          FIXTURE_VIEWS, all, 4, 9, out, &err),
                         LF_BAD_INPUT);
        assert_non_null(strstr(err.text, "9 source views are asked for, 8 are there"));
    }
    lf_scene_close(scene);
}

/* Moved with the frame, centre included, the ranking is the same. */
static void test_nearest_is_invariant(void **state)
{
    (void)state;
    lf_scene *scene = make_scene(false, false), *moved = make_scene(false, false);
    lf_stream s = lf_stream_at(3, LF_RANDOM_TEST, 0, 0);
    const lf_motion g = lf_motion_random(&s, 100);
    const double centre[3] = {0.1, 0.2, 0.3};
    double gc[3];
    long all[FIXTURE_VIEWS], a[8], b[8];
    lf_motion_apply(&g, centre, gc);
    for (long i = 0; i < FIXTURE_VIEWS; i++) {
        all[i] = i;
        moved->view[i].camera = lf_camera_move(&scene->view[i].camera, &g);
    }
    for (long t = 0; t < FIXTURE_VIEWS; t++) {
        lf_scene_nearest(scene, &scene->view[t].camera, LF_NEAR_ANGLE, centre, 9, all, t, 8, a,
                         NULL);
        lf_scene_nearest(moved, &moved->view[t].camera, LF_NEAR_ANGLE, gc, 9, all, t, 8, b, NULL);
        assert_memory_equal(a, b, sizeof a);
    }
    lf_scene_close(scene);
    lf_scene_close(moved);
}

/* Pool of 2, 4 or 6 of 8: each draw is sorted, without repetition, within its pool; over many draws
 * view number 1 of the ranking comes with probability .3 + .5 / 2 + .2 / 3. */
static void test_draw_sources(void **state)
{
    (void)state;
    lf_scene *scene = make_scene(false, false);
    const double centre[3] = {0, 0, 0}, pool[3] = {0.3, 0.5, 0.2};
    long all[FIXTURE_VIEWS], ranking[8], out[2], first = 0, beyond = 0, own = 0;
    enum { DRAWS = 20000 };
    for (long i = 0; i < FIXTURE_VIEWS; i++)
        all[i] = i;
    const lf_camera *target = &scene->view[4].camera;
    lf_scene_nearest(scene, target, LF_NEAR_ANGLE, centre, 9, all, 4, 8, ranking, NULL);
    for (uint64_t d = 0; d < DRAWS; d++) {
        lf_stream s = lf_stream_at(1, LF_RANDOM_TEST, d, 0), t = s;
        long again[2];
        assert_int_equal(lf_scene_draw_sources(scene, target, LF_NEAR_ANGLE, centre, 9, all, 4, 0.1,
                                               pool, &s, 2, out, NULL),
                         LF_OK);
        lf_scene_draw_sources(scene, target, LF_NEAR_ANGLE, centre, 9, all, 4, 0.1, pool, &t, 2,
                              again, NULL);
        assert_memory_equal(out, again, sizeof out);
        assert_true(out[0] != out[1]);
        own += out[0] == 4;
        first += out[0] == ranking[0] || out[1] == ranking[0];
        beyond += out[1] == ranking[6] || out[1] == ranking[7];
    }
    const double share = 0.3 + 0.5 / 2 + 0.2 / 3;
    assert_close((double)first / DRAWS, share, 0, 0.012);
    assert_close((double)own / DRAWS, 0.1 * share, 0, 0.007);
    assert_int_equal(beyond, 0);
    lf_scene_close(scene);
}

static void test_focus(void **state)
{
    (void)state;
    lf_scene *scene = make_scene(false, false);
    double focus[3];
    assert_true(lf_scene_focus(scene, focus));
    for (int k = 0; k < 3; k++)
        assert_close(focus[k], k == 1 ? 0 : 0.05, 0, 0.05);
    for (long v = 0; v < scene->views; v++) { /* all look the same way: no crossing */
        lf_rotation_identity(scene->view[v].camera.rotation);
        memcpy(scene->view[v].camera.centre, (double[3]){(double)v, 0, 5}, 24);
    }
    assert_false(lf_scene_focus(scene, focus));
    assert_close(focus[0], 4, 1e-12, 0);
    assert_close(focus[2], 5 + 16, 1e-12, 0);
    lf_scene_close(scene);
}

static void test_npy(void **state)
{
    char path[512];
    const long shape[3] = {2, 1, 3};
    const double value[6] = {1, -2.5, 1e300, 1e-300, 0, 3};
    lf_npy npy;
    place(state, "a.npy", path);
    assert_int_equal(lf_npy_write(path, 3, shape, value, NULL), LF_OK);
    assert_int_equal(lf_npy_read(path, &npy, NULL), LF_OK);
    assert_int_equal(npy.axes, 3);
    assert_memory_equal(npy.shape, shape, sizeof shape);
    assert_memory_equal(npy.value, value, sizeof value);
    free(npy.value);
    static const char head[] = "{'descr': '<f4', 'fortran_order': False, 'shape': (2,), }\n";
    char bytes[12 + sizeof head - 1 + 8] = "\x93NUMPY\x02\x00";
    const float two[2] = {0.5f, -8};
    bytes[8] = (char)(sizeof head - 1);
    memcpy(bytes + 12, head, sizeof head - 1);
    memcpy(bytes + 12 + sizeof head - 1, two, 8);
    put_bytes(state, "b.npy", bytes, sizeof bytes);
    assert_int_equal(lf_npy_read(place(state, "b.npy", path), &npy, NULL), LF_OK);
    assert_close(npy.value[1], -8, 0, 0);
    assert_int_equal(npy.count, 2);
    free(npy.value);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_round_trips, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_writer_refuses, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_cache_is_bounded, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_reduction, set_up, tear_down),
        cmocka_unit_test(test_nearest),
        cmocka_unit_test(test_nearest_is_invariant),
        cmocka_unit_test(test_draw_sources),
        cmocka_unit_test(test_focus),
        cmocka_unit_test_setup_teardown(test_npy, set_up, tear_down),
    };
    return cmocka_run_group_tests_name("scene", tests, NULL, NULL);
}
