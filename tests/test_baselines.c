/* test_baselines.c: closed forms of the renderers that learn nothing. */
#include <omp.h>

#include "tests/scene_fixture.h"

#include "eval/baselines.h"

enum { W = 40, H = 30, SOURCES = 4, SAMPLES = 8 };

/* A wall at depth 5 with a texture without period, and cameras that look at it along z. Its
 * inverse depth, 0.2, is the middle of stratum 4 of 8 between 0.38 and 0.06. */
typedef struct wall {
    lf_camera camera[SOURCES + 1]; /* the last is the target */
    lf_pixels pixels[SOURCES + 1];
    uint8_t rgb[SOURCES + 1][H][W][3];
} wall;

/* In steps of 1/8, where the pixels of all cameras lie. */
static uint8_t texture(double x, double y, int channel)
{
    const uint64_t i = (uint64_t)(lround(8 * x) + 1000), j = (uint64_t)(lround(8 * y) + 1000);
    lf_stream s = lf_stream_at(5, LF_RANDOM_TEST, i, j * 3 + (uint64_t)channel);
    return (uint8_t)(256 * lf_uniform(&s));
}

/* Focal length 40: a pixel is 1/8 at depth 5; sources are 0.5 or 0.25 beside, 4 or 2 pixels. */
static wall *make_wall(void)
{
    static const double beside[SOURCES + 1][2] = {{0.5, 0}, {-0.5, 0.25}, {0.25, -0.5}, {0, 0.5}};
    wall *w = calloc(1, sizeof *w);
    for (int k = 0; k <= SOURCES; k++) {
        lf_camera *c = &w->camera[k];
        *c = (lf_camera){.fx = 40, .fy = 40, .cx = 20, .cy = 15, .width = W, .height = H};
        lf_rotation_identity(c->rotation);
        memcpy(c->centre, beside[k], sizeof beside[k]);
        for (int row = 0; row < H; row++)
            for (int column = 0; column < W; column++)
                for (int i = 0; i < 3; i++)
                    w->rgb[k][row][column][i] = texture(c->centre[0] + (column - 20) / 8.0,
                                                        c->centre[1] + (row - 15) / 8.0, i);
        w->pixels[k] = (lf_pixels){W, H, &w->rgb[k][0][0][0], NULL};
    }
    return w;
}

static lf_baseline_views views_of(const wall *w)
{
    return (lf_baseline_views){.target = w->camera[SOURCES],
                               .near = 1 / 0.38,
                               .far = 1 / 0.06,
                               .samples = SAMPLES,
                               .sources = SOURCES,
                               .camera = w->camera,
                               .pixels = w->pixels,
                               .ground = 1};
}

static lf_image *render(lf_baseline kind, const lf_baseline_views *views)
{
    lf_error err = {""};
    lf_image *out = NULL;
    if (lf_baseline_render(kind, views, &out, &err) != LF_OK)
        fail_msg("%s", err.text);
    assert_true(out->width == views->target.width && out->height == views->target.height);
    return out;
}

/* The sweep finds the wall and the target's colours, where two sources see it. */
static void sweep_recovers_a_wall(void **state)
{
    (void)state;
    wall *w = make_wall();
    const lf_baseline_views views = views_of(w);
    lf_image *out = render(LF_BASELINE_SWEEP, &views);
    for (int row = 4; row < H - 4; row++)
        for (int column = 4; column < W - 4; column++)
            for (int i = 0; i < 3; i++)
                assert_close(lf_image_at(out, column, row)[i],
                             w->rgb[SOURCES][row][column][i] / 255.0, 0, 1e-6);
    lf_image_free(out);
    free(w);
}

/* The same with all cameras moved by a rigid motion, and with a turned target. */
static void frame_does_not_matter(void **state)
{
    (void)state;
    wall *w = make_wall();
    lf_baseline_views views = views_of(w);
    views.target = lf_camera_roll(&views.target, 0.3);
    for (int kind = LF_BASELINE_MEAN; kind <= LF_BASELINE_SWEEP; kind++) {
        lf_stream stream = lf_stream_at(6, LF_RANDOM_TEST, 0, (uint64_t)kind);
        const lf_motion g = lf_motion_random(&stream, 5);
        lf_baseline_views moved = views;
        lf_camera camera[SOURCES];
        for (int k = 0; k < SOURCES; k++)
            camera[k] = lf_camera_move(&w->camera[k], &g);
        moved.target = lf_camera_move(&views.target, &g);
        moved.camera = camera;
        lf_image *a = render((lf_baseline)kind, &views), *b = render((lf_baseline)kind, &moved);
        for (int i = 0; i < 3 * W * H; i++)
            assert_close(b->pixel[i], a->pixel[i], 0, 1e-6);
        lf_image_free(a);
        lf_image_free(b);
    }
    free(w);
}

