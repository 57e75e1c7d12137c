/* curves.c: see curves.h. */
#include "eval/curves.h"

#include <errno.h>
#include <jansson.h>
#include <math.h>
#include <stdbool.h>

#include "datasets/image.h"

enum { WIDTH = 480, HEIGHT = 320, MARGIN = 12, LINE = 22, BAR = 28, TEXT = 2 }; /* pixels */

/* ---- a training's log --------------------------------------------------------------------- */

/* What stands in one line of the log. */
typedef struct entry {
    double step, seconds, loss, check, peak_rss_mb; /* NaN: null, or not there */
} entry;

typedef struct entries {
    long count;
    entry *at;
    const char *figure;
} entries;

static double number(const json_t *line, const char *key)
{
    const json_t *value = json_object_get(line, key);
    return json_is_number(value) ? json_number_value(value) : NAN;
}

static lf_status add_line(entries *e, const char *text, lf_error *err)
{
    static const char *const figure[] = {"val_iou", "val_psnr"};
    json_error_t error;
    json_t *line = json_loads(text, JSON_REJECT_DUPLICATES, &error);
    if (!line)
        return lf_fail(err, LF_BAD_INPUT, "%s", error.text);
    entry x = {number(line, "step"), number(line, "seconds"), number(line, "loss"), NAN,
               number(line, "peak_rss_mb")};
    for (int k = 0; k < 2; k++)
        if (json_object_get(line, figure[k])) {
            e->figure = figure[k];
            x.check = number(line, figure[k]);
        }
    json_decref(line);
    if (isnan(x.step) || isnan(x.seconds) || isnan(x.peak_rss_mb))
        return lf_fail(err, LF_BAD_INPUT, "step, seconds and peak_rss_mb must be numbers");
    if ((e->count & (e->count - 1)) == 0) { /* full at powers of two */
        e->at = realloc(e->at, (size_t)(e->count ? 2 * e->count : 1) * sizeof *e->at);
        LF_REQUIRE(e->at, "out of memory for %ld lines", e->count);
    }
    e->at[e->count++] = x;
    return LF_OK;
}

static lf_status read_entries(const char *path, entries *e, lf_error *err)
{
    FILE *file = fopen(path, "r");
    if (!file)
        return lf_fail(err, LF_BAD_INPUT, "%s", strerror(errno));
    char *text = NULL;
    size_t room = 0;
    lf_status status = LF_OK;
    while (status == LF_OK && getline(&text, &room, file) >= 0) {
        status = add_line(e, text, err);
        if (status != LF_OK)
            lf_error_context(err, status, "line %ld", e->count + 1);
    }
    free(text);
    fclose(file);
    if (status == LF_OK && e->count == 0)
        return lf_fail(err, LF_BAD_INPUT, "is empty: nothing was logged yet");
    return status;
}

/* Means of equal numbers of lines. */
static void take_losses(lf_curve *c, const entries *e)
{
    const long n = e->count < LF_CURVE_POINTS ? e->count : LF_CURVE_POINTS;
    for (long k = 0; k < n; k++) {
        const long from = k * e->count / n, to = (k + 1) * e->count / n;
        double sum = 0;
        for (long i = from; i < to; i++)
            sum += e->at[i].loss;
        c->step[k] = e->at[to - 1].step;
        c->seconds[k] = e->at[to - 1].seconds;
        c->loss[k] = sum / (double)(to - from);
    }
    c->points = n;
}

static void take_checks(lf_curve *c, const entries *e)
{
    c->check_step = malloc(2 * (size_t)e->count * sizeof *c->check);
    LF_REQUIRE(c->check_step, "out of memory for %ld lines", e->count);
    c->check = c->check_step + e->count;
    c->figure = e->figure;
    for (long i = 0; i < e->count; i++)
        if (!isnan(e->at[i].check)) {
            c->check_step[c->checks] = e->at[i].step;
            c->check[c->checks++] = e->at[i].check;
        }
}

lf_status lf_curve_read(const char *run, lf_curve *out, lf_error *err)
{
    char path[4400];
    entries e = {0};
    snprintf(path, sizeof path, "%.4300s/metrics.jsonl", run);
    const lf_status status = read_entries(path, &e, err);
    if (status == LF_OK) {
        *out = (lf_curve){0};
        take_losses(out, &e);
        take_checks(out, &e);
        out->total_seconds = e.at[e.count - 1].seconds;
        for (long i = 0; i < e.count; i++)
            out->peak_rss_mb = fmax(out->peak_rss_mb, e.at[i].peak_rss_mb);
    }
    free(e.at);
    return status == LF_OK ? LF_OK : lf_error_context(err, status, "%s", path);
}

void lf_curve_free(lf_curve *c)
{
    free(c->check_step);
    *c = (lf_curve){0};
}

/* ---- the picture -------------------------------------------------------------------------- */

typedef enum panel { LOSS_STEPS, LOSS_SECONDS, CHECK_STEPS } panel;

typedef struct sheet {
    const lf_run_columns *runs;
    lf_curve *curve; /* [columns][parts] */
    int panels;
    const char *figure;
    bool across; /* the panels of a part beside each other; else below */
} sheet;

static const lf_curve *curve_at(const sheet *s, int column, int part)
{
    return &s->curve[column * s->runs->parts + part];
}

static lf_plot_series series_of(const lf_curve *c, panel kind)
{
    if (kind == CHECK_STEPS)
        return (lf_plot_series){NULL, c->checks, c->check_step, c->check, LF_PLOT_LINE};
    return (lf_plot_series){NULL, c->points, kind == LOSS_STEPS ? c->step : c->seconds, c->loss,
                            LF_PLOT_LINE};
}

