/* along_ray_attention.c: attention between the points of one ray              [method.md 2.8, 5b.5]
 *
 *   D = depth_j - depth_i,  phi_b(D) = exp(-(D - m_b)^2 / 2 s^2), m_b from -1 to 1, s their spacing
 *   c(D) = 1 + sum_b w_b phi_b(D), complex per type and channel;  phi_16 = 1 with w_16 = 1
 *   l_ij = <q_i, c_k(D) k_j>_h / sqrt(P C / H),  a = softmax_j over the keys,
 *   y_i = sum_j a_ij c_v(D) v_j
 *
 * A profile's weights do not depend on j, so no pair ever has a profile of its own:
 *
 *   l_ij = sum_b phi_b <q_i conj(w_b), k_j>_h / sqrt(P C / H)                     "products"
 *   y_i = sum_b w_b z_ib,  z_ib = sum_j a_ij phi_b(D) v_j                         "collect"
 *   backward, g = dy_i:
 *     da_ij = sum_b phi_b <g conj(w_b), v_j>_h                                    products
 *     dv_j += a_ij sum_b phi_b g conj(w_b)                                        "expand"
 *     dw_b += g conj(z_ib),  dl = a (da - sum_j a da) / sqrt(P C / H)
 *     dk_j += dl_ij sum_b phi_b q_i conj(w_b)                                     expand
 *     r_ib = sum_j dl_ij phi_b k_j,  dq_i = sum_b w_b r_ib,  dw_b += q_i conj(r_ib)
 *
 * with <x, y> = Re x conj(y) summed over the numbers of a head; a complex number stands for the
 * pair of its parts and the pair of their gradients.
 *
 * Shapes       q, k, v, y [N, S, P C], w [16, P C] for keys and values; depth [N, S] in [0, 1].
 * Keeps        the weights a and z.
 * Masked       samples seen by less than two views are no keys: weight 0, no gradient.
 * Degenerate   a ray without keys gives zeros.
 */
#include "layers/along_ray_kernels.h"
#include "layers/heads.h"

static keys make_keys(lf_tape *tape, const along *t, const lf_real *profile)
{
    keys k = {.row = lf_alloc_reals(tape, t->blocks * W * t->n),
              .wide = lf_alloc_reals(tape, t->blocks * t->n * W),
              .grad = lf_alloc_reals(tape, t->blocks * t->n * W),
              .profile = lf_alloc_reals(tape, t->n * BASIS),
              .dprofile = lf_alloc_reals(tape, t->n * BASIS)};
    for (long i = 0; i < t->n; i++)
        for (int b = 0; b < BASIS; b++) {
            k.profile[t->place[i] * BASIS + b] = profile[b * t->n + i];
            k.dprofile[t->place[i] * BASIS + b] = 0;
        }
    return k;
}

static work make_work(lf_tape *tape, const along *t, lf_tensor *const *in)
{
    const long all = t->blocks * W, larger = TERMS > t->size ? TERMS : t->size;
    work w = {.k = make_keys(tape, t, in[3]->value),
              .v = make_keys(tape, t, in[4]->value),
              .mask = lf_alloc_reals(tape, all),
              .depth = lf_alloc_reals(tape, all),
              .phi = lf_alloc_reals(tape, all * TERMS),
              .phi_row = lf_alloc_reals(tape, all * BASIS),
              .pairs = lf_alloc_reals(tape, all * BASIS),
              .matrix = lf_alloc_reals(tape, t->n * ROW),
              .x = lf_alloc_reals(tape, t->n),
              .number = lf_alloc_reals(tape, all * t->heads),
              .r = lf_alloc_reals(tape, t->n * BASIS),
              .buffer = lf_alloc_reals(tape, t->blocks * larger * W)};
    return w;
}

/* Rows of the ray whose first sample is `first`; what is no key becomes 0. */
static void load_keys(const along *t, const work *w, long first, const lf_real *x, keys *k)
{
    memset(k->row, 0, (size_t)(t->blocks * W * t->n) * sizeof *k->row);
    memset(k->wide, 0, (size_t)(t->blocks * W * t->n) * sizeof *k->wide);
    memset(k->grad, 0, (size_t)(t->blocks * W * t->n) * sizeof *k->grad);
    for (long j = 0; j < t->rays.samples; j++)
        for (long i = 0; w->mask[j] > 0 && i < t->n; i++) {
            const lf_real value = x[(first + j) * t->n + i];
            const long at = t->place[i];
            k->row[j * t->n + at] = value;
            k->wide[(j / W * t->n + at) * W + j % W] = value;
        }
}

