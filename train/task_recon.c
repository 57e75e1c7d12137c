/* task_recon.c: reconstruction as the training loop sees it: shapes, signed distances, the model.
 */
#include <math.h>
#include <unistd.h>

#include "train/batch.h"
#include "train/progress.h"
#include "train/recon_data.h"
#include "train/task.h"

typedef struct recon_task {
    const lf_config *cfg;
    const lf_task_options *options;
    lf_shapes *shapes, *val;
    lf_store *store;
    lf_recon model;
    lf_recon_work *work;
    lf_batches *batches;
} recon_task;

/* ---- data ---- */

typedef struct prepare_progress {
    lf_progress progress;
    double started;
} prepare_progress;

static void prepared(void *context, long done, long total)
{
    prepare_progress *p = context;
    (void)total;
    lf_progress_update(&p->progress, done, lf_seconds_now() - p->started,
                       "rendering and sampling shapes");
}

static lf_status open_split(const recon_task *t, const char *split, lf_shapes **shapes,
                            lf_error *err)
{
    const lf_shapes_options options = lf_shapes_options_from(t->cfg, split);
    LF_TRY(lf_shapes_open(&options, shapes, err));
    const double mb = (double)lf_shapes_bytes(*shapes) * 1e-6;
    const double most = (double)lf_config_int(t->cfg, "data.cache_mb");
    if (mb <= most)
        return LF_OK;
    return lf_fail(err, LF_BAD_INPUT,
                   "the views and points of %ld shapes take %.0f MB, more than data.cache_mb = "
                   "%.0f: raise it, or lower data.draws, data.shapes or data.points_*",
                   lf_shapes_count(*shapes), mb, most);
}

/* Both splits, before the first is rendered. */
static lf_status open_splits(recon_task *t, lf_error *err)
{
    const long val = lf_config_int(t->cfg, "data.val_shapes");
    LF_TRY(open_split(t, "train", &t->shapes, err));
    if (val == 0)
        return LF_OK;
    const lf_status status = open_split(t, "val", &t->val, err);
    return status == LF_OK
               ? LF_OK
               : lf_error_context(err, status, "data.val_shapes = %ld (0: no validation)", val);
}

static lf_status prepare(const recon_task *t, const char *split, lf_shapes *shapes, lf_error *err)
{
    prepare_progress p = {
        lf_progress_start(stdout, "shape", 0, lf_shapes_count(shapes), t->options->quiet),
        lf_seconds_now()};
    const lf_status status = lf_shapes_prepare(shapes, prepared, &p, err);
    lf_progress_end(&p.progress);
    LF_TRY(status);
    long doubtful, samples;
    lf_shapes_doubtful(shapes, &doubtful, &samples);
    if (!t->options->quiet)
        printf("%s: %ld shapes, %.0f MB; sign doubtful at %.2f %% of %ld points\n", split,
               lf_shapes_count(shapes), (double)lf_shapes_bytes(shapes) * 1e-6,
               100.0 * (double)doubtful / (double)samples, samples);
    return LF_OK;
}

static lf_status open_data(void *self, lf_error *err)
{
    recon_task *t = self;
    LF_TRY(open_splits(t, err));
    LF_TRY(prepare(t, "train", t->shapes, err));
    if (t->val)
        LF_TRY(prepare(t, "val", t->val, err));
    t->batches = lf_batches_create(t->cfg, &t->model, t->shapes);
    return LF_OK;
}

/* ---- the step ---- */

static lf_sdf_loss_config loss_config(const lf_config *cfg)
{
    return (lf_sdf_loss_config){lf_config_real(cfg, "loss.scale"),
                                lf_config_real(cfg, "loss.clamp"), lf_config_real(cfg, "loss.near"),
                                lf_config_real(cfg, "loss.near_weight")};
}

/* Run one step on a copy of the model, to say what memory a step takes. */
static void print_plan(void *self, long step)
{
    recon_task *t = self;
    lf_store *store = lf_store_create(0);
    lf_recon model;
    lf_recon_init(&model, store, &t->model.config);
    lf_recon_work *work = lf_recon_work_create(&model, lf_config_int(t->cfg, "train.tile_points"));
    const lf_batch b = lf_batches_at(t->batches, step);
    const lf_sdf_loss_config loss = loss_config(t->cfg);
    lf_recon_step(work, &b.images, &b.points, b.sdf, &loss);
    const double tapes = (double)lf_recon_work_bytes(work) * 1e-6;
    const double cache = (double)lf_shapes_bytes(t->shapes) * 1e-6 +
                         (t->val ? (double)lf_shapes_bytes(t->val) * 1e-6 : 0);
    const double parameters = 4.0 * (double)lf_store_size(store) * sizeof(lf_real) * 1e-6;
    printf("model: %ld parameters, %.3g GFLOP a step (forward and backward)\n",
           lf_store_trainable(store),
           6e-9 * lf_recon_macs(&model, b.images.count, b.points.count, b.points.views));
    printf("memory: %.0f MB of views and points, %.0f MB of tapes (features and tiles), %.1f MB of "
           "parameters, gradients and moments\n",
           cache, tapes, parameters);
    lf_recon_work_free(work);
    lf_recon_free(&model);
    lf_store_free(store);
}

