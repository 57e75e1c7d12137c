/* plot.c: layout, axes, curves. Inside, coordinates on a log axis are log10 of the values. */
#include "eval/plot.h"

#include <math.h>

enum { GAP = 8, MARK = 24, TICKS = 32 }; /* pixels: space between things; a colour in the legend */

static const float black[3] = {0, 0, 0}, white[3] = {1, 1, 1};
static const float grid_grey[3] = {0.88f, 0.88f, 0.88f}, axis_grey[3] = {0.35f, 0.35f, 0.35f};

void lf_plot_colour(int index, float out[3])
{
    static const float colour[LF_PLOT_SERIES][3] = {{0.05f, 0.33f, 0.68f}, {0.9f, 0.45f, 0.05f},
                                                    {0.1f, 0.58f, 0.38f},  {0.72f, 0.13f, 0.33f},
                                                    {0.4f, 0.7f, 0.93f},   {0.3f, 0.3f, 0.3f}};
    LF_REQUIRE(index >= 0 && index < LF_PLOT_SERIES, "lf_plot_colour: %d", index);
    memcpy(out, colour[index], sizeof colour[index]);
}

/* ---- axes --------------------------------------------------------------------------------- */

typedef struct axis {
    bool log;
    double low, high, step; /* step: of linear ticks */
    int from, to;           /* pixels of low and high */
    int ticks;
    double tick[TICKS];
} axis;

typedef struct layout {
    int width, height, scale; /* of the picture; of the font */
    int legend_rows;
    axis x, y;
} layout;

static bool usable(const axis *a, double value)
{
    return isfinite(value) && (!a->log || value > 0);
}

static double to_axis(const axis *a, double value)
{
    return a->log ? log10(value) : value;
}

static double to_pixel(const axis *a, double at)
{
    return a->from + (at - a->low) / (a->high - a->low) * (a->to - a->from);
}

/* Point i of a series on the axes; false where it is left out. */
static bool point(const layout *l, const lf_plot_series *s, long i, double *x, double *y)
{
    if (!usable(&l->x, s->x[i]) || !usable(&l->y, s->y[i]))
        return false;
    *x = to_axis(&l->x, s->x[i]);
    *y = to_axis(&l->y, s->y[i]);
    return true;
}

static void linear_ticks(axis *a)
{
    const double raw = (a->high - a->low) / 5, power = pow(10, floor(log10(raw)));
    a->step = raw <= power       ? power
              : raw <= 2 * power ? 2 * power
              : raw <= 5 * power ? 5 * power
                                 : 10 * power;
    const double first = floor(a->low / a->step + 1e-9), last = ceil(a->high / a->step - 1e-9);
    a->low = first * a->step;
    a->high = last * a->step;
    for (a->ticks = 0; a->ticks < TICKS && first + a->ticks <= last; a->ticks++)
        a->tick[a->ticks] = (first + a->ticks) * a->step;
}

/* Tick number i of a log axis: 1, 2, 5, 10, ... if fine, else powers of ten, `stride` apart. */
static double log_tick(long i, bool fine, long stride)
{
    if (!fine)
        return (double)(i * stride);
    const long decade = i >= 0 ? i / 3 : (i - 2) / 3;
    static const double part[3] = {0, 0.30102999566398120, 0.69897000433601880};
    return (double)decade + part[i - 3 * decade];
}

static void log_ticks(axis *a)
{
    const double span = a->high - a->low, slack = 1e-9;
    const bool fine = span < 2;
    const long stride = (long)ceil(span / 8);
    long first = (long)floor(a->low) * (fine ? 3 : 1) / (fine ? 1 : stride) - 1;
    while (log_tick(first + 1, fine, stride) <= a->low + slack)
        first++;
    for (a->ticks = 0; a->ticks < TICKS; a->ticks++) {
        a->tick[a->ticks] = log_tick(first + a->ticks, fine, stride);
        if (a->ticks > 0 && a->tick[a->ticks] >= a->high - slack)
            break;
    }
    a->ticks += a->ticks < TICKS;
    a->low = a->tick[0];
    a->high = a->tick[a->ticks - 1];
}

