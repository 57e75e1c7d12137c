/* block_fields.c: fields in blocks: rays to rays, norms, gates, attention over the views
 *                                                                          [layers/light_blocks.h]
 * Formulas as in ray_ray_convolution.c, so2_nonlinear.c and cross_attention.c.
 *
 * Keeps       gated: the invariants and the gates' slopes; attention: the weights of all heads.
 * Degenerate  points that no view sees: zeros, no gradient.
 */
#include "layers/block_kernels.h"
#include "layers/heads.h"
#include "layers/light_blocks.h"

enum { W = LF_WIDE };
static const lf_real norm_epsilon = (lf_real)1e-12, layer_epsilon = (lf_real)1e-4;

/* ---- rays to rays ------------------------------------------------------------------------------
 */

typedef struct turn {
    lf_blocks blocks;
    long c;
    bool mean;
} turn;

/* What a value of group g of block b counts: mask / number of views for the mean, else mask. */
static lf_vec weight_of(const turn *t, long b, long g, int h)
{
    const lf_vec mask = lf_vec_load(t->blocks.mask + g * W + h * LF_LANES);
    return t->mean ? mask * lf_vec_load(t->blocks.share + b * W + h * LF_LANES) : mask;
}

/* y += weight (1 + a) z m. */
static void turn_group(const turn *t, long b, long g, const lf_real *m, const lf_real *a,
                       lf_real *y)
{
    const long c = t->c;
    const lf_real *z = t->blocks.phase + g * lf_types_planes(&t->blocks.types) * W;
    for (int h = 0; h < LF_PARTS; h++) {
        const lf_vec weight = weight_of(t, b, g, h);
        for (long i = 0; i < c; i++)
            lf_block_add(y, i, h, weight * (1 + lf_block_get(a, i, h)) * lf_block_get(m, i, h));
        for (long k = 1; k < t->blocks.types.count; k++) {
            const lf_vec x = weight * lf_block_get(z, 2 * k - 1, h);
            const lf_vec s = weight * lf_block_get(z, 2 * k, h);
            for (long i = 0; i < c; i++) {
                const long re = (2 * k - 1) * c + i, im = re + c;
                const lf_vec f = 1 + lf_block_get(a, k * c + i, h);
                const lf_vec u = f * lf_block_get(m, re, h), v = f * lf_block_get(m, im, h);
                lf_block_add(y, re, h, x * u - s * v);
                lf_block_add(y, im, h, s * u + x * v);
            }
        }
    }
}

static void turn_group_backward(const turn *t, long b, long g, const lf_real *m, const lf_real *a,
                                const lf_real *dy, lf_real *dm, lf_real *da)
{
    const long c = t->c;
    const lf_real *z = t->blocks.phase + g * lf_types_planes(&t->blocks.types) * W;
    for (int h = 0; h < LF_PARTS; h++) {
        const lf_vec weight = weight_of(t, b, g, h);
        for (long i = 0; i < c; i++) {
            const lf_vec d = weight * lf_block_get(dy, i, h);
            lf_block_add(dm, i, h, (1 + lf_block_get(a, i, h)) * d);
            lf_block_add(da, i, h, lf_block_get(m, i, h) * d);
        }
        for (long k = 1; k < t->blocks.types.count; k++) {
            const lf_vec x = weight * lf_block_get(z, 2 * k - 1, h);
            const lf_vec s = weight * lf_block_get(z, 2 * k, h);
            for (long i = 0; i < c; i++) {
                const long re = (2 * k - 1) * c + i, im = re + c;
                const lf_vec dr = lf_block_get(dy, re, h), di = lf_block_get(dy, im, h);
                const lf_vec gr = x * dr + s * di, gi = x * di - s * dr;
                const lf_vec f = 1 + lf_block_get(a, k * c + i, h);
                lf_block_add(dm, re, h, f * gr);
                lf_block_add(dm, im, h, f * gi);
                lf_block_add(da, k * c + i, h,
                             lf_block_get(m, re, h) * gr + lf_block_get(m, im, h) * gi);
            }
        }
    }
}

