/* test_run_pictures.c: tables of pictures, columns of runs, curves of trainings. */
#include "tests/scene_fixture.h"

#include <unistd.h>

#include "eval/curves.h"
#include "eval/picture_grid.h"
#include "eval/run_columns.h"
#include "tests/folder.h"

/* ---- tables of pictures ---- */

static lf_image *flat(int width, int height, float r, float g, float b)
{
    lf_image *image = lf_image_create(width, height, 3);
    lf_image_fill(image, (const float[3]){r, g, b});
    return image;
}

static lf_image *draw(const lf_picture_grid *grid)
{
    lf_error err = {""};
    lf_image *image = NULL;
    if (lf_picture_grid_draw(grid, &image, &err) != LF_OK)
        fail_msg("%s", err.text);
    return image;
}

/* Pixels of about this colour. */
static long count_colour(const lf_image *image, const float colour[3])
{
    long n = 0;
    for (long i = 0; i < (long)image->width * image->height; i++) {
        float off = 0;
        for (int c = 0; c < 3; c++)
            off = fmaxf(off, fabsf(image->pixel[3 * i + c] - colour[c]));
        n += off < 0.01f;
    }
    return n;
}

/* A square picture fills its cell, a flat one keeps its proportions; an empty cell stays white. */
static void pictures_fill_their_cells(void **state)
{
    (void)state;
    const float red[3] = {1, 0, 0}, blue[3] = {0, 0, 1};
    lf_image *square = flat(20, 20, 1, 0, 0), *wide = flat(40, 20, 0, 0, 1);
    const char *const head[] = {"one", "two", "three"};
    const lf_grid_cell cell[] = {{square, NULL}, {wide, "IoU 0.5"}, {NULL, "not run"}};
    const lf_grid_row row[] = {{"first", cell}, {NULL, cell}};
    const lf_picture_grid grid = {60, 3, head, 2, row};
    lf_image *image = draw(&grid);
    assert_int_equal(count_colour(image, red), 2 * 60 * 60);
    assert_int_equal(count_colour(image, blue), 2 * 60 * 30);
    assert_true(image->width >= 180 && image->height >= 120);
    lf_image_free(image);
    lf_image_free(square);
    lf_image_free(wide);
}

/* A long head is broken between its words, and needs no wider cell; dark pixels stand above each
 * column and none beyond it. */
static void heads_stay_in_their_columns(void **state)
{
    (void)state;
    const float black[3] = {0, 0, 0};
    const char *const head[] = {"without-se2-equal-cost", ""};
    const lf_grid_cell cell[2] = {{NULL, NULL}, {NULL, NULL}};
    const lf_grid_row row = {NULL, cell};
    for (int edge = 32; edge <= 144; edge += 16) {
        lf_image *image = draw(&(lf_picture_grid){edge, 2, head, 1, &row});
        long inside = 0;
        for (int y = 0; y < image->height; y++)
            for (int x = 0; x < image->width; x++)
                if (lf_image_at(image, x, y)[0] < 0.5f) {
                    inside++;
                    if (edge >= 12 * 6) /* "without-se2-" in the small letters */
                        assert_true(x < 8 + edge);
                }
        assert_true(inside > 100);
        assert_true(count_colour(image, black) == inside);
        lf_image_free(image);
    }
}

static void bad_grids(void **state)
{
    (void)state;
    lf_error err = {""};
    lf_image *image;
    const char *const head[] = {"a"};
    const lf_grid_cell cell = {NULL, NULL};
    const lf_grid_row row = {NULL, &cell};
    assert_int_equal(lf_picture_grid_draw(&(lf_picture_grid){16, 1, head, 1, &row}, &image, &err),
                     LF_BAD_INPUT);
    assert_int_equal(lf_picture_grid_draw(&(lf_picture_grid){64, 1, head, 0, &row}, &image, &err),
                     LF_BAD_INPUT);
}

/* ---- columns of runs ---- */

static void columns_of_parts(void **state)
{
    (void)state;
    lf_error err = {""};
    lf_run_columns c;
    char *word[] = {"runs/a/,none", "b,runs/c"};
    assert_int_equal(lf_run_columns_parse(2, word, NULL, &c, &err), LF_OK);
    assert_true(c.columns == 2 && c.parts == 2);
    assert_string_equal(c.name[0], "a");
    assert_string_equal(c.name[1], "b");
    assert_string_equal(lf_run_at(&c, 1, 1), "runs/c");
    assert_null(lf_run_at(&c, 0, 1));
    assert_string_equal(lf_run_first(&c, 1), "runs/c");
    lf_run_columns_free(&c);
    assert_int_equal(lf_run_columns_parse(2, word, "x,y z", &c, &err), LF_OK);
    assert_string_equal(c.name[1], "y z");
    lf_run_columns_free(&c);
}

