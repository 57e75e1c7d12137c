/* reproduction_cells.c: see reproduction_cells.h. */
#include "eval/reproduction_cells.h"

#include <math.h>

/* ---- cells ----------------------------------------------------------------------------------- */

static bool match(const char *wanted, const char *found)
{
    return !wanted || strcmp(wanted, found) == 0;
}

bool lf_in_cell(const lf_result *r, const lf_cell *c)
{
    return match(c->experiment, r->experiment) && match(c->system, r->system) &&
           match(c->size, r->size) && match(c->data, r->data) && match(c->category, r->category) &&
           match(c->train, r->train) && match(c->test, r->test);
}

lf_moments lf_moments_of(const lf_results *r, const lf_cell *c, int figure)
{
    lf_moments m = {0};
    double squares = 0;
    for (long i = 0; i < r->count; i++) {
        const double x = r->result[i].figure[figure];
        if (!lf_in_cell(&r->result[i], c))
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

int lf_figure_digits(int figure)
{
    const char *name = lf_result_figure[figure];
    return strcmp(name, "psnr") == 0 || strcmp(name, "pixel_variance") == 0 ? 2 : 3;
}

/* ---- groups: one size on one data ------------------------------------------------------------ */

static bool first_of_group(const lf_results *r, long i, const lf_cell *c)
{
    for (long j = 0; j < i; j++)
        if (lf_in_cell(&r->result[j], c) && !strcmp(r->result[j].size, r->result[i].size) &&
            !strcmp(r->result[j].data, r->result[i].data))
            return false;
    return true;
}

int lf_size_rank(const char *size)
{
    static const char *const sizes[] = {"quick", "tiny", "small", "paper"};
    for (int i = 0; i < 4; i++)
        if (strcmp(size, sizes[i]) == 0)
            return i;
    return 4;
}

static int by_size(const void *a, const void *b)
{
    const lf_group *x = a, *y = b;
    const int ranks = lf_size_rank(x->size) - lf_size_rank(y->size),
              sizes = strcmp(x->size, y->size);
    return ranks ? ranks : sizes ? sizes : strcmp(x->data, y->data);
}

lf_group *lf_groups_of(const lf_results *r, const lf_cell *c, long *count)
{
    lf_group *g = malloc(((size_t)r->count + 1) * sizeof *g);
    LF_REQUIRE(g, "out of memory");
    *count = 0;
    for (long i = 0; i < r->count; i++)
        if (lf_in_cell(&r->result[i], c) && first_of_group(r, i, c))
            g[(*count)++] = (lf_group){r->result[i].size, r->result[i].data};
    qsort(g, (size_t)*count, sizeof *g, by_size);
    return g;
}

const char *lf_text_of(const json_t *object, const char *key)
{
    return json_string_value(json_object_get(object, key));
}

/* ---- cells of a table of paper.json ------------------------------------------------------------ */

lf_cell lf_cell_at(const json_t *table, const json_t *row, const lf_group *g, size_t i,
                   char train[32])
{
    const char *setting = json_string_value(json_array_get(json_object_get(table, "settings"), i));
    const char *slash = strchr(setting, '/');
    snprintf(train, 32, "%.*s", (int)(slash - setting), setting);
    return (lf_cell){lf_text_of(table, "experiment"),
                     lf_text_of(row, "system"),
                     g ? g->size : "",
                     g ? g->data : "",
                     lf_text_of(row, "category"),
                     train,
                     slash + 1};
}

void lf_print_settings(const json_t *table, FILE *out)
{
    const json_t *settings = json_object_get(table, "settings");
    for (size_t i = 0; i < json_array_size(settings); i++)
        fprintf(out, " %s |", json_string_value(json_array_get(settings, i)));
    fputs("\n|---|---|", out);
    for (size_t i = 0; i < json_array_size(settings); i++)
        fputs("---|", out);
    fputc('\n', out);
}
