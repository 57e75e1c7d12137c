/* vector_neuron.c: vector-neuron LeakyReLU, inner products, the readout      [method.md 2.9, 5a.6]
 *
 *   u = p                                   where s = <p, k> >= 0
 *   u = p - b s / m k,  m = |k|^2 + e       elsewhere; b = 0.8
 *   dp += du - b <du, k> / m k
 *   dk += -b (<du,k> / m p + s / m du - 2 s <du,k> / m^2 k)
 *
 * Shapes   p, k, u [.., 3, C]; per channel.
 * Degenerate  k = 0 gives u = p.
 */
#include "layers/layers.h"

static const lf_real keep = (lf_real)0.8, epsilon = (lf_real)1e-6;

/* One channel of a row of 3 x c numbers: components c apart. */
static lf_real dot3(const lf_real *a, const lf_real *b, long c)
{
    return a[0] * b[0] + a[c] * b[c] + a[2 * c] * b[2 * c];
}

static void relu_backward(const lf_node *node)
{
    lf_tensor *p = node->in[0], *k = node->in[1];
    const long c = lf_cols(p);
    for (long r = 0; r < lf_rows(p) / 3; r++)
        for (long i = 0; i < c; i++) {
            const long at = 3 * r * c + i;
            const lf_real *pv = p->value + at, *kv = k->value + at;
            const lf_real *du = node->out[0]->grad + at;
            const lf_real s = dot3(pv, kv, c), m = dot3(kv, kv, c) + epsilon;
            const lf_real b = s < 0 ? keep : 0, g = dot3(du, kv, c);
            for (int a = 0; a < 3; a++) {
                const long j = a * c;
                if (p->grad)
                    p->grad[at + j] += du[j] - b * g / m * kv[j];
                if (k->grad)
                    k->grad[at + j] -=
                        b * (g / m * pv[j] + s / m * du[j] - 2 * s * g / (m * m) * kv[j]);
            }
        }
}

lf_tensor *lf_vector_relu(lf_tape *tape, lf_tensor *p, lf_tensor *k)
{
    LF_REQUIRE(p->size == k->size && p->rank >= 2 && p->dim[p->rank - 2] == 3,
               "lf_vector_relu: p of %ld, k of %ld", p->size, k->size);
    lf_tensor *u = lf_tensor_like(tape, p);
    const long c = lf_cols(p);
    for (long r = 0; r < lf_rows(p) / 3; r++)
        for (long i = 0; i < c; i++) {
            const long at = 3 * r * c + i;
            const lf_real *pv = p->value + at, *kv = k->value + at;
            const lf_real s = dot3(pv, kv, c), m = dot3(kv, kv, c) + epsilon;
            const lf_real f = s >= 0 ? 0 : keep * s / m; /* NaN stays NaN */
            for (int a = 0; a < 3; a++)
                u->value[at + a * c] = pv[a * c] - f * kv[a * c];
        }
    lf_record(tape, "vector_relu", relu_backward, NULL, LF_IN(p, k), LF_OUT(u));
    return u;
}

static void inner_backward(const lf_node *node)
{
    const lf_real *dy = node->out[0]->grad;
    const long c = lf_cols(node->in[0]), rows = lf_rows(node->out[0]);
    for (int side = 0; side < 2; side++) {
        lf_tensor *x = node->in[side];
        const lf_real *other = node->in[1 - side]->value;
        for (long r = 0; x->grad && r < 3 * rows; r++)
            for (long i = 0; i < c; i++)
                x->grad[r * c + i] += dy[r / 3 * c + i] * other[r * c + i];
    }
}

lf_tensor *lf_inner(lf_tape *tape, lf_tensor *a, lf_tensor *b)
{
    LF_REQUIRE(a->size == b->size && a->rank >= 2 && a->dim[a->rank - 2] == 3,
               "lf_inner: a of %ld, b of %ld", a->size, b->size);
    long dim[LF_MAX_RANK];
    for (int i = 0; i < a->rank - 2; i++)
        dim[i] = a->dim[i];
    const long c = dim[a->rank - 2] = lf_cols(a);
    lf_tensor *y = lf_tensor_new(tape, a->rank - 1, dim);
    for (long r = 0; r < lf_rows(y); r++)
        for (long i = 0; i < c; i++)
            y->value[r * c + i] = dot3(a->value + 3 * r * c + i, b->value + 3 * r * c + i, c);
    lf_record(tape, "inner", inner_backward, NULL, LF_IN(a, b), LF_OUT(y));
    return y;
}

void lf_vector_neuron_init(lf_store *store, lf_vector_neuron *layer, const char *prefix, long c)
{
    char name[128];
    snprintf(name, sizeof name, "%s.feature", prefix);
    lf_linear_init(store, &layer->feature, name, c, c, false, 1);
    snprintf(name, sizeof name, "%s.direction", prefix);
    lf_linear_init(store, &layer->direction, name, c, c, false, 1);
}

lf_tensor *lf_vector_neuron_apply(lf_tape *tape, const lf_vector_neuron *layer, lf_tensor *v)
{
    lf_tensor *p = lf_linear_apply(tape, &layer->feature, v, LF_IDENTITY);
    lf_tensor *k = lf_linear_apply(tape, &layer->direction, v, LF_IDENTITY);
    return lf_inner(tape, v, lf_vector_relu(tape, p, k));
}
