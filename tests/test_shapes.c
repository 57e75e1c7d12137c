/* test_shapes.c: splits, samples and views of built-in and file shapes; projections of points. */
#include <omp.h>
#include <sys/stat.h>
#include <unistd.h>

#include "datasets/projection.h"
#include "tests/close.h"

static lf_shapes_options small(const char *split)
{
    return (lf_shapes_options){
        .root = LF_BUILTIN,
        .category = "chair",
        .split = split,
        .builtin = 3,
        .thickness = -1,
        .points_uniform = 60,
        .points_near = 40,
        .views = {.setting = LF_SETTING_I, .size = 17, .render = lf_render_defaults()},
        .draws = 2,
        .seed = 5};
}

static lf_shapes *open_shapes(const lf_shapes_options *options)
{
    lf_shapes *shapes;
    lf_error err = {""};
    if (lf_shapes_open(options, &shapes, &err) != LF_OK)
        fail_msg("%s", err.text);
    return shapes;
}

static lf_shapes *prepared(const lf_shapes_options *options)
{
    lf_shapes *shapes = open_shapes(options);
    lf_error err = {""};
    if (lf_shapes_prepare(shapes, NULL, NULL, &err) != LF_OK)
        fail_msg("%s", err.text);
    return shapes;
}

static size_t image_bytes(const lf_shapes_options *o)
{
    return (size_t)lf_views_floats(&o->views);
}

/* ---- splits ---- */

static void splits_are_disjoint(void **state)
{
    (void)state;
    static const char *const splits[] = {"train", "val", "test"};
    lf_shapes *shapes[3];
    for (int i = 0; i < 3; i++) {
        const lf_shapes_options o = small(splits[i]);
        shapes[i] = prepared(&o);
        assert_int_equal(lf_shapes_count(shapes[i]), 3);
    }
    for (int a = 0; a < 9; a++)
        for (int b = 0; b < a; b++) {
            const lf_shape_views *x = lf_shapes_views(shapes[a / 3], a % 3, 0),
                                 *y = lf_shapes_views(shapes[b / 3], b % 3, 0);
            const lf_shapes_options o = small("train");
            assert_string_not_equal(lf_shapes_id(shapes[a / 3], a % 3),
                                    lf_shapes_id(shapes[b / 3], b % 3));
            assert_memory_not_equal(x->images, y->images, image_bytes(&o));
        }
    for (int i = 0; i < 3; i++)
        lf_shapes_close(shapes[i]);
}

/* More shapes to train on do not change the first ones. */
static void a_shape_does_not_depend_on_the_others(void **state)
{
    (void)state;
    lf_shapes_options o = small("train");
    lf_shapes *three = prepared(&o);
    o.builtin = 1;
    lf_shapes *one = prepared(&o);
    assert_string_equal(lf_shapes_id(one, 0), lf_shapes_id(three, 0));
    assert_memory_equal(lf_shapes_samples(one, 0), lf_shapes_samples(three, 0),
                        100 * 4 * sizeof(float));
    assert_memory_equal(lf_shapes_views(one, 0, 0)->images, lf_shapes_views(three, 0, 0)->images,
                        image_bytes(&o));
    lf_shapes_close(one);
    lf_shapes_close(three);
}

static void unknown_family(void **state)
{
    (void)state;
    lf_shapes_options o = small("train");
    lf_shapes *shapes = NULL;
    lf_error err;
    o.category = "teapot";
    assert_int_equal(lf_shapes_open(&o, &shapes, &err), LF_BAD_INPUT);
    assert_null(shapes);
    assert_non_null(strstr(err.text, "teapot"));
    assert_non_null(strstr(err.text, "airplane"));
}

static void a_split_without_shapes(void **state)
{
    (void)state;
    lf_shapes_options o = small("val");
    lf_shapes *shapes = NULL;
    lf_error err;
    o.builtin = 0;
    assert_int_equal(lf_shapes_open(&o, &shapes, &err), LF_BAD_INPUT);
    assert_null(shapes);
    assert_non_null(strstr(err.text, "data.val_shapes"));
}

