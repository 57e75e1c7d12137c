/* stability_attention.c: large logits and large densities.               [method.md 2.6, 4.6, 5b.1]
 * A logit of 1e4 in float has a last place of 1e-3, which is what its weights may err by: their
 * condition. Softmax and volume rendering are written out in long double, the transmittance as a
 * sum of logarithms.
 */
#include "autograd/ops.h"
#include "bench/stability.h"
#include "layers/ibrnet.h"
#include "layers/light_blocks.h"

#define LOGITS LF_STABILITY_AT(1, 1e1, 3e1, 1e2, 1e3, 3e3, 1e4)
#define DENSITIES LF_STABILITY_AT(0, 1e-8, 1e-4, 1e-2, 1, 1e1, 1e2, 1e3, 1e4, 1e6, 1e8)

/* ---- softmax --------------------------------------------------------------------------------- */

enum { ROWS = 4, COLS = 6 };

/* Weights of one row and the gradient of their weighting by the driver's numbers from `at` on. */
static void exact_softmax(const lf_real *x, const double *mask, long at, long double *y,
                          long double *dx)
{
    long double most = -INFINITY, sum = 0;
    for (int i = 0; i < COLS; i++)
        most = mask[i] > 0 && x[i] > most ? (long double)x[i] : most;
    for (int i = 0; i < COLS; i++)
        sum += y[i] = mask[i] > 0 ? expl((long double)x[i] - most) : 0;
    for (int i = 0; i < COLS; i++)
        y[i] = sum > 0 ? y[i] / sum : 0;
    for (int i = 0; i < COLS; i++) {
        const double by = lf_stability_weight(0, at + i);
        dx[i] = 0;
        for (int j = 0; j < COLS; j++)
            dx[i] += y[i] * y[j] * (by - lf_stability_weight(0, at + j));
    }
}

/* Logits of that size, some equal, some near the largest, a row that is masked. */
static void softmax(lf_stability *s)
{
    double x[ROWS * COLS], mask[ROWS * COLS];
    long double y[ROWS * COLS], dx[ROWS * COLS];
    for (int i = 0; i < ROWS * COLS; i++) {
        x[i] = s->parameter * cos(1.7 * i);
        mask[i] = i / COLS != 3 && i != 2;
    }
    x[COLS] = x[COLS + 1] = s->parameter;
    x[2 * COLS] = s->parameter;
    x[2 * COLS + 1] = s->parameter - 0.5;
    lf_tensor *logits = lf_stability_given(s, "logits", 2, LF_DIMS(ROWS, COLS), x, 1);
    for (int r = 0; r < ROWS; r++)
        exact_softmax(logits->value + r * COLS, mask + r * COLS, r * COLS, y + r * COLS,
                      dx + r * COLS);
    lf_tensor *seen = lf_stability_constant(s, 2, LF_DIMS(ROWS, COLS), mask);
    lf_stability_output(s, "weights", lf_softmax(s->tape, logits, seen), y);
    lf_stability_gradient(s, "logits", dx);
}

/* One logit above the others by the parameter: their weights are below a last place of its own. */
static void saturated_softmax(lf_stability *s)
{
    double x[COLS], all[COLS];
    long double y[COLS], dx[COLS];
    for (int i = 0; i < COLS; i++) {
        x[i] = i == 3 ? s->parameter : 0.25 * i;
        all[i] = 1;
    }
    lf_tensor *logits = lf_stability_given(s, "logits", 2, LF_DIMS(1, COLS), x, 1);
    exact_softmax(logits->value, all, 0, y, dx);
    lf_stability_output(s, "weights", lf_softmax(s->tape, logits, NULL), y);
    lf_stability_gradient(s, "logits", dx);
}

/* ---- attention ------------------------------------------------------------------------------- */

enum { Q = 2, V = 4, N = 2, S = 5, C = 2, PLANES = 5 };
static const lf_types types = {.count = 3, .omega = {0, 1, 4}};