/* A source that is the target: all three give it back, the copy exactly. */
static void target_as_source(void **state)
{
    (void)state;
    wall *w = make_wall();
    lf_baseline_views views = views_of(w);
    const lf_camera camera[2] = {w->camera[SOURCES], w->camera[SOURCES]};
    const lf_pixels pixels[2] = {w->pixels[SOURCES], w->pixels[SOURCES]};
    views.camera = camera;
    views.pixels = pixels;
    views.sources = 2;
    const uint8_t *truth = &w->rgb[SOURCES][0][0][0];
    for (int kind = 0; kind < LF_BASELINES; kind++) {
        lf_image *out = render((lf_baseline)kind, &views);
        for (int i = 0; i < 3 * W * H; i++)
            if (kind == LF_BASELINE_COPY)
                assert_true(out->pixel[i] == (float)truth[i] / 255);
            else
                assert_close(out->pixel[i], truth[i] / 255.0, 0, 1e-6);
        lf_image_free(out);
    }
    free(w);
}

/* One source at the same place with twice the focal length sees only the middle of the target: the
 * mean is its picture at half the size there, and so is the sweep, for want of a second one. */
static void unseen_pixels_get_the_ground(void **state)
{
    (void)state;
    wall *w = make_wall();
    lf_baseline_views views = views_of(w);
    lf_camera zoom = w->camera[SOURCES];
    zoom.fx = zoom.fy = 80;
    views.camera = &zoom;
    views.sources = 1;
    views.ground = 0.25f;
    for (int kind = LF_BASELINE_MEAN; kind <= LF_BASELINE_SWEEP; kind++) {
        lf_image *out = render((lf_baseline)kind, &views);
        for (int row = 0; row < H; row++)
            for (int column = 0; column < W; column++) {
                const int u = 20 + 2 * (column - 20), v = 15 + 2 * (row - 15);
                const bool seen = u >= 0 && v >= 0 && u < W && v < H;
                const double expected = seen ? w->rgb[0][v][u][1] / 255.0 : 0.25;
                assert_close(lf_image_at(out, column, row)[1], expected, 0, 1e-6);
            }
        lf_image_free(out);
    }
    lf_rotation_axis(1, 3.14159265358979323846, zoom.rotation); /* looks away */
    lf_image *out = render(LF_BASELINE_MEAN, &views);
    for (int i = 0; i < 3 * W * H; i++)
        assert_close(out->pixel[i], 0.25, 0, 0);
    lf_image_free(out);
    free(w);
}

/* Another size: a constant stays, and the size is the target's. */
static void copy_is_resized(void **state)
{
    (void)state;
    wall *w = make_wall();
    lf_baseline_views views = views_of(w);
    memset(w->rgb[0], 51, sizeof w->rgb[0]);
    views.target.width = 17;
    views.target.height = 50;
    lf_image *out = render(LF_BASELINE_COPY, &views);
    for (int i = 0; i < 3 * 17 * 50; i++)
        assert_close(out->pixel[i], 0.2, 1e-6, 0);
    lf_image_free(out);
    free(w);
}

static void threads_do_not_matter(void **state)
{
    (void)state;
    wall *w = make_wall();
    const lf_baseline_views views = views_of(w);
    const int before = omp_get_max_threads();
    for (int kind = 0; kind < LF_BASELINES; kind++) {
        omp_set_num_threads(1);
        lf_image *one = render((lf_baseline)kind, &views);
        omp_set_num_threads(3);
        lf_image *three = render((lf_baseline)kind, &views);
        assert_memory_equal(one->pixel, three->pixel, 3 * W * H * sizeof(float));
        lf_image_free(one);
        lf_image_free(three);
    }
    omp_set_num_threads(before);
    free(w);
}

static void bad_views_are_refused(void **state)
{
    (void)state;
    wall *w = make_wall();
    const lf_baseline_views good = views_of(w);
    lf_baseline_views bad[4] = {good, good, good, good};
    const char *words[4] = {"near 0", "0 sources", "0 samples", "the target"};
    bad[0].near = 0;
    bad[1].sources = 0;
    bad[2].samples = 0;
    bad[3].target.fx = NAN;
    for (int i = 0; i < 4; i++) {
        lf_error err = {""};
        lf_image *out = NULL;
        assert_int_equal(lf_baseline_render(LF_BASELINE_MEAN, &bad[i], &out, &err), LF_BAD_INPUT);
        assert_null(out);
        if (!strstr(err.text, words[i]))
            fail_msg("\"%s\" does not say %s", err.text, words[i]);
    }
    assert_string_equal(lf_baseline_name(LF_BASELINE_SWEEP), "sweep");
    free(w);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sweep_recovers_a_wall), cmocka_unit_test(frame_does_not_matter),
        cmocka_unit_test(target_as_source),      cmocka_unit_test(unseen_pixels_get_the_ground),
        cmocka_unit_test(copy_is_resized),       cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(bad_views_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
