/* test_hull.c: visual hulls against closed forms and against lines of sight cast at the mesh. */
#include <omp.h>
#include <string.h>

#include "datasets/views.h"
#include "eval/hull.h"
#include "eval/isosurface.h"
#include "eval/metrics.h"
#include "tests/close.h"

enum { V = LF_CUBE_VIEWS, SIZE = 97, POINTS = 20000 };

static const double origin[3] = {0, 0, 0};

/* A mesh and its views with 8 bits, shade and mask. */
typedef struct scene {
    lf_mesh *mesh;
    lf_surface *surface;
    lf_shape_views views;
    uint8_t *images;
    lf_hull hull;
} scene;

/* The object as views.camera and views.object have it; takes over the mesh. */
static scene *render(lf_mesh *mesh, const lf_shape_views *views)
{
    scene *s = calloc(1, sizeof *s);
    const lf_views_options options = {.size = views->camera[0].width,
                                      .render = lf_render_defaults()};
    const long n = lf_views_floats(&options);
    float *pixels = malloc((size_t)n * sizeof *pixels);
    assert_non_null(s);
    assert_non_null(pixels);
    *s = (scene){.mesh = mesh, .views = *views, .images = malloc((size_t)n)};
    assert_non_null(s->images);
    assert_int_equal(lf_surface_open(mesh, &s->surface, NULL), LF_OK);
    assert_int_equal(
        lf_views_render(s->surface, &options, views->camera, views->object, pixels, NULL), LF_OK);
    for (long i = 0; i < n; i++)
        s->images[i] = (uint8_t)lround(255 * pixels[i]);
    free(pixels);
    s->views.images = s->images;
    s->hull = (lf_hull){&s->views, 2, V, {0, 1, 2, 3, 4, 5, 6, 7}};
    return s;
}

static void release(scene *s)
{
    lf_surface_close(s->surface);
    lf_mesh_free(s->mesh);
    free(s->images);
    free(s);
}

static scene *render_setting(lf_mesh *mesh, lf_setting setting)
{
    lf_shape_views views = {0};
    lf_setting_draw(setting, SIZE, 1, 0, 0, views.camera, views.object);
    return render(mesh, &views);
}

/* From the corners of a cube so far away that lines of sight are parallel to 1 in 200. */
static scene *render_far(lf_mesh *mesh)
{
    lf_shape_views views = {0};
    lf_rotation_identity(views.object);
    for (int v = 0; v < V; v++) {
        const double along = 100 / sqrt(3);
        const double centre[3] = {v & 1 ? along : -along, v & 2 ? along : -along,
                                  v & 4 ? along : -along};
        views.camera[v] = lf_camera_look_at(centre, origin, atan(0.5 / 100), 193);
    }
    return render(mesh, &views);
}

static lf_mesh *extract(scene *s)
{
    lf_iso_options o = lf_iso_defaults();
    o.dense = true;
    o.coarse = 96;
    o.refinements = 0;
    lf_mesh *mesh = NULL;
    assert_int_equal(lf_isosurface(&o, lf_hull_field, &s->hull, &mesh, NULL, NULL), LF_OK);
    return mesh;
}

static lf_score score(const lf_mesh *a, const lf_mesh *b)
{
    const lf_metric_options options = lf_metric_defaults();
    lf_score s = {0};
    assert_int_equal(lf_score_meshes(a, b, NULL, &options, &s, NULL), LF_OK);
    return s;
}

/* Opposite corners see the same outline: four cylinders along the diagonals of a cube, which meet
 * in 12 (2 sqrt 2 - sqrt 6) r^3. What of it lies beyond 1.1 r is no part of the IoU: less than 1 %.
 */
static void ball_is_in_four_cylinders(void **state)
{
    (void)state;
    const double r = 0.4, volume = 12 * (2 * sqrt(2) - sqrt(6)) * r * r * r;
    const double ball = 4.0 / 3 * 3.14159265358979 * r * r * r;
    scene *s = render_far(lf_mesh_sphere(5, r, origin));
    lf_mesh *hull = extract(s);
    assert_close(lf_mesh_volume(hull), volume, 1e-2, 0);
    const lf_score figures = score(hull, s->mesh);
    assert_close(figures.iou, ball / volume, 2e-2, 0);
    lf_mesh_free(hull);
    release(s);
}

