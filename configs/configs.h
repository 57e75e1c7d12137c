/* configs.h: what a run is made of, as keys "section.name" with checked values.
 *
 *     lf_config *cfg;
 *     LF_TRY(lf_config_load("configs/reconstruct-tiny.ini", &cfg, err));
 *     LF_TRY(lf_config_set(cfg, "train.steps=100", err));        (the --set of the programs)
 *     LF_TRY(lf_config_check(cfg, err));                         (keys that must fit each other)
 *     long steps = lf_config_int(cfg, "train.steps");
 *
 * One table, configs/schema.c, holds every key with its type, range, default and help; there is no
 * other key. An INI file gives some of them, the rest keep their defaults:
 *
 *     # a comment has a line of its own, or follows a value after " ;"
 *     [train]
 *     steps = 4000
 *     lr = 5e-3        ; a number
 *
 * Lists of whole numbers are written 1, 1, 1. A line may have 198 bytes, text 160.
 *
 * Errors:  LF_BAD_INPUT for everything wrong in a file or an override: unknown section or key (with
 *          the nearest known one), a value of the wrong type or out of range, a key given twice, a
 *          line that is too long, indented or no "key = value", a NUL byte. The text names file,
 *          line, key and what is allowed. After a failed call nothing has changed.
 * Getters: a key that the schema does not have, or a getter of another type, is the caller's
 * mistake and aborts. Threads: any number may read one config.
 */
#ifndef LF_CONFIGS_H
#define LF_CONFIGS_H

#include <stdbool.h>
#include <stdio.h>

#include "autograd/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct lf_config lf_config;

/* Defaults overridden by the file; path NULL: the defaults alone. The caller frees *out. */
lf_status lf_config_load(const char *path, lf_config **out, lf_error *err);

/* The same from text in memory, such as the text stored in a checkpoint; `name` stands for the file
 * in messages. */
lf_status lf_config_parse_text(const char *text, const char *name, lf_config **out, lf_error *err);

/* Override one key: "section.key=value" ("--set" stands for the file in messages). */
lf_status lf_config_set(lf_config *cfg, const char *assignment, lf_error *err);

/* The overrides of a trained network's config, then lf_config_check. LF_BAD_INPUT also for a key
 * that says what the network is and that would change: all of [model] but norm_momentum, all of
 * [render] but sources, samples and fine_samples, and loss.scale. The parameters may fit either
 * value (heads, smoothing). */
lf_status lf_config_set_trained(lf_config *cfg, int n, const char *const *assignment,
                                lf_error *err);

/* Keys that must fit each other (lengths of lists, channels and heads). Call after the last set. */
lf_status lf_config_check(const lf_config *cfg, lf_error *err);

/* Values that are allowed but rarely wanted, one line each; returns their number. */
int lf_config_warn(const lf_config *cfg, FILE *out);

void lf_config_free(lf_config *cfg);

long lf_config_int(const lf_config *cfg, const char *key);
double lf_config_real(const lf_config *cfg, const char *key);
bool lf_config_bool(const lf_config *cfg, const char *key);
/* Text and paths; owned by cfg, valid until the key is set again. */
const char *lf_config_string(const lf_config *cfg, const char *key);
/* The chosen word, a constant. */
const char *lf_config_choice(const lf_config *cfg, const char *key);
/* Is the chosen word `word`? A word that is no choice of the key aborts. */
bool lf_config_is(const lf_config *cfg, const char *key, const char *word);
/* Is model.type a renderer (and not a network for reconstruction)? */
bool lf_config_renders(const lf_config *cfg);
/* A list of *count >= 1 numbers, owned by cfg, valid until the key is set again. */
const long *lf_config_ints(const lf_config *cfg, const char *key, int *count);

/* Did the file or an override give this key (even its default value)? */
bool lf_config_given(const lf_config *cfg, const char *key);

/* The whole resolved config as INI text, in the order of the schema; parsing it gives the same
 * config, bit for bit. malloc'd; the caller frees it. */
char *lf_config_text(const lf_config *cfg);

/* Every key with type, range, default and help. */
void lf_config_help(FILE *out);

#ifdef __cplusplus
}
#endif
#endif
