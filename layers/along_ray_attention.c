/* along_ray_attention.c: attention between the points of one ray              [method.md 2.8, 5b.5]
 *
 *   D = depth_j - depth_i,  phi_b(D) = exp(-(D - m_b)^2 / 2 s^2), m_b from -1 to 1, s their spacing
 *   c(D) = 1 + sum_b w_b phi_b(D), complex per type and channel
 *   l_ij = <q_i, c_k(D) k_j>_h / sqrt(P C / H),  a = softmax_j over the keys,
 *   y_i = sum_j a_ij c_v(D) v_j
 *
 * A Gaussian of a difference is a product, t = depth / s from the middle of the ray, m = m_b / s:
 *
 *   phi_b(D) = G_ij E_jb F_ib,  G = exp(-(t_j - t_i)^2 / 2),  E = exp(t_j m - m^2 / 4),
 *                               F = exp(-t_i m - m^2 / 4)
 *
 * and a profile's weights do not depend on j. So all sums over pairs are matrix products, with 16
 * columns a number, of a ray's queries and keys:
 *
 *   l_ij = (G_ij sum_b <F q_i conj(w_b), E k_j>_h + <q_i, k_j>_h) / sqrt(P C / H)     "products"
 *   y_i = sum_b w_b F z_ib + sum_j a_ij v_j,  z_ib = sum_j (a G)_ij E v_j      "collect", "join"
 *   backward, g = dy_i:
 *     da_ij = G_ij sum_b <F g conj(w_b), E v_j>_h + <g, v_j>_h                          products
 *     dv_j = sum_b E sum_i (a G)_ij F g_i conj(w_b) + sum_i a_ij g_i                    "expand"
 *     dw_b += g conj(F z_ib),  dl = a (da - sum_j a da) / sqrt(P C / H)
 *     dk_j: expand of dl and q;  dq_i: collect and join of dl and k;  dw_b likewise
 *
 * with <x, y> = Re x conj(y) summed over the numbers of a head; a complex number stands for the
 * pair of its parts and the pair of their gradients.
 *
 * Shapes       q, k, v, y [N, S, P C] or blocks [B, 1, P C, W], w [16, P C] for keys and values;
 *              depth [N, S] in [0, 1]: a ray's depths are at most 1.5 apart.
 * Keeps        the weights a and z.
 * Masked       samples seen by less than two views are no keys: weight 0, no gradient.
 * Degenerate   a ray without keys gives zeros.
 */
#include "layers/along_ray_kernels.h"
#include "layers/heads.h"

/* ---- a ray's work ------------------------------------------------------------------------------
 */

static profiles make_profile(lf_tape *tape, const along *t, const lf_real *weight)
{
    profiles p = {lf_alloc_reals(tape, t->n * BASIS), lf_alloc_reals(tape, t->n * BASIS)};
    for (long i = 0; i < t->n; i++)
        for (int b = 0; b < BASIS; b++) {
            p.w[t->place[i] * BASIS + b] = weight[b * t->n + i];
            p.dw[t->place[i] * BASIS + b] = 0;
        }
    return p;
}

static work make_work(lf_tape *tape, const along *t, lf_tensor *const *in)
{
    const long keys = t->keys, field = t->n * keys, pairs = t->rays.samples * keys;
    const long wide = keys * t->size * BASIS;
    work w = {.k = make_profile(tape, t, in[3]->value),
              .v = make_profile(tape, t, in[4]->value),
              .mask = lf_alloc_reals(tape, keys),
              .coarse = lf_alloc_reals(tape, keys),
              .rest = lf_alloc_reals(tape, keys),
              .near = lf_alloc_reals(tape, pairs),
              .of_key = lf_alloc_reals(tape, keys * BASIS),
              .of_query = lf_alloc_reals(tape, keys * BASIS),
              .of_keys = lf_alloc_reals(tape, keys * BASIS),
              .q = lf_alloc_reals(tape, field),
              .kk = lf_alloc_reals(tape, field),
              .vv = lf_alloc_reals(tape, field),
              .g = lf_alloc_reals(tape, field),
              .dq = lf_alloc_reals(tape, field),
              .dk = lf_alloc_reals(tape, field),
              .dv = lf_alloc_reals(tape, field),
              .number = lf_alloc_reals(tape, pairs),
              .pair = lf_alloc_reals(tape, pairs),
              .wide = lf_alloc_reals(tape, wide),
              .rows = lf_alloc_reals(tape, wide),
              .turned = lf_alloc_reals(tape, wide),
              .sum = lf_alloc_reals(tape, wide)};
    memset(w.number, 0, (size_t)pairs * sizeof *w.number); /* behind the samples: finite */
    return w;
}

