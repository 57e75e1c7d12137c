/* test_ray_equivariant.c: the whole equivariant network of a ray: motions of the frame, orders of
 * the views, missing views and angles, gradients.                   [method.md 4.4, 5b.3 - 5b.5,
 * 10]
 */
#include "autograd/random.h"
#include "models/ray_equivariant.h"
#include "tests/close.h"

enum {
    N = 4,
    S = 6,
    V = 5,
    C = 4,
    F = 9,
    POINTS = N * S,
    SEEN = N * S * V,
    DRAWS = 100,
    ENOUGH = 8192
};
#define EXACT (sizeof(lf_real) == 8) /* the double build */
static const lf_types types = {.count = 8, .omega = {0, 2, 4, 8, 16, 32, 64, 128}},
                      scalars_too = {.count = 3, .omega = {0, 1, 4}, .more = 3};

typedef struct scene {
    long views;
    double origin[N * 3], direction[N * 3], depth[POINTS], centre[V * 3];
    uint8_t seen[SEEN];
    lf_real feature[SEEN * F];
} scene;

typedef struct net {
    lf_store *store;
    lf_tape *tape;
    lf_ray_equivariant model;
} net;

static void unit_vector(lf_stream *r, double v[3])
{
    double size = 0;
    for (int a = 0; a < 3; a++)
        v[a] = lf_normal(r);
    for (int a = 0; a < 3; a++)
        size += v[a] * v[a];
    for (int a = 0; a < 3; a++)
        v[a] /= sqrt(size);
}

static void aim(scene *s, int ray, const double towards[3])
{
    double size = 0, *d = s->direction + 3 * ray;
    for (int a = 0; a < 3; a++)
        d[a] = towards[a] - s->origin[3 * ray + a];
    for (int a = 0; a < 3; a++)
        size += d[a] * d[a];
    for (int a = 0; a < 3; a++)
        d[a] /= sqrt(size);
}

/* A scene of radius 1: rays from 3 away to near the origin, cameras about as far, a fifth of the
 * pairs unseen. */
static scene make_scene(void)
{
    scene s = {.views = V};
    lf_stream r = lf_stream_at(3, LF_RANDOM_TEST, 60, 0);
    for (int i = 0; i < N; i++) {
        double target[3];
        unit_vector(&r, s.origin + 3 * i);
        for (int a = 0; a < 3; a++) {
            s.origin[3 * i + a] *= 3;
            target[a] = 0.6 * (lf_uniform(&r) - 0.5);
        }
        aim(&s, i, target);
        for (int k = 0; k < S; k++)
            s.depth[i * S + k] = 2 + 2 * (k + lf_uniform(&r)) / S;
    }
    for (int v = 0; v < V; v++) {
        unit_vector(&r, s.centre + 3 * v);
        for (int a = 0; a < 3; a++)
            s.centre[3 * v + a] *= 3;
    }
    for (int i = 0; i < SEEN; i++)
        s.seen[i] = lf_uniform(&r) < 0.8;
    for (int i = 0; i < SEEN * F; i++)
        s.feature[i] = (lf_real)(i % F < LF_RGB ? lf_uniform(&r) : lf_normal(&r));
    return s;
}

static net open_net_of(const lf_types *list, bool layer_norm, bool along_ray)
{
    net n = {.store = lf_store_create(7), .tape = lf_tape_create()};
    const lf_ray_equivariant_config config = {*list, F, C, 16, 4, layer_norm, along_ray};
    lf_ray_equivariant_init(n.store, &n.model, "net", &config);
    lf_stream r = lf_stream_at(7, LF_RANDOM_TEST, 61, 0); /* biases that are not 0 */
    for (int i = 0; i < lf_store_count(n.store); i++) {
        const lf_parameter *p = lf_store_at(n.store, i);
        for (long k = 0; p->rank == 1 && k < p->size; k++)
            lf_values(p)[k] += (lf_real)(0.3 * lf_normal(&r));
    }
    return n;
}

static net open_net(bool layer_norm, bool along_ray)
{
    return open_net_of(&types, layer_norm, along_ray);
}

