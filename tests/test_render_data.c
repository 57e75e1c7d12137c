/* test_render_data.c: target rays and sources of a scene in any frame, and the batches of a
 * training. */
#include "tests/scene_fixture.h"
#include "train/render_data.h"

enum { SIZE = 24, SOURCES = 4 };

static const char *const small[] = {
    "model.type=renderer",    "data.builtin_scenes=3", "data.scene_size=24",
    "render.sources=4",       "render.samples=8",      "render.features=4",
    "render.feature_width=4", "train.rays=20",         "data.cache_mb=50"};

static lf_config *config(const char *more)
{
    lf_config *cfg;
    lf_error err = {"no message"};
    assert_int_equal(lf_config_load(NULL, &cfg, &err), LF_OK);
    for (size_t i = 0; i < sizeof small / sizeof *small; i++)
        if (lf_config_set(cfg, small[i], &err) != LF_OK)
            fail_msg("%s", err.text);
    if (more && lf_config_set(cfg, more, &err) != LF_OK)
        fail_msg("%s", err.text);
    if (lf_config_check(cfg, &err) != LF_OK)
        fail_msg("%s", err.text);
    return cfg;
}

static lf_scene_set *open_scenes(const lf_config *cfg, const char *split)
{
    lf_scene_set *set = NULL;
    lf_error err = {"no message"};
    if (lf_render_scenes(cfg, split, NULL, NULL, &set, &err) != LF_OK)
        fail_msg("%s", err.text);
    return set;
}

static lf_config *cfg;
static lf_scene_set *scenes; /* glossy, diffuse, forward */

static int open_all(void **state)
{
    cfg = config(NULL);
    scenes = open_scenes(cfg, "train");
    return set_up(state);
}

static int close_all(void **state)
{
    lf_scene_set_close(scenes);
    lf_config_free(cfg);
    return tear_down(state);
}

/* ---- a view in a frame ---- */

static lf_render_view open_view(const lf_scene_entry *e, long target, const lf_motion *motion)
{
    const lf_render_view_options o = {.sources = SOURCES, .motion = motion};
    lf_render_view v;
    lf_error err = {"no message"};
    if (lf_render_view_open(e, target, &o, &v, &err) != LF_OK)
        fail_msg("%s", err.text);
    return v;
}

static const long some_pixels[] = {0, 5, 100, 9 * SIZE + 9, 18 * SIZE - 1};
enum { PIXELS = sizeof some_pixels / sizeof *some_pixels };

/* Directions of rays in the axes of the target's camera. */
static void directions_in_camera(const lf_render_view *v, double out[PIXELS][3])
{
    lf_pixel_rays r = lf_pixel_rays_create(v, PIXELS, some_pixels);
    for (int i = 0; i < PIXELS; i++) {
        lf_rotation_apply_transposed(v->camera.rotation, r.rays.direction + 3 * i, out[i]);
        assert_close(out[i][2] * r.rays.stretch[i], 1, 1e-12, 0);
        assert_memory_equal(r.rays.origin + 3 * i, v->camera.centre, sizeof v->camera.centre);
    }
    assert_true(r.rays.near == v->near && r.rays.far == v->far);
    lf_pixel_rays_free(&r);
}

/* Where source `s` sees the point at depth z on ray i. */
static void seen_at(const lf_render_view *v, int i, double z, long s, double uv[2])
{
    lf_pixel_rays r = lf_pixel_rays_create(v, PIXELS, some_pixels);
    const double *m = v->source[s].projection;
    double q[3];
    for (int k = 0; k < 3; k++) {
        q[k] = m[4 * k + 3];
        for (int a = 0; a < 3; a++)
            q[k] += m[4 * k + a] * (r.rays.origin[3 * i + a] +
                                    z * r.rays.stretch[i] * r.rays.direction[3 * i + a]);
    }
    uv[0] = q[0] / q[2];
    uv[1] = q[1] / q[2];
    lf_pixel_rays_free(&r);
}

static void assert_same_view(const lf_render_view *a, const lf_render_view *b, double tolerance)
{
    double da[PIXELS][3], db[PIXELS][3], ua[2], ub[2];
    assert_int_equal(a->sources, SOURCES);
    assert_int_equal(b->sources, SOURCES);
    assert_memory_equal(a->source_view, b->source_view, SOURCES * sizeof(long));
    assert_true(a->near == b->near && a->far == b->far && a->bounds.radius == b->bounds.radius);
    directions_in_camera(a, da);
    directions_in_camera(b, db);
    for (int i = 0; i < PIXELS; i++) {
        for (int k = 0; k < 3; k++)
            assert_close(da[i][k], db[i][k], 0, tolerance);
        for (long s = 0; s < SOURCES; s++) {
            seen_at(a, i, 0.5 * (a->near + a->far), s, ua);
            seen_at(b, i, 0.5 * (a->near + a->far), s, ub);
            assert_close(ua[0], ub[0], 0, 100 * tolerance);
            assert_close(ua[1], ub[1], 0, 100 * tolerance);
            assert_true(a->source[s].rgb == b->source[s].rgb);
        }
    }
}

