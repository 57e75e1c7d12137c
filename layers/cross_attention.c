/* cross_attention.c: attention of a point of the target ray over the source views   [method.md
 * 5b.4]
 *
 *   l_{v,h} = sum over the channels c of head h and all planes of q_c k_vc / sqrt(P C / H)
 *   w_{v,h} = softmax over the views that see the point,  y_c = sum_v w_{v,h(c)} val_vc
 *   W_v = mean_h w_{v,h},  blend = sum_v W_v x_v
 *   backward  dval_v = w_v dy;  dw_{v,h} = <dy, val_v>_h + dW_v / H;
 *             dl = w (dw - sum_v w dw) / sqrt(P C / H), made as in heads.h;
 *             dk_v = dl q,  dq = sum_v dl_v k_v
 *
 * Shapes      q, y [N, S, P C], k, val [N, S, V, P C], W [N, S, V], x [N, S, V, D].
 * Keeps       the weights [N, S, V, H].
 * Degenerate  no view: zeros. One view: weight 1, no gradient to q and k.
 * Masked      views that do not see the point are not computed: weight 0, no gradient.
 */
#include "layers/heads.h"
#include "layers/light_field.h"

enum { HEADS = LF_HEAD_CHANNELS, VIEWS = 256 };

typedef struct attention {
    const lf_tensor *mask;
    long points, views, planes, c;
    int heads;
    lf_real scale;
    lf_real *weight; /* [points, V, H] */
} attention;

/* Weights of one point from its logits, in place: [V, H]. */
static void softmax_views(const attention *t, const lf_real *mask, lf_real *w)
{
    const int heads = t->heads;
    for (int h = 0; h < heads; h++) {
        lf_real largest = -INFINITY, sum = 0;
        for (long v = 0; v < t->views; v++)
            if (mask[v] > 0 && w[v * heads + h] > largest)
                largest = w[v * heads + h];
        for (long v = 0; v < t->views; v++) {
            lf_real *x = &w[v * heads + h];
            *x = mask[v] > 0 ? LF_EXP(*x - largest) : 0;
            sum += *x;
        }
        for (long v = 0; sum > 0 && v < t->views; v++)
            w[v * heads + h] /= sum; /* sum >= 1: the largest term is exp(0) */
    }
}

static void forward_point(const attention *t, long p, lf_tensor *const *in, lf_tensor *const *out)
{
    const long n = t->planes * t->c, views = t->views;
    const lf_real *mask = t->mask->value + p * views, *q = in[0]->value + p * n;
    lf_real *w = t->weight + p * views * t->heads, *y = out[0]->value + p * n;
    memset(w, 0, (size_t)(views * t->heads) * sizeof *w);
    for (long v = 0; v < views; v++) {
        if (!(mask[v] > 0))
            continue;
        lf_head_products(t->planes, t->c, t->heads, q, in[1]->value + (p * views + v) * n,
                         w + v * t->heads);
        for (int h = 0; h < t->heads; h++)
            w[v * t->heads + h] *= t->scale;
    }
    softmax_views(t, mask, w);
    memset(y, 0, (size_t)n * sizeof *y);
    for (long v = 0; v < views; v++) {
        lf_real mean = 0;
        for (int h = 0; h < t->heads; h++)
            mean += w[v * t->heads + h];
        out[1]->value[p * views + v] = mean / (lf_real)t->heads;
        if (mask[v] > 0)
            lf_head_add(t->planes, t->c, t->heads, w + v * t->heads,
                        in[2]->value + (p * views + v) * n, y);
    }
}

