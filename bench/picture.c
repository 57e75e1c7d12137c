/* picture.c: see picture.h. */
#include "bench/picture.h"

#include "eval/plot.h"

enum { ROOFS = 2, GROUPS = 4, PANEL = LF_PICTURE_HEIGHT / 2 };

static const char *const groups[GROUPS] = {"kernels", "networks", "steps", "paper"};
static const float black[3] = {0, 0, 0}, white[3] = {1, 1, 1};

/* The points of a panel, by group. */
typedef struct panel {
    const lf_bench_result **of; /* [count] */
    double *x, *y;
    long first[GROUPS + 1];
} panel;

typedef bool (*place_fn)(const lf_bench_result *r, double *x, double *y);

/* Flops a byte and GFLOP/s. */
static bool on_roofline(const lf_bench_result *r, double *x, double *y)
{
    *x = r->flop / r->bytes;
    *y = 1e-9 * r->flop / r->seconds;
    return r->flop > 0 && r->bytes > 0;
}

/* Milliseconds and largest error; no error at all has no place on a logarithmic axis. */
static bool time_and_error(const lf_bench_result *r, double *x, double *y)
{
    const lf_output_error *worst = lf_bench_worst(r);
    *x = 1e3 * r->seconds;
    *y = worst ? worst->largest : 0;
    return *y > 0;
}

static panel gather(const lf_bench_result *results, int count, place_fn place)
{
    panel p = {lf_bench_room(count + 1, sizeof *p.of),
               lf_bench_room(count + 1, sizeof *p.x),
               lf_bench_room(count + 1, sizeof *p.y),
               {0}};
    for (int g = 0; g < GROUPS; g++) {
        long n = p.first[g];
        for (int i = 0; i < count; i++)
            if (strcmp(results[i].group, groups[g]) == 0 && place(&results[i], &p.x[n], &p.y[n]))
                p.of[n++] = &results[i];
        p.first[g + 1] = n;
    }
    return p;
}

static void release(panel *p)
{
    free(p->of);
    free(p->x);
    free(p->y);
}

/* Appends a series for each group that has points; returns the number of series. */
static int add_groups(const panel *p, lf_plot_series *line, int series)
{
    for (int g = 0; g < GROUPS; g++) {
        const long from = p->first[g], n = p->first[g + 1] - from;
        line[series + g] =
            (lf_plot_series){n ? groups[g] : NULL, n, p->x + from, p->y + from, LF_PLOT_DOTS};
    }
    return series + GROUPS;
}

/* ---- labels ---------------------------------------------------------------------------------- */

typedef struct box {
    double left, top, right, bottom;
} box;

static bool meets(const box *a, const box *b)
{
    return a->left < b->right && b->left < a->right && a->top < b->bottom && b->top < a->bottom;
}

static void draw_line(lf_image *image, double x0, double y0, double x1, double y1)
{
    const long steps = (long)ceil(fmax(fabs(x1 - x0), fabs(y1 - y0))) + 1;
    for (long i = 0; i <= steps; i++) {
        const double t = (double)i / (double)steps;
        float *pixel =
            lf_image_at(image, (int)lround(x0 + t * (x1 - x0)), (int)lround(y0 + t * (y1 - y0)));
        for (int c = 0; c < 3; c++)
            pixel[c] = 0.6f;
    }
}

/* A place for a text of that size near (x, y) that meets no taken box: round it, farther and
 * farther. False: there is none inside the image. */
static bool find_place(const lf_image *image, const box *taken, long count, double x, double y,
                       double width, double height, box *out)
{
    for (double radius = 8; radius < PANEL / 2; radius += 6)
        for (int k = 0; k < 16; k++) {
            const double angle = 6.283185307179586 * k / 16;
            const double u = x + radius * cos(angle), v = y + radius * sin(angle);
            const double left = u - (1 - cos(angle)) / 2 * width;
            const double top = v - (1 - sin(angle)) / 2 * height;
            *out = (box){left, top, left + width, top + height};
            bool free_place = left >= 1 && top >= 1 && out->right < image->width - 1 &&
                              out->bottom < image->height - 1;
            for (long i = 0; free_place && i < count; i++)
                free_place = !meets(out, &taken[i]);
            if (free_place)
                return true;
        }
    return false;
}

/* The name of each point beside it, with a line to it where it had to go far. */
static lf_status label(lf_image *image, const lf_plot *plot, const panel *p, lf_error *err)
{
    const long count = p->first[GROUPS];
    const int scale = count > 16 ? 1 : 2;
    box *taken = lf_bench_room(2 * count + 1, sizeof *taken);
    for (long i = 0; i < count; i++) {
        double at[2];
        const lf_status status = lf_plot_place(plot, p->x[i], p->y[i], at, err);
        if (status != LF_OK) {
            free(taken);
            return status;
        }
        taken[i] = (box){at[0] - 5, at[1] - 5, at[0] + 5, at[1] + 5};
    }
    for (long i = 0; i < count; i++) {
        const char *name = p->of[i]->of->name;
        const double x = (taken[i].left + taken[i].right) / 2;
        const double y = (taken[i].top + taken[i].bottom) / 2;
        const double width = lf_image_text_width((int)strlen(name), scale), height = 8 * scale;
        box *b = &taken[count + i];
        if (!find_place(image, taken, count + i, x, y, width, height, b)) {
            *b = (box){0};
            continue;
        }
        const double u = fmin(fmax(x, b->left), b->right), v = fmin(fmax(y, b->top), b->bottom);
        if (hypot(u - x, v - y) > 12)
            draw_line(image, x, y, u, v);
        lf_image_text(image, name, (int)lround(b->left), (int)lround(b->top), scale, black);
    }
    free(taken);
    return LF_OK;
}

