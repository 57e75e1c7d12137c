/* test_scene_files.c: what is wrong with a scene's files is said, with file and place; frames
 * without picture and pictures without frame are counted and named. */
#include "tests/scene_fixture.h"

#include "datasets/npy.h"

#define EYE "[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]"
#define FRAME(name, matrix) "{\"file_path\": \"" name "\", \"transform_matrix\": " matrix "}"

static void put_json(void **state, const char *head, const char *frames)
{
    char text[4096];
    snprintf(text, sizeof text, "{%s, \"frames\": [%s]}", head, frames);
    put(state, "j/transforms.json", text);
    put_picture(state, "j/a.png", 8, 6);
    put_picture(state, "j/b.png", 8, 6);
}

static void test_no_layout(void **state)
{
    put(state, "x/readme", "nothing");
    expect_bad(state, "x", "transforms_train.json; LLFF: poses_bounds.npy");
    expect_bad(state, "nowhere", "is no scene");
}

static void test_json_bad(void **state)
{
    static const struct {
        const char *head, *frames, *message;
    } cases[] = {
        {"\"fl_x\": 5,", FRAME("a", EYE), "transforms.json:1:"},
        {"\"fl_x\": 0", FRAME("a", EYE), "focal lengths are 0"},
        {"\"fl_x\": \"5\"", FRAME("a", EYE), "frames[0]: \"fl_x\" must be a number"},
        {"\"w\": 8", FRAME("a", EYE), "neither \"fl_x\" nor \"camera_angle_x\""},
        {"\"fl_x\": 5, \"w\": 9", FRAME("a", EYE), "is 8 x 6 pixels, the intrinsics belong to 9"},
        {"\"fl_x\": 5, \"k1\": 0.1", FRAME("a", EYE), "\"k1\" is 0.1: lens distortion"},
        {"\"fl_x\": 5, \"camera_model\": \"OPENCV_FISHEYE\"", FRAME("a", EYE), "OPENCV_FISHEYE"},
        {"\"fl_x\": 5, \"near\": 3, \"far\": 2", FRAME("a", EYE), "near 3 and far 2"},
        {"\"fl_x\": 5, \"near\": -1, \"far\": 2", FRAME("a", EYE), "near -1"},
        {"\"camera_angle_x\": 4", FRAME("a", EYE), "between 0 and pi"},
        {"\"fl_x\": 5", FRAME("a", "[[1,0,0,0],[0,1,0,0],[0,0,-1,4],[0,0,0,1]]"), "det R = -1"},
        {"\"fl_x\": 5", FRAME("a", "[[2,0,0,0],[0,2,0,0],[0,0,2,4],[0,0,0,1]]"), "det R = 8"},
        {"\"fl_x\": 5", FRAME("a", "[[1,0,0,0],[0,1,0,0],[0,0,1],[0,0,0,1]]"),
         "\"transform_matrix\"[2] must be an array of 4 numbers"},
        {"\"fl_x\": 5", FRAME("a", "[[1,0,0,0],[0,\"1\",0,0],[0,0,1,4],[0,0,0,1]]"),
         "\"transform_matrix\"[1][1]"},
        {"\"fl_x\": 5", FRAME("a", EYE) "," FRAME("a", EYE), "frames[1]: the frame a is there"},
        {"\"fl_x\": 5", FRAME("c", EYE), "no view could be read; the first left out is c"},
        {"\"fl_x\": 5", "", "no view could be read"},
        {"\"fl_x\": 5", "{\"transform_matrix\": " EYE "}", "\"file_path\" must be a text"},
        {"\"fl_x\": 5", "3", "\"file_path\" must be a text"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        put_json(state, cases[i].head, cases[i].frames);
        expect_bad(state, "j", cases[i].message);
    }
    put(state, "j/transforms.json", "[1, 2]");
    expect_bad(state, "j", "\"frames\" must be an array");
}

static void test_left_out(void **state)
{
    put_json(state, "\"fl_x\": 5", FRAME("./a", EYE) "," FRAME("missing.png", EYE));
    lf_scene *scene = open_good(state, "j");
    assert_int_equal(scene->views, 1);
    assert_string_equal(scene->view[0].name, "a");
    assert_int_equal(scene->left, 2);
    assert_string_equal(scene->left_out[0].name, "missing.png");
    assert_non_null(strstr(scene->left_out[0].reason, "frames[1]: there is no such picture"));
    assert_non_null(strstr(scene->left_out[1].name, "b.png"));
    assert_non_null(strstr(scene->left_out[1].reason, "without a frame"));
    assert_int_equal(scene->depths, LF_DEPTHS_GUESSED);
    lf_scene_close(scene);
}

/* Two views of different sizes, one grey with alpha, the other grey. */
static void test_grey_and_sizes(void **state)
{
    char path[512];
    lf_pixels p;
    lf_error err = {"no message"};
    lf_image *grey = lf_image_create(10, 4, 2), *plain = lf_image_create(8, 6, 1);
    memcpy(lf_image_at(grey, 2, 1), (float[2]){0.2f, 0.6f}, 8);
    lf_image_at(plain, 3, 5)[0] = 0.4f;
    put_json(state, "\"fl_x\": 5", FRAME("a", EYE) "," FRAME("b", EYE));
    assert_int_equal(lf_image_write_png(place(state, "j/a.png", path), grey, &err), LF_OK);
    assert_int_equal(lf_image_write_png(place(state, "j/b.png", path), plain, &err), LF_OK);
    lf_scene *scene = open_good(state, "j");
    assert_int_equal(scene->view[0].camera.width, 10);
    assert_close(scene->view[0].camera.cx, 4.5, 0, 0);
    assert_int_equal(scene->view[1].camera.width, 8);
    assert_true(scene->view[0].alpha && !scene->view[1].alpha);
    assert_int_equal(lf_scene_hold(scene, 0, &p, &err), LF_OK);
    for (int k = 0; k < 3; k++) /* 0.2 * 0.6 + 0.4 */
        assert_int_equal(p.rgb[3 * (10 + 2) + k], 133);
    assert_int_equal(p.alpha[10 + 2], 153);
    assert_int_equal(p.rgb[0], 255); /* alpha 0 is white */
    lf_scene_release(scene, 0);
    assert_int_equal(lf_scene_hold(scene, 1, &p, &err), LF_OK);
    assert_int_equal(p.rgb[3 * (5 * 8 + 3) + 2], 102);
    assert_null(p.alpha);
    lf_scene_release(scene, 1);
    lf_scene_close(scene);
    lf_image_free(grey);
    lf_image_free(plain);
}

/* A picture that is exchanged while the scene is open is refused, not mixed up. */
static void test_exchanged_picture(void **state)
{
    lf_pixels p;
    lf_error err;
    put_json(state, "\"fl_x\": 5", FRAME("a", EYE) "," FRAME("b", EYE));
    lf_scene *scene = open_good(state, "j");
    put_picture(state, "j/a.png", 9, 6);
    assert_int_equal(lf_scene_hold(scene, 0, &p, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "another picture"));
    put(state, "j/a.png", "no picture");
    assert_int_equal(lf_scene_hold(scene, 0, &p, &err), LF_BAD_INPUT);
    assert_int_equal(lf_scene_bytes(scene), 0);
    lf_scene_close(scene);
}

static void test_options(void **state)
{
    put_json(state, "\"fl_x\": 5", FRAME("a", EYE) "," FRAME("b", EYE));
    char path[512];
    lf_scene *scene = NULL;
    lf_error err;
    lf_scene_options o = lf_scene_defaults();
    o.near = 1;
    o.far = 3;
    o.hold_out = 0;
    scene = open_with(state, "j", &o);
    assert_int_equal(scene->depths, LF_DEPTHS_GIVEN);
    assert_close(scene->view[1].far, 3, 0, 0);
    assert_int_equal(lf_scene_count(scene, LF_SPLIT_TRAIN), 2);
    lf_scene_close(scene);
    scene = NULL;
    o.far = 0.5;
    place(state, "j", path);
    assert_int_equal(lf_scene_open(path, &o, &scene, &err), LF_BAD_INPUT);
    o = lf_scene_defaults();
    o.factor = 7; /* of 8 x 6 */
    assert_int_equal(lf_scene_open(path, &o, &scene, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "cannot be reduced 7 times"));
    assert_null(scene);
}

/* ---- LLFF --------------------------------------------------------------------------------- */

static void put_rows(void **state, const double *change, int at)
{
    double row[34] = {0};
    char path[512];
    const long shape[2] = {2, 17};
    for (int v = 0; v < 2; v++) {
        double *r = row + 17 * v;
        r[1] = 1;   /* right = x */
        r[5] = 1;   /* down = y */
        r[12] = -1; /* backward = -z */
        r[4] = 6;
        r[9] = 8;
        r[14] = 5;
        r[15] = 1;
        r[16] = 2;
        r[3] = v;
    }
    if (change)
        row[17 + at] = *change;
    lf_npy_write(place(state, "l/poses_bounds.npy", path), 2, shape, row, NULL);
    put_picture(state, "l/images/a.png", 8, 6);
    put_picture(state, "l/images/b.png", 8, 6);
}

static void test_llff_bad(void **state)
{
    static const struct {
        int at;
        double value;
        const char *message;
    } cases[] = {{14, 0, "row 1: the focal lengths are 0"},
                 {14, NAN, "focal lengths are nan"},
                 {1, -1, "det R = -1"},
                 {1, 2, "row 1: the pose is no rotation"},
                 {3, NAN, "row 1: the pose holds a number"},
                 {9, 9, "belong to 9 x 6"},
                 {15, 2, "near 2 and far 2"},
                 {16, NAN, "far (column 16)"},
                 {16, 0, "far (column 16) is 0"},
                 {4, NAN, "height nan"}};
    put_rows(state, NULL, 0);
    lf_scene_close(open_good(state, "l"));
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        put_rows(state, &cases[i].value, cases[i].at);
        expect_bad(state, "l", cases[i].message);
    }
    put_rows(state, NULL, 0);
    put_picture(state, "l/images/c.png", 8, 6);
    expect_bad(state, "l", "2 rows, but 3 pictures");
}

