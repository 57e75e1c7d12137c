/* test_check_data.c: what elf-eval check-data says about a scene. */
#include "tests/scene_fixture.h"

#include "eval/check_data.h"

/* The text of check-data; the caller frees. */
static char *report_of(const char *path, const char *picture)
{
    char *text = NULL;
    size_t size;
    lf_error err = {"no message"};
    FILE *out = open_memstream(&text, &size);
    assert_non_null(out);
    if (lf_check_data(path, picture, out, &err) != LF_OK)
        fail_msg("%s", err.text);
    fclose(out);
    if (!text)
        fail_msg("no memory");
    return text;
}

static void expect_line(const char *text, const char *line)
{
    if (!strstr(text, line)) {
        fputs(text, stderr);
        fail_msg("'%s' is not there", line);
    }
}

static void test_report(void **state)
{
    char path[512], picture[512];
    int width, height, channels;
    lf_scene *scene = make_scene(false, true);
    place(state, "scene", path);
    place(state, "scene.png", picture);
    assert_int_equal(lf_scene_write(scene, LF_LAYOUT_TRANSFORMS, path, NULL), LF_OK);
    put_picture(state, "scene/images/stray.png", 3, 3);
    char *text = report_of(path, picture);
    expect_line(text, "layout      transforms.json\n");
    expect_line(text, "views       7 train, 0 val, 2 test\n");
    expect_line(text, "width       24 pixels\n");
    expect_line(text, "focal x     31.25 pixels\n");
    expect_line(text, "centre x    0 pixels right of the middle\n");
    expect_line(text, "alpha       9 of 9 views\n");
    expect_line(text, "near        2\nfar         6\ndepths      from the files\n");
    expect_line(text, "left out    1\n");
    expect_line(text, "stray.png: a picture without a frame\n");
    expect_line(text, "epipolar");
    free(text);
    assert_int_equal(lf_image_read_size(picture, &width, &height, &channels, NULL), LF_OK);
    lf_scene_close(scene);
}

static void test_no_scene(void **state)
{
    char path[512], picture[512];
    lf_error err;
    put(state, "empty/readme", "no scene");
    assert_int_equal(
        lf_check_data(place(state, "empty", path), place(state, "no.png", picture), NULL, &err),
        LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "is no scene"));
    assert_int_equal(access(picture, F_OK), -1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_report, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_no_scene, set_up, tear_down),
    };
    return cmocka_run_group_tests_name("check_data", tests, NULL, NULL);
}
