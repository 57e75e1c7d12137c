/* reproduction.c: the page of docs/reproduction.md. See reproduction.h. */
#include <math.h>

#include "autograd/atomic_file.h"
#include "eval/reproduction.h"

/* ---- cells ----------------------------------------------------------------------------------- */

/* Results of one training and test setting; NULL matches all. */
typedef struct cell {
    const char *experiment, *system, *size, *data, *category, *train, *test;
} cell;

static bool match(const char *wanted, const char *found)
{
    return !wanted || strcmp(wanted, found) == 0;
}

static bool in_cell(const lf_result *r, const cell *c)
{
    return match(c->experiment, r->experiment) && match(c->system, r->system) &&
           match(c->size, r->size) && match(c->data, r->data) && match(c->category, r->category) &&
           match(c->train, r->train) && match(c->test, r->test);
}

/* Mean and sample standard deviation of a figure over the results of a cell. */
typedef struct moments {
    int n, lacking; /* results with and without the figure */
    double mean, deviation;
} moments;

static moments moments_of(const lf_results *r, const cell *c, int figure)
{
    moments m = {0};
    double squares = 0;
    for (long i = 0; i < r->count; i++) {
        const double x = r->result[i].figure[figure];
        if (!in_cell(&r->result[i], c))
            continue;
        if (isnan(x)) {
            m.lacking++;
            continue;
        }
        m.n++; /* Welford: the mean of what came so far */
        const double step = x - m.mean;
        m.mean += step / m.n;
        squares += step * (x - m.mean);
    }
    m.deviation = m.n > 1 ? sqrt(squares / (m.n - 1)) : NAN;
    return m;
}

static int digits_of(int figure)
{
    const char *name = lf_result_figure[figure];
    return strcmp(name, "psnr") == 0 || strcmp(name, "pixel_variance") == 0 ? 2 : 3;
}

static int figure_at(const json_t *figures, size_t i)
{
    return lf_result_figure_of(json_string_value(json_array_get(figures, i)));
}

static void print_cell(const lf_results *r, const cell *c, const json_t *figures, FILE *out)
{
    const moments first = moments_of(r, c, figure_at(figures, 0));
    if (first.n + first.lacking == 0) {
        fputs(" not run |", out);
        return;
    }
    for (size_t i = 0; i < json_array_size(figures); i++) {
        const int figure = figure_at(figures, i), digits = digits_of(figure);
        const moments m = moments_of(r, c, figure);
        fputs(i ? " / " : " ", out);
        if (m.n == 0 || m.lacking)
            fputs("–", out);
        else
            fprintf(out, "%.*f", digits, m.mean);
        if (m.n > 1 && !m.lacking)
            fprintf(out, " ± %.*f", digits, m.deviation);
    }
    fputs(" |", out);
}

static void print_paper_cell(const json_t *value, const json_t *figures, FILE *out)
{
    for (size_t i = 0; i < json_array_size(figures); i++) {
        const json_t *x = json_array_get(value, i);
        fputs(i ? " / " : " ", out);
        if (json_is_number(x))
            fprintf(out, "%.*f", digits_of(figure_at(figures, i)), json_number_value(x));
        else
            fputs("–", out);
    }
    fputs(" |", out);
}

/* ---- groups: one size on one data ------------------------------------------------------------ */

typedef struct group {
    const char *size, *data;
} group;

static bool first_of_group(const lf_results *r, long i, const cell *c)
{
    for (long j = 0; j < i; j++)
        if (in_cell(&r->result[j], c) && !strcmp(r->result[j].size, r->result[i].size) &&
            !strcmp(r->result[j].data, r->result[i].data))
            return false;
    return true;
}

static int rank(const char *size)
{
    static const char *const sizes[] = {"quick", "tiny", "small", "paper"};
    for (int i = 0; i < 4; i++)
        if (strcmp(size, sizes[i]) == 0)
            return i;
    return 4;
}

static int by_size(const void *a, const void *b)
{
    const group *x = a, *y = b;
    const int ranks = rank(x->size) - rank(y->size), sizes = strcmp(x->size, y->size);
    return ranks ? ranks : sizes ? sizes : strcmp(x->data, y->data);
}

/* The groups of the cell's results, small sizes first; malloc'd. */
static group *groups_of(const lf_results *r, const cell *c, long *count)
{
    group *g = malloc(((size_t)r->count + 1) * sizeof *g);
    LF_REQUIRE(g, "out of memory");
    *count = 0;
    for (long i = 0; i < r->count; i++)
        if (in_cell(&r->result[i], c) && first_of_group(r, i, c))
            g[(*count)++] = (group){r->result[i].size, r->result[i].data};
    qsort(g, (size_t)*count, sizeof *g, by_size);
    return g;
}

/* ---- a table of the paper -------------------------------------------------------------------- */

static const char *text(const json_t *object, const char *key)
{
    return json_string_value(json_object_get(object, key));
}

