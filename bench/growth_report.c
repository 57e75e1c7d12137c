/* growth_report.c: what growth.c measured, as exponents, text and JSON. See growth.h. */
#include "bench/growth.h"

#include "bench/bench.h"

lf_growth_exponent lf_growth_exponent_of(int count, const double *n, const double *y)
{
    LF_REQUIRE(count >= 2 && count <= LF_GROWTH_SIZES, "an exponent of %d sizes", count);
    double x = 0, z = 0, xx = 0, xz = 0;
    for (int i = 0; i < count; i++) {
        x += log(n[i]) / count;
        z += log(y[i]) / count;
    }
    for (int i = 0; i < count; i++) {
        xx += (log(n[i]) - x) * (log(n[i]) - x);
        xz += (log(n[i]) - x) * (log(y[i]) - z);
    }
    const int k = count - 1;
    return (lf_growth_exponent){xz / xx, log(y[k] / y[k - 1]) / log(n[k] / n[k - 1])};
}

/* ---- text ------------------------------------------------------------------------------------ */

void lf_growth_head(FILE *to)
{
    fprintf(to, "%-11s %-9s %-8s %-24s %-28s %5s %5s  %-24s %5s %5s\n", "system", "work", "of",
            "sizes", "ms", "fit", "last", "MB held", "fit", "last");
}

/* Numbers with spaces between, in a column of that width. */
static void list(FILE *to, int width, int count, const double *x, double unit)
{
    char text[128] = "";
    for (int i = 0, at = 0; i < count; i++)
        at += snprintf(text + at, sizeof text - (size_t)at,
                       x[i] * unit < 1000 ? "%s%.3g" : "%s%.0f", i ? " " : "", x[i] * unit);
    fprintf(to, " %-*s", width, text);
}

static void exponents(FILE *to, const lf_growth_row *row, const double *y)
{
    const lf_growth_exponent p = lf_growth_exponent_of(row->count, row->size, y);
    fprintf(to, " %5.2f %5.2f", p.fit, p.last);
}

void lf_growth_line(FILE *to, const lf_growth_row *row)
{
    fprintf(to, "%-11s %-9s %-8s", row->system, row->work, row->quantity);
    list(to, 24, row->count, row->size, 1);
    list(to, 28, row->count, row->seconds, 1e3);
    exponents(to, row, row->seconds);
    fprintf(to, " ");
    list(to, 24, row->count, row->bytes, 1e-6);
    exponents(to, row, row->bytes);
    fprintf(to, "\n");
    fflush(to);
}

/* ---- JSON ------------------------------------------------------------------------------------ */

static json_t *numbers(int count, const double *x, double unit)
{
    json_t *a = json_array();
    for (int i = 0; i < count; i++)
        json_array_append_new(a, json_real(x[i] * unit));
    return a;
}

static json_t *exponent_json(const lf_growth_row *row, const double *y)
{
    const lf_growth_exponent p = lf_growth_exponent_of(row->count, row->size, y);
    return json_pack("{s:f, s:f}", "fit", p.fit, "last", p.last);
}

static json_t *row_json(const lf_growth_row *r)
{
    return json_pack("{s:s, s:s, s:s, s:o, s:f, s:o, s:o, s:o, s:o}", "system", r->system, "work",
                     r->work, "quantity", r->quantity, "sizes", numbers(r->count, r->size, 1),
                     "base", r->size[r->base], "ms", numbers(r->count, r->seconds, 1e3), "held_mb",
                     numbers(r->count, r->bytes, 1e-6), "exponent_of_time",
                     exponent_json(r, r->seconds), "exponent_of_memory",
                     exponent_json(r, r->bytes));
}

json_t *lf_growth_json(const lf_growth_row *rows, int count, int threads)
{
    json_t *list = json_array();
    for (int i = 0; i < count; i++)
        json_array_append_new(list, row_json(&rows[i]));
    return json_pack("{s:s, s:i, s:s, s:o}", "precision", LF_REAL_NAME, "threads", threads,
                     "compiler", __VERSION__, "rows", list);
}
