/* steps.c: whole training steps of the reconstruction model: forward, loss, backward, Adam.
 *
 * Images, projections and distances are random: nothing is rendered, as in the PyTorch comparison.
 * Operations are counted by formula, useful ones only: three times the forward products.
 */
#include <stdlib.h>

#include "autograd/optim.h"
#include "autograd/random.h"
#include "bench/bench.h"
#include "models/recon_work.h"

enum { VIEWS = 8 };

typedef struct step_work {
    lf_bench_work work;
    lf_store *store;
    lf_recon model;
    lf_recon_work *run;
    lf_adam adam;
    long images, points;
    double loss;
    lf_real *image;
    float *sdf;
    double *uv, *direction, *distance, *position;
    uint8_t *mask;
    long *first;
} step_work;

static lf_recon_points points_of(const step_work *s)
{
    return (lf_recon_points){s->points, VIEWS,    s->uv,       s->direction, s->distance,
                             s->mask,   s->first, s->position, s->direction};
}

static void run_gradient(step_work *s)
{
    const lf_sdf_loss_config loss = {10, 0.1, 0.01, 4};
    const lf_recon_images images = {s->images, VIEWS, s->image, NULL};
    const lf_recon_points points = points_of(s);
    s->loss = lf_recon_step(s->run, &images, &points, s->sdf, &loss);
}

static void run_step(lf_bench_work *work)
{
    step_work *s = (step_work *)work;
    run_gradient(s);
    lf_adam_step(&s->adam, s->store, 1e-4);
    work->memory = (double)lf_recon_work_bytes(s->run) +
                   4.0 * sizeof(lf_real) * (double)lf_store_size(s->store);
    work->bytes = 2 * work->memory;
}

/* The distances that training sees, of all points on one tape. */
static void add_distances(const step_work *s, lf_outputs *to)
{
    const lf_recon_config *c = &s->model.config;
    const lf_recon_points points = points_of(s);
    lf_tape *tape = lf_tape_create();
    lf_tape_set_grad(tape, false);
    lf_recon_code code;
    lf_tensor *images =
        lf_leaf(tape, 4, LF_DIMS(s->images, c->image_size, c->image_size, c->backbone.in_channels),
                s->image, NULL);
    lf_recon_encode_images(tape, &s->model, images, VIEWS, NULL, true, &code);
    const lf_recon_inputs in = lf_recon_look(tape, &s->model, &code, &points);
    const lf_tensor *x = lf_recon_sdf(tape, &s->model, &in, NULL);
    lf_outputs_add(to, "distances", x->size, x->value);
    lf_tape_free(tape);
}

static void step_outputs(lf_bench_work *work, lf_outputs *to)
{
    step_work *s = (step_work *)work;
    run_gradient(s);
    lf_outputs_add_doubles(to, "loss", 1, &s->loss);
    lf_outputs_add(to, "gradient", lf_store_size(s->store), lf_store_grads(s->store));
    add_distances(s, to);
}

static void close_step(lf_bench_work *work)
{
    step_work *s = (step_work *)work;
    lf_recon_work_free(s->run);
    lf_adam_free(&s->adam);
    lf_recon_free(&s->model);
    lf_store_free(s->store);
    free(s->image);
    free(s->sdf);
    free(s->uv);
    free(s->direction);
    free(s->distance);
    free(s->position);
    free(s->mask);
    free(s->first);
    free(s);
}

static void fill_points(step_work *s, double size)
{
    lf_stream r = lf_stream_at(1, LF_RANDOM_TEST, 0, 0);
    for (long i = 0; i < s->points * VIEWS; i++) {
        double *d = s->direction + 3 * i, n = 0;
        for (int a = 0; a < 3; a++) {
            d[a] = lf_normal(&r);
            n += d[a] * d[a];
        }
        for (int a = 0; a < 3; a++)
            d[a] /= sqrt(n);
        s->uv[2 * i] = (size - 1) * lf_uniform(&r);
        s->uv[2 * i + 1] = (size - 1) * lf_uniform(&r);
        s->distance[i] = 2.5;
        s->mask[i] = 1;
    }
    lf_reference_round_doubles(2 * s->points * VIEWS, s->uv);
    lf_reference_round_doubles(3 * s->points * VIEWS, s->direction);
    for (long q = 0; q < s->points; q++) {
        for (int a = 0; a < 3; a++)
            s->position[3 * q + a] = lf_uniform(&r) - 0.5;
        s->sdf[q] = (float)(0.2 * (lf_uniform(&r) - 0.5));
        s->first[q] = q * s->images / VIEWS / s->points * VIEWS;
    }
}

/* sizes: shapes, points of all shapes, points of a tile; the config is the schema's defaults (the
 * tiny recipe) with the changes of `sets`. */
