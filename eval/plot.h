/* plot.h: a small picture of curves: axes with ticks and numbers, title, labels, legend.
 *
 * Up to LF_PLOT_SERIES series of points (x, y), each a line, dots or both, in colours that differ
 * in lightness as well. An axis is linear, or log10; it reaches from one tick to another and holds
 * all points. Ticks are 1, 2 or 5 times a power of ten apart; on a log axis they are powers of ten,
 * with their double and fivefold where it spans less than two. A point with a coordinate that is
 * not finite, or not positive on a log axis, is left out, and its line has a gap there.
 */
#ifndef LF_EVAL_PLOT_H
#define LF_EVAL_PLOT_H

#include "autograd/status.h"
#include "datasets/image.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { LF_PLOT_SERIES = 6 };

typedef enum lf_plot_style { LF_PLOT_BOTH, LF_PLOT_LINE, LF_PLOT_DOTS } lf_plot_style;

typedef struct lf_plot_series {
    const char *name; /* in the legend; NULL: not there */
    long count;
    const double *x, *y; /* [count] */
    lf_plot_style style;
} lf_plot_series;

/* All borrowed; texts are ASCII and may be NULL. */
typedef struct lf_plot {
    const char *title, *x_label, *y_label;
    bool log_x, log_y;
    int width, height; /* pixels, 200 ... 4096; 0: 640 x 420 */
    int series;        /* 1 ... LF_PLOT_SERIES */
    const lf_plot_series *line;
} lf_plot;

/* A new image of three channels on white. LF_BAD_INPUT: size or number of series out of range, no
 * point to draw, or texts that leave no room for the curves. */
lf_status lf_plot_draw(const lf_plot *plot, lf_image **out, lf_error *err);
/* The same as PNG. */
lf_status lf_plot_write(const char *path, const lf_plot *plot, lf_error *err);
/* The column and row, as real numbers, where lf_plot_draw puts the point (x, y). */
lf_status lf_plot_place(const lf_plot *plot, double x, double y, double pixel[2], lf_error *err);
/* The colour of series `index`. */
void lf_plot_colour(int index, float out[3]);

#ifdef __cplusplus
}
#endif
#endif
