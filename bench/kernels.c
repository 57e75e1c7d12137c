/* kernels.c: the kernels as cases. Linear maps run as tiles do: every thread works on a tile of its
 * own that stays in its L2; matrix products and convolutions share their work between the threads.
 */
#include <omp.h>
#include <stdlib.h>
#include <string.h>

#include "autograd/kernels/kernels.h"
#include "autograd/random.h"
#include "autograd/status.h"
#include "bench/bench.h"

static lf_real *numbers(long n, uint64_t item)
{
    lf_real *x = aligned_alloc(64, ((size_t)n * sizeof *x + 127) / 64 * 64);
    LF_REQUIRE(x, "no memory for %ld numbers", n);
    lf_stream s = lf_stream_at(1, LF_RANDOM_TEST, 1, item);
    for (long i = 0; i < n; i++)
        x[i] = lf_reference_input(2 * lf_uniform(&s) - 1);
    return x;
}

/* Room for results that runs add to. */
static lf_real *zeros(long n)
{
    lf_real *x = numbers(n, 0);
    memset(x, 0, (size_t)n * sizeof *x);
    return x;
}

static double bytes_of(long numbers)
{
    return (double)numbers * sizeof(lf_real);
}

/* ---- matrix product -------------------------------------------------------------------------- */

typedef struct matmul_work {
    lf_bench_work base;
    long m, n, k;
    lf_real *a, *b, *c;
} matmul_work;

static void run_matmul(lf_bench_work *work)
{
    const matmul_work *w = (matmul_work *)work;
    lf_kernel_matmul(w->m, w->n, w->k, w->a, w->b, w->c, false);
}

static void matmul_outputs(lf_bench_work *work, lf_outputs *to)
{
    const matmul_work *w = (matmul_work *)work;
    run_matmul(work);
    lf_outputs_add(to, "product", w->m * w->n, w->c);
}

static void close_matmul(lf_bench_work *work)
{
    matmul_work *w = (matmul_work *)work;
    free(w->a);
    free(w->b);
    free(w->c);
    free(w);
}

static lf_bench_work *open_matmul(const lf_bench_case *c)
{
    matmul_work *w = lf_bench_room(1, sizeof *w);
    w->base = (lf_bench_work){.run = run_matmul, .close = close_matmul, .outputs = matmul_outputs};
    w->m = c->size[0];
    w->n = c->size[1];
    w->k = c->size[2];
    w->base.flop = 2.0 * (double)w->m * (double)w->n * (double)w->k;
    w->base.bytes = bytes_of(w->m * w->k + w->k * w->n + w->m * w->n);
    w->a = numbers(w->m * w->k, 1);
    w->b = numbers(w->k * w->n, 2);
    w->c = numbers(w->m * w->n, 3);
    return &w->base;
}

/* ---- linear maps ----------------------------------------------------------------------------- */

enum { FORWARD, DX, DW, TRAIN /* all three */ };

/* One thread's tile. */
typedef struct tile {
    lf_real *x, *w, *b, *y, *dy, *dx, *dw, *db;
} tile;

typedef struct linear_work {
    lf_bench_work base;
    long rows, in, out;
    int variant, tiles;
    tile *tile;
} linear_work;

enum { TURNS = 64 }; /* products of a run, so that starting the threads does not count */

static void run_tile(const linear_work *w, const tile *t)
{
    const int v = w->variant;
    if (v == FORWARD || v == TRAIN)
        lf_kernel_linear(w->rows, w->in, w->out, t->x, t->w, t->b, LF_RELU, t->y);
    if (v == DX || v == TRAIN)
        lf_kernel_linear_dx(w->rows, w->in, w->out, t->dy, t->w, t->dx);
    if (v == DW || v == TRAIN)
        lf_kernel_linear_dw(w->rows, w->in, w->out, t->x, t->dy, t->dw, t->db);
}

static void run_linear(lf_bench_work *work)
{
    const linear_work *w = (linear_work *)work;
#pragma omp parallel for schedule(static, 1)
    for (int t = 0; t < w->tiles; t++)
        for (int k = 0; k < TURNS; k++)
            run_tile(w, &w->tile[t]);
}

