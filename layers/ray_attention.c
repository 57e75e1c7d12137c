/* ray_attention.c: multi-head attention of a point over its rays            [method.md 2.6, 4.6]
 *
 *   l_{v,h} = (sum_{c in h} q0_c k0_vc + sum_{a, c in h} q1_ac k1_vac) / sqrt(D)
 *   w = softmax over the views that see the point;  o0_c = sum_v w_{v,h(c)} v0_vc, o1 alike
 *   backward   dval_v = w_v do;  dw_{v,h} = <do, val_v>_h;
 *              dl = w (dw - sum_v w dw), made as in heads.h;
 *              dk_v = dl q / sqrt(D),  dq = sum_v dl_v k_v / sqrt(D)
 *
 * Shapes     q0 [Q, C0], q1 [Q, 3, C1], kv0 [Q, V, 2 C0], kv1 [Q, V, 3, 2 C1]; o0 [Q, C0],
 *            o1 [Q, 3, C1]. Heads split the channels of both types evenly.
 * Keeps      the weights [Q, V, H].
 * Degenerate no view: zeros. One view: weight 1, no gradient to q and k.
 *
 * Where the channels of each type fit a vector: attention_lanes.h. Else products are formed channel
 * by channel and summed per head afterwards, and weights are spread over the channels of their head
 * first, so that all inner loops run over contiguous channels.
 */
#include "layers/attention_lanes.h"
#include "layers/heads.h"

enum { CHANNELS = 512, HEADS = 32, VIEWS = LF_ATTENTION_VIEWS };

typedef struct attention {
    lf_ray_geometry rays;
    long c0, c1;
    int heads;
    lf_real scale;
    lf_real *weight; /* [Q, V, H] */
    bool in_lanes;   /* the channels of a type fit a vector */
    lf_lane_type type[2];
} attention;

/* sums[h] = sum of x over the channels of head h. */
static void sum_heads(int heads, long c, const lf_real *x, lf_real *sums)
{
    const long per = c / heads;
    for (int h = 0; h < heads; h++)
        for (long i = 0; i < per; i++)
            sums[h] += x[h * per + i];
}

/* Each head's number over its channels. */
static void spread_heads(int heads, long c, const lf_real *x, lf_real *out)
{
    const long per = c / heads;
    for (int h = 0; h < heads; h++)
        for (long i = 0; i < per; i++)
            out[h * per + i] = x[h];
}

/* Per head: <a0, b0> + <a1, b1>; a1 has rows of c1, b1 rows of 2 c1 (a half of keys and values). */
static void head_products(const attention *t, const lf_real *a0, const lf_real *a1,
                          const lf_real *b0, const lf_real *b1, lf_real *sums)
{
    lf_real p[CHANNELS];
    memset(sums, 0, (size_t)t->heads * sizeof *sums);
    for (long i = 0; i < t->c0; i++)
        p[i] = a0[i] * b0[i];
    sum_heads(t->heads, t->c0, p, sums);
    const long c = t->c1;
    if (!c)
        return;
    for (long i = 0; i < c; i++)
        p[i] = a1[i] * b1[i] + a1[c + i] * b1[2 * c + i] + a1[2 * c + i] * b1[4 * c + i];
    sum_heads(t->heads, c, p, sums);
}

/* y += x scaled per head; x and y have strides (components) xs and ys of their own. */
static void add_scaled(const lf_real *by, long c, int rows, const lf_real *x, long xs,
                       lf_real *restrict y, long ys)
{
    for (int a = 0; a < rows; a++)
        for (long i = 0; i < c; i++)
            y[a * ys + i] += by[i] * x[a * xs + i];
}

/* Weights of one point from its logits, in place: [V, H]. */
static void softmax_views(const attention *t, long q, lf_real *w)
{
    const lf_real *mask = t->rays.mask->value + q * t->rays.views;
    const int heads = t->heads;
    for (int h = 0; h < heads; h++) {
        lf_real largest = -INFINITY, sum = 0;
        for (long v = 0; v < t->rays.views; v++)
            if (mask[v] > 0 && w[v * heads + h] > largest)
                largest = w[v * heads + h];
        for (long v = 0; v < t->rays.views; v++) {
            lf_real *x = &w[v * heads + h];
            *x = mask[v] > 0 ? LF_EXP(*x - largest) : 0;
            sum += *x;
        }
        for (long v = 0; sum > 0 && v < t->rays.views; v++)
            w[v * heads + h] /= sum;
    }
}

