/* test_scene_set.c: what rendering knows of a scene: how its cameras stand, its ground, bounds and
 * depths, its views; lists of folders and numbers of built-in scenes; messages. */
#include <limits.h>

#include "datasets/scene_bounds.h"
#include "datasets/scene_make_internal.h"
#include "datasets/scene_set.h"
#include "tests/scene_fixture.h"

enum { SIZE = 32 };

static lf_scene_set_options usual(void)
{
    return (lf_scene_set_options){.hold_out = 8,
                                  .outlines = true,
                                  .near_factor = 0.9,
                                  .far_factor = 1.2,
                                  .nearness = -1,
                                  .white = -1,
                                  .cache_bytes = 10000000,
                                  .size = SIZE,
                                  .highlight = 1};
}

static lf_scene_set *open_set(const lf_scene_set_options *o)
{
    lf_scene_set *set = NULL;
    lf_error err = {"no message"};
    if (lf_scene_set_open(o, NULL, NULL, &set, &err) != LF_OK)
        fail_msg("%s", err.text);
    return set;
}

static void expect_refused(const lf_scene_set_options *o, const char *words)
{
    lf_scene_set *set = NULL;
    lf_error err = {"no message"};
    assert_int_equal(lf_scene_set_open(o, NULL, NULL, &set, &err), LF_BAD_INPUT);
    assert_null(set);
    if (!strstr(err.text, words))
        fail_msg("'%s' does not say '%s'", err.text, words);
}

/* ---- built-in scenes ---- */

static lf_scene_set *open_kind(lf_scene_kinds kinds, long count, long first)
{
    lf_scene_set_options o = usual();
    o.builtin = count;
    o.kinds = kinds;
    o.first = first;
    return open_set(&o);
}

static void objects_are_surrounded_on_white(void **state)
{
    (void)state;
    lf_scene_set *set = open_kind(LF_KINDS_OBJECTS, 2, 0);
    for (long i = 0; i < set->count; i++) {
        const lf_scene_entry *e = &set->entry[i];
        assert_true(e->builtin && e->white && e->nearness == LF_NEAR_ANGLE && !e->near_raised);
        assert_int_equal(e->count[LF_SPLIT_TRAIN], 35);
        assert_int_equal(e->count[LF_SPLIT_VAL], 0);
        assert_int_equal(e->count[LF_SPLIT_TEST], 5);
        for (int s = 0; s < LF_SPLITS; s++)
            for (long v = 0; v < e->count[s]; v++)
                assert_int_equal(e->scene->view[e->view[s][v]].split, s);
        /* half a diagonal of 1.9 to 2.5, and what the pictures are too coarse to rule out */
        assert_true(e->radius > 0.6 && e->radius < 1.8);
        for (int a = 0; a < 3; a++)
            assert_true(fabs(e->centre[a]) < 0.3);
    }
    lf_scene_set_close(set);
}

static void rooms_are_before_the_cameras(void **state)
{
    (void)state;
    lf_scene_set *set = open_kind(LF_KINDS_FORWARD, 2, 0);
    for (long i = 0; i < set->count; i++) {
        const lf_scene_entry *e = &set->entry[i];
        assert_true(e->nearness == LF_NEAR_DISTANCE && !e->white && e->radius == 0);
        assert_true(e->near > 0 && e->near < e->far);
    }
    lf_scene_set_close(set);
}

/* The ray of every pixel that is not ground meets the ball. */
static void bounds_enclose_the_outlines(void **state)
{
    (void)state;
    lf_scene_set *set = open_kind(LF_KINDS_OBJECTS, 4, 0);
    for (long i = 0; i < set->count; i++) {
        const lf_scene_entry *e = &set->entry[i];
        long covered = 0;
        for (long v = 0; v < e->scene->views; v++) {
            const lf_camera *c = &e->scene->view[v].camera;
            lf_pixels p;
            assert_int_equal(lf_scene_hold(e->scene, v, &p, NULL), LF_OK);
            for (long k = 0; k < (long)SIZE * SIZE; k++) {
                double d[3], along = 0, size = 0;
                if (p.alpha[k] == 0)
                    continue;
                covered++;
                lf_camera_ray(c, (double)(k % SIZE), (double)(k / SIZE), d);
                for (int a = 0; a < 3; a++) {
                    along += d[a] * (e->centre[a] - c->centre[a]);
                    size += (e->centre[a] - c->centre[a]) * (e->centre[a] - c->centre[a]);
                }
                assert_true(sqrt(fmax(0, size - along * along)) <= e->radius);
            }
            lf_scene_release(e->scene, v);
        }
        assert_true(covered > 1000);
    }
    lf_scene_set_close(set);
}

