/* options.h: the command line of elf-eval. */
#ifndef LF_EVAL_OPTIONS_H
#define LF_EVAL_OPTIONS_H

#include "eval/compare_images.h"
#include "eval/evaluate.h"
#include "eval/make_scene.h"
#include "eval/render_job.h"

enum { LF_MOST_SETS = 256 };

typedef struct lf_arguments {
    const char *checkpoint, *set[LF_MOST_SETS];
    int sets, threads;
    uint64_t given; /* bits 1 << (option - OPT_CHECKPOINT) */
    long check;     /* elements of --check-equivariance; 0: not asked */
    bool speed;     /* --speed-error */
    long repeats;   /* of --speed-error */
    const char *measure;
    const char *names, *readme; /* of compare-runs and curves; of reproduction */
    long samples;
    bool normalise, done;
    lf_evaluate_options evaluate;
    lf_compare_images_options images;
    lf_render_job render; /* path, frames, baselines; the rest is in evaluate and images */
    long views;
    lf_make_scene_options scene;
    int words;
    char **word; /* what is not an option */
} lf_arguments;

enum {
    OPT_CHECKPOINT = 256,
    OPT_SETTING,
    OPT_SPLIT,
    OPT_SHAPES,
    OPT_JSON,
    OPT_OUT,
    OPT_PICTURES,
    OPT_ROLL,
    OPT_DENSE,
    OPT_EXACT,
    OPT_NORMALISE,
    OPT_SAMPLES,
    OPT_LPIPS_WEIGHTS,
    OPT_LPIPS_NET,
    OPT_SET,
    OPT_VIEWS,
    OPT_PATH,
    OPT_FRAMES,
    OPT_NO_BASELINES,
    OPT_LAYOUT,
    OPT_INDEX,
    OPT_SEED,
    OPT_SIZE,
    OPT_MESH,
    OPT_THREADS,
    OPT_QUIET,
    OPT_CHECK,
    OPT_SPEED_ERROR,
    OPT_REPEATS,
    OPT_MEASURE,
    OPT_NAMES,
    OPT_README,
    OPT_HELP,
    OPT_HELP_CONFIG,
    OPT_VERSION
};

/* Read it; help and version are printed at once, and `done` set. LF_BAD_INPUT: an unknown option,
 * or one whose value is not allowed. */
lf_status lf_options_parse(int argc, char **argv, lf_arguments *out, lf_error *err);

bool lf_option_given(const lf_arguments *a, int option);
/* Refuse options that the job has no use for: `used`, with 0 at the end, lists those it has. */
lf_status lf_options_only(const lf_arguments *a, const char *job, const int *used, lf_error *err);
/* Refuse a report that could not be written before the work, not after it. */
lf_status lf_options_report(const char *path, lf_error *err);

#endif
