/* limit.c: the machine's own limits: multiply-adds in registers, and streams of numbers from and to
 * memory and caches; and what all cases use. */
#include <omp.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "autograd/kernels/limit.h"
#include "autograd/kernels/vector.h"
#include "autograd/random.h"
#include "bench/bench.h"

void *lf_bench_room(long count, size_t size)
{
    void *p = calloc((size_t)count, size);
    LF_REQUIRE(p, "out of memory for %ld times %zu bytes", count, size);
    return p;
}

void lf_bench_fill(long count, lf_real *x, double low, double high, uint64_t item)
{
    lf_stream s = lf_stream_at(3, LF_RANDOM_TEST, 1, item);
    for (long i = 0; i < count; i++)
        x[i] = lf_reference_input(low + (high - low) * lf_uniform(&s));
}

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
    fma_work *w = lf_bench_room(1, sizeof *w);
    w->threads = c->variant ? c->variant : omp_get_max_threads();
    w->base = (lf_bench_work){.run = run_fma, .close = close_plain};
    run_fma(&w->base); /* counts the operations */
    return &w->base;
}

/* ---- memory ---------------------------------------------------------------------------------- */

enum { SUMS = 8 }; /* independent sums of a thread that reads */

static void read_part(const lf_real *from, long count)
{
    lf_vec sum[SUMS] = {{0}};
    for (long j = 0; j + SUMS * LF_LANES <= count; j += SUMS * LF_LANES)
        for (int k = 0; k < SUMS; k++)
            sum[k] += lf_vec_load(from + j + k * LF_LANES);
    __asm__ volatile("" ::"m"(sum));
}

static void triad_part(lf_real *to, const lf_real *b, const lf_real *c, long count)
{
    const lf_vec factor = lf_vec_all((lf_real)0.5);
    for (long j = 0; j < count; j += LF_LANES)
        lf_vec_store(to + j, lf_vec_load(b + j) + factor * lf_vec_load(c + j));
}

static void stream_part(lf_bench_stream kind, lf_real *part, long count)
{
    if (kind == LF_STREAM_READ)
        read_part(part, count);
    else if (kind == LF_STREAM_COPY)
        memcpy(part, part + count, (size_t)count * sizeof *part);
    else
        triad_part(part, part + count, part + 2 * count, count);
    __asm__ volatile("" ::: "memory"); /* each turn really is one */
}

double lf_bench_stream_run(lf_bench_stream kind, lf_real *buffer, long bytes, long turns,
                           int threads)
{
    const long arrays = 1 + (long)kind, line = SUMS * LF_LANES;
    const long share = bytes / (long)sizeof(lf_real) / arrays / threads,
               count = share / line * line;
#pragma omp parallel for num_threads(threads) schedule(static, 1)
    for (int t = 0; t < threads; t++)
        for (long k = 0; k < turns; k++)
            stream_part(kind, buffer + t * arrays * count, count);
    return (double)(arrays * count * turns * threads) * sizeof(lf_real);
}

typedef struct memory_work {
    lf_bench_work base;
    lf_bench_stream kind;
    int threads;
    long bytes;
    lf_real *buffer;
} memory_work;

static void run_memory(lf_bench_work *work)
{
    const memory_work *w = (memory_work *)work;
    work->bytes = lf_bench_stream_run(w->kind, w->buffer, w->bytes, 1, w->threads);
}

static void close_memory(lf_bench_work *work)
{
    free(((memory_work *)work)->buffer);
    free(work);
}

/* size: MiB of all arrays, threads (0: all) */
static lf_bench_work *open_memory(const lf_bench_case *c)
{
    memory_work *w = lf_bench_room(1, sizeof *w);
    w->kind = (lf_bench_stream)c->variant;
    w->threads = c->size[1] ? (int)c->size[1] : omp_get_max_threads();
    w->bytes = c->size[0] << 20;
    w->buffer = aligned_alloc(64, (size_t)w->bytes);
    LF_REQUIRE(w->buffer, "no memory for %ld MiB", c->size[0]);
    memset(w->buffer, 0, (size_t)w->bytes);
    w->base = (lf_bench_work){.run = run_memory, .close = close_memory};
    return &w->base;
}

#define STREAM(name, what, kind)                                                                   \
    {name "-1", what ", one thread", open_memory, {256, 1}, kind},                                 \
    {                                                                                              \
        name, what ", all threads", open_memory, {256, 0}, kind                                    \
    }

static const lf_bench_case cases[] = {
    {"limit-1", "multiply-adds in registers, one thread", open_fma, {0}, 1},
    {"limit", "multiply-adds in registers, all threads", open_fma, {0}, 0},
    STREAM("read", "read 256 MiB", LF_STREAM_READ),
    STREAM("copy", "copy 128 MiB (bytes read + bytes written)", LF_STREAM_COPY),
    STREAM("triad", "a = b + s c, 256 MiB together", LF_STREAM_TRIAD),
};

const lf_bench_table lf_bench_limits = {"limits", cases, sizeof cases / sizeof *cases, false};
