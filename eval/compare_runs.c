/* compare_runs.c: the job and its table. See compare_runs.h. */
#include "eval/compare_runs.h"

#include "models/checkpoint.h"
#include "train/run_dir.h"

enum { SHAPE_CELL = 144, SCENE_CELL = 132 }; /* pixels: twelve letters, eleven */

/* ---- the table ---- */

long lf_picture_table_add(lf_picture_table *t, long rows)
{
    const long first = t->rows;
    const size_t cells = (size_t)(first + rows) * (size_t)t->columns;
    t->image = realloc(t->image, cells * sizeof(lf_image *));
    t->note = realloc(t->note, cells * sizeof(char *));
    t->caption = realloc(t->caption, (size_t)(first + rows) * sizeof(char *));
    LF_REQUIRE(t->image && t->note && t->caption, "out of memory");
    for (long i = first * t->columns; i < (first + rows) * t->columns; i++) {
        t->image[i] = NULL;
        t->note[i] = NULL;
    }
    for (long i = first; i < first + rows; i++)
        t->caption[i] = NULL;
    t->rows += rows;
    return first;
}

static char *formatted(const char *format, va_list args)
{
    char *text = NULL;
    LF_REQUIRE(vasprintf(&text, format, args) >= 0, "out of memory");
    return text;
}

void lf_picture_table_put(lf_picture_table *t, long row, int column, lf_image *image)
{
    t->image[row * t->columns + column] = image;
}

void lf_picture_table_note(lf_picture_table *t, long row, int column, const char *format, ...)
{
    va_list args;
    va_start(args, format);
    t->note[row * t->columns + column] = formatted(format, args);
    va_end(args);
}

void lf_picture_table_caption(lf_picture_table *t, long row, const char *format, ...)
{
    va_list args;
    va_start(args, format);
    t->caption[row] = formatted(format, args);
    va_end(args);
}

static void table_free(lf_picture_table *t)
{
    for (long i = 0; i < t->rows * t->columns; i++) {
        lf_image_free(t->image[i]);
        free(t->note[i]);
    }
    for (long i = 0; i < t->rows; i++)
        free(t->caption[i]);
    free(t->image);
    free(t->note);
    free(t->caption);
}

static lf_status table_write(const lf_picture_table *t, int edge, const char *const *head,
                             const char *path, lf_error *err)
{
    lf_grid_row *row = calloc((size_t)t->rows + 1, sizeof *row);
    lf_grid_cell *cell = calloc((size_t)(t->rows * t->columns) + 1, sizeof *cell);
    LF_REQUIRE(row && cell, "out of memory");
    for (long i = 0; i < t->rows * t->columns; i++)
        cell[i] = (lf_grid_cell){t->image[i], t->note[i]};
    for (long i = 0; i < t->rows; i++)
        row[i] = (lf_grid_row){t->caption[i], cell + i * t->columns};
    const lf_picture_grid grid = {edge, t->columns, head, t->rows, row};
    const lf_status status = lf_picture_grid_write(path, &grid, err);
    free(row);
    free(cell);
    return status;
}

/* ---- the runs ---- */

/* The config of a run's newest checkpoint; the caller frees it. */
static lf_status config_of(const char *run, lf_config **cfg, lf_error *err)
{
    lf_found found = {0};
    LF_TRY(lf_run_find(run, &found, err));
    const lf_status status = lf_checkpoint_config(found.checkpoint, cfg, NULL, err);
    lf_found_free(&found);
    return status;
}

/* What a run is trained on (malloc'd), and whether it renders as the others do: -1 none yet. */
static lf_status title_of(const char *run, char **title, int *renders, lf_error *err)
{
    lf_config *cfg;
    LF_TRY(config_of(run, &cfg, err));
    const int this = lf_config_renders(cfg);
    const bool fits = *renders < 0 || *renders == this;
    *renders = this;
    if (fits && title) {
        *title = strdup(this ? "scenes" : lf_config_string(cfg, "data.category"));
        LF_REQUIRE(*title, "out of memory");
    }
    lf_config_free(cfg);
    return fits ? LF_OK
                : lf_fail(err, LF_BAD_INPUT,
                          "%s: renderers and networks for reconstruction are not compared in one "
                          "picture",
                          run);
}

lf_status lf_run_titles(const lf_run_columns *runs, char ***out, bool *renders, lf_error *err)
{
    char **title = calloc((size_t)runs->parts, sizeof *title);
    LF_REQUIRE(title, "out of memory");
    int kind = -1;
    lf_status status = LF_OK;
    for (int p = 0; status == LF_OK && p < runs->parts; p++)
        for (int c = 0; status == LF_OK && c < runs->columns; c++)
            if (lf_run_at(runs, c, p))
                status = title_of(lf_run_at(runs, c, p), title[p] ? NULL : &title[p], &kind, err);
    if (status != LF_OK) {
        lf_run_titles_free(runs, title);
        return status;
    }
    *out = title;
    if (renders)
        *renders = kind == 1;
    return LF_OK;
}

void lf_run_titles_free(const lf_run_columns *runs, char **title)
{
    for (int p = 0; p < runs->parts; p++)
        free(title[p]);
    free(title);
}

/* ---- the job ---- */

/* Heads of the columns: before the systems' and after them; [columns], malloc'd. */
static const char **heads_of(const lf_run_columns *runs, bool renders, int columns)
{
    const char **head = calloc((size_t)columns, sizeof *head);
    const int before = renders ? LF_SCENE_TRUTHS : LF_SHAPE_VIEWS;
    LF_REQUIRE(head, "out of memory");
    for (int c = 0; c < columns; c++)
        head[c] = "";
    head[0] = renders ? "true view" : "input views";
    for (int c = 0; c < runs->columns; c++)
        head[before + c] = runs->name[c];
    if (!renders)
        head[columns - 1] = "true";
    return head;
}

static lf_status check(const lf_compare_runs_options *o, bool renders, lf_error *err)
{
    const size_t length = strlen(o->out);
    if (renders && o->settings)
        return lf_fail(err, LF_BAD_INPUT,
                       "--setting %s: renderers are always shown in I and in SO3", o->settings);
    if (length < 5 || strcmp(o->out + length - 4, ".png") != 0)
        return lf_fail(err, LF_BAD_INPUT, "--out %s: the picture's name must end in .png", o->out);
    return LF_OK;
}

lf_status lf_compare_runs(const lf_compare_runs_options *o, lf_error *err)
{
    char **title;
    bool renders;
    LF_TRY(lf_run_titles(o->runs, &title, &renders, err));
    lf_run_titles_free(o->runs, title);
    LF_TRY(check(o, renders, err));
    lf_picture_table table = {.columns =
                                  o->runs->columns +
                                  (renders ? LF_SCENE_TRUTHS : LF_SHAPE_VIEWS + LF_SHAPE_TRUTHS)};
    lf_status status =
        renders ? lf_compare_scenes(o, &table, err) : lf_compare_shapes(o, &table, err);
    if (status == LF_OK) {
        const char **head = heads_of(o->runs, renders, table.columns);
        status = table_write(&table, renders ? SCENE_CELL : SHAPE_CELL, head, o->out, err);
        free(head);
    }
    table_free(&table);
    return status;
}
