/* test_recon.c: the whole reconstruction model with random weights: symmetry, gradient, tiles and
 * threads, depth code.                                                     [method.md 5a, 10] */
#include <omp.h>

#include "autograd/random.h"
#include "tests/recon_scene.h"

/* ---- symmetry ---- */

static double worst_of_motions(const char *more, double translation, int motions)
{
    net n;
    open_net(&n, more);
    scene *s = make_scene(), *moved = make_scene();
    double worst = 0;
    for (int i = 0; i < motions; i++) {
        lf_stream r = lf_stream_at(1, LF_RANDOM_GROUP, (uint64_t)i, 0);
        const lf_motion g = lf_motion_random(&r, translation);
        move(s, &g, moved);
        worst = larger(worst, change(&n, s, moved));
    }
    free(s);
    free(moved);
    close_net(&n);
    return worst;
}

static const char *const variants[] = {NULL,
                                       "model.nonlinearity=gated",
                                       "model.skip=linear",
                                       "model.degree2=true",
                                       "model.depth_octaves=3",
                                       "model.backbone=plain",
                                       "model.norm=instance",
                                       "model.backbone=plain;model.plain_channels=3"};
enum { VARIANTS = sizeof variants / sizeof *variants };

static void moving_the_frame_changes_nothing(void **state)
{
    (void)state;
    for (int i = 0; i < VARIANTS; i++) {
        assert_below(worst_of_motions(variants[i], 1, 3), EXACT ? 1e-9 : 1e-4);
        assert_below(worst_of_motions(variants[i], 1000, 3), EXACT ? 1e-9 : 1e-4);
    }
    assert_below(worst_of_motions(NULL, 1e6, 3), EXACT ? 1e-6 : 1e-4);
}

static double defect_of_rolls(const char *more)
{
    static const int quarters[3][V] = {
        {1, 1, 1, 1, 1, 1, 1, 1}, {0, 1, 2, 3, 0, 1, 2, 3}, {2, 0, 0, 3, 1, 0, 0, 1}};
    net n;
    open_net(&n, more);
    double worst = 0;
    scene *s = make_scene();
    for (int i = 0; i < 3; i++) {
        scene *rolled = make_scene();
        roll(rolled, quarters[i]);
        worst = larger(worst, change(&n, s, rolled));
        free(rolled);
    }
    free(s);
    close_net(&n);
    return worst;
}

static void quarter_turns_of_every_view_change_nothing(void **state)
{
    (void)state;
    assert_below(defect_of_rolls(NULL), EXACT ? 1e-11 : 1e-5);
    assert_below(defect_of_rolls("model.norm=instance"), EXACT ? 1e-11 : 1e-5);
    assert_true(defect_of_rolls("model.backbone=plain") > 1e-3); /* or the test tests nothing */
    assert_true(defect_of_rolls("model.backbone=plain;model.plain_channels=3") > 1e-3);
}

/* The directions of all rays replaced by others: what the ablations without vectors cannot know. */
static double defect_of_other_directions(const char *more)
{
    net n;
    open_net(&n, more);
    scene *s = make_scene();
    double before[Q], after[Q];
    distances(&n, s, before);
    sight t;
    open_sight(&t, &n.model, s);
    for (uint64_t i = 0; i < Q * V; i++) {
        lf_stream r = lf_stream_at(12, LF_RANDOM_GROUP, i, 0);
        const lf_motion g = lf_motion_random(&r, 0);
        double *d = t.projection.direction + 3 * i;
        lf_rotation_apply(g.rotation, d, d);
    }
    lf_tape *tape = lf_tape_create();
    lf_tape_set_grad(tape, false);
    const lf_tensor *x = forward(tape, &n.model, &t, false);
    for (int q = 0; q < Q; q++)
        after[q] = (double)x->value[q];
    lf_tape_free(tape);
    close_sight(&t);
    free(s);
    close_net(&n);
    return relative_error(after, before, Q);
}

static void directions_go_in_by_vectors_alone(void **state)
{
    (void)state;
    assert_true(defect_of_other_directions(NULL) > 1e-3);
    assert_true(defect_of_other_directions("model.fusion=max-pool") == 0);
    assert_true(defect_of_other_directions("model.vectors=0") == 0);
}

/* ---- steps ---- */

