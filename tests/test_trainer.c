/* test_trainer.c: small trainings: the same bits stopped or not and on any number of threads; what
 * goes wrong stops with a message and loses nothing. */
#include <jansson.h>
#include <omp.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <unistd.h>

#include "autograd/random.h"
#include "tests/close.h"
#include "tests/folder.h"
#include "tests/same_arrays.h"
#include "train/progress.h"
#include "train/run_dir.h"
#include "train/batch.h"
#include "train/recon_data.h"
#include "train/trainer.h"

static char folder[64];
static volatile sig_atomic_t stop;

static int make_folder(void **state)
{
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/elf-test-trainer-XXXXXX");
    return mkdtemp(folder) ? 0 : 1;
}

static int remove_folder(void **state)
{
    (void)state;
    return remove_tree(folder);
}

/* ---- a small training ---- */

static lf_config *tiny(const char *const *more)
{
    static const char *const sets[] = {"data.image_size=33",
                                       "model.stages=1, 1",
                                       "model.fields=1, 2",
                                       "model.stem_fields=1",
                                       "model.features=2",
                                       "model.scalars=4",
                                       "model.vectors=4",
                                       "model.mlp=8",
                                       "model.blocks=1",
                                       "data.supersample=1",
                                       "data.shapes=3",
                                       "data.val_shapes=1",
                                       "data.points_uniform=200",
                                       "data.points_near=200",
                                       "train.steps=24",
                                       "train.warmup=2",
                                       "train.points_per_shape=32",
                                       "train.tile_points=4",
                                       "train.log_every=5",
                                       "train.checkpoint_every=7",
                                       "train.val_every=12",
                                       "train.keep=10"};
    lf_config *cfg;
    lf_error err;
    assert_int_equal(lf_config_load(NULL, &cfg, &err), LF_OK);
    for (size_t i = 0; i < sizeof sets / sizeof *sets; i++)
        assert_int_equal(lf_config_set(cfg, sets[i], &err), LF_OK);
    for (; more && *more; more++)
        if (lf_config_set(cfg, *more, &err) != LF_OK)
            fail_msg("%s", err.text);
    if (lf_config_check(cfg, &err) != LF_OK)
        fail_msg("%s", err.text);
    return cfg;
}

#define SETS(...) ((const char *const[]){__VA_ARGS__, NULL})

static char *in_folder(const char *name)
{
    char *path = NULL;
    assert_true(asprintf(&path, "%s/%s", folder, name) > 0);
    return path;
}

/* Train into folder/name; what is printed (lines on skipped steps) goes into folder/printed. */
static lf_status train(const char *name, const lf_config *cfg, lf_train_options options,
                       lf_error *err)
{
    char *out = in_folder(name);
    options.out = out;
    options.quiet = true;
    fflush(stdout);
    const int old = dup(1);
    char *printed = in_folder("printed");
    assert_non_null(freopen(printed, "w", stdout));
    const lf_status status = lf_train(cfg, &options, err);
    fflush(stdout);
    assert_true(dup2(old, 1) == 1);
    close(old);
    free(printed);
    free(out);
    return status;
}

static void train_well(const char *name, const char *const *sets, lf_train_options options)
{
    lf_config *cfg = tiny(sets);
    lf_error err = {""};
    if (train(name, cfg, options, &err) != LF_OK)
        fail_msg("%s", err.text);
    lf_config_free(cfg);
}

static char *checkpoint(const char *run, long step)
{
    char *path = NULL;
    assert_true(asprintf(&path, "%s/%s/checkpoints/step-%08ld.safetensors", folder, run, step) > 0);
    return path;
}

static void assert_same_end(const char *first, const char *second, long step)
{
    char *a = checkpoint(first, step), *b = checkpoint(second, step);
    lf_error text;
    const char *found = different_arrays(a, b, &text);
    if (found)
        fail_msg("%s and %s: %s", first, second, found);
    free(a);
    free(b);
}

