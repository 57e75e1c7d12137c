/* reproduction_cells.h: results of one training and test setting together: cells of a table, and
 * which sizes and data there are.
 */
#ifndef LF_EVAL_REPRODUCTION_CELLS_H
#define LF_EVAL_REPRODUCTION_CELLS_H

#include "eval/reproduction.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Results of one training and test setting; NULL matches all. */
typedef struct lf_cell {
    const char *experiment, *system, *size, *data, *category, *train, *test;
} lf_cell;

bool lf_in_cell(const lf_result *result, const lf_cell *cell);

/* Mean and sample standard deviation of a figure over the results of a cell. */
typedef struct lf_moments {
    int n, lacking; /* results with and without the figure */
    double mean, deviation;
} lf_moments;
lf_moments lf_moments_of(const lf_results *results, const lf_cell *cell, int figure);

/* Digits behind the point that a figure is printed with. */
int lf_figure_digits(int figure);
/* The text of a key of a JSON object. */
const char *lf_text_of(const json_t *object, const char *key);

/* 0 quick ... 3 paper; 4: another size. */
int lf_size_rank(const char *size);
/* The groups of the cell's results, small sizes first; malloc'd. */
lf_group *lf_groups_of(const lf_results *results, const lf_cell *cell, long *count);

/* The rest of a Markdown table's head behind its first two columns, a column a setting of the table
 * of paper.json, and the line below it. */
void lf_print_settings(const json_t *table, FILE *out);

/* The cell of a row of a table of paper.json in its setting number i, of a group or of none (NULL);
 * its training setting is put into `train`. */
lf_cell lf_cell_at(const json_t *table, const json_t *row, const lf_group *group, size_t i,
                   char train[32]);

#ifdef __cplusplus
}
#endif
#endif
