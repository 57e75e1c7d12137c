/* block_maps.c: blocks from rows and back, and linear maps of blocks.      [layers/light_blocks.h]
 *
 *   linear   y = act(x w + b)              dz = act' dy, dx += dz w', dw += x dz, db += dz
 *   map      per type y = (A + i B) x      as in so2_linear.c
 *
 * The gradient of a weight is summed over all blocks and groups in registers.
 */
#include "layers/block_groups.h"

enum { W = LF_BLOCK_POINTS };

/* ---- where points and views stand --------------------------------------------------------------
 */

/* Group numbers; returns how many. */
static long list_groups(const lf_light_geometry *rays, long points, long blocks, long *first,
                        long *view)
{
    long groups = 0;
    for (long b = 0; b < blocks; b++) {
        first[b] = groups;
        for (long v = 0; v < rays->views; v++) {
            bool seen = false;
            for (long p = b * W; p < points && p < (b + 1) * W && !seen; p++)
                seen = rays->mask->value[p * rays->views + v] > 0;
            view[groups] = v;
            groups += seen;
        }
    }
    first[blocks] = groups;
    return groups;
}

static void fill_group(const lf_blocks *k, long b, long g, lf_real *mask, lf_real *phase,
                       lf_real *angle)
{
    const lf_light_geometry *rays = k->rays;
    const long phases = lf_types_phases(&k->types), v = k->view[g];
    for (long l = 0; l < W; l++) {
        const long p = b * W + l < k->points ? b * W + l : k->points - 1;
        const long pv = p * rays->views + v;
        const lf_real *z = rays->phase->value + (p / rays->samples * rays->views + v) * phases;
        mask[g * W + l] = b * W + l < k->points ? rays->mask->value[pv] : 0;
        for (long i = 0; i < phases; i++)
            phase[(g * phases + i) * W + l] = z[i];
        for (long i = 0; i < 3; i++)
            angle[(g * 3 + i) * W + l] = rays->angle->value[3 * pv + i];
    }
}

lf_blocks lf_blocks_make(lf_tape *tape, const lf_light_geometry *geometry)
{
    lf_light_geometry *rays = lf_alloc(tape, sizeof *rays); /* the backward needs it too */
    *rays = *geometry;
    const long points = rays->rays * rays->samples, blocks = (points + W - 1) / W;
    const long phases = lf_types_phases(&rays->types);
    lf_blocks k = {rays, rays->types, points, blocks, 0, NULL, NULL, NULL, NULL, NULL, NULL};
    long *first = lf_alloc(tape, (size_t)(blocks + 1) * sizeof *first);
    long *view = lf_alloc(tape, (size_t)(blocks * rays->views) * sizeof *view);
    k.groups = list_groups(rays, points, blocks, first, view);
    lf_real *mask = lf_alloc_reals(tape, k.groups * W), *share = lf_alloc_reals(tape, blocks * W);
    lf_real *phase = lf_alloc_reals(tape, k.groups * phases * W);
    k.first = first;
    k.view = view;
    k.mask = mask;
    k.share = share;
    k.phase = phase;
    lf_real *angle = lf_alloc_reals(tape, k.groups * 3 * W);
    k.angle = angle;
    for (long b = 0; b < blocks; b++)
        for (long g = first[b]; g < first[b + 1]; g++)
            fill_group(&k, b, g, mask, phase, angle);
    for (long p = 0; p < blocks * W; p++) {
        const lf_real count = p < points ? rays->count->value[p] : 0;
        share[p] = count > 0 ? 1 / count : 0;
    }
    return k;
}

/* ---- rows <-> blocks ---------------------------------------------------------------------------
 */

/* Where rows of a tensor stand: row of point p and view v (0 without views), or -1. */
typedef struct rows {
    lf_blocks blocks;
    bool views;
} rows;

static long row_of(const rows *t, long b, long g, long lane)
{
    const long p = b * W + lane;
    if (p >= t->blocks.points)
        return -1;
    if (!t->views)
        return p;
    return t->blocks.mask[g * W + lane] > 0 ? p * t->blocks.rays->views + t->blocks.view[g] : -1;
}

/* `count` adjacent numbers of the rows at `row` (-1: none) -> the same of LF_LANES points. */
static void rows_to_block(const long *row, long n, long count, const lf_real *x, lf_real *y)
{
    lf_vec v[LF_LANES];
    for (int l = 0; l < LF_LANES; l++)
        v[l] = row[l] >= 0 ? lf_vec_load_part(x + row[l] * n, count) : (lf_vec){0};
    lf_vec_transpose(v);
    for (long i = 0; i < count; i++)
        lf_vec_store(y + i * W, v[i]);
}

/* And back, adding. */
static void block_to_rows(const long *row, long n, long count, lf_real *x, const lf_real *y)
{
    lf_vec v[LF_LANES];
    for (long i = 0; i < LF_LANES; i++)
        v[i] = i < count ? lf_vec_load(y + i * W) : (lf_vec){0};
    lf_vec_transpose(v);
    for (int l = 0; l < LF_LANES; l++)
        if (row[l] >= 0)
            lf_vec_store_part(x + row[l] * n, count,
                              lf_vec_load_part(x + row[l] * n, count) + v[l]);
}

