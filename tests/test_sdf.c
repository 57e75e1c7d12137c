/* test_sdf.c: signed distance against closed forms; sign on closed, holed, overlapping, inside-out
 * and open meshes; samples. Each shape has a size (box diagonal) near 1. */
#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

#include "autograd/random.h"
#include "datasets/sdf.h"
#include "datasets/sdf_winding.h"
#include "tests/close.h"

enum { points = 10000 };
static const double zero[3] = {0, 0, 0}, low[3] = {-0.2, -0.3, -0.35}, high[3] = {0.2, 0.3, 0.35};

static double sphere_sdf(const double p[3])
{
    return sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]) - 0.2886;
}

static double box_sdf(const double p[3])
{
    double out = 0, in = -INFINITY;
    for (int i = 0; i < 3; i++) {
        const double q = fabs(p[i]) - high[i];
        out += q > 0 ? q * q : 0;
        in = fmax(in, q);
    }
    return out > 0 ? sqrt(out) : in;
}

static double torus_sdf(const double p[3])
{
    return hypot(hypot(p[0], p[2]) - 0.25, p[1]) - 0.1;
}

/* Half uniform in a cube round the shape, half near the surface. */
static void draw_points(const lf_mesh *mesh, double (*p)[3])
{
    const long half = points / 2;
    assert_int_equal(lf_mesh_sample_surface(mesh, half, 5, 0, p + half, NULL, NULL), LF_OK);
    for (long k = 0; k < points; k++) {
        lf_stream s = lf_stream_at(7, LF_RANDOM_TEST, 1, (uint64_t)k);
        const double sigma = lf_uniform(&s) < 0.5 ? 0.01 : 0.03;
        for (int i = 0; i < 3; i++)
            p[k][i] = k < half ? 1.1 * (lf_uniform(&s) - 0.5) : p[k][i] + sigma * lf_normal(&s);
    }
}

static lf_sdf *open_sdf(const lf_mesh *mesh, lf_sdf_method method)
{
    lf_sdf_options options = lf_sdf_defaults();
    options.method = method;
    lf_sdf *sdf = NULL;
    lf_error err;
    if (lf_sdf_open(mesh, &options, &sdf, &err) != LF_OK)
        fail_msg("%s", err.text);
    return sdf;
}

static void evaluate(const lf_mesh *mesh, lf_sdf_method method, const double (*p)[3], double *value)
{
    lf_sdf *sdf = open_sdf(mesh, method);
    lf_sdf_eval(sdf, points, p, value, NULL);
    lf_sdf_close(sdf);
}

/* Shares of points farther than 0.001 from the surface whose sign is wrong, in percent. */
static double wrong_sign(const double *value, const double *truth)
{
    long wrong = 0, all = 0;
    for (long k = 0; k < points; k++)
        if (fabs(truth[k]) > 0.001) {
            wrong += (value[k] < 0) != (truth[k] < 0);
            all++;
        }
    return 100.0 * (double)wrong / (double)all;
}

static void check_closed_form(lf_mesh *mesh, double (*form)(const double *), lf_sdf_method last)
{
    double(*p)[3] = malloc(points * sizeof *p), *v = malloc(points * sizeof *v);
    double *truth = malloc(points * sizeof *truth), worst = 0;
    draw_points(mesh, p);
    for (long k = 0; k < points; k++)
        truth[k] = form(p[k]);
    for (int method = LF_SDF_COMBINED; method <= (int)last; method++) {
        evaluate(mesh, (lf_sdf_method)method, (const double(*)[3])p, v);
        for (long k = 0; k < points; k++)
            worst = larger(worst, fabs(fabs(v[k]) - fabs(truth[k])));
        assert_below(wrong_sign(v, truth), 0.1);
    }
    assert_below(worst, 1e-5);
    free(p);
    free(v);
    free(truth);
    lf_mesh_free(mesh);
}

static void test_closed_forms(void **state)
{
    (void)state;
    check_closed_form(lf_mesh_box(low, high), box_sdf, LF_SDF_WINDING);
}

/* As fine as the polyhedron must be to lie within 1e-5 of the round shape. */
static void test_round_forms(void **state)
{
    (void)state;
    check_closed_form(lf_mesh_sphere(7, 0.2886 + 2e-6, zero), sphere_sdf, LF_SDF_COMBINED);
    check_closed_form(lf_mesh_torus(0.25, 0.1, 700, 280), torus_sdf, LF_SDF_COMBINED);
}

static lf_mesh *with_holes(const lf_mesh *mesh, double share)
{
    lf_mesh *out = lf_mesh_copy(mesh);
    long n = 0;
    for (long f = 0; f < mesh->faces; f++) {
        lf_stream s = lf_stream_at(3, LF_RANDOM_TEST, 2, (uint64_t)f);
        if (lf_uniform(&s) >= share)
            memcpy(out->face[n++], mesh->face[f], sizeof *out->face);
    }
    out->faces = n;
    return out;
}

