/* test_file_names.c: no two scenes of a set and no two views of a scene are called the same. */
#include "tests/close.h"

#include <string.h>

#include "eval/file_names.h"

enum { MOST = 8 };

static void check_scenes(long count, const char *const *path, const char *const *expected)
{
    lf_scene_entry entry[MOST] = {{0}};
    const lf_scene_set set = {count, entry};
    char text[MOST][64];
    for (long i = 0; i < count; i++) {
        snprintf(text[i], sizeof text[i], "%s", path[i]);
        entry[i].name = text[i];
    }
    char **name = lf_scene_file_names(&set);
    for (long i = 0; i < count; i++)
        assert_string_equal(name[i], expected[i]);
    lf_file_names_free(count, name);
}

static void scenes(void **state)
{
    (void)state;
    static const char *const path[] = {"/d/a/chair", "/d/b/chair", "fern",   "/e/b/chair",
                                       "d/..",       "built-in 3", "a-chair"};
    static const char *const name[] = {"a-chair", "b-chair",    "fern",     "b-chair-2",
                                       "d-..",    "built-in 3", "a-chair-2"};
    check_scenes(7, path, name);
}

static void check_views(long count, const char *const *name, const char *const *expected)
{
    lf_scene_view view[MOST] = {{0}};
    char text[MOST][64];
    const lf_scene scene = {.views = count, .view = view};
    for (long i = 0; i < count; i++) {
        snprintf(text[i], sizeof text[i], "%s", name[i]);
        view[i].name = text[i];
    }
    char **file = lf_view_file_names(&scene);
    for (long i = 0; i < count; i++)
        assert_string_equal(file[i], expected[i]);
    lf_file_names_free(count, file);
}

static void views(void **state)
{
    (void)state;
    static const char *const name[] = {
        "cam0/1.png", "cam1/1.png", "2023.05.01-1.jpg", "2023.05.01-2.jpg", "./train/r_0", "a.png",
        "a.jpg",      ".b"};
    static const char *const file[] = {"cam0-1",    "cam1-1", "2023.05.01-1", "2023.05.01-2",
                                       "train-r_0", "a",      "a-2",          ".b"};
    check_views(8, name, file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(scenes), cmocka_unit_test(views)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
