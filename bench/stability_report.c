/* stability_report.c: runs the cases here and in double, compares, and prints.
 *
 * The program in double does what needs double (conditions, exact values, differences) and gives
 * its arrays with what it found; the program in float compares its own arrays with them.
 */
#include <getopt.h>
#include <jansson.h>
#include <limits.h>
#include <unistd.h>

#include "bench/command_line.h"
#include "bench/reference.h"
#include "bench/report.h"
#include "bench/stability.h"
#include "bench/stability_report.h"

/* An error: relative, in units of the case's own last place, whether it is large, and whether it is
 * larger than it is known to be. */
typedef struct error {
    bool known, marked, bad;
    double size, ulps;
} error;

typedef struct row {
    const lf_stability_case *c;
    double parameter;
    error forward[2], gradient[2]; /* float, double */
    bool finite, differences;      /* the gradient in double is known from differences */
} row;

typedef struct options {
    bool list, worst, check;
    const char *json;
    char **names;
    int count;
} options;

/* ---- through the pipe ------------------------------------------------------------------------ */

enum { CONDITION, ERROR, ULPS, FINDINGS };

static void array_name(const lf_stability_array *a, char name[LF_OUTPUT_NAME])
{
    snprintf(name, LF_OUTPUT_NAME, "%s%.*s", a->gradient ? "d " : "", LF_OUTPUT_NAME - 3, a->name);
}

/* In double: the arrays of case argv[1] at its parameter number argv[2], and what is found. */
static lf_status give_reference(char **argv, lf_error *err)
{
    const lf_stability_case *c = lf_stability_find(argv[1]);
    const int at = atoi(argv[2]);
    if (!c || at < 0 || at >= c->count)
        return lf_fail(err, LF_BAD_INPUT, "stability --reference %s %s: no such case", argv[1],
                       argv[2]);
    if (isatty(STDOUT_FILENO))
        return lf_fail(err, LF_BAD_INPUT, "--reference writes binary numbers: give it a pipe");
    lf_stability *s = lf_stability_open(c, c->at[at]);
    lf_outputs *outputs = lf_outputs_create();
    double found[LF_STABILITY_ARRAYS * FINDINGS] = {0};
    lf_stability_measure(s);
    for (int a = 0; a < s->arrays; a++) {
        char name[LF_OUTPUT_NAME];
        array_name(&s->array[a], name);
        lf_outputs_add_doubles(outputs, name, s->array[a].count, s->array[a].value);
        found[a * FINDINGS + CONDITION] = s->array[a].condition;
        found[a * FINDINGS + ERROR] = s->array[a].error;
        found[a * FINDINGS + ULPS] = s->array[a].ulps;
    }
    lf_outputs_add_doubles(outputs, "found", s->arrays * FINDINGS, found);
    lf_stability_close(s);
    const lf_status status = lf_outputs_write(outputs, stdout, "standard output", err);
    lf_outputs_free(outputs);
    return status;
}

static lf_status run_double(const lf_stability_case *c, int at, lf_outputs **out, lf_error *err)
{
    char path[PATH_MAX], number[16];
    snprintf(number, sizeof number, "%d", at);
    LF_TRY(lf_reference_find("elf-bench-f64", path, sizeof path, err));
    return lf_reference_run(
        (const char *const[]){path, "stability", "--reference", c->name, number, NULL}, out, err);
}

/* ---- a row ----------------------------------------------------------------------------------- */

static bool all_finite(const lf_output *o)
{
    for (long i = 0; i < o->count; i++)
        if (!isfinite(o->value[i]))
            return false;
    return true;
}

/* The worst array stands for the row. */
static void join(error *all, const error *one)
{
    if (!one->known)
        return;
    all->size = all->known ? fmax(all->size, one->size) : one->size;
    all->ulps = all->known && !(one->ulps > all->ulps) ? all->ulps : one->ulps;
    all->known = true;
    all->marked |= one->marked;
    all->bad |= one->bad;
}

/* ulps is NAN for an error against differences. */
static error error_of(const lf_stability_case *c, double size, double ulps)
{
    const bool by_differences = isnan(ulps) && !isnan(size);
    const bool far = by_differences && !(size <= LF_STABILITY_DIFFERENCE);
    return (error){!isnan(size), far || ulps > LF_STABILITY_ULPS,
                   far || ulps > lf_stability_limit(c), size, ulps};
}

static void join_double(row *r, bool gradient, const double *found)
{
    const error e = error_of(r->c, found[ERROR], found[ULPS]);
    join(gradient ? &r->gradient[1] : &r->forward[1], &e);
    r->differences |= gradient && e.known && isnan(e.ulps);
}

