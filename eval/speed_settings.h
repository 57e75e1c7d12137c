/* speed_settings.h: which savings a model's evaluation has, as settings to try.
 *                                                                          [docs/speed-error.md]
 * A setting is a program (elf-eval or elf-eval-f64) and keys that override the config's, so that
 * what is measured can be used as it is. Number LF_SPEED_EXACT has everything off, in double: all
 * errors are measured against it. Number LF_SPEED_CONFIG is the config's own. Each of the others
 * changes one saving, taken off, on, or to another degree.
 */
#ifndef LF_EVAL_SPEED_SETTINGS_H
#define LF_EVAL_SPEED_SETTINGS_H

#include "configs/configs.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { LF_SPEED_EXACT, LF_SPEED_CONFIG, LF_SPEED_FIRST };
enum { LF_SPEED_NAME = 192, LF_SPEED_KEYS = 16, LF_SPEED_KEY = 48 };

typedef struct lf_speed_setting {
    char name[LF_SPEED_NAME]; /* "12 samples" */
    const char *saving;       /* "samples"; settings of one saving exclude each other */
    bool f64;                 /* by elf-eval-f64 */
    int keys;
    char key[LF_SPEED_KEYS][LF_SPEED_KEY]; /* "render.samples=12" */
} lf_speed_setting;

/* The settings of a checked config, without those that lf_config_check refuses (views too small for
 * the network); *count of them, the caller frees the array. */
lf_speed_setting *lf_speed_settings(const lf_config *cfg, long *count);

/* Does lf_config_check take the config with the setting's keys? */
bool lf_speed_allowed(const lf_config *cfg, const lf_speed_setting *setting);

/* Both changes, of two savings: name "a + b". The keys of b come last; each may be allowed alone
 * and both not (a coarse grid as fine as one grid, the half of it as the other). */
lf_speed_setting lf_speed_join(const lf_speed_setting *a, const lf_speed_setting *b);

#ifdef __cplusplus
}
#endif
#endif
