/* stability_sums.c: sums of up to a million terms: sums, losses, gradients of shared weights,
 * statistics of images. Terms are positive, so that a sum has the condition 1: what a plain sum in
 * float loses, up to one last place a term, is its own.
 */
#include "autograd/ops.h"
#include "autograd/ops_image.h"
#include "bench/stability.h"
#include "layers/layers.h"

#define TERMS LF_STABILITY_AT(1e3, 1e4, 1e5, 1e6)

/* Uniform in (0.2, 1.2), floats. */
static double *positive(lf_stability *s, long n)
{
    double *x = lf_alloc(s->tape, (size_t)n * sizeof *x);
    lf_stream r = lf_stream_at(3, LF_RANDOM_TEST, 0, 0);
    for (long i = 0; i < n; i++)
        x[i] = (double)(float)(0.2 + lf_uniform(&r));
    s->step = 0;
    return x;
}

static void sum(lf_stability *s)
{
    const long n = (long)s->parameter;
    lf_tensor *x = lf_stability_given(s, "x", 1, LF_DIMS(n), positive(s, n), 1);
    long double exact = 0;
    for (long i = 0; i < n; i++)
        exact += x->value[i];
    lf_stability_output(s, "sum", lf_sum(s->tape, x), &exact);
}

static void squared_error(lf_stability *s)
{
    const long n = (long)s->parameter;
    lf_tensor *x = lf_stability_given(s, "x", 2, LF_DIMS(n, 1), positive(s, n), 1);
    float *target = lf_alloc(s->tape, (size_t)n * sizeof *target);
    long double exact = 0, part = 0; /* one long sum of squares would miss 10 places of a double */
    for (long i = 0; i < n; i++) {
        target[i] = (float)(0.25 * (double)(i % 5));
        const long double d = (long double)x->value[i] - target[i];
        part += d * d;
        if (i % 1000 == 999) {
            exact += part;
            part = 0;
        }
    }
    lf_stability_output(s, "loss", lf_squared_error(s->tape, x, target, NULL), &exact);
}

static void sdf_loss(lf_stability *s)
{
    static const lf_sdf_loss_config config = {10, 0.1, 0.01, 4};
    const long n = (long)s->parameter;
    lf_tensor *x = lf_stability_given(s, "x", 2, LF_DIMS(n, 1), positive(s, n), 1);
    float *sdf = lf_alloc(s->tape, (size_t)n * sizeof *sdf);
    long double exact = 0;
    for (long i = 0; i < n; i++) {
        sdf[i] = (float)(0.01 * (double)(i % 5) - 0.02);
        exact +=
            (sdf[i] <= 0.01 ? 4 : 1) * fabsl((long double)x->value[i] - 10 * (long double)sdf[i]);
    }
    lf_stability_output(s, "loss", lf_sdf_loss(s->tape, x, sdf, &config), &exact);
}

/* The gradients of a linear map's matrix and bias. */
static void linear(lf_stability *s)
{
    enum { IN = 4, OUT = 3 };
    const long n = (long)s->parameter / IN;
    lf_tensor *x = lf_stability_given(s, "x", 2, LF_DIMS(n, IN), positive(s, n * IN), 1);
    lf_tensor *w = lf_stability_given(s, "w", 2, LF_DIMS(IN, OUT), positive(s, IN * OUT), 1);
    lf_tensor *b = lf_stability_given(s, "b", 1, LF_DIMS(OUT), positive(s, OUT), 1);
    long double dw[IN * OUT] = {0}, db[OUT] = {0};
    for (long r = 0; r < n; r++)
        for (int o = 0; o < OUT; o++) {
            const double g = lf_stability_weight(0, r * OUT + o);
            db[o] += g;
            for (int i = 0; i < IN; i++)
                dw[i * OUT + o] += (long double)x->value[r * IN + i] * g;
        }
    lf_stability_output(s, "y", lf_linear(s->tape, x, w, b, LF_IDENTITY), NULL);
    lf_stability_gradient(s, "w", dw);
    lf_stability_gradient(s, "b", db);
}

