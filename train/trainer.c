/* trainer.c: the training loop. See trainer.h. */
#include <math.h>
#include <unistd.h>

#include "autograd/random.h"
#include "train/progress.h"
#include "train/run_dir.h"
#include "train/schedule.h"
#include "train/trainer.h"

typedef struct trainer {
    const lf_config *cfg;
    const lf_train_options *options;
    lf_shapes *shapes, *val;
    lf_store *store;
    lf_recon model;
    lf_recon_work *work;
    lf_adam adam;
    lf_batches *batches;
    lf_run *run;
    lf_training_state state;
    lf_progress progress;
    double started;                    /* clock at the start of the loop, less state.seconds */
    double data_seconds, step_seconds; /* since the last log line */
    long timed;                        /* step at which these two began */
    lf_real *statistics;               /* what a step changes before it is known to be good */
    long saved;                        /* step of the last checkpoint; -1 none */
    lf_validation validation;
    bool validated; /* at the current step */
} trainer;

/* ---- before the first step ---- */

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

static lf_status open_split(const trainer *t, const char *split, lf_shapes **shapes, lf_error *err)
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
static lf_status open_data(trainer *t, lf_error *err)
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

static lf_status prepare(const trainer *t, const char *split, lf_shapes *shapes, lf_error *err)
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

static void build_model(trainer *t)
{
    const lf_recon_config config = lf_recon_config_from(t->cfg);
    t->store = lf_store_create((uint64_t)lf_config_int(t->cfg, "train.seed"));
    lf_recon_init(&t->model, t->store, &config);
    const lf_adam_config adam = {.beta1 = lf_config_real(t->cfg, "train.beta1"),
                                 .beta2 = lf_config_real(t->cfg, "train.beta2"),
                                 .eps = lf_config_real(t->cfg, "train.eps"),
                                 .weight_decay = lf_config_real(t->cfg, "train.weight_decay"),
                                 .decoupled = lf_config_is(t->cfg, "train.optimizer", "adamw")};
    lf_adam_init(&t->adam, &adam, t->store);
    t->work = lf_recon_work_create(&t->model, lf_config_int(t->cfg, "train.tile_points"));
    lf_recon_work_check(t->work, t->options->check_finite);
    t->statistics = calloc((size_t)lf_store_size(t->store), sizeof *t->statistics);
    LF_REQUIRE(t->statistics, "out of memory for %ld numbers", lf_store_size(t->store));
}

static lf_sdf_loss_config loss_config(const lf_config *cfg)
{
    return (lf_sdf_loss_config){lf_config_real(cfg, "loss.scale"),
                                lf_config_real(cfg, "loss.clamp"), lf_config_real(cfg, "loss.near"),
                                lf_config_real(cfg, "loss.near_weight")};
}

/* Run one step on a copy of the model, to say what memory a step takes. */
static void print_plan(trainer *t)
{
    lf_store *store = lf_store_create(0);
    lf_recon model;
    lf_recon_init(&model, store, &t->model.config);
    lf_recon_work *work = lf_recon_work_create(&model, lf_config_int(t->cfg, "train.tile_points"));
    const lf_batch b = lf_batches_at(t->batches, t->state.step);
    const lf_sdf_loss_config loss = loss_config(t->cfg);
    lf_recon_step(work, b.images, b.image, &b.points, b.sdf, &loss);
    const double tapes = (double)lf_recon_work_bytes(work) * 1e-6;
    const double cache = (double)lf_shapes_bytes(t->shapes) * 1e-6 +
                         (t->val ? (double)lf_shapes_bytes(t->val) * 1e-6 : 0);
    const double parameters = 4.0 * (double)lf_store_size(store) * sizeof(lf_real) * 1e-6;
    printf("model: %ld parameters, %.3g GFLOP a step (forward and backward)\n",
           lf_store_trainable(store),
           6e-9 * lf_recon_macs(&model, b.images, b.points.count, b.points.views));
    printf("memory: %.0f MB of views and points, %.0f MB of tapes (features and tiles), %.1f MB of "
           "parameters, gradients and moments\n",
           cache, tapes, parameters);
    lf_recon_work_free(work);
    lf_recon_free(&model);
    lf_store_free(store);
}

/* What can be refused is refused before the shapes are rendered. */
static lf_status check_start(trainer *t, lf_error *err)
{
    if (t->options->resume)
        LF_TRY(lf_checkpoint_read(t->options->resume, t->store, &t->adam, err));
    if (t->options->resume && !t->options->fresh)
        return LF_OK;
    return lf_run_vacant(t->options->out, err);
}

static lf_status open_run(trainer *t, lf_error *err)
{
    if (t->options->resume && !t->options->fresh)
        return lf_run_open(t->options->out, t->state.step, &t->run, err);
    char *text = lf_config_text(t->cfg);
    const lf_status status = lf_run_create(t->options->out, text, &t->run, err);
    free(text);
    return status;
}

