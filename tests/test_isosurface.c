/* test_isosurface.c: marching cubes gives closed, outward meshes at the right place, and the
 * coarse-to-fine search gives the dense grid's mesh. */
#include <stdlib.h>
#include <string.h>

#include "autograd/random.h"
#include "eval/isosurface.h"
#include "eval/mc_table.h"
#include "tests/close.h"

typedef double shape_fn(const double p[3], const double *size);

typedef struct field {
    shape_fn *shape;
    const double *size;
    double invalid_above; /* points with a larger x are called invalid */
    long calls, largest;
} field;

static double length(double x, double y, double z)
{
    return sqrt(x * x + y * y + z * z);
}

/* size: radius, centre. */
static double sphere(const double p[3], const double *size)
{
    return length(p[0] - size[1], p[1] - size[2], p[2] - size[3]) - size[0];
}

/* size: half extents; the exact distance. */
static double box(const double p[3], const double *size)
{
    double q[3], inner = -INFINITY;
    for (int i = 0; i < 3; i++) {
        q[i] = fabs(p[i]) - size[i];
        inner = fmax(inner, q[i]);
    }
    return length(fmax(q[0], 0), fmax(q[1], 0), fmax(q[2], 0)) + fmin(inner, 0);
}

/* size: ring, tube. */
static double torus(const double p[3], const double *size)
{
    return length(length(p[0], p[2], 0) - size[0], p[1], 0) - size[1];
}

/* White noise of the grid point: every case of the table, ambiguous ones above all. */
static double noise(const double p[3], const double *size)
{
    const uint64_t at = (uint64_t)(int64_t)llround((p[0] + 10 * p[1] + 100 * p[2]) * 1e6);
    lf_stream s = lf_stream_at((uint64_t)size[0], LF_RANDOM_TEST, 0, at);
    return lf_uniform(&s) - size[1];
}

static double nowhere(const double p[3], const double *size)
{
    (void)p;
    return size[0];
}

static void evaluate(void *context, long n, const double (*points)[3], float *value, uint8_t *valid)
{
    field *f = context;
    f->calls++;
    f->largest = n > f->largest ? n : f->largest;
    for (long i = 0; i < n; i++) {
        value[i] = (float)f->shape(points[i], f->size);
        valid[i] = (uint8_t) !(points[i][0] > f->invalid_above);
    }
}

static lf_mesh *extract(shape_fn *shape, const double *size, const lf_iso_options *options,
                        lf_iso_report *report)
{
    field f = {shape, size, INFINITY, 0, 0};
    lf_mesh *mesh = NULL;
    lf_error err = {""};
    assert_int_equal(lf_isosurface(options, evaluate, &f, &mesh, report, &err), LF_OK);
    assert_true(f.largest <= options->batch);
    return mesh;
}

static lf_mesh_report check_closed(const lf_mesh *mesh)
{
    lf_mesh_report r = {0};
    lf_mesh_closed_check(mesh, &r);
    assert_int_equal(r.boundary, 0);
    assert_int_equal(r.non_manifold, 0);
    assert_int_equal(r.inconsistent, 0);
    assert_true(r.closed);
    return r;
}

static void assert_same_mesh(const lf_mesh *a, const lf_mesh *b)
{
    assert_int_equal(a->vertices, b->vertices);
    assert_int_equal(a->faces, b->faces);
    assert_memory_equal(a->vertex, b->vertex, (size_t)a->vertices * sizeof *a->vertex);
    assert_memory_equal(a->face, b->face, (size_t)a->faces * sizeof *a->face);
}

/* Every crossed edge of a case is used, and the sides of its triangles that have no partner are
 * exactly two a crossed edge: one segment enters it, one leaves it. */
static void table_is_consistent(void **state)
{
    (void)state;
    lf_mc_table t;
    lf_mc_table_build(&t);
    int most = 0;
    for (int inside = 0; inside < 256; inside++) {
        int side[12][12] = {{0}};
        most = t.triangles[inside] > most ? t.triangles[inside] : most;
        for (int k = 0; k < 3 * t.triangles[inside]; k++)
            side[t.edge[inside][k]][t.edge[inside][k % 3 == 2 ? k - 2 : k + 1]]++;
        for (int e = 0; e < 12; e++) {
            int in = 0, out = 0;
            for (int o = 0; o < 12; o++) {
                assert_true(side[e][o] <= 1);
                out += side[e][o] && !side[o][e];
                in += side[o][e] && !side[e][o];
            }
            const int crossed = (inside >> t.corner[e][0] & 1) != (inside >> t.corner[e][1] & 1);
            assert_int_equal(in, crossed);
            assert_int_equal(out, crossed);
        }
    }
    assert_int_equal(most, LF_MC_TRIANGLES);
}

