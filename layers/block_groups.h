/* block_groups.h: fields of one block or group: maps within a type, invariants, gates. Rows are
 * [n, LF_BLOCK_POINTS]; formulas as in so2_linear.c and so2_nonlinear.c. [layers/light_blocks.h]
 */
#ifndef LF_LAYERS_BLOCK_GROUPS_H
#define LF_LAYERS_BLOCK_GROUPS_H

#include "layers/block_kernels.h"
#include "layers/light_blocks.h"

/* Numbers from group to group of n numbers each, in memory of an op's own: an odd number of lines,
 * so that the same number of all groups does not fall on few sets of a cache. */
static inline long lf_group_step(long n)
{
    return (n + (n + 1) % 2) * LF_BLOCK_POINTS;
}

/* Pairs of a point and a view that sees it. */
static inline double lf_blocks_pairs(const lf_blocks *blocks)
{
    return lf_present(blocks->groups * LF_BLOCK_POINTS, blocks->mask);
}

/* How many of `left` groups are computed together. */
static inline long lf_group_count(long left)
{
    return left < LF_BLOCK_SIDE ? left : LF_BLOCK_SIDE;
}

/* ---- maps ------------------------------------------------------------------------------------ */

typedef struct lf_group_map {
    lf_types types;
    long in, out; /* channels */
} lf_group_map;

/* Products of one point. */
static inline double lf_group_map_products(const lf_group_map *m)
{
    return lf_types_products(&m->types) * (double)(m->in * m->out);
}

/* y = or += (A + i B) x, or with `adjoint` the adjoint of it. */
static inline void lf_group_map_apply(const lf_group_map *m, const lf_real *w, const lf_real *bias,
                                      bool adjoint, bool accumulate, const lf_real *x, lf_real *y)
{
    const long ci = adjoint ? m->out : m->in, co = adjoint ? m->in : m->out, size = ci * co;
    const long in_step = adjoint ? 1 : co, out_step = adjoint ? ci : 1;
    const long scalars = lf_types_scalars(&m->types);
    const lf_block_terms t = {.in = scalars * ci,
                              .x = x,
                              .w = {w, adjoint ? 1 : scalars * co, adjoint ? scalars * ci : 1},
                              .bias = bias,
                              .accumulate = accumulate};
    lf_block_product(&t, scalars * co, y);
    for (int k = 1; k < m->types.count; k++) {
        const long plane = lf_types_plane(&m->types, k);
        const lf_real *wk = w + lf_types_matrix(&m->types, k) * size;
        const lf_block_turn_terms turn = {ci,      co,       wk,      wk + size,
                                          in_step, out_step, adjoint, accumulate};
        lf_block_turn(&turn, x + plane * ci * LF_BLOCK_POINTS, y + plane * co * LF_BLOCK_POINTS);
    }
}

/* dw of all groups, which are rx and ry numbers apart. */
static inline void lf_group_map_weights(const lf_group_map *m, long groups, const lf_real *x,
                                        long rx, const lf_real *dy, long ry, lf_real *dw)
{
    const long ci = m->in, co = m->out, scalars = lf_types_scalars(&m->types);
    lf_block_pairs p = {groups, rx, ry, x, dy, NULL, NULL, 0};
    if (scalars * co >= LF_LANES) /* 1.2 to 1.5 times as fast from there on */
        lf_block_outer(&p, scalars * ci, scalars * co, dw);
    else
        lf_block_outer_across(&p, scalars * ci, scalars * co, dw, scalars * co, 1);
    for (int k = 1; k < m->types.count; k++) {
        const long plane = lf_types_plane(&m->types, k);
        lf_real *da = dw + lf_types_matrix(&m->types, k) * ci * co, *db = da + ci * co;
        const lf_real *re = x + plane * ci * LF_BLOCK_POINTS, *im = re + ci * LF_BLOCK_POINTS;
        const lf_real *gr = dy + plane * co * LF_BLOCK_POINTS, *gi = gr + co * LF_BLOCK_POINTS;
        p = (lf_block_pairs){groups, rx, ry, re, gr, im, gi, 1};
        lf_block_outer_across(&p, ci, co, da, co, 1);
        p = (lf_block_pairs){groups, rx, ry, re, gi, im, gr, -1};
        lf_block_outer_across(&p, ci, co, db, co, 1);
    }
}

