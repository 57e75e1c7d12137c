/* ray_equivariant.c: a training step of the equivariant renderer's network: geometry, forward,
 * volume rendering, mean square colour, backward to the parameters and the sampled features.
 *
 * At the sizes of the PyTorch comparison: 512 rays of 32 samples, 8 views, 35 numbers a view.
 * Rays run in tiles, each on a tape of its own that stays in the caches; gradients of parameters go
 * to 8 lanes, whatever the number of threads. Operations are counted by formula, useful ones only:
 * three times the forward products.
 */
#include <omp.h>
#include <stdlib.h>

#include "autograd/random.h"
#include "bench/bench.h"
#include "models/ray_equivariant.h"

enum { LANES = 8, WORKERS = 64 };

typedef struct step_work {
    lf_bench_work work;
    lf_store *store;
    lf_ray_equivariant model;
    long rays, samples, views, tile;
    double *origin, *direction, *depth, *centre;
    uint8_t *seen;
    lf_real *feature, *feature_grad, *lane, *colour;
    lf_tape *tape[WORKERS];
} step_work;

static void run_tile(step_work *s, lf_tape *tape, lf_real *lane, long from, long count)
{
    const long samples = s->samples, row = samples * s->views * s->model.config.inputs;
    lf_tape_reset(tape);
    lf_tape_set_lane(tape, lane, 0);
    const lf_light_rays rays = {count,
                                samples,
                                s->views,
                                s->origin + 3 * from,
                                s->direction + 3 * from,
                                s->depth + from * samples,
                                s->centre,
                                s->seen + from * samples * s->views,
                                2,
                                6};
    const lf_light_geometry g = lf_light_geometry_make(tape, &s->model.config.types, &rays);
    lf_tensor *seen = lf_leaf(tape, 4, LF_DIMS(count, samples, s->views, s->model.config.inputs),
                              s->feature + from * row, s->feature_grad + from * row);
    const lf_radiance y =
        lf_ray_equivariant_apply(tape, &s->model, &(lf_ray_inputs){seen, &g, NULL});
    const lf_rendered r = lf_volume(tape, y.sigma, y.colour, g.depth, false);
    memcpy(s->colour + from * LF_RGB, r.colour->value, (size_t)r.colour->size * sizeof(lf_real));
    lf_real *grad = lf_grad(tape, r.colour);
    for (long i = 0; i < r.colour->size; i++)
        grad[i] = 2 * r.colour->value[i] / (lf_real)(s->rays * LF_RGB);
    lf_backward_from(tape);
}

static void run_lane(step_work *s, lf_tape *tape, int lane)
{
    const long tiles = (s->rays + s->tile - 1) / s->tile, size = lf_store_size(s->store);
    lf_real *grad = s->lane + lane * size;
    memset(grad, 0, (size_t)size * sizeof *grad);
    for (long t = lane; t < tiles; t += LANES) {
        const long from = t * s->tile, left = s->rays - from;
        run_tile(s, tape, grad, from, left < s->tile ? left : s->tile);
    }
}

static void run_step(lf_bench_work *work)
{
    step_work *s = (step_work *)work;
    const long row = s->samples * s->views * s->model.config.inputs;
    memset(s->feature_grad, 0, (size_t)(s->rays * row) * sizeof *s->feature_grad);
#pragma omp parallel for schedule(dynamic, 1)
    for (int l = 0; l < LANES; l++)
        run_lane(s, s->tape[omp_get_thread_num()], l);
    lf_store_zero_grads(s->store);
    lf_real *grad = lf_store_grads(s->store);
    for (int l = 0; l < LANES; l++)
        for (long i = 0; i < lf_store_size(s->store); i++)
            grad[i] += s->lane[l * lf_store_size(s->store) + i];
    work->memory = 0;
    for (int w = 0; w < WORKERS; w++)
        work->memory += s->tape[w] ? (double)lf_tape_peak(s->tape[w]) : 0;
}

static void step_outputs(lf_bench_work *work, lf_outputs *to)
{
    const step_work *s = (step_work *)work;
    run_step(work);
    lf_outputs_add(to, "colour", s->rays * LF_RGB, s->colour);
    lf_outputs_add(to, "gradient", lf_store_size(s->store), lf_store_grads(s->store));
    lf_outputs_add(to, "features' gradient",
                   s->rays * s->samples * s->views * s->model.config.inputs, s->feature_grad);
}

