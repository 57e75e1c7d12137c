/* evaluate.c: scores, meshes and the picture of a split. See evaluate.h. */
#include <math.h>

#include "eval/evaluate.h"
#include "eval/montage.h"
#include "eval/report.h"
#include "train/progress.h"
#include "train/run_dir.h"
#include "train/recon_data.h"

enum { V = LF_CUBE_VIEWS };

/* What the evaluation of one shape needs and leaves. */
typedef struct subject {
    lf_loaded *loaded;
    const lf_evaluate_options *options;
    const lf_shapes *shapes;
    lf_shape shape;
    lf_shape_views views;
    uint8_t *images;
    lf_predicted predicted;
    lf_mesh *truth;
} subject;

/* Views in the setting, every one rolled by `roll` degrees as well if that is not 0. */
static lf_status make_views(subject *s, long index, lf_error *err)
{
    LF_TRY(lf_shapes_render(s->shapes, &s->shape, index, 0, &s->views, s->images, err));
    if (s->options->roll == 0)
        return LF_OK;
    for (int v = 0; v < V; v++)
        s->views.camera[v] =
            lf_camera_roll(&s->views.camera[v], s->options->roll * 3.141592653589793 / 180);
    return lf_shapes_render_views(s->shapes, &s->shape, &s->views, s->images, err);
}

static lf_status extract(subject *s, long index, lf_error *err)
{
    LF_TRY(lf_shapes_load(s->shapes, index, &s->shape, err));
    LF_TRY(make_views(s, index, err));
    LF_TRY(lf_predicted_mesh(s->loaded, &s->views, s->shape.longest_edge, s->options->dense,
                             &s->predicted, err));
    return lf_true_mesh(s->loaded->cfg, &s->shape, &s->truth, err);
}

static void release(subject *s)
{
    lf_mesh_free(s->predicted.mesh);
    lf_mesh_free(s->truth);
    s->predicted.mesh = s->truth = NULL;
    lf_shape_release(&s->shape);
}

/* ---- files ---- */

static lf_status write_mesh(const char *folder, const char *id, const char *kind,
                            const lf_mesh *mesh, lf_error *err)
{
    char path[1024];
    const int n = snprintf(path, sizeof path, "%s/%s-%s.ply", folder, id, kind);
    if (n >= (int)sizeof path)
        return lf_fail(err, LF_BAD_INPUT, "%s/%s: the name is too long", folder, id);
    return lf_mesh_write_ply(path, mesh, err);
}

/* A row of the montage owns its caption, images and meshes. */
static void keep_row(lf_montage_row *row, subject *s, const char *id, double iou)
{
    const lf_recon_config *c = &s->loaded->model.config;
    const long n = V * c->image_size * c->image_size * c->backbone.in_channels;
    float *pixels = malloc((size_t)n * sizeof *pixels);
    char *caption = NULL;
    LF_REQUIRE(pixels && asprintf(&caption, "%s   IoU %.2f", id, iou) >= 0, "out of memory");
    lf_shapes_pixels(s->images, n, pixels);
    *row = (lf_montage_row){
        caption,           V,       (int)c->image_size, c->backbone.in_channels, pixels,
        s->predicted.mesh, s->truth};
    s->predicted.mesh = s->truth = NULL;
}

static void free_rows(lf_montage_row *row, long rows)
{
    for (long i = 0; i < rows; i++) {
        free((void *)(uintptr_t)row[i].caption);
        free((void *)(uintptr_t)row[i].images);
        lf_mesh_free((lf_mesh *)(uintptr_t)row[i].predicted);
        lf_mesh_free((lf_mesh *)(uintptr_t)row[i].truth);
    }
    free(row);
}

/* ---- the split ---- */

typedef struct run {
    lf_report report;
    lf_mean_shape mean; /* of the training split, if the report has it */
    lf_montage_row *row;
    long rows, count;
    long evaluations, dense_evaluations, invalid;
    long steps, steep;
    lf_progress progress;
    double started;
} run;

