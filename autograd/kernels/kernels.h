/* kernels.h: the arithmetic under the ops: matrix products and convolutions, forward and backward.
 *
 * Layout:  every array is row-major and contiguous. A linear map takes x[rows, in] to y[rows, out]
 *          by w[in, out]. Feature maps are [images, height, width, channels]; a filter is
 *          w[size, size, in, out], so that one output pixel is a product of `size` runs of
 *          size * in adjacent numbers with a [size * size * in, out] matrix.
 * Memory:  nothing is allocated; the caller owns all arrays and gives scratch where it is asked
 *          for (any alignment, contents undefined before and after). No array may overlap another.
 *          Up to 512 KiB of the calling thread's stack are used.
 * Limits:  a convolution whose window (size rows of size pixels) exceeds 256 KiB, and the adjoint
 *          in x of a stride above 4, run as the plain loops of the reference.
 * Bounds:  nothing outside the given arrays is read or written, whatever the sizes. Sizes are >= 0
 *          (an empty product adds nothing) and are the caller's to check.
 * Threads: OpenMP when called outside a parallel region, serial inside one. Results do not depend
 *          on the number of threads: sums over rows or images run in fixed lanes.
 * lf_ref_* are the same in plain C loops: the definition that the fast ones are tested against.
 */
#ifndef LF_AUTOGRAD_KERNELS_H
#define LF_AUTOGRAD_KERNELS_H

#include <stdbool.h>

#include "autograd/real.h"

/* ---- linear maps ----------------------------------------------------------------------------- */

/* The kernels below fuse the first two; ops run lf_kernel_activate for the others. */
typedef enum lf_activation { LF_IDENTITY, LF_RELU, LF_ELU, LF_SIGMOID } lf_activation;

/* y = act(y) [n], in place. */
void lf_kernel_activate(long n, lf_activation act, lf_real *y);
/* dz = the gradient behind the activation, from its result y and that result's gradient dy [n]; dz
 * may be dy. */
void lf_kernel_activation_dz(long n, lf_activation act, const lf_real *y, const lf_real *dy,
                             lf_real *dz);
static inline bool lf_activation_fused(lf_activation act)
{
    return act == LF_IDENTITY || act == LF_RELU;
}

/* y = act(x w + b); b[out] may be NULL. */
void lf_kernel_linear(long rows, long in, long out, const lf_real *x, const lf_real *w,
                      const lf_real *b, lf_activation act, lf_real *y);
/* dx += dy w^T */
void lf_kernel_linear_dx(long rows, long in, long out, const lf_real *dy, const lf_real *w,
                         lf_real *dx);
/* dw += x^T dy, db += column sums of dy; db may be NULL. Serial: tiles call it from their lane. */
void lf_kernel_linear_dw(long rows, long in, long out, const lf_real *x, const lf_real *dy,
                         lf_real *dw, lf_real *db);
/* The same in parallel over a fixed number of lanes of rows, for many rows outside tiles. scratch
 * holds lf_linear_dw_scratch numbers. Its sums are ordered otherwise than the serial function's. */
void lf_kernel_linear_dw_lanes(long rows, long in, long out, const lf_real *x, const lf_real *dy,
                               lf_real *dw, lf_real *db, lf_real *scratch);
long lf_linear_dw_scratch(long rows, long in, long out);

/* c[m, n] = a[m, k] b[k, n], or += with accumulate. For large matrices of any shape. */
void lf_kernel_matmul(long m, long n, long k, const lf_real *a, const lf_real *b, lf_real *c,
                      bool accumulate);

/* ---- convolution ----------------------------------------------------------------------------- */

/* out_height = (height + 2 pad - size) / stride + 1; likewise the width. */
typedef struct lf_conv {
    long images, height, width, in, out, size, stride, pad, out_height, out_width;
} lf_conv;

/* Fill in the output size. size and stride >= 1, pad >= 0, the filter fits into the padded image.
 */
lf_conv lf_conv_shape(long images, long height, long width, long in, long out, long size,
                      long stride, long pad);
/* Numbers of scratch that any of the three functions needs at most, at least 1, with as many
 * threads as there are now; and that the last one does, with any number. */
long lf_conv_scratch(const lf_conv *s);
long lf_conv_dw_scratch(const lf_conv *s);

/* y[n, i, j, o] = act(b[o] + sum_{p, q, c} x[n, i stride + p - pad, j stride + q - pad, c]
 * w[p, q, c, o]), zero outside the image. b[out] may be NULL. */
void lf_kernel_conv(const lf_conv *s, const lf_real *x, const lf_real *w, const lf_real *b,
                    lf_activation act, lf_real *y, lf_real *scratch);
/* dx += the adjoint in x, applied to dy */
void lf_kernel_conv_dx(const lf_conv *s, const lf_real *dy, const lf_real *w, lf_real *dx,
                       lf_real *scratch);
/* dw += the adjoint in w, applied to dy; db += sums of dy over images and pixels; db may be NULL */
void lf_kernel_conv_dw(const lf_conv *s, const lf_real *x, const lf_real *dy, lf_real *dw,
                       lf_real *db, lf_real *scratch);

/* ---- reference ------------------------------------------------------------------------------- */

void lf_ref_linear(long rows, long in, long out, const lf_real *x, const lf_real *w,
                   const lf_real *b, lf_activation act, lf_real *y);
void lf_ref_linear_dx(long rows, long in, long out, const lf_real *dy, const lf_real *w,
                      lf_real *dx);
void lf_ref_linear_dw(long rows, long in, long out, const lf_real *x, const lf_real *dy,
                      lf_real *dw, lf_real *db);
void lf_ref_matmul(long m, long n, long k, const lf_real *a, const lf_real *b, lf_real *c,
                   bool accumulate);
void lf_ref_conv(const lf_conv *s, const lf_real *x, const lf_real *w, const lf_real *b,
                 lf_activation act, lf_real *y, lf_real *scratch);
void lf_ref_conv_dx(const lf_conv *s, const lf_real *dy, const lf_real *w, lf_real *dx,
                    lf_real *scratch);
void lf_ref_conv_dw(const lf_conv *s, const lf_real *x, const lf_real *dy, lf_real *dw, lf_real *db,
                    lf_real *scratch);

#endif