static void threads_do_not_change_a_bit(void **state)
{
    (void)state;
    const int most = omp_get_max_threads();
    net n;
    open_net(&n, NULL);
    scene *s = make_scene();
    omp_set_num_threads(1);
    stepped one = step(&n, s, 3);
    assert_true(isfinite(one.loss) && one.loss > 0);
    for (int threads = 2; threads <= 3; threads++) {
        omp_set_num_threads(threads);
        stepped more = step(&n, s, 3);
        const size_t bytes = (size_t)one.size * sizeof(lf_real);
        assert_true(more.loss == one.loss);
        assert_memory_equal(more.grad, one.grad, bytes);
        assert_memory_equal(more.values, one.values, bytes);
        free_step(&more);
    }
    omp_set_num_threads(most);
    free_step(&one);
    free(s);
    close_net(&n);
}

static void tiles_change_rounding_only(void **state)
{
    (void)state;
    static const long tiles[] = {1, 7, Q, 1000};
    net n;
    open_net(&n, NULL);
    scene *s = make_scene();
    stepped a = step(&n, s, 16);
    for (int i = 0; i < 4; i++) {
        stepped b = step(&n, s, tiles[i]);
        assert_close(b.loss, a.loss, EXACT ? 1e-13 : 1e-5, 0);
        assert_below(relative_error(b.grad, a.grad, a.size), EXACT ? 1e-12 : 1e-4);
        free_step(&b);
    }
    free_step(&a);
    free(s);
    close_net(&n);
}

static void lanes_add_up_to_one_tape(void **state)
{
    (void)state;
    net n;
    open_net(&n, NULL);
    scene *s = make_scene();
    stepped a = step(&n, s, 3);
    assert_close(a.loss, plain_step(&n, s, true), EXACT ? 1e-13 : 1e-5, 0);
    assert_below(relative_error(a.grad, lf_store_grads(n.store), a.size), EXACT ? 1e-12 : 1e-4);
    free_step(&a);
    free(s);
    close_net(&n);
}

static void gradient_of_the_whole_model(void **state)
{
    (void)state;
    if (!EXACT)
        skip();
    const int most = omp_get_max_threads();
    omp_set_num_threads(1); /* the work is too small to share */
    assert_below(gradient_defect(NULL), 1e-6);
    assert_below(gradient_defect("model.nonlinearity=gated"), 1e-6);
    assert_below(gradient_defect("model.backbone=plain;model.plain_channels=3"), 1e-6);
    omp_set_num_threads(most);
}

static void a_nonfinite_number_is_found_and_named(void **state)
{
    (void)state;
    net n;
    open_net(&n, NULL);
    scene *s = make_scene();
    sight t;
    open_sight(&t, &n.model, s);
    lf_recon_work *work = lf_recon_work_create(&n.model, 16);
    lf_recon_work_check(work, true);
    lf_recon_step(work, &t.images, &t.points, s->sdf, &loss_config);
    assert_null(lf_recon_nonfinite(work));
    lf_values(lf_store_find(n.store, "block1.query.scalar.weight"))[3] = NAN;
    lf_recon_step(work, &t.images, &t.points, s->sdf, &loss_config);
    assert_string_equal(lf_recon_nonfinite(work), "forward of linear");
    lf_recon_work_free(work);
    close_sight(&t);
    free(s);
    close_net(&n);
}

/* A NaN must reach the loss or the gradient, wherever it starts: training looks at no more. */
static void no_op_hides_a_nan(void **state)
{
    (void)state;
    net n;
    open_net(&n, NULL);
    scene *s = make_scene();
    for (int i = 0; i < lf_store_count(n.store); i++) {
        const lf_parameter *p = lf_store_at(n.store, i);
        if (!p->trainable)
            continue;
        const lf_real old = lf_values(p)[0];
        lf_values(p)[0] = NAN;
        stepped a = step(&n, s, 16);
        bool found = !isfinite(a.loss);
        for (long k = 0; k < a.size && !found; k++)
            found = !isfinite(a.grad[k]);
        if (!found)
            fail_msg("NaN in %s reaches neither the loss nor a gradient", p->name);
        free_step(&a);
        lf_values(p)[0] = old;
    }
    free(s);
    close_net(&n);
}

/* ---- evaluation ---- */