/* `count` adjacent samples of number i from point p on. */
typedef struct run {
    long at, step, count;
} run;

/* Samples j.. of a ray whose first point is `first`, as many as stand side by side. */
static run run_at(const along *t, long first, long i, long j)
{
    const long p = first + j, left = t->rays.samples - j;
    if (!t->blocks)
        return (run){p * t->n + i, t->n, left};
    return (run){(p / W * t->n + i) * W + p % W, 1, left < W - p % W ? left : W - p % W};
}

/* A field's numbers at the ray's samples -> x [n, keys]; zeros behind, and, with a mask, where it
 * is 0. */
static void load_field(const along *t, long first, const lf_real *field, const lf_real *mask,
                       lf_real *x)
{
    memset(x, 0, (size_t)(t->n * t->keys) * sizeof *x);
    for (long i = 0; i < t->n; i++) {
        lf_real *to = x + t->place[i] * t->keys;
        for (long j = 0; j < t->rays.samples;) {
            const run r = run_at(t, first, i, j);
            for (long l = 0; l < r.count; l++)
                to[j + l] = field[r.at + l * r.step];
            j += r.count;
        }
        for (long j = 0; mask && j < t->keys; j += LF_LANES)
            lf_vec_store(
                to + j, lf_vec_select(lf_vec_load(mask + j) > 0, lf_vec_load(to + j), (lf_vec){0}));
    }
}

/* field += or, without `add`, = x; NULL: nothing. */
static void store_field(const along *t, long first, const lf_real *x, bool add, lf_real *field)
{
    for (long i = 0; field && i < t->n; i++) {
        const lf_real *from = x + t->place[i] * t->keys;
        for (long j = 0; j < t->rays.samples;) {
            const run r = run_at(t, first, i, j);
            for (long l = 0; l < r.count; l++) {
                lf_real *to = field + r.at + l * r.step;
                *to = from[j + l] + (add ? *to : 0);
            }
            j += r.count;
        }
    }
}

/* Places of a ray's samples, and what hangs on them. */
static void load_places(const along *t, const work *w, long first)
{
    const lf_real *depth = t->rays.depth->value + first, *count = t->rays.count->value + first;
    const double per = 0.5 * (BASIS - 1);
    double nearest = (double)depth[0], farthest = nearest, fade[BASIS];
    for (long j = 1; j < t->rays.samples; j++) {
        nearest = (double)depth[j] < nearest ? (double)depth[j] : nearest;
        farthest = (double)depth[j] > farthest ? (double)depth[j] : farthest;
    }
    LF_REQUIRE(!(farthest - nearest > 1.5),
               "lf_along_ray_attention: depths from %g to %g, not 0 to 1", nearest, farthest);
    for (int b = 0; b < BASIS; b++)
        fade[b] = exp(-0.25 * (b - per) * (b - per));
    memset(w->of_key, 0, (size_t)(t->keys * BASIS) * sizeof *w->of_key);
    for (long j = 0; j < t->keys; j++) {
        const bool sample = j < t->rays.samples;
        const double at = sample ? per * ((double)depth[j] - 0.5 * (nearest + farthest)) : 0;
        w->mask[j] = sample && count[j] >= LF_KEY_VIEWS;
        w->coarse[j] = (lf_real)(rint(at * 256) / 256);
        w->rest[j] = (lf_real)(at - rint(at * 256) / 256);
        if (sample)
            load_factors(w, j, at, fade);
    }
    turn_factors(t, w);
    load_near(t, w);
}

static void load_ray(const along *t, const work *w, long first, lf_tensor *const *in)
{
    load_places(t, w, first);
    load_field(t, first, in[0]->value, NULL, w->q);
    load_field(t, first, in[1]->value, w->mask, w->kk);
    load_field(t, first, in[2]->value, w->mask, w->vv);
}

/* ---- forward -----------------------------------------------------------------------------------
 */

