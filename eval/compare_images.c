/* compare_images.c: the figures of two image files. */
#include "eval/compare_images.h"
#include "eval/image_metrics.h"
#include "eval/report.h"

typedef struct image_figures {
    double psnr, ssim, lpips; /* the last only with weights */
} image_figures;

static lf_status measure(const lf_image *a, const lf_image *b, lf_lpips *lpips, image_figures *out,
                         lf_error *err)
{
    LF_TRY(lf_psnr(a, b, &out->psnr, err));
    LF_TRY(lf_ssim(a, b, &out->ssim, err));
    return lpips ? lf_lpips_distance(lpips, a, b, &out->lpips, err) : LF_OK;
}

/* Of the three, without the variance, which is of more than two images. */
static json_t *definitions(const lf_lpips *lpips)
{
    json_t *metric = lf_image_metric_json(), *learned = lf_lpips_json(lpips);
    json_object_del(metric, "pixel_variance");
    if (learned && json_object_set_new(metric, "lpips", learned) == 0)
        return metric;
    json_decref(metric);
    return NULL;
}

static lf_status put(const json_t *json, const char *path, FILE *out, lf_error *err)
{
    if (out && (json_dumpf(json, out, JSON_INDENT(2) | JSON_REAL_PRECISION(9)) ||
                fputc('\n', out) == EOF || fflush(out) == EOF))
        return lf_fail(err, LF_FAILED, "the figures could not be written");
    return path ? lf_json_write(path, json, err) : LF_OK;
}

static lf_status print_images(const char *const name[2], lf_image *const image[2], lf_lpips *lpips,
                              const char *path, FILE *out, lf_error *err)
{
    image_figures f = {0};
    const lf_status status = measure(image[0], image[1], lpips, &f, err);
    if (status != LF_OK)
        return lf_error_context(err, status, "%s against %s", name[0], name[1]);
    json_t *json =
        json_pack("{s:s,s:s, s:i,s:i, s:f,s:f,s:o, s:o}", "a", name[0], "b", name[1], "width",
                  image[0]->width, "height", image[0]->height, "psnr", f.psnr, "ssim", f.ssim,
                  "lpips", lpips ? json_real(f.lpips) : json_null(), "metric", definitions(lpips));
    if (!json)
        return lf_fail(err, LF_BAD_INPUT, "a file name that is not UTF-8 cannot stand in JSON");
    const lf_status written = put(json, path, out, err);
    json_decref(json);
    return written;
}

lf_status lf_compare_images(const char *a, const char *b, const lf_compare_images_options *options,
                            FILE *out, lf_error *err)
{
    const char *const name[] = {a, b};
    lf_image *image[] = {NULL, NULL};
    lf_lpips *lpips = NULL;
    lf_status status = LF_OK;
    for (int i = 0; i < 2 && status == LF_OK; i++)
        status = lf_image_read(name[i], &image[i], err);
    if (status == LF_OK && options->weights)
        status = lf_lpips_open(options->weights, options->net, &lpips, err);
    if (status == LF_OK)
        status = print_images(name, image, lpips, options->json, out, err);
    lf_image_free(image[0]);
    lf_image_free(image[1]);
    lf_lpips_free(lpips);
    return status;
}
