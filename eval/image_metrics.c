/* image_metrics.c: PSNR, SSIM and pixel variance.                              [image_metrics.h]
 *
 * Sums run over a row first and then over the rows in order, so that threads do not matter.
 */
#include "eval/image_metrics.h"

#include <math.h>

const char *lf_image_metric_text(void)
{
    return "images       three channels, grey three times, alpha composited on white, values cut\n"
           "             to [0, 1]\n"
           "PSNR         10 log10(1 / mse) in dB, mse the mean over pixels and channels, peak 1;\n"
           "             at most 100, which equal images have\n"
           "SSIM         11 x 11 Gaussian window of sigma 1.5, K = (0.01, 0.03), peak 1;\n"
           "             variances with divisor n, windows inside the image only, mean over\n"
           "             windows and channels\n"
           "variance     values 0 to 255, not rounded; variance over the renderings of an item\n"
           "             with divisor n, largest over pixels and channels; mean over items\n";
}

json_t *lf_image_metric_json(void)
{
    return json_pack(
        "{s:s,s:s,s:s,s:s}", "image",
        "three channels, grey three times, alpha composited on white, values cut to [0, 1]", "psnr",
        "10 log10(1 / mse) in dB, mse the mean over pixels and channels, peak 1; at most 100, "
        "which equal images have",
        "ssim",
        "11 x 11 Gaussian window of sigma 1.5, K = (0.01, 0.03), peak 1, variances with divisor n, "
        "windows inside the image only, mean over windows and channels",
        "pixel_variance",
        "values 0 to 255, not rounded; variance over the renderings of an item with divisor n, "
        "largest over pixels and channels; mean over items");
}

/* ---- images ---------------------------------------------------------------------------------- */

static lf_status check_finite(const lf_image *image, lf_error *err)
{
    const long row = (long)image->width * image->channels;
    for (long i = 0; i < row * image->height; i++)
        if (!isfinite(image->pixel[i]))
            return lf_fail(err, LF_BAD_INPUT,
                           "the image's value at row %ld, column %ld is not finite", i / row,
                           i % row / image->channels);
    return LF_OK;
}

lf_status lf_images_agree(const lf_image *a, const lf_image *b, lf_error *err)
{
    if (a->width != b->width || a->height != b->height)
        return lf_fail(err, LF_BAD_INPUT,
                       "the first image is %d x %d pixels, the second %d x %d; give two of one "
                       "size",
                       a->width, a->height, b->width, b->height);
    LF_TRY(check_finite(a, err));
    return check_finite(b, err);
}

lf_image *lf_image_for_metrics(const lf_image *image)
{
    lf_image *out = lf_image_over_white(image);
    const long n = 3L * out->width * out->height;
    for (long i = 0; i < n; i++)
        out->pixel[i] = fminf(fmaxf(out->pixel[i], 0), 1);
    return out;
}

typedef struct image_pair {
    lf_image *a, *b;
} image_pair;

static lf_status pair_open(const lf_image *a, const lf_image *b, image_pair *out, lf_error *err)
{
    LF_TRY(lf_images_agree(a, b, err));
    *out = (image_pair){lf_image_for_metrics(a), lf_image_for_metrics(b)};
    return LF_OK;
}

static void pair_close(const image_pair *pair)
{
    lf_image_free(pair->a);
    lf_image_free(pair->b);
}

static double *new_doubles(long n)
{
    double *x = malloc((size_t)n * sizeof *x);
    LF_REQUIRE(x, "no memory for %ld numbers", n);
    return x;
}

static double sum_of(long n, const double *x)
{
    double sum = 0;
    for (long i = 0; i < n; i++)
        sum += x[i];
    return sum;
}

/* ---- PSNR ------------------------------------------------------------------------------------ */

static double squared_row(long n, const float *a, const float *b)
{
    double sum = 0;
    for (long i = 0; i < n; i++) {
        const double d = (double)a[i] - b[i];
        sum += d * d;
    }
    return sum;
}

lf_status lf_psnr(const lf_image *a, const lf_image *b, double *out, lf_error *err)
{
    image_pair pair;
    LF_TRY(pair_open(a, b, &pair, err));
    const long row = 3L * a->width, rows = a->height;
    double *sum = new_doubles(rows);
#pragma omp parallel for schedule(static)
    for (long i = 0; i < rows; i++)
        sum[i] = squared_row(row, pair.a->pixel + i * row, pair.b->pixel + i * row);
    const double mse = sum_of(rows, sum) / (double)(row * rows);
    *out = fmin(LF_PSNR_MOST, -10 * log10(fmax(mse, 1e-10)));
    free(sum);
    pair_close(&pair);
    return LF_OK;
}

/* ---- SSIM ------------------------------------------------------------------------------------ */

enum { MOMENTS = 5 }; /* a, b, a a, b b, a b */