/* A cube's outline from its corners is a hexagon; the four prisms meet in the rhombic dodecahedron
 * |x +- y|, |x +- z|, |y +- z| <= 2 h over the cube of half edge h, of twice its volume. The cube
 * of IoU cuts the six pyramids of height h off at 0.1 h and keeps 1 - 0.9^3 of them. */
static void box_is_in_a_dodecahedron(void **state)
{
    (void)state;
    const double h = 0.25, low[3] = {-h, -h, -h}, high[3] = {h, h, h};
    scene *s = render_far(lf_mesh_box(low, high));
    lf_mesh *hull = extract(s);
    assert_close(lf_mesh_volume(hull), 2 * 8 * h * h * h, 1e-2, 0);
    const lf_score figures = score(hull, s->mesh);
    assert_close(figures.iou, 1 / (2 - 0.9 * 0.9 * 0.9), 1e-2, 0);
    lf_mesh_free(hull);
    release(s);
}

static double (*random_points(void))[3]
{
    double(*point)[3] = malloc(POINTS * sizeof *point);
    assert_non_null(point);
    lf_stream stream = lf_stream_at(3, LF_RANDOM_TEST, 0, 0);
    for (int i = 0; i < POINTS; i++)
        for (int a = 0; a < 3; a++)
            point[i][a] = lf_uniform(&stream) - 0.5;
    return point;
}

/* Does the line of sight from every camera through p meet the mesh? */
static bool all_lines_meet(const scene *s, const double p[3])
{
    for (int v = 0; v < V; v++) {
        double centre[3], direction[3];
        lf_rotation_apply_transposed(s->views.object, s->views.camera[v].centre, centre);
        for (int a = 0; a < 3; a++)
            direction[a] = p[a] - centre[a];
        if (!lf_surface_any_hit(s->surface, centre, direction, 0, INFINITY))
            return false;
    }
    return true;
}

static double torus_distance(const double p[3])
{
    return hypot(hypot(p[0], p[2]) - 0.27, p[1]) - 0.11;
}

/* A torus in every setting. Where the masks are sure, lines of sight say the same; what lies so
 * deep in the torus that the four pixels round its projection are covered (2.13 pixels, 0.03 where
 * it is farthest) is inside; the hull is as large as the lines of sight make it, and that is more
 * than the torus. */
static void lines_of_sight_agree(void **state)
{
    (void)state;
    double(*point)[3] = random_points();
    static float value[POINTS];
    static uint8_t valid[POINTS];
    for (int setting = 0; setting < LF_SETTINGS; setting++) {
        scene *s = render_setting(lf_mesh_torus(0.27, 0.11, 96, 48), (lf_setting)setting);
        long torus = 0, lines = 0, hull = 0, unsure = 0;
        lf_hull_field(&s->hull, POINTS, (const double(*)[3])point, value, valid);
        for (int i = 0; i < POINTS; i++) {
            const bool meet = all_lines_meet(s, point[i]), sure = fabsf(value[i]) == 0.5f;
            assert_true(valid[i]);
            if (sure)
                assert_int_equal(value[i] < 0, meet);
            if (torus_distance(point[i]) < -0.03)
                assert_true(value[i] == -0.5f);
            torus += torus_distance(point[i]) < 0;
            lines += meet;
            hull += value[i] < 0;
            unsure += !sure;
        }
        assert_true(unsure < POINTS / 10);
        assert_close(hull, lines, 2e-2, 0);
        assert_true(lines > torus + torus / 10);
        release(s);
    }
    free(point);
}

