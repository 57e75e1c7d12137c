/* test_scene_make.c: built-in scenes are what they say: the same every time, posed rightly, the
 * same colour from everywhere where they are diffuse, and written and read in every layout. */
#include <omp.h>

#include "datasets/scene_make_internal.h"
#include "eval/make_scene.h"
#include "tests/scene_fixture.h"

enum { SIZE = 48 };

static lf_scene_make_options options_of(lf_scene_kind kind, uint64_t index)
{
    lf_scene_make_options o = lf_scene_make_defaults();
    o.kind = kind;
    o.seed = 3;
    o.index = index;
    o.size = SIZE;
    o.train_views = 7;
    o.test_views = 2;
    return o;
}

static lf_scene *make(const lf_scene_make_options *o)
{
    lf_scene *scene = NULL;
    lf_error err = {"no message"};
    if (lf_scene_make(o, &scene, &err) != LF_OK)
        fail_msg("%s", err.text);
    return scene;
}

static lf_pixels hold(const lf_scene *scene, long view)
{
    lf_pixels p;
    assert_int_equal(lf_scene_hold(scene, view, &p, NULL), LF_OK);
    return p;
}

/* Largest difference of a colour; the pictures have one size. */
static int picture_difference(const lf_scene *a, long i, const lf_scene *b, long j)
{
    const lf_pixels p = hold(a, i), q = hold(b, j);
    int worst = 0;
    assert_int_equal(p.width, q.width);
    assert_int_equal(p.height, q.height);
    for (long k = 0; k < 3L * p.width * p.height; k++)
        worst = abs(p.rgb[k] - q.rgb[k]) > worst ? abs(p.rgb[k] - q.rgb[k]) : worst;
    lf_scene_release(a, i);
    lf_scene_release(b, j);
    return worst;
}

static void assert_same_scene(const lf_scene *a, const lf_scene *b)
{
    assert_int_equal(a->views, b->views);
    for (long v = 0; v < a->views; v++) {
        assert_memory_equal(&a->view[v].camera, &b->view[v].camera, sizeof(lf_camera));
        assert_true(a->view[v].near == b->view[v].near && a->view[v].far == b->view[v].far);
        assert_string_equal(a->view[v].name, b->view[v].name);
        assert_int_equal(picture_difference(a, v, b, v), 0);
    }
}

static void test_same_every_time(void **state)
{
    (void)state;
    for (int kind = 0; kind < LF_SCENE_KINDS; kind++) {
        lf_scene_make_options o = options_of((lf_scene_kind)kind, 1);
        const int threads = omp_get_max_threads();
        omp_set_num_threads(1);
        lf_scene *a = make(&o);
        omp_set_num_threads(2);
        lf_scene *b = make(&o);
        omp_set_num_threads(threads);
        assert_same_scene(a, b);
        o.train_views = 3; /* a view does not depend on how many there are */
        o.test_views = 1;
        lf_scene *few = make(&o);
        assert_int_equal(picture_difference(few, 0, a, 0), 0);
        assert_int_equal(picture_difference(few, 3, a, 3), 0);
        o.index = 2;
        lf_scene *other = make(&o);
        assert_true(picture_difference(few, 0, other, 0) > 50);
        o.index = 1;
        o.seed++;
        lf_scene *third = make(&o);
        assert_true(picture_difference(few, 0, third, 0) > 50);
        lf_scene_close(third);
        lf_scene_close(other);
        lf_scene_close(few);
        lf_scene_close(b);
        lf_scene_close(a);
    }
}

