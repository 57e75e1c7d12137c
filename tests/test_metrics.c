/* test_metrics.c: IoU and Chamfer-L1 against closed forms, and what happens at the edges. */
#include <omp.h>
#include <string.h>

#include "autograd/random.h"
#include "eval/metrics.h"
#include "tests/close.h"

static const double origin[3] = {0, 0, 0};

static lf_score score(const lf_mesh *a, const lf_mesh *b, const lf_metric_options *options)
{
    lf_score s = {0};
    lf_error err = {""};
    const lf_status status = lf_score_meshes(a, b, NULL, options, &s, &err);
    if (status != LF_OK)
        fail_msg("%s", err.text);
    return s;
}

/* Concentric spheres: IoU (r1/r2)^3; Chamfer |r1 - r2| / (2 r2), the truth having edge 2 r2. */
static void spheres(void **state)
{
    (void)state;
    const lf_metric_options options = lf_metric_defaults();
    lf_mesh *truth = lf_mesh_sphere(6, 0.5, origin);
    const double scales[] = {0.95, 0.9};
    for (int i = 0; i < 2; i++) {
        const double r = scales[i];
        lf_mesh *ball = lf_mesh_sphere(6, 0.5 * r, origin);
        const lf_score s = score(ball, truth, &options);
        assert_close(s.iou, r * r * r, 5e-3, 0);
        assert_close(s.accuracy, (1 - r) / 2, i ? 5e-3 : 2e-2, 0);
        assert_close(s.completeness, (1 - r) / 2, i ? 5e-3 : 2e-2, 0);
        assert_close(s.edge, 1, 1e-3, 0);
        assert_int_equal(s.occupancy_predicted, LF_OCCUPANCY_WINDING);
        assert_false(s.empty);
        lf_mesh_free(ball);
    }
    lf_mesh *ball = lf_mesh_sphere(6, 0.45, origin);
    const lf_score turned = score(truth, ball, &options); /* the unit follows the truth */
    assert_close(turned.iou, 0.729, 5e-3, 0);
    assert_close(turned.accuracy, 0.5 / 0.9 - 0.5, 5e-3, 0);
    lf_mesh_free(ball);
    lf_mesh_free(truth);
}

/* A unit cube and the same shifted by t along x: IoU (1 - t) / (1 + t); the distance to the
 * other's surface integrates to (2 t + 4 t^3 / 3) / 6 on either side. */
static void shifted_box(void **state)
{
    (void)state;
    const double t = 0.1, low[3] = {-0.5, -0.5, -0.5}, high[3] = {0.5, 0.5, 0.5};
    const double low_b[3] = {-0.5 + t, -0.5, -0.5}, high_b[3] = {0.5 + t, 0.5, 0.5};
    lf_metric_options options = lf_metric_defaults();
    lf_mesh *a = lf_mesh_box(low_b, high_b), *b = lf_mesh_box(low, high);
    lf_score s = score(a, b, &options);
    /* the cube of IoU ends at 0.55, so it holds half of what the shifted box has beyond 0.5 */
    assert_close(s.iou, (1 - t) / (1 + t / 2), 5e-3, 0);
    /* sample to sample: where the sides coincide the nearest sample is half a spacing away */
    const double form = (2 * t + 4 * t * t * t / 3) / 6, spacing = sqrt(6.0 / 100000);
    assert_true(s.chamfer_l1 > form && s.chamfer_l1 < form + spacing / 2);
    options.exact = true;
    options.samples = 400000;
    s = score(a, b, &options);
    assert_close(s.chamfer_l1, form, 5e-3, 0);
    lf_mesh_free(a);
    lf_mesh_free(b);
}

/* Shifted inside a larger box, so that nothing leaves the cube of IoU: both meshes hold the same
 * third part far away, which counts in both. */
static void shifted_box_whole(void **state)
{
    (void)state;
    const double t = 0.05, edge = 0.5;
    const double far_low[3] = {-0.5, -0.5, -0.5}, far_high[3] = {-0.4, 0.5, 0.5};
    const double low[3] = {-0.2, -0.25, -0.25}, high[3] = {0.3, 0.25, 0.25};
    lf_mesh *a = lf_mesh_box(far_low, far_high), *b = lf_mesh_copy(a);
    lf_mesh *box = lf_mesh_box(low, high);
    const double shift[3] = {t, 0, 0};
    lf_mesh_append(a, box);
    lf_mesh_transform(box, NULL, shift);
    lf_mesh_append(b, box);
    const lf_metric_options options = lf_metric_defaults();
    const lf_score s = score(b, a, &options);
    const double common = edge * edge * (edge - t), either = edge * edge * (edge + t);
    assert_close(s.iou, (common + 0.1) / (either + 0.1), 5e-3, 0);
    lf_mesh_free(box);
    lf_mesh_free(a);
    lf_mesh_free(b);
}