static void turn_backward(const lf_node *node)
{
    const turn *t = node->saved;
    const lf_tensor *m = node->in[0], *a = node->in[1];
    const long n = m->dim[2] * W, na = a->dim[2] * W;
    lf_real *spare = lf_alloc_reals(node->tape, n); /* where no gradient is wanted */
    for (long b = 0; b < t->blocks.blocks; b++)
        for (long g = t->blocks.first[b]; g < t->blocks.first[b + 1]; g++)
            turn_group_backward(t, b, g, m->value + g * n, a->value + g * na,
                                node->out[0]->grad + (t->mean ? b : g) * n,
                                m->grad ? m->grad + g * n : spare,
                                a->grad ? a->grad + g * na : spare);
}

static lf_tensor *turn_views(lf_tape *tape, const lf_blocks *blocks, lf_tensor *m, lf_tensor *a,
                             bool mean)
{
    const long planes = lf_types_planes(&blocks->types), n = m->dim[2], c = n / planes;
    LF_REQUIRE(m->dim[0] == blocks->groups && a->dim[0] == blocks->groups && n == planes * c &&
                   a->dim[2] == blocks->types.count * c,
               "lf_blocks_values: m [%ld, 1, %ld], a [%ld, 1, %ld]", m->dim[0], n, a->dim[0],
               a->dim[2]);
    turn *t = lf_alloc(tape, sizeof *t);
    *t = (turn){*blocks, c, mean};
    lf_tensor *y = lf_tensor_new(tape, 4, LF_DIMS(mean ? blocks->blocks : blocks->groups, 1, n, W));
    memset(y->value, 0, (size_t)y->size * sizeof *y->value);
    for (long b = 0; b < blocks->blocks; b++)
        for (long g = blocks->first[b]; g < blocks->first[b + 1]; g++)
            turn_group(t, b, g, m->value + g * n * W, a->value + g * a->dim[2] * W,
                       y->value + (mean ? b : g) * n * W);
    lf_record(tape, mean ? "blocks_mean" : "blocks_values", turn_backward, t, LF_IN(m, a),
              LF_OUT(y));
    return y;
}

lf_tensor *lf_blocks_values(lf_tape *tape, const lf_blocks *blocks, lf_tensor *m, lf_tensor *a)
{
    return turn_views(tape, blocks, m, a, false);
}

lf_tensor *lf_blocks_mean(lf_tape *tape, const lf_blocks *blocks, lf_tensor *m, lf_tensor *a)
{
    return turn_views(tape, blocks, m, a, true);
}

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
static long gain_of(long j, long c)
{
    return (j / c + 1) / 2 * c + j % c;
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
                dot += gain->value[gain_of(j, c)] * t;
                sums[gain_of(j, c)] += q * t;
            }
            const lf_vec pull = q * q * q * dot / (lf_real)n;
            for (long j = 0; x->grad && j < n; j++)
                lf_block_add(x->grad + b * n * W, j, h,
                             q * gain->value[gain_of(j, c)] * lf_block_get(dy, j, h) -
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
    LF_REQUIRE(gain->size == types->count * c, "lf_blocks_norm: gain [%ld]", gain->size);
    lf_tensor *y = lf_tensor_like(tape, x);
    for (long b = 0; b < x->dim[0]; b++)
        for (int h = 0; h < LF_PARTS; h++) {
            const lf_vec q = inverse_rms(n, x->value + b * n * W, h);
            for (long j = 0; j < n; j++)
                lf_block_set(y->value + b * n * W, j, h,
                             q * gain->value[gain_of(j, c)] *
                                 lf_block_get(x->value + b * n * W, j, h));
        }
    lf_record(tape, "blocks_norm", norm_backward, keep_types(tape, types), LF_IN(x, gain),
              LF_OUT(y));
    return y;
}

/* ---- invariants --------------------------------------------------------------------------------
 */