/* Trainable numbers of what a network computes of a shape as a whole. */
static long object_parameters(const recon_task *t)
{
    long n = 0;
    for (int i = 0; i < lf_store_count(t->store); i++) {
        const lf_parameter *p = lf_store_at(t->store, i);
        if (p->trainable && p->offset < t->model.head_first)
            n += p->size;
    }
    return n - lf_trainable_in(t->store, "backbone.");
}

static void count(const void *self, lf_cost *out)
{
    const recon_task *t = self;
    const lf_recon *m = &t->model;
    const lf_recon_cost c = lf_recon_costs(m, LF_CUBE_VIEWS);
    const long shapes = lf_config_int(t->cfg, "train.shapes_per_step");
    const long points = shapes * lf_config_int(t->cfg, "train.points_per_shape");
    const long backbone = lf_trainable_in(t->store, "backbone."), objects = object_parameters(t);
    char text[LF_COST_TEXT];
    snprintf(text, sizeof text, "a view of %ld x %ld", m->config.image_size, m->config.image_size);
    lf_cost_add(out, "backbone", backbone, c.image, text);
    snprintf(text, sizeof text, "a shape of %d views", LF_CUBE_VIEWS);
    if (objects > 0 || c.object > 0)
        lf_cost_add(out, "shape", objects, c.object, text);
    snprintf(text, sizeof text, "a point that %d views see", LF_CUBE_VIEWS);
    lf_cost_add(out, "head", lf_store_trainable(t->store) - backbone - objects, c.point, text);
    out->step_macs = lf_recon_macs(m, shapes * LF_CUBE_VIEWS, points, LF_CUBE_VIEWS);
    snprintf(out->step, sizeof out->step, "%ld shapes, %ld points", shapes, points);
}

/* Refuse a step that this machine cannot hold, before an hour of rendering. An estimate from below:
 * the outputs of all convolutions, and the samples. */
static lf_status check_memory(void *self, lf_error *err)
{
    const recon_task *t = self;
    const lf_recon_cost cost = lf_recon_costs(&t->model, LF_CUBE_VIEWS);
    const double shapes = (double)lf_config_int(t->cfg, "train.shapes_per_step");
    const double points = shapes * (double)lf_config_int(t->cfg, "train.points_per_shape");
    const double numbers =
        shapes * (LF_CUBE_VIEWS * cost.image_kept + cost.object_kept) + points * cost.point_kept;
    const double needed = numbers * sizeof(lf_real);
    const double there = (double)sysconf(_SC_PHYS_PAGES) * (double)sysconf(_SC_PAGE_SIZE);
    if (needed <= there)
        return LF_OK;
    return lf_fail(
        err, LF_BAD_INPUT,
        "a step would keep at least %.1f GB of feature maps and samples, and this machine "
        "has %.1f GB: lower data.image_size, train.shapes_per_step, "
        "train.points_per_shape, model.fields or (fvor) model.grid",
        1e-9 * needed, 1e-9 * there);
}

static lf_status run_step(void *self, long step, double *loss, double *data_seconds, lf_error *err)
{
    recon_task *t = self;
    (void)err;
    const lf_sdf_loss_config config = loss_config(t->cfg);
    const double start = lf_seconds_now();
    const lf_batch b = lf_batches_at(t->batches, step);
    *data_seconds = lf_seconds_now() - start;
    *loss = lf_recon_step(t->work, &b.images, &b.points, b.sdf, &config);
    return LF_OK;
}

static void watch(void *self, lf_profile *profile)
{
    const recon_task *t = self;
    lf_recon_work_watch(t->work, profile);
}

static size_t work_bytes(const void *self)
{
    const recon_task *t = self;
    return lf_recon_work_bytes(t->work);
}

static const char *nonfinite(const void *self)
{
    const recon_task *t = self;
    return lf_recon_nonfinite(t->work);
}

static bool validates(const void *self)
{
    const recon_task *t = self;
    return t->val != NULL;
}

static lf_status validate(void *self, lf_validation *out, lf_error *err)
{
    const recon_task *t = self;
    (void)err;
    const lf_agreement a = lf_validate_shapes(t->work, &t->model, t->cfg, t->val);
    *out = (lf_validation){a.loss, "val_iou", "IoU of signs", a.iou, "val"};
    return LF_OK;
}

static void free_task(void *self)
{
    recon_task *t = self;
    lf_batches_free(t->batches);
    lf_recon_work_free(t->work);
    lf_recon_free(&t->model);
    lf_shapes_close(t->val);
    lf_shapes_close(t->shapes);
    free(t);
}

void lf_task_recon(const lf_config *cfg, const lf_task_options *options, lf_task *out)
{
    recon_task *t = calloc(1, sizeof *t);
    LF_REQUIRE(t, "out of memory");
    const lf_recon_config config = lf_recon_config_from(cfg);
    t->cfg = cfg;
    t->options = options;
    t->store = lf_store_create((uint64_t)lf_config_int(cfg, "train.seed"));
    lf_recon_init(&t->model, t->store, &config);
    t->work = lf_recon_work_create(&t->model, lf_config_int(cfg, "train.tile_points"));
    lf_recon_work_check(t->work, options->check_finite);
    *out = (lf_task){.self = t,
                     .store = t->store,
                     .count = count,
                     .check = check_memory,
                     .open = open_data,
                     .print_plan = print_plan,
                     .step = run_step,
                     .watch = watch,
                     .work_bytes = work_bytes,
                     .nonfinite = nonfinite,
                     .validates = validates,
                     .validate = validate,
                     .free = free_task};
}
