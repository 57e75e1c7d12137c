/* test_image.c: pictures to PNG and back, other formats, damaged files, pasting and text. */
#include "tests/close.h"
#include "tests/folder.h"

#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "datasets/image.h"

static int set_up(void **state)
{
    char *root = strdup("/tmp/lf_test_image_XXXXXX");
    *state = root;
    return mkdtemp(root) ? 0 : -1;
}

static int tear_down(void **state)
{
    const int left = remove_tree(*state);
    free(*state);
    return left;
}

static const char *name_of(void **state, const char *name, char out[128])
{
    snprintf(out, 128, "%s/%s", (char *)*state, name);
    return out;
}

static void put(const char *path, const void *bytes, size_t size)
{
    FILE *f = fopen(path, "wb");
    assert_non_null(f);
    assert_int_equal(fwrite(bytes, 1, size, f), size);
    fclose(f);
}

static lf_image *read_good(const char *path)
{
    lf_image *image = NULL;
    lf_error err = {"no message"};
    if (lf_image_read(path, &image, &err) != LF_OK)
        fail_msg("%s", err.text);
    return image;
}

static void expect_bad(const char *path, const char *message)
{
    lf_image *image = NULL;
    lf_error err = {"no message"};
    int w = -1, h = -1, c = -1;
    assert_int_equal(lf_image_read(path, &image, &err), LF_BAD_INPUT);
    assert_null(image);
    if (!strstr(err.text, message) || !strstr(err.text, path))
        fail_msg("message '%s' lacks '%s'", err.text, message);
    if (lf_image_read_size(path, &w, &h, &c, &err) != LF_OK)
        assert_true(w == -1 && h == -1 && c == -1);
}

/* Values of multiples of 1/255 survive exactly, for every number of channels. */
static void test_round_trip(void **state)
{
    char path[128];
    for (int channels = 1; channels <= 4; channels++) {
        lf_image *image = lf_image_create(7, 5, channels), *back;
        lf_error err = {""};
        int w, h, c;
        for (int i = 0; i < 35 * channels; i++)
            image->pixel[i] = (float)(i * 37 % 256) / 255;
        name_of(state, "round.png", path);
        assert_int_equal(lf_image_write_png(path, image, &err), LF_OK);
        assert_int_equal(lf_image_read_size(path, &w, &h, &c, &err), LF_OK);
        assert_true(w == 7 && h == 5 && c == channels);
        back = read_good(path);
        assert_true(back->width == 7 && back->height == 5 && back->channels == channels);
        for (int i = 0; i < 35 * channels; i++)
            assert_close(back->pixel[i], image->pixel[i], 0, 1e-6);
        lf_image_free(image);
        lf_image_free(back);
    }
}

static void test_values_are_cut(void **state)
{
    char path[128];
    lf_image *image = lf_image_create(2, 2, 1);
    const float values[4] = {-3, 7, NAN, 0.5f}, expected[4] = {0, 1, 0, 128.0f / 255};
    memcpy(image->pixel, values, sizeof values);
    assert_int_equal(lf_image_write_png(name_of(state, "cut.png", path), image, NULL), LF_OK);
    lf_image *back = read_good(path);
    for (int i = 0; i < 4; i++)
        assert_close(back->pixel[i], expected[i], 0, 1e-6);
    lf_image_free(image);
    lf_image_free(back);
}

/* Binary PGM of 16 bits (most significant byte first), PPM of 8. */
static void test_other_formats(void **state)
{
    char path[128];
    static const char pgm[] = "P5\n2 1\n65535\n\x80\x00\xff\xff",
                      ppm[] = "P6\n1 1\n255\n\xff\x33\x00";
    put(name_of(state, "deep.pgm", path), pgm, sizeof pgm - 1);
    lf_image *image = read_good(path);
    assert_true(image->width == 2 && image->height == 1);
    assert_close(image->pixel[0], 32768.0 / 65535, 1e-4, 0);
    assert_close(image->pixel[image->channels], 1, 1e-4, 0);
    lf_image_free(image);
    put(name_of(state, "colour.ppm", path), ppm, sizeof ppm - 1);
    image = read_good(path);
    assert_int_equal(image->channels, 3);
    assert_close(image->pixel[1], 0.2, 1e-6, 0);
    lf_image_free(image);
}

/* A small TIFF, little-endian, 8 bits, no compression: entries by tag, then the pixels. `alpha`: 0
 * no such entry, 1 colours are multiplied by it, 2 they are not. */
