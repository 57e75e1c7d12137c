/* atomic_file.c: temporary file, sync, rename, sync of the folder. */
#include "autograd/atomic_file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdint.h>
#include <unistd.h>

enum { LARGEST_WRITE = 1 << 24 }; /* a fault can strike inside a large file, too */

/* Shall this system call fail? Then errno is set. */
static bool struck(const lf_fault *fault, const char *call)
{
    const int code = fault ? fault->before(fault->user, call) : 0;
    if (code)
        errno = code;
    return code != 0;
}

static bool write_all(int fd, lf_bytes piece, const lf_fault *fault)
{
    const char *data = piece.data;
    while (piece.size) {
        const size_t part = piece.size < LARGEST_WRITE ? piece.size : LARGEST_WRITE;
        const ssize_t done = struck(fault, "write") ? -1 : write(fd, data, part);
        if (done < 0 && errno == EINTR)
            continue;
        if (done < 0)
            return false;
        data += done;
        piece.size -= (size_t)done;
    }
    return true;
}

/* Write, sync and close the temporary file; the name of the call that failed, or NULL. */
static const char *fill(int fd, const lf_bytes *piece, int count, const lf_fault *fault)
{
    const char *failed = NULL;
    for (int i = 0; i < count && !failed; i++)
        failed = write_all(fd, piece[i], fault) ? NULL : "write";
    if (!failed && (struck(fault, "fsync") || fsync(fd)))
        failed = "fsync";
    const int code = errno;
    const bool close_struck = struck(fault, "close");
    if ((close(fd) || close_struck) && !failed)
        return "close";
    errno = code;
    return failed;
}

/* Length of the folder part of path, 0 for the current folder. */
static size_t folder_length(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? (size_t)(slash - path) + 1 : 0;
}

static bool sync_folder(const char *path, const lf_fault *fault)
{
    char folder[4096];
    const size_t length = folder_length(path);
    snprintf(folder, sizeof folder, "%.*s", length ? (int)length : 1, length ? path : ".");
    if (struck(fault, "fsync folder"))
        return false;
    const int fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0)
        return false;
    /* some file systems cannot sync a folder and say EINVAL: nothing more can be done there */
    const bool ok = fsync(fd) == 0 || errno == EINVAL;
    const int code = errno;
    close(fd);
    errno = code;
    return ok;
}

lf_status lf_atomic_write(const char *path, const lf_bytes *piece, int count, const lf_fault *fault,
                          lf_error *err)
{
    char temporary[4096];
    const int length = snprintf(temporary, sizeof temporary, "%s.tmp%ld", path, (long)getpid());
    if (length < 0 || (size_t)length >= sizeof temporary)
        return lf_fail(err, LF_BAD_INPUT, "%.200s...: the path is too long", path);
    int fd = -1;
    if (!struck(fault, "open"))
        fd = open(temporary, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (fd < 0) {
        const bool wrong_path = errno == ENOENT || errno == ENOTDIR;
        return lf_fail(err, wrong_path ? LF_BAD_INPUT : LF_FAILED, "%s: cannot write: %s%s", path,
                       strerror(errno), wrong_path ? " (the folder does not exist)" : "");
    }
    const char *failed = fill(fd, piece, count, fault);
    if (!failed && (struck(fault, "rename") || rename(temporary, path)))
        failed = "rename";
    if (failed) {
        const int code = errno;
        unlink(temporary);
        return lf_fail(err, LF_FAILED, "%s: cannot write (%s: %s); what was there is unchanged",
                       path, failed, strerror(code));
    }
    if (!sync_folder(path, fault))
        return lf_fail(err, LF_FAILED,
                       "%s: written, but a power cut may undo it (syncing the folder: %s)", path,
                       strerror(errno));
    return LF_OK;
}
