/* nonlinear.c: nonlinearities of types 0 and 1                                    [method.md 2.9]
 *
 *   norm     n_c = sqrt(|v_c|^2 + e)                     dv += dn v / n
 *   gate     y_c = g_c v_c                               dv += g dy, dg += <dy, v>
 *   norm_relu  y = F(n) v, F = ReLU(n + b) / n           dv += F dy + F'(n) <dy, v> v / n
 *                                                        db += [n + b > 0] <dy, v> / n
 * Shapes   v [.., 3, C], n, g [.., C], b [C].
 * Degenerate  v = 0: n >= sqrt(e) > 0, every derivative is finite.
 */
#include "layers/layers.h"

#include "autograd/kernels/vector_math.h"

static const lf_real norm_epsilon = (lf_real)1e-12, relu_epsilon = (lf_real)1e-8;

/* A tensor with the dims of v [.., 3, C] without the axis of length 3. */
static lf_tensor *scalars_of(lf_tape *tape, const lf_tensor *v, const char *op)
{
    LF_REQUIRE(v->rank >= 2 && v->dim[v->rank - 2] == 3, "%s: v has no axis of 3 components", op);
    long dim[LF_MAX_RANK];
    for (int i = 0; i < v->rank - 2; i++)
        dim[i] = v->dim[i];
    dim[v->rank - 2] = lf_cols(v);
    return lf_tensor_new(tape, v->rank - 1, dim);
}

static void vector_norm_backward(const lf_node *node)
{
    lf_tensor *v = node->in[0];
    const lf_tensor *n = node->out[0];
    const long c = lf_cols(v);
    for (long r = 0; r < lf_rows(n); r++)
        for (int a = 0; a < 3; a++)
            for (long i = 0; i < c; i++)
                v->grad[(3 * r + a) * c + i] +=
                    n->grad[r * c + i] * v->value[(3 * r + a) * c + i] / n->value[r * c + i];
}

lf_tensor *lf_vector_norm(lf_tape *tape, lf_tensor *v)
{
    lf_tensor *n = scalars_of(tape, v, "lf_vector_norm");
    const long c = lf_cols(v);
    for (long r = 0; r < lf_rows(n); r++) {
        const lf_real *x = v->value + 3 * r * c, *y = x + c, *z = y + c;
        for (long i = 0; i < c; i++)
            n->value[r * c + i] = LF_SQRT(x[i] * x[i] + y[i] * y[i] + z[i] * z[i] + norm_epsilon);
    }
    lf_record(tape, "vector_norm", vector_norm_backward, NULL, LF_IN(v), LF_OUT(n));
    return n;
}

static void gate_backward(const lf_node *node)
{
    lf_tensor *v = node->in[0], *g = node->in[1];
    const lf_real *dy = node->out[0]->grad;
    const long c = lf_cols(v);
    for (long r = 0; r < lf_rows(v); r++)
        for (long i = 0; i < c; i++) {
            const long vi = r * c + i, gi = r / 3 * c + i;
            if (v->grad)
                v->grad[vi] += g->value[gi] * dy[vi];
            if (g->grad)
                g->grad[gi] += v->value[vi] * dy[vi];
        }
}

lf_tensor *lf_gate(lf_tape *tape, lf_tensor *v, lf_tensor *g)
{
    LF_REQUIRE(v->size == 3 * g->size && lf_cols(v) == lf_cols(g), "lf_gate: v of %ld, g of %ld",
               v->size, g->size);
    lf_tensor *y = lf_tensor_like(tape, v);
    const long c = lf_cols(v);
    for (long r = 0; r < lf_rows(v); r++)
        for (long i = 0; i < c; i++)
            y->value[r * c + i] = v->value[r * c + i] * g->value[r / 3 * c + i];
    lf_record(tape, "gate", gate_backward, NULL, LF_IN(v, g), LF_OUT(y));
    return y;
}

/* |v| of `count` channels from the three components x, c apart. */
LF_INLINE lf_vec load_norm(const lf_real *x, long c, long count, lf_vec v[3])
{
    lf_vec square = lf_vec_all(relu_epsilon);
    for (int a = 0; a < 3; a++) {
        v[a] = lf_vec_load_part(x + a * c, count);
        square += v[a] * v[a];
    }
    return lf_vec_sqrt(square);
}

