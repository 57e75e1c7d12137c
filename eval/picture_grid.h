/* picture_grid.h: a table of pictures: a head above each column, a caption above each row, a note
 * below each picture.
 *
 * White ground. Pictures are fitted into square cells and keep their proportions. Heads are broken
 * at spaces and hyphens; where one still is too wide for its cell, all heads have small letters.
 */
#ifndef LF_EVAL_PICTURE_GRID_H
#define LF_EVAL_PICTURE_GRID_H

#include "autograd/status.h"
#include "datasets/image.h"

#ifdef __cplusplus
extern "C" {
#endif

/* All borrowed; texts are ASCII. */
typedef struct lf_grid_cell {
    const lf_image *image; /* any channels, alpha over white; NULL: empty */
    const char *note;      /* e.g. "IoU 0.81"; NULL: none */
} lf_grid_cell;

typedef struct lf_grid_row {
    const char *caption;      /* NULL: none */
    const lf_grid_cell *cell; /* [columns] */
} lf_grid_row;

typedef struct lf_picture_grid {
    int cell; /* pixels an edge, 32 ... 1024 */
    int columns;
    const char *const *head; /* [columns] */
    long rows;
    const lf_grid_row *row;
} lf_picture_grid;

/* A new image of three channels. LF_BAD_INPUT: a cell out of range, no columns or no rows, or a
 * picture larger than LF_IMAGE_SIZE_MAX. */
lf_status lf_picture_grid_draw(const lf_picture_grid *grid, lf_image **out, lf_error *err);
/* The same as PNG. */
lf_status lf_picture_grid_write(const char *path, const lf_picture_grid *grid, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
