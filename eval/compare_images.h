/* compare_images.h: the figures of any two image files ("elf-eval compare-images A B"). */
#ifndef LF_EVAL_COMPARE_IMAGES_H
#define LF_EVAL_COMPARE_IMAGES_H

#include <stdio.h>

#include "autograd/status.h"
#include "eval/lpips.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct lf_compare_images_options {
    const char *weights; /* of LPIPS (docs/lpips.md), or NULL: not available */
    lf_lpips_net net;    /* whose weights these are */
    const char *json;    /* a file for the object as well, or NULL */
} lf_compare_images_options;

/* Print PSNR, SSIM and LPIPS of two image files of one size as a JSON object to `out` (NULL:
 * nowhere); docs/formats.md names its keys. LF_BAD_INPUT: a file that cannot be read, two sizes,
 * an image smaller than a metric's window, bad weights; nothing is printed then. */
lf_status lf_compare_images(const char *a, const char *b, const lf_compare_images_options *options,
                            FILE *out, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
