/* montage.h: one picture of some shapes, a row each: input views | predicted mesh | true mesh.
 *
 * White ground; the views as the network got them (shade over white); both meshes rendered from the
 * same viewpoints with the same light; a caption above each row. A prediction without faces leaves
 * its cells empty.
 */
#ifndef LF_EVAL_MONTAGE_H
#define LF_EVAL_MONTAGE_H

#include "autograd/status.h"
#include "datasets/image.h"
#include "datasets/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

/* All borrowed. Meshes within radius 0.5 of the origin, predicted in the frame of truth. */
typedef struct lf_montage_row {
    const char *caption;      /* ASCII, e.g. "chair 0012   IoU 0.81"; NULL: none */
    int views, size;          /* images[views][size][size][channels], as lf_views_make fills it */
    int channels;             /* 2: shade, coverage; 4: red, green, blue, coverage; premultiplied */
    const float *images;      /* may be NULL if views is 0 */
    const lf_mesh *predicted; /* may be NULL */
    const lf_mesh *truth;     /* may be NULL */
} lf_montage_row;

typedef struct lf_montage_options {
    int cell;       /* pixels an edge of every picture in it; 16 ... 1024, default 129 */
    int views;      /* input views shown a row, evenly chosen of those given; default 4 */
    int viewpoints; /* pictures a mesh, 1 or 2; default 2 */
} lf_montage_options;

lf_montage_options lf_montage_defaults(void);

/* Write the picture as PNG. LF_BAD_INPUT: options out of range, no rows, a mesh that cannot be
 * rendered; LF_FAILED: the file cannot be written. */
lf_status lf_montage_write(const char *path, long rows, const lf_montage_row *row,
                           const lf_montage_options *options, lf_error *err);

/* ---- its parts, as new images of cell x cell x 3 on white, which the caller frees ---- */

/* One of the row's views, resampled: bilinear, corner pixels on corner pixels. */
lf_image *lf_montage_view(const lf_montage_row *row, int view, int cell);

typedef enum lf_montage_colour { LF_MONTAGE_PREDICTED, LF_MONTAGE_TRUE } lf_montage_colour;
/* A mesh from viewpoint 0 (front, from the right and above) or 1 (from the left, lower); white if
 * it is NULL or has no surface. Errors of lf_render_mesh_picture. */
lf_status lf_montage_mesh(const lf_mesh *mesh, lf_montage_colour colour, int viewpoint, int cell,
                          lf_image **out, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
