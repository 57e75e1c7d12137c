/* test_recon.c: the whole reconstruction model with random weights: symmetry, gradient, tiles and
 * threads, depth code.                                                     [method.md 5a, 10] */
#include <omp.h>

#include "autograd/random.h"
#include "datasets/projection.h"
#include "models/recon_work.h"
#include "tests/close.h"
#include "tests/recon_net.h"

enum { V = LF_CUBE_VIEWS, Q = 40, SIZE = 33, CHANNELS = 2, PIXELS = V * SIZE * SIZE * CHANNELS };
#define EXACT (sizeof(lf_real) == 8) /* the double build */

typedef struct scene {
    lf_shape_views views; /* cameras; the object is not turned */
    double point[Q][3];
    float sdf[Q];
    lf_real image[PIXELS];
} scene;

static scene *make_scene(void)
{
    scene *s = calloc(1, sizeof *s);
    assert_non_null(s);
    lf_camera_cube(SIZE, s->views.camera);
    lf_rotation_identity(s->views.object);
    lf_stream r = lf_stream_at(4, LF_RANDOM_TEST, 0, 0);
    for (int q = 0; q < Q; q++) {
        for (int a = 0; a < 3; a++)
            s->point[q][a] = 0.57 * (lf_uniform(&r) - 0.5);
        s->sdf[q] = (float)(0.2 * (lf_uniform(&r) - 0.5));
    }
    for (int i = 0; i < PIXELS; i++)
        s->image[i] = (lf_real)lf_uniform(&r);
    return s;
}

