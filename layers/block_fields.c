/* block_fields.c: layer norm, invariants and gates of fields in blocks     [layers/light_blocks.h]
 *
 * Formulas as in so2_nonlinear.c.
 *
 * Keeps       gated: the invariants and the gates' slopes.
 * Degenerate  zero rows: every divisor is positive.
 */
#include "layers/block_groups.h"

enum { W = LF_BLOCK_POINTS };
static const lf_real layer_epsilon = (lf_real)1e-4;

/* ---- layer norm --------------------------------------------------------------------------------
 */

static lf_vec inverse_rms(long n, const lf_real *x, int h)
{
    lf_vec sum = {0};
    for (long i = 0; i < n; i++)
        sum += lf_block_get(x, i, h) * lf_block_get(x, i, h);
    return 1 / lf_vec_sqrt(sum / (lf_real)n + layer_epsilon);
}

/* Number of the gain of number j of a row. */
static long gain_of(const lf_types *types, long j, long c)
{
    return lf_types_gate_of_plane(types, j / c) * c + j % c;
}

static void norm_backward(const lf_node *node)
{
    const lf_types *types = node->saved;
    const lf_tensor *x = node->in[0], *gain = node->in[1];
    const long n = x->dim[2], c = n / lf_types_planes(types);
    lf_vec *sums = lf_alloc(node->tape, (size_t)gain->size * sizeof *sums);
    memset(sums, 0, (size_t)gain->size * sizeof *sums);
    for (long b = 0; b < x->dim[0]; b++)
        for (int h = 0; h < LF_PARTS; h++) {
            const lf_real *xb = x->value + b * n * W, *dy = node->out[0]->grad + b * n * W;
            const lf_vec q = inverse_rms(n, xb, h);
            lf_vec dot = {0}; /* <g dy, x> */
            for (long j = 0; j < n; j++) {
                const lf_vec t = lf_block_get(dy, j, h) * lf_block_get(xb, j, h);
                dot += gain->value[gain_of(types, j, c)] * t;
                sums[gain_of(types, j, c)] += q * t;
            }
            const lf_vec pull = q * q * q * dot / (lf_real)n;
            for (long j = 0; x->grad && j < n; j++)
                lf_block_add(x->grad + b * n * W, j, h,
                             q * gain->value[gain_of(types, j, c)] * lf_block_get(dy, j, h) -
                                 pull * lf_block_get(xb, j, h));
        }
    for (long i = 0; gain->grad && i < gain->size; i++)
        gain->grad[i] += lf_vec_total(sums[i]);
}

static lf_types *keep_types(lf_tape *tape, const lf_types *types)
{
    lf_types *kept = lf_alloc(tape, sizeof *kept);
    *kept = *types;
    return kept;
}

lf_tensor *lf_blocks_norm(lf_tape *tape, const lf_types *types, lf_tensor *x, lf_tensor *gain)
{
    const long n = x->dim[2], c = n / lf_types_planes(types);
    LF_REQUIRE(gain->size == lf_types_gates(types) * c, "lf_blocks_norm: gain [%ld]", gain->size);
    lf_tensor *y = lf_tensor_like(tape, x);
    for (long b = 0; b < x->dim[0]; b++)
        for (int h = 0; h < LF_PARTS; h++) {
            const lf_vec q = inverse_rms(n, x->value + b * n * W, h);
            for (long j = 0; j < n; j++)
                lf_block_set(y->value + b * n * W, j, h,
                             q * gain->value[gain_of(types, j, c)] *
                                 lf_block_get(x->value + b * n * W, j, h));
        }
    lf_record(tape, "blocks_norm", norm_backward, keep_types(tape, types), LF_IN(x, gain),
              LF_OUT(y));
    return y;
}

/* ---- invariants --------------------------------------------------------------------------------
 */

static void invariants_backward(const lf_node *node)
{
    const lf_types *types = node->saved;
    const lf_tensor *x = node->in[0], *y = node->out[0];
    const long n = x->dim[2] * W, ny = y->dim[2] * W;
    const long c = x->dim[2] / lf_types_planes(types);
    for (long g = 0; g < x->dim[0]; g++)
        lf_group_invariants_backward(types, c, x->value + g * n, y->value + g * ny,
                                     y->grad + g * ny, x->grad + g * n);
}

