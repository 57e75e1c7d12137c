/* speed_score.h: how far what a setting gives is from the exact result, and how good it is.
 *                                                                          [docs/speed-error.md]
 * Distances are in longest edges of the true shape's box; colours are 0..1.
 */
#ifndef LF_EVAL_SPEED_SCORE_H
#define LF_EVAL_SPEED_SCORE_H

#include "configs/configs.h"
#include "eval/raw_results.h"

/* Means over the items but for the largest ones. */
typedef struct lf_speed_figures {
    double seconds;     /* of an item */
    double cpu_seconds; /* the same of all threads together: what a shared machine disturbs less */
    double memory_mb;   /* most that any item added to what the process held before the first */
    double peak_mb;     /* largest resident set */
    double work;        /* reconstruction: points evaluated; rendering: (sample, view) pairs */
    double error;       /* reconstruction: Chamfer distance, to the surface, between its mesh and
                           the exact one; rendering: RMS difference of the colours */
    double point_mean;  /* mean difference of distances at fixed points, or of colours */
    double point_largest; /* the largest of them */
    double unseen;        /* share of the points that the exact result sees and this does not */
    double metric;        /* IoU against the truth; PSNR against the photograph, dB */
    double chamfer;       /* reconstruction: Chamfer-L1 to the truth as elf-eval has it, not times
                             10; else NaN */
} lf_speed_figures;

/* The truth about the test items. */
typedef struct lf_speed_truth lf_speed_truth;

/* At most `items` shapes or scenes (0: all) of the split; setting: of reconstruction, or NULL. The
 * views of a scene are those of eval.views. Errors of the data. */
lf_status lf_speed_truth_open(const lf_config *cfg, const char *split, const char *setting,
                              long items, lf_speed_truth **out, lf_error *err);
void lf_speed_truth_close(lf_speed_truth *truth);
long lf_speed_items(const lf_speed_truth *truth);
/* "chair-test-0003", or scene and view. */
const char *lf_speed_item_name(const lf_speed_truth *truth, long item);

/* Fill all figures but seconds and memory. LF_FAILED: the results are of other items. */
lf_status lf_speed_score(const lf_speed_truth *truth, const lf_raw *exact, const lf_raw *raw,
                         lf_speed_figures *out, lf_error *err);

#endif