/* Go on from a checkpoint, in its run or (fresh) in another. */
static void resume(const char *path, const char *name, bool fresh)
{
    lf_config *cfg;
    lf_error err = {""};
    lf_train_options options = {.resume = path, .fresh = fresh};
    if (lf_checkpoint_config(path, &cfg, &options.start, &err) != LF_OK ||
        train(name, cfg, options, &err) != LF_OK)
        fail_msg("%s", err.text);
    lf_config_free(cfg);
}

enum { LINES = 32 };

/* The lines of metrics.jsonl; the caller decrefs each. */
static int metrics(const char *run, json_t *line[LINES])
{
    char path[256], text[4096];
    snprintf(path, sizeof path, "%s/%s/metrics.jsonl", folder, run);
    FILE *f = fopen(path, "r");
    int n = 0;
    assert_non_null(f);
    while (n < LINES && fgets(text, sizeof text, f)) {
        line[n] = json_loads(text, 0, NULL);
        assert_non_null(line[n++]);
    }
    fclose(f);
    return n;
}

static void free_lines(int n, json_t *line[LINES])
{
    for (int i = 0; i < n; i++)
        json_decref(line[i]);
}

static double number(const json_t *line, const char *key)
{
    return json_number_value(json_object_get(line, key));
}

/* All that does not depend on the clock or the machine, for lines after `step`. */
static void assert_same_metrics(const char *first, const char *second, long step)
{
    static const char *const keys[] = {"step",    "loss",     "lr",     "grad_norm",
                                       "skipped", "val_loss", "val_iou"};
    json_t *a[LINES], *b[LINES];
    const int n = metrics(first, a), m = metrics(second, b);
    int i = 0, k = 0;
    while (i < n && number(a[i], "step") <= (double)step)
        i++;
    while (k < m && number(b[k], "step") <= (double)step)
        k++;
    assert_int_equal(n - i, m - k);
    assert_true(n > i);
    for (; i < n; i++, k++)
        for (int key = 0; key < 7; key++)
            if (!json_equal(json_object_get(a[i], keys[key]), json_object_get(b[k], keys[key])) &&
                (json_object_get(a[i], keys[key]) || json_object_get(b[k], keys[key])))
                fail_msg("%s and %s, step %g: %s differs: %.9g, %.9g", first, second,
                         number(a[i], "step"), keys[key], number(a[i], keys[key]),
                         number(b[k], keys[key]));
    free_lines(n, a);
    free_lines(m, b);
}

/* ---- the same bits ---- */

static void a_run_leaves_what_it_should(void **state)
{
    (void)state;
    train_well("plain", NULL, (lf_train_options){.out = NULL});
    json_t *line[LINES];
    const int n = metrics("plain", line);
    static const double steps[] = {5, 10, 12, 15, 20, 24};
    assert_int_equal(n, 6);
    for (int i = 0; i < n; i++) {
        static const char *const keys[] = {"step",        "seconds",    "loss",
                                           "lr",          "grad_norm",  "steps_per_s",
                                           "peak_rss_mb", "data_share", "skipped"};
        for (size_t k = 0; k < sizeof keys / sizeof *keys; k++)
            assert_true(json_is_number(json_object_get(line[i], keys[k])));
        assert_true(number(line[i], "step") == steps[i]);
        assert_int_equal(json_object_get(line[i], "val_loss") != NULL, i == 2 || i == 5);
    }
    free_lines(n, line);
    static const long saved[] = {7, 14, 21, 24};
    for (int i = 0; i < 4; i++) {
        char *path = checkpoint("plain", saved[i]);
        assert_int_equal(access(path, R_OK), 0);
        free(path);
    }
}

