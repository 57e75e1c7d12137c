/* main.c: elf-bench [CASE...] [--json FILE] [--picture FILE] [--scaling] [--memory] ...
 *         elf-bench --ratio CASE OTHER
 *         elf-bench --errors [CASE...]
 *         elf-bench stability [CASE...]: stability_report.h
 *         elf-bench growth [QUANTITY...]: growth.h
 *         elf-bench --reference CASE, --once CASE: to a pipe, for another elf-bench
 *
 * Times each case alternately with the machine's limits and reports the best of both: what a
 * machine shared with others can still show. Names pick cases by their beginning. What the numbers
 * mean: docs/performance.md.
 */
#include <getopt.h>
#include <omp.h>
#include <unistd.h>

#include "autograd/kernels/vector.h"
#include "bench/command_line.h"
#include "bench/growth.h"
#include "bench/picture.h"
#include "bench/report.h"
#include "bench/stability_report.h"

static const lf_bench_table *const tables[] = {
    &lf_bench_limits,       &lf_bench_kernels,
#ifdef LF_ONEDNN
    &lf_bench_onednn,
#endif
    &lf_bench_backbones,    &lf_bench_ray_equivariant, &lf_bench_ibrnet,       &lf_bench_steps,
    &lf_bench_render_steps, &lf_bench_paper,           &lf_bench_paper_render,
};
enum { TABLES = sizeof tables / sizeof *tables, MOST_CASES = 256 };

typedef struct options {
    bool list, exact, errors, no_errors, scaling, memory, ratio;
    const char *json, *picture, *reference, *once;
    int threads, repeats;
    char **names;
    int count;
} options;

/* What the program has found. */
typedef struct findings {
    lf_seen_limits seen;
    lf_bench_result result[MOST_CASES];
    int count;
} findings;

/* ---- cases ----------------------------------------------------------------------------------- */

/* The case of exactly that name, and its table. */
static lf_status find_case(const char *name, const lf_bench_case **out,
                           const lf_bench_table **table, lf_error *err)
{
    for (int t = 0; t < TABLES; t++)
        for (int i = 0; i < tables[t]->count; i++)
            if (strcmp(tables[t]->cases[i].name, name) == 0) {
                *out = &tables[t]->cases[i];
                *table = tables[t];
                return LF_OK;
            }
    return lf_fail(err, LF_BAD_INPUT, "%s: no such case; elf-bench --list names them", name);
}

static bool chosen(const options *o, const lf_bench_table *table, const lf_bench_case *c)
{
    for (int i = 0; i < o->count; i++)
        if (o->exact ? strcmp(c->name, o->names[i]) == 0
                     : strncmp(c->name, o->names[i], strlen(o->names[i])) == 0)
            return true;
    return o->count == 0 && (o->list || !table->large);
}

static lf_status run_case(const lf_bench_case *c, bool large, const options *o, findings *f,
                          lf_error *err)
{
    lf_bench_result *r = &f->result[f->count];
    if (o->errors) {
        lf_bench_errors(c, o->threads, r);
        lf_bench_error_rows(stdout, r);
        f->count++;
        return LF_OK;
    }
    if (large)
        LF_TRY(lf_bench_measure_large(c, o->threads, &f->seen, r, err));
    else
        lf_bench_measure(c, o->threads, o->repeats, o->scaling, &f->seen, r);
    if (o->memory && !large)
        LF_TRY(lf_bench_memory(c, o->threads, r, err));
    if (!o->no_errors && !large)
        lf_bench_errors(c, o->threads, r);
    lf_bench_line(stdout, r);
    f->count++;
    return LF_OK;
}

/* Lists, or measures, every chosen case. */
static lf_status for_cases(const options *o, findings *f, lf_error *err)
{
    int count = 0;
    for (int t = 0; t < TABLES; t++)
        for (int i = 0; i < tables[t]->count; i++) {
            const lf_bench_case *c = &tables[t]->cases[i];
            if (!chosen(o, tables[t], c))
                continue;
            LF_REQUIRE(count++ < MOST_CASES, "more than %d cases", MOST_CASES);
            f->result[f->count] = (lf_bench_result){.of = c, .group = tables[t]->group};
            if (o->list)
                printf("%-22s %s\n", c->name, c->what);
            else
                LF_TRY(run_case(c, tables[t]->large, o, f, err));
        }
    return count ? LF_OK : lf_fail(err, LF_BAD_INPUT, "no such case; elf-bench --list names them");
}

/* ---- jobs ------------------------------------------------------------------------------------ */

