/* measure.c: timing in turn with the machine's limits, errors, memory. See measure.h. */
#include "bench/measure.h"

#include <limits.h>
#include <omp.h>

#include "autograd/kernels/limit.h"

/* ---- limits ---------------------------------------------------------------------------------- */

enum { BANDWIDTH_SAMPLES = 30 }; /* of a footprint, enough to see an undisturbed one */

void lf_seen_limits_free(lf_seen_limits *seen)
{
    free(seen->buffer);
    *seen = (lf_seen_limits){0};
}

int lf_foot_of(double bytes)
{
    const long power = lround(log2(fmax(bytes, 1)));
    return power < LF_FOOT_FIRST  ? 0
           : power > LF_FOOT_LAST ? LF_FOOTS - 1
                                  : (int)power - LF_FOOT_FIRST;
}

static void see_bandwidth(lf_seen_limits *seen, int foot, int threads)
{
    const long bytes = 1L << (foot + LF_FOOT_FIRST), sample = 1L << 24;
    const long turns = bytes < sample ? sample / bytes : 1;
    if (!seen->buffer) {
        const size_t most = (size_t)1 << LF_FOOT_LAST;
        seen->buffer = aligned_alloc(64, most);
        LF_REQUIRE(seen->buffer, "out of memory for %zu bytes", most);
        memset(seen->buffer, 0, most);
    }
    for (int kind = 0; kind < LF_STREAMS; kind++) {
        const double start = lf_bench_now();
        const double moved =
            lf_bench_stream_run((lf_bench_stream)kind, seen->buffer, bytes, turns, threads);
        seen->bandwidth[foot] = fmax(seen->bandwidth[foot], moved / (lf_bench_now() - start));
    }
    seen->samples[foot]++;
}

void lf_see_limits(lf_seen_limits *seen, double bytes, int threads)
{
    seen->fma = fmax(seen->fma, lf_limit_now(threads));
    const int foot = lf_foot_of(bytes);
    if (bytes > 0 && seen->samples[foot] < BANDWIDTH_SAMPLES)
        see_bandwidth(seen, foot, threads);
}

lf_roof lf_roof_of(double flop, double bytes, double fma, double bandwidth)
{
    const double computing = flop > 0 && fma > 0 ? flop / fma : 0;
    const double moving = bytes > 0 && bandwidth > 0 ? bytes / bandwidth : 0;
    return (lf_roof){fmax(computing, moving), moving > computing};
}

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

static double footprint(const lf_bench_work *work)
{
    return work->footprint > 0 ? work->footprint : work->bytes;
}

void lf_bench_time(lf_timed *timed, int count, int repeats, lf_seen_limits *seen)
{
    for (int k = 0; k < count; k++) {
        omp_set_num_threads(timed[k].threads);
        timed[k].runs = choose_runs(timed[k].work);
        timed[k].seconds = INFINITY;
    }
    for (int i = 0; i < repeats; i++)
        for (int k = 0; k < count; k++) {
            lf_timed *t = &timed[k];
            lf_see_limits(seen, footprint(timed[0].work), timed[0].threads);
            omp_set_num_threads(t->threads);
            t->seconds = fmin(t->seconds, seconds_of(t->work, t->runs) / (double)t->runs);
        }
    omp_set_num_threads(timed[0].threads);
}

/* Work a second, in whatever is counted. */
static double rate(const lf_timed *t)
{
    const lf_bench_work *w = t->work;
    return (w->flop > 0 ? w->flop : w->bytes > 0 ? w->bytes : 1) / t->seconds;
}

void lf_bench_measure(const lf_bench_case *c, int threads, int repeats, bool scaling,
                      lf_seen_limits *seen, lf_bench_result *result)
{
    lf_timed timed[2] = {{.work = c->open(c), .threads = threads}, {.threads = 1}};
    if (scaling) {
        omp_set_num_threads(1);
        timed[1].work = c->open(c);
        omp_set_num_threads(threads);
    }
    lf_bench_time(timed, scaling ? 2 : 1, repeats, seen);
    lf_bench_work *work = timed[0].work;
    result->seconds = timed[0].seconds;
    result->flop = work->flop;
    result->bytes = work->bytes;
    result->held = work->memory;
    result->fma = seen->fma;
    result->bandwidth = work->bytes > 0 ? seen->bandwidth[lf_foot_of(footprint(work))] : 0;
    result->scaling = scaling ? rate(&timed[0]) / rate(&timed[1]) : 0;
    work->close(work);
    if (scaling)
        timed[1].work->close(timed[1].work);
}