/* ---- threads and draws ---- */

static void threads_do_not_change_a_bit(void **state)
{
    (void)state;
    const int most = omp_get_max_threads();
    lf_shapes_options o = small("train");
    o.views.setting = LF_SETTING_SO3;
    lf_shapes *shapes[2];
    for (int i = 0; i < 2; i++) {
        omp_set_num_threads(i + 1);
        shapes[i] = prepared(&o);
    }
    omp_set_num_threads(most);
    for (int s = 0; s < 3; s++) {
        assert_memory_equal(lf_shapes_samples(shapes[0], s), lf_shapes_samples(shapes[1], s),
                            100 * 4 * sizeof(float));
        for (int d = 0; d < 2; d++) {
            const lf_shape_views *a = lf_shapes_views(shapes[0], s, d),
                                 *b = lf_shapes_views(shapes[1], s, d);
            assert_memory_equal(a->images, b->images, image_bytes(&o));
            assert_memory_equal(a->object, b->object, sizeof a->object);
            assert_memory_equal(a->camera, b->camera, sizeof a->camera);
        }
    }
    lf_shapes_close(shapes[0]);
    lf_shapes_close(shapes[1]);
}

static void draws_differ_and_repeat(void **state)
{
    (void)state;
    lf_shapes_options o = small("train");
    lf_shapes *still = prepared(&o); /* setting I has one draw */
    assert_ptr_equal(lf_shapes_views(still, 1, 0), lf_shapes_views(still, 1, 1));
    o.views.setting = LF_SETTING_Z;
    lf_shapes *rolled = prepared(&o);
    assert_ptr_equal(lf_shapes_views(rolled, 1, 0), lf_shapes_views(rolled, 1, 2));
    assert_memory_not_equal(lf_shapes_views(rolled, 1, 0)->images,
                            lf_shapes_views(rolled, 1, 1)->images, image_bytes(&o));
    assert_true(lf_shapes_bytes(rolled) > lf_shapes_bytes(still));
    /* what evaluation renders afresh is what training keeps */
    uint8_t *images = malloc(image_bytes(&o));
    assert_non_null(images);
    lf_shape shape;
    lf_shape_views views;
    lf_error err;
    assert_int_equal(lf_shapes_load(rolled, 1, &shape, &err), LF_OK);
    assert_int_equal(lf_shapes_render(rolled, &shape, 1, 1, &views, images, &err), LF_OK);
    assert_memory_equal(images, lf_shapes_views(rolled, 1, 1)->images, image_bytes(&o));
    lf_shape_release(&shape);
    free(images);
    lf_shapes_close(still);
    lf_shapes_close(rolled);
}

static void samples_lie_in_the_cube_and_near_the_surface(void **state)
{
    (void)state;
    const lf_shapes_options o = small("train");
    lf_shapes *shapes = prepared(&o);
    lf_shape shape;
    lf_error err;
    assert_int_equal(lf_shapes_load(shapes, 0, &shape, &err), LF_OK);
    const float(*x)[4] = lf_shapes_samples(shapes, 0);
    long inside = 0;
    for (int i = 0; i < 100; i++) {
        const double p[3] = {(double)x[i][0], (double)x[i][1], (double)x[i][2]};
        double sdf;
        for (int a = 0; a < 3 && i < 60; a++)
            assert_true(fabs(p[a]) <= 0.55 * shape.longest_edge + 1e-6);
        lf_sdf_eval(shape.sdf, 1, &p, &sdf, NULL);
        assert_close(x[i][3], sdf, 0, 1e-6);
        if (i >= 60)
            assert_true(fabs(sdf) < 0.25);
        inside += sdf < 0;
    }
    assert_true(inside > 5 && inside < 95);
    lf_shape_release(&shape);
    lf_shapes_close(shapes);
}

/* ---- files ---- */