static void close_net(net *n)
{
    lf_tape_free(n->tape);
    lf_store_free(n->store);
}

/* `grad` of the features: [N, S, views, F], or NULL. */
static lf_radiance run(const net *n, lf_tape *tape, const scene *s, lf_real *grad)
{
    const lf_light_rays rays = {N,        S,         s->views, s->origin, s->direction,
                                s->depth, s->centre, s->seen,  2,         4};
    lf_light_geometry *g = lf_alloc(tape, sizeof *g);
    *g = lf_light_geometry_make(tape, &n->model.config.types, &rays);
    lf_tensor *seen =
        lf_leaf(tape, 4, LF_DIMS(N, S, s->views, F), (lf_real *)(uintptr_t)s->feature, grad);
    return lf_ray_equivariant_apply(tape, &n->model, &(lf_ray_inputs){seen, g, NULL});
}

static double error_of(lf_radiance a, lf_radiance b)
{
    const double colour = relative_error(a.colour->value, b.colour->value, POINTS * LF_RGB);
    return larger(colour, relative_error(a.sigma->value, b.sigma->value, POINTS));
}

/* ---- the same network, layer by layer ---- */

static lf_tensor *norm(lf_tape *tape, const lf_ray_equivariant *m, int place, lf_tensor *x)
{
    return lf_so2_layer_norm(tape, &m->config.types, x, lf_param(tape, m->gain[place]));
}

/* From the layers of light_field.h, which keep points and views in rows. */
static lf_radiance run_layers(const net *n, lf_tape *tape, const scene *s)
{
    const lf_ray_equivariant *m = &n->model;
    const lf_types *list = &m->config.types;
    const lf_light_rays rays = {N,        S,         s->views, s->origin, s->direction,
                                s->depth, s->centre, s->seen,  2,         4};
    const lf_light_geometry g = lf_light_geometry_make(tape, list, &rays);
    lf_tensor *seen =
        lf_leaf(tape, 4, LF_DIMS(N, S, s->views, F), (lf_real *)(uintptr_t)s->feature, NULL);
    lf_tensor *x = lf_ray_ray_convolution_apply(tape, &m->convolution, seen, &g);
    const lf_attended a = lf_cross_attention_apply(tape, &m->cross, seen, norm(tape, m, 0, x), &g);
    x = norm(tape, m, 1, a.field);
    x = norm(tape, m, 2, lf_add(tape, x, lf_along_ray_apply(tape, &m->along, x, &g)));
    lf_tensor *y = lf_so2_gated_apply(tape, &m->gated, list, x);
    x = lf_add(tape, x, lf_so2_map_apply(tape, &m->mix, list, y));
    lf_tensor *share = lf_tensor_new(tape, 3, LF_DIMS(N, S, 1));
    for (int i = 0; i < POINTS; i++)
        share->value[i] = g.count->value[i] / (lf_real)s->views - (lf_real)0.5;
    lf_tensor *parts[] = {lf_so2_invariants(tape, list, x), share};
    lf_tensor *t = lf_mlp_apply(tape, &m->density, lf_concat(tape, 2, parts));
    return (lf_radiance){lf_blend_columns(tape, a.weight, seen, LF_RGB),
                         lf_density(tape, t, g.count)};
}

static void blocks_are_the_layers(void **state)
{
    (void)state;
    scene s = make_scene();
    memset(s.seen, 0, 3 * V); /* samples that no view sees */
    for (int p = S; p < S + 16 && p < POINTS; p++)
        s.seen[p * V + 3] = 0; /* a view that sees no sample of a block, or few */
    for (int more = 0; more < 2; more++) {
        net n = open_net_of(more ? &scalars_too : &types, true, true);
        const lf_radiance layers = run_layers(&n, n.tape, &s);
        assert_below(error_of(run(&n, n.tape, &s, NULL), layers), EXACT ? 1e-12 : 1e-5);
        close_net(&n);
    }
}

/* ---- motions ---- */

