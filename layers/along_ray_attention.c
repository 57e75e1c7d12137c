/* along_ray_attention.c: attention between the points of one ray              [method.md 2.8, 5b.5]
 *
 *   D = depth_j - depth_i,  phi_b(D) = exp(-(D - m_b)^2 / 2 s^2), m_b from -1 to 1, s their spacing
 *   c(D) = 1 + sum_b w_b phi_b(D), complex per type and channel: u_ij = c_k(D) k_j, t_ij = c_v(D)
 * v_j l_{ij,h} = <q_i, u_ij>_h / sqrt(P C / H),  a = softmax_j over the keys,  y_i = sum_j a_ij
 * t_ij backward   dt = a dy_i,  da_h = <dy_i, t>_h,  dl = a (da - sum_j a da) / sqrt(P C / H) dq_i
 * += dl u,  du = dl q_i;  for both kernels, from dt or du as g: d(k or v)_j += conj(c) g,  dc = g
 * conj(k or v),  dw_b += phi_b dc
 *
 * Shapes       q, k, v, y [N, S, P C], w [16, P C] for keys and values; depth [N, S] in [0, 1].
 * Keeps        the weights a [N, S, S, H]; profiles are computed again.
 * Masked       samples seen by less than two views are no keys: weight 0, no gradient.
 * Degenerate   a ray without keys gives zeros.
 */
#include "layers/heads.h"
#include "layers/light_field.h"

enum { BASIS = LF_ALONG_BASIS, ROW = LF_PLANES_MAX * LF_HEAD_CHANNELS };

typedef struct along {
    lf_light_geometry rays;
    long planes, c, n; /* n = planes c */
    int heads;
    lf_real scale;
    lf_real *weight; /* [N, S, S, H] */
} along;

static void basis(lf_real distance, lf_real phi[BASIS])
{
    const lf_real spacing = (lf_real)2 / (BASIS - 1);
    for (int b = 0; b < BASIS; b++) {
        const lf_real x = (distance + 1) / spacing - (lf_real)b;
        phi[b] = x * x < 160 ? LF_EXP(-x * x / 2) : 0; /* no denormal numbers */
    }
}

/* c = 1 + sum_b w_b phi_b: real part 1, imaginary part 0 where all w are 0. */
static void profile(const along *t, const lf_real phi[BASIS], const lf_real *w, lf_real *restrict c)
{
    for (long p = 0; p < t->planes; p++)
        for (long i = 0; i < t->c; i++)
            c[p * t->c + i] = p == 0 || p % 2;
    for (int b = 0; b < BASIS; b++)
        for (long i = 0; i < t->n; i++)
            c[i] += phi[b] * w[b * t->n + i];
}

/* out = a b per channel; scalars are real. */
static void product(const along *t, const lf_real *a, const lf_real *b, lf_real *restrict out)
{
    const long c = t->c;
    for (long i = 0; i < c; i++)
        out[i] = a[i] * b[i];
    for (long re = c, im = 2 * c; re < t->n; re += 2 * c, im += 2 * c)
        for (long i = 0; i < c; i++) {
            out[re + i] = a[re + i] * b[re + i] - a[im + i] * b[im + i];
            out[im + i] = a[re + i] * b[im + i] + a[im + i] * b[re + i];
        }
}

/* out += conj(a) b */
static void add_conjugate_product(const along *t, const lf_real *a, const lf_real *b,
                                  lf_real *restrict out)
{
    const long c = t->c;
    for (long i = 0; i < c; i++)
        out[i] += a[i] * b[i];
    for (long re = c, im = 2 * c; re < t->n; re += 2 * c, im += 2 * c)
        for (long i = 0; i < c; i++) {
            out[re + i] += a[re + i] * b[re + i] + a[im + i] * b[im + i];
            out[im + i] += a[re + i] * b[im + i] - a[im + i] * b[re + i];
        }
}

static bool is_key(const along *t, long sample)
{
    return t->rays.count->value[sample] >= LF_KEY_VIEWS;
}

/* The distance kernel's basis of the samples i and j (counted over all rays). */
static void pair_basis(const along *t, long i, long j, lf_real phi[BASIS])
{
    basis(t->rays.depth->value[j] - t->rays.depth->value[i], phi);
}

