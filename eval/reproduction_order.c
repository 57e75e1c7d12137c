/* reproduction_order.c: who is ahead of whom, and what a setting costs. See reproduction.h. */
#include <math.h>

#include "eval/reproduction_cells.h"

/* ---- elf's means and the paper's, of the first figure ---- */

static int first_figure(const json_t *table)
{
    return lf_result_figure_of(
        json_string_value(json_array_get(json_object_get(table, "figures"), 0)));
}

static lf_moments ours(const lf_results *r, const json_t *table, const json_t *row,
                       const lf_group *g, size_t setting)
{
    char train[32];
    const lf_cell c = lf_cell_at(table, row, g, setting, train);
    return lf_moments_of(r, &c, first_figure(table));
}

static bool has_results(const lf_moments *m)
{
    return m->n + m->lacking > 0;
}

/* NaN: not in the paper. */
static double papers(const json_t *row, size_t setting)
{
    const json_t *values = json_object_get(row, "values"),
                 *value = json_array_get(json_array_get(values, setting), 0);
    return json_is_number(value) ? json_number_value(value) : NAN;
}

static bool same_text(const json_t *a, const json_t *b, const char *key)
{
    return strcmp(lf_text_of(a, key), lf_text_of(b, key)) == 0;
}

/* The reference's row in the category of `row`, or NULL. */
static const json_t *reference_of(const json_t *table, const json_t *row)
{
    const json_t *rows = json_object_get(table, "rows");
    const char *system = lf_text_of(table, "reference");
    for (size_t i = 0; system && i < json_array_size(rows); i++) {
        const json_t *other = json_array_get(rows, i);
        if (same_text(other, row, "category") && strcmp(lf_text_of(other, "system"), system) == 0)
            return other;
    }
    return NULL;
}

/* ---- how far the reference is ahead ---- */

/* What two trainings were seen to differ by that differ in rounding alone (docs/figures.md, "The
 * paper's tables"): without a spread a smaller difference is no other order. */
static double seen_noise(int figure)
{
    return figure == lf_result_figure_of("iou")    ? 0.03
           : figure == lf_result_figure_of("psnr") ? 0.5
                                                   : 0;
}

static void print_lead(const lf_results *r, const json_t *table, const json_t *row,
                       const lf_group *g, size_t setting, FILE *out)
{
    const json_t *reference = reference_of(table, row);
    const lf_moments a = ours(r, table, reference, g, setting), b = ours(r, table, row, g, setting);
    const double paper = papers(reference, setting) - papers(row, setting), lead = a.mean - b.mean;
    const int digits = lf_figure_digits(first_figure(table));
    if (!has_results(&a) || !has_results(&b)) {
        fputs(" not run /", out);
    } else if (a.lacking || b.lacking) {
        fputs(" – /", out);
    } else {
        const bool spread = a.n > 1 && b.n > 1;
        const double noise =
            spread ? hypot(a.deviation, b.deviation) : seen_noise(first_figure(table));
        const char *bold = lead * paper < 0 && fabs(lead) > noise ? "**" : "";
        fprintf(out, " %s%+.*f%s", bold, digits, lead, bold);
        if (spread)
            fprintf(out, " ± %.*f", digits, noise);
        fputs(" /", out);
    }
    if (isnan(paper))
        fputs(" – |", out);
    else
        fprintf(out, " %+.*f |", digits, paper);
}

/* Were the reference and the row's system run in one setting at least? */
static bool comparable(const lf_results *r, const json_t *table, const json_t *row,
                       const lf_group *g)
{
    const json_t *reference = reference_of(table, row);
    if (!reference || reference == row)
        return false;
    for (size_t i = 0; i < json_array_size(json_object_get(table, "settings")); i++)
        if (ours(r, table, reference, g, i).n && ours(r, table, row, g, i).n)
            return true;
    return false;
}

