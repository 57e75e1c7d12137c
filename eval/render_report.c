/* render_report.c: a rendering evaluation as JSON and as a table. */
#include "eval/render_report.h"

#include <math.h>

#include "eval/image_metrics.h"
#include "eval/plot.h"
#include "eval/report.h"

enum { FIGURES = sizeof(lf_render_figures) / sizeof(double) };

static double *figure(lf_render_figures *f, int i)
{
    double *const all[FIGURES] = {&f->psnr,           &f->ssim,        &f->lpips,
                                  &f->pixel_variance, &f->seconds,     &f->rows,
                                  &f->baseline[0],    &f->baseline[1], &f->baseline[2]};
    return all[i];
}

lf_render_figures lf_render_figures_none(void)
{
    lf_render_figures f;
    for (int i = 0; i < FIGURES; i++)
        *figure(&f, i) = NAN;
    return f;
}

void lf_render_report_add(lf_render_report *report, long number, const char *scene,
                          const char *view, const lf_render_figures *f)
{
    LF_REQUIRE(isfinite(f->psnr) && isfinite(f->ssim) && isfinite(f->seconds) && isfinite(f->rows),
               "report: figures of %s %s are not finite", scene, view);
    if (report->images == report->room) {
        report->room = report->room ? 2 * report->room : 64;
        report->image = realloc(report->image, (size_t)report->room * sizeof *report->image);
        LF_REQUIRE(report->image, "report: no memory for %ld images", report->room);
    }
    lf_render_image *image = &report->image[report->images++];
    *image = (lf_render_image){.number = number, .figures = *f};
    snprintf(image->scene, sizeof image->scene, "%s", scene);
    snprintf(image->view, sizeof image->view, "%s", view);
}

void lf_render_report_clear(lf_render_report *report)
{
    free(report->image);
    report->image = NULL;
    report->images = report->room = 0;
}

/* ---- means -------------------------------------------------------------------------------- */

bool lf_render_report_new_scene(const lf_render_report *report, long image)
{
    for (long i = 0; i < image; i++)
        if (report->image[i].number == report->image[image].number)
            return false;
    return true;
}

static bool is_of(const lf_render_report *report, long image, long number)
{
    return number < 0 || report->image[image].number == number;
}

static long images_of(const lf_render_report *report, long number)
{
    long count = 0;
    for (long i = 0; i < report->images; i++)
        count += is_of(report, i, number);
    return count;
}

static long scenes_of(const lf_render_report *report)
{
    long count = 0;
    for (long i = 0; i < report->images; i++)
        count += lf_render_report_new_scene(report, i);
    return count;
}

static void add_share(lf_render_figures *sum, lf_render_figures f, long count)
{
    for (int i = 0; i < FIGURES; i++)
        *figure(sum, i) += *figure(&f, i) / (double)count;
}

lf_render_figures lf_render_report_mean(const lf_render_report *report, long number)
{
    const long count = images_of(report, number);
    lf_render_figures mean = {0};
    for (long i = 0; i < report->images; i++)
        if (is_of(report, i, number))
            add_share(&mean, report->image[i].figures, count);
    return count ? mean : lf_render_figures_none();
}

lf_render_figures lf_render_report_scene_mean(const lf_render_report *report)
{
    const long count = scenes_of(report);
    lf_render_figures mean = {0};
    for (long i = 0; i < report->images; i++)
        if (lf_render_report_new_scene(report, i))
            add_share(&mean, lf_render_report_mean(report, report->image[i].number), count);
    return count ? mean : lf_render_figures_none();
}

/* ---- JSON --------------------------------------------------------------------------------- */

/* Bytes beyond ASCII become '?' where the text is not UTF-8. */
static json_t *text_json(const char *text)
{
    json_t *json = json_string(text ? text : "");
    if (json)
        return json;
    char ascii[256];
    snprintf(ascii, sizeof ascii, "%s", text);
    for (char *c = ascii; *c; c++)
        if (*c & 0x80)
            *c = '?';
    return json_string(ascii);
}

static json_t *number_json(double x)
{
    return isfinite(x) ? json_real(x) : json_null();
}

