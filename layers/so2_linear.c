/* so2_linear.c: complex-linear maps of fields along a ray [method.md 1.5, 4.9]
 *
 *   scalars   y = x W + b                       dW += x dy, dx += dy W', db += dy
 *   type k    y = (A + i B) x:                  y_re = x_re A - x_im B,  y_im = x_re B + x_im A
 *             dA += x_re dy_re + x_im dy_im     dx_re += dy_re A' + dy_im B'
 *             dB += x_re dy_im - x_im dy_re     dx_im += dy_im A' - dy_re B'
 *
 * Shapes      x [.., P Ci], w [P, Ci, Co], b [Co] or NULL, y [.., P Co].
 * A map with A and B is what commutes with every turn; types never mix. The adjoint is a map of the
 * same kind, with A' and -B' in place of A and B.
 */
#include "layers/light_field.h"

typedef struct so2_linear {
    lf_types types;
    long in, out;
} so2_linear;

/* y += x w, and y += i x w with the signs given. x [ci], w [ci, co], y [co]. */
static void add_product(long ci, long co, lf_real sign, const lf_real *x, const lf_real *w,
                        lf_real *restrict y)
{
    for (long i = 0; i < ci; i++) {
        const lf_real f = sign * x[i];
        for (long o = 0; o < co; o++)
            y[o] += f * w[i * co + o];
    }
}

/* y += (A + i B) x for all types of one row. */
static void add_map(const lf_types *types, long ci, long co, const lf_real *x, const lf_real *w,
                    lf_real *restrict y)
{
    const long size = ci * co;
    add_product(ci, co, 1, x, w, y);
    for (int k = 1; k < types->count; k++) {
        const long re = 2 * k - 1, im = 2 * k;
        const lf_real *a = w + re * size, *b = w + im * size;
        add_product(ci, co, 1, x + re * ci, a, y + re * co);
        add_product(ci, co, -1, x + im * ci, b, y + re * co);
        add_product(ci, co, 1, x + re * ci, b, y + im * co);
        add_product(ci, co, 1, x + im * ci, a, y + im * co);
    }
}

/* dw += sign x dy', an outer product. */
static void add_outer(long ci, long co, lf_real sign, const lf_real *x, const lf_real *dy,
                      lf_real *restrict dw)
{
    for (long i = 0; i < ci; i++) {
        const lf_real f = sign * x[i];
        for (long o = 0; o < co; o++)
            dw[i * co + o] += f * dy[o];
    }
}

static void add_weight_gradient(const so2_linear *t, const lf_real *x, const lf_real *dy,
                                lf_real *restrict dw)
{
    const long ci = t->in, co = t->out, size = ci * co;
    add_outer(ci, co, 1, x, dy, dw);
    for (int k = 1; k < t->types.count; k++) {
        const long re = 2 * k - 1, im = 2 * k;
        add_outer(ci, co, 1, x + re * ci, dy + re * co, dw + re * size);
        add_outer(ci, co, 1, x + im * ci, dy + im * co, dw + re * size);
        add_outer(ci, co, 1, x + re * ci, dy + im * co, dw + im * size);
        add_outer(ci, co, -1, x + im * ci, dy + re * co, dw + im * size);
    }
}

/* The adjoint's weights [P, Co, Ci]: A' and -B'. */
static lf_real *adjoint_weights(lf_tape *tape, const so2_linear *t, const lf_real *w)
{
    const long planes = lf_types_planes(&t->types);
    lf_real *adjoint = lf_alloc_reals(tape, planes * t->in * t->out);
    for (long p = 0; p < planes; p++) {
        const lf_real sign = p > 0 && p % 2 == 0 ? -1 : 1;
        for (long i = 0; i < t->in; i++)
            for (long o = 0; o < t->out; o++)
                adjoint[(p * t->out + o) * t->in + i] = sign * w[(p * t->in + i) * t->out + o];
    }
    return adjoint;
}

static void backward(const lf_node *node)
{
    const so2_linear *t = node->saved;
    const lf_tensor *x = node->in[0], *w = node->in[1], *b = node->in[2], *y = node->out[0];
    const long rows = lf_rows(x), cols_in = lf_cols(x), cols_out = lf_cols(y);
    const lf_real *adjoint = x->grad ? adjoint_weights(node->tape, t, w->value) : NULL;
    for (long r = 0; r < rows; r++) {
        const lf_real *dy = y->grad + r * cols_out;
        if (x->grad)
            add_map(&t->types, t->out, t->in, dy, adjoint, x->grad + r * cols_in);
        if (w->grad)
            add_weight_gradient(t, x->value + r * cols_in, dy, w->grad);
        for (long o = 0; b && b->grad && o < t->out; o++)
            b->grad[o] += dy[o];
    }
}

