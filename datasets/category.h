/* category.h: which meshes belong to a category and a split.
 *
 * A category is the folder <root>/<category>, in one of two layouts:
 *
 *   lists      train.lst, val.lst, test.lst with one id a line ('#' begins a comment), and for each
 *              id <id>/model.obj, <id>/models/model_normalized.obj, <id>/model_normalized.obj
 *              or <id>/model.{ply,off,stl}                                    (ShapeNet),
 *              or, if there is none, the file <id>.{obj,ply,off,stl}
 *   folder     no list: every OBJ, PLY, OFF and STL file, its id the name without the ending, and
 *              every subfolder that holds a model as above. The split is drawn by a hash of the id,
 *              about 70 % train, 10 % val, 20 % test, the same on every machine; it does not change
 *              for the others when a file is added. `drawn` says so.
 *
 * Ownership: lf_category_open gives a handle that the caller closes once; lf_category_close(NULL)
 *            does nothing.
 * Errors:    LF_BAD_INPUT with file and line; outputs untouched.
 */
#ifndef LF_DATASETS_CATEGORY_H
#define LF_DATASETS_CATEGORY_H

#include <stdbool.h>

#include "autograd/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct lf_category_item {
    char *id;
    char *path; /* of the mesh file */
} lf_category_item;

typedef struct lf_category {
    long count;
    lf_category_item *item; /* [count], sorted by id (byte order) */
    bool drawn;             /* the split was drawn by hash, no list was found */
} lf_category;

/* `split` is "train", "val", "test" or "all" (the three together). LF_BAD_INPUT: no such folder, no
 * list for this split while another split has one, an id named twice or with a '/', an id without
 * a mesh file, a split without a shape, two files of one id. */
lf_status lf_category_open(const char *root, const char *category, const char *split,
                           lf_category **out, lf_error *err);
void lf_category_close(lf_category *category);

/* The split that the hash of an id draws in a folder without lists. */
const char *lf_category_drawn_split(const char *id);

#ifdef __cplusplus
}
#endif
#endif
