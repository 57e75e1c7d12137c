/* ibrnet.h: IBRNet's aggregation over source views and its attention along a ray, as ops.
 *                                                                        [method.md 5b.1, 5c]
 * Its maps are small (4 .. 105 numbers a row) and its rows many, so features lie in lanes: LF_LANES
 * points side by side,
 *
 *   x [R, C, L]    R rows, C channels, L = LF_LANES points
 *
 * A block is L adjacent points (of the N S points in order; the last block may have lanes beyond
 * the last point). A row is one block as one view sees it; views that see no point of a block have
 * no row there. "Point" tensors [B, C, L] have one row a block. So every nonlinearity, every sum
 * over views and every product runs over whole vectors, whatever C.
 *
 * Sizes: N rays, S samples, V views, F numbers a sample and view, B blocks.
 */
#ifndef LF_LAYERS_IBRNET_H
#define LF_LAYERS_IBRNET_H

#include "autograd/kernels/vector.h"
#include "layers/light_field.h"

/* Which view of which block a row is, and what is known of it without gradient. */
typedef struct lf_lanes {
    long rays, samples, views, points, blocks, rows;
    const long *first;           /* [B + 1] the rows of block b are first[b] .. first[b + 1] - 1 */
    const long *view, *block;    /* [R] */
    const lf_tensor *mask;       /* [R, 1, L] 1 = the view sees the point; 0 beyond the last one */
    const lf_tensor *difference; /* [R, 4, L] see models/ray_network.h; NULL: none */
    const lf_tensor *lowest;     /* [B, 1, L] the least inner product of all V views; or NULL */
} lf_lanes;

/* mask and difference are [N, S, V] and [N, S, V, 4]; every difference must be finite. NULL: there
 * is no target to differ from, and lf_ibrnet_weights may not be asked. */
lf_lanes lf_lanes_make(lf_tape *tape, const lf_tensor *mask, const lf_tensor *difference);

/* A copy on the tape, for an op to keep. */
lf_lanes *lf_lanes_keep(lf_tape *tape, const lf_lanes *lanes);

/* ---- rows to lanes and back ------------------------------------------------------------------ */

/* x [N, S, V, C] plus y [R, C, L] (NULL: nothing) -> [R, C, L]. */
lf_tensor *lf_lanes_add_rows(lf_tape *tape, lf_tensor *x, lf_tensor *y, const lf_lanes *lanes);
/* x [B, C, L] -> [N, S, C] */
lf_tensor *lf_lanes_to_rows(lf_tape *tape, lf_tensor *x, const lf_lanes *lanes);

/* ---- linear maps ----------------------------------------------------------------------------- */

enum { LF_LANES_PARTS = 3 };

/* y = act(x w + b + p): x the channels of all parts [R, Ci, L] one after the other, w [sum of Ci,
 * Co], b [Co] or p [B, Co, L] (the share of the map that is the same for all views of a point), the
 * other or both NULL -> [R, Co, L]. act is LF_IDENTITY or LF_ELU. Maps of points have no p. */
lf_tensor *lf_lanes_linear(lf_tape *tape, int parts, lf_tensor *const *x, lf_tensor *w,
                           lf_tensor *b, lf_tensor *p, const lf_lanes *lanes, lf_activation act);

/* ---- aggregation over the views -------------------------------------------------------------- */

/* Weights by direction: a_v = m_v (e_v - min_u e_u), e_v = exp(|s| (dot_v - 1)), w = a / (sum a +
 * 1e-8): s [1] -> [R, 1, L]. The least is over all views, seen or not, as published. */
lf_tensor *lf_ibrnet_weights(lf_tape *tape, lf_tensor *s, const lf_lanes *lanes);

/* Weights without direction: m_v / (sum m + 1e-8) -> [R, 1, L], no gradient. */
lf_tensor *lf_ibrnet_even_weights(lf_tape *tape, const lf_lanes *lanes);

/* Weighted mean m = sum_v w_v x_v, variance sum_v w_v (x_v - m)^2 and, if asked, the mean weight
 * sum_v w_v / V: x [R, D, L], w [R, 1, L] -> [B, 2 D (+ 1), L]. */
lf_tensor *lf_ibrnet_moments(lf_tape *tape, lf_tensor *x, lf_tensor *w, const lf_lanes *lanes,
                             bool mean_weight);

/* x [R, D, L] times w [R, 1, L]. */
lf_tensor *lf_lanes_scale(lf_tape *tape, lf_tensor *x, lf_tensor *w);

/* Residual and first visibility, r [R, D + 1, L]: x + r_0..D-1 and the same times m sigmoid(r_D).
 */
typedef struct lf_ibrnet_residual {
    lf_tensor *x, *visible; /* [R, D, L] */
} lf_ibrnet_residual;
lf_ibrnet_residual lf_ibrnet_residual_apply(lf_tape *tape, lf_tensor *x, lf_tensor *r,
                                            const lf_lanes *lanes);

/* Second visibility u = m sigmoid(t) and the weights u / (sum_v u + 1e-8): t [R, 1, L]. */
typedef struct lf_ibrnet_visibility {
    lf_tensor *visibility, *weight; /* [R, 1, L] */
} lf_ibrnet_visibility;
lf_ibrnet_visibility lf_ibrnet_visibility_apply(lf_tape *tape, lf_tensor *t, const lf_lanes *lanes);

/* Colours: softmax of the logits t [R, 1, L] over the views that see the point, times the first
 * three numbers of x [N, S, V, C] -> [N, S, 3]; 0 where no view sees it. */
lf_tensor *lf_ibrnet_colour(lf_tape *tape, lf_tensor *t, lf_tensor *x, const lf_lanes *lanes);

/* ---- along the ray --------------------------------------------------------------------------- */

/* Attention between the samples of a ray, heads of D / heads adjacent channels: q, k, values
 * [N, S, D] -> [N, S, D]. Queries that fewer than LF_KEY_VIEWS views see (count [N, S]) attend to
 * all samples alike: published masks rows, not keys. */
lf_tensor *lf_sample_attention(lf_tape *tape, lf_tensor *q, lf_tensor *k, lf_tensor *value,
                               const lf_tensor *count, int heads);

/* y = gain (x - mean) / sqrt(variance + 1e-6) + bias over the last axis, n >= 1 numbers. */
lf_tensor *lf_layer_norm(lf_tape *tape, lf_tensor *x, lf_tensor *gain, lf_tensor *bias);

#endif
