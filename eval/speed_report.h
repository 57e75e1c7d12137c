/* speed_report.h: seconds and memory of settings against error and metric: fronts, what is
 * recommended, as a table, as JSON and as a picture.       [docs/speed-error.md, docs/formats.md]
 */
#ifndef LF_EVAL_SPEED_REPORT_H
#define LF_EVAL_SPEED_REPORT_H

#include <jansson.h>
#include <stdio.h>

#include "eval/speed_score.h"
#include "eval/speed_settings.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Of what a setting is on the Pareto front. A lost metric counts as an error. */
typedef enum lf_speed_front {
    LF_SECONDS_ERROR,
    LF_SECONDS_METRIC,
    LF_MEMORY_ERROR,
    LF_MEMORY_METRIC,
    LF_SPEED_FRONTS
} lf_speed_front;

typedef struct lf_speed_row {
    lf_speed_setting setting;
    lf_speed_figures figures;
    bool front[LF_SPEED_FRONTS]; /* of all rows but the exact one */
} lf_speed_row;

/* Texts are borrowed. Row LF_SPEED_EXACT is the exact result, LF_SPEED_CONFIG the config's setting.
 */
typedef struct lf_speed_report {
    bool rendering;
    const char *model, *split;
    const char *eval_setting; /* reconstruction; NULL: the training's */
    const char *checkpoint;   /* as the user gave it, */
    int sets;                 /* with what else he gave */
    const char *const *set;
    long items, repeats, threads;
    const char *const *item; /* [items] names */
    bool whole_process;      /* memory is that of the process, data being read included */
    double tolerance;        /* of the metric */
    long rows, room;
    lf_speed_row *row; /* owned */
    long recommended;  /* a row */
} lf_speed_report;

/* Append a row; the pointer lasts until the next one. */
lf_speed_row *lf_speed_report_add(lf_speed_report *report, const lf_speed_setting *setting);
void lf_speed_report_clear(lf_speed_report *report);
/* 0.05 dB or 0.005 of IoU. */
double lf_speed_tolerance(bool rendering);
/* Is the row's metric at most the tolerance below the exact one's? */
bool lf_speed_good(const lf_speed_report *report, const lf_speed_row *row);

/* Find fronts and recommendation: the fastest row that is good. */
void lf_speed_report_finish(lf_speed_report *report);

/* The command line that evaluates in a row's setting; malloc'd. */
char *lf_speed_command(const lf_speed_report *report, const lf_speed_row *row);

void lf_speed_report_print(const lf_speed_report *report, FILE *out);
/* A new reference. */
json_t *lf_speed_report_json(const lf_speed_report *report);
/* Four plots and what their numbers mean, as PNG. Errors of lf_plot_draw and lf_image_write_png. */
lf_status lf_speed_report_plot(const lf_speed_report *report, const char *png, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
