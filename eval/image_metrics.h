/* image_metrics.h: how far one image is from another, and images from each other. [method.md 5b.7]
 *
 * Every function first makes three channels of what it is given: grey becomes three equal channels,
 * alpha is composited on white, values are cut to [0, 1]. All sums are in double.
 *
 * PSNR            10 log10(1 / mse) dB, mse the mean over pixels and channels of the squared
 *                 difference; peak 1. At most 100 dB, which equal images have.
 * SSIM            means, variances and covariance in an 11 x 11 Gaussian window of standard
 *                 deviation 1.5 that sums to 1 (so with divisor n), K = (0.01, 0.03), peak 1; only
 *                 windows inside the image; mean over windows and channels. It is tf.image.ssim,
 *                 and skimage's structural_similarity(gaussian_weights=True, sigma=1.5,
 *                 use_sample_covariance=False, data_range=1).
 * Pixel variance  of renderings that should be equal: values 0..255, not rounded; variance with
 *                 divisor n for each pixel and channel; the largest of them. A data set has the
 *                 mean over its items.
 *
 * Threads: results do not depend on their number. Errors: *out untouched, *err filled (may be
 * NULL); LF_BAD_INPUT: images of two sizes, values that are not finite, an image below the window.
 */
#ifndef LF_EVAL_IMAGE_METRICS_H
#define LF_EVAL_IMAGE_METRICS_H

#include <jansson.h>

#include "autograd/status.h"
#include "datasets/image.h"

#ifdef __cplusplus
extern "C" {
#endif

#define LF_PSNR_MOST 100.0 /* dB, of equal images */
enum { LF_SSIM_WINDOW = 11 };

/* The definitions above for people, a few lines with units. */
const char *lf_image_metric_text(void);
/* The same as a JSON object {"image", "psnr", "ssim", "pixel_variance"}, texts each. A new
 * reference. */
json_t *lf_image_metric_json(void);

lf_status lf_psnr(const lf_image *a, const lf_image *b, double *out, lf_error *err);
lf_status lf_ssim(const lf_image *a, const lf_image *b, double *out, lf_error *err);
/* Of count >= 1 images of one size. */
lf_status lf_pixel_variance(int count, const lf_image *const *image, double *out, lf_error *err);

/* ---- shared by the metrics ------------------------------------------------------------------- */

/* Both images are of one size and finite; the message names both sizes, or the place. */
lf_status lf_images_agree(const lf_image *a, const lf_image *b, lf_error *err);
/* Three channels over white, cut to [0, 1]; a new image. */
lf_image *lf_image_for_metrics(const lf_image *image);

#ifdef __cplusplus
}
#endif
#endif
