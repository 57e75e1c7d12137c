/* growth_picture.c: panels of lines, all through the tiny config. See growth.h. */
#include "bench/bench.h"
#include "bench/growth.h"
#include "eval/plot.h"

enum { WIDTH = 640, HEIGHT = 440, COLUMNS = 2, QUANTITIES = LF_PLOT_SERIES - 1 };

static const float white[3] = {1, 1, 1};

static bool same_panel(const lf_growth_row *a, const lf_growth_row *b)
{
    return strcmp(a->system, b->system) == 0 && strcmp(a->work, b->work) == 0;
}

/* The rows of the panel that rows[first] begins. */
static lf_status draw_panel(const lf_growth_row *rows, int count, int first, lf_image **out,
                            lf_error *err)
{
    const lf_growth_row *of = &rows[first];
    double x[QUANTITIES][LF_GROWTH_SIZES], y[QUANTITIES][LF_GROWTH_SIZES];
    double low = 1, high = 1, linear[2];
    lf_plot_series line[LF_PLOT_SERIES];
    char title[64];
    int n = 0;
    for (int i = first; i < count && n < QUANTITIES; i++) {
        if (!same_panel(&rows[i], of))
            continue;
        for (int k = 0; k < rows[i].count; k++) {
            x[n][k] = rows[i].size[k] / rows[i].size[rows[i].base];
            y[n][k] = 1e3 * rows[i].seconds[k];
            low = fmin(low, x[n][k]);
            high = fmax(high, x[n][k]);
        }
        line[n] = (lf_plot_series){rows[i].quantity, rows[i].count, x[n], y[n], LF_PLOT_BOTH};
        n++;
    }
    const double ends[2] = {low, high}, base = 1e3 * of->seconds[of->base];
    for (int i = 0; i < 2; i++)
        linear[i] = base * ends[i];
    line[n] = (lf_plot_series){"linear", 2, ends, linear, LF_PLOT_LINE};
    snprintf(title, sizeof title, "%s: %s", of->system, of->work);
    return lf_plot_draw(&(lf_plot){.title = title,
                                   .x_label = "times the config's size",
                                   .y_label = "ms",
                                   .log_x = true,
                                   .log_y = true,
                                   .width = WIDTH,
                                   .height = HEIGHT,
                                   .series = n + 1,
                                   .line = line},
                        out, err);
}

lf_status lf_growth_picture(const char *path, const lf_growth_row *rows, int count, lf_error *err)
{
    int first[LF_GROWTH_ROWS], panels = 0;
    for (int i = 0; i < count; i++) {
        bool seen = false;
        for (int k = 0; k < panels; k++)
            seen |= same_panel(&rows[first[k]], &rows[i]);
        if (!seen)
            first[panels++] = i;
    }
    const int down = (panels + COLUMNS - 1) / COLUMNS;
    lf_image *image = lf_image_create(panels > 1 ? COLUMNS * WIDTH : WIDTH, down * HEIGHT, 3);
    lf_image_fill(image, white);
    lf_status status = LF_OK;
    for (int k = 0; k < panels && status == LF_OK; k++) {
        lf_image *panel = NULL;
        status = draw_panel(rows, count, first[k], &panel, err);
        if (status == LF_OK)
            lf_image_paste(image, panel, k % COLUMNS * WIDTH, k / COLUMNS * HEIGHT, 1);
        lf_image_free(panel);
    }
    if (status == LF_OK)
        status = lf_image_write_png(path, image, err);
    lf_image_free(image);
    return status;
}
