/* lpips.h: LPIPS v0.1, the distance of two images in the features of AlexNet or VGG16.
 *                                              [Zhang et al. 2018; method.md 5b.7; docs/lpips.md]
 *
 * The network and the arithmetic are here; the published weights are the user's to give, as a
 * safetensors file with the names and layouts of torchvision and lpips. Without them LPIPS is not
 * available, which is no number.
 *
 *   x   = (2 image - 1 - shift) / scale       three channels over white, cut to [0, 1]
 *   f_l = features of x after the last ReLU of block l = 1..5, [h_l, w_l, C_l]
 *   u_l = f_l / (|f_l| + 1e-10)               |.| over channels, at each position
 *   d   = sum_l mean over positions of sum_c w_lc (u_l(a) - u_l(b))^2
 *
 * Features are lf_real, the distance from them is in double. Equal images give 0. It is symmetric
 * up to rounding and the same for any number of threads.
 * Memory: two largest feature maps of both images, VGG16: 1 kB a pixel (650 MB at 800 x 800).
 */
#ifndef LF_EVAL_LPIPS_H
#define LF_EVAL_LPIPS_H

#include <jansson.h>

#include "autograd/status.h"
#include "datasets/image.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum lf_lpips_net { LF_LPIPS_VGG, LF_LPIPS_ALEX } lf_lpips_net;
/* "vgg", "alex". */
const char *lf_lpips_net_name(lf_lpips_net net);
/* The other way round. LF_BAD_INPUT names both. */
lf_status lf_lpips_net_parse(const char *name, lf_lpips_net *out, lf_error *err);
/* Pixels a side that the network needs at least: 16 (VGG16), 31 (AlexNet). */
int lf_lpips_smallest(lf_lpips_net net);

/* A network with its weights. Used by one thread at a time (it runs several itself); the caller
 * frees it once, NULL does nothing. */
typedef struct lf_lpips lf_lpips;

/* Read the weights of `net`. LF_BAD_INPUT: no such file, not safetensors, an array that is missing,
 * of another shape or not finite; further arrays (a classifier's) are not read. */
lf_status lf_lpips_open(const char *path, lf_lpips_net net, lf_lpips **out, lf_error *err);
void lf_lpips_free(lf_lpips *lpips);

/* LF_BAD_INPUT: images of two sizes, too small for the network, or not finite. */
lf_status lf_lpips_distance(lf_lpips *lpips, const lf_image *a, const lf_image *b, double *out,
                            lf_error *err);

/* The definition for people, a few lines. */
const char *lf_lpips_text(void);
/* {"definition", "net", "weights"}, the last being the file; with lpips = NULL {"definition",
 * "net": null, "weights": null, "not_available": why}. A new reference; NULL if the file's name
 * is not UTF-8. */
json_t *lf_lpips_json(const lf_lpips *lpips);

#ifdef __cplusplus
}
#endif
#endif