/* A rotation drawn uniformly and a translation of a length up to `reach`. */
static lf_frame random_motion(uint64_t item, double reach)
{
    lf_stream r = lf_stream_at(1, LF_RANDOM_GROUP, item, 21);
    double d[3];
    unit_vector(&r, d);
    const double angle = 6.283185307179586 * lf_uniform(&r);
    const lf_twist turn = {cos(angle), sin(angle), 0};
    lf_frame g = {.origin = {0, 0, 0}}, about = lf_twist_frame(&turn);
    lf_ray_axes(d, g.rotation);
    g = lf_frame_compose(&g, &about);
    unit_vector(&r, d);
    for (int a = 0; a < 3; a++)
        g.origin[a] = reach * d[a];
    return g;
}

static scene moved(const scene *s, const lf_frame *g)
{
    scene m = *s;
    lf_frame turn = *g;
    memset(turn.origin, 0, sizeof turn.origin);
    for (int i = 0; i < N; i++) {
        lf_frame_apply(g, s->origin + 3 * i, m.origin + 3 * i);
        lf_frame_apply(&turn, s->direction + 3 * i, m.direction + 3 * i);
    }
    for (int v = 0; v < V; v++)
        lf_frame_apply(g, s->centre + 3 * v, m.centre + 3 * v);
    return m;
}

static void check_motions(const lf_types *list, bool layer_norm, bool along_ray)
{
    static const double reach[] = {0, 1, 1000}; /* scene radii */
    const scene s = make_scene();
    net n = open_net_of(list, layer_norm, along_ray);
    lf_tape *other = lf_tape_create();
    const lf_radiance before = run(&n, n.tape, &s, NULL);
    for (int i = 0; i < DRAWS; i++) {
        const lf_frame g = random_motion((uint64_t)i, reach[i % 3]);
        const scene m = moved(&s, &g);
        lf_tape_reset(other);
        assert_below(error_of(run(&n, other, &m, NULL), before), EXACT ? 1e-9 : 2e-5);
    }
    lf_tape_free(other);
    close_net(&n);
}

static void motions_change_nothing(void **state)
{
    (void)state;
    check_motions(&types, true, true);
    check_motions(&types, false, true);
    check_motions(&types, true, false);
    check_motions(&scalars_too, true, true);
}

/* The frame of a ray about it is a free choice: another one turns the phases of all its views by
 * the same angle. */
static void gauges_change_nothing(void **state)
{
    (void)state;
    const scene s = make_scene();
    net n = open_net_of(&scalars_too, true, true);
    const lf_radiance before = run(&n, n.tape, &s, NULL);
    const lf_light_rays rays = {N, S, V, s.origin, s.direction, s.depth, s.centre, s.seen, 2, 4};
    lf_light_geometry g = lf_light_geometry_make(n.tape, &scalars_too, &rays);
    const long phases = lf_types_phases(&scalars_too);
    for (long i = 0; i < N * V; i++) {
        double turn[LF_PHASES_MAX];
        const double angle = 0.7 + 1.3 * (double)(i / V);
        lf_harmonics(&scalars_too, cos(angle), sin(angle), 0, turn);
        lf_real *z = g.phase->value + i * phases;
        for (long p = 1; p < phases; p += 2) {
            const double re = (double)z[p], im = (double)z[p + 1];
            z[p] = (lf_real)(re * turn[p] - im * turn[p + 1]);
            z[p + 1] = (lf_real)(re * turn[p + 1] + im * turn[p]);
        }
    }
    lf_tensor *seen =
        lf_leaf(n.tape, 4, LF_DIMS(N, S, V, F), (lf_real *)(uintptr_t)s.feature, NULL);
    const lf_radiance after =
        lf_ray_equivariant_apply(n.tape, &n.model, &(lf_ray_inputs){seen, &g, NULL});
    assert_below(error_of(after, before), EXACT ? 1e-12 : 2e-5);
    close_net(&n);
}

static void orders_of_views_change_nothing(void **state)
{
    (void)state;
    const scene s = make_scene();
    scene m = s;
    for (int v = 0; v < V; v++) {
        const int to = (v + 2) % V;
        memcpy(m.centre + 3 * to, s.centre + 3 * v, 3 * sizeof *m.centre);
        for (int p = 0; p < POINTS; p++) {
            m.seen[p * V + to] = s.seen[p * V + v];
            memcpy(m.feature + (p * V + to) * F, s.feature + (p * V + v) * F,
                   F * sizeof *m.feature);
        }
    }
    net n = open_net(true, true);
    const lf_radiance before = run(&n, n.tape, &s, NULL);
    assert_below(error_of(run(&n, n.tape, &m, NULL), before), EXACT ? 1e-12 : 2e-5);
    close_net(&n);
}

