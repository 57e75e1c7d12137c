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
 * Keeps        the weights a, the keys in blocks; profiles are computed again.
 * Masked       samples seen by less than two views are no keys: weight 0, no gradient.
 * Degenerate   a ray without keys gives zeros.
 * Channels are few, so keys run side by side: a vector holds one number of each key of a block.
 */
#include "layers/heads.h"
#include "layers/light_field.h"

/* One number of LANES keys side by side. */
typedef lf_real lanes __attribute__((vector_size(64), may_alias));
enum { LANES = 64 / sizeof(lf_real), BASIS = LF_ALONG_BASIS };

typedef struct along {
    lf_light_geometry rays;
    long planes, c, n; /* n = planes c */
    int heads;
    lf_real scale;
    lf_real *weight;     /* [N, S, blocks, H, LANES] */
    unsigned char *head; /* [n]: of each number of a row */
} along;

/* Working memory: of one ray, keys and values as lanes; of one block of keys the rest. */
typedef struct work {
    lanes *k, *v;           /* [blocks, n] */
    lanes *dk, *dv;         /* [blocks, n] */
    lanes *dkw, *dvw;       /* [BASIS, n], over all rays */
    lanes *profile, *u, *g; /* [n] */
    lanes *sum;             /* [n]: of a query */
    lanes *dl;              /* [blocks, H] */
} work;

static long blocks_of(const along *t)
{
    return (t->rays.samples + LANES - 1) / LANES;
}

static work make_work(lf_tape *tape, const along *t, bool backward)
{
    const long n = t->n, blocks = blocks_of(t), all = blocks * n;
    const long size =
        2 * all + 4 * n + (backward ? 2 * all + 2 * BASIS * n + blocks * t->heads : 0);
    lanes *x = lf_alloc(tape, (size_t)size * sizeof *x);
    memset(x, 0, (size_t)size * sizeof *x);
    work w = {.k = x, .v = x + all, .profile = x + 2 * all};
    w.u = w.profile + n;
    w.g = w.u + n;
    w.sum = w.g + n;
    if (!backward)
        return w;
    w.dk = w.sum + n;
    w.dv = w.dk + all;
    w.dkw = w.dv + all;
    w.dvw = w.dkw + BASIS * n;
    w.dl = w.dvw + BASIS * n;
    return w;
}

static bool is_key(const along *t, long sample)
{
    return t->rays.count->value[sample] >= LF_KEY_VIEWS;
}

/* Rows [samples, n] of the ray that starts at sample `first` to lanes [blocks, n]; no key: 0. */
static void gather(const along *t, long first, const lf_real *x, lanes *restrict out)
{
    for (long j = 0; j < t->rays.samples; j++) {
        const bool key = is_key(t, first + j);
        const lf_real *row = x + (first + j) * t->n;
        for (long i = 0; i < t->n; i++)
            ((lf_real *)&out[j / LANES * t->n + i])[j % LANES] = key ? row[i] : 0;
    }
}

static void scatter_add(const along *t, const lanes *x, lf_real *restrict out)
{
    for (long j = 0; j < t->rays.samples; j++)
        for (long i = 0; i < t->n; i++)
            out[j * t->n + i] += ((const lf_real *)&x[j / LANES * t->n + i])[j % LANES];
}

static lf_real sum_of(const lanes *x)
{
    lf_real sum = 0;
    for (int l = 0; l < LANES; l++)
        sum += (*x)[l];
    return sum;
}

/* phi_b for one distance in units of the spacing, from centre 0 on: from the nearest centre
 * outwards by phi_{b+1} = phi_b e^{x - b - 1/2}; what is below 1e-30 is 0. */
static void gaussians(lf_real at, long lane, lanes phi[BASIS])
{
    const lf_real rounded = at < 0 ? 0 : at > BASIS - 1 ? BASIS - 1 : at + (lf_real)0.5;
    const int near = (int)rounded;
    const lf_real x = at - (lf_real)near, shrink = (lf_real)0.36787944117144233;
    if (!(x * x < 100))
        return;
    const lf_real middle = LF_EXP(-x * x / 2);
    phi[near][lane] = middle;
    for (int side = -1; side <= 1; side += 2) {
        lf_real value = middle, ratio = LF_EXP((lf_real)side * x - (lf_real)0.5);
        for (int b = near + side; b >= 0 && b < BASIS && value > (lf_real)1e-30; b += side) {
            value *= ratio;
            ratio *= shrink;
            phi[b][lane] = value;
        }
    }
}

