/* test_compared.c: the compared systems of reconstruction, DISN, FvOR and IBRNet, and the ablations
 * that leave out vectors or attention, with random weights: which changes leave the prediction as
 * it is and which do not, gradients, tiles and threads. [method.md 5c]
 */
#include <omp.h>

#include "autograd/random.h"
#include "tests/recon_scene.h"

typedef struct kind {
    const char *name, *plain, *c8; /* with either backbone */
    bool rolls;                    /* with c8, quarter turns of a view change nothing */
    bool turned, shifted;          /* another frame of the object changes the prediction */
} kind;

/* Either backbone. */
#define WITH(keys) keys ";model.backbone=plain", keys ";model.backbone=c8"
static const kind kinds[] = {
    {"disn", WITH("model.type=disn;model.sample_image=false"), .rolls = true, .turned = true,
     .shifted = true},
    /* its backbone sees the coordinates of the pixels */
    {"fvor", WITH("model.type=fvor;model.sample_image=false"), .turned = true, .shifted = true},
    /* it is told directions, no places */
    {"ibrnet-sdf", WITH("model.type=ibrnet-sdf"), .rolls = true, .turned = true},
    {"max-pool", WITH("model.fusion=max-pool"), .rolls = true},
    {"smoothed", WITH("model.antialias=true"), .rolls = true},
    {"scalars", WITH("model.vectors=0"), .rolls = true},
    {"equivariant", WITH("model.type=equivariant"), .rolls = true},
};
enum { KINDS = sizeof kinds / sizeof *kinds };

static const double exactly = EXACT ? 1e-11 : 2e-5;

/* ---- what changes nothing ---- */

static void the_order_of_the_views_changes_nothing(void **state)
{
    (void)state;
    enum { N = SIZE * SIZE * CHANNELS };
    for (int k = 0; k < KINDS; k++) {
        net n;
        open_net(&n, kinds[k].plain);
        scene *s = make_scene(), *mixed = make_scene();
        for (int draw = 0; draw < 3; draw++) {
            lf_stream r = lf_stream_at(1, LF_RANDOM_GROUP, (uint64_t)draw, 0);
            int order[V] = {0};
            for (int v = 1; v < V; v++) { /* Fisher-Yates, inside out */
                const int other = (int)lf_index(&r, v + 1);
                order[v] = order[other];
                order[other] = v;
            }
            for (int v = 0; v < V; v++) {
                mixed->views.camera[v] = s->views.camera[order[v]];
                memcpy(mixed->image + v * N, s->image + order[v] * N, N * sizeof(lf_real));
            }
            assert_below(change(&n, s, mixed), exactly);
        }
        free(s);
        free(mixed);
        close_net(&n);
    }
}

static lf_motion random_motion(uint64_t draw, double translation)
{
    lf_stream r = lf_stream_at(1, LF_RANDOM_GROUP, draw, 1);
    return lf_motion_random(&r, translation);
}

/* The object turned with its cameras: its own frame turns with them. */
static void turning_object_and_cameras_changes_nothing(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++) {
        net n;
        open_net(&n, kinds[k].plain);
        scene *s = make_scene(), *turned = make_scene();
        for (uint64_t draw = 0; draw < 3; draw++) {
            const lf_motion g = random_motion(draw, 0);
            memcpy(turned->views.object, g.rotation, sizeof g.rotation);
            for (int v = 0; v < V; v++)
                turned->views.camera[v] = lf_camera_move(&s->views.camera[v], &g);
            assert_below(change(&n, s, turned), exactly);
        }
        free(s);
        free(turned);
        close_net(&n);
    }
}

static double defect_of_rolls(const char *more)
{
    net n;
    open_net(&n, more);
    scene *s = make_scene();
    double worst = 0;
    for (uint64_t draw = 0; draw < 3; draw++) {
        lf_stream r = lf_stream_at(1, LF_RANDOM_GROUP, draw, 2);
        int quarters[V];
        for (int v = 0; v < V; v++)
            quarters[v] = (int)lf_index(&r, 4);
        scene *rolled = make_scene();
        roll(rolled, quarters);
        worst = larger(worst, change(&n, s, rolled));
        free(rolled);
    }
    free(s);
    close_net(&n);
    return worst;
}

