/* block_views.c: what happens to a view of a point, in blocks: ray -> ray convolution, and the
 * update of keys and values                                                [layers/light_blocks.h]
 *
 *   convolution   m = f W + b,  h = ReLU(angle W1 + b1),  a = h W2 + b2,  k = (1 + a) z m
 *   update        u = from_view k + point,  y = gate(u, [scalars, norms of u] Wg + bg),  out y
 *
 * Shapes      f [G, 1, F, W], k [G, 1, P C, W] or its mean [B, 1, P C, W]; point [B, 1, P 2C, W].
 * Keeps       m, h, a; u, invariants, gates, y. Nothing else of a view is ever stored.
 * Masked      views that do not see a point give 0 and get no gradient.
 */
#include "layers/block_groups.h"

enum { W = LF_BLOCK_POINTS };

/* ---- rays to rays ------------------------------------------------------------------------------
 */

typedef struct turn {
    lf_blocks blocks;
    long in, c, n, gates, hidden; /* F, C, P C, Q C, width of the profile's MLP */
    bool mean;
    lf_real *m, *a, *h; /* [G, n, W], [G, gates, W], [G, hidden, W], lf_group_step apart */
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
    const lf_types *types = &t->blocks.types;
    const long c = t->c;
    const lf_real *z = t->blocks.phase + g * lf_types_phases(types) * W;
    for (int h = 0; h < LF_PARTS; h++) {
        const lf_vec weight = weight_of(t, b, g, h);
        for (long i = 0; i < lf_types_scalars(types) * c; i++)
            lf_block_add(y, i, h, weight * (1 + lf_block_get(a, i, h)) * lf_block_get(m, i, h));
        for (long k = 1; k < types->count; k++) {
            const lf_vec x = weight * lf_block_get(z, 2 * k - 1, h);
            const lf_vec s = weight * lf_block_get(z, 2 * k, h);
            for (long i = 0; i < c; i++) {
                const long re = lf_types_plane(types, k) * c + i, im = re + c;
                const long gate = lf_types_gate(types, k) * c + i;
                const lf_vec f = 1 + lf_block_get(a, gate, h);
                const lf_vec u = f * lf_block_get(m, re, h), v = f * lf_block_get(m, im, h);
                lf_block_add(y, re, h, x * u - s * v);
                lf_block_add(y, im, h, s * u + x * v);
            }
        }
    }
}

/* dm and da from dy. */
static void turn_group_backward(const turn *t, long b, long g, const lf_real *m, const lf_real *a,
                                const lf_real *dy, lf_real *dm, lf_real *da)
{
    const lf_types *types = &t->blocks.types;
    const long c = t->c;
    const lf_real *z = t->blocks.phase + g * lf_types_phases(types) * W;
    for (int h = 0; h < LF_PARTS; h++) {
        const lf_vec weight = weight_of(t, b, g, h);
        for (long i = 0; i < lf_types_scalars(types) * c; i++) {
            const lf_vec d = weight * lf_block_get(dy, i, h);
            lf_block_set(dm, i, h, (1 + lf_block_get(a, i, h)) * d);
            lf_block_set(da, i, h, lf_block_get(m, i, h) * d);
        }
        for (long k = 1; k < types->count; k++) {
            const lf_vec x = weight * lf_block_get(z, 2 * k - 1, h);
            const lf_vec s = weight * lf_block_get(z, 2 * k, h);
            for (long i = 0; i < c; i++) {
                const long re = lf_types_plane(types, k) * c + i, im = re + c;
                const long gate = lf_types_gate(types, k) * c + i;
                const lf_vec dr = lf_block_get(dy, re, h), di = lf_block_get(dy, im, h);
                const lf_vec gr = x * dr + s * di, gi = x * di - s * dr;
                const lf_vec f = 1 + lf_block_get(a, gate, h);
                lf_block_set(dm, re, h, f * gr);
                lf_block_set(dm, im, h, f * gi);
                lf_block_set(da, gate, h,
                             lf_block_get(m, re, h) * gr + lf_block_get(m, im, h) * gi);
            }
        }
    }
}

