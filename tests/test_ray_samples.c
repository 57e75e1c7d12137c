/* test_ray_samples.c: what happens between the samples of one ray, against the definitions:
 * attention with many keys, volume rendering.                              [method.md 2.8, 4.9,
 * 5b.1, 5b.5]
 */
#include "autograd/random.h"
#include "layers/light_field.h"
#include "tests/close.h"

enum { C = 4, T = 9, P = 2 * T - 1 };
#define EXACT (sizeof(lf_real) == 8) /* the double build */
static const lf_types types = {.count = T, .omega = {0, 1, 2, 4, 8, 16, 32, 64, 128}};

/* ---- attention along the ray ---- */

enum { LONG = 37 }; /* samples: several blocks of keys and a part of one */

/* c(D) x of number p of a row, straight from the definition. */
static double kernel_times(const lf_real *w, double distance, const lf_real *x, long p)
{
    double c[2] = {1, 0};
    const long plane = p / C, re = plane ? p - (plane % 2 ? 0 : C) : p;
    for (int b = 0; b < LF_ALONG_BASIS; b++) {
        const double at = (distance + 1) * (LF_ALONG_BASIS - 1) / 2 - b;
        c[0] += exp(-at * at / 2) * (double)w[b * P * C + re];
        c[1] += plane ? exp(-at * at / 2) * (double)w[b * P * C + re + C] : 0;
    }
    if (!plane)
        return c[0] * (double)x[p];
    return plane % 2 ? c[0] * (double)x[p] - c[1] * (double)x[p + C]
                     : c[0] * (double)x[p] + c[1] * (double)x[p - C];
}

/* One query of one head group against the definition, in double. */
static void reference_along(const lf_light_geometry *g, lf_tensor *const *in, long i, int heads,
                            double out[P * C])
{
    double a[LONG], sum;
    for (int h = 0; h < heads; h++) {
        sum = 0;
        for (long j = 0; j < LONG; j++) {
            const double d = (double)g->depth->value[j] - (double)g->depth->value[i];
            double logit = 0;
            for (long p = 0; p < P * C; p++)
                if (p % C * heads / C == h)
                    logit += (double)in[0]->value[i * P * C + p] *
                             kernel_times(in[3]->value, d, in[1]->value + j * P * C, p);
            a[j] = g->count->value[j] >= LF_KEY_VIEWS ? exp(logit / sqrt(P * C / heads)) : 0;
            sum += a[j];
        }
        for (long p = 0; p < P * C; p++) {
            if (p % C * heads / C != h)
                continue;
            out[p] = 0;
            for (long j = 0; j < LONG; j++) {
                const double d = (double)g->depth->value[j] - (double)g->depth->value[i];
                out[p] += a[j] / sum * kernel_times(in[4]->value, d, in[2]->value + j * P * C, p);
            }
        }
    }
}

static void long_rays_follow_the_definition(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    lf_tensor *count = lf_tensor_new(tape, 2, LF_DIMS(1, LONG));
    lf_tensor *depth = lf_tensor_new(tape, 2, LF_DIMS(1, LONG)), *in[5];
    lf_stream r = lf_stream_at(13, LF_RANDOM_TEST, 26, 0);
    for (int j = 0; j < LONG; j++) {
        depth->value[j] = (lf_real)((j + lf_uniform(&r)) / LONG);
        count->value[j] = (lf_real)(j % 7);
    }
    const lf_light_geometry g = {1, LONG, 1, types, NULL, NULL, NULL, count, depth};
    for (int k = 0; k < 5; k++) {
        in[k] = lf_tensor_new(tape, 2, LF_DIMS(k < 3 ? LONG : LF_ALONG_BASIS, P * C));
        for (long i = 0; i < in[k]->size; i++)
            in[k]->value[i] = (lf_real)(0.5 * lf_normal(&r));
    }
    const lf_tensor *y = lf_along_ray_attention(tape, in[0], in[1], in[2], in[3], in[4], &g, 2);
    double expected[P * C];
    for (long i = 0; i < LONG; i += 6) {
        reference_along(&g, in, i, 2, expected);
        assert_below(relative_error(y->value + i * P * C, expected, P * C), EXACT ? 1e-12 : 1e-5);
    }
    lf_tape_free(tape);
}