/* ---- missing views and angles ---- */

/* What a masked view holds never counts; samples that no view sees are empty and black. */
static void masked_views_do_not_count(void **state)
{
    (void)state;
    scene s = make_scene();
    memset(s.seen, 0, S * V);         /* ray 0 */
    memset(s.seen + S * V, 0, 3 * V); /* half of ray 1 */
    net n = open_net(true, true);
    const lf_radiance before = run(&n, n.tape, &s, NULL);
    for (int i = 0; i < SEEN * F; i++)
        if (!s.seen[i / F])
            s.feature[i] += 1000;
    const lf_radiance after = run(&n, n.tape, &s, NULL);
    assert_memory_equal(after.colour->value, before.colour->value,
                        POINTS * LF_RGB * sizeof(lf_real));
    assert_memory_equal(after.sigma->value, before.sigma->value, POINTS * sizeof(lf_real));
    for (int i = 0; i < S + 3; i++) {
        assert_true(before.sigma->value[i] == 0);
        for (int a = 0; a < LF_RGB; a++)
            assert_true(before.colour->value[LF_RGB * i + a] == 0);
    }
    close_net(&n);
}

static void assert_finite(long n, const lf_real *x)
{
    for (long i = 0; i < n; i++)
        assert_true(isfinite(x[i]));
}

/* Values, and gradients of the features and of all parameters. */
static void check_finite(const scene *s)
{
    net n = open_net(true, true);
    static lf_real grad[SEEN * F];
    memset(grad, 0, sizeof grad);
    lf_store_zero_grads(n.store);
    const lf_radiance y = run(&n, n.tape, s, grad);
    lf_real *dc = lf_grad(n.tape, y.colour), *ds = lf_grad(n.tape, y.sigma);
    for (int i = 0; i < POINTS; i++) {
        ds[i] = 1;
        for (int a = 0; a < LF_RGB; a++)
            dc[LF_RGB * i + a] = 1;
    }
    lf_backward_from(n.tape);
    assert_finite(POINTS, y.sigma->value);
    assert_finite(POINTS * LF_RGB, y.colour->value);
    assert_finite(POINTS * s->views * F, grad);
    assert_finite(lf_store_size(n.store), lf_store_grads(n.store));
    for (long i = 0; i < POINTS * s->views * F; i++)
        if (!s->seen[i / F])
            assert_true(grad[i] == 0);
    close_net(&n);
}

/* Ray 0 looks along camera 0's ray, ray 1 against it: both pass through camera 0, nearly or
 * exactly, so that the ray from the camera to each sample is parallel to the target ray. */
static void cameras_on_the_ray(void **state)
{
    (void)state;
    static const double off[] = {0, 1e-12, 1e-7, 1e-4};
    for (int k = 0; k < 4; k++) {
        scene s = make_scene();
        const double target[3] = {0, 0, 0};
        memset(s.seen, 1, sizeof s.seen);
        for (int a = 0; a < 3; a++) {
            s.origin[a] = 1.2 * s.centre[a];
            s.origin[3 + a] = -s.centre[a];
        }
        aim(&s, 0, target);
        aim(&s, 1, target);
        s.centre[0] += off[k];
        check_finite(&s);
    }
}

/* Camera 1 stands at the third sample of ray 1, and camera 2 where ray 2 begins. */
static void samples_at_a_camera(void **state)
{
    (void)state;
    scene s = make_scene();
    memset(s.seen, 1, sizeof s.seen);
    for (int a = 0; a < 3; a++)
        s.centre[3 + a] = s.origin[3 + a] + s.depth[S + 2] * s.direction[3 + a];
    memcpy(s.centre + 6, s.origin + 6, 3 * sizeof *s.centre);
    s.seen[(S + 2) * V + 1] = 0; /* as the geometry masks it */
    check_finite(&s);
}

