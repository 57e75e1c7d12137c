/* test_surface.c: closest points and rays against closed forms and brute force; bad meshes. */
#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

#include "autograd/random.h"
#include "datasets/surface.h"
#include "tests/close.h"

static const double low[3] = {-0.2, -0.3, -0.1}, high[3] = {0.2, 0.3, 0.4};

static lf_surface *open_surface(const lf_mesh *mesh)
{
    lf_surface *surface = NULL;
    lf_error err;
    if (lf_surface_open(mesh, &surface, &err) != LF_OK)
        fail_msg("%s", err.text);
    return surface;
}

static double box_distance(const double p[3])
{
    double out = 0, in = -INFINITY;
    for (int i = 0; i < 3; i++) {
        const double q = fabs(p[i] - (low[i] + high[i]) / 2) - (high[i] - low[i]) / 2;
        out += q > 0 ? q * q : 0;
        in = fmax(in, q);
    }
    return out > 0 ? sqrt(out) : -in;
}

static void random_point(uint64_t item, double size, double p[3])
{
    lf_stream s = lf_stream_at(2, LF_RANDOM_TEST, 0, item);
    for (int i = 0; i < 3; i++)
        p[i] = size * (lf_uniform(&s) - 0.5);
}

static void test_box(void **state)
{
    (void)state;
    lf_mesh *mesh = lf_mesh_box(low, high);
    lf_surface *surface = open_surface(mesh);
    assert_close(lf_surface_diagonal(surface), sqrt(0.16 + 0.36 + 0.25), 1e-12, 0);
    for (uint64_t k = 0; k < 5000; k++) {
        double p[3], d2 = 0;
        random_point(k, k % 2 ? 1 : 100, p);
        const lf_closest c = lf_surface_closest(surface, p);
        for (int i = 0; i < 3; i++)
            d2 += (c.point[i] - p[i]) * (c.point[i] - p[i]);
        assert_close(c.distance, box_distance(p), 0, 1e-12);
        assert_close(sqrt(d2), c.distance, 0, 1e-12);
        assert_true(c.face >= 0 && c.face < 12);
    }
    lf_surface_close(surface);
    lf_mesh_free(mesh);
}

/* Far from the origin and of another unit: Embree's float must not show. */
static void test_far_and_large(void **state)
{
    (void)state;
    const double shift[3] = {1e6, -3e6, 2e6};
    const double scale[9] = {1000, 0, 0, 0, 1000, 0, 0, 0, 1000};
    lf_mesh *mesh = lf_mesh_box(low, high);
    lf_mesh_transform(mesh, scale, shift);
    lf_surface *surface = open_surface(mesh);
    for (uint64_t k = 0; k < 2000; k++) {
        double p[3], q[3];
        random_point(k, 1, p);
        for (int i = 0; i < 3; i++)
            q[i] = 1000 * p[i] + shift[i];
        assert_close(lf_surface_closest(surface, q).distance / 1000, box_distance(p), 0, 1e-9);
    }
    lf_surface_close(surface);
    lf_mesh_free(mesh);
}

/* Every triangle alone as a surface gives the distance that the whole must not exceed; the least of
 * them is the whole's. */
static void test_against_single_triangles(void **state)
{
    (void)state;
    enum { points = 200 };
    lf_mesh *mesh = lf_mesh_torus(0.3, 0.12, 16, 10);
    lf_surface *whole = open_surface(mesh);
    double p[points][3], best[points];
    for (int k = 0; k < points; k++) {
        random_point(100 + (uint64_t)k, 1, p[k]);
        best[k] = INFINITY;
    }
    for (long f = 0; f < mesh->faces; f++) {
        lf_mesh one = {.vertices = mesh->vertices, .faces = 1, .vertex = mesh->vertex};
        one.face = mesh->face + f;
        one.colour = mesh->colour + f;
        lf_surface *part = open_surface(&one);
        for (int k = 0; k < points; k++)
            best[k] = fmin(best[k], lf_surface_closest(part, p[k]).distance);
        lf_surface_close(part);
    }
    for (int k = 0; k < points; k++)
        assert_close(lf_surface_closest(whole, p[k]).distance, best[k], 0, 1e-12);
    lf_surface_close(whole);
    lf_mesh_free(mesh);
}

static void test_rays(void **state)
{
    (void)state;
    const double centre[3] = {0.1, 0.2, 0.3}, radius = 0.4;
    lf_mesh *mesh = lf_mesh_sphere(5, radius, centre);
    lf_surface *surface = open_surface(mesh);
    for (uint64_t k = 0; k < 3000; k++) {
        double o[3], d[3], n = 0, b = 0, c = -radius * radius;
        lf_hit hit;
        random_point(2 * k, 4, o);
        random_point(2 * k + 1, 1, d);
        for (int i = 0; i < 3; i++) {
            d[i] += centre[i] - o[i];
            n += d[i] * d[i];
        }
        for (int i = 0; i < 3; i++) {
            d[i] /= sqrt(n);
            b += (o[i] - centre[i]) * d[i];
            c += (o[i] - centre[i]) * (o[i] - centre[i]);
        }
        const double root = b * b - c;
        if (fabs(root) < 0.01 || c < 0.01)
            continue; /* grazing or inside */
        const bool met = lf_surface_first_hit(surface, o, d, 0, INFINITY, &hit);
        assert_int_equal(met, root > 0);
        assert_int_equal(lf_surface_any_hit(surface, o, d, 0, INFINITY), met);
        if (!met)
            continue;
        assert_close(hit.distance, -b - sqrt(root), 0, 2e-3); /* the mesh is inscribed */
        assert_true(hit.normal[0] * d[0] + hit.normal[1] * d[1] + hit.normal[2] * d[2] < 0);
        assert_false(lf_surface_any_hit(surface, o, d, 0, 0.99 * hit.distance));
        double at[3];
        for (int i = 0; i < 3; i++)
            at[i] = o[i] + hit.distance * d[i];
        assert_below(lf_surface_closest(surface, at).distance, 1e-12);
    }
    lf_surface_close(surface);
    lf_mesh_free(mesh);
}

