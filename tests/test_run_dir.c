/* test_run_dir.c: the life of a run's folder, and the lines of progress. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <fcntl.h>
#include <math.h>
#include <sys/stat.h>
#include <unistd.h>

#include "autograd/safetensors.h"
#include "tests/folder.h"
#include "train/progress.h"
#include "train/run_dir.h"

static char folder[64], out[96];

static int make_folder(void **state)
{
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/lf-run-XXXXXX");
    assert_non_null(mkdtemp(folder));
    snprintf(out, sizeof out, "%s/a/run", folder);
    return 0;
}

static int remove_folder(void **state)
{
    (void)state;
    return remove_tree(folder);
}

/* The text of a file in the run, in a buffer of the caller. */
static const char *text_of(const char *name, char text[2048])
{
    char file[256];
    snprintf(file, sizeof file, "%s/%s", out, name);
    FILE *in = fopen(file, "rb");
    if (!in)
        return NULL;
    text[fread(text, 1, 2047, in)] = 0;
    fclose(in);
    return text;
}

static bool there(const char *name)
{
    char text[2048];
    return text_of(name, text) != NULL;
}

static void put_text(const char *name, const char *text)
{
    char file[256];
    snprintf(file, sizeof file, "%s/%s", out, name);
    FILE *f = fopen(file, "wb");
    assert_non_null(f);
    fputs(text, f);
    fclose(f);
}

static lf_run *create(void)
{
    lf_run *run = NULL;
    lf_error err = {""};
    if (lf_run_create(out, "[train]\nsteps = 4\n", &run, &err) != LF_OK)
        fail_msg("%s", err.text);
    return run;
}

static lf_run *reopen(long step)
{
    lf_run *run = NULL;
    lf_error err = {""};
    if (lf_run_open(out, step, &run, &err) != LF_OK)
        fail_msg("%s", err.text);
    return run;
}

static void save(lf_run *run, long step, double score, int keep)
{
    const float x = (float)step;
    const lf_array array = {"x", LF_F32, 0, {0}, &x};
    char *path = lf_run_checkpoint(run, step);
    assert_int_equal(lf_safetensors_write(path, &array, 1, NULL, 0, NULL, NULL), LF_OK);
    free(path);
    assert_int_equal(lf_run_saved(run, step, score, keep, NULL), LF_OK);
}

static void log_step(lf_run *run, long step, double loss)
{
    json_t *line = json_pack("{s:I}", "step", (json_int_t)step);
    lf_json_real(line, "loss", loss);
    assert_int_equal(lf_run_log(run, line, NULL), LF_OK);
}

static void damage(long step)
{
    char file[256];
    snprintf(file, sizeof file, "%s/checkpoints/step-%08ld.safetensors", out, step);
    assert_int_equal(truncate(file, 90), 0);
}

static void expect(lf_status status, const lf_error *err, const char *format, ...)
{
    char message[1024];
    va_list args;
    va_start(args, format);
    vsnprintf(message, sizeof message, format, args);
    va_end(args);
    assert_int_equal(status, LF_BAD_INPUT);
    assert_string_equal(err->text, message);
}

/* ---- runs ------------------------------------------------------------------------------------ */

static void test_create(void **state)
{
    (void)state;
    char text[2048];
    lf_run *run = create(), *second = NULL;
    lf_error err = {""};
    assert_string_equal(lf_run_path(run), out);
    assert_string_equal(text_of("config.ini", text), "[train]\nsteps = 4\n");
    log_step(run, 1, 0.5);
    log_step(run, 2, NAN);
    assert_string_equal(text_of("metrics.jsonl", text),
                        "{\"step\":1,\"loss\":0.5}\n{\"step\":2,\"loss\":null}\n");
    expect(lf_run_open(out, 9, &second, &err), &err, "%s: another process is writing to this run",
           out);
    lf_run_close(run);
    lf_run_close(NULL);
}

static void test_create_refuses(void **state)
{
    (void)state;
    char text[2048], file[128], deep[256];
    lf_run *run = NULL;
    lf_error err = {""};
    lf_run_close(create());
    expect(lf_run_create(out, "new", &run, &err), &err,
           "%s holds another run (config.ini): choose another folder with --out, or go on with "
           "that run with --resume %s",
           out, out);
    assert_string_equal(text_of("config.ini", text), "[train]\nsteps = 4\n");
    snprintf(file, sizeof file, "%s/config.ini", out);
    expect(lf_run_create(file, "new", &run, &err), &err, "%s: is no folder; choose another", file);
    snprintf(deep, sizeof deep, "%s/deep", file);
    expect(lf_run_create(deep, "new", &run, &err), &err,
           "%s: cannot make the folder: Not a directory", deep);
    expect(lf_run_create("", "new", &run, &err), &err, ": a path must have 1 to 4095 bytes");
    assert_null(run);
}