typedef struct folder {
    char root[64], category[96], mesh[2][160], list[128];
} folder;

static void write_text(const char *path, const char *text)
{
    FILE *f = fopen(path, "w");
    assert_non_null(f);
    assert_true(fputs(text, f) >= 0);
    assert_int_equal(fclose(f), 0);
}

static const char tetrahedron[] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
                                  "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

/* A category with two meshes, "first" and "second", of which `text` is the second. */
static void open_folder(folder *f, const char *text)
{
    static const char *const ids[] = {"first", "second"};
    snprintf(f->root, sizeof f->root, "/tmp/elf-test-shapes-XXXXXX");
    assert_non_null(mkdtemp(f->root));
    snprintf(f->category, sizeof f->category, "%s/things", f->root);
    assert_int_equal(mkdir(f->category, 0700), 0);
    for (int i = 0; i < 2; i++) {
        snprintf(f->mesh[i], sizeof f->mesh[i], "%s/%s.obj", f->category, ids[i]);
        char inner[128];
        snprintf(inner, sizeof inner, "%s/%s", f->category, ids[i]);
        assert_int_equal(mkdir(inner, 0700), 0);
        snprintf(f->mesh[i], sizeof f->mesh[i], "%s/model.obj", inner);
        if (i == 0 || text)
            write_text(f->mesh[i], i == 0 ? tetrahedron : text);
    }
    snprintf(f->list, sizeof f->list, "%s/train.lst", f->category);
    write_text(f->list, "first\nsecond\n");
}

static void close_folder(folder *f)
{
    for (int i = 0; i < 2; i++) {
        unlink(f->mesh[i]);
        *strrchr(f->mesh[i], '/') = 0;
        rmdir(f->mesh[i]);
    }
    unlink(f->list);
    rmdir(f->category);
    assert_int_equal(rmdir(f->root), 0);
}

static lf_shapes_options of_folder(const folder *f)
{
    lf_shapes_options o = small("train");
    o.root = f->root;
    o.category = "things";
    o.builtin = 0;
    return o;
}

static void a_bad_mesh_is_named(void **state)
{
    (void)state;
    static const char *const bad[] = {
        "",                                                         /* empty */
        "v 0 0 0\nv 1 0 0\nv 0 1 0\n",                              /* no face */
        "v 0 0 0\nv nan 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n", /* no number */
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n",                     /* no such vertex */
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n",   /* a flat sheet */
        "v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n",                     /* a point */
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        folder f;
        open_folder(&f, bad[i]);
        const lf_shapes_options o = of_folder(&f);
        lf_shapes *shapes = open_shapes(&o);
        assert_int_equal(lf_shapes_count(shapes), 2);
        lf_error err = {""};
        const lf_status status = lf_shapes_prepare(shapes, NULL, NULL, &err);
        if (status != LF_BAD_INPUT || !strstr(err.text, f.mesh[1]))
            fail_msg("bad mesh %zu: status %d, \"%s\"", i, (int)status, err.text);
        lf_shapes_close(shapes);
        close_folder(&f);
    }
}

static void a_missing_mesh_is_named(void **state)
{
    (void)state;
    folder f;
    open_folder(&f, NULL);
    const lf_shapes_options o = of_folder(&f);
    lf_shapes *shapes = NULL;
    lf_error err = {""};
    assert_int_equal(lf_shapes_open(&o, &shapes, &err), LF_BAD_INPUT);
    assert_null(shapes);
    assert_non_null(strstr(err.text, "second"));
    close_folder(&f);
}