static void invariants_group(int count, long c, const lf_real *x, lf_real *n)
{
    memcpy(n, x, (size_t)(c * W) * sizeof *n);
    for (long k = 1; k < count; k++)
        for (long i = 0; i < c; i++)
            for (int h = 0; h < LF_PARTS; h++) {
                const lf_vec re = lf_block_get(x, (2 * k - 1) * c + i, h);
                const lf_vec im = lf_block_get(x, 2 * k * c + i, h);
                lf_block_set(n, k * c + i, h, lf_vec_sqrt(re * re + im * im + norm_epsilon));
            }
}

/* dx += the adjoint, from the norms n and their gradient dn. */
static void invariants_group_backward(int count, long c, const lf_real *x, const lf_real *n,
                                      const lf_real *dn, lf_real *dx)
{
    for (int h = 0; h < LF_PARTS; h++) {
        for (long i = 0; i < c; i++)
            lf_block_add(dx, i, h, lf_block_get(dn, i, h));
        for (long k = 1; k < count; k++)
            for (long i = 0; i < c; i++) {
                const long re = (2 * k - 1) * c + i, im = re + c;
                const lf_vec f = lf_block_get(dn, k * c + i, h) / lf_block_get(n, k * c + i, h);
                lf_block_add(dx, re, h, f * lf_block_get(x, re, h));
                lf_block_add(dx, im, h, f * lf_block_get(x, im, h));
            }
    }
}

static void invariants_backward(const lf_node *node)
{
    const lf_types *types = node->saved;
    const lf_tensor *x = node->in[0], *y = node->out[0];
    const long n = x->dim[2] * W, ny = y->dim[2] * W;
    const long c = x->dim[2] / lf_types_planes(types);
    for (long g = 0; g < x->dim[0]; g++)
        invariants_group_backward(types->count, c, x->value + g * n, y->value + g * ny,
                                  y->grad + g * ny, x->grad + g * n);
}

lf_tensor *lf_blocks_invariants(lf_tape *tape, const lf_types *types, lf_tensor *x)
{
    const long c = x->dim[2] / lf_types_planes(types), ny = types->count * c;
    lf_tensor *y = lf_tensor_new(tape, 4, LF_DIMS(x->dim[0], 1, ny, W));
    for (long g = 0; g < x->dim[0]; g++)
        invariants_group(types->count, c, x->value + g * x->dim[2] * W, y->value + g * ny * W);
    lf_record(tape, "blocks_invariants", invariants_backward, keep_types(tape, types), LF_IN(x),
              LF_OUT(y));
    return y;
}

/* ---- gated nonlinearity ------------------------------------------------------------------------
 */

typedef struct gated {
    lf_types types;
    long c, n;     /* n = count c */
    lf_real *norm; /* [G, n, W] */
    lf_real *gate; /* [G, n, W]: ELU's slope for the scalars, sigmoids */
} gated;

/* From group to group: an odd number of lines, so that the same number of all groups does not fall
 * on few sets of a cache. */
static long gated_step(const gated *t)
{
    return (t->n + (t->n + 1) % 2) * W;
}

/* Logits in `gate` become what is kept; y from x. */
static void gate_group(const gated *t, const lf_real *x, lf_real *gate, lf_real *y)
{
    const long c = t->c;
    for (int h = 0; h < LF_PARTS; h++) {
        for (long i = 0; i < c; i++) {
            lf_vec slope;
            const lf_vec e = lf_vec_elu(lf_block_get(gate, i, h), &slope);
            lf_block_set(y, i, h, lf_block_get(x, i, h) + e);
            lf_block_set(gate, i, h, slope);
        }
        for (long k = 1; k < t->types.count; k++)
            for (long i = 0; i < c; i++) {
                const long re = (2 * k - 1) * c + i, im = re + c;
                const lf_vec g = lf_vec_sigmoid(lf_block_get(gate, k * c + i, h));
                lf_block_set(y, re, h, g * lf_block_get(x, re, h));
                lf_block_set(y, im, h, g * lf_block_get(x, im, h));
                lf_block_set(gate, k * c + i, h, g);
            }
    }
}

