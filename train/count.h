/* count.h: parameters and operations of a config's model, without data and without training. */
#ifndef LF_TRAIN_COUNT_H
#define LF_TRAIN_COUNT_H

#include <stdio.h>

#include "autograd/status.h"
#include "configs/configs.h"

/* Print them as a table to `out` (NULL: not), and write them to the file `json` (NULL: not), whole
 * or not at all. Operations are multiply-adds times two, by formula: the useful ones of matrices,
 * filters, samples and attention; not norms, nonlinearities and the expansion of filters.
 * [docs/formats.md] */
lf_status lf_count(const lf_config *cfg, FILE *out, const char *json, lf_error *err);

#endif
