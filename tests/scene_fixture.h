/* scene_fixture.h: a temporary folder, files in it, and a small scene for the tests of scenes. */
#ifndef LF_TESTS_SCENE_FIXTURE_H
#define LF_TESTS_SCENE_FIXTURE_H

#include "tests/close.h"
#include "tests/folder.h"

#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "datasets/image.h"
#include "datasets/scene.h"

static inline int set_up(void **state)
{
    char *root = strdup("/tmp/lf_test_scene_XXXXXX");
    *state = root;
    return mkdtemp(root) ? 0 : -1;
}

static inline int tear_down(void **state)
{
    const int left = remove_tree(*state);
    free(*state);
    return left;
}

/* <root>/<name>, its folders made; in a buffer of the caller. */
static inline const char *place(void **state, const char *name, char path[512])
{
    snprintf(path, 512, "%s/%s", (char *)*state, name);
    for (char *slash = path + strlen(*state) + 1; (slash = strchr(slash, '/')); slash++) {
        *slash = 0;
        mkdir(path, 0700);
        *slash = '/';
    }
    return path;
}

static inline void put_bytes(void **state, const char *name, const void *bytes, size_t size)
{
    char path[512];
    FILE *f = fopen(place(state, name, path), "wb");
    assert_non_null(f);
    assert_int_equal(fwrite(bytes, 1, size, f), size);
    fclose(f);
}

static inline void put(void **state, const char *name, const char *text)
{
    put_bytes(state, name, text, strlen(text));
}

static inline void put_picture(void **state, const char *name, int width, int height)
{
    char path[512];
    lf_image *image = lf_image_create(width, height, 3);
    assert_int_equal(lf_image_write_png(place(state, name, path), image, NULL), LF_OK);
    lf_image_free(image);
}

static inline lf_scene *open_with(void **state, const char *name, const lf_scene_options *options)
{
    char path[512];
    lf_scene *scene = NULL;
    lf_error err = {"no message"};
    if (lf_scene_open(place(state, name, path), options, &scene, &err) != LF_OK)
        fail_msg("%s", err.text);
    return scene;
}

static inline lf_scene *open_good(void **state, const char *name)
{
    const lf_scene_options options = lf_scene_defaults();
    return open_with(state, name, &options);
}

static inline void expect_bad(void **state, const char *name, const char *message)
{
    char path[512];
    lf_scene *scene = NULL;
    lf_error err = {"no message"};
    const lf_scene_options options = lf_scene_defaults();
    assert_int_equal(lf_scene_open(place(state, name, path), &options, &scene, &err), LF_BAD_INPUT);
    assert_null(scene);
    if (!strstr(err.text, message))
        fail_msg("'%s' does not say '%s'", err.text, message);
}

enum { FIXTURE_VIEWS = 9, FIXTURE_WIDTH = 24, FIXTURE_HEIGHT = 16 };

/* Cameras on a ring of radius 3 to 4 looking near the origin, each rolled; views 0 and 8 are test.
 * `free_lens`: two focal lengths, own principal points. */
static inline lf_scene *make_scene(bool free_lens, bool alpha)
{
    enum { PIXELS = FIXTURE_WIDTH * FIXTURE_HEIGHT };
    lf_scene *scene = lf_scene_create("fixture");
    for (int v = 0; v < FIXTURE_VIEWS; v++) {
        lf_stream s = lf_stream_at(7, LF_RANDOM_TEST, 0, (uint64_t)v);
        const double angle = 0.7 * v, radius = 3 + lf_uniform(&s);
        const double centre[3] = {radius * cos(angle), 2 * lf_uniform(&s) - 1, radius * sin(angle)};
        const double target[3] = {0.1 * lf_uniform(&s), 0, 0.1 * lf_uniform(&s)};
        lf_camera c = lf_camera_look_at(centre, target, 0.3, 16);
        c = lf_camera_roll(&c, lf_uniform(&s));
        c.width = FIXTURE_WIDTH;
        c.height = FIXTURE_HEIGHT;
        c.fx = free_lens ? 30 + v : 31.25;
        c.fy = free_lens ? 29.5 + v : 31.25;
        c.cx = free_lens ? 10.3 + 0.1 * v : 0.5 * FIXTURE_WIDTH - 0.5;
        c.cy = free_lens ? 8.1 : 0.5 * FIXTURE_HEIGHT - 0.5;
        uint8_t rgb[PIXELS * 3], a[PIXELS];
        for (int i = 0; i < PIXELS; i++) {
            a[i] = (uint8_t)(i % 3 == 0 ? 255 : i % 3 == 1 ? 0 : 128);
            for (int k = 0; k < 3; k++)
                rgb[3 * i + k] =
                    (uint8_t)(alpha && a[i] == 0 ? 255 : 128 + (i * (k + 1) + v) % 128);
        }
        char name[16];
        snprintf(name, sizeof name, "view%d", v);
        lf_scene_add(scene, name, &c, 2, 6, v % 8 == 0 ? LF_SPLIT_TEST : LF_SPLIT_TRAIN, rgb,
                     alpha ? a : NULL);
    }
    return scene;
}

#endif