static void a_moved_frame_shows_the_same(void **state)
{
    (void)state;
    static const double far[] = {0, 1, 1e3, 1e5};
    for (long i = 0; i < scenes->count; i++) {
        const lf_scene_entry *e = &scenes->entry[i];
        const long target = e->view[LF_SPLIT_TEST][1];
        lf_render_view still = open_view(e, target, NULL);
        for (int k = 0; k < 8; k++) {
            lf_stream r = lf_stream_at(3, LF_RANDOM_GROUP, 2, (uint64_t)k);
            const lf_motion g = lf_motion_random(&r, far[k % 4]);
            lf_render_view moved = open_view(e, target, &g);
            assert_same_view(&still, &moved, far[k % 4] > 1e3 ? 1e-9 : 1e-11);
            /* near the origin again: float features of it are as good as at home */
            assert_true(fabs(moved.camera.centre[0]) < 20);
            assert_true(moved.pixels.rgb == still.pixels.rgb);
            lf_render_view_release(&moved);
        }
        lf_render_view_release(&still);
    }
}

/* The projection is the camera's; rays run through the pixels' centres. */
static void sources_project_as_their_cameras(void **state)
{
    (void)state;
    const lf_scene_entry *e = &scenes->entry[2];
    lf_render_view v = open_view(e, e->view[LF_SPLIT_TEST][0], NULL);
    for (int i = 0; i < PIXELS; i++)
        for (long s = 0; s < SOURCES; s++) {
            double uv[2], expected[2], depth, p[3], d[3];
            const lf_camera *c = &e->scene->view[v.target].camera;
            lf_camera_ray(c, (double)(some_pixels[i] % c->width),
                          (double)(some_pixels[i] / c->width), d);
            const double z = d[0] * c->rotation[2] + d[1] * c->rotation[5] + d[2] * c->rotation[8];
            for (int a = 0; a < 3; a++)
                p[a] = c->centre[a] + 4 / z * d[a];
            seen_at(&v, i, 4, s, uv);
            assert_true(lf_camera_project(&e->scene->view[v.source_view[s]].camera, p, 1e-3,
                                          expected, &depth));
            assert_close(uv[0], expected[0], 0, 1e-9);
            assert_close(uv[1], expected[1], 0, 1e-9);
        }
    lf_render_view_release(&v);
}

/* A rendering in floats, 1e5 units from the origin. */
static void far_from_the_origin_renders_the_same(void **state)
{
    (void)state;
    const lf_renderer_config config = lf_renderer_config_from(cfg);
    lf_store *store = lf_store_create(3);
    lf_renderer model;
    lf_renderer_init(&model, store, &config);
    lf_render_work *work = lf_render_work_create(&model, 4);
    const lf_motion away = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {6e4, -5e4, 6e4}};
    const lf_scene_entry *e = &scenes->entry[0];
    float number[2][PIXELS * 5];
    for (int far = 0; far < 2; far++) {
        lf_render_view v = open_view(e, e->view[LF_SPLIT_TEST][0], far ? &away : NULL);
        lf_pixel_rays r = lf_pixel_rays_create(&v, PIXELS, some_pixels);
        lf_ray_image x = {number[far], number[far] + 3 * PIXELS, number[far] + 4 * PIXELS, 0};
        const lf_render_savings none = lf_render_savings_none();
        lf_render_encode(work, v.sources, v.source);
        lf_render_rays(work, &r.rays, e->white, &none, &x);
        lf_pixel_rays_free(&r);
        lf_render_view_release(&v);
    }
    for (int i = 0; i < 5 * PIXELS; i++)
        assert_close(number[1][i], number[0][i], 1e-4, 1e-4);
    lf_render_work_free(work);
    lf_renderer_free(&model);
    lf_store_free(store);
}

/* ---- hard scenes ---- */

