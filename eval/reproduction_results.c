/* reproduction_results.c: results and the paper's figures, read and checked. See reproduction.h. */
#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stddef.h>

#include "eval/reproduction.h"

const char *const lf_result_figure[LF_RESULT_FIGURES] = {
    "iou", "chamfer_l1", "empty", "psnr", "ssim", "lpips", "pixel_variance"};

/* ---- one result ------------------------------------------------------------------------------ */

int lf_result_figure_of(const char *name)
{
    for (int k = 0; k < LF_RESULT_FIGURES; k++)
        if (strcmp(name, lf_result_figure[k]) == 0)
            return k;
    return -1;
}

static lf_status read_figures(json_t *figures, lf_result *r, lf_error *err)
{
    for (int k = 0; k < LF_RESULT_FIGURES; k++)
        r->figure[k] = NAN;
    for (void *at = json_object_iter(figures); at; at = json_object_iter_next(figures, at)) {
        const char *key = json_object_iter_key(at);
        const json_t *value = json_object_iter_value(at);
        const int k = lf_result_figure_of(key);
        if (k < 0)
            return lf_fail(err, LF_BAD_INPUT, "figures: unknown key \"%s\"", key);
        if (!json_is_number(value) && !json_is_null(value))
            return lf_fail(err, LF_BAD_INPUT, "figures: %s is neither a number nor null", key);
        if (json_is_number(value))
            r->figure[k] = json_number_value(value);
    }
    return LF_OK;
}

/* A key of a result: 's' a text, 'I' a whole number, 'F' a number, 'f' one that may be missing, 'o'
 * an object; where it goes. */
typedef struct field {
    const char *key;
    char type;
    size_t at;
} field;

#define FIELD(key, type, member)                                                                   \
    {                                                                                              \
        key, type, offsetof(lf_result, member)                                                     \
    }

static const field run_field[] = {FIELD("experiment", 's', experiment),
                                  FIELD("system", 's', system),
                                  FIELD("config", 's', config),
                                  FIELD("keys", 's', keys),
                                  FIELD("size", 's', size),
                                  FIELD("size_keys", 's', size_keys),
                                  FIELD("data", 's', data),
                                  FIELD("category", 's', category),
                                  FIELD("train_setting", 's', train),
                                  FIELD("eval_setting", 's', test),
                                  FIELD("commit", 's', commit),
                                  FIELD("seed", 'I', seed),
                                  FIELD("steps", 'I', steps),
                                  FIELD("pixels", 'I', pixels),
                                  FIELD("train_items", 'I', train_items),
                                  FIELD("test_items", 'I', test_items),
                                  FIELD("parameters", 'I', parameters),
                                  FIELD("train_seconds", 'F', seconds),
                                  FIELD("peak_rss_mb", 'F', peak_rss_mb),
                                  FIELD("seconds_per_item", 'f', item_seconds),
                                  {"figures", 'o', 0},
                                  {NULL, 0, 0}};

static const field count_field[] = {FIELD("experiment", 's', experiment),
                                    FIELD("system", 's', system),
                                    FIELD("config", 's', config),
                                    FIELD("keys", 's', keys),
                                    FIELD("size", 's', size),
                                    FIELD("size_keys", 's', size_keys),
                                    FIELD("commit", 's', commit),
                                    FIELD("of", 's', of),
                                    FIELD("parameters", 'I', parameters),
                                    FIELD("flop_forward", 'F', flop_forward),
                                    FIELD("flop", 'F', flop),
                                    {NULL, 0, 0}};

static lf_status read_field(lf_result *r, const field *f, lf_error *err)
{
    const json_t *value = json_object_get(r->json, f->key);
    char *to = (char *)r + f->at;
    if (!value && f->type == 'f') {
        *(double *)(void *)to = NAN;
        return LF_OK;
    }
    if (!value)
        return lf_fail(err, LF_BAD_INPUT, "%s is missing", f->key);
    if (f->type == 's' && json_is_string(value))
        *(const char **)(void *)to = json_string_value(value);
    else if (f->type == 'I' && json_is_integer(value))
        *(json_int_t *)(void *)to = json_integer_value(value);
    else if ((f->type == 'F' || f->type == 'f') && json_is_number(value))
        *(double *)(void *)to = json_number_value(value);
    else if (f->type != 'o' || !json_is_object(value))
        return lf_fail(err, LF_BAD_INPUT, "%s must be %s", f->key,
                       f->type == 's'   ? "a text"
                       : f->type == 'I' ? "a whole number"
                       : f->type == 'o' ? "an object"
                                        : "a number");
    return LF_OK;
}

static lf_status read_fields(lf_result *r, const field *fields, lf_error *err)
{
    for (const field *f = fields; f->key; f++)
        LF_TRY(read_field(r, f, err));
    for (void *at = json_object_iter(r->json); at; at = json_object_iter_next(r->json, at)) {
        const field *f = fields;
        while (f->key && strcmp(f->key, json_object_iter_key(at)) != 0)
            f++;
        if (!f->key)
            return lf_fail(err, LF_BAD_INPUT, "unknown key \"%s\"", json_object_iter_key(at));
    }
    return LF_OK;
}