/* ---- the loop ---- */

static lf_status save(trainer *t, lf_error *err)
{
    if (t->saved == t->state.step)
        return LF_OK;
    t->state.seconds = lf_seconds_now() - t->started;
    char *path = lf_run_checkpoint(t->run, t->state.step);
    lf_status status = lf_checkpoint_write(path, t->store, &t->adam, &t->state, t->cfg, NULL, err);
    free(path);
    if (status == LF_OK)
        status = lf_run_saved(t->run, t->state.step, t->validated ? t->validation.loss : NAN,
                              (int)lf_config_int(t->cfg, "train.keep"), err);
    if (status == LF_OK)
        t->saved = t->state.step;
    return status;
}

static lf_status log_step(trainer *t, double lr, double norm, lf_error *err)
{
    const double wall = t->step_seconds + t->data_seconds;
    json_t *line = json_object();
    json_object_set_new(line, "step", json_integer(t->state.step));
    lf_json_real(line, "seconds", lf_seconds_now() - t->started);
    lf_json_real(line, "loss", t->state.loss_sum / (double)t->state.loss_steps);
    lf_json_real(line, "lr", lr);
    lf_json_real(line, "grad_norm", norm);
    lf_json_real(line, "steps_per_s", (double)(t->state.step - t->timed) / wall);
    lf_json_real(line, "data_share", t->data_seconds / wall);
    lf_json_real(line, "peak_rss_mb", lf_peak_rss_mb());
    json_object_set_new(line, "skipped", json_integer(t->state.skipped));
    if (t->validated) {
        lf_json_real(line, "val_loss", t->validation.loss);
        lf_json_real(line, "val_iou", t->validation.iou);
    }
    t->timed = t->state.step;
    t->state.loss_steps = 0;
    t->state.loss_sum = t->step_seconds = t->data_seconds = 0;
    return lf_run_log(t->run, line, err);
}

/* Running statistics, which the forward of a step changes: put aside, and brought back if the step
 * is skipped. */
static void copy_statistics(trainer *t, bool back)
{
    for (int i = 0; i < lf_store_count(t->store); i++) {
        const lf_parameter *p = lf_store_at(t->store, i);
        lf_real *kept = t->statistics + p->offset, *value = lf_values(p);
        if (!p->trainable)
            memcpy(back ? value : kept, back ? kept : value, (size_t)p->size * sizeof *kept);
    }
}

/* An update, or a skipped step if something is not finite. */
static lf_status update(trainer *t, double loss, double lr, double *norm, lf_error *err)
{
    *norm = lf_gradient_norm(t->store);
    const double clip = lf_config_real(t->cfg, "train.clip");
    if (isfinite(loss) && isfinite(*norm)) {
        if (clip > 0 && *norm > clip)
            lf_gradient_scale(t->store, clip / *norm);
        lf_adam_step(&t->adam, t->store, lr);
        t->state.bad_in_a_row = 0;
        return LF_OK;
    }
    const long most = lf_config_int(t->cfg, "train.max_bad_steps");
    const char *op = lf_recon_nonfinite(t->work);
    copy_statistics(t, true);
    t->state.skipped++;
    t->state.bad_in_a_row++;
    lf_progress_say(&t->progress, "step %ld skipped: loss %g, gradient norm %g%s%s",
                    t->state.step + 1, loss, *norm, op ? ", first in the " : "", op ? op : "");
    if (t->state.bad_in_a_row < most)
        return LF_OK;
    return lf_fail(
        err, LF_FAILED,
        "%ld steps in a row gave a loss or gradient that is not finite, the last at step "
        "%ld; %s %s. Lower train.lr (now %g) or set train.clip; --check-finite names the op",
        most, t->state.step + 1,
        t->saved >= 0 ? "the last good checkpoint is kept in" : "no checkpoint was saved yet in",
        t->options->out, lf_config_real(t->cfg, "train.lr"));
}

static void validate(trainer *t)
{
    t->validation = lf_validate(t->work, t->cfg, t->val);
    t->validated = true;
    if (!t->options->quiet)
        lf_progress_say(&t->progress, "step %ld: validation loss %.4f, IoU of signs %.3f",
                        t->state.step, t->validation.loss, t->validation.iou);
}