/* Queries and keys, of which one number moves a logit by a step. */
static lf_tensor *half(lf_stability *s, const char *name, int rank, const long *dim)
{
    const double size = sqrt(s->parameter);
    return lf_stability_small(s, name, rank, dim, size, 1 / size);
}

/* Heads of so many scalars and vectors. */
static void attend_rays(lf_stability *s, long per)
{
    enum { HEADS = 2 };
    const long c = HEADS * per;
    double d[Q * V * 3], mask[Q * V];
    for (int i = 0; i < Q * V; i++) {
        d[3 * i] = cos(i);
        d[3 * i + 1] = sin(i);
        d[3 * i + 2] = 0;
        mask[i] = i != 1;
    }
    const lf_ray_geometry rays = {Q, V, lf_stability_constant(s, 3, LF_DIMS(Q, V, 3), d),
                                  lf_stability_constant(s, 2, LF_DIMS(Q, V), mask)};
    const lf_field q = {half(s, "q0", 2, LF_DIMS(Q, c)), half(s, "q1", 3, LF_DIMS(Q, 3, c))};
    const lf_field kv = {half(s, "kv0", 3, LF_DIMS(Q, V, 2 * c)),
                         half(s, "kv1", 4, LF_DIMS(Q, V, 3, 2 * c))};
    const lf_field y = lf_ray_attention(s->tape, q, kv, &rays, HEADS);
    lf_stability_output(s, "scalars", y.scalar, NULL);
    lf_stability_output(s, "vectors", y.vector, NULL);
}

static void ray_attention(lf_stability *s)
{
    attend_rays(s, 2);
}

/* Heads of three channels are no butterfly: the other way to compute it. */
static void ray_attention_arrays(lf_stability *s)
{
    attend_rays(s, 3);
}

/* Some cameras round two target rays; the second ray's first sample is seen by one view, its second
 * by none. */
static lf_light_geometry around(lf_stability *s)
{
    const double origin[3 * N] = {0, 0, 0, 0.1, -0.1, 0};
    const double direction[3 * N] = {0, 0.6, 0.8, 0, 0.8, 0.6};
    double centre[3 * V], depth[N * S];
    uint8_t seen[N * S * V];
    for (int v = 0; v < V; v++) {
        centre[3 * v] = cos(1.3 * v);
        centre[3 * v + 1] = sin(1.3 * v);
        centre[3 * v + 2] = 0.2 * v;
    }
    for (int i = 0; i < N * S; i++)
        depth[i] = 1.2 + 0.7 * (i % S) + 0.1 * (i / S);
    for (int i = 0; i < N * S * V; i++)
        seen[i] = i % 7 != 3 && !(i >= S * V && i < (S + 2) * V && i != S * V);
    const lf_light_rays rays = {N, S, V, origin, direction, depth, centre, seen, 1, 5};
    return lf_light_geometry_make(s->tape, &types, &rays);
}

static void cross_attention(lf_stability *s)
{
    const lf_light_geometry g = around(s);
    lf_tensor *q = half(s, "q", 3, LF_DIMS(N, S, PLANES * C));
    lf_tensor *k = half(s, "k", 4, LF_DIMS(N, S, V, PLANES * C));
    lf_tensor *v = lf_stability_input(s, "values", 4, LF_DIMS(N, S, V, PLANES * C), 1);
    const lf_attended y = lf_cross_attention(s->tape, q, k, v, &g, 2);
    lf_stability_output(s, "field", y.field, NULL);
    lf_stability_output(s, "weight", y.weight, NULL);
}

static void cross_attention_blocks(lf_stability *s)
{
    const lf_light_geometry g = around(s);
    const lf_blocks b = lf_blocks_make(s->tape, &g);
    lf_tensor *q = half(s, "q", 3, LF_DIMS(N, S, PLANES * C));
    lf_tensor *k = half(s, "k", 4, LF_DIMS(N, S, V, PLANES * C));
    lf_tensor *v = lf_stability_input(s, "values", 4, LF_DIMS(N, S, V, PLANES * C), 1);
    const lf_attended y = lf_blocks_attention(s->tape, &b, lf_blocks_of_points(s->tape, &b, q),
                                              lf_blocks_of_views(s->tape, &b, k),
                                              lf_blocks_of_views(s->tape, &b, v), 2);
    lf_stability_output(s, "field", lf_blocks_rows(s->tape, &b, y.field), NULL);
    lf_stability_output(s, "weight", y.weight, NULL);
}