/* Channels [i, i + count) of one row: x, dy, dx and db are the row's. */
static void norm_relu_part(long c, long i, long count, const lf_real *x, const lf_real *dy,
                           const lf_real *beta, lf_real *dx, lf_real *db)
{
    const lf_vec none = {0};
    lf_vec v[3], g[3], dot = none;
    const lf_vec n = load_norm(x + i, c, count, v), b = lf_vec_load_part(beta + i, count);
    for (int a = 0; a < 3; a++) {
        g[a] = lf_vec_load_part(dy + a * c + i, count);
        dot += g[a] * v[a];
    }
    const lf_vec one = lf_vec_select(n + b > 0, 1 / n, none); /* F = (n + b) one */
    const lf_vec scale = one * (n + b), pull = one * dot, slope = b * pull / (n * n);
    for (int a = 0; dx && a < 3; a++) {
        lf_real *to = dx + a * c + i;
        lf_vec_store_part(to, count, lf_vec_load_part(to, count) + scale * g[a] - slope * v[a]);
    }
    if (db)
        lf_vec_store_part(db + i, count, lf_vec_load_part(db + i, count) + pull);
}

/* Rows of v [.., 3, C]; db [C] is summed by itself for BLOCK of them, to round less. */
static void norm_relu_backward(const lf_node *node)
{
    enum { BLOCK = 256 };
    const lf_tensor *v = node->in[0], *beta = node->in[1];
    const long c = lf_cols(v), rows = lf_rows(v) / 3;
    lf_real *db = beta->grad ? lf_alloc_reals(node->tape, c) : NULL;
    for (long first = 0; first < rows; first += BLOCK) {
        const long end = first + BLOCK < rows ? first + BLOCK : rows;
        if (db)
            memset(db, 0, (size_t)c * sizeof *db);
        for (long r = first; r < end; r++)
            for (long i = 0; i < c; i += LF_LANES)
                norm_relu_part(c, i, c - i < LF_LANES ? c - i : LF_LANES, v->value + 3 * r * c,
                               node->out[0]->grad + 3 * r * c, beta->value,
                               v->grad ? v->grad + 3 * r * c : NULL, db);
        for (long i = 0; db && i < c; i++)
            beta->grad[i] += db[i];
    }
}

lf_tensor *lf_norm_relu(lf_tape *tape, lf_tensor *v, lf_tensor *beta)
{
    LF_REQUIRE(v->rank >= 2 && v->dim[v->rank - 2] == 3 && beta->size == lf_cols(v),
               "lf_norm_relu: v [.., %ld], beta [%ld]", lf_cols(v), beta->size);
    lf_tensor *y = lf_tensor_like(tape, v);
    const long c = lf_cols(v);
    for (long r = 0; r < lf_rows(v) / 3; r++)
        for (long i = 0; i < c; i += LF_LANES) {
            const long at = 3 * r * c + i, count = c - i < LF_LANES ? c - i : LF_LANES;
            lf_vec x[3];
            const lf_vec n = load_norm(v->value + at, c, count, x);
            /* a NaN stays one */
            const lf_vec scale = lf_vec_relu(n + lf_vec_load_part(beta->value + i, count)) / n;
            for (int a = 0; a < 3; a++)
                lf_vec_store_part(y->value + at + a * c, count, scale * x[a]);
        }
    lf_record(tape, "norm_relu", norm_relu_backward, NULL, LF_IN(v, beta), LF_OUT(y));
    return y;
}

void lf_nonlinear_init(lf_store *store, lf_nonlinear *layer, const char *prefix,
                       lf_nonlinearity kind, long c0, long c1)
{
    char name[128];
    *layer = (lf_nonlinear){.kind = kind};
    if (c1 == 0)
        return;
    if (kind == LF_NORM_RELU) {
        snprintf(name, sizeof name, "%s.beta", prefix);
        layer->beta = lf_store_add(store, name, 1, LF_DIMS(c1), 0, 0, true);
        return;
    }
    snprintf(name, sizeof name, "%s.gate", prefix);
    lf_linear_init(store, &layer->gate, name, c0 + c1, c1, true, 1);
    snprintf(name, sizeof name, "%s.mix", prefix);
    lf_linear_init(store, &layer->mix, name, c1, c0, false, 1);
}

lf_field lf_nonlinear_apply(lf_tape *tape, const lf_nonlinear *layer, lf_field x)
{
    if (!x.vector)
        return (lf_field){lf_relu(tape, x.scalar), NULL};
    if (layer->kind == LF_NORM_RELU)
        return (lf_field){lf_relu(tape, x.scalar),
                          lf_norm_relu(tape, x.vector, lf_param(tape, layer->beta))};
    lf_tensor *norms = lf_vector_norm(tape, x.vector);
    lf_tensor *both = lf_concat(tape, 2, (lf_tensor *[]){x.scalar, norms});
    lf_tensor *gates = lf_sigmoid(tape, lf_linear_apply(tape, &layer->gate, both, LF_IDENTITY));
    lf_tensor *heard = lf_linear_apply(tape, &layer->mix, norms, LF_IDENTITY);
    return (lf_field){lf_relu(tape, lf_add(tape, x.scalar, heard)), lf_gate(tape, x.vector, gates)};
}