/* A forward-facing scene of 16 views in root/name as LLFF, near 0 in its file. */
static void put_near_0(void **state, const char *name)
{
    char path[512];
    lf_scene_make_options o = lf_scene_make_defaults();
    lf_scene *scene = NULL;
    o.kind = LF_KIND_FORWARD;
    o.size = SIZE;
    o.rays = 1;
    o.train_views = 16;
    o.test_views = 0;
    assert_int_equal(lf_scene_make(&o, &scene, NULL), LF_OK);
    for (long v = 0; v < scene->views; v++)
        scene->view[v].near = 0;
    assert_int_equal(lf_scene_write(scene, LF_LAYOUT_LLFF, place(state, name, path), NULL), LF_OK);
    lf_scene_close(scene);
}

static void a_scene_with_near_0_is_rendered(void **state)
{
    char set[600];
    put_near_0(state, "near0");
    snprintf(set, sizeof set, "data.scenes=%s/near0", (char *)*state);
    lf_config *other = config(set);
    assert_int_equal(lf_config_set(other, "data.builtin_scenes=0", NULL), LF_OK);
    lf_scene_set *zero = open_scenes(other, "train");
    const lf_scene_entry *e = &zero->entry[0];
    assert_true(e->scene->view[0].near == 0 && e->near_raised);
    assert_true(e->near > 0 && e->near < e->far);
    const lf_renderer_config c = lf_renderer_config_from(other);
    lf_store *store = lf_store_create(3);
    lf_renderer model;
    lf_renderer_init(&model, store, &c);
    lf_render_work *work = lf_render_work_create(&model, 4);
    lf_render_view v = open_view(e, e->view[LF_SPLIT_TEST][0], NULL);
    lf_pixel_rays r = lf_pixel_rays_create(&v, PIXELS, some_pixels);
    float number[PIXELS * 5];
    lf_ray_image x = {number, number + 3 * PIXELS, number + 4 * PIXELS, 0};
    const lf_render_savings none = lf_render_savings_none();
    lf_render_encode(work, v.sources, v.source);
    lf_render_rays(work, &r.rays, e->white, &none, &x);
    for (int i = 0; i < 5 * PIXELS; i++)
        assert_true(isfinite(number[i]));
    for (int i = 0; i < PIXELS; i++)
        assert_true((double)x.depth[i] > v.near * 0.99999 && (double)x.depth[i] < v.far * 1.00001);
    lf_pixel_rays_free(&r);
    lf_render_view_release(&v);
    lf_render_work_free(work);
    lf_renderer_free(&model);
    lf_store_free(store);
    lf_scene_set_close(zero);
    lf_config_free(other);
}

static void the_target_is_no_source_of_itself(void **state)
{
    (void)state;
    for (long i = 0; i < scenes->count; i++) {
        const lf_scene_entry *e = &scenes->entry[i];
        for (int draws = 0; draws < 20; draws++) {
            lf_stream r = lf_stream_at(3, LF_RANDOM_TEST, 8, (uint64_t)draws);
            const lf_render_view_options o = {
                .sources = SOURCES, .draw = draws ? &r : NULL, .pool = {0.4, 0.4, 0.2}};
            const long target = e->view[LF_SPLIT_TRAIN][draws % e->count[LF_SPLIT_TRAIN]];
            lf_render_view v;
            assert_int_equal(lf_render_view_open(e, target, &o, &v, NULL), LF_OK);
            for (long s = 0; s < SOURCES; s++) {
                assert_true(v.source_view[s] != target);
                assert_int_equal(e->scene->view[v.source_view[s]].split, LF_SPLIT_TRAIN);
                for (long t = 0; t < s; t++)
                    assert_true(v.source_view[s] != v.source_view[t]);
            }
            lf_render_view_release(&v);
        }
    }
}

/* A camera that is no view: the same sources and rays as the view at its place. */
static void any_camera_can_be_a_target(void **state)
{
    (void)state;
    const lf_scene_entry *e = &scenes->entry[1];
    const long target = e->view[LF_SPLIT_TEST][2];
    const lf_render_view_options o = {.sources = SOURCES};
    lf_render_view a = open_view(e, target, NULL), b;
    const lf_camera *camera = &e->scene->view[target].camera;
    assert_int_equal(lf_render_camera_open(e, camera, &o, &b, NULL), LF_OK);
    assert_same_view(&a, &b, 0);
    assert_true(b.target == -1 && b.pixels.rgb == NULL && a.pixels.rgb != NULL);
    lf_render_view_release(&a);
    lf_render_view_release(&b);
}