/* Ticks for low ... high, which may be equal. */
static void set_ticks(axis *a)
{
    const double size = fmax(fabs(a->low), fabs(a->high));
    if (!(a->high - a->low > 1e-9 * size)) {
        const double pad = a->log ? 0.3 : size > 0 ? 0.1 * size : 1;
        a->low -= pad;
        a->high += pad;
    }
    if (a->log)
        log_ticks(a);
    else
        linear_ticks(a);
}

/* "0.25", "1000", "1e6". */
static void tick_text(const axis *a, double at, char text[32])
{
    const double value = a->log ? pow(10, at) : at;
    const double most = a->log ? value : fmax(fabs(a->low), fabs(a->high));
    const double least = a->log ? value : a->step;
    if (most < 99999.5 && least > 0.99e-4) {
        const int digits = (int)fmax(0, -floor(log10(least) + 1e-9));
        snprintf(text, 32, "%.*f", digits, fabs(value) < least / 2 ? 0 : value);
        return;
    }
    snprintf(text, 32, "%.3g", fabs(value) < least / 2 ? 0 : value);
    char *e = strchr(text, 'e'), *digit = e ? e + 1 : NULL;
    if (!digit)
        return;
    const int power = atoi(digit);
    snprintf(e, (size_t)(32 - (e - text)), "e%d", power);
}

/* ---- layout ------------------------------------------------------------------------------- */

static int text_width(const layout *l, const char *text)
{
    return lf_image_text_width((int)strlen(text), l->scale) - l->scale;
}

static int line_height(const layout *l)
{
    return 8 * l->scale + GAP;
}

/* Place of the next legend entry: continues the row if it fits, else begins one. */
static void next_entry(const layout *l, const char *name, int *row, int *left, int *after)
{
    const int width = MARK + GAP + text_width(l, name);
    if (*row == 0 || *after + width > l->width - GAP) {
        ++*row;
        *after = l->x.from;
    }
    *left = *after;
    *after += width + 3 * GAP;
}

static int legend_rows(const layout *l, const lf_plot *p)
{
    int row = 0, left = 0, after = 0;
    for (int k = 0; k < p->series; k++)
        if (p->line[k].name)
            next_entry(l, p->line[k].name, &row, &left, &after);
    return row;
}

static bool find_ranges(const lf_plot *p, layout *l)
{
    bool any = false;
    for (int k = 0; k < p->series; k++)
        for (long i = 0; i < p->line[k].count; i++) {
            double x, y;
            if (!point(l, &p->line[k], i, &x, &y))
                continue;
            l->x.low = any ? fmin(l->x.low, x) : x;
            l->x.high = any ? fmax(l->x.high, x) : x;
            l->y.low = any ? fmin(l->y.low, y) : y;
            l->y.high = any ? fmax(l->y.high, y) : y;
            any = true;
        }
    return any;
}

static int widest_tick(const layout *l, const axis *a)
{
    int widest = 0;
    for (int i = 0; i < a->ticks; i++) {
        char text[32];
        tick_text(a, a->tick[i], text);
        const int width = text_width(l, text);
        widest = width > widest ? width : widest;
    }
    return widest;
}

/* Room for the right half of the x axis' last number. */
static int right_margin(const layout *l)
{
    char text[32];
    tick_text(&l->x, l->x.tick[l->x.ticks - 1], text);
    const int needed = text_width(l, text) / 2 + GAP / 2;
    return needed > 3 * GAP ? needed : 3 * GAP;
}