/* phi_b of the sample i (counted over all rays) and a block of keys; 0 for keys past the last. */
static void basis(const along *t, long i, long block, lanes phi[BASIS])
{
    const lf_real spacing = (lf_real)2 / (BASIS - 1), *depth = t->rays.depth->value;
    const long samples = t->rays.samples, first = i / samples * samples;
    memset(phi, 0, BASIS * sizeof *phi);
    for (long l = 0; l < LANES && block * LANES + l < samples; l++)
        gaussians((depth[first + block * LANES + l] - depth[i] + 1) / spacing, l, phi);
}

/* c = 1 + sum_b w_b phi_b: real part 1, imaginary part 0 where all w are 0. */
static void make_profile(const along *t, const lanes phi[BASIS], const lf_real *w,
                         lanes *restrict c)
{
    const lanes none = {0};
    for (long i = 0; i < t->n; i++) {
        const long p = i / t->c;
        lanes sum = none + (lf_real)(p == 0 || p % 2);
        for (int b = 0; b < BASIS; b++)
            sum += w[b * t->n + i] * phi[b];
        c[i] = sum;
    }
}

/* out = a b per channel; scalars are real. */
static void product(const along *t, const lanes *a, const lanes *b, lanes *restrict out)
{
    const long c = t->c;
    for (long i = 0; i < c; i++)
        out[i] = a[i] * b[i];
    for (long first = c; first < t->n; first += 2 * c)
        for (long re = first, im = first + c; re < first + c; re++, im++) {
            out[re] = a[re] * b[re] - a[im] * b[im];
            out[im] = a[re] * b[im] + a[im] * b[re];
        }
}

/* out += conj(a) b */
static void add_conjugate_product(const along *t, const lanes *a, const lanes *b,
                                  lanes *restrict out)
{
    const long c = t->c;
    for (long i = 0; i < c; i++)
        out[i] += a[i] * b[i];
    for (long first = c; first < t->n; first += 2 * c)
        for (long re = first, im = first + c; re < first + c; re++, im++) {
            out[re] += a[re] * b[re] + a[im] * b[im];
            out[im] += a[re] * b[im] - a[im] * b[re];
        }
}

/* sums[h] = <x, u> per key and head, x the same for all keys. */
static void head_products(const along *t, const lf_real *x, const lanes *u, lanes *restrict sums)
{
    memset(sums, 0, (size_t)t->heads * sizeof *sums);
    for (long i = 0; i < t->n; i++)
        sums[t->head[i]] += x[i] * u[i];
}

/* Logits [blocks, H] of one query to weights, over the keys of its ray. */
static void softmax_keys(const along *t, long first, lanes *a)
{
    const int heads = t->heads;
    for (int h = 0; h < heads; h++) {
        lf_real largest = -INFINITY, sum = 0;
        for (long j = 0; j < t->rays.samples; j++)
            if (is_key(t, first + j) && a[j / LANES * heads + h][j % LANES] > largest)
                largest = a[j / LANES * heads + h][j % LANES];
        for (long j = 0; j < t->rays.samples; j++) {
            lf_real *x = (lf_real *)&a[j / LANES * heads + h] + j % LANES;
            *x = is_key(t, first + j) ? LF_EXP(*x - largest) : 0;
            sum += *x;
        }
        for (long k = 0; sum > 0 && k < blocks_of(t); k++)
            a[k * heads + h] /= sum;
    }
}

static lanes *weights_of(const along *t, long i)
{
    return (lanes *)t->weight + i * blocks_of(t) * t->heads;
}

/* in: q, k, v, key profile, value profile. */
static void forward_point(const along *t, const work *w, long i, lf_tensor *const *in, lf_real *y)
{
    const long blocks = blocks_of(t), n = t->n;
    lanes *a = weights_of(t, i), phi[BASIS];
    for (long k = 0; k < blocks; k++) {
        basis(t, i, k, phi);
        make_profile(t, phi, in[3]->value, w->profile);
        product(t, w->profile, w->k + k * n, w->u);
        head_products(t, in[0]->value + i * n, w->u, a + k * t->heads);
        for (int h = 0; h < t->heads; h++)
            a[k * t->heads + h] *= t->scale;
    }
    softmax_keys(t, i / t->rays.samples * t->rays.samples, a);
    memset(w->sum, 0, (size_t)n * sizeof *w->sum);
    for (long k = 0; k < blocks; k++) {
        basis(t, i, k, phi);
        make_profile(t, phi, in[4]->value, w->profile);
        product(t, w->profile, w->v + k * n, w->u);
        for (long p = 0; p < n; p++)
            w->sum[p] += a[k * t->heads + t->head[p]] * w->u[p];
    }
    for (long p = 0; p < n; p++)
        y[p] = sum_of(&w->sum[p]);
}

