/* test_plot.c: curves, axes and texts are drawn where they should be. */
#include "tests/scene_fixture.h"

#include "eval/plot.h"

static lf_image *draw(const lf_plot *plot)
{
    lf_error err = {""};
    lf_image *image = NULL;
    if (lf_plot_draw(plot, &image, &err) != LF_OK)
        fail_msg("%s", err.text);
    return image;
}

static void place_of(const lf_plot *plot, double x, double y, double pixel[2])
{
    lf_error err = {""};
    if (lf_plot_place(plot, x, y, pixel, &err) != LF_OK)
        fail_msg("%s", err.text);
}

/* At least half of the pixel is of the colour; edges are soft. */
static bool has_colour(const lf_image *image, double x, double y, const float colour[3])
{
    const float *pixel = lf_image_at(image, (int)lround(x), (int)lround(y));
    for (int c = 0; c < 3; c++)
        if (fabsf(pixel[c] - colour[c]) > 0.5f * (1 - colour[c]))
            return false;
    return true;
}

static void is_drawn(const lf_plot *plot, const lf_image *image, double x, double y, int series,
                     bool drawn)
{
    double at[2];
    float colour[3];
    place_of(plot, x, y, at);
    lf_plot_colour(series, colour);
    if (has_colour(image, at[0], at[1], colour) != drawn)
        fail_msg("series %d at (%g, %g), pixel (%g, %g): %s", series, x, y, at[0], at[1],
                 drawn ? "missing" : "drawn");
}

/* A line from (0, 0) to (10, 5) and dots on y = 4: both at their points, the first between too. */
static void points_are_in_place(void **state)
{
    (void)state;
    const double x[] = {0, 5, 10}, y[] = {0, 2.5, 5}, dot_x[] = {1, 3}, dot_y[] = {4, 4};
    const lf_plot_series line[] = {{"line", 3, x, y, LF_PLOT_LINE},
                                   {"dots", 2, dot_x, dot_y, LF_PLOT_DOTS}};
    const lf_plot plot = {.title = "title", .series = 2, .line = line};
    lf_image *image = draw(&plot);
    assert_true(image->width == 640 && image->height == 420 && image->channels == 3);
    for (int i = 0; i <= 20; i++)
        is_drawn(&plot, image, 0.5 * i, 0.25 * i, 0, true);
    is_drawn(&plot, image, 1, 4, 1, true);
    is_drawn(&plot, image, 3, 4, 1, true);
    is_drawn(&plot, image, 2, 4, 1, false);
    is_drawn(&plot, image, 5, 4, 0, false);
    double low[2], high[2], middle[2]; /* the axes are linear, x to the right, y upwards */
    place_of(&plot, 0, 0, low);
    place_of(&plot, 10, 5, high);
    place_of(&plot, 5, 2.5, middle);
    assert_true(high[0] > low[0] + 400 && high[1] < low[1] - 200);
    for (int i = 0; i < 2; i++)
        assert_close(middle[i], (low[i] + high[i]) / 2, 0, 1e-9);
    lf_image_free(image);
}

/* On log axes a power law is straight; the axis of 8 ... 128 goes from 5 to 200. */
static void log_axes(void **state)
{
    (void)state;
    double x[5], y[5], a[2], b[2], c[2];
    for (int i = 0; i < 5; i++) {
        x[i] = 8 << i;
        y[i] = 1e-7 * pow(x[i], 3);
    }
    const lf_plot_series line = {"cubic", 5, x, y, LF_PLOT_BOTH};
    const lf_plot plot = {.log_x = true, .log_y = true, .series = 1, .line = &line};
    lf_image *image = draw(&plot);
    for (int i = 0; i < 5; i++)
        is_drawn(&plot, image, x[i], y[i], 0, true);
    is_drawn(&plot, image, sqrt(8 * 128), 1e-7 * pow(8 * 128, 1.5), 0, true);
    place_of(&plot, 5, y[0], a);
    place_of(&plot, 200, y[0], b);
    place_of(&plot, sqrt(1000), y[0], c);
    assert_close(c[0], (a[0] + b[0]) / 2, 0, 1e-6);
    assert_close(b[0], 640 - 1 - 24, 0, 1e-6); /* where the axis ends */
    lf_image_free(image);
}