enum { WIDE = 600, WIDE_VIEWS = 6 };

static double apart(const double a[3], const double b[3])
{
    return hypot(hypot(a[0] - b[0], a[1] - b[1]), a[2] - b[2]);
}

/* Cameras on the axes, with a lens of 2 x 76 degrees, see two dots on white, each of
 * one pixel. */
static lf_scene *wide_scene(double (*dot)[3])
{
    static uint8_t rgb[WIDE * WIDE * 3], alpha[WIDE * WIDE];
    lf_scene *scene = lf_scene_create("wide");
    memset(rgb, 255, sizeof rgb);
    for (int v = 0; v < WIDE_VIEWS; v++) {
        double centre[3] = {v / 2 == 0 ? 4 : 0, v / 2 == 1 ? 4 : 0, v / 2 == 2 ? 4 : 0};
        const double target[3] = {0, 0, 0};
        if (v % 2)
            for (int i = 0; i < 3; i++)
                centre[i] = -centre[i];
        lf_camera c = lf_camera_look_at(centre, target, 0.3, WIDE);
        c.fx = c.fy = 0.125 * WIDE;
        memset(alpha, 0, sizeof alpha);
        for (int d = 0; d < 2; d++) {
            double uv[2], depth;
            if (lf_camera_project(&c, dot[d], 0.1, uv, &depth) &&
                fabs(uv[0] - c.cx) < WIDE / 2 - 1 && fabs(uv[1] - c.cy) < WIDE / 2 - 1)
                alpha[lround(uv[1]) * WIDE + lround(uv[0])] = 255;
        }
        char name[8];
        snprintf(name, sizeof name, "%d", v);
        lf_scene_add(scene, name, &c, 1, 9, LF_SPLIT_TRAIN, rgb, alpha);
    }
    return scene;
}

/* Cells whose balls hold a dot are kept, so the bounds have them inside. */
static void check_bounds(double (*dot)[3])
{
    const double edge = 1.4 * 4 / 48, ball = 0.8661 * edge; /* of the grid in scene_bounds.c */
    long views[WIDE_VIEWS] = {0, 1, 2, 3, 4, 5}, held = 0;
    lf_scene_entry e = {.scene = wide_scene(dot)};
    e.count[LF_SPLIT_TRAIN] = WIDE_VIEWS;
    e.view[LF_SPLIT_TRAIN] = views;
    assert_int_equal(lf_entry_find_bounds(&e, NULL), LF_OK);
    for (long c = 0; c < 48L * 48 * 48; c++) {
        const long at[3] = {c / 48 / 48, c / 48 % 48, c % 48};
        double p[3];
        for (int a = 0; a < 3; a++)
            p[a] = ((double)at[a] - 23.5) * edge;
        if (apart(p, dot[0]) > 0.999 * ball && apart(p, dot[1]) > 0.999 * ball)
            continue;
        held++;
        assert_true(apart(p, e.centre) <= e.radius - ball + 1e-9);
    }
    assert_true(held > 2);
    lf_scene_close(e.scene);
}

/* The ball round a cell reaches further off the axis of a wide lens: without that, cells of each of
 * these dots would be lost. */
static void bounds_of_a_wide_lens(void **state)
{
    (void)state;
    for (uint64_t k = 7; k < 10; k++) {
        double dot[2][3];
        lf_stream s = lf_stream_at(5, LF_RANDOM_TEST, 4, k);
        for (int i = 0; i < 3; i++) {
            dot[0][i] = 2.4 + 0.3 * lf_uniform(&s); /* in a corner, 70 degrees off three axes */
            dot[1][i] = 0.8 * dot[0][i];
        }
        check_bounds(dot);
    }
}

