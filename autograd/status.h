/* status.h: how a function reports that something outside the program is wrong.
 *
 * Everything that touches the outside (a file, a config, a command line) returns an lf_status and
 * fills an lf_error that the caller owns; outputs stay untouched. The text says which file, line
 * or key, what was found, what is allowed and what to do; callers add context in front with
 * lf_error_context; the program prints it once and exits. Inside the program wrong shapes are the
 * programmer's error: LF_REQUIRE prints and aborts. This header has no state and needs nothing,
 * so every folder may include it.
 */
#ifndef LF_AUTOGRAD_STATUS_H
#define LF_AUTOGRAD_STATUS_H

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum lf_status {
    LF_OK = 0,
    LF_BAD_INPUT = 2, /* a file, value or command line that the user must mend: exit code 2 */
    LF_FAILED = 1,    /* the machine failed (disk full, no memory): exit code 1 */
    LF_STOPPED = 130  /* the user stopped the program and its work is saved: exit code 130 */
} lf_status;

typedef struct lf_error {
    char text[1024];
} lf_error;

#if defined(__GNUC__)
#define LF_PRINTF(text, first) __attribute__((format(printf, text, first)))
#else
#define LF_PRINTF(text, first)
#endif

/* Write the message into *err (which may be NULL) and return `status`. */
LF_PRINTF(3, 4)
static inline lf_status lf_fail(lf_error *err, lf_status status, const char *format, ...)
{
    if (err) {
        va_list args;
        va_start(args, format);
        vsnprintf(err->text, sizeof err->text, format, args);
        va_end(args);
    }
    return status;
}

/* Put context in front of a message: "outer: inner". Returns `status`. */
LF_PRINTF(3, 4)
static inline lf_status lf_error_context(lf_error *err, lf_status status, const char *format, ...)
{
    if (err) {
        char outer[512];
        va_list args;
        va_start(args, format);
        vsnprintf(outer, sizeof outer, format, args);
        va_end(args);
        const lf_error inner = *err;
        snprintf(err->text, sizeof err->text, "%s: %.*s", outer, (int)(sizeof inner.text - 516),
                 inner.text);
    }
    return status;
}

/* Leave the calling function with the status of `call` unless it is LF_OK. */
#define LF_TRY(call)                                                                               \
    do {                                                                                           \
        lf_status lf_try_status = (call);                                                          \
        if (lf_try_status != LF_OK)                                                                \
            return lf_try_status;                                                                  \
    } while (0)

/* A programmer's error: say what was wrong and abort. Never for input from outside. */
#define LF_REQUIRE(condition, ...)                                                                 \
    do {                                                                                           \
        if (!(condition)) {                                                                        \
            fprintf(stderr, "%s:%d: ", __FILE__, __LINE__);                                        \
            fprintf(stderr, __VA_ARGS__);                                                          \
            fprintf(stderr, " (%s)\n", #condition);                                                \
            abort();                                                                               \
        }                                                                                          \
    } while (0)

#ifdef __cplusplus
}
#endif
#endif