static void backward_point(const attention *t, const lf_node *node, long p)
{
    const long n = t->planes * t->c, views = t->views;
    const int heads = t->heads;
    const lf_tensor *q = node->in[0], *k = node->in[1], *val = node->in[2];
    const lf_real *mask = t->mask->value + p * views, *dy = node->out[0]->grad + p * n;
    const lf_real *w = t->weight + p * views * heads, *dmean = node->out[1]->grad + p * views;
    lf_real dw[VIEWS * HEADS];
    memset(dw, 0, (size_t)(views * heads) * sizeof *dw);
    for (long v = 0; v < views; v++) {
        if (!(mask[v] > 0))
            continue;
        lf_head_products(t->planes, t->c, t->heads, dy, val->value + (p * views + v) * n,
                         dw + v * heads);
        for (int h = 0; h < heads; h++)
            dw[v * heads + h] += dmean[v] / (lf_real)heads;
    }
    lf_head_softmax_backward(views, heads, t->scale, w, dw);
    for (long v = 0; v < views; v++) {
        const long row = (p * views + v) * n;
        if (!(mask[v] > 0))
            continue;
        if (q->grad)
            lf_head_add(t->planes, t->c, t->heads, dw + v * heads, k->value + row, q->grad + p * n);
        if (k->grad)
            lf_head_add(t->planes, t->c, t->heads, dw + v * heads, q->value + p * n, k->grad + row);
        if (val->grad)
            lf_head_add(t->planes, t->c, t->heads, w + v * heads, dy, val->grad + row);
    }
}

static void backward(const lf_node *node)
{
    const attention *t = node->saved;
    for (long p = 0; p < t->points; p++)
        backward_point(t, node, p);
}

lf_attended lf_cross_attention(lf_tape *tape, lf_tensor *q, lf_tensor *k, lf_tensor *val,
                               const lf_light_geometry *rays, int heads)
{
    const long planes = lf_types_planes(&rays->types), c = lf_cols(q) / planes;
    const long points = rays->rays * rays->samples;
    LF_REQUIRE(heads >= 1 && heads <= HEADS && c % heads == 0 && c <= LF_HEAD_CHANNELS &&
                   lf_cols(q) == planes * c && rays->views <= VIEWS,
               "lf_cross_attention: %d heads over %ld channels, %ld views", heads, c, rays->views);
    LF_REQUIRE(lf_rows(q) == points && k->size == q->size * rays->views && val->size == k->size,
               "lf_cross_attention: q of %ld, k of %ld, values of %ld", q->size, k->size,
               val->size);
    attention *t = lf_alloc(tape, sizeof *t);
    *t = (attention){rays->mask, points, rays->views, planes, c, heads, 0, NULL};
    t->scale = (lf_real)(1 / sqrt((double)(planes * c) / heads));
    t->weight = lf_alloc_reals(tape, points * rays->views * heads);
    lf_tensor *in[] = {q, k, val};
    lf_attended y = {lf_tensor_like(tape, q),
                     lf_tensor_new(tape, 3, LF_DIMS(rays->rays, rays->samples, rays->views))};
    lf_tensor *out[] = {y.field, y.weight};
    for (long p = 0; p < points; p++)
        forward_point(t, p, in, out);
    if (lf_profiled(tape)) { /* logits and sum; back dw, dq, dk, dval */
        const double seen = lf_present(rays->mask->size, rays->mask->value);
        const double half = seen * (double)lf_cols(q);
        lf_products(tape, 2 * half, half * (1 + q->wants + k->wants + val->wants));
    }
    lf_record(tape, "cross_attention", backward, t, 3, in, 2, out);
    return y;
}

/* ---- colours of the views, mixed ---------------------------------------------------------------
 */

static void blend_backward(const lf_node *node)
{
    const lf_tensor *w = node->in[0], *x = node->in[1];
    const long views = lf_cols(w), n = lf_cols(x), columns = lf_cols(node->out[0]);
    for (long r = 0; r < w->size; r++) {
        const lf_real *g = node->out[0]->grad + r / views * columns;
        for (long i = 0; i < columns; i++) {
            if (w->grad)
                w->grad[r] += g[i] * x->value[r * n + i];
            if (x->grad)
                x->grad[r * n + i] += w->value[r] * g[i];
        }
    }
}

