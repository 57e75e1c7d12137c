/* main.c: elf-bench [CASE...] [--list] [--json FILE] [--threads N] [--repeats N]
 *
 * Times each case alternately with the machine's multiply-add limit and reports the best of both:
 * what a machine shared with others can still show. Names pick cases by their beginning.
 */
#include <getopt.h>
#include <jansson.h>
#include <math.h>
#include <omp.h>
#include <stdbool.h>

#include "autograd/kernels/limit.h"
#include "autograd/kernels/vector.h"
#include "autograd/status.h"
#include "bench/bench.h"

static const lf_bench_table *const tables[] = {
    &lf_bench_limits,          &lf_bench_kernels, &lf_bench_steps,
    &lf_bench_ray_equivariant, &lf_bench_ibrnet,
#ifdef LF_ONEDNN
    &lf_bench_onednn,
#endif
};
enum { TABLES = sizeof tables / sizeof *tables };

typedef struct options {
    bool list;
    const char *json;
    int repeats;
    char **names;
    int count;
} options;

typedef struct result {
    double seconds; /* of one run, the best */
    double limit;   /* flops a second, the best so far in this run of the program */
    double flop, bytes, memory, error;
} result;

/* ---- measuring ------------------------------------------------------------------------------- */

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

/* *limit is the best seen since the program's start: one case may have been disturbed throughout.
 */
static result measure(lf_bench_work *work, int repeats, double *limit)
{
    result r = {.seconds = INFINITY, .flop = work->flop, .bytes = work->bytes, .error = NAN};
    const long runs = choose_runs(work);
    for (int i = 0; i < repeats; i++) {
        *limit = fmax(*limit, lf_limit_now(omp_get_max_threads()));
        r.seconds = fmin(r.seconds, seconds_of(work, runs) / (double)runs);
    }
    r.limit = *limit;
    r.memory = work->memory;
    if (work->error)
        r.error = work->error(work);
    return r;
}

/* ---- reporting ------------------------------------------------------------------------------- */

static void print_result(const char *name, const result *r)
{
    printf("%-18s %10.4f ms", name, 1e3 * r->seconds);
    if (r->flop > 0)
        printf(" %8.1f GF/s %5.1f %%", 1e-9 * r->flop / r->seconds,
               100 * r->flop / r->seconds / r->limit);
    if (r->bytes > 0)
        printf(" %8.1f GB/s", 1e-9 * r->bytes / r->seconds);
    if (r->memory > 0)
        printf(" %8.1f MB", 1e-6 * r->memory);
    if (!isnan(r->error))
        printf("  err %.0e", r->error);
    printf("\n");
    fflush(stdout);
}

static json_t *result_json(const char *name, const result *r)
{
    json_t *o = json_pack("{s:s, s:f}", "case", name, "ms", 1e3 * r->seconds);
    if (r->flop > 0) {
        json_object_set_new(o, "gflops", json_real(1e-9 * r->flop / r->seconds));
        json_object_set_new(o, "limit_gflops", json_real(1e-9 * r->limit));
        json_object_set_new(o, "share", json_real(r->flop / r->seconds / r->limit));
    }
    if (r->bytes > 0)
        json_object_set_new(o, "gbytes_per_s", json_real(1e-9 * r->bytes / r->seconds));
    if (r->memory > 0)
        json_object_set_new(o, "mb", json_real(1e-6 * r->memory));
    if (!isnan(r->error))
        json_object_set_new(o, "error", json_real(r->error));
    return o;
}

/* ---- the program ----------------------------------------------------------------------------- */

static bool chosen(const options *o, const char *name)
{
    for (int i = 0; i < o->count; i++)
        if (strncmp(name, o->names[i], strlen(o->names[i])) == 0)
            return true;
    return o->count == 0;
}

static void run_case(const lf_bench_case *c, const options *o, double *limit, json_t *results)
{
    lf_bench_work *work = c->open(c);
    const result r = measure(work, o->repeats, limit);
    work->close(work);
    print_result(c->name, &r);
    json_array_append_new(results, result_json(c->name, &r));
}