static void rolled_views_change_nothing_with_c8_unless_pixels_have_coordinates(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++) {
        assert_true(defect_of_rolls(kinds[k].plain) > 1e-3);
        if (kinds[k].rolls)
            assert_below(defect_of_rolls(kinds[k].c8), exactly);
        else
            assert_true(defect_of_rolls(kinds[k].c8) > 1e-3);
    }
}

/* ---- what changes the prediction ---- */

/* The object's frame moved, rays and images the same: the equivariant network and its ablations see
 * no difference. */
static void another_frame_changes_the_prediction(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++) {
        net n;
        open_net(&n, kinds[k].plain);
        scene *s = make_scene(), *moved = make_scene();
        for (uint64_t draw = 0; draw < 3; draw++) {
            for (int axis = -1; axis < 3; axis++) { /* a rotation, a shift along each axis */
                lf_motion g = random_motion(draw, 0);
                if (axis >= 0) {
                    lf_rotation_identity(g.rotation);
                    g.translation[axis] = draw ? -0.3 : 0.2;
                }
                move(s, &g, moved);
                const double e = change(&n, s, moved);
                if (!(axis < 0 ? kinds[k].turned : kinds[k].shifted))
                    assert_below(e, EXACT ? 1e-9 : 1e-4);
                else if (!(e > 1e-3))
                    fail_msg("%s: a motion changes the prediction by %g", kinds[k].name, e);
            }
        }
        free(s);
        free(moved);
        close_net(&n);
    }
}

/* DISN's position, FvOR's volume and IBRNet's directions are told apart from the images: with black
 * images, other points still have other distances. */
static void the_place_counts_without_images(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++) {
        net n;
        if (!kinds[k].turned)
            continue;
        open_net(&n, kinds[k].plain);
        scene *s = make_scene();
        memset(s->image, 0, sizeof s->image);
        double x[Q];
        distances(&n, s, x);
        double low = x[0], high = x[0];
        for (int q = 1; q < Q; q++) {
            low = fmin(low, x[q]);
            high = fmax(high, x[q]);
        }
        assert_true(high - low > 1e-4);
        free(s);
        close_net(&n);
    }
}

/* ---- objects ---- */

/* Two objects in one step: each point is told of its own. */
static void points_know_their_own_object(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++) {
        net n;
        open_net(&n, kinds[k].plain);
        scene *a = make_scene(), *b = make_scene();
        for (int i = 0; i < PIXELS; i++)
            b->image[i] = a->image[PIXELS - 1 - i];
        double alone[2 * Q];
        distances(&n, a, alone);
        distances(&n, b, alone + Q);

        const long grid = n.model.grid * n.model.grid * n.model.grid;
        double(*voxel)[3] = calloc((size_t)(grid + 1), sizeof *voxel);
        lf_real *image = calloc(2 * PIXELS, sizeof *image);
        assert_true(voxel && image);
        memcpy(image, a->image, sizeof a->image);
        memcpy(image + PIXELS, b->image, sizeof b->image);
        lf_projection p = lf_projection_create(2 * Q), on_grid = lf_projection_create(2 * grid);
        if (grid > 0)
            lf_recon_grid(&n.model, voxel);
        for (int i = 0; i < 2; i++) {
            lf_projection_fill(&p, i * Q, Q, (const double(*)[3])a->point, &a->views, i * V);
            lf_projection_fill(&on_grid, i * grid, grid, (const double(*)[3])voxel, &a->views,
                               i * V);
        }
        const lf_recon_points points = points_of(&p, 2 * Q), voxels = points_of(&on_grid, 2 * grid);
        const lf_recon_images images = {2 * V, V, image, grid > 0 ? &voxels : NULL};
        lf_real sdf[2 * Q];
        lf_recon_work *work = lf_recon_work_create(&n.model, 7);
        lf_recon_encode(work, &images);
        lf_recon_predict(work, &points, 1, sdf, NULL);
        assert_below(relative_error(sdf, alone, 2 * Q), 1e-4);
        assert_true(relative_error(sdf, alone + Q, Q) > 1e-3);
        lf_recon_work_free(work);
        lf_projection_free(&p);
        lf_projection_free(&on_grid);
        free(voxel);
        free(image);
        free(a);
        free(b);
        close_net(&n);
    }
}

/* ---- steps ---- */

