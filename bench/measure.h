/* measure.h: time of a case, the machine's limits in turn with it, and its errors against double.
 */
#ifndef LF_BENCH_MEASURE_H
#define LF_BENCH_MEASURE_H

#include "bench/bench.h"

/* What of a case is known. */
typedef struct lf_bench_result {
    const char *name;
    double seconds;             /* of one run, the best */
    double fma;                 /* the machine's multiply-add limit, flops a second */
    double flop, bytes, memory; /* as in lf_bench_work */
    int outputs;                /* arrays whose error is known; 0: none */
    lf_output_error error[LF_OUTPUTS_MAX];
    char problem[512]; /* why errors are not known although the case has outputs; else "" */
} lf_bench_result;

/* The machine's limits, the best seen since the program's start: a case may have been disturbed
 * throughout. */
typedef struct lf_bench_limits_seen {
    double fma; /* flops a second */
} lf_bench_limits_seen;

/* Measure the limits `repeats` times. */
void lf_bench_see_limits(lf_bench_limits_seen *seen, int repeats);
/* The best of `repeats` samples of the work, in turn with the limits. */
void lf_bench_time(lf_bench_work *work, int repeats, lf_bench_limits_seen *seen,
                   lf_bench_result *result);
/* Fill in the errors of the case against the program in double, from fresh work in both. */
void lf_bench_errors(const lf_bench_case *c, int threads, lf_bench_result *result);
/* The array with the largest error; NULL: not known. */
const lf_output_error *lf_bench_worst(const lf_bench_result *result);

#endif