static lf_status compare(lf_stability *s, const lf_outputs *exact, row *r, lf_error *err)
{
    const lf_output *last = &exact->array[exact->count - 1];
    if (exact->count != s->arrays + 1 || last->count != s->arrays * FINDINGS)
        return lf_fail(err, LF_FAILED, "%s: the program in double has other arrays", s->c->name);
    r->finite = lf_stability_finite(s);
    for (int a = 0; a < s->arrays; a++) {
        lf_stability_array *x = &s->array[a];
        const double *found = last->value + a * FINDINGS;
        if (exact->array[a].count != x->count)
            return lf_fail(err, LF_FAILED, "%s: %s has other sizes in double", s->c->name, x->name);
        r->finite &= all_finite(&exact->array[a]);
        lf_stability_compare(s, x, exact->array[a].value, found[CONDITION]);
        const error e = error_of(r->c, x->error, x->ulps);
        join(x->gradient ? &r->gradient[0] : &r->forward[0], &e);
        join_double(r, x->gradient, found);
    }
    return LF_OK;
}

static lf_status measure(const lf_stability_case *c, int at, row *r, lf_error *err)
{
    lf_outputs *exact;
    LF_TRY(run_double(c, at, &exact, err));
    *r = (row){.c = c, .parameter = c->at[at]};
    lf_stability *s = lf_stability_open(c, c->at[at]);
    const lf_status status = compare(s, exact, r, err);
    lf_stability_close(s);
    lf_outputs_free(exact);
    return status;
}

static bool marked(const row *r)
{
    return !r->finite || r->forward[0].marked || r->forward[1].marked || r->gradient[0].marked ||
           r->gradient[1].marked;
}

static bool bad(const row *r)
{
    return !r->finite || r->forward[0].bad || r->forward[1].bad || r->gradient[0].bad ||
           r->gradient[1].bad;
}

/* ---- reporting ------------------------------------------------------------------------------- */

static void print_error(const error *e, bool differences)
{
    char ulps[16] = "";
    if (e->known && !differences && !isnan(e->ulps))
        snprintf(ulps, sizeof ulps, "%.2g", e->ulps);
    else if (e->known)
        snprintf(ulps, sizeof ulps, "fd");
    if (e->known)
        printf(" %8.1e %7s%c", e->size, ulps, e->marked ? '*' : ' ');
    else
        printf(" %8s %7s ", "-", "");
}

static void print_head(void)
{
    printf("%-28s %-19s %16s  %16s  %16s  %16s   finite\n", "case", "parameter", "forward float",
           "forward double", "gradient float", "gradient double");
}

static void print_row(const row *r)
{
    char parameter[32];
    snprintf(parameter, sizeof parameter, "%s %g", r->c->parameter, r->parameter);
    printf("%-28s %-19s", r->c->name, parameter);
    print_error(&r->forward[0], false);
    print_error(&r->forward[1], false);
    print_error(&r->gradient[0], false);
    print_error(&r->gradient[1], r->differences);
    printf("  %s\n", r->finite ? "yes" : "NO");
    fflush(stdout);
}

/* The most last places of a row's errors. */
static double ulps_of(const row *r)
{
    return fmax(fmax(r->forward[0].ulps, r->gradient[0].ulps),
                fmax(r->forward[1].ulps, r->gradient[1].ulps)); /* NANs drop out */
}

/* The worse of each column; the parameter is that of the most last places. */
static void keep_worst(row *worst, const row *r)
{
    if (!worst->c) {
        *worst = *r;
        return;
    }
    const bool worse = ulps_of(r) > ulps_of(worst);
    worst->parameter = worse ? r->parameter : worst->parameter;
    for (int p = 0; p < 2; p++) {
        join(&worst->forward[p], &r->forward[p]);
        join(&worst->gradient[p], &r->gradient[p]);
    }
    worst->finite &= r->finite;
    worst->differences |= r->differences;
}

static json_t *number(double x)
{
    return isfinite(x) ? json_real(x) : json_null();
}

static void set_error(json_t *o, const char *name, const error *e)
{
    if (!e->known)
        return;
    json_t *x = json_pack("{s:o}", "error", number(e->size));
    if (!isnan(e->ulps))
        json_object_set_new(x, "ulps", number(e->ulps));
    json_object_set_new(o, name, x);
}

