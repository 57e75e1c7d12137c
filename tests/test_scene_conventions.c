/* test_scene_conventions.c: a point of the world falls on the pixel that each layout's own rules
 * give, worked out here without elf's cameras; and such pixels satisfy the epipolar constraint of
 * the cameras read, which a flipped axis or half a pixel breaks. */
#include "tests/scene_fixture.h"

#include "datasets/npy.h"

enum { VIEWS = 4, WIDTH = 40, HEIGHT = 30, POINTS = 60 };
static const double focal = 50;

/* Rotation whose columns are the camera's right, up and backward axes, and the centre. */
typedef struct pose {
    double r[9], c[3];
} pose;

static pose pose_of(int v)
{
    lf_stream s = lf_stream_at(11, LF_RANDOM_TEST, 0, (uint64_t)v);
    pose p;
    double t[9], turn[9];
    lf_rotation_axis(1, 0.35 * v - 0.5, p.r);
    lf_rotation_axis(0, 0.2 - 0.15 * v, t);
    lf_rotation_axis(2, lf_uniform(&s), turn);
    lf_rotation_multiply(p.r, t, p.r);
    lf_rotation_multiply(p.r, turn, p.r);
    for (int i = 0; i < 3; i++) /* backward: away from the origin */
        p.c[i] = (3 + 0.3 * v) * p.r[3 * i + 2] + 0.2 * lf_uniform(&s);
    return p;
}

static void point_of(int i, double out[3])
{
    lf_stream s = lf_stream_at(12, LF_RANDOM_TEST, 0, (uint64_t)i);
    for (int k = 0; k < 3; k++)
        out[k] = 1.2 * lf_uniform(&s) - 0.6;
}

/* The pixel whose top left corner of the picture is (0, 0): by OpenGL's rules. */
static void image_of(const pose *p, const double x[3], double uv[2])
{
    double q[3];
    for (int k = 0; k < 3; k++)
        q[k] = p->r[k] * (x[0] - p->c[0]) + p->r[3 + k] * (x[1] - p->c[1]) +
               p->r[6 + k] * (x[2] - p->c[2]);
    uv[0] = 0.5 * WIDTH + focal * q[0] / -q[2];
    uv[1] = 0.5 * HEIGHT - focal * q[1] / -q[2];
}

/* ---- the five layouts by hand ------------------------------------------------------------- */

static int gl_matrix(const pose *p, char *text, size_t room)
{
    return snprintf(text, room,
                    "[[%.17g,%.17g,%.17g,%.17g],[%.17g,%.17g,%.17g,%.17g],"
                    "[%.17g,%.17g,%.17g,%.17g],[0,0,0,1]]",
                    p->r[0], p->r[1], p->r[2], p->c[0], p->r[3], p->r[4], p->r[5], p->c[1], p->r[6],
                    p->r[7], p->r[8], p->c[2]);
}

static void make_json(void **state, const char *name, const char *head)
{
    char text[8192], file[64];
    size_t n = (size_t)snprintf(text, sizeof text, "{%s, \"frames\": [", head);
    for (int v = 0; v < VIEWS; v++) {
        const pose p = pose_of(v);
        n += (size_t)snprintf(
            text + n, sizeof text - n,
            "%s{\"file_path\": \"./pic/%d\", \"transform_matrix\": ", v ? "," : "", v);
        n += (size_t)gl_matrix(&p, text + n, sizeof text - n);
        n += (size_t)snprintf(text + n, sizeof text - n, "}");
        snprintf(file, sizeof file, "s/pic/%d.png", v);
        put_picture(state, file, WIDTH, HEIGHT);
    }
    snprintf(text + n, sizeof text - n, "]}");
    put(state, name, text);
}

static void make_synthetic(void **state)
{
    char head[64];
    snprintf(head, sizeof head, "\"camera_angle_x\": %.17g", 2 * atan(0.5 * WIDTH / focal));
    make_json(state, "s/transforms_train.json", head);
}

static void make_transforms(void **state)
{
    make_json(
        state, "s/transforms.json",
        "\"fl_x\": 50, \"fl_y\": 50, \"cx\": 20, \"cy\": 15, \"w\": 40, \"h\": 30, \"k1\": 0");
}

