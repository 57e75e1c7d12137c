/* test_speed_error.c: fronts and recommendations, the settings of a config, views that are left
 * out, files of raw results, and the report of all that. */
#include <unistd.h>

#include "autograd/random.h"
#include "datasets/image.h"
#include "eval/pareto.h"
#include "eval/raw_results.h"
#include "eval/some_views.h"
#include "eval/speed_report.h"
#include "tests/close.h"

/* ---- fronts ------------------------------------------------------------------------------------
 */

static void the_front_is_what_nothing_dominates(void **state)
{
    (void)state;
    /* 1 is dominated by 0, 3 by 2 in cost alone; 4 equals 2; 5 and 6 are no points */
    const double cost[] = {1, 2, 3, 4, 3, NAN, 0.5}, error[] = {5, 6, 1, 1, 1, 0, NAN};
    const bool wanted[] = {true, false, true, false, true, false, false};
    bool on[7];
    lf_pareto_front(7, cost, error, on);
    for (int i = 0; i < 7; i++)
        if (on[i] != wanted[i])
            fail_msg("point %d: %d", i, on[i]);
    lf_pareto_front(0, cost, error, on);
    lf_pareto_front(1, cost, error, on);
    assert_true(on[0]);
}

/* Any point is on the front or dominated by one that is. */
static void the_front_dominates_the_rest(void **state)
{
    (void)state;
    enum { N = 200 };
    double cost[N], error[N];
    bool on[N];
    lf_stream s = lf_stream_at(1, LF_RANDOM_GROUP, 0, 0);
    for (int i = 0; i < N; i++) {
        cost[i] = (double)lf_index(&s, 40);
        error[i] = (double)lf_index(&s, 40);
    }
    lf_pareto_front(N, cost, error, on);
    for (int i = 0; i < N; i++) {
        bool below = false;
        for (int j = 0; j < N; j++) {
            const bool dominates = cost[j] <= cost[i] && error[j] <= error[i] &&
                                   cost[j] + error[j] < cost[i] + error[i];
            assert_false(on[i] && dominates);
            below |= on[j] && dominates;
        }
        assert_true(on[i] || below);
    }
}

static void the_fastest_good_one_is_chosen(void **state)
{
    (void)state;
    const double cost[] = {10, 4, 2, 2, 1, NAN}, quality[] = {30, 29.96, 29.95, 29.97, 29.9, 30};
    assert_int_equal(lf_pareto_choose(6, cost, quality, 30, 0.0501), 3); /* 2 ties, worse */
    assert_int_equal(lf_pareto_choose(6, cost, quality, 30, 0.2), 4);
    assert_int_equal(lf_pareto_choose(6, cost, quality, 30, 0), 0);
    assert_int_equal(lf_pareto_choose(6, cost, quality, 31, 0.5), -1);
    const double nothing[] = {NAN};
    assert_int_equal(lf_pareto_choose(1, cost, nothing, 30, 100), -1);
}

/* ---- settings ----------------------------------------------------------------------------------
 */

static lf_config *config(const char *const *set)
{
    lf_config *cfg;
    lf_error err = {""};
    if (lf_config_load(NULL, &cfg, &err) != LF_OK)
        fail_msg("%s", err.text);
    for (; *set; set++)
        if (lf_config_set(cfg, *set, &err) != LF_OK)
            fail_msg("%s", err.text);
    if (lf_config_check(cfg, &err) != LF_OK)
        fail_msg("%s", err.text);
    return cfg;
}