static void test_create_in_a_folder_with_other_files(void **state)
{
    (void)state;
    snprintf(out, sizeof out, "%s", folder);
    put_text("notes.txt", "mine");
    lf_run_close(create());
    assert_true(there("notes.txt"));
}

static void test_keeps_last_and_best(void **state)
{
    (void)state;
    char text[2048];
    lf_run *run = create();
    const double scores[] = {3, 1, NAN, 2, 1, 4};
    for (int i = 0; i < 6; i++)
        save(run, 10 * (i + 1), scores[i], 2);
    assert_string_equal(text_of("latest", text), "checkpoints/step-00000060.safetensors\n");
    assert_string_equal(text_of("best", text), "checkpoints/step-00000020.safetensors 1\n");
    const bool kept[] = {false, true, false, false, true, true};
    for (int i = 0; i < 6; i++) {
        char name[64];
        snprintf(name, sizeof name, "checkpoints/step-%08d.safetensors", 10 * (i + 1));
        assert_int_equal(there(name), kept[i]);
    }
    lf_run_close(run);

    run = reopen(60); /* the best is remembered */
    save(run, 70, 1.5, 1);
    assert_string_equal(text_of("best", text), "checkpoints/step-00000020.safetensors 1\n");
    assert_true(there("checkpoints/step-00000020.safetensors"));
    assert_false(there("checkpoints/step-00000060.safetensors"));
    save(run, 80, 0.5, 1);
    assert_false(there("checkpoints/step-00000020.safetensors"));
    lf_run_close(run);
}

/* ---- going on -------------------------------------------------------------------------------- */

static void test_metrics_are_cut(void **state)
{
    (void)state;
    char text[2048];
    lf_run *run = create();
    for (int step = 1; step <= 4; step++)
        log_step(run, step, 1.0 / step);
    save(run, 2, NAN, 3);
    lf_run_close(run);
    run = reopen(2);
    assert_string_equal(text_of("metrics.jsonl", text),
                        "{\"step\":1,\"loss\":1.0}\n{\"step\":2,\"loss\":0.5}\n");
    log_step(run, 3, 7);
    lf_run_close(run);
    assert_string_equal(text_of("metrics.jsonl", text),
                        "{\"step\":1,\"loss\":1.0}\n{\"step\":2,\"loss\":0.5}\n"
                        "{\"step\":3,\"loss\":7.0}\n");
    put_text("metrics.jsonl", "{\"step\":1}\n{\"step\":2"); /* killed while writing a line */
    lf_run_close(reopen(2));
    assert_string_equal(text_of("metrics.jsonl", text), "{\"step\":1}\n");
}

static void test_find_newest(void **state)
{
    (void)state;
    lf_found found;
    char path[256];
    lf_run *run = create();
    save(run, 10, NAN, 3);
    save(run, 20, NAN, 3);
    lf_run_close(run);
    assert_int_equal(lf_run_find(out, &found, NULL), LF_OK);
    snprintf(path, sizeof path, "%s/checkpoints/step-00000020.safetensors", out);
    assert_string_equal(found.checkpoint, path);
    assert_string_equal(found.directory, out);
    assert_int_equal(found.step, 20);
    assert_string_equal(found.note, "");
    lf_found_free(&found);

    assert_int_equal(lf_run_find(path, &found, NULL), LF_OK);
    assert_string_equal(found.directory, out);
    assert_string_equal(found.checkpoint, path);
    assert_int_equal(found.step, 20);
    lf_found_free(&found);
}

static void test_find_passes_over_damage(void **state)
{
    (void)state;
    lf_found found;
    lf_error err = {""};
    char path[256];
    lf_run *run = create();
    save(run, 10, NAN, 3);
    save(run, 20, NAN, 3);
    put_text("checkpoints/step-00000030.safetensors.tmp7", "half");
    lf_run_close(run);
    damage(20);
    assert_int_equal(lf_run_find(out, &found, NULL), LF_OK);
    assert_int_equal(found.step, 10);
    assert_non_null(strstr(found.note, "passed over "));
    assert_non_null(strstr(found.note, "step-00000020.safetensors: truncated"));
    lf_found_free(&found);
    snprintf(path, sizeof path, "%s/checkpoints/step-00000020.safetensors", out);
    assert_int_equal(lf_run_find(path, &found, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "step-00000020.safetensors: truncated"));

    lf_run_close(reopen(10)); /* the damaged one steps aside, the temporary one goes */
    assert_true(there("checkpoints/step-00000020.safetensors.damaged"));
    assert_false(there("checkpoints/step-00000020.safetensors"));
    assert_false(there("checkpoints/step-00000030.safetensors.tmp7"));

    damage(10);
    assert_int_equal(lf_run_find(out, &found, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "/run: no checkpoint is sound: "));
}

