/* progress.c: one rewritten line on a terminal, plain lines elsewhere. */
#include "train/progress.h"

#include <math.h>
#include <sys/ioctl.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

static const double terminal_interval = 0.1, plain_interval = 5; /* seconds between prints */

lf_progress lf_progress_start(FILE *out, const char *unit, long first, long total, bool quiet)
{
    struct winsize size;
    lf_progress p = {out, unit, isatty(fileno(out)) == 1, quiet, first, total, -1, 0, 80};
    if (p.terminal && ioctl(fileno(out), TIOCGWINSZ, &size) == 0 && size.ws_col > 20)
        p.width = size.ws_col;
    return p;
}

void lf_duration_text(double seconds, char text[24])
{
    if (!(seconds >= 0 && seconds < 1e9)) {
        snprintf(text, 24, "?");
        return;
    }
    const unsigned s = (unsigned)lround(seconds), h = s / 3600, m = s / 60 % 60;
    if (h)
        snprintf(text, 24, "%u:%02u:%02u", h, m, s % 60);
    else
        snprintf(text, 24, "%u:%02u", m, s % 60);
}

/* "step 1200/4000  30%  0:41 elapsed, 1:36 left  " into text; returns its length. */
static size_t describe(const lf_progress *p, long done, double seconds, char *text, size_t size)
{
    char elapsed[24], left[24];
    const double steps = (double)(done - p->first), rest = (double)(p->total - done);
    lf_duration_text(seconds, elapsed);
    lf_duration_text(steps > 0 ? seconds / steps * rest : NAN, left);
    const long percent = p->total > 0 ? 100 * done / p->total : 100;
    const int n = snprintf(text, size, "%s %ld/%ld  %ld%%  %s elapsed, %s left  ", p->unit, done,
                           p->total, percent, elapsed, left);
    return n < 0 ? 0 : (size_t)n < size ? (size_t)n : size - 1;
}

/* Put the text over the line that stands on the terminal. The last column stays free: some
 * terminals would go to the next line. */
static void rewrite(lf_progress *p, const char *text)
{
    int columns = (int)strlen(text);
    if (columns > p->width - 1)
        columns = p->width - 1;
    const int old = p->shown > columns ? p->shown - columns : 0;
    fprintf(p->out, "\r%.*s%*s", columns, text, old, "");
    p->shown = columns;
}

LF_PRINTF(4, 5)
void lf_progress_update(lf_progress *p, long done, double seconds, const char *format, ...)
{
    const double interval = p->terminal ? terminal_interval : plain_interval;
    const bool due = p->printed_at < 0 || seconds - p->printed_at >= interval || done >= p->total;
    if (p->quiet || !due)
        return;
    char text[512];
    const size_t used = describe(p, done, seconds, text, sizeof text);
    va_list args;
    va_start(args, format);
    vsnprintf(text + used, sizeof text - used, format, args);
    va_end(args);
    if (p->terminal)
        rewrite(p, text);
    else
        fprintf(p->out, "%s\n", text);
    fflush(p->out);
    p->printed_at = seconds;
}

LF_PRINTF(2, 3)
void lf_progress_say(lf_progress *p, const char *format, ...)
{
    if (p->shown)
        fprintf(p->out, "\r%*s\r", p->shown, "");
    p->shown = 0;
    va_list args;
    va_start(args, format);
    vfprintf(p->out, format, args);
    va_end(args);
    fprintf(p->out, "\n");
    fflush(p->out);
}

void lf_progress_end(lf_progress *p)
{
    if (p->shown)
        fprintf(p->out, "\n");
    p->shown = 0;
    fflush(p->out);
}

double lf_seconds_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

double lf_peak_rss_mb(void)
{
    struct rusage usage;
    if (getrusage(RUSAGE_SELF, &usage))
        return 0;
    return (double)usage.ru_maxrss * 1024 / 1e6; /* Linux counts kilobytes of 1024 */
}