double lf_bench_share(const lf_bench_result *r, bool *memory)
{
    const lf_roof roof = lf_roof_of(r->flop, r->bytes, r->fma, r->bandwidth);
    *memory = roof.memory;
    return roof.seconds > 0 ? roof.seconds / r->seconds : NAN;
}

/* ---- errors ---------------------------------------------------------------------------------- */

/* What `program`, this one or the one in double, gives to a pipe when asked for the case. */
static lf_status ask(const char *program, const char *option, const lf_bench_case *c, int threads,
                     lf_outputs **out, lf_error *err)
{
    char number[16];
    snprintf(number, sizeof number, "%d", threads);
    return lf_reference_run((const char *[]){program, option, c->name, "--threads", number, NULL},
                            out, err);
}

void lf_bench_errors(const lf_bench_case *c, int threads, lf_bench_result *result)
{
    char path[PATH_MAX];
    lf_error err = {""};
    lf_outputs *exact = NULL, *got = lf_outputs_create();
    lf_bench_work *work = c->open(c);
    if (work->outputs) {
        lf_status status = lf_reference_find("elf-bench-f64", path, sizeof path, &err);
        if (status == LF_OK)
            status = ask(path, "--reference", c, threads, &exact, &err);
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

/* ---- a process of its own -------------------------------------------------------------------- */

/* The largest resident set of this process since it was started, in bytes; 0: not known. (That of
 * getrusage counts what the parent had.) */
static double resident(void)
{
    FILE *file = fopen("/proc/self/status", "r");
    char line[256];
    long kilobytes = 0;
    while (file && fgets(line, sizeof line, file))
        if (sscanf(line, "VmHWM: %ld kB", &kilobytes) == 1)
            break;
    if (file)
        fclose(file);
    return 1024.0 * (double)kilobytes;
}

/* What a process of its own knows of a case, as an array of doubles. */
enum { SECONDS, FLOP, BYTES, FOOTPRINT, HELD, RESIDENT, BASE, KNOWN };

void lf_bench_once(const lf_bench_case *c, bool large, lf_outputs *to)
{
    const int runs = large ? 1 : 3;
    lf_limit_run(1, omp_get_max_threads()); /* starts the threads */
    const double base = resident();
    lf_bench_work *work = c->open(c);
    const double seconds = seconds_of(work, runs) / runs;
    const double known[KNOWN] = {seconds,      work->flop, work->bytes, footprint(work),
                                 work->memory, resident(), base};
    work->close(work);
    lf_outputs_add_doubles(to, "once", KNOWN, known);
}

static lf_status ask_once(const lf_bench_case *c, int threads, double known[KNOWN], lf_error *err)
{
    lf_outputs *out = NULL;
    LF_TRY(ask("/proc/self/exe", "--once", c, threads, &out, err));
    memcpy(known, out->array[0].value, KNOWN * sizeof *known);
    lf_outputs_free(out);
    return LF_OK;
}

lf_status lf_bench_memory(const lf_bench_case *c, int threads, lf_bench_result *result,
                          lf_error *err)
{
    double known[KNOWN];
    LF_TRY(ask_once(c, threads, known, err));
    result->resident = known[RESIDENT];
    result->base = known[BASE];
    return LF_OK;
}

lf_status lf_bench_measure_large(const lf_bench_case *c, int threads, lf_seen_limits *seen,
                                 lf_bench_result *result, lf_error *err)
{
    double known[KNOWN];
    LF_TRY(ask_once(c, threads, known, err));
    for (int i = 0; i < BANDWIDTH_SAMPLES; i++)
        lf_see_limits(seen, known[FOOTPRINT], threads);
    result->seconds = known[SECONDS];
    result->flop = known[FLOP];
    result->bytes = known[BYTES];
    result->held = known[HELD];
    result->fma = seen->fma;
    result->bandwidth = known[BYTES] > 0 ? seen->bandwidth[lf_foot_of(known[FOOTPRINT])] : 0;
    result->resident = known[RESIDENT];
    result->base = known[BASE];
    return LF_OK;
}
