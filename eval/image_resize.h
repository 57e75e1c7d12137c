/* image_resize.h: a picture at another size.
 *
 * Along each axis, with s = old size / new size, new pixel x lies at u = (x + 1/2) s - 1/2 of the
 * old ones (the borders of both pictures coincide, as docs/conventions.md counts pixels) and is
 *   sum_i w_i old_i / sum_i w_i,   w_i = max(0, 1 - |i - u| / max(1, s)),   i inside the picture:
 * bilinear where the picture grows, an average over about 2 s pixels where it shrinks. The same
 * size gives the same values exactly.
 */
#ifndef LF_EVAL_IMAGE_RESIZE_H
#define LF_EVAL_IMAGE_RESIZE_H

#include "datasets/image.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A new image of width x height pixels and the same channels, which the caller frees. */
lf_image *lf_image_resize(const lf_image *image, int width, int height);
/* The largest size of the image's proportions within width x height; at least one pixel a side. */
void lf_image_fit(int image_width, int image_height, int width, int height, int *out_width,
                  int *out_height);

#ifdef __cplusplus
}
#endif
#endif