static void bad_columns(void **state)
{
    (void)state;
    lf_error err = {""};
    lf_run_columns c;
    char *empty[] = {"a,,b"}, *uneven[] = {"a,b", "c"}, *nothing[] = {"none,a", "none,b"},
         *one[] = {"a"};
    assert_int_equal(lf_run_columns_parse(0, one, NULL, &c, &err), LF_BAD_INPUT);
    assert_int_equal(lf_run_columns_parse(1, empty, NULL, &c, &err), LF_BAD_INPUT);
    assert_int_equal(lf_run_columns_parse(2, uneven, NULL, &c, &err), LF_BAD_INPUT);
    assert_int_equal(lf_run_columns_parse(2, nothing, NULL, &c, &err), LF_BAD_INPUT);
    assert_int_equal(lf_run_columns_parse(1, one, "x,y", &c, &err), LF_BAD_INPUT);
    assert_int_equal(lf_run_columns_parse(1, one, "", &c, &err), LF_BAD_INPUT);
}

/* ---- curves ---- */

typedef struct run {
    char path[64];
} run;

static int make_run(void **state)
{
    run *r = calloc(1, sizeof *r);
    strcpy(r->path, "/tmp/lf_curves_XXXXXX");
    if (!r || !mkdtemp(r->path))
        return -1;
    *state = r;
    return 0;
}

static int remove_run(void **state)
{
    run *r = *state;
    const int left = remove_tree(r->path);
    free(r);
    return left;
}

static FILE *open_log(const run *r)
{
    char path[160];
    snprintf(path, sizeof path, "%s/metrics.jsonl", r->path);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    return file;
}

/* 80 lines become 40 means of two; a validation every 40 lines; the largest memory. */
static void a_log_becomes_a_curve(void **state)
{
    const run *r = *state;
    lf_error err = {""};
    lf_curve c;
    FILE *file = open_log(r);
    for (int i = 1; i <= 80; i++)
        fprintf(file, "{\"step\": %d, \"seconds\": %d.5, \"loss\": %d, \"peak_rss_mb\": %d%s}\n",
                50 * i, i, i, i == 7 ? 300 : 200, i % 40 ? "" : ", \"val_psnr\": 20.5");
    fclose(file);
    if (lf_curve_read(r->path, &c, &err) != LF_OK)
        fail_msg("%s", err.text);
    assert_int_equal(c.points, 40);
    for (int k = 0; k < 40; k++) {
        assert_close(c.loss[k], 2 * k + 1.5, 1e-12, 0);
        assert_close(c.step[k], 50 * (2 * k + 2), 0, 0);
        assert_close(c.seconds[k], 2 * k + 2.5, 1e-12, 0);
    }
    assert_int_equal(c.checks, 2);
    assert_string_equal(c.figure, "val_psnr");
    assert_true(c.check_step[1] == 4000 && c.check[1] == 20.5);
    assert_true(c.peak_rss_mb == 300 && c.total_seconds == 80.5);
    lf_curve_free(&c);
}

/* A loss that is not finite is null in the log, and a gap here; the rest is drawn. */
static void a_lost_loss_is_a_gap(void **state)
{
    const run *r = *state;
    lf_error err = {""};
    lf_run_columns runs;
    char picture[160], *word[] = {(char *)(uintptr_t)r->path};
    FILE *file = open_log(r);
    for (int i = 1; i <= 5; i++)
        fprintf(file, "{\"step\": %d, \"seconds\": %d, \"loss\": %s, \"peak_rss_mb\": 9}\n", i, i,
                i == 3 ? "null" : "0.5");
    fclose(file);
    snprintf(picture, sizeof picture, "%s/curves.png", r->path);
    assert_int_equal(lf_run_columns_parse(1, word, "one", &runs, &err), LF_OK);
    const char *const title[] = {"chair"};
    if (lf_curves_write(&runs, title, picture, &err) != LF_OK)
        fail_msg("%s", err.text);
    lf_run_columns_free(&runs);
    lf_image *image = NULL;
    assert_int_equal(lf_image_read(picture, &image, &err), LF_OK);
    float colour[3];
    lf_plot_colour(0, colour);
    assert_true(count_colour(image, colour) > 100);
    lf_image_free(image);
}

static void bad_logs(void **state)
{
    const run *r = *state;
    static const char *const bad[][2] = {
        {"", "empty"},
        {"{\"step\": 1,\n", "line 1"},
        {"{\"step\": 1, \"seconds\": 1, \"peak_rss_mb\": 1, \"loss\": 1}\n{\"step\": 2}\n",
         "line 2"},
        {"[]\n", "line 1"}};
    lf_error err = {""};
    lf_curve c;
    assert_int_equal(lf_curve_read(r->path, &c, &err), LF_BAD_INPUT); /* no log at all */
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        FILE *file = open_log(r);
        fputs(bad[i][0], file);
        fclose(file);
        assert_int_equal(lf_curve_read(r->path, &c, &err), LF_BAD_INPUT);
        if (!strstr(err.text, bad[i][1]) || !strstr(err.text, "metrics.jsonl"))
            fail_msg("no \"%s\" in: %s", bad[i][1], err.text);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pictures_fill_their_cells),
        cmocka_unit_test(heads_stay_in_their_columns),
        cmocka_unit_test(bad_grids),
        cmocka_unit_test(columns_of_parts),
        cmocka_unit_test(bad_columns),
        cmocka_unit_test_setup_teardown(a_log_becomes_a_curve, make_run, remove_run),
        cmocka_unit_test_setup_teardown(a_lost_loss_is_a_gap, make_run, remove_run),
        cmocka_unit_test_setup_teardown(bad_logs, make_run, remove_run),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
