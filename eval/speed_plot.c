/* speed_plot.c: four plots of a speed report, and below them what the numbers at their points mean.
 * See speed_report.h. */
#include "eval/speed_report.h"

#include <math.h>

#include "datasets/image.h"
#include "eval/labels.h"
#include "eval/plot.h"

enum { PANEL_WIDTH = 640, PANEL_HEIGHT = 420, COLUMNS = 2, LINE = 22, MARGIN = 12, TEXT = 2 };

static const float white[3] = {1, 1, 1}, black[3] = {0, 0, 0}, grey[3] = {0.55f, 0.55f, 0.55f};

/* One plot: a point for each row but the exact result. */
typedef struct panel {
    const lf_speed_report *report;
    lf_speed_front kind;
    double *x, *y;             /* [rows] */
    double *front_x, *front_y; /* [front], x rising */
    long front;
} panel;

static bool of_error(lf_speed_front kind)
{
    return kind == LF_SECONDS_ERROR || kind == LF_MEMORY_ERROR;
}

/* Where an error of 0 is drawn on a log axis: a tenth of the smallest other one. */
static double floor_of(const lf_speed_report *r)
{
    double least = INFINITY;
    for (long i = LF_SPEED_CONFIG; i < r->rows; i++)
        if (r->row[i].figures.error > 0)
            least = fmin(least, r->row[i].figures.error);
    return isfinite(least) ? least / 10 : 1e-12;
}

static void add_to_front(panel *p, double x, double y)
{
    long at = p->front++;
    for (; at > 0 && p->front_x[at - 1] > x; at--) {
        p->front_x[at] = p->front_x[at - 1];
        p->front_y[at] = p->front_y[at - 1];
    }
    p->front_x[at] = x;
    p->front_y[at] = y;
}

static panel panel_create(const lf_speed_report *r, lf_speed_front kind)
{
    const size_t n = (size_t)r->rows;
    panel p = {r, kind, calloc(4 * n, sizeof(double)), NULL, NULL, NULL, 0};
    LF_REQUIRE(p.x, "out of memory for %ld settings", r->rows);
    p.y = p.x + n;
    p.front_x = p.y + n;
    p.front_y = p.front_x + n;
    const double least = floor_of(r);
    for (long i = LF_SPEED_CONFIG; i < r->rows; i++) {
        const lf_speed_figures *f = &r->row[i].figures;
        p.x[i] = kind == LF_SECONDS_ERROR || kind == LF_SECONDS_METRIC ? f->seconds : f->memory_mb;
        p.y[i] = !of_error(kind) ? f->metric : f->error > 0 ? f->error : least;
        if (r->row[i].front[kind])
            add_to_front(&p, p.x[i], p.y[i]);
    }
    return p;
}

/* A thin line from a point to the nearest place of its text. */
static void draw_leader(lf_image *image, const lf_label *l)
{
    const double to[2] = {fmin(fmax(l->x, l->left), l->left + l->width),
                          fmin(fmax(l->y, l->top), l->top + l->height)};
    const int steps = (int)ceil(fmax(fabs(to[0] - l->x), fabs(to[1] - l->y)));
    for (int k = 1; k < steps; k++) {
        const double t = (double)k / steps;
        memcpy(lf_image_at(image, (int)lround(l->x + t * (to[0] - l->x)),
                           (int)lround(l->y + t * (to[1] - l->y))),
               grey, sizeof grey);
    }
}

/* The number of each row beside its point. */
static lf_status mark(const panel *p, const lf_plot *plot, lf_image *image, lf_error *err)
{
    const lf_label_room room = {0, 0, image->width, image->height, 3.5};
    const long first = LF_SPEED_CONFIG, count = p->report->rows - first;
    lf_label *label = calloc((size_t)count + 1, sizeof *label);
    LF_REQUIRE(label, "out of memory for %ld settings", count);
    lf_status status = LF_OK;
    for (long i = 0; status == LF_OK && i < count; i++) {
        double at[2] = {0, 0};
        status = lf_plot_place(plot, p->x[first + i], p->y[first + i], at, err);
        const int letters = snprintf(NULL, 0, "%ld", first + i);
        label[i] = (lf_label){at[0], at[1], lf_image_text_width(letters, 1) - 1, 7, 0, 0, false};
    }
    if (status == LF_OK)
        lf_labels_place(&room, count, label);
    for (long i = 0; status == LF_OK && i < count; i++) {
        char text[24];
        snprintf(text, sizeof text, "%ld", first + i);
        if (label[i].led)
            draw_leader(image, &label[i]);
        lf_image_text(image, text, label[i].left, label[i].top, 1, black);
    }
    free(label);
    return status;
}