/* In another folder from a checkpoint between two lines of metrics. */
static void going_on_from_a_checkpoint_ends_the_same(void **state)
{
    (void)state;
    static const long steps[] = {7, 14, 21, 24};
    for (int i = 0; i < 4; i++) {
        char *path = checkpoint("plain", steps[i]), name[32];
        snprintf(name, sizeof name, "from-%ld", steps[i]);
        resume(path, name, true);
        assert_same_end("plain", name, 24);
        if (steps[i] < 24)
            assert_same_metrics("plain", name, steps[i]);
        free(path);
    }
}

static void on_alarm(int signal_number)
{
    (void)signal_number;
    stop = 1;
}

/* Stopped by the clock, as a user would, and gone on in place, until it is done. */
static void stopped_and_resumed_ends_the_same(void **state)
{
    (void)state;
    const struct sigaction action = {.sa_handler = on_alarm, .sa_flags = SA_RESTART};
    sigaction(SIGALRM, &action, NULL);
    lf_config *cfg = tiny(NULL);
    char *out = in_folder("stopped");
    lf_status status = LF_STOPPED;
    int stops = 0;
    for (; status == LF_STOPPED && stops < 200; stops++) {
        lf_found found = {0};
        lf_error err = {""};
        lf_train_options options = {.stop = &stop};
        if (stops) {
            assert_int_equal(lf_run_find(out, &found, &err), LF_OK);
            options.resume = found.checkpoint;
            lf_config *inside;
            assert_int_equal(lf_checkpoint_config(found.checkpoint, &inside, &options.start, &err),
                             LF_OK);
            lf_config_free(inside);
        }
        stop = stops == 0; /* the first time before the first step */
        const struct itimerval soon = {.it_value = {.tv_usec = 40000 + 30000 * stops}};
        setitimer(ITIMER_REAL, &soon, NULL);
        status = train("stopped", cfg, options, &err);
        if (status == LF_STOPPED)
            assert_non_null(strstr(err.text, "--resume"));
        else if (status != LF_OK)
            fail_msg("%s", err.text);
        lf_found_free(&found);
    }
    const struct itimerval never = {.it_value = {0}};
    setitimer(ITIMER_REAL, &never, NULL);
    assert_true(stops >= 2 && status == LF_OK);
    assert_same_end("plain", "stopped", 24);
    assert_same_metrics("plain", "stopped", 0);
    free(out);
    lf_config_free(cfg);
}

static void threads_do_not_change_a_bit(void **state)
{
    (void)state;
    const int most = omp_get_max_threads();
    for (int threads = 1; threads <= 3; threads++) {
        char name[32];
        snprintf(name, sizeof name, "threads-%d", threads);
        omp_set_num_threads(threads);
        train_well(name, SETS("data.setting=SO3", "train.steps=10", "train.val_every=10"),
                   (lf_train_options){.out = NULL});
    }
    omp_set_num_threads(most);
    for (int threads = 2; threads <= 3; threads++) {
        char name[32];
        snprintf(name, sizeof name, "threads-%d", threads);
        assert_same_end("threads-1", name, 10);
        assert_same_metrics("threads-1", name, 0);
    }
}

/* Later epochs take other draws of the views; a resumed run takes the same ones. */
/* DISN and FvOR: gone on from the middle, on other numbers of threads. */
static void compared_systems_end_the_same(void **state)
{
    (void)state;
    static const char *const types[] = {"model.type=disn", "model.type=fvor"};
    const int most = omp_get_max_threads();
    for (int i = 0; i < 2; i++) {
        const char *const name[] = {types[i] + 11, i ? "fvor-on" : "disn-on"};
        omp_set_num_threads(1);
        train_well(name[0],
                   SETS(types[i], "model.backbone=plain", "model.grid=5", "model.volume=1, 1",
                        "data.setting=Y", "train.steps=10", "train.val_every=10"),
                   (lf_train_options){.out = NULL});
        char *path = checkpoint(name[0], 7);
        omp_set_num_threads(3);
        resume(path, name[1], true);
        assert_same_end(name[0], name[1], 10);
        assert_same_metrics(name[0], name[1], 7);
        free(path);
    }
    omp_set_num_threads(most);
}