/* Put the figures into an object; rows of an image are a whole number. */
static json_t *put_figures(json_t *object, const lf_render_figures *f, bool image)
{
    json_t *baselines = json_object();
    for (int k = 0; k < LF_BASELINES; k++)
        json_object_set_new(baselines, lf_baseline_name((lf_baseline)k),
                            number_json(f->baseline[k]));
    json_object_set_new(object, "psnr", number_json(f->psnr));
    json_object_set_new(object, "ssim", number_json(f->ssim));
    json_object_set_new(object, "lpips", number_json(f->lpips));
    json_object_set_new(object, "pixel_variance", number_json(f->pixel_variance));
    json_object_set_new(object, "seconds", number_json(f->seconds));
    json_object_set_new(object, "rows",
                        image ? json_integer((json_int_t)f->rows) : number_json(f->rows));
    json_object_set_new(object, "baselines", baselines);
    return object;
}

static json_t *per_image_json(const lf_render_report *report)
{
    json_t *array = json_array();
    for (long i = 0; i < report->images; i++) {
        const lf_render_image *m = &report->image[i];
        json_t *object =
            json_pack("{s:o,s:o}", "scene", text_json(m->scene), "view", text_json(m->view));
        json_array_append_new(array, put_figures(object, &m->figures, true));
    }
    return array;
}

static json_t *per_scene_json(const lf_render_report *report)
{
    json_t *array = json_array();
    for (long i = 0; i < report->images; i++) {
        if (!lf_render_report_new_scene(report, i))
            continue;
        const lf_render_image *m = &report->image[i];
        const lf_render_figures mean = lf_render_report_mean(report, m->number);
        json_t *object = json_pack("{s:o,s:I}", "scene", text_json(m->scene), "images",
                                   (json_int_t)images_of(report, m->number));
        json_array_append_new(array, put_figures(object, &mean, false));
    }
    return array;
}

static json_t *definitions_json(const lf_render_report *report)
{
    json_t *metric = lf_image_metric_json(), *lpips = lf_lpips_json(report->lpips);
    json_t *baselines = json_pack(
        "{s:s,s:s,s:s,s:s}", "figure", "PSNR of what learns nothing, from the same source views",
        "copy", "the nearest source view, at the size of the image", "mean",
        "mean colour over all samples between near and far, even in 1/depth, and all sources that "
        "see them",
        "sweep",
        "mean colour at the sample of least colour variance over the sources that see it, two at "
        "least");
    json_object_set_new(metric, "baselines", baselines);
    json_object_set_new(metric, "seconds", json_string("wall time of one image"));
    json_object_set_new(
        metric, "rows",
        json_string(
            "(sample, source view) pairs given to the networks, coarse and fine, seen or not"));
    if (lpips && json_object_set_new(metric, "lpips", lpips) == 0)
        return metric;
    json_decref(metric);
    return NULL;
}

json_t *lf_render_report_json(const lf_render_report *r)
{
    const lf_render_figures scenes = lf_render_report_scene_mean(r),
                            images = lf_render_report_mean(r, -1);
    json_t *metric = definitions_json(r);
    if (!metric)
        return NULL;
    return json_pack("{s:s,s:o,s:o,s:o,s:o, s:i,s:i,s:I,s:I, s:o,s:o,s:f,s:o, s:o,s:o}", /**/
                     "experiment", "rendering", "model", text_json(r->model), "train_setting",
                     text_json(r->train_setting), "eval_setting", text_json(r->eval_setting),
                     "split", text_json(r->split), "sources", r->sources, "samples", r->samples,
                     "scenes", (json_int_t)scenes_of(r), "images", (json_int_t)r->images,
                     "mean_over_scenes", put_figures(json_object(), &scenes, false),
                     "mean_over_images", put_figures(json_object(), &images, false), "peak_rss_mb",
                     r->peak_rss_mb, "metric", metric, "per_scene", per_scene_json(r), "per_image",
                     per_image_json(r));
}

