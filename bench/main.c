/* main.c: elf-bench [CASE...] [--list] [--json FILE] [--threads N] [--repeats N] [--no-errors]
 *         elf-bench --reference CASE: what the case computes, to the program in another precision
 *
 * Times each case alternately with the machine's multiply-add limit and reports the best of both:
 * what a machine shared with others can still show. Names pick cases by their beginning.
 */
#include <getopt.h>
#include <jansson.h>
#include <omp.h>
#include <stdbool.h>
#include <unistd.h>

#include "autograd/kernels/vector.h"
#include "bench/measure.h"

static const lf_bench_table *const tables[] = {
    &lf_bench_limits,          &lf_bench_kernels, &lf_bench_steps,
    &lf_bench_ray_equivariant, &lf_bench_ibrnet,
#ifdef LF_ONEDNN
    &lf_bench_onednn,
#endif
};
enum { TABLES = sizeof tables / sizeof *tables };

typedef struct options {
    bool list, no_errors;
    const char *json, *reference;
    int threads, repeats;
    char **names;
    int count;
} options;

/* ---- reporting ------------------------------------------------------------------------------- */

static void print_result(const lf_bench_result *r)
{
    const lf_output_error *worst = lf_bench_worst(r);
    printf("%-18s %10.4f ms", r->name, 1e3 * r->seconds);
    if (r->flop > 0)
        printf(" %8.1f GF/s %5.1f %%", 1e-9 * r->flop / r->seconds,
               100 * r->flop / r->seconds / r->fma);
    if (r->bytes > 0)
        printf(" %8.1f GB/s", 1e-9 * r->bytes / r->seconds);
    if (r->memory > 0)
        printf(" %8.1f MB", 1e-6 * r->memory);
    if (worst)
        printf("  err %.1e (%s), l2 %.1e", worst->largest, worst->name, worst->l2);
    else if (r->problem[0])
        printf("  err not measured: %s", r->problem);
    printf("\n");
    fflush(stdout);
}

static json_t *errors_json(const lf_bench_result *r)
{
    json_t *all = json_object();
    for (int i = 0; i < r->outputs; i++)
        json_object_set_new(
            all, r->error[i].name,
            json_pack("{s:f, s:f}", "largest", r->error[i].largest, "l2", r->error[i].l2));
    return all;
}

