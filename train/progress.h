/* progress.h: how far a long piece of work is, for a person.
 *
 * On a terminal one line is rewritten (by carriage return; no other control characters), at most
 * ten times a second. Elsewhere whole lines are printed, at most one in five seconds and always the
 * last. The clock belongs to the caller: `seconds` is the time since lf_progress_start.
 *
 *     step 1200/4000  30%  0:41 elapsed, 1:36 left  loss 0.183
 */
#ifndef LF_TRAIN_PROGRESS_H
#define LF_TRAIN_PROGRESS_H

#include <stdbool.h>
#include <stdio.h>

#include "autograd/status.h"

typedef struct lf_progress {
    FILE *out;
    const char *unit;  /* "step" */
    bool terminal;     /* rewrite one line */
    bool quiet;        /* print nothing but lf_progress_say */
    long first, total; /* work done before the start, and at the end */
    double printed_at; /* seconds at the last print, or -1 */
    int shown;         /* columns of the line that stands on the terminal */
    int width;         /* columns of the terminal */
} lf_progress;

/* Work from `first` (after a resume more than 0) to `total`. `unit` must outlive the progress. */
lf_progress lf_progress_start(FILE *out, const char *unit, long first, long total, bool quiet);

/* `done` of total are done; the text is put behind the estimate. Call it as often as you like. */
LF_PRINTF(4, 5)
void lf_progress_update(lf_progress *p, long done, double seconds, const char *format, ...);

/* Print a line of its own, quiet or not, without spoiling the rewritten one. */
LF_PRINTF(2, 3)
void lf_progress_say(lf_progress *p, const char *format, ...);

/* Leave the rewritten line standing and go to a new one. */
void lf_progress_end(lf_progress *p);

/* "0:07", "12:34" or "3:02:10"; "?" if seconds is not finite or negative. text holds 24 bytes. */
void lf_duration_text(double seconds, char text[24]);

/* Seconds of a clock that never goes back, from an arbitrary beginning. */
double lf_seconds_now(void);

/* The most memory this process has held, in MB of 10^6 bytes. */
double lf_peak_rss_mb(void);

#endif
