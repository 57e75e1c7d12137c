/* render_job.c: scores and pictures of a renderer. See render_job.h. */
#include <limits.h>

#include "eval/render_job.h"
#include "eval/file_names.h"
#include "eval/image_metrics.h"
#include "eval/render_montage.h"
#include "eval/render_report.h"
#include "train/progress.h"
#include "train/run_dir.h"

/* ---- the evaluation ---------------------------------------------------------------------------
 */

/* A row of the montage owns its pictures and names. */
typedef struct kept_row {
    lf_render_row row;
    lf_image **source;
} kept_row;

typedef struct evaluation {
    lf_loaded_renderer *loaded;
    const lf_render_job *job;
    lf_lpips *lpips;
    bool turns; /* setting SO3 */
    const lf_scene_set *set;
    char **scene, **view; /* names of files: of the scenes, of the views of the scene at work */
    lf_render_report report;
    kept_row *row;
    long rows;
    lf_progress progress;
} evaluation;

static lf_render_view_options view_options(const evaluation *e, const lf_motion *motion)
{
    return (lf_render_view_options){.sources = lf_render_sources(e->loaded), .motion = motion};
}

lf_motion lf_render_rotation(long k)
{
    lf_stream s = lf_stream_at(1, LF_RANDOM_SETTING, (uint64_t)k, 77);
    return lf_motion_random(&s, 0);
}

static lf_status score(const evaluation *e, const lf_image *image, const lf_image *truth,
                       double share, lf_render_figures *f, lf_error *err)
{
    double psnr, ssim, lpips = NAN;
    LF_TRY(lf_psnr(image, truth, &psnr, err));
    LF_TRY(lf_ssim(image, truth, &ssim, err));
    if (e->lpips)
        LF_TRY(lf_lpips_distance(e->lpips, image, truth, &lpips, err));
    f->psnr += share * psnr;
    f->ssim += share * ssim;
    f->lpips += share * lpips;
    return LF_OK;
}

/* PSNR of what learns nothing. */
static lf_status score_baselines(const evaluation *e, const lf_render_view *v,
                                 const lf_image *truth, lf_render_figures *f, lf_error *err)
{
    const lf_scene *scene = v->entry->scene;
    lf_camera *camera = calloc((size_t)v->sources, sizeof *camera);
    lf_pixels *pixels = calloc((size_t)v->sources, sizeof *pixels);
    LF_REQUIRE(camera && pixels, "out of memory");
    lf_status status = LF_OK;
    for (long i = 0; i < v->sources; i++) {
        camera[i] = scene->view[v->source_view[i]].camera;
        pixels[i] =
            (lf_pixels){(int)v->source[i].width, (int)v->source[i].height, v->source[i].rgb, NULL};
    }
    const lf_baseline_views views = {scene->view[v->target].camera,
                                     v->near,
                                     v->far,
                                     (int)e->loaded->model.config.samples,
                                     (int)v->sources,
                                     camera,
                                     pixels,
                                     v->entry->white};
    for (int k = 0; status == LF_OK && k < LF_BASELINES; k++) {
        lf_image *image;
        status = lf_baseline_render((lf_baseline)k, &views, &image, err);
        if (status != LF_OK)
            break;
        status = lf_psnr(image, truth, &f->baseline[k], err);
        lf_image_free(image);
    }
    free(camera);
    free(pixels);
    return status;
}

static long number_of(const evaluation *e, const lf_render_view *v)
{
    return (long)(v->entry - e->set->entry);
}

static lf_status write_image(const evaluation *e, const lf_render_view *v, const lf_image *image,
                             const char *what, lf_error *err)
{
    char path[PATH_MAX];
    const int n = snprintf(path, sizeof path, "%s/%s-%s-%s.png", e->job->out,
                           e->scene[number_of(e, v)], e->view[v->target], what);
    if (n < 0 || n >= (int)sizeof path)
        return lf_fail(err, LF_BAD_INPUT, "--out %s: the name is too long", e->job->out);
    return lf_image_write_png(path, image, err);
}

static void keep_row(evaluation *e, const lf_render_view *v, lf_rendering *r, lf_image *truth,
                     double psnr)
{
    kept_row *k = &e->row[e->rows++];
    k->source = calloc((size_t)v->sources, sizeof *k->source);
    LF_REQUIRE(k->source, "out of memory");
    for (long i = 0; i < v->sources; i++) {
        const lf_pixels p = {(int)v->source[i].width, (int)v->source[i].height, v->source[i].rgb,
                             NULL};
        k->source[i] = lf_picture_of(&p);
    }
    k->row = (lf_render_row){.scene = strdup(e->scene[number_of(e, v)]),
                             .view = strdup(v->entry->scene->view[v->target].name),
                             .psnr = psnr,
                             .sources = (int)v->sources,
                             .source = (const lf_image *const *)k->source,
                             .rendered = r->image,
                             .truth = truth,
                             .depth = r->depth,
                             .near = v->near,
                             .far = v->far};
    r->image = NULL;
    r->depth = NULL;
}