/* The sign with faces removed, against the whole mesh. The limits are measured values and a margin;
 * wrong points lie in and at the holes. */
static void check_holes(lf_mesh *mesh)
{
    static const double share[4] = {0.05, 0.1, 0.2, 0.3}, limit[4] = {0.15, 0.4, 1.5, 4};
    double(*p)[3] = malloc(points * sizeof *p), *v = malloc(points * sizeof *v);
    double *truth = malloc(points * sizeof *truth);
    draw_points(mesh, p);
    evaluate(mesh, LF_SDF_COMBINED, (const double(*)[3])p, truth);
    for (int k = 0; k < 4; k++) {
        lf_mesh *holed = with_holes(mesh, share[k]);
        evaluate(holed, LF_SDF_COMBINED, (const double(*)[3])p, v);
        assert_below(wrong_sign(v, truth), limit[k]);
        evaluate(holed, LF_SDF_WINDING, (const double(*)[3])p, v);
        assert_below(wrong_sign(v, truth), limit[k]);
        lf_mesh_free(holed);
    }
    free(p);
    free(v);
    free(truth);
    lf_mesh_free(mesh);
}

static void test_holes(void **state)
{
    (void)state;
    check_holes(lf_mesh_sphere(3, 0.2886, zero));
    check_holes(lf_mesh_torus(0.25, 0.1, 48, 20));
}

/* Two overlapping boxes, one of them inside out, and a box hidden inside: one solid. */
static lf_mesh *overlapping(void)
{
    const double a0[3] = {-0.3, -0.1, -0.1}, a1[3] = {0.1, 0.1, 0.1};
    const double b0[3] = {-0.05, -0.2, -0.15}, b1[3] = {0.25, 0.2, 0.15};
    const double c0[3] = {0.1, -0.05, -0.05}, c1[3] = {0.2, 0.05, 0.05};
    lf_mesh *mesh = lf_mesh_box(a0, a1), *b = lf_mesh_box(b0, b1), *c = lf_mesh_box(c0, c1);
    for (long f = 0; f < b->faces; f++) {
        const int32_t t = b->face[f][0];
        b->face[f][0] = b->face[f][1];
        b->face[f][1] = t;
    }
    lf_mesh_append(mesh, b);
    lf_mesh_append(mesh, c);
    lf_mesh_free(b);
    lf_mesh_free(c);
    return mesh;
}

static void test_soup(void **state)
{
    (void)state;
    lf_mesh *mesh = overlapping();
    double(*p)[3] = malloc(points * sizeof *p), *v = malloc(points * sizeof *v);
    draw_points(mesh, p);
    for (int method = LF_SDF_COMBINED; method <= LF_SDF_WINDING; method++) {
        lf_sdf *sdf = open_sdf(mesh, (lf_sdf_method)method);
        const lf_sdf_report report = lf_sdf_report_of(sdf);
        assert_int_equal(report.hidden, 14); /* and the two faces of a's end within b */
        assert_int_equal(report.closed, 1);
        lf_sdf_eval(sdf, points, (const double(*)[3])p, v, NULL);
        for (long k = 0; k < points; k++) {
            const bool a =
                p[k][0] > -0.3 && p[k][0] < 0.1 && fabs(p[k][1]) < 0.1 && fabs(p[k][2]) < 0.1;
            const bool b =
                p[k][0] > -0.05 && p[k][0] < 0.25 && fabs(p[k][1]) < 0.2 && fabs(p[k][2]) < 0.15;
            if (fabs(v[k]) > 1e-6)
                assert_int_equal(v[k] < 0, a || b);
        }
        lf_sdf_close(sdf);
    }
    free(p);
    free(v);
    lf_mesh_free(mesh);
}

/* One triangle: no inside without thickness; with it, a solid sheet of twice the thickness. */
static void test_sheet(void **state)
{
    (void)state;
    lf_mesh *mesh = lf_mesh_create(3, 1);
    for (int i = 0; i < 3; i++) {
        mesh->vertex[i][i] = 1;
        mesh->face[0][i] = i;
    }
    lf_sdf_options options = lf_sdf_defaults();
    options.thickness = 0.004;
    lf_sdf *sdf = NULL;
    assert_int_equal(lf_sdf_open(mesh, &options, &sdf, NULL), LF_OK);
    double p[4][3], v[4];
    const double off[4] = {0.003, -0.003, 0.005, NAN};
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 3; i++)
            p[k][i] = 1.0 / 3 + off[k] / sqrt(3);
    lf_sdf_eval(sdf, 4, (const double(*)[3])p, v, NULL);
    assert_close(v[0], -0.001, 0, 1e-12);
    assert_close(v[1], -0.001, 0, 1e-12);
    assert_close(v[2], 0.001, 0, 1e-12);
    assert_true(isnan(v[3]));
    lf_sdf_close(sdf);
    lf_mesh_free(mesh);
}

