/* render_steps.c: whole training steps of the renderers: feature network, samples, ray network,
 * volume rendering, loss, backward, Adam.
 *
 * Pictures are smooth waves, cameras stand around the origin and look at it: nothing is read or
 * ray-traced. Operations are counted by formula, useful ones only: three times the forward ones.
 */
#include "autograd/optim.h"
#include "bench/steps.h"
#include "datasets/camera.h"
#include "models/render_work.h"

typedef struct step_work {
    lf_bench_work work;
    lf_store *store;
    lf_renderer model;
    lf_render_work *run;
    lf_adam adam;
    lf_source *source;
    uint8_t *rgb; /* of all sources */
    long rays, width, height;
    double *origin, *direction, *stretch;
    float *colour;
    double loss;
    lf_ray_image image; /* of an evaluation */
} step_work;

static lf_render_batch batch_of(const step_work *s)
{
    return (lf_render_batch){.rays = {s->rays, s->origin, s->direction, s->stretch, 2.6, 5.6},
                             .colour = s->colour,
                             .seen_samples = 4,
                             .seed = 1,
                             .views = s->model.config.sources,
                             .source = s->source};
}

static void run_gradient(step_work *s)
{
    const lf_render_batch batch = batch_of(s);
    s->loss = lf_render_step(s->run, &batch, NULL);
}

static void run_step(lf_bench_work *work)
{
    step_work *s = (step_work *)work;
    run_gradient(s);
    lf_adam_step(&s->adam, s->store, 1e-4);
    work->memory = (double)lf_render_work_bytes(s->run) +
                   4.0 * sizeof(lf_real) * (double)lf_store_size(s->store);
    work->bytes = 2 * work->memory;
}

static void run_picture(lf_bench_work *work)
{
    step_work *s = (step_work *)work;
    const lf_render_batch batch = batch_of(s);
    const lf_render_savings none = lf_render_savings_none();
    lf_render_rays(s->run, &batch.rays, false, &none, &s->image);
    work->memory = (double)lf_render_work_bytes(s->run) +
                   (double)sizeof(lf_real) * (double)lf_store_size(s->store);
    work->bytes = 2 * work->memory;
}

static void step_outputs(lf_bench_work *work, lf_outputs *to)
{
    step_work *s = (step_work *)work;
    const lf_render_batch batch = batch_of(s);
    const lf_render_savings none = lf_render_savings_none();
    lf_real *colour = lf_bench_room(s->rays * LF_RGB, sizeof *colour);
    lf_real *depth = lf_bench_room(2 * s->rays, sizeof *depth);
    run_gradient(s);
    lf_outputs_add_doubles(to, "loss", 1, &s->loss);
    lf_outputs_add(to, "gradient", lf_store_size(s->store), lf_store_grads(s->store));
    lf_ray_image image = {colour, depth, depth + s->rays, 0};
    lf_render_encode(s->run, batch.views, batch.source);
    lf_render_rays(s->run, &batch.rays, false, &none, &image);
    lf_outputs_add(to, "colour", s->rays * LF_RGB, colour);
    free(colour);
    free(depth);
}

static void close_step(lf_bench_work *work)
{
    step_work *s = (step_work *)work;
    lf_render_work_free(s->run);
    lf_adam_free(&s->adam);
    lf_renderer_free(&s->model);
    lf_store_free(s->store);
    free(s->source);
    free(s->rgb);
    free(s->origin);
    free(s->direction);
    free(s->stretch);
    free(s->colour);
    free(s->image.colour);
    free(s->image.depth);
    free(s->image.opacity);
    free(s);
}

/* ---- the scene ------------------------------------------------------------------------------- */