/* Units cancel: both meshes larger and elsewhere give the same figures. */
static void scale_is_the_truths(void **state)
{
    (void)state;
    lf_metric_options options = lf_metric_defaults();
    options.samples = 20000;
    const double matrix[9] = {7, 0, 0, 0, 7, 0, 0, 0, 7}, shift[3] = {100, -50, 3};
    lf_mesh *a = lf_mesh_sphere(4, 0.4, origin), *b = lf_mesh_torus(0.4, 0.15, 60, 40);
    const lf_score before = score(a, b, &options);
    lf_mesh_transform(a, matrix, shift);
    lf_mesh_transform(b, matrix, shift);
    const lf_score after = score(a, b, &options);
    assert_close(after.iou, before.iou, 1e-3, 0);
    assert_close(after.chamfer_l1, before.chamfer_l1, 1e-6, 0);
    assert_close(after.edge, 7 * before.edge, 1e-9, 0);
    lf_mesh_free(a);
    lf_mesh_free(b);
}

/* The same bits with one thread and with three. */
static void threads_do_not_matter(void **state)
{
    (void)state;
    lf_metric_options options = lf_metric_defaults();
    options.samples = 10000;
    lf_mesh *a = lf_mesh_sphere(4, 0.4, origin), *b = lf_mesh_torus(0.4, 0.15, 60, 40);
    const int threads = omp_get_max_threads();
    for (int exact = 0; exact < 2; exact++) {
        options.exact = exact;
        omp_set_num_threads(1);
        const lf_score one = score(a, b, &options);
        omp_set_num_threads(3);
        const lf_score three = score(a, b, &options);
        assert_true(one.iou == three.iou && one.chamfer_l1 == three.chamfer_l1);
    }
    omp_set_num_threads(threads);
    lf_mesh_free(a);
    lf_mesh_free(b);
}

static void empty_prediction(void **state)
{
    (void)state;
    const lf_metric_options options = lf_metric_defaults();
    lf_mesh *none = lf_mesh_create(0, 0), *flat = lf_mesh_create(3, 1);
    lf_mesh *truth = lf_mesh_sphere(3, 2, origin);
    flat->face[0][1] = 1;
    flat->face[0][2] = 2; /* three equal corners: no area */
    const lf_mesh *empties[] = {none, flat};
    for (int i = 0; i < 2; i++) {
        const lf_score s = score(empties[i], truth, &options);
        assert_true(s.empty);
        assert_close(s.iou, 0, 0, 0);
        assert_close(s.chamfer_l1, sqrt(3), 1e-12, 0);
        assert_true(s.inside_truth > 0);
        assert_int_equal(s.inside_predicted, 0);
        lf_score kept = {.iou = -1};
        lf_error err = {""};
        assert_int_equal(lf_score_meshes(truth, empties[i], NULL, &options, &kept, &err),
                         LF_BAD_INPUT);
        assert_non_null(strstr(err.text, "no surface"));
        assert_close(kept.iou, -1, 0, 0);
    }
    lf_metric_options bad = options;
    bad.samples = 0;
    lf_score s;
    assert_int_equal(lf_score_meshes(truth, truth, NULL, &bad, &s, NULL), LF_BAD_INPUT);
    lf_mesh_free(none);
    lf_mesh_free(flat);
    lf_mesh_free(truth);
}

/* A truth with a face missing is not closed: its inside comes from the signed distance. */
static void open_truth(void **state)
{
    (void)state;
    lf_metric_options options = lf_metric_defaults();
    options.samples = 20000;
    lf_mesh *ball = lf_mesh_sphere(4, 0.45, origin), *truth = lf_mesh_sphere(4, 0.5, origin);
    truth->faces -= 3;
    const lf_score s = score(ball, truth, &options);
    assert_int_equal(s.occupancy_truth, LF_OCCUPANCY_SDF);
    assert_close(s.iou, 0.729, 1e-2, 0);
    truth->faces += 3;
    const lf_sdf_options thick = {LF_SDF_COMBINED, 128, 0.05};
    lf_sdf *sdf = NULL;
    lf_score t;
    assert_int_equal(lf_sdf_open(truth, &thick, &sdf, NULL), LF_OK);
    assert_int_equal(lf_score_meshes(ball, truth, sdf, &options, &t, NULL), LF_OK);
    assert_int_equal(t.occupancy_truth, LF_OCCUPANCY_SDF);
    assert_close(t.iou, 0.729 / 1.331, 2e-2, 0); /* 0.05 thicker: radius 0.55 */
    lf_sdf_close(sdf);
    lf_mesh_free(ball);
    lf_mesh_free(truth);
}

static void iou_of_flags(void **state)
{
    (void)state;
    const uint8_t none[4] = {0}, a[4] = {1, 1, 0, 0}, b[4] = {0, 1, 1, 0};
    assert_close(lf_iou(4, none, none), 1, 0, 0);
    assert_close(lf_iou(4, none, a), 0, 0, 0);
    assert_close(lf_iou(4, a, b), 1.0 / 3, 1e-15, 0);
}