static lf_status one_step(trainer *t, lf_error *err)
{
    const lf_sdf_loss_config loss_keys = loss_config(t->cfg);
    const long total = lf_config_int(t->cfg, "train.steps");
    const double lr = lf_learning_rate(t->cfg, t->state.step), t0 = lf_seconds_now();
    const lf_batch b = lf_batches_at(t->batches, t->options->overfit ? 0 : t->state.step);
    const double t1 = lf_seconds_now();
    copy_statistics(t, false);
    const double loss = lf_recon_step(t->work, b.images, b.image, &b.points, b.sdf, &loss_keys);
    double norm;
    LF_TRY(update(t, loss, lr, &norm, err));
    t->state.step++;
    t->data_seconds += t1 - t0;
    t->step_seconds += lf_seconds_now() - t1;
    t->state.loss_sum += loss;
    t->state.loss_steps++;
    t->validated = false;
    const long step = t->state.step;
    const bool last = step == total;
    if (t->val && (last || step % lf_config_int(t->cfg, "train.val_every") == 0))
        validate(t);
    if (last || t->validated || step % lf_config_int(t->cfg, "train.log_every") == 0)
        LF_TRY(log_step(t, lr, norm, err));
    if (last || step % lf_config_int(t->cfg, "train.checkpoint_every") == 0)
        LF_TRY(save(t, err));
    lf_progress_update(&t->progress, step, lf_seconds_now() - t->started, "loss %.4f", loss);
    return LF_OK;
}

static bool interrupted(const trainer *t)
{
    return t->options->stop && *t->options->stop;
}

static lf_status loop(trainer *t, lf_error *err)
{
    const long steps = lf_config_int(t->cfg, "train.steps");
    t->started = lf_seconds_now() - t->state.seconds;
    t->timed = t->state.step;
    if (t->options->resume && !t->options->fresh)
        t->saved = t->state.step;
    t->progress = lf_progress_start(stdout, "step", t->state.step, steps, t->options->quiet);
    while (t->state.step < steps && !interrupted(t)) {
        const lf_status status = one_step(t, err);
        if (status != LF_OK) {
            lf_progress_end(&t->progress);
            return status;
        }
    }
    lf_progress_end(&t->progress);
    if (t->state.step < steps) {
        LF_TRY(save(t, err));
        return lf_fail(err, LF_STOPPED,
                       "stopped after step %ld of %ld, saved; go on with: elf-train --resume %s",
                       t->state.step, steps, t->options->out);
    }
    return save(t, err);
}

/* Refuse a step that this machine cannot hold, before an hour of rendering. An estimate from below:
 * the outputs of all convolutions and norms, and the samples with their gradient. */
static lf_status check_memory(const trainer *t, lf_error *err)
{
    const lf_recon_config *c = &t->model.config;
    const double shapes = (double)lf_config_int(t->cfg, "train.shapes_per_step");
    const double points = shapes * (double)lf_config_int(t->cfg, "train.points_per_shape");
    const double size = (double)c->image_size;
    const double image = lf_backbone_macs(&t->model.backbone, c->image_size, c->image_size).kept +
                         size * size * c->backbone.in_channels;
    const double numbers =
        LF_CUBE_VIEWS * (shapes * image + 2 * points * (double)t->model.feature_count);
    const double needed = numbers * sizeof(lf_real);
    const double there = (double)sysconf(_SC_PHYS_PAGES) * (double)sysconf(_SC_PAGE_SIZE);
    if (needed <= there)
        return LF_OK;
    return lf_fail(
        err, LF_BAD_INPUT,
        "a step would keep at least %.1f GB of feature maps and samples, and this machine "
        "has %.1f GB: lower data.image_size, train.shapes_per_step, "
        "train.points_per_shape or model.fields",
        1e-9 * needed, 1e-9 * there);
}

static lf_status train_all(trainer *t, lf_error *err)
{
    build_model(t);
    LF_TRY(check_memory(t, err));
    LF_TRY(check_start(t, err));
    const long steps = lf_config_int(t->cfg, "train.steps");
    if (t->options->resume && !t->options->fresh && t->state.step >= steps) {
        if (!t->options->quiet)
            printf("nothing to do: step %ld of %ld; to go on, --set train.steps=MORE\n",
                   t->state.step, steps);
        return LF_OK;
    }
    LF_TRY(open_data(t, err));
    if (!t->options->quiet)
        printf("run folder: %s\n", t->options->out);
    LF_TRY(prepare(t, "train", t->shapes, err));
    if (t->val)
        LF_TRY(prepare(t, "val", t->val, err));
    t->batches = lf_batches_create(t->cfg, t->shapes);
    LF_TRY(open_run(t, err));
    if (!t->options->quiet)
        print_plan(t);
    return loop(t, err);
}

lf_status lf_train(const lf_config *cfg, const lf_train_options *options, lf_error *err)
{
    trainer t = {.cfg = cfg, .options = options, .state = options->start, .saved = -1};
    const lf_status status = train_all(&t, err);
    lf_run_close(t.run);
    lf_batches_free(t.batches);
    lf_recon_work_free(t.work);
    lf_adam_free(&t.adam);
    lf_recon_free(&t.model);
    lf_store_free(t.store);
    free(t.statistics);
    lf_shapes_close(t.val);
    lf_shapes_close(t.shapes);
    return status;
}