static void print_leads(const lf_results *r, const json_t *table, const lf_group *g, FILE *out)
{
    const json_t *rows = json_object_get(table, "rows"),
                 *settings = json_object_get(table, "settings");
    bool any = false;
    for (size_t i = 0; i < json_array_size(rows); i++) {
        const json_t *row = json_array_get(rows, i);
        if (!comparable(r, table, row, g))
            continue;
        if (!any) {
            fprintf(out,
                    "\n**%s** above the others in %s: difference of the means, elf / the paper; ± "
                    "is the root of the sum\nof both variances; bold: of the other sign than the "
                    "paper's, and beyond ±;\nwithout ± (one seed) beyond what two trainings that "
                    "differ in rounding alone were seen to\ndiffer by: 0.03 iou, 0.5 dB.\n\n| | "
                    "above |",
                    lf_text_of(reference_of(table, row), "label"),
                    lf_result_figure[first_figure(table)]);
            lf_print_settings(table, out);
            any = true;
        }
        fprintf(out, "| %s | %s |", lf_text_of(row, "category"), lf_text_of(row, "label"));
        for (size_t k = 0; k < json_array_size(settings); k++)
            print_lead(r, table, row, g, k, out);
        fputc('\n', out);
    }
}

/* ---- what is kept in other settings ---- */

/* The setting in which training and test are those that setting number i was trained in, or -1; i
 * itself does not count. */
static int own_setting(const json_t *settings, size_t i)
{
    const char *setting = json_string_value(json_array_get(settings, i));
    const int length = (int)(strchr(setting, '/') - setting);
    char own[64];
    snprintf(own, sizeof own, "%.*s/%.*s", length, setting, length, setting);
    for (size_t k = 0; k < json_array_size(settings); k++)
        if (k != i && strcmp(json_string_value(json_array_get(settings, k)), own) == 0)
            return (int)k;
    return -1;
}

static void print_kept_row(const lf_results *r, const json_t *table, const json_t *row,
                           const lf_group *g, FILE *out)
{
    const json_t *settings = json_object_get(table, "settings");
    fprintf(out, "| %s | %s |", lf_text_of(row, "category"), lf_text_of(row, "label"));
    for (size_t i = 0; i < json_array_size(settings); i++) {
        const int own = own_setting(settings, i);
        if (own < 0)
            continue;
        const lf_moments a = ours(r, table, row, g, i), b = ours(r, table, row, g, (size_t)own);
        const double paper = papers(row, i) / papers(row, (size_t)own);
        if (!has_results(&a) || !has_results(&b))
            fputs(" not run /", out);
        else if (a.lacking || b.lacking || !(b.mean > 0))
            fputs(" – /", out);
        else
            fprintf(out, " %.0f %% /", 100 * a.mean / b.mean);
        if (isfinite(paper))
            fprintf(out, " %.0f %% |", 100 * paper);
        else
            fputs(" – |", out);
    }
    fputc('\n', out);
}

static bool any_kept(const lf_results *r, const json_t *table, const json_t *row, const lf_group *g)
{
    const json_t *settings = json_object_get(table, "settings");
    for (size_t i = 0; i < json_array_size(settings); i++) {
        const int own = own_setting(settings, i);
        if (own >= 0 && ours(r, table, row, g, i).n && ours(r, table, row, g, (size_t)own).n)
            return true;
    }
    return false;
}

static void print_kept(const lf_results *r, const json_t *table, const lf_group *g, FILE *out)
{
    const json_t *rows = json_object_get(table, "rows"),
                 *settings = json_object_get(table, "settings");
    bool heading = false;
    for (size_t i = 0; i < json_array_size(rows); i++) {
        if (!any_kept(r, table, json_array_get(rows, i), g))
            continue;
        if (!heading) {
            int columns = 0;
            fputs("\nShare of the iou kept in settings not trained in: elf / the paper.\n\n| | |",
                  out);
            for (size_t k = 0; k < json_array_size(settings); k++) {
                const int own = own_setting(settings, k);
                if (own < 0)
                    continue;
                fprintf(out, " %s of %s |", json_string_value(json_array_get(settings, k)),
                        json_string_value(json_array_get(settings, (size_t)own)));
                columns++;
            }
            fputs("\n|---|---|", out);
            while (columns--)
                fputs("---|", out);
            fputc('\n', out);
            heading = true;
        }
        print_kept_row(r, table, json_array_get(rows, i), g, out);
    }
}

void lf_results_print_order(const lf_results *r, const json_t *table, const lf_group *g, FILE *out)
{
    const json_t *rows = json_object_get(table, "rows");
    bool any = false;
    for (size_t i = 0; i < json_array_size(rows); i++)
        any = any || comparable(r, table, json_array_get(rows, i), g);
    if (!any)
        return;
    fprintf(out, "\n### Order of the systems: %s, %s\n", g->size, g->data);
    print_leads(r, table, g, out);
    if (strcmp(lf_result_figure[first_figure(table)], "iou") == 0)
        print_kept(r, table, g, out);
}
