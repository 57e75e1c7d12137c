/* run_dir.c: starting, going on with, and writing to a run's folder (run_dir.h describes it). */
#include "train/run_dir.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "autograd/atomic_file.h"
#include "train/run_files.h"

struct lf_run {
    char *path;
    int metrics;    /* metrics.jsonl, open and locked */
    long best_step; /* -1: none yet */
    double best_score;
};

/* ---- files ----------------------------------------------------------------------------------- */

lf_status lf_make_folders(const char *path, lf_error *err)
{
    char part[4096];
    const size_t length = strlen(path);
    if (length == 0 || length >= sizeof part)
        return lf_fail(err, LF_BAD_INPUT, "%.200s: a path must have 1 to 4095 bytes", path);
    memcpy(part, path, length + 1);
    for (size_t i = 1; i <= length; i++)
        if (part[i] == '/' || i == length) {
            part[i] = 0;
            if (mkdir(part, 0777) && errno != EEXIST)
                return lf_fail(err, errno == ENOSPC ? LF_FAILED : LF_BAD_INPUT,
                               "%s: cannot make the folder: %s", part, strerror(errno));
            part[i] = path[i];
        }
    struct stat info;
    if (stat(path, &info) || !S_ISDIR(info.st_mode))
        return lf_fail(err, LF_BAD_INPUT, "%s: is no folder; choose another", path);
    return LF_OK;
}

static bool exists(const char *folder, const char *name)
{
    char *path = lf_path_join(folder, name);
    struct stat info;
    const bool there = lstat(path, &info) == 0;
    free(path);
    return there;
}

static lf_status write_text(const lf_run *run, const char *name, const char *text, lf_error *err)
{
    char *path = lf_path_join(run->path, name);
    const lf_bytes piece = {text, strlen(text)};
    const lf_status status = lf_atomic_write(path, &piece, 1, NULL, err);
    free(path);
    return status;
}

