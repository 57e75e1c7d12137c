/* test_render_trainer.c: small trainings of the renderers: the same bits stopped or not and on any
 * number of threads; what goes wrong stops with a message before anything is written. */
#include <jansson.h>
#include <omp.h>
#include <sys/stat.h>
#include <unistd.h>

#include "datasets/scene_make.h"
#include "tests/close.h"
#include "tests/folder.h"
#include "tests/same_arrays.h"
#include "train/run_dir.h"
#include "train/trainer.h"

static char folder[64];

static int make_folder(void **state)
{
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/elf-test-render-XXXXXX");
    return mkdtemp(folder) ? 0 : 1;
}

static int remove_folder(void **state)
{
    (void)state;
    return remove_tree(folder);
}

/* ---- a small training ---- */

#define SETS(...) ((const char *const[]){__VA_ARGS__, NULL})

static lf_config *tiny(const char *const *more)
{
    static const char *const sets[] = {
        "model.type=renderer", "data.builtin_scenes=2",  "data.scene_size=24",
        "data.val_shapes=2",   "render.sources=3",       "render.samples=8",
        "render.features=4",   "render.feature_width=4", "render.types=0, 2",
        "render.hidden=8",     "train.rays=12",          "train.steps=14",
        "train.warmup=2",      "train.log_every=2",      "train.checkpoint_every=4",
        "train.val_every=7",   "train.keep=10",          "data.bounds=file"};
    lf_config *cfg;
    lf_error err;
    assert_int_equal(lf_config_load(NULL, &cfg, &err), LF_OK);
    for (size_t i = 0; i < sizeof sets / sizeof *sets; i++)
        if (lf_config_set(cfg, sets[i], &err) != LF_OK)
            fail_msg("%s", err.text);
    for (; more && *more; more++)
        if (lf_config_set(cfg, *more, &err) != LF_OK)
            fail_msg("%s", err.text);
    if (lf_config_check(cfg, &err) != LF_OK)
        fail_msg("%s", err.text);
    return cfg;
}

static lf_status train(const char *name, const lf_config *cfg, lf_train_options options,
                       lf_error *err)
{
    char out[128];
    snprintf(out, sizeof out, "%s/%s", folder, name);
    options.out = out;
    options.quiet = true;
    return lf_train(cfg, &options, err);
}

static void train_well(const char *name, const char *const *sets, lf_train_options options)
{
    lf_config *cfg = tiny(sets);
    lf_error err = {""};
    if (train(name, cfg, options, &err) != LF_OK)
        fail_msg("%s: %s", name, err.text);
    lf_config_free(cfg);
}

static const char *checkpoint(const char *run, long step, char path[256])
{
    snprintf(path, 256, "%s/%s/checkpoints/step-%08ld.safetensors", folder, run, step);
    return path;
}

static bool same_end(const char *first, const char *second, long step, lf_error *text)
{
    char a[256], b[256];
    return !different_arrays(checkpoint(first, step, a), checkpoint(second, step, b), text);
}

static void assert_same_end(const char *first, const char *second, long step)
{
    lf_error text = {""};
    if (!same_end(first, second, step, &text))
        fail_msg("%s and %s: %s", first, second, text.text);
}

/* Go on from a checkpoint, in its run or (fresh) in another. */
static void resume(const char *run, long step, const char *name, bool fresh)
{
    char path[256];
    lf_config *cfg;
    lf_error err = {""};
    lf_train_options options = {.resume = checkpoint(run, step, path), .fresh = fresh};
    if (lf_checkpoint_config(path, &cfg, &options.start, &err) != LF_OK ||
        train(name, cfg, options, &err) != LF_OK)
        fail_msg("%s", err.text);
    lf_config_free(cfg);
}

enum { LINES = 128 };

/* Numbers of a key in metrics.jsonl, NAN where a line has none. */
static int metrics(const char *run, const char *key, double out[LINES])
{
    char path[256], text[4096];
    snprintf(path, sizeof path, "%s/%s/metrics.jsonl", folder, run);
    FILE *f = fopen(path, "r");
    int n = 0;
    assert_non_null(f);
    while (n < LINES && fgets(text, sizeof text, f)) {
        json_t *line = json_loads(text, 0, NULL);
        assert_non_null(line);
        const json_t *x = json_object_get(line, key);
        out[n++] = x ? json_number_value(x) : NAN;
        json_decref(line);
    }
    fclose(f);
    return n;
}

