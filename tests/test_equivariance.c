/* test_equivariance.c: convolution and attention blocks under motions of the frame, and what they
 * do with views that are masked, permuted, duplicated or missing.          [method.md 2, 4.4, 4.6,
 * 10] */
#include "autograd/random.h"
#include "datasets/camera.h"
#include "layers/layers.h"
#include "tests/close.h"

enum { V = 6, Q = 14, F = 10, MOTIONS = 100, DIRECTIONS = 200 };
#define EXACT (sizeof(lf_real) == 8) /* the double build */
static const double near_depth = 1e-3;

static double layer_tolerance(void)
{
    return EXACT ? 1e-9 : 2e-5;
}

static double order_tolerance(void)
{
    return EXACT ? 1e-12 : 1e-5;
}

/* ---- the composite ---- */

typedef struct scene {
    int views;
    lf_camera camera[V];
    double point[Q][3];
    lf_real feature[Q * V * F]; /* of ray (q, v), at the place q * views + v */
} scene;

/* Cameras round the origin that look past it, so that some views miss some points. */
static scene make_scene(void)
{
    scene s = {.views = V};
    lf_stream r = lf_stream_at(3, LF_RANDOM_TEST, 0, 0);
    for (int v = 0; v < V; v++) {
        double centre[3], target[3], size = 0;
        for (int a = 0; a < 3; a++) {
            centre[a] = lf_normal(&r);
            size += centre[a] * centre[a];
            target[a] = 0.4 * (lf_uniform(&r) - 0.5);
        }
        for (int a = 0; a < 3; a++)
            centre[a] *= 2.5 / sqrt(size);
        s.camera[v] = lf_camera_look_at(centre, target, 0.2, 65);
    }
    for (int q = 0; q < Q; q++)
        for (int a = 0; a < 3; a++)
            s.point[q][a] = lf_uniform(&r) - 0.5;
    for (int i = 0; i < Q * V * F; i++)
        s.feature[i] = (lf_real)lf_normal(&r);
    return s;
}

/* What a transformer may be, as bits. */
enum { DEGREE2 = 1, GATED = 2, SKIP_LINEAR = 4, NO_VECTORS = 8, SWITCHES = 16 };

typedef struct net {
    lf_store *store;
    lf_tape *tape;
    lf_ray_convolution convolution;
    lf_transformer_block block[2];
} net;

static net open_net(int switches)
{
    net n = {lf_store_create(7), lf_tape_create(), {.has_vector = false}, {{.has_vector = false}}};
    const lf_transformer_config config = {.scalars = 8,
                                          .vectors = switches & NO_VECTORS ? 0 : 4,
                                          .heads = 4,
                                          .degree2 = switches & DEGREE2,
                                          .skip_linear = switches & SKIP_LINEAR,
                                          .nonlinearity =
                                              switches & GATED ? LF_GATED : LF_NORM_RELU};
    lf_ray_convolution_init(n.store, &n.convolution, "convolution", F, 8, config.vectors);
    lf_transformer_block_init(n.store, &n.block[0], "block0", &config, F, 0);
    lf_transformer_block_init(n.store, &n.block[1], "block1", &config, 8, config.vectors);
    lf_stream r = lf_stream_at(7, LF_RANDOM_TEST, 1, 0); /* biases and betas that are not 0 */
    for (int i = 0; i < lf_store_count(n.store); i++) {
        const lf_parameter *p = lf_store_at(n.store, i);
        for (long k = 0; p->rank == 1 && k < p->size; k++)
            lf_values(p)[k] = (lf_real)(0.3 * lf_normal(&r));
    }
    return n;
}

static void close_net(net *n)
{
    lf_tape_free(n->tape);
    lf_store_free(n->store);
}

typedef struct output {
    long scalars, vectors; /* channels */
    double scalar[Q * 8], vector[Q * 3 * 4];
    int seen[Q]; /* views that see the point */
} output;