static void make_llff(void **state)
{
    double rows[VIEWS][17];
    const long shape[2] = {VIEWS, 17};
    char file[64], path[512];
    for (int v = 0; v < VIEWS; v++) {
        const pose p = pose_of(v);
        const double size[3] = {HEIGHT, WIDTH, focal};
        for (int i = 0; i < 3; i++) {
            rows[v][5 * i] = -p.r[3 * i + 1]; /* down */
            rows[v][5 * i + 1] = p.r[3 * i];
            rows[v][5 * i + 2] = p.r[3 * i + 2]; /* backward */
            rows[v][5 * i + 3] = p.c[i];
            rows[v][5 * i + 4] = size[i];
        }
        rows[v][15] = 1;
        rows[v][16] = 9;
        snprintf(file, sizeof file, "s/images/%d.png", v);
        put_picture(state, file, WIDTH, HEIGHT);
    }
    assert_int_equal(
        lf_npy_write(place(state, "s/poses_bounds.npy", path), 2, shape, rows[0], NULL), LF_OK);
}

static void make_deepvoxels(void **state)
{
    char text[512], file[64];
    put(state, "s/intrinsics.txt", "50 20 15 0.\n0 0 0\n1.\n1.\n30 40\n");
    for (int v = 0; v < VIEWS; v++) {
        const pose p = pose_of(v);
        size_t n = 0;
        for (int i = 0; i < 3; i++)
            n += (size_t)snprintf(text + n, sizeof text - n, "%.17g %.17g %.17g %.17g ", p.r[3 * i],
                                  -p.r[3 * i + 1], -p.r[3 * i + 2], p.c[i]);
        snprintf(text + n, sizeof text - n, "0 0 0 1\n");
        snprintf(file, sizeof file, "s/pose/%06d.txt", v);
        put(state, file, text);
        snprintf(file, sizeof file, "s/rgb/%06d.png", v);
        put_picture(state, file, WIDTH, HEIGHT);
    }
}

/* Unit quaternion of a rotation near enough to none that w > 0.1. */
static bool colmap_pose(const pose *p, double q[4], double t[3])
{
    double r[9]; /* world to camera, x right, y down, z forward */
    for (int j = 0; j < 3; j++)
        for (int k = 0; k < 3; k++)
            r[3 * k + j] = k ? -p->r[3 * j + k] : p->r[3 * j + k];
    q[0] = 0.5 * sqrt(fmax(0, 1 + r[0] + r[4] + r[8]));
    if (q[0] < 0.01)
        return false;
    q[1] = (r[7] - r[5]) / (4 * q[0]);
    q[2] = (r[2] - r[6]) / (4 * q[0]);
    q[3] = (r[3] - r[1]) / (4 * q[0]);
    for (int k = 0; k < 3; k++)
        t[k] = -(r[3 * k] * p->c[0] + r[3 * k + 1] * p->c[1] + r[3 * k + 2] * p->c[2]);
    return true;
}

static void make_colmap(void **state)
{
    static char text[65536];
    char file[64];
    size_t n = 0;
    put(state, "s/sparse/0/cameras.txt", "# a comment\n7 SIMPLE_PINHOLE 40 30 50 20 15\n");
    for (int v = 0; v < VIEWS; v++) {
        const pose p = pose_of(v);
        double q[4] = {0}, t[3] = {0};
        assert_true(colmap_pose(&p, q, t));
        n += (size_t)snprintf(text + n, sizeof text - n,
                              "%d %.17g %.17g %.17g %.17g %.17g %.17g %.17g 7 %d.png\n", v + 1,
                              q[0], q[1], q[2], q[3], t[0], t[1], t[2], v);
        for (int i = 0; i < POINTS; i++) {
            double x[3], uv[2];
            point_of(i, x);
            image_of(&p, x, uv);
            n += (size_t)snprintf(text + n, sizeof text - n, "%.17g %.17g %d ", uv[0], uv[1],
                                  i == 5 ? -1 : i);
        }
        n += (size_t)snprintf(text + n, sizeof text - n, "\n");
        snprintf(file, sizeof file, "s/images/%d.png", v);
        put_picture(state, file, WIDTH, HEIGHT);
    }
    put(state, "s/sparse/0/images.txt", text);
    n = 0;
    for (int i = 0; i < POINTS; i++) {
        double x[3];
        point_of(i, x);
        n += (size_t)snprintf(text + n, sizeof text - n, "%d %.17g %.17g %.17g 1 2 3 0.5 1 %d\n", i,
                              x[0], x[1], x[2], i);
    }
    put(state, "s/sparse/0/points3D.txt", text);
}

/* ---- checks ------------------------------------------------------------------------------- */

