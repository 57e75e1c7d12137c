/* test_report.c: reports, comparisons of mesh files and the picture: what they write and refuse. */
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "datasets/image.h"
#include "eval/compare.h"
#include "eval/montage.h"
#include "eval/report.h"
#include "tests/close.h"

typedef struct folder {
    char path[64], file[128];
} folder;

static int make_folder(void **state)
{
    folder *f = calloc(1, sizeof *f);
    strcpy(f->path, "/tmp/lf_report_XXXXXX");
    if (!f || !mkdtemp(f->path))
        return -1;
    *state = f;
    return 0;
}

static int remove_folder(void **state)
{
    folder *f = *state;
    const char *names[] = {"a.json", "a.ply", "b.ply", "c.ply", "m.png", "bad.obj"};
    char path[128];
    for (int i = 0; i < 6; i++) {
        snprintf(path, sizeof path, "%s/%s", f->path, names[i]);
        unlink(path);
    }
    const int left = rmdir(f->path); /* fails if a temporary file stayed behind */
    free(f);
    return left;
}

static const char *in_folder(folder *f, const char *name)
{
    snprintf(f->file, sizeof f->file, "%s/%s", f->path, name);
    return f->file;
}

static lf_report example(void)
{
    lf_report r = {.experiment = "reconstruction",
                   .model = "recon",
                   .category = "chair",
                   .train_setting = "I",
                   .eval_setting = "Z",
                   .split = "test",
                   .peak_rss_mb = 123.5,
                   .metric = lf_metric_defaults()};
    const lf_score good = {.iou = 0.8, .chamfer_l1 = 0.02};
    const lf_score empty = {.iou = 0, .chamfer_l1 = LF_CHAMFER_EMPTY, .empty = true};
    lf_report_add(&r, "one", &good, 1.5, 1000);
    lf_report_add(&r, "caf\xe9", &empty, 0.5, 0); /* not UTF-8 */
    return r;
}

/* What a report prints; the caller frees it. */
static char *printed(const lf_report *r)
{
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    assert_non_null(out);
    lf_report_print(r, out);
    fclose(out);
    return text;
}

static double number(const json_t *json, const char *key)
{
    const json_t *value = json_object_get(json, key);
    assert_true(json_is_number(value));
    return json_number_value(value);
}

static void report_has_its_keys(void **state)
{
    folder *f = *state;
    lf_report r = example();
    const char *path = in_folder(f, "a.json");
    assert_int_equal(lf_report_write(&r, path, NULL), LF_OK);
    json_t *json = json_load_file(path, 0, NULL);
    assert_non_null(json);
    const char *texts[][2] = {
        {"experiment", "reconstruction"}, {"model", "recon"},    {"category", "chair"},
        {"train_setting", "I"},           {"eval_setting", "Z"}, {"split", "test"}};
    for (int i = 0; i < 6; i++)
        assert_string_equal(json_string_value(json_object_get(json, texts[i][0])), texts[i][1]);
    assert_close(number(json, "shapes"), 2, 0, 0);
    assert_close(number(json, "iou"), 0.4, 1e-8, 0);
    assert_close(number(json, "chamfer_l1"), 10 * (0.02 + sqrt(3)) / 2, 1e-8, 0);
    assert_close(number(json, "seconds_per_shape"), 1, 1e-8, 0);
    assert_close(number(json, "peak_rss_mb"), 123.5, 1e-8, 0);
    assert_close(number(json, "empty"), 1, 0, 0);
    const json_t *shapes = json_object_get(json, "per_shape");
    assert_int_equal(json_array_size(shapes), 2);
    const json_t *first = json_array_get(shapes, 0), *second = json_array_get(shapes, 1);
    assert_string_equal(json_string_value(json_object_get(first, "id")), "one");
    assert_close(number(first, "chamfer_l1"), 0.2, 1e-8, 0);
    assert_close(number(first, "faces"), 1000, 0, 0);
    assert_true(json_is_false(json_object_get(first, "empty")));
    assert_string_equal(json_string_value(json_object_get(second, "id")), "caf?");
    assert_true(json_is_true(json_object_get(second, "empty")));
    const json_t *baselines = json_object_get(json, "baselines");
    assert_true(json_is_null(json_object_get(baselines, "hull")));
    assert_true(json_is_null(json_object_get(baselines, "mean_shape")));
    const json_t *chamfer = json_object_get(json_object_get(json, "metric"), "chamfer_l1");
    assert_close(number(chamfer, "factor"), 10, 0, 0);
    assert_close(number(chamfer, "samples"), 100000, 0, 0);
    assert_non_null(json_object_get(chamfer, "unit"));
    json_decref(json);
    lf_report_clear(&r);
}