static void more_sources_than_views(void **state)
{
    (void)state;
    const lf_render_view_options o = {.sources = 35}; /* of 35 training views, one the target */
    const lf_scene_entry *e = &scenes->entry[0];
    lf_render_view v;
    lf_error err = {""};
    assert_int_equal(lf_render_view_open(e, e->view[LF_SPLIT_TRAIN][0], &o, &v, &err),
                     LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "render.sources = 35"));
    assert_int_equal(lf_render_view_open(e, e->view[LF_SPLIT_TEST][0], &o, &v, &err), LF_OK);
    lf_render_view_release(&v);
}

/* ---- splits ---- */

static void splits_of_a_config(void **state)
{
    (void)state;
    lf_scene_set *set = open_scenes(cfg, "val");
    assert_null(set);
    set = open_scenes(cfg, "test");
    assert_null(set);
    lf_config *other = config("data.test_builtin=2");
    set = open_scenes(other, "test");
    assert_int_equal(set->count, 2);
    assert_string_equal(set->entry[0].name, "built-in 1000000"); /* none that is trained on */
    long count;
    const long *target = lf_render_targets(&set->entry[0], "test", &count);
    assert_true(count == 5 && target == set->entry[0].view[LF_SPLIT_TEST]);
    target = lf_render_targets(&set->entry[0], "val", &count); /* there is no such view */
    assert_true(count == 35 && target == set->entry[0].view[LF_SPLIT_TRAIN]);
    assert_string_equal(lf_render_split(&set->entry[0], "val"), "train");
    assert_string_equal(lf_render_split(&set->entry[0], "test"), "test");
    assert_string_equal(lf_render_split_name("test", 5, 0), "test");
    assert_string_equal(lf_render_split_name("test", 5, 2), "test, train");
    assert_string_equal(lf_render_split_name("val", 5, 5), "train");
    assert_string_equal(lf_render_split_name("train", 5, 5), "train");
    lf_scene_set_close(set);
    lf_config_free(other);
}

/* What built-in scenes take is known before they are made. */
static void built_in_scenes_fit_the_cache(void **state)
{
    (void)state;
    static const char *const kinds[] = {"data.kinds=all", "data.kinds=objects",
                                        "data.kinds=forward"};
    for (int k = 0; k < 3; k++) {
        const lf_scene_set_options o = {
            .builtin = 3,
            .kinds = k == 0   ? LF_KINDS_ALL
                     : k == 1 ? LF_KINDS_OBJECTS
                              : LF_KINDS_FORWARD,
            .size = 24,
        };
        lf_config *other = config(kinds[k]);
        lf_scene_set *set = open_scenes(other, "train");
        double bytes = 0;
        for (long i = 0; i < set->count; i++)
            bytes += (double)lf_scene_bytes(set->entry[i].scene);
        assert_true(bytes == lf_scene_set_builtin_bytes(&o));
        lf_scene_set_close(set);
        lf_config_free(other);
    }
    lf_config *much = config("data.builtin_scenes=5000");
    lf_scene_set *set = NULL;
    lf_error err = {""};
    assert_int_equal(lf_render_scenes(much, "train", NULL, NULL, &set, &err), LF_BAD_INPUT);
    assert_null(set);
    assert_non_null(strstr(err.text, "data.builtin_scenes = 5000"));
    assert_non_null(strstr(err.text, "data.cache_mb = 50"));
    lf_config_free(much);
}

/* ---- batches ---- */

/* What a step reads, but for its pictures. */
typedef struct seen_batch {
    float colour[20 * 3];
    double direction[20 * 3], origin[20 * 3], projection[SOURCES * 12];
    double near, far;
    bool white;
} seen_batch;

static seen_batch look(const lf_render_batch *b)
{
    seen_batch s = {.near = b->rays.near, .far = b->rays.far, .white = b->white};
    assert_true(b->rays.count == 20 && b->views == SOURCES);
    memcpy(s.colour, b->colour, sizeof s.colour);
    memcpy(s.direction, b->rays.direction, sizeof s.direction);
    memcpy(s.origin, b->rays.origin, sizeof s.origin);
    for (int v = 0; v < SOURCES; v++)
        memcpy(s.projection + 12 * v, b->source[v].projection, 12 * sizeof(double));
    return s;
}

static bool same_batch(const seen_batch *a, const seen_batch *b)
{
    return !memcmp(a->colour, b->colour, sizeof a->colour) &&
           !memcmp(a->direction, b->direction, sizeof a->direction) &&
           !memcmp(a->origin, b->origin, sizeof a->origin) &&
           !memcmp(a->projection, b->projection, sizeof a->projection) && a->near == b->near &&
           a->far == b->far && a->white == b->white;
}

