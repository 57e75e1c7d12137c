/* test_render_montage.c: the picture of renderings has its cells where they belong; resizing and
 * colour scales. */
#include "tests/scene_fixture.h"

#include "eval/colour_map.h"
#include "eval/image_resize.h"
#include "eval/render_montage.h"

static lf_image *flat(int width, int height, float r, float g, float b)
{
    lf_image *image = lf_image_create(width, height, 3);
    lf_image_fill(image, (const float[3]){r, g, b});
    return image;
}

static void expect_colour(const lf_image *image, int x, int y, const float colour[3])
{
    for (int c = 0; c < 3; c++)
        assert_close(lf_image_at(image, x, y)[c], colour[c], 0, 0.003); /* 8 bits */
}

/* Constants and, away from the border, ramps stay (to 5e-4 where the new pixels are not whole
 * numbers of old ones or the other way round); the same size is exact. */
static void resizing(void **state)
{
    (void)state;
    lf_image *image = lf_image_create(60, 31, 2);
    for (int y = 0; y < 31; y++)
        for (int x = 0; x < 60; x++) {
            lf_image_at(image, x, y)[0] = 0.3f;
            lf_image_at(image, x, y)[1] = ((float)x + 0.5f) / 60;
        }
    lf_image *same = lf_image_resize(image, 60, 31);
    assert_memory_equal(same->pixel, image->pixel, 60 * 31 * 2 * sizeof(float));
    lf_image_free(same);
    const int sizes[][2] = {{20, 10}, {17, 31}, {240, 64}, {1, 1}};
    for (int i = 0; i < 4; i++) {
        const int w = sizes[i][0], h = sizes[i][1];
        lf_image *fresh = lf_image_resize(image, w, h);
        assert_true(fresh->width == w && fresh->height == h && fresh->channels == 2);
        for (int y = 0; y < h; y++)
            for (int x = 0; x < w; x++) {
                assert_close(lf_image_at(fresh, x, y)[0], 0.3, 1e-6, 0);
                if (w == 1 || (x >= w / 10 && x < w - w / 10 && x >= 1 && x < w - 1))
                    assert_close(lf_image_at(fresh, x, y)[1], (x + 0.5) / w, 0,
                                 w == 17 ? 5e-4 : 1e-6);
            }
        lf_image_free(fresh);
    }
    lf_image_free(image);
    int w, h;
    lf_image_fit(1000, 500, 160, 160, &w, &h);
    assert_true(w == 160 && h == 80);
    lf_image_fit(1, 5000, 160, 160, &w, &h);
    assert_true(w == 1 && h == 160);
}

static double lightness(const float c[3])
{
    double l[3];
    for (int i = 0; i < 3; i++)
        l[i] = (double)c[i] <= 0.04045 ? (double)c[i] / 12.92
                                       : pow(((double)c[i] + 0.055) / 1.055, 2.4);
    const double y = 0.2126 * l[0] + 0.7152 * l[1] + 0.0722 * l[2];
    return y > 0.008856 ? 116 * cbrt(y) - 16 : 903.3 * y;
}

/* Lightness grows all the way, between 0.7 and 1.5 times as fast as on average. */
static void colours_grow_lighter(void **state)
{
    (void)state;
    for (int map = LF_COLOURS_HEAT; map <= LF_COLOURS_SEA; map++) {
        float low[3], high[3];
        lf_colour_at((lf_colour_map)map, -1, low);
        lf_colour_at((lf_colour_map)map, 7, high);
        const double slope = (lightness(high) - lightness(low)) / 8;
        for (int i = 0; i < 8; i++) {
            lf_colour_at((lf_colour_map)map, i / 8.0, low);
            lf_colour_at((lf_colour_map)map, (i + 1) / 8.0, high);
            const double step = (lightness(high) - lightness(low)) / slope;
            assert_true(step > 0.7 && step < 1.5);
        }
    }
    float none[3];
    lf_colour_at(LF_COLOURS_SEA, NAN, none);
    assert_close(none[0], 0.5, 0, 0);
}

static void error_map(void **state)
{
    (void)state;
    lf_image *a = flat(3, 2, 0.5f, 0.5f, 0.5f), *b = flat(3, 2, 0.5f, 0.8f, 0.2f), *out = NULL;
    lf_image *c = flat(2, 2, 0, 0, 0);
    lf_error err;
    assert_int_equal(lf_image_error_map(a, b, &out, NULL), LF_OK);
    for (int i = 0; i < 6; i++)
        assert_close(out->pixel[i], 0.2, 1e-6, 0);
    assert_int_equal(lf_image_error_map(a, c, &out, &err), LF_BAD_INPUT);
    lf_image_free(a);
    lf_image_free(b);
    lf_image_free(c);
    lf_image_free(out);
}