static void assert_same_metrics(const char *first, const char *second)
{
    static const char *const keys[] = {"step", "loss", "grad_norm", "val_loss", "val_psnr"};
    for (int k = 0; k < 5; k++) {
        double a[LINES], b[LINES];
        const int n = metrics(first, keys[k], a), m = metrics(second, keys[k], b);
        int numbers = 0;
        assert_int_equal(n, m);
        for (int i = 0; i < n; i++) {
            assert_true(a[i] == b[i] || (isnan(a[i]) && isnan(b[i])));
            numbers += !isnan(a[i]);
        }
        assert_true(numbers >= 2); /* validated at 7 and 14 */
    }
}

/* ---- the same bits ---- */

static const char *const both[] = {"model.type=renderer", "model.type=ibrnet"};
static const char *const plain[] = {"plain-0", "plain-1"};

static void plain_runs(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++)
        train_well(plain[i], SETS(both[i], "render.fine_samples=4"),
                   (lf_train_options){.check_finite = true});
    lf_error text;
    assert_false(same_end(plain[0], plain[1], 14, &text)); /* or the comparison sees nothing */
}

static void going_on_from_a_checkpoint_ends_the_same(void **state)
{
    (void)state;
    static const long steps[] = {4, 8, 12};
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++) {
            char name[32];
            snprintf(name, sizeof name, "from-%d-%ld", i, steps[k]);
            resume(plain[i], steps[k], name, true);
            assert_same_end(plain[i], name, 14);
        }
}

/* Stopped before its first step and gone on in place. */
static void stopped_and_resumed_ends_the_same(void **state)
{
    (void)state;
    volatile sig_atomic_t stop = 1;
    lf_config *cfg = tiny(SETS("render.fine_samples=4"));
    lf_error err = {""};
    assert_int_equal(train("stopped", cfg, (lf_train_options){.stop = &stop}, &err), LF_STOPPED);
    assert_non_null(strstr(err.text, "--resume"));
    lf_config_free(cfg);
    char out[128];
    lf_found found = {0};
    snprintf(out, sizeof out, "%s/stopped", folder);
    assert_int_equal(lf_run_find(out, &found, &err), LF_OK);
    lf_train_options options = {.resume = found.checkpoint};
    assert_int_equal(lf_checkpoint_config(found.checkpoint, &cfg, &options.start, &err), LF_OK);
    if (train("stopped", cfg, options, &err) != LF_OK)
        fail_msg("%s", err.text);
    lf_found_free(&found);
    lf_config_free(cfg);
    assert_same_end("plain-0", "stopped", 14);
    assert_same_metrics("plain-0", "stopped");
}

static void threads_do_not_change_a_bit(void **state)
{
    (void)state;
    const int most = omp_get_max_threads();
    for (int i = 0; i < 2; i++)
        for (int threads = 1; threads <= 3; threads++) {
            char name[32];
            snprintf(name, sizeof name, "threads-%d-%d", i, threads);
            omp_set_num_threads(threads);
            train_well(name, SETS(both[i], "render.fine_samples=4"), (lf_train_options){0});
            assert_same_end(plain[i], name, 14);
            assert_same_metrics(plain[i], name);
        }
    omp_set_num_threads(most);
}

static void the_seed_matters(void **state)
{
    (void)state;
    lf_error text;
    train_well("seed", SETS("train.seed=5", "render.fine_samples=4"), (lf_train_options){0});
    assert_false(same_end("plain-0", "seed", 14, &text));
}

/* ---- learning ---- */

static void overfit_learns_one_batch(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++) {
        double loss[LINES];
        char name[16];
        snprintf(name, sizeof name, "overfit-%d", i);
        train_well(name,
                   SETS(both[i], "train.steps=80", "train.log_every=10", "train.schedule=constant",
                        "train.lr=0.005", "data.val_shapes=0", "data.builtin_scenes=1",
                        "train.checkpoint_every=1000"),
                   (lf_train_options){.overfit = true});
        const int n = metrics(name, "loss", loss);
        assert_int_equal(n, 8);
        if (!(loss[n - 1] < 0.5 * loss[0]))
            fail_msg("%s: loss %g at the start, %g at the end", both[i], loss[0], loss[n - 1]);
    }
}