/* Adjoint of u = c(D) x for one query and block, given the gradient g of u. */
static void kernel_backward(const along *t, const work *w, const lanes phi[BASIS], const lanes *x,
                            lanes *dx, lanes *restrict dw)
{
    add_conjugate_product(t, w->profile, w->g, dx);
    memset(w->u, 0, (size_t)t->n * sizeof *w->u);
    add_conjugate_product(t, x, w->g, w->u);
    for (int b = 0; b < BASIS; b++)
        for (long i = 0; i < t->n; i++)
            dw[b * t->n + i] += phi[b] * w->u[i];
}

/* g = numbers per key and head times a row that all keys share. */
static void spread(const along *t, const lanes *number, const lf_real *x, lanes *restrict g)
{
    for (long p = 0; p < t->n; p++)
        g[p] = number[t->head[p]] * x[p];
}

static void backward_point(const along *t, const work *w, const lf_node *node, long i)
{
    const long blocks = blocks_of(t), n = t->n;
    const int heads = t->heads;
    const lanes *a = weights_of(t, i);
    const lf_real *q = node->in[0]->value + i * n, *dy = node->out[0]->grad + i * n;
    lanes phi[BASIS];
    lf_real pull[LF_HEAD_CHANNELS] = {0};
    for (long k = 0; k < blocks; k++) {
        basis(t, i, k, phi);
        make_profile(t, phi, node->in[4]->value, w->profile);
        product(t, w->profile, w->v + k * n, w->u);
        head_products(t, dy, w->u, w->dl + k * heads);
        for (int h = 0; h < heads; h++) {
            const lanes share = a[k * heads + h] * w->dl[k * heads + h];
            pull[h] += sum_of(&share);
        }
        spread(t, a + k * heads, dy, w->g);
        kernel_backward(t, w, phi, w->v + k * n, w->dv + k * n, w->dvw);
    }
    memset(w->sum, 0, (size_t)n * sizeof *w->sum);
    for (long k = 0; k < blocks; k++) {
        lanes *dl = w->dl + k * heads;
        for (int h = 0; h < heads; h++)
            dl[h] = t->scale * a[k * heads + h] * (dl[h] - pull[h]);
        basis(t, i, k, phi);
        make_profile(t, phi, node->in[3]->value, w->profile);
        product(t, w->profile, w->k + k * n, w->u);
        for (long p = 0; p < n; p++)
            w->sum[p] += dl[t->head[p]] * w->u[p];
        spread(t, dl, q, w->g);
        kernel_backward(t, w, phi, w->k + k * n, w->dk + k * n, w->dkw);
    }
    for (long p = 0; node->in[0]->grad && p < n; p++)
        node->in[0]->grad[i * n + p] += sum_of(&w->sum[p]);
}

static void backward(const lf_node *node)
{
    const along *t = node->saved;
    const long samples = t->rays.samples, n = t->n, all = blocks_of(t) * n;
    const work w = make_work(node->tape, t, true);
    lf_tensor *const *in = node->in;
    for (long r = 0; r < t->rays.rays; r++) {
        gather(t, r * samples, in[1]->value, w.k);
        gather(t, r * samples, in[2]->value, w.v);
        memset(w.dk, 0, (size_t)(2 * all) * sizeof *w.dk); /* and dv */
        for (long i = r * samples; i < (r + 1) * samples; i++)
            backward_point(t, &w, node, i);
        if (in[1]->grad)
            scatter_add(t, w.dk, in[1]->grad + r * samples * n);
        if (in[2]->grad)
            scatter_add(t, w.dv, in[2]->grad + r * samples * n);
    }
    for (long p = 0; p < BASIS * n; p++) {
        if (in[3]->grad)
            in[3]->grad[p] += sum_of(&w.dkw[p]);
        if (in[4]->grad)
            in[4]->grad[p] += sum_of(&w.dvw[p]);
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
    *t = (along){*rays, planes, c, planes * c, heads, 0, NULL, NULL};
    lf_tensor *in[] = {q, k, v, key_profile, value_profile};
    require_shapes(t, in);
    t->scale = (lf_real)(1 / sqrt((double)t->n / heads));
    t->head = lf_alloc(tape, (size_t)t->n);
    for (long i = 0; i < t->n; i++)
        t->head[i] = (unsigned char)(i % c * heads / c);
    t->weight = lf_alloc_reals(tape, points * blocks_of(t) * LANES * heads);
    lf_tensor *y = lf_tensor_like(tape, q);
    const lf_mark mark = lf_tape_mark(tape);
    const work w = make_work(tape, t, false);
    for (long i = 0; i < points; i++) {
        if (i % rays->samples == 0) {
            gather(t, i, k->value, w.k);
            gather(t, i, v->value, w.v);
        }
        forward_point(t, &w, i, in, y->value + i * t->n);
    }
    lf_tape_release(tape, mark);
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