/* Logits in place to weights, [S, H], over the keys of one ray. */
static void softmax_keys(const along *t, long first, lf_real *a)
{
    const int heads = t->heads;
    for (int h = 0; h < heads; h++) {
        lf_real largest = -INFINITY, sum = 0;
        for (long j = 0; j < t->rays.samples; j++)
            if (is_key(t, first + j) && a[j * heads + h] > largest)
                largest = a[j * heads + h];
        for (long j = 0; j < t->rays.samples; j++) {
            lf_real *x = &a[j * heads + h];
            *x = is_key(t, first + j) ? LF_EXP(*x - largest) : 0;
            sum += *x;
        }
        for (long j = 0; sum > 0 && j < t->rays.samples; j++)
            a[j * heads + h] /= sum;
    }
}

/* in: q, k, v, key profile, value profile. */
static void forward_point(const along *t, long i, lf_tensor *const *in, lf_real *y)
{
    const long samples = t->rays.samples, first = i / samples * samples, n = t->n;
    lf_real *a = t->weight + i * samples * t->heads, phi[BASIS], c[ROW], u[ROW];
    memset(a, 0, (size_t)(samples * t->heads) * sizeof *a);
    memset(y, 0, (size_t)n * sizeof *y);
    for (long j = 0; j < samples; j++) {
        if (!is_key(t, first + j))
            continue;
        pair_basis(t, i, first + j, phi);
        profile(t, phi, in[3]->value, c);
        product(t, c, in[1]->value + (first + j) * n, u);
        lf_head_products(t->planes, t->c, t->heads, in[0]->value + i * n, u, a + j * t->heads);
        for (int h = 0; h < t->heads; h++)
            a[j * t->heads + h] *= t->scale;
    }
    softmax_keys(t, first, a);
    for (long j = 0; j < samples; j++) {
        if (!is_key(t, first + j))
            continue;
        pair_basis(t, i, first + j, phi);
        profile(t, phi, in[4]->value, c);
        product(t, c, in[2]->value + (first + j) * n, u);
        lf_head_add(t->planes, t->c, t->heads, a + j * t->heads, u, y);
    }
}

/* Adjoint of u = c(D) x for one pair, given the gradient g of u per row. */
static void kernel_backward(const along *t, const lf_real phi[BASIS], const lf_real *c,
                            const lf_real *x, const lf_real *g, lf_real *dx, lf_real *dw)
{
    lf_real dc[ROW];
    if (dx)
        add_conjugate_product(t, c, g, dx);
    if (!dw)
        return;
    memset(dc, 0, (size_t)t->n * sizeof *dc);
    add_conjugate_product(t, x, g, dc);
    for (int b = 0; b < BASIS; b++)
        for (long i = 0; i < t->n; i++)
            dw[b * t->n + i] += phi[b] * dc[i];
}

/* Values of the pair (i, j): dl [H] becomes da, and the values and their profile get gradients. */
static void value_backward(const along *t, const lf_node *node, long i, long j, const lf_real *a,
                           lf_real *da)
{
    const lf_tensor *v = node->in[2], *w = node->in[4];
    const lf_real *dy = node->out[0]->grad + i * t->n, *x = v->value + j * t->n;
    lf_real phi[BASIS], c[ROW], u[ROW], g[ROW];
    pair_basis(t, i, j, phi);
    profile(t, phi, w->value, c);
    product(t, c, x, u);
    lf_head_products(t->planes, t->c, t->heads, dy, u, da);
    memset(g, 0, (size_t)t->n * sizeof *g);
    lf_head_add(t->planes, t->c, t->heads, a, dy, g);
    kernel_backward(t, phi, c, x, g, v->grad ? v->grad + j * t->n : NULL, w->grad);
}

/* Query and key of the pair (i, j), given dl [H]. */
static void key_backward(const along *t, const lf_node *node, long i, long j, const lf_real *dl)
{
    const lf_tensor *q = node->in[0], *k = node->in[1], *w = node->in[3];
    const lf_real *x = k->value + j * t->n;
    lf_real phi[BASIS], c[ROW], u[ROW], g[ROW];
    pair_basis(t, i, j, phi);
    profile(t, phi, w->value, c);
    if (q->grad) {
        product(t, c, x, u);
        lf_head_add(t->planes, t->c, t->heads, dl, u, q->grad + i * t->n);
    }
    memset(g, 0, (size_t)t->n * sizeof *g);
    lf_head_add(t->planes, t->c, t->heads, dl, q->value + i * t->n, g);
    kernel_backward(t, phi, c, x, g, k->grad ? k->grad + j * t->n : NULL, w->grad);
}