/* Two cases in turn: how many times longer the first one takes. */
static lf_status print_ratio(const options *o, lf_error *err)
{
    const lf_bench_case *c[2];
    const lf_bench_table *table;
    lf_timed timed[2];
    lf_seen_limits seen = {0};
    if (o->count != 2)
        return lf_fail(err, LF_BAD_INPUT, "--ratio takes two cases, %d given", o->count);
    for (int k = 0; k < 2; k++) {
        LF_TRY(find_case(o->names[k], &c[k], &table, err));
        if (table->large)
            return lf_fail(err, LF_BAD_INPUT, "--ratio %s: this case runs once, alone", c[k]->name);
    }
    for (int k = 0; k < 2; k++)
        timed[k] = (lf_timed){.work = c[k]->open(c[k]), .threads = o->threads};
    lf_bench_time(timed, 2, o->repeats, &seen);
    printf("%s %.4f ms, %s %.4f ms: ratio %.3f\n", c[0]->name, 1e3 * timed[0].seconds, c[1]->name,
           1e3 * timed[1].seconds, timed[0].seconds / timed[1].seconds);
    for (int k = 0; k < 2; k++)
        timed[k].work->close(timed[k].work);
    lf_seen_limits_free(&seen);
    return LF_OK;
}

/* What the case computes, or what a process of its own knows of it, to standard output. */
static lf_status give(const options *o, lf_error *err)
{
    const lf_bench_case *c;
    const lf_bench_table *table;
    LF_TRY(find_case(o->reference ? o->reference : o->once, &c, &table, err));
    if (isatty(STDOUT_FILENO))
        return lf_fail(err, LF_BAD_INPUT, "binary numbers are written: give a pipe");
    lf_outputs *outputs = lf_outputs_create();
    if (o->once)
        lf_bench_once(c, table->large, outputs);
    else {
        lf_bench_work *work = c->open(c);
        if (work->outputs)
            work->outputs(work, outputs);
        work->close(work);
    }
    const lf_status status = lf_outputs_write(outputs, stdout, "standard output", err);
    lf_outputs_free(outputs);
    return status;
}

static lf_status write_files(const options *o, const findings *f, lf_error *err)
{
    if (o->json) {
        json_t *report = lf_bench_json(f->result, f->count, &f->seen, o->threads);
        const lf_status status = lf_bench_json_write(o->json, report, err);
        json_decref(report);
        LF_TRY(status);
    }
#ifndef LF_DOUBLE
    if (o->picture)
        LF_TRY(lf_bench_picture(o->picture, f->result, f->count, &f->seen, err));
#endif
    return LF_OK;
}

static lf_status measure(const options *o, lf_error *err)
{
    findings *f = lf_bench_room(1, sizeof *f);
    if (o->errors)
        lf_bench_error_head(stdout);
    else if (!o->list) {
        printf("%d threads, vectors of %d bytes, %s, GCC %s\n", o->threads, LF_VEC_BYTES,
               LF_REAL_NAME, __VERSION__);
        lf_bench_head(stdout);
        for (int i = 0; i < o->repeats; i++)
            lf_see_limits(&f->seen, 0, o->threads);
        /* of memory, and of caches */
        for (int i = 0; (o->json || o->picture) && i < 2 * o->repeats; i++)
            lf_see_limits(&f->seen, i % 2 ? LF_BYTES_OF_MEMORY : LF_BYTES_OF_CACHES, o->threads);
    }
    lf_status status = for_cases(o, f, err);
    if (status == LF_OK && !o->list)
        status = write_files(o, f, err);
    lf_seen_limits_free(&f->seen);
    free(f);
    return status;
}

/* ---- the command line ------------------------------------------------------------------------ */

static void usage(void)
{
    printf("usage: elf-bench [CASE...] [options]      CASE: the beginning of a case's name\n"
           "       elf-bench --ratio CASE OTHER       how many times longer CASE takes, in turn\n"
           "       elf-bench stability --help         errors of hard cases\n"
           "       elf-bench growth --help            how cost grows with size\n"
           "  --list          name all cases; those of the paper's size run only when named\n"
           "  --exact         CASE is a whole name\n"
           "  --threads N     (default: all)\n"
           "  --repeats N     samples of a case, of which the best counts (default: 100)\n"
           "  --scaling       also with one thread, in turn: rate of all over rate of one\n"
           "  --memory        also the largest resident set of a process of its own\n"
           "  --errors        do nothing but compare with double: a table in Markdown\n"
           "  --no-errors     do not compare with double\n"
           "  --json FILE     all of it\n"
           "  --picture FILE  PNG: the roofline, and time against error\n"
           "Columns: best time of one run; useful operations and least bytes moved a second, and\n"
           "their quotient; share of what the limits measured in turn with it allow, by\n"
           "multiply-adds (f) or memory (m); tapes and parameters held; error of what it computes\n"
           "against elf-bench-f64, which stands beside this program: largest difference over\n"
           "largest value, and the same of root mean squares, of the array where that is worst.\n"
           "Exit codes: 0 done, 1 failed, 2 bad input\n");
}

