/* limit.c: the machine's own limits: multiply-adds in registers, and memory streams. */
#include <omp.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "autograd/kernels/limit.h"
#include "autograd/kernels/vector.h"
#include "autograd/status.h"
#include "bench/bench.h"

double lf_bench_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* ---- multiply-adds --------------------------------------------------------------------------- */

typedef struct fma_work {
    lf_bench_work base;
    int threads;
} fma_work;

enum { STEPS = 1 << 16 };

static void run_fma(lf_bench_work *work)
{
    work->flop = lf_limit_run(STEPS, ((fma_work *)work)->threads);
}

static void close_plain(lf_bench_work *work)
{
    free(work);
}

static lf_bench_work *open_fma(const lf_bench_case *c)
{
    fma_work *w = calloc(1, sizeof *w);
    LF_REQUIRE(w, "no memory");
    w->threads = c->variant ? c->variant : omp_get_max_threads();
    w->base = (lf_bench_work){.run = run_fma, .close = close_plain};
    run_fma(&w->base); /* counts the operations */
    return &w->base;
}

/* ---- memory ---------------------------------------------------------------------------------- */

typedef struct memory_work {
    lf_bench_work base;
    long count;
    lf_real *from, *to;
} memory_work;

static void run_copy(lf_bench_work *work)
{
    const memory_work *w = (memory_work *)work;
    const long part = 1 << 16;
#pragma omp parallel for schedule(static)
    for (long i = 0; i < w->count; i += part)
        memcpy(w->to + i, w->from + i, (size_t)part * sizeof *w->to);
}

static void run_read(lf_bench_work *work)
{
    const memory_work *w = (memory_work *)work;
    const long part = 1 << 16;
#pragma omp parallel for schedule(static)
    for (long i = 0; i < w->count; i += part) {
        lf_vec sum[4] = {{0}};
        for (long j = i; j < i + part; j += 4 * LF_LANES)
            for (int k = 0; k < 4; k++)
                sum[k] += lf_vec_load(w->from + j + k * LF_LANES);
        __asm__ volatile("" ::"m"(sum));
    }
}

static void close_memory(lf_bench_work *work)
{
    memory_work *w = (memory_work *)work;
    free(w->from);
    free(w->to);
    free(w);
}

static lf_bench_work *open_memory(const lf_bench_case *c)
{
    memory_work *w = calloc(1, sizeof *w);
    LF_REQUIRE(w, "no memory");
    w->count = c->size[0] << 20;
    w->count /= (long)sizeof(lf_real);
    w->from = aligned_alloc(64, (size_t)w->count * sizeof(lf_real));
    w->to = aligned_alloc(64, (size_t)w->count * sizeof(lf_real));
    LF_REQUIRE(w->from && w->to, "no memory for two arrays of %ld MiB", c->size[0]);
    memset(w->from, 0, (size_t)w->count * sizeof(lf_real));
    memset(w->to, 0, (size_t)w->count * sizeof(lf_real));
    w->base = (lf_bench_work){.run = c->variant ? run_copy : run_read, .close = close_memory};
    w->base.bytes = (c->variant ? 2.0 : 1.0) * (double)w->count * sizeof(lf_real);
    return &w->base;
}

static const lf_bench_case cases[] = {
    {"limit-1", "multiply-adds in registers, one thread", open_fma, {0}, 1},
    {"limit", "multiply-adds in registers, all threads", open_fma, {0}, 0},
    {"read", "read 128 MiB, all threads", open_memory, {128}, 0},
    {"copy", "copy 128 MiB, all threads (bytes read + bytes written)", open_memory, {128}, 1},
};

const lf_bench_table lf_bench_limits = {cases, sizeof cases / sizeof *cases};
