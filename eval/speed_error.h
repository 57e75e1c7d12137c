/* speed_error.h: elf-eval --speed-error: what each saving of an evaluation costs and brings.
 *                                                                          [docs/speed-error.md]
 * The same test items are evaluated in several settings (speed_settings.h), each in a process of
 * its own (elf-eval --measure, elf-eval-f64 --measure), so that memory is that setting's alone.
 * First the exact result; then all settings in turn, `repeats` times, of which the best time
 * counts; then combinations of the savings that cost little: of each saving the fastest setting
 * within the tolerance is taken, those that save most first, and each is kept if the combination is
 * faster and still within the tolerance.
 */
#ifndef LF_EVAL_SPEED_ERROR_H
#define LF_EVAL_SPEED_ERROR_H

#include "configs/configs.h"
#include "eval/raw_results.h"

typedef struct lf_speed_options {
    const char *checkpoint; /* the file */
    const char *given;      /* as the user gave it, for the line that is recommended */
    int sets;
    const char *const *set;      /* "key=value", the user's; they are in the config already */
    const char *split, *setting; /* setting: of reconstruction, or NULL */
    const char *json, *out;      /* or NULL: a report; a folder for the picture */
    long items;                  /* at most so many shapes or scenes; 0: all */
    long views;                  /* of a scene */
    long repeats;
    int threads; /* 0: as the programs choose */
    bool quiet;
} lf_speed_options;

/* Errors of the data and of the programs that are started. */
lf_status lf_speed_error(const lf_config *cfg, const lf_speed_options *options, lf_error *err);

/* ---- its parts --------------------------------------------------------------------------------
 */

struct lf_speed_setting;

/* The programs that are started. */
typedef struct lf_speed_runner {
    const lf_speed_options *options;
    char *program[2]; /* in float, in double */
} lf_speed_runner;

/* Find both programs. */
lf_status lf_speed_runner_open(const lf_speed_options *options, lf_speed_runner *out,
                               lf_error *err);
void lf_speed_runner_close(lf_speed_runner *runner);
/* Evaluate the items in a setting, in a new process; the caller frees the results. They come
 * through a folder in /tmp that is there meanwhile only. */
lf_status lf_speed_run(const lf_speed_runner *runner, const struct lf_speed_setting *setting,
                       lf_raw **out, lf_error *err);

#endif