lf_tensor *lf_blend_columns(lf_tape *tape, lf_tensor *weight, lf_tensor *x, long columns)
{
    const long views = lf_cols(weight), n = lf_cols(x);
    LF_REQUIRE(weight->rank == 3 && lf_rows(x) == weight->size && columns <= n,
               "lf_blend_columns: %ld weights for %ld rows, %ld of %ld columns", weight->size,
               lf_rows(x), columns, n);
    lf_tensor *y = lf_tensor_new(tape, 3, LF_DIMS(weight->dim[0], weight->dim[1], columns));
    memset(y->value, 0, (size_t)y->size * sizeof *y->value);
    for (long r = 0; r < weight->size; r++)
        for (long i = 0; i < columns; i++)
            y->value[r / views * columns + i] += weight->value[r] * x->value[r * n + i];
    lf_record(tape, "blend_views", blend_backward, NULL, LF_IN(weight, x), LF_OUT(y));
    return y;
}

lf_tensor *lf_blend_views(lf_tape *tape, lf_tensor *weight, lf_tensor *x)
{
    return lf_blend_columns(tape, weight, x, lf_cols(x));
}

/* ---- the layer --------------------------------------------------------------------------------
 */

static void update_init(lf_store *store, lf_view_update *u, const char *prefix,
                        const lf_types *types, long channels)
{
    char name[160];
    snprintf(name, sizeof name, "%s.from_view", prefix);
    lf_so2_map_init(store, &u->from_view, name, types, channels, 2 * channels, true);
    snprintf(name, sizeof name, "%s.from_point", prefix);
    lf_so2_map_init(store, &u->from_point, name, types, channels, 2 * channels, false);
    snprintf(name, sizeof name, "%s.gated", prefix);
    lf_so2_gated_init(store, &u->gated, name, types, 2 * channels);
    snprintf(name, sizeof name, "%s.out", prefix);
    lf_so2_map_init(store, &u->out, name, types, 2 * channels, channels, true);
}

/* [view; point] -> linear -> gated -> linear, the point's half of the first map once a point. */
static lf_tensor *update_apply(lf_tape *tape, const lf_view_update *u, const lf_types *types,
                               lf_tensor *view, lf_tensor *point)
{
    lf_tensor *v = lf_so2_map_apply(tape, &u->from_view, types, view);
    lf_tensor *q = lf_so2_map_apply(tape, &u->from_point, types, point);
    const long points = lf_rows(point), n = lf_cols(v), views = lf_rows(v) / points;
    v = lf_add_group(tape, lf_reshape(tape, v, 3, LF_DIMS(points, views, n)),
                     lf_reshape(tape, q, 2, LF_DIMS(points, n)));
    v = lf_so2_gated_apply(tape, &u->gated, types, v);
    return lf_so2_map_apply(tape, &u->out, types, v);
}

void lf_cross_attention_init(lf_store *store, lf_cross_attention_layer *layer, const char *prefix,
                             const lf_types *types, long in, long channels, long hidden, int heads)
{
    char name[128];
    layer->heads = heads;
    snprintf(name, sizeof name, "%s.query", prefix);
    lf_so2_map_init(store, &layer->query, name, types, channels, channels, true);
    static const char *const part[] = {"key", "value"};
    for (int i = 0; i < 2; i++) {
        snprintf(name, sizeof name, "%s.%s", prefix, part[i]);
        lf_ray_ray_convolution_init(store, &layer->kernel[i], name, types, in, channels, hidden);
        snprintf(name, sizeof name, "%s.%s_update", prefix, part[i]);
        update_init(store, &layer->update[i], name, types, channels);
    }
}

lf_attended lf_cross_attention_apply(lf_tape *tape, const lf_cross_attention_layer *layer,
                                     lf_tensor *f, lf_tensor *point, const lf_light_geometry *rays)
{
    lf_tensor *q = lf_so2_map_apply(tape, &layer->query, &rays->types, point), *kv[2];
    for (int i = 0; i < 2; i++) {
        kv[i] = lf_ray_ray_convolution_views(tape, &layer->kernel[i], f, rays);
        kv[i] = update_apply(tape, &layer->update[i], &rays->types, kv[i], q);
    }
    lf_attended y = lf_cross_attention(tape, q, kv[0], kv[1], rays, layer->heads);
    y.field = lf_add(tape, point, y.field);
    return y;
}