static lf_bench_work *open_sets(const lf_bench_case *c, const char *const *sets, int count,
                                int channels)
{
    step_work *s = lf_bench_room(1, sizeof *s);
    lf_config *cfg;
    lf_error err;
    lf_status status = lf_config_load(NULL, &cfg, &err);
    for (int i = 0; i < count && status == LF_OK; i++)
        status = lf_config_set(cfg, sets[i], &err);
    LF_REQUIRE(status == LF_OK, "%s", err.text);
    lf_recon_config config = lf_recon_config_from(cfg);
    lf_config_free(cfg);
    config.backbone.in_channels = channels;
    s->images = VIEWS * c->size[0];
    s->points = c->size[1];
    s->store = lf_store_create(1);
    lf_recon_init(&s->model, s->store, &config);
    lf_reference_round(lf_store_size(s->store), lf_store_values(s->store));
    s->run = lf_recon_work_create(&s->model, c->size[2]);
    const lf_adam_config adam = {.beta1 = 0.9, .beta2 = 0.999, .eps = 1e-8};
    lf_adam_init(&s->adam, &adam, s->store);
    const long pixels = s->images * config.image_size * config.image_size * channels;
    s->image = lf_bench_room(pixels, sizeof *s->image);
    lf_stream r = lf_stream_at(2, LF_RANDOM_TEST, 0, 0);
    for (long i = 0; i < pixels; i++)
        s->image[i] = lf_reference_input(lf_uniform(&r));
    s->sdf = lf_bench_room(s->points, sizeof *s->sdf);
    s->uv = lf_bench_room(2 * s->points * VIEWS, sizeof *s->uv);
    s->direction = lf_bench_room(3 * s->points * VIEWS, sizeof *s->direction);
    s->distance = lf_bench_room(s->points * VIEWS, sizeof *s->distance);
    s->position = lf_bench_room(3 * s->points, sizeof *s->position);
    s->mask = lf_bench_room(s->points * VIEWS, 1);
    s->first = lf_bench_room(s->points, sizeof *s->first);
    fill_points(s, (double)config.image_size);
    s->work = (lf_bench_work){.flop = 6 * lf_recon_macs(&s->model, s->images, s->points, VIEWS),
                              .run = run_step,
                              .outputs = step_outputs,
                              .close = close_step};
    return &s->work;
}

static lf_bench_work *open_tiny(const lf_bench_case *c)
{
    static const char *const sets[] = {"data.image_size=97"};
    return open_sets(c, sets, 1, 2);
}

static lf_bench_work *open_small_images(const lf_bench_case *c)
{
    return open_sets(c, NULL, 0, 2);
}

/* configs/peer-tiny.ini with three channels. */
#define PEER                                                                                       \
    "model.stem_pool=true", "model.stages=2, 2, 2, 2", "model.first_stride=1",                     \
        "model.features=16", "model.stem_features=false", "model.sample_image=false",              \
        "model.blocks=3", "model.skip=linear"

static lf_bench_work *open_peer(const lf_bench_case *c)
{
    static const char *const sets[] = {PEER, "model.fields=4, 8, 16, 32"};
    return open_sets(c, sets, sizeof sets / sizeof *sets, 3);
}

static lf_bench_work *open_small(const lf_bench_case *c)
{
    static const char *const sets[] = {PEER, "model.stem_fields=8", "model.fields=8, 16, 32, 64",
                                       "data.image_size=129"};
    return open_sets(c, sets, sizeof sets / sizeof *sets, 3);
}

/* The bottleneck blocks of ResNet-50 over fields: 64 channels of the stem, 256 to 2048 after. */
static lf_bench_work *open_paper(const lf_bench_case *c)
{
    static const char *const sets[] = {PEER,
                                       "model.stages=3, 4, 6, 3",
                                       "model.block=bottleneck",
                                       "model.stem_fields=8",
                                       "model.fields=32, 64, 128, 256",
                                       "data.image_size=225"};
    return open_sets(c, sets, sizeof sets / sizeof *sets, 3);
}

static const lf_bench_case cases[] = {
    {"step-tiny",
     "training step of configs/reconstruct-tiny.ini: 2 shapes, 512 points",
     open_tiny,
     {2, 512, 32},
     0},
    {"step-65", "the same with images of 65x65", open_small_images, {2, 512, 32}, 0},
    {"step-peer",
     "training step at the sizes of the PyTorch comparison: 8 views 65x65, 2048 points",
     open_peer,
     {1, 2048, 32},
     0},
    {"step-small",
     "the same of twice the fields: 8 views 129x129, 2048 points",
     open_small,
     {1, 2048, 32},
     0},
};

const lf_bench_table lf_bench_steps = {"steps", cases, sizeof cases / sizeof *cases, false};

static const lf_bench_case paper[] = {
    {"paper-reconstruct",
     "first training step at the paper's size: C8 ResNet-50, 8 views 225x225, 2048 points",
     open_paper,
     {1, 2048, 32},
     0},
};

const lf_bench_table lf_bench_paper = {"paper", paper, sizeof paper / sizeof *paper, true};