static void draws_of_the_settings_repeat(void **state)
{
    (void)state;
    static const char *const settings[] = {"data.setting=Z", "data.setting=R"};
    for (int i = 0; i < 2; i++) {
        char a[16], b[16];
        snprintf(a, sizeof a, "draws-%d", i);
        snprintf(b, sizeof b, "again-%d", i);
        train_well(a, SETS(settings[i], "train.steps=12", "data.draws=3", "train.clip=0.5"),
                   (lf_train_options){.out = NULL});
        char *path = checkpoint(a, 7);
        resume(path, b, true);
        assert_same_end(a, b, 12);
        free(path);
    }
    char *x = checkpoint("draws-0", 12), *y = checkpoint("draws-1", 12);
    lf_error text;
    assert_non_null(different_arrays(x, y, &text)); /* or the comparison sees nothing */
    free(x);
    free(y);
}

static void a_batch_is_a_function_of_its_step(void **state)
{
    (void)state;
    lf_config *cfg = tiny(SETS("data.setting=Z"));
    const lf_shapes_options o = lf_shapes_options_from(cfg, "train");
    lf_shapes *shapes;
    lf_error err;
    assert_int_equal(lf_shapes_open(&o, &shapes, &err), LF_OK);
    assert_int_equal(lf_shapes_prepare(shapes, NULL, NULL, &err), LF_OK);
    lf_batches *a = lf_batches_create(cfg, NULL, shapes), *b = lf_batches_create(cfg, NULL, shapes);
    assert_int_equal(lf_batches_epoch(a), 2); /* 3 shapes, 2 a step */
    float sdf[20][64];
    for (long s = 0; s < 20; s++)
        memcpy(sdf[s], lf_batches_at(a, s).sdf, sizeof sdf[s]);
    for (long s = 19; s >= 0; s -= 3) { /* backwards, with gaps */
        const lf_batch x = lf_batches_at(a, s), y = lf_batches_at(b, s);
        assert_int_equal(x.images.count, 16);
        assert_int_equal(x.points.count, 64);
        assert_memory_equal(x.sdf, sdf[s], sizeof sdf[s]);
        assert_memory_equal(y.sdf, sdf[s], sizeof sdf[s]);
        assert_memory_equal(x.images.pixel, y.images.pixel, 16 * 33 * 33 * 2 * sizeof(lf_real));
        assert_memory_equal(x.points.uv, y.points.uv, 64 * 16 * sizeof(double));
    }
    assert_memory_not_equal(sdf[3], sdf[4], sizeof sdf[3]);
    lf_batches_free(a);
    lf_batches_free(b);
    lf_shapes_close(shapes);
    lf_config_free(cfg);
}

/* ---- learning ---- */

static void overfit_learns_one_batch(void **state)
{
    (void)state;
    train_well("overfit",
               SETS("train.steps=150", "train.log_every=10", "train.schedule=constant",
                    "train.lr=0.01", "data.val_shapes=0", "model.scalars=8", "model.mlp=32"),
               (lf_train_options){.overfit = true});
    json_t *line[LINES];
    const int n = metrics("overfit", line);
    assert_int_equal(n, 15);
    const double first = number(line[0], "loss"), last = number(line[n - 1], "loss");
    free_lines(n, line);
    if (!(last < 0.4 * first))
        fail_msg("loss %g at the start, %g at the end", first, last);
}

/* ---- what goes wrong ---- */

/* Is this among what the last training printed? */
static bool was_printed(const char *words)
{
    char *path = in_folder("printed"), text[4096];
    FILE *f = fopen(path, "r");
    assert_non_null(f);
    text[fread(text, 1, sizeof text - 1, f)] = 0;
    fclose(f);
    free(path);
    return strstr(text, words) != NULL;
}