static lf_status set_option(int letter, options *o, lf_error *err)
{
    switch (letter) {
    case 'l':
        o->list = true;
        break;
    case 'e':
        o->exact = true;
        break;
    case 'E':
        o->errors = true;
        break;
    case 'n':
        o->no_errors = true;
        break;
    case 's':
        o->scaling = true;
        break;
    case 'm':
        o->memory = true;
        break;
    case 'q':
        o->ratio = true;
        break;
    case 'j':
        o->json = optarg;
        break;
    case 'p':
        o->picture = optarg;
        break;
    case 'f':
        o->reference = optarg;
        break;
    case 'o':
        o->once = optarg;
        break;
    case 't':
        return lf_bench_positive("--threads", optarg, &o->threads, err);
    case 'r':
        return lf_bench_positive("--repeats", optarg, &o->repeats, err);
    case 'h':
        usage();
        exit(0);
    default:
        return lf_fail(err, LF_BAD_INPUT, "elf-bench --help shows what is allowed");
    }
    return LF_OK;
}

static lf_status check(options *o, lf_error *err)
{
    if (o->ratio && (o->json || o->picture || o->scaling || o->memory || o->list))
        return lf_fail(err, LF_BAD_INPUT, "--ratio goes with --threads and --repeats alone");
    if (o->json)
        LF_TRY(lf_bench_check_file(o->json, err));
    if (o->picture)
        LF_TRY(lf_bench_check_picture(o->picture, err));
    if (o->errors && (sizeof(lf_real) == sizeof(double) || o->json || o->picture || o->scaling ||
                      o->memory || o->list || o->no_errors || o->ratio))
        return lf_fail(err, LF_BAD_INPUT, "--errors: of elf-bench, with cases and --threads alone");
    o->no_errors |= sizeof(lf_real) == sizeof(double); /* it is what errors are measured against */
    return LF_OK;
}

static lf_status parse(int argc, char **argv, options *o, lf_error *err)
{
    static const struct option known[] = {{"list", no_argument, NULL, 'l'},
                                          {"exact", no_argument, NULL, 'e'},
                                          {"json", required_argument, NULL, 'j'},
                                          {"threads", required_argument, NULL, 't'},
                                          {"repeats", required_argument, NULL, 'r'},
                                          {"picture", required_argument, NULL, 'p'},
                                          {"reference", required_argument, NULL, 'f'},
                                          {"once", required_argument, NULL, 'o'},
                                          {"errors", no_argument, NULL, 'E'},
                                          {"no-errors", no_argument, NULL, 'n'},
                                          {"scaling", no_argument, NULL, 's'},
                                          {"memory", no_argument, NULL, 'm'},
                                          {"ratio", no_argument, NULL, 'q'},
                                          {"help", no_argument, NULL, 'h'},
                                          {0}};
    for (int c; (c = getopt_long(argc, argv, "", known, NULL)) != -1;)
        LF_TRY(set_option(c, o, err));
    o->names = argv + optind;
    o->count = argc - optind;
    return check(o, err);
}

static lf_status run(int argc, char **argv, lf_error *err)
{
    options o = {.repeats = 100, .threads = omp_get_max_threads()};
    if (argc > 1 && strcmp(argv[1], "stability") == 0)
        return lf_stability_main(argc - 1, argv + 1, err);
    if (argc > 1 && strcmp(argv[1], "growth") == 0)
        return lf_growth_main(argc - 1, argv + 1, err);
    LF_TRY(parse(argc, argv, &o, err));
    omp_set_num_threads(o.threads);
    if (o.reference || o.once)
        return give(&o, err);
    return o.ratio ? print_ratio(&o, err) : measure(&o, err);
}

int main(int argc, char **argv)
{
    lf_error err;
    const lf_status status = run(argc, argv, &err);
    if (status != LF_OK)
        fprintf(stderr, "elf-bench: %s\n", err.text);
    return (int)status;
}