/* ---- channels in lanes ------------------------------------------------------------------------
 */

/* Keys (half 0) or values (half 1) of view v of point q. */
LF_INLINE void load_ray(const attention *t, lf_tensor *const *in, long q, long v, int half,
                        lf_lane_value x[2])
{
    const long qv = q * t->rays.views + v;
    x[0] = lf_lane_load(&t->type[0], in[2]->value + (2 * qv + half) * t->c0, 0);
    if (t->c1)
        x[1] = lf_lane_load(&t->type[1], in[3]->value + 6 * qv * t->c1 + half * t->c1, 2 * t->c1);
}

LF_INLINE void load_point(const attention *t, const lf_real *x0, const lf_real *x1, long q,
                          lf_lane_value x[2])
{
    x[0] = lf_lane_load(&t->type[0], x0 + q * t->c0, 0);
    if (t->c1)
        x[1] = lf_lane_load(&t->type[1], x1 + 3 * q * t->c1, t->c1);
}

LF_INLINE lf_vec both_products(const attention *t, const lf_lane_value *a, const lf_lane_value *b)
{
    const lf_vec sum = lf_lane_products(&t->type[0], a, b);
    return t->c1 ? sum + lf_lane_products(&t->type[1], a + 1, b + 1) : sum;
}

static void forward_lanes(const attention *t, long q, lf_tensor *const *in, lf_real *o0,
                          lf_real *o1)
{
    const long views = t->rays.views;
    lf_lane_value query[2], ray[2], sum[2] = {{{{0}}}};
    lf_vec w[VIEWS];
    load_point(t, in[0]->value, t->c1 ? in[1]->value : NULL, q, query);
    for (long v = 0; v < views; v++) {
        load_ray(t, in, q, v, 0, ray);
        w[v] = t->scale * both_products(t, query, ray);
    }
    lf_lane_softmax(views, t->rays.mask->value + q * views, w);
    for (long v = 0; v < views; v++) {
        load_ray(t, in, q, v, 1, ray);
        lf_vec_store_part(t->weight + (q * views + v) * t->heads, t->heads, w[v]);
        for (int k = 0; k < 2; k++)
            lf_lane_sum(&t->type[k], w[v], &ray[k], &sum[k]);
    }
    lf_lane_store(&t->type[0], &sum[0], o0, 0);
    lf_lane_store(&t->type[1], &sum[1], o1, t->c1);
}

/* Gradients of one ray's keys and values, and its share of the query's. */
LF_INLINE void backward_lane_ray(const attention *t, lf_tensor *const *in, long q, long v,
                                 lf_vec dl, lf_vec w, const lf_lane_value *query,
                                 const lf_lane_value *g, lf_lane_value *dq)
{
    const long qv = q * t->rays.views + v, c0 = t->c0, c1 = t->c1;
    lf_lane_value key[2];
    load_ray(t, in, q, v, 0, key);
    for (int k = 0; k < 2; k++)
        lf_lane_sum(&t->type[k], dl, &key[k], &dq[k]);
    if (in[2]->grad) {
        lf_lane_add(&t->type[0], dl, &query[0], in[2]->grad + 2 * qv * c0, 0);
        lf_lane_add(&t->type[0], w, &g[0], in[2]->grad + 2 * qv * c0 + c0, 0);
    }
    if (c1 && in[3]->grad) {
        lf_lane_add(&t->type[1], dl, &query[1], in[3]->grad + 6 * qv * c1, 2 * c1);
        lf_lane_add(&t->type[1], w, &g[1], in[3]->grad + 6 * qv * c1 + c1, 2 * c1);
    }
}

