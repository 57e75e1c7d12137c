/* profile_report.c: see profile_report.h. */
#include <jansson.h>
#include <math.h>

#include "autograd/atomic_file.h"
#include "train/profile_report.h"
#include "train/run_dir.h"

static int by_length(const void *a, const void *b)
{
    const lf_measured_step *x = a, *y = b;
    return (x->seconds.all > y->seconds.all) - (x->seconds.all < y->seconds.all);
}

void lf_step_profile_choose(lf_step_profile *p, lf_measured_step *step)
{
    qsort(step, (size_t)p->all, sizeof *step, by_length);
    p->steps = (p->all + 3) / 4;
    p->fastest = step[0].seconds.all;
    p->profile = step[0].profile;
    p->mean = 0;
    for (long i = 0; i < p->all; i++) {
        const lf_step_times *s = &step[i].seconds;
        p->mean += s->all / (double)p->all;
        if (i >= p->steps)
            continue;
        p->sum.data += s->data;
        p->sum.compute += s->compute;
        p->sum.update += s->update;
        p->sum.all += s->all;
        if (i > 0)
            lf_profile_join(step[0].profile, step[i].profile);
    }
}

/* What a line says of one step; NAN: not known. */
typedef struct line {
    const char *name;
    double forward, backward; /* ms; backward NAN: the line has one time alone */
    double gflop, mb;
} line;

static double ms_of(const line *l)
{
    return l->forward + (isnan(l->backward) ? 0 : l->backward);
}

/* Share of the machine's limit. */
static double share_of(const lf_step_profile *p, const line *l)
{
    return 1e9 * l->gflop / (1e-3 * ms_of(l) * p->limit);
}

static bool waits(const lf_profile_row *r)
{
    return !r->op && strcmp(r->scope, LF_SCOPE_TEAM) == 0;
}

static const char *name_of(const lf_profile_row *r, lf_profile_by by)
{
    if (waits(r))
        return "threads waiting";
    if (by == LF_BY_SCOPE)
        return r->scope[0] ? r->scope : "outside all parts";
    return r->op ? r->op : "no op";
}

static line line_of(const lf_step_profile *p, const lf_profile_row *r, lf_profile_by by)
{
    const double steps = (double)p->steps, products = r->products[0] + r->products[1];
    return (line){.name = name_of(r, by),
                  .forward = 1e3 * r->forward / steps,
                  .backward = r->calls ? 1e3 * r->backward / steps : NAN,
                  .gflop = products > 0 ? 2e-9 * products / steps : NAN,
                  .mb = r->bytes ? 1e-6 * (double)r->bytes / steps : NAN};
}

/* ---- what is no part of the model ---- */

enum { OTHERS = 3 };

/* Batch, update, and what is left of the step beside `known` seconds of the profile. */
static void other_lines(const lf_step_profile *p, double known, line other[OTHERS])
{
    const double ms = 1e3 / (double)p->steps, data = p->sum.data, update = p->sum.update;
    other[0] = (line){"making the batch", ms * data, NAN, NAN, NAN};
    other[1] = (line){"update of parameters", ms * update, NAN, NAN, NAN};
    other[2] = (line){"rest of the step", ms * (p->sum.all - data - update - known), NAN, NAN, NAN};
}

static double seconds_of(const lf_profile_row *row)
{
    return row->forward + row->backward;
}

/* Too little for a line of a table: between the parts of a part. Joins the rest of the step. */
static bool is_slight(const lf_step_profile *p, const lf_profile_row *row)
{
    return !row->calls && seconds_of(row) < 1e-3 * p->sum.all;
}

static double sum_seconds(const lf_profile_row *row, int count)
{
    double seconds = 0;
    for (int i = 0; i < count; i++)
        seconds += seconds_of(&row[i]);
    return seconds;
}

static line total_line(const lf_step_profile *p, const lf_profile_row *row, int count)
{
    double products = 0, bytes = 0;
    for (int i = 0; i < count; i++) {
        products += row[i].products[0] + row[i].products[1];
        bytes += (double)row[i].bytes;
    }
    return (line){"a step", 1e3 * p->sum.all / (double)p->steps, NAN,
                  2e-9 * products / (double)p->steps, 1e-6 * bytes / (double)p->steps};
}

/* ---- tables ---- */

static void print_number(FILE *out, int width, int digits, double value)
{
    if (isfinite(value))
        fprintf(out, " %*.*f", width, digits, value);
    else
        fprintf(out, " %*s", width, "-");
}

static void print_line(FILE *out, const lf_step_profile *p, const line *l)
{
    fprintf(out, "%-30s", l->name);
    print_number(out, 10, 3, l->forward);
    print_number(out, 10, 3, l->backward);
    print_number(out, 7, 1, 100 * ms_of(l) / (1e3 * p->sum.all / (double)p->steps));
    print_number(out, 9, 4, l->gflop);
    print_number(out, 7, 1, 100 * share_of(p, l));
    print_number(out, 8, 2, l->mb);
    fprintf(out, "\n");
}

static int by_seconds(const void *a, const void *b)
{
    const double x = seconds_of(a), y = seconds_of(b);
    return (x < y) - (x > y);
}

