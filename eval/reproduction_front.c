/* reproduction_front.c: the tables of results on the front page. See reproduction.h. */
#include <errno.h>
#include <math.h>

#include "eval/reproduction_cells.h"

static const char begin_mark[] = "<!-- results: written by scripts/reproduce, edit nothing -->\n";
static const char end_mark[] = "<!-- end of results -->\n";

/* A column: a figure in a setting. */
typedef struct column {
    const char *head, *train, *test, *figure;
} column;

/* What the front page takes of a table of paper.json. */
typedef struct front {
    const char *table, *title;
    int columns;
    column column[4];
} front;

static const front fronts[] = {
    {"table1",
     "Reconstruction, IoU",
     4,
     {{"I/I", "I", "I", "iou"},
      {"I/Z", "I", "Z", "iou"},
      {"I/R", "I", "R", "iou"},
      {"SO3/SO3", "SO3", "SO3", "iou"}}},
    {"rendering",
     "Rendering",
     3,
     {{"PSNR, I/I", "I", "I", "psnr"},
      {"PSNR, I/SO3", "I", "SO3", "psnr"},
      {"pixel variance, I/SO3", "I", "SO3", "pixel_variance"}}},
};

static const json_t *table_named(const lf_results *r, const char *name)
{
    const json_t *tables = json_object_get(r->paper, "tables");
    for (size_t i = 0; i < json_array_size(tables); i++)
        if (strcmp(lf_text_of(json_array_get(tables, i), "name"), name) == 0)
            return json_array_get(tables, i);
    return NULL;
}

/* ---- the groups that are shown ---- */

static lf_cell cell_of(const json_t *table, const json_t *row, const lf_group *g, const column *k)
{
    return (lf_cell){lf_text_of(table, "experiment"),
                     lf_text_of(row, "system"),
                     g->size,
                     g->data,
                     lf_text_of(row, "category"),
                     k->train,
                     k->test};
}

static long results_in(const lf_results *r, const lf_cell *c)
{
    long n = 0;
    for (long i = 0; i < r->count; i++)
        n += lf_in_cell(&r->result[i], c);
    return n;
}

/* Results of the front page's columns, of a category or of all (NULL). */
static long results_of(const lf_results *r, const front *f, const json_t *table, const lf_group *g,
                       const char *category)
{
    const json_t *rows = json_object_get(table, "rows");
    long n = 0;
    for (size_t i = 0; i < json_array_size(rows); i++) {
        const json_t *row = json_array_get(rows, i);
        if (category && strcmp(category, lf_text_of(row, "category")) != 0)
            continue;
        for (int k = 0; k < f->columns; k++) {
            const lf_cell c = cell_of(table, row, g, &f->column[k]);
            n += results_in(r, &c);
        }
    }
    return n;
}

static int worth(const char *size)
{
    const int rank = lf_size_rank(size);
    return rank < 4 ? rank + 2 : 1; /* an unknown size least */
}

/* What the largest size with results of the table is worth; 0: there are none. */
static int best_worth(const lf_results *r, const front *f, const json_t *table)
{
    const lf_cell all = {.experiment = lf_text_of(table, "experiment")};
    long count;
    int best = 0;
    lf_group *g = lf_groups_of(r, &all, &count);
    for (long i = 0; i < count; i++)
        if (worth(g[i].size) > best && results_of(r, f, table, &g[i], NULL))
            best = worth(g[i].size);
    free(g);
    return best;
}

/* ---- rows ---- */

static void print_own(const lf_results *r, const lf_cell *c, int figure, FILE *out)
{
    const lf_moments m = lf_moments_of(r, c, figure);
    const int digits = lf_figure_digits(figure);
    if (m.n + m.lacking == 0)
        fputs(" not run", out);
    else if (m.n == 0 || m.lacking)
        fputs(" –", out);
    else
        fprintf(out, " %.*f", digits, m.mean);
    if (m.n > 1 && !m.lacking)
        fprintf(out, " ± %.*f", digits, m.deviation);
}

static const json_t *paper_value(const json_t *table, const json_t *row, const column *k)
{
    const json_t *settings = json_object_get(table, "settings"),
                 *figures = json_object_get(table, "figures");
    char setting[32];
    snprintf(setting, sizeof setting, "%s/%s", k->train, k->test);
    for (size_t i = 0; i < json_array_size(settings); i++)
        for (size_t j = 0; j < json_array_size(figures); j++)
            if (!strcmp(json_string_value(json_array_get(settings, i)), setting) &&
                !strcmp(json_string_value(json_array_get(figures, j)), k->figure))
                return json_array_get(json_array_get(json_object_get(row, "values"), i), j);
    return NULL;
}

static void print_row(const lf_results *r, const front *f, const json_t *table, const json_t *row,
                      const lf_group *g, FILE *out)
{
    fprintf(out, "| %s | %s |", lf_text_of(row, "category"), lf_text_of(row, "label"));
    for (int k = 0; k < f->columns; k++) {
        const column *at = &f->column[k];
        const int figure = lf_result_figure_of(at->figure);
        const lf_cell c = cell_of(table, row, g, at);
        const json_t *paper = paper_value(table, row, at);
        print_own(r, &c, figure, out);
        if (json_is_number(paper))
            fprintf(out, " / %.*f |", lf_figure_digits(figure), json_number_value(paper));
        else
            fputs(" / – |", out);
    }
    fputc('\n', out);
}

