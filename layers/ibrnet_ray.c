/* ibrnet_ray.c: attention between the samples of a ray; layer norm      [layers/ibrnet.h]
 *
 *   attention  a_ij = softmax_j <q_i, k_j> / sqrt(n), n numbers a head; 1 / S where fewer than two
 *              views see sample i;  y_i = sum_j a_ij v_j
 *     dv_j += a_ij dy_i,  da_ij = <dy_i, v_j>,  dl = a (da - sum_j a da) / sqrt(n) (0 where masked)
 *     dq_i += sum_j dl_ij k_j,  dk_j += dl_ij q_i
 *   norm       h = (x - mean) / sqrt(variance + 1e-6),  y = gain h + bias
 *     e = gain dy,  dx += (e - mean(e) - h mean(e h)) / sqrt(variance + 1e-6)
 *
 * Shapes      q, k, v, y [N, S, D], count [N, S], a [N, H, S, S']; S' is S in whole wide vectors:
 *             keys and values are turned to [D, S'], one ray at a time, keys beyond S have a = 0.
 * Keeps       a; h and the deviation's inverse.
 */
#include "layers/ibrnet.h"
#include "autograd/kernels/vector_math.h"

typedef struct attention {
    long rays, samples, wide, d; /* wide: S' */
    int heads;
    lf_real scale;
    const lf_real *count;
    lf_real *weight; /* [N, H, S, S'] */
} attention;

/* x [S, D] -> [D, S'], zeros behind. */
static void turn(const attention *t, const lf_real *x, lf_real *turned)
{
    memset(turned, 0, (size_t)(t->d * t->wide) * sizeof *turned);
    for (long j = 0; j < t->samples; j++)
        for (long c = 0; c < t->d; c++)
            turned[c * t->wide + j] = x[j * t->d + c];
}

static void turn_back(const attention *t, const lf_real *turned, lf_real *x)
{
    for (long j = 0; j < t->samples; j++)
        for (long c = 0; c < t->d; c++)
            x[j * t->d + c] += turned[c * t->wide + j];
}

LF_INLINE lf_vec at(const lf_real *x)
{
    return lf_vec_load(x);
}

LF_INLINE void put(lf_real *x, lf_vec v)
{
    lf_vec_store(x, v);
}

/* sum_c number[c] x[c, j] for LF_LANES keys from j on. */
LF_INLINE lf_vec mix(long n, const lf_real *number, const lf_real *x, long step)
{
    lf_vec sum = {0};
    for (long c = 0; c < n; c++)
        sum += number[c] * at(x + c * step);
    return sum;
}

/* Softmax of the first n of `wide` logits, in place; the rest become 0. */
static void softmax(long n, long wide, lf_real *a)
{
    lf_vec most = lf_vec_all(-INFINITY), sum = {0};
    for (long j = n; j < wide; j++)
        a[j] = -INFINITY;
    for (long j = 0; j < wide; j += LF_LANES)
        most = lf_vec_max(most, at(a + j));
    lf_real largest = most[0];
    for (int l = 1; l < LF_LANES; l++)
        largest = most[l] > largest ? most[l] : largest;
    for (long j = 0; j < wide; j += LF_LANES)
        put(a + j, lf_vec_exp(at(a + j) - largest));
    for (long j = n; j < wide; j++)
        a[j] = 0;
    for (long j = 0; j < wide; j += LF_LANES)
        sum += at(a + j);
    const lf_real share = 1 / lf_vec_total(sum); /* of >= 1: the largest term is exp(0) */
    for (long j = 0; j < wide; j += LF_LANES)
        put(a + j, at(a + j) * share);
}

/* Weights of query i: of one head. */
static void weigh(const attention *t, bool masked, const lf_real *q, const lf_real *k, lf_real *a)
{
    if (masked)
        memset(a, 0, (size_t)t->wide * sizeof *a);
    else
        for (long j = 0; j < t->wide; j += LF_LANES)
            put(a + j, mix(t->d / t->heads, q, k + j, t->wide) * t->scale);
    softmax(t->samples, t->wide, a);
}

static void forward_ray(const attention *t, long ray, lf_tensor *const *in, lf_real *y, lf_real *k,
                        lf_real *v)
{
    const long n = t->d / t->heads, first = ray * t->samples;
    turn(t, in[1]->value + first * t->d, k);
    turn(t, in[2]->value + first * t->d, v);
    for (int h = 0; h < t->heads; h++)
        for (long i = 0; i < t->samples; i++) {
            lf_real *a = t->weight + ((ray * t->heads + h) * t->samples + i) * t->wide;
            const long place = (first + i) * t->d + h * n;
            weigh(t, t->count[first + i] < LF_KEY_VIEWS, in[0]->value + place, k + h * n * t->wide,
                  a);
            for (long c = 0; c < n; c++) {
                lf_vec sum = {0};
                for (long j = 0; j < t->wide; j += LF_LANES)
                    sum += at(a + j) * at(v + (h * n + c) * t->wide + j);
                y[place + c] = lf_vec_total(sum);
            }
        }
}