/* `count` adjacent groups of block b. */
static void forward_groups(const turn *t, long b, long g, long count, lf_tensor *const *in,
                           lf_real *y)
{
    const long n = lf_group_step(t->n), na = lf_group_step(t->gates), nh = lf_group_step(t->hidden);
    lf_real *m = t->m + g * n, *a = t->a + g * na, *h = t->h + g * nh;
    lf_block_terms p = {.in = t->in,
                        .x = in[0]->value + g * t->in * W,
                        .w = {in[1]->value, t->n, 1},
                        .bias = in[2]->value,
                        .groups = count,
                        .x_step = t->in * W,
                        .y_step = n};
    lf_block_product(&p, t->n, m);
    p = (lf_block_terms){.in = 3,
                         .x = t->blocks.angle + g * 3 * W,
                         .w = {in[3]->value, t->hidden, 1},
                         .bias = in[4]->value,
                         .groups = count,
                         .x_step = 3 * W,
                         .y_step = nh};
    lf_block_product(&p, t->hidden, h);
    for (long k = 0; k < count; k++)
        for (long i = k * nh; i < k * nh + t->hidden * W; i += LF_LANES)
            lf_vec_store(h + i, lf_vec_relu(lf_vec_load(h + i)));
    p = (lf_block_terms){.in = t->hidden,
                         .x = h,
                         .w = {in[5]->value, t->gates, 1},
                         .bias = in[6]->value,
                         .groups = count,
                         .x_step = nh,
                         .y_step = na};
    lf_block_product(&p, t->gates, a);
    for (long k = 0; k < count; k++)
        turn_group(t, b, g + k, m + k * n, a + k * na, y + (t->mean ? b : g + k) * t->n * W);
}

/* Gradients of `count` adjacent groups of block b: of f, added, and of m, a and hidden numbers. */
static void backward_groups(const turn *t, const lf_node *node, long b, long g, long count,
                            lf_real *dm, lf_real *da, lf_real *dh)
{
    const lf_tensor *f = node->in[0], *w = node->in[1], *w2 = node->in[5];
    const long n = lf_group_step(t->n), na = lf_group_step(t->gates), nh = lf_group_step(t->hidden);
    const lf_real *h = t->h + g * nh;
    const lf_vec none = {0};
    for (long k = 0; k < count; k++)
        turn_group_backward(t, b, g + k, t->m + (g + k) * n, t->a + (g + k) * na,
                            node->out[0]->grad + (t->mean ? b : g + k) * t->n * W, dm + k * n,
                            da + k * na);
    lf_block_terms p = {.in = t->n,
                        .x = dm,
                        .w = {w->value, 1, t->n},
                        .accumulate = true,
                        .groups = count,
                        .x_step = n,
                        .y_step = t->in * W};
    if (f->grad)
        lf_block_product(&p, t->in, f->grad + g * t->in * W);
    p = (lf_block_terms){.in = t->gates,
                         .x = da,
                         .w = {w2->value, 1, t->gates},
                         .groups = count,
                         .x_step = na,
                         .y_step = nh};
    lf_block_product(&p, t->hidden, dh);
    for (long k = 0; k < count; k++)
        for (long i = k * nh; i < k * nh + t->hidden * W; i += LF_LANES)
            lf_vec_store(dh + i, lf_vec_select(lf_vec_load(h + i) > 0, lf_vec_load(dh + i), none));
}

/* dw += x dy and db += dy over all groups. */
static void add_weights(long groups, long in, const lf_real *x, long x_step, long out,
                        const lf_real *dy, const lf_tensor *w, const lf_tensor *b)
{
    const lf_block_pairs p = {groups, x_step, lf_group_step(out), x, dy, NULL, NULL, 0};
    if (w->grad)
        lf_block_outer(&p, in, out, w->grad);
    if (b->grad)
        lf_block_sums(groups, p.y_step, out, dy, b->grad);
}

static void convolution_backward(const lf_node *node)
{
    const turn *t = node->saved;
    const long groups = t->blocks.groups, n = lf_group_step(t->n), na = lf_group_step(t->gates);
    const long nh = lf_group_step(t->hidden);
    lf_tensor *const *in = node->in;
    lf_real *dm = lf_alloc_reals(node->tape, groups * n);
    lf_real *da = lf_alloc_reals(node->tape, groups * na);
    lf_real *dh = lf_alloc_reals(node->tape, groups * nh);
    for (long b = 0; b < t->blocks.blocks; b++)
        for (long g = t->blocks.first[b], count; g < t->blocks.first[b + 1]; g += count) {
            count = lf_group_count(t->blocks.first[b + 1] - g);
            backward_groups(t, node, b, g, count, dm + g * n, da + g * na, dh + g * nh);
        }
    add_weights(groups, t->in, in[0]->value, t->in * W, t->n, dm, in[1], in[2]);
    add_weights(groups, 3, t->blocks.angle, 3 * W, t->hidden, dh, in[3], in[4]);
    add_weights(groups, t->hidden, t->h, nh, t->gates, da, in[5], in[6]);
}