/* The gradient of numbers that all rows share: shifts of norms. */
static void norm_shift(lf_stability *s)
{
    enum { C = 2 };
    const long n = (long)s->parameter / (3 * C);
    lf_tensor *v = lf_stability_given(s, "v", 3, LF_DIMS(n, 3, C), positive(s, 3 * C * n), 1);
    lf_tensor *beta = lf_stability_given(s, "beta", 1, LF_DIMS(C), positive(s, C), 1);
    long double db[C] = {0};
    for (long r = 0; r < n; r++)
        for (int i = 0; i < C; i++) {
            long double square = 1e-8L, dot = 0;
            for (int a = 0; a < 3; a++) {
                const long k = (3 * r + a) * C + i;
                square += (long double)v->value[k] * v->value[k];
                dot += lf_stability_weight(0, k) * (long double)v->value[k];
            }
            db[i] += dot / sqrtl(square);
        }
    lf_stability_output(s, "v", lf_norm_relu(s->tape, v, beta), NULL);
    lf_stability_gradient(s, "beta", db);
}

/* A convolution's filter and bias, over all pixels of an image. */
static void convolution(lf_stability *s)
{
    enum { OUT = 2 };
    const long edge = lround(sqrt(s->parameter)), n = edge * edge;
    lf_tensor *x = lf_stability_given(s, "x", 4, LF_DIMS(1, edge, edge, 1), positive(s, n), 1);
    lf_tensor *w = lf_stability_given(s, "w", 4, LF_DIMS(3, 3, 1, OUT), positive(s, 9 * OUT), 1);
    lf_tensor *b = lf_stability_given(s, "b", 1, LF_DIMS(OUT), positive(s, OUT), 1);
    long double dw[9 * OUT] = {0}, db[OUT] = {0};
    for (long i = 0; i < n * OUT; i++) {
        const double g = lf_stability_weight(0, i);
        const long row = i / OUT / edge, col = i / OUT % edge;
        db[i % OUT] += g;
        for (int k = 0; k < 9; k++) {
            const long r = row + k / 3 - 1, c = col + k % 3 - 1;
            if (r >= 0 && r < edge && c >= 0 && c < edge)
                dw[k * OUT + i % OUT] += g * (long double)x->value[r * edge + c];
        }
    }
    lf_stability_output(s, "y", lf_conv2d(s->tape, x, w, b, 1, 1, LF_IDENTITY), NULL);
    lf_stability_gradient(s, "w", dw);
    lf_stability_gradient(s, "b", db);
}

/* Mean and variance of an image's field of mean 0.7. */
static void field_norm(lf_stability *s)
{
    const long edge = lround(sqrt(s->parameter)), n = edge * edge;
    const double one = 1, zero = 0;
    lf_tensor *x = lf_stability_given(s, "x", 4, LF_DIMS(1, edge, edge, 1), positive(s, n), 1);
    lf_tensor *gamma = lf_stability_given(s, "gamma", 1, LF_DIMS(1), &one, 1);
    lf_tensor *beta = lf_stability_given(s, "beta", 1, LF_DIMS(1), &zero, 1);
    const lf_field_norm_options o = {.mode = LF_NORM_INSTANCE, .group = 1, .epsilon = 1e-5};
    long double *y = lf_alloc(s->tape, (size_t)n * sizeof *y), mean = 0, variance = 0;
    for (long i = 0; i < n; i++)
        mean += (long double)x->value[i] / n;
    for (long i = 0; i < n; i++)
        variance += (x->value[i] - mean) * (x->value[i] - mean) / n;
    long double dgamma = 0, terms = 0;
    for (long i = 0; i < n; i++) {
        const long double u = (x->value[i] - mean) / sqrtl(variance + 1e-5L);
        y[i] = u * gamma->value[0] + beta->value[0];
        dgamma += u * lf_stability_weight(0, i);
        terms += fabsl(u * lf_stability_weight(0, i));
    }
    lf_stability_gradient(s, "gamma", &dgamma);
    lf_stability_condition(s, "gamma", (double)(terms / fabsl(dgamma)));
    lf_stability_output(s, "y", lf_field_norm(s->tape, x, gamma, beta, NULL, &o), y);
}

static const lf_stability_case cases[] = {
    {"sum", "terms", sum, TERMS},
    {"squared error", "terms", squared_error, TERMS},
    {"loss of distances", "terms", sdf_loss, TERMS},
    {"linear map", "terms", linear, TERMS},
    {"norms' shift", "terms", norm_shift, TERMS},
    {"convolution", "pixels", convolution, TERMS},
    {"field norm", "pixels", field_norm, TERMS},
};

const lf_stability_table lf_stability_sums = {cases, sizeof cases / sizeof *cases};
