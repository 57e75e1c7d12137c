/* task_render.c: rendering as the training loop sees it: scenes, rays, the model. */
#include <math.h>
#include <unistd.h>

#include "train/progress.h"
#include "train/render_data.h"
#include "train/task.h"

enum { VAL_STEP = 4 }; /* validation renders every so-manieth pixel both ways */

typedef struct render_task {
    const lf_config *cfg;
    const lf_task_options *options;
    lf_scene_set *scenes, *val;
    lf_store *store;
    lf_renderer model;
    lf_render_work *work;
    lf_render_batches *batches;
    long rays, counted; /* since the last line of metrics */
} render_task;

/* ---- data -------------------------------------------------------------------------------------
 */

typedef struct open_progress {
    lf_progress progress;
    double started;
} open_progress;

static void opened(void *context, long done, long total)
{
    open_progress *p = context;
    p->progress.total = total;
    lf_progress_update(&p->progress, done, lf_seconds_now() - p->started, "opening scenes");
}

static lf_status open_split(const render_task *t, const char *split, lf_scene_set **out,
                            lf_error *err)
{
    open_progress p = {lf_progress_start(stdout, "scene", 0, 1, t->options->quiet),
                       lf_seconds_now()};
    const lf_status status = lf_render_scenes(t->cfg, split, opened, &p, out, err);
    lf_progress_end(&p.progress);
    if (status == LF_OK && *out && !t->options->quiet)
        lf_render_describe(stdout, split, *out);
    return status;
}

/* Scenes whose own training views are validated on. */
static long without_val(const lf_scene_set *set)
{
    long without = 0;
    for (long i = 0; i < set->count; i++)
        without += strcmp(lf_render_split(&set->entry[i], "val"), "val") != 0;
    return without;
}

static void print_scenes(const render_task *t)
{
    const lf_scene_set *val = t->val ? t->val : t->scenes;
    long views = 0, builtin = 0;
    for (long i = 0; i < t->scenes->count; i++) {
        views += t->scenes->entry[i].count[LF_SPLIT_TRAIN];
        builtin += t->scenes->entry[i].builtin;
    }
    printf("train: %ld scenes, %ld of them built in, %ld views\n", t->scenes->count, builtin,
           views);
    if (lf_config_int(t->cfg, "data.val_shapes") > 0 && without_val(val))
        printf("validation: on training views of %ld scenes of %ld, which have no val views\n",
               without_val(val), val->count);
}

static lf_status open_data(void *self, lf_error *err)
{
    render_task *t = self;
    LF_TRY(open_split(t, "train", &t->scenes, err));
    LF_TRY(open_split(t, "val", &t->val, err));
    LF_TRY(lf_render_batches_create(t->cfg, t->scenes, &t->batches, err));
    if (!t->options->quiet)
        print_scenes(t);
    return LF_OK;
}

/* ---- the step ---------------------------------------------------------------------------------
 */

static lf_status run_step(void *self, long step, double *loss, double *data_seconds, lf_error *err)
{
    render_task *t = self;
    const double start = lf_seconds_now();
    lf_render_batch batch;
    LF_TRY(lf_render_batches_at(t->batches, step, &batch, err));
    *data_seconds = lf_seconds_now() - start;
    long counted;
    *loss = lf_render_step(t->work, &batch, &counted);
    t->rays += batch.rays.count;
    t->counted += counted;
    return LF_OK;
}

static void watch(void *self, lf_profile *profile)
{
    const render_task *t = self;
    lf_render_work_watch(t->work, profile);
}

static size_t work_bytes(const void *self)
{
    const render_task *t = self;
    return lf_render_work_bytes(t->work);
}

/* Rays that too few views see do not count in the loss; which share does is written down. */
static void log_rays(void *self, json_t *line)
{
    render_task *t = self;
    json_object_set_new(line, "rays_counted",
                        json_real(t->rays ? (double)t->counted / (double)t->rays : 0));
    t->rays = t->counted = 0;
}

static const char *nonfinite(const void *self)
{
    const render_task *t = self;
    return lf_render_nonfinite(t->work);
}

/* Multiply-adds of a step, forward. */
static double step_macs(const render_task *t, const lf_render_batch *b)
{
    double macs = (double)b->rays.count * lf_renderer_ray_macs(&t->model);
    for (long v = 0; v < b->views; v++)
        macs += lf_renderer_picture_macs(&t->model, b->source[v].height, b->source[v].width);
    return macs;
}