static void backward_lanes(const attention *t, const lf_node *node, long q)
{
    const long views = t->rays.views;
    lf_tensor *const *in = node->in;
    lf_lane_value g[2], query[2], ray[2], dq[2] = {{{{0}}}};
    lf_vec w[VIEWS], dw[VIEWS];
    load_point(t, node->out[0]->grad, t->c1 ? node->out[1]->grad : NULL, q, g);
    load_point(t, in[0]->value, t->c1 ? in[1]->value : NULL, q, query);
    for (long v = 0; v < views; v++) {
        load_ray(t, in, q, v, 1, ray);
        w[v] = lf_vec_load_part(t->weight + (q * views + v) * t->heads, t->heads);
        dw[v] = both_products(t, g, ray);
    }
    lf_lane_softmax_backward(views, t->scale, w, dw);
    for (long v = 0; v < views; v++)
        if (t->rays.mask->value[q * views + v] > 0)
            backward_lane_ray(t, in, q, v, dw[v], w[v], query, g, dq);
    const lf_vec one = lf_vec_all(1);
    if (in[0]->grad)
        lf_lane_add(&t->type[0], one, &dq[0], in[0]->grad + q * t->c0, 0);
    if (t->c1 && in[1]->grad)
        lf_lane_add(&t->type[1], one, &dq[1], in[1]->grad + 3 * q * t->c1, t->c1);
}

/* ---- channels in arrays -----------------------------------------------------------------------
 */

static void forward_point(const attention *t, long q, lf_tensor *const *in, lf_real *o0,
                          lf_real *o1)
{
    const long views = t->rays.views, c0 = t->c0, c1 = t->c1;
    const lf_real *q0 = in[0]->value + q * c0, *q1 = c1 ? in[1]->value + 3 * q * c1 : NULL;
    const lf_real *kv0 = in[2]->value + 2 * q * views * c0;
    const lf_real *kv1 = c1 ? in[3]->value + 6 * q * views * c1 : NULL;
    lf_real *w = t->weight + q * views * t->heads, by[CHANNELS];
    for (long v = 0; v < views; v++) {
        head_products(t, q0, q1, kv0 + 2 * v * c0, kv1 + 6 * v * c1, w + v * t->heads);
        for (int h = 0; h < t->heads; h++)
            w[v * t->heads + h] *= t->scale;
    }
    softmax_views(t, q, w);
    memset(o0, 0, (size_t)c0 * sizeof *o0);
    if (c1)
        memset(o1, 0, (size_t)(3 * c1) * sizeof *o1);
    for (long v = 0; v < views; v++) {
        spread_heads(t->heads, c0, w + v * t->heads, by);
        add_scaled(by, c0, 1, kv0 + 2 * v * c0 + c0, 0, o0, 0);
        if (!c1)
            continue;
        spread_heads(t->heads, c1, w + v * t->heads, by);
        add_scaled(by, c1, 3, kv1 + 6 * v * c1 + c1, 2 * c1, o1, c1);
    }
}

/* Gradients of one (point, view) for queries, keys and values, given dl/dlogit per head. */
static void backward_ray(const attention *t, const lf_node *node, long q, long v,
                         const lf_real *dlogit)
{
    const long c0 = t->c0, c1 = t->c1, qv = q * t->rays.views + v;
    const lf_real *w = t->weight + qv * t->heads;
    lf_tensor *const *in = node->in;
    lf_real by[CHANNELS], weight[CHANNELS];
    spread_heads(t->heads, c0, dlogit, by);
    spread_heads(t->heads, c0, w, weight);
    if (in[0]->grad)
        add_scaled(by, c0, 1, in[2]->value + 2 * qv * c0, 0, in[0]->grad + q * c0, 0);
    if (in[2]->grad) {
        add_scaled(by, c0, 1, in[0]->value + q * c0, 0, in[2]->grad + 2 * qv * c0, 0);
        add_scaled(weight, c0, 1, node->out[0]->grad + q * c0, 0, in[2]->grad + 2 * qv * c0 + c0,
                   0);
    }
    if (!c1)
        return;
    spread_heads(t->heads, c1, dlogit, by);
    spread_heads(t->heads, c1, w, weight);
    if (in[1]->grad)
        add_scaled(by, c1, 3, in[3]->value + 6 * qv * c1, 2 * c1, in[1]->grad + 3 * q * c1, c1);
    if (in[3]->grad) {
        lf_real *dkv = in[3]->grad + 6 * qv * c1;
        add_scaled(by, c1, 3, in[1]->value + 3 * q * c1, c1, dkv, 2 * c1);
        add_scaled(weight, c1, 3, node->out[1]->grad + 3 * q * c1, c1, dkv + c1, 2 * c1);
    }
}