/* ---- what goes wrong ---- */

/* Refused with these words, and nothing is written. */
static void expect_refused(const char *const *sets, const char *words)
{
    char out[128];
    lf_config *cfg = tiny(sets);
    lf_error err = {""};
    assert_int_equal(train("bad", cfg, (lf_train_options){0}, &err), LF_BAD_INPUT);
    if (!strstr(err.text, words))
        fail_msg("'%s' does not say '%s'", err.text, words);
    lf_config_free(cfg);
    snprintf(out, sizeof out, "%s/bad", folder);
    assert_int_not_equal(access(out, F_OK), 0);
}

/* A built-in scene in the folder; its name for data.scenes. */
static void put_scene(const char *name, int size, long views)
{
    char path[128];
    lf_scene *scene = NULL;
    lf_error err = {""};
    lf_scene_make_options o = lf_scene_make_defaults();
    o.size = size;
    o.rays = 1;
    o.train_views = views;
    o.test_views = 0;
    assert_int_equal(lf_scene_make(&o, &scene, &err), LF_OK);
    snprintf(path, sizeof path, "%s/%s", folder, name);
    if (lf_scene_write(scene, LF_LAYOUT_LLFF, path, &err) != LF_OK)
        fail_msg("%s", err.text);
    lf_scene_close(scene);
}

static void bad_data_ends_before_a_folder_is_made(void **state)
{
    (void)state;
    char root[128], nothing[128];
    snprintf(root, sizeof root, "data.root=%s", folder);
    snprintf(nothing, sizeof nothing, "%s/nothing", folder);
    assert_int_equal(mkdir(nothing, 0700), 0);
    put_scene("few", 24, 5);
    expect_refused(SETS(root, "data.scenes=nothing"), "nothing");
    expect_refused(SETS(root, "data.scenes=nowhere"), "nowhere");
    expect_refused(SETS("render.sources=40"), "render.sources = 40");
    expect_refused(SETS(root, "data.builtin_scenes=0", "data.scenes=few", "data.hold_out=0",
                        "render.sources=5"),
                   "render.sources = 5");
    expect_refused(SETS(root, "data.val_scenes=nowhere"), "nowhere");
}

/* The first validation would find these too late. */
static void bad_validation_scenes(void **state)
{
    (void)state;
    char root[128];
    snprintf(root, sizeof root, "data.root=%s", folder);
    expect_refused(SETS(root, "data.val_scenes=few", "data.hold_out=0", "render.sources=5"),
                   "render.sources = 5");
}

/* Pictures too small for the feature network, which would abort. */
static void pictures_too_small(void **state)
{
    (void)state;
    char root[128];
    snprintf(root, sizeof root, "data.root=%s", folder);
    expect_refused(
        SETS(root, "data.builtin_scenes=0", "data.scenes=few", "data.longest=4", "data.hold_out=0"),
        "data.longest");
    expect_refused(SETS("data.scene_size=16", "render.feature_net=resnet34"), "16 x 16");
    expect_refused(SETS(root, "data.val_scenes=few", "data.factor=8"), "data.factor");
}

/* Real scenes and built-in ones together, of two sizes. */
static void scenes_from_files_train_too(void **state)
{
    (void)state;
    char root[128];
    snprintf(root, sizeof root, "data.root=%s", folder);
    put_scene("real", 30, 9);
    train_well("mixed",
               SETS(root, "data.scenes=real", "data.builtin_scenes=1", "train.steps=6",
                    "train.val_every=6"),
               (lf_train_options){.check_finite = true});
    train_well("files",
               SETS(root, "data.scenes=real, few", "data.builtin_scenes=0", "train.steps=4",
                    "data.hold_out=0", "data.val_scenes=real"),
               (lf_train_options){.check_finite = true});
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(plain_runs),
        cmocka_unit_test(going_on_from_a_checkpoint_ends_the_same),
        cmocka_unit_test(stopped_and_resumed_ends_the_same),
        cmocka_unit_test(threads_do_not_change_a_bit),
        cmocka_unit_test(the_seed_matters),
        cmocka_unit_test(overfit_learns_one_batch),
        cmocka_unit_test(bad_data_ends_before_a_folder_is_made),
        cmocka_unit_test(bad_validation_scenes),
        cmocka_unit_test(pictures_too_small),
        cmocka_unit_test(scenes_from_files_train_too),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