static lf_status draw_panel(const sheet *s, int part, const char *title, panel kind, lf_image *into,
                            lf_error *err)
{
    lf_plot_series line[LF_PLOT_SERIES];
    long points = 0;
    for (int c = 0; c < s->runs->columns; c++) {
        line[c] = series_of(curve_at(s, c, part), kind);
        points += line[c].count;
    }
    if (points == 0) /* validated in other parts alone */
        return LF_OK;
    const lf_plot plot = {.title = title,
                          .x_label = kind == LOSS_SECONDS ? "seconds" : "steps",
                          .y_label = kind == CHECK_STEPS ? s->figure : "loss",
                          .log_x = kind == LOSS_SECONDS,
                          .log_y = kind != CHECK_STEPS,
                          .width = WIDTH,
                          .height = HEIGHT,
                          .series = s->runs->columns,
                          .line = line};
    lf_image *image;
    LF_TRY(lf_plot_draw(&plot, &image, err));
    lf_image_paste(into, image, (s->across ? (int)kind : part) * WIDTH,
                   (s->across ? part : (int)kind) * HEIGHT, 1);
    lf_image_free(image);
    return LF_OK;
}

/* "name: 125 s, 255 MB" */
static void entry_text(const sheet *s, int column, int part, char text[256])
{
    const lf_curve *c = curve_at(s, column, part);
    if (c->points)
        snprintf(text, 256, "%.200s: %.0f s, %.0f MB", s->runs->name[column], c->total_seconds,
                 c->peak_rss_mb);
    else
        snprintf(text, 256, "%.200s: not run", s->runs->name[column]);
}

/* Large letters where all entries of the legend have room in them. */
static int legend_scale(const sheet *s, int room)
{
    char text[256];
    bool fit = true;
    for (int c = 0; c < s->runs->columns; c++)
        for (int p = 0; p < s->runs->parts; p++) {
            entry_text(s, c, p, text);
            fit = fit && lf_image_text_width((int)strlen(text), TEXT) <= room;
        }
    return fit ? TEXT : 1;
}

static void draw_legend(const sheet *s, int part, lf_image *into)
{
    const int left = MARGIN + (s->across ? 0 : part * WIDTH);
    const int room = (s->across ? into->width : WIDTH) - BAR - 3 * MARGIN;
    const int scale = legend_scale(s, room);
    int top = (s->across ? 1 : s->panels) * HEIGHT + MARGIN;
    for (int c = 0; c < s->runs->columns; c++, top += LINE) {
        char text[256];
        float colour[3];
        entry_text(s, c, part, text);
        lf_plot_colour(c, colour);
        for (int y = 5; y < 9; y++)
            for (int x = 0; x < BAR; x++)
                memcpy(lf_image_at(into, left + x, top + y), colour, sizeof colour);
        text[(size_t)fmin(room / lf_image_text_width(1, scale), sizeof text - 1.0)] = 0;
        lf_image_text(into, text, left + BAR + MARGIN, top + (scale == 1 ? 3 : 0), scale,
                      (const float[3]){0, 0, 0});
    }
}

static lf_status draw(const sheet *s, const char *const *title, const char *path, lf_error *err)
{
    const int parts = s->runs->parts, wide = s->across ? s->panels : parts;
    const int high = s->across ? 1 : s->panels;
    lf_image *picture =
        lf_image_create(wide * WIDTH, high * HEIGHT + 2 * MARGIN + s->runs->columns * LINE, 3);
    lf_image_fill(picture, (const float[3]){1, 1, 1});
    lf_status status = LF_OK;
    for (int p = 0; p < parts; p++) {
        for (int k = 0; status == LF_OK && k < s->panels; k++)
            status = draw_panel(s, p, k == 0 ? title[p] : "", (panel)k, picture, err);
        draw_legend(s, p, picture);
    }
    if (status == LF_OK)
        status = lf_image_write_png(path, picture, err);
    lf_image_free(picture);
    return status;
}

static lf_status read_curves(sheet *s, lf_error *err)
{
    for (int c = 0; c < s->runs->columns; c++)
        for (int p = 0; p < s->runs->parts; p++) {
            const char *run = lf_run_at(s->runs, c, p);
            lf_curve *curve = &s->curve[c * s->runs->parts + p];
            if (!run)
                continue;
            LF_TRY(lf_curve_read(run, curve, err));
            s->figure = curve->figure ? curve->figure : s->figure;
        }
    s->panels = s->figure ? 3 : 2;
    return LF_OK;
}

lf_status lf_curves_write(const lf_run_columns *runs, const char *const *title, const char *path,
                          lf_error *err)
{
    if (runs->columns > LF_PLOT_SERIES || runs->parts > 16)
        return lf_fail(err, LF_BAD_INPUT, "%d columns of %d parts: at most %d of 16", runs->columns,
                       runs->parts, (int)LF_PLOT_SERIES);
    const size_t curves = (size_t)runs->columns * (size_t)runs->parts;
    sheet s = {.runs = runs, .across = runs->parts == 1};
    s.curve = calloc(curves, sizeof *s.curve);
    LF_REQUIRE(s.curve, "out of memory");
    lf_status status = read_curves(&s, err);
    if (status == LF_OK)
        status = draw(&s, title, path, err);
    for (size_t i = 0; i < curves; i++)
        lf_curve_free(&s.curve[i]);
    free(s.curve);
    return status;
}