static void gradient_of_the_whole_model(void **state)
{
    (void)state;
    if (!EXACT)
        skip();
    for (int k = 0; k < KINDS; k++) {
        assert_below(gradient_defect(kinds[k].plain), 1e-6);
        assert_below(gradient_defect(kinds[k].c8), 1e-6);
    }
}

static void threads_and_tiles_change_no_result(void **state)
{
    (void)state;
    const int most = omp_get_max_threads();
    for (int k = 0; k < KINDS; k++) {
        net n;
        open_net(&n, kinds[k].plain);
        scene *s = make_scene();
        omp_set_num_threads(1);
        stepped one = step(&n, s, 3);
        assert_true(isfinite(one.loss) && one.loss > 0);
        omp_set_num_threads(3);
        stepped more = step(&n, s, 3), whole = step(&n, s, Q);
        const size_t bytes = (size_t)one.size * sizeof(lf_real);
        assert_true(more.loss == one.loss);
        assert_memory_equal(more.grad, one.grad, bytes);
        assert_memory_equal(more.values, one.values, bytes);
        assert_close(whole.loss, one.loss, EXACT ? 1e-13 : 1e-5, 0);
        assert_below(relative_error(whole.grad, one.grad, one.size), EXACT ? 1e-12 : 1e-4);
        assert_close(one.loss, plain_step(&n, s, true), EXACT ? 1e-13 : 1e-5, 0);
        assert_below(relative_error(one.grad, lf_store_grads(n.store), one.size),
                     EXACT ? 1e-12 : 1e-4);
        free_step(&one);
        free_step(&more);
        free_step(&whole);
        free(s);
        close_net(&n);
    }
    omp_set_num_threads(most);
}

/* A NaN must reach the loss or the gradient, wherever it starts. */
static void no_op_hides_a_nan(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++) {
        net n;
        open_net(&n, kinds[k].plain);
        scene *s = make_scene();
        for (int i = 0; i < lf_store_count(n.store); i++) {
            const lf_parameter *p = lf_store_at(n.store, i);
            if (!p->trainable)
                continue;
            const lf_real old = lf_values(p)[0];
            lf_values(p)[0] = NAN;
            stepped a = step(&n, s, 16);
            bool found = !isfinite(a.loss);
            for (long j = 0; j < a.size && !found; j++)
                found = !isfinite(a.grad[j]);
            if (!found)
                fail_msg("%s: NaN in %s reaches neither the loss nor a gradient", kinds[k].name,
                         p->name);
            free_step(&a);
            lf_values(p)[0] = old;
        }
        free(s);
        close_net(&n);
    }
}

static void a_point_that_no_view_sees_has_a_finite_distance(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++) {
        net n;
        open_net(&n, kinds[k].plain);
        scene *s = make_scene();
        for (int a = 0; a < 3; a++)
            s->point[5][a] = a ? 1.5 : 0; /* in front of some cameras, in no image */
        sight t;
        open_sight(&t, &n.model, s);
        for (int v = 0; v < V; v++)
            assert_int_equal(t.points.mask[5 * V + v], 0);
        lf_real sdf[Q];
        uint8_t valid[Q];
        lf_recon_work *work = lf_recon_work_create(&n.model, 16);
        lf_recon_encode(work, &t.images);
        lf_recon_predict(work, &t.points, 10, sdf, valid);
        for (int q = 0; q < Q; q++) {
            assert_true(isfinite(sdf[q]));
            assert_int_equal(valid[q], q != 5);
        }
        lf_recon_work_free(work);
        close_sight(&t);
        free(s);
        close_net(&n);
    }
}

/* ---- shapes ---- */

static void the_grid_spans_the_unit_cube(void **state)
{
    (void)state;
    net n;
    open_net(&n, "model.type=fvor;model.grid=9");
    assert_int_equal(n.model.grid, 9);
    double(*point)[3] = calloc(729, sizeof *point);
    assert_non_null(point);
    lf_recon_grid(&n.model, point);
    static const struct {
        long at;
        double x, y, z;
    } some[] = {{0, -0.5, -0.5, -0.5},    {1, -0.375, -0.5, -0.5}, {9, -0.5, -0.375, -0.5},
                {81, -0.5, -0.5, -0.375}, {364, 0, 0, 0},          {728, 0.5, 0.5, 0.5}};
    for (size_t i = 0; i < sizeof some / sizeof *some; i++) {
        assert_close(point[some[i].at][0], some[i].x, 0, 1e-15);
        assert_close(point[some[i].at][1], some[i].y, 0, 1e-15);
        assert_close(point[some[i].at][2], some[i].z, 0, 1e-15);
    }
    free(point);
    close_net(&n);
}