/* At distance 4 from the origin, `turn` and `tilt` radians off the z axis. */
static lf_camera camera_at(const step_work *s, double turn, double tilt)
{
    const double centre[3] = {4 * sin(turn) * cos(tilt), 4 * sin(tilt), 4 * cos(turn) * cos(tilt)};
    lf_camera c = lf_camera_look_at(centre, (const double[3]){0}, 0.3, (int)s->width);
    c.height = (int)s->height;
    c.cy = 0.5 * (double)(s->height - 1);
    return c;
}

/* K R' [I | -c] */
static void project(const lf_camera *c, double projection[12])
{
    const double *m = c->rotation;
    for (int j = 0; j < 4; j++) {
        double q[3];
        for (int i = 0; i < 3; i++)
            q[i] = j < 3 ? m[3 * j + i]
                         : -m[i] * c->centre[0] - m[3 + i] * c->centre[1] - m[6 + i] * c->centre[2];
        projection[j] = c->fx * q[0] + c->cx * q[2];
        projection[4 + j] = c->fy * q[1] + c->cy * q[2];
        projection[8 + j] = q[2];
    }
}

static void paint(const step_work *s, uint8_t *rgb, long view)
{
    for (long y = 0; y < s->height; y++)
        for (long x = 0; x < s->width; x++)
            for (long c = 0; c < LF_RGB; c++)
                rgb[(y * s->width + x) * LF_RGB + c] =
                    (uint8_t)lround(127.5 + 120 * sin(0.11 * (double)(x + 3 * c)) *
                                                cos(0.07 * (double)y + 0.2 * (double)(view + c)));
}

static void make_sources(step_work *s)
{
    const long views = s->model.config.sources, pixels = s->width * s->height * LF_RGB;
    s->source = lf_bench_room(views, sizeof *s->source);
    s->rgb = lf_bench_room(views * pixels, 1);
    for (long v = 0; v < views; v++) {
        const double angle = 6.283185307179586 * (double)v / (double)views;
        const lf_camera c = camera_at(s, 0.3 * cos(angle), 0.3 * sin(angle));
        lf_source *source = &s->source[v];
        *source = (lf_source){.width = s->width, .height = s->height, .rgb = s->rgb + v * pixels};
        memcpy(source->centre, c.centre, sizeof source->centre);
        project(&c, source->projection);
        paint(s, s->rgb + v * pixels, v);
    }
}

/* Rays through pixels of a target in the middle of the sources. */
static void make_rays(step_work *s)
{
    const lf_camera c = camera_at(s, 0.02, 0.03);
    lf_stream r = lf_stream_at(4, LF_RANDOM_TEST, 0, 0);
    s->origin = lf_bench_room(3 * s->rays, sizeof *s->origin);
    s->direction = lf_bench_room(3 * s->rays, sizeof *s->direction);
    s->stretch = lf_bench_room(s->rays, sizeof *s->stretch);
    s->colour = lf_bench_room(s->rays * LF_RGB, sizeof *s->colour);
    for (long i = 0; i < s->rays; i++) {
        double *d = s->direction + 3 * i;
        const double u = (double)lf_index(&r, s->width), v = (double)lf_index(&r, s->height);
        lf_camera_ray(&c, u, v, d);
        memcpy(s->origin + 3 * i, c.centre, sizeof c.centre);
        s->stretch[i] = 1 / (c.rotation[2] * d[0] + c.rotation[5] * d[1] + c.rotation[8] * d[2]);
        for (int k = 0; k < LF_RGB; k++)
            s->colour[LF_RGB * i + k] = (float)lf_uniform(&r);
    }
}

/* ---- the model ------------------------------------------------------------------------------- */

/* Colours of rays alone, their pictures' features made. */
static void only_render(step_work *s)
{
    s->image = (lf_ray_image){lf_bench_room(s->rays * LF_RGB, sizeof(lf_real)),
                              lf_bench_room(s->rays, sizeof(lf_real)),
                              lf_bench_room(s->rays, sizeof(lf_real)), 0};
    lf_render_encode(s->run, s->model.config.sources, s->source);
    s->work.flop = 2 * (double)s->rays * lf_renderer_ray_macs(&s->model);
    s->work.run = run_picture;
    s->work.outputs = NULL;
}

