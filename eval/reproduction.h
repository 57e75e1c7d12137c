/* reproduction.h: elf-eval reproduction: the paper's figures and elf's side by side, as Markdown.
 *
 * A folder holds results, a small JSON object a file, and paper.json, which says what tables there
 * are and what the paper has in them; docs/formats.md has the keys of both. Results of a cell that
 * differ in their seed alone are joined: mean and sample standard deviation (divisor n - 1). A
 * cell without a result says "not run"; a size and data of which a system has none at all has no
 * row. All is in the order of paper.json and of the files' names, so the page does not depend on
 * the order in which the runs came.
 */
#ifndef LF_EVAL_REPRODUCTION_H
#define LF_EVAL_REPRODUCTION_H

#include <stdbool.h>
#include <stdio.h>

#include <jansson.h>

#include "autograd/status.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { LF_RESULT_FIGURES = 7 };
/* iou, chamfer_l1 (times 10), empty, psnr, ssim, lpips, pixel_variance */
extern const char *const lf_result_figure[LF_RESULT_FIGURES];
/* Its number, or -1. */
int lf_result_figure_of(const char *name);

/* One training in one test setting, or what a model costs. Texts belong to `json`. */
typedef struct lf_result {
    char file[256];
    const char *experiment; /* reconstruction, rendering or count */
    const char *system, *config, *keys, *size, *size_keys, *data, *category, *train, *test, *commit,
        *of;
    json_int_t seed, steps, pixels, train_items, test_items, parameters;
    double seconds, peak_rss_mb, flop, flop_forward;
    double item_seconds;              /* of a test item; NaN: not there */
    double figure[LF_RESULT_FIGURES]; /* NaN: not there, or null */
    json_t *json;
} lf_result;

typedef struct lf_results {
    char *folder;
    json_t *paper;
    long count;
    lf_result *result; /* by file name */
} lf_results;

/* One size on one data. */
typedef struct lf_group {
    const char *size, *data;
} lf_group;

/* Read every .json of the folder. LF_BAD_INPUT, naming the file, for what is no JSON, for a key
 * that is missing, unknown or of the wrong type, for two results of one cell and seed, and for
 * seeds of one cell that were trained or tested differently. */
lf_status lf_results_read(const char *folder, lf_results *out, lf_error *err);
void lf_results_free(lf_results *results);

/* Write the page. `paper` has been checked by lf_results_read. */
void lf_results_print(const lf_results *results, FILE *out);
/* Its last two parts: what the models cost, and how the figures came about. */
void lf_results_print_counts(const lf_results *results, FILE *out);
void lf_results_print_runs(const lf_results *results, FILE *out);

/* How far a table's "reference" is above its other systems in the first figure of a group, and what
 * share of its IoU a system keeps in a setting that it was not trained in; the paper's beside, bold
 * where the order is another one. Nothing where the reference and another system were not run. */
void lf_results_print_order(const lf_results *results, const json_t *table, const lf_group *group,
                            FILE *out);

/* What the front page shows of two tables, in the largest size that is there (paper, small, tiny,
 * quick), for each data. False, and nothing printed, if neither was run. */
bool lf_results_print_front(const lf_results *results, FILE *out);
/* The text of the page `path` with that between its two marks, or as it is if nothing was run; the
 * caller frees it. LF_BAD_INPUT: no such page, or no marks. */
lf_status lf_results_front_page(const lf_results *results, const char *path, char **out,
                                lf_error *err);

/* The job: read the folder, replace `path` whole or not at all (NULL: print to stdout), and so the
 * front page `readme` unless it is NULL. */
lf_status lf_reproduction(const char *folder, const char *path, const char *readme, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
