/* stability_degenerate.c: zero vectors, variances of nothing, views that see nothing.
 *                                                                    [method.md 2.9, 4.2, 4.4, 5c]
 * Vectors shrink to 0 where a norm has its kink; features of one view or of equal views have no
 * variance; directions of views agree; all views are masked.
 */
#include "autograd/ops.h"
#include "bench/stability.h"
#include "layers/ibrnet.h"
#include "layers/light_blocks.h"
#include "models/ray_samples.h"

#define SIZES LF_STABILITY_AT(1, 1e-2, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-12, 1e-20, 1e-30, 0)
#define MEANS LF_STABILITY_AT(0, 1, 1e1, 1e2, 1e3, 1e4)

enum { ROWS = 3, C = 4, PLANES = 5 };
static const lf_types types = {.count = 3, .omega = {0, 1, 4}};

/* Vectors of the size of the parameter, for functions that bend at `bend`. */
static lf_tensor *vectors(lf_stability *s, const char *name, int rank, const long *dim, double bend)
{
    const double size = s->parameter;
    return lf_stability_small(s, name, rank, dim, size, size > bend ? size : bend);
}

/* ---- zero vectors ---------------------------------------------------------------------------- */

/* sqrt(|v|^2 + 1e-12), with its gradient. */
static void vector_norm(lf_stability *s)
{
    lf_tensor *v = vectors(s, "v", 3, LF_DIMS(ROWS, 3, C), 1e-6);
    long double n[ROWS * C], dv[ROWS * 3 * C];
    for (int i = 0; i < ROWS * C; i++) {
        long double sum = 1e-12L;
        const int at = i / C * 3 * C + i % C;
        for (int a = 0; a < 3; a++)
            sum += (long double)v->value[at + a * C] * v->value[at + a * C];
        n[i] = sqrtl(sum);
        for (int a = 0; a < 3; a++)
            dv[at + a * C] = lf_stability_weight(0, i) * v->value[at + a * C] / n[i];
    }
    lf_stability_output(s, "norm", lf_vector_norm(s->tape, v), n);
    lf_stability_gradient(s, "v", dv);
}

/* v ReLU(n + beta) / n with n = sqrt(|v|^2 + 1e-8). */
static void norm_relu(lf_stability *s)
{
    lf_tensor *v = vectors(s, "v", 3, LF_DIMS(ROWS, 3, C), 1e-4);
    lf_tensor *beta = lf_stability_input(s, "beta", 1, LF_DIMS(C), 1);
    long double y[ROWS * 3 * C], dv[ROWS * 3 * C], db[C] = {0};
    for (int i = 0; i < ROWS * C; i++) {
        long double sum = 1e-8L, dot = 0, b = beta->value[i % C];
        const int at = i / C * 3 * C + i % C;
        for (int a = 0; a < 3; a++) {
            const int k = at + a * C;
            sum += (long double)v->value[k] * v->value[k];
            dot += lf_stability_weight(0, k) * v->value[k];
        }
        const long double n = sqrtl(sum), on = n + b > 0;
        for (int a = 0; a < 3; a++) {
            const int k = at + a * C;
            y[k] = on * (n + b) / n * v->value[k];
            dv[k] =
                on * ((n + b) / n * lf_stability_weight(0, k) - b / n / n / n * dot * v->value[k]);
        }
        db[i % C] += on * dot / n;
    }
    lf_stability_output(s, "v", lf_norm_relu(s->tape, v, beta), y);
    lf_stability_gradient(s, "v", dv);
    lf_stability_gradient(s, "beta", db);
}

/* The gated nonlinearity and the vector neuron of the reconstruction network. */
static void gated(lf_stability *s)
{
    lf_nonlinear layer;
    lf_nonlinear_init(s->store, &layer, "gated", LF_GATED, 3, C);
    lf_stability_parameters(s);
    const lf_field x = {lf_stability_input(s, "scalars", 2, LF_DIMS(ROWS, 3), 1),
                        vectors(s, "vectors", 3, LF_DIMS(ROWS, 3, C), 2e-4)};
    const lf_field y = lf_nonlinear_apply(s->tape, &layer, x);
    lf_stability_output(s, "scalars", y.scalar, NULL);
    lf_stability_output(s, "vectors", y.vector, NULL);
}