static lf_ray_geometry rays_of(lf_tape *tape, const scene *s, int *seen)
{
    double direction[Q * V * 3];
    uint8_t mask[Q * V];
    lf_project_points(s->views, s->camera, Q, s->point, near_depth, NULL, direction, NULL, mask);
    lf_tensor *d = lf_tensor_new(tape, 3, LF_DIMS(Q, s->views, 3));
    lf_tensor *m = lf_tensor_new(tape, 2, LF_DIMS(Q, s->views));
    for (long i = 0; i < d->size; i++)
        d->value[i] = (lf_real)direction[i];
    for (long i = 0; i < m->size; i++) {
        m->value[i] = mask[i];
        seen[i / s->views] += mask[i];
    }
    return (lf_ray_geometry){Q, s->views, d, m};
}

/* Point features after the last block; with `backward` also the gradients of their sum. */
static output run(net *n, const scene *s, bool backward)
{
    output o = {0};
    lf_tape_reset(n->tape);
    lf_store_zero_grads(n->store);
    const lf_ray_geometry rays = rays_of(n->tape, s, o.seen);
    lf_real *grad = lf_alloc_reals(n->tape, Q * V * F);
    memset(grad, 0, Q * V * F * sizeof *grad);
    lf_tensor *r =
        lf_leaf(n->tape, 3, LF_DIMS(Q, s->views, F), (lf_real *)(uintptr_t)s->feature, grad);
    lf_field on_rays = {r, NULL},
             point = lf_ray_convolution_apply(n->tape, &n->convolution, r, &rays);
    for (int b = 0; b < 2; b++)
        lf_transformer_block_apply(n->tape, &n->block[b], &on_rays, &point, &rays);
    o.scalars = lf_cols(point.scalar);
    for (long i = 0; i < point.scalar->size; i++)
        o.scalar[i] = (double)point.scalar->value[i];
    for (long i = 0; point.vector && i < point.vector->size; i++)
        o.vector[i] = (double)point.vector->value[i];
    o.vectors = point.vector ? lf_cols(point.vector) : 0;
    if (backward) {
        lf_tensor *loss = lf_sum(n->tape, point.scalar);
        if (point.vector)
            loss = lf_add(n->tape, loss, lf_sum(n->tape, point.vector));
        lf_backward(n->tape, loss, 1);
        for (long i = 0; i < Q * s->views * F; i++)
            assert_true(isfinite(grad[i]));
        for (long i = 0; i < lf_store_size(n->store); i++)
            assert_true(isfinite(lf_store_grads(n->store)[i]));
    }
    return o;
}

/* Vectors turned by R. */
static void turn(output *o, const double rotation[9])
{
    for (long q = 0; q < Q; q++)
        for (long c = 0; c < o->vectors; c++) {
            double *v = o->vector + 3 * q * o->vectors + c, p[3];
            for (int a = 0; a < 3; a++)
                p[a] = v[a * o->vectors];
            lf_rotation_apply(rotation, p, p);
            for (int a = 0; a < 3; a++)
                v[a * o->vectors] = p[a];
        }
}

static double difference(const output *a, const output *b)
{
    const double scalars = relative_error(a->scalar, b->scalar, Q * b->scalars);
    const double vectors =
        b->vectors ? relative_error(a->vector, b->vector, 3 * Q * b->vectors) : 0;
    return larger(scalars, vectors);
}

static scene moved(const scene *s, const lf_motion *g)
{
    scene m = *s;
    for (int v = 0; v < s->views; v++)
        m.camera[v] = lf_camera_move(&s->camera[v], g);
    for (int q = 0; q < Q; q++)
        lf_motion_apply(g, s->point[q], m.point[q]);
    return m;
}

/* ---- motions ---- */

