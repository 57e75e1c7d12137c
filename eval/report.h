/* report.h: the figures of an evaluation as JSON and as a table; docs/formats.md has the format.
 *
 * JSON keys: experiment, model, category, train_setting, eval_setting, split, shapes, iou,
 * chamfer_l1, seconds_per_shape, peak_rss_mb, empty, baselines{hull, mean_shape}, metric,
 * per_shape[{id, iou, chamfer_l1, seconds, faces, empty, baselines{hull, mean_shape}}]. iou,
 * chamfer_l1 and seconds_per_shape are plain means over all shapes; an empty prediction counts
 * with the worst value. chamfer_l1 is times LF_CHAMFER_FACTOR (10) here and nowhere else; `metric`
 * holds the definitions.
 */
#ifndef LF_EVAL_REPORT_H
#define LF_EVAL_REPORT_H

#include <stdio.h>

#include <jansson.h>

#include "autograd/status.h"
#include "eval/metrics.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Reconstructions that learn nothing, scored beside the model's. */
typedef enum lf_shape_baseline {
    LF_SHAPE_HULL, /* hull.h */
    LF_SHAPE_MEAN, /* mean_shape.h */
    LF_SHAPE_BASELINES
} lf_shape_baseline;

typedef struct lf_shape_baseline_score {
    double iou, chamfer_l1; /* as lf_score has it, not times 10 */
    long empty;             /* of a shape: 1 or 0 */
} lf_shape_baseline_score;

typedef struct lf_report_shape {
    char id[128]; /* UTF-8; longer names are cut */
    double iou;
    double chamfer_l1; /* as lf_score has it, not times 10 */
    double seconds;    /* from views to mesh */
    long faces;
    bool empty;
    lf_shape_baseline_score baseline[LF_SHAPE_BASELINES]; /* those that the report has */
} lf_report_shape;

/* Fill the strings (borrowed; NULL is written as "") and the options; shapes come by lf_report_add.
 */
typedef struct lf_report {
    const char *experiment, *model, *category, *train_setting, *eval_setting, *split;
    double peak_rss_mb;
    lf_metric_options metric;
    bool has[LF_SHAPE_BASELINES]; /* every shape gets the score of these */
    long shapes, room;
    lf_report_shape *shape;
} lf_report;

typedef struct lf_report_means {
    double iou, chamfer_l1 /* not times 10 */, seconds;
    long empty;
    lf_shape_baseline_score baseline[LF_SHAPE_BASELINES]; /* those that the report has */
} lf_report_means;

/* Append one shape; the figures must be finite. */
void lf_report_add(lf_report *report, const char *id, const lf_score *score, double seconds,
                   long faces);
/* A baseline's score on the shape added last; the report must have that baseline. */
void lf_report_add_baseline(lf_report *report, lf_shape_baseline which, const lf_score *score);
/* Free the shapes; the report may be filled again. */
void lf_report_clear(lf_report *report);
/* Means over all shapes; zeros if there is none. */
lf_report_means lf_report_mean(const lf_report *report);

/* The definitions as a JSON object: {"iou": {definition, samples, region}, "chamfer_l1":
 * {definition, distance, samples, unit, factor}, "empty", "seed"}. A new reference. */
json_t *lf_metric_json(const lf_metric_options *options);
/* The whole report. A new reference. */
json_t *lf_report_json(const lf_report *report);

/* Replace the file `path` whole or not at all (autograd/atomic_file.h). LF_BAD_INPUT: the folder is
 * missing; LF_FAILED: the disk refuses; an older file at `path` is then as it was. */
lf_status lf_json_write(const char *path, const json_t *json, lf_error *err);
lf_status lf_report_write(const lf_report *report, const char *path, lf_error *err);

/* The same as a table, a line a shape and the means below, with what the columns mean. */
void lf_report_print(const lf_report *report, FILE *out);

#ifdef __cplusplus
}
#endif
#endif