/* Depths of what the cameras see lie between near and far, for cameras of all splits. */
static void depths_enclose_what_is_seen(void **state)
{
    (void)state;
    static float depth[SIZE * SIZE];
    lf_scene_set *set = open_kind(LF_KINDS_ALL, 6, 0);
    for (long i = 0; i < set->count; i++) {
        const lf_scene_entry *e = &set->entry[i];
        lf_scene_make_options o = lf_scene_make_defaults();
        o.kind = (lf_scene_kind)(i % 3);
        o.index = (uint64_t)i;
        o.size = SIZE;
        lf_world *world = NULL;
        assert_int_equal(lf_world_make(&o, &world, NULL), LF_OK);
        long met = 0;
        for (long v = 0; v < e->scene->views; v++) {
            const lf_camera *c = &e->scene->view[v].camera;
            double near, far;
            lf_scene_depths_of(e, c, &near, &far);
            assert_true(near > 0 && near < far);
            lf_render_depth(world->surface, c, depth);
            for (long k = 0; k < (long)c->width * c->height; k++) {
                assert_true(isinf(depth[k]) || ((double)depth[k] > near && (double)depth[k] < far));
                met += !isinf(depth[k]);
            }
        }
        assert_true(met > 1000);
        lf_world_free(world);
    }
    lf_scene_set_close(set);
}

/* A camera within the ball takes what the views say. */
static void a_camera_inside_the_bounds(void **state)
{
    (void)state;
    lf_scene_set *set = open_kind(LF_KINDS_GLOSSY, 1, 0);
    const lf_scene_entry *e = &set->entry[0];
    lf_camera c = e->scene->view[0].camera;
    double near, far;
    lf_scene_depths_of(e, &c, &near, &far);
    assert_close(far - near, 2 * e->radius, 1e-12, 0);
    for (int a = 0; a < 3; a++)
        c.centre[a] = e->centre[a] + 0.1;
    lf_scene_depths_of(e, &c, &near, &far);
    assert_true(near == e->near && far == e->far);
    lf_scene_set_close(set);
}

static void assert_same_pictures(const lf_scene_entry *a, const lf_scene_entry *b, bool same)
{
    lf_pixels p, q;
    assert_int_equal(lf_scene_hold(a->scene, 3, &p, NULL), LF_OK);
    assert_int_equal(lf_scene_hold(b->scene, 3, &q, NULL), LF_OK);
    assert_int_equal(p.width, q.width);
    assert_int_equal(memcmp(p.rgb, q.rgb, (size_t)p.width * (size_t)p.height * 3) == 0, same);
    lf_scene_release(a->scene, 3);
    lf_scene_release(b->scene, 3);
}

/* Number n is the same scene wherever the list begins. */
static void numbers_name_built_in_scenes(void **state)
{
    (void)state;
    lf_scene_set *four = open_kind(LF_KINDS_ALL, 4, 0), *last = open_kind(LF_KINDS_ALL, 2, 3);
    assert_string_equal(four->entry[3].name, "built-in 3");
    assert_string_equal(last->entry[0].name, "built-in 3");
    assert_string_equal(last->entry[1].name, "built-in 4");
    assert_same_pictures(&four->entry[3], &last->entry[0], true);
    assert_same_pictures(&four->entry[0], &four->entry[3], false); /* both glossy */
    assert_same_pictures(&four->entry[3], &last->entry[1], false);
    assert_true(four->entry[2].nearness == LF_NEAR_DISTANCE); /* the third is a room */
    lf_scene_set_close(four);
    lf_scene_set_close(last);
}