static void limit_and_added_shapes(void **state)
{
    (void)state;
    folder f;
    open_folder(&f, tetrahedron);
    lf_shapes_options o = of_folder(&f);
    o.limit = 1;
    lf_shapes *shapes = open_shapes(&o);
    assert_int_equal(lf_shapes_count(shapes), 1);
    assert_string_equal(lf_shapes_id(shapes, 0), "first");
    lf_shapes_close(shapes);
    o.limit = 0;
    o.builtin = 3; /* the family of this name is not built in */
    lf_error err;
    assert_int_equal(lf_shapes_open(&o, &shapes, &err), LF_BAD_INPUT);
    char chairs[128], list[160];
    snprintf(chairs, sizeof chairs, "%s/chair", f.root);
    assert_int_equal(rename(f.category, chairs), 0);
    o.category = "chair";
    shapes = open_shapes(&o);
    assert_int_equal(lf_shapes_count(shapes), 5);
    assert_false(lf_shapes_is_builtin(shapes, 1));
    assert_true(lf_shapes_is_builtin(shapes, 2));
    lf_shapes_close(shapes);
    snprintf(list, sizeof list, "%s/test.lst", chairs);
    write_text(list, "second\n");
    o.split = "test"; /* never scored on added shapes */
    shapes = open_shapes(&o);
    assert_int_equal(lf_shapes_count(shapes), 1);
    lf_shapes_close(shapes);
    unlink(list);
    assert_int_equal(rename(chairs, f.category), 0);
    close_folder(&f);
}

/* ---- projection ---- */

static void projection_masks_what_views_do_not_see(void **state)
{
    (void)state;
    lf_shape_views views = {.images = NULL};
    lf_camera_cube(33, views.camera);
    lf_rotation_axis(2, 1.5707963267948966, views.object); /* x -> y */
    double point[5][3] = {{0.1, 0, 0}, {0}, {1e9, 0, 0}, {NAN, 0, 0}, {0, 0, 0}};
    lf_rotation_apply_transposed(views.object, views.camera[3].centre, point[1]);
    lf_projection p = lf_projection_create(5);
    lf_projection_fill(&p, 0, 3, (const double(*)[3])point, &views, 0);
    lf_projection_fill(&p, 3, 2, (const double(*)[3])(point + 3), &views, 8);
    for (int v = 0; v < LF_CUBE_VIEWS; v++) {
        const double *c = views.camera[v].centre, *d = p.direction + 3 * v;
        const double turned[3] = {0, 0.1, 0};
        double size = 0;
        for (int a = 0; a < 3; a++)
            size += (turned[a] - c[a]) * (turned[a] - c[a]);
        assert_close(p.distance[v], sqrt(size), 1e-14, 0);
        for (int a = 0; a < 3; a++)
            assert_close(d[a], (turned[a] - c[a]) / sqrt(size), 0, 1e-14);
        assert_int_equal(p.mask[v], 1);
        assert_int_equal(p.mask[2 * 8 + v], 0);
        assert_int_equal(p.mask[3 * 8 + v], 0);
        assert_int_equal(p.mask[4 * 8 + v], 1);
        assert_close(p.uv[(4 * 8 + v) * 2], 16, 0, 1e-12);
    }
    assert_int_equal(p.mask[8 + 3], 0); /* a point at the camera */
    for (int i = 0; i < 5 * 8; i++)
        assert_true(isfinite(p.uv[2 * i]) && isfinite(p.direction[3 * i]) && p.uv[2 * i] >= 0 &&
                    p.uv[2 * i] <= 32);
    assert_int_equal(p.first[2], 0);
    assert_int_equal(p.first[3], 8);
    lf_projection_free(&p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(splits_are_disjoint),
        cmocka_unit_test(a_shape_does_not_depend_on_the_others),
        cmocka_unit_test(unknown_family),
        cmocka_unit_test(a_split_without_shapes),
        cmocka_unit_test(threads_do_not_change_a_bit),
        cmocka_unit_test(draws_differ_and_repeat),
        cmocka_unit_test(samples_lie_in_the_cube_and_near_the_surface),
        cmocka_unit_test(a_bad_mesh_is_named),
        cmocka_unit_test(a_missing_mesh_is_named),
        cmocka_unit_test(limit_and_added_shapes),
        cmocka_unit_test(projection_masks_what_views_do_not_see),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
