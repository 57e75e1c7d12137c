/* test_render.c: pictures agree with projection, rolls turn them exactly, motions of everything
 * leave them alone. */
#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

#include "datasets/render.h"
#include "datasets/views.h"
#include "tests/close.h"

enum { size = 65, pixels = size * size };

/* Not symmetric under any turn, box centred, diagonal 1. */
static lf_mesh *test_mesh(void)
{
    const double a0[3] = {-0.2, -0.3, -0.1}, a1[3] = {0.1, 0.3, 0.2};
    const double b0[3] = {0, -0.2, -0.25}, b1[3] = {0.35, -0.05, 0.1};
    lf_mesh *mesh = lf_mesh_box(a0, a1), *more = lf_mesh_box(b0, b1);
    lf_mesh_paint(mesh, 0.9f, 0.2f, 0.1f);
    lf_mesh_paint(more, 0.1f, 0.5f, 0.8f);
    lf_mesh_append(mesh, more);
    lf_mesh_free(more);
    assert_int_equal(lf_mesh_normalise(mesh, NULL), LF_OK);
    return mesh;
}

static lf_surface *open_surface(const lf_mesh *mesh)
{
    lf_surface *surface = NULL;
    lf_error err;
    if (lf_surface_open(mesh, &surface, &err) != LF_OK)
        fail_msg("%s", err.text);
    return surface;
}

static float *render(const lf_surface *surface, const lf_camera *camera,
                     const lf_render_options *options)
{
    float *image = malloc(pixels * 4 * sizeof *image);
    assert_non_null(image);
    lf_render(surface, camera, options, image);
    return image;
}

/* Number of entries that differ by more than 1e-5, and the largest difference. */
static long differing(const float *a, const float *b, long n, double *largest)
{
    long count = 0;
    *largest = 0;
    for (long k = 0; k < n; k++) {
        const double d = fabs((double)(a[k] - b[k]));
        count += d > 1e-5;
        *largest = larger(*largest, d);
    }
    return count;
}

/* The picture of a ball is a disk of known radius with the known shade in its middle. */
static void test_ball(void **state)
{
    (void)state;
    const double zero[3] = {0, 0, 0};
    lf_mesh *mesh = lf_mesh_sphere(5, 0.4, zero);
    lf_surface *surface = open_surface(mesh);
    lf_camera camera[8];
    lf_camera_cube(size, camera);
    lf_render_options options = lf_render_defaults();
    float *image = render(surface, &camera[7], &options);
    double area = 0;
    for (int k = 0; k < pixels; k++) {
        const float alpha = image[2 * k + 1];
        assert_true(alpha >= 0 && alpha <= 1 && image[2 * k] <= alpha && image[2 * k] >= 0);
        area += (double)alpha;
    }
    const double radius = camera[7].fx * tan(asin(0.4 / 2.5));
    assert_close(area, 3.14159265 * radius * radius, 0.005, 0);
    double nl = 0;
    for (int i = 0; i < 3; i++)
        nl += options.light.direction[i] * camera[7].centre[i] / 2.5;
    const float *middle = image + 2 * (32 * size + 32);
    assert_close(middle[0], 0.2 + 0.3 + 0.25 * (1 + nl), 0, 0.01);
    assert_close(middle[1], 1, 0, 0);
    options.light.head = true;
    lf_render(surface, &camera[7], &options, image);
    assert_close(middle[0], 1, 0, 0.01);
    free(image);
    lf_surface_close(surface);
    lf_mesh_free(mesh);
}

/* Points of the surface project into the mask; points of the mask are seen at the depth of the
 * depth picture. */