static void options_overrule_what_is_found(void **state)
{
    (void)state;
    lf_scene_set_options o = usual();
    o.builtin = 1;
    o.white = 0;
    o.nearness = LF_NEAR_DISTANCE;
    lf_scene_set *set = open_set(&o);
    assert_true(!set->entry[0].white && set->entry[0].nearness == LF_NEAR_DISTANCE);
    assert_true(set->entry[0].radius == 0); /* outlines want white ground */
    lf_scene_set_close(set);
    o = usual();
    o.builtin = 1;
    o.outlines = false;
    set = open_set(&o);
    assert_true(set->entry[0].white && set->entry[0].radius == 0);
    double near, far;
    lf_scene_depths_of(&set->entry[0], &set->entry[0].scene->view[0].camera, &near, &far);
    assert_true(near == set->entry[0].near && far == set->entry[0].far);
    lf_scene_set_close(set);
}

/* ---- folders ---- */

/* A built-in scene written to root/name as LLFF (no split). */
static void put_scene(void **state, const char *name, long views, int kind)
{
    char path[512];
    lf_error err = {"no message"};
    lf_scene_make_options o = lf_scene_make_defaults();
    lf_scene *scene = NULL;
    o.kind = (lf_scene_kind)kind;
    o.size = SIZE;
    o.rays = 1;
    o.train_views = views;
    o.test_views = 0;
    assert_int_equal(lf_scene_make(&o, &scene, &err), LF_OK);
    if (lf_scene_write(scene, LF_LAYOUT_LLFF, place(state, name, path), &err) != LF_OK)
        fail_msg("%s", err.text);
    lf_scene_close(scene);
}

static int set_up_scenes(void **state)
{
    if (set_up(state))
        return -1;
    put_scene(state, "all/b", 10, LF_KIND_GLOSSY);
    put_scene(state, "all/a", 10, LF_KIND_FORWARD);
    put_scene(state, "alone", 9, LF_KIND_DIFFUSE);
    put_scene(state, "two", 2, LF_KIND_DIFFUSE);
    put(state, "notes/readme.txt", "no scene");
    return 0;
}

static bool ends_with(const char *text, const char *end)
{
    return strlen(text) >= strlen(end) && !strcmp(text + strlen(text) - strlen(end), end);
}

static void count_up(void *context, long done, long total)
{
    long *seen = context;
    assert_int_equal(done, seen[0] + 1);
    seen[0] = done;
    seen[1] = total;
}

/* A folder of scenes stands for all of them, by name; built-in ones come last. */
static void lists_of_folders(void **state)
{
    lf_scene_set_options o = usual();
    lf_scene_set *set = NULL;
    lf_error err = {"no message"};
    long progress[2] = {0, 0};
    o.root = *state;
    o.scenes = " alone ,all,";
    o.builtin = 1;
    if (lf_scene_set_open(&o, count_up, progress, &set, &err) != LF_OK)
        fail_msg("%s", err.text);
    static const char *const names[] = {"/alone", "/all/a", "/all/b", "built-in 0"};
    assert_int_equal(set->count, 4);
    assert_true(progress[0] == 4 && progress[1] == 4);
    for (int i = 0; i < 4; i++) {
        assert_true(ends_with(set->entry[i].name, names[i]));
        assert_int_equal(set->entry[i].builtin, i == 3);
    }
    assert_int_equal(set->entry[0].count[LF_SPLIT_TRAIN], 7); /* 0 and 8 of 9 are held out */
    assert_int_equal(set->entry[0].count[LF_SPLIT_TEST], 2);
    assert_true(set->entry[1].nearness == LF_NEAR_DISTANCE && !set->entry[1].white);
    assert_true(set->entry[2].nearness == LF_NEAR_ANGLE && set->entry[2].white);
    lf_scene_set_close(set);
}

static void absolute_paths_need_no_root(void **state)
{
    char path[512];
    lf_scene_set_options o = usual();
    o.root = "/nowhere";
    o.scenes = place(state, "alone", path);
    lf_scene_set *set = open_set(&o);
    assert_int_equal(set->count, 1);
    lf_scene_set_close(set);
}