static lf_status read_run(lf_result *r, lf_error *err)
{
    LF_TRY(read_fields(r, run_field, err));
    return read_figures(json_object_get(r->json, "figures"), r, err);
}

static lf_status read_count(lf_result *r, lf_error *err)
{
    LF_TRY(read_fields(r, count_field, err));
    r->data = r->category = r->train = r->test = "";
    return LF_OK;
}

static lf_status load(const char *folder, const char *name, json_t **out, lf_error *err)
{
    char path[4400];
    json_error_t e;
    snprintf(path, sizeof path, "%s/%s", folder, name);
    *out = json_load_file(path, JSON_REJECT_DUPLICATES, &e);
    if (!*out)
        return lf_fail(err, LF_BAD_INPUT, "line %d: %s", e.line, e.text);
    return LF_OK;
}

static lf_status read_result(const char *folder, lf_result *r, lf_error *err)
{
    LF_TRY(load(folder, r->file, &r->json, err));
    const char *experiment = json_string_value(json_object_get(r->json, "experiment"));
    if (experiment && strcmp(experiment, "count") == 0)
        return read_count(r, err);
    if (experiment && (!strcmp(experiment, "reconstruction") || !strcmp(experiment, "rendering")))
        return read_run(r, err);
    return lf_fail(err, LF_BAD_INPUT,
                   "\"experiment\" must be \"reconstruction\", \"rendering\" or \"count\"");
}

/* ---- paper.json ------------------------------------------------------------------------------ */

/* Every figure a number or null. */
static bool sound_cell(const json_t *cell, size_t figures)
{
    if (json_array_size(cell) != figures)
        return false;
    for (size_t i = 0; i < figures; i++) {
        const json_t *value = json_array_get(cell, i);
        if (!json_is_number(value) && !json_is_null(value))
            return false;
    }
    return true;
}

static lf_status check_row(json_t *row, size_t settings, size_t figures, lf_error *err)
{
    json_error_t e;
    const char *category, *system, *label;
    json_t *values = NULL;
    if (json_unpack_ex(row, &e, JSON_STRICT, "{s:s, s:s, s:s, s?:o}", "category", &category,
                       "system", &system, "label", &label, "values", &values))
        return lf_fail(err, LF_BAD_INPUT, "%s", e.text);
    if (!values)
        return LF_OK;
    if (json_array_size(values) != settings)
        return lf_fail(err, LF_BAD_INPUT, "%s, %s: %zu values for %zu settings", category, system,
                       json_array_size(values), settings);
    for (size_t i = 0; i < settings; i++)
        if (!sound_cell(json_array_get(values, i), figures))
            return lf_fail(err, LF_BAD_INPUT,
                           "%s, %s: value %zu must be %zu figures, each a number or null", category,
                           system, i + 1, figures);
    return LF_OK;
}

static lf_status check_texts(const json_t *array, const char *name, lf_error *err)
{
    bool sound = json_array_size(array) > 0;
    for (size_t i = 0; i < json_array_size(array); i++)
        sound = sound && json_is_string(json_array_get(array, i));
    return sound ? LF_OK : lf_fail(err, LF_BAD_INPUT, "%s must be a list of texts", name);
}

static lf_status check_figures(const json_t *figures, lf_error *err)
{
    LF_TRY(check_texts(figures, "figures", err));
    for (size_t i = 0; i < json_array_size(figures); i++)
        if (lf_result_figure_of(json_string_value(json_array_get(figures, i))) < 0)
            return lf_fail(err, LF_BAD_INPUT, "figures: unknown \"%s\"",
                           json_string_value(json_array_get(figures, i)));
    return LF_OK;
}

static lf_status check_table(json_t *table, lf_error *err)
{
    json_error_t e;
    const char *name, *title, *source, *experiment, *reference = NULL;
    json_t *figures, *settings, *rows;
    if (json_unpack_ex(table, &e, JSON_STRICT, "{s:s,s:s,s:s,s:s,s?s,s:o,s:o,s:o}", "name", &name,
                       "title", &title, "source", &source, "experiment", &experiment, "reference",
                       &reference, "figures", &figures, "settings", &settings, "rows", &rows))
        return lf_fail(err, LF_BAD_INPUT, "%s", e.text);
    lf_status status = json_is_array(rows) ? check_figures(figures, err)
                                           : lf_fail(err, LF_BAD_INPUT, "rows must be a list");
    if (status == LF_OK)
        status = check_texts(settings, "settings", err);
    for (size_t i = 0; status == LF_OK && i < json_array_size(settings); i++)
        if (!strchr(json_string_value(json_array_get(settings, i)), '/'))
            status = lf_fail(err, LF_BAD_INPUT, "settings: write training/test, as I/Z");
    bool found = !reference;
    for (size_t i = 0; status == LF_OK && !found && i < json_array_size(rows); i++)
        found = json_string_value(json_object_get(json_array_get(rows, i), "system")) &&
                strcmp(json_string_value(json_object_get(json_array_get(rows, i), "system")),
                       reference) == 0;
    if (status == LF_OK && !found)
        status = lf_fail(err, LF_BAD_INPUT, "reference \"%s\" has no row", reference);
    for (size_t i = 0; status == LF_OK && i < json_array_size(rows); i++)
        status = check_row(json_array_get(rows, i), json_array_size(settings),
                           json_array_size(figures), err);
    return status == LF_OK ? LF_OK : lf_error_context(err, status, "table %s", name);
}

