/* test_procedural.c: procedural shapes are closed, oriented, normalised, various and repeatable. */
#include "tests/close.h"

#include <string.h>

#include "autograd/random.h"
#include "datasets/procedural.h"

enum { SHAPES = 60 };

static const char *const families[3] = {"chair", "airplane", "car"};

static lf_mesh *make(const char *family, uint64_t seed, uint64_t index, lf_parts *parts)
{
    lf_mesh *mesh = NULL;
    lf_error err = {"no message"};
    if (lf_procedural_mesh(family, seed, index, &mesh, parts, &err) != LF_OK)
        fail_msg("%s", err.text);
    return mesh;
}

/* One part as a mesh of its own. */
static lf_mesh *cut_part(const lf_mesh *mesh, const lf_parts *parts, int i)
{
    lf_mesh *part = lf_mesh_copy(mesh);
    part->faces = parts->first[i + 1] - parts->first[i];
    memmove(part->face, part->face + parts->first[i], (size_t)part->faces * sizeof *part->face);
    return part;
}

static void check_part(const lf_mesh *mesh, const lf_parts *parts, int i)
{
    lf_mesh *part = cut_part(mesh, parts, i);
    lf_mesh_report r = {0};
    lf_mesh_closed_check(part, &r);
    assert_true(r.closed && r.manifold);
    assert_int_equal(r.euler, 2);
    assert_int_equal(r.components, 1);
    assert_true(lf_mesh_volume(part) > 1e-7);
    lf_mesh_free(part);
}

static void test_parts_are_closed_and_outward(void **state)
{
    (void)state;
    for (int f = 0; f < 3; f++)
        for (int s = 0; s < SHAPES; s++) {
            lf_parts parts;
            lf_mesh *mesh = make(families[f], 5, (uint64_t)s, &parts);
            assert_true(parts.count >= 3 && parts.count <= LF_PARTS_MAX);
            assert_int_equal(parts.first[0], 0);
            assert_int_equal(parts.first[parts.count], mesh->faces);
            assert_true(mesh->faces < 3000);
            for (int i = 0; i < parts.count; i++)
                check_part(mesh, &parts, i);
            lf_mesh_free(mesh);
        }
}

static void test_normalised_and_coloured(void **state)
{
    (void)state;
    for (int f = 0; f < 3; f++)
        for (int s = 0; s < SHAPES; s++) {
            lf_mesh *mesh = make(families[f], 6, (uint64_t)s, NULL);
            double low[3], high[3], diagonal = 0;
            lf_mesh_bounds(mesh, low, high);
            for (int j = 0; j < 3; j++) {
                assert_close(low[j], -high[j], 0, 1e-12);
                diagonal += (high[j] - low[j]) * (high[j] - low[j]);
            }
            assert_close(diagonal, 1, 1e-12, 0);
            for (long i = 0; i < 3 * mesh->faces; i++)
                assert_true(mesh->colour[i / 3][i % 3] >= 0 && mesh->colour[i / 3][i % 3] <= 1);
            lf_mesh_free(mesh);
        }
}

/* Left and right mirror each other but for details; the front is at -z. */
static double mean_of(const lf_mesh *mesh, int axis, double where_low, double where_high)
{
    double sum = 0, weight = 1e-300;
    enum { n = 4000 };
    static double p[n][3];
    assert_int_equal(lf_mesh_sample_surface(mesh, n, 1, 1, p, NULL, NULL), LF_OK);
    for (int i = 0; i < n; i++)
        if (p[i][1] >= where_low && p[i][1] <= where_high) {
            sum += p[i][axis];
            weight += 1;
        }
    return sum / weight;
}

static void test_frame(void **state)
{
    (void)state;
    int backs = 0, fins = 0;
    for (int s = 0; s < SHAPES; s++) {
        lf_mesh *chair = make("chair", 7, (uint64_t)s, NULL);
        lf_mesh *plane = make("airplane", 7, (uint64_t)s, NULL);
        lf_mesh *car = make("car", 7, (uint64_t)s, NULL);
        double low[3], high[3];
        lf_mesh_bounds(chair, low, high);
        backs += mean_of(chair, 2, 0.7 * high[1], high[1]) > 0.05; /* the back behind */
        lf_mesh_bounds(plane, low, high);
        fins += mean_of(plane, 2, 0.85 * high[1], high[1]) > 0.1; /* the fin at the tail */
        assert_close(mean_of(plane, 0, low[1], high[1]), 0, 0, 0.03);
        lf_mesh_bounds(car, low, high);
        assert_true(high[2] > high[0] && high[2] > high[1]); /* longest along z */
        for (long i = 0; i < car->faces; i++)                /* the yellow lights in front */
            if (car->colour[i][0] > 0.94f && car->colour[i][2] < 0.8f)
                assert_true(car->vertex[car->face[i][0]][2] < 0.75 * low[2]);
        lf_mesh_free(chair);
        lf_mesh_free(plane);
        lf_mesh_free(car);
    }
    /* some chairs have high arms, of some airplanes a propeller's blade is the highest point */
    assert_true(backs > 0.9 * SHAPES && fins > 0.9 * SHAPES);
}