static void some_views_see_some_points(void **state)
{
    (void)state;
    const scene s = make_scene();
    net n = open_net(0);
    const output o = run(&n, &s, false);
    int partly = 0;
    for (int q = 0; q < Q; q++)
        partly += o.seen[q] > 0 && o.seen[q] < V;
    assert_true(partly > Q / 3); /* or the other tests would test little */
    close_net(&n);
}

static double worst_of_motions(int switches, double translation, int motions)
{
    const scene s = make_scene();
    net n = open_net(switches);
    const output before = run(&n, &s, false);
    double worst = 0;
    for (int i = 0; i < motions; i++) {
        lf_stream r = lf_stream_at(1, LF_RANDOM_GROUP, (uint64_t)i, 0);
        const lf_motion g = lf_motion_random(&r, translation);
        const scene m = moved(&s, &g);
        const output after = run(&n, &m, false);
        output expected = before;
        turn(&expected, g.rotation);
        assert_memory_equal(after.seen, before.seen, sizeof after.seen);
        const double e = difference(&after, &expected);
        worst = e > worst || isnan(e) ? e : worst;
    }
    close_net(&n);
    return worst;
}

/* Scene radius 1: translations up to 1000 of it. */
static void moving_the_frame_turns_vectors_only(void **state)
{
    (void)state;
    for (int switches = 0; switches < SWITCHES; switches++)
        assert_below(worst_of_motions(switches, 1000, MOTIONS), layer_tolerance());
}

static void rotations_alone(void **state)
{
    (void)state;
    assert_below(worst_of_motions(DEGREE2 | GATED, 0, MOTIONS), layer_tolerance());
}

/* Positions 1e6 away carry 1e6 * 1e-16 of themselves; centred first, directions keep the rest. */
static void far_away(void **state)
{
    (void)state;
    assert_below(worst_of_motions(DEGREE2 | GATED, 1e6, 20), EXACT ? 1e-6 : 2e-5);
}

/* ---- kernels ---- */

typedef struct kernel_case {
    lf_tape *tape;
    lf_ray_geometry rays;
    lf_field x;
} kernel_case;

static kernel_case open_kernels(void)
{
    kernel_case k = {.tape = lf_tape_create()};
    lf_tensor *d = lf_tensor_new(k.tape, 3, LF_DIMS(1, DIRECTIONS, 3));
    lf_tensor *mask = lf_tensor_new(k.tape, 2, LF_DIMS(1, DIRECTIONS));
    k.x.scalar = lf_tensor_new(k.tape, 3, LF_DIMS(1, DIRECTIONS, 2));
    k.x.vector = lf_tensor_new(k.tape, 4, LF_DIMS(1, DIRECTIONS, 3, 2));
    lf_stream r = lf_stream_at(2, LF_RANDOM_TEST, 4, 0);
    for (long i = 0; i < DIRECTIONS; i++) {
        double v[3] = {lf_normal(&r), lf_normal(&r), lf_normal(&r)};
        const double size = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        for (int a = 0; a < 3; a++) /* every tenth direction lies on an axis */
            d->value[3 * i + a] = (lf_real)(i % 10 ? v[a] / size : a == i / 10 % 3);
        mask->value[i] = 1;
    }
    for (long i = 0; i < k.x.scalar->size; i++)
        k.x.scalar->value[i] = (lf_real)lf_normal(&r);
    for (long i = 0; i < k.x.vector->size; i++)
        k.x.vector->value[i] = (lf_real)lf_normal(&r);
    k.rays = (lf_ray_geometry){1, DIRECTIONS, d, mask};
    return k;
}

/* Rows of 3 x c numbers turned by R. */
static lf_tensor *turned(lf_tape *tape, const lf_tensor *x, long c, const double rotation[9])
{
    lf_tensor *y = lf_tensor_like(tape, x);
    for (long r = 0; r < x->size / (3 * c); r++)
        for (long i = 0; i < c; i++) {
            const lf_real *v = x->value + 3 * r * c + i;
            double p[3] = {(double)v[0], (double)v[c], (double)v[2 * c]};
            lf_rotation_apply(rotation, p, p);
            for (int a = 0; a < 3; a++)
                y->value[3 * r * c + a * c + i] = (lf_real)p[a];
        }
    return y;
}