static lf_status panel_draw(const panel *p, lf_image **out, lf_error *err)
{
    const lf_speed_report *r = p->report;
    const long config = LF_SPEED_CONFIG, chosen = r->recommended;
    const lf_plot_series line[] = {
        {"settings", r->rows - config, p->x + config, p->y + config, LF_PLOT_DOTS},
        {"front", p->front, p->front_x, p->front_y, LF_PLOT_BOTH},
        {"as configured", 1, p->x + config, p->y + config, LF_PLOT_DOTS},
        {"recommended", chosen > 0, p->x + chosen, p->y + chosen, LF_PLOT_DOTS}};
    const bool seconds = p->kind == LF_SECONDS_ERROR || p->kind == LF_SECONDS_METRIC;
    const lf_plot plot = {.x_label = seconds ? "seconds of an item" : "memory of an evaluation, MB",
                          .y_label = !of_error(p->kind) ? (r->rendering ? "PSNR, dB" : "IoU")
                                     : r->rendering     ? "RMS colour error"
                                                        : "Chamfer to exact",
                          .log_x = seconds,
                          .log_y = of_error(p->kind),
                          .width = PANEL_WIDTH,
                          .height = PANEL_HEIGHT,
                          .series = 4,
                          .line = line};
    LF_TRY(lf_plot_draw(&plot, out, err));
    const lf_status status = mark(p, &plot, *out, err);
    if (status != LF_OK)
        lf_image_free(*out);
    return status;
}

static lf_status add_panel(const lf_speed_report *r, lf_speed_front kind, lf_image *picture,
                           lf_error *err)
{
    lf_image *image;
    panel p = panel_create(r, kind);
    const lf_status status = panel_draw(&p, &image, err);
    free(p.x);
    LF_TRY(status);
    lf_image_paste(picture, image, (int)kind % COLUMNS * PANEL_WIDTH,
                   (int)kind / COLUMNS * PANEL_HEIGHT, 1);
    lf_image_free(image);
    return LF_OK;
}

/* "7 12 samples", in two columns. */
static void add_names(const lf_speed_report *r, lf_image *picture)
{
    const long lines = (r->rows - LF_SPEED_CONFIG + COLUMNS - 1) / COLUMNS;
    for (long i = LF_SPEED_CONFIG; i < r->rows; i++) {
        char text[LF_SPEED_NAME + 32];
        const int width = PANEL_WIDTH - 2 * MARGIN;
        const long k = i - LF_SPEED_CONFIG;
        snprintf(text, sizeof text, "%2ld %s", i, r->row[i].setting.name);
        const int scale = lf_image_text_width((int)strlen(text), TEXT) > width ? 1 : TEXT;
        text[(size_t)fmin(width / lf_image_text_width(1, scale), sizeof text - 1.0)] = 0;
        lf_image_text(picture, text, MARGIN + (int)(k / lines) * PANEL_WIDTH,
                      2 * PANEL_HEIGHT + MARGIN + (int)(k % lines) * LINE, scale, black);
    }
}

lf_status lf_speed_report_plot(const lf_speed_report *r, const char *png, lf_error *err)
{
    const long lines = (r->rows - LF_SPEED_CONFIG + COLUMNS - 1) / COLUMNS;
    lf_image *picture = lf_image_create(COLUMNS * PANEL_WIDTH,
                                        2 * PANEL_HEIGHT + 2 * MARGIN + (int)lines * LINE, 3);
    lf_image_fill(picture, white);
    lf_status status = LF_OK;
    for (int k = 0; status == LF_OK && k < LF_SPEED_FRONTS; k++)
        status = add_panel(r, (lf_speed_front)k, picture, err);
    add_names(r, picture);
    if (status == LF_OK)
        status = lf_image_write_png(png, picture, err);
    lf_image_free(picture);
    return status;
}
