/* ops.h: the differentiable ops. Each is one file, op_<name>.c, with its forward, its backward and
 * what it computes as formulas at the top. Images have their own: ops_image.h.
 *
 * Shapes are given as [..]; "rows" means all axes but the last. A wrong shape aborts with the op's
 * name and the shapes. Every op has a row in tests/op_table_*.c.
 */
#ifndef LF_AUTOGRAD_OPS_H
#define LF_AUTOGRAD_OPS_H

#include "autograd/autograd.h"
#include "autograd/kernels/kernels.h"

/* y = act(x w + b): x [.., in], w [in, out], b [out] or NULL -> [.., out]. */
lf_tensor *lf_linear(lf_tape *tape, lf_tensor *x, lf_tensor *w, lf_tensor *b, lf_activation act);

/* Elementwise; both shapes the same. */
lf_tensor *lf_add(lf_tape *tape, lf_tensor *a, lf_tensor *b);
lf_tensor *lf_multiply(lf_tape *tape, lf_tensor *a, lf_tensor *b);
lf_tensor *lf_scale(lf_tape *tape, lf_tensor *a, lf_real factor);
lf_tensor *lf_relu(lf_tape *tape, lf_tensor *x);
lf_tensor *lf_elu(lf_tape *tape, lf_tensor *x);
lf_tensor *lf_sigmoid(lf_tape *tape, lf_tensor *x);

/* Rows of y added to groups of rows of x: x [Q, V, ..], y [Q, ..] -> x + y[:, None]. */
lf_tensor *lf_add_group(lf_tape *tape, lf_tensor *x, lf_tensor *y);

/* Join along the last axis; all other axes the same; count <= LF_MAX_IN. */
lf_tensor *lf_concat(lf_tape *tape, int count, lf_tensor *const *parts);

/* The same numbers under another shape (memory is shared, nothing is copied). */
lf_tensor *lf_reshape(lf_tape *tape, lf_tensor *x, int rank, const long *dim);

/* Rows [from, from + count) of the first axis (memory is shared). */
lf_tensor *lf_rows_view(lf_tape *tape, lf_tensor *x, long from, long count);

/* Rows by number: x [S, C], row [Q] (0 .. S - 1, the caller's until the backward) -> [Q, C]. */
lf_tensor *lf_gather_rows(lf_tape *tape, lf_tensor *x, long count, const long *row);

/* Mean or largest over the views (or pixels) of a row: x [Q, V, C] -> [Q, C], of those with mask
 * [Q, V] 1 (NULL: all). A row without any gives zeros and no gradient. */
typedef enum lf_pooling { LF_POOL_MEAN, LF_POOL_MAX } lf_pooling;
lf_tensor *lf_pool_views(lf_tape *tape, lf_tensor *x, const lf_tensor *mask, lf_pooling pooling);

/* Sum of all elements -> []. */
lf_tensor *lf_sum(lf_tape *tape, lf_tensor *x);

/* Softmax over the last axis; mask of the same shape (1 = present) or NULL. Absent entries get
 * weight 0, a row with none gives zeros.                              [method.md 4.6] */
lf_tensor *lf_softmax(lf_tape *tape, lf_tensor *x, const lf_tensor *mask);

/* Bilinear samples of several maps of one set of images, joined.     [method.md 5a.3]
 * maps[m] [N, h_m, w_m, C_m]; all cover the same image, corners aligned: a point at uv (pixels of
 * an image of height x width, integers are pixel centres) reads map m at uv * (w_m - 1) / (width -
 * 1). uv [Q, V, 2] (doubles), image n of point q and view v is first[q] + v; mask [Q, V] (1 =
 * seen): an unseen entry gives zeros and no gradient. Result [Q, V, sum of C_m]. The backward adds
 * to each map in the order of the points, one image after the other by one thread each: same bits
 * for any thread count. */
lf_tensor *lf_sample_maps(lf_tape *tape, int count, lf_tensor *const *maps, long height, long width,
                          long points, long views, const double *uv, const lf_real *mask,
                          const long *first);

/* What V source views show at Q points, [Q, V, 3 + channels]: colours (0..1) of their pictures and
 * `channels` features from `first` on of their maps, bilinear at uv [Q, V, 2] (doubles, pixels of
 * the view's picture, centres at integers), which is uv / stride in the map, cut to it. Where mask
 * [Q, V] is 0: zeros and no gradient. maps is the flat array that holds the maps of all views, each
 * [map_height, map_width, map_channels] from its offset on; it gets the gradient. Views may differ
 * in size.                                                                      [method.md 5b.1]
 */
typedef struct lf_view_map {
    const uint8_t *rgb; /* [height][width][3] */
    long height, width;
    double stride; /* pixels of the picture from one texel of the map to the next */
    long map_height, map_width, map_channels, offset;
} lf_view_map;
lf_tensor *lf_sample_views(lf_tape *tape, lf_tensor *maps, long views, const lf_view_map *view,
                           long first, long channels, long points, const double *uv,
                           const lf_real *mask);

/* sum over rows r of weight[r] |x_r - target_r|^2: x [.., C], target like x, weight a number a row
 * or NULL (1) -> []. Rows of weight 0 have no gradient, whatever they hold. */
lf_tensor *lf_squared_error(lf_tape *tape, lf_tensor *x, const float *target, const float *weight);

/* Weighted L1 on clamped values, summed over the points, of predictions x [.., 1] of `scale` * sdf:
 *   sum_i w_i | x_i - clip(scale sdf_i) |,  clip to [-scale clamp, scale clamp],
 *   0 where x lies beyond the clamp on the target's side;
 *   w_i = near_weight if sdf_i <= near, else 1.
 * -> []                                                              [method.md 5a.7] */
typedef struct lf_sdf_loss_config {
    double scale, clamp, near, near_weight;
} lf_sdf_loss_config;
lf_tensor *lf_sdf_loss(lf_tape *tape, lf_tensor *x, const float *sdf,
                       const lf_sdf_loss_config *config);

#endif