static void test_eight_rays(void **state)
{
    (void)state;
    lf_mesh *mesh = lf_mesh_torus(0.3, 0.12, 32, 20);
    lf_surface *surface = open_surface(mesh);
    for (uint64_t k = 0; k < 500; k++) {
        double o[3], d[8][3];
        float packet[3][8];
        random_point(k, 1, o);
        for (int j = 0; j < 8; j++) {
            random_point(1000 + 8 * k + (uint64_t)j, 1, d[j]);
            for (int i = 0; i < 3; i++)
                d[j][i] = packet[i][j] = (float)d[j][i];
        }
        const unsigned bits = lf_surface_any_hit8(surface, o, packet);
        for (int j = 0; j < 8; j++)
            assert_int_equal(bits >> j & 1, lf_surface_any_hit(surface, o, d[j], 0, INFINITY));
    }
    lf_surface_close(surface);
    lf_mesh_free(mesh);
}

static void test_threads(void **state)
{
    (void)state;
    enum { n = 5000 };
    lf_mesh *mesh = lf_mesh_torus(0.3, 0.12, 32, 20);
    lf_surface *surface = open_surface(mesh);
    double(*p)[3] = malloc(n * sizeof *p), *a = malloc(n * sizeof *a), *b = malloc(n * sizeof *b);
    for (int k = 0; k < n; k++)
        random_point((uint64_t)k, 1, p[k]);
    const int threads = omp_get_max_threads();
    omp_set_num_threads(1);
    lf_surface_distance_all(surface, n, (const double(*)[3])p, a);
    omp_set_num_threads(2);
    lf_surface_distance_all(surface, n, (const double(*)[3])p, b);
    omp_set_num_threads(threads);
    assert_memory_equal(a, b, n * sizeof *a);
    free(p);
    free(a);
    free(b);
    lf_surface_close(surface);
    lf_mesh_free(mesh);
}

static void assert_refused(const lf_mesh *mesh, const char *word)
{
    lf_surface *surface = NULL;
    lf_error err;
    assert_int_equal(lf_surface_open(mesh, &surface, &err), LF_BAD_INPUT);
    assert_null(surface);
    if (!strstr(err.text, word))
        fail_msg("'%s' does not say '%s'", err.text, word);
}

static void test_bad_meshes(void **state)
{
    (void)state;
    lf_mesh *mesh = lf_mesh_box(low, high);
    const long faces = mesh->faces;
    mesh->faces = 0;
    assert_refused(mesh, "empty");
    mesh->faces = faces;
    mesh->vertex[3][1] = NAN;
    assert_refused(mesh, "vertex 3");
    mesh->vertex[3][1] = 1e31;
    assert_refused(mesh, "vertex 3");
    mesh->vertex[3][1] = 0;
    mesh->face[5][2] = 8;
    assert_refused(mesh, "face 5");
    mesh->face[5][2] = -1;
    assert_refused(mesh, "face 5");
    for (long f = 0; f < faces; f++)
        memset(mesh->face[f], 0, sizeof mesh->face[f]);
    assert_refused(mesh, "area");
    lf_mesh_free(mesh);
    lf_surface_close(NULL);
}

static void test_one_triangle(void **state)
{
    (void)state;
    lf_mesh *mesh = lf_mesh_create(3, 1);
    for (int i = 0; i < 3; i++) {
        mesh->vertex[i][i] = 1;
        mesh->face[0][i] = i;
    }
    lf_surface *surface = open_surface(mesh);
    const double origin[3] = {0, 0, 0}, bad[3] = {0, NAN, 0}, far_away[3] = {1e200, 0, 0};
    assert_close(lf_surface_closest(surface, origin).distance, 1 / sqrt(3), 1e-14, 0);
    assert_int_equal(lf_surface_closest(surface, bad).face, -1);
    assert_true(isnan(lf_surface_closest(surface, far_away).distance));
    lf_surface_close(surface);
    lf_mesh_free(mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_box),
        cmocka_unit_test(test_far_and_large),
        cmocka_unit_test(test_against_single_triangles),
        cmocka_unit_test(test_rays),
        cmocka_unit_test(test_eight_rays),
        cmocka_unit_test(test_threads),
        cmocka_unit_test(test_bad_meshes),
        cmocka_unit_test(test_one_triangle),
    };
    return cmocka_run_group_tests_name("surface", tests, NULL, NULL);
}
