/* test_render_report.c: what the report of a rendering holds and prints. */
#include "tests/scene_fixture.h"

#include "eval/render_report.h"

static lf_render_figures figures(double psnr, double variance)
{
    lf_render_figures f = lf_render_figures_none();
    f.psnr = psnr;
    f.ssim = psnr / 100;
    f.pixel_variance = variance;
    f.seconds = psnr / 10;
    f.rows = 1000;
    f.baseline[LF_BASELINE_COPY] = psnr - 4;
    f.baseline[LF_BASELINE_SWEEP] = psnr - 1;
    return f;
}

/* Two images of fern, one of box: means 22 and 30; over scenes 26, over images 74 / 3. */
static lf_render_report example(void)
{
    lf_render_report r = {.model = "render",
                          .train_setting = "I",
                          .eval_setting = "SO3",
                          .split = "test",
                          .sources = 6,
                          .samples = 24,
                          .peak_rss_mb = 12.5};
    const lf_render_figures f[] = {figures(20, 1e-9), figures(30, 3e-9), figures(24, NAN)};
    lf_render_report_add(&r, 0, "fern", "image000", &f[0]);
    lf_render_report_add(&r, 7, "box", "caf\xe9", &f[1]); /* not UTF-8 */
    lf_render_report_add(&r, 0, "fern", "image008", &f[2]);
    return r;
}

static void means(void **state)
{
    (void)state;
    lf_render_report r = example();
    assert_true(lf_render_report_new_scene(&r, 1));
    assert_false(lf_render_report_new_scene(&r, 2));
    assert_close(lf_render_report_mean(&r, 0).psnr, 22, 1e-12, 0);
    assert_close(lf_render_report_mean(&r, -1).psnr, 74.0 / 3, 1e-12, 0);
    assert_close(lf_render_report_scene_mean(&r).psnr, 26, 1e-12, 0);
    assert_close(lf_render_report_scene_mean(&r).baseline[LF_BASELINE_COPY], 22, 1e-12, 0);
    assert_close(lf_render_report_scene_mean(&r).rows, 1000, 1e-12, 0);
    assert_close(lf_render_report_mean(&r, 7).pixel_variance, 3e-9, 1e-12, 0);
    assert_true(isnan(lf_render_report_mean(&r, 0).pixel_variance)); /* one lacks it */
    assert_true(isnan(lf_render_report_scene_mean(&r).lpips));
    assert_true(isnan(lf_render_report_mean(&r, 3).psnr));
    lf_render_report_clear(&r);
    assert_true(isnan(lf_render_report_scene_mean(&r).psnr));
}

/* Two scenes of one name are two scenes. */
static void scenes_are_told_apart_by_number(void **state)
{
    (void)state;
    lf_render_report r = {0};
    const lf_render_figures f[] = {figures(20, NAN), figures(30, NAN), figures(28, NAN)};
    lf_render_report_add(&r, 0, "chair", "a", &f[0]);
    lf_render_report_add(&r, 1, "chair", "a", &f[1]);
    lf_render_report_add(&r, 1, "chair", "b", &f[2]);
    assert_true(lf_render_report_new_scene(&r, 1));
    assert_close(lf_render_report_mean(&r, 1).psnr, 29, 1e-12, 0);
    assert_close(lf_render_report_scene_mean(&r).psnr, 24.5, 1e-12, 0);
    lf_render_report_clear(&r);
}

static double number(const json_t *json, const char *key)
{
    const json_t *value = json_object_get(json, key);
    assert_true(json_is_number(value));
    return json_number_value(value);
}

static void is_text(const json_t *json, const char *key, const char *text)
{
    assert_string_equal(json_string_value(json_object_get(json, key)), text);
}

