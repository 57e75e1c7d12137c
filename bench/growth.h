/* growth.h: how time and memory grow with views, pixels, points, rays, samples and width.
 *                                                                     [docs/performance.md]
 * A row is one system's training step or evaluation at a few sizes of one quantity, the other
 * quantities as in the tiny config. If y grows as n^p, p is the slope of log y over log n: over all
 * sizes by least squares, and between the two largest, where what does not grow counts least.
 */
#ifndef LF_BENCH_GROWTH_H
#define LF_BENCH_GROWTH_H

#include <jansson.h>

#include "autograd/status.h"

enum { LF_GROWTH_SIZES = 4, LF_GROWTH_ROWS = 64 };

typedef struct lf_growth_row {
    const char *system, *work, *quantity;
    int count;                       /* of sizes, rising */
    int base;                        /* which of them is the tiny config's */
    double size[LF_GROWTH_SIZES];    /* how many there are; of width: times the config's */
    double seconds[LF_GROWTH_SIZES]; /* the best of some runs */
    double bytes[LF_GROWTH_SIZES];   /* tapes and parameters held */
} lf_growth_row;

typedef struct lf_growth_exponent {
    double fit, last; /* over all sizes, between the two largest */
} lf_growth_exponent;

/* n[count] rising, y > 0, count >= 2. */
lf_growth_exponent lf_growth_exponent_of(int count, const double *n, const double *y);

/* A line that names the columns, and a line of them. */
void lf_growth_head(FILE *to);
void lf_growth_line(FILE *to, const lf_growth_row *row);
/* {"precision", "threads", "rows": [...]}; the caller's. */
json_t *lf_growth_json(const lf_growth_row *rows, int count, int threads);
/* A PNG (growth_picture.c, in float): a panel for every system and work, time over the multiple of
 * the config's size, both logarithmic; a line without points: as if it were linear. */
lf_status lf_growth_picture(const char *path, const lf_growth_row *rows, int count, lf_error *err);

/* elf-bench growth [QUANTITY...] [--system NAME]...: measures and reports. argv[0] is "growth". */
lf_status lf_growth_main(int argc, char **argv, lf_error *err);

#endif