static lf_status lay_out(const lf_plot *p, layout *l, lf_error *err)
{
    *l = (layout){.width = p->width ? p->width : 640, .height = p->height ? p->height : 420};
    if (l->width < 200 || l->width > 4096 || l->height < 200 || l->height > 4096 || p->series < 1 ||
        p->series > LF_PLOT_SERIES)
        return lf_fail(err, LF_BAD_INPUT, "plot: %d x %d pixels (200 to 4096), %d series (1 to %d)",
                       l->width, l->height, p->series, LF_PLOT_SERIES);
    l->scale = l->width < 480 || l->height < 320 ? 1 : 2;
    l->x.log = p->log_x;
    l->y.log = p->log_y;
    if (!find_ranges(p, l))
        return lf_fail(err, LF_BAD_INPUT, "plot: no point to draw; log axes need positive numbers");
    set_ticks(&l->x);
    set_ticks(&l->y);
    l->x.from = GAP + (p->y_label ? line_height(l) : 0) + widest_tick(l, &l->y) + GAP;
    l->x.to = l->width - 1 - right_margin(l);
    l->legend_rows = legend_rows(l, p);
    l->y.to = 2 * GAP + ((p->title != NULL) + l->legend_rows) * line_height(l);
    l->y.from = l->height - 1 - GAP - (1 + (p->x_label != NULL)) * line_height(l);
    if (l->x.to - l->x.from < 64 || l->y.from - l->y.to < 64)
        return lf_fail(err, LF_BAD_INPUT,
                       "plot: %d x %d pixels leave no room for the curves beside the texts",
                       l->width, l->height);
    return LF_OK;
}

/* ---- drawing ------------------------------------------------------------------------------ */

/* Mix colour into a pixel; `share` is cut to 0..1. */
static void blend(lf_image *image, int x, int y, const float colour[3], double share)
{
    if (x < 0 || y < 0 || x >= image->width || y >= image->height || share <= 0)
        return;
    const float s = (float)fmin(1, share);
    float *pixel = lf_image_at(image, x, y);
    for (int c = 0; c < 3; c++)
        pixel[c] += s * (colour[c] - pixel[c]);
}

/* All pixels within `radius` of the segment a b, with soft edges; a dot if a = b. */
static void draw_segment(lf_image *image, const double a[2], const double b[2], double radius,
                         const float colour[3])
{
    const double d[2] = {b[0] - a[0], b[1] - a[1]}, square = d[0] * d[0] + d[1] * d[1];
    const int left = (int)floor(fmin(a[0], b[0]) - radius - 1);
    const int right = (int)ceil(fmax(a[0], b[0]) + radius + 1);
    const int top = (int)floor(fmin(a[1], b[1]) - radius - 1);
    const int bottom = (int)ceil(fmax(a[1], b[1]) + radius + 1);
    for (int y = top; y <= bottom; y++)
        for (int x = left; x <= right; x++) {
            const double u = x - a[0], v = y - a[1];
            const double t = square > 0 ? fmin(1, fmax(0, (u * d[0] + v * d[1]) / square)) : 0;
            blend(image, x, y, colour, radius + 0.5 - hypot(u - t * d[0], v - t * d[1]));
        }
}

static void draw_series(lf_image *image, const layout *l, const lf_plot_series *s,
                        const float colour[3])
{
    double last[2], at[2], x, y;
    bool joined = false;
    for (long i = 0; i < s->count; i++) {
        const bool there = point(l, s, i, &x, &y);
        if (there) {
            at[0] = to_pixel(&l->x, x);
            at[1] = to_pixel(&l->y, y);
            if (joined && s->style != LF_PLOT_DOTS)
                draw_segment(image, last, at, 0.9, colour);
            if (s->style != LF_PLOT_LINE)
                draw_segment(image, at, at, 3.5, colour);
            memcpy(last, at, sizeof last);
        }
        joined = there;
    }
}

static void fill(lf_image *image, int left, int top, int right, int bottom, const float colour[3])
{
    for (int y = top; y <= bottom; y++)
        for (int x = left; x <= right; x++)
            blend(image, x, y, colour, 1);
}

static void draw_grid(lf_image *image, const layout *l)
{
    const axis *x = &l->x, *y = &l->y;
    char text[32];
    int free_from = 0; /* labels of the x axis stand apart */
    for (int i = 0; i < x->ticks; i++) {
        const int at = (int)lround(to_pixel(x, x->tick[i]));
        tick_text(x, x->tick[i], text);
        const int width = text_width(l, text), left = at - width / 2;
        fill(image, at, y->to, at, y->from, grid_grey);
        if (left >= free_from)
            lf_image_text(image, text, left, y->from + GAP, l->scale, black);
        free_from = left >= free_from ? left + width + GAP : free_from;
    }
    for (int i = 0; i < y->ticks; i++) {
        const int at = (int)lround(to_pixel(y, y->tick[i]));
        tick_text(y, y->tick[i], text);
        fill(image, x->from, at, x->to, at, grid_grey);
        lf_image_text(image, text, x->from - GAP - text_width(l, text), at - 7 * l->scale / 2,
                      l->scale, black);
    }
    fill(image, x->from, y->to, x->from, y->from, axis_grey);
    fill(image, x->from, y->from, x->to, y->from, axis_grey);
}