static void linear_outputs(lf_bench_work *work, lf_outputs *to)
{
    const linear_work *w = (linear_work *)work;
    const tile *t = &w->tile[0];
    run_tile(w, t);
    if (w->variant == FORWARD || w->variant == TRAIN)
        lf_outputs_add(to, "y", w->rows * w->out, t->y);
    if (w->variant == DX || w->variant == TRAIN)
        lf_outputs_add(to, "dx", w->rows * w->in, t->dx);
    if (w->variant == DW || w->variant == TRAIN) {
        lf_outputs_add(to, "dw", w->in * w->out, t->dw);
        lf_outputs_add(to, "db", w->out, t->db);
    }
}

/* Numbers that one product reads and writes. */
static long linear_moves(const linear_work *w)
{
    const long x = w->rows * w->in, y = w->rows * w->out, m = w->in * w->out;
    const long forward = x + m + w->out + y, dx = y + m + 2 * x, dw = x + y + 2 * (m + w->out);
    return w->variant == FORWARD ? forward
           : w->variant == DX    ? dx
           : w->variant == DW    ? dw
                                 : forward + dx + dw;
}

static void close_linear(lf_bench_work *work)
{
    linear_work *w = (linear_work *)work;
    for (int k = 0; k < w->tiles; k++) {
        tile *t = &w->tile[k];
        lf_real *arrays[] = {t->x, t->w, t->b, t->y, t->dy, t->dx, t->dw, t->db};
        for (int i = 0; i < 8; i++)
            free(arrays[i]);
    }
    free(w->tile);
    free(w);
}

static lf_bench_work *open_linear(const lf_bench_case *c)
{
    linear_work *w = lf_bench_room(1, sizeof *w);
    w->base = (lf_bench_work){.run = run_linear, .close = close_linear, .outputs = linear_outputs};
    w->rows = c->size[0];
    w->in = c->size[1];
    w->out = c->size[2];
    w->variant = c->variant;
    w->tiles = omp_get_max_threads();
    const double runs = (double)TURNS * w->tiles;
    w->base.flop = (w->variant == TRAIN ? 6.0 : 2.0) * (double)(w->rows * w->in * w->out) * runs;
    w->base.bytes = bytes_of(linear_moves(w)) * runs;
    w->base.footprint = bytes_of(linear_moves(w)) * w->tiles;
    w->tile = lf_bench_room(w->tiles, sizeof *w->tile);
    for (int k = 0; k < w->tiles; k++) /* tiles of all threads are alike */
        w->tile[k] = (tile){.x = numbers(w->rows * w->in, 1),
                            .w = numbers(w->in * w->out, 2),
                            .b = numbers(w->out, 3),
                            .y = zeros(w->rows * w->out),
                            .dy = numbers(w->rows * w->out, 4),
                            .dx = zeros(w->rows * w->in),
                            .dw = zeros(w->in * w->out),
                            .db = zeros(w->out)};
    return &w->base;
}

/* ---- convolution ----------------------------------------------------------------------------- */

typedef struct conv_work {
    lf_bench_work base;
    lf_conv s;
    int variant;
    lf_real *x, *w, *b, *y, *dx, *dw, *db, *scratch;
} conv_work;

static void run_conv(lf_bench_work *work)
{
    const conv_work *w = (conv_work *)work;
    if (w->variant == FORWARD)
        lf_kernel_conv(&w->s, w->x, w->w, w->b, LF_RELU, w->y, w->scratch);
    else if (w->variant == DX)
        lf_kernel_conv_dx(&w->s, w->y, w->w, w->dx, w->scratch);
    else
        lf_kernel_conv_dw(&w->s, w->x, w->y, w->dw, w->db, w->scratch);
}

static void conv_outputs(lf_bench_work *work, lf_outputs *to)
{
    const conv_work *w = (conv_work *)work;
    const lf_conv *s = &w->s;
    run_conv(work);
    if (w->variant == FORWARD)
        lf_outputs_add(to, "y", s->images * s->out_height * s->out_width * s->out, w->y);
    else if (w->variant == DX)
        lf_outputs_add(to, "dx", s->images * s->height * s->width * s->in, w->dx);
    else {
        lf_outputs_add(to, "dw", s->size * s->size * s->in * s->out, w->dw);
        lf_outputs_add(to, "db", s->out, w->db);
    }
}

static void close_conv(lf_bench_work *work)
{
    conv_work *w = (conv_work *)work;
    lf_real *arrays[] = {w->x, w->w, w->b, w->y, w->dx, w->dw, w->db, w->scratch};
    for (int i = 0; i < 8; i++)
        free(arrays[i]);
    free(w);
}