/* ---- panels ---------------------------------------------------------------------------------- */

static lf_status draw_panel(lf_image *into, int row, lf_plot *plot, const panel *p, lf_error *err)
{
    lf_image *image = NULL;
    plot->log_x = plot->log_y = true;
    plot->width = LF_PICTURE_WIDTH;
    plot->height = PANEL;
    LF_TRY(lf_plot_draw(plot, &image, err));
    const lf_status status = label(image, plot, p, err);
    lf_image_paste(into, image, 0, row, 1);
    lf_image_free(image);
    return status;
}

/* GFLOP/s below one bandwidth from `low` to `high` flops a byte: a slope, then flat. */
static void roof(double fma, double bandwidth, double low, double high, double x[3], double y[3])
{
    const double ridge = fmin(fmax(fma / bandwidth, low), high);
    const double at[3] = {low, ridge, high};
    for (int i = 0; i < 3; i++) {
        x[i] = at[i];
        y[i] = 1e-9 * fmin(fma, at[i] * bandwidth);
    }
}

static lf_status draw_roofline(lf_image *into, const lf_bench_result *results, int count,
                               const lf_seen_limits *seen, lf_error *err)
{
    const double bandwidths[ROOFS] = {seen->bandwidth[lf_foot_of(LF_BYTES_OF_MEMORY)],
                                      seen->bandwidth[lf_foot_of(LF_BYTES_OF_CACHES)]};
    static const char *const kind[ROOFS] = {"memory", "1 MiB in caches"};
    lf_plot_series line[ROOFS + GROUPS];
    char name[ROOFS][64], title[64];
    double x[ROOFS][3], y[ROOFS][3], low = INFINITY, high = 0;
    panel p = gather(results, count, on_roofline);
    for (long i = 0; i < p.first[GROUPS]; i++) {
        low = fmin(low, p.x[i] / 2);
        high = fmax(high, p.x[i] * 2);
    }
    for (int k = 0; k < ROOFS; k++) {
        low = fmin(low, seen->fma / bandwidths[k] / 4); /* the slope is seen */
        high = fmax(high, seen->fma / bandwidths[k] * 4);
    }
    for (int k = 0; k < ROOFS; k++) {
        roof(seen->fma, bandwidths[k], low, high, x[k], y[k]);
        snprintf(name[k], sizeof name[k], "%s: %.0f GB/s", kind[k], 1e-9 * bandwidths[k]);
        line[k] = (lf_plot_series){name[k], 3, x[k], y[k], LF_PLOT_LINE};
    }
    snprintf(title, sizeof title, "multiply-adds: %.0f GFLOP/s", 1e-9 * seen->fma);
    lf_plot plot = {.title = title,
                    .x_label = "flop / byte",
                    .y_label = "GFLOP/s",
                    .series = add_groups(&p, line, ROOFS),
                    .line = line};
    const lf_status status = draw_panel(into, 0, &plot, &p, err);
    release(&p);
    return status;
}

static lf_status draw_errors(lf_image *into, const lf_bench_result *results, int count,
                             lf_error *err)
{
    lf_plot_series line[ROOFS + GROUPS] = {{0}}; /* no roofs, but the groups' colours of above */
    panel p = gather(results, count, time_and_error);
    lf_status status = LF_OK;
    if (p.first[GROUPS] > 0) {
        lf_plot plot = {.title = "time and error",
                        .x_label = "ms",
                        .y_label = "largest difference to double / largest value",
                        .series = add_groups(&p, line, ROOFS),
                        .line = line};
        status = draw_panel(into, PANEL, &plot, &p, err);
    } else
        lf_image_text(into, "no error was measured", 24, PANEL + 24, 2, black);
    release(&p);
    return status;
}

lf_status lf_bench_picture(const char *path, const lf_bench_result *results, int count,
                           const lf_seen_limits *seen, lf_error *err)
{
    panel p = gather(results, count, on_roofline);
    const long points = p.first[GROUPS];
    release(&p);
    if (points == 0 || seen->samples[lf_foot_of(LF_BYTES_OF_MEMORY)] == 0 ||
        seen->samples[lf_foot_of(LF_BYTES_OF_CACHES)] == 0)
        return lf_fail(err, LF_BAD_INPUT, "%s: no case to draw: name one that counts operations",
                       path);
    lf_image *image = lf_image_create(LF_PICTURE_WIDTH, LF_PICTURE_HEIGHT, 3);
    lf_image_fill(image, white);
    lf_status status = draw_roofline(image, results, count, seen, err);
    if (status == LF_OK)
        status = draw_errors(image, results, count, err);
    if (status == LF_OK)
        status = lf_image_write_png(path, image, err);
    lf_image_free(image);
    return status;
}