/* The baselines' figures are means of their own, below the model's, which stay as they are. */
static void baselines_are_reported(void **state)
{
    (void)state;
    lf_report r = example();
    lf_report_clear(&r);
    r.has[LF_SHAPE_HULL] = r.has[LF_SHAPE_MEAN] = true;
    const lf_score score[2] = {{.iou = 0.8, .chamfer_l1 = 0.02},
                               {.chamfer_l1 = LF_CHAMFER_EMPTY, .empty = true}};
    for (int i = 0; i < 2; i++) {
        lf_report_add(&r, "one", &score[0], 1, 1);
        lf_report_add_baseline(&r, LF_SHAPE_HULL, &score[i]);
        lf_report_add_baseline(&r, LF_SHAPE_MEAN, &score[0]);
    }
    json_t *json = lf_report_json(&r);
    const json_t *hull = json_object_get(json_object_get(json, "baselines"), "hull");
    assert_close(number(json, "iou"), 0.8, 1e-12, 0);
    assert_close(number(hull, "iou"), 0.4, 1e-12, 0);
    assert_close(number(hull, "chamfer_l1"), 10 * (0.02 + sqrt(3)) / 2, 1e-12, 0);
    assert_close(number(hull, "empty"), 1, 0, 0);
    const json_t *second = json_array_get(json_object_get(json, "per_shape"), 1);
    hull = json_object_get(json_object_get(second, "baselines"), "hull");
    assert_true(json_is_true(json_object_get(hull, "empty")));
    assert_close(number(hull, "iou"), 0, 0, 0);
    assert_non_null(
        json_object_get(json_object_get(json_object_get(json, "metric"), "baselines"), "hull"));
    const json_t *mean = json_object_get(json_object_get(json, "baselines"), "mean_shape");
    assert_close(number(mean, "iou"), 0.8, 1e-12, 0);
    assert_close(number(mean, "empty"), 0, 0, 0);
    json_decref(json);
    char *text = printed(&r);
    assert_non_null(strstr(text, "views: IoU 0.4000, Chamfer x10 8.7603, 1 empty"));
    assert_non_null(strstr(text, "training split: IoU 0.8000, Chamfer x10 0.2000, 0 empty"));
    free(text);
    lf_report_clear(&r);
}

/* A report that cannot be written leaves the older file. */
static void report_is_atomic(void **state)
{
    folder *f = *state;
    lf_report r = example();
    lf_error err = {""};
    assert_int_equal(lf_report_write(&r, "/nonexistent/folder/a.json", &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "/nonexistent/folder/a.json"));
    assert_int_equal(lf_report_write(&r, f->path, &err), LF_FAILED); /* a folder is in the way */
    struct stat kind;
    assert_int_equal(stat(f->path, &kind), 0);
    assert_true(S_ISDIR(kind.st_mode));
    lf_report_clear(&r);
    assert_int_equal(lf_report_mean(&r).empty, 0);
    assert_close(lf_report_mean(&r).iou, 0, 0, 0);
    assert_int_equal(lf_report_write(&r, in_folder(f, "a.json"), &err), LF_OK);
}

static void table_is_printed(void **state)
{
    (void)state;
    lf_report r = example();
    char *text = printed(&r);
    assert_non_null(strstr(text, "0.8000       0.2000"));
    assert_non_null(strstr(text, "2 shapes, 1 empty"));
    assert_non_null(strstr(text, "17.3205"));
    free(text);
    lf_report_clear(&r);
}

static json_t *compare(const char *a, const char *b, const lf_compare_options *options)
{
    char *text = NULL;
    size_t size = 0;
    lf_error err = {""};
    FILE *out = open_memstream(&text, &size);
    const lf_status status = lf_compare_meshes(a, b, options, out, &err);
    fclose(out);
    if (status != LF_OK)
        fail_msg("%s", err.text);
    json_t *json = json_loads(text, 0, NULL);
    assert_non_null(json);
    free(text);
    return json;
}

static void meshes_are_compared(void **state)
{
    folder *f = *state;
    const double centre[3] = {3, 0, 0};
    char a[128], b[128];
    strcpy(a, in_folder(f, "a.ply"));
    strcpy(b, in_folder(f, "b.ply"));
    lf_mesh *ball = lf_mesh_sphere(5, 1.8, centre), *truth = lf_mesh_sphere(5, 2, centre);
    assert_int_equal(lf_mesh_write_ply(a, ball, NULL), LF_OK);
    assert_int_equal(lf_mesh_write_ply(b, truth, NULL), LF_OK);
    lf_compare_options options = lf_compare_defaults();
    options.metric.samples = 30000;
    options.metric.exact = true;
    json_t *json = compare(a, b, &options);
    assert_close(number(json, "iou"), 0.729, 5e-3, 0);
    assert_close(number(json, "chamfer_l1"), 0.5, 5e-3, 0); /* 0.2 of an edge of 4, times 10 */
    assert_close(number(json, "longest_edge"), 4, 1e-2, 0);
    assert_true(json_is_false(json_object_get(json, "normalised")));
    assert_string_equal(json_string_value(json_object_get(json, "occupancy_truth")),
                        "winding number");
    json_decref(json);
    options.normalise = true; /* then both are the same sphere */
    json = compare(a, b, &options);
    assert_close(number(json, "iou"), 1, 1e-3, 0);
    assert_close(number(json, "chamfer_l1"), 0, 0, 1e-6);
    json_decref(json);
    lf_mesh_free(ball);
    lf_mesh_free(truth);
}