static json_t *result_json(const lf_bench_result *r)
{
    json_t *o = json_pack("{s:s, s:f}", "case", r->name, "ms", 1e3 * r->seconds);
    const lf_output_error *worst = lf_bench_worst(r);
    if (r->flop > 0) {
        json_object_set_new(o, "gflops", json_real(1e-9 * r->flop / r->seconds));
        json_object_set_new(o, "limit_gflops", json_real(1e-9 * r->fma));
        json_object_set_new(o, "share", json_real(r->flop / r->seconds / r->fma));
    }
    if (r->bytes > 0)
        json_object_set_new(o, "gbytes_per_s", json_real(1e-9 * r->bytes / r->seconds));
    if (r->memory > 0)
        json_object_set_new(o, "mb", json_real(1e-6 * r->memory));
    json_object_set_new(o, "error", worst ? json_real(worst->largest) : json_null());
    if (worst)
        json_object_set_new(o, "errors", errors_json(r));
    else if (r->problem[0])
        json_object_set_new(o, "error_missing", json_string(r->problem));
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

static void run_case(const lf_bench_case *c, const options *o, lf_bench_limits_seen *seen,
                     json_t *results)
{
    lf_bench_result r = {.name = c->name};
    lf_bench_work *work = c->open(c);
    lf_bench_time(work, o->repeats, seen, &r);
    work->close(work);
    if (!o->no_errors)
        lf_bench_errors(c, o->threads, &r);
    print_result(&r);
    json_array_append_new(results, result_json(&r));
}

/* Every chosen case; returns how many there were. */
static int for_cases(const options *o, json_t *results)
{
    int count = 0;
    lf_bench_limits_seen seen = {0};
    if (!o->list)
        lf_bench_see_limits(&seen, o->repeats);
    for (int t = 0; t < TABLES; t++)
        for (int i = 0; i < tables[t]->count; i++) {
            const lf_bench_case *c = &tables[t]->cases[i];
            if (!chosen(o, c->name))
                continue;
            count++;
            if (o->list)
                printf("%-18s %s\n", c->name, c->what);
            else
                run_case(c, o, &seen, results);
        }
    return count;
}

static lf_status write_json(const options *o, json_t *results, lf_error *err)
{
    json_t *all =
        json_pack("{s:s, s:i, s:i, s:s, s:O}", "precision", LF_REAL_NAME, "threads", o->threads,
                  "vector_bytes", LF_VEC_BYTES, "compiler", __VERSION__, "results", results);
    const int failed = json_dump_file(all, o->json, JSON_INDENT(1) | JSON_REAL_PRECISION(6));
    json_decref(all);
    return failed ? lf_fail(err, LF_FAILED, "%s: cannot be written", o->json) : LF_OK;
}

/* Give what the case of exactly that name computes to standard output. */
static lf_status give_reference(const char *name, lf_error *err)
{
    const lf_bench_case *c = NULL;
    for (int t = 0; t < TABLES; t++)
        for (int i = 0; i < tables[t]->count; i++)
            if (strcmp(tables[t]->cases[i].name, name) == 0)
                c = &tables[t]->cases[i];
    if (!c)
        return lf_fail(err, LF_BAD_INPUT, "--reference %s: no such case; --list names them", name);
    if (isatty(STDOUT_FILENO))
        return lf_fail(err, LF_BAD_INPUT, "--reference writes binary numbers: give it a pipe");
    lf_bench_work *work = c->open(c);
    lf_outputs *outputs = lf_outputs_create();
    if (work->outputs)
        work->outputs(work, outputs);
    work->close(work);
    const lf_status status = lf_outputs_write(outputs, stdout, "standard output", err);
    lf_outputs_free(outputs);
    return status;
}

static void usage(FILE *to)
{
    fprintf(to,
            "usage: elf-bench [CASE...] [--list] [--json FILE] [--threads N] [--repeats N]\n"
            "                 [--no-errors]\n"
            "       elf-bench --reference CASE\n"
            "Times kernels against the machine's multiply-add limit. CASE: the beginning of a\n"
            "case's name; none: all. Columns: best time of one run, rate, share of the limit\n"
            "measured in turn with it, error of what it computes against elf-bench-f64, which\n"
            "stands beside this program: the largest difference over the largest value, of the\n"
            "array where that is largest, and the same of the root mean squares.\n"
            "--reference writes what a case computes to a pipe.\n");
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
    static const struct option known[] = {{"list", no_argument, NULL, 'l'},
                                          {"json", required_argument, NULL, 'j'},
                                          {"threads", required_argument, NULL, 't'},
                                          {"repeats", required_argument, NULL, 'r'},
                                          {"reference", required_argument, NULL, 'f'},
                                          {"no-errors", no_argument, NULL, 'n'},
                                          {"help", no_argument, NULL, 'h'},
                                          {0}};
    for (int c; (c = getopt_long(argc, argv, "", known, NULL)) != -1;) {
        if (c == 'l')
            o->list = true;
        else if (c == 'n')
            o->no_errors = true;
        else if (c == 'j')
            o->json = optarg;
        else if (c == 'f')
            o->reference = optarg;
        else if (c == 't')
            LF_TRY(positive("--threads", optarg, &o->threads, err));
        else if (c == 'r')
            LF_TRY(positive("--repeats", optarg, &o->repeats, err));
        else if (c == 'h') {
            usage(stdout);
            exit(0);
        } else
            return lf_fail(err, LF_BAD_INPUT, "elf-bench --help shows what is allowed");
    }
    o->names = argv + optind;
    o->count = argc - optind;
    return LF_OK;
}

static lf_status run(int argc, char **argv, lf_error *err)
{
    options o = {.repeats = 100, .threads = omp_get_max_threads()};
    LF_TRY(parse(argc, argv, &o, err));
    omp_set_num_threads(o.threads);
    if (o.reference)
        return give_reference(o.reference, err);
    o.no_errors |= sizeof(lf_real) == sizeof(double); /* it is what errors are measured against */
    if (!o.list)
        printf("%d threads, vectors of %d bytes, %s, GCC %s\n", o.threads, LF_VEC_BYTES,
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
