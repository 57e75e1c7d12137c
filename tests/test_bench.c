/* test_bench.c: what elf-bench makes of what it measures: the roofline, errors against double and
 * their way through a pipe, JSON, the picture. No time is measured. */
#include "tests/scene_fixture.h"

#include "bench/growth.h"
#include "bench/picture.h"
#include "bench/report.h"

/* ---- the roofline ---------------------------------------------------------------------------- */

static void roofline(void **state)
{
    (void)state;
    const double fma = 100e9, bandwidth = 10e9; /* the ridge is at 10 flops a byte */
    lf_roof r = lf_roof_of(40e9, 2e9, fma, bandwidth);
    assert_false(r.memory);
    assert_close(r.seconds, 0.4, 1e-12, 0);
    r = lf_roof_of(40e9, 8e9, fma, bandwidth);
    assert_true(r.memory);
    assert_close(r.seconds, 0.8, 1e-12, 0);
    r = lf_roof_of(0, 5e9, fma, bandwidth); /* what is not counted binds nothing */
    assert_true(r.memory);
    assert_close(r.seconds, 0.5, 1e-12, 0);
    r = lf_roof_of(50e9, 0, fma, bandwidth);
    assert_false(r.memory);
    assert_close(r.seconds, 0.5, 1e-12, 0);
    r = lf_roof_of(50e9, 50e9, fma, 0);
    assert_close(r.seconds, 0.5, 1e-12, 0);
    assert_true(lf_roof_of(0, 0, fma, bandwidth).seconds == 0);
}

static void shares(void **state)
{
    (void)state;
    bool memory;
    lf_bench_result r = {.seconds = 1, .flop = 40e9, .bytes = 8e9, .fma = 100e9, .bandwidth = 10e9};
    assert_close(lf_bench_share(&r, &memory), 0.8, 1e-12, 0);
    assert_true(memory);
    r.bytes = 1e9;
    assert_close(lf_bench_share(&r, &memory), 0.4, 1e-12, 0);
    assert_false(memory);
    r.flop = r.bytes = 0;
    assert_true(isnan(lf_bench_share(&r, &memory)));
}

static void footprints(void **state)
{
    (void)state;
    assert_int_equal(lf_foot_of(0), 0);
    assert_int_equal(lf_foot_of(1 << LF_FOOT_FIRST), 0);
    assert_int_equal(lf_foot_of(1.4 * (1 << 20)), 20 - LF_FOOT_FIRST); /* the nearest power of 2 */
    assert_int_equal(lf_foot_of(1.5 * (1 << 20)), 21 - LF_FOOT_FIRST);
    assert_int_equal(lf_foot_of(1e12), LF_FOOTS - 1);
}

/* Bytes of a stream are those of its arrays, the numbers those of its definition. */
static void streams(void **state)
{
    (void)state;
    const long count = 3 * 4096;
    lf_real *x = lf_bench_room(count, sizeof *x);
    for (int threads = 1; threads <= 3; threads++)
        for (int kind = 0; kind < LF_STREAMS; kind++) {
            const long bytes = count * (long)sizeof *x;
            const double moved = lf_bench_stream_run((lf_bench_stream)kind, x, bytes, 2, threads);
            assert_true(moved <= 2.0 * (double)bytes && moved > 1.8 * (double)bytes);
        }
    lf_bench_fill(count, x, -1, 1, 5);
    const lf_real b = x[4096], c = x[8192];
    lf_bench_stream_run(LF_STREAM_TRIAD, x, count * (long)sizeof *x, 1, 1);
    assert_close((double)x[0], (double)(b + c / 2), 1e-6, 1e-7);
    free(x);
}

/* ---- outputs --------------------------------------------------------------------------------- */

static lf_outputs *example(double shift)
{
    const double y[3] = {1 + shift, -4, 2}, loss = 0.25;
    lf_outputs *o = lf_outputs_create();
    lf_outputs_add_doubles(o, "y", 3, y);
    lf_outputs_add_doubles(o, "loss", 1, &loss);
    lf_outputs_add_doubles(o, "empty", 0, y);
    return o;
}

static void errors_by_definition(void **state)
{
    (void)state;
    lf_outputs *got = example(0.5), *exact = example(0);
    lf_output_error e[LF_OUTPUTS_MAX];
    assert_int_equal(lf_outputs_compare(got, exact, e, NULL), LF_OK);
    assert_string_equal(e[0].name, "y");
    assert_close(e[0].largest, 0.5 / 4, 1e-15, 0);
    assert_close(e[0].l2, 0.5 / sqrt(21), 1e-15, 0);
    assert_true(e[1].largest == 0 && e[1].l2 == 0 && e[2].largest == 0);
    lf_bench_result r = {.outputs = 3};
    memcpy(r.error, e, sizeof e);
    assert_string_equal(lf_bench_worst(&r)->name, "y");
    r.outputs = 0;
    assert_null(lf_bench_worst(&r));
    lf_outputs_free(got);
    lf_outputs_free(exact);
}