/* A baseline's mesh, scored at the same points. */
static lf_status score_baseline(run *r, const subject *s, lf_shape_baseline which,
                                const lf_metric_options *metric, lf_error *err)
{
    const double edge = s->shape.longest_edge;
    lf_mesh *mesh;
    lf_score score;
    if (which == LF_SHAPE_HULL)
        LF_TRY(lf_hull_mesh(s->loaded, &s->views, edge, &mesh, err));
    else
        LF_TRY(lf_mean_shape_mesh(s->loaded->cfg, &r->mean, edge, &mesh, err));
    const lf_status status = lf_score_meshes(mesh, s->truth, s->shape.sdf, metric, &score, err);
    lf_mesh_free(mesh);
    if (status == LF_OK)
        lf_report_add_baseline(&r->report, which, &score);
    return status;
}

static lf_status score_shape(run *r, subject *s, long index, lf_error *err)
{
    lf_metric_options metric = r->report.metric;
    metric.item = (uint64_t)index;
    const char *id = lf_shapes_id(s->shapes, index);
    LF_TRY(extract(s, index, err));
    lf_score score;
    LF_TRY(lf_score_meshes(s->predicted.mesh, s->truth, s->shape.sdf, &metric, &score, err));
    lf_report_add(&r->report, id, &score, s->predicted.seconds, s->predicted.mesh->faces);
    for (int b = 0; b < LF_SHAPE_BASELINES; b++)
        if (r->report.has[b])
            LF_TRY(score_baseline(r, s, (lf_shape_baseline)b, &metric, err));
    r->evaluations += s->predicted.iso.evaluations;
    r->dense_evaluations += s->predicted.iso.dense_evaluations;
    r->invalid += s->predicted.iso.invalid;
    r->steps += s->predicted.iso.steps;
    r->steep += s->predicted.iso.steep;
    if (s->options->out) {
        LF_TRY(write_mesh(s->options->out, id, "predicted", s->predicted.mesh, err));
        LF_TRY(write_mesh(s->options->out, id, "true", s->truth, err));
    }
    if (s->options->out && r->rows < s->options->pictures)
        keep_row(&r->row[r->rows++], s, id, score.iou);
    lf_progress_update(&r->progress, index + 1, lf_seconds_now() - r->started, "IoU %.3f",
                       lf_report_mean(&r->report).iou);
    return LF_OK;
}

static lf_status write_results(run *r, const lf_evaluate_options *o, lf_error *err)
{
    r->report.peak_rss_mb = lf_peak_rss_mb();
    if (!o->quiet) {
        lf_report_print(&r->report, stdout);
        printf(
            "field evaluations: %ld, dense grid %ld (%.1f times more); %ld points seen by no view "
            "taken as outside\n",
            r->evaluations, r->dense_evaluations,
            (double)r->dense_evaluations / (double)(r->evaluations ? r->evaluations : 1),
            r->invalid);
        if (r->steps)
            printf(
                "the field was steeper than eval.lipschitz in %.1f %% of the steps looked at: only "
                "there can a separate part be missed; --dense misses none\n",
                100 * (double)r->steep / (double)r->steps);
    }
    if (o->json)
        LF_TRY(lf_report_write(&r->report, o->json, err));
    if (!o->out || r->rows == 0)
        return LF_OK;
    char path[1024];
    snprintf(path, sizeof path, "%s/montage.png", o->out);
    const lf_montage_options montage = lf_montage_defaults();
    LF_TRY(lf_montage_write(path, r->rows, r->row, &montage, err));
    if (!o->quiet)
        printf("picture: %s (views | predicted | true)\n", path);
    return LF_OK;
}

