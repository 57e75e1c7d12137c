/* light_blocks.h: the layers of light_field.h on points in blocks: the same mathematics and the
 * same parameters, fast.                                                     [method.md 5b.3 -
 * 5b.5]
 *
 * Points (samples of all rays, in order) stand in blocks of LF_BLOCK_POINTS side by side, one
 * vector a number. A group is a block as one view sees it; only groups in which the view sees at
 * least one point exist: what no source sees is not computed. Tensors are
 *
 *   of points   [B, 1, n, LF_BLOCK_POINTS]    B blocks
 *   of views    [G, 1, n, LF_BLOCK_POINTS]    G groups, those of a block adjacent, views in order
 *
 * with n = P C for fields. Points past the last one, and views that do not see a point, hold finite
 * numbers that nothing reads; their gradients are 0.
 */
#ifndef LF_LAYERS_LIGHT_BLOCKS_H
#define LF_LAYERS_LIGHT_BLOCKS_H

#include "layers/light_field.h"

enum { LF_BLOCK_POINTS = 64 / sizeof(lf_real) }; /* points in a block */

/* How light_geometry's points and views stand in blocks; lives on the tape. */
typedef struct lf_blocks {
    const lf_light_geometry *rays; /* a copy on the tape */
    lf_types types;
    long points, blocks, groups;
    const long *first;    /* [B + 1]: the groups of block b are first[b] .. first[b + 1] - 1 */
    const long *view;     /* [G] */
    const lf_real *mask;  /* [G, W]: 1 = sees */
    const lf_real *share; /* [B, W]: 1 / views that see the point; 0 if none does */
    const lf_real *phase; /* [G, 2 count - 1, W] */
    const lf_real *angle; /* [G, 3, W] */
} lf_blocks;

lf_blocks lf_blocks_make(lf_tape *tape, const lf_light_geometry *geometry);

/* Rows of views x [N, S, V, F] -> [G, 1, F, W]; rows that are not seen become 0 and get no
 * gradient. Rows of points [N, S, n] <-> [B, 1, n, W]. */
lf_tensor *lf_blocks_of_views(lf_tape *tape, const lf_blocks *blocks, lf_tensor *x);
lf_tensor *lf_blocks_of_points(lf_tape *tape, const lf_blocks *blocks, lf_tensor *x);
lf_tensor *lf_blocks_rows(lf_tape *tape, const lf_blocks *blocks, lf_tensor *x);

/* act(x w + b): [.., in, W] -> [.., out, W]; b may be NULL. */
lf_tensor *lf_blocks_linear(lf_tape *tape, lf_tensor *x, lf_tensor *w, lf_tensor *b,
                            lf_activation act);
lf_tensor *lf_blocks_mlp(lf_tape *tape, const lf_mlp *mlp, lf_tensor *x);

/* lf_so2_map. */
lf_tensor *lf_blocks_map(lf_tape *tape, const lf_types *types, const lf_so2_map *map, lf_tensor *x);

/* lf_so2_layer_norm, lf_so2_invariants, lf_so2_gated. */
lf_tensor *lf_blocks_norm(lf_tape *tape, const lf_types *types, lf_tensor *x, lf_tensor *gain);
lf_tensor *lf_blocks_invariants(lf_tape *tape, const lf_types *types, lf_tensor *x);
lf_tensor *lf_blocks_gated(lf_tape *tape, const lf_types *types, lf_tensor *x, lf_tensor *w,
                           lf_tensor *b);

/* lf_cross_attention: q of points, k and value of views -> field of points; weight in rows, [N, S,
 * V]. */
lf_attended lf_blocks_attention(lf_tape *tape, const lf_blocks *blocks, lf_tensor *q, lf_tensor *k,
                                lf_tensor *value, int heads);

/* lf_along_ray_attention of points. */
lf_tensor *lf_blocks_along_attention(lf_tape *tape, const lf_blocks *blocks, lf_tensor *q,
                                     lf_tensor *k, lf_tensor *value, lf_tensor *key_profile,
                                     lf_tensor *value_profile, int heads);

/* Whole layers: f of views [G, 1, F, W]. */
lf_tensor *lf_blocks_convolution(lf_tape *tape, const lf_blocks *blocks,
                                 const lf_ray_ray_convolution *layer, lf_tensor *f, bool mean);
/* A key or value of every view -> what it becomes beside the query q of points. */
lf_tensor *lf_blocks_update(lf_tape *tape, const lf_blocks *blocks, const lf_view_update *layer,
                            lf_tensor *view, lf_tensor *q);
lf_attended lf_blocks_cross(lf_tape *tape, const lf_blocks *blocks,
                            const lf_cross_attention_layer *layer, lf_tensor *f, lf_tensor *point);
lf_tensor *lf_blocks_along(lf_tape *tape, const lf_blocks *blocks, const lf_along_ray_layer *layer,
                           lf_tensor *x);

#endif