/* A pair: m, h, a, and 3 a number for (1 + a) z m; back also into f, and into h but not the angle.
 */
static void count_convolution(lf_tape *tape, const turn *t, lf_tensor *const *in)
{
    const double scalars = (double)(lf_types_scalars(&t->blocks.types) * t->c);
    const double map = (double)(t->in * t->n), turned = scalars + 3.0 * ((double)t->n - scalars);
    const double first = 3.0 * (double)t->hidden, second = (double)(t->hidden * t->gates);
    const double pairs = lf_blocks_pairs(&t->blocks);
    lf_products(tape, pairs * (map + turned + first + second),
                pairs * (map * (in[0]->wants + in[1]->wants) + 2 * turned + first * in[3]->wants +
                         second * (1 + in[5]->wants)));
}

lf_tensor *lf_blocks_convolution(lf_tape *tape, const lf_blocks *blocks,
                                 const lf_ray_ray_convolution *layer, lf_tensor *f, bool mean)
{
    const lf_linear_layer *one = &layer->profile.layer[0], *two = &layer->profile.layer[1];
    lf_tensor *in[] = {f,
                       lf_param(tape, layer->map.weight),
                       lf_param(tape, layer->map.bias),
                       lf_param(tape, one->weight),
                       lf_param(tape, one->bias),
                       lf_param(tape, two->weight),
                       lf_param(tape, two->bias)};
    const long planes = lf_types_planes(&blocks->types), n = in[1]->dim[1], groups = blocks->groups;
    LF_REQUIRE(f->rank == 4 && f->dim[0] == groups && f->dim[2] == in[1]->dim[0] &&
                   n % planes == 0 &&
                   in[5]->dim[1] == lf_types_gates(&blocks->types) * (n / planes) &&
                   layer->profile.count == 2 && layer->profile.act == LF_RELU,
               "lf_blocks_convolution: f [%ld, 1, %ld], map to %ld, %ld groups", f->dim[0],
               f->dim[2], n, groups);
    turn *t = lf_alloc(tape, sizeof *t);
    *t = (turn){.blocks = *blocks,
                .in = f->dim[2],
                .c = n / planes,
                .n = n,
                .gates = in[5]->dim[1],
                .hidden = in[5]->dim[0],
                .mean = mean};
    t->m = lf_alloc_reals(tape, groups * lf_group_step(t->n));
    t->a = lf_alloc_reals(tape, groups * lf_group_step(t->gates));
    t->h = lf_alloc_reals(tape, groups * lf_group_step(t->hidden));
    lf_tensor *y = lf_tensor_new(tape, 4, LF_DIMS(mean ? blocks->blocks : groups, 1, n, W));
    memset(y->value, 0, (size_t)y->size * sizeof *y->value);
    for (long b = 0; b < blocks->blocks; b++)
        for (long g = blocks->first[b], count; g < blocks->first[b + 1]; g += count) {
            count = lf_group_count(blocks->first[b + 1] - g);
            forward_groups(t, b, g, count, in, y->value);
        }
    if (lf_profiled(tape))
        count_convolution(tape, t, in);
    lf_record(tape, "blocks_convolution", convolution_backward, t, 7, in, 1, &y);
    return y;
}

/* ---- update of keys and values -----------------------------------------------------------------
 */

typedef struct update {
    lf_blocks blocks;
    lf_group_map from, to; /* C -> D, D -> C' */
    long n, inner, gates;  /* P C, P D, Q D */
    lf_real *u, *y;        /* [G, inner, W], lf_group_step apart, like */
    lf_real *norm, *gate;  /* [G, gates, W] */
} update;