static void backward(const lf_node *node)
{
    const along *t = node->saved;
    const long samples = t->rays.samples;
    const int heads = t->heads;
    lf_real *dl = lf_alloc_reals(node->tape, samples * heads);
    for (long i = 0; i < t->rays.rays * samples; i++) {
        const long first = i / samples * samples;
        const lf_real *a = t->weight + i * samples * heads;
        lf_real pull[LF_HEAD_CHANNELS] = {0};
        for (long j = 0; j < samples; j++) {
            if (!is_key(t, first + j))
                continue;
            value_backward(t, node, i, first + j, a + j * heads, dl + j * heads);
            for (int h = 0; h < heads; h++)
                pull[h] += a[j * heads + h] * dl[j * heads + h];
        }
        for (long j = 0; j < samples; j++) {
            if (!is_key(t, first + j))
                continue;
            for (int h = 0; h < heads; h++)
                dl[j * heads + h] = t->scale * a[j * heads + h] * (dl[j * heads + h] - pull[h]);
            key_backward(t, node, i, first + j, dl + j * heads);
        }
    }
}

static void require_shapes(const along *t, lf_tensor *const *in)
{
    const long size = t->rays.rays * t->rays.samples * t->n;
    LF_REQUIRE(t->heads >= 1 && t->c >= 1 && t->c <= LF_HEAD_CHANNELS && t->c % t->heads == 0,
               "lf_along_ray_attention: %d heads over %ld channels", t->heads, t->c);
    for (int k = 0; k < 3; k++)
        LF_REQUIRE(in[k]->size == size && lf_cols(in[k]) == t->n,
                   "lf_along_ray_attention: input %d of %ld, not %ld", k, in[k]->size, size);
    for (int k = 3; k < 5; k++)
        LF_REQUIRE(in[k]->size == BASIS * t->n,
                   "lf_along_ray_attention: a profile of %ld, not %d x %ld", in[k]->size, BASIS,
                   t->n);
}

lf_tensor *lf_along_ray_attention(lf_tape *tape, lf_tensor *q, lf_tensor *k, lf_tensor *v,
                                  lf_tensor *key_profile, lf_tensor *value_profile,
                                  const lf_light_geometry *rays, int heads)
{
    const long planes = lf_types_planes(&rays->types), c = lf_cols(q) / planes;
    const long points = rays->rays * rays->samples;
    along *t = lf_alloc(tape, sizeof *t);
    *t = (along){*rays, planes, c, planes * c, heads, 0, NULL};
    lf_tensor *in[] = {q, k, v, key_profile, value_profile};
    require_shapes(t, in);
    t->scale = (lf_real)(1 / sqrt((double)t->n / heads));
    t->weight = lf_alloc_reals(tape, points * rays->samples * heads);
    lf_tensor *y = lf_tensor_like(tape, q);
    for (long i = 0; i < points; i++)
        forward_point(t, i, in, y->value + i * t->n);
    lf_record(tape, "along_ray_attention", backward, t, 5, in, 1, &y);
    return y;
}

/* ---- the layer --------------------------------------------------------------------------------
 */

void lf_along_ray_init(lf_store *store, lf_along_ray_layer *layer, const char *prefix,
                       const lf_types *types, long channels, long out, int heads)
{
    static const char *const map[] = {"query", "key", "value"};
    static const char *const kernel[] = {"key_profile", "value_profile"};
    char name[160];
    layer->heads = heads;
    lf_so2_map *const maps[] = {&layer->query, &layer->key, &layer->value};
    for (int i = 0; i < 3; i++) {
        snprintf(name, sizeof name, "%s.%s", prefix, map[i]);
        lf_so2_map_init(store, maps[i], name, types, channels, channels, false);
    }
    const long n = lf_types_planes(types) * channels;
    for (int i = 0; i < 2; i++) {
        snprintf(name, sizeof name, "%s.%s", prefix, kernel[i]);
        layer->profile[i] = lf_store_add(store, name, 2, LF_DIMS(BASIS, n), 0, 0.1, true);
    }
    snprintf(name, sizeof name, "%s.join", prefix);
    lf_so2_map_init(store, &layer->join, name, types, channels, out, true);
}

lf_tensor *lf_along_ray_apply(lf_tape *tape, const lf_along_ray_layer *layer, lf_tensor *x,
                              const lf_light_geometry *rays)
{
    const lf_types *types = &rays->types;
    lf_tensor *y = lf_along_ray_attention(tape, lf_so2_map_apply(tape, &layer->query, types, x),
                                          lf_so2_map_apply(tape, &layer->key, types, x),
                                          lf_so2_map_apply(tape, &layer->value, types, x),
                                          lf_param(tape, layer->profile[0]),
                                          lf_param(tape, layer->profile[1]), rays, layer->heads);
    return lf_so2_map_apply(tape, &layer->join, types, y);
}
