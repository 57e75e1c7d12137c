/* run_columns.c: see run_columns.h. */
#include "eval/run_columns.h"

#include <stdbool.h>

static int count_parts(const char *text)
{
    int n = 1;
    for (; *text; text++)
        n += *text == ',';
    return n;
}

/* Cut `text` at its commas into out[n]; false if there are not n parts, or an empty one. */
static bool cut(char *text, int n, char **out)
{
    if (count_parts(text) != n)
        return false;
    for (int i = 0; i < n; i++) {
        out[i] = text;
        text += strcspn(text, ",");
        if (text == out[i])
            return false;
        *text++ = 0;
    }
    return true;
}

/* The last part of a path, without slashes at its end; malloc'd. */
static char *last_part(const char *path)
{
    size_t end = strlen(path);
    while (end > 1 && path[end - 1] == '/')
        end--;
    size_t from = end;
    while (from > 0 && path[from - 1] != '/')
        from--;
    return strndup(path + from, end - from);
}

static lf_status take_runs(lf_run_columns *c, char *const *word, lf_error *err)
{
    for (int k = 0; k < c->columns; k++) {
        c->text[k] = strdup(word[k]);
        LF_REQUIRE(c->text[k], "out of memory");
        if (!cut(c->text[k], c->parts, c->run + k * c->parts))
            return lf_fail(
                err, LF_BAD_INPUT,
                "column %d, \"%s\": every column must have %d runs as the first one has, "
                "with commas between, the word none where there is none",
                k + 1, word[k], c->parts);
        for (int p = 0; p < c->parts; p++)
            if (strcmp(c->run[k * c->parts + p], "none") == 0)
                c->run[k * c->parts + p] = NULL;
    }
    for (int p = 0; p < c->parts; p++)
        if (!lf_run_first(c, p))
            return lf_fail(err, LF_BAD_INPUT, "part %d has no run in any column", p + 1);
    return LF_OK;
}

static lf_status take_names(lf_run_columns *c, const char *names, lf_error *err)
{
    char **name = calloc((size_t)c->columns, sizeof *name);
    c->text[c->columns] = strdup(names ? names : "");
    LF_REQUIRE(name && c->text[c->columns], "out of memory");
    const bool sound = !names || cut(c->text[c->columns], c->columns, name);
    for (int k = 0; sound && k < c->columns; k++) {
        const char *path = "";
        for (int p = c->parts - 1; p >= 0; p--)
            path = lf_run_at(c, k, p) ? lf_run_at(c, k, p) : path;
        c->name[k] = names ? strdup(name[k]) : last_part(path);
        LF_REQUIRE(c->name[k], "out of memory");
    }
    free(name);
    return sound ? LF_OK
                 : lf_fail(err, LF_BAD_INPUT, "--names %s: give %d names with commas between",
                           names, c->columns);
}

lf_status lf_run_columns_parse(int words, char *const *word, const char *names, lf_run_columns *out,
                               lf_error *err)
{
    if (words < 1)
        return lf_fail(err, LF_BAD_INPUT, "give the folders of the runs, a column each");
    const size_t n = (size_t)words;
    lf_run_columns c = {.columns = words, .parts = count_parts(word[0])};
    c.run = calloc(n * (size_t)c.parts, sizeof *c.run);
    c.name = calloc(n, sizeof *c.name);
    c.text = calloc(n + 1, sizeof *c.text);
    LF_REQUIRE(c.run && c.name && c.text, "out of memory");
    lf_status status = take_runs(&c, word, err);
    if (status == LF_OK)
        status = take_names(&c, names, err);
    if (status == LF_OK)
        *out = c;
    else
        lf_run_columns_free(&c);
    return status;
}

void lf_run_columns_free(lf_run_columns *c)
{
    for (int k = 0; k < c->columns; k++) {
        free(c->name[k]);
        free(c->text[k]);
    }
    if (c->text)
        free(c->text[c->columns]);
    free(c->run);
    free(c->name);
    free(c->text);
    *c = (lf_run_columns){0};
}

const char *lf_run_at(const lf_run_columns *c, int column, int part)
{
    return c->run[column * c->parts + part];
}

const char *lf_run_first(const lf_run_columns *c, int part)
{
    for (int k = 0; k < c->columns; k++)
        if (lf_run_at(c, k, part))
            return lf_run_at(c, k, part);
    return NULL;
}