static void refuse(const char *a, const char *b, const char *word)
{
    const lf_compare_options options = lf_compare_defaults();
    char *text = NULL;
    size_t size = 0;
    lf_error err = {""};
    FILE *out = open_memstream(&text, &size);
    assert_int_equal(lf_compare_meshes(a, b, &options, out, &err), LF_BAD_INPUT);
    fclose(out);
    assert_int_equal(size, 0);
    if (!strstr(err.text, word))
        fail_msg("\"%s\" does not say %s", err.text, word);
    free(text);
}

static void bad_files_are_refused(void **state)
{
    folder *f = *state;
    const double centre[3] = {0, 0, 0};
    char a[128], bad[128];
    strcpy(a, in_folder(f, "a.ply"));
    strcpy(bad, in_folder(f, "bad.obj"));
    lf_mesh *ball = lf_mesh_sphere(2, 1, centre);
    assert_int_equal(lf_mesh_write_ply(a, ball, NULL), LF_OK);
    refuse(a, "/nonexistent/b.ply", "/nonexistent/b.ply");
    refuse("/nonexistent/b.ply", a, "/nonexistent/b.ply");
    const char *texts[] = {"", "v 0 0 0\n", "v 0 0 nan\nv 0 1 0\nv 1 0 0\nf 1 2 3\n",
                           "v 0 0 0\nv 0 1 0\nv 1 0 0\nf 1 2 9\n",
                           "v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n"};
    for (int i = 0; i < 5; i++) {
        FILE *file = fopen(bad, "w");
        fputs(texts[i], file);
        fclose(file);
        refuse(a, bad, "bad.obj");
    }
    lf_compare_options options = lf_compare_defaults(); /* the last file: an empty prediction */
    options.metric.samples = 1000;
    json_t *json = compare(bad, a, &options);
    assert_true(json_is_true(json_object_get(json, "empty")));
    assert_true(json_is_null(json_object_get(json, "occupancy_predicted")));
    assert_close(number(json, "chamfer_l1"), 10 * sqrt(3), 1e-8, 0);
    json_decref(json);
    lf_mesh_free(ball);
}

/* The picture holds the views and both meshes where they belong, and white elsewhere. */
static void montage_is_drawn(void **state)
{
    folder *f = *state;
    enum { views = 8, size = 17, cell = 33 };
    static float images[views][size][size][2];
    for (int v = 0; v < views; v++)
        for (int y = 0; y < size; y++)
            for (int x = 0; x < size; x++) /* a dark square of shade 0 on the ground */
                images[v][y][x][1] = x > 4 && x < 12 && y > 4 && y < 12;
    const double centre[3] = {0, 0, 0};
    lf_mesh *ball = lf_mesh_sphere(3, 0.4, centre), *none = lf_mesh_create(0, 0);
    const lf_montage_row rows[2] = {
        {"one  IoU 0.80", views, size, 2, &images[0][0][0][0], ball, ball},
        {"two", 0, 0, 0, NULL, none, ball}};
    lf_montage_options options = {.cell = cell, .views = 2, .viewpoints = 1};
    const char *path = in_folder(f, "m.png");
    assert_int_equal(lf_montage_write(path, 2, rows, &options, NULL), LF_OK);
    lf_image *image = NULL;
    assert_int_equal(lf_image_read(path, &image, NULL), LF_OK);
    assert_int_equal(image->channels, 3);
    const int step = cell + 6, half = cell / 2, top = 6 + 22 + 22 + half;
    const int second = top + 22 + cell + 6;
    assert_below(lf_image_at(image, 6 + half, top)[0], 0.01); /* first view: dark */
    assert_below(0.99, lf_image_at(image, 6 + 2, top)[0]);    /* beside: white */
    const int predicted = 6 + 2 * step + 12 + half, truth = predicted + step + 12;
    assert_below(lf_image_at(image, predicted, top)[0], 0.9);
    assert_below(lf_image_at(image, truth, top)[0], 0.9);
    assert_below(0.99, lf_image_at(image, predicted, second)[0]); /* empty prediction: white */
    assert_below(lf_image_at(image, truth, second)[0], 0.9);
    lf_image_free(image);
    lf_error err = {""};
    assert_int_equal(lf_montage_write(path, 0, rows, &options, &err), LF_BAD_INPUT);
    options.viewpoints = 3;
    assert_int_equal(lf_montage_write(path, 2, rows, &options, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "viewpoints 3"));
    lf_mesh_free(ball);
    lf_mesh_free(none);
}

int main(void)
{
#define WITH_FOLDER(test) cmocka_unit_test_setup_teardown(test, make_folder, remove_folder)
    const struct CMUnitTest tests[] = {
        WITH_FOLDER(report_has_its_keys),
        WITH_FOLDER(report_is_atomic),
        cmocka_unit_test(baselines_are_reported),
        cmocka_unit_test(table_is_printed),
        WITH_FOLDER(meshes_are_compared),
        WITH_FOLDER(bad_files_are_refused),
        WITH_FOLDER(montage_is_drawn),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