static void vector_neuron(lf_stability *s)
{
    lf_vector_neuron layer;
    lf_vector_neuron_init(s->store, &layer, "neuron", C);
    lf_stability_parameters(s);
    lf_tensor *v = vectors(s, "v", 3, LF_DIMS(ROWS, 3, C), 1e-2);
    lf_stability_output(s, "invariants", lf_vector_neuron_apply(s->tape, &layer, v), NULL);
}

/* Fields along a ray: norms and gates, the norm nonlinearity, the norm of a row. */
static void so2_gated(lf_stability *s)
{
    lf_so2_gated layer;
    lf_so2_gated_init(s->store, &layer, "gated", &types, C);
    lf_stability_parameters(s);
    lf_tensor *x = vectors(s, "x", 2, LF_DIMS(ROWS, PLANES * C), 2e-4);
    lf_stability_output(s, "field", lf_so2_gated_apply(s->tape, &layer, &types, x), NULL);
}

static void so2_norms(lf_stability *s)
{
    lf_tensor *x = vectors(s, "x", 2, LF_DIMS(ROWS, PLANES * C), 1e-2);
    lf_tensor *beta = lf_stability_input(s, "beta", 1, LF_DIMS(3 * C), 1);
    lf_tensor *gain = lf_stability_input(s, "gain", 1, LF_DIMS(3 * C), 1);
    lf_stability_output(s, "norm", lf_so2_layer_norm(s->tape, &types, x, gain), NULL);
    lf_stability_output(s, "relu", lf_so2_norm_relu(s->tape, &types, x, beta), NULL);
}

/* ---- no variance ----------------------------------------------------------------------------- */

/* IBRNet's layer norm of rows that are constant but for 1e-3: the mean is taken off first. */
static void layer_norm(lf_stability *s)
{
    enum { N = 16 };
    double x[ROWS * N];
    long double y[ROWS * N];
    for (int i = 0; i < ROWS * N; i++)
        x[i] = s->parameter + (i < N ? 0 : 1e-3 * cos(2.3 * i));
    lf_tensor *t = lf_stability_given(s, "x", 2, LF_DIMS(ROWS, N), x, 0.03);
    lf_tensor *gain = lf_stability_input(s, "gain", 1, LF_DIMS(N), 1);
    lf_tensor *bias = lf_stability_input(s, "bias", 1, LF_DIMS(N), 1);
    for (int r = 0; r < ROWS; r++) {
        long double mean = 0, variance = 0;
        for (int i = 0; i < N; i++)
            mean += (long double)t->value[r * N + i] / N;
        for (int i = 0; i < N; i++)
            variance += (t->value[r * N + i] - mean) * (t->value[r * N + i] - mean) / N;
        for (int i = 0; i < N; i++)
            y[r * N + i] = (t->value[r * N + i] - mean) / sqrtl(variance + 1e-6L) * gain->value[i] +
                           bias->value[i];
    }
    s->condition = 1 + s->parameter / 1e-3;
    lf_stability_output(s, "y", lf_layer_norm(s->tape, t, gain, bias), y);
}

enum { N = 1, S = 5, V = 4, F = 3 };

/* Lanes of S samples of one ray; sample k is seen by `views` of the views, no more than k of them
 * with `few`. Inner products are those of directions that differ by `angle`. */