/* Fewer views allow more; a view that is not looked at changes nothing; one thread or two. */
static void fewer_views_allow_more(void **state)
{
    (void)state;
    double(*point)[3] = random_points();
    static float all[POINTS], some[POINTS], again[POINTS];
    static uint8_t valid[POINTS];
    scene *s = render_setting(lf_mesh_torus(0.27, 0.11, 96, 48), LF_SETTING_Z);
    lf_hull_field(&s->hull, POINTS, (const double(*)[3])point, all, valid);
    const int threads = omp_get_max_threads();
    omp_set_num_threads(threads == 1 ? 2 : 1);
    lf_hull_field(&s->hull, POINTS, (const double(*)[3])point, again, valid);
    omp_set_num_threads(threads);
    assert_memory_equal(again, all, sizeof all);
    s->hull = (lf_hull){&s->views, 2, 2, {1, 6}};
    lf_hull_field(&s->hull, POINTS, (const double(*)[3])point, some, valid);
    long more = 0;
    for (int i = 0; i < POINTS; i++) {
        assert_true(some[i] <= all[i]);
        more += some[i] < all[i];
    }
    assert_true(more > 0);
    memset(s->images, 0, 2 * SIZE * SIZE); /* view 0 */
    lf_hull_field(&s->hull, POINTS, (const double(*)[3])point, again, valid);
    assert_memory_equal(again, some, sizeof some);
    free(point);
    release(s);
}

/* One empty mask: an empty hull, scored as empty. Full masks: nothing is carved from the grid, not
 * even its corners, which lie beside the images. Behind all cameras there is no opinion. */
static void empty_and_full_masks(void **state)
{
    (void)state;
    scene *s = render_setting(lf_mesh_sphere(4, 0.4, origin), LF_SETTING_I);
    memset(s->images + 3 * 2 * SIZE * SIZE, 0, 2 * SIZE * SIZE);
    lf_mesh *hull = extract(s);
    assert_int_equal(hull->faces, 0);
    const lf_score figures = score(hull, s->mesh);
    assert_true(figures.empty);
    assert_close(figures.iou, 0, 0, 0);
    lf_mesh_free(hull);
    memset(s->images, 255, V * 2 * SIZE * SIZE);
    hull = extract(s);
    assert_close(lf_mesh_volume(hull), 1.1 * 1.1 * 1.1, 1e-2, 0);
    lf_mesh_free(hull);
    s->hull = (lf_hull){&s->views, 2, 1, {7}};
    const double points[2][3] = {{2, 2, 2}, {0, 0, 0}};
    float value[2];
    uint8_t valid[2] = {1, 1};
    lf_hull_field(&s->hull, 2, points, value, valid);
    assert_int_equal(valid[0], 0);
    assert_int_equal(valid[1], 1);
    release(s);
}

/* A mask that meets the edge of its image goes on there, at each place as at the edge. */
static void masks_go_on_beyond_the_image(void **state)
{
    (void)state;
    scene *s = render_setting(lf_mesh_sphere(4, 0.4, origin), LF_SETTING_I);
    s->hull = (lf_hull){&s->views, 2, 1, {7}};
    const lf_camera *camera = &s->views.camera[7];
    uint8_t *image = s->images + 7 * 2 * SIZE * SIZE;
    for (int i = 0; i < SIZE * SIZE; i++) /* the right half */
        image[2 * i + 1] = i % SIZE > SIZE / 2 ? 255 : 0;
    const double pixel[4][2] = {{3 * SIZE, 40}, {-SIZE, 40}, {70, -SIZE}, {20, 3 * SIZE}};
    double point[4][3];
    float value[4];
    uint8_t valid[4];
    for (int i = 0; i < 4; i++) {
        lf_camera_ray(camera, pixel[i][0], pixel[i][1], point[i]);
        for (int a = 0; a < 3; a++)
            point[i][a] = camera->centre[a] + 2.5 * point[i][a];
    }
    lf_hull_field(&s->hull, 4, (const double(*)[3])point, value, valid);
    for (int i = 0; i < 4; i++)
        assert_close(value[i], i == 0 || i == 2 ? -0.5 : 0.5, 0, 0);
    release(s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ball_is_in_four_cylinders), cmocka_unit_test(box_is_in_a_dodecahedron),
        cmocka_unit_test(lines_of_sight_agree),      cmocka_unit_test(fewer_views_allow_more),
        cmocka_unit_test(empty_and_full_masks),      cmocka_unit_test(masks_go_on_beyond_the_image),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
