/* trainer.c: the training loop. See trainer.h. */
#include <math.h>
#include <omp.h>

#include "autograd/kernels/limit.h"
#include "train/profile_report.h"
#include "train/progress.h"
#include "train/run_dir.h"
#include "train/schedule.h"
#include "train/task.h"
#include "train/trainer.h"

typedef struct trainer {
    const lf_config *cfg;
    const lf_train_options *options;
    lf_task_options task_options;
    lf_task task;
    lf_store *store; /* the task's */
    lf_adam adam;
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

static void build_model(trainer *t)
{
    lf_task_create(t->cfg, &t->task_options, &t->task);
    t->store = t->task.store;
    const lf_adam_config adam = {.beta1 = lf_config_real(t->cfg, "train.beta1"),
                                 .beta2 = lf_config_real(t->cfg, "train.beta2"),
                                 .eps = lf_config_real(t->cfg, "train.eps"),
                                 .weight_decay = lf_config_real(t->cfg, "train.weight_decay"),
                                 .decoupled = lf_config_is(t->cfg, "train.optimizer", "adamw")};
    lf_adam_init(&t->adam, &adam, t->store);
    t->statistics = calloc((size_t)lf_store_size(t->store), sizeof *t->statistics);
    LF_REQUIRE(t->statistics, "out of memory for %ld numbers", lf_store_size(t->store));
}

/* What can be refused is refused before the shapes are rendered. */
static lf_status check_start(trainer *t, lf_error *err)
{
    if (t->options->resume)
        LF_TRY(lf_checkpoint_read(t->options->resume, t->store, &t->adam, err));
    if (t->options->profile || (t->options->resume && !t->options->fresh))
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
        lf_json_real(line, t->validation.name, t->validation.figure);
        json_object_set_new(line, "val_split", json_string(t->validation.split));
    }
    if (t->task.log)
        t->task.log(t->task.self, line);
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
    const char *op = t->task.nonfinite(t->task.self);
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

static lf_status validate(trainer *t, lf_error *err)
{
    LF_TRY(t->task.validate(t->task.self, &t->validation, err));
    t->validated = true;
    if (!t->options->quiet)
        lf_progress_say(&t->progress, "step %ld: validation loss %.4g, %s %.3f", t->state.step,
                        t->validation.loss, t->validation.label, t->validation.figure);
    return LF_OK;
}

/* What is due after a step: validation, a line of metrics, a checkpoint. */
static lf_status after_step(trainer *t, double lr, double norm, lf_error *err)
{
    const long step = t->state.step;
    const bool last = step == lf_config_int(t->cfg, "train.steps");
    if (t->task.validates(t->task.self) &&
        (last || step % lf_config_int(t->cfg, "train.val_every") == 0))
        LF_TRY(validate(t, err));
    if (last || t->validated || step % lf_config_int(t->cfg, "train.log_every") == 0)
        LF_TRY(log_step(t, lr, norm, err));
    if (last || step % lf_config_int(t->cfg, "train.checkpoint_every") == 0)
        LF_TRY(save(t, err));
    return LF_OK;
}

/* Batch, forward and backward, update. */
static lf_status compute_step(trainer *t, double lr, double *loss, double *norm,
                              lf_step_times *times, lf_error *err)
{
    const double start = lf_seconds_now();
    copy_statistics(t, false);
    LF_TRY(t->task.step(t->task.self, t->options->overfit ? 0 : t->state.step, loss, &times->data,
                        err));
    const double computed = lf_seconds_now();
    LF_TRY(update(t, *loss, lr, norm, err));
    t->state.step++;
    const double end = lf_seconds_now();
    times->compute = computed - start - times->data;
    times->update = end - computed;
    times->all = end - start;
    return LF_OK;
}

static lf_status one_step(trainer *t, lf_error *err)
{
    const double lr = lf_learning_rate(t->cfg, t->state.step);
    double loss, norm;
    lf_step_times times;
    LF_TRY(compute_step(t, lr, &loss, &norm, &times, err));
    t->data_seconds += times.data;
    t->step_seconds += times.compute + times.update;
    t->state.loss_sum += loss;
    t->state.loss_steps++;
    t->validated = false;
    LF_TRY(after_step(t, lr, norm, err));
    lf_progress_update(&t->progress, t->state.step, lf_seconds_now() - t->started, "loss %.4g",
                       loss);
    return LF_OK;
}

static bool interrupted(const trainer *t)
{
    return t->options->stop && *t->options->stop;
}

/* Read or make the data. An interrupt after that is the loop's. */
static lf_status open_data(trainer *t, lf_error *err)
{
    fflush(stdout); /* an interrupt while the data are made ends the program at once */
    LF_TRY(t->task.open(t->task.self, err));
    if (t->options->begun)
        *t->options->begun = 1;
    return LF_OK;
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

/* ---- instead of training ---- */

enum { WARM_UP = 5, LIMIT_RUNS = 100, LIMIT_RUNS_A_STEP = 4 };

/* At the start, and between the steps: a machine that others use is seldom undisturbed. */
static double measure_limit(int runs, double limit)
{
    for (int i = 0; i < runs; i++)
        limit = fmax(limit, lf_limit_now(omp_get_max_threads()));
    return limit;
}

/* Steps that change the parameters, as in training; put down in `step` unless it is NULL. */
static lf_status measured_steps(trainer *t, long steps, lf_measured_step *step, double *limit,
                                lf_error *err)
{
    for (long i = 0; i < steps; i++) {
        double loss, norm;
        lf_step_times times;
        if (interrupted(t))
            return lf_fail(err, LF_STOPPED, "stopped; a profile of fewer steps is not printed");
        t->task.watch(t->task.self, step ? step[i].profile : NULL);
        const lf_status status =
            compute_step(t, lf_learning_rate(t->cfg, t->state.step), &loss, &norm, &times, err);
        t->task.watch(t->task.self, NULL);
        LF_TRY(status);
        if (step)
            step[i].seconds = times;
        *limit = measure_limit(LIMIT_RUNS_A_STEP, *limit);
    }
    return LF_OK;
}

static lf_status profile_steps(trainer *t, lf_measured_step *step, lf_error *err)
{
    lf_step_profile p = {.model = lf_config_choice(t->cfg, "model.type"),
                         .warm_up = WARM_UP,
                         .all = t->options->profile,
                         .threads = omp_get_max_threads(),
                         .limit = measure_limit(LIMIT_RUNS, 0)};
    LF_TRY(measured_steps(t, WARM_UP, NULL, &p.limit, err));
    LF_TRY(measured_steps(t, p.all, step, &p.limit, err));
    p.tapes = t->task.work_bytes(t->task.self);
    p.rss_mb = lf_peak_rss_mb();
    lf_step_profile_choose(&p, step);
    lf_step_profile_print(stdout, &p);
    return t->options->json ? lf_step_profile_write(t->options->json, &p, err) : LF_OK;
}

static lf_status profile(trainer *t, lf_error *err)
{
    const long steps = t->options->profile;
    LF_TRY(open_data(t, err));
    t->progress = lf_progress_start(stdout, "step", 0, steps, t->options->quiet);
    lf_measured_step *step = calloc((size_t)steps, sizeof *step);
    LF_REQUIRE(step, "out of memory for %ld steps", steps);
    for (long i = 0; i < steps; i++)
        step[i].profile = lf_profile_create();
    const lf_status status = profile_steps(t, step, err);
    for (long i = 0; i < steps; i++)
        lf_profile_free(step[i].profile);
    free(step);
    return status;
}

static lf_status train_all(trainer *t, lf_error *err)
{
    build_model(t);
    LF_TRY(t->task.check(t->task.self, err));
    LF_TRY(check_start(t, err));
    if (t->options->profile)
        return profile(t, err);
    const long steps = lf_config_int(t->cfg, "train.steps");
    if (t->options->resume && !t->options->fresh && t->state.step >= steps) {
        if (!t->options->quiet)
            printf("nothing to do: step %ld of %ld; to go on, --set train.steps=MORE\n",
                   t->state.step, steps);
        return LF_OK;
    }
    if (!t->options->quiet)
        printf("run folder: %s\n", t->options->out);
    LF_TRY(open_data(t, err));
    LF_TRY(open_run(t, err));
    if (!t->options->quiet)
        t->task.print_plan(t->task.self, t->state.step);
    return loop(t, err);
}

lf_status lf_train(const lf_config *cfg, const lf_train_options *options, lf_error *err)
{
    trainer t = {.cfg = cfg,
                 .options = options,
                 .task_options = {options->quiet, options->check_finite},
                 .state = options->start,
                 .saved = -1};
    const lf_status status = train_all(&t, err);
    lf_run_close(t.run);
    lf_adam_free(&t.adam);
    lf_task_free(&t.task);
    free(t.statistics);
    return status;
}

/* ---- tasks ---- */

void lf_task_create(const lf_config *cfg, const lf_task_options *options, lf_task *out)
{
    if (lf_config_renders(cfg))
        lf_task_render(cfg, options, out);
    else
        lf_task_recon(cfg, options, out);
}

void lf_task_free(lf_task *task)
{
    task->free(task->self);
    lf_store_free(task->store);
}
