/* so2_nonlinear.c: nonlinearities of fields along a ray, on invariants only         [method.md 2.9]
 *
 *   invariants  n_0 = x_0, n_k = sqrt(|x_k|^2 + 1e-12)          dx_k += dn x_k / n
 *   gate        y_0 = x_0 + ELU(h_0)                            dh_0 += ELU'(h_0) dy_0
 *               y_k = s x_k, s = sigmoid(h_k)                   dh_k += s (1 - s) <dy_k, x_k>
 *   norm_relu   y_0 = ReLU(x_0 + b_0)
 *               y_k = F x_k, F = ReLU(n + b_k) / n              dx_k += F dy + F'(n) <dy, x> x / n
 *               n = sqrt(|x_k|^2 + 1e-8)                        db_k += [n + b > 0] <dy, x> / n
 *   layer_norm  y = g x q, q = (mean x^2 + 1e-4)^-1/2   dx += q (g dy - x q^2 <g dy, x> / R)
 *                                                       dg += q <dy, x> per type, channel
 *
 * Shapes      x, y [.., P C]; n, h [.., Q C]; b, g [Q C]; k >= 1 has two planes.
 * Degenerate  zero rows: every divisor is positive, every derivative finite.
 */
#include "layers/light_field.h"

static const lf_real norm_epsilon = (lf_real)1e-12, relu_epsilon = (lf_real)1e-8,
                     layer_epsilon = (lf_real)1e-4;

/* Channels of a field, whose last axis must be P C. */
static long channels_of(const lf_types *types, const lf_tensor *x, const char *op)
{
    const long planes = lf_types_planes(types);
    LF_REQUIRE(lf_cols(x) % planes == 0 && lf_cols(x) > 0, "%s: rows of %ld for %ld planes", op,
               lf_cols(x), planes);
    return lf_cols(x) / planes;
}

typedef struct saved {
    lf_types types;
    long c;
} saved;

static saved *save(lf_tape *tape, const lf_types *types, long c)
{
    saved *s = lf_alloc(tape, sizeof *s);
    *s = (saved){*types, c};
    return s;
}

/* ---- invariants -------------------------------------------------------------------------------
 */

static void invariants_backward(const lf_node *node)
{
    const saved *s = node->saved;
    const lf_tensor *x = node->in[0], *n = node->out[0];
    const long c = s->c, nx = lf_cols(x), nn = lf_cols(n);
    for (long r = 0; r < lf_rows(n); r++) {
        const lf_real *xr = x->value + r * nx, *nr = n->value + r * nn, *dn = n->grad + r * nn;
        lf_real *dx = x->grad + r * nx;
        for (long i = 0; i < lf_types_scalars(&s->types) * c; i++)
            dx[i] += dn[i];
        for (long k = 1; k < s->types.count; k++)
            for (long i = 0; i < c; i++) {
                const long re = lf_types_plane(&s->types, k) * c + i, im = re + c;
                const long gate = lf_types_gate(&s->types, k) * c + i;
                const lf_real f = dn[gate] / nr[gate];
                dx[re] += f * xr[re];
                dx[im] += f * xr[im];
            }
    }
}

lf_tensor *lf_so2_invariants(lf_tape *tape, const lf_types *types, lf_tensor *x)
{
    const long c = channels_of(types, x, "lf_so2_invariants");
    lf_tensor *n = lf_tensor_cols(tape, x, lf_types_gates(types) * c);
    for (long r = 0; r < lf_rows(x); r++) {
        const lf_real *xr = x->value + r * lf_cols(x);
        lf_real *out = n->value + r * lf_cols(n);
        memcpy(out, xr, (size_t)(lf_types_scalars(types) * c) * sizeof *out);
        for (long k = 1; k < types->count; k++) {
            const lf_real *re = xr + lf_types_plane(types, k) * c, *im = re + c;
            for (long i = 0; i < c; i++)
                out[lf_types_gate(types, k) * c + i] =
                    LF_SQRT(re[i] * re[i] + im[i] * im[i] + norm_epsilon);
        }
    }
    lf_record(tape, "so2_invariants", invariants_backward, save(tape, types, c), LF_IN(x),
              LF_OUT(n));
    return n;
}

/* ---- gate -------------------------------------------------------------------------------------
 */

/* Finite for every x: the exponent is never positive. */
static lf_real sigmoid(lf_real x)
{
    const lf_real e = LF_EXP(-LF_FABS(x));
    return (x >= 0 ? 1 : e) / (1 + e);
}