/* ---- volume rendering ---- */

enum { MOST = 1024 };

/* Colours and weights in double, straight from the definition. */
static void reference_volume(long n, const lf_real *sigma, const lf_real *colour, double *weight,
                             double out[3])
{
    long double sum = 0;
    for (int a = 0; a < 3; a++)
        out[a] = 0;
    for (long i = 0; i < n; i++) {
        weight[i] = (double)(expl(-sum) * -expm1l(-(long double)sigma[i]));
        for (int a = 0; a < 3; a++)
            out[a] += weight[i] * (double)colour[3 * i + a];
        sum += (long double)sigma[i];
    }
}

static lf_rendered render(lf_tape *tape, long n, lf_real *sigma, lf_real *colour, lf_real *depth,
                          bool white)
{
    return lf_volume(tape, lf_leaf(tape, 2, LF_DIMS(1, n), sigma, NULL),
                     lf_leaf(tape, 3, LF_DIMS(1, n, 3), colour, NULL),
                     lf_leaf(tape, 2, LF_DIMS(1, n), depth, NULL), white);
}

/* Densities of every size between 0 and 1e6, 1 to 1024 samples. */
static void weights_of_all_densities(void **state)
{
    (void)state;
    static const double scale[] = {0, 1e-9, 1e-4, 1, 30, 1e6};
    lf_real sigma[MOST], colour[3 * MOST], depth[MOST];
    double weight[MOST], expected[3];
    const double tolerance = EXACT ? 1e-14 : 1e-6;
    lf_tape *tape = lf_tape_create();
    for (long n = 1; n <= MOST; n *= 2)
        for (int kind = 0; kind < 7; kind++) {
            lf_stream r = lf_stream_at((uint64_t)n, LF_RANDOM_TEST, 22, (uint64_t)kind);
            for (long i = 0; i < n; i++) {
                const double size = scale[kind < 6 ? kind : lf_index(&r, 6)];
                sigma[i] = (lf_real)(size * lf_uniform(&r));
                depth[i] = (lf_real)(2 + (double)i / MOST);
                for (int a = 0; a < 3; a++)
                    colour[3 * i + a] = (lf_real)lf_uniform(&r);
            }
            lf_tape_reset(tape);
            const lf_rendered black = render(tape, n, sigma, colour, depth, false);
            const lf_rendered white = render(tape, n, sigma, colour, depth, true);
            reference_volume(n, sigma, colour, weight, expected);
            double opacity = 0, middle = 0;
            for (long i = 0; i < n; i++) {
                assert_close(black.weight->value[i], weight[i], EXACT ? 1e-10 : 1e-5, 1e-30);
                opacity += weight[i];
                middle += weight[i] * (double)depth[i];
            }
            for (int a = 0; a < 3; a++) {
                assert_close(black.colour->value[a], expected[a], 0, tolerance);
                assert_close(white.colour->value[a], expected[a] + 1 - opacity, 0, tolerance);
            }
            assert_close(black.depth->value[0], middle, 0, 3 * tolerance);
        }
    lf_tape_free(tape);
}

/* Exact: nothing there is the background, an opaque sample behind nothing is its colour. */
static void empty_and_opaque_rays(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    lf_real sigma[4] = {0, 0, 0, 0}, colour[12], depth[4] = {1, 2, 3, 4};
    for (int i = 0; i < 12; i++)
        colour[i] = (lf_real)(i / 16.0);
    assert_true(render(tape, 4, sigma, colour, depth, false).colour->value[1] == 0);
    assert_true(render(tape, 4, sigma, colour, depth, true).colour->value[1] == 1);
    sigma[2] = (lf_real)1e6;
    sigma[3] = 5;
    for (int white = 0; white < 2; white++) {
        const lf_rendered r = render(tape, 4, sigma, colour, depth, white);
        for (int a = 0; a < 3; a++)
            assert_true(r.colour->value[a] == colour[6 + a]);
        assert_true(r.depth->value[0] == 3);
        assert_true(r.weight->value[3] < 1e-30);
    }
    lf_tape_free(tape);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(long_rays_follow_the_definition),
        cmocka_unit_test(weights_of_all_densities),
        cmocka_unit_test(empty_and_opaque_rays),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