/* Text from bottom to top, its middle at row `middle`, its left border at column GAP. */
static void draw_upwards(lf_image *image, const char *text, int middle, int scale)
{
    const int length = lf_image_text_width((int)strlen(text), scale);
    if (length < 1)
        return;
    lf_image *flat = lf_image_create(length, 8 * scale, 3);
    lf_image_fill(flat, white);
    lf_image_text(flat, text, 0, 0, scale, black);
    for (int y = 0; y < flat->height; y++)
        for (int x = 0; x < length; x++)
            if (lf_image_at(flat, x, y)[0] < 0.5f)
                blend(image, GAP + y, middle + length / 2 - x, black, 1);
    lf_image_free(flat);
}

static void draw_texts(lf_image *image, const layout *l, const lf_plot *p)
{
    const int middle = (l->x.from + l->x.to) / 2;
    if (p->title)
        lf_image_text(image, p->title, middle - text_width(l, p->title) / 2, GAP, l->scale, black);
    if (p->x_label)
        lf_image_text(image, p->x_label, middle - text_width(l, p->x_label) / 2,
                      l->y.from + GAP + line_height(l), l->scale, black);
    if (p->y_label)
        draw_upwards(image, p->y_label, (l->y.from + l->y.to) / 2, l->scale);
}

static void draw_legend(lf_image *image, const layout *l, const lf_plot *p)
{
    int row = 0, left = 0, after = 0;
    for (int k = 0; k < p->series; k++) {
        const lf_plot_series *s = &p->line[k];
        if (!s->name)
            continue;
        float colour[3];
        lf_plot_colour(k, colour);
        next_entry(l, s->name, &row, &left, &after);
        const int top = GAP + ((p->title != NULL) + row - 1) * line_height(l);
        const double y = top + 3.5 * l->scale, ends[2][2] = {{left, y}, {left + MARK, y}};
        const double dot[2] = {left + MARK / 2.0, y};
        if (s->style != LF_PLOT_DOTS)
            draw_segment(image, ends[0], ends[1], 0.9, colour);
        if (s->style != LF_PLOT_LINE)
            draw_segment(image, dot, dot, 3.5, colour);
        lf_image_text(image, s->name, left + MARK + GAP, top, l->scale, black);
    }
}

lf_status lf_plot_draw(const lf_plot *plot, lf_image **out, lf_error *err)
{
    layout l;
    LF_TRY(lay_out(plot, &l, err));
    lf_image *image = lf_image_create(l.width, l.height, 3);
    lf_image_fill(image, white);
    draw_grid(image, &l);
    for (int k = 0; k < plot->series; k++) {
        float colour[3];
        lf_plot_colour(k, colour);
        draw_series(image, &l, &plot->line[k], colour);
    }
    draw_texts(image, &l, plot);
    draw_legend(image, &l, plot);
    *out = image;
    return LF_OK;
}

lf_status lf_plot_write(const char *path, const lf_plot *plot, lf_error *err)
{
    lf_image *image = NULL;
    LF_TRY(lf_plot_draw(plot, &image, err));
    const lf_status status = lf_image_write_png(path, image, err);
    lf_image_free(image);
    return status;
}

lf_status lf_plot_place(const lf_plot *plot, double x, double y, double pixel[2], lf_error *err)
{
    layout l;
    LF_TRY(lay_out(plot, &l, err));
    if (!usable(&l.x, x) || !usable(&l.y, y))
        return lf_fail(err, LF_BAD_INPUT, "plot: (%g, %g) has no place on these axes", x, y);
    pixel[0] = to_pixel(&l.x, to_axis(&l.x, x));
    pixel[1] = to_pixel(&l.y, to_axis(&l.y, y));
    return LF_OK;
}