static void refuse(const lf_outputs *got, const lf_outputs *exact, const char *word)
{
    lf_error err = {""};
    lf_output_error e[LF_OUTPUTS_MAX];
    assert_int_equal(lf_outputs_compare(got, exact, e, &err), LF_FAILED);
    if (!strstr(err.text, word))
        fail_msg("\"%s\" does not say %s", err.text, word);
}

/* What cannot be compared gives no number. */
static void no_errors_of_unlike_outputs(void **state)
{
    (void)state;
    lf_outputs *got = example(0), *exact = example(0);
    got->array[0].value[1] = NAN;
    refuse(got, exact, "y: number 1 is nan");
    got->array[0].value[1] = INFINITY;
    refuse(got, exact, "inf");
    got->array[0].value[1] = 1;
    memset(exact->array[0].value, 0, 3 * sizeof(double));
    refuse(got, exact, "zeros alone");
    got->array[0].count = 2;
    refuse(got, exact, "y of 2 numbers, in double y of 3");
    got->array[0].count = 3;
    exact->array[1].name[0] = 'm';
    memcpy(exact->array[0].value, got->array[0].value, 3 * sizeof(double));
    refuse(got, exact, "loss");
    exact->count = 1;
    refuse(got, exact, "3 outputs, in double 1");
    exact->count = 3;
    lf_outputs_free(got);
    lf_outputs_free(exact);
}

static lf_status read_file(const char *path, lf_outputs **out)
{
    FILE *file = fopen(path, "r");
    assert_non_null(file);
    const lf_status status = lf_outputs_read(file, path, out, NULL);
    fclose(file);
    return status;
}

static void outputs_through_a_file(void **state)
{
    char path[512];
    place(state, "o", path);
    lf_outputs *o = example(0), *back = NULL;
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    assert_int_equal(lf_outputs_write(o, file, path, NULL), LF_OK);
    long size = ftell(file);
    fclose(file);
    assert_int_equal(read_file(path, &back), LF_OK);
    assert_int_equal(back->count, 3);
    for (int i = 0; i < 3; i++) {
        assert_string_equal(back->array[i].name, o->array[i].name);
        assert_int_equal(back->array[i].count, o->array[i].count);
        assert_memory_equal(back->array[i].value, o->array[i].value,
                            (size_t)o->array[i].count * sizeof(double));
    }
    lf_outputs_free(back);
    while (size-- > 0) { /* whatever is cut off is missed */
        back = NULL;
        assert_int_equal(truncate(path, size), 0);
        assert_int_equal(read_file(path, &back), LF_FAILED);
        assert_null(back);
    }
    lf_outputs_free(o);
}

static void inputs_are_floats(void **state)
{
    (void)state;
    double x[2] = {0.1, 0.5};
    lf_reference_round_doubles(2, x);
    assert_true(x[0] == (double)0.1f && x[1] == 0.5);
    assert_true((double)lf_reference_input(0.1) == (double)0.1f);
    lf_error err = {""};
    char path[64];
    assert_int_equal(lf_reference_find("no-such-program", path, sizeof path, &err), LF_FAILED);
    assert_non_null(strstr(err.text, "no-such-program"));
    assert_int_equal(lf_reference_find("no-such-program", path, 4, &err), LF_FAILED);
}

/* ---- reports --------------------------------------------------------------------------------- */

enum { CASES = 4 };
static const lf_bench_case names[CASES] = {
    {.name = "fast", .what = "a kernel"},
    {.name = "slow", .what = "a step"},
    {.name = "copy", .what = "a limit"},
    {.name = "lost", .what = "a kernel without its double"},
};