/* Glossy and diffuse scenes differ by their highlights alone, which add. */
static void test_kinds_differ(void **state)
{
    (void)state;
    const lf_scene_make_options g = options_of(LF_KIND_GLOSSY, 4),
                                d = options_of(LF_KIND_DIFFUSE, 4);
    lf_scene *glossy = make(&g), *diffuse = make(&d);
    int most = 0;
    for (long v = 0; v < glossy->views; v++) {
        const lf_pixels p = hold(glossy, v), q = hold(diffuse, v);
        assert_memory_equal(&glossy->view[v].camera, &diffuse->view[v].camera, sizeof(lf_camera));
        for (long k = 0; k < 3L * SIZE * SIZE; k++) {
            assert_true(p.rgb[k] >= q.rgb[k]);
            most = p.rgb[k] - q.rgb[k] > most ? p.rgb[k] - q.rgb[k] : most;
        }
        assert_memory_equal(p.alpha, q.alpha, SIZE * SIZE);
        lf_scene_release(glossy, v);
        lf_scene_release(diffuse, v);
    }
    assert_true(most > 40);
    lf_scene_close(glossy);
    lf_scene_close(diffuse);
    for (int k = 0; k < LF_SCENE_KINDS; k++) {
        lf_scene_kind again;
        assert_int_equal(lf_scene_kind_parse(lf_scene_kind_name((lf_scene_kind)k), &again, NULL),
                         LF_OK);
        assert_int_equal(again, k);
    }
}

/* Without its highlight a glossy scene is the diffuse one; a stronger one only adds light. */
static void test_highlight(void **state)
{
    (void)state;
    lf_scene_make_options o[4] = {options_of(LF_KIND_DIFFUSE, 4), options_of(LF_KIND_GLOSSY, 4),
                                  options_of(LF_KIND_GLOSSY, 4), options_of(LF_KIND_GLOSSY, 4)};
    o[1].highlight = 0;
    o[2].highlight = 2;
    lf_scene *none = make(&o[0]), *off = make(&o[1]), *twice = make(&o[2]), *once = make(&o[3]);
    int most = 0;
    for (long v = 0; v < none->views; v++) {
        const lf_pixels p = hold(none, v), q = hold(off, v), r = hold(twice, v);
        assert_memory_equal(p.rgb, q.rgb, 3L * SIZE * SIZE);
        const lf_pixels usual = hold(once, v);
        for (long k = 0; k < 3L * SIZE * SIZE; k++) {
            assert_true(r.rgb[k] >= usual.rgb[k]);
            most = r.rgb[k] - usual.rgb[k] > most ? r.rgb[k] - usual.rgb[k] : most;
        }
        lf_scene_release(once, v);
        lf_scene_release(none, v);
        lf_scene_release(off, v);
        lf_scene_release(twice, v);
    }
    lf_scene_close(none);
    lf_scene_close(off);
    assert_true(most > 40);
    lf_scene_close(once);
    lf_scene_close(twice);
}

/* Splits as the header says: 0, 8, ... and what is left at the end. */
static void test_splits(void **state)
{
    (void)state;
    lf_scene_make_options o = options_of(LF_KIND_DIFFUSE, 0);
    o.rays = 1;
    o.train_views = 9;
    o.test_views = 4;
    lf_scene *scene = make(&o);
    for (long v = 0; v < scene->views; v++)
        assert_int_equal(scene->view[v].split == LF_SPLIT_TEST, v == 0 || v == 8 || v >= 11);
    lf_scene_close(scene);
}

/* Objects lie in the picture, with room around them; cameras are where they should be. */
static void test_objects_fit(void **state)
{
    (void)state;
    for (uint64_t index = 0; index < 9; index++) {
        lf_scene_make_options o = options_of(LF_KIND_DIFFUSE, index);
        lf_scene *scene = make(&o);
        for (long v = 0; v < scene->views; v++) {
            const lf_pixels p = hold(scene, v);
            const double *c = scene->view[v].camera.centre;
            const double distance = sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
            long covered = 0;
            for (long k = 0; k < SIZE * SIZE; k++) {
                const long row = k / SIZE, column = k % SIZE;
                const bool border =
                    row == 0 || column == 0 || row == SIZE - 1 || column == SIZE - 1;
                covered += p.alpha[k] > 0;
                assert_true(!border || p.alpha[k] == 0);
                assert_true(p.alpha[k] != 0 || p.rgb[3 * k] == 255);
            }
            assert_true(covered > SIZE * SIZE / 50 && covered < SIZE * SIZE / 2);
            assert_true(distance > 3.79 && distance < 4.21 && c[2] > -0.11 * distance);
            lf_scene_release(scene, v);
        }
        lf_scene_close(scene);
    }
}

