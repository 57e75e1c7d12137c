/* compare_runs.h: elf-eval compare-runs: what several trained systems make of the same shapes or
 * views, as one picture.
 *
 *   reconstruction  a row a shape and setting: input views | each system's mesh, IoU | truth
 *   rendering       three rows a view: truth and each system's picture with its PSNR; the same with
 *                   the whole frame turned (SO3); what that changed
 *
 * A part of lf_run_columns is a block of rows. Every run is read with its own config, and must see
 * the same shapes from the same cameras, or render the same views.
 */
#ifndef LF_EVAL_COMPARE_RUNS_H
#define LF_EVAL_COMPARE_RUNS_H

#include "configs/configs.h"
#include "eval/picture_grid.h"
#include "eval/run_columns.h"

typedef struct lf_compare_runs_options {
    const lf_run_columns *runs;
    const char *split;    /* train, val or test */
    const char *settings; /* reconstruction: "I,Z"; NULL: that of the training */
    int sets;             /* "key=value", for every run */
    const char *const *set;
    long items;      /* shapes or views of a part, at most */
    const char *out; /* the PNG */
    bool quiet;
} lf_compare_runs_options;

/* Names of the parts: what their first runs were trained on, a category or "scenes"; [parts],
 * malloc'd, as are the texts. LF_BAD_INPUT: a run that cannot be read, or runs for reconstruction
 * and for rendering together; *renders tells which, unless it is NULL. */
lf_status lf_run_titles(const lf_run_columns *runs, char ***title, bool *renders, lf_error *err);
void lf_run_titles_free(const lf_run_columns *runs, char **title);

/* LF_BAD_INPUT: as above; settings for renderers; other shapes, cameras or views than the first
 * run's; errors of the evaluations. Nothing is written then. */
lf_status lf_compare_runs(const lf_compare_runs_options *options, lf_error *err);

/* ---- shared by both kinds --------------------------------------------------------------------
 */

/* A picture_grid that owns its pictures and texts. */
typedef struct lf_picture_table {
    int columns;
    long rows;
    lf_image **image; /* [rows][columns] */
    char **note;      /* [rows][columns] */
    char **caption;   /* [rows] */
} lf_picture_table;

/* Append `rows` empty rows; returns the number of the first one. */
long lf_picture_table_add(lf_picture_table *t, long rows);
/* Fill a cell, once: takes over the image; what stands below it; above the row. */
void lf_picture_table_put(lf_picture_table *t, long row, int column, lf_image *image);
LF_PRINTF(4, 5)
void lf_picture_table_note(lf_picture_table *t, long row, int column, const char *format, ...);
LF_PRINTF(3, 4)
void lf_picture_table_caption(lf_picture_table *t, long row, const char *format, ...);

/* Add the blocks of all parts to the table. */
lf_status lf_compare_shapes(const lf_compare_runs_options *options, lf_picture_table *table,
                            lf_error *err);
lf_status lf_compare_scenes(const lf_compare_runs_options *options, lf_picture_table *table,
                            lf_error *err);
/* Columns of pictures before the systems', and after them. */
enum { LF_SHAPE_VIEWS = 2, LF_SHAPE_TRUTHS = 1, LF_SCENE_TRUTHS = 1 };

#endif