/* A cap of a sphere as an open sheet is a bowl, not a solid. */
static void test_bowl(void **state)
{
    (void)state;
    lf_mesh *mesh = lf_mesh_sphere(4, 0.4, zero);
    long n = 0;
    for (long f = 0; f < mesh->faces; f++) {
        double y = 0;
        for (int k = 0; k < 3; k++)
            y += mesh->vertex[mesh->face[f][k]][1];
        if (y < -3 * 0.2)
            memmove(mesh->face[n++], mesh->face[f], sizeof *mesh->face);
    }
    mesh->faces = n;
    lf_sdf *sdf = open_sdf(mesh, LF_SDF_COMBINED);
    const double p[3][3] = {{0, -0.22, 0}, {0, -0.3, 0}, {0.1, -0.35, 0.1}};
    double v[3];
    long doubtful = -1;
    lf_sdf_eval(sdf, 3, p, v, &doubtful);
    for (int k = 0; k < 3; k++)
        assert_true(v[k] > 0);
    assert_int_equal(doubtful, 0);
    lf_sdf_close(sdf);
    lf_mesh_free(mesh);
}

/* A pinhole of a little over 1/128 of the sky, seen from the middle, makes points doubtful. */
static void test_doubtful(void **state)
{
    (void)state;
    lf_mesh *mesh = lf_mesh_sphere(2, 0.4, zero);
    mesh->faces -= 6;
    lf_sdf *sdf = open_sdf(mesh, LF_SDF_COMBINED);
    double(*p)[3] = malloc(points * sizeof *p), *v = malloc(points * sizeof *v);
    for (long k = 0; k < points; k++)
        for (int i = 0; i < 3; i++)
            p[k][i] = 1e-7 * (double)k;
    long doubtful = -1;
    lf_sdf_eval(sdf, points, (const double(*)[3])p, v, &doubtful);
    assert_true(doubtful > points / 2);
    for (long k = 0; k < points; k++)
        assert_true(v[k] < 0);
    free(p);
    free(v);
    lf_sdf_close(sdf);
    lf_mesh_free(mesh);
}

static void test_samples(void **state)
{
    (void)state;
    enum { n_uniform = 2000, n_near = 3000, n = n_uniform + n_near };
    lf_mesh *mesh = lf_mesh_box(low, high);
    lf_sdf *sdf = open_sdf(mesh, LF_SDF_COMBINED);
    float(*a)[4] = malloc(n * sizeof *a), (*b)[4] = malloc(n * sizeof *b);
    const int threads = omp_get_max_threads();
    omp_set_num_threads(1);
    lf_sdf_samples(sdf, n_uniform, n_near, 3, 17, a, NULL);
    omp_set_num_threads(2);
    lf_sdf_samples(sdf, n_uniform, n_near, 3, 17, b, NULL);
    omp_set_num_threads(threads);
    assert_memory_equal(a, b, n * sizeof *a);
    double mean = 0, near2 = 0;
    for (int k = 0; k < n; k++) {
        const double p[3] = {(double)a[k][0], (double)a[k][1], (double)a[k][2]};
        assert_close(a[k][3], box_sdf(p), 1e-6, 1e-7);
        for (int i = 0; k < n_uniform && i < 3; i++) {
            assert_below(fabs(p[i]), 0.55 * 0.7 + 1e-6);
            mean += p[i] / (3 * n_uniform);
        }
        if (k >= n_uniform)
            near2 += (double)(a[k][3] * a[k][3]) / n_near;
    }
    assert_below(fabs(mean), 0.02);
    const double diagonal = sqrt(0.16 + 0.36 + 0.49);
    assert_close(sqrt(near2), sqrt(0.0005) * diagonal, 0.1, 0); /* mean of 0.01^2 and 0.03^2 */
    lf_sdf_samples(sdf, n_uniform, n_near, 3, 18, b, NULL);
    assert_true(memcmp(a, b, n * sizeof *a) != 0);
    lf_sdf_samples(sdf, 0, 0, 3, 18, b, NULL);
    free(a);
    free(b);
    lf_sdf_close(sdf);
    lf_mesh_free(mesh);
}