static void predict_is_the_model(void **state)
{
    (void)state;
    net n;
    open_net(&n, NULL);
    scene *s = make_scene();
    double expected[Q];
    distances(&n, s, expected);
    for (int a = 0; a < 3; a++) /* behind all cameras but one, which it is outside of */
        s->point[5][a] = 100;
    sight t;
    open_sight(&t, &n.model, s);
    float first[Q];
    for (long tile = 1; tile <= 64; tile *= 8) {
        lf_recon_work *work = lf_recon_work_create(&n.model, tile);
        float sdf[Q];
        uint8_t valid[Q];
        lf_recon_encode(work, &t.images);
        lf_recon_predict(work, &t.points, 10, sdf, valid);
        for (int q = 0; q < Q; q++) {
            bool seen = false;
            for (int v = 0; v < V; v++)
                seen |= t.points.mask[q * V + v];
            assert_int_equal(valid[q], seen);
            assert_true(isfinite(sdf[q]));
            if (q != 5)
                assert_close(sdf[q], expected[q] / 10, 0, 1e-6);
        }
        lf_recon_predict(work, &t.points, 10, first, NULL);
        assert_memory_equal(first, sdf, sizeof sdf);
        lf_recon_work_free(work);
    }
    close_sight(&t);
    free(s);
    close_net(&n);
}

static lf_ray_geometry rays_of(lf_tape *tape, const lf_projection *p)
{
    lf_tensor *d = lf_tensor_new(tape, 3, LF_DIMS(Q, V, 3)),
              *mask = lf_tensor_new(tape, 2, LF_DIMS(Q, V));
    for (long i = 0; i < d->size; i++)
        d->value[i] = (lf_real)p->direction[i];
    for (long i = 0; i < mask->size; i++)
        mask->value[i] = p->mask[i];
    return (lf_ray_geometry){Q, V, d, mask};
}

/* The code is 1 + 2 octaves more numbers a ray: a model that samples three more numbers instead and
 * gets them by hand must give the same.                                         [method.md 5a.3] */
static void depth_code(void **state)
{
    (void)state;
    net coded = {make_config("model.depth_octaves=1"), lf_store_create(3), {.store = NULL}};
    net plain = {make_config(NULL), lf_store_create(3), {.store = NULL}};
    lf_recon_config config = lf_recon_config_from(coded.cfg);
    config.sample_image = false;
    config.backbone.in_channels = 3;
    lf_recon_init(&coded.model, coded.store, &config);
    config.sample_image = true;
    config.depth_octaves = 0;
    lf_recon_init(&plain.model, plain.store, &config);
    assert_int_equal(coded.model.feature_count + 3, plain.model.feature_count);

    const long sampled = coded.model.feature_count;
    scene *s = make_scene();
    lf_projection p = lf_projection_create(Q);
    lf_projection_fill(&p, 0, Q, (const double(*)[3])s->point, &s->views, 0);
    lf_tape *tape = lf_tape_create();
    const lf_ray_geometry rays = rays_of(tape, &p);
    lf_tensor *a = lf_tensor_new(tape, 3, LF_DIMS(Q, V, sampled)),
              *b = lf_tensor_new(tape, 3, LF_DIMS(Q, V, sampled + 3));
    lf_stream r = lf_stream_at(8, LF_RANDOM_TEST, 0, 0);
    for (long i = 0; i < Q * V; i++) {
        lf_real *row = b->value + i * (sampled + 3);
        const double d = (p.distance[i] - 2.5) / 0.5;
        for (long k = 0; k < sampled; k++)
            row[k] = a->value[i * sampled + k] = (lf_real)lf_normal(&r);
        row[sampled] = (lf_real)d;
        row[sampled + 1] = (lf_real)sin(acos(-1) * d);
        row[sampled + 2] = (lf_real)cos(acos(-1) * d);
        assert_true(fabs(d) <= 1);
    }
    const lf_recon_points points = points_of(&p, Q);
    const lf_recon_inputs in_a = {a, NULL, rays, &points}, in_b = {b, NULL, rays, &points};
    const lf_tensor *x = lf_recon_sdf(tape, &coded.model, &in_a, NULL);
    const lf_tensor *y = lf_recon_sdf(tape, &plain.model, &in_b, NULL);
    assert_below(relative_error(x->value, y->value, Q), EXACT ? 1e-13 : 1e-5);
    lf_tape_free(tape);
    lf_projection_free(&p);
    free(s);
    close_net(&coded);
    close_net(&plain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(moving_the_frame_changes_nothing),
        cmocka_unit_test(quarter_turns_of_every_view_change_nothing),
        cmocka_unit_test(directions_go_in_by_vectors_alone),
        cmocka_unit_test(threads_do_not_change_a_bit),
        cmocka_unit_test(tiles_change_rounding_only),
        cmocka_unit_test(lanes_add_up_to_one_tape),
        cmocka_unit_test(gradient_of_the_whole_model),
        cmocka_unit_test(a_nonfinite_number_is_found_and_named),
        cmocka_unit_test(no_op_hides_a_nan),
        cmocka_unit_test(predict_is_the_model),
        cmocka_unit_test(depth_code),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