lf_tensor *lf_so2_linear(lf_tape *tape, const lf_types *types, lf_tensor *x, lf_tensor *w,
                         lf_tensor *b)
{
    const long planes = lf_types_planes(types), cols = lf_cols(x), rows = lf_rows(x);
    LF_REQUIRE(w->rank == 3 && w->dim[0] == planes && cols == planes * w->dim[1],
               "lf_so2_linear: x [.., %ld], w of %ld planes, %d types", cols, w->dim[0],
               types->count);
    LF_REQUIRE(!b || b->size == w->dim[2], "lf_so2_linear: b of %ld, not %ld", b->size, w->dim[2]);
    so2_linear *t = lf_alloc(tape, sizeof *t);
    *t = (so2_linear){*types, w->dim[1], w->dim[2]};
    lf_tensor *y = lf_tensor_cols(tape, x, planes * t->out);
    memset(y->value, 0, (size_t)y->size * sizeof *y->value);
    for (long r = 0; r < rows; r++) {
        lf_real *out = y->value + r * planes * t->out;
        if (b)
            memcpy(out, b->value, (size_t)t->out * sizeof *out);
        add_map(types, t->in, t->out, x->value + r * cols, w->value, out);
    }
    lf_record(tape, "so2_linear", backward, t, LF_IN(x, w, b), LF_OUT(y));
    return y;
}

/* ---- the layer --------------------------------------------------------------------------------
 */

void lf_so2_map_init(lf_store *store, lf_so2_map *layer, const char *prefix, const lf_types *types,
                     long in, long out, bool bias)
{
    LF_REQUIRE(lf_types_valid(types) && in >= 1 && out >= 1, "%s: %ld -> %ld channels of %d types",
               prefix, in, out, types->count);
    char name[160];
    const long planes = lf_types_planes(types);
    snprintf(name, sizeof name, "%s.weight", prefix);
    layer->weight =
        lf_store_add(store, name, 3, LF_DIMS(planes, in, out), 0, 1 / sqrt(3 * (double)in), true);
    lf_real *w = lf_values(layer->weight);
    for (long i = in * out; i < planes * in * out; i++)
        w[i] *= (lf_real)0.7071067811865476; /* |A + i B|^2 as for the scalars */
    snprintf(name, sizeof name, "%s.bias", prefix);
    layer->bias = bias ? lf_store_add(store, name, 1, LF_DIMS(out), 0, 0, true) : NULL;
}

lf_tensor *lf_so2_map_apply(lf_tape *tape, const lf_so2_map *layer, const lf_types *types,
                            lf_tensor *x)
{
    return lf_so2_linear(tape, types, x, lf_param(tape, layer->weight),
                         layer->bias ? lf_param(tape, layer->bias) : NULL);
}

/* ---- side by side ------------------------------------------------------------------------------
 */

static void concat_backward(const lf_node *node)
{
    const lf_tensor *y = node->out[0];
    const long planes = *(const long *)node->saved, cols = lf_cols(y) / planes;
    const long ca = lf_cols(node->in[0]) / planes;
    for (long r = 0; r < lf_rows(y) * planes; r++)
        for (int part = 0; part < 2; part++) {
            const long c = part ? cols - ca : ca;
            lf_real *dx = node->in[part]->grad;
            for (long i = 0; dx && i < c; i++)
                dx[r * c + i] += y->grad[r * cols + (part ? ca : 0) + i];
        }
}

lf_tensor *lf_so2_concat(lf_tape *tape, const lf_types *types, lf_tensor *a, lf_tensor *b)
{
    long *planes = lf_alloc(tape, sizeof *planes);
    *planes = lf_types_planes(types);
    LF_REQUIRE(lf_cols(a) % *planes == 0 && lf_cols(b) % *planes == 0 && lf_rows(a) == lf_rows(b),
               "lf_so2_concat: %ld rows of %ld and %ld of %ld", lf_rows(a), lf_cols(a), lf_rows(b),
               lf_cols(b));
    const long ca = lf_cols(a) / *planes, cb = lf_cols(b) / *planes;
    lf_tensor *y = lf_tensor_cols(tape, a, *planes * (ca + cb));
    for (long r = 0; r < lf_rows(a) * *planes; r++) {
        lf_real *out = y->value + r * (ca + cb);
        memcpy(out, a->value + r * ca, (size_t)ca * sizeof *out);
        memcpy(out + ca, b->value + r * cb, (size_t)cb * sizeof *out);
    }
    lf_record(tape, "so2_concat", concat_backward, planes, LF_IN(a, b), LF_OUT(y));
    return y;
}