/* A checkpoint whose weights of one array are all `value`; written over `path`. */
static void spoil(const char *path, const char *array, float value)
{
    lf_config *cfg;
    lf_training_state where;
    lf_error err;
    assert_int_equal(lf_checkpoint_config(path, &cfg, &where, &err), LF_OK);
    lf_store *store = lf_store_create(0);
    lf_recon model;
    const lf_recon_config config = lf_recon_config_from(cfg);
    lf_recon_init(&model, store, &config);
    static const lf_adam_config plain = {0.9, 0.999, 1e-8, 0, false};
    lf_adam adam;
    lf_adam_init(&adam, &plain, store);
    assert_int_equal(lf_checkpoint_read(path, store, &adam, &err), LF_OK);
    const lf_parameter *p = lf_store_find(store, array);
    assert_non_null(p);
    for (long k = 0; k < p->size; k++)
        lf_values(p)[k] = value;
    assert_int_equal(lf_checkpoint_write(path, store, &adam, &where, cfg, NULL, &err), LF_OK);
    lf_adam_free(&adam);
    lf_recon_free(&model);
    lf_store_free(store);
    lf_config_free(cfg);
}

static void diverging_stops_with_a_message(void **state)
{
    (void)state;
    static const struct {
        const char *array, *op;
    } cases[] = {{"head.0.weight", "forward of linear"},
                 {"backbone.stem.weight", "forward of c8_conv2d"}};
    for (int i = 0; i < 2; i++) {
        char name[16];
        snprintf(name, sizeof name, "spoilt-%d", i);
        train_well(name, SETS("train.steps=100", "train.max_bad_steps=4", "train.steps=8"),
                   (lf_train_options){.out = NULL});
        char *path = checkpoint(name, 8);
        spoil(path, cases[i].array, 3e38f);
        lf_config *cfg;
        lf_error err = {""};
        lf_train_options options = {.resume = path, .check_finite = true};
        assert_int_equal(lf_checkpoint_config(path, &cfg, &options.start, &err), LF_OK);
        assert_int_equal(lf_config_set(cfg, "train.steps=100", &err), LF_OK);
        assert_int_equal(train(name, cfg, options, &err), LF_FAILED);
        assert_non_null(strstr(err.text, "4 steps in a row"));
        assert_non_null(strstr(err.text, "train.lr"));
        assert_true(was_printed("step 9 skipped") && was_printed("step 12 skipped"));
        assert_true(was_printed(cases[i].op)); /* what --check-finite is for */
        lf_config_free(cfg);
        lf_config *inside;
        char *good = checkpoint(name, 7);
        assert_int_equal(lf_checkpoint_config(good, &inside, NULL, &err), LF_OK);
        lf_config_free(inside);
        assert_int_equal(lf_checkpoint_config(path, &inside, NULL, &err), LF_OK);
        lf_config_free(inside);
        free(good);
        free(path);
    }
}

/* A skipped step must not leave its means and variances behind. */
static void a_skipped_step_changes_nothing(void **state)
{
    (void)state;
    train_well("skipped", SETS("train.steps=8", "train.max_bad_steps=100"),
               (lf_train_options){.out = NULL});
    char *path = checkpoint("skipped", 8), *after = checkpoint("skipped", 10);
    spoil(path, "backbone.stage1.block0.conv1.weight", 3e38f);
    lf_config *cfg;
    lf_error err = {""};
    lf_train_options options = {.resume = path};
    assert_int_equal(lf_checkpoint_config(path, &cfg, &options.start, &err), LF_OK);
    assert_int_equal(lf_config_set(cfg, "train.steps=10", &err), LF_OK);
    if (train("skipped", cfg, options, &err) != LF_OK)
        fail_msg("%s", err.text);
    lf_config_free(cfg);
    lf_safetensors *a, *b;
    assert_int_equal(lf_safetensors_open(path, &a, &err), LF_OK);
    assert_int_equal(lf_safetensors_open(after, &b, &err), LF_OK);
    assert_string_equal(lf_safetensors_meta(b, "skipped"), "2");
    assert_string_equal(lf_safetensors_meta(b, "step"), "10");
    assert_string_equal(lf_safetensors_meta(b, "adam_steps"), "8");
    for (int i = 0; i < lf_safetensors_count(a); i++) {
        const lf_array *x = lf_safetensors_at(a, i);
        if (!same_array(x, lf_safetensors_find(b, x->name)))
            fail_msg("%s changed", x->name);
    }
    lf_safetensors_close(a);
    lf_safetensors_close(b);
    free(path);
    free(after);
}

