/* test_profile_report.c: which steps a profile reports, and what its tables and its JSON say of
 * them.                                                              [train/profile_report.h] */
#include <jansson.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "autograd/ops.h"
#include "tests/close.h"
#include "tests/folder.h"
#include "train/profile_report.h"

enum { STEPS = 5, ROWS = 1000, IN = 3, OUT = 4 };

/* One linear map without gradients in a scope, and a ReLU; the step took so many ms. */
static lf_measured_step measured(double ms)
{
    static lf_real x[ROWS * IN], w[IN * OUT];
    lf_measured_step s = {{1e-3, 1e-3 * (ms - 3), 2e-3, 1e-3 * ms}, lf_profile_create()};
    lf_tape *tape = lf_tape_create();
    lf_profile_watch(s.profile, tape, 0);
    lf_scope(tape, "map");
    lf_tensor *a = lf_leaf(tape, 2, LF_DIMS(ROWS, IN), x, NULL);
    a = lf_linear(tape, a, lf_leaf(tape, 2, LF_DIMS(IN, OUT), w, NULL), NULL, LF_IDENTITY);
    lf_scope_end(tape);
    lf_scope(tape, "other");
    lf_relu(tape, a);
    lf_scope_end(tape);
    lf_tape_free(tape);
    return s;
}

/* The fastest two of five steps. */
static lf_step_profile chosen(lf_measured_step step[STEPS])
{
    static const double ms[STEPS] = {50, 20, 40, 10, 30};
    lf_step_profile p = {.model = "equivariant",
                         .warm_up = 1,
                         .all = STEPS,
                         .threads = 2,
                         .limit = 1e9,
                         .tapes = 3000000,
                         .rss_mb = 20};
    for (int i = 0; i < STEPS; i++)
        step[i] = measured(ms[i]);
    lf_step_profile_choose(&p, step);
    return p;
}

static void free_steps(lf_measured_step step[STEPS])
{
    for (int i = 0; i < STEPS; i++)
        lf_profile_free(step[i].profile);
}

static void test_choice(void **state)
{
    (void)state;
    lf_measured_step step[STEPS];
    lf_profile_row *row;
    const lf_step_profile p = chosen(step);
    assert_int_equal(p.steps, 2);
    assert_close(p.fastest, 10e-3, 1e-12, 0);
    assert_close(p.mean, 30e-3, 1e-12, 0);
    assert_close(p.sum.all, 30e-3, 1e-12, 0);
    assert_close(p.sum.compute, 24e-3, 1e-12, 0);
    const int count = lf_profile_rows(p.profile, LF_BY_SCOPE, &row);
    assert_int_equal(count, 2);
    assert_int_equal(row[0].calls, 2);
    assert_true(row[0].products[0] == 2.0 * ROWS * IN * OUT);
    free(row);
    free_steps(step);
}

static void test_tables(void **state)
{
    (void)state;
    lf_measured_step step[STEPS];
    const lf_step_profile p = chosen(step);
    char *text;
    size_t size;
    FILE *out = open_memstream(&text, &size);
    assert_non_null(out);
    lf_step_profile_print(out, &p);
    fclose(out);
    assert_non_null(strstr(text, "the fastest 2 of 5 steps: 15.00 ms a step (mean of all 30.00)"));
    assert_non_null(strstr(text, "\nmap  "));
    assert_non_null(strstr(text, "\nlinear  "));
    assert_non_null(strstr(text, "\nupdate of parameters                2.000 "));
    assert_non_null(strstr(text, "3.0 MB of tapes and lanes at their largest, 20 MB largest"));
    free(text);
    free_steps(step);
}

static double number(const json_t *o, const char *key)
{
    return json_number_value(json_object_get(o, key));
}

static void test_json(void **state)
{
    (void)state;
    char folder[] = "/tmp/elf-profile-XXXXXX", path[256];
    lf_measured_step step[STEPS];
    lf_error err = {""};
    const lf_step_profile p = chosen(step);
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/p.json", folder);
    assert_int_equal(lf_step_profile_write(path, &p, &err), LF_OK);
    json_t *o = json_load_file(path, 0, NULL), *s = json_object_get(o, "step");
    assert_close(number(s, "ms"), 15, 1e-9, 0);
    assert_close(number(s, "data_ms"), 1, 1e-9, 0);
    assert_close(number(s, "update_ms"), 2, 1e-9, 0);
    const double gflop = 2e-9 * ROWS * IN * OUT;
    assert_close(number(s, "gflop"), gflop, 1e-9, 0);
    assert_close(number(s, "limit_share"), gflop / 15e-3, 1e-9, 0);
    const json_t *map = json_array_get(json_object_get(o, "parts"), 0);
    assert_string_equal(json_string_value(json_object_get(map, "part")), "map");
    assert_close(number(map, "calls"), 1, 1e-12, 0);
    const json_t *other = json_array_get(json_object_get(o, "parts"), 1);
    assert_true(json_is_null(json_object_get(other, "gflop"))); /* a ReLU has no formula */
    assert_close(number(other, "uncounted_calls"), 1, 1e-12, 0);
    json_decref(o);
    snprintf(path, sizeof path, "%s/nowhere/p.json", folder);
    assert_int_equal(lf_step_profile_write(path, &p, &err), LF_BAD_INPUT);
    free_steps(step);
    assert_int_equal(remove_tree(folder), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_choice),
        cmocka_unit_test(test_tables),
        cmocka_unit_test(test_json),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