/* The pixel of elf's convention lies half a pixel before. */
static void check_projection(const lf_scene *scene)
{
    assert_int_equal(scene->views, VIEWS);
    for (int v = 0; v < VIEWS; v++)
        for (int i = 0; i < POINTS; i++) {
            const pose p = pose_of(v);
            double x[3], uv[2], seen[2], depth;
            point_of(i, x);
            image_of(&p, x, uv);
            assert_true(lf_camera_project(&scene->view[v].camera, x, 0, seen, &depth));
            assert_close(seen[0], uv[0] - 0.5, 0, 1e-10);
            assert_close(seen[1], uv[1] - 0.5, 0, 1e-10);
        }
}

/* Distance of pixel `b` of camera B from the epipolar line of pixel `a` of camera A. */
static double epipolar(const lf_camera *A, const double a[2], const lf_camera *B, const double b[2])
{
    double d[3], p[3], u[2][2], depth;
    lf_camera_ray(A, a[0], a[1], d);
    for (int end = 0; end < 2; end++) {
        for (int k = 0; k < 3; k++)
            p[k] = A->centre[k] + (end ? 4.5 : 2.5) * d[k];
        if (!lf_camera_project(B, p, 0, u[end], &depth))
            return 1e3;
    }
    const double x = u[1][0] - u[0][0], y = u[1][1] - u[0][1];
    return fabs(x * (b[1] - u[0][1]) - y * (b[0] - u[0][0])) / hypot(x, y);
}

/* Root of the mean square over all pairs and points, pixels; `shift` is added to cx and cy, and the
 * axes y and z are turned round if `flip`. */
static double epipolar_error(const lf_scene *scene, double shift, bool flip)
{
    lf_camera c[VIEWS];
    double sum = 0;
    for (int v = 0; v < VIEWS; v++) {
        c[v] = scene->view[v].camera;
        c[v].cx += shift;
        c[v].cy += shift;
        for (int i = 0; flip && i < 3; i++) {
            c[v].rotation[3 * i + 1] *= -1;
            c[v].rotation[3 * i + 2] *= -1;
        }
    }
    for (int v = 0; v < VIEWS; v++)
        for (int w = 0; w < VIEWS; w++)
            for (int i = 0; i < POINTS && v != w; i++) {
                const pose p = pose_of(v), q = pose_of(w);
                double x[3], a[2], b[2];
                point_of(i, x);
                image_of(&p, x, a);
                image_of(&q, x, b);
                for (int k = 0; k < 2; k++) {
                    a[k] -= 0.5;
                    b[k] -= 0.5;
                }
                const double e = epipolar(&c[v], a, &c[w], b);
                sum += e * e;
            }
    return sqrt(sum / (VIEWS * (VIEWS - 1) * POINTS));
}

static void check_layout(void **state, void (*make)(void **), lf_scene_layout layout)
{
    make(state);
    lf_scene *scene = open_good(state, "s");
    assert_int_equal(scene->layout, layout);
    check_projection(scene);
    assert_below(epipolar_error(scene, 0, false), 1e-10);
    assert_true(epipolar_error(scene, 0.5, false) > 0.05);
    assert_true(epipolar_error(scene, 0, true) > 3);
    lf_scene_close(scene);
}

static void test_synthetic(void **state)
{
    check_layout(state, make_synthetic, LF_LAYOUT_NERF_SYNTHETIC);
}

static void test_transforms(void **state)
{
    check_layout(state, make_transforms, LF_LAYOUT_TRANSFORMS);
}

static void test_llff(void **state)
{
    check_layout(state, make_llff, LF_LAYOUT_LLFF);
}

static void test_deepvoxels(void **state)
{
    check_layout(state, make_deepvoxels, LF_LAYOUT_DEEPVOXELS);
}

static void test_colmap(void **state)
{
    check_layout(state, make_colmap, LF_LAYOUT_COLMAP_TEXT);
    lf_scene *scene = open_good(state, "s");
    assert_int_equal(scene->points, POINTS);
    assert_int_equal(scene->observations, VIEWS * (POINTS - 1));
    assert_below(scene->reprojection, 1e-12);
    assert_int_equal(scene->depths, LF_DEPTHS_POINTS);
    lf_scene_close(scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_synthetic, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_transforms, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_llff, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_deepvoxels, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_colmap, set_up, tear_down),
    };
    return cmocka_run_group_tests_name("scene_conventions", tests, NULL, NULL);
}
