/* test_mesh.c: measures of closed shapes, closedness, normalisation, samples of the surface. */
#include "tests/close.h"

#include <string.h>

#include "datasets/mesh.h"

static const double pi = 3.14159265358979323846;
static const double origin[3] = {0, 0, 0};

static void expect_closed(const lf_mesh *m, long euler, long components)
{
    lf_mesh_report r = {0};
    lf_mesh_closed_check(m, &r);
    assert_true(r.closed && r.manifold);
    assert_int_equal(r.euler, euler);
    assert_int_equal(r.components, components);
    assert_int_equal(2 * r.edges, 3 * m->faces);
}

static void test_closed_shapes(void **state)
{
    (void)state;
    const double low[3] = {-1, -2, -3}, high[3] = {1, 3, 0.5}, centre[3] = {0.3, -0.2, 4};
    lf_mesh *box = lf_mesh_box(low, high), *sphere = lf_mesh_sphere(4, 2, centre),
            *torus = lf_mesh_torus(1, 0.25, 96, 48);
    expect_closed(box, 2, 1);
    expect_closed(sphere, 2, 1);
    expect_closed(torus, 0, 1);
    assert_int_equal(sphere->faces, 20 * 256);
    assert_close(lf_mesh_volume(box), 35, 1e-14, 0);
    assert_close(lf_mesh_area(box), 2 * (10 + 7 + 17.5), 1e-14, 0);
    assert_close(lf_mesh_volume(sphere), 4 * pi * 8 / 3, 5e-3, 0);
    assert_close(lf_mesh_area(sphere), 16 * pi, 3e-3, 0);
    assert_close(lf_mesh_volume(torus), 2 * pi * pi * 0.0625, 5e-3, 0);
    assert_close(lf_mesh_winding(sphere, 0, sphere->faces, centre), 1, 1e-12, 0);
    assert_close(lf_mesh_winding(sphere, 0, sphere->faces, origin), 0, 0, 1e-12);
    assert_close(lf_mesh_winding(torus, 0, torus->faces, origin), 0, 0, 1e-12);
    lf_mesh_append(box, sphere);
    expect_closed(box, 4, 2);
    assert_close(lf_mesh_winding(box, 12, sphere->faces, centre), 1, 1e-12, 0);
    lf_mesh_free(box);
    lf_mesh_free(sphere);
    lf_mesh_free(torus);
}

static void test_open_shapes(void **state)
{
    (void)state;
    const double high[3] = {1, 1, 1};
    lf_mesh *m = lf_mesh_box(origin, high);
    lf_mesh_report r = {0};
    m->faces = 11;
    lf_mesh_closed_check(m, &r);
    assert_false(r.closed);
    assert_int_equal(r.boundary, 3);
    assert_true(r.manifold);
    m->faces = 12;
    const int32_t turn = m->face[3][0];
    m->face[3][0] = m->face[3][1];
    m->face[3][1] = turn;
    lf_mesh_closed_check(m, &r);
    assert_false(r.closed || r.manifold);
    assert_int_equal(r.inconsistent, 3);
    m->face[3][1] = m->face[3][0];
    m->face[3][0] = turn;
    memcpy(m->face[0], m->face[1], sizeof *m->face); /* one face twice, one gone */
    lf_mesh_closed_check(m, &r);
    assert_true(r.non_manifold > 0 && r.boundary > 0);
    lf_mesh_free(m);
}

