/* test_image_metrics.c: PSNR, SSIM and pixel variance against closed forms and a plain loop. */
#include <omp.h>
#include <string.h>

#include "autograd/random.h"
#include "eval/image_metrics.h"
#include "tests/close.h"

static lf_image *flat(int width, int height, int channels, float value)
{
    lf_image *image = lf_image_create(width, height, channels);
    for (long i = 0; i < (long)width * height * channels; i++)
        image->pixel[i] = value;
    return image;
}

/* Uniform values in [low, high]. */
static lf_image *noise(int width, int height, int channels, uint64_t seed, double low, double high)
{
    lf_image *image = lf_image_create(width, height, channels);
    lf_stream s = lf_stream_at(seed, LF_RANDOM_TEST, 0, 0);
    for (long i = 0; i < (long)width * height * channels; i++)
        image->pixel[i] = (float)(low + (high - low) * lf_uniform(&s));
    return image;
}

static double figure(lf_status (*metric)(const lf_image *, const lf_image *, double *, lf_error *),
                     const lf_image *a, const lf_image *b)
{
    double value = -1;
    lf_error err = {""};
    if (metric(a, b, &value, &err) != LF_OK)
        fail_msg("%s", err.text);
    return value;
}

/* Constant images p and q: mse (p - q)^2, and SSIM (2 p q + c1) / (p p + q q + c1). */
static void constants(void **state)
{
    (void)state;
    lf_image *a = flat(20, 13, 3, 0.25f), *b = flat(20, 13, 3, 0.75f);
    assert_close(figure(lf_psnr, a, b), 20 * log10(2), 1e-12, 0);
    assert_close(figure(lf_ssim, a, b), (2 * 0.25 * 0.75 + 1e-4) / (0.0625 + 0.5625 + 1e-4), 1e-12,
                 0);
    assert_close(figure(lf_psnr, a, a), 100, 0, 0);
    assert_close(figure(lf_ssim, a, a), 1, 1e-14, 0);
    lf_image_free(a);
    lf_image_free(b);
}

/* A change of 1e-6 would be 120 dB: the figure stays at 100. Values beyond [0, 1] are cut. */
static void limits(void **state)
{
    (void)state;
    lf_image *a = flat(11, 11, 3, 0.5f), *b = flat(11, 11, 3, 0.500001f);
    assert_close(figure(lf_psnr, a, b), 100, 0, 0);
    lf_image *low = flat(11, 11, 3, -3), *high = flat(11, 11, 3, 7);
    assert_close(figure(lf_psnr, low, high), 0, 0, 1e-12);
    lf_image *images[] = {a, b, low, high};
    for (int i = 0; i < 4; i++)
        lf_image_free(images[i]);
}

/* An image plus a constant d: mse d^2; the structure is the same, so the rest of SSIM is 1. */
static void shift(void **state)
{
    (void)state;
    lf_image *a = noise(40, 30, 3, 1, 0.2, 0.7), *b = lf_image_create(40, 30, 3);
    for (long i = 0; i < 3 * 40 * 30; i++)
        b->pixel[i] = a->pixel[i] + 0.125f;
    assert_close(figure(lf_psnr, a, b), -20 * log10(0.125), 1e-7, 0);
    const double s = figure(lf_ssim, a, b);
    assert_true(s < 1 && s > (2 * 0.2 * 0.325 + 1e-4) / (0.04 + 0.325 * 0.325 + 1e-4));
    lf_image_free(a);
    lf_image_free(b);
}

/* Noise of standard deviation s on a grey image: mse s^2 with n = 3 * 200 * 200 samples. */
static void additive_noise(void **state)
{
    (void)state;
    const double deviation = 0.05;
    lf_image *a = flat(200, 200, 3, 0.5f), *b = flat(200, 200, 3, 0.5f);
    lf_stream s = lf_stream_at(2, LF_RANDOM_TEST, 0, 0);
    for (long i = 0; i < 3 * 200 * 200; i++)
        b->pixel[i] += (float)(deviation * lf_normal(&s));
    /* the variance of n samples is off by about sqrt(2 / n) = 0.4 %, 0.018 dB */
    assert_close(figure(lf_psnr, a, b), -20 * log10(deviation), 0, 0.06);
    /* a has no variance: SSIM is about c2 / (v + c2), v a little below s^2 in such a window */
    const double ssim = figure(lf_ssim, a, b), c2 = 0.0009;
    assert_true(ssim > c2 / (deviation * deviation + c2) && ssim < 0.32);
    lf_image_free(a);
    lf_image_free(b);
}

