/* test_lpips.c: LPIPS with random weights against plain loops in double over the file's own
 * layouts, and "compare-images". */
#include <omp.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "autograd/random.h"
#include "eval/compare_images.h"
#include "tests/close.h"
#include "tests/folder.h"
#include "tests/lpips_reference.h"

/* ---- tests ------------------------------------------------------------------------------------
 */

typedef struct fixture {
    char folder[40], path[2][64]; /* files of weights, by net */
    weights weights[2];
} fixture;

static int set_up(void **state)
{
    fixture *f = calloc(1, sizeof *f);
    strcpy(f->folder, "/tmp/lf_test_lpips_XXXXXX");
    if (!mkdtemp(f->folder))
        return -1;
    for (int net = 0; net < 2; net++) {
        random_weights((lf_lpips_net)net, &f->weights[net]);
        snprintf(f->path[net], sizeof f->path[net], "%s/%d.safetensors", f->folder, net);
        write_weights(&f->weights[net], f->path[net]);
    }
    *state = f;
    return 0;
}

static int tear_down(void **state)
{
    fixture *f = *state;
    const int left = remove_tree(f->folder);
    for (int net = 0; net < 2; net++)
        free_weights(&f->weights[net]);
    free(f);
    return left;
}

static lf_image *noise(int width, int height, uint64_t seed)
{
    lf_image *image = lf_image_create(width, height, 3);
    lf_stream s = lf_stream_at(seed, LF_RANDOM_TEST, 0, 0);
    for (long i = 0; i < 3L * width * height; i++)
        image->pixel[i] = (float)lf_uniform(&s);
    return image;
}

static lf_lpips *open_good(const char *path, lf_lpips_net net)
{
    lf_lpips *lpips = NULL;
    lf_error err = {""};
    if (lf_lpips_open(path, net, &lpips, &err) != LF_OK)
        fail_msg("%s", err.text);
    return lpips;
}

static double distance(lf_lpips *lpips, const lf_image *a, const lf_image *b)
{
    double d = -1;
    lf_error err = {""};
    if (lf_lpips_distance(lpips, a, b, &d, &err) != LF_OK)
        fail_msg("%s", err.text);
    return d;
}

static void check_size(fixture *f, lf_lpips *lpips, lf_lpips_net net, int width, int height)
{
    lf_image *a = noise(width, height, 1), *b = noise(width, height, 2);
    const double d = distance(lpips, a, b);
    assert_true(d > 0.01);
    assert_close(d, lpips_reference(net, &f->weights[net], a, b), 2e-6, 0);
    assert_close(distance(lpips, b, a), d, 1e-6, 0);
    assert_close(distance(lpips, a, a), 0, 0, 0);
    lf_image_free(a);
    lf_image_free(b);
}

static void alex_is_the_reference(void **state)
{
    lf_lpips *lpips = open_good(((fixture *)*state)->path[LF_LPIPS_ALEX], LF_LPIPS_ALEX);
    check_size(*state, lpips, LF_LPIPS_ALEX, 67, 45);
    check_size(*state, lpips, LF_LPIPS_ALEX, 31, 31); /* a smaller one after a larger one */
    check_size(*state, lpips, LF_LPIPS_ALEX, 36, 64);
    lf_lpips_free(lpips);
}

static void vgg_is_the_reference(void **state)
{
    lf_lpips *lpips = open_good(((fixture *)*state)->path[LF_LPIPS_VGG], LF_LPIPS_VGG);
    check_size(*state, lpips, LF_LPIPS_VGG, 16, 16);
    check_size(*state, lpips, LF_LPIPS_VGG, 35, 18);
    lf_lpips_free(lpips);
}

static void same_for_any_threads(void **state)
{
    fixture *f = *state;
    const int before = omp_get_max_threads();
    lf_image *a = noise(70, 50, 3), *b = noise(70, 50, 4);
    lf_lpips *lpips = open_good(f->path[LF_LPIPS_ALEX], LF_LPIPS_ALEX);
    double d[2];
    for (int k = 0; k < 2; k++) {
        omp_set_num_threads(k + 1);
        d[k] = distance(lpips, a, b);
    }
    omp_set_num_threads(before);
    assert_true(d[0] == d[1]);
    lf_lpips_free(lpips);
    lf_image_free(a);
    lf_image_free(b);
}

/* Features that are 0 at every position: unit vectors of nothing, distance 0 and not NaN. */
static void no_feature(void **state)
{
    fixture *f = *state;
    char path[64];
    weights w;
    random_weights(LF_LPIPS_ALEX, &w);
    float *bias = (float *)(uintptr_t)array_of(&w, "features.0.bias")->data;
    for (int i = 0; i < 64; i++)
        bias[i] = -1e6f;
    snprintf(path, sizeof path, "%s/none.safetensors", f->folder);
    write_weights(&w, path);
    lf_lpips *lpips = open_good(path, LF_LPIPS_ALEX);
    lf_image *a = noise(40, 40, 5), *b = noise(40, 40, 6);
    assert_close(distance(lpips, a, b), 0, 0, 0);
    lf_image_free(a);
    lf_image_free(b);
    lf_lpips_free(lpips);
    free_weights(&w);
}

static void expect_bad(const char *path, lf_lpips_net net, const char *words)
{
    lf_lpips *lpips = NULL;
    lf_error err = {""};
    assert_int_equal(lf_lpips_open(path, net, &lpips, &err), LF_BAD_INPUT);
    assert_null(lpips);
    if (!strstr(err.text, words) || !strstr(err.text, path))
        fail_msg("no \"%s\" in \"%s\"", words, err.text);
}

