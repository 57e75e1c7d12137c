/* steps.c: whole training steps of the reconstruction model: forward, loss, backward, Adam.
 *
 * Images, projections and distances are random: nothing is rendered, as in the PyTorch comparison.
 * Operations are counted by formula, useful ones only: three times the forward products.
 */
#include <stdlib.h>

#include "autograd/optim.h"
#include "autograd/random.h"
#include "bench/steps.h"
#include "models/recon_work.h"

enum { VIEWS = 8 };

/* Points and how views see them; the arrays of `seen` are this struct's. */
typedef struct places {
    lf_recon_points seen;
    double *uv, *direction, *distance, *position;
    uint8_t *mask;
    long *first;
} places;

typedef struct step_work {
    lf_bench_work work;
    lf_store *store;
    lf_recon model;
    lf_recon_work *run;
    lf_adam adam;
    double loss;
    lf_real *image, *predicted;
    float *sdf;
    places query, grid; /* grid: of networks that have one */
    lf_recon_images images;
} step_work;

static void run_gradient(step_work *s)
{
    const lf_sdf_loss_config loss = {10, 0.1, 0.01, 4};
    s->loss = lf_recon_step(s->run, &s->images, &s->query.seen, s->sdf, &loss);
}

static void count_memory(step_work *s, double copies)
{
    s->work.memory = (double)lf_recon_work_bytes(s->run) +
                     copies * sizeof(lf_real) * (double)lf_store_size(s->store);
    s->work.bytes = 2 * s->work.memory;
}

static void run_step(lf_bench_work *work)
{
    step_work *s = (step_work *)work;
    run_gradient(s);
    lf_adam_step(&s->adam, s->store, 1e-4);
    count_memory(s, 4);
}

static void run_prediction(lf_bench_work *work)
{
    step_work *s = (step_work *)work;
    lf_recon_predict(s->run, &s->query.seen, 10, s->predicted, NULL);
    count_memory(s, 1);
}

