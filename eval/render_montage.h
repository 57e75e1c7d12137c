/* render_montage.h: one picture of some views kept from training, a row each:
 * nearest source views | rendered | true | error | depth.
 *
 * White ground; titles above the columns, a caption above each row (scene, view, PSNR, range of
 * depths), the two colour scales at the bottom. Pictures are fitted into cells and keep their
 * proportions.
 *   error  mean over channels of |rendered - true|, both over white and cut to 0..1; 0 black,
 *          error_most and above nearly white
 *   depth  near bright, far dark, even in 1/depth (in depth where near is 0); NaN and infinity,
 *          i.e. nothing there, white
 */
#ifndef LF_EVAL_RENDER_MONTAGE_H
#define LF_EVAL_RENDER_MONTAGE_H

#include "autograd/status.h"
#include "datasets/image.h"

#ifdef __cplusplus
extern "C" {
#endif

/* All borrowed. Any channels; alpha is composited on white. */
typedef struct lf_render_row {
    const char *scene, *view; /* ASCII; NULL: not written */
    double psnr;              /* dB; NaN: not written */
    int sources;
    const lf_image *const *source; /* [sources] nearest first; sizes may differ */
    const lf_image *rendered;      /* may be NULL: empty cells */
    const lf_image *truth;         /* may be NULL; of one size with rendered */
    const float *depth;            /* [height][width] of rendered; may be NULL */
    double near, far;              /* range of the depth's colours, 0 <= near < far */
} lf_render_row;

typedef struct lf_render_montage_options {
    int cell;          /* pixels, edge of the square a picture is fitted into; 32 ... 1024 */
    int views;         /* source views shown a row, 0 ... 16 */
    double error_most; /* where the error's scale ends, > 0 */
} lf_render_montage_options;

lf_render_montage_options lf_render_montage_defaults(void); /* 160, 3, 0.2 */

/* Mean over channels of |a - b|, [height][width] in a new image of one channel. LF_BAD_INPUT as
 * lf_images_agree. */
lf_status lf_image_error_map(const lf_image *a, const lf_image *b, lf_image **out, lf_error *err);
/* A new image of three channels: the depths' colours as above. */
lf_image *lf_depth_picture(const float *depth, int width, int height, double near, double far);

/* Write the picture as PNG. LF_BAD_INPUT: options out of range, no rows or too many, rendered and
 * true of two sizes, near >= far; LF_FAILED: the file cannot be written. */
lf_status lf_render_montage_write(const char *path, long rows, const lf_render_row *row,
                                  const lf_render_montage_options *options, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
