/* report.c: an evaluation as JSON and as a table. */
#include <math.h>

#include "autograd/atomic_file.h"
#include "eval/hull.h"
#include "eval/mean_shape.h"
#include "eval/report.h"

void lf_report_add(lf_report *report, const char *id, const lf_score *score, double seconds,
                   long faces)
{
    LF_REQUIRE(isfinite(score->iou) && isfinite(score->chamfer_l1) && isfinite(seconds),
               "report: figures of %s are not finite", id);
    if (report->shapes == report->room) {
        report->room = report->room ? 2 * report->room : 64;
        report->shape = realloc(report->shape, (size_t)report->room * sizeof *report->shape);
        LF_REQUIRE(report->shape, "report: no memory for %ld shapes", report->room);
    }
    lf_report_shape *s = &report->shape[report->shapes++];
    *s = (lf_report_shape){.iou = score->iou,
                           .chamfer_l1 = score->chamfer_l1,
                           .seconds = seconds,
                           .faces = faces,
                           .empty = score->empty};
    snprintf(s->id, sizeof s->id, "%s", id);
}

void lf_report_add_baseline(lf_report *report, lf_shape_baseline which, const lf_score *score)
{
    LF_REQUIRE(report->has[which] && report->shapes > 0 && isfinite(score->iou) &&
                   isfinite(score->chamfer_l1),
               "report: a baseline without its shape or figures");
    report->shape[report->shapes - 1].baseline[which] =
        (lf_shape_baseline_score){score->iou, score->chamfer_l1, score->empty};
}

void lf_report_clear(lf_report *report)
{
    free(report->shape);
    report->shape = NULL;
    report->shapes = report->room = 0;
}

lf_report_means lf_report_mean(const lf_report *report)
{
    lf_report_means m = {0};
    const double n = report->shapes ? (double)report->shapes : 1;
    for (long i = 0; i < report->shapes; i++) {
        const lf_report_shape *s = &report->shape[i];
        m.iou += s->iou / n;
        m.chamfer_l1 += s->chamfer_l1 / n;
        m.seconds += s->seconds / n;
        m.empty += s->empty;
        for (int b = 0; b < LF_SHAPE_BASELINES; b++) {
            m.baseline[b].iou += s->baseline[b].iou / n;
            m.baseline[b].chamfer_l1 += s->baseline[b].chamfer_l1 / n;
            m.baseline[b].empty += s->baseline[b].empty;
        }
    }
    return m;
}

/* A JSON string; bytes beyond ASCII become '?' where the text is not UTF-8. */
static json_t *json_text(const char *text)
{
    json_t *json = json_string(text ? text : "");
    if (json)
        return json;
    char ascii[512];
    snprintf(ascii, sizeof ascii, "%s", text);
    for (char *c = ascii; *c; c++)
        if (*c & 0x80)
            *c = '?';
    return json_string(ascii);
}

json_t *lf_metric_json(const lf_metric_options *options)
{
    return json_pack(
        "{s:{s:s,s:I,s:s,s:s}, s:{s:s,s:s,s:I,s:s,s:i}, s:s, s:I}", "iou", "definition",
        "|A and B| / |A or B|; 1 if no point is in either", "samples", (json_int_t)options->samples,
        "region",
        "uniform in the cube of edge 1.1 longest box edges round the centre of the true shape's "
        "box",
        "normalisation", "none: the prediction is scored in the frame of the truth", "chamfer_l1",
        "definition",
        "(mean distance prediction to truth + mean distance truth to prediction) / 2, Euclidean, "
        "not squared",
        "distance",
        options->exact ? "area-uniform samples to the nearest point of the other surface"
                       : "area-uniform samples to the nearest sample of the other surface",
        "samples", (json_int_t)options->samples, "unit",
        "longest edge of the true shape's bounding box", "factor", LF_CHAMFER_FACTOR, "empty",
        "a prediction without a surface counts with iou 0 and chamfer_l1 factor * sqrt(3), stays "
        "in "
        "every mean, and is counted apart",
        "seed", (json_int_t)options->seed);
}

static const char *const baseline_key[LF_SHAPE_BASELINES] = {"hull", "mean_shape"};
static const char *const baseline_name[LF_SHAPE_BASELINES] = {"visual hull of the same views",
                                                              "mean shape of the training split"};

/* {"hull": {iou, chamfer_l1, empty}, ...}, null for what the report has not; of one shape `empty`
 * is true or false. */
static json_t *baselines_json(const lf_report *report, const lf_shape_baseline_score *score,
                              bool one)
{
    json_t *json = json_object();
    for (int b = 0; b < LF_SHAPE_BASELINES; b++) {
        const lf_shape_baseline_score *s = &score[b];
        json_t *empty = one ? json_boolean(s->empty) : json_integer(s->empty);
        json_t *figures = json_pack("{s:f,s:f,s:o}", "iou", s->iou, "chamfer_l1",
                                    LF_CHAMFER_FACTOR * s->chamfer_l1, "empty", empty);
        if (!report->has[b]) {
            json_decref(figures);
            figures = json_null();
        }
        json_object_set_new(json, baseline_key[b], figures);
    }
    return json;
}

