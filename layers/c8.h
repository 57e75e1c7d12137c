/* c8.h: convolutions that turn with the image, for the eight rotations by multiples of 45 degrees.
 *                                                                        [method.md 5a.1]
 * A regular field is eight adjacent channels, one an orientation r = 0..7: turning the image
 * counter-clockwise by 45 a degrees (column x to the right, row y up) moves what orientation r saw
 * to orientation (r + a) mod 8. Filters are sums of ring harmonics with learned weights:
 *
 *   lift     w[o][i][b]     filter of orientation a:      sum_b w[o][i][b] B_b(p; phi - 2 pi a / 8)
 *   regular  w[o][i][s][b]  from orientation (s+a) mod 8: sum_b w[o][i][s][b] B_b(p; phi - 2 pi a /
 * 8)
 *
 * Quarter turns are exact on odd sizes and for strides that meet odd sizes only (65 -> 33 -> 17);
 * eighth turns hold up to the interpolation of the image.
 *
 * Memory:  a layer's parameters live in the store; a layer with a basis owns its table and is
 *          closed with its free function. A layer is read-only after init.
 */
#ifndef LF_LAYERS_C8_H
#define LF_LAYERS_C8_H

#include "autograd/autograd.h"
#include "autograd/ops_image.h"

enum { LF_C8 = 8 }; /* orientations */

/* The highest angular frequency kept on a ring of radius r of a k x k filter. */
typedef enum lf_c8_cutoff {
    LF_C8_E2CNN, /* min(2 r, 2) on the last ring, else 2 r - (r + 1) mod 2 (e2cnn's default) */
    LF_C8_REDET  /* 3 r (ReDet) */
} lf_c8_cutoff;

/* Ring harmonics exp(-(|p| - r_j)^2 / 2 s_j^2) {cos, sin}(m (phi - 2 pi a / 8)) on the pixels of a
 * k x k filter: radii r_j = 0, 1, ..., (k - 1) / 2; s = 0.005 at radius 0, 0.4 on the last ring,
 * else 0.6; frequencies m = 0 .. cutoff, those above 0 vanish at the centre. Each member has unit
 * energy sum_p B^2: E2CNN as the mean over the eight rotations, REDET at a = 0 (the same for m not
 * a multiple of 4). Members whose energy before scaling is at most 1e-2, aliased away by the grid,
 * are dropped (none at sizes 1, 3, 5, 7, with either cutoff). */
typedef struct lf_c8_basis {
    int size;       /* k, odd */
    int count;      /* members: 1, 6, 11, 18 (E2CNN) or 1, 8, 21, 40 (REDET) for k = 1, 3, 5, 7 */
    lf_real *table; /* [k * k][count][8 rotations], 64-byte aligned */
} lf_c8_basis;

void lf_c8_basis_init(lf_c8_basis *basis, int size, lf_c8_cutoff cutoff);
void lf_c8_basis_free(lf_c8_basis *basis);

/* The ordinary filter [k, k, Ci, 8 Fo] of weights, channel = 8 * field + orientation. A lift has
 * w [Fo, Fi, count] and Ci = Fi; regular fields have w [Fo, Fi, 8, count] and Ci = 8 Fi. */
typedef struct lf_c8_filter {
    const lf_real *table; /* the basis's, which must outlive this */
    long size, count;
    long in, out; /* Fi, Fo */
    long turns;   /* 8, a lift 1 */
} lf_c8_filter;

lf_c8_filter lf_c8_filter_of(const lf_c8_basis *basis, const lf_tensor *w);
/* Numbers in the filter, and in the scratch that both functions below need with as many threads as
 * there are now. */
long lf_c8_filter_size(const lf_c8_filter *s);
long lf_c8_filter_scratch(const lf_c8_filter *s);
/* f = the filter of w. */
void lf_c8_expand(const lf_c8_filter *s, const lf_real *w, lf_real *f, lf_real *scratch);
/* dw += the transpose of that, applied to df. */
void lf_c8_fold(const lf_c8_filter *s, const lf_real *df, lf_real *dw, lf_real *scratch);

/* y = x correlated with the filter of w, zero padding k / 2: x [N, H, W, Ci], w as above;
 * y [N, ceil(H / stride), ceil(W / stride), 8 Fo]. The filter, which is many times w, is not kept:
 * the backward makes it again. `basis` must outlive the tape's use of y. */
lf_tensor *lf_c8_conv2d(lf_tape *tape, const lf_c8_basis *basis, lf_tensor *x, lf_tensor *w,
                        long stride);

/* ---- layers ---------------------------------------------------------------------------------- */

/* Lift (channels to fields) or regular (fields to fields), without bias, zero padding k / 2. */
typedef struct lf_c8_conv {
    const lf_parameter *weight;
    lf_c8_basis basis;
    int stride;
} lf_c8_conv;

/* Registers prefix.weight, standard deviation sqrt(2 / (in * count * 8)), 8 dropped for a lift. */
void lf_c8_conv_init(lf_store *store, const char *prefix, bool lift, int in, int out, int size,
                     int stride, lf_c8_cutoff cutoff, lf_c8_conv *layer);
void lf_c8_conv_free(lf_c8_conv *layer);
/* x [N, H, W, in or 8 in] -> [N, ceil(H / stride), ceil(W / stride), 8 out] */
lf_tensor *lf_c8_conv_forward(lf_tape *tape, const lf_c8_conv *layer, lf_tensor *x);

#endif