static lf_recon_points points_of(const lf_projection *p)
{
    return (lf_recon_points){Q, V, p->uv, p->direction, p->distance, p->mask, p->first};
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

/* 10 times the distance at every point, all on one tape. */
static lf_tensor *forward(lf_tape *tape, const lf_recon *model, lf_real *image,
                          const lf_projection *p, bool training)
{
    lf_tensor *maps[LF_BACKBONE_MAPS + 1];
    lf_tensor *x = lf_leaf(tape, 4, LF_DIMS(V, SIZE, SIZE, CHANNELS), image, NULL);
    const int count = lf_recon_maps(tape, model, x, training, maps);
    const lf_ray_geometry rays = rays_of(tape, p);
    lf_tensor *seen =
        lf_sample_maps(tape, count, maps, SIZE, SIZE, Q, V, p->uv, rays.mask->value, p->first);
    return lf_recon_sdf(tape, model, seen, &rays, p->distance, NULL);
}

static void distances(const net *n, scene *s, double out[Q])
{
    lf_tape *tape = lf_tape_create();
    lf_tape_set_grad(tape, false);
    lf_projection p = lf_projection_create(Q);
    lf_projection_fill(&p, 0, Q, (const double(*)[3])s->point, &s->views, 0);
    for (long i = 0; i < Q * V; i++)
        assert_int_equal(p.mask[i], 1);
    const lf_tensor *x = forward(tape, &n->model, s->image, &p, false);
    for (int q = 0; q < Q; q++)
        out[q] = (double)x->value[q];
    lf_projection_free(&p);
    lf_tape_free(tape);
}

/* ---- symmetry ---- */

static double worst_of_motions(const char *more, double translation, int motions)
{
    net n;
    open_net(&n, more);
    scene *s = make_scene(), *moved = make_scene();
    double before[Q], after[Q], worst = 0;
    distances(&n, s, before);
    for (int i = 0; i < motions; i++) {
        lf_stream r = lf_stream_at(1, LF_RANDOM_GROUP, (uint64_t)i, 0);
        const lf_motion g = lf_motion_random(&r, translation);
        for (int v = 0; v < V; v++)
            moved->views.camera[v] = lf_camera_move(&s->views.camera[v], &g);
        for (int q = 0; q < Q; q++)
            lf_motion_apply(&g, s->point[q], moved->point[q]);
        distances(&n, moved, after);
        const double e = relative_error(after, before, Q);
        worst = e > worst || isnan(e) ? e : worst;
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
                                       "model.norm=instance"};
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

/* Camera v rolled by quarters[v] * 90 degrees, its image turned to match: a pixel of the rolled
 * camera at (column, row) was at (size - 1 - row, column), a quarter ago. */
static void roll(scene *s, const int quarters[V])
{
    enum { N = SIZE * SIZE * CHANNELS };
    lf_real *old = malloc(N * sizeof *old);
    assert_non_null(old);
    for (int v = 0; v < V; v++) {
        lf_real *image = s->image + v * N;
        s->views.camera[v] = lf_camera_roll(&s->views.camera[v], quarters[v] * acos(-1) / 2);
        for (int k = 0; k < quarters[v]; k++) {
            memcpy(old, image, N * sizeof *old);
            for (int row = 0; row < SIZE; row++)
                for (int column = 0; column < SIZE; column++)
                    for (int c = 0; c < CHANNELS; c++)
                        image[(row * SIZE + column) * CHANNELS + c] =
                            old[(column * SIZE + SIZE - 1 - row) * CHANNELS + c];
        }
    }
    free(old);
}

static double defect_of_rolls(const char *more)
{
    static const int quarters[3][V] = {
        {1, 1, 1, 1, 1, 1, 1, 1}, {0, 1, 2, 3, 0, 1, 2, 3}, {2, 0, 0, 3, 1, 0, 0, 1}};
    net n;
    open_net(&n, more);
    double before[Q], after[Q], worst = 0;
    scene *s = make_scene();
    distances(&n, s, before);
    free(s);
    for (int i = 0; i < 3; i++) {
        s = make_scene();
        roll(s, quarters[i]);
        distances(&n, s, after);
        worst = larger(worst, relative_error(after, before, Q));
        free(s);
    }
    close_net(&n);
    return worst;
}

static void quarter_turns_of_every_view_change_nothing(void **state)
{
    (void)state;
    assert_below(defect_of_rolls(NULL), EXACT ? 1e-11 : 1e-5);
    assert_below(defect_of_rolls("model.norm=instance"), EXACT ? 1e-11 : 1e-5);
    assert_true(defect_of_rolls("model.backbone=plain") > 1e-3); /* or the test tests nothing */
}

/* ---- steps ---- */

static const lf_sdf_loss_config loss_config = {10, 0.1, 0.01, 4};

typedef struct stepped {
    double loss;
    lf_real *grad, *values; /* after the step: running statistics */
    long size;
} stepped;

static stepped step(net *n, scene *s, long tile)
{
    stepped r = {.size = lf_store_size(n->store)};
    const size_t bytes = (size_t)r.size * sizeof(lf_real);
    lf_real *before = malloc(bytes);
    r.grad = malloc(bytes);
    r.values = malloc(bytes);
    assert_true(before && r.grad && r.values);
    memcpy(before, lf_store_values(n->store), bytes);
    lf_projection p = lf_projection_create(Q);
    lf_projection_fill(&p, 0, Q, (const double(*)[3])s->point, &s->views, 0);
    const lf_recon_points points = points_of(&p);
    lf_recon_work *work = lf_recon_work_create(&n->model, tile);
    r.loss = lf_recon_step(work, V, s->image, &points, s->sdf, &loss_config);
    assert_true(lf_recon_work_bytes(work) > 0);
    memcpy(r.grad, lf_store_grads(n->store), bytes);
    memcpy(r.values, lf_store_values(n->store), bytes);
    memcpy(lf_store_values(n->store), before, bytes);
    lf_recon_work_free(work);
    lf_projection_free(&p);
    free(before);
    return r;
}

static void free_step(stepped *r)
{
    free(r->grad);
    free(r->values);
}

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

/* Mean loss on one tape without tiles; with gradients if `backward`. */
static double plain_step(net *n, scene *s, bool backward)
{
    lf_tape *tape = lf_tape_create();
    lf_projection p = lf_projection_create(Q);
    lf_projection_fill(&p, 0, Q, (const double(*)[3])s->point, &s->views, 0);
    lf_store_zero_grads(n->store);
    lf_tensor *x = forward(tape, &n->model, s->image, &p, true);
    lf_tensor *loss = lf_sdf_loss(tape, x, s->sdf, &loss_config);
    if (backward)
        lf_backward(tape, loss, (lf_real)(1.0 / Q));
    const double mean = (double)loss->value[0] / Q;
    lf_projection_free(&p);
    lf_tape_free(tape);
    return mean;
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

/* Difference of `slope` from the derivative of the mean loss by one parameter: the least over three
 * steps, for a long one runs into the kinks of ReLU and a short one into rounding. */
static double slope_error(net *n, scene *s, lf_real *x, double slope)
{
    const lf_real old = *x;
    double least = INFINITY;
    for (double h = 1e-5; h > 5e-8; h /= 10) {
        *x = old + (lf_real)h;
        const double up = plain_step(n, s, false);
        *x = old - (lf_real)h;
        const double down = plain_step(n, s, false);
        least = fmin(least, fabs((up - down) / (2 * h) - slope));
    }
    *x = old;
    return least;
}

static double largest(const lf_real *x, long n)
{
    double most = 0;
    for (long k = 0; k < n; k++)
        most = fmax(most, fabs((double)x[k]));
    return most;
}

/* A number of every array against central differences, relative to the array's largest gradient
 * or a hundredth of the model's, whichever is larger. */
static double gradient_defect(const char *more)
{
    net n;
    open_net(&n, more);
    scene *s = make_scene();
    stepped a = step(&n, s, 16);
    const double all = largest(a.grad, a.size);
    double worst = 0;
    for (int i = 0; i < lf_store_count(n.store); i++) {
        const lf_parameter *p = lf_store_at(n.store, i);
        const lf_real *grad = a.grad + p->offset;
        const double size = fmax(largest(grad, p->size), 0.01 * all);
        lf_stream r = lf_stream_at(2, LF_RANDOM_TEST, 6, (uint64_t)i);
        const long at = lf_index(&r, p->size);
        if (!p->trainable)
            continue;
        const double e = slope_error(&n, s, lf_values(p) + at, (double)grad[at]) / size;
        worst = e > worst || isnan(e) ? e : worst;
    }
    free_step(&a);
    free(s);
    close_net(&n);
    return worst;
}

static void gradient_of_the_whole_model(void **state)
{
    (void)state;
    if (!EXACT)
        skip();
    assert_below(gradient_defect(NULL), 1e-6);
    assert_below(gradient_defect("model.nonlinearity=gated"), 1e-6);
}

static void a_nonfinite_number_is_found_and_named(void **state)
{
    (void)state;
    net n;
    open_net(&n, NULL);
    scene *s = make_scene();
    lf_projection p = lf_projection_create(Q);
    lf_projection_fill(&p, 0, Q, (const double(*)[3])s->point, &s->views, 0);
    const lf_recon_points points = points_of(&p);
    lf_recon_work *work = lf_recon_work_create(&n.model, 16);
    lf_recon_work_check(work, true);
    lf_recon_step(work, V, s->image, &points, s->sdf, &loss_config);
    assert_null(lf_recon_nonfinite(work));
    lf_values(lf_store_find(n.store, "block1.query.scalar.weight"))[3] = NAN;
    lf_recon_step(work, V, s->image, &points, s->sdf, &loss_config);
    assert_string_equal(lf_recon_nonfinite(work), "forward of linear");
    lf_recon_work_free(work);
    lf_projection_free(&p);
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
    lf_projection p = lf_projection_create(Q);
    lf_projection_fill(&p, 0, Q, (const double(*)[3])s->point, &s->views, 0);
    const lf_recon_points points = points_of(&p);
    lf_real first[Q];
    for (long tile = 1; tile <= 64; tile *= 8) {
        lf_recon_work *work = lf_recon_work_create(&n.model, tile);
        lf_real sdf[Q];
        uint8_t valid[Q];
        lf_recon_encode(work, V, s->image);
        lf_recon_predict(work, &points, 10, sdf, valid);
        for (int q = 0; q < Q; q++) {
            bool seen = false;
            for (int v = 0; v < V; v++)
                seen |= p.mask[q * V + v];
            assert_int_equal(valid[q], seen);
            assert_true(isfinite(sdf[q]));
            if (q != 5)
                assert_close(sdf[q], expected[q] / 10, 0, 1e-6);
        }
        lf_recon_predict(work, &points, 10, first, NULL);
        assert_memory_equal(first, sdf, sizeof sdf);
        lf_recon_work_free(work);
    }
    lf_projection_free(&p);
    free(s);
    close_net(&n);
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
    assert_int_equal(lf_recon_sampled(&coded.model) + 3, lf_recon_sampled(&plain.model));

    const long sampled = lf_recon_sampled(&coded.model);
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
    const lf_tensor *x = lf_recon_sdf(tape, &coded.model, a, &rays, p.distance, NULL);
    const lf_tensor *y = lf_recon_sdf(tape, &plain.model, b, &rays, p.distance, NULL);
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