/* A query's logits [keys] to weights, over the keys of the ray. */
LF_INLINE void softmax_keys(const long keys, lf_real scale, const lf_real *mask, lf_real *a)
{
    const lf_vec none = {0}, least = lf_vec_all(-INFINITY);
    const lf_vec_bits lane = LF_VEC_COUNT;
    lf_vec largest = least, sum = none;
    for (long j = 0; j < keys; j += LF_LANES)
        largest = lf_vec_max(
            largest, lf_vec_select(lf_vec_load(mask + j) > 0, scale * lf_vec_load(a + j), least));
    for (int h = LF_LANES / 2; h > 0; h /= 2)
        largest = lf_vec_max(largest, __builtin_shuffle(largest, lane ^ h));
    for (long j = 0; j < keys; j += LF_LANES) {
        const lf_vec e = lf_vec_exp(scale * lf_vec_load(a + j) - largest);
        const lf_vec kept = lf_vec_select(lf_vec_load(mask + j) > 0, e, none);
        lf_vec_store(a + j, kept);
        sum += kept;
    }
    const lf_real total = lf_vec_total(sum);
    for (long j = 0; total > 0 && j < keys; j += LF_LANES)
        lf_vec_store(a + j, lf_vec_load(a + j) / total);
}

/* Of all queries. */
static void softmax(const along *t, const work *w, lf_real *a)
{
    const long samples = t->rays.samples, vectors = t->keys / LF_LANES;
    for (long i = 0; i < samples; i++)
        if (vectors == 2)
            softmax_keys(2 * LF_LANES, t->scale, w->mask, a + i * 2 * LF_LANES);
        else if (vectors == 3)
            softmax_keys(3 * LF_LANES, t->scale, w->mask, a + i * 3 * LF_LANES);
        else
            softmax_keys(t->keys, t->scale, w->mask, a + i * t->keys);
}

static lf_real *weights_of(const along *t, long first, int head)
{
    return t->weight + (first * t->heads + head * t->rays.samples) * t->keys;
}

static lf_real *z_of(const along *t, long first, int head)
{
    return t->z + (first * t->heads + head * t->rays.samples) * t->size * BASIS;
}

static void forward_head(const along *t, const work *w, long first, int head)
{
    const long at = head * t->size * t->keys, profile = head * t->size * BASIS;
    lf_real *a = weights_of(t, first, head), *z = z_of(t, first, head);
    load_turned(t, w, w->q + at, w->k.w + profile);
    load_wide(t, w, w->kk + at);
    products(t, w, w->q + at, w->kk + at, a);
    softmax(t, w, a);
    load_pair(t, w, a);
    load_rows(t, w, w->vv + at);
    collect(t, w, z);
    join(t, w, a, w->vv + at, w->v.w + profile, z, w->dq + at);
}

/* ---- backward ----------------------------------------------------------------------------------
 */

/* A query's da becomes dl; the largest weight's da is taken off first: see heads.h. */
static void softmax_backward(const along *t, const lf_real *a, lf_real *d)
{
    lf_vec pull = {0};
    const lf_real most = lf_vec_of_largest(t->keys, a, d);
    for (long j = 0; j < t->keys; j += LF_LANES)
        pull += lf_vec_load(a + j) * (lf_vec_load(d + j) - most);
    const lf_real sum = lf_vec_total(pull);
    for (long j = 0; j < t->keys; j += LF_LANES)
        lf_vec_store(d + j, t->scale * lf_vec_load(a + j) * (lf_vec_load(d + j) - most - sum));
}

static void backward_head(const along *t, const work *w, long first, int head)
{
    const long at = head * t->size * t->keys, profile = head * t->size * BASIS;
    const lf_real *a = weights_of(t, first, head);
    load_turned(t, w, w->g + at, w->v.w + profile);
    load_wide(t, w, w->vv + at);
    products(t, w, w->g + at, w->vv + at, w->number);
    add_profile(t, w, w->g + at, z_of(t, first, head), w->v.dw + profile);
    load_pair(t, w, a);
    expand(t, w, a, w->g + at, w->dv + at);
    for (long i = 0; i < t->rays.samples; i++)
        softmax_backward(t, a + i * t->keys, w->number + i * t->keys);
    load_turned(t, w, w->q + at, w->k.w + profile);
    load_pair(t, w, w->number);
    expand(t, w, w->number, w->q + at, w->dk + at);
    load_rows(t, w, w->kk + at);
    collect(t, w, w->sum);
    add_profile(t, w, w->q + at, w->sum, w->k.dw + profile);
    join(t, w, w->number, w->kk + at, w->k.w + profile, w->sum, w->dq + at);
}

static void store_profile(const along *t, const profiles *p, lf_real *grad)
{
    for (int b = 0; grad && b < BASIS; b++)
        for (long i = 0; i < t->n; i++)
            grad[b * t->n + i] += p->dw[t->place[i] * BASIS + b];
}

