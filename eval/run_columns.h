/* run_columns.h: trained runs side by side, as compare-runs and curves are given them.
 *
 * A word of the command line is a column: RUN, or RUN,RUN,... with a run for each part of the
 * picture, such as the same system trained on chairs, airplanes and cars. "none" stands for a run
 * that is not there. All columns have the same number of parts.
 */
#ifndef LF_EVAL_RUN_COLUMNS_H
#define LF_EVAL_RUN_COLUMNS_H

#include "autograd/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct lf_run_columns {
    int columns, parts;
    char **run;  /* [columns][parts] a folder or checkpoint; NULL: not there */
    char **name; /* [columns] */
    char **text; /* [columns + 1] what the above point into */
} lf_run_columns;

/* `names`: one a column, with commas between; NULL: the last parts of the paths. LF_BAD_INPUT: no
 * column, an empty run or name, columns of different parts, another number of names, a part
 * without a run. Free it with lf_run_columns_free. */
lf_status lf_run_columns_parse(int words, char *const *word, const char *names, lf_run_columns *out,
                               lf_error *err);
void lf_run_columns_free(lf_run_columns *c);

/* The run of a column in a part, or NULL. */
const char *lf_run_at(const lf_run_columns *c, int column, int part);
/* The first run of a part. */
const char *lf_run_first(const lf_run_columns *c, int part);

#ifdef __cplusplus
}
#endif
#endif