/* Winding numbers against closed forms, at random points and where columns pass through vertices
 * and along sides: a box's own grid. */
static void winding_is_exact(void **state)
{
    (void)state;
    enum { n = 20000 };
    static double point[n][3];
    static uint8_t inside[n];
    lf_stream s = lf_stream_at(1, LF_RANDOM_TEST, 0, 0);
    for (long i = 0; i < n; i++)
        for (int k = 0; k < 3; k++)
            point[i][k] = 1.2 * lf_uniform(&s) - 0.6;
    lf_mesh *torus = lf_mesh_torus(0.4, 0.15, 64, 48);
    assert_int_equal(lf_winding_occupancy(torus, n, (const double(*)[3])point, inside, NULL),
                     LF_OK);
    long wrong = 0;
    for (long i = 0; i < n; i++) {
        const double d = hypot(hypot(point[i][0], point[i][2]) - 0.4, point[i][1]) - 0.15;
        wrong += fabs(d) > 2e-3 && inside[i] != (d < 0);
    }
    assert_int_equal(wrong, 0);
    lf_mesh_free(torus);
    const double low[3] = {-0.5, -0.5, -0.5}, high[3] = {0.5, 0.5, 0.5};
    lf_mesh *box = lf_mesh_box(low, high);
    for (long i = 0; i < n; i++)
        for (int k = 0; k < 3; k++)
            point[i][k] = (double)lf_index(&s, 21) * 0.0625 - 0.625; /* diagonals, sides, corners */
    assert_int_equal(lf_winding_occupancy(box, n, (const double(*)[3])point, inside, NULL), LF_OK);
    for (long i = 0; i < n; i++) {
        const double d = fmax(fabs(point[i][0]), fmax(fabs(point[i][1]), fabs(point[i][2]))) - 0.5;
        if (d != 0)
            assert_int_equal(inside[i], d < 0);
    }
    lf_mesh_free(box);
}

static void nearest_is_nearest(void **state)
{
    (void)state;
    enum { n = 500, m = 700 };
    static double a[n][3], b[m][3];
    lf_stream s = lf_stream_at(2, LF_RANDOM_TEST, 0, 0);
    for (int kind = 0; kind < 2; kind++) { /* 1: many equal coordinates */
        for (long i = 0; i < n + m; i++)
            for (int k = 0; k < 3; k++)
                (i < n ? a[i] : b[i - n])[k] = kind ? (double)lf_index(&s, 4) : lf_uniform(&s);
        double sum = 0;
        for (long i = 0; i < n; i++) {
            double best = INFINITY;
            for (long j = 0; j < m; j++)
                best = fmin(best,
                            hypot(hypot(a[i][0] - b[j][0], a[i][1] - b[j][1]), a[i][2] - b[j][2]));
            sum += best;
        }
        assert_close(lf_mean_nearest(n, (const double(*)[3])a, m, (const double(*)[3])b), sum / n,
                     1e-12, 0);
    }
    assert_close(lf_mean_nearest(1, (const double(*)[3])a, 1, (const double(*)[3])a), 0, 0, 0);
}

/* The points fill the cube evenly, and the text names every number of the definition. */
static void definition(void **state)
{
    (void)state;
    const double low[3] = {1, 2, 3}, high[3] = {2, 2.5, 3.5};
    lf_metric_options options = lf_metric_defaults();
    options.samples = 8000;
    static double point[8000][3];
    lf_metric_points(low, high, &options, point);
    long octant[8] = {0};
    for (long i = 0; i < 8000; i++) {
        const double d[3] = {point[i][0] - 1.5, point[i][1] - 2.25, point[i][2] - 3.25};
        for (int k = 0; k < 3; k++)
            assert_true(fabs(d[k]) <= 0.55);
        octant[(d[0] > 0) | (d[1] > 0) << 1 | (d[2] > 0) << 2]++;
    }
    for (int i = 0; i < 8; i++)
        assert_true(labs(octant[i] - 1000) < 30);
    const char *words[] = {"100000", "1.1", "longest edge", "times 10", "sqrt(3)", "not squared"};
    for (int i = 0; i < 6; i++)
        assert_non_null(strstr(lf_metric_text(), words[i]));
    assert_int_equal(LF_METRIC_SAMPLES, 100000);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(spheres),
        cmocka_unit_test(shifted_box),
        cmocka_unit_test(shifted_box_whole),
        cmocka_unit_test(scale_is_the_truths),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(empty_prediction),
        cmocka_unit_test(open_truth),
        cmocka_unit_test(iou_of_flags),
        cmocka_unit_test(winding_is_exact),
        cmocka_unit_test(nearest_is_nearest),
        cmocka_unit_test(definition),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
