/* atomic_file.h: replace a file whole or not at all.
 *
 * The bytes go to a temporary file beside the final name, which is synced, renamed over the final
 * name, and made durable by syncing the folder. Whatever fails, the final name holds the complete
 * old file or the complete new one, and no temporary file stays behind.
 */
#ifndef LF_AUTOGRAD_ATOMIC_FILE_H
#define LF_AUTOGRAD_ATOMIC_FILE_H

#include <stddef.h>

#include "autograd/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A piece of the file; pieces are written one after the other. */
typedef struct lf_bytes {
    const void *data;
    size_t size;
} lf_bytes;

/* For tests of failures: called before each system call ("open", "write", "fsync", "close",
 * "rename", "fsync folder"); a result other than 0 is an errno, and the call fails with it. */
typedef struct lf_fault {
    int (*before)(void *user, const char *call);
    void *user;
} lf_fault;

/* Write the pieces to `path`. fault: NULL except in tests. LF_FAILED with the system's words if the
 * machine refuses (disk full, no permission), LF_BAD_INPUT if the folder does not exist. */
lf_status lf_atomic_write(const char *path, const lf_bytes *piece, int count, const lf_fault *fault,
                          lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