static lf_lanes make_lanes(lf_stability *s, int views, bool few, double angle)
{
    double mask[N * S * V], difference[N * S * V * 4];
    for (int i = 0; i < N * S * V; i++) {
        const int v = i % V, k = i / V;
        const double turn = angle * (0.5 + 0.3 * v + 0.1 * k);
        mask[i] = v < views && (!few || v < k);
        difference[4 * i] = 1;
        difference[4 * i + 1] = difference[4 * i + 2] = 0;
        difference[4 * i + 3] = cos(turn);
    }
    return lf_lanes_make(s->tape, lf_stability_constant(s, 3, LF_DIMS(N, S, V), mask),
                         lf_stability_constant(s, 4, LF_DIMS(N, S, V, 4), difference));
}

/* Mean and variance over equal views, and over one view, of features of that mean. */
static void moments(lf_stability *s, int views)
{
    const lf_lanes lanes = make_lanes(s, views, false, 0.3);
    double x[S * V * F], w[S * V];
    for (int i = 0; i < S * V; i++) {
        w[i] = i % V < views ? 1.0 / views : 0;
        for (int c = 0; c < F; c++)
            x[i * F + c] = s->parameter * (1 + 0.25 * c + 0.125 * (i / V));
    }
    lf_tensor *values = lf_stability_given(s, "x", 4, LF_DIMS(N, S, V, F), x, 1);
    lf_tensor *weights = lf_stability_given(s, "w", 4, LF_DIMS(N, S, V, 1), w, 1);
    lf_tensor *m =
        lf_ibrnet_moments(s->tape, lf_lanes_add_rows(s->tape, values, NULL, &lanes),
                          lf_lanes_add_rows(s->tape, weights, NULL, &lanes), &lanes, true);
    lf_stability_output(s, "moments", lf_lanes_to_rows(s->tape, m, &lanes), NULL);
}

static void moments_of_one(lf_stability *s)
{
    moments(s, 1);
}

static void moments_of_equals(lf_stability *s)
{
    moments(s, V);
}

/* ---- directions of views that agree ---------------------------------------------------------- */

/* The directions' inner product less 1, -|a - b|^2 / 2, of a sample's directions to the target and
 * to a source's centre. */
static long double exact_behind(const double target[3], const double point[3],
                                const double centre[3])
{
    long double to[3], far = 0, square = 0;
    for (int a = 0; a < 3; a++) {
        to[a] = (long double)centre[a] - point[a];
        far += to[a] * to[a];
    }
    for (int a = 0; a < 3; a++) {
        const long double e = target[a] - to[a] / sqrtl(far);
        square += e * e;
    }
    return -square / 2;
}

/* Weights of V views of which these numbers are known, for the sharpness s. */
static void exact_weights(long double s, const long double behind[V], long double w[V])
{
    long double least = 0, sum = 1e-8L;
    for (int v = 0; v < V; v++)
        least = behind[v] < least ? behind[v] : least;
    for (int v = 0; v < V; v++)
        sum += w[v] = expl(s * least) * expm1l(s * (behind[v] - least));
    for (int v = 0; v < V; v++)
        w[v] /= sum;
}

/* The weights in rows [N, S, V]; every view sees every sample. */
static lf_tensor *weights_of(lf_stability *s, lf_tensor *sharpness, lf_tensor *differences)
{
    lf_tensor *mask = lf_tensor_new(s->tape, 3, LF_DIMS(N, S, V));
    for (int i = 0; i < S * V; i++)
        mask->value[i] = 1;
    const lf_lanes lanes = lf_lanes_make(s->tape, mask, differences);
    lf_tensor *w = lf_ibrnet_weights(s->tape, sharpness, &lanes);
    w = lf_reshape(s->tape, w, 3, LF_DIMS(lanes.blocks, V, LF_LANES));
    return lf_lanes_to_rows(s->tape, w, &lanes);
}

/* IBRNet's weights of views that see a sample at angles of that size from the target's: by the
 * samples' geometry, as the renderer makes it. */