/* kappa(R d) = D_out(R) kappa(d) D_in(R)^-1, each path in its own columns. */
static void kernels_keep_their_constraint(void **state)
{
    (void)state;
    kernel_case k = open_kernels();
    const lf_field before = lf_tfn_paths(k.tape, k.x, &k.rays, true);
    const long paths = lf_cols(before.vector);
    for (int i = 0; i < 20; i++) {
        lf_stream r = lf_stream_at(4, LF_RANDOM_GROUP, (uint64_t)i, 0);
        double rotation[9];
        lf_rotation_random(&r, rotation);
        const lf_ray_geometry rays = {1, DIRECTIONS, turned(k.tape, k.rays.direction, 1, rotation),
                                      k.rays.mask};
        const lf_field x = {k.x.scalar, turned(k.tape, k.x.vector, 2, rotation)};
        const lf_field after = lf_tfn_paths(k.tape, x, &rays, true);
        const lf_tensor *expected = turned(k.tape, before.vector, paths, rotation);
        assert_below(relative_error(after.scalar->value, before.scalar->value, before.scalar->size),
                     EXACT ? 1e-11 : 2e-5);
        assert_below(relative_error(after.vector->value, expected->value, expected->size),
                     EXACT ? 1e-11 : 2e-5);
    }
    lf_tape_free(k.tape);
}

/* Matrices of the 1 <- 1 paths, written out: I, sqrt(3/2) [d]x, 3/sqrt2 (d d' - I/3). */
static double path_entry(int path, const double d[3], int a, int b)
{
    const double eye = a == b;
    if (path == 0)
        return eye;
    if (path == 2)
        return 3 / sqrt(2) * (d[a] * d[b] - eye / 3);
    const double cross = a == b ? 0 : (b == (a + 1) % 3 ? -1 : 1) * d[3 - a - b];
    return sqrt(1.5) * cross;
}

static void kernels_are_the_written_matrices(void **state)
{
    (void)state;
    kernel_case k = open_kernels();
    const lf_field y = lf_tfn_paths(k.tape, k.x, &k.rays, true);
    const long n = lf_cols(y.vector), column[3] = {0, 2, 6}; /* v | d x v | s d | degree 2 */
    const double tolerance = EXACT ? 1e-12 : 1e-5;
    for (long r = 0; r < DIRECTIONS; r++) {
        const lf_real *s = k.x.scalar->value + 2 * r, *v = k.x.vector->value + 6 * r;
        const lf_real *out0 = y.scalar->value + 4 * r, *out1 = y.vector->value + 3 * n * r;
        const double d[3] = {(double)k.rays.direction->value[3 * r],
                             (double)k.rays.direction->value[3 * r + 1],
                             (double)k.rays.direction->value[3 * r + 2]};
        for (int c = 0; c < 2; c++) {
            double along = 0;
            for (int a = 0; a < 3; a++) {
                along += d[a] * (double)v[2 * a + c];
                assert_close(out1[a * n + 4 + c], sqrt(3) * d[a] * (double)s[c], 0, tolerance);
                for (int path = 0; path < 3; path++) {
                    double sum = 0;
                    for (int b = 0; b < 3; b++)
                        sum += path_entry(path, d, a, b) * (double)v[2 * b + c];
                    assert_close(out1[a * n + column[path] + c], sum, 0, 4 * tolerance);
                }
            }
            assert_close(out0[c], s[c], 0, 0);
            assert_close(out0[2 + c], along, 0, 4 * tolerance);
        }
    }
    lf_tape_free(k.tape);
}