static void depths_of_files_are_widened(void **state)
{
    lf_scene_set_options o = usual();
    o.root = *state;
    o.scenes = "all/a";
    o.near_factor = o.far_factor = 1;
    lf_scene_set *plain = open_set(&o);
    o.near_factor = 0.5;
    o.far_factor = 2;
    lf_scene_set *wide = open_set(&o);
    assert_close(wide->entry[0].near, 0.5 * plain->entry[0].near, 1e-12, 0);
    assert_close(wide->entry[0].far, 2 * plain->entry[0].far, 1e-12, 0);
    o.near_factor = 1e-9;
    lf_scene_set *raised = open_set(&o);
    assert_true(raised->entry[0].near_raised && !wide->entry[0].near_raised);
    assert_close(raised->entry[0].near, 1e-3 * raised->entry[0].far, 1e-12, 0);
    lf_scene_set_close(plain);
    lf_scene_set_close(wide);
    lf_scene_set_close(raised);
}

static void pictures_are_reduced(void **state)
{
    static const int cases[][3] = {{0, 0, 32},  {32, 0, 32}, {31, 0, 16}, {16, 0, 16},
                                   {15, 0, 10}, {8, 0, 8},   {0, 4, 8},   {31, 4, 8}};
    for (int i = 0; i < 8; i++) {
        lf_scene_set_options o = usual();
        o.root = *state;
        o.scenes = "alone";
        o.longest = cases[i][0];
        o.factor = cases[i][1];
        lf_scene_set *set = open_set(&o);
        lf_pixels p;
        const lf_scene *scene = set->entry[0].scene;
        assert_int_equal(scene->view[1].camera.width, cases[i][2]);
        assert_int_equal(lf_scene_hold(scene, 1, &p, NULL), LF_OK);
        assert_int_equal(p.width, cases[i][2]);
        lf_scene_release(scene, 1);
        lf_scene_set_close(set);
    }
}

/* An alpha of 255 everywhere is none: the ground is what the colours say. */
static void opaque_alpha_says_nothing(void **state)
{
    for (int clear = 0; clear < 2; clear++) {
        static uint8_t rgb[16 * 16 * 3], alpha[16 * 16];
        lf_scene *scene = lf_scene_create("dark");
        memset(rgb, 40, sizeof rgb);
        memset(alpha, 255, sizeof alpha);
        if (clear) { /* one pixel, far from the rim */
            alpha[8 * 16 + 8] = 0;
            memset(rgb + 3 * (8 * 16 + 8), 255, 3);
        }
        for (int v = 0; v < 4; v++) {
            const double centre[3] = {3 * cos(v), 0, 3 * sin(v)}, target[3] = {0, 0, 0};
            const lf_camera c = lf_camera_look_at(centre, target, 0.3, 16);
            char name[8];
            snprintf(name, sizeof name, "%d", v);
            lf_scene_add(scene, name, &c, 1, 2, LF_SPLIT_TRAIN, rgb, alpha);
        }
        char path[512];
        place(state, clear ? "clear" : "dark", path);
        assert_int_equal(lf_scene_write(scene, LF_LAYOUT_NERF_SYNTHETIC, path, NULL), LF_OK);
        lf_scene_close(scene);
        lf_scene_set_options o = usual();
        o.scenes = path;
        lf_scene_set *set = open_set(&o);
        assert_int_equal(set->entry[0].white, clear);
        lf_scene_set_close(set);
    }
}

/* ---- what goes wrong ---- */

static void reduced_too_much(void **state)
{
    lf_scene *scene = lf_scene_create("wide");
    static uint8_t rgb[130 * 2 * 3];
    for (int v = 0; v < 4; v++) {
        const double centre[3] = {cos(v), 0, sin(v)}, target[3] = {0, 0, 0};
        lf_camera c = lf_camera_look_at(centre, target, 0.3, 2);
        c.width = 130;
        c.cx = 64.5;
        char name[8];
        snprintf(name, sizeof name, "%d", v);
        lf_scene_add(scene, name, &c, 1, 2, LF_SPLIT_TRAIN, rgb, NULL);
    }
    char path[512];
    assert_int_equal(lf_scene_write(scene, LF_LAYOUT_COLMAP_TEXT, place(state, "wide", path), NULL),
                     LF_OK);
    lf_scene_close(scene);
    lf_scene_set_options o = usual();
    o.scenes = path;
    o.longest = 2; /* 65 times */
    expect_refused(&o, "data.longest = 2");
}

