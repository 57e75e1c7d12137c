/* bench.h: what elf-bench measures: tables of cases, each one piece of work timed against the
 * machine's own limits in the same run. [docs/performance.md]
 *
 * To add cases, write a table in a file of its own and name it in main.c's list of tables.
 */
#ifndef LF_BENCH_BENCH_H
#define LF_BENCH_BENCH_H

#include <stdbool.h>
#include <stdint.h>

#include "bench/reference.h"

/* A piece of work with its data. */
typedef struct lf_bench_work lf_bench_work;
struct lf_bench_work {
    double flop; /* of one run, useful operations only; 0: only the time is reported */
    /* The least that one run moves: everything read, once, and everything written, once; what is
     * added to counts twice. Steps: all that is held after a run, written once and read once. Known
     * after a run; 0: not counted. */
    double bytes;
    double footprint; /* bytes of what a run touches, if it goes over it several times; 0: bytes */
    double memory;    /* bytes held, if known after a run; else 0 */
    void (*run)(lf_bench_work *work); /* with the threads that OpenMP has */
    /* Run fresh work once and give what it computes, for the error against double; NULL: nothing.
     * All inputs are floats in either precision. */
    void (*outputs)(lf_bench_work *work, lf_outputs *to);
    void (*close)(lf_bench_work *work); /* free the data and the work itself */
};

typedef struct lf_bench_case lf_bench_case;
struct lf_bench_case {
    const char *name;
    const char *what; /* one line for --list */
    lf_bench_work *(*open)(const lf_bench_case *c);
    long size[8]; /* open's own parameters */
    int variant;
};

typedef struct lf_bench_table {
    const char *group; /* limits, kernels, networks, steps, paper */
    const lf_bench_case *cases;
    int count;
    bool large; /* run only when named, once, in a process of its own */
} lf_bench_table;

extern const lf_bench_table lf_bench_limits;          /* limit.c */
extern const lf_bench_table lf_bench_kernels;         /* kernels.c */
extern const lf_bench_table lf_bench_backbones;       /* backbones.c */
extern const lf_bench_table lf_bench_ray_equivariant; /* ray_equivariant.c */
extern const lf_bench_table lf_bench_ibrnet;          /* ibrnet.c */
extern const lf_bench_table lf_bench_steps;           /* steps.c */
extern const lf_bench_table lf_bench_paper;           /* steps.c */
extern const lf_bench_table lf_bench_render_steps;    /* render_steps.c */
extern const lf_bench_table lf_bench_paper_render;    /* render_steps.c */
extern const lf_bench_table lf_bench_onednn;          /* peer_onednn.c, if it was found */

/* Zeroed memory for `count` things of `size` bytes, to be given to free. */
void *lf_bench_room(long count, size_t size);
/* Floats, uniform in low ... high, named by `item`. */
void lf_bench_fill(long count, lf_real *x, double low, double high, uint64_t item);

/* ---- limits ---------------------------------------------------------------------------------- */

typedef enum lf_bench_stream {
    LF_STREAM_READ,
    LF_STREAM_COPY,
    LF_STREAM_TRIAD, /* a = b + s c */
    LF_STREAMS
} lf_bench_stream;

/* Go `turns` times over arrays of `bytes` together, each thread over its own part of them: the
 * bytes read and written. `buffer` has room for them. */
double lf_bench_stream_run(lf_bench_stream kind, lf_real *buffer, long bytes, long turns,
                           int threads);

/* Seconds of a steady clock. */
double lf_bench_now(void);

#endif