/* Every chosen case; returns how many there were. */
static int for_cases(const options *o, json_t *results)
{
    int count = 0;
    double limit = 0;
    for (int i = 0; !o->list && i < o->repeats; i++)
        limit = fmax(limit, lf_limit_now(omp_get_max_threads()));
    for (int t = 0; t < TABLES; t++)
        for (int i = 0; i < tables[t]->count; i++) {
            const lf_bench_case *c = &tables[t]->cases[i];
            if (!chosen(o, c->name))
                continue;
            count++;
            if (o->list)
                printf("%-18s %s\n", c->name, c->what);
            else
                run_case(c, o, &limit, results);
        }
    return count;
}

static lf_status write_json(const options *o, json_t *results, lf_error *err)
{
    json_t *all = json_pack("{s:s, s:i, s:i, s:s, s:O}", "precision", LF_REAL_NAME, "threads",
                            omp_get_max_threads(), "vector_bytes", LF_VEC_BYTES, "compiler",
                            __VERSION__, "results", results);
    const int failed = json_dump_file(all, o->json, JSON_INDENT(1) | JSON_REAL_PRECISION(6));
    json_decref(all);
    return failed ? lf_fail(err, LF_FAILED, "%s: cannot be written", o->json) : LF_OK;
}

static void usage(FILE *to)
{
    fprintf(to, "usage: elf-bench [CASE...] [--list] [--json FILE] [--threads N] [--repeats N]\n"
                "Times kernels against the machine's multiply-add limit. CASE: the beginning of a\n"
                "case's name; none: all. Columns: best time of one run, rate, share of the limit\n"
                "measured in turn with it, largest error against sums in double.\n");
}

static lf_status positive(const char *option, const char *text, int *value, lf_error *err)
{
    char *end;
    const long n = strtol(text, &end, 10);
    if (*end || end == text || n < 1 || n > 1024)
        return lf_fail(err, LF_BAD_INPUT, "%s %s: a number from 1 to 1024 is needed", option, text);
    *value = (int)n;
    return LF_OK;
}

static lf_status parse(int argc, char **argv, options *o, lf_error *err)
{
    static const struct option known[] = {
        {"list", no_argument, NULL, 'l'},          {"json", required_argument, NULL, 'j'},
        {"threads", required_argument, NULL, 't'}, {"repeats", required_argument, NULL, 'r'},
        {"help", no_argument, NULL, 'h'},          {0}};
    int threads = omp_get_max_threads();
    for (int c; (c = getopt_long(argc, argv, "", known, NULL)) != -1;) {
        if (c == 'l')
            o->list = true;
        else if (c == 'j')
            o->json = optarg;
        else if (c == 't')
            LF_TRY(positive("--threads", optarg, &threads, err));
        else if (c == 'r')
            LF_TRY(positive("--repeats", optarg, &o->repeats, err));
        else if (c == 'h') {
            usage(stdout);
            exit(0);
        } else
            return lf_fail(err, LF_BAD_INPUT, "elf-bench --help shows what is allowed");
    }
    omp_set_num_threads(threads);
    o->names = argv + optind;
    o->count = argc - optind;
    return LF_OK;
}

static lf_status run(int argc, char **argv, lf_error *err)
{
    options o = {.repeats = 100};
    LF_TRY(parse(argc, argv, &o, err));
    if (!o.list)
        printf("%d threads, vectors of %d bytes, %s, GCC %s\n", omp_get_max_threads(), LF_VEC_BYTES,
               LF_REAL_NAME, __VERSION__);
    json_t *results = json_array();
    const int count = for_cases(&o, results);
    lf_status status = LF_OK;
    if (count == 0)
        status = lf_fail(err, LF_BAD_INPUT, "no such case; elf-bench --list names them");
    else if (o.json)
        status = write_json(&o, results, err);
    json_decref(results);
    return status;
}

int main(int argc, char **argv)
{
    lf_error err;
    const lf_status status = run(argc, argv, &err);
    if (status != LF_OK)
        fprintf(stderr, "elf-bench: %s\n", err.text);
    return (int)status;
}
