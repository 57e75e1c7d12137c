/* ops_image.h: differentiable ops on feature maps.
 *
 * Feature maps are [images, height, width, channels]. A field is `group` adjacent channels that
 * share statistics and affine parameters: the eight orientations of a regular C8 field, or one
 * channel. Every op is parallel over images and gives the same bits for any number of threads;
 * wrong shapes abort with both shapes. Outputs belong to the tape.
 */
#ifndef LF_AUTOGRAD_OPS_IMAGE_H
#define LF_AUTOGRAD_OPS_IMAGE_H

#include "autograd/autograd.h"
#include "autograd/kernels/kernels.h" /* lf_activation */

/* y[n, i, j, o] = act(b[o] + sum_{p, q, c} x[n, i stride + p - pad, j stride + q - pad, c]
 * w[p, q, c, o]), zero outside the image. x [N, H, W, Ci], w [k, k, Ci, Co], b [Co] or NULL;
 * y [N, (H + 2 pad - k) / stride + 1, ..., Co]. */
lf_tensor *lf_conv2d(lf_tape *tape, lf_tensor *x, lf_tensor *w, lf_tensor *b, long stride, long pad,
                     lf_activation act);

/* Over what lf_field_norm takes mean and variance. */
typedef enum lf_norm_mode {
    LF_NORM_BATCH,   /* all images and pixels of a field; updates the running statistics */
    LF_NORM_RUNNING, /* the running statistics, constants for the gradient */
    LF_NORM_INSTANCE /* each image by itself; running statistics are not used */
} lf_norm_mode;

typedef struct lf_field_norm_options {
    lf_norm_mode mode;
    int group;             /* channels a field: 8 for regular fields, 1 for plain channels */
    double epsilon;        /* added to the variance before the square root; 1e-5 */
    double momentum;       /* BATCH: running = (1 - momentum) running + momentum batch */
    bool relu;             /* y = max(0, ...) last */
    lf_real *running_mean; /* [fields], NULL for INSTANCE; BATCH writes them in the forward pass, */
    lf_real *running_var;  /* which is the op's one side effect (NULL: not kept) */
} lf_field_norm_options;

/* y = act(gamma_f (x - mean_f) / sqrt(var_f + epsilon) + beta_f + residual), f the channel's field.
 * x [N, H, W, C], gamma and beta [C / group], residual like x or NULL. The variance has divisor n
 * (also the running one) and is taken in two passes an image, images joined in order. */
lf_tensor *lf_field_norm(lf_tape *tape, lf_tensor *x, lf_tensor *gamma, lf_tensor *beta,
                         lf_tensor *residual, const lf_field_norm_options *options);

/* Largest of each size x size window, channel by channel; pixels outside the image do not count.
 * Of equal values the first in row order gets the gradient. x [N, H, W, C], pad < size. */
lf_tensor *lf_max_pool(lf_tape *tape, lf_tensor *x, long size, long stride, long pad);

/* Each channel smoothed by the 3x3 binomial filter (1 2 1; 2 4 2; 1 2 1) / 16, lines beyond the
 * border repeating it: what an image needs before a stride of 2. x [N, H, W, C] -> the same.
 * [method.md 5a.2] */
lf_tensor *lf_blur(lf_tape *tape, lf_tensor *x);

/* The image with a border that mirrors it at its outermost pixels, which are not repeated: x
 * [N, H, W, C] -> [N, H + 2 pad, W + 2 pad, C]; H and W > pad. */
lf_tensor *lf_reflect_pad(lf_tape *tape, lf_tensor *x, long pad);

/* Maps at another size, bilinear: x [N, H, W, C] -> [N, height, width, C]. Corners aligned: line i
 * of the result is line i (H - 1) / (height - 1) of x; else (i + 1/2) H / height - 1/2, at least 0.
 * Lines beyond the last are the last; likewise columns. */
lf_tensor *lf_resize(lf_tape *tape, lf_tensor *x, long height, long width, bool aligned);

/* Feature volumes are [volumes, depth, height, width, channels].
 * Slices of a volume beside their neighbours: x [N, D, H, W, C] -> [N ceil(D / stride), H, W, 3 C],
 * image i of a volume: slices stride i - 1, stride i, stride i + 1, zero outside. A 3x3 convolution
 * of it is a 3x3x3 one of x. */
lf_tensor *lf_volume_slices(lf_tape *tape, lf_tensor *x, long stride);
/* Trilinear samples of x [N, D, H, W, C] at position [Q, 3] of volume number volume[q] -> [Q, C]:
 * x, y, z along W, H, D; the corner voxels' centres are at -1/2 and 1/2, beyond them is the
 * border. */
lf_tensor *lf_sample_volume(lf_tape *tape, lf_tensor *x, long points, const double *position,
                            const long *volume);

/* y[..., f] = sum of the `group` adjacent channels of field f: x [..., group F] -> [..., F]. */
lf_tensor *lf_group_sum(lf_tape *tape, lf_tensor *x, long group);

#endif