static lf_status score_split(run *r, subject *s, lf_error *err)
{
    r->started = lf_seconds_now();
    r->progress = lf_progress_start(stdout, "shape", 0, r->count, s->options->quiet);
    for (long i = 0; i < r->count; i++) {
        const lf_status status = score_shape(r, s, i, err);
        release(s);
        if (status != LF_OK) {
            lf_progress_end(&r->progress);
            return lf_error_context(err, status, "%s", lf_shapes_id(s->shapes, i));
        }
    }
    lf_progress_end(&r->progress);
    return write_results(r, s->options, err);
}

/* The training shapes may be elsewhere than the model: then there is no mean of them. */
static void make_mean(run *r, const lf_config *cfg)
{
    const lf_shapes_options data = lf_shapes_options_from(cfg, "train");
    lf_error why = {""};
    lf_shapes *shapes;
    lf_status status = lf_shapes_open(&data, &shapes, &why);
    if (status == LF_OK) {
        status = lf_mean_shape_make(shapes, &r->mean, &why);
        lf_shapes_close(shapes);
    }
    r->report.has[LF_SHAPE_MEAN] = status == LF_OK;
    if (status != LF_OK)
        fprintf(stderr,
                "elf-eval: no mean of the training shapes beside the model: %s (give data.root, or "
                "--no-baselines)\n",
                why.text);
}

static lf_metric_options metric_options(const lf_config *cfg, bool exact)
{
    lf_metric_options m = lf_metric_defaults();
    m.samples = lf_config_int(cfg, "eval.points");
    m.exact = exact;
    return m;
}

static lf_status evaluate_shapes(lf_loaded *loaded, const lf_evaluate_options *o,
                                 const lf_shapes *shapes, const char *setting, lf_error *err)
{
    const lf_config *cfg = loaded->cfg;
    const lf_recon_config *c = &loaded->model.config;
    run r = {.count = lf_shapes_count(shapes),
             .report = {.experiment = "reconstruction",
                        .model = lf_config_choice(cfg, "model.type"),
                        .category = lf_config_string(cfg, "data.category"),
                        .train_setting = lf_setting_name(loaded->trained),
                        .eval_setting = setting,
                        .split = o->split,
                        .has = {[LF_SHAPE_HULL] = o->baselines},
                        .metric = metric_options(cfg, o->exact)}};
    if (o->shapes > 0 && o->shapes < r.count)
        r.count = o->shapes;
    subject s = {.loaded = loaded, .options = o, .shapes = shapes};
    s.images = malloc((size_t)(V * c->image_size * c->image_size * c->backbone.in_channels));
    r.row = calloc((size_t)(o->pictures > 0 ? o->pictures : 1), sizeof *r.row);
    LF_REQUIRE(s.images && r.row, "out of memory for views");
    if (o->baselines)
        make_mean(&r, cfg);
    const lf_status status = score_split(&r, &s, err);
    lf_mean_shape_free(&r.mean);
    free_rows(r.row, r.rows);
    free(s.images);
    lf_report_clear(&r.report);
    return status;
}

lf_status lf_evaluated_shapes(const lf_config *cfg, const char *split, const char *setting,
                              lf_setting *used, lf_shapes **out, lf_error *err)
{
    lf_shapes_options data = lf_shapes_options_from(cfg, split);
    if (strcmp(split, "train") == 0)
        data.draws = 1;
    if (setting)
        LF_TRY(lf_setting_parse(setting, &data.views.setting, err));
    if (used)
        *used = data.views.setting;
    return lf_shapes_open(&data, out, err);
}

lf_status lf_evaluate(lf_loaded *loaded, const lf_evaluate_options *options, lf_error *err)
{
    lf_setting setting;
    lf_shapes *shapes;
    LF_TRY(
        lf_evaluated_shapes(loaded->cfg, options->split, options->setting, &setting, &shapes, err));
    lf_status status = options->out ? lf_make_folders(options->out, err) : LF_OK;
    if (status == LF_OK)
        status = evaluate_shapes(loaded, options, shapes, lf_setting_name(setting), err);
    lf_shapes_close(shapes);
    return status;
}