/* Every setting changes the config in keys that it knows, to another allowed one. */
static void check_settings(const lf_config *cfg, const lf_speed_setting *s, long count)
{
    for (long i = 0; i < count; i++) {
        lf_error err = {""};
        lf_config *changed;
        char *text = lf_config_text(cfg);
        assert_int_equal(lf_config_parse_text(text, "test", &changed, &err), LF_OK);
        for (int k = 0; k < s[i].keys; k++)
            if (lf_config_set(changed, s[i].key[k], &err) != LF_OK)
                fail_msg("%s: %s", s[i].name, err.text);
        if (lf_config_check(changed, &err) != LF_OK)
            fail_msg("%s: %s", s[i].name, err.text);
        char *after = lf_config_text(changed);
        if (i >= LF_SPEED_FIRST && !s[i].f64 && strcmp(text, after) == 0)
            fail_msg("%s changes nothing", s[i].name);
        for (long j = 0; j < i; j++)
            assert_string_not_equal(s[i].name, s[j].name);
        free(text);
        free(after);
        lf_config_free(changed);
    }
    assert_true(s[LF_SPEED_EXACT].f64);
    assert_int_equal(s[LF_SPEED_CONFIG].keys, 0);
    assert_false(s[LF_SPEED_CONFIG].f64);
}

static const lf_speed_setting *named(const lf_speed_setting *s, long count, const char *name)
{
    for (long i = 0; i < count; i++)
        if (strcmp(s[i].name, name) == 0)
            return &s[i];
    return NULL;
}

static void expect_key(const lf_speed_setting *s, long count, const char *name, const char *key)
{
    const lf_speed_setting *found = named(s, count, name);
    if (!found)
        fail_msg("no setting '%s'", name);
    for (int i = 0; i < found->keys; i++)
        if (strcmp(found->key[i], key) == 0)
            return;
    fail_msg("'%s' does not set %s", name, key);
}

static void reconstruction_has_its_savings(void **state)
{
    (void)state;
    long n;
    lf_config *cfg = config((const char *[]){"data.image_size=97", NULL});
    lf_speed_setting *s = lf_speed_settings(cfg, &n);
    check_settings(cfg, s, n);
    expect_key(s, n, s[LF_SPEED_EXACT].name, "eval.coarse=128");
    expect_key(s, n, "dense grid", "eval.coarse=128");
    expect_key(s, n, "coarse grid 8", "eval.coarse=8");
    expect_key(s, n, "grid of 32 cells an edge", "eval.resolution=32");
    expect_key(s, n, "slope 2 trusted", "eval.lipschitz=2");
    assert_null(named(s, n, "slope 1 trusted"));
    expect_key(s, n, "1 source view", "eval.sources=1");
    expect_key(s, n, "4 source views", "eval.sources=4");
    expect_key(s, n, "views of 65 pixels", "data.image_size=65");
    expect_key(s, n, "views of 33 pixels", "data.image_size=33");
    assert_true(named(s, n, "in double")->f64);
    assert_null(named(s, n, "exact savings only")); /* the config has them */
    assert_null(named(s, n, "8 source views"));
    free(s);
    lf_config_free(cfg);
    cfg = config((const char *[]){"data.image_size=33", "eval.sources=2", "eval.coarse=128", NULL});
    s = lf_speed_settings(cfg, &n);
    check_settings(cfg, s, n);
    expect_key(s, n, "exact savings only", "eval.coarse=32");
    expect_key(s, n, "exact savings only", "eval.sources=0");
    expect_key(s, n, "grid of 32 cells an edge", "eval.coarse=32");
    expect_key(s, n, "views of 17 pixels", "data.image_size=17");
    assert_null(named(s, n, "2 source views"));
    free(s);
    lf_config_free(cfg);
    /* each is allowed, but no grid of 64 cells begins with one of 128 */
    cfg = config((const char *[]){"eval.resolution=128", "eval.coarse=32", NULL});
    s = lf_speed_settings(cfg, &n);
    const lf_speed_setting *half = named(s, n, "grid of 64 cells an edge");
    const lf_speed_setting both = lf_speed_join(half, named(s, n, "dense grid"));
    const lf_speed_setting other = lf_speed_join(half, named(s, n, "coarse grid 16"));
    assert_true(lf_speed_allowed(cfg, half));
    assert_false(lf_speed_allowed(cfg, &both));
    assert_true(lf_speed_allowed(cfg, &other));
    free(s);
    lf_config_free(cfg);
    /* three stages of stride 2 after a pooled stem: 17 pixels are too few and are not offered */
    cfg = config((const char *[]){"data.image_size=33", "model.stem_pool=true", NULL});
    s = lf_speed_settings(cfg, &n);
    check_settings(cfg, s, n);
    assert_null(named(s, n, "views of 17 pixels"));
    free(s);
    lf_config_free(cfg);
}