/* SSIM of channel c in the window with top left corner (column, row), by its definition. */
static double window_ssim(const lf_image *a, const lf_image *b, int column, int row, int c)
{
    double total = 0, mean_a = 0, mean_b = 0, var_a = 0, var_b = 0, both = 0;
    for (int pass = 0; pass < 3; pass++)
        for (int i = 0; i < 121; i++) {
            const int y = i / 11, x = i % 11;
            const double w = exp(-((y - 5) * (y - 5) + (x - 5) * (x - 5)) / 4.5);
            const double p = lf_image_at(a, column + x, row + y)[c];
            const double q = lf_image_at(b, column + x, row + y)[c];
            if (pass == 0) {
                total += w;
            } else if (pass == 1) {
                mean_a += w * p / total;
                mean_b += w * q / total;
            } else {
                var_a += w * (p - mean_a) * (p - mean_a) / total;
                var_b += w * (q - mean_b) * (q - mean_b) / total;
                both += w * (p - mean_a) * (q - mean_b) / total;
            }
        }
    return (2 * mean_a * mean_b + 1e-4) * (2 * both + 9e-4) /
           ((mean_a * mean_a + mean_b * mean_b + 1e-4) * (var_a + var_b + 9e-4));
}

static void against_a_plain_loop(void **state)
{
    (void)state;
    const int sizes[][2] = {{11, 11}, {11, 17}, {26, 19}};
    for (int k = 0; k < 3; k++) {
        const int w = sizes[k][0], h = sizes[k][1];
        lf_image *a = noise(w, h, 3, 3, 0, 1), *b = noise(w, h, 3, 4, 0, 1);
        for (long i = 0; i < 3L * w * h; i++)
            b->pixel[i] = 0.6f * a->pixel[i] + 0.4f * b->pixel[i];
        double sum = 0;
        for (int row = 0; row + 11 <= h; row++)
            for (int column = 0; column + 11 <= w; column++)
                for (int c = 0; c < 3; c++)
                    sum += window_ssim(a, b, column, row, c);
        assert_close(figure(lf_ssim, a, b), sum / (3.0 * (w - 10) * (h - 10)), 1e-12, 0);
        lf_image_free(a);
        lf_image_free(b);
    }
}

static void symmetric_and_for_any_threads(void **state)
{
    (void)state;
    const int before = omp_get_max_threads();
    lf_image *a = noise(67, 45, 3, 5, 0, 1), *b = noise(67, 45, 3, 6, 0, 1);
    const lf_image *both[] = {a, b};
    double psnr[2], ssim[2], variance[2];
    for (int k = 0; k < 2; k++) {
        omp_set_num_threads(k + 1);
        psnr[k] = figure(lf_psnr, a, b);
        ssim[k] = figure(lf_ssim, a, b);
        assert_int_equal(lf_pixel_variance(2, both, &variance[k], NULL), LF_OK);
        assert_true(figure(lf_psnr, b, a) == psnr[k]);
        assert_close(figure(lf_ssim, b, a), ssim[k], 1e-14, 0);
    }
    omp_set_num_threads(before);
    assert_true(psnr[0] == psnr[1] && ssim[0] == ssim[1] && variance[0] == variance[1]);
    lf_image_free(a);
    lf_image_free(b);
}