static void close_step(lf_bench_work *work)
{
    step_work *s = (step_work *)work;
    for (int w = 0; w < WORKERS; w++)
        lf_tape_free(s->tape[w]);
    lf_store_free(s->store);
    free(s->origin);
    free(s->direction);
    free(s->depth);
    free(s->centre);
    free(s->seen);
    free(s->feature);
    free(s->feature_grad);
    free(s->lane);
    free(s->colour);
    free(s);
}

/* Cameras at distance 4 that look at the origin's surroundings; all views see all samples. */
static void fill_scene(step_work *s)
{
    lf_stream r = lf_stream_at(1, LF_RANDOM_TEST, 70, 0);
    for (long i = 0; i < s->rays + s->views; i++) {
        double p[3], size = 0, towards = 0;
        for (int a = 0; a < 3; a++)
            p[a] = lf_normal(&r);
        for (int a = 0; a < 3; a++)
            size += p[a] * p[a];
        for (int a = 0; a < 3; a++)
            p[a] *= 4 / sqrt(size);
        if (i >= s->rays) {
            memcpy(s->centre + 3 * (i - s->rays), p, sizeof p);
            continue;
        }
        memcpy(s->origin + 3 * i, p, sizeof p);
        double *d = s->direction + 3 * i;
        for (int a = 0; a < 3; a++) {
            d[a] = lf_uniform(&r) - 0.5 - p[a];
            towards += d[a] * d[a];
        }
        for (int a = 0; a < 3; a++)
            d[a] /= sqrt(towards);
        for (long k = 0; k < s->samples; k++)
            s->depth[i * s->samples + k] =
                2 + 4 * ((double)k + lf_uniform(&r)) / (double)s->samples;
    }
    const long seen = s->rays * s->samples * s->views;
    memset(s->seen, 1, (size_t)seen);
    for (long i = 0; i < seen * s->model.config.inputs; i++)
        s->feature[i] = lf_reference_input(lf_uniform(&r));
}

/* sizes: rays, samples, views, rays of a tile */
static lf_bench_work *open_step(const lf_bench_case *c)
{
    step_work *s = lf_bench_room(1, sizeof *s);
    const lf_ray_equivariant_config config = {
        {.count = 8, .omega = {0, 2, 4, 8, 16, 32, 64, 128}}, 35, 4, 16, 4, true, true};
    s->rays = c->size[0];
    s->samples = c->size[1];
    s->views = c->size[2];
    s->tile = c->size[3];
    s->store = lf_store_create(1);
    lf_ray_equivariant_init(s->store, &s->model, "net", &config);
    lf_reference_round(lf_store_size(s->store), lf_store_values(s->store));
    const long seen = s->rays * s->samples * s->views;
    s->origin = lf_bench_room(3 * s->rays, sizeof *s->origin);
    s->direction = lf_bench_room(3 * s->rays, sizeof *s->direction);
    s->depth = lf_bench_room(s->rays * s->samples, sizeof *s->depth);
    s->centre = lf_bench_room(3 * s->views, sizeof *s->centre);
    s->seen = lf_bench_room(seen, 1);
    s->feature = lf_bench_room(seen * config.inputs, sizeof *s->feature);
    s->feature_grad = lf_bench_room(seen * config.inputs, sizeof *s->feature);
    s->colour = lf_bench_room(s->rays * LF_RGB, sizeof *s->colour);
    s->lane = lf_bench_room(LANES * lf_store_size(s->store), sizeof *s->lane);
    for (int w = 0; w < WORKERS && w < omp_get_max_threads(); w++)
        s->tape[w] = lf_tape_create();
    fill_scene(s);
    /* features are read, their gradient set to zero, read and written; between lies a tile, in the
     * caches */
    s->work = (lf_bench_work){.bytes = 4.0 * (double)(seen * config.inputs) * sizeof(lf_real),
                              .flop = 6 * (double)(s->rays * s->samples) *
                                      lf_ray_equivariant_macs(&s->model, s->samples, s->views),
                              .run = run_step,
                              .outputs = step_outputs,
                              .close = close_step};
    return &s->work;
}

static const lf_bench_case cases[] = {
    {"equivariant-step",
     "step of the equivariant renderer: 512 rays of 32 samples, 8 views, 35 numbers",
     open_step,
     {512, 32, 8, 1},
     0},
    {"equivariant-16",
     "the same of 16 rays: short enough to be undisturbed on a busy machine",
     open_step,
     {16, 32, 8, 1},
     0},
};

const lf_bench_table lf_bench_ray_equivariant = {"networks", cases, sizeof cases / sizeof *cases,
                                                 false};