static void test_normalise(void **state)
{
    (void)state;
    const double high[3] = {30, 40, 120};
    lf_error err = {""};
    lf_mesh *m = lf_mesh_box(origin, high), *copy = lf_mesh_copy(m);
    double low[3], top[3];
    assert_int_equal(lf_mesh_normalise(m, &err), LF_OK);
    lf_mesh_bounds(m, low, top);
    for (int i = 0; i < 3; i++) {
        assert_close(top[i], high[i] / 260, 1e-14, 0);
        assert_close(low[i], -top[i], 1e-14, 0);
    }
    /* a sheet in a slanted plane */
    const double c = cos(0.7), s = sin(0.7);
    const double flatten[9] = {c, -s, 0, s, c, 0, c + 2 * s, 2 * c - s, 0};
    lf_mesh_transform(copy, flatten, high);
    lf_mesh *same = lf_mesh_copy(copy);
    assert_int_equal(lf_mesh_normalise(copy, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "flat sheet"));
    assert_memory_equal(copy->vertex, same->vertex, 8 * sizeof *same->vertex);
    copy->faces = 0;
    assert_int_equal(lf_mesh_normalise(copy, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "no face"));
    copy->faces = 12;
    memset(copy->vertex, 0, 8 * sizeof *copy->vertex);
    assert_int_equal(lf_mesh_normalise(copy, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "one point"));
    lf_mesh_free(m);
    lf_mesh_free(copy);
    lf_mesh_free(same);
}

static void test_transform_and_weld(void **state)
{
    (void)state;
    const double mirror[9] = {-1, 0, 0, 0, 2, 0, 0, 0, 1}, shift[3] = {1, 2, 3};
    lf_mesh *m = lf_mesh_sphere(2, 1, origin);
    const double volume = lf_mesh_volume(m);
    lf_mesh_transform(m, mirror, shift);
    assert_close(lf_mesh_volume(m), 2 * volume, 1e-12, 0);
    const long vertices = m->vertices;
    lf_mesh *soup = lf_mesh_create(3 * m->faces, m->faces);
    for (long i = 0; i < 3 * m->faces; i++) {
        memcpy(soup->vertex[i], m->vertex[m->face[i / 3][i % 3]], sizeof *m->vertex);
        soup->face[i / 3][i % 3] = (int32_t)i;
    }
    lf_mesh_weld(soup);
    assert_int_equal(soup->vertices, vertices);
    expect_closed(soup, 2, 1);
    assert_close(lf_mesh_volume(soup), 2 * volume, 1e-12, 0);
    lf_mesh_free(m);
    lf_mesh_free(soup);
}

/* Uniform on the sphere: second moments 1/3; on a box: share of each side; prefixes agree. */
static void test_sample_surface(void **state)
{
    (void)state;
    enum { n = 40000 };
    lf_error err = {""};
    double(*p)[3] = malloc(n * sizeof *p), (*q)[3] = malloc(n * sizeof *q), moment[3] = {0};
    int32_t *face = malloc(n * sizeof *face);
    lf_mesh *sphere = lf_mesh_sphere(4, 1, origin);
    assert_int_equal(lf_mesh_sample_surface(sphere, n, 7, 3, p, NULL, &err), LF_OK);
    assert_int_equal(lf_mesh_sample_surface(sphere, 100, 7, 3, q, NULL, &err), LF_OK);
    assert_memory_equal(p, q, 100 * sizeof *p);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < 3; j++)
            moment[j] += p[i][j] * p[i][j] / n;
    for (int j = 0; j < 3; j++)
        assert_close(moment[j], 1.0 / 3, 0, 0.006); /* 4 standard deviations of 0.0015 */
    const double high[3] = {1, 2, 3};
    lf_mesh *box = lf_mesh_box(origin, high);
    long bottom = 0;
    assert_int_equal(lf_mesh_sample_surface(box, n, 7, 3, p, face, &err), LF_OK);
    for (int i = 0; i < n; i++)
        bottom += p[i][1] == 0;
    assert_close((double)bottom / n, 3.0 / 22, 0, 0.007);
    assert_true(face[0] >= 0 && face[0] < 12);
    memset(box->vertex, 0, 8 * sizeof *box->vertex);
    assert_int_equal(lf_mesh_sample_surface(box, n, 7, 3, p, face, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "area"));
    free(p);
    free(q);
    free(face);
    lf_mesh_free(box);
    lf_mesh_free(sphere);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_closed_shapes),  cmocka_unit_test(test_open_shapes),
        cmocka_unit_test(test_normalise),      cmocka_unit_test(test_transform_and_weld),
        cmocka_unit_test(test_sample_surface),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