static void backward(const lf_node *node)
{
    const along *t = node->saved;
    const long samples = t->rays.samples;
    lf_tensor *const *in = node->in;
    const work w = make_work(node->tape, t, in);
    for (long first = 0; first < t->rays.rays * samples; first += samples) {
        load_ray(t, &w, first, in);
        load_field(t, first, node->out[0]->grad, NULL, w.g);
        for (int h = 0; h < t->heads; h++)
            backward_head(t, &w, first, h);
        store_field(t, first, w.dq, true, in[0]->grad);
        store_field(t, first, w.dk, true, in[1]->grad);
        store_field(t, first, w.dv, true, in[2]->grad);
    }
    store_profile(t, &w.k, in[3]->grad);
    store_profile(t, &w.v, in[4]->grad);
}

/* ---- the op ------------------------------------------------------------------------------------
 */

static void require_shapes(const along *t, lf_tensor *const *in)
{
    const long points = t->rays.rays * t->rays.samples;
    const long size = (t->blocks ? (points + W - 1) / W * W : points) * t->n;
    LF_REQUIRE(t->heads >= 1 && t->c >= 1 && t->c <= LF_HEAD_CHANNELS && t->c % t->heads == 0,
               "lf_along_ray_attention: %d heads over %ld channels", t->heads, t->c);
    for (int k = 0; k < 3; k++)
        LF_REQUIRE(in[k]->size == size && (t->blocks ? in[k]->dim[2] : lf_cols(in[k])) == t->n,
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
    const double scalars = (double)(t->scalars * t->c), others = (double)t->n - scalars;
    const double products = pairs * (4 * scalars + 6 * others);
    lf_products(tape, products, 2 * products);
}

/* Fields in rows, or `blocks`. */
static lf_tensor *attend(lf_tape *tape, lf_tensor *const *in, const lf_light_geometry *rays,
                         int heads, bool blocks)
{
    const long planes = lf_types_planes(&rays->types), points = rays->rays * rays->samples;
    const long n = blocks ? in[0]->dim[2] : lf_cols(in[0]), c = n / planes;
    along *t = lf_alloc(tape, sizeof *t);
    *t = (along){.rays = *rays,
                 .blocks = blocks,
                 .planes = planes,
                 .c = c,
                 .n = planes * c,
                 .scalars = lf_types_scalars(&rays->types),
                 .heads = heads};
    require_shapes(t, in);
    t->per = c / heads;
    t->size = planes * t->per;
    t->keys = (rays->samples + LF_LANES - 1) / LF_LANES * LF_LANES;
    t->scale = (lf_real)(1 / sqrt((double)t->n / heads));
    t->place = make_places(tape, t);
    t->weight = lf_alloc_reals(tape, points * heads * t->keys);
    t->z = lf_alloc_reals(tape, points * t->n * BASIS);
    lf_tensor *y = lf_tensor_like(tape, in[0]);
    const long last = blocks ? t->n * W : 0; /* the last block's points behind the last one */
    memset(y->value + y->size - last, 0, (size_t)last * sizeof *y->value);
    const lf_mark mark = lf_tape_mark(tape);
    const work w = make_work(tape, t, in);
    for (long first = 0; first < points; first += rays->samples) {
        load_ray(t, &w, first, in);
        for (int h = 0; h < heads; h++)
            forward_head(t, &w, first, h);
        store_field(t, first, w.dq, false, y->value);
    }
    lf_tape_release(tape, mark);
    if (lf_profiled(tape))
        count_products(tape, t);
    lf_record(tape, "along_ray_attention", backward, t, 5, in, 1, &y);
    return y;
}

lf_tensor *lf_along_ray_attention(lf_tape *tape, lf_tensor *q, lf_tensor *k, lf_tensor *v,
                                  lf_tensor *key_profile, lf_tensor *value_profile,
                                  const lf_light_geometry *rays, int heads)
{
    return attend(tape, (lf_tensor *[]){q, k, v, key_profile, value_profile}, rays, heads, false);
}

lf_tensor *lf_blocks_along_attention(lf_tape *tape, const lf_blocks *blocks, lf_tensor *q,
                                     lf_tensor *k, lf_tensor *v, lf_tensor *key_profile,
                                     lf_tensor *value_profile, int heads)
{
    return attend(tape, (lf_tensor *[]){q, k, v, key_profile, value_profile}, blocks->rays, heads,
                  true);
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