static lf_bench_work *open_conv(const lf_bench_case *c)
{
    conv_work *w = lf_bench_room(1, sizeof *w);
    w->base = (lf_bench_work){.run = run_conv, .close = close_conv, .outputs = conv_outputs};
    w->s = lf_conv_shape(c->size[0], c->size[1], c->size[1], c->size[2], c->size[3], c->size[4],
                         c->size[5], c->size[6]);
    w->variant = c->variant;
    const lf_conv *s = &w->s;
    const long xs = s->images * s->height * s->width * s->in;
    const long ys = s->images * s->out_height * s->out_width * s->out;
    const long ws = s->size * s->size * s->in * s->out;
    const long moves[] = {xs + ws + s->out + ys, ys + ws + 2 * xs, xs + ys + 2 * (ws + s->out)};
    w->base.flop = 2.0 * (double)ys * (double)(s->size * s->size * s->in);
    w->base.bytes = bytes_of(moves[w->variant]);
    w->x = numbers(xs, 1);
    w->w = numbers(ws, 2);
    w->b = numbers(s->out, 3);
    w->y = numbers(ys, 4);
    w->dx = zeros(xs);
    w->dw = zeros(ws);
    w->db = zeros(s->out);
    w->scratch = numbers(lf_conv_scratch(s), 8);
    return &w->base;
}

#define LINEAR(name, rows, in, out)                                                                \
    {"linear-" name,                                                                               \
     #in " -> " #out " + bias + ReLU, " #rows " rows a tile, a tile a thread",                     \
     open_linear,                                                                                  \
     {rows, in, out},                                                                              \
     FORWARD},                                                                                     \
        {"linear-" name "-dx", "its gradient in x", open_linear, {rows, in, out}, DX},             \
    {                                                                                              \
        "linear-" name "-dw", "its gradient in w and b", open_linear, {rows, in, out}, DW          \
    }
#define CONV(name, images, side, in, out, kernel, stride, pad)                                     \
    {"conv-" name,                                                                                 \
     #kernel "x" #kernel " stride " #stride ", " #in " -> " #out ", " #images " images " #side     \
             "x" #side,                                                                            \
     open_conv,                                                                                    \
     {images, side, in, out, kernel, stride, pad},                                                 \
     FORWARD},                                                                                     \
        {"conv-" name "-dx",                                                                       \
         "its gradient in x",                                                                      \
         open_conv,                                                                                \
         {images, side, in, out, kernel, stride, pad},                                             \
         DX},                                                                                      \
    {                                                                                              \
        "conv-" name "-dw", "its gradient in w and b", open_conv,                                  \
            {images, side, in, out, kernel, stride, pad}, DW                                       \
    }

static const lf_bench_case cases[] = {
    {"gemm-512", "matrix product 512 x 512 x 512", open_matmul, {512, 512, 512}, 0},
    {"gemm-1024", "matrix product 1024 x 1024 x 1024", open_matmul, {1024, 1024, 1024}, 0},
    LINEAR("32", 480, 32, 32),
    {"linear-32-train", "32 -> 32, forward and both gradients", open_linear, {480, 32, 32}, TRAIN},
    LINEAR("16", 480, 16, 16),
    LINEAR("34-64", 512, 34, 64),
    LINEAR("66-24", 1024, 66, 24),
    LINEAR("72-64", 256, 72, 64),
    LINEAR("256-128", 512, 256, 128),
    LINEAR("64-1", 1024, 64, 1),
    CONV("64", 8, 64, 64, 64, 3, 1, 1),
    CONV("32", 8, 64, 32, 32, 3, 1, 1),
    CONV("stem", 8, 65, 3, 32, 7, 2, 3),
    CONV("33-32-s2", 8, 33, 32, 32, 3, 2, 1),
    CONV("17-32", 8, 17, 32, 32, 3, 1, 1),
    CONV("17-64-s2", 8, 17, 32, 64, 3, 2, 1),
    CONV("9-64", 8, 9, 64, 64, 3, 1, 1),
    CONV("5-128", 8, 5, 128, 128, 3, 1, 1),
    CONV("3-256", 8, 3, 256, 256, 3, 1, 1),
    CONV("17-1x1-s2", 8, 17, 32, 64, 1, 2, 0),
    CONV("9-1x1", 8, 9, 64, 16, 1, 1, 0),
};

const lf_bench_table lf_bench_kernels = {"kernels", cases, sizeof cases / sizeof *cases, false};