static void test_lines_fit(void **state)
{
    (void)state;
    for (int kind = 0; kind < LF_SCENE_KINDS; kind++) {
        lf_scene_make_options o = options_of((lf_scene_kind)kind, 2);
        lf_line_fit fit;
        o.size = 96;
        o.rays = 2;
        o.train_views = kind == LF_KIND_FORWARD ? 6 : 70;
        lf_scene *scene = make(&o);
        assert_int_equal(lf_scene_fit_lines(scene, 4, &fit, NULL), LF_OK);
        assert_true(fit.matches > 25);
        assert_below(fit.median, 0.5);
        lf_scene_close(scene);
    }
}

static lf_world *world_of(const lf_scene_make_options *o)
{
    lf_world *world = NULL;
    assert_int_equal(lf_world_make(o, &world, NULL), LF_OK);
    return world;
}

/* Scenes of all kinds by turns: each kind meets each family. */
static void test_kinds_and_families_are_not_tied(void **state)
{
    (void)state;
    long faces[9];
    for (uint64_t index = 0; index < 9; index++) {
        lf_scene_make_options o = options_of((lf_scene_kind)(index % 3), index);
        o.kind = LF_KIND_DIFFUSE;
        lf_world *w = world_of(&o);
        faces[index] = w->mesh->faces;
        lf_world_free(w);
    }
    for (int kind = 0; kind < 3; kind++) { /* told apart by their size: few faces are a chair */
        int chairs = 0, airplanes = 0;
        for (int i = kind; i < 9; i += 3) {
            chairs += faces[i] < 600;
            airplanes += faces[i] > 900;
        }
        assert_true(chairs == 1 && airplanes == 1);
    }
}

static void test_bounds_enclose(void **state)
{
    (void)state;
    for (int kind = 0; kind < LF_SCENE_KINDS; kind++)
        for (uint64_t index = 0; index < 4; index++) {
            lf_scene_make_options o = options_of((lf_scene_kind)kind, index);
            o.rays = 1;
            lf_scene *scene = make(&o);
            lf_world *world = world_of(&o);
            static float depth[SIZE * SIZE];
            for (long v = 0; v < scene->views; v++) {
                const lf_camera *c = &scene->view[v].camera;
                lf_render_depth(world->surface, c, depth);
                for (long k = 0; k < (long)c->width * c->height; k++) {
                    assert_true(kind != LF_KIND_FORWARD || isfinite(depth[k]));
                    assert_true(isinf(depth[k]) || ((double)depth[k] > scene->view[v].near &&
                                                    (double)depth[k] < scene->view[v].far));
                }
            }
            lf_world_free(world);
            lf_scene_close(scene);
        }
}

/* Every ray of a forward scene meets something: its pictures have no white between. */
static void test_rooms_are_full(void **state)
{
    (void)state;
    for (uint64_t index = 4; index < 8; index++) {
        const lf_scene_make_options o = options_of(LF_KIND_FORWARD, index);
        lf_world *world = world_of(&o);
        static float image[SIZE * SIZE * 4];
        for (long v = 0; v < 4; v++) {
            const lf_camera c = lf_world_camera(world, &o, v % 2, v);
            assert_int_equal(c.height, 36);
            lf_render_shaded(world->surface, &c, 3, 4, lf_world_shade, world, image);
            for (long k = 0; k < (long)c.width * c.height; k++)
                assert_true(image[4 * k + 3] == 1);
        }
        lf_world_free(world);
        lf_scene *scene = make(&o);
        assert_null(hold(scene, 0).alpha);
        lf_scene_release(scene, 0);
        lf_scene_close(scene);
    }
}

/* ---- the same point from two cameras ------------------------------------------------------ */

