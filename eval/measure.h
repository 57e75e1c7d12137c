/* measure.h: elf-eval --measure: what a model gives for test items, how long it takes and how much
 * memory, as raw numbers in a file. elf-eval --speed-error starts it, a process for each setting.
 *
 * Seconds: from the views of an item to its mesh or picture. Memory: largest resident set of the
 * process meanwhile, data included; before each item what was freed is given back to the system and
 * the high-water mark is reset (/proc/self/clear_refs).
 */
#ifndef LF_EVAL_MEASURE_H
#define LF_EVAL_MEASURE_H

#include "eval/evaluate.h"
#include "eval/render_job.h"

enum { LF_MEASURE_POINTS = 4096 }; /* fixed points of a shape, spread over the cube of the IoU */

typedef struct lf_measure_options {
    const char *split, *setting; /* setting: of reconstruction; NULL: the training's */
    const char *file;            /* raw_results.h */
    long items;                  /* at most so many shapes or scenes; 0: all */
} lf_measure_options;

/* The first shapes of the split; distances in longest edges of the true box. */
lf_status lf_measure_shapes(lf_loaded *loaded, const lf_measure_options *options, lf_error *err);
/* The views of lf_render_items; colours as the network gives them. */
lf_status lf_measure_views(lf_loaded_renderer *loaded, const lf_measure_options *options,
                           lf_error *err);

#endif