static void along_ray_attention(lf_stability *s)
{
    const lf_light_geometry g = around(s);
    lf_tensor *q = half(s, "q", 3, LF_DIMS(N, S, PLANES * C));
    lf_tensor *k = half(s, "k", 3, LF_DIMS(N, S, PLANES * C));
    lf_tensor *v = lf_stability_input(s, "values", 3, LF_DIMS(N, S, PLANES * C), 1);
    lf_tensor *a = lf_stability_input(s, "key profile", 2, LF_DIMS(16, PLANES * C), 0.1);
    lf_tensor *b = lf_stability_input(s, "value profile", 2, LF_DIMS(16, PLANES * C), 0.1);
    lf_stability_output(s, "field", lf_along_ray_attention(s->tape, q, k, v, a, b, &g, 2), NULL);
}

/* IBRNet's: the attention along the ray, and the colours of the views. */
static void sample_attention(lf_stability *s)
{
    const lf_light_geometry g = around(s);
    lf_tensor *q = half(s, "q", 3, LF_DIMS(N, S, 8));
    lf_tensor *k = half(s, "k", 3, LF_DIMS(N, S, 8));
    lf_tensor *v = lf_stability_input(s, "values", 3, LF_DIMS(N, S, 8), 1);
    lf_stability_output(s, "field", lf_sample_attention(s->tape, q, k, v, g.count, 2), NULL);
}

static void colour_softmax(lf_stability *s)
{
    const lf_light_geometry g = around(s);
    lf_tensor *difference = lf_tensor_new(s->tape, 4, LF_DIMS(N, S, V, 4));
    memset(difference->value, 0, (size_t)difference->size * sizeof(lf_real));
    const lf_lanes lanes = lf_lanes_make(s->tape, g.mask, difference);
    lf_tensor *t = lf_stability_small(s, "logits", 4, LF_DIMS(N, S, V, 1), s->parameter, 1);
    lf_tensor *x = lf_stability_input(s, "seen", 4, LF_DIMS(N, S, V, 4), 1);
    lf_tensor *rows = lf_lanes_add_rows(s->tape, t, NULL, &lanes);
    lf_stability_output(s, "colour", lf_ibrnet_colour(s->tape, rows, x, &lanes), NULL);
}

/* ---- volume rendering ------------------------------------------------------------------------ */

enum { SAMPLES = 8 };

/* Weights by logarithms of the transmittance; gradients by the law of method.md 4.9 with T_i and
 * the sums behind in long double. The outputs' order: colour, weight, depth. */
static void exact_volume(const lf_real *sigma, const lf_real *c, const double *t, bool white,
                         long double *colour, long double *w, long double *depth,
                         long double *dsigma, long double *dc)
{
    long double before[SAMPLES], sum = 0, opacity = 0, behind = 0;
    memset(colour, 0, 3 * sizeof *colour);
    *depth = 0;
    for (int i = 0; i < SAMPLES; i++) {
        before[i] = expl(-sum);
        w[i] = before[i] * -expm1l(-(long double)sigma[i]);
        sum += sigma[i];
        opacity += w[i];
        *depth += w[i] * (long double)(lf_real)t[i];
        for (int a = 0; a < 3; a++)
            colour[a] += w[i] * c[3 * i + a];
    }
    for (int a = 0; white && a < 3; a++) /* 1 - opacity, without its cancellation */
        colour[a] += expl(-sum);
    for (int i = SAMPLES - 1; i >= 0; i--) {
        long double g =
            lf_stability_weight(1, i) + lf_stability_weight(2, 0) * (long double)(lf_real)t[i];
        for (int a = 0; a < 3; a++) {
            const long double by = lf_stability_weight(0, a);
            g += by * ((long double)c[3 * i + a] - white);
            dc[3 * i + a] = w[i] * by;
        }
        dsigma[i] = before[i] * expl(-(long double)sigma[i]) * g - behind;
        behind += w[i] * g;
    }
}