static void missing_folders(void **state)
{
    lf_scene_set_options o = usual();
    o.root = *state;
    o.scenes = "alone, nowhere";
    expect_refused(&o, "nowhere");
    o.scenes = "notes";
    expect_refused(&o, "notes");
    o.scenes = " , ";
    expect_refused(&o, "no scene");
    o.scenes = NULL;
    expect_refused(&o, "no scene");
}

static void too_few_views(void **state)
{
    lf_scene_set_options o = usual();
    o.root = *state;
    o.scenes = "two"; /* one of the two is held out */
    expect_refused(&o, "data.hold_out");
    expect_refused(&o, "1 views to train on");
    o.hold_out = 0;
    lf_scene_set *set = open_set(&o);
    assert_int_equal(set->entry[0].count[LF_SPLIT_TRAIN], 2);
    lf_scene_set_close(set);
}

static void nothing_between_near_and_far(void **state)
{
    lf_scene_set_options o = usual();
    o.root = *state;
    o.scenes = "all/a";
    o.near_factor = 1000;
    expect_refused(&o, "data.near_factor 1000");
}

static void no_meshes(void **state)
{
    char path[512];
    lf_scene_set_options o = usual();
    o.builtin = 1;
    o.meshes = place(state, "notes", path);
    expect_refused(&o, "data.scene_meshes");
}

/* A folder of categories as ShapeNet has them: <category>/<id>/models/model_normalized.obj. */
static void meshes_of_categories(void **state)
{
    static const char *const below[] = {"shapes", "shapes/03001627", "shapes/03001627/a",
                                        "shapes/03001627/a/models"};
    char path[512];
    for (size_t i = 0; i < sizeof below / sizeof *below; i++)
        assert_int_equal(mkdir(place(state, below[i], path), 0777), 0);
    FILE *file = fopen(place(state, "shapes/03001627/a/models/model_normalized.obj", path), "w");
    assert_non_null(file);
    fputs("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n", file);
    assert_int_equal(fclose(file), 0);
    lf_scene_set_options o = usual();
    o.builtin = 1;
    o.meshes = place(state, "shapes", path);
    lf_scene_set *set = open_set(&o);
    assert_int_equal(set->count, 1);
    lf_scene_set_close(set);
}

/* A name longer than any path is a message, not a crash. */
static void a_name_too_long(void **state)
{
    lf_scene_set_options o = usual();
    static char name[3 * PATH_MAX];
    memset(name, 'a', sizeof name - 1);
    o.root = *state;
    o.scenes = name;
    expect_refused(&o, "too long");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(objects_are_surrounded_on_white),
        cmocka_unit_test(rooms_are_before_the_cameras),
        cmocka_unit_test(bounds_enclose_the_outlines),
        cmocka_unit_test(depths_enclose_what_is_seen),
        cmocka_unit_test(a_camera_inside_the_bounds),
        cmocka_unit_test(numbers_name_built_in_scenes),
        cmocka_unit_test(options_overrule_what_is_found),
        cmocka_unit_test(lists_of_folders),
        cmocka_unit_test(absolute_paths_need_no_root),
        cmocka_unit_test(depths_of_files_are_widened),
        cmocka_unit_test(pictures_are_reduced),
        cmocka_unit_test(opaque_alpha_says_nothing),
        cmocka_unit_test(bounds_of_a_wide_lens),
        cmocka_unit_test(reduced_too_much),
        cmocka_unit_test(missing_folders),
        cmocka_unit_test(too_few_views),
        cmocka_unit_test(nothing_between_near_and_far),
        cmocka_unit_test(no_meshes),
        cmocka_unit_test(meshes_of_categories),
        cmocka_unit_test(a_name_too_long),
    };
    return cmocka_run_group_tests(tests, set_up_scenes, tear_down);
}