static void print_head(const json_t *settings, FILE *out)
{
    fputs("\n| system | from |", out);
    for (size_t i = 0; i < json_array_size(settings); i++)
        fprintf(out, " %s |", json_string_value(json_array_get(settings, i)));
    fputs("\n|---|---|", out);
    for (size_t i = 0; i < json_array_size(settings); i++)
        fputs("---|", out);
    fputc('\n', out);
}

/* A row of elf's figures: of a group, or of none. */
static void print_row(const lf_results *r, const json_t *table, const json_t *row, const group *g,
                      FILE *out)
{
    const json_t *settings = json_object_get(table, "settings");
    for (size_t i = 0; i < json_array_size(settings); i++) {
        char train[32];
        const char *setting = json_string_value(json_array_get(settings, i));
        const char *slash = strchr(setting, '/');
        snprintf(train, sizeof train, "%.*s", (int)(slash - setting), setting);
        const cell c = {text(table, "experiment"),
                        text(row, "system"),
                        g ? g->size : "",
                        g ? g->data : "",
                        text(row, "category"),
                        train,
                        slash + 1};
        print_cell(r, &c, json_object_get(table, "figures"), out);
    }
    fputc('\n', out);
}

static void print_system(const lf_results *r, const json_t *table, const json_t *row,
                         const group *g, long groups, FILE *out)
{
    const json_t *values = json_object_get(row, "values");
    fprintf(out, "| %s | paper |", text(row, "label"));
    for (size_t i = 0; i < json_array_size(json_object_get(table, "settings")); i++)
        print_paper_cell(json_array_get(values, i), json_object_get(table, "figures"), out);
    fputc('\n', out);
    for (long i = 0; i < groups; i++) {
        fprintf(out, "| | elf, %s, %s |", g[i].size, g[i].data);
        print_row(r, table, row, &g[i], out);
    }
    if (groups == 0) {
        fputs("| | elf |", out);
        print_row(r, table, row, NULL, out);
    }
}

static void print_table(const lf_results *r, const json_t *table, FILE *out)
{
    const json_t *rows = json_object_get(table, "rows"),
                 *figures = json_object_get(table, "figures");
    const cell c = {.experiment = text(table, "experiment")};
    const char *category = "";
    long groups;
    group *g = groups_of(r, &c, &groups);
    fprintf(out, "\n## %s\n\n%s. A cell:", text(table, "title"), text(table, "source"));
    for (size_t i = 0; i < json_array_size(figures); i++)
        fprintf(out, "%s %s", i ? " /" : "", json_string_value(json_array_get(figures, i)));
    fputs(".\n", out);
    for (size_t i = 0; i < json_array_size(rows); i++) {
        const json_t *row = json_array_get(rows, i);
        if (strcmp(category, text(row, "category")) != 0) {
            category = text(row, "category");
            fprintf(out, "\n### %s\n", category);
            print_head(json_object_get(table, "settings"), out);
        }
        print_system(r, table, row, g, groups, out);
    }
    free(g);
}

static void print_intro(FILE *out)
{
    fputs(
        "# Reproduction\n"
        "\n"
        "The paper's figures and elf's side by side. Made by `elf-eval reproduction` from the "
        "files in\n"
        "[reproduction/](reproduction/), which `scripts/reproduce` writes: edit neither. The "
        "paper's\n"
        "figures are of ShapeNet and of the published scenes, with networks and trainings hundreds "
        "of times\n"
        "larger; elf's are of the sizes and data that the rows name, so compare the order of "
        "systems\n"
        "and what a setting costs, not the numbers.\n"
        "\n"
        "A/B: trained in setting A, tested in B. iou, psnr, ssim: more is better; chamfer_l1 "
        "(times 10),\n"
        "lpips, pixel_variance (0 ... 255): less is. ± is the sample standard deviation over "
        "seeds, where\n"
        "there are two or more. \"not run\": no result yet. –: not in the paper, or not available\n"
        "(lpips without its weights).\n",
        out);
}

void lf_results_print(const lf_results *r, FILE *out)
{
    const json_t *tables = json_object_get(r->paper, "tables");
    print_intro(out);
    for (size_t i = 0; i < json_array_size(tables); i++)
        print_table(r, json_array_get(tables, i), out);
    lf_results_print_counts(r, out);
    lf_results_print_runs(r, out);
}

lf_status lf_reproduction(const char *folder, const char *path, lf_error *err)
{
    lf_results r;
    char *page = NULL;
    size_t size = 0;
    LF_TRY(lf_results_read(folder, &r, err));
    FILE *out = path ? open_memstream(&page, &size) : stdout;
    LF_REQUIRE(out, "out of memory");
    lf_results_print(&r, out);
    lf_results_free(&r);
    if (!path)
        return fflush(out) ? lf_fail(err, LF_FAILED, "the page could not be written") : LF_OK;
    LF_REQUIRE(fclose(out) == 0 && page, "out of memory");
    const lf_bytes piece = {page, size};
    const lf_status status = lf_atomic_write(path, &piece, 1, NULL, err);
    free(page);
    return status;
}
