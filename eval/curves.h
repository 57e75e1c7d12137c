/* curves.h: elf-eval curves: how several trainings went, as one picture, from their metrics.jsonl.
 *
 * For each part of the columns: loss against steps, loss against seconds, and the figure of the
 * validation against steps if some run has one; below, the seconds and the memory of each training.
 * A point of a loss is the mean over about a fortieth of the training, at the end of that time.
 */
#ifndef LF_EVAL_CURVES_H
#define LF_EVAL_CURVES_H

#include "eval/plot.h"
#include "eval/run_columns.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { LF_CURVE_POINTS = 40 };

/* One training. */
typedef struct lf_curve {
    long points; /* of the loss, <= LF_CURVE_POINTS */
    double step[LF_CURVE_POINTS], seconds[LF_CURVE_POINTS], loss[LF_CURVE_POINTS];
    long checks;                /* validations */
    double *check_step, *check; /* [checks], owned; */
    const char *figure;         /* "val_iou" or "val_psnr": what was checked; NULL: nothing */
    double total_seconds, peak_rss_mb;
} lf_curve;

/* Read <run>/metrics.jsonl. LF_BAD_INPUT: no such file, or a line (which is named) that is no JSON
 * object or lacks a number. Free it with lf_curve_free. */
lf_status lf_curve_read(const char *run, lf_curve *out, lf_error *err);
void lf_curve_free(lf_curve *curve);

/* Draw the runs, folders all, as PNG; title[parts] stands above the plots. LF_BAD_INPUT: as above,
 * more than LF_PLOT_SERIES columns, nothing to draw. */
lf_status lf_curves_write(const lf_run_columns *runs, const char *const *title, const char *path,
                          lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