static void gaussian(double weight[LF_SSIM_WINDOW])
{
    const int middle = LF_SSIM_WINDOW / 2;
    for (int i = 0; i < LF_SSIM_WINDOW; i++)
        weight[i] = exp(-0.5 * (i - middle) * (i - middle) / (1.5 * 1.5));
    const double sum = sum_of(LF_SSIM_WINDOW, weight);
    for (int i = 0; i < LF_SSIM_WINDOW; i++)
        weight[i] /= sum;
}

/* The moments of each of n values weighed over LF_SSIM_WINDOW rows from a and b on:
 * moment[MOMENTS][n]. */
static void moments_down(long n, const float *a, const float *b, const double *weight,
                         double *moment)
{
    memset(moment, 0, (size_t)(MOMENTS * n) * sizeof *moment);
    for (int k = 0; k < LF_SSIM_WINDOW; k++)
        for (long i = 0; i < n; i++) {
            const double x = a[k * n + i], y = b[k * n + i], w = weight[k];
            moment[i] += w * x;
            moment[n + i] += w * y;
            moment[2 * n + i] += w * x * x;
            moment[3 * n + i] += w * y * y;
            moment[4 * n + i] += w * x * y;
        }
}

/* SSIM of one window from its moments. */
static double similarity(const double m[MOMENTS])
{
    const double c1 = 0.01 * 0.01, c2 = 0.03 * 0.03;
    const double var_a = m[2] - m[0] * m[0], var_b = m[3] - m[1] * m[1];
    const double luminance = (2 * m[0] * m[1] + c1) / (m[0] * m[0] + m[1] * m[1] + c1);
    return luminance * (2 * (m[4] - m[0] * m[1]) + c2) / (var_a + var_b + c2);
}

/* The sum over the windows of one row of windows and its channels; a and b at the window's first
 * row. */
static double ssim_row(long width, const float *a, const float *b, const double *weight)
{
    const long n = 3 * width, windows = 3 * (width - LF_SSIM_WINDOW + 1);
    double *moment = new_doubles(MOMENTS * n), sum = 0;
    moments_down(n, a, b, weight, moment);
    for (long i = 0; i < windows; i++) {
        double m[MOMENTS] = {0};
        for (int k = 0; k < LF_SSIM_WINDOW; k++)
            for (int f = 0; f < MOMENTS; f++)
                m[f] += weight[k] * moment[f * n + i + 3 * k];
        sum += similarity(m);
    }
    free(moment);
    return sum;
}

lf_status lf_ssim(const lf_image *a, const lf_image *b, double *out, lf_error *err)
{
    if (a->width < LF_SSIM_WINDOW || a->height < LF_SSIM_WINDOW)
        return lf_fail(err, LF_BAD_INPUT,
                       "SSIM needs at least %d x %d pixels, the first image is %d x %d",
                       LF_SSIM_WINDOW, LF_SSIM_WINDOW, a->width, a->height);
    image_pair pair;
    LF_TRY(pair_open(a, b, &pair, err));
    double weight[LF_SSIM_WINDOW];
    gaussian(weight);
    const long width = a->width, rows = a->height - LF_SSIM_WINDOW + 1;
    double *sum = new_doubles(rows);
#pragma omp parallel for schedule(static)
    for (long i = 0; i < rows; i++)
        sum[i] =
            ssim_row(width, pair.a->pixel + 3 * i * width, pair.b->pixel + 3 * i * width, weight);
    *out = sum_of(rows, sum) / (double)(3 * rows * (width - LF_SSIM_WINDOW + 1));
    free(sum);
    pair_close(&pair);
    return LF_OK;
}

/* ---- pixel variance -------------------------------------------------------------------------- */

/* Variance of value i over the images, on the 0..255 scale, in two passes. */
static double variance_at(int count, lf_image *const *image, long i)
{
    double mean = 0, sum = 0;
    for (int k = 0; k < count; k++)
        mean += (double)image[k]->pixel[i] / count;
    for (int k = 0; k < count; k++) {
        const double d = 255 * (image[k]->pixel[i] - mean);
        sum += d * d;
    }
    return sum / count;
}

lf_status lf_pixel_variance(int count, const lf_image *const *image, double *out, lf_error *err)
{
    LF_REQUIRE(count >= 1, "lf_pixel_variance: %d images", count);
    for (int k = 0; k < count; k++)
        LF_TRY(lf_images_agree(image[0], image[k], err));
    lf_image **three = malloc((size_t)count * sizeof(lf_image *));
    LF_REQUIRE(three, "no memory for %d images", count);
    for (int k = 0; k < count; k++)
        three[k] = lf_image_for_metrics(image[k]);
    double worst = 0;
    const long n = 3L * image[0]->width * image[0]->height;
#pragma omp parallel for schedule(static) reduction(max : worst)
    for (long i = 0; i < n; i++)
        worst = fmax(worst, variance_at(count, three, i));
    for (int k = 0; k < count; k++)
        lf_image_free(three[k]);
    free(three);
    *out = worst;
    return LF_OK;
}