static void backward_point(const attention *t, const lf_node *node, long q)
{
    const long views = t->rays.views, c0 = t->c0, c1 = t->c1;
    const int heads = t->heads;
    const lf_real *g0 = node->out[0]->grad + q * c0;
    const lf_real *g1 = c1 ? node->out[1]->grad + 3 * q * c1 : NULL;
    const lf_real *w = t->weight + q * views * heads;
    lf_real dw[VIEWS * HEADS];
    for (long v = 0; v < views; v++) {
        const long qv = q * views + v;
        head_products(t, g0, g1, node->in[2]->value + 2 * qv * c0 + c0,
                      c1 ? node->in[3]->value + 6 * qv * c1 + c1 : NULL, dw + v * heads);
    }
    lf_head_softmax_backward(views, heads, t->scale, w, dw);
    for (long v = 0; v < views; v++)
        if (t->rays.mask->value[q * views + v] > 0)
            backward_ray(t, node, q, v, dw + v * heads);
}

static void backward(const lf_node *node)
{
    const attention *t = node->saved;
    for (long q = 0; q < t->rays.points; q++)
        if (t->in_lanes)
            backward_lanes(t, node, q);
        else
            backward_point(t, node, q);
}

static void require_shapes(const attention *t, lf_field q, lf_field kv)
{
    const long n = t->rays.points, rows = n * t->rays.views;
    LF_REQUIRE(t->heads >= 1 && t->heads <= HEADS && t->c0 % t->heads == 0 &&
                   t->c1 % t->heads == 0 && t->c0 <= CHANNELS && t->c1 <= CHANNELS,
               "lf_ray_attention: %d heads over %ld scalars and %ld vectors", t->heads, t->c0,
               t->c1);
    LF_REQUIRE(t->rays.views <= VIEWS, "lf_ray_attention: %ld views", t->rays.views);
    LF_REQUIRE(q.scalar->size == n * t->c0 && kv.scalar->size == rows * 2 * t->c0,
               "lf_ray_attention: q0 of %ld, kv0 of %ld", q.scalar->size, kv.scalar->size);
    LF_REQUIRE(!t->c1 || (q.vector->size == 3 * n * t->c1 && kv.vector->size == 6 * rows * t->c1),
               "lf_ray_attention: vectors of another shape than %ld x %ld", n, t->c1);
}

/* A ray and a half of its keys and values: logits and sum forward; back dw, dq, dk and dval. */
static void count_products(lf_tape *tape, const attention *t, lf_field q, lf_field kv)
{
    const double seen = lf_present(t->rays.points * t->rays.views, t->rays.mask->value);
    const double half = seen * (double)(t->c0 + 3 * t->c1);
    lf_products(tape, 2 * half, half * (1 + q.scalar->wants + 2 * kv.scalar->wants));
}

lf_field lf_ray_attention(lf_tape *tape, lf_field q, lf_field kv, const lf_ray_geometry *rays,
                          int heads)
{
    attention *t = lf_alloc(tape, sizeof *t);
    *t = (attention){.rays = *rays,
                     .c0 = lf_cols(q.scalar),
                     .c1 = q.vector ? lf_cols(q.vector) : 0,
                     .heads = heads};
    require_shapes(t, q, kv);
    t->in_lanes = lf_lanes_fit(t->c0, heads) && lf_lanes_fit(t->c1, heads);
    t->type[0] = lf_lane_type_make((int)t->c0, 1, heads);
    t->type[1] = lf_lane_type_make((int)t->c1, 3, heads);
    t->scale = (lf_real)(1 / sqrt((double)(t->c0 + 3 * t->c1) / heads));
    t->weight = lf_alloc_reals(tape, rays->points * rays->views * heads);
    lf_tensor *in[] = {q.scalar, q.vector, kv.scalar, kv.vector};
    lf_field o = {lf_tensor_new(tape, 2, LF_DIMS(rays->points, t->c0)), NULL};
    if (t->c1)
        o.vector = lf_tensor_new(tape, 3, LF_DIMS(rays->points, 3, t->c1));
    for (long p = 0; p < rays->points; p++)
        (t->in_lanes ? forward_lanes : forward_point)(
            t, p, in, o.scalar->value + p * t->c0, t->c1 ? o.vector->value + 3 * p * t->c1 : NULL);
    lf_tensor *out[] = {o.scalar, o.vector};
    if (lf_profiled(tape))
        count_products(tape, t, q, kv);
    lf_record(tape, "ray_attention", backward, t, 4, in, t->c1 ? 2 : 1, out);
    return o;
}
