/* reproduction_runs.c: what the models cost, and how the figures of the page came about. */
#include <math.h>

#include "eval/reproduction.h"

/* Are both in one row of the table of runs? */
static bool same_row(const lf_result *a, const lf_result *b)
{
    return !strcmp(a->system, b->system) && !strcmp(a->size, b->size) &&
           !strcmp(a->data, b->data) && !strcmp(a->experiment, b->experiment) &&
           !strcmp(a->keys, b->keys);
}

/* ---- counts ---- */

void lf_results_print_counts(const lf_results *r, FILE *out)
{
    long counts = 0;
    fputs("\n## Parameters and operations\n\n"
          "Of the whole model and of one training step, two operations a multiply-add, by formula\n"
          "(`elf-train --count`). The paper has its own in figures alone, without numbers.\n\n",
          out);
    for (long i = 0; i < r->count; i++) {
        const lf_result *c = &r->result[i];
        if (strcmp(c->experiment, "count") != 0)
            continue;
        if (counts++ == 0)
            fputs(
                "| size | system | config | parameters | GFLOP forward | with backward | a step |\n"
                "|---|---|---|---|---|---|---|\n",
                out);
        fprintf(out, "| %s | %s | %s%s%s | %lld | %.2f | %.2f | %s |\n", c->size, c->system,
                c->config, *c->keys ? " " : "", c->keys, (long long)c->parameters,
                1e-9 * c->flop_forward, 1e-9 * c->flop, c->of);
    }
    if (counts == 0)
        fputs("not run\n", out);
}

/* ---- runs ---- */

static bool same_size_keys(const lf_result *a, const lf_result *b)
{
    return strcmp(a->size, b->size) == 0 && strcmp(a->size_keys, b->size_keys) == 0;
}

/* Is result i the first of its system with these keys? */
static bool new_system(const lf_results *r, long i)
{
    for (long j = 0; j < i; j++)
        if (same_size_keys(&r->result[j], &r->result[i]) &&
            strcmp(r->result[j].system, r->result[i].system) == 0)
            return false;
    return true;
}

typedef struct range {
    json_int_t low, high;
} range;

static range joined(range a, json_int_t x)
{
    return (range){x < a.low ? x : a.low, x > a.high ? x : a.high};
}

static void print_range(range a, FILE *out)
{
    fprintf(out, " %lld", (long long)a.low);
    if (a.high > a.low)
        fprintf(out, " to %lld", (long long)a.high);
    fputs(" |", out);
}

/* Over the results of one row: one system, its keys, size and data. */
typedef struct summary {
    range steps, pixels, train, test, seed, parameters;
    int trainings;
    double seconds, peak, empty; /* sum over trainings; largest; meshes without a surface */
    double item_seconds;         /* sum over the tests that tell it */
    int told;
    char commits[256];
} summary;

/* Is result i the first of its training? */
static bool new_training(const lf_results *r, long i)
{
    const lf_result *b = &r->result[i];
    for (long j = 0; j < i; j++) {
        const lf_result *a = &r->result[j];
        /* a renderer has one training for all categories */
        if (same_row(a, b) && a->seed == b->seed && !strcmp(a->train, b->train) &&
            (!strcmp(a->category, b->category) || !strcmp(a->experiment, "rendering")))
            return false;
    }
    return true;
}

static void add_commit(summary *s, const char *commit)
{
    const size_t used = strlen(s->commits), length = strlen(commit);
    bool there = false; /* as a whole item: abc is none of abc-changed */
    for (const char *at = s->commits; (at = strstr(at, commit)) && !there; at += length)
        there = (at == s->commits || at[-1] == ' ') && (at[length] == ',' || at[length] == 0);
    if (!there)
        snprintf(s->commits + used, sizeof s->commits - used, "%s%s", used ? ", " : "", commit);
}

