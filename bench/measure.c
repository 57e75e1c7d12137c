/* measure.c: timing in turn with the machine's limits, and errors. See measure.h. */
#include "bench/measure.h"

#include <limits.h>
#include <omp.h>

/* ---- time ------------------------------------------------------------------------------------ */

static double seconds_of(lf_bench_work *work, long runs)
{
    const double start = lf_bench_now();
    for (long i = 0; i < runs; i++)
        work->run(work);
    return lf_bench_now() - start;
}

/* Runs that take about a millisecond together, after a first one that warms up: short enough that
 * some samples are undisturbed on a machine that others use too. */
static long choose_runs(lf_bench_work *work)
{
    const double wanted = 0.7e-3;
    long runs = 1;
    seconds_of(work, 1);
    for (double t = seconds_of(work, runs); t < wanted; t = seconds_of(work, runs))
        runs *= t < wanted / 10 ? 8 : 2;
    return runs;
}

void lf_bench_see_limits(lf_bench_limits_seen *seen, int repeats)
{
    for (int i = 0; i < repeats; i++) {
        const double start = lf_bench_now();
        const double flop = lf_bench_fma(1 << 17, omp_get_max_threads());
        seen->fma = fmax(seen->fma, flop / (lf_bench_now() - start));
    }
}

void lf_bench_time(lf_bench_work *work, int repeats, lf_bench_limits_seen *seen,
                   lf_bench_result *result)
{
    const long runs = choose_runs(work);
    result->seconds = INFINITY;
    for (int i = 0; i < repeats; i++) {
        lf_bench_see_limits(seen, 1);
        result->seconds = fmin(result->seconds, seconds_of(work, runs) / (double)runs);
    }
    result->fma = seen->fma;
    result->flop = work->flop;
    result->bytes = work->bytes;
    result->memory = work->memory;
}

/* ---- errors ---------------------------------------------------------------------------------- */

/* What the program in double computes of the case. */
static lf_status run_double(const lf_bench_case *c, int threads, lf_outputs **exact, lf_error *err)
{
    char path[PATH_MAX], number[16];
    snprintf(number, sizeof number, "%d", threads);
    LF_TRY(lf_reference_find("elf-bench-f64", path, sizeof path, err));
    const char *const argv[] = {path, "--reference", c->name, "--threads", number, NULL};
    return lf_reference_run(argv, exact, err);
}

void lf_bench_errors(const lf_bench_case *c, int threads, lf_bench_result *result)
{
    lf_error err = {""};
    lf_outputs *exact = NULL, *got = lf_outputs_create();
    lf_bench_work *work = c->open(c);
    if (work->outputs) {
        lf_status status = run_double(c, threads, &exact, &err);
        if (status == LF_OK) {
            work->outputs(work, got);
            status = lf_outputs_compare(got, exact, result->error, &err);
        }
        result->outputs = status == LF_OK ? got->count : 0;
        snprintf(result->problem, sizeof result->problem, "%.511s", err.text);
    }
    work->close(work);
    lf_outputs_free(exact);
    lf_outputs_free(got);
}

const lf_output_error *lf_bench_worst(const lf_bench_result *result)
{
    const lf_output_error *worst = NULL;
    for (int i = 0; i < result->outputs; i++)
        if (!worst || result->error[i].largest > worst->largest)
            worst = &result->error[i];
    return worst;
}