static void one_view_and_none(void **state)
{
    (void)state;
    scene s = make_scene();
    s.views = 1;
    check_finite(&s);
    memset(s.seen, 0, sizeof s.seen);
    check_finite(&s);
}

/* ---- gradients ---- */

/* A fixed random weighting of all outputs. */
static double loss_of(const net *n, const scene *s, lf_real *grad, bool backward)
{
    double loss = 0;
    lf_tape_reset(n->tape);
    const lf_radiance y = run(n, n->tape, s, grad);
    lf_stream r = lf_stream_at(4, LF_RANDOM_TEST, 62, 0);
    lf_tensor *out[] = {y.colour, y.sigma};
    for (int k = 0; k < 2; k++) {
        lf_real *g = backward ? lf_grad(n->tape, out[k]) : NULL;
        for (long i = 0; i < out[k]->size; i++) {
            const double w = lf_normal(&r);
            loss += w * (double)out[k]->value[i];
            if (g)
                g[i] = (lf_real)w;
        }
    }
    if (backward)
        lf_backward_from(n->tape);
    return loss;
}

/* x += step d. */
static void walk(long size, lf_real *x, const double *d, double step)
{
    for (long i = 0; i < size; i++)
        x[i] += (lf_real)(step * d[i]);
}

/* Error of the slope of the loss along a random direction of x [size], over the gradient's length.
 * The least over three steps: a large one may cross a kink of a ReLU, a small one rounds. */
static double slope_error(const net *n, const scene *s, long size, lf_real *x, const lf_real *grad,
                          uint64_t item)
{
    static double d[ENOUGH];
    double expected = 0, length = 0, least = INFINITY;
    lf_stream r = lf_stream_at(4, LF_RANDOM_TEST, 63, item);
    assert_true(size <= ENOUGH);
    for (long i = 0; i < size; i++) {
        d[i] = lf_normal(&r);
        expected += d[i] * (double)grad[i];
        length += (double)grad[i] * (double)grad[i];
    }
    for (double h = 1e-5; h > 1e-8; h *= 0.1) {
        double slope[2];
        for (int half = 0; half < 2; half++) {
            const double step = half ? h / 2 : h;
            walk(size, x, d, step);
            const double up = loss_of(n, s, NULL, false);
            walk(size, x, d, -2 * step);
            slope[half] = (up - loss_of(n, s, NULL, false)) / (2 * step);
            walk(size, x, d, step);
        }
        least = fmin(least, fabs((4 * slope[1] - slope[0]) / 3 - expected));
    }
    return least / (sqrt(length) + 1e-3); /* a bias of all keys has gradient 0 */
}

static void gradients(void **state)
{
    (void)state;
    if (!EXACT)
        skip();
    scene s = make_scene();
    memset(s.seen, 0, 2 * V);
    for (int kind = 0; kind < 4; kind++) {
        net n = open_net_of(kind == 3 ? &scalars_too : &types, kind != 1, kind != 2);
        static lf_real grad[SEEN * F];
        memset(grad, 0, sizeof grad);
        lf_store_zero_grads(n.store);
        loss_of(&n, &s, grad, true);
        assert_below(slope_error(&n, &s, SEEN * F, s.feature, grad, 1000), 1e-6);
        for (int i = 0; i < lf_store_count(n.store); i++) {
            const lf_parameter *p = lf_store_at(n.store, i);
            const double e = slope_error(&n, &s, p->size, lf_values(p), lf_grads(p), (uint64_t)i);
            if (!(e <= 1e-6))
                fail_msg("%s: error %.3g of the gradient", p->name, e);
        }
        close_net(&n);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(blocks_are_the_layers),
        cmocka_unit_test(motions_change_nothing),
        cmocka_unit_test(gauges_change_nothing),
        cmocka_unit_test(orders_of_views_change_nothing),
        cmocka_unit_test(masked_views_do_not_count),
        cmocka_unit_test(cameras_on_the_ray),
        cmocka_unit_test(samples_at_a_camera),
        cmocka_unit_test(one_view_and_none),
        cmocka_unit_test(gradients),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