enum { CELL = 64, GAP = 8, BELOW = 14, LINE = 16, TOP = GAP + 2 * LINE - GAP / 2 };

/* Left edge of picture `column`; two source views. */
static int left_of(int column)
{
    return GAP + column * (CELL + GAP) + (column >= 2 ? 2 * GAP : 0);
}

static void cells_are_where_they_belong(void **state)
{
    enum { W = 32, H = 16, HIGH = CELL * H / W };
    char path[512];
    place(state, "m.png", path);
    lf_image *source = flat(W, H, 0.1f, 0.9f, 0.2f), *truth = flat(W, H, 0.5f, 0.5f, 0.5f),
             *rendered = flat(W, H, 0.6f, 0.6f, 0.6f), *out = NULL;
    float depth[H * W];
    for (int i = 0; i < H * W; i++)
        depth[i] = i % W < W / 2 ? 2 : INFINITY;
    const lf_image *const sources[] = {source};
    const lf_render_row rows[2] = {{"box", "view 3", 20, 1, sources, rendered, truth, depth, 2, 6},
                                   {NULL, NULL, NAN, 0, NULL, NULL, truth, NULL, 0, 0}};
    const lf_render_montage_options options = {.cell = CELL, .views = 2, .error_most = 0.2};
    assert_int_equal(lf_render_montage_write(path, 2, rows, &options, NULL), LF_OK);
    assert_int_equal(lf_image_read(path, &out, NULL), LF_OK);
    const float white[3] = {1, 1, 1};
    float middle_heat[3], bright_sea[3];
    lf_colour_at(LF_COLOURS_HEAT, 0.5, middle_heat);
    lf_colour_at(LF_COLOURS_SEA, 1, bright_sea);
    const int y = TOP + HIGH / 2, x = CELL / 2;
    assert_int_equal(out->width, left_of(6));
    expect_colour(out, left_of(0), y, source->pixel);
    expect_colour(out, left_of(1) + x, y, white); /* only one source */
    expect_colour(out, left_of(2) + x, y, rendered->pixel);
    expect_colour(out, left_of(3) + x, TOP, truth->pixel);
    expect_colour(out, left_of(3) + x, TOP + HIGH, white); /* below the picture */
    expect_colour(out, left_of(4) + x, y, middle_heat);
    expect_colour(out, left_of(5) + x - 8, y, bright_sea);
    expect_colour(out, left_of(5) + x + 8, y, white); /* nothing there */
    const int next = y + LINE + HIGH + BELOW;
    expect_colour(out, left_of(2) + x, next, white);
    expect_colour(out, left_of(3) + x, next, truth->pixel);
    expect_colour(out, left_of(4) + x, next, white);
    lf_image_free(source);
    lf_image_free(truth);
    lf_image_free(rendered);
    lf_image_free(out);
}

static void refuse(const char *path, long rows, const lf_render_row *row,
                   const lf_render_montage_options *options, const char *word)
{
    lf_error err = {""};
    assert_int_equal(lf_render_montage_write(path, rows, row, options, &err), LF_BAD_INPUT);
    if (!strstr(err.text, word))
        fail_msg("\"%s\" does not say %s", err.text, word);
}

static void bad_rows_are_refused(void **state)
{
    char path[512];
    place(state, "m.png", path);
    lf_image *a = flat(4, 4, 0, 0, 0), *b = flat(4, 5, 0, 0, 0);
    const float depth[16] = {0};
    lf_render_montage_options options = lf_render_montage_defaults();
    const lf_render_row sizes = {.rendered = a, .truth = b};
    const lf_render_row depths = {.rendered = a, .depth = depth, .near = 2, .far = 1};
    refuse(path, 1, &sizes, &options, "row 0");
    refuse(path, 1, &depths, &options, "near 2");
    refuse(path, 0, &sizes, &options, "0 rows");
    options.cell = 4;
    refuse(path, 1, &depths, &options, "cell 4");
    lf_image_free(a);
    lf_image_free(b);
}

int main(void)
{
#define WITH_FOLDER(test) cmocka_unit_test_setup_teardown(test, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(resizing),        cmocka_unit_test(colours_grow_lighter),
        cmocka_unit_test(error_map),       WITH_FOLDER(cells_are_where_they_belong),
        WITH_FOLDER(bad_rows_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