static void sphere_is_measured(void **state)
{
    (void)state;
    const double size[4] = {0.4, 0.01, -0.02, 0.03}, pi = 3.14159265358979;
    lf_iso_options o = lf_iso_defaults();
    lf_iso_report report;
    lf_mesh *mesh = extract(sphere, size, &o, &report);
    const lf_mesh_report r = check_closed(mesh);
    assert_int_equal(r.components, 1);
    assert_int_equal(r.euler, 2);
    assert_close(lf_mesh_volume(mesh), 4.0 / 3 * pi * 0.064, 2e-3, 0);
    assert_close(lf_mesh_area(mesh), 4 * pi * 0.16, 2e-3, 0);
    for (long i = 0; i < mesh->vertices; i++)
        assert_below(fabs(sphere(mesh->vertex[i], size)), 5e-5);
    assert_int_equal(report.resolution, 128);
    assert_int_equal(report.dense_evaluations, 129L * 129 * 129);
    assert_true(report.evaluations < report.dense_evaluations / 5); /* 17 % */
    assert_int_equal(report.invalid, 0);
    lf_mesh_free(mesh);
}

static void torus_has_a_hole(void **state)
{
    (void)state;
    const double size[2] = {0.35, 0.1};
    lf_iso_options o = lf_iso_defaults();
    lf_mesh *mesh = extract(torus, size, &o, NULL);
    const lf_mesh_report r = check_closed(mesh);
    assert_int_equal(r.components, 1);
    assert_int_equal(r.euler, 0);
    assert_close(lf_mesh_volume(mesh), 2 * 9.8696044 * 0.35 * 0.01, 4e-3, 0);
    lf_mesh_free(mesh);
}

/* Thin sheets, rods, tiny spheres, torus: sparse = dense, bit for bit, for any batch. */
static void sparse_equals_dense(void **state)
{
    (void)state;
    const double sizes[][4] = {{0.4, 0.01, -0.02, 0.03}, {0.012, 0.2, -0.3, 0.1},
                               {0.5, 0.5, 0.004, 0},     {0.006, 0.4, 0.006, 0},
                               {0.35, 0.02, 0, 0},       {0.6, 0.3, 0.2, 0.1}};
    shape_fn *const shapes[] = {sphere, sphere, box, box, torus, sphere};
    for (int k = 0; k < 6; k++) {
        lf_iso_options o = lf_iso_defaults();
        lf_iso_report sparse_report, dense_report;
        o.coarse = 16;
        o.lipschitz = 1;
        lf_mesh *sparse = extract(shapes[k], sizes[k], &o, &sparse_report);
        o.batch = 1000;
        o.dense = true;
        lf_mesh *dense = extract(shapes[k], sizes[k], &o, &dense_report);
        assert_true(dense->faces > 0);
        assert_same_mesh(sparse, dense);
        assert_int_equal(dense_report.evaluations, dense_report.dense_evaluations);
        assert_true(sparse_report.evaluations < dense_report.evaluations * 2 / 3);
        check_closed(sparse);
        lf_mesh_free(sparse);
        lf_mesh_free(dense);
    }
}

/* Without the Lipschitz margin a found component is still followed to its end. */
static void surface_is_followed(void **state)
{
    (void)state;
    const double size[3] = {0.02, 0.02, 0.5}; /* a rod that few coarse corners are inside of */
    lf_iso_options o = lf_iso_defaults();
    o.coarse = 16;
    o.lipschitz = 0;
    lf_mesh *sparse = extract(box, size, &o, NULL);
    o.dense = true;
    lf_mesh *dense = extract(box, size, &o, NULL);
    assert_same_mesh(sparse, dense);
    lf_mesh_free(sparse);
    lf_mesh_free(dense);
}

/* Noise meets every case beside every other: the mesh must still be a closed 2-manifold. */
static void noise_is_closed(void **state)
{
    (void)state;
    for (int k = 0; k < 6; k++) {
        const double size[2] = {k, 0.2 + 0.12 * k};
        lf_iso_options o = {.half = 1, .coarse = 20, .lipschitz = 0, .batch = 777};
        lf_mesh *mesh = extract(noise, size, &o, NULL);
        const lf_mesh_report r = check_closed(mesh);
        assert_true(mesh->faces > 3000);
        assert_true(r.manifold);
        assert_true(lf_mesh_volume(mesh) > 0);
        lf_mesh_free(mesh);
    }
}