static size_t tiff_alpha(char *out, int width, int height, int channels, int photometric,
                         int orientation, int alpha)
{
    const int entries[][3] = {/* tag, type (3 short, 4 long), value */
                              {256, 3, width},       {257, 3, height},
                              {258, 3, 8},           {259, 3, 1},
                              {262, 3, photometric}, {273, 4, 0},
                              {274, 3, orientation}, {277, 3, channels},
                              {278, 3, height},      {279, 4, width * height * channels},
                              {338, 3, alpha}};
    const int count = alpha ? 11 : 10;
    const int data = 8 + 2 + 12 * count + 4;
    memset(out, 0, (size_t)data);
    memcpy(out, "II*\0\10\0\0\0", 8);
    out[8] = (char)count;
    for (int i = 0; i < count; i++) {
        char *e = out + 10 + 12 * i;
        const int value = entries[i][0] == 273 ? data : entries[i][2];
        e[0] = (char)entries[i][0];
        e[1] = (char)(entries[i][0] >> 8);
        e[2] = (char)entries[i][1];
        e[4] = 1;
        for (int b = 0; b < 4; b++)
            e[8 + b] = (char)(value >> 8 * b);
    }
    for (int i = 0; i < width * height * channels; i++)
        out[data + i] = (char)(i * 20);
    return (size_t)(data + width * height * channels);
}

static size_t tiff(char *out, int width, int height, int channels, int photometric, int orientation)
{
    return tiff_alpha(out, width, height, channels, photometric, orientation, 0);
}

/* Colours that a TIFF stores multiplied by alpha are divided. */
static void test_alpha_is_straight(void **state)
{
    char path[128], bytes[512];
    static const double divided[4] = {0, 20.0 / 60, 40.0 / 60, 60.0 / 255};
    for (int alpha = 1; alpha <= 2; alpha++) {
        put(name_of(state, "alpha.tif", path), bytes, tiff_alpha(bytes, 1, 1, 4, 2, 1, alpha));
        lf_image *image = read_good(path);
        assert_int_equal(image->channels, 4);
        for (int c = 0; c < 4; c++)
            assert_close(image->pixel[c], alpha == 1 ? divided[c] : c * 20.0 / 255, 0, 1e-6);
        lf_image_free(image);
    }
}

/* Orientation 6: the stored first row is the right column of the upright picture. */
static void test_orientation(void **state)
{
    char path[128], bytes[512];
    int w, h, c;
    put(name_of(state, "turned.tif", path), bytes, tiff(bytes, 3, 2, 1, 1, 6));
    lf_image *image = read_good(path);
    assert_true(image->width == 2 && image->height == 3);
    static const int stored[6] = {3, 0, 4, 1, 5, 2}; /* row by row, upright */
    for (int i = 0; i < 6; i++)
        assert_close(image->pixel[i], stored[i] * 20.0 / 255, 0, 1e-6);
    assert_int_equal(lf_image_read_size(path, &w, &h, &c, NULL), LF_OK);
    assert_true(w == 2 && h == 3 && c == 1);
    lf_image_free(image);
    put(path, bytes, tiff(bytes, 3, 2, 1, 1, 1));
    image = read_good(path);
    assert_true(image->width == 3 && image->height == 2);
    lf_image_free(image);
}

static void test_bad_files(void **state)
{
    char path[128], bytes[4096];
    expect_bad(name_of(state, "gone.png", path), "cannot be opened: No such file");
    put(name_of(state, "empty.png", path), "", 0);
    expect_bad(path, "the file is empty");
    put(name_of(state, "words.png", path), "these are words", 15);
    expect_bad(path, "is not a picture");
    put(name_of(state, "words.abc", path), "these are words", 15);
    expect_bad(path, "is not a picture");
    expect_bad(*state, "is not a regular file");
    put(name_of(state, "zero.ppm", path), "P6\n0 4\n255\n", 11);
    expect_bad(path, "");
    put(name_of(state, "wide.ppm", path), "P6\n99999 1\n255\n", 15);
    expect_bad(path, "the picture is 99999 x 1, allowed are 1 to 32768");
    put(name_of(state, "five.tif", path), bytes, tiff(bytes, 3, 2, 5, 1, 1));
    expect_bad(path, "");
    static const char pfm[] = "Pf\n1 1\n-1.0\n\0\0\xc0\x7f"; /* a NaN */
    put(name_of(state, "nan.pfm", path), pfm, sizeof pfm - 1);
    expect_bad(path, "pixel 0 has the value");
}

/* Every prefix of a PNG is refused or, at worst, read; never worse. */
static void test_cut_png(void **state)
{
    char path[128], bytes[4096];
    lf_image *image = lf_image_create(16, 16, 3);
    for (int i = 0; i < 768; i++)
        image->pixel[i] = (float)(i * 7919 % 256) / 255;
    assert_int_equal(lf_image_write_png(name_of(state, "whole.png", path), image, NULL), LF_OK);
    lf_image_free(image);
    FILE *f = fopen(path, "rb");
    const size_t size = fread(bytes, 1, sizeof bytes, f);
    fclose(f);
    name_of(state, "cut.png", path);
    for (size_t n = 1; n + 60 < size; n += 13) {
        put(path, bytes, n);
        lf_error err = {""};
        image = NULL;
        assert_int_equal(lf_image_read(path, &image, &err), LF_BAD_INPUT);
        assert_null(image);
        assert_non_null(strstr(err.text, path));
    }
}