static void load_ray(const along *t, work *w, long first, lf_tensor *const *in)
{
    for (long j = 0; j < t->blocks * W; j++) {
        const bool sample = j < t->rays.samples;
        w->mask[j] = sample && t->rays.count->value[first + j] >= LF_KEY_VIEWS;
        w->depth[j] = sample ? t->rays.depth->value[first + j] : 0;
    }
    load_keys(t, w, first, in[1]->value, &w->k);
    load_keys(t, w, first, in[2]->value, &w->v);
}

/* Logits [blocks, W] of one head to weights, over the keys of the ray. */
static void softmax_keys(const along *t, const work *w, lf_real *a)
{
    const lf_vec none = {0};
    lf_real largest = -INFINITY, sum = 0;
    for (long j = 0; j < t->rays.samples; j++)
        if (w->mask[j] > 0 && a[j] * t->scale > largest)
            largest = a[j] * t->scale;
    for (long j = 0; j < t->blocks * W; j += LF_LANES) {
        const lf_vec e = lf_vec_select(lf_vec_load(w->mask + j) > 0,
                                       lf_vec_exp(t->scale * lf_vec_load(a + j) - largest), none);
        lf_vec_store(a + j, e);
        sum += lf_vec_total(e);
    }
    for (long j = 0; sum > 0 && j < t->blocks * W; j++)
        a[j] /= sum;
}

static void load_row(const along *t, const lf_real *row, lf_real *x)
{
    for (long i = 0; i < t->n; i++)
        x[t->place[i]] = row[i];
}

static lf_real *weights_of(const along *t, long i)
{
    return t->weight + i * t->heads * t->blocks * W;
}

static void forward_point(const along *t, const work *w, long i, lf_tensor *const *in, lf_real *y)
{
    lf_real *a = weights_of(t, i), *z = t->z + i * t->n * BASIS;
    load_gaussians(t, w, t->rays.depth->value[i]);
    load_row(t, in[0]->value + i * t->n, w->x);
    load_matrix(t, w, w->x, w->k.profile);
    products(t, w, w->k.wide, a);
    for (int h = 0; h < t->heads; h++)
        softmax_keys(t, w, a + h * t->blocks * W);
    collect(t, w, a, &w->v, z);
    join(t, a, &w->v, z, w->x);
    for (long j = 0; j < t->n; j++)
        y[j] = w->x[t->place[j]];
}

/* da in w->number becomes dl; the largest weight's da is taken off first: see heads.h. */
static void softmax_backward(const along *t, const work *w, const lf_real *a)
{
    const long all = t->blocks * W;
    for (int h = 0; h < t->heads; h++) {
        const lf_real *of_head = a + h * all;
        lf_real *d = w->number + h * all;
        lf_vec pull = {0};
        const lf_real most = lf_vec_of_largest(all, of_head, d);
        for (long j = 0; j < all; j += LF_LANES)
            pull += lf_vec_load(of_head + j) * (lf_vec_load(d + j) - most);
        const lf_real sum = lf_vec_total(pull);
        for (long j = 0; j < all; j += LF_LANES)
            lf_vec_store(d + j,
                         t->scale * lf_vec_load(of_head + j) * (lf_vec_load(d + j) - most - sum));
    }
}

static void backward_point(const along *t, const work *w, const lf_node *node, long i)
{
    const lf_real *a = weights_of(t, i);
    load_gaussians(t, w, t->rays.depth->value[i]);
    load_row(t, node->out[0]->grad + i * t->n, w->x);
    load_matrix(t, w, w->x, w->v.profile);
    products(t, w, w->v.wide, w->number);
    expand(t, w, a, w->v.grad);
    add_profile(t, w->x, t->z + i * t->n * BASIS, w->v.dprofile);
    softmax_backward(t, w, a);
    load_row(t, node->in[0]->value + i * t->n, w->x);
    load_matrix(t, w, w->x, w->k.profile);
    expand(t, w, w->number, w->k.grad);
    collect(t, w, w->number, &w->k, w->r);
    add_profile(t, w->x, w->r, w->k.dprofile);
    join(t, w->number, &w->k, w->r, w->x);
    for (long j = 0; node->in[0]->grad && j < t->n; j++)
        node->in[0]->grad[i * t->n + j] += w->x[t->place[j]];
}