/* Open metrics.jsonl and lock it, so that no other process writes to the run. */
static lf_status open_metrics(lf_run *run, lf_error *err)
{
    char *path = lf_path_join(run->path, "metrics.jsonl");
    run->metrics = open(path, O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    lf_status status = LF_OK;
    if (run->metrics < 0)
        status = lf_fail(err, LF_FAILED, "%s: %s", path, strerror(errno));
    else if (flock(run->metrics, LOCK_EX | LOCK_NB) && errno == EWOULDBLOCK)
        status =
            lf_fail(err, LF_BAD_INPUT, "%s: another process is writing to this run", run->path);
    free(path);
    return status;
}

static lf_run *new_run(const char *path)
{
    lf_run *run = calloc(1, sizeof *run);
    LF_REQUIRE(run && (run->path = strdup(path)), "run: out of memory");
    run->metrics = -1;
    run->best_step = -1;
    for (size_t n = strlen(path); n > 1 && run->path[n - 1] == '/';)
        run->path[--n] = 0;
    return run;
}

void lf_run_close(lf_run *run)
{
    if (!run)
        return;
    if (run->metrics >= 0)
        close(run->metrics);
    free(run->path);
    free(run);
}

/* ---- starting -------------------------------------------------------------------------------- */

/* The part of `out` that is there must be a folder that can be written to. */
static lf_status can_be_made(const char *out, lf_error *err)
{
    char part[4096];
    struct stat info;
    snprintf(part, sizeof part, "%s", out);
    while (*part && strcmp(part, "/") != 0 && stat(part, &info)) {
        char *slash = strrchr(part, '/');
        *(slash == part ? part + 1 : slash ? slash : part) = 0;
    }
    if (access(*part ? part : ".", W_OK | X_OK))
        return lf_fail(err, LF_BAD_INPUT, "%s: cannot make the folder: %s: %s", out,
                       *part ? part : ".", strerror(errno));
    return LF_OK;
}

lf_status lf_run_vacant(const char *out, lf_error *err)
{
    static const char *const names[] = {"config.ini", "metrics.jsonl", "checkpoints", "latest"};
    struct stat info;
    if (stat(out, &info) == 0 && !S_ISDIR(info.st_mode))
        return lf_fail(err, LF_BAD_INPUT, "%s: is no folder; choose another", out);
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (exists(out, names[i]))
            return lf_fail(err, LF_BAD_INPUT,
                           "%s holds another run (%s): choose another folder with --out, or go on "
                           "with that run with --resume %s",
                           out, names[i], out);
    return can_be_made(out, err);
}

static lf_status create(lf_run *run, const char *config_text, lf_error *err)
{
    LF_TRY(lf_make_folders(run->path, err));
    LF_TRY(lf_run_vacant(run->path, err));
    char *checkpoints = lf_path_join(run->path, "checkpoints");
    const lf_status status = lf_make_folders(checkpoints, err);
    free(checkpoints);
    LF_TRY(status);
    LF_TRY(open_metrics(run, err));
    return write_text(run, "config.ini", config_text, err);
}

static lf_status hand_out(lf_run *run, lf_status status, lf_run **out)
{
    if (status == LF_OK)
        *out = run;
    else
        lf_run_close(run);
    return status;
}

lf_status lf_run_create(const char *out, const char *config_text, lf_run **run, lf_error *err)
{
    lf_run *made = new_run(out);
    return hand_out(made, create(made, config_text, err), run);
}

/* ---- going on -------------------------------------------------------------------------------- */

/* Checkpoints of later steps: sound ones must not be lost, damaged ones step aside. */
static lf_status set_later_aside(const lf_run *run, long step, lf_error *err)
{
    long *steps;
    const int n = lf_checkpoint_steps(run->path, &steps);
    lf_status status = LF_OK;
    for (int i = 0; i < n && status == LF_OK; i++) {
        if (steps[i] <= step)
            continue;
        char *path = lf_run_checkpoint(run, steps[i]), aside[4200];
        if (lf_checkpoint_sound(path, NULL) == LF_OK)
            status = lf_fail(err, LF_BAD_INPUT,
                             "%s has checkpoints of later steps (%ld), which going on after step "
                             "%ld would replace: choose another folder with --out, or move them "
                             "away",
                             run->path, steps[i], step);
        snprintf(aside, sizeof aside, "%s.damaged", path);
        if (status == LF_OK && rename(path, aside))
            status = lf_fail(err, LF_FAILED, "%s: cannot rename: %s", path, strerror(errno));
        free(path);
    }
    free(steps);
    return status;
}

/* Delete what a killed writer left: temporary files beside the checkpoints. */
static void clean(const lf_run *run)
{
    char *folder = lf_path_join(run->path, "checkpoints");
    DIR *d = opendir(folder);
    for (struct dirent *e = d ? readdir(d) : NULL; e; e = readdir(d))
        if (!strncmp(e->d_name, "step-", 5) && strstr(e->d_name, ".safetensors.tmp")) {
            char *path = lf_path_join(folder, e->d_name);
            unlink(path);
            free(path);
        }
    if (d)
        closedir(d);
    free(folder);
}

/* Cut metrics.jsonl before the first line of a later step, and before a line that is not whole. */
static lf_status cut_metrics(const lf_run *run, long step, lf_error *err)
{
    char *path = lf_path_join(run->path, "metrics.jsonl"), *line = NULL;
    size_t room = 0;
    long keep = 0;
    ssize_t length;
    FILE *file = fopen(path, "rb");
    while (file && (length = getline(&line, &room, file)) > 0) {
        json_t *object = json_loads(line, 0, NULL);
        const json_t *at = json_object_get(object, "step");
        const bool good =
            line[length - 1] == '\n' && json_is_integer(at) && json_integer_value(at) <= step;
        json_decref(object);
        if (!good)
            break;
        keep += (long)length;
    }
    const bool failed = !file || ftruncate(run->metrics, keep);
    const lf_status status =
        failed ? lf_fail(err, LF_FAILED, "%s: %s", path, strerror(errno)) : LF_OK;
    if (file)
        fclose(file);
    free(line);
    free(path);
    return status;
}

/* The best checkpoint so far, if it is still there and not of a later step. */
static void read_best(lf_run *run, long step)
{
    char *path = lf_path_join(run->path, "best");
    FILE *file = fopen(path, "r");
    long best;
    double score;
    if (file && fscanf(file, LF_CHECKPOINT_SCAN " %lf", &best, &score) == 2 && best <= step) {
        char *checkpoint = lf_run_checkpoint(run, best);
        if (access(checkpoint, R_OK) == 0) {
            run->best_step = best;
            run->best_score = score;
        }
        free(checkpoint);
    }
    if (file)
        fclose(file);
    free(path);
}

static lf_status go_on(lf_run *run, long step, lf_error *err)
{
    if (!exists(run->path, "checkpoints"))
        return lf_fail(err, LF_BAD_INPUT, "%s: no run (it has no folder checkpoints)", run->path);
    LF_TRY(open_metrics(run, err));
    LF_TRY(set_later_aside(run, step, err));
    LF_TRY(cut_metrics(run, step, err));
    clean(run);
    read_best(run, step);
    return LF_OK;
}

lf_status lf_run_open(const char *directory, long step, lf_run **run, lf_error *err)
{
    lf_run *opened = new_run(directory);
    return hand_out(opened, go_on(opened, step, err), run);
}

/* ---- writing --------------------------------------------------------------------------------- */

const char *lf_run_path(const lf_run *run)
{
    return run->path;
}

char *lf_run_checkpoint(const lf_run *run, long step)
{
    char name[64];
    snprintf(name, sizeof name, LF_CHECKPOINT_FORMAT, step);
    return lf_path_join(run->path, name);
}

/* Delete all checkpoints but the last `keep` and the best. */
static lf_status prune(const lf_run *run, int keep, lf_error *err)
{
    long *steps;
    const int n = lf_checkpoint_steps(run->path, &steps);
    lf_status status = LF_OK;
    for (int i = 0; i < n - keep; i++) {
        if (steps[i] == run->best_step)
            continue;
        char *path = lf_run_checkpoint(run, steps[i]);
        if (unlink(path))
            status = lf_fail(err, LF_FAILED, "%s: cannot delete: %s", path, strerror(errno));
        free(path);
    }
    free(steps);
    return status;
}

lf_status lf_run_saved(lf_run *run, long step, double score, int keep, lf_error *err)
{
    char text[128];
    LF_REQUIRE(keep >= 1, "run: keep = %d", keep);
    snprintf(text, sizeof text, LF_CHECKPOINT_FORMAT "\n", step);
    LF_TRY(write_text(run, "latest", text, err));
    if (isfinite(score) && (run->best_step < 0 || score < run->best_score)) {
        snprintf(text, sizeof text, LF_CHECKPOINT_FORMAT " %.17g\n", step, score);
        LF_TRY(write_text(run, "best", text, err));
        run->best_step = step;
        run->best_score = score;
    }
    return prune(run, keep, err);
}

void lf_json_real(json_t *object, const char *key, double value)
{
    json_object_set_new(object, key, isfinite(value) ? json_real(value) : json_null());
}

lf_status lf_run_log(lf_run *run, json_t *object, lf_error *err)
{
    LF_REQUIRE(json_is_integer(json_object_get(object, "step")), "run: a log line without step");
    char *line = json_dumps(object, JSON_COMPACT | JSON_REAL_PRECISION(9));
    json_decref(object);
    LF_REQUIRE(line, "run: out of memory");
    const size_t length = strlen(line);
    line[length] = '\n'; /* in place of the terminating 0 */
    const off_t before = lseek(run->metrics, 0, SEEK_END);
    const ssize_t done = write(run->metrics, line, length + 1);
    free(line);
    if (done == (ssize_t)length + 1)
        return LF_OK;
    const int code = done < 0 ? errno : ENOSPC;
    const bool cut = before >= 0 && ftruncate(run->metrics, before) == 0;
    return lf_fail(err, LF_FAILED, "%s/metrics.jsonl: cannot write: %s%s", run->path,
                   strerror(code), cut ? "" : " (the last line is not whole)");
}