static void bilinear(const lf_pixels *p, const double uv[2], double out[3])
{
    const int i = (int)uv[0], j = (int)uv[1];
    const double a = uv[0] - i, b = uv[1] - j;
    for (int c = 0; c < 3; c++) {
        const uint8_t *at = p->rgb + 3 * ((long)j * p->width + i) + c;
        out[c] = ((1 - b) * ((1 - a) * at[0] + a * at[3]) +
                  b * ((1 - a) * at[3 * p->width] + a * at[3 * p->width + 3])) /
                 255;
    }
}

/* The face is large in the picture and met at no grazing angle: the 3 x 3 pixels around see it or
 * its neighbours at about the same depth. */
static bool smooth(const lf_world *w, const lf_camera *c, const double uv[2], const lf_hit *seen)
{
    for (int k = 0; k < 9; k++) {
        double d[3];
        lf_hit hit;
        lf_camera_ray(c, uv[0] + k % 3 - 1, uv[1] + (double)(k / 3) - 1, d);
        if (!lf_surface_first_hit(w->surface, c->centre, d, 0, INFINITY, &hit) ||
            fabs(hit.distance - seen->distance) > 0.1)
            return false;
        for (int i = 0; i < 3; i++)
            if (fabs(hit.normal[i] - seen->normal[i]) > 0.1)
                return false;
    }
    return true;
}

/* The colours at pixel uv of view a and where view b sees the same point, unless something hides it
 * there or it lies at an edge. */
static bool both_see(const lf_world *w, const lf_camera *a, const lf_camera *b, const lf_pixels *pa,
                     const lf_pixels *pb, const double uv[2], double ya[3], double yb[3])
{
    double d[3], e[3], x[3], at[2], depth, distance = 0;
    lf_hit hit, back;
    lf_camera_ray(a, uv[0], uv[1], d);
    if (uv[0] + 1 >= pa->width || uv[1] + 1 >= pa->height ||
        !lf_surface_first_hit(w->surface, a->centre, d, 0, INFINITY, &hit))
        return false;
    for (int i = 0; i < 3; i++) {
        x[i] = a->centre[i] + hit.distance * d[i];
        distance = hypot(distance, x[i] - b->centre[i]);
    }
    if (!lf_camera_project(b, x, 0.1, at, &depth) || at[0] < 0 || at[1] < 0 ||
        at[0] >= pb->width - 1 || at[1] >= pb->height - 1)
        return false;
    lf_camera_ray(b, at[0], at[1], e);
    if (!lf_surface_first_hit(w->surface, b->centre, e, 0, INFINITY, &back) ||
        fabs(back.distance - distance) > 0.005 || !smooth(w, a, uv, &hit) ||
        !smooth(w, b, at, &back))
        return false;
    bilinear(pa, uv, ya);
    bilinear(pb, at, yb);
    return true;
}

/* Mean difference of the colours of points that two views see, 0 ... 1. */
static double colour_difference(const lf_scene_make_options *o)
{
    lf_scene *scene = make(o);
    lf_world *w = world_of(o);
    double sum = 0, ya[3], yb[3];
    long count = 0;
    for (long k = 0; k < scene->views * scene->views; k++) {
        const long a = k / scene->views, b = k % scene->views;
        const lf_pixels pa = hold(scene, a), pb = hold(scene, b);
        for (long p = 0; a != b && p < (long)pa.width * pa.height; p += 11) {
            const double uv[2] = {(double)(p % pa.width), (double)(p / pa.width)};
            if (!both_see(w, &scene->view[a].camera, &scene->view[b].camera, &pa, &pb, uv, ya, yb))
                continue;
            for (int i = 0; i < 3; i++)
                sum += fabs(ya[i] - yb[i]) / 3;
            count++;
        }
        lf_scene_release(scene, a);
        lf_scene_release(scene, b);
    }
    lf_world_free(w);
    lf_scene_close(scene);
    assert_true(count > 500);
    return sum / (double)count;
}