static json_t *row_json(const row *r)
{
    json_t *o =
        json_pack("{s:s, s:s, s:f, s:b, s:b}", "case", r->c->name, "parameter", r->c->parameter,
                  "at", r->parameter, "finite", r->finite, "marked", marked(r));
    set_error(o, "forward_float", &r->forward[0]);
    set_error(o, "forward_double", &r->forward[1]);
    set_error(o, "gradient_float", &r->gradient[0]);
    set_error(o, "gradient_double", &r->gradient[1]);
    if (r->gradient[1].known)
        json_object_set_new(o, "gradient_double_by",
                            json_string(r->differences ? "differences" : "exact"));
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

/* Rows that are marked, and those that may not be. */
typedef struct counts {
    int marked, bad;
} counts;

static lf_status run_case(const lf_stability_case *c, const options *o, json_t *rows, counts *found,
                          lf_error *err)
{
    row worst = {.c = NULL};
    for (int at = 0; at < c->count; at++) {
        row r;
        LF_TRY(measure(c, at, &r, err));
        keep_worst(&worst, &r);
        found->marked += marked(&r);
        found->bad += bad(&r);
        json_array_append_new(rows, row_json(&r));
        if (!o->worst)
            print_row(&r);
    }
    if (o->worst)
        print_row(&worst);
    return LF_OK;
}

static lf_status run_cases(const options *o, json_t *rows, lf_error *err)
{
    int count = 0;
    counts found = {0};
    const lf_stability_case *c;
    for (int i = 0; (c = lf_stability_at(i)); i++) {
        if (!chosen(o, c->name))
            continue;
        if (o->list)
            printf("%-28s %d values of %s\n", c->name, c->count, c->parameter);
        else if (count == 0)
            print_head();
        if (!o->list)
            LF_TRY(run_case(c, o, rows, &found, err));
        count++;
    }
    if (count == 0)
        return lf_fail(err, LF_BAD_INPUT, "no such case; elf-bench stability --list names them");
    if (!o->list)
        printf("%d of %zu rows marked\n", found.marked, json_array_size(rows));
    if (o->check && found.bad > 0)
        return lf_fail(err, LF_FAILED, "%d rows are worse than they are known to be", found.bad);
    return LF_OK;
}

static void usage(void)
{
    printf(
        "usage: elf-bench stability [CASE...] [--worst] [--check] [--list] [--json FILE]\n"
        "Errors of hard cases: of the float build against the double build (elf-bench-f64,\n"
        "beside this program) on the same numbers, and of the double build against long double\n"
        "or, for gradients, central differences (fd). Each error is the largest difference over\n"
        "the largest value; beside it the same in last places of the precision times the\n"
        "condition of the case. *: more than %g of these, %g for differences. --worst: one line\n"
        "a case. --check: fails if a row is worse than it is known to be. CASE: the beginning\n"
        "of a name.\n",
        LF_STABILITY_ULPS, LF_STABILITY_DIFFERENCE);
}

static lf_status parse(int argc, char **argv, options *o, lf_error *err)
{
    static const struct option known[] = {
        {"list", no_argument, NULL, 'l'},  {"worst", no_argument, NULL, 'w'},
        {"check", no_argument, NULL, 'c'}, {"json", required_argument, NULL, 'j'},
        {"help", no_argument, NULL, 'h'},  {0}};
    for (int c; (c = getopt_long(argc, argv, "", known, NULL)) != -1;) {
        if (c == 'l')
            o->list = true;
        else if (c == 'w')
            o->worst = true;
        else if (c == 'c')
            o->check = true;
        else if (c == 'j') {
            o->json = optarg;
            LF_TRY(lf_bench_check_file(optarg, err));
        } else if (c == 'h') {
            usage();
            exit(0);
        } else
            return lf_fail(err, LF_BAD_INPUT, "elf-bench stability --help shows what is allowed");
    }
    o->names = argv + optind;
    o->count = argc - optind;
    return LF_OK;
}

static lf_status write_json(const char *path, json_t *rows, lf_error *err)
{
    json_t *all =
        json_pack("{s:f, s:f, s:s, s:O}", "most_ulps", LF_STABILITY_ULPS, "most_difference",
                  LF_STABILITY_DIFFERENCE, "compiler", __VERSION__, "rows", rows);
    const lf_status status = lf_bench_json_write(path, all, err);
    json_decref(all);
    return status;
}

lf_status lf_stability_main(int argc, char **argv, lf_error *err)
{
    options o = {.json = NULL};
    if (argc == 4 && strcmp(argv[1], "--reference") == 0)
        return give_reference(argv + 1, err);
    LF_TRY(parse(argc, argv, &o, err));
    if (sizeof(lf_real) == sizeof(double) && !o.list)
        return lf_fail(err, LF_BAD_INPUT, "stability: elf-bench compares float with this program");
    json_t *rows = json_array();
    lf_status status = run_cases(&o, rows, err);
    if (status == LF_OK && o.json && !o.list)
        status = write_json(o.json, rows, err);
    json_decref(rows);
    return status;
}