static void volume_on(lf_stability *s, bool white)
{
    double sigma[SAMPLES], t[SAMPLES];
    long double colour[3], w[SAMPLES], depth, dsigma[SAMPLES], dc[3 * SAMPLES];
    for (int i = 0; i < SAMPLES; i++) {
        sigma[i] = s->parameter * (i % 3 == 1 ? 1 : i % 3 == 2 ? 0.3 : 1e-3);
        t[i] = 1 + 0.5 * i;
    }
    lf_tensor *x = lf_stability_given(s, "density", 2, LF_DIMS(1, SAMPLES), sigma,
                                      s->parameter > 1 ? s->parameter : 1);
    lf_tensor *c = lf_stability_input(s, "colour", 3, LF_DIMS(1, SAMPLES, 3), 1);
    lf_tensor *places = lf_stability_constant(s, 2, LF_DIMS(1, SAMPLES), t);
    exact_volume(x->value, c->value, t, white, colour, w, &depth, dsigma, dc);
    const lf_rendered r = lf_volume(s->tape, x, c, places, white);
    lf_stability_output(s, "rendered", r.colour, colour);
    lf_stability_output(s, "weight", r.weight, w);
    lf_stability_output(s, "depth", r.depth, &depth);
    lf_stability_gradient(s, "density", dsigma);
    lf_stability_gradient(s, "colour", dc);
}

static void volume(lf_stability *s)
{
    volume_on(s, false);
}

static void volume_white(lf_stability *s)
{
    volume_on(s, true);
}

/* softplus of large numbers of both signs. */
static void density(lf_stability *s)
{
    enum { T = 6 };
    double t[T], seen[T];
    long double sigma[T], dt[T];
    for (int i = 0; i < T; i++) {
        t[i] = s->parameter * (i % 2 ? -1 : 1) * (1 - 0.3 * (i / 2));
        seen[i] = i != 4;
    }
    lf_tensor *x = lf_stability_given(s, "t", 3, LF_DIMS(1, T, 1), t, 1);
    for (int i = 0; i < T; i++) {
        const long double v = x->value[i], e = expl(-fabsl(v));
        sigma[i] = seen[i] * ((v > 0 ? v : 0) + log1pl(e));
        dt[i] = seen[i] * lf_stability_weight(0, i) * (v > 0 ? 1 : e) / (1 + e);
    }
    lf_tensor *count = lf_stability_constant(s, 2, LF_DIMS(1, T), seen);
    lf_stability_output(s, "density", lf_density(s->tape, x, count), sigma);
    lf_stability_gradient(s, "t", dt);
}

static const lf_stability_case cases[] = {
    {"softmax", "logits", softmax, LOGITS},
    {"softmax, saturated", "logit", saturated_softmax, LF_STABILITY_AT(1, 5, 10, 20, 40, 60)},
    {"ray attention", "logits", ray_attention, LOGITS},
    {"ray attention, arrays", "logits", ray_attention_arrays, LOGITS},
    {"cross attention: logits", "logits", cross_attention, LOGITS},
    {"block attention: logits", "logits", cross_attention_blocks, LOGITS},
    {"along-ray attention", "logits", along_ray_attention, LOGITS},
    {"IBRNet attention", "logits", sample_attention, LOGITS},
    {"IBRNet colours", "logits", colour_softmax, LOGITS},
    {"density", "last number", density, LOGITS},
    {"volume", "density", volume, DENSITIES},
    {"volume on white", "density", volume_white, DENSITIES},
};

const lf_stability_table lf_stability_attention = {cases, sizeof cases / sizeof *cases};