/* Alpha over white and grey three times, in any mixture. */
static void channels(void **state)
{
    (void)state;
    lf_image *grey = flat(12, 12, 1, 0.7f), *colour = flat(12, 12, 3, 0.7f);
    lf_image *alpha = lf_image_create(12, 12, 4), *grey_alpha = lf_image_create(12, 12, 2);
    lf_image_fill(alpha, (const float[]){0.4f, 0.4f, 0.4f, 0.5f}); /* 0.2 + 0.5 */
    lf_image_fill(grey_alpha, (const float[]){0, 0.3f});           /* 0 + 0.7 */
    const lf_image *all[] = {grey, colour, alpha, grey_alpha};
    for (int i = 0; i < 4; i++) {
        assert_close(figure(lf_psnr, all[i], colour), 100, 0, 0);
        assert_close(figure(lf_ssim, colour, all[i]), 1, 1e-6, 0);
    }
    lf_image_free(grey);
    lf_image_free(colour);
    lf_image_free(alpha);
    lf_image_free(grey_alpha);
}

/* Six values 0, d, .., 5 d at one pixel: variance 35/12 d^2; elsewhere less. */
static void variance(void **state)
{
    (void)state;
    lf_image *image[6];
    for (int k = 0; k < 6; k++) {
        image[k] = flat(7, 5, 3, 0.5f);
        lf_image_at(image[k], 3, 2)[1] = (float)k * 2 / 255;
        lf_image_at(image[k], 6, 4)[2] = (float)k / 255;
    }
    double value = -1;
    const lf_image *const *images = (const lf_image *const *)image;
    assert_int_equal(lf_pixel_variance(6, images, &value, NULL), LF_OK);
    assert_close(value, 4 * 35.0 / 12, 1e-6, 0);
    assert_int_equal(lf_pixel_variance(1, images, &value, NULL), LF_OK);
    assert_close(value, 0, 0, 0);
    for (int k = 0; k < 6; k++)
        lf_image_free(image[k]);
}

static void expect_bad(lf_status status, const lf_error *err, double value, const char *words)
{
    assert_int_equal(status, LF_BAD_INPUT);
    assert_close(value, -1, 0, 0);
    if (!strstr(err->text, words))
        fail_msg("no \"%s\" in \"%s\"", words, err->text);
}

static void refusals(void **state)
{
    (void)state;
    double value = -1;
    lf_error err = {""};
    lf_image *a = flat(12, 14, 3, 0), *b = flat(14, 12, 3, 0), *small = flat(30, 10, 3, 0);
    const lf_image *both[] = {a, b};
    const char *sizes = "first image is 12 x 14 pixels, the second 14 x 12";
    expect_bad(lf_psnr(a, b, &value, &err), &err, value, sizes);
    expect_bad(lf_ssim(a, b, &value, &err), &err, value, sizes);
    expect_bad(lf_pixel_variance(2, both, &value, &err), &err, value, sizes);
    expect_bad(lf_ssim(small, small, &value, &err), &err, value, "at least 11 x 11");
    lf_image_at(b, 3, 5)[2] = NAN;
    expect_bad(lf_psnr(b, b, &value, &err), &err, value, "row 5, column 3 is not finite");
    assert_int_equal(lf_psnr(a, b, &value, NULL), LF_BAD_INPUT);
    lf_image_free(a);
    lf_image_free(b);
    lf_image_free(small);
}

static void definitions(void **state)
{
    (void)state;
    json_t *json = lf_image_metric_json();
    const char *keys[] = {"image", "psnr", "ssim", "pixel_variance"};
    const char *words[] = {"alpha composited on white", "peak 1", "sigma 1.5", "divisor n"};
    for (int i = 0; i < 4; i++) {
        const char *text = json_string_value(json_object_get(json, keys[i]));
        assert_non_null(text);
        assert_non_null(strstr(text, words[i]));
        assert_non_null(strstr(lf_image_metric_text(), words[i]));
    }
    json_decref(json);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(constants), cmocka_unit_test(limits),
        cmocka_unit_test(shift),     cmocka_unit_test(additive_noise),
        cmocka_unit_test(channels),  cmocka_unit_test(against_a_plain_loop),
        cmocka_unit_test(variance),  cmocka_unit_test(symmetric_and_for_any_threads),
        cmocka_unit_test(refusals),  cmocka_unit_test(definitions),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