static void ibrnet_weights(lf_stability *s)
{
    const double d[3] = {0, 0.6, 0.8}, back[3] = {0, -0.6, -0.8}, o[3] = {-0.1, 0.2, 0.3};
    const double stretch = 1, sharp = 0.25;
    double depth[S], axes[9];
    lf_source source[V] = {{.width = 9, .height = 9}};
    lf_ray_axes(d, axes);
    for (int k = 0; k < S; k++)
        depth[k] = 2 + 0.5 * k;
    for (int v = 0; v < V; v++)
        for (int a = 0; a < 3; a++)
            source[v].centre[a] = o[a] + 3 * s->parameter * (0.4 + 0.2 * v) * axes[3 * a + v % 2];
    const lf_target_rays rays = {1, o, d, &stretch, 1, 5};
    const lf_seen_samples seen = lf_see_samples(s->tape, &rays, 0, 1, S, depth, V, source);
    lf_tensor *sharpness = lf_stability_given(s, "s", 1, LF_DIMS(1), &sharp, 1);
    lf_tensor *w = weights_of(s, sharpness, lf_ray_differences(s->tape, &rays, 0, 1, S, &seen, V));
    long double behind[V], exact[S * V];
    for (int k = 0; k < S; k++) {
        for (int v = 0; v < V; v++)
            behind[v] = exact_behind(back, seen.point + 3 * k, source[v].centre);
        exact_weights(sharpness->value[0], behind, exact + k * V);
    }
    s->geometry = 1 / s->parameter / s->parameter;
    lf_stability_output(s, "weight", w, exact);
}

/* ---- nothing seen ---------------------------------------------------------------------------- */

/* So many views see anything: the reconstruction network's layers. */
static void unseen_points(lf_stability *s)
{
    enum { Q = 2 };
    double d[Q * V * 3] = {0}, mask[Q * V];
    for (int i = 0; i < Q * V; i++) {
        mask[i] = i % V < s->parameter;
        d[3 * i] = mask[i] > 0 ? 0.6 : 0;
        d[3 * i + 1] = mask[i] > 0 ? 0.8 : 0;
    }
    const lf_ray_geometry rays = {Q, V, lf_stability_constant(s, 3, LF_DIMS(Q, V, 3), d),
                                  lf_stability_constant(s, 2, LF_DIMS(Q, V), mask)};
    const lf_transformer_config config = {
        .scalars = 4, .vectors = 2, .heads = 2, .nonlinearity = LF_NORM_RELU};
    lf_ray_convolution convolution;
    lf_transformer_block block;
    lf_ray_convolution_init(s->store, &convolution, "convolution", F, 4, 2);
    lf_transformer_block_init(s->store, &block, "block", &config, F, 0);
    lf_stability_parameters(s);
    lf_field ray = {lf_stability_input(s, "seen", 3, LF_DIMS(Q, V, F), 1), NULL};
    lf_field point = lf_ray_convolution_apply(s->tape, &convolution, ray.scalar, &rays);
    lf_transformer_block_apply(s->tape, &block, &ray, &point, &rays);
    s->step = s->parameter > 0 ? 1e-4 : 0; /* norms of zero vectors bend at 1e-4 */
    lf_stability_output(s, "scalars", point.scalar, NULL);
    lf_stability_output(s, "vectors", point.vector, NULL);
}

static const lf_stability_case cases[] = {
    {"vector norm", "size", vector_norm, SIZES},
    {"norm nonlinearity", "size", norm_relu, SIZES},
    {"gated nonlinearity", "size", gated, SIZES},
    {"vector neuron", "size", vector_neuron, SIZES},
    {"gates along a ray", "size", so2_gated, SIZES},
    {"norms along a ray", "size", so2_norms, SIZES},
    {"layer norm of a constant", "mean", layer_norm, MEANS},
    {"moments of one view", "mean", moments_of_one, MEANS},
    {"moments of equal views", "mean", moments_of_equals, MEANS},
    {"IBRNet weights", "angle", ibrnet_weights, .count = 6,
     .at = {1, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5}},
    {"point of few views", "views", unseen_points, LF_STABILITY_AT(0, 1, 2)},
};

const lf_stability_table lf_stability_degenerate = {cases, sizeof cases / sizeof *cases};