static void test_points_keep_their_colour(void **state)
{
    (void)state;
    static const uint64_t kept[3] = {0, 2, 5}; /* an airplane has too little of even surface */
    double mean[LF_SCENE_KINDS] = {0};
    for (int kind = 0; kind < LF_SCENE_KINDS; kind++)
        for (uint64_t index = 0; index < 3; index++) {
            lf_scene_make_options o = options_of((lf_scene_kind)kind, kept[index]);
            o.size = 96;
            mean[kind] += colour_difference(&o) / 3;
        }
    assert_below(mean[LF_KIND_DIFFUSE], 0.006);
    assert_below(mean[LF_KIND_FORWARD], 0.006);
    assert_true(mean[LF_KIND_GLOSSY] > 1.05 * mean[LF_KIND_DIFFUSE]);
}

/* The shade itself does not know the viewer, as long as he is on the same side. */
static void test_shade(void **state)
{
    (void)state;
    double largest = 0;
    for (int kind = 0; kind < LF_SCENE_KINDS; kind++) {
        const lf_scene_make_options o = options_of((lf_scene_kind)kind, 0);
        lf_world *w = world_of(&o);
        lf_stream s = lf_stream_at(1, LF_RANDOM_TEST, 0, 0);
        for (int i = 0; i < 300; i++) {
            lf_hit hit = {.face = lf_index(&s, w->mesh->faces), .normal = {0, 0, 1}};
            double point[3], sum[2][4] = {{0}};
            for (int k = 0; k < 3; k++)
                point[k] = lf_normal(&s);
            for (int side = 0; side < 2; side++) {
                double d[3] = {lf_normal(&s), lf_normal(&s), -0.2 - lf_uniform(&s)};
                const double n = hypot(hypot(d[0], d[1]), d[2]);
                for (int k = 0; k < 3; k++)
                    d[k] /= n;
                lf_world_shade(w, &hit, point, d, sum[side]);
            }
            for (int k = 0; k < 3; k++) {
                const double off = fabs(sum[0][k] - sum[1][k]);
                assert_true(sum[0][k] > 0 && sum[0][k] <= 1);
                assert_true(kind == LF_KIND_GLOSSY || off == 0);
                largest = fmax(largest, off);
            }
        }
        lf_world_free(w);
    }
    assert_true(largest > 0.2);
}

/* ---- to disk and back --------------------------------------------------------------------- */

static long find(const lf_scene *scene, lf_scene_split split, long number)
{
    for (long v = 0; v < scene->views; v++)
        if (scene->view[v].split == split && number-- == 0)
            return v;
    fail_msg("a view is gone");
    return -1;
}

static void round_trip(void **state, lf_scene_kind kind, lf_scene_layout layout)
{
    char name[64], path[512];
    lf_error err = {"no message"};
    const lf_scene_make_options o = options_of(kind, 2);
    lf_scene *scene = make(&o);
    snprintf(name, sizeof name, "made/%s%d", lf_scene_kind_name(kind), (int)layout);
    if (lf_scene_write(scene, layout, place(state, name, path), &err) != LF_OK)
        fail_msg("%s", err.text);
    lf_scene *again = open_good(state, name);
    assert_int_equal(again->layout, layout);
    assert_int_equal(again->views, scene->views);
    for (int split = 0; split < LF_SPLITS; split++)
        for (long i = 0; i < lf_scene_count(scene, (lf_scene_split)split); i++) {
            const long v = find(scene, (lf_scene_split)split, i);
            const long w = find(again, (lf_scene_split)split, i);
            const lf_camera *a = &scene->view[v].camera, *b = &again->view[w].camera;
            for (int k = 0; k < 9; k++)
                assert_close(b->rotation[k], a->rotation[k], 0, 1e-6);
            for (int k = 0; k < 3; k++)
                assert_close(b->centre[k], a->centre[k], 0, 1e-6);
            assert_close(b->fx, a->fx, 1e-6, 0);
            assert_close(b->cx, a->cx, 0, 1e-6);
            assert_close(b->cy, a->cy, 0, 1e-6);
            if (layout <= LF_LAYOUT_TRANSFORMS) {
                assert_close(again->view[w].near, scene->view[v].near, 1e-6, 0);
                assert_close(again->view[w].far, scene->view[v].far, 1e-6, 0);
            }
            /* straight colours at the rim are rounded once more */
            assert_true(picture_difference(scene, v, again, w) <= (kind != LF_KIND_FORWARD));
        }
    lf_scene_close(again);
    lf_scene_close(scene);
}