static void test_refused(void **state)
{
    (void)state;
    lf_mesh *mesh = lf_mesh_box(low, high);
    lf_sdf *sdf = NULL;
    lf_error err;
    lf_sdf_options options = lf_sdf_defaults();
    options.directions = 100;
    assert_int_equal(lf_sdf_open(mesh, &options, &sdf, &err), LF_BAD_INPUT);
    options = lf_sdf_defaults();
    options.thickness = NAN;
    assert_int_equal(lf_sdf_open(mesh, &options, &sdf, &err), LF_BAD_INPUT);
    options = lf_sdf_defaults();
    mesh->vertex[0][0] = NAN;
    assert_int_equal(lf_sdf_open(mesh, &options, &sdf, &err), LF_BAD_INPUT);
    mesh->faces = 0;
    assert_int_equal(lf_sdf_open(mesh, &options, &sdf, &err), LF_BAD_INPUT);
    assert_null(sdf);
    lf_sdf_close(NULL);
    lf_mesh_free(mesh);
}

/* Against arc tangents, a face at a time. */
static void check_leaf(const lf_mesh *mesh, const signed char *weight, const double p[3],
                       double *largest)
{
    double want = 0;
    for (long f = 0; f < mesh->faces; f++)
        want += weight[f] * lf_mesh_winding(mesh, f, 1, p);
    lf_winding *w = lf_winding_open(mesh, weight);
    assert_close(lf_winding_at(w, p), want, 0, 1e-12);
    lf_winding_close(w);
    *largest = fmax(*largest, fabs(want));
}

/* Solid angles of exactly pi / 2, in leaves that are not full: sums of exactly half turns, of
 * either sign, and a point on a corner. */
static void test_exact_leaves(void **state)
{
    (void)state;
    double vertex[6][3] = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    int32_t face[8][3];
    double largest = 0;
    for (int32_t f = 0; f < 8; f++) {
        const bool odd = (f ^ f >> 1 ^ f >> 2) & 1; /* outward */
        face[f][0] = f & 1;
        face[f][odd ? 2 : 1] = 2 + (f >> 1 & 1);
        face[f][odd ? 1 : 2] = 4 + (f >> 2 & 1);
    }
    for (int faces = 1; faces <= 8; faces++)
        for (int sign = -1; sign <= 1; sign += 2) {
            const lf_mesh mesh = {.vertices = 6, .faces = faces, .vertex = vertex, .face = face};
            signed char weight[8];
            memset(weight, sign, sizeof weight);
            check_leaf(&mesh, weight, (const double[]){0, 0, 0}, &largest);
            check_leaf(&mesh, weight, (const double[]){0, 0, 1}, &largest);
        }
    assert_close(largest, 1, 0, 1e-12);
}

/* A leaf joins the angles of its faces by products. Layers of faces that look the same way make
 * sums of several full turns, either way. */
static void test_leaf_angles(void **state)
{
    (void)state;
    enum { faces = 8, rounds = 20000 };
    double vertex[3 * faces][3];
    int32_t face[faces][3];
    for (int32_t v = 0; v < 3 * faces; v++)
        face[v / 3][v % 3] = v;
    const lf_mesh mesh = {.vertices = 3 * faces, .faces = faces, .vertex = vertex, .face = face};
    double largest = 0;
    for (uint64_t r = 0; r < rounds; r++) {
        lf_stream s = lf_stream_at(3, LF_RANDOM_TEST, 2, r);
        signed char weight[faces];
        const double offset = lf_uniform(&s) < 0.5 ? 1e-3 : 1;
        for (int v = 0; v < 3 * faces; v++)
            for (int i = 0; i < 3; i++)
                vertex[v][i] = lf_normal(&s);
        for (int v = 0; v < 3 * faces && r % 2; v++) { /* nearly one triangle, eight times */
            vertex[v][0] = cos(2.0943951023931953 * (v % 3)) + 0.1 * vertex[v][0];
            vertex[v][1] = sin(2.0943951023931953 * (v % 3)) + 0.1 * vertex[v][1];
            vertex[v][2] *= 1e-3;
        }
        const double p[3] = {0.1 * lf_normal(&s), 0.1 * lf_normal(&s), offset * lf_normal(&s)};
        for (int f = 0; f < faces; f++)
            weight[f] = (signed char)(r % 3 && lf_uniform(&s) < 0.5 ? -1 : 1);
        check_leaf(&mesh, weight, p, &largest);
    }
    assert_true(largest > 2); /* several turns were summed */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_closed_forms), cmocka_unit_test(test_round_forms),
        cmocka_unit_test(test_holes),        cmocka_unit_test(test_soup),
        cmocka_unit_test(test_sheet),        cmocka_unit_test(test_bowl),
        cmocka_unit_test(test_doubtful),     cmocka_unit_test(test_samples),
        cmocka_unit_test(test_refused),      cmocka_unit_test(test_leaf_angles),
        cmocka_unit_test(test_exact_leaves),
    };
    return cmocka_run_group_tests_name("sdf", tests, NULL, NULL);
}
