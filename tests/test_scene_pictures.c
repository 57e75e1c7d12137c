/* test_scene_pictures.c: scenes whose pictures are EXR or PNG of 16 bits, with alpha. */
#include "tests/picture_bytes.h"
#include "tests/scene_fixture.h"

enum { SIDE = 16, PIXELS = SIDE * SIDE };

/* Two views of a transforms.json, their pictures <name>0 and <name>1. */
static void put_transforms(void **state, const char *folder, const char *ending)
{
    char name[64], text[2048];
    snprintf(name, sizeof name, "%s/transforms.json", folder);
    snprintf(text, sizeof text,
             "{\"fl_x\": 20, \"fl_y\": 20, \"cx\": 8, \"cy\": 8, \"w\": 16, \"h\": 16,\n"
             "\"near\": 1, \"far\": 5, \"frames\": [\n"
             "{\"file_path\": \"0.%s\", \"transform_matrix\": "
             "[[1,0,0,0],[0,1,0,0],[0,0,1,3],[0,0,0,1]]},\n"
             "{\"file_path\": \"1.%s\", \"transform_matrix\": "
             "[[1,0,0,1],[0,1,0,0],[0,0,1,3],[0,0,0,1]]}]}",
             ending, ending);
    put(state, name, text);
}

/* Straight colours and alpha of the test pictures: a clear, a faint, a half and a full pixel by
 * turns. */
static const double colour[3] = {0.75, 0.5, 0.125};
static const double alpha[4] = {0, 0.25, 0.5, 1};

static void check_scene(void **state, const char *folder, int factor)
{
    lf_scene_options o = lf_scene_defaults();
    o.factor = factor;
    lf_scene *scene = open_with(state, folder, &o);
    const double mean = (alpha[0] + alpha[1] + alpha[2] + alpha[3]) / 4;
    assert_int_equal(scene->views, 2);
    for (int v = 0; v < 2; v++) {
        lf_pixels p;
        assert_true(scene->view[v].alpha);
        assert_int_equal(lf_scene_hold(scene, v, &p, NULL), LF_OK);
        assert_int_equal(p.width, SIDE / factor);
        for (int i = 0; i < p.width * p.height; i++) {
            const double a = factor == 4 ? mean : alpha[i % 4];
            assert_close(p.alpha[i], 255 * a, 0, 0.51);
            for (int c = 0; c < 3; c++)
                assert_close(p.rgb[3 * i + c], 255 * (colour[c] * a + 1 - a), 0, 0.51);
        }
        lf_scene_release(scene, v);
    }
    lf_scene_close(scene);
}

/* EXR stores colours multiplied by alpha: rims must not come out darker for that. */
static void exr_with_alpha(void **state)
{
    static file_bytes file;
    float value[PIXELS][4];
    for (int i = 0; i < PIXELS; i++)
        for (int c = 0; c < 4; c++)
            value[i][c] = (float)(alpha[i % 4] * (c < 3 ? colour[c] : 1));
    exr(&file, SIDE, SIDE, value[0]);
    put_transforms(state, "exr", "exr");
    put_bytes(state, "exr/0.exr", file.byte, file.count);
    put_bytes(state, "exr/1.exr", file.byte, file.count);
    check_scene(state, "exr", 1);
    check_scene(state, "exr", 4);
}

static void png_of_16_bits(void **state)
{
    static file_bytes file;
    uint16_t value[PIXELS][4];
    for (int i = 0; i < PIXELS; i++)
        for (int c = 0; c < 4; c++)
            value[i][c] = (uint16_t)lround(65535 * (c < 3 ? colour[c] : alpha[i % 4]));
    png16(&file, SIDE, SIDE, value[0]);
    put_transforms(state, "deep", "png");
    put_bytes(state, "deep/0.png", file.byte, file.count);
    put_bytes(state, "deep/1.png", file.byte, file.count);
    check_scene(state, "deep", 1);
    check_scene(state, "deep", 4);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(exr_with_alpha),
        cmocka_unit_test(png_of_16_bits),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