/* Refused before anything is rendered or made. */
static void too_large_a_cache(void **state)
{
    (void)state;
    lf_config *cfg = tiny(SETS("data.cache_mb=1", "data.points_uniform=1000000"));
    lf_error err = {""};
    assert_int_equal(train("large", cfg, (lf_train_options){.out = NULL}, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "data.cache_mb"));
    lf_config_free(cfg);
    char *out = in_folder("large");
    assert_int_not_equal(access(out, F_OK), 0);
    free(out);
}

static void a_folder_with_another_run_stays(void **state)
{
    (void)state;
    json_t *line[LINES];
    lf_config *cfg = tiny(SETS("train.steps=1"));
    lf_error err = {""};
    const int before = metrics("plain", line);
    free_lines(before, line);
    assert_int_equal(train("plain", cfg, (lf_train_options){.out = NULL}, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "holds another run"));
    char *path = checkpoint("plain", 14); /* nor as a new run from a checkpoint */
    lf_train_options options = {.resume = path, .fresh = true, .start = {.step = 14}};
    assert_int_equal(train("plain", cfg, options, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "holds another run"));
    free(path);
    lf_config_free(cfg);
    const int after = metrics("plain", line);
    free_lines(after, line);
    assert_int_equal(after, before);
    assert_same_end("plain", "from-7", 24);
}

/* Resuming an older checkpoint in place would lose the newer ones. */
static void an_old_checkpoint_does_not_overwrite_newer_ones(void **state)
{
    (void)state;
    char *path = checkpoint("plain", 14);
    lf_config *cfg;
    lf_error err = {""};
    lf_train_options options = {.resume = path};
    assert_int_equal(lf_checkpoint_config(path, &cfg, &options.start, &err), LF_OK);
    assert_int_equal(train("plain", cfg, options, &err), LF_BAD_INPUT);
    lf_config_free(cfg);
    free(path);
    assert_same_end("plain", "from-7", 24);
}

static void a_bad_shape_ends_before_a_folder_is_made(void **state)
{
    (void)state;
    char root[128];
    snprintf(root, sizeof root, "data.root=%s/nowhere", folder);
    lf_config *cfg = tiny(SETS(root));
    lf_error err = {""};
    assert_int_equal(train("bad", cfg, (lf_train_options){.out = NULL}, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "nowhere"));
    lf_config_free(cfg);
    char *out = in_folder("bad");
    assert_int_not_equal(access(out, F_OK), 0);
    free(out);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_run_leaves_what_it_should),
        cmocka_unit_test(going_on_from_a_checkpoint_ends_the_same),
        cmocka_unit_test(stopped_and_resumed_ends_the_same),
        cmocka_unit_test(threads_do_not_change_a_bit),
        cmocka_unit_test(compared_systems_end_the_same),
        cmocka_unit_test(draws_of_the_settings_repeat),
        cmocka_unit_test(a_batch_is_a_function_of_its_step),
        cmocka_unit_test(overfit_learns_one_batch),
        cmocka_unit_test(diverging_stops_with_a_message),
        cmocka_unit_test(a_skipped_step_changes_nothing),
        cmocka_unit_test(too_large_a_cache),
        cmocka_unit_test(a_folder_with_another_run_stays),
        cmocka_unit_test(an_old_checkpoint_does_not_overwrite_newer_ones),
        cmocka_unit_test(a_bad_shape_ends_before_a_folder_is_made),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