static void vector_neurons_give_invariants(void **state)
{
    (void)state;
    kernel_case k = open_kernels();
    lf_store *store = lf_store_create(3);
    lf_vector_neuron layer;
    lf_vector_neuron_init(store, &layer, "readout", 2);
    const lf_tensor *before = lf_vector_neuron_apply(k.tape, &layer, k.x.vector);
    assert_int_equal(before->size, DIRECTIONS * 2);
    for (int i = 0; i < 20; i++) {
        lf_stream r = lf_stream_at(5, LF_RANDOM_GROUP, (uint64_t)i, 0);
        double rotation[9];
        lf_rotation_random(&r, rotation);
        lf_tensor *v = turned(k.tape, k.x.vector, 2, rotation);
        const lf_tensor *after = lf_vector_neuron_apply(k.tape, &layer, v);
        assert_below(relative_error(after->value, before->value, before->size), order_tolerance());
    }
    lf_store_free(store);
    lf_tape_free(k.tape);
}

/* ---- views ---- */

/* View v of the result is view order[v] of s. */
static scene with_views(const scene *s, int views, const int *order)
{
    scene p = *s;
    p.views = views;
    for (int v = 0; v < views; v++) {
        p.camera[v] = s->camera[order[v]];
        for (int q = 0; q < Q; q++)
            memcpy(p.feature + (q * views + v) * F, s->feature + (q * s->views + order[v]) * F,
                   F * sizeof *p.feature);
    }
    return p;
}

static void order_of_the_views_does_not_matter(void **state)
{
    (void)state;
    static const int orders[3][V] = {{5, 4, 3, 2, 1, 0}, {1, 2, 3, 4, 5, 0}, {0, 3, 1, 5, 2, 4}};
    const scene s = make_scene();
    for (int switches = 0; switches < SWITCHES; switches++) {
        net n = open_net(switches);
        const output before = run(&n, &s, false);
        for (int i = 0; i < 3; i++) {
            const scene p = with_views(&s, V, orders[i]);
            const output after = run(&n, &p, false);
            assert_below(difference(&after, &before), order_tolerance());
        }
        close_net(&n);
    }
}

static void what_a_masked_view_holds_does_not_matter(void **state)
{
    (void)state;
    const scene s = make_scene();
    for (int switches = 0; switches < SWITCHES; switches++) {
        net n = open_net(switches);
        const output before = run(&n, &s, true);
        lf_tape_reset(n.tape);
        int seen[Q] = {0};
        const lf_ray_geometry rays = rays_of(n.tape, &s, seen);
        scene garbage = s;
        for (long i = 0; i < Q * V * F; i++)
            if (!(rays.mask->value[i / F] > 0))
                garbage.feature[i] = (lf_real)(i % 3 ? 1e6 : -1e5) * s.feature[i];
        lf_real *grads = calloc((size_t)lf_store_size(n.store), sizeof *grads);
        const size_t bytes = (size_t)lf_store_size(n.store) * sizeof *grads;
        run(&n, &s, true);
        memcpy(grads, lf_store_grads(n.store), bytes);
        const output after = run(&n, &garbage, true);
        assert_memory_equal(after.scalar, before.scalar, sizeof after.scalar);
        assert_memory_equal(after.vector, before.vector, sizeof after.vector);
        assert_below(relative_error(lf_store_grads(n.store), grads, lf_store_size(n.store)), 0);
        free(grads);
        close_net(&n);
    }
}

/* Six times the same view is that view once. */
static void copies_of_a_view_count_as_one(void **state)
{
    (void)state;
    static const int copies[V] = {2, 2, 2, 2, 2, 2};
    const scene s = make_scene();
    for (int switches = 0; switches < SWITCHES; switches++) {
        net n = open_net(switches);
        const scene one = with_views(&s, 1, copies), six = with_views(&s, V, copies);
        const output a = run(&n, &one, true), b = run(&n, &six, true);
        assert_below(difference(&b, &a), order_tolerance());
        close_net(&n);
    }
}