static void fill(lf_bench_result r[CASES], lf_seen_limits *seen)
{
    r[0] = (lf_bench_result){&names[0], "kernels", .seconds = 1e-3, .flop = 4e8, .bytes = 1e7};
    r[1] = (lf_bench_result){&names[1], "steps", .seconds = 0.1, .flop = 2e9, .bytes = 2e9};
    r[2] = (lf_bench_result){&names[2], "limits", .seconds = 0.01, .bytes = 3e8};
    r[3] = (lf_bench_result){&names[3], "kernels", .seconds = 2e-3, .problem = "no double"};
    r[0].outputs = 2;
    r[0].error[0] = (lf_output_error){"y", 3e-7, 1e-7};
    r[0].error[1] = (lf_output_error){"dw", 5e-7, 2e-7};
    r[1].outputs = 1;
    r[1].error[0] = (lf_output_error){"loss", 2e-5, 2e-5};
    r[1].resident = 3e8;
    r[1].base = 1e8;
    for (int i = 0; i < CASES; i++) {
        r[i].fma = 500e9;
        r[i].bandwidth = 30e9;
    }
    *seen = (lf_seen_limits){.fma = 500e9};
    const int feet[] = {lf_foot_of(LF_BYTES_OF_MEMORY), lf_foot_of(LF_BYTES_OF_CACHES)};
    for (int k = 0; k < 2; k++) {
        seen->samples[feet[k]] = 1;
        seen->bandwidth[feet[k]] = k ? 200e9 : 30e9;
    }
}

static double number(const json_t *object, const char *key)
{
    const json_t *value = json_object_get(object, key);
    if (!json_is_number(value))
        fail_msg("%s is no number", key);
    return json_number_value(value);
}

static void json_says_what_is_known(void **state)
{
    char path[512];
    place(state, "b.json", path);
    lf_bench_result r[CASES];
    lf_seen_limits seen;
    fill(r, &seen);
    json_t *made = lf_bench_json(r, CASES, &seen, 2);
    assert_int_equal(lf_bench_json_write(path, made, NULL), LF_OK);
    json_decref(made);
    json_t *all = json_load_file(path, 0, NULL);
    assert_non_null(all);
    const json_t *limits = json_object_get(all, "limits"), *list = json_object_get(all, "results");
    assert_string_equal(json_string_value(json_object_get(all, "precision")), "f32");
    assert_close(number(all, "threads"), 2, 0, 0);
    assert_close(number(limits, "gflops"), 500, 1e-6, 0);
    assert_close(number(json_object_get(limits, "gbytes_per_s"), "268435456"), 30, 1e-6, 0);
    assert_int_equal(json_object_size(json_object_get(limits, "gbytes_per_s")), 2);
    assert_int_equal(json_array_size(list), CASES);
    const json_t *fast = json_array_get(list, 0), *slow = json_array_get(list, 1);
    const json_t *copy = json_array_get(list, 2), *lost = json_array_get(list, 3);
    assert_string_equal(json_string_value(json_object_get(fast, "case")), "fast");
    assert_close(number(fast, "gflops"), 400, 1e-6, 0);
    assert_close(number(fast, "flop_per_byte"), 40, 1e-6, 0);
    assert_close(number(fast, "share"), 0.8, 1e-6, 0);
    assert_close(number(fast, "error"), 5e-7, 1e-6, 0);
    assert_close(number(fast, "error_l2"), 2e-7, 1e-6, 0);
    assert_close(number(json_object_get(json_object_get(fast, "errors"), "y"), "largest"), 3e-7,
                 1e-6, 0);
    assert_null(json_object_get(fast, "resident_mb"));
    assert_string_equal(json_string_value(json_object_get(slow, "bound")), "memory");
    assert_close(number(slow, "resident_mb"), 200, 1e-6, 0);
    assert_null(json_object_get(copy, "gflops"));
    assert_true(json_is_null(json_object_get(copy, "error")));
    assert_null(json_object_get(copy, "error_missing"));
    assert_true(json_is_null(json_object_get(lost, "error")));
    assert_string_equal(json_string_value(json_object_get(lost, "error_missing")), "no double");
    json_decref(all);
}

static void picture_has_both_panels(void **state)
{
    char path[512];
    place(state, "b.png", path);
    lf_bench_result r[CASES];
    lf_seen_limits seen;
    lf_error err = {""};
    fill(r, &seen);
    if (lf_bench_picture(path, r, CASES, &seen, &err) != LF_OK)
        fail_msg("%s", err.text);
    lf_image *image = NULL;
    assert_int_equal(lf_image_read(path, &image, &err), LF_OK);
    assert_true(image->width == LF_PICTURE_WIDTH && image->height == LF_PICTURE_HEIGHT);
    for (int half = 0; half < 2; half++) { /* curves and texts in each */
        long dark = 0;
        for (int y = half * image->height / 2; y < (half + 1) * image->height / 2; y++)
            for (int x = 0; x < image->width; x++)
                dark += lf_image_at(image, x, y)[1] < 0.5f;
        assert_true(dark > 3000);
    }
    lf_image_free(image);
}