static void rendering_has_its_savings(void **state)
{
    (void)state;
    long n;
    lf_config *cfg =
        config((const char *[]){"model.type=renderer", "data.builtin_scenes=1", "render.samples=24",
                                "train.seen_samples=8", "eval.sources=6", "eval.stop=0.02", NULL});
    lf_speed_setting *s = lf_speed_settings(cfg, &n);
    check_settings(cfg, s, n);
    expect_key(s, n, s[LF_SPEED_EXACT].name, "eval.skip_unseen=false");
    expect_key(s, n, s[LF_SPEED_EXACT].name, "eval.stop=0");
    expect_key(s, n, "exact savings only", "eval.skip_unseen=true");
    expect_key(s, n, "6 samples", "render.samples=6");
    expect_key(s, n, "6 samples", "train.seen_samples=5"); /* the config's is 8 */
    expect_key(s, n, "48 samples", "render.samples=48");
    expect_key(s, n, "4 source views", "eval.sources=4");
    expect_key(s, n, "skip_outside on", "eval.skip_outside=true");
    expect_key(s, n, "skip_unseen off", "eval.skip_unseen=false");
    expect_key(s, n, "pictures at 1/2", "eval.shrink=2");
    assert_null(named(s, n, "stop off")); /* there are no fine samples */
    free(s);
    lf_config_free(cfg);
    cfg = config((const char *[]){"model.type=ibrnet", "data.builtin_scenes=1",
                                  "render.fine_samples=8", "eval.stop=0.02", NULL});
    s = lf_speed_settings(cfg, &n);
    check_settings(cfg, s, n);
    expect_key(s, n, "stop off", "eval.stop=0");
    expect_key(s, n, "stop 0.002", "eval.stop=0.002");
    expect_key(s, n, "empty 0.02", "eval.empty=0.02");
    expect_key(s, n, "12 + 4 samples", "render.fine_samples=4");
    assert_null(named(s, n, "stop 0.02"));
    assert_null(named(s, n, "skip_unseen off"));
    assert_null(named(s, n, "exact savings only"));
    const lf_speed_setting both =
        lf_speed_join(named(s, n, "stop 0.002"), named(s, n, "12 + 4 samples"));
    expect_key(&both, 1, "stop 0.002 + 12 + 4 samples", "eval.stop=0.002");
    expect_key(&both, 1, "stop 0.002 + 12 + 4 samples", "render.fine_samples=4");
    free(s);
    lf_config_free(cfg);
}

/* ---- views -------------------------------------------------------------------------------------
 */

static void fewer_views_are_kept_packed(void **state)
{
    (void)state;
    enum { POINTS = 5 };
    for (int count = 1; count <= LF_CUBE_VIEWS; count++) {
        int view[LF_CUBE_VIEWS];
        lf_some_views(count, view);
        lf_projection p = lf_projection_create(POINTS);
        for (int i = 0; i < POINTS * LF_CUBE_VIEWS; i++) {
            p.uv[2 * i] = p.distance[i] = i;
            p.uv[2 * i + 1] = p.direction[3 * i + 2] = p.bearing[3 * i] = -i;
            p.mask[i] = (uint8_t)i;
        }
        lf_keep_views(&p, POINTS, count, view);
        for (int q = 0; q < POINTS; q++)
            for (int k = 0; k < count; k++) {
                const int from = q * LF_CUBE_VIEWS + view[k], to = q * count + k;
                assert_true(k == 0 || view[k] > view[k - 1]);
                assert_true(p.uv[2 * to] == from && p.uv[2 * to + 1] == -from);
                assert_true(p.distance[to] == from && p.direction[3 * to + 2] == -from);
                assert_true(p.bearing[3 * to] == -from);
                assert_int_equal(p.mask[to], from);
            }
        lf_projection_free(&p);
    }
    int view[LF_CUBE_VIEWS];
    lf_some_views(2, view);
    assert_int_equal(view[0] ^ view[1], 7); /* opposite corners */
}