static json_t *shape_json(const lf_report *report, const lf_report_shape *s)
{
    return json_pack("{s:o,s:f,s:f,s:f,s:I,s:b,s:o}", "id", json_text(s->id), "iou", s->iou,
                     "chamfer_l1", LF_CHAMFER_FACTOR * s->chamfer_l1, "seconds", s->seconds,
                     "faces", (json_int_t)s->faces, "empty", (int)s->empty, "baselines",
                     baselines_json(report, s->baseline, true));
}

json_t *lf_report_json(const lf_report *report)
{
    const lf_report_means m = lf_report_mean(report);
    json_t *shapes = json_array(), *metric = lf_metric_json(&report->metric);
    json_object_set_new(
        metric, "baselines",
        json_pack("{s:s,s:s}", "hull", lf_hull_text(), "mean_shape", lf_mean_shape_text()));
    for (long i = 0; i < report->shapes; i++)
        json_array_append_new(shapes, shape_json(report, &report->shape[i]));
    return json_pack(
        "{s:o,s:o,s:o,s:o,s:o,s:o, s:I,s:f,s:f,s:f,s:f,s:I, s:o,s:o,s:o}", /**/
        "experiment", json_text(report->experiment), "model", json_text(report->model), "category",
        json_text(report->category), "train_setting", json_text(report->train_setting),
        "eval_setting", json_text(report->eval_setting), "split", json_text(report->split),
        "shapes", (json_int_t)report->shapes, "iou", m.iou, "chamfer_l1",
        LF_CHAMFER_FACTOR * m.chamfer_l1, "seconds_per_shape", m.seconds, "peak_rss_mb",
        report->peak_rss_mb, "empty", (json_int_t)m.empty, "baselines",
        baselines_json(report, m.baseline, false), "metric", metric, "per_shape", shapes);
}

lf_status lf_json_write(const char *path, const json_t *json, lf_error *err)
{
    char *text = json_dumps(json, JSON_INDENT(2) | JSON_REAL_PRECISION(9) | JSON_ENCODE_ANY);
    if (!text)
        return lf_fail(err, LF_FAILED, "%s: the JSON could not be made (memory)", path);
    const lf_bytes pieces[] = {{text, strlen(text)}, {"\n", 1}};
    const lf_status status = lf_atomic_write(path, pieces, 2, NULL, err);
    free(text);
    return status;
}

lf_status lf_report_write(const lf_report *report, const char *path, lf_error *err)
{
    json_t *json = lf_report_json(report);
    const lf_status status = lf_json_write(path, json, err);
    json_decref(json);
    return status;
}

static void print_line(FILE *out, const char *name, double iou, double chamfer, double seconds,
                       const char *note)
{
    fprintf(out, "%-32.32s %8.4f %12.4f %8.2f  %s\n", name, iou, LF_CHAMFER_FACTOR * chamfer,
            seconds, note);
}

void lf_report_print(const lf_report *report, FILE *out)
{
    const lf_report_means m = lf_report_mean(report);
    char note[64];
    fprintf(out, "%s %s, category %s, trained in %s, evaluated in %s, split %s\n",
            report->experiment ? report->experiment : "", report->model ? report->model : "",
            report->category ? report->category : "",
            report->train_setting ? report->train_setting : "",
            report->eval_setting ? report->eval_setting : "", report->split ? report->split : "");
    fprintf(out, "%-32s %8s %12s %8s\n", "shape", "IoU", "Chamfer x10", "seconds");
    for (long i = 0; i < report->shapes; i++) {
        const lf_report_shape *s = &report->shape[i];
        print_line(out, s->id, s->iou, s->chamfer_l1, s->seconds, s->empty ? "empty" : "");
    }
    snprintf(note, sizeof note, "%ld shape%s, %ld empty", report->shapes,
             report->shapes == 1 ? "" : "s", m.empty);
    print_line(out, "mean", m.iou, m.chamfer_l1, m.seconds, note);
    for (int b = 0; b < LF_SHAPE_BASELINES; b++)
        if (report->has[b])
            fprintf(out, "%s: IoU %.4f, Chamfer x10 %.4f, %ld empty\n", baseline_name[b],
                    m.baseline[b].iou, LF_CHAMFER_FACTOR * m.baseline[b].chamfer_l1,
                    m.baseline[b].empty);
    fprintf(out,
            "IoU over %ld points, Chamfer-L1 from %ld samples a side, in tenths of the true "
            "shape's longest box edge\n",
            report->metric.samples, report->metric.samples);
}