static void test_mask_and_depth_agree_with_projection(void **state)
{
    (void)state;
    enum { n = 2000 };
    lf_mesh *mesh = test_mesh();
    lf_surface *surface = open_surface(mesh);
    lf_camera camera[8];
    lf_camera_cube(size, camera);
    double(*p)[3] = malloc(n * sizeof *p);
    float *depth = malloc(pixels * sizeof *depth);
    assert_int_equal(lf_mesh_sample_surface(mesh, n, 1, 2, p, NULL, NULL), LF_OK);
    lf_render_options options = lf_render_defaults();
    for (int v = 0; v < 8; v++) {
        float *image = render(surface, &camera[v], &options);
        lf_render_depth(surface, &camera[v], depth);
        for (int k = 0; k < n; k++) {
            double uv[2], z;
            assert_true(lf_camera_project(&camera[v], p[k], 0, uv, &z));
            const int at = (int)lround(uv[1]) * size + (int)lround(uv[0]);
            float most = 0; /* a thin sliver may slip between the rays of its own pixel */
            for (int j = -1; j <= 1; j++)
                for (int i = -1; i <= 1; i++)
                    most = fmaxf(most, image[2 * (at + j * size + i) + 1]);
            assert_true(most > 0);
        }
        for (int k = 0; k < pixels; k++) {
            if (!isfinite(depth[k]))
                continue;
            double d[3], at[3];
            lf_camera_ray(&camera[v], k % size, k / size, d);
            const double *r = camera[v].rotation;
            const double along = d[0] * r[2] + d[1] * r[5] + d[2] * r[8];
            for (int i = 0; i < 3; i++)
                at[i] = camera[v].centre[i] + (double)depth[k] / along * d[i];
            assert_below(lf_surface_closest(surface, at).distance, 1e-6);
        }
        free(image);
    }
    free(depth);
    free(p);
    lf_surface_close(surface);
    lf_mesh_free(mesh);
}

/* A camera rolled by k quarter turns sees the picture turned, sample by sample. */
static void test_quarter_roll(void **state)
{
    (void)state;
    lf_mesh *mesh = test_mesh();
    lf_surface *surface = open_surface(mesh);
    lf_camera camera[8];
    lf_camera_cube(size, camera);
    const lf_render_options options = lf_render_defaults();
    for (int v = 0; v < 8; v++) {
        const lf_camera rolled = lf_camera_roll(&camera[v], 3.14159265358979323846 / 2);
        float *image = render(surface, &camera[v], &options);
        float *turned = render(surface, &rolled, &options);
        float *expected = malloc(pixels * 2 * sizeof *expected);
        /* x' = y, y' = -x about the middle: new (column, row) = (row, last - column) */
        for (int row = 0; row < size; row++)
            for (int column = 0; column < size; column++)
                memcpy(expected + 2 * ((size - 1 - column) * size + row),
                       image + 2 * (row * size + column), 2 * sizeof *image);
        double largest;
        /* a ray within a rounding of an edge may fall on its other side: one sample of nine */
        assert_below(differing(turned, expected, 2 * pixels, &largest), 2);
        assert_below(largest, 1.0 / 9 + 1e-5);
        free(image);
        free(turned);
        free(expected);
    }
    lf_surface_close(surface);
    lf_mesh_free(mesh);
}

/* Mesh, light and camera moved together: the same picture. */
static void test_motion(void **state)
{
    (void)state;
    lf_mesh *mesh = test_mesh();
    lf_surface *surface = open_surface(mesh);
    lf_camera camera[8];
    lf_camera_cube(size, camera);
    for (int k = 0; k < 4; k++) {
        lf_stream s = lf_stream_at(4, LF_RANDOM_TEST, 0, (uint64_t)k);
        const lf_motion g = lf_motion_random(&s, k == 3 ? 1000 : 2);
        lf_mesh *moved = lf_mesh_copy(mesh);
        lf_mesh_transform(moved, g.rotation, g.translation);
        lf_surface *moved_surface = open_surface(moved);
        lf_render_options options = lf_render_defaults();
        options.mode = LF_RENDER_COLOUR;
        float *image = render(surface, &camera[k], &options);
        const lf_camera moved_camera = lf_camera_move(&camera[k], &g);
        options.light = lf_light_rotate(&options.light, g.rotation);
        float *again = render(moved_surface, &moved_camera, &options);
        double largest;
        assert_below(differing(image, again, 4 * pixels, &largest), 8 * 4);
        assert_below(largest, 2.0 / 9 + 1e-5);
        free(image);
        free(again);
        lf_surface_close(moved_surface);
        lf_mesh_free(moved);
    }
    lf_surface_close(surface);
    lf_mesh_free(mesh);
}

