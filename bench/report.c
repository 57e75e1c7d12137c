/* report.c: see report.h. */
#include "bench/report.h"

#include "autograd/atomic_file.h"
#include "autograd/kernels/vector.h"

/* ---- text ------------------------------------------------------------------------------------ */

void lf_bench_head(FILE *to)
{
    fprintf(to, "%-22s %10s %8s %8s %8s %7s %9s %9s %8s %8s\n", "case", "ms", "GF/s", "GB/s",
            "flop/B", "share", "held MB", "scaling", "error", "l2");
}

/* A number in its column, or a dash where nothing is known. */
static void column(FILE *to, bool known, int width, int digits, double value)
{
    if (known)
        fprintf(to, " %*.*f", width, digits, value);
    else
        fprintf(to, " %*s", width, "-");
}

static void errors(FILE *to, const lf_bench_result *r)
{
    const lf_output_error *worst = lf_bench_worst(r);
    if (worst)
        fprintf(to, " %8.1e %8.1e %s", worst->largest, worst->l2, worst->name);
    else if (r->problem[0])
        fprintf(to, " not measured: %s", r->problem);
    else
        fprintf(to, " %8s %8s", "-", "-");
}

void lf_bench_line(FILE *to, const lf_bench_result *r)
{
    bool memory;
    const double share = lf_bench_share(r, &memory);
    fprintf(to, "%-22s %10.4f", r->of->name, 1e3 * r->seconds);
    column(to, r->flop > 0, 8, 1, 1e-9 * r->flop / r->seconds);
    column(to, r->bytes > 0, 8, 1, 1e-9 * r->bytes / r->seconds);
    column(to, r->flop > 0 && r->bytes > 0, 8, 1, r->flop / r->bytes);
    if (isnan(share))
        fprintf(to, " %7s", "-");
    else
        fprintf(to, " %4.0f %% %c", 100 * share, memory ? 'm' : 'f');
    column(to, r->held > 0, 9, 1, 1e-6 * r->held);
    column(to, r->scaling > 0, 9, 2, r->scaling);
    errors(to, r);
    if (r->resident > 0)
        fprintf(to, "  resident %.1f MB + %.1f", 1e-6 * (r->resident - r->base), 1e-6 * r->base);
    fprintf(to, "\n");
    fflush(to);
}

void lf_bench_error_head(FILE *to)
{
    fprintf(to,
            "| case | what | array: largest difference over largest value, l2 |\n|---|---|---|\n");
}

void lf_bench_error_rows(FILE *to, const lf_bench_result *r)
{
    if (r->outputs == 0 && !r->problem[0])
        return; /* it has no outputs */
    fprintf(to, "| %s | %s | %s", r->of->name, r->of->what, r->problem);
    for (int i = 0; i < r->outputs; i++)
        fprintf(to, "%s%s %.1e, %.1e", i ? "; " : "", r->error[i].name, r->error[i].largest,
                r->error[i].l2);
    fprintf(to, " |\n");
    fflush(to);
}

/* ---- JSON ------------------------------------------------------------------------------------ */

static void set(json_t *object, const char *key, bool known, double value)
{
    if (known)
        json_object_set_new(object, key, json_real(value));
}

static json_t *errors_json(const lf_bench_result *r)
{
    json_t *all = json_object();
    for (int i = 0; i < r->outputs; i++) {
        json_t *one = json_object();
        json_object_set_new(one, "largest", json_real(r->error[i].largest));
        json_object_set_new(one, "l2", json_real(r->error[i].l2));
        json_object_set_new(all, r->error[i].name, one);
    }
    return all;
}

static json_t *result_json(const lf_bench_result *r)
{
    bool memory;
    const double share = lf_bench_share(r, &memory);
    const lf_output_error *worst = lf_bench_worst(r);
    json_t *o = json_object();
    json_object_set_new(o, "case", json_string(r->of->name));
    json_object_set_new(o, "what", json_string(r->of->what));
    json_object_set_new(o, "group", json_string(r->group));
    json_object_set_new(o, "ms", json_real(1e3 * r->seconds));
    set(o, "gflop", r->flop > 0, 1e-9 * r->flop);
    set(o, "gflops", r->flop > 0, 1e-9 * r->flop / r->seconds);
    set(o, "mbytes", r->bytes > 0, 1e-6 * r->bytes);
    set(o, "gbytes_per_s", r->bytes > 0, 1e-9 * r->bytes / r->seconds);
    set(o, "flop_per_byte", r->flop > 0 && r->bytes > 0, r->flop / r->bytes);
    set(o, "limit_gflops", r->flop > 0, 1e-9 * r->fma);
    set(o, "limit_gbytes_per_s", r->bandwidth > 0, 1e-9 * r->bandwidth);
    set(o, "share", !isnan(share), share);
    if (!isnan(share))
        json_object_set_new(o, "bound", json_string(memory ? "memory" : "multiply-adds"));
    set(o, "held_mb", r->held > 0, 1e-6 * r->held);
    set(o, "resident_mb", r->resident > 0, 1e-6 * (r->resident - r->base));
    set(o, "scaling", r->scaling > 0, r->scaling);
    json_object_set_new(o, "error", worst ? json_real(worst->largest) : json_null());
    json_object_set_new(o, "error_l2", worst ? json_real(worst->l2) : json_null());
    if (worst)
        json_object_set_new(o, "errors", errors_json(r));
    if (r->problem[0])
        json_object_set_new(o, "error_missing", json_string(r->problem));
    return o;
}

static json_t *limits_json(const lf_seen_limits *seen)
{
    json_t *limits = json_object(), *bandwidth = json_object();
    set(limits, "gflops", seen->fma > 0, 1e-9 * seen->fma);
    for (int i = 0; i < LF_FOOTS; i++) {
        char bytes[32];
        snprintf(bytes, sizeof bytes, "%ld", 1L << (LF_FOOT_FIRST + i));
        set(bandwidth, bytes, seen->samples[i] > 0, 1e-9 * seen->bandwidth[i]);
    }
    json_object_set_new(limits, "gbytes_per_s", bandwidth);
    return limits;
}

json_t *lf_bench_json(const lf_bench_result *results, int count, const lf_seen_limits *seen,
                      int threads)
{
    json_t *all = json_object(), *list = json_array();
    for (int i = 0; i < count; i++)
        json_array_append_new(list, result_json(&results[i]));
    json_object_set_new(all, "precision", json_string(LF_REAL_NAME));
    json_object_set_new(all, "threads", json_integer(threads));
    json_object_set_new(all, "vector_bytes", json_integer(LF_VEC_BYTES));
    json_object_set_new(all, "compiler", json_string(__VERSION__));
    json_object_set_new(all, "limits", limits_json(seen));
    json_object_set_new(all, "results", list);
    return all;
}

lf_status lf_bench_json_write(const char *path, const json_t *report, lf_error *err)
{
    char *text = json_dumps(report, JSON_INDENT(1) | JSON_REAL_PRECISION(6));
    if (!text)
        return lf_fail(err, LF_FAILED, "%s: no memory for the report", path);
    const lf_bytes piece[] = {{text, strlen(text)}, {"\n", 1}};
    const lf_status status = lf_atomic_write(path, piece, 2, NULL, err);
    free(text);
    return status;
}