/* Rows that the paper has, of the categories that were begun; the others are named below. */
static void print_rows(const lf_results *r, const front *f, const json_t *table, const lf_group *g,
                       FILE *out)
{
    const json_t *rows = json_object_get(table, "rows");
    const char *last = "";
    bool left = false;
    for (size_t i = 0; i < json_array_size(rows); i++) {
        const json_t *row = json_array_get(rows, i);
        if (json_object_get(row, "values") &&
            results_of(r, f, table, g, lf_text_of(row, "category")))
            print_row(r, f, table, row, g, out);
    }
    for (size_t i = 0; i < json_array_size(rows); i++) {
        const char *category = lf_text_of(json_array_get(rows, i), "category");
        if (strcmp(category, last) != 0 && results_of(r, f, table, g, category) == 0) {
            fprintf(out, "%s%s", left ? ", " : "\nNot run: ", category);
            left = true;
        }
        last = category;
    }
    fputs(left ? ".\n" : "", out);
}

/* "400 shapes trained on": the range over the group's results. */
static void print_items(const lf_results *r, const json_t *table, const lf_group *g, FILE *out)
{
    const lf_cell c = {
        .experiment = lf_text_of(table, "experiment"), .size = g->size, .data = g->data};
    const bool renders = strcmp(c.experiment, "rendering") == 0;
    json_int_t low[3] = {0}, high[3] = {0};
    bool any = false;
    for (long i = 0; i < r->count; i++) {
        const lf_result *x = &r->result[i];
        const json_int_t n[3] = {x->steps, x->train_items, x->test_items};
        if (!lf_in_cell(x, &c))
            continue;
        for (int k = 0; k < 3; k++) {
            low[k] = !any || n[k] < low[k] ? n[k] : low[k];
            high[k] = !any || n[k] > high[k] ? n[k] : high[k];
        }
        any = true;
    }
    const char *const what[3] = {" steps", renders ? " scenes trained on" : " shapes trained on",
                                 renders ? " views tested of a kind" : " tested"};
    for (int k = 0; k < 3; k++) {
        fprintf(out, "%s%lld", k ? ", " : "", (long long)low[k]);
        if (high[k] > low[k])
            fprintf(out, " to %lld", (long long)high[k]);
        fputs(what[k], out);
    }
}

static void print_group(const lf_results *r, const front *f, const json_t *table, const lf_group *g,
                        FILE *out)
{
    if (strcmp(g->data, "files") == 0)
        fprintf(out, "\n%s (size %s, data from files: ", f->title, g->size);
    else
        fprintf(out, "\n%s (size %s, %s data: ", f->title, g->size, g->data);
    print_items(r, table, g, out);
    fputs("):\n\n| | system |", out);
    for (int k = 0; k < f->columns; k++)
        fprintf(out, " %s |", f->column[k].head);
    fputs("\n|---|---|", out);
    for (int k = 0; k < f->columns; k++)
        fputs("---|", out);
    fputc('\n', out);
    print_rows(r, f, table, g, out);
}

/* All data of the largest size. */
static void print_front(const lf_results *r, const front *f, FILE *out)
{
    const json_t *table = table_named(r, f->table);
    const int best = table ? best_worth(r, f, table) : 0;
    if (best == 0) {
        fprintf(out, "\n%s: not run.\n", f->title);
        return;
    }
    const lf_cell all = {.experiment = lf_text_of(table, "experiment")};
    long count;
    lf_group *g = lf_groups_of(r, &all, &count);
    for (long i = 0; i < count; i++)
        if (worth(g[i].size) == best && results_of(r, f, table, &g[i], NULL))
            print_group(r, f, table, &g[i], out);
    free(g);
}

bool lf_results_print_front(const lf_results *r, FILE *out)
{
    bool any = false;
    for (size_t k = 0; k < sizeof fronts / sizeof *fronts; k++) {
        const json_t *table = table_named(r, fronts[k].table);
        any = any || (table && best_worth(r, &fronts[k], table));
    }
    if (!any)
        return false;
    fputs(
        "elf's figure / the paper's, of ShapeNet and the published scenes with larger networks and "
        "longer trainings;\nA/B: trained in setting A, tested in B.\n",
        out);
    for (size_t k = 0; k < sizeof fronts / sizeof *fronts; k++)
        print_front(r, &fronts[k], out);
    return true;
}

/* ---- the file ---- */

/* The whole file with a 0 behind it; the caller frees it. */
static lf_status read_text(const char *path, char **out, lf_error *err)
{
    FILE *file = fopen(path, "r");
    char *text = NULL;
    size_t room = 0;
    if (!file)
        return lf_fail(err, LF_BAD_INPUT, "%s: %s", path, strerror(errno));
    const ssize_t n = getdelim(&text, &room, 0, file); /* a page has no 0 */
    const bool sound = n > 0 && !ferror(file);
    fclose(file);
    if (sound) {
        *out = text;
        return LF_OK;
    }
    free(text);
    return lf_fail(err, LF_BAD_INPUT, "%s: is empty or cannot be read", path);
}

lf_status lf_results_front_page(const lf_results *r, const char *path, char **out, lf_error *err)
{
    char *old = NULL, *page = NULL;
    size_t size = 0;
    LF_TRY(read_text(path, &old, err));
    const char *from = strstr(old, begin_mark), *to = from ? strstr(from, end_mark) : NULL;
    if (!to) {
        free(old);
        return lf_fail(
            err, LF_BAD_INPUT, "%s: the results go between two lines, %.*s and %.*s: add them",
            path, (int)strlen(begin_mark) - 1, begin_mark, (int)strlen(end_mark) - 1, end_mark);
    }
    FILE *file = open_memstream(&page, &size);
    LF_REQUIRE(file, "out of memory");
    fprintf(file, "%.*s%s\n", (int)(from - old), old, begin_mark);
    const bool any = lf_results_print_front(r, file);
    fprintf(file, "\n%s", to);
    LF_REQUIRE(fclose(file) == 0 && page, "out of memory");
    if (any) {
        free(old);
        *out = page;
    } else {
        free(page);
        *out = old;
    }
    return LF_OK;
}