/* Numbers that cannot be drawn leave a gap, and one point alone is drawn. */
static void gaps(void **state)
{
    (void)state;
    const double x[] = {1, 2, 3, 4, 5}, y[] = {1, 1, NAN, 1, -1}, one = 3;
    const lf_plot_series line[] = {{NULL, 5, x, y, LF_PLOT_LINE}, {NULL, 1, &one, &one, 0}};
    lf_plot plot = {.log_y = true, .series = 2, .line = line};
    lf_image *image = draw(&plot);
    is_drawn(&plot, image, 1.5, 1, 0, true);
    is_drawn(&plot, image, 2.5, 1, 0, false);
    is_drawn(&plot, image, 3.5, 1, 0, false);
    lf_image_free(image);
    plot = (lf_plot){.series = 1, .line = line + 1, .width = 300, .height = 200};
    image = draw(&plot);
    is_drawn(&plot, image, 3, 3, 0, true);
    lf_image_free(image);
}

/* Ranges of any size have a few ticks and room for their numbers; texts are drawn. */
static void all_ranges_and_texts(void **state)
{
    (void)state;
    for (int power = -12; power <= 12; power++)
        for (int log = 0; log < 2; log++) {
            const double s = pow(10, power), x[] = {s, 1.7 * s, 3e3 * s}, y[] = {s, 3 * s, 2 * s};
            const lf_plot_series line = {"name", 3, x, y, LF_PLOT_BOTH};
            const lf_plot plot = {"title", "samples", "seconds", log, log, 0, 0, 1, &line};
            lf_image *image = draw(&plot);
            is_drawn(&plot, image, 1.7 * s, 3 * s, 0, true);
            long black = 0;
            for (int i = 0; i < 640 * 420; i++)
                black += image->pixel[3 * i] == 0 && image->pixel[3 * i + 1] == 0;
            assert_true(black > 1500);
            lf_image_free(image);
        }
}

/* Twenty-four decades: powers of ten some decades apart, all points inside. */
static void many_decades(void **state)
{
    (void)state;
    const double x[] = {3e-13, 1, 4e11}, y[] = {4e12, 1, 2e-11};
    const lf_plot_series line = {"name", 3, x, y, LF_PLOT_BOTH};
    const lf_plot plot = {.log_x = true, .log_y = true, .series = 1, .line = &line};
    lf_image *image = draw(&plot);
    for (int i = 0; i < 3; i++)
        is_drawn(&plot, image, x[i], y[i], 0, true);
    lf_image_free(image);
}

static void refuse(const lf_plot *plot, const char *word)
{
    lf_error err = {""};
    lf_image *image = NULL;
    assert_int_equal(lf_plot_draw(plot, &image, &err), LF_BAD_INPUT);
    assert_null(image);
    if (!strstr(err.text, word))
        fail_msg("\"%s\" does not say %s", err.text, word);
}

static void bad_plots_are_refused(void **state)
{
    (void)state;
    const double x[] = {-1, NAN}, y[] = {1, 1};
    double pixel[2];
    const lf_plot_series line = {"name", 2, x, y, LF_PLOT_BOTH};
    refuse(&(lf_plot){.series = 1, .line = &line, .log_x = true}, "no point");
    refuse(&(lf_plot){.series = 0, .line = &line}, "0 series");
    refuse(&(lf_plot){.series = 1, .line = &line, .width = 20}, "20 x 420");
    const lf_plot good = {.series = 1, .line = &line};
    assert_int_equal(lf_plot_place(&good, NAN, 1, pixel, NULL), LF_BAD_INPUT);
}

static void file_is_written(void **state)
{
    char path[512];
    place(state, "p.png", path);
    const double x[] = {1, 2}, y[] = {1, 2};
    const lf_plot_series line = {"name", 2, x, y, LF_PLOT_BOTH};
    const lf_plot plot = {.series = 1, .line = &line};
    assert_int_equal(lf_plot_write(path, &plot, NULL), LF_OK);
    int width, height, channels;
    assert_int_equal(lf_image_read_size(path, &width, &height, &channels, NULL), LF_OK);
    assert_true(width == 640 && height == 420);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_are_in_place),
        cmocka_unit_test(log_axes),
        cmocka_unit_test(gaps),
        cmocka_unit_test(all_ranges_and_texts),
        cmocka_unit_test(many_decades),
        cmocka_unit_test(bad_plots_are_refused),
        cmocka_unit_test_setup_teardown(file_is_written, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