/* Without errors the second panel says so; without operations there is no picture at all. */
static void picture_of_little(void **state)
{
    char path[512], none[512];
    place(state, "little.png", path);
    place(state, "none.png", none);
    lf_bench_result r[CASES];
    lf_seen_limits seen;
    lf_error err = {""};
    fill(r, &seen);
    r[0].outputs = 0;
    assert_int_equal(lf_bench_picture(path, r, 1, &seen, &err), LF_OK);
    assert_int_equal(access(path, F_OK), 0);
    assert_int_equal(lf_bench_picture(none, r + 2, 2, &seen, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "no case to draw"));
    assert_int_equal(lf_bench_picture(none, r, 2, &(lf_seen_limits){0}, &err), LF_BAD_INPUT);
    assert_int_not_equal(access(none, F_OK), 0);
}

/* As many cases as there are, all alike: every label finds a place, in time. */
static void crowded_picture(void **state)
{
    char path[512];
    place(state, "crowd.png", path);
    enum { MANY = 120 };
    lf_bench_result r[CASES], *many = lf_bench_room(MANY, sizeof *many);
    lf_seen_limits seen;
    fill(r, &seen);
    for (int i = 0; i < MANY; i++)
        many[i] = r[0];
    assert_int_equal(lf_bench_picture(path, many, MANY, &seen, NULL), LF_OK);
    free(many);
}

/* ---- growth ---------------------------------------------------------------------------------- */

/* y = 3 n^2 has the exponent 2 everywhere; of n + 96 the last one is near 0.4. */
static void exponents(void **state)
{
    (void)state;
    const double n[4] = {4, 8, 16, 64};
    double y[4];
    for (int i = 0; i < 4; i++)
        y[i] = 3 * n[i] * n[i];
    lf_growth_exponent p = lf_growth_exponent_of(4, n, y);
    assert_close(p.fit, 2, 1e-12, 0);
    assert_close(p.last, 2, 1e-12, 0);
    for (int i = 0; i < 4; i++)
        y[i] = n[i] + 96;
    p = lf_growth_exponent_of(4, n, y);
    assert_close(p.last, log(160.0 / 112) / log(4), 1e-12, 0);
    assert_true(p.fit > 0 && p.fit < p.last);
    p = lf_growth_exponent_of(2, n, y);
    assert_close(p.fit, p.last, 1e-12, 0);
}

static void growth_files(void **state)
{
    const lf_growth_row rows[] = {
        {"a", "step", "views", 3, 1, {1, 2, 4}, {1e-3, 2e-3, 4e-3}, {1e6, 4e6, 16e6}},
        {"a", "step", "width", 2, 0, {1, 2}, {2e-3, 8e-3}, {4e6, 4e6}},
        {"b", "row", "views", 2, 1, {1, 2}, {3e-3, 3e-3}, {1e6, 2e6}}};
    char path[512];
    place(state, "g.png", path);
    json_t *all = lf_growth_json(rows, 3, 2);
    const json_t *first = json_array_get(json_object_get(all, "rows"), 0);
    assert_string_equal(json_string_value(json_object_get(first, "quantity")), "views");
    assert_close(number(first, "base"), 2, 1e-12, 0);
    assert_close(json_real_value(json_array_get(json_object_get(first, "ms"), 2)), 4, 1e-12, 0);
    assert_close(number(json_object_get(first, "exponent_of_time"), "fit"), 1, 1e-9, 0);
    assert_close(number(json_object_get(first, "exponent_of_memory"), "last"), 2, 1e-9, 0);
    json_decref(all);
    lf_error err = {""};
    if (lf_growth_picture(path, rows, 3, &err) != LF_OK)
        fail_msg("%s", err.text);
    lf_image *image = NULL;
    assert_int_equal(lf_image_read(path, &image, &err), LF_OK);
    assert_true(image->width > image->height); /* two panels beside each other */
    lf_image_free(image);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(roofline),
        cmocka_unit_test(shares),
        cmocka_unit_test(footprints),
        cmocka_unit_test(streams),
        cmocka_unit_test(errors_by_definition),
        cmocka_unit_test(no_errors_of_unlike_outputs),
        cmocka_unit_test_setup_teardown(outputs_through_a_file, set_up, tear_down),
        cmocka_unit_test(inputs_are_floats),
        cmocka_unit_test_setup_teardown(json_says_what_is_known, set_up, tear_down),
        cmocka_unit_test_setup_teardown(picture_has_both_panels, set_up, tear_down),
        cmocka_unit_test_setup_teardown(picture_of_little, set_up, tear_down),
        cmocka_unit_test_setup_teardown(crowded_picture, set_up, tear_down),
        cmocka_unit_test(exponents),
        cmocka_unit_test_setup_teardown(growth_files, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