/* ---- invariants and gates -------------------------------------------------------------------- */

static inline void lf_group_invariants(const lf_types *types, long c, const lf_real *x, lf_real *n)
{
    const long scalars = lf_types_scalars(types) * c;
    memcpy(n, x, (size_t)(scalars * LF_BLOCK_POINTS) * sizeof *n);
    for (long k = 1; k < types->count; k++)
        for (long i = 0; i < c; i++)
            for (int h = 0; h < LF_PARTS; h++) {
                const long at = lf_types_plane(types, k) * c + i;
                const lf_vec re = lf_block_get(x, at, h), im = lf_block_get(x, at + c, h);
                lf_block_set(n, lf_types_gate(types, k) * c + i, h,
                             lf_vec_sqrt(re * re + im * im + (lf_real)1e-12));
            }
}

/* dx += the adjoint, from the norms n and their gradient dn. */
static inline void lf_group_invariants_backward(const lf_types *types, long c, const lf_real *x,
                                                const lf_real *n, const lf_real *dn, lf_real *dx)
{
    for (int h = 0; h < LF_PARTS; h++) {
        for (long i = 0; i < lf_types_scalars(types) * c; i++)
            lf_block_add(dx, i, h, lf_block_get(dn, i, h));
        for (long k = 1; k < types->count; k++)
            for (long i = 0; i < c; i++) {
                const long re = lf_types_plane(types, k) * c + i, im = re + c;
                const long gate_at = lf_types_gate(types, k) * c + i;
                const lf_vec f = lf_block_get(dn, gate_at, h) / lf_block_get(n, gate_at, h);
                lf_block_add(dx, re, h, f * lf_block_get(x, re, h));
                lf_block_add(dx, im, h, f * lf_block_get(x, im, h));
            }
    }
}

/* Logits in `gate` become what is kept; y from x. */
static inline void lf_group_gate(const lf_types *types, long c, const lf_real *x, lf_real *gate,
                                 lf_real *y)
{
    for (int h = 0; h < LF_PARTS; h++) {
        for (long i = 0; i < lf_types_scalars(types) * c; i++) {
            lf_vec slope;
            const lf_vec e = lf_vec_elu_slope(lf_block_get(gate, i, h), &slope);
            lf_block_set(y, i, h, lf_block_get(x, i, h) + e);
            lf_block_set(gate, i, h, slope);
        }
        for (long k = 1; k < types->count; k++)
            for (long i = 0; i < c; i++) {
                const long re = lf_types_plane(types, k) * c + i, im = re + c;
                const long gate_at = lf_types_gate(types, k) * c + i;
                const lf_vec g = lf_vec_sigmoid(lf_block_get(gate, gate_at, h));
                lf_block_set(y, re, h, g * lf_block_get(x, re, h));
                lf_block_set(y, im, h, g * lf_block_get(x, im, h));
                lf_block_set(gate, gate_at, h, g);
            }
    }
}

/* dx += g dy, and the gradient dl of the logits. */
static inline void lf_group_gate_backward(const lf_types *types, long c, const lf_real *x,
                                          const lf_real *gate, const lf_real *dy, lf_real *dx,
                                          lf_real *dl)
{
    for (int h = 0; h < LF_PARTS; h++) {
        for (long i = 0; i < lf_types_scalars(types) * c; i++) {
            const lf_vec d = lf_block_get(dy, i, h);
            lf_block_add(dx, i, h, d);
            lf_block_set(dl, i, h, lf_block_get(gate, i, h) * d);
        }
        for (long k = 1; k < types->count; k++)
            for (long i = 0; i < c; i++) {
                const long re = lf_types_plane(types, k) * c + i, im = re + c;
                const long gate_at = lf_types_gate(types, k) * c + i;
                const lf_vec g = lf_block_get(gate, gate_at, h);
                const lf_vec dr = lf_block_get(dy, re, h), di = lf_block_get(dy, im, h);
                lf_block_add(dx, re, h, g * dr);
                lf_block_add(dx, im, h, g * di);
                lf_block_set(dl, gate_at, h,
                             g * (1 - g) *
                                 (dr * lf_block_get(x, re, h) + di * lf_block_get(x, im, h)));
            }
    }
}

#endif