static void report_has_its_keys(void **state)
{
    char path[512];
    place(state, "a.json", path);
    lf_render_report r = example();
    assert_int_equal(lf_render_report_write(&r, path, NULL), LF_OK);
    json_t *json = json_load_file(path, 0, NULL);
    assert_non_null(json);
    is_text(json, "experiment", "rendering");
    is_text(json, "model", "render");
    is_text(json, "train_setting", "I");
    is_text(json, "eval_setting", "SO3");
    is_text(json, "split", "test");
    assert_close(number(json, "sources"), 6, 0, 0);
    assert_close(number(json, "samples"), 24, 0, 0);
    assert_close(number(json, "scenes"), 2, 0, 0);
    assert_close(number(json, "images"), 3, 0, 0);
    assert_close(number(json, "peak_rss_mb"), 12.5, 0, 0);
    const json_t *over_scenes = json_object_get(json, "mean_over_scenes");
    const json_t *over_images = json_object_get(json, "mean_over_images");
    assert_close(number(over_scenes, "psnr"), 26, 1e-8, 0);
    assert_close(number(over_images, "ssim"), 0.74 / 3, 1e-8, 0);
    assert_close(number(json_object_get(over_scenes, "baselines"), "sweep"), 25, 1e-8, 0);
    assert_true(json_is_null(json_object_get(json_object_get(over_scenes, "baselines"), "mean")));
    assert_true(json_is_null(json_object_get(over_scenes, "lpips")));
    const json_t *scenes = json_object_get(json, "per_scene");
    assert_int_equal(json_array_size(scenes), 2);
    is_text(json_array_get(scenes, 0), "scene", "fern");
    assert_close(number(json_array_get(scenes, 0), "images"), 2, 0, 0);
    assert_close(number(json_array_get(scenes, 0), "psnr"), 22, 1e-8, 0);
    const json_t *images = json_object_get(json, "per_image");
    assert_int_equal(json_array_size(images), 3);
    const json_t *box = json_array_get(images, 1);
    is_text(box, "scene", "box");
    is_text(box, "view", "caf?");
    assert_close(number(box, "seconds"), 3, 1e-8, 0);
    assert_close(number(box, "pixel_variance"), 3e-9, 1e-8, 0);
    assert_true(json_is_integer(json_object_get(box, "rows")));
    assert_true(json_is_null(json_object_get(json_array_get(images, 2), "pixel_variance")));
    const json_t *metric = json_object_get(json, "metric");
    const char *defined[] = {"image", "psnr",      "ssim",    "pixel_variance",
                             "lpips", "baselines", "seconds", "rows"};
    for (int i = 0; i < 8; i++)
        assert_non_null(json_object_get(metric, defined[i]));
    assert_non_null(json_object_get(json_object_get(metric, "lpips"), "not_available"));
    json_decref(json);
    lf_render_report_clear(&r);
}

static void table_is_printed(void **state)
{
    (void)state;
    lf_render_report r = example();
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    lf_render_report_print(&r, out);
    fclose(out);
    const char *const lines[] = {
        "rendering render, trained in I, evaluated in SO3, split test, 6 sources, 24 samples a ray",
        "fern                 image008              24.00 0.2400      -         -  20.00      -",
        "fern                 mean of 2             22.00",
        "mean over scenes     mean of 2             26.00",
        "mean over images     mean of 3             24.67"};
    for (int i = 0; i < 5; i++)
        if (!strstr(text, lines[i]))
            fail_msg("no line\n%s\nin\n%s", lines[i], text);
    free(text);
    lf_render_report_clear(&r);
}

static void bad_folder_is_refused(void **state)
{
    (void)state;
    lf_render_report r = example();
    assert_int_equal(lf_render_report_write(&r, "/nonexistent/a.json", NULL), LF_BAD_INPUT);
    lf_render_report_clear(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(means),
        cmocka_unit_test(scenes_are_told_apart_by_number),
        cmocka_unit_test_setup_teardown(report_has_its_keys, set_up, tear_down),
        cmocka_unit_test(table_is_printed),
        cmocka_unit_test(bad_folder_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
