/* reference.c: named arrays, their way through a pipe, and their errors. See reference.h. */
#include "bench/reference.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <math.h>
#include <signal.h>
#include <spawn.h>
#include <stdbool.h>
#include <stdint.h>
#include <sys/wait.h>
#include <unistd.h>

extern char **environ;

static const char magic[8] = "LFOUT 1"; /* then int64 arrays; of each: name, int64 count, doubles */

/* ---- inputs ---------------------------------------------------------------------------------- */

void lf_reference_round(long count, lf_real *x)
{
    for (long i = 0; i < count; i++)
        x[i] = (lf_real)(float)x[i];
}

void lf_reference_round_doubles(long count, double *x)
{
    for (long i = 0; i < count; i++)
        x[i] = (double)(float)x[i];
}

/* ---- outputs --------------------------------------------------------------------------------- */

lf_outputs *lf_outputs_create(void)
{
    lf_outputs *outputs = calloc(1, sizeof *outputs);
    LF_REQUIRE(outputs, "no memory");
    return outputs;
}

void lf_outputs_free(lf_outputs *outputs)
{
    for (int i = 0; outputs && i < outputs->count; i++)
        free(outputs->array[i].value);
    free(outputs);
}

static double *append(lf_outputs *outputs, const char *name, long count)
{
    LF_REQUIRE(outputs->count < LF_OUTPUTS_MAX && strlen(name) < LF_OUTPUT_NAME && count >= 0,
               "output %d, %s, of %ld numbers", outputs->count, name, count);
    for (int i = 0; i < outputs->count; i++)
        LF_REQUIRE(strcmp(outputs->array[i].name, name) != 0, "two outputs are called %s", name);
    lf_output *o = &outputs->array[outputs->count++];
    snprintf(o->name, sizeof o->name, "%s", name);
    o->count = count;
    o->value = malloc((size_t)(count + 1) * sizeof *o->value);
    LF_REQUIRE(o->value, "out of memory for %ld outputs", count);
    return o->value;
}

void lf_outputs_add(lf_outputs *outputs, const char *name, long count, const lf_real *value)
{
    double *to = append(outputs, name, count);
    for (long i = 0; i < count; i++)
        to[i] = (double)value[i];
}

void lf_outputs_add_floats(lf_outputs *outputs, const char *name, long count, const float *value)
{
    double *to = append(outputs, name, count);
    for (long i = 0; i < count; i++)
        to[i] = (double)value[i];
}

void lf_outputs_add_doubles(lf_outputs *outputs, const char *name, long count, const double *value)
{
    memcpy(append(outputs, name, count), value, (size_t)count * sizeof *value);
}

/* ---- the pipe -------------------------------------------------------------------------------- */

static bool put(FILE *file, const void *from, size_t bytes)
{
    return bytes == 0 || fwrite(from, bytes, 1, file) == 1;
}

static bool get(FILE *file, void *to, size_t bytes)
{
    return bytes == 0 || fread(to, bytes, 1, file) == 1;
}

lf_status lf_outputs_write(const lf_outputs *outputs, FILE *file, const char *name, lf_error *err)
{
    const int64_t arrays = outputs->count;
    bool good = put(file, magic, sizeof magic) && put(file, &arrays, sizeof arrays);
    for (int i = 0; good && i < outputs->count; i++) {
        const lf_output *o = &outputs->array[i];
        const int64_t count = o->count;
        good = put(file, o->name, sizeof o->name) && put(file, &count, sizeof count) &&
               put(file, o->value, (size_t)count * sizeof *o->value);
    }
    if (fflush(file) != 0 || !good)
        return lf_fail(err, LF_FAILED, "%s: outputs cannot be written: %s", name, strerror(errno));
    return LF_OK;
}

static bool read_array(FILE *file, lf_outputs *outputs)
{
    lf_output *o = &outputs->array[outputs->count];
    int64_t count;
    if (!get(file, o->name, sizeof o->name) || memchr(o->name, 0, sizeof o->name) == NULL ||
        !get(file, &count, sizeof count) || count < 0 || count > INT64_C(1) << 32)
        return false;
    o->count = (long)count;
    o->value = malloc((size_t)(count + 1) * sizeof *o->value);
    outputs->count += o->value != NULL;
    return o->value && get(file, o->value, (size_t)count * sizeof *o->value);
}

lf_status lf_outputs_read(FILE *file, const char *name, lf_outputs **out, lf_error *err)
{
    char start[sizeof magic];
    int64_t arrays;
    if (!get(file, start, sizeof start))
        return lf_fail(err, LF_FAILED, "%s: no outputs", name);
    if (memcmp(start, magic, sizeof magic) != 0)
        return lf_fail(err, LF_FAILED, "%s: these are no outputs", name);
    lf_outputs *outputs = lf_outputs_create();
    bool good = get(file, &arrays, sizeof arrays) && arrays >= 0 && arrays <= LF_OUTPUTS_MAX;
    for (int64_t i = 0; good && i < arrays; i++)
        good = read_array(file, outputs);
    if (!good) {
        lf_outputs_free(outputs);
        return lf_fail(err, LF_FAILED, "%s: the outputs end early or are damaged", name);
    }
    *out = outputs;
    return LF_OK;
}