static void test_same_name_same_shape(void **state)
{
    (void)state;
    for (int f = 0; f < 3; f++) {
        lf_mesh *a = make(families[f], 8, 3, NULL), *b = make(families[f], 8, 3, NULL);
        assert_int_equal(a->faces, b->faces);
        assert_int_equal(a->vertices, b->vertices);
        assert_memory_equal(a->vertex, b->vertex, (size_t)a->vertices * sizeof *a->vertex);
        assert_memory_equal(a->face, b->face, (size_t)a->faces * sizeof *a->face);
        assert_memory_equal(a->colour, b->colour, (size_t)a->faces * sizeof *a->colour);
        lf_mesh_free(a);
        lf_mesh_free(b);
    }
}

/* No two of the shapes of a family have the same volume and area; seeds are independent. */
static void test_shapes_differ(void **state)
{
    (void)state;
    for (int f = 0; f < 3; f++) {
        double area[2 * SHAPES];
        for (int s = 0; s < 2 * SHAPES; s++) {
            lf_mesh *mesh = make(families[f], s < SHAPES ? 9 : 10, (uint64_t)(s % SHAPES), NULL);
            area[s] = lf_mesh_area(mesh);
            for (int t = 0; t < s; t++)
                assert_true(fabs(area[t] - area[s]) > 1e-7);
            lf_mesh_free(mesh);
        }
    }
}

/* The share of the unit cube inside, by the exact test, lies where such objects have it; and the
 * parts' volumes bound it from above. */
static void test_inside(void **state)
{
    (void)state;
    for (int f = 0; f < 3; f++)
        for (int s = 0; s < 5; s++) {
            enum { n = 3000 };
            lf_parts parts;
            lf_mesh *mesh = make(families[f], 11, (uint64_t)s, &parts);
            lf_stream r = lf_stream_at(11, LF_RANDOM_TEST, (uint64_t)f, (uint64_t)s);
            int inside = 0;
            for (int i = 0; i < n; i++) {
                double p[3];
                for (int j = 0; j < 3; j++)
                    p[j] = lf_uniform(&r) - 0.5;
                inside += lf_procedural_inside(mesh, &parts, p);
            }
            const double share = (double)inside / n, bound = lf_mesh_volume(mesh);
            assert_true(share > 0.002 && share < 0.4);
            assert_true(share < bound + 4 * sqrt(bound / n));
            const double out[3] = {0.6, 0, 0};
            assert_false(lf_procedural_inside(mesh, &parts, out));
            lf_mesh_free(mesh);
        }
}

/* Chairs: every part is at least 0.02 thick in all directions of the axes. */
static void test_chairs_are_thick_enough(void **state)
{
    (void)state;
    for (int s = 0; s < SHAPES; s++) {
        lf_parts parts;
        lf_mesh *mesh = make("chair", 12, (uint64_t)s, &parts);
        for (int i = 0; i < parts.count; i++) {
            lf_mesh *part = cut_part(mesh, &parts, i);
            double low[3], high[3];
            lf_mesh_bounds(part, low, high);
            for (int j = 0; j < 3; j++)
                assert_true(high[j] - low[j] > 0.02);
            lf_mesh_free(part);
        }
        lf_mesh_free(mesh);
    }
}

static void test_unknown_family(void **state)
{
    (void)state;
    lf_mesh *mesh = NULL;
    lf_error err = {""};
    assert_int_equal(lf_procedural_mesh("boat", 1, 1, &mesh, NULL, &err), LF_BAD_INPUT);
    assert_null(mesh);
    assert_non_null(strstr(err.text, "'boat' is no procedural family; allowed are chair"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_parts_are_closed_and_outward),
        cmocka_unit_test(test_normalised_and_coloured),
        cmocka_unit_test(test_frame),
        cmocka_unit_test(test_same_name_same_shape),
        cmocka_unit_test(test_shapes_differ),
        cmocka_unit_test(test_inside),
        cmocka_unit_test(test_chairs_are_thick_enough),
        cmocka_unit_test(test_unknown_family),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