static void free_rows(evaluation *e)
{
    for (long i = 0; i < e->rows; i++) {
        kept_row *k = &e->row[i];
        for (int s = 0; s < k->row.sources; s++)
            lf_image_free(k->source[s]);
        free(k->source);
        free((void *)(uintptr_t)k->row.scene);
        free((void *)(uintptr_t)k->row.view);
        free((void *)(uintptr_t)k->row.depth);
        lf_image_free((lf_image *)(uintptr_t)k->row.rendered);
        lf_image_free((lf_image *)(uintptr_t)k->row.truth);
    }
    free(e->row);
}

/* All frames of one target; frame 0's rendering is kept for the pictures. */
static lf_status render_frames(evaluation *e, const lf_scene_entry *entry, long target,
                               const lf_image *truth, lf_rendering frame[LF_ROTATIONS],
                               lf_render_figures *f, lf_error *err)
{
    const int frames = e->turns ? LF_ROTATIONS : 1;
    for (int k = 0; k < frames; k++) {
        const lf_motion motion = lf_render_rotation(k);
        const lf_render_view_options o = view_options(e, e->turns ? &motion : NULL);
        lf_render_view v;
        LF_TRY(lf_render_view_open(entry, target, &o, &v, err));
        frame[k] = lf_render_whole(e->loaded, &v);
        lf_render_view_release(&v);
        f->seconds += frame[k].seconds / frames;
        f->rows = (double)frame[k].rows;
        LF_TRY(score(e, frame[k].image, truth, 1.0 / frames, f, err));
    }
    if (!e->turns)
        return LF_OK;
    const lf_image *all[LF_ROTATIONS];
    for (int k = 0; k < frames; k++)
        all[k] = frame[k].image;
    return lf_pixel_variance(frames, all, &f->pixel_variance, err);
}

static lf_status finish_view(evaluation *e, const lf_render_view *v, lf_rendering *r,
                             lf_image **truth, lf_render_figures *f, lf_error *err)
{
    if (e->job->baselines)
        LF_TRY(score_baselines(e, v, *truth, f, err));
    lf_render_report_add(&e->report, number_of(e, v), e->scene[number_of(e, v)],
                         v->entry->scene->view[v->target].name, f);
    if (!e->job->out)
        return LF_OK;
    LF_TRY(write_image(e, v, r->image, "rendered", err));
    LF_TRY(write_image(e, v, *truth, "true", err));
    if (e->rows < e->job->pictures) {
        keep_row(e, v, r, *truth, f->psnr);
        *truth = NULL;
    }
    return LF_OK;
}

static lf_status score_view(evaluation *e, const lf_scene_entry *entry, long target, lf_error *err)
{
    const lf_render_view_options o = view_options(e, NULL);
    lf_render_view v;
    LF_TRY(lf_render_view_open(entry, target, &o, &v, err));
    lf_image *truth = lf_picture_of(&v.pixels);
    lf_rendering frame[LF_ROTATIONS] = {{0}};
    lf_render_figures f = lf_render_figures_none();
    f.psnr = f.ssim = f.seconds = f.lpips = 0;
    lf_status status = render_frames(e, entry, target, truth, frame, &f, err);
    if (!e->lpips)
        f.lpips = NAN;
    if (status == LF_OK)
        status = finish_view(e, &v, &frame[0], &truth, &f, err);
    for (int k = 0; k < LF_ROTATIONS; k++)
        lf_rendering_free(&frame[k]);
    lf_image_free(truth);
    lf_render_view_release(&v);
    return status;
}

/* Says which split is scored: the training's where a scene has no views of the job's. */
static void note_split(evaluation *e, long items, const lf_render_item *item)
{
    long trained = 0, without = 0, scenes = 0;
    for (long i = 0; i < items; i++) {
        const bool first = i == 0 || item[i].entry != item[i - 1].entry;
        const bool own = strcmp(lf_render_split(item[i].entry, e->job->split), e->job->split) == 0;
        trained += !own;
        without += first && !own;
        scenes += first;
    }
    e->report.split = lf_render_split_name(e->job->split, items, trained);
    if (without && !e->job->quiet)
        printf("%ld scenes of %ld have no %s views: their training views are scored\n", without,
               scenes, e->job->split);
}