typedef struct attention_case {
    lf_tape *tape;
    lf_ray_geometry rays;
    lf_field q, kv;
    lf_real grad0[4 * 2 * 4], grad1[4 * 3 * 2 * 2];
} attention_case;

/* One point, four scalars, two vectors, two heads; key and value of `views` rays. */
static void open_attention(attention_case *c, long views)
{
    *c = (attention_case){.tape = lf_tape_create()};
    lf_tensor *d = lf_tensor_new(c->tape, 3, LF_DIMS(1, views, 3));
    lf_tensor *mask = lf_tensor_new(c->tape, 2, LF_DIMS(1, views));
    c->q = (lf_field){lf_tensor_new(c->tape, 2, LF_DIMS(1, 4)),
                      lf_tensor_new(c->tape, 3, LF_DIMS(1, 3, 2))};
    lf_real *kv0 = lf_alloc_reals(c->tape, views * 8), *kv1 = lf_alloc_reals(c->tape, views * 12);
    c->kv = (lf_field){lf_leaf(c->tape, 3, LF_DIMS(1, views, 8), kv0, c->grad0),
                       lf_leaf(c->tape, 4, LF_DIMS(1, views, 3, 4), kv1, c->grad1)};
    lf_stream r = lf_stream_at(6, LF_RANDOM_TEST, 5, 0);
    lf_tensor *all[] = {d, c->q.scalar, c->q.vector, c->kv.scalar, c->kv.vector};
    for (int t = 0; t < 5; t++)
        for (long i = 0; i < all[t]->size; i++)
            all[t]->value[i] = (lf_real)lf_normal(&r);
    for (long v = 0; v < views; v++)
        mask->value[v] = 1;
    c->rays = (lf_ray_geometry){1, views, d, mask};
}

/* Weights seen as derivatives of the output by the values: 1 per channel of the head. */
static void copies_have_equal_weights(void **state)
{
    (void)state;
    attention_case c;
    open_attention(&c, 4);
    memcpy(c.kv.scalar->value + 8, c.kv.scalar->value, 8 * sizeof(lf_real)); /* view 1 = view 0 */
    memcpy(c.kv.vector->value + 12, c.kv.vector->value, 12 * sizeof(lf_real));
    const lf_field o = lf_ray_attention(c.tape, c.q, c.kv, &c.rays, 2);
    for (long i = 0; i < 4; i++)
        lf_grad(c.tape, o.scalar)[i] = 1;
    lf_backward_from(c.tape);
    for (int i = 0; i < 4; i++) {
        const double w[4] = {(double)c.grad0[4 + i], (double)c.grad0[12 + i],
                             (double)c.grad0[20 + i], (double)c.grad0[28 + i]};
        assert_true(w[0] > 0 && w[2] > 0 && w[3] > 0);
        assert_true(w[0] == w[1]);
        assert_close(w[0] + w[1] + w[2] + w[3], 1, 0, EXACT ? 1e-15 : 1e-6);
    }
    lf_tape_free(c.tape);
}

static void one_view_is_copied(void **state)
{
    (void)state;
    attention_case c;
    open_attention(&c, 1);
    const lf_field o = lf_ray_attention(c.tape, c.q, c.kv, &c.rays, 2);
    for (int i = 0; i < 4; i++)
        assert_true(o.scalar->value[i] == c.kv.scalar->value[4 + i]);
    for (int a = 0; a < 3; a++)
        for (int i = 0; i < 2; i++)
            assert_true(o.vector->value[2 * a + i] == c.kv.vector->value[4 * a + 2 + i]);
    lf_tape_free(c.tape);
}