/* The views' share, the point's, and invariants of both. */
static void mix_point(const update *t, long b, long g, lf_tensor *const *in)
{
    const lf_real *point = in[1]->value + b * t->inner * W;
    lf_real *u = t->u + g * lf_group_step(t->inner);
    lf_group_map_apply(&t->from, in[2]->value, in[3]->value, false, false,
                       in[0]->value + g * t->n * W, u);
    for (long i = 0; i < t->inner * W; i += LF_LANES)
        lf_vec_store(u + i, lf_vec_load(u + i) + lf_vec_load(point + i));
    lf_group_invariants(&t->blocks.types, t->from.out, u, t->norm + g * lf_group_step(t->gates));
}

/* `count` adjacent groups of block b. in: view, point, w, b, gate w, gate b, out w, out b. */
static void update_groups(const update *t, long b, long g, long count, lf_tensor *const *in,
                          lf_real *out)
{
    const long step = lf_group_step(t->inner), gates = lf_group_step(t->gates);
    const long row = lf_types_planes(&t->to.types) * t->to.out * W;
    for (long k = g; k < g + count; k++)
        mix_point(t, b, k, in);
    const lf_block_terms p = {.in = t->gates,
                              .x = t->norm + g * gates,
                              .w = {in[4]->value, t->gates, 1},
                              .bias = in[5]->value,
                              .groups = count,
                              .x_step = gates,
                              .y_step = gates};
    lf_block_product(&p, t->gates, t->gate + g * gates);
    for (long k = g; k < g + count; k++) {
        lf_group_gate(&t->blocks.types, t->from.out, t->u + k * step, t->gate + k * gates,
                      t->y + k * step);
        lf_group_map_apply(&t->to, in[6]->value, in[7]->value, false, false, t->y + k * step,
                           out + k * row);
    }
}

/* From the logits' and the norms' gradients dl, dn of group g on to u, the view and the point. */
static void mix_point_backward(const update *t, const lf_node *node, long b, long g,
                               const lf_real *dn, lf_real *du)
{
    lf_tensor *const *in = node->in;
    lf_real *point = in[1]->grad ? in[1]->grad + b * t->inner * W : NULL;
    lf_group_invariants_backward(&t->blocks.types, t->from.out, t->u + g * lf_group_step(t->inner),
                                 t->norm + g * lf_group_step(t->gates), dn, du);
    if (in[0]->grad)
        lf_group_map_apply(&t->from, in[2]->value, NULL, true, true, du,
                           in[0]->grad + g * t->n * W);
    for (long i = 0; point && i < t->inner * W; i += LF_LANES)
        lf_vec_store(point + i, lf_vec_load(point + i) + lf_vec_load(du + i));
}

/* Gradients of the views and the point, added, and of u and the logits, of `count` adjacent groups;
 * `spare` holds LF_BLOCK_SIDE groups of gates and one of inner numbers. */
static void update_groups_backward(const update *t, const lf_node *node, long b, long g, long count,
                                   lf_real *du, lf_real *dl, lf_real *spare)
{
    lf_tensor *const *in = node->in;
    const long step = lf_group_step(t->inner), gates = lf_group_step(t->gates);
    const long row = lf_types_planes(&t->to.types) * t->to.out * W;
    lf_real *dn = spare, *dy = spare + LF_BLOCK_SIDE * gates;
    memset(du, 0, (size_t)(count * step) * sizeof *du);
    for (long k = 0; k < count; k++) {
        lf_group_map_apply(&t->to, in[6]->value, NULL, true, false,
                           node->out[0]->grad + (g + k) * row, dy);
        lf_group_gate_backward(&t->blocks.types, t->from.out, t->u + (g + k) * step,
                               t->gate + (g + k) * gates, dy, du + k * step, dl + k * gates);
    }
    const lf_block_terms p = {.in = t->gates,
                              .x = dl,
                              .w = {in[4]->value, 1, t->gates},
                              .groups = count,
                              .x_step = gates,
                              .y_step = gates};
    lf_block_product(&p, t->gates, dn);
    for (long k = 0; k < count; k++)
        mix_point_backward(t, node, b, g + k, dn + k * gates, du + k * step);
}