/* ---- files -------------------------------------------------------------------------------------
 */

static void raw_results_come_back(void **state)
{
    (void)state;
    char path[] = "/tmp/lf_raw_XXXXXX";
    lf_error err = {""};
    close(mkstemp(path));
    lf_raw *raw = lf_raw_create(2), *back;
    double number[] = {1, NAN, 1e-300};
    snprintf(raw->precision, sizeof raw->precision, "f64");
    raw->item[0] =
        (lf_raw_item){.seconds = 0.5, .cpu_seconds = 1, .before_mb = 7, .peak_mb = 8, .work = 9};
    raw->item[1].numbers = 3;
    raw->item[1].number = malloc(sizeof number);
    memcpy(raw->item[1].number, number, sizeof number);
    raw->item[1].mesh = lf_mesh_create(3, 1);
    raw->item[1].mesh->vertex[2][1] = 0.1;
    raw->item[1].mesh->face[0][1] = 1;
    raw->item[1].mesh->face[0][2] = 2;
    assert_int_equal(lf_raw_write(path, raw, &err), LF_OK);
    assert_int_equal(lf_raw_read(path, &back, &err), LF_OK);
    assert_string_equal(back->precision, "f64");
    assert_false(back->whole_process);
    assert_int_equal(back->items, 2);
    assert_true(back->item[0].seconds == 0.5 && back->item[0].cpu_seconds == 1 &&
                back->item[0].before_mb == 7);
    assert_true(back->item[0].peak_mb == 8 && back->item[0].work == 9);
    assert_null(back->item[0].mesh);
    assert_int_equal(back->item[0].numbers, 0);
    assert_memory_equal(back->item[1].number, number, sizeof number);
    assert_true(back->item[1].mesh->vertex[2][1] == 0.1);
    assert_int_equal(back->item[1].mesh->face[0][2], 2);
    lf_raw_free(back);
    raw->item[1].mesh->face[0][2] = 3; /* no such vertex */
    assert_int_equal(lf_raw_write(path, raw, &err), LF_OK);
    assert_int_equal(lf_raw_read(path, &back, &err), LF_BAD_INPUT);
    lf_raw_free(raw);
    unlink(path);
    assert_int_equal(lf_raw_read(path, &back, &err), LF_BAD_INPUT);
}

static lf_speed_report example(void)
{
    static const char *const set[] = {"data.root=my meshes"};
    static const char *const item[] = {"one", "caf\xe9"};
    static const double seconds[] = {8, 4, 1, 2}, error[] = {0, 1e-7, 0.2, 1e-3},
                        metric[] = {0.7, 0.7, 0.5, 0.699}, memory[] = {80, 40, 40, 50};
    static const char *const name[] = {"exact", "as configured", "1 view", "4 views"};
    lf_speed_report r = {.model = "equivariant",
                         .split = "test",
                         .checkpoint = "runs/it's",
                         .sets = 1,
                         .set = set,
                         .items = 2,
                         .item = item,
                         .repeats = 3,
                         .threads = 2,
                         .tolerance = lf_speed_tolerance(false)};
    for (int i = 0; i < 4; i++) {
        lf_speed_setting s = {.saving = "views", .f64 = i == 0, .keys = i > 1};
        snprintf(s.name, sizeof s.name, "%s", name[i]);
        snprintf(s.key[0], sizeof s.key[0], "eval.sources=%d", i == 2 ? 1 : 4);
        lf_speed_report_add(&r, &s)->figures = (lf_speed_figures){.seconds = seconds[i],
                                                                  .error = error[i],
                                                                  .metric = metric[i],
                                                                  .memory_mb = memory[i],
                                                                  .chamfer = 0.01};
    }
    lf_speed_report_finish(&r);
    return r;
}