lf_bench_work *lf_bench_render_open(const lf_config *cfg, const lf_bench_render *sizes)
{
    step_work *s = lf_bench_room(1, sizeof *s);
    s->rays = sizes->rays;
    s->width = sizes->width;
    s->height = sizes->height;
    const lf_renderer_config config = lf_renderer_config_from(cfg);
    s->store = lf_store_create(1);
    lf_renderer_init(&s->model, s->store, &config);
    lf_reference_round(lf_store_size(s->store), lf_store_values(s->store));
    s->run = lf_render_work_create(&s->model, lf_config_int(cfg, "train.tile_rays"));
    const lf_adam_config adam = {.beta1 = 0.9, .beta2 = 0.999, .eps = 1e-8};
    lf_adam_init(&s->adam, &adam, s->store);
    make_sources(s);
    make_rays(s);
    const double macs =
        (double)s->rays * lf_renderer_ray_macs(&s->model) +
        (double)config.sources * lf_renderer_picture_macs(&s->model, s->height, s->width);
    s->work = (lf_bench_work){
        .flop = 6 * macs, .run = run_step, .outputs = step_outputs, .close = close_step};
    if (sizes->picture)
        only_render(s);
    return &s->work;
}

/* sizes: rays, width, height. */
static lf_bench_work *open_sets(const lf_bench_case *c, const char *const *sets, int count)
{
    lf_config *cfg = lf_bench_config(sets, count);
    lf_bench_work *work =
        lf_bench_render_open(cfg, &(lf_bench_render){c->size[0], c->size[1], c->size[2], false});
    lf_config_free(cfg);
    return work;
}

static lf_bench_work *open_tiny(const lf_bench_case *c)
{
    static const char *const sets[] = {"model.type=renderer", "render.types=0, 1, 2, 4",
                                       "render.scalars=16", "render.samples=40"};
    return open_sets(c, sets, 4);
}

static lf_bench_work *open_tiny_ibrnet(const lf_bench_case *c)
{
    static const char *const sets[] = {"model.type=ibrnet", "render.samples=40"};
    return open_sets(c, sets, 2);
}

/* IBRNet's feature network, coarse and fine. */
#define PAPER                                                                                      \
    "render.feature_net=resnet34", "render.feature_width=64", "render.features=32",                \
        "render.sources=10", "render.samples=64", "render.fine_samples=64"

static lf_bench_work *open_paper(const lf_bench_case *c)
{
    static const char *const sets[] = {"model.type=renderer", PAPER};
    return open_sets(c, sets, sizeof sets / sizeof *sets);
}

static lf_bench_work *open_paper_ibrnet(const lf_bench_case *c)
{
    static const char *const sets[] = {"model.type=ibrnet", PAPER};
    return open_sets(c, sets, sizeof sets / sizeof *sets);
}

static const lf_bench_case cases[] = {
    {"render-tiny",
     "training step of configs/render-tiny.ini: 64 rays, 40 samples, 6 views 100x100",
     open_tiny,
     {64, 100, 100},
     0},
    {"render-tiny-ibrnet", "the same with IBRNet", open_tiny_ibrnet, {64, 100, 100}, 0},
};

const lf_bench_table lf_bench_render_steps = {"steps", cases, sizeof cases / sizeof *cases, false};

static const lf_bench_case paper[] = {
    {"paper-render",
     "first training step at the paper's size: 512 rays, 64 + 64 samples, 10 views 378x504",
     open_paper,
     {512, 504, 378},
     0},
    {"paper-render-ibrnet", "the same with IBRNet", open_paper_ibrnet, {512, 504, 378}, 0},
};

const lf_bench_table lf_bench_paper_render = {"paper", paper, sizeof paper / sizeof *paper, true};