static void gate_row_backward(const saved *s, const lf_real *x, const lf_real *h, const lf_real *dy,
                              lf_real *restrict dx, lf_real *restrict dh)
{
    const long c = s->c;
    for (long i = 0; i < lf_types_scalars(&s->types) * c; i++) {
        if (dx)
            dx[i] += dy[i];
        if (dh)
            dh[i] += (h[i] > 0 ? 1 : LF_EXP(h[i])) * dy[i];
    }
    for (long k = 1; k < s->types.count; k++)
        for (long i = 0; i < c; i++) {
            const long re = lf_types_plane(&s->types, k) * c + i, im = re + c;
            const long gate = lf_types_gate(&s->types, k) * c + i;
            const lf_real g = sigmoid(h[gate]);
            if (dx) {
                dx[re] += g * dy[re];
                dx[im] += g * dy[im];
            }
            if (dh)
                dh[gate] += g * (1 - g) * (dy[re] * x[re] + dy[im] * x[im]);
        }
}

static void gate_backward(const lf_node *node)
{
    const saved *s = node->saved;
    const lf_tensor *x = node->in[0], *h = node->in[1];
    const long nx = lf_cols(x), nh = lf_cols(h);
    for (long r = 0; r < lf_rows(x); r++)
        gate_row_backward(s, x->value + r * nx, h->value + r * nh, node->out[0]->grad + r * nx,
                          x->grad ? x->grad + r * nx : NULL, h->grad ? h->grad + r * nh : NULL);
}

lf_tensor *lf_so2_gate(lf_tape *tape, const lf_types *types, lf_tensor *x, lf_tensor *h)
{
    const long c = channels_of(types, x, "lf_so2_gate"), gates = lf_types_gates(types) * c;
    LF_REQUIRE(lf_rows(h) == lf_rows(x) && lf_cols(h) == gates, "lf_so2_gate: h [%ld, %ld]",
               lf_rows(h), lf_cols(h));
    lf_tensor *y = lf_tensor_like(tape, x);
    for (long r = 0; r < lf_rows(x); r++) {
        const lf_real *xr = x->value + r * lf_cols(x), *hr = h->value + r * gates;
        lf_real *out = y->value + r * lf_cols(x);
        for (long i = 0; i < lf_types_scalars(types) * c; i++)
            out[i] = xr[i] + (hr[i] > 0 ? hr[i] : (lf_real)expm1((double)hr[i]));
        for (long k = 1; k < types->count; k++)
            for (long i = 0; i < c; i++) {
                const long re = lf_types_plane(types, k) * c + i;
                const lf_real g = sigmoid(hr[lf_types_gate(types, k) * c + i]);
                out[re] = g * xr[re];
                out[re + c] = g * xr[re + c];
            }
    }
    lf_record(tape, "so2_gate", gate_backward, save(tape, types, c), LF_IN(x, h), LF_OUT(y));
    return y;
}

void lf_so2_gated_init(lf_store *store, lf_so2_gated *layer, const char *prefix,
                       const lf_types *types, long channels)
{
    char name[160];
    snprintf(name, sizeof name, "%s.gate", prefix);
    const long n = lf_types_gates(types) * channels;
    lf_linear_init(store, &layer->gate, name, n, n, true, 1);
}

lf_tensor *lf_so2_gated_apply(lf_tape *tape, const lf_so2_gated *layer, const lf_types *types,
                              lf_tensor *x)
{
    lf_tensor *n = lf_so2_invariants(tape, types, x);
    return lf_so2_gate(tape, types, x, lf_linear_apply(tape, &layer->gate, n, LF_IDENTITY));
}

/* ---- norm nonlinearity --------------------------------------------------------------------------
 */

static void norm_relu_row_backward(const saved *s, const lf_real *x, const lf_real *beta,
                                   const lf_real *dy, lf_real *restrict dx, lf_real *restrict db)
{
    const long c = s->c;
    for (long i = 0; i < lf_types_scalars(&s->types) * c; i++) {
        const lf_real g = x[i] + beta[i] > 0 ? dy[i] : 0;
        if (dx)
            dx[i] += g;
        if (db)
            db[i] += g;
    }
    for (long k = 1; k < s->types.count; k++)
        for (long i = 0; i < c; i++) {
            const long re = lf_types_plane(&s->types, k) * c + i, im = re + c;
            const long gate = lf_types_gate(&s->types, k) * c + i;
            const lf_real n = LF_SQRT(x[re] * x[re] + x[im] * x[im] + relu_epsilon);
            const lf_real b = beta[gate], dot = dy[re] * x[re] + dy[im] * x[im];
            if (!(n + b > 0))
                continue;
            if (dx) {
                const lf_real f = (n + b) / n, slope = -b / (n * n) * dot / n;
                dx[re] += f * dy[re] + slope * x[re];
                dx[im] += f * dy[im] + slope * x[im];
            }
            if (db)
                db[gate] += dot / n;
        }
}