static void the_report_recommends(void **state)
{
    (void)state;
    lf_speed_report r = example();
    assert_int_equal(r.recommended, 3);
    assert_true(lf_speed_good(&r, &r.row[3]) && !lf_speed_good(&r, &r.row[2]));
    const bool seconds_error[] = {false, true, true, true},
               memory_error[] = {false, true, false, false};
    for (int i = 0; i < 4; i++) {
        assert_int_equal(r.row[i].front[LF_SECONDS_ERROR], seconds_error[i]);
        assert_int_equal(r.row[i].front[LF_MEMORY_ERROR], memory_error[i]);
    }
    char *command = lf_speed_command(&r, &r.row[3]);
    assert_string_equal(command,
                        "elf-eval --checkpoint 'runs/it'\\''s' --set 'data.root=my meshes' "
                        "--set eval.sources=4");
    free(command);
    command = lf_speed_command(&r, &r.row[0]);
    assert_non_null(strstr(command, "elf-eval-f64 "));
    free(command);
    lf_speed_report_clear(&r);
}

static void the_report_is_json(void **state)
{
    (void)state;
    lf_speed_report r = example();
    json_t *json = lf_speed_report_json(&r);
    assert_non_null(json);
    const json_t *rows = json_object_get(json, "settings");
    assert_int_equal(json_array_size(rows), 4);
    const json_t *row = json_array_get(rows, 3), *chosen = json_object_get(json, "recommended");
    assert_close(json_number_value(json_object_get(row, "error")), 1e-3, 1e-12, 0);
    assert_close(json_number_value(json_object_get(row, "chamfer_l1")), 0.1, 1e-12, 0);
    assert_true(json_is_true(json_object_get(json_object_get(row, "front"), "seconds_error")));
    assert_int_equal(json_integer_value(json_object_get(chosen, "number")), 3);
    assert_close(json_number_value(json_object_get(chosen, "faster")), 2, 1e-12, 0);
    assert_true(json_is_null(json_object_get(json, "eval_setting")));
    json_decref(json);
    lf_speed_report_clear(&r);
}

static void the_report_is_a_picture(void **state)
{
    (void)state;
    char folder[] = "/tmp/lf_speed_XXXXXX", path[64];
    lf_error err = {""};
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/a.png", folder);
    lf_speed_report r = example();
    for (int i = 0; i < 4; i++) /* all alike: an axis without extent */
        r.row[i].figures = r.row[0].figures;
    if (lf_speed_report_plot(&r, path, &err) != LF_OK)
        fail_msg("%s", err.text);
    lf_speed_report_clear(&r);
    r = example();
    if (lf_speed_report_plot(&r, path, &err) != LF_OK)
        fail_msg("%s", err.text);
    int width, height, channels;
    assert_int_equal(lf_image_read_size(path, &width, &height, &channels, &err), LF_OK);
    assert_true(width == 1280 && height > 840);
    lf_speed_report_clear(&r);
    unlink(path);
    rmdir(folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_front_is_what_nothing_dominates),
        cmocka_unit_test(the_front_dominates_the_rest),
        cmocka_unit_test(the_fastest_good_one_is_chosen),
        cmocka_unit_test(reconstruction_has_its_savings),
        cmocka_unit_test(rendering_has_its_savings),
        cmocka_unit_test(fewer_views_are_kept_packed),
        cmocka_unit_test(raw_results_come_back),
        cmocka_unit_test(the_report_recommends),
        cmocka_unit_test(the_report_is_json),
        cmocka_unit_test(the_report_is_a_picture),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