/* A solid that fills or leaves the cube is closed by the cube's faces. */
static void boundary_closes(void **state)
{
    (void)state;
    const double full[1] = {-1}, ball[4] = {0.5, 0.5, 0.5, 0.5},
                 third = 3.14159265358979 / 6 * 0.125;
    lf_iso_options o = {
        .half = 0.5, .coarse = 16, .refinements = 2, .lipschitz = 1, .batch = 65536};
    lf_mesh *mesh = extract(nowhere, full, &o, NULL);
    check_closed(mesh);
    assert_close(lf_mesh_volume(mesh), 1, 1e-4, 0);
    lf_mesh_free(mesh);
    mesh = extract(sphere, ball, &o, NULL); /* an eighth of a ball in the cube's corner */
    const lf_mesh_report r = check_closed(mesh);
    assert_int_equal(r.euler, 2);
    assert_close(lf_mesh_volume(mesh), third, 5e-3, 0);
    lf_mesh_free(mesh);
}

static void empty_field(void **state)
{
    (void)state;
    const double positive[1] = {1}, zero[1] = {0};
    lf_iso_options o = lf_iso_defaults();
    o.coarse = 8;
    lf_mesh *mesh = extract(nowhere, positive, &o, NULL);
    assert_int_equal(mesh->faces, 0);
    assert_int_equal(mesh->vertices, 0);
    lf_mesh_free(mesh);
    mesh = extract(nowhere, zero, &o, NULL); /* exactly 0 counts as outside */
    assert_int_equal(mesh->faces, 0);
    lf_mesh_free(mesh);
}

/* Triangles have area even where the field is exactly zero on grid points. */
static void no_zero_area(void **state)
{
    (void)state;
    const double size[3] = {0.25, 0.25, 0.25};
    lf_iso_options o = {.half = 0.5, .coarse = 16, .refinements = 1, .lipschitz = 1, .batch = 4096};
    lf_mesh *mesh = extract(box, size, &o, NULL);
    check_closed(mesh);
    for (long f = 0; f < mesh->faces; f++) {
        const double *a = mesh->vertex[mesh->face[f][0]], *b = mesh->vertex[mesh->face[f][1]],
                     *c = mesh->vertex[mesh->face[f][2]];
        double u[3], v[3];
        for (int i = 0; i < 3; i++) {
            u[i] = b[i] - a[i];
            v[i] = c[i] - a[i];
        }
        assert_true(length(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2],
                           u[0] * v[1] - u[1] * v[0]) > 1e-12);
    }
    lf_mesh_free(mesh);
}

/* Invalid points are outside and counted. */
static void invalid_is_outside(void **state)
{
    (void)state;
    const double size[4] = {0.4, 0, 0, 0};
    lf_iso_options o = {
        .half = 0.5, .coarse = 16, .refinements = 2, .lipschitz = 1, .batch = 65536};
    field f = {sphere, size, 0.0, 0, 0};
    lf_mesh *mesh = NULL;
    lf_iso_report report;
    assert_int_equal(lf_isosurface(&o, evaluate, &f, &mesh, &report, NULL), LF_OK);
    check_closed(mesh);
    assert_true(report.invalid > 0);
    assert_close(lf_mesh_volume(mesh), 2.0 / 3 * 3.14159265358979 * 0.064, 5e-3, 0);
    lf_mesh_free(mesh);
}

static void bad_options(void **state)
{
    (void)state;
    const lf_iso_options good = lf_iso_defaults();
    lf_iso_options bad[8] = {good, good, good, good, good, good, good, good};
    bad[0].half = 0;
    bad[1].half = NAN;
    bad[2].coarse = 1;
    bad[3].coarse = 100000;
    bad[4].refinements = -1;
    bad[5].refinements = 40;
    bad[6].lipschitz = NAN;
    bad[7].batch = 0;
    for (int i = 0; i < 8; i++) {
        lf_mesh *mesh = NULL;
        lf_error err = {""};
        field f = {0};
        assert_int_equal(lf_isosurface(&bad[i], evaluate, &f, &mesh, NULL, &err), LF_BAD_INPUT);
        assert_null(mesh);
        assert_true(strlen(err.text) > 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(table_is_consistent), cmocka_unit_test(sphere_is_measured),
        cmocka_unit_test(torus_has_a_hole),    cmocka_unit_test(sparse_equals_dense),
        cmocka_unit_test(surface_is_followed), cmocka_unit_test(noise_is_closed),
        cmocka_unit_test(boundary_closes),     cmocka_unit_test(empty_field),
        cmocka_unit_test(no_zero_area),        cmocka_unit_test(invalid_is_outside),
        cmocka_unit_test(bad_options),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
