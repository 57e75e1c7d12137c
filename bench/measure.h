/* measure.h: time of a case in turn with the machine's limits, the share that it reaches of them,
 * its errors against double, and its memory.                            [docs/performance.md]
 */
#ifndef LF_BENCH_MEASURE_H
#define LF_BENCH_MEASURE_H

#include "bench/bench.h"

/* ---- limits ---------------------------------------------------------------------------------- */

/* Footprints whose bandwidth is measured: powers of two from 2^LF_FOOT_FIRST bytes on. */
enum { LF_FOOT_FIRST = 17, LF_FOOT_LAST = 28, LF_FOOTS = LF_FOOT_LAST - LF_FOOT_FIRST + 1 };

/* Footprints of memory, and of the caches of one core and more. */
#define LF_BYTES_OF_MEMORY 0x1p28
#define LF_BYTES_OF_CACHES 0x1p20

/* The machine's limits, the best seen since the program's start: a case may have been disturbed
 * throughout. All zeros to begin with. */
typedef struct lf_seen_limits {
    double fma;                 /* flops a second */
    double bandwidth[LF_FOOTS]; /* bytes a second, best of read, copy and triad; 0: not measured */
    int samples[LF_FOOTS];
    lf_real *buffer; /* of the largest footprint, made when it is first needed */
} lf_seen_limits;

void lf_seen_limits_free(lf_seen_limits *seen);
/* Which footprint stands for so many bytes. */
int lf_foot_of(double bytes);
/* One sample of the multiply-add limit, and one of the bandwidth of `bytes`, if any. */
void lf_see_limits(lf_seen_limits *seen, double bytes, int threads);

/* What the limits leave: the least seconds that so much work takes. */
typedef struct lf_roof {
    double seconds; /* the longer of both */
    bool memory;    /* bandwidth binds, not multiply-adds */
} lf_roof;
/* fma: flops a second; bandwidth: bytes a second. What is not counted (0) binds nothing. */
lf_roof lf_roof_of(double flop, double bytes, double fma, double bandwidth);

/* ---- a case ---------------------------------------------------------------------------------- */

/* What is known of a case; 0 where nothing is. */
typedef struct lf_bench_result {
    const lf_bench_case *of;
    const char *group;
    double seconds;           /* of one run, the best */
    double flop, bytes, held; /* as in lf_bench_work; held: its memory */
    double fma, bandwidth;    /* the limits for it */
    double scaling;           /* rate of all threads over that of one */
    double resident, base;    /* largest resident set of a process of its own; that of no work */
    int outputs;              /* arrays whose error is known */
    lf_output_error error[LF_OUTPUTS_MAX];
    char problem[512]; /* why errors are not known although the case has outputs; else "" */
} lf_bench_result;

/* The limits' share of the time: 1 is all that they allow. NAN: nothing is counted. */
double lf_bench_share(const lf_bench_result *result, bool *memory);
/* The array with the largest error; NULL: not known. */
const lf_output_error *lf_bench_worst(const lf_bench_result *result);

/* Work to be timed with so many threads. */
typedef struct lf_timed {
    lf_bench_work *work;
    int threads;
    double seconds; /* of one run, the best */
    long runs;      /* of a sample; set by lf_bench_time */
} lf_timed;

/* `repeats` samples of each piece of work and of the limits, in turn. Leaves OpenMP with the first
 * one's threads. */
void lf_bench_time(lf_timed *timed, int count, int repeats, lf_seen_limits *seen);

/* Fill in time and limits, and with `scaling` the rate over that of one thread. */
void lf_bench_measure(const lf_bench_case *c, int threads, int repeats, bool scaling,
                      lf_seen_limits *seen, lf_bench_result *result);
/* Fill in the errors of the case against the program in double, from fresh work in both. */
void lf_bench_errors(const lf_bench_case *c, int threads, lf_bench_result *result);

/* ---- a process of its own -------------------------------------------------------------------- */

/* Run the case in this process, which has done nothing else: three times, a large one once. Gives
 * what the functions below want to know. */
void lf_bench_once(const lf_bench_case *c, bool large, lf_outputs *to);
/* Fill in the memory of a case from a process of its own. */
lf_status lf_bench_memory(const lf_bench_case *c, int threads, lf_bench_result *result,
                          lf_error *err);
/* Fill in time (of its one run, the first), limits and memory of a large case. */
lf_status lf_bench_measure_large(const lf_bench_case *c, int threads, lf_seen_limits *seen,
                                 lf_bench_result *result, lf_error *err);

#endif