static summary summary_of(const lf_results *r, long first)
{
    const lf_result *a = &r->result[first];
    summary s = {.steps = {a->steps, a->steps},
                 .pixels = {a->pixels, a->pixels},
                 .train = {a->train_items, a->train_items},
                 .test = {a->test_items, a->test_items},
                 .seed = {a->seed, a->seed},
                 .parameters = {a->parameters, a->parameters}};
    for (long i = first; i < r->count; i++) {
        const lf_result *b = &r->result[i];
        if (!same_row(a, b))
            continue;
        s.steps = joined(s.steps, b->steps);
        s.pixels = joined(s.pixels, b->pixels);
        s.train = joined(s.train, b->train_items);
        s.test = joined(s.test, b->test_items);
        s.seed = joined(s.seed, b->seed);
        s.parameters = joined(s.parameters, b->parameters);
        s.peak = fmax(s.peak, b->peak_rss_mb);
        s.empty += b->figure[lf_result_figure_of("empty")]; /* NaN: renderers */
        if (!isnan(b->item_seconds)) {
            s.item_seconds += b->item_seconds;
            s.told++;
        }
        add_commit(&s, b->commit);
        if (new_training(r, i)) {
            s.trainings++;
            s.seconds += b->seconds;
        }
    }
    return s;
}

static void print_run(const lf_result *a, const summary *s, FILE *out)
{
    fprintf(out, "| %s, %s | %s | %s%s%s |", a->size, a->data, a->system, a->config,
            *a->keys ? " " : "", a->keys);
    print_range(s->parameters, out);
    print_range(s->steps, out);
    print_range(s->pixels, out);
    print_range(s->train, out);
    print_range(s->test, out);
    print_range(s->seed, out);
    fprintf(out, " %d |", s->trainings);
    if (isnan(s->empty))
        fputs(" – |", out);
    else
        fprintf(out, " %.0f |", s->empty);
    fprintf(out, " %.0f | %.0f |", s->seconds / s->trainings, s->peak);
    if (s->told)
        fprintf(out, " %.2f |", s->item_seconds / s->told);
    else
        fputs(" – |", out);
    fprintf(out, " %s |\n", s->commits);
}

/* The keys that a size adds, each with the systems that it adds them to. */
static void print_size_keys(const lf_results *r, FILE *out)
{
    for (long i = 0; i < r->count; i++) {
        const lf_result *a = &r->result[i];
        bool first = true;
        for (long j = 0; j < i && first; j++)
            first = !same_size_keys(&r->result[j], a);
        if (!first)
            continue;
        fprintf(out, "\n- %s, %s", a->size, a->system);
        for (long j = i + 1; j < r->count; j++)
            if (same_size_keys(&r->result[j], a) && new_system(r, j))
                fprintf(out, ", %s", r->result[j].system);
        if (*a->size_keys)
            fprintf(out, ": `%s`", a->size_keys);
        else
            fputs(": none", out);
    }
    fputs(r->count ? "\n" : "", out);
}

static bool is_run(const lf_result *a)
{
    return strcmp(a->experiment, "count") != 0;
}

void lf_results_print_runs(const lf_results *r, FILE *out)
{
    long runs = 0;
    fputs(
        "\n## The runs\n\n"
        "Items: shapes; for renderers scenes to train on and rendered views of a kind to test on.\n"
        "Pixels of photographs: at most. Empty: meshes without a surface, over all tests; they "
        "count with\n"
        "the worst value. Seconds: of one training without making its data, mean over trainings.\n"
        "MB: largest resident memory of a training. An item: seconds from views to mesh, or of a "
        "rendered\n"
        "view, mean over the tests that tell them. Seconds are of a machine that may have done "
        "other work, too.\n\n",
        out);
    for (long i = 0; i < r->count; i++) {
        bool first = is_run(&r->result[i]);
        for (long j = 0; j < i && first; j++)
            first = !same_row(&r->result[j], &r->result[i]);
        if (!first)
            continue;
        if (runs++ == 0)
            fputs("| size, data | system | config and keys | parameters | steps | pixels | "
                  "training items | "
                  "test items | "
                  "seeds | trainings | empty | seconds | MB | an item | commit |\n"
                  "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
                  out);
        const summary s = summary_of(r, i);
        print_run(&r->result[i], &s, out);
    }
    if (runs == 0)
        fputs("none yet\n", out);
    if (r->count)
        fputs("\nKeys that a size adds to the configs:\n", out);
    print_size_keys(r, out);
}