static void update_backward(const lf_node *node)
{
    const update *t = node->saved;
    lf_tensor *const *in = node->in;
    const long groups = t->blocks.groups, step = lf_group_step(t->inner);
    const long gates = lf_group_step(t->gates), row = node->out[0]->dim[2] * W;
    lf_real *du = lf_alloc_reals(node->tape, groups * step);
    lf_real *dl = lf_alloc_reals(node->tape, groups * gates);
    lf_real *spare = lf_alloc_reals(node->tape, LF_BLOCK_SIDE * gates + t->inner * W);
    for (long b = 0; b < t->blocks.blocks; b++)
        for (long g = t->blocks.first[b], count; g < t->blocks.first[b + 1]; g += count) {
            count = lf_group_count(t->blocks.first[b + 1] - g);
            update_groups_backward(t, node, b, g, count, du + g * step, dl + g * gates, spare);
        }
    if (in[2]->grad)
        lf_group_map_weights(&t->from, groups, in[0]->value, t->n * W, du, step, in[2]->grad);
    if (in[3]->grad)
        lf_block_sums(groups, step, in[3]->size, du, in[3]->grad);
    add_weights(groups, t->gates, t->norm, gates, t->gates, dl, in[4], in[5]);
    if (in[6]->grad)
        lf_group_map_weights(&t->to, groups, t->y, step, node->out[0]->grad, row, in[6]->grad);
    if (in[7]->grad)
        lf_block_sums(groups, row, in[7]->size, node->out[0]->grad, in[7]->grad);
}

/* A pair: both maps and the gates' logits. */
static void count_update(lf_tape *tape, const update *t, lf_tensor *const *in)
{
    const double from = lf_group_map_products(&t->from), to = lf_group_map_products(&t->to);
    const double gates = (double)(t->gates * t->gates), pairs = lf_blocks_pairs(&t->blocks);
    lf_products(tape, pairs * (from + gates + to),
                pairs * (from * (in[0]->wants + in[2]->wants) + gates * (1 + in[4]->wants) +
                         to * (1 + in[6]->wants)));
}

lf_tensor *lf_blocks_update(lf_tape *tape, const lf_blocks *blocks, const lf_view_update *layer,
                            lf_tensor *view, lf_tensor *q)
{
    const lf_types *types = &blocks->types;
    lf_tensor *in[] = {view,
                       lf_blocks_map(tape, types, &layer->from_point, q),
                       lf_param(tape, layer->from_view.weight),
                       lf_param(tape, layer->from_view.bias),
                       lf_param(tape, layer->gated.gate.weight),
                       lf_param(tape, layer->gated.gate.bias),
                       lf_param(tape, layer->out.weight),
                       lf_param(tape, layer->out.bias)};
    const long planes = lf_types_planes(types), groups = blocks->groups;
    update *t = lf_alloc(tape, sizeof *t);
    *t = (update){.blocks = *blocks,
                  .from = {*types, in[2]->dim[1], in[2]->dim[2]},
                  .to = {*types, in[6]->dim[1], in[6]->dim[2]},
                  .n = view->dim[2],
                  .inner = planes * in[2]->dim[2],
                  .gates = lf_types_gates(types) * in[2]->dim[2]};
    LF_REQUIRE(view->dim[0] == groups && t->n == planes * t->from.in && t->to.in == t->from.out &&
                   in[1]->size == blocks->blocks * t->inner * W && in[5]->size == t->gates,
               "lf_blocks_update: views [%ld, 1, %ld], %ld -> %ld -> %ld channels", view->dim[0],
               view->dim[2], t->from.in, t->from.out, t->to.out);
    t->u = lf_alloc_reals(tape, groups * lf_group_step(t->inner));
    t->y = lf_alloc_reals(tape, groups * lf_group_step(t->inner));
    t->norm = lf_alloc_reals(tape, groups * lf_group_step(t->gates));
    t->gate = lf_alloc_reals(tape, groups * lf_group_step(t->gates));
    const long n = planes * t->to.out;
    lf_tensor *out = lf_tensor_new(tape, 4, LF_DIMS(groups, 1, n, W));
    for (long b = 0; b < blocks->blocks; b++)
        for (long g = blocks->first[b], count; g < blocks->first[b + 1]; g += count) {
            count = lf_group_count(blocks->first[b + 1] - g);
            update_groups(t, b, g, count, in, out->value);
        }
    if (lf_profiled(tape))
        count_update(tape, t, in);
    lf_record(tape, "blocks_update", update_backward, t, 8, in, 1, &out);
    return out;
}