static void bad_weights(void **state)
{
    fixture *f = *state;
    char path[64];
    expect_bad(f->path[LF_LPIPS_ALEX], LF_LPIPS_VGG, "features.0.weight");
    expect_bad("/nowhere.safetensors", LF_LPIPS_VGG, "No such file");
    snprintf(path, sizeof path, "%s/bad.safetensors", f->folder);
    weights w;
    random_weights(LF_LPIPS_ALEX, &w);
    float *x = (float *)(uintptr_t)array_of(&w, "features.8.bias")->data;
    x[7] = NAN;
    write_weights(&w, path);
    expect_bad(path, LF_LPIPS_ALEX, "features.8.bias: number 7 is not finite");
    x[7] = 0;
    lf_array *linear = array_of(&w, "lin3.model.1.weight");
    linear->rank = 2; /* [1, 256] */
    write_weights(&w, path);
    expect_bad(path, LF_LPIPS_ALEX, "lin3.model.1.weight");
    linear->rank = 4;
    w.count--; /* lin4 is the last */
    write_weights(&w, path);
    w.count++;
    expect_bad(path, LF_LPIPS_ALEX, "lin4.model.1.weight is missing");
    assert_int_equal(truncate(path, 1000000), 0);
    expect_bad(path, LF_LPIPS_ALEX, "truncated");
    free_weights(&w);
}

static void bad_images(void **state)
{
    fixture *f = *state;
    lf_lpips *lpips = open_good(f->path[LF_LPIPS_ALEX], LF_LPIPS_ALEX);
    lf_image *a = noise(30, 40, 1), *b = noise(40, 30, 1);
    double d = -1;
    lf_error err = {""};
    assert_int_equal(lf_lpips_distance(lpips, a, a, &d, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "at least 31 x 31 pixels, the images are 30 x 40"));
    assert_int_equal(lf_lpips_distance(lpips, a, b, &d, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "30 x 40 pixels, the second 40 x 30"));
    assert_close(d, -1, 0, 0);
    lf_lpips_net net = LF_LPIPS_VGG;
    assert_int_equal(lf_lpips_net_parse("squeeze", &net, &err), LF_BAD_INPUT);
    assert_int_equal(lf_lpips_net_parse("alex", &net, &err), LF_OK);
    assert_int_equal(net, LF_LPIPS_ALEX);
    lf_image_free(a);
    lf_image_free(b);
    lf_lpips_free(lpips);
}

/* ---- compare-images ---------------------------------------------------------------------------
 */

static void write_image(const char *folder, const char *name, lf_image *image, char path[64])
{
    snprintf(path, 64, "%s/%s", folder, name);
    assert_int_equal(lf_image_write_png(path, image, NULL), LF_OK);
    lf_image_free(image);
}

static json_t *compare(const char *a, const char *b, const lf_compare_images_options *options)
{
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    lf_error err = {""};
    if (lf_compare_images(a, b, options, out, &err) != LF_OK)
        fail_msg("%s", err.text);
    fclose(out);
    json_t *json = json_loads(text, 0, NULL), *file = json_load_file(options->json, 0, NULL);
    assert_non_null(json);
    assert_true(json_equal(json, file));
    json_decref(file);
    free(text);
    return json;
}

static double number(const json_t *json, const char *key)
{
    return json_number_value(json_object_get(json, key));
}

static const char *lpips_entry(const json_t *json, const char *key)
{
    return json_string_value(
        json_object_get(json_object_get(json_object_get(json, "metric"), "lpips"), key));
}

static void compared_files(void **state)
{
    fixture *f = *state;
    char a[64], b[64], c[64], report[64];
    write_image(f->folder, "a.png", noise(40, 33, 1), a);
    write_image(f->folder, "b.png", noise(40, 33, 2), b);
    write_image(f->folder, "c.png", noise(33, 40, 2), c);
    snprintf(report, sizeof report, "%s/report.json", f->folder);
    lf_compare_images_options options = {.json = report};
    json_t *json = compare(a, a, &options);
    assert_close(number(json, "psnr"), 100, 0, 0);
    assert_close(number(json, "ssim"), 1, 1e-12, 0);
    assert_true(json_is_null(json_object_get(json, "lpips")));
    assert_non_null(strstr(lpips_entry(json, "not_available"), "docs/lpips.md"));
    json_decref(json);
    options.weights = f->path[LF_LPIPS_ALEX];
    options.net = LF_LPIPS_ALEX;
    json = compare(a, b, &options);
    assert_true(number(json, "lpips") > 0.01 && number(json, "psnr") < 9);
    assert_string_equal(lpips_entry(json, "net"), "alex");
    assert_string_equal(lpips_entry(json, "weights"), options.weights);
    json_decref(json);
    lf_error err = {""};
    options.json = NULL;
    assert_int_equal(lf_compare_images(a, c, &options, NULL, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, a));
    assert_non_null(strstr(err.text, "40 x 33 pixels, the second 33 x 40"));
    assert_int_equal(lf_compare_images(a, "/nowhere.png", &options, NULL, &err), LF_BAD_INPUT);
    options.weights = a; /* a picture is no file of weights */
    assert_int_equal(lf_compare_images(a, b, &options, NULL, &err), LF_BAD_INPUT);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(alex_is_the_reference), cmocka_unit_test(vgg_is_the_reference),
        cmocka_unit_test(same_for_any_threads),  cmocka_unit_test(no_feature),
        cmocka_unit_test(bad_weights),           cmocka_unit_test(bad_images),
        cmocka_unit_test(compared_files),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