static void norm_relu_backward(const lf_node *node)
{
    const lf_tensor *x = node->in[0], *beta = node->in[1];
    const long n = lf_cols(x);
    for (long r = 0; r < lf_rows(x); r++)
        norm_relu_row_backward(node->saved, x->value + r * n, beta->value,
                               node->out[0]->grad + r * n, x->grad ? x->grad + r * n : NULL,
                               beta->grad);
}

lf_tensor *lf_so2_norm_relu(lf_tape *tape, const lf_types *types, lf_tensor *x, lf_tensor *beta)
{
    const long c = channels_of(types, x, "lf_so2_norm_relu");
    LF_REQUIRE(beta->size == lf_types_gates(types) * c, "lf_so2_norm_relu: beta [%ld]", beta->size);
    lf_tensor *y = lf_tensor_like(tape, x);
    for (long r = 0; r < lf_rows(x); r++) {
        const lf_real *xr = x->value + r * lf_cols(x), *b = beta->value;
        lf_real *out = y->value + r * lf_cols(x);
        for (long i = 0; i < lf_types_scalars(types) * c; i++) {
            const lf_real t = xr[i] + b[i];
            out[i] = t < 0 ? 0 : t; /* NaN stays NaN */
        }
        for (long k = 1; k < types->count; k++)
            for (long i = 0; i < c; i++) {
                const long re = lf_types_plane(types, k) * c + i, im = re + c;
                const lf_real n = LF_SQRT(xr[re] * xr[re] + xr[im] * xr[im] + relu_epsilon);
                const lf_real t = n + b[lf_types_gate(types, k) * c + i], f = (t < 0 ? 0 : t) / n;
                out[re] = f * xr[re];
                out[im] = f * xr[im];
            }
    }
    lf_record(tape, "so2_norm_relu", norm_relu_backward, save(tape, types, c), LF_IN(x, beta),
              LF_OUT(y));
    return y;
}

/* ---- layer norm -------------------------------------------------------------------------------
 */

static lf_real inverse_rms(long n, const lf_real *x)
{
    lf_real sum = 0;
    for (long i = 0; i < n; i++)
        sum += x[i] * x[i];
    return 1 / LF_SQRT(sum / (lf_real)n + layer_epsilon);
}

static void layer_norm_backward(const lf_node *node)
{
    const saved *s = node->saved;
    const lf_tensor *x = node->in[0], *gain = node->in[1];
    const long c = s->c, planes = lf_types_planes(&s->types), n = planes * c;
    for (long r = 0; r < lf_rows(x); r++) {
        const lf_real *xr = x->value + r * n, *dy = node->out[0]->grad + r * n;
        const lf_real q = inverse_rms(n, xr);
        lf_real dot = 0; /* <g dy, x> */
        for (long p = 0; p < planes; p++) {
            const long block = lf_types_gate_of_plane(&s->types, p) * c;
            for (long i = 0; i < c; i++) {
                const lf_real t = dy[p * c + i] * xr[p * c + i];
                dot += gain->value[block + i] * t;
                if (gain->grad)
                    gain->grad[block + i] += q * t;
            }
        }
        const lf_real pull = q * q * q * dot / (lf_real)n;
        for (long j = 0; x->grad && j < n; j++)
            x->grad[r * n + j] +=
                q * gain->value[lf_types_gate_of_plane(&s->types, j / c) * c + j % c] * dy[j] -
                pull * xr[j];
    }
}

lf_tensor *lf_so2_layer_norm(lf_tape *tape, const lf_types *types, lf_tensor *x, lf_tensor *gain)
{
    const long c = channels_of(types, x, "lf_so2_layer_norm"), n = lf_cols(x);
    LF_REQUIRE(gain->size == lf_types_gates(types) * c, "lf_so2_layer_norm: gain [%ld]",
               gain->size);
    lf_tensor *y = lf_tensor_like(tape, x);
    for (long r = 0; r < lf_rows(x); r++) {
        const lf_real *xr = x->value + r * n, q = inverse_rms(n, xr);
        for (long p = 0; p < lf_types_planes(types); p++)
            for (long i = 0; i < c; i++)
                y->value[r * n + p * c + i] =
                    q * gain->value[lf_types_gate_of_plane(types, p) * c + i] * xr[p * c + i];
    }
    lf_record(tape, "so2_layer_norm", layer_norm_backward, save(tape, types, c), LF_IN(x, gain),
              LF_OUT(y));
    return y;
}