static lf_status score_items(evaluation *e, long items, const lf_render_item *item, lf_error *err)
{
    const lf_scene *scene = NULL;
    const double started = lf_seconds_now();
    lf_status status = LF_OK;
    for (long i = 0; status == LF_OK && i < items; i++) {
        if (scene != item[i].entry->scene) {
            if (scene)
                lf_file_names_free(scene->views, e->view);
            scene = item[i].entry->scene;
            e->view = lf_view_file_names(scene);
        }
        status = score_view(e, item[i].entry, item[i].target, err);
        lf_progress_update(&e->progress, i + 1, lf_seconds_now() - started, "PSNR %.2f dB",
                           lf_render_report_mean(&e->report, -1).psnr);
    }
    if (scene)
        lf_file_names_free(scene->views, e->view);
    return status;
}

static lf_status score_scenes(evaluation *e, const lf_scene_set *set, lf_error *err)
{
    long items;
    lf_render_item *item =
        lf_render_items(e->loaded->cfg, e->job->split, e->job->scenes, set, &items);
    note_split(e, items, item);
    e->progress = lf_progress_start(stdout, "view", 0, items, e->job->quiet);
    const lf_status status = score_items(e, items, item, err);
    lf_progress_end(&e->progress);
    free(item);
    return status;
}

static lf_status write_results(evaluation *e, lf_error *err)
{
    const lf_render_job *job = e->job;
    e->report.peak_rss_mb = lf_peak_rss_mb();
    if (!job->quiet)
        lf_render_report_print(&e->report, stdout);
    if (job->json)
        LF_TRY(lf_render_report_write(&e->report, job->json, err));
    if (!job->out || e->rows == 0)
        return LF_OK;
    char path[PATH_MAX];
    snprintf(path, sizeof path, "%.4000s/cost.png", job->out);
    LF_TRY(lf_render_report_plot(&e->report, path, err));
    snprintf(path, sizeof path, "%.4000s/montage.png", job->out);
    lf_render_row *rows = calloc((size_t)e->rows, sizeof *rows);
    LF_REQUIRE(rows, "out of memory");
    for (long i = 0; i < e->rows; i++)
        rows[i] = e->row[i].row;
    const lf_render_montage_options montage = lf_render_montage_defaults();
    const lf_status status = lf_render_montage_write(path, e->rows, rows, &montage, err);
    free(rows);
    if (status == LF_OK && !job->quiet)
        printf("picture: %s (source views | rendered | true | error | depth)\n", path);
    return status;
}

static lf_status parse_setting(const char *name, bool *turns, lf_error *err)
{
    lf_setting setting = LF_SETTING_I;
    if (name)
        LF_TRY(lf_setting_parse(name, &setting, err));
    if (setting != LF_SETTING_I && setting != LF_SETTING_SO3)
        return lf_fail(err, LF_BAD_INPUT, "--setting %s: renderers have I and SO3", name);
    *turns = setting == LF_SETTING_SO3;
    return LF_OK;
}

static lf_status evaluate(evaluation *e, lf_error *err)
{
    lf_scene_set *set;
    LF_TRY(lf_render_job_scenes(e->loaded->cfg, e->job->split, e->job->quiet, &set, err));
    e->set = set;
    e->scene = lf_scene_file_names(set);
    lf_status status = score_scenes(e, set, err);
    if (status == LF_OK)
        status = write_results(e, err);
    lf_file_names_free(set->count, e->scene);
    lf_scene_set_close(set);
    return status;
}

lf_status lf_render_evaluate(lf_loaded_renderer *l, const lf_render_job *job, lf_error *err)
{
    evaluation e = {.loaded = l, .job = job};
    LF_TRY(parse_setting(job->setting, &e.turns, err));
    if (job->out)
        LF_TRY(lf_make_folders(job->out, err));
    if (job->lpips_weights)
        LF_TRY(lf_lpips_open(job->lpips_weights, job->lpips_net, &e.lpips, err));
    e.row = calloc((size_t)(job->pictures > 0 ? job->pictures : 1), sizeof *e.row);
    LF_REQUIRE(e.row, "out of memory");
    e.report = (lf_render_report){.model = lf_config_choice(l->cfg, "model.type"),
                                  .train_setting = "I",
                                  .eval_setting = e.turns ? "SO3" : "I",
                                  .sources = (int)lf_render_sources(l),
                                  .samples = (int)(l->model.config.samples + l->model.config.fine),
                                  .lpips = e.lpips};
    const lf_status status = evaluate(&e, err);
    free_rows(&e);
    lf_render_report_clear(&e.report);
    lf_lpips_free(e.lpips);
    return status;
}