lf_status lf_render_report_write(const lf_render_report *report, const char *path, lf_error *err)
{
    json_t *json = lf_render_report_json(report);
    if (!json)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: the file of the LPIPS weights has a name that is not UTF-8, which "
                       "cannot stand in JSON; rename it",
                       path);
    const lf_status status = lf_json_write(path, json, err);
    json_decref(json);
    return status;
}

/* ---- the table ---------------------------------------------------------------------------- */

/* A space and the number in `width` columns. */
static void print_number(FILE *out, int width, int digits, double x)
{
    if (isfinite(x))
        fprintf(out, " %*.*f", width, digits, x);
    else
        fprintf(out, " %*s", width, "-");
}

static void print_line(FILE *out, const char *scene, const char *view, const lf_render_figures *f)
{
    fprintf(out, "%-20.20s %-20.20s", scene, view);
    print_number(out, 6, 2, f->psnr);
    print_number(out, 6, 4, f->ssim);
    print_number(out, 6, 4, f->lpips);
    if (isfinite(f->pixel_variance))
        fprintf(out, " %9.2e", f->pixel_variance);
    else
        fprintf(out, " %9s", "-");
    for (int k = 0; k < LF_BASELINES; k++)
        print_number(out, 6, 2, f->baseline[k]);
    print_number(out, 8, 2, f->seconds);
    print_number(out, 8, 3, f->rows / 1e6);
    fputc('\n', out);
}

void lf_render_report_print(const lf_render_report *r, FILE *out)
{
    const lf_render_figures scenes = lf_render_report_scene_mean(r),
                            images = lf_render_report_mean(r, -1);
    char text[64];
    fprintf(out,
            "rendering %s, trained in %s, evaluated in %s, split %s, %d sources, %d samples a "
            "ray\n",
            r->model ? r->model : "", r->train_setting ? r->train_setting : "",
            r->eval_setting ? r->eval_setting : "", r->split ? r->split : "", r->sources,
            r->samples);
    fprintf(out, "%-20s %-20s %6s %6s %6s %9s %6s %6s %6s %8s %8s\n", "scene", "view", "PSNR",
            "SSIM", "LPIPS", "variance", "copy", "mean", "sweep", "seconds", "10^6rows");
    for (long i = 0; i < r->images; i++)
        print_line(out, r->image[i].scene, r->image[i].view, &r->image[i].figures);
    for (long i = 0; i < r->images; i++) {
        if (!lf_render_report_new_scene(r, i))
            continue;
        const lf_render_figures mean = lf_render_report_mean(r, r->image[i].number);
        snprintf(text, sizeof text, "mean of %ld", images_of(r, r->image[i].number));
        print_line(out, r->image[i].scene, text, &mean);
    }
    snprintf(text, sizeof text, "mean of %ld", scenes_of(r));
    print_line(out, "mean over scenes", text, &scenes);
    snprintf(text, sizeof text, "mean of %ld", r->images);
    print_line(out, "mean over images", text, &images);
    fprintf(
        out,
        "PSNR in dB; copy, mean, sweep: PSNR of renderers that learn nothing; variance: "
        "largest pixel variance over frames, of 0..255; rows: (sample, source view) pairs given to "
        "the networks, coarse and fine, seen or not; -: not available\n");
}

/* ---- cost --------------------------------------------------------------------------------------
 */

lf_status lf_render_report_plot(const lf_render_report *report, const char *png, lf_error *err)
{
    double *x = calloc((size_t)report->images + 1, sizeof *x);
    double *y = calloc((size_t)report->images + 1, sizeof *y);
    LF_REQUIRE(x && y, "out of memory for %ld images", report->images);
    for (long i = 0; i < report->images; i++) {
        x[i] = 1e-6 * report->image[i].figures.rows;
        y[i] = report->image[i].figures.seconds;
    }
    x[report->images] = y[report->images] = 0; /* the axes' origin */
    const lf_plot_series dots = {NULL, report->images + 1, x, y, LF_PLOT_DOTS};
    const lf_plot plot = {.title = "cost of an image",
                          .x_label = "million (sample, source view) pairs",
                          .y_label = "seconds",
                          .series = 1,
                          .line = &dots};
    const lf_status status = lf_plot_write(png, &plot, err);
    free(x);
    free(y);
    return status;
}