/* Y and SO3: the views are those of the object rotated by `object` under the fixed light. */
static void test_turned_object(void **state)
{
    (void)state;
    lf_mesh *mesh = test_mesh();
    lf_surface *surface = open_surface(mesh);
    lf_views_options options = {.setting = LF_SETTING_SO3, .size = size};
    options.render = lf_render_defaults();
    float *images = malloc((size_t)lf_views_floats(&options) * sizeof *images);
    lf_camera camera[8];
    double object[9], largest;
    const double zero[3] = {0, 0, 0};
    assert_int_equal(lf_views_make(surface, &options, 1, 2, 3, camera, object, images, NULL),
                     LF_OK);
    lf_mesh *turned = lf_mesh_copy(mesh);
    lf_mesh_transform(turned, object, zero);
    lf_surface *turned_surface = open_surface(turned);
    for (int v = 0; v < 8; v++) {
        float *image = render(turned_surface, &camera[v], &options.render);
        assert_below(differing(images + v * 2 * pixels, image, 2 * pixels, &largest), 8 * 2);
        assert_below(largest, 2.0 / 9 + 1e-5);
        free(image);
    }
    lf_surface_close(turned_surface);
    lf_mesh_free(turned);
    free(images);
    lf_surface_close(surface);
    lf_mesh_free(mesh);
}

static void test_threads(void **state)
{
    (void)state;
    lf_mesh *mesh = test_mesh();
    lf_surface *surface = open_surface(mesh);
    lf_views_options options = {.setting = LF_SETTING_R, .size = size};
    options.render = lf_render_defaults();
    options.render.mode = LF_RENDER_COLOUR;
    const size_t bytes = (size_t)lf_views_floats(&options) * sizeof(float);
    float *a = malloc(bytes), *b = malloc(bytes);
    lf_camera camera[8];
    double object[9];
    const int threads = omp_get_max_threads();
    omp_set_num_threads(1);
    assert_int_equal(lf_views_make(surface, &options, 1, 2, 3, camera, object, a, NULL), LF_OK);
    omp_set_num_threads(2);
    assert_int_equal(lf_views_make(surface, &options, 1, 2, 3, camera, object, b, NULL), LF_OK);
    omp_set_num_threads(threads);
    assert_memory_equal(a, b, bytes);
    free(a);
    free(b);
    lf_surface_close(surface);
    lf_mesh_free(mesh);
}

static void test_picture(void **state)
{
    (void)state;
    lf_mesh *mesh = test_mesh();
    lf_camera camera[8];
    lf_camera_cube(size, camera);
    const float white[3] = {1, 1, 1};
    float *rgb = malloc(pixels * 3 * sizeof *rgb);
    assert_int_equal(lf_render_mesh_picture(mesh, &camera[3], white, rgb, NULL), LF_OK);
    assert_close(rgb[0], 1, 0, 0);
    const float *middle = rgb + 3 * (32 * size + 32);
    assert_true(middle[0] > 0 && middle[0] < 1);
    mesh->faces = 0;
    lf_error err;
    assert_int_equal(lf_render_mesh_picture(mesh, &camera[3], white, rgb, &err), LF_BAD_INPUT);
    free(rgb);
    lf_mesh_free(mesh);
}

static void test_bad_options(void **state)
{
    (void)state;
    lf_mesh *mesh = test_mesh();
    lf_surface *surface = open_surface(mesh);
    lf_views_options options = {.setting = LF_SETTING_I, .size = 0, .render = lf_render_defaults()};
    lf_camera camera[8];
    double object[9];
    lf_error err;
    assert_int_equal(lf_views_make(surface, &options, 1, 2, 3, camera, object, NULL, &err),
                     LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "image size 0"));
    options.size = 65;
    options.render.rays = 0;
    assert_int_equal(lf_views_make(surface, &options, 1, 2, 3, camera, object, NULL, &err),
                     LF_BAD_INPUT);
    lf_surface_close(surface);
    lf_mesh_free(mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_ball),
        cmocka_unit_test(test_mask_and_depth_agree_with_projection),
        cmocka_unit_test(test_quarter_roll),
        cmocka_unit_test(test_motion),
        cmocka_unit_test(test_turned_object),
        cmocka_unit_test(test_threads),
        cmocka_unit_test(test_picture),
        cmocka_unit_test(test_bad_options),
    };
    return cmocka_run_group_tests_name("render", tests, NULL, NULL);
}