static void test_bad_writes(void **state)
{
    char path[128];
    lf_error err = {""};
    lf_image *image = lf_image_create(1, 1, 3);
    assert_int_equal(lf_image_write_png(name_of(state, "a.jpg", path), image, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "must end in .png"));
    assert_int_equal(lf_image_write_png("/nowhere/at/all.png", image, &err), LF_FAILED);
    assert_non_null(strstr(err.text, "/nowhere/at/all.png"));
    name_of(state, "taken.png", path);
    mkdir(path, 0700); /* a folder of that name: the rename fails and the temporary file goes */
    assert_int_equal(lf_image_write_png(path, image, &err), LF_FAILED);
    snprintf(path, sizeof path, "%s/taken.png.part.%ld", (char *)*state, (long)getpid());
    assert_int_not_equal(access(path, F_OK), 0);
    lf_image_free(image);
}

static void test_over_white(void **state)
{
    (void)state;
    lf_image *rgba = lf_image_create(1, 1, 4), *grey = lf_image_create(1, 1, 2);
    const float colour[4] = {1, 0.5f, 0, 0.25f}, half[2] = {0.2f, 0.5f};
    lf_image_fill(rgba, colour);
    lf_image_fill(grey, half);
    lf_image *a = lf_image_over_white(rgba), *b = lf_image_over_white(grey);
    assert_close(a->pixel[0], 1, 0, 1e-6);
    assert_close(a->pixel[1], 0.875, 0, 1e-6);
    assert_close(a->pixel[2], 0.75, 0, 1e-6);
    for (int i = 0; i < 3; i++)
        assert_close(b->pixel[i], 0.6, 0, 1e-6);
    lf_image_free(rgba);
    lf_image_free(grey);
    lf_image_free(a);
    lf_image_free(b);
}

static void test_paste(void **state)
{
    (void)state;
    lf_image *into = lf_image_create(6, 5, 3), *from = lf_image_create(2, 2, 1);
    const float values[4] = {0.1f, 0.2f, 0.3f, 0.4f};
    memcpy(from->pixel, values, sizeof values);
    lf_image_paste(into, from, 1, 1, 2);
    assert_close(lf_image_at(into, 1, 1)[0], 0.1, 1e-6, 0);
    assert_close(lf_image_at(into, 2, 2)[2], 0.1, 1e-6, 0);
    assert_close(lf_image_at(into, 3, 1)[1], 0.2, 1e-6, 0);
    assert_close(lf_image_at(into, 4, 4)[0], 0.4, 1e-6, 0);
    assert_close(lf_image_at(into, 5, 4)[0], 0, 0, 0);
    lf_image_paste(into, from, -1, -1, 1); /* all but one pixel is cut off */
    assert_close(lf_image_at(into, 0, 0)[0], 0.4, 1e-6, 0);
    lf_image_paste(into, from, 5, 4, 3);
    assert_close(lf_image_at(into, 5, 4)[0], 0.1, 1e-6, 0);
    lf_image_free(into);
    lf_image_free(from);
}

/* Letters differ, a space has no dot, and text may leave the picture on any side. */
static void test_text(void **state)
{
    (void)state;
    static const char all[] =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789.,:;/-+_%()=<>#'!? ";
    enum { letters = sizeof all - 1 };
    const float ink = 1;
    lf_image *image = lf_image_create(6 * letters, 8, 1);
    assert_int_equal(lf_image_text_width(letters, 1), 6 * letters);
    lf_image_text(image, all, 0, 0, 1, &ink);
    char shape[letters][36];
    for (int k = 0; k < letters; k++)
        for (int i = 0; i < 35; i++) {
            shape[k][i] = *lf_image_at(image, 6 * k + i % 5, i / 5) > 0;
            shape[k][35] = 0;
        }
    for (int k = 0; k < letters; k++)
        for (int l = 0; l < k; l++)
            assert_memory_not_equal(shape[k], shape[l], 35);
    static const char nothing[35];
    assert_memory_equal(shape[letters - 1], nothing, 35);
    lf_image_text(image, "A\x80\n~", -3, -2, 3, &ink);
    lf_image_text(image, "A", 6 * letters - 2, 5, 3, &ink);
    lf_image_free(image);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_values_are_cut),
        cmocka_unit_test(test_other_formats),
        cmocka_unit_test(test_orientation),
        cmocka_unit_test(test_bad_files),
        cmocka_unit_test(test_cut_png),
        cmocka_unit_test(test_bad_writes),
        cmocka_unit_test(test_over_white),
        cmocka_unit_test(test_paste),
        cmocka_unit_test(test_text),
        cmocka_unit_test(test_alpha_is_straight),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