/* images_2 of another rounding is taken for factor 2, and the camera fits it. */
static void test_llff_reduced(void **state)
{
    put_rows(state, NULL, 0);
    put_picture(state, "l/images_2/a.png", 4, 3);
    put_picture(state, "l/images_2/b.png", 4, 3);
    lf_scene_options o = lf_scene_defaults();
    o.factor = 2;
    lf_scene *scene = open_with(state, "l", &o);
    assert_non_null(strstr(scene->view[0].path, "images_2"));
    assert_int_equal(scene->view[0].camera.width, 4);
    assert_close(scene->view[0].camera.fx, 2.5, 0, 1e-12);
    assert_close(scene->view[0].camera.cx, 1.5, 0, 1e-12);
    lf_scene_close(scene);
}

static void test_npy_bad(void **state)
{
    static const struct {
        const char *header, *message;
    } cases[] = {
        {"{'descr': '<f8', 'fortran_order': True, 'shape': (1, 17), }", "Fortran order"},
        {"{'descr': '<i8', 'fortran_order': False, 'shape': (1, 17), }", "type '<i8'"},
        {"{'descr': '>f8', 'fortran_order': False, 'shape': (1, 17), }", "type '>f8'"},
        {"{'descr': '<f8', 'fortran_order': False, 'shape': (1, 17), }", "promises 17"},
        {"{'descr': '<f8', 'fortran_order': False, 'shape': (1, 1), }", "1 of 17"},
        {"{'descr': '<f8', 'fortran_order': False, 'shape': (x), }", "shape that cannot be read"},
        {"{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }", "shape that cannot"},
        {"{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999,99999999999), }",
         "shape that cannot"},
        {"{'descr': '<f8', 'fortran_order': False}", "no 'shape'"},
        {"{'shape': (1,)}", "lacks 'descr'"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char bytes[256] = "\x93NUMPY\x01";
        const size_t n = strlen(cases[i].header);
        bytes[8] = (char)n;
        memcpy(bytes + 10, cases[i].header, n);
        put_bytes(state, "l/poses_bounds.npy", bytes, 10 + n + 8);
        if (i == 4)
            expect_bad(state, "l", "N x 17 is needed");
        else
            expect_bad(state, "l", cases[i].message);
    }
    put(state, "l/poses_bounds.npy", "NUMPY this is not");
    expect_bad(state, "l", "is no .npy file");
    put_bytes(state, "l/poses_bounds.npy", "\x93NUMPY\x01\x00\xff\xff{}", 12);
    expect_bad(state, "l", "header is cut short");
    put_bytes(state, "l/poses_bounds.npy", "\x93NUMPY\x09\x00\x01\x00{}", 12);
    expect_bad(state, "l", "version 9");
}

/* ---- DeepVoxels --------------------------------------------------------------------------- */

static const char identity[] = "1 0 0 0 0 1 0 0 0 0 1 -4 0 0 0 1";

static void put_voxels(void **state, const char *intrinsics, const char *pose)
{
    put(state, "d/intrinsics.txt", intrinsics);
    put(state, "d/pose/000000.txt", pose);
    put_picture(state, "d/rgb/000000.png", 8, 8);
}

static void test_deepvoxels(void **state)
{
    put_voxels(state, "5 4 4 0.\n0 0 0\n1\n1\n8 8\n", identity);
    lf_scene *scene = open_good(state, "d");
    assert_close(scene->view[0].near, 3, 0, 1e-12);
    assert_close(scene->view[0].far, 5, 0, 1e-12);
    assert_close(scene->view[0].camera.centre[2], -4, 0, 0);
    lf_scene_close(scene);
    /* the original data: 640 x 480 intrinsics, square pictures; and poses world to camera */
    put_voxels(state, "600 320 240 0.\n0 0 0\n1\n1\n480 640\n1\n",
               "1 0 0 0 0 1 0 0 0 0 1 4 0 0 0 1");
    scene = open_good(state, "d");
    assert_close(scene->view[0].camera.fx, 10, 0, 1e-12);
    assert_close(scene->view[0].camera.cx, 3.5, 0, 1e-12);
    assert_close(scene->view[0].camera.cy, 3.5, 0, 1e-12);
    assert_close(scene->view[0].camera.centre[2], -4, 0, 0);
    lf_scene_close(scene);
}

static void test_deepvoxels_bad(void **state)
{
    static const char good[] = "5 4 4 0.\n0 0 0\n1\n1\n8 8\n";
    static const struct {
        const char *intrinsics, *pose, *message;
    } cases[] = {{"0 4 4 0.\n0 0 0\n1\n1\n8 8\n", identity, "line 1: the focal length is 0"},
                 {"5 4 4 0.\n0 0 0\n1\n1\n", identity, "intrinsics.txt: 9 numbers"},
                 {"5 4 x 0.\n", identity, "number 3 is 'x'"},
                 {"5 4 4 0.\n0 0 0\n1\n1\n0 8\n", identity, "line 5"},
                 {good, "1 0 0", "000000.txt: 3 numbers"},
                 {good, "1 0 0 0 0 1 0 0 0 0 nan -4 0 0 0 1", "number 11 is 'nan'"},
                 {good, "1 0 0 0 0 -1 0 0 0 0 1 -4 0 0 0 1", "det R = -1"},
                 {"5 4 4 0.\n0 0 0\n1\n1\n8 9\n9 9", identity, "at most 12"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        put_voxels(state, cases[i].intrinsics, cases[i].pose);
        expect_bad(state, "d", cases[i].message);
    }
}

/* ---- COLMAP ------------------------------------------------------------------------------- */

static void put_model(void **state, const char *cameras, const char *images)
{
    put(state, "c/sparse/0/cameras.txt", cameras);
    put(state, "c/sparse/0/images.txt", images);
    put_picture(state, "c/images/a b.png", 8, 6);
}

static void test_colmap_bad(void **state)
{
    static const char camera[] = "1 PINHOLE 8 6 5 5 4 3\n",
                      image[] = "1 1 0 0 0 0 0 4 1 a b.png\n\n";
    static const struct {
        const char *cameras, *images, *message;
    } cases[] = {
        {"1 OPENCV_FISHEYE 8 6 5 5 4 3 0 0 0 0\n", image, "cameras.txt:1: the camera model"},
        {"1 SIMPLE_RADIAL 8 6 5 4 3 0.1\n", image, "SIMPLE_RADIAL has distortion"},
        {"1 PINHOLE 8 6 5 5 4\n", image, "cameras.txt:1: number 4 of the parameters"},
        {"1 PINHOLE 8 -6 5 5 4 3\n", image, "8 x -6"},
        {"1 PINHOLE 8 6 0 5 4 3\n", image, "focal lengths are 0 and 5"},
        {"1 PINHOLE 9 6 5 5 4 3\n", image, "belong to 9 x 6"},
        {camera, "1 2 0 0 0 0 0 4 1 a b.png\n\n", "quaternion has length 2"},
        {camera, "1 1 0 0 0 0 0 4 2 a b.png\n\n", "names the camera 2"},
        {camera, "# one\n1 1 0 0 0 0 x 4 1 a b.png\n\n", "images.txt:2: number 7"},
        {camera, "1 1 0 0 0 0 0 4 1 a b.png\n1 2\n", "images.txt:2: number 3 of an observation"},
        {camera, "1 1 0 0 0 0 0 4 1 c.png\n\n", "no view could be read; the first left out is c"},
    };
    put_model(state, "1 OPENCV 8 6 5 5 4 3 0 0 0 0\n", image);
    lf_scene_close(open_good(state, "c"));
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        put_model(state, cases[i].cameras, cases[i].images);
        expect_bad(state, "c", cases[i].message);
    }
}

/* Every cut of a binary model is refused, and so is a byte too many. */
static void test_colmap_binary_cut(void **state)
{
    static const char *const names[] = {"cameras", "images"};
    char path[512], name[64], bytes[4096];
    lf_scene *scene = make_scene(true, false);
    assert_int_equal(lf_scene_write(scene, LF_LAYOUT_COLMAP_BINARY, place(state, "b", path), NULL),
                     LF_OK);
    for (int i = 0; i < 2; i++) {
        snprintf(name, sizeof name, "b/sparse/0/%s.bin", names[i]);
        FILE *f = fopen(place(state, name, path), "rb");
        const size_t n = fread(bytes, 1, sizeof bytes - 1, f);
        fclose(f);
        for (size_t cut = 1; cut < n; cut += 3) {
            put_bytes(state, name, bytes, cut);
            expect_bad(state, "b", "cut short");
        }
        bytes[n] = 0;
        put_bytes(state, name, bytes, n + 1);
        expect_bad(state, "b", "1 bytes follow the last of 9 elements");
        put_bytes(state, name, bytes, n);
    }
    lf_scene_close(open_good(state, "b"));
    lf_scene_close(scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_no_layout, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_json_bad, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_left_out, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_grey_and_sizes, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_exchanged_picture, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_options, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_llff_bad, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_llff_reduced, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_npy_bad, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_deepvoxels, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_deepvoxels_bad, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_colmap_bad, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_colmap_binary_cut, set_up, tear_down),
    };
    return cmocka_run_group_tests_name("scene_files", tests, NULL, NULL);
}