/* Gradients of one ray's keys or values to their rows: samples that are no keys get none. */
static void store_keys(const along *t, const work *w, long first, const keys *k, lf_real *grad)
{
    for (long j = 0; grad && j < t->rays.samples; j++)
        for (long i = 0; w->mask[j] > 0 && i < t->n; i++)
            grad[(first + j) * t->n + i] += k->grad[(j / W * t->n + t->place[i]) * W + j % W];
}

static void store_profile(const along *t, const keys *k, lf_real *grad)
{
    for (int b = 0; grad && b < BASIS; b++)
        for (long i = 0; i < t->n; i++)
            grad[b * t->n + i] += k->dprofile[t->place[i] * BASIS + b];
}

static void backward(const lf_node *node)
{
    const along *t = node->saved;
    const long samples = t->rays.samples;
    lf_tensor *const *in = node->in;
    work w = make_work(node->tape, t, in);
    for (long first = 0; first < t->rays.rays * samples; first += samples) {
        load_ray(t, &w, first, in);
        for (long i = first; i < first + samples; i++)
            backward_point(t, &w, node, i);
        store_keys(t, &w, first, &w.k, in[1]->grad);
        store_keys(t, &w, first, &w.v, in[2]->grad);
    }
    store_profile(t, &w.k, in[3]->grad);
    store_profile(t, &w.v, in[4]->grad);
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

/* Where the numbers of a row [P, C] stand in the order of heads [H, P, C / H]. */
static const long *make_places(lf_tape *tape, const along *t)
{
    long *place = lf_alloc(tape, (size_t)t->n * sizeof *place);
    for (long i = 0; i < t->n; i++) {
        const long plane = i / t->c, channel = i % t->c;
        place[i] = channel / t->per * t->size + plane * t->per + channel % t->per;
    }
    return place;
}

/* Between a sample and a key, as the formulas at the top first say it: c_k k, its product with q,
 * c_v v and its sum, 6 a number; not the profile c of their distance. Back 12: dw and the gradients
 * of both factors of every product. */
static void count_products(lf_tape *tape, const along *t)
{
    const long samples = t->rays.samples;
    double pairs = 0;
    for (long i = 0; i < t->rays.rays * samples; i++)
        pairs += t->rays.count->value[i] >= LF_KEY_VIEWS ? (double)samples : 0;
    lf_products(tape, 6 * pairs * (double)t->n, 12 * pairs * (double)t->n);
}

/* Numbers of a head are [P, C / H]: plane 0 scalars, then real and imaginary parts by turns. */
static const pair_number *make_pairs(lf_tape *tape, const along *t)
{
    pair_number *pair = lf_alloc(tape, (size_t)t->n * sizeof *pair);
    for (long j = 0; j < t->n; j++) {
        const long plane = j % t->size / t->per;
        pair[j] = plane == 0  ? (pair_number){j, j, j, 0}
                  : plane % 2 ? (pair_number){j, j + t->per, j + t->per, 1}
                              : (pair_number){j - t->per, j, j - t->per, -1};
    }
    return pair;
}

lf_tensor *lf_along_ray_attention(lf_tape *tape, lf_tensor *q, lf_tensor *k, lf_tensor *v,
                                  lf_tensor *key_profile, lf_tensor *value_profile,
                                  const lf_light_geometry *rays, int heads)
{
    const long planes = lf_types_planes(&rays->types), c = lf_cols(q) / planes;
    const long points = rays->rays * rays->samples;
    along *t = lf_alloc(tape, sizeof *t);
    *t = (along){.rays = *rays, .planes = planes, .c = c, .n = planes * c, .heads = heads};
    lf_tensor *in[] = {q, k, v, key_profile, value_profile};
    require_shapes(t, in);
    t->per = c / heads;
    t->size = planes * t->per;
    t->scale = (lf_real)(1 / sqrt((double)t->n / heads));
    t->blocks = (rays->samples + W - 1) / W;
    t->place = make_places(tape, t);
    t->pair = make_pairs(tape, t);
    t->weight = lf_alloc_reals(tape, points * heads * t->blocks * W);
    t->z = lf_alloc_reals(tape, points * t->n * BASIS);
    lf_tensor *y = lf_tensor_like(tape, q);
    const lf_mark mark = lf_tape_mark(tape);
    work w = make_work(tape, t, in);
    for (long i = 0; i < points; i++) {
        if (i % rays->samples == 0)
            load_ray(t, &w, i, in);
        forward_point(t, &w, i, in, y->value + i * t->n);
    }
    lf_tape_release(tape, mark);
    if (lf_profiled(tape))
        count_products(tape, t);
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