/* dx += g dy, and the gradient dl of the logits. */
static void gate_group_backward(const gated *t, const lf_real *x, const lf_real *gate,
                                const lf_real *dy, lf_real *dx, lf_real *dl)
{
    const long c = t->c;
    for (int h = 0; h < LF_PARTS; h++) {
        for (long i = 0; i < c; i++) {
            const lf_vec d = lf_block_get(dy, i, h);
            lf_block_add(dx, i, h, d);
            lf_block_set(dl, i, h, lf_block_get(gate, i, h) * d);
        }
        for (long k = 1; k < t->types.count; k++)
            for (long i = 0; i < c; i++) {
                const long re = (2 * k - 1) * c + i, im = re + c;
                const lf_vec g = lf_block_get(gate, k * c + i, h);
                const lf_vec dr = lf_block_get(dy, re, h), di = lf_block_get(dy, im, h);
                lf_block_add(dx, re, h, g * dr);
                lf_block_add(dx, im, h, g * di);
                lf_block_set(dl, k * c + i, h,
                             g * (1 - g) *
                                 (dr * lf_block_get(x, re, h) + di * lf_block_get(x, im, h)));
            }
    }
}

static void gated_backward(const lf_node *node)
{
    const gated *t = node->saved;
    const lf_tensor *x = node->in[0], *w = node->in[1], *b = node->in[2];
    const long groups = x->dim[0], row = x->dim[2] * W, n = t->n * W;
    const long step = gated_step(t);
    lf_real *dl = lf_alloc_reals(node->tape, groups * step), *dn = lf_alloc_reals(node->tape, n);
    lf_real *spare = x->grad ? NULL : lf_alloc_reals(node->tape, row);
    for (long g = 0; g < groups; g++) {
        lf_real *dx = spare ? spare : x->grad + g * row;
        gate_group_backward(t, x->value + g * row, t->gate + g * step, node->out[0]->grad + g * row,
                            dx, dl + g * step);
        const lf_block_terms p = {.in = t->n, .x = dl + g * step, .w = {w->value, 1, t->n}};
        lf_block_product(&p, t->n, dn);
        invariants_group_backward(t->types.count, t->c, x->value + g * row, t->norm + g * step, dn,
                                  dx);
    }
    const lf_block_pairs p = {groups, step, step, t->norm, dl, NULL, NULL, 0};
    if (w->grad)
        lf_block_outer(&p, t->n, t->n, w->grad, t->n, 1);
    if (b->grad)
        lf_block_sums(groups, step, t->n, dl, b->grad);
}

lf_tensor *lf_blocks_gated(lf_tape *tape, const lf_types *types, lf_tensor *x, lf_tensor *w,
                           lf_tensor *b)
{
    const long c = x->dim[2] / lf_types_planes(types), n = types->count * c, groups = x->dim[0];
    LF_REQUIRE(w->size == n * n && b->size == n, "lf_blocks_gated: w of %ld for %ld invariants",
               w->size, n);
    gated *t = lf_alloc(tape, sizeof *t);
    *t = (gated){.types = *types, .c = c, .n = n};
    const long step = gated_step(t);
    t->norm = lf_alloc_reals(tape, groups * step);
    t->gate = lf_alloc_reals(tape, groups * step);
    lf_tensor *y = lf_tensor_like(tape, x);
    for (long g = 0; g < groups; g++) {
        const lf_real *xg = x->value + g * x->dim[2] * W;
        lf_real *norm = t->norm + g * step, *gate = t->gate + g * step;
        invariants_group(types->count, c, xg, norm);
        const lf_block_terms p = {.in = n, .x = norm, .w = {w->value, n, 1}, .bias = b->value};
        lf_block_product(&p, n, gate);
        gate_group(t, xg, gate, y->value + g * x->dim[2] * W);
    }
    lf_record(tape, "blocks_gated", gated_backward, t, LF_IN(x, w, b), LF_OUT(y));
    return y;
}