static void print_table(FILE *out, const lf_step_profile *p, lf_profile_by by, const char *title)
{
    lf_profile_row *row;
    line other[OTHERS];
    const int count = lf_profile_rows(p->profile, by, &row);
    const line total = total_line(p, row, count);
    double known = 0;
    if (by == LF_BY_OP)
        qsort(row, (size_t)count, sizeof *row, by_seconds);
    fprintf(out, "\n%-30s %10s %10s %7s %9s %7s %8s\n", title, "forward ms", "backward", "% step",
            "GFLOP", "% limit", "MB kept");
    for (int i = 0; i < count; i++) {
        const line l = line_of(p, &row[i], by);
        if (is_slight(p, &row[i]))
            continue;
        print_line(out, p, &l);
        known += seconds_of(&row[i]);
    }
    other_lines(p, known, other);
    for (int i = 0; by == LF_BY_SCOPE && i < OTHERS; i++)
        print_line(out, p, &other[i]);
    if (by == LF_BY_SCOPE)
        print_line(out, p, &total);
    free(row);
}

void lf_step_profile_print(FILE *out, const lf_step_profile *p)
{
    const double ms = 1e3 / (double)p->steps;
    fprintf(out,
            "the fastest %ld of %ld steps: %.2f ms a step (mean of all %.2f); %d threads, limit "
            "%.1f GFLOP/s\n",
            p->steps, p->all, ms * p->sum.all, 1e3 * p->mean, p->threads, 1e-9 * p->limit);
    print_table(out, p, LF_BY_SCOPE, "part");
    print_table(out, p, LF_BY_OP, "op");
    fprintf(out,
            "\nmemory: %.1f MB of tapes and lanes at their largest, %.0f MB largest resident set\n"
            "GFLOP: multiply-adds by formula, useful ones; -: no formula. Parts that a team of "
            "threads\nruns: seconds of all its threads, divided by their number. "
            "docs/profile.md says more.\n",
            1e-6 * (double)p->tapes, p->rss_mb);
}

/* ---- JSON ---- */

static json_t *line_json(const lf_step_profile *p, const line *l, json_t *o)
{
    lf_json_real(o, "forward_ms", l->forward);
    lf_json_real(o, "backward_ms", l->backward);
    lf_json_real(o, "share", 1e-3 * ms_of(l) * (double)p->steps / p->sum.all);
    lf_json_real(o, "gflop", l->gflop);
    lf_json_real(o, "limit_share", share_of(p, l));
    lf_json_real(o, "mb", l->mb);
    return o;
}

static json_t *row_json(const lf_step_profile *p, const lf_profile_row *r, lf_profile_by by)
{
    const line l = line_of(p, r, by);
    json_t *o = json_object();
    if (by == LF_BY_BOTH)
        json_object_set_new(o, "part", json_string(name_of(r, LF_BY_SCOPE)));
    json_object_set_new(o, by == LF_BY_SCOPE ? "part" : "op", json_string(l.name));
    lf_json_real(o, "calls", (double)r->calls / (double)p->steps);
    lf_json_real(o, "uncounted_calls", (double)r->unknown / (double)p->steps);
    return line_json(p, &l, o);
}

static json_t *rows_json(const lf_step_profile *p, lf_profile_by by)
{
    lf_profile_row *row;
    const int count = lf_profile_rows(p->profile, by, &row);
    json_t *rows = json_array();
    for (int i = 0; i < count; i++)
        json_array_append_new(rows, row_json(p, &row[i], by));
    free(row);
    return rows;
}

static json_t *step_json(const lf_step_profile *p)
{
    lf_profile_row *row;
    line other[OTHERS];
    const int count = lf_profile_rows(p->profile, LF_BY_SCOPE, &row);
    const line total = total_line(p, row, count);
    other_lines(p, sum_seconds(row, count), other);
    free(row);
    json_t *o = json_object();
    lf_json_real(o, "ms", total.forward);
    lf_json_real(o, "fastest_ms", 1e3 * p->fastest);
    lf_json_real(o, "mean_ms", 1e3 * p->mean);
    lf_json_real(o, "data_ms", other[0].forward);
    lf_json_real(o, "update_ms", other[1].forward);
    lf_json_real(o, "rest_ms", other[2].forward);
    lf_json_real(o, "gflop", total.gflop);
    lf_json_real(o, "limit_share", share_of(p, &total));
    lf_json_real(o, "mb", total.mb);
    return o;
}

static json_t *profile_json(const lf_step_profile *p)
{
    json_t *o = json_object();
    json_object_set_new(o, "model", json_string(p->model));
    json_object_set_new(o, "precision", json_string(LF_REAL_NAME));
    json_object_set_new(o, "warm_up", json_integer(p->warm_up));
    json_object_set_new(o, "all_steps", json_integer(p->all));
    json_object_set_new(o, "steps", json_integer(p->steps));
    json_object_set_new(o, "threads", json_integer(p->threads));
    lf_json_real(o, "limit_gflops", 1e-9 * p->limit);
    json_object_set_new(o, "step", step_json(p));
    lf_json_real(o, "tape_mb", 1e-6 * (double)p->tapes);
    lf_json_real(o, "peak_rss_mb", p->rss_mb);
    json_object_set_new(o, "parts", rows_json(p, LF_BY_SCOPE));
    json_object_set_new(o, "ops", rows_json(p, LF_BY_OP));
    json_object_set_new(o, "parts_and_ops", rows_json(p, LF_BY_BOTH));
    return o;
}

lf_status lf_step_profile_write(const char *path, const lf_step_profile *p, lf_error *err)
{
    json_t *json = profile_json(p);
    char *text = json_dumps(json, JSON_INDENT(1) | JSON_REAL_PRECISION(9));
    json_decref(json);
    if (!text)
        return lf_fail(err, LF_FAILED, "%s: the JSON could not be made (memory)", path);
    const lf_bytes pieces[] = {{text, strlen(text)}, {"\n", 1}};
    const lf_status status = lf_atomic_write(path, pieces, 2, NULL, err);
    free(text);
    return status;
}