/* x [rows, n] -> y [.., n, W], or with `back` y -> x, adding. */
static void move(const rows *t, long n, lf_real *x, lf_real *y, bool back)
{
    for (long b = 0; b < t->blocks.blocks; b++) {
        const long first = t->views ? t->blocks.first[b] : b;
        const long last = t->views ? t->blocks.first[b + 1] : b + 1;
        for (long g = first; g < last; g++) {
            long row[W];
            for (long l = 0; l < W; l++)
                row[l] = row_of(t, b, g, l);
            for (long l = 0; l < W; l += LF_LANES)
                for (long i = 0; i < n; i += LF_LANES) {
                    const long count = n - i < LF_LANES ? n - i : LF_LANES;
                    lf_real *block = y + (g * n + i) * W + l;
                    if (back)
                        block_to_rows(row + l, n, count, x + i, block);
                    else
                        rows_to_block(row + l, n, count, x + i, block);
                }
        }
    }
}

static void of_rows_backward(const lf_node *node)
{
    const lf_tensor *x = node->in[0];
    move(node->saved, lf_cols(x), x->grad, node->out[0]->grad, true);
}

static lf_tensor *of_rows(lf_tape *tape, const lf_blocks *blocks, lf_tensor *x, bool views)
{
    const long n = lf_cols(x), count = blocks->points * (views ? blocks->rays->views : 1);
    LF_REQUIRE(lf_rows(x) == count, "lf_blocks_of: %ld rows, not %ld", lf_rows(x), count);
    rows *t = lf_alloc(tape, sizeof *t);
    *t = (rows){*blocks, views};
    lf_tensor *y =
        lf_tensor_new(tape, 4, LF_DIMS(views ? blocks->groups : blocks->blocks, 1, n, W));
    move(t, n, x->value, y->value, false);
    lf_record(tape, "blocks_of_rows", of_rows_backward, t, LF_IN(x), LF_OUT(y));
    return y;
}

lf_tensor *lf_blocks_of_views(lf_tape *tape, const lf_blocks *blocks, lf_tensor *x)
{
    return of_rows(tape, blocks, x, true);
}

lf_tensor *lf_blocks_of_points(lf_tape *tape, const lf_blocks *blocks, lf_tensor *x)
{
    return of_rows(tape, blocks, x, false);
}

static void rows_backward(const lf_node *node)
{
    const lf_tensor *x = node->in[0], *y = node->out[0];
    const rows *t = node->saved;
    const long n = lf_cols(y);
    for (long p = 0; p < t->blocks.points; p++)
        for (long i = 0; i < n; i++)
            x->grad[(p / W * n + i) * W + p % W] += y->grad[p * n + i];
}

lf_tensor *lf_blocks_rows(lf_tape *tape, const lf_blocks *blocks, lf_tensor *x)
{
    const long n = x->dim[2];
    LF_REQUIRE(x->rank == 4 && x->dim[0] == blocks->blocks, "lf_blocks_rows: %ld blocks, not %ld",
               x->dim[0], blocks->blocks);
    rows *t = lf_alloc(tape, sizeof *t);
    *t = (rows){*blocks, false};
    lf_tensor *y = lf_tensor_new(tape, 3, LF_DIMS(blocks->rays->rays, blocks->rays->samples, n));
    memset(y->value, 0, (size_t)y->size * sizeof *y->value);
    move(t, n, y->value, x->value, true);
    lf_record(tape, "blocks_rows", rows_backward, t, LF_IN(x), LF_OUT(y));
    return y;
}

/* ---- linear maps -------------------------------------------------------------------------------
 */

static void activate(long n, lf_activation act, lf_real *y)
{
    lf_vec slope;
    for (long i = 0; i < n; i++)
        for (int h = 0; act != LF_IDENTITY && h < LF_PARTS; h++) {
            const lf_vec z = lf_block_get(y, i, h);
            lf_block_set(y, i, h,
                         act == LF_RELU      ? lf_vec_relu(z)
                         : act == LF_SIGMOID ? lf_vec_sigmoid(z)
                                             : lf_vec_elu_slope(z, &slope));
        }
}

/* dz from y and dy; the ELU's slope is 1 + y below 0. */
static const lf_real *behind(const lf_node *node, lf_activation act)
{
    const lf_tensor *y = node->out[0];
    if (act == LF_IDENTITY)
        return y->grad;
    lf_real *dz = lf_alloc_reals(node->tape, y->size);
    const lf_vec zero = {0};
    for (long i = 0; i < y->size; i += LF_LANES) {
        const lf_vec v = lf_vec_load(y->value + i), d = lf_vec_load(y->grad + i);
        lf_vec_store(dz + i, act == LF_RELU      ? lf_vec_select(v > 0, d, zero)
                             : act == LF_SIGMOID ? v * (1 - v) * d
                                                 : lf_vec_select(v > 0, d, d * (1 + v)));
    }
    return dz;
}