static void print_plan(void *self, long step)
{
    render_task *t = self;
    lf_store *store = lf_store_create(0);
    lf_renderer model;
    lf_render_batch batch;
    lf_error err;
    lf_renderer_init(&model, store, &t->model.config);
    lf_render_work *work = lf_render_work_create(&model, lf_config_int(t->cfg, "train.tile_rays"));
    if (lf_render_batches_at(t->batches, step, &batch, &err) == LF_OK) {
        lf_render_step(work, &batch, NULL);
        size_t pictures = 0;
        for (long i = 0; i < t->scenes->count; i++)
            pictures += lf_scene_bytes(t->scenes->entry[i].scene);
        printf("model: %ld parameters, %.3g GFLOP a step (forward and backward)\n",
               lf_store_trainable(store), 6e-9 * step_macs(t, &batch));
        printf(
            "memory: %.0f MB of pictures now (at most data.cache_mb = %ld), %.0f MB of tapes and "
            "lanes, %.1f MB of parameters, gradients and moments\n",
            (double)pictures * 1e-6, lf_config_int(t->cfg, "data.cache_mb"),
            (double)lf_render_work_bytes(work) * 1e-6,
            4.0 * (double)lf_store_size(store) * sizeof(lf_real) * 1e-6);
    }
    lf_render_work_free(work);
    lf_renderer_free(&model);
    lf_store_free(store);
}

/* Pictures are read later: as large as they may be, or as built-in ones are. */
static long assumed_edge(const lf_config *cfg)
{
    const long longest = lf_config_int(cfg, "data.longest");
    const bool files = strcmp(lf_config_string(cfg, "data.scenes"), "none") != 0;
    return files && longest > 0 ? longest : lf_config_int(cfg, "data.scene_size");
}

static void count(const void *self, lf_cost *out)
{
    static const char *const name[] = {"coarse", "fine"}, *const prefix[] = {"coarse.", "fine."};
    const render_task *t = self;
    const lf_renderer_config *c = &t->model.config;
    const long edge = assumed_edge(t->cfg), rays = lf_config_int(t->cfg, "train.rays");
    const double picture = lf_renderer_picture_macs(&t->model, edge, edge);
    char text[LF_COST_TEXT];
    snprintf(text, sizeof text, "a picture of %ld x %ld", edge, edge);
    lf_cost_add(out, "features", lf_trainable_in(t->store, "features."), picture, text);
    for (int i = 0; i < t->model.networks; i++) {
        snprintf(text, sizeof text, "a ray of %ld samples, %ld source views",
                 c->samples + (i == LF_FINE ? c->fine : 0), c->sources);
        lf_cost_add(out, name[i], lf_trainable_in(t->store, prefix[i]),
                    lf_renderer_network_macs(&t->model, i), text);
    }
    out->step_macs = (double)rays * lf_renderer_ray_macs(&t->model) + (double)c->sources * picture;
    snprintf(out->step, sizeof out->step, "%ld rays, %ld such pictures", rays, c->sources);
}

/* From below: what the feature network keeps of the sources' pictures. Sizes are not known before
 * the scenes are read, so the longest edge that is allowed stands for them. */
static lf_status check_memory(void *self, lf_error *err)
{
    const render_task *t = self;
    const lf_renderer_config *c = &t->model.config;
    const double edge = (double)lf_config_int(t->cfg, "data.longest");
    const double maps = 8.0 * LF_RENDER_LANES * edge * edge / 16 * (double)c->features.features;
    const double needed = (double)c->sources * (edge * edge * 3 + maps / 8) * sizeof(lf_real);
    const double there = (double)sysconf(_SC_PHYS_PAGES) * (double)sysconf(_SC_PAGE_SIZE);
    if (needed <= there)
        return LF_OK;
    return lf_fail(err, LF_BAD_INPUT,
                   "a step would keep at least %.1f GB of pictures and maps, and this machine has "
                   "%.1f GB: lower data.longest, render.sources or render.features",
                   1e-9 * needed, 1e-9 * there);
}

/* ---- validation -------------------------------------------------------------------------------
 */

static bool validates(const void *self)
{
    const render_task *t = self;
    return lf_config_int(t->cfg, "data.val_shapes") > 0;
}