/* One ray's keys, values and their gradients, [D, S'] each, and one row of weights' gradients. */
typedef struct turned {
    lf_real *k, *v, *dk, *dv, *da;
} turned;

/* da_j = <dy, v_j> less that of the largest weight (see heads.h); dv_j += a_j dy. The return: sum_j
 * a_j da_j. */
static lf_real values_back(const attention *t, long head, const lf_real *a, const lf_real *dy,
                           const turned *m)
{
    const long n = t->d / t->heads, from = head * n * t->wide;
    lf_vec pull = {0};
    for (long j = 0; j < t->wide; j += LF_LANES) {
        const lf_vec weight = at(a + j);
        put(m->da + j, mix(n, dy, m->v + from + j, t->wide));
        for (long c = 0; c < n; c++) {
            lf_real *dv = m->dv + from + c * t->wide + j;
            put(dv, at(dv) + weight * dy[c]);
        }
    }
    const lf_real most = lf_vec_of_largest(t->wide, a, m->da);
    for (long j = 0; j < t->wide; j += LF_LANES) {
        const lf_vec da = at(m->da + j) - most;
        pull += at(a + j) * da;
        put(m->da + j, da);
    }
    return lf_vec_total(pull);
}

/* dq += sum_j dl_j k_j, dk_j += dl_j q, dl = a (da - pull) scale. */
static void keys_back(const attention *t, long head, const lf_real *a, lf_real pull,
                      const lf_real *q, lf_real *dq, const turned *m)
{
    const long n = t->d / t->heads, from = head * n * t->wide;
    for (long j = 0; j < t->wide; j += LF_LANES)
        put(m->da + j, at(a + j) * (at(m->da + j) - pull) * t->scale);
    for (long c = 0; c < n; c++) {
        lf_vec sum = {0};
        for (long j = 0; j < t->wide; j += LF_LANES) {
            const long place = from + c * t->wide + j;
            const lf_vec dl = at(m->da + j);
            sum += dl * at(m->k + place);
            put(m->dk + place, at(m->dk + place) + dl * q[c]);
        }
        if (dq)
            dq[c] += lf_vec_total(sum);
    }
}

static void backward_ray(const attention *t, const lf_node *node, long ray, const turned *m)
{
    const lf_tensor *q = node->in[0], *k = node->in[1], *v = node->in[2];
    const long n = t->d / t->heads, first = ray * t->samples;
    turn(t, k->value + first * t->d, m->k);
    turn(t, v->value + first * t->d, m->v);
    memset(m->dk, 0, (size_t)(t->d * t->wide) * sizeof(lf_real));
    memset(m->dv, 0, (size_t)(t->d * t->wide) * sizeof(lf_real));
    for (int h = 0; h < t->heads; h++)
        for (long i = 0; i < t->samples; i++) {
            const lf_real *a = t->weight + ((ray * t->heads + h) * t->samples + i) * t->wide;
            const long place = (first + i) * t->d + h * n;
            const lf_real pull = values_back(t, h, a, node->out[0]->grad + place, m);
            if (t->count[first + i] >= LF_KEY_VIEWS)
                keys_back(t, h, a, pull, q->value + place, q->grad ? q->grad + place : NULL, m);
        }
    if (k->grad)
        turn_back(t, m->dk, k->grad + first * t->d);
    if (v->grad)
        turn_back(t, m->dv, v->grad + first * t->d);
}

static void attention_backward(const lf_node *node)
{
    const attention *t = node->saved;
    turned m;
    lf_real **const part[] = {&m.k, &m.v, &m.dk, &m.dv};
    for (int i = 0; i < 4; i++)
        *part[i] = lf_alloc_reals(node->tape, t->d * t->wide);
    m.da = lf_alloc_reals(node->tape, t->wide);
    for (long ray = 0; ray < t->rays; ray++)
        backward_ray(t, node, ray, &m);
}

/* Logits of the queries that are not masked, and all sums; back dv, and da, dq, dk of the former.
 */
static void count_products(lf_tape *tape, const attention *t, lf_tensor *const *in)
{
    double queries = 0;
    for (long i = 0; i < t->rays * t->samples; i++)
        queries += t->count[i] >= LF_KEY_VIEWS;
    const double one = (double)(t->samples * t->d), all = (double)(t->rays * t->samples);
    lf_products(tape, one * (queries + all),
                one * (all * in[2]->wants + queries * (1 + in[0]->wants + in[1]->wants)));
}