static lf_status read_paper(const char *folder, json_t **out, lf_error *err)
{
    json_error_t e;
    const char *paper;
    json_t *tables;
    LF_TRY(load(folder, "paper.json", out, err));
    if (json_unpack_ex(*out, &e, JSON_STRICT, "{s:s, s:o}", "paper", &paper, "tables", &tables))
        return lf_fail(err, LF_BAD_INPUT, "%s", e.text);
    if (!json_is_array(tables))
        return lf_fail(err, LF_BAD_INPUT, "tables must be a list");
    for (size_t i = 0; i < json_array_size(tables); i++)
        LF_TRY(check_table(json_array_get(tables, i), err));
    return LF_OK;
}

/* ---- the folder ------------------------------------------------------------------------------ */

static bool same_cell(const lf_result *a, const lf_result *b)
{
    return !strcmp(a->experiment, b->experiment) && !strcmp(a->system, b->system) &&
           !strcmp(a->size, b->size) && !strcmp(a->data, b->data) &&
           !strcmp(a->category, b->category) && !strcmp(a->train, b->train) &&
           !strcmp(a->test, b->test);
}

/* What seeds of one cell must share. */
static const char *difference(const lf_result *a, const lf_result *b)
{
    return strcmp(a->config, b->config) || strcmp(a->keys, b->keys) ||
                   strcmp(a->size_keys, b->size_keys)
               ? "config or keys"
           : a->steps != b->steps             ? "steps"
           : a->pixels != b->pixels           ? "pixels"
           : a->train_items != b->train_items ? "train_items"
           : a->test_items != b->test_items   ? "test_items"
           : a->parameters != b->parameters   ? "parameters"
                                              : NULL;
}

static lf_status check_cells(const lf_results *r, lf_error *err)
{
    for (long i = 0; i < r->count; i++)
        for (long j = 0; j < i; j++) {
            const lf_result *a = &r->result[j], *b = &r->result[i];
            if (!same_cell(a, b))
                continue;
            if (a->seed == b->seed)
                return lf_fail(err, LF_BAD_INPUT,
                               "%s and %s: the same run and seed twice; delete one", a->file,
                               b->file);
            if (difference(a, b))
                return lf_fail(err, LF_BAD_INPUT,
                               "%s and %s: two seeds of one cell that differ in %s; delete one",
                               a->file, b->file, difference(a, b));
        }
    return LF_OK;
}

static int is_result(const struct dirent *e)
{
    const size_t length = strlen(e->d_name);
    return length > 5 && strcmp(e->d_name + length - 5, ".json") == 0 && e->d_name[0] != '.' &&
           strcmp(e->d_name, "paper.json") != 0;
}

static int by_name(const struct dirent **a, const struct dirent **b)
{
    return strcmp((*a)->d_name, (*b)->d_name);
}

static lf_status read_all(const char *folder, lf_results *r, lf_error *err)
{
    struct dirent **entry;
    const int n = scandir(folder, &entry, is_result, by_name);
    if (n < 0)
        return lf_fail(err, LF_BAD_INPUT, "%s", strerror(errno));
    r->result = calloc((size_t)n + 1, sizeof *r->result);
    LF_REQUIRE(r->result, "out of memory");
    lf_status status = LF_OK;
    for (int i = 0; i < n && status == LF_OK; i++) {
        lf_result *result = &r->result[r->count++];
        snprintf(result->file, sizeof result->file, "%s", entry[i]->d_name);
        status = read_result(folder, result, err);
        if (status != LF_OK)
            lf_error_context(err, status, "%s", result->file);
    }
    for (int i = 0; i < n; i++)
        free(entry[i]);
    free(entry);
    return status == LF_OK ? check_cells(r, err) : status;
}

lf_status lf_results_read(const char *folder, lf_results *out, lf_error *err)
{
    lf_results r = {.folder = strdup(folder)};
    LF_REQUIRE(r.folder, "out of memory");
    lf_status status = read_all(folder, &r, err);
    if (status == LF_OK) {
        status = read_paper(folder, &r.paper, err);
        if (status != LF_OK)
            lf_error_context(err, status, "paper.json");
    }
    if (status == LF_OK) {
        *out = r;
        return LF_OK;
    }
    lf_results_free(&r);
    return lf_error_context(err, status, "%s", folder);
}

void lf_results_free(lf_results *r)
{
    for (long i = 0; i < r->count; i++)
        json_decref(r->result[i].json);
    free(r->folder);
    free(r->result);
    json_decref(r->paper);
    *r = (lf_results){0};
}
