/* ibrnet.c: a training step of IBRNet's network alone: forward and backward of 512 rays of 32
 * samples seen by 8 views, 35 numbers each, as the PyTorch comparison times it. No feature network,
 * no optimiser; the gradient of the loss is given (1 for every colour and density).
 *
 * Rays run in tiles, each with its own short tape that stays in the cache; tiles go to a fixed
 * number of lanes, which own gradients, and lanes to threads.
 */
#include <omp.h>
#include <stdlib.h>

#include "autograd/random.h"
#include "bench/bench.h"
#include "models/ibrnet.h"

enum { LANES = 8, INPUTS = 35 };

typedef struct net_work {
    lf_bench_work work;
    lf_store *store;
    lf_ibrnet net;
    long rays, samples, views, tile;
    lf_real *seen, *gradient, *difference, *mask, *count;
    lf_real *colour, *sigma; /* of the last run */
    lf_tape *tape[LANES];
    lf_real *lane[LANES]; /* gradients of the parameters */
} net_work;

static void run_tile(const net_work *w, lf_tape *tape, lf_real *lane, long ray)
{
    const long n = w->tile, s = w->samples, v = w->views, first = ray * s * v;
    lf_tape_reset(tape);
    lf_tape_set_lane(tape, lane, 0);
    const lf_light_geometry geometry = {
        .rays = n,
        .samples = s,
        .views = v,
        .mask = lf_leaf(tape, 3, LF_DIMS(n, s, v), w->mask + first, NULL),
        .count = lf_leaf(tape, 2, LF_DIMS(n, s), w->count + ray * s, NULL)};
    const lf_ray_inputs in = {
        lf_leaf(tape, 4, LF_DIMS(n, s, v, INPUTS), w->seen + first * INPUTS,
                w->gradient + first * INPUTS),
        &geometry, lf_leaf(tape, 4, LF_DIMS(n, s, v, 4), w->difference + first * 4, NULL)};
    const lf_radiance out = lf_ibrnet_apply(tape, &w->net, &in);
    memcpy(w->colour + ray * s * LF_RGB, out.colour->value,
           (size_t)out.colour->size * sizeof(lf_real));
    memcpy(w->sigma + ray * s, out.sigma->value, (size_t)out.sigma->size * sizeof(lf_real));
    lf_tensor *const part[] = {out.colour, out.sigma};
    for (int k = 0; k < 2; k++) {
        lf_real *grad = lf_grad(tape, part[k]);
        for (long i = 0; i < part[k]->size; i++)
            grad[i] += 1;
    }
    lf_backward_from(tape);
}

static void run(lf_bench_work *work)
{
    net_work *w = (net_work *)work;
    const long size = lf_store_size(w->store);
    const int most = omp_get_max_threads(), threads = most < LANES ? most : LANES;
    lf_real *grad = lf_store_grads(w->store);
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads)
    for (int l = 0; l < LANES; l++) {
        memset(w->lane[l], 0, (size_t)size * sizeof(lf_real));
        for (long ray = l * w->tile; ray < w->rays; ray += LANES * w->tile)
            run_tile(w, w->tape[omp_get_thread_num()], w->lane[l], ray);
    }
    work->memory = 0;
    for (int l = 0; l < LANES; l++) {
        work->memory += (double)lf_tape_peak(w->tape[l]);
        for (long i = 0; i < size; i++)
            grad[i] += w->lane[l][i];
    }
}

static void net_outputs(lf_bench_work *work, lf_outputs *to)
{
    const net_work *w = (net_work *)work;
    const long points = w->rays * w->samples;
    run(work);
    lf_outputs_add(to, "colour", points * LF_RGB, w->colour);
    lf_outputs_add(to, "density", points, w->sigma);
    lf_outputs_add(to, "gradient", lf_store_size(w->store), lf_store_grads(w->store));
    lf_outputs_add(to, "features' gradient", points * w->views * INPUTS, w->gradient);
}

static void close_net(lf_bench_work *work)
{
    net_work *w = (net_work *)work;
    for (int l = 0; l < LANES; l++) {
        lf_tape_free(w->tape[l]);
        free(w->lane[l]);
    }
    free(w->seen);
    free(w->gradient);
    free(w->difference);
    free(w->mask);
    free(w->count);
    free(w->colour);
    free(w->sigma);
    lf_store_free(w->store);
    free(w);
}

static void fill(net_work *w)
{
    const long points = w->rays * w->samples, rows = points * w->views;
    lf_stream r = lf_stream_at(2, LF_RANDOM_TEST, 1, 0);
    for (long i = 0; i < rows * INPUTS; i++)
        w->seen[i] = lf_reference_input(lf_uniform(&r));
    for (long i = 0; i < rows * 4; i++)
        w->difference[i] = lf_reference_input(2 * lf_uniform(&r) - 1);
    for (long i = 0; i < rows; i++)
        w->mask[i] = 1;
    for (long i = 0; i < points; i++)
        w->count[i] = (lf_real)w->views;
}

/* size: rays, samples, views, rays of a tile */
static lf_bench_work *open_net(const lf_bench_case *c)
{
    net_work *w = lf_bench_room(1, sizeof *w);
    w->rays = c->size[0];
    w->samples = c->size[1];
    w->views = c->size[2];
    w->tile = c->size[3];
    w->store = lf_store_create(1);
    lf_ibrnet_init(w->store, &w->net, "ibrnet", &(lf_ibrnet_config){INPUTS, 16, true});
    lf_reference_round(lf_store_size(w->store), lf_store_values(w->store));
    const long points = w->rays * w->samples, rows = points * w->views;
    w->colour = lf_bench_room(points * LF_RGB, sizeof(lf_real));
    w->sigma = lf_bench_room(points, sizeof(lf_real));
    w->seen = lf_bench_room(rows * INPUTS, sizeof(lf_real));
    w->gradient = lf_bench_room(rows * INPUTS, sizeof(lf_real));
    w->difference = lf_bench_room(rows * 4, sizeof(lf_real));
    w->mask = lf_bench_room(rows, sizeof(lf_real));
    w->count = lf_bench_room(points, sizeof(lf_real));
    fill(w);
    for (int l = 0; l < LANES; l++) {
        w->tape[l] = lf_tape_create();
        w->lane[l] = lf_bench_room(lf_store_size(w->store), sizeof(lf_real));
    }
    /* what is seen is read, its gradient read and written; between lies a tile, in the caches */
    const double numbers = (double)rows * (3 * INPUTS + 4 + 1) + (double)points * (1 + LF_RGB + 1);
    w->work =
        (lf_bench_work){.bytes = numbers * sizeof(lf_real),
                        .flop = 6 * (double)points * lf_ibrnet_macs(&w->net, w->samples, w->views),
                        .run = run,
                        .outputs = net_outputs,
                        .close = close_net};
    return &w->work;
}

static const lf_bench_case cases[] = {
    {"ibrnet-step",
     "forward and backward of IBRNet: 512 rays, 32 samples, 8 views, tiles of 2 rays",
     open_net,
     {512, 32, 8, 2},
     0},
    {"ibrnet-1", "the same in tiles of one ray", open_net, {512, 32, 8, 1}, 0},
    {"ibrnet-4", "the same in tiles of four rays", open_net, {512, 32, 8, 4}, 0},
};

const lf_bench_table lf_bench_ibrnet = {"networks", cases, sizeof cases / sizeof *cases, false};