static void linear_backward(const lf_node *node)
{
    const lf_tensor *x = node->in[0], *w = node->in[1], *b = node->in[2];
    const long in = w->dim[0], out = w->dim[1], groups = x->dim[0];
    const lf_real *dz = behind(node, *(const lf_activation *)node->saved);
    const lf_block_terms t = {.in = out,
                              .x = dz,
                              .w = {w->value, 1, out},
                              .accumulate = true,
                              .groups = groups,
                              .x_step = out * W,
                              .y_step = in * W};
    if (x->grad)
        lf_block_product(&t, in, x->grad);
    const lf_block_pairs p = {groups, in * W, out * W, x->value, dz, NULL, NULL, 0};
    if (w->grad)
        lf_block_outer(&p, in, out, w->grad);
    if (b && b->grad)
        lf_block_sums(groups, out * W, out, dz, b->grad);
}

lf_tensor *lf_blocks_linear(lf_tape *tape, lf_tensor *x, lf_tensor *w, lf_tensor *b,
                            lf_activation act)
{
    LF_REQUIRE(x->rank == 4 && x->dim[2] == w->dim[0] && (!b || b->size == w->dim[1]),
               "lf_blocks_linear: %ld numbers, w [%ld, %ld]", x->dim[2], w->dim[0], w->dim[1]);
    const long in = w->dim[0], out = w->dim[1];
    lf_tensor *y = lf_tensor_new(tape, 4, LF_DIMS(x->dim[0], 1, out, W));
    const lf_block_terms t = {.in = in,
                              .x = x->value,
                              .w = {w->value, out, 1},
                              .bias = b ? b->value : NULL,
                              .groups = x->dim[0],
                              .x_step = in * W,
                              .y_step = out * W};
    lf_block_product(&t, out, y->value);
    activate(x->dim[0] * out, act, y->value);
    lf_activation *saved = lf_alloc(tape, sizeof *saved);
    *saved = act;
    lf_products_of(tape, (double)(x->dim[0] * W) * (double)w->size, x, w);
    lf_record(tape, "blocks_linear", linear_backward, saved, LF_IN(x, w, b), LF_OUT(y));
    return y;
}

lf_tensor *lf_blocks_mlp(lf_tape *tape, const lf_mlp *mlp, lf_tensor *x)
{
    for (int i = 0; i < mlp->count; i++)
        x = lf_blocks_linear(tape, x, lf_param(tape, mlp->layer[i].weight),
                             lf_param(tape, mlp->layer[i].bias),
                             i + 1 < mlp->count ? mlp->act : LF_IDENTITY);
    return x;
}

/* ---- maps within a type ------------------------------------------------------------------------
 */

static void map_backward(const lf_node *node)
{
    const lf_group_map *m = node->saved;
    const lf_tensor *x = node->in[0], *w = node->in[1], *b = node->in[2], *y = node->out[0];
    const long groups = x->dim[0], rx = x->dim[2] * W, ry = y->dim[2] * W;
    for (long g = 0; x->grad && g < groups; g++)
        lf_group_map_apply(m, w->value, NULL, true, true, y->grad + g * ry, x->grad + g * rx);
    if (w->grad)
        lf_group_map_weights(m, groups, x->value, rx, y->grad, ry, w->grad);
    if (b && b->grad)
        lf_block_sums(groups, ry, b->size, y->grad, b->grad);
}

lf_tensor *lf_blocks_map(lf_tape *tape, const lf_types *types, const lf_so2_map *layer,
                         lf_tensor *x)
{
    const long planes = lf_types_planes(types), groups = x->dim[0];
    lf_tensor *w = lf_param(tape, layer->weight);
    lf_tensor *b = layer->bias ? lf_param(tape, layer->bias) : NULL;
    LF_REQUIRE(x->rank == 4 && w->dim[0] == lf_types_matrices(types) &&
                   x->dim[2] == planes * w->dim[1],
               "lf_blocks_map: %ld numbers, w of %ld matrices", x->dim[2], w->dim[0]);
    lf_group_map *m = lf_alloc(tape, sizeof *m);
    *m = (lf_group_map){*types, w->dim[1], w->dim[2]};
    const long rx = x->dim[2] * W, n = planes * m->out;
    lf_tensor *y = lf_tensor_new(tape, 4, LF_DIMS(groups, 1, n, W));
    for (long g = 0; g < groups; g++)
        lf_group_map_apply(m, w->value, b ? b->value : NULL, false, false, x->value + g * rx,
                           y->value + g * n * W);
    lf_products_of(tape, (double)(groups * W) * lf_group_map_products(m), x, w);
    lf_record(tape, "blocks_map", map_backward, m, LF_IN(x, w, b), LF_OUT(y));
    return y;
}
