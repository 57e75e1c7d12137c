/* child.c: see child.h. */
#include "eval/child.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

extern char **environ;

lf_status lf_child_find(const char *name, char **path, lf_error *err)
{
    char self[PATH_MAX], *found = NULL;
    const ssize_t n = readlink("/proc/self/exe", self, sizeof self - 1);
    if (n < 0)
        return lf_fail(err, LF_FAILED, "/proc/self/exe: %s", strerror(errno));
    self[n] = 0;
    *strrchr(self, '/') = 0;
    LF_REQUIRE(asprintf(&found, "%s/%s", self, name) >= 0, "out of memory");
    if (access(found, X_OK) == 0) {
        *path = found;
        return LF_OK;
    }
    lf_fail(err, LF_BAD_INPUT, "%s: %s, and it is needed beside elf-eval; build all programs",
            found, strerror(errno));
    free(found);
    return LF_BAD_INPUT;
}

/* Start the program with its standard error on `to`. */
static lf_status start(const char *path, char *const argv[], int to, pid_t *pid, lf_error *err)
{
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_adddup2(&actions, to, STDERR_FILENO);
    posix_spawnattr_t attributes;
    sigset_t interrupt;
    sigemptyset(&interrupt);
    sigaddset(&interrupt, SIGINT);
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setsigdefault(&attributes, &interrupt);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF);
    const int failed = posix_spawn(pid, path, &actions, &attributes, argv, environ);
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
    return failed ? lf_fail(err, LF_FAILED, "%s: cannot be started: %s", path, strerror(failed))
                  : LF_OK;
}

/* All that comes until the other end is closed; the beginning of it is kept in text[size]. */
static void drain(int from, char *text, size_t size)
{
    char piece[512];
    size_t kept = 0;
    for (ssize_t n; (n = read(from, piece, sizeof piece)) > 0 || (n < 0 && errno == EINTR);) {
        const size_t room = size - 1 - kept, got = n > 0 ? (size_t)n : 0;
        const size_t more = got < room ? got : room;
        memcpy(text + kept, piece, more);
        kept += more;
    }
    text[kept] = 0;
}

/* The last line without the program's name: what a program of elf says when it fails. */
static const char *message(char *text)
{
    size_t n = strlen(text);
    while (n && text[n - 1] == '\n')
        text[--n] = 0;
    char *last = strrchr(text, '\n');
    last = last ? last + 1 : text;
    char *colon = strstr(last, ": ");
    return strncmp(last, "elf-", 4) == 0 && colon ? colon + 2 : last;
}

static lf_status finish(const char *path, int result, char *text, lf_error *err)
{
    if (WIFEXITED(result) && WEXITSTATUS(result) == 0)
        return LF_OK;
    if (WIFSIGNALED(result) && WTERMSIG(result) == SIGINT)
        return lf_fail(err, LF_STOPPED, "stopped");
    if (WIFSIGNALED(result))
        return lf_fail(err, LF_FAILED, "%s was ended by signal %d (%s) %s", path, WTERMSIG(result),
                       strsignal(WTERMSIG(result)), message(text));
    return lf_fail(err, WEXITSTATUS(result) == 2 ? LF_BAD_INPUT : LF_FAILED, "%s", message(text));
}

static lf_status run(const char *path, char *const argv[], lf_error *err)
{
    int ends[2], result;
    char text[900];
    pid_t pid;
    if (pipe2(ends, O_CLOEXEC) != 0)
        return lf_fail(err, LF_FAILED, "no pipe to %s: %s", path, strerror(errno));
    const lf_status status = start(path, argv, ends[1], &pid, err);
    close(ends[1]);
    if (status == LF_OK)
        drain(ends[0], text, sizeof text);
    close(ends[0]);
    LF_TRY(status);
    while (waitpid(pid, &result, 0) < 0)
        if (errno != EINTR)
            return lf_fail(err, LF_FAILED, "%s: %s", path, strerror(errno));
    return finish(path, result, text, err);
}

static volatile sig_atomic_t interrupted; /* a signal handler has no other way */

static void on_interrupt(int number)
{
    (void)number;
    interrupted = 1;
}

/* A Ctrl-C that comes before the child is there, or when it has just ended, counts as well. */
lf_status lf_child_run(const char *path, char *const argv[], lf_error *err)
{
    struct sigaction before, keep = {.sa_handler = on_interrupt, .sa_flags = SA_RESTART};
    sigaction(SIGINT, NULL, &before);
    if (before.sa_handler == SIG_IGN)
        return run(path, argv, err);
    interrupted = 0;
    sigaction(SIGINT, &keep, NULL);
    const lf_status status = run(path, argv, err);
    sigaction(SIGINT, &before, NULL);
    return status == LF_OK && interrupted ? lf_fail(err, LF_STOPPED, "stopped") : status;
}