lf_tensor *lf_blocks_invariants(lf_tape *tape, const lf_types *types, lf_tensor *x)
{
    const long c = x->dim[2] / lf_types_planes(types), ny = lf_types_gates(types) * c;
    lf_tensor *y = lf_tensor_new(tape, 4, LF_DIMS(x->dim[0], 1, ny, W));
    for (long g = 0; g < x->dim[0]; g++)
        lf_group_invariants(types, c, x->value + g * x->dim[2] * W, y->value + g * ny * W);
    lf_record(tape, "blocks_invariants", invariants_backward, keep_types(tape, types), LF_IN(x),
              LF_OUT(y));
    return y;
}

/* ---- gated nonlinearity ------------------------------------------------------------------------
 */

typedef struct gated {
    lf_types types;
    long c, n;     /* n = Q c */
    lf_real *norm; /* [G, n, W] */
    lf_real *gate; /* [G, n, W]: ELU's slope for the scalars, sigmoids */
} gated;

static void gated_backward(const lf_node *node)
{
    const gated *t = node->saved;
    const lf_tensor *x = node->in[0], *w = node->in[1], *b = node->in[2];
    const long groups = x->dim[0], row = x->dim[2] * W, n = t->n * W;
    const long step = lf_group_step(t->n);
    lf_real *dl = lf_alloc_reals(node->tape, groups * step), *dn = lf_alloc_reals(node->tape, n);
    lf_real *spare = x->grad ? NULL : lf_alloc_reals(node->tape, row);
    for (long g = 0; g < groups; g++) {
        lf_real *dx = spare ? spare : x->grad + g * row;
        lf_group_gate_backward(&t->types, t->c, x->value + g * row, t->gate + g * step,
                               node->out[0]->grad + g * row, dx, dl + g * step);
        const lf_block_terms p = {.in = t->n, .x = dl + g * step, .w = {w->value, 1, t->n}};
        lf_block_product(&p, t->n, dn);
        lf_group_invariants_backward(&t->types, t->c, x->value + g * row, t->norm + g * step, dn,
                                     dx);
    }
    const lf_block_pairs p = {groups, step, step, t->norm, dl, NULL, NULL, 0};
    if (w->grad)
        lf_block_outer(&p, t->n, t->n, w->grad);
    if (b->grad)
        lf_block_sums(groups, step, t->n, dl, b->grad);
}

lf_tensor *lf_blocks_gated(lf_tape *tape, const lf_types *types, lf_tensor *x, lf_tensor *w,
                           lf_tensor *b)
{
    const long c = x->dim[2] / lf_types_planes(types), n = lf_types_gates(types) * c,
               groups = x->dim[0];
    LF_REQUIRE(w->size == n * n && b->size == n, "lf_blocks_gated: w of %ld for %ld invariants",
               w->size, n);
    gated *t = lf_alloc(tape, sizeof *t);
    *t = (gated){.types = *types, .c = c, .n = n};
    const long step = lf_group_step(t->n);
    t->norm = lf_alloc_reals(tape, groups * step);
    t->gate = lf_alloc_reals(tape, groups * step);
    lf_tensor *y = lf_tensor_like(tape, x);
    for (long g = 0; g < groups; g++) {
        const lf_real *xg = x->value + g * x->dim[2] * W;
        lf_real *norm = t->norm + g * step, *gate = t->gate + g * step;
        lf_group_invariants(types, c, xg, norm);
        const lf_block_terms p = {.in = n, .x = norm, .w = {w->value, n, 1}, .bias = b->value};
        lf_block_product(&p, n, gate);
        lf_group_gate(types, c, xg, gate, y->value + g * x->dim[2] * W);
    }
    const double logits = (double)(groups * W) * (double)w->size;
    lf_products(tape, logits, logits * (1 + w->wants));
    lf_record(tape, "blocks_gated", gated_backward, t, LF_IN(x, w, b), LF_OUT(y));
    return y;
}