/* ---- errors ---------------------------------------------------------------------------------- */

static lf_status compare(const lf_output *got, const lf_output *exact, lf_output_error *error,
                         lf_error *err)
{
    double difference = 0, size = 0, differences = 0, squares = 0;
    for (long i = 0; i < got->count; i++) {
        const double d = got->value[i] - exact->value[i];
        if (!isfinite(got->value[i]) || !isfinite(exact->value[i]))
            return lf_fail(err, LF_FAILED, "%s: number %ld is %g, in double %g", got->name, i,
                           got->value[i], exact->value[i]);
        difference = fmax(difference, fabs(d));
        size = fmax(size, fabs(exact->value[i]));
        differences += d * d;
        squares += exact->value[i] * exact->value[i];
    }
    if (size == 0 && difference > 0)
        return lf_fail(err, LF_FAILED, "%s: up to %g where double has zeros alone", got->name,
                       difference);
    memcpy(error->name, got->name, sizeof error->name);
    error->largest = size > 0 ? difference / size : 0;
    error->l2 = squares > 0 ? sqrt(differences / squares) : 0;
    return LF_OK;
}

lf_status lf_outputs_compare(const lf_outputs *got, const lf_outputs *exact,
                             lf_output_error *errors, lf_error *err)
{
    if (got->count != exact->count)
        return lf_fail(err, LF_FAILED, "%d outputs, in double %d", got->count, exact->count);
    for (int i = 0; i < got->count; i++) {
        const lf_output *a = &got->array[i], *b = &exact->array[i];
        if (strcmp(a->name, b->name) != 0 || a->count != b->count)
            return lf_fail(err, LF_FAILED, "output %d is %s of %ld numbers, in double %s of %ld", i,
                           a->name, a->count, b->name, b->count);
        LF_TRY(compare(a, b, &errors[i], err));
    }
    return LF_OK;
}

/* ---- the program in double ------------------------------------------------------------------- */

lf_status lf_reference_find(const char *name, char *path, size_t size, lf_error *err)
{
    char own[PATH_MAX];
    const ssize_t length = readlink("/proc/self/exe", own, sizeof own - 1);
    if (length < 1)
        return lf_fail(err, LF_FAILED, "/proc/self/exe: %s", strerror(errno));
    own[length] = 0;
    *strrchr(own, '/') = 0;
    if ((size_t)snprintf(path, size, "%s/%s", own, name) >= size)
        return lf_fail(err, LF_FAILED, "%s/%s: the path is too long", own, name);
    if (access(path, X_OK) != 0)
        return lf_fail(err, LF_FAILED, "%s: %s; the program in double stands beside this one", path,
                       strerror(errno));
    return LF_OK;
}

/* Start argv with nothing to read and its standard output into a pipe; returns an errno. */
static int start(const char *const *argv, pid_t *child, FILE **from)
{
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0)
        return errno;
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
    /* posix_spawn changes no argument */
    const int code =
        posix_spawn(child, argv[0], &actions, NULL, (char *const *)(uintptr_t)argv, environ);
    posix_spawn_file_actions_destroy(&actions);
    close(ends[1]);
    *from = code == 0 ? fdopen(ends[0], "r") : NULL;
    if (!*from)
        close(ends[0]);
    return code;
}

lf_status lf_reference_run(const char *const *argv, lf_outputs **out, lf_error *err)
{
    pid_t child;
    FILE *from = NULL;
    int code = 0;
    fflush(NULL);
    const int failed = start(argv, &child, &from);
    if (failed)
        return lf_fail(err, LF_FAILED, "%s: cannot be started: %s", argv[0], strerror(failed));
    lf_outputs *outputs = NULL;
    lf_status status = from ? lf_outputs_read(from, argv[0], &outputs, err)
                            : lf_fail(err, LF_FAILED, "%s: no pipe from it", argv[0]);
    if (from)
        fclose(from); /* a child that still writes ends */
    while (waitpid(child, &code, 0) < 0 && errno == EINTR)
        ;
    if (WIFSIGNALED(code) && WTERMSIG(code) != SIGPIPE)
        status = lf_fail(err, LF_FAILED, "%s: ended by a signal: %s", argv[0],
                         strsignal(WTERMSIG(code)));
    else if (status == LF_OK && code != 0)
        status = lf_fail(err, LF_FAILED, "%s: ended with code %d", argv[0], WEXITSTATUS(code));
    if (status != LF_OK)
        lf_outputs_free(outputs);
    else
        *out = outputs;
    return status;
}