/* FvOR's backbone sees column and row of a pixel behind its channels. */
static void pixels_have_coordinates(void **state)
{
    (void)state;
    net n;
    open_net(&n, kinds[1].plain);
    scene *s = make_scene();
    lf_tape *tape = lf_tape_create();
    lf_tensor *x = lf_leaf(tape, 4, LF_DIMS(V, SIZE, SIZE, CHANNELS), s->image, NULL);
    const lf_tensor *y = n.model.config.network->view(tape, &n.model, x);
    assert_int_equal(lf_cols(y), CHANNELS + 2);
    for (long i = 0; i < lf_rows(y); i++) {
        const lf_real *row = y->value + i * (CHANNELS + 2);
        assert_memory_equal(row, s->image + i * CHANNELS, CHANNELS * sizeof *row);
        assert_close(row[CHANNELS], (double)(i % SIZE - 16) / 16, 0, 1e-6);
        assert_close(row[CHANNELS + 1], (double)(i / SIZE % SIZE - 16) / 16, 0, 1e-6);
    }
    lf_tape_free(tape);
    free(s);
    close_net(&n);
}

static void what_is_known_of_objects_has_its_shape(void **state)
{
    (void)state;
    static const long expected[KINDS][2] = {
        {1, 6}, {125, 8}}; /* numbers of places, channels; 0: nothing is known */
    for (int k = 0; k < KINDS; k++) {
        net n;
        open_net(&n, kinds[k].plain);
        scene *s = make_scene();
        sight t;
        open_sight(&t, &n.model, s);
        lf_tape *tape = lf_tape_create();
        lf_tensor *x = lf_leaf(tape, 4, LF_DIMS(V, SIZE, SIZE, CHANNELS), s->image, NULL);
        lf_recon_code code;
        lf_recon_encode_images(tape, &n.model, x, V, t.images.grid, false, &code);
        const lf_recon_inputs in = lf_recon_look(tape, &n.model, &code, &t.points);
        if (expected[k][0] == 0) {
            assert_true(!code.object && !in.known);
        } else {
            assert_int_equal(code.object->dim[0], 1);
            assert_int_equal(lf_rows(code.object), expected[k][0]);
            assert_int_equal(lf_cols(code.object), expected[k][1]);
            assert_int_equal(lf_rows(in.known), Q);
            assert_int_equal(lf_cols(in.known), expected[k][1]);
        }
        assert_int_equal(lf_cols(in.seen), n.model.feature_count);
        const lf_tensor *y = lf_recon_sdf(tape, &n.model, &in, NULL);
        assert_int_equal(y->rank, 2);
        assert_int_equal(y->dim[0], Q);
        assert_int_equal(y->dim[1], 1);
        assert_true(lf_recon_macs(&n.model, V, Q, V) > 0);
        lf_tape_free(tape);
        close_sight(&t);
        free(s);
        close_net(&n);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_order_of_the_views_changes_nothing),
        cmocka_unit_test(turning_object_and_cameras_changes_nothing),
        cmocka_unit_test(rolled_views_change_nothing_with_c8_unless_pixels_have_coordinates),
        cmocka_unit_test(another_frame_changes_the_prediction),
        cmocka_unit_test(the_place_counts_without_images),
        cmocka_unit_test(points_know_their_own_object),
        cmocka_unit_test(gradient_of_the_whole_model),
        cmocka_unit_test(threads_and_tiles_change_no_result),
        cmocka_unit_test(no_op_hides_a_nan),
        cmocka_unit_test(a_point_that_no_view_sees_has_a_finite_distance),
        cmocka_unit_test(the_grid_spans_the_unit_cube),
        cmocka_unit_test(pixels_have_coordinates),
        cmocka_unit_test(what_is_known_of_objects_has_its_shape),
    };
    omp_set_num_threads(1); /* many small models: handing work over would take most of the time */
    return cmocka_run_group_tests(tests, NULL, NULL);
}