static seen_batch batch_at(lf_render_batches *b, long step)
{
    lf_render_batch out;
    lf_error err = {"no message"};
    if (lf_render_batches_at(b, step, &out, &err) != LF_OK)
        fail_msg("%s", err.text);
    assert_int_equal(out.step, step);
    return look(&out);
}

static void a_batch_is_a_function_of_seed_and_step(void **state)
{
    (void)state;
    enum { STEPS = 16 };
    static seen_batch first[STEPS];
    lf_render_batches *a, *b, *c;
    lf_config *other = config("train.seed=1");
    assert_int_equal(lf_render_batches_create(cfg, scenes, &a, NULL), LF_OK);
    assert_int_equal(lf_render_batches_create(cfg, scenes, &b, NULL), LF_OK);
    assert_int_equal(lf_render_batches_create(other, scenes, &c, NULL), LF_OK);
    for (long s = 0; s < STEPS; s++)
        first[s] = batch_at(a, s);
    for (long s = STEPS - 1; s >= 0; s -= 3) { /* backwards, with gaps */
        const seen_batch x = batch_at(a, s), y = batch_at(b, s), z = batch_at(c, s);
        assert_true(same_batch(&x, &first[s]) && same_batch(&y, &first[s]));
        assert_false(same_batch(&z, &first[s]));
        assert_true(s == 0 || !same_batch(&first[s], &first[s - 1]));
    }
    lf_render_batches_free(a);
    lf_render_batches_free(b);
    lf_render_batches_free(c);
    lf_config_free(other);
}

/* Share of pure white pixels on white ground. */
static double white_share(const char *set)
{
    lf_config *other = config(set);
    lf_render_batches *b;
    assert_int_equal(lf_render_batches_create(other, scenes, &b, NULL), LF_OK);
    long white = 0, all = 0;
    for (long s = 0; s < 60; s++) {
        const seen_batch x = batch_at(b, s);
        for (int i = 0; i < 20 && x.white; i++, all++)
            white += x.colour[3 * i] == 1 && x.colour[3 * i + 1] == 1 && x.colour[3 * i + 2] == 1;
    }
    lf_render_batches_free(b);
    lf_config_free(other);
    assert_true(all > 200);
    return (double)white / (double)all;
}

static void white_pixels_come_last(void **state)
{
    (void)state;
    const double none = white_share("train.white_share=0"),
                 most = white_share("train.white_share=1");
    assert_true(none > 0.5);
    assert_true(1 - most > 2 * (1 - none)); /* four times as many are drawn as are used */
}

static void colours_are_those_of_the_pixels(void **state)
{
    (void)state;
    lf_render_batches *b;
    lf_render_batch batch;
    assert_int_equal(lf_render_batches_create(cfg, scenes, &b, NULL), LF_OK);
    for (long step = 0; step < 6; step++) {
        assert_int_equal(lf_render_batches_at(b, step, &batch, NULL), LF_OK);
        for (int i = 0; i < 3 * batch.rays.count; i++) {
            const double byte = 255 * (double)batch.colour[i];
            assert_close(byte, round(byte), 0, 1e-4);
            assert_true(byte >= 0 && byte <= 255);
        }
    }
    lf_render_batches_free(b);
}

static void sources_that_are_not_there(void **state)
{
    (void)state;
    lf_config *other = config("render.sources=35");
    lf_render_batches *b = NULL;
    lf_error err = {""};
    assert_int_equal(lf_render_batches_create(other, scenes, &b, &err), LF_BAD_INPUT);
    assert_null(b);
    assert_non_null(strstr(err.text, "render.sources = 35"));
    lf_config_free(other);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_moved_frame_shows_the_same),
        cmocka_unit_test(sources_project_as_their_cameras),
        cmocka_unit_test(far_from_the_origin_renders_the_same),
        cmocka_unit_test(a_scene_with_near_0_is_rendered),
        cmocka_unit_test(the_target_is_no_source_of_itself),
        cmocka_unit_test(any_camera_can_be_a_target),
        cmocka_unit_test(more_sources_than_views),
        cmocka_unit_test(splits_of_a_config),
        cmocka_unit_test(built_in_scenes_fit_the_cache),
        cmocka_unit_test(a_batch_is_a_function_of_seed_and_step),
        cmocka_unit_test(white_pixels_come_last),
        cmocka_unit_test(colours_are_those_of_the_pixels),
        cmocka_unit_test(sources_that_are_not_there),
    };
    return cmocka_run_group_tests(tests, open_all, close_all);
}