lf_tensor *lf_sample_attention(lf_tape *tape, lf_tensor *q, lf_tensor *k, lf_tensor *value,
                               const lf_tensor *count, int heads)
{
    const long d = lf_cols(q);
    LF_REQUIRE(q->rank == 3 && k->size == q->size && value->size == q->size && heads >= 1 &&
                   d % heads == 0 && q->size == count->size * d,
               "lf_sample_attention: q of %ld, k of %ld, values of %ld, %ld counts, %d heads",
               q->size, k->size, value->size, count->size, heads);
    attention *t = lf_alloc(tape, sizeof *t);
    *t = (attention){q->dim[0], q->dim[1], 0, d, heads, 0, count->value, NULL};
    t->wide = (t->samples + LF_LANES - 1) / LF_LANES * LF_LANES;
    t->scale = (lf_real)(1 / sqrt((double)d / heads));
    t->weight = lf_alloc_reals(tape, t->rays * heads * t->samples * t->wide);
    lf_tensor *y = lf_tensor_like(tape, q), *in[] = {q, k, value};
    const lf_mark mark = lf_tape_mark(tape);
    lf_real *turned_k = lf_alloc_reals(tape, d * t->wide);
    lf_real *turned_v = lf_alloc_reals(tape, d * t->wide);
    for (long ray = 0; ray < t->rays; ray++)
        forward_ray(t, ray, in, y->value, turned_k, turned_v);
    lf_tape_release(tape, mark);
    if (lf_profiled(tape))
        count_products(tape, t, in);
    lf_record(tape, "sample_attention", attention_backward, t, 3, in, LF_OUT(y));
    return y;
}

/* ---- layer norm --------------------------------------------------------------------------------
 */

#define NORM_EPSILON ((lf_real)1e-6)

typedef struct norm {
    lf_real *h, *inverse; /* [rows, n], [rows] */
} norm;

static void norm_row(long n, const lf_real *x, lf_real *h, lf_real *inverse)
{
    lf_real mean = 0, variance = 0;
    for (long i = 0; i < n; i++)
        mean += x[i] / (lf_real)n;
    for (long i = 0; i < n; i++)
        variance += (x[i] - mean) * (x[i] - mean) / (lf_real)n;
    *inverse = 1 / LF_SQRT(variance + NORM_EPSILON);
    for (long i = 0; i < n; i++)
        h[i] = (x[i] - mean) * *inverse;
}

static void norm_backward(const lf_node *node)
{
    const norm *t = node->saved;
    const lf_tensor *x = node->in[0], *gain = node->in[1], *bias = node->in[2];
    const long n = lf_cols(x);
    for (long r = 0; r < lf_rows(x); r++) {
        const lf_real *dy = node->out[0]->grad + r * n, *h = t->h + r * n;
        lf_real mean = 0, along = 0;
        for (long i = 0; i < n; i++) {
            mean += gain->value[i] * dy[i] / (lf_real)n;
            along += gain->value[i] * dy[i] * h[i] / (lf_real)n;
        }
        for (long i = 0; i < n; i++) {
            if (x->grad)
                x->grad[r * n + i] +=
                    t->inverse[r] * (gain->value[i] * dy[i] - mean - h[i] * along);
            if (gain->grad)
                gain->grad[i] += dy[i] * h[i];
            if (bias->grad)
                bias->grad[i] += dy[i];
        }
    }
}

lf_tensor *lf_layer_norm(lf_tape *tape, lf_tensor *x, lf_tensor *gain, lf_tensor *bias)
{
    const long n = lf_cols(x);
    LF_REQUIRE(n >= 1 && gain->size == n && bias->size == n,
               "lf_layer_norm: x [.., %ld], gain of %ld, bias of %ld", n, gain->size, bias->size);
    norm *t = lf_alloc(tape, sizeof *t);
    *t = (norm){lf_alloc_reals(tape, x->size), lf_alloc_reals(tape, lf_rows(x))};
    lf_tensor *y = lf_tensor_like(tape, x);
    for (long r = 0; r < lf_rows(x); r++) {
        norm_row(n, x->value + r * n, t->h + r * n, &t->inverse[r]);
        for (long i = 0; i < n; i++)
            y->value[r * n + i] = gain->value[i] * t->h[r * n + i] + bias->value[i];
    }
    lf_record(tape, "layer_norm", norm_backward, t, LF_IN(x, gain, bias), LF_OUT(y));
    return y;
}