static void test_find_alone(void **state)
{
    (void)state;
    char from[256], to[256];
    lf_found found;
    lf_run *run = create();
    save(run, 10, NAN, 3);
    lf_run_close(run);
    snprintf(from, sizeof from, "%s/checkpoints/step-00000010.safetensors", out);
    snprintf(to, sizeof to, "%s/model.safetensors", folder);
    assert_int_equal(rename(from, to), 0);
    assert_int_equal(lf_run_find(to, &found, NULL), LF_OK);
    assert_null(found.directory);
    assert_int_equal(found.step, -1);
    lf_found_free(&found);
}

static void test_open_refuses(void **state)
{
    (void)state;
    lf_run *run = create(), *again = NULL;
    lf_found found;
    lf_error err = {""};
    expect(lf_run_find(out, &found, &err), &err, "%s: no checkpoint in its folder checkpoints",
           out);
    save(run, 10, NAN, 3);
    save(run, 20, NAN, 3);
    lf_run_close(run);
    expect(lf_run_open(out, 10, &again, &err), &err,
           "%s has checkpoints of later steps (20), which going on after step 10 would replace: "
           "choose another folder with --out, or move them away",
           out);
    expect(lf_run_open(folder, 10, &again, &err), &err, "%s: no run (it has no folder checkpoints)",
           folder);
    expect(lf_run_find("/tmp/lf-no-such", &found, &err), &err,
           "/tmp/lf-no-such: No such file or directory");
    assert_null(again);
}

/* ---- progress -------------------------------------------------------------------------------- */

static void test_duration(void **state)
{
    (void)state;
    const struct {
        double seconds;
        const char *text;
    } rows[] = {{0, "0:00"},    {7.4, "0:07"},      {59.6, "1:00"},
                {754, "12:34"}, {10930, "3:02:10"}, {360000, "100:00:00"},
                {NAN, "?"},     {-1, "?"},          {INFINITY, "?"}};
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        char text[24];
        lf_duration_text(rows[i].seconds, text);
        assert_string_equal(text, rows[i].text);
    }
}

/* What progress prints between its start and its end, as on a terminal or not. */
static char *printed(bool terminal, bool quiet)
{
    char *text = calloc(1, 4096);
    FILE *file = tmpfile();
    assert_true(text && file);
    lf_progress p = lf_progress_start(file, "step", 0, 400, quiet);
    assert_false(p.terminal);
    p.terminal = terminal;
    p.width = 60;
    lf_progress_update(&p, 100, 10, "loss %.3f %s", 0.123456, "and a text that is too long");
    lf_progress_update(&p, 101, 10.05, "too early");
    lf_progress_update(&p, 200, 20, "loss 0.1");
    lf_progress_say(&p, "saved %d", 200);
    lf_progress_update(&p, 400, 40, "done");
    lf_progress_end(&p);
    rewind(file);
    assert_true(fread(text, 1, 4095, file) > 0);
    fclose(file);
    return text;
}

static void test_progress(void **state)
{
    (void)state;
    char *plain = printed(false, false), *quiet = printed(false, true),
         *line = printed(true, false);
    assert_string_equal(plain, "step 100/400  25%  0:10 elapsed, 0:30 left  loss 0.123 and a text "
                               "that is too long\n"
                               "step 200/400  50%  0:20 elapsed, 0:20 left  loss 0.1\n"
                               "saved 200\n"
                               "step 400/400  100%  0:40 elapsed, 0:00 left  done\n");
    assert_string_equal(quiet, "saved 200\n");
    assert_string_equal(line, "\rstep 100/400  25%  0:10 elapsed, 0:30 left  loss 0.123 and "
                              "\rstep 200/400  50%  0:20 elapsed, 0:20 left  loss 0.1       "
                              "\r                                                    "
                              "\rsaved 200\n"
                              "\rstep 400/400  100%  0:40 elapsed, 0:00 left  done\n");
    free(plain);
    free(quiet);
    free(line);
}

static void test_peak_memory(void **state)
{
    (void)state;
    const double before = lf_peak_rss_mb();
    char *block = malloc(50000000);
    assert_non_null(block);
    memset(block, 1, 50000000);
    assert_true(block[49999999] && lf_peak_rss_mb() > 50 && before > 0.5);
    free(block);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_create, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_create_refuses, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_create_in_a_folder_with_other_files, make_folder,
                                        remove_folder),
        cmocka_unit_test_setup_teardown(test_keeps_last_and_best, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_metrics_are_cut, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_find_newest, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_find_passes_over_damage, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_find_alone, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_open_refuses, make_folder, remove_folder),
        cmocka_unit_test(test_duration),
        cmocka_unit_test(test_progress),
        cmocka_unit_test(test_peak_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