static void test_round_trips(void **state)
{
    for (int layout = 0; layout < LF_LAYOUTS; layout++) {
        round_trip(state, LF_KIND_GLOSSY, (lf_scene_layout)layout);
        round_trip(state, LF_KIND_FORWARD, (lf_scene_layout)layout);
    }
}

/* Views of a lens that a layout cannot say. */
static void test_layout_refuses(void **state)
{
    char path[512];
    lf_error err;
    const lf_scene_make_options o = options_of(LF_KIND_DIFFUSE, 2);
    lf_scene *scene = make(&o);
    scene->view[1].camera.fx *= 1.01;
    static const lf_scene_layout strict[] = {LF_LAYOUT_NERF_SYNTHETIC, LF_LAYOUT_LLFF,
                                             LF_LAYOUT_DEEPVOXELS};
    for (int i = 0; i < 3; i++) {
        place(state, "refused", path);
        assert_int_equal(lf_scene_write(scene, strict[i], path, &err), LF_BAD_INPUT);
        assert_non_null(strstr(err.text, "two focal lengths"));
    }
    lf_scene_close(scene);
}

static void test_bad_options(void **state)
{
    char path[512];
    lf_error err;
    lf_scene *scene = NULL;
    lf_scene_kind kind;
    lf_scene_make_options o = options_of(LF_KIND_DIFFUSE, 0);
    o.size = 7;
    assert_int_equal(lf_scene_make(&o, &scene, &err), LF_BAD_INPUT);
    o = options_of(LF_KIND_DIFFUSE, 0);
    o.train_views = 0;
    assert_int_equal(lf_scene_make(&o, &scene, &err), LF_BAD_INPUT);
    o = options_of(LF_KIND_FORWARD, 0);
    o.rays = 17;
    assert_int_equal(lf_scene_make(&o, &scene, &err), LF_BAD_INPUT);
    o = options_of(LF_KIND_FORWARD, 0);
    o.mesh = "/nowhere/chair.obj";
    assert_int_equal(lf_scene_make(&o, &scene, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "/nowhere/chair.obj"));
    put(state, "flat.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    o.mesh = place(state, "flat.obj", path);
    assert_int_equal(lf_scene_make(&o, &scene, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "flat.obj"));
    assert_null(scene);
    assert_int_equal(lf_scene_kind_parse("matt", &kind, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "glossy, diffuse or forward"));
}

/* A file's mesh is drawn, painted anew. */
static void test_mesh_file(void **state)
{
    char path[512];
    const double low[3] = {0, 0, 0}, high[3] = {1, 2, 3};
    lf_mesh *box = lf_mesh_box(low, high);
    assert_int_equal(lf_mesh_write_ply(place(state, "box.ply", path), box, NULL), LF_OK);
    lf_mesh_free(box);
    lf_scene_make_options o = options_of(LF_KIND_DIFFUSE, 0);
    o.mesh = path;
    lf_world *world = world_of(&o);
    double least[3], size[3];
    assert_int_equal(world->mesh->faces, 12);
    lf_mesh_bounds(world->mesh, least, size);    /* centred: size is half of it */
    assert_close(size[2] / size[0], 2, 1e-6, 0); /* the file's y is up */
    assert_close(size[1] / size[0], 3, 1e-6, 0);
    lf_world_free(world);
}

/* ---- the job ------------------------------------------------------------------------------ */

static void test_job(void **state)
{
    char path[512], text[2048] = "";
    lf_error err = {"no message"};
    lf_make_scene_options o = lf_make_scene_defaults();
    o.kind = "forward";
    o.folder = place(state, "job", path);
    o.size = 24;
    o.views = 9;
    FILE *out = fmemopen(text, sizeof text - 1, "w");
    if (lf_make_scene_job(&o, out, &err) != LF_OK)
        fail_msg("%s", err.text);
    fclose(out);
    assert_non_null(strstr(text, "LLFF"));
    assert_non_null(strstr(text, "7 train, 2 test, 24 x 18"));
    lf_scene *scene = open_good(state, "job");
    assert_int_equal(scene->layout, LF_LAYOUT_LLFF);
    assert_int_equal(lf_scene_count(scene, LF_SPLIT_TEST), 2);
    lf_scene_close(scene);
    assert_int_equal(lf_make_scene_job(&o, NULL, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "holds files"));
    o.layout = "nerf";
    assert_int_equal(lf_make_scene_job(&o, NULL, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "nerf-synthetic, llff"));
    o.kind = NULL;
    assert_int_equal(lf_make_scene_job(&o, NULL, &err), LF_BAD_INPUT);
    o = lf_make_scene_defaults();
    o.kind = "glossy";
    assert_int_equal(lf_make_scene_job(&o, NULL, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "--out"));
}

/* ---- several scenes ----------------------------------------------------------------------- */

static void test_folders(void **state)
{
    char path[512];
    lf_error err;
    long count;
    char **folders;
    lf_make_scene_options o = lf_make_scene_defaults();
    static const char *const names[] = {"all/b", "all/a", "all/.hidden"};
    o.kind = "diffuse";
    o.size = 16;
    o.views = 2;
    for (int i = 0; i < 3; i++) {
        o.folder = place(state, names[i], path);
        assert_int_equal(lf_make_scene_job(&o, NULL, &err), LF_OK);
    }
    put(state, "all/notes/readme.txt", "no scene");
    place(state, "all/", path);
    assert_int_equal(lf_scene_folders(path, &count, &folders, &err), LF_OK);
    assert_int_equal(count, 2);
    assert_string_equal(folders[0] + strlen(folders[0]) - 6, "/all/a");
    assert_string_equal(folders[1] + strlen(folders[1]) - 6, "/all/b");
    lf_scene_folders_free(count, folders);
    assert_int_equal(lf_scene_folders(place(state, "all/a", path), &count, &folders, &err), LF_OK);
    assert_int_equal(count, 1);
    assert_string_equal(folders[0], path);
    lf_scene_folders_free(count, folders);
    count = 7;
    assert_int_equal(lf_scene_folders(place(state, "all/notes", path), &count, &folders, &err),
                     LF_BAD_INPUT);
    assert_int_equal(count, 7);
    assert_non_null(strstr(err.text, "no folder in it"));
    assert_non_null(strstr(err.text, "poses_bounds.npy"));
}

/* near and far given replace the files'. */
static void test_given_depths(void **state)
{
    char path[512];
    lf_scene *made = make_scene(false, false);
    assert_int_equal(lf_scene_write(made, LF_LAYOUT_LLFF, place(state, "llff", path), NULL), LF_OK);
    lf_scene_options o = lf_scene_defaults();
    o.near = 1;
    o.far = 7;
    lf_scene *scene = open_with(state, "llff", &o);
    assert_true(scene->view[0].near == 1 && scene->view[0].far == 7);
    lf_scene_close(scene);
    lf_scene_close(made);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_same_every_time),
        cmocka_unit_test(test_kinds_differ),
        cmocka_unit_test(test_highlight),
        cmocka_unit_test(test_splits),
        cmocka_unit_test(test_kinds_and_families_are_not_tied),
        cmocka_unit_test(test_objects_fit),
        cmocka_unit_test(test_lines_fit),
        cmocka_unit_test(test_bounds_enclose),
        cmocka_unit_test(test_rooms_are_full),
        cmocka_unit_test(test_points_keep_their_colour),
        cmocka_unit_test(test_shade),
        cmocka_unit_test_setup_teardown(test_round_trips, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_layout_refuses, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_bad_options, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_mesh_file, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_job, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_folders, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_given_depths, set_up, tear_down),
    };
    return cmocka_run_group_tests_name("scene_make", tests, NULL, NULL);
}