/* Logits of +-1e4 must not overflow; the largest alone counts. */
static void large_logits(void **state)
{
    (void)state;
    attention_case c;
    open_attention(&c, 3);
    for (long i = 0; i < c.kv.scalar->size; i++)
        if (i % 8 < 4)
            c.kv.scalar->value[i] *= (lf_real)1e5;
    const lf_field o = lf_ray_attention(c.tape, c.q, c.kv, &c.rays, 2);
    for (int i = 0; i < 4; i++) {
        int copies = 0;
        for (int v = 0; v < 3; v++)
            copies += o.scalar->value[i] == c.kv.scalar->value[8 * v + 4 + i];
        assert_int_equal(copies, 1);
    }
    lf_tape_free(c.tape);
}

static void no_view_gives_zeros(void **state)
{
    (void)state;
    attention_case c;
    open_attention(&c, 3);
    memset(c.rays.mask->value, 0, 3 * sizeof(lf_real));
    const lf_field o = lf_ray_attention(c.tape, c.q, c.kv, &c.rays, 2);
    const lf_field m = lf_ray_moments(c.tape, c.kv.scalar, &c.rays);
    for (int i = 0; i < 4; i++)
        lf_grad(c.tape, o.scalar)[i] = 1;
    for (int i = 0; i < 6; i++)
        lf_grad(c.tape, o.vector)[i] = 1;
    for (long i = 0; i < m.scalar->size; i++)
        lf_grad(c.tape, m.scalar)[i] = lf_grad(c.tape, m.vector)[i] = 1;
    lf_backward_from(c.tape);
    for (int i = 0; i < 4; i++)
        assert_true(o.scalar->value[i] == 0);
    for (int i = 0; i < 6; i++)
        assert_true(o.vector->value[i] == 0);
    for (long i = 0; i < m.vector->size; i++)
        assert_true(m.vector->value[i] == 0);
    for (int i = 0; i < 24; i++)
        assert_true(c.grad0[i] == 0);
    for (int i = 0; i < 36; i++)
        assert_true(c.grad1[i] == 0);
    lf_tape_free(c.tape);
}

/* A point at a camera's centre is masked there, one behind all cameras everywhere. */
static void points_without_a_direction(void **state)
{
    (void)state;
    scene s = make_scene();
    memcpy(s.point[0], s.camera[0].centre, sizeof s.point[0]);
    for (int a = 0; a < 3; a++) /* on the far side of camera 1 */
        s.point[1][a] = 40 * s.camera[1].centre[a];
    s.camera[2] = s.camera[3] = s.camera[4] = s.camera[5] = s.camera[1];
    for (int switches = 0; switches < SWITCHES; switches++) {
        net n = open_net(switches);
        const output o = run(&n, &s, true); /* checks that all gradients are finite */
        assert_int_equal(o.seen[1], 0);
        for (long i = 0; i < Q * o.scalars; i++)
            assert_true(isfinite(o.scalar[i]));
        for (long i = 0; i < 3 * o.vectors; i++) /* no direction, so no vector */
            assert_true(o.vector[3 * o.vectors + i] == 0);
        scene other = s; /* what the camera at the point holds does not matter */
        for (int i = 0; i < F; i++)
            other.feature[i] += 1000;
        const output p = run(&n, &other, false);
        assert_memory_equal(p.scalar, o.scalar, sizeof(double) * (size_t)o.scalars);
        close_net(&n);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(some_views_see_some_points),
        cmocka_unit_test(moving_the_frame_turns_vectors_only),
        cmocka_unit_test(rotations_alone),
        cmocka_unit_test(far_away),
        cmocka_unit_test(kernels_keep_their_constraint),
        cmocka_unit_test(kernels_are_the_written_matrices),
        cmocka_unit_test(vector_neurons_give_invariants),
        cmocka_unit_test(order_of_the_views_does_not_matter),
        cmocka_unit_test(what_a_masked_view_holds_does_not_matter),
        cmocka_unit_test(copies_of_a_view_count_as_one),
        cmocka_unit_test(copies_have_equal_weights),
        cmocka_unit_test(one_view_is_copied),
        cmocka_unit_test(large_logits),
        cmocka_unit_test(no_view_gives_zeros),
        cmocka_unit_test(points_without_a_direction),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