/* Mean squared error of every VAL_STEP-th pixel of a view. */
static lf_status view_error(const render_task *t, const lf_scene_entry *e, long target, double *mse,
                            lf_error *err)
{
    const lf_render_view_options o = {.sources = t->model.config.sources};
    lf_render_view v;
    LF_TRY(lf_render_view_open(e, target, &o, &v, err));
    const long across = (v.camera.width + VAL_STEP - 1) / VAL_STEP;
    const long down = (v.camera.height + VAL_STEP - 1) / VAL_STEP, n = across * down;
    long *pixel = calloc((size_t)n, sizeof *pixel);
    lf_real *number = calloc((size_t)n, 5 * sizeof *number);
    LF_REQUIRE(pixel && number, "out of memory for %ld pixels", n);
    for (long i = 0; i < n; i++)
        pixel[i] = i / across * VAL_STEP * v.camera.width + i % across * VAL_STEP;
    lf_pixel_rays rays = lf_pixel_rays_create(&v, n, pixel);
    lf_ray_image image = {number, number + 3 * n, number + 4 * n, 0};
    const lf_render_savings none = lf_render_savings_none();
    lf_render_encode(t->work, v.sources, v.source);
    lf_render_rays(t->work, &rays.rays, e->white, &none, &image);
    double sum = 0;
    for (long i = 0; i < 3 * n; i++) {
        const double x = (double)number[i], cut = x < 0 ? 0 : x > 1 ? 1 : x; /* NaN stays */
        const double d = cut - v.pixels.rgb[3 * pixel[i / 3] + i % 3] / 255.0;
        sum += d * d;
    }
    *mse = sum / (3 * (double)n);
    lf_pixel_rays_free(&rays);
    lf_render_view_release(&v);
    free(pixel);
    free(number);
    return LF_OK;
}

/* Number `round` of `count` targets, spread over the list; rounds below count do not repeat. */
static long target_number(long round, long count)
{
    const long stride = count % 7 ? 7 : count % 11 ? 11 : 1; /* no common divisor */
    return (round * stride + 3) % count;
}

/* A view of each scene in turn, until there are enough. */
static lf_status validate(void *self, lf_validation *out, lf_error *err)
{
    const render_task *t = self;
    const lf_scene_set *set = t->val ? t->val : t->scenes;
    const long most = lf_config_int(t->cfg, "data.val_shapes");
    double loss = 0, psnr = 0;
    long done = 0, trained = 0;
    for (long round = 0; done < most; round++) {
        const long before = done;
        for (long i = 0; i < set->count && done < most; i++) {
            long count;
            const long *target = lf_render_targets(&set->entry[i], "val", &count);
            if (round >= count)
                continue;
            double mse;
            LF_TRY(view_error(t, &set->entry[i], target[target_number(round, count)], &mse, err));
            loss += mse;
            psnr += -10 * log10(fmax(mse, 1e-10));
            trained += strcmp(lf_render_split(&set->entry[i], "val"), "val") != 0;
            done++;
        }
        if (done == before)
            break;
    }
    *out = (lf_validation){loss / (double)done, "val_psnr", "PSNR", psnr / (double)done,
                           lf_render_split_name("val", done, trained)};
    return LF_OK;
}

static void free_task(void *self)
{
    render_task *t = self;
    lf_render_batches_free(t->batches);
    lf_render_work_free(t->work);
    lf_renderer_free(&t->model);
    lf_scene_set_close(t->val);
    lf_scene_set_close(t->scenes);
    free(t);
}

void lf_task_render(const lf_config *cfg, const lf_task_options *options, lf_task *out)
{
    render_task *t = calloc(1, sizeof *t);
    LF_REQUIRE(t, "out of memory");
    const lf_renderer_config config = lf_renderer_config_from(cfg);
    t->cfg = cfg;
    t->options = options;
    t->store = lf_store_create((uint64_t)lf_config_int(cfg, "train.seed"));
    lf_renderer_init(&t->model, t->store, &config);
    t->work = lf_render_work_create(&t->model, lf_config_int(cfg, "train.tile_rays"));
    lf_render_work_check(t->work, options->check_finite);
    *out = (lf_task){.self = t,
                     .store = t->store,
                     .count = count,
                     .check = check_memory,
                     .open = open_data,
                     .print_plan = print_plan,
                     .step = run_step,
                     .watch = watch,
                     .work_bytes = work_bytes,
                     .log = log_rays,
                     .nonfinite = nonfinite,
                     .validates = validates,
                     .validate = validate,
                     .free = free_task};
}