/* The distances that training sees, of all points on one tape. */
static void add_distances(const step_work *s, lf_outputs *to)
{
    const lf_recon_config *c = &s->model.config;
    lf_tape *tape = lf_tape_create();
    lf_tape_set_grad(tape, false);
    lf_recon_code code;
    lf_tensor *images = lf_leaf(
        tape, 4, LF_DIMS(s->images.count, c->image_size, c->image_size, c->backbone.in_channels),
        s->image, NULL);
    lf_recon_encode_images(tape, &s->model, images, s->images.views, s->images.grid, true, &code);
    const lf_recon_inputs in = lf_recon_look(tape, &s->model, &code, &s->query.seen);
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

static void free_places(places *p)
{
    free(p->uv);
    free(p->direction);
    free(p->distance);
    free(p->position);
    free(p->mask);
    free(p->first);
}

static void close_step(lf_bench_work *work)
{
    step_work *s = (step_work *)work;
    lf_recon_work_free(s->run);
    lf_adam_free(&s->adam);
    lf_recon_free(&s->model);
    lf_store_free(s->store);
    free(s->image);
    free(s->predicted);
    free(s->sdf);
    free_places(&s->query);
    free_places(&s->grid);
    free(s);
}

/* ---- data ------------------------------------------------------------------------------------ */

/* Directions and pixels of `count` points, all seen; images of `size` pixels an edge. */
static void look(places *p, long count, double size, lf_stream *r)
{
    for (long i = 0; i < count; i++) {
        double *d = p->direction + 3 * i, n = 0;
        for (int a = 0; a < 3; a++) {
            d[a] = lf_normal(r);
            n += d[a] * d[a];
        }
        for (int a = 0; a < 3; a++)
            d[a] /= sqrt(n);
        p->uv[2 * i] = (size - 1) * lf_uniform(r);
        p->uv[2 * i + 1] = (size - 1) * lf_uniform(r);
        p->distance[i] = 2.5;
        p->mask[i] = 1;
    }
    lf_reference_round_doubles(2 * count, p->uv);
    lf_reference_round_doubles(3 * count, p->direction);
}

/* `count` points of `objects` objects, evenly; positions are 0. */
static void make_places(places *p, long count, long objects, long views, double size, lf_stream *r)
{
    const long seen = count * views;
    p->uv = lf_bench_room(2 * seen, sizeof *p->uv);
    p->direction = lf_bench_room(3 * seen, sizeof *p->direction);
    p->distance = lf_bench_room(seen, sizeof *p->distance);
    p->position = lf_bench_room(3 * count, sizeof *p->position);
    p->mask = lf_bench_room(seen, 1);
    p->first = lf_bench_room(count, sizeof *p->first);
    look(p, seen, size, r);
    for (long q = 0; q < count; q++)
        p->first[q] = q * objects / count * views;
    p->seen = (lf_recon_points){count,   views,    p->uv,       p->direction, p->distance,
                                p->mask, p->first, p->position, p->direction};
}

static void make_query(step_work *s, const lf_bench_recon *sizes)
{
    lf_stream r = lf_stream_at(1, LF_RANDOM_TEST, 0, 0);
    make_places(&s->query, sizes->points, sizes->objects, sizes->views,
                (double)s->model.config.image_size, &r);
    s->sdf = lf_bench_room(sizes->points, sizeof *s->sdf);
    for (long q = 0; q < sizes->points; q++) {
        for (int a = 0; a < 3; a++)
            s->query.position[3 * q + a] = lf_uniform(&r) - 0.5;
        s->sdf[q] = (float)(0.2 * (lf_uniform(&r) - 0.5));
    }
}

static void make_grid(step_work *s, const lf_bench_recon *sizes)
{
    const long n = s->model.grid * s->model.grid * s->model.grid;
    lf_stream r = lf_stream_at(3, LF_RANDOM_TEST, 0, 0);
    make_places(&s->grid, n * sizes->objects, sizes->objects, sizes->views,
                (double)s->model.config.image_size, &r);
    for (long o = 0; o < sizes->objects; o++)
        lf_recon_grid(&s->model, (double(*)[3])(s->grid.position + 3 * n * o));
    s->images.grid = &s->grid.seen;
}

static void make_images(step_work *s, const lf_bench_recon *sizes)
{
    const long edge = s->model.config.image_size, count = sizes->objects * sizes->views;
    const long pixels = count * edge * edge * sizes->channels;
    s->image = lf_bench_room(pixels, sizeof *s->image);
    lf_stream r = lf_stream_at(2, LF_RANDOM_TEST, 0, 0);
    for (long i = 0; i < pixels; i++)
        s->image[i] = lf_reference_input(lf_uniform(&r));
    s->images = (lf_recon_images){count, sizes->views, s->image, NULL};
    if (s->model.grid > 0)
        make_grid(s, sizes);
}

/* ---- the model ------------------------------------------------------------------------------- */

lf_config *lf_bench_config(const char *const *sets, int count)
{
    lf_config *cfg;
    lf_error err;
    lf_status status = lf_config_load(NULL, &cfg, &err);
    for (int i = 0; i < count && status == LF_OK; i++)
        status = lf_config_set(cfg, sets[i], &err);
    LF_REQUIRE(status == LF_OK, "%s", err.text);
    return cfg;
}

lf_bench_work *lf_bench_recon_open(const lf_config *cfg, const lf_bench_recon *sizes)
{
    step_work *s = lf_bench_room(1, sizeof *s);
    lf_recon_config config = lf_recon_config_from(cfg);
    config.backbone.in_channels = (int)sizes->channels;
    s->store = lf_store_create(1);
    lf_recon_init(&s->model, s->store, &config);
    lf_reference_round(lf_store_size(s->store), lf_store_values(s->store));
    s->run = lf_recon_work_create(&s->model, sizes->tile);
    const lf_adam_config adam = {.beta1 = 0.9, .beta2 = 0.999, .eps = 1e-8};
    lf_adam_init(&s->adam, &adam, s->store);
    make_images(s, sizes);
    make_query(s, sizes);
    s->work = (lf_bench_work){
        .flop = 6 * lf_recon_macs(&s->model, s->images.count, sizes->points, sizes->views),
        .run = run_step,
        .outputs = step_outputs,
        .close = close_step};
    if (sizes->predict) {
        s->predicted = lf_bench_room(sizes->points, sizeof *s->predicted);
        lf_recon_encode(s->run, &s->images);
        s->work.flop = 2 * lf_recon_costs(&s->model, sizes->views).point * (double)sizes->points;
        s->work.run = run_prediction;
        s->work.outputs = NULL;
    }
    return &s->work;
}

/* sizes: shapes, points of all shapes, points of a tile. */
static lf_bench_work *open_sets(const lf_bench_case *c, const char *const *sets, int count,
                                int channels)
{
    lf_config *cfg = lf_bench_config(sets, count);
    lf_bench_work *work = lf_bench_recon_open(
        cfg, &(lf_bench_recon){c->size[0], VIEWS, c->size[1], c->size[2], channels, false});
    lf_config_free(cfg);
    return work;
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

/* configs/reconstruct-disn.ini, -fvor.ini, -ibrnet.ini: the compared systems. */
#define PLAIN                                                                                      \
    "data.image_size=97", "model.backbone=plain", "model.stem_fields=2", "model.stages=2, 1, 1",   \
        "model.first_stride=1", "model.fields=2, 3, 4", "model.sample_image=false"

static lf_bench_work *open_disn(const lf_bench_case *c)
{
    static const char *const sets[] = {"model.type=disn", PLAIN};
    return open_sets(c, sets, sizeof sets / sizeof *sets, 2);
}

static lf_bench_work *open_fvor(const lf_bench_case *c)
{
    static const char *const sets[] = {"model.type=fvor", PLAIN};
    return open_sets(c, sets, sizeof sets / sizeof *sets, 2);
}

static lf_bench_work *open_ibrnet(const lf_bench_case *c)
{
    static const char *const sets[] = {"model.type=ibrnet-sdf", "data.image_size=97",
                                       "model.mlp=16"};
    return open_sets(c, sets, sizeof sets / sizeof *sets, 2);
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
    {"step-disn", "step-tiny with configs/reconstruct-disn.ini", open_disn, {2, 512, 32}, 0},
    {"step-fvor", "step-tiny with configs/reconstruct-fvor.ini", open_fvor, {2, 512, 32}, 0},
    {"step-ibrnet-sdf",
     "step-tiny with configs/reconstruct-ibrnet.ini",
     open_ibrnet,
     {2, 512, 32},
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
