/* test_light_field.c: the layers along a target ray under motions of the frame, and at the places
 * where an angle or a view is missing.                 [method.md 2.1 - 2.4, 2.8, 4.1, 4.4, 5b, 10]
 */
#include "autograd/random.h"
#include "layers/light_field.h"
#include "tests/close.h"

enum { N = 5, S = 6, V = 4, C = 4, F = 7, T = 9, P = 2 * T - 1, MOTIONS = 100 };
#define EXACT (sizeof(lf_real) == 8) /* the double build */
static const lf_types types = {.count = T, .omega = {0, 1, 2, 4, 8, 16, 32, 64, 128}};

static double layer_tolerance(void)
{
    return EXACT ? 1e-9 : 2e-5;
}

/* ---- a scene of radius 1 ---- */

typedef struct scene {
    double origin[N * 3], direction[N * 3], depth[N * S], centre[V * 3];
    uint8_t seen[N * S * V];
    lf_real feature[N * S * V * F];
} scene;

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

/* Rays from 3 away to near the origin, cameras about as far, a fifth of the pairs unseen. */
static scene make_scene(void)
{
    scene s;
    lf_stream r = lf_stream_at(3, LF_RANDOM_TEST, 20, 0);
    for (int i = 0; i < N; i++) {
        double size = 0;
        unit_vector(&r, s.origin + 3 * i);
        for (int a = 0; a < 3; a++) {
            s.origin[3 * i + a] *= 3;
            s.direction[3 * i + a] = 0.6 * (lf_uniform(&r) - 0.5) - s.origin[3 * i + a];
            size += s.direction[3 * i + a] * s.direction[3 * i + a];
        }
        for (int a = 0; a < 3; a++)
            s.direction[3 * i + a] /= sqrt(size);
        for (int k = 0; k < S; k++)
            s.depth[i * S + k] = 2 + 2 * (k + lf_uniform(&r)) / S;
    }
    for (int v = 0; v < V; v++) {
        unit_vector(&r, s.centre + 3 * v);
        for (int a = 0; a < 3; a++)
            s.centre[3 * v + a] *= 3;
    }
    for (int i = 0; i < N * S * V; i++)
        s.seen[i] = lf_uniform(&r) < 0.8;
    for (int i = 0; i < N * S * V * F; i++)
        s.feature[i] = (lf_real)lf_normal(&r);
    return s;
}

static lf_light_rays rays_of(const scene *s)
{
    return (lf_light_rays){N, S, V, s->origin, s->direction, s->depth, s->centre, s->seen, 2, 4};
}

/* A rotation drawn uniformly and a translation of a length up to `reach`. */
static lf_frame random_motion(uint64_t item, double reach)
{
    lf_stream r = lf_stream_at(1, LF_RANDOM_GROUP, item, 20);
    double d[3];
    unit_vector(&r, d);
    const double angle = 6.283185307179586 * lf_uniform(&r);
    const lf_twist turn = {cos(angle), sin(angle), 0};
    lf_frame g = {.origin = {0, 0, 0}}, about = lf_twist_frame(&turn);
    lf_ray_axes(d, g.rotation);
    g = lf_frame_compose(&g, &about);
    unit_vector(&r, d);
    const double length = reach * lf_uniform(&r);
    for (int a = 0; a < 3; a++)
        g.origin[a] = length * d[a];
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

/* ---- the layers, one after the other ---- */

enum stage { VALUES, MEAN, MAP, GATED, NORM, LAYER_NORM, CROSS, ALONG, STAGES };

typedef struct net {
    lf_store *store;
    lf_tape *tape;
    lf_ray_ray_convolution convolution;
    lf_so2_map map;
    lf_so2_gated gated;
    lf_cross_attention_layer cross;
    lf_along_ray_layer along;
    const lf_parameter *beta, *gain;
} net;

static net open_net(void)
{
    net n = {.store = lf_store_create(7), .tape = lf_tape_create()};
    lf_ray_ray_convolution_init(n.store, &n.convolution, "convolution", &types, F, C, 16);
    lf_so2_map_init(n.store, &n.map, "map", &types, C, C, true);
    lf_so2_gated_init(n.store, &n.gated, "gated", &types, C);
    lf_cross_attention_init(n.store, &n.cross, "cross", &types, F, C, 16, 4);
    lf_along_ray_init(n.store, &n.along, "along", &types, C, 2, 4);
    n.beta = lf_store_add(n.store, "beta", 1, LF_DIMS(T * C), 0, 0.3, true);
    n.gain = lf_store_add(n.store, "gain", 1, LF_DIMS(T * C), 1, 0.3, true);
    lf_stream r = lf_stream_at(7, LF_RANDOM_TEST, 21, 0); /* biases that are not 0 */
    for (int i = 0; i < lf_store_count(n.store); i++) {
        const lf_parameter *p = lf_store_at(n.store, i);
        for (long k = 0; p->rank == 1 && k < p->size; k++)
            lf_values(p)[k] += (lf_real)(0.3 * lf_normal(&r));
    }
    return n;
}

static void close_net(net *n)
{
    lf_tape_free(n->tape);
    lf_store_free(n->store);
}

/* Fields of all stages; returns the weights of the views. */
static const lf_tensor *run(net *n, lf_tape *tape, const scene *s, lf_tensor **field)
{
    const lf_light_rays in = rays_of(s);
    const lf_light_geometry g = lf_light_geometry_make(tape, &types, &in);
    lf_tensor *f = lf_leaf(tape, 4, LF_DIMS(N, S, V, F), (lf_real *)(uintptr_t)s->feature, NULL);
    field[VALUES] = lf_ray_ray_convolution_views(tape, &n->convolution, f, &g);
    field[MEAN] = lf_ray_ray_convolution_apply(tape, &n->convolution, f, &g);
    field[MAP] = lf_so2_map_apply(tape, &n->map, &types, field[MEAN]);
    field[GATED] = lf_so2_gated_apply(tape, &n->gated, &types, field[MAP]);
    field[NORM] = lf_so2_norm_relu(tape, &types, field[MAP], lf_param(tape, n->beta));
    field[LAYER_NORM] = lf_so2_layer_norm(tape, &types, field[MAP], lf_param(tape, n->gain));
    const lf_attended a = lf_cross_attention_apply(tape, &n->cross, f, field[LAYER_NORM], &g);
    field[CROSS] = a.field;
    field[ALONG] = lf_along_ray_apply(tape, &n->along, a.field, &g);
    return a.weight;
}

/* The largest |after - Rot(omega gamma) before| of each type over the field's largest number. */
static void add_errors(const lf_tensor *after, const lf_tensor *before, const scene *s,
                       const lf_frame *g, double error[T])
{
    double size = 0;
    for (long i = 0; i < before->size; i++)
        size = larger(fabs((double)before->value[i]), size);
    const long rows = lf_rows(before), c = lf_cols(before) / P;
    for (long r = 0; r < rows; r++) {
        const long ray = r / (rows / N);
        const lf_ray x = lf_ray_through(s->origin + 3 * ray, s->direction + 3 * ray);
        const lf_twist h = lf_ray_twist(g, &x);
        double z[P];
        lf_harmonics(&types, h.cosine, h.sine, 0, z);
        for (long k = 0; k < T; k++)
            for (long i = 0; i < c; i++) {
                const long re = (r * P + (k ? 2 * k - 1 : 0)) * c + i, im = k ? re + c : re;
                const double cosine = k ? z[2 * k - 1] : 1, sine = k ? z[2 * k] : 0;
                const double x0 = (double)before->value[re], x1 = (double)before->value[im];
                const double e0 = (double)after->value[re] - (cosine * x0 - sine * x1);
                const double e1 = (double)after->value[im] - (sine * x0 + cosine * x1);
                error[k] = larger(larger(fabs(e0), fabs(e1)) / size, error[k]);
            }
    }
}

/* Errors of all stages and types under motions with translations up to `reach`, every second one
 * of that order and the others within the scene; the weights of the views must not change. */
static void check_motions(int motions, double reach, double tolerance)
{
    const scene s = make_scene();
    net n = open_net();
    lf_tape *other = lf_tape_create();
    lf_tensor *before[STAGES], *after[STAGES];
    double error[STAGES][T] = {{0}};
    const lf_tensor *weight = run(&n, n.tape, &s, before);
    for (int i = 0; i < motions; i++) {
        const lf_frame g = random_motion((uint64_t)i, i % 2 ? reach : 3);
        const scene m = moved(&s, &g);
        lf_tape_reset(other);
        const lf_tensor *w = run(&n, other, &m, after);
        assert_below(relative_error(w->value, weight->value, w->size), tolerance);
        for (int k = 0; k < STAGES; k++)
            add_errors(after[k], before[k], &s, &g, error[k]);
    }
    for (int k = 0; k < STAGES; k++)
        for (int t = 0; t < T; t++)
            if (!(error[k][t] <= tolerance))
                fail_msg("stage %d, type %d: error %.3g, must be <= %.3g", k, types.omega[t],
                         error[k][t], tolerance);
    lf_tape_free(other);
    close_net(&n);
}

/* Translations up to 1000 scene radii. */
static void fields_turn_with_the_frame(void **state)
{
    (void)state;
    check_motions(MOTIONS, 1000, layer_tolerance());
}

/* Coordinates of 1e5 carry 1e5 * 1e-16 of themselves, phases 128 times that. */
static void far_away(void **state)
{
    (void)state;
    check_motions(20, 1e5, EXACT ? 1e-7 : 2e-5);
}

/* ---- phases and angles ---- */

static void phases_are_powers(void **state)
{
    (void)state;
    const lf_types list = {.count = 5, .omega = {0, 1, 3, 100, 1000}};
    double z[LF_PHASES_MAX];
    for (int i = 0; i < 100; i++) {
        const double alpha = 0.063 * i - 3.14, r = pow(10, i % 7 - 3);
        lf_harmonics(&list, r * cos(alpha), r * sin(alpha), 0, z);
        assert_true(z[0] == 1);
        for (int k = 1; k < list.count; k++) {
            assert_close(z[2 * k - 1], cos(list.omega[k] * alpha), 0, 3e-13);
            assert_close(z[2 * k], sin(list.omega[k] * alpha), 0, 3e-13);
        }
    }
}

static void phases_fade_on_the_axis(void **state)
{
    (void)state;
    double z[LF_PHASES_MAX];
    lf_harmonics(&types, 0, 0, 1e-4, z);
    assert_true(z[0] == 1);
    for (int p = 1; p < P; p++)
        assert_true(z[p] == 0);
    lf_harmonics(&types, 1e-4, 0, 1e-4, z); /* at a distance of epsilon: half */
    for (int k = 1; k < T; k++)
        assert_close(z[2 * k - 1], 0.5, 0, 1e-12);
    lf_harmonics(&types, 1e-180, 1e-180, 1e-4, z); /* its square underflows */
    for (int p = 1; p < P; p++)
        assert_true(isfinite(z[p]) && fabs(z[p]) < 1e-300);
}

/* omega = 128 and a ray that the camera sees at an angle of 1e-7: the offset keeps the azimuth. */
static void nearly_parallel_rays(void **state)
{
    (void)state;
    double z[LF_PHASES_MAX];
    const double alpha = 0.7;
    lf_harmonics(&types, 1e-7 * cos(alpha), 1e-7 * sin(alpha), 0, z);
    assert_close(z[P - 2], cos(128 * alpha), 0, 1e-12);
    assert_close(z[P - 1], sin(128 * alpha), 0, 1e-12);
}

static void lists_of_types(void **state)
{
    (void)state;
    assert_true(lf_types_valid(&types));
    assert_true(lf_types_valid(&(lf_types){.count = 1, .omega = {0}}));
    assert_true(lf_types_valid(&(lf_types){.count = 1, .omega = {0}, .more = LF_SCALARS_MAX - 1}));
    assert_false(lf_types_valid(&(lf_types){.count = 1, .omega = {0}, .more = LF_SCALARS_MAX}));
    assert_false(lf_types_valid(&(lf_types){.count = 1, .omega = {0}, .more = -1}));
    assert_false(lf_types_valid(&(lf_types){.count = 0, .omega = {0}}));
    assert_false(lf_types_valid(&(lf_types){.count = 2, .omega = {1, 2}}));
    assert_false(lf_types_valid(&(lf_types){.count = 3, .omega = {0, 4, 4}}));
    assert_false(lf_types_valid(&(lf_types){.count = 2, .omega = {0, LF_OMEGA_MAX + 1}}));
    assert_false(lf_types_valid(
        &(lf_types){.count = LF_TYPES_MAX + 1, .omega = {0, 1, 2, 3, 4, 5, 6, 7, 8}}));
}

/* Angles from depths against angles from vectors. */
static void angles_are_those_of_the_vectors(void **state)
{
    (void)state;
    const scene s = make_scene();
    lf_tape *tape = lf_tape_create();
    const lf_light_rays in = rays_of(&s);
    const lf_light_geometry g = lf_light_geometry_make(tape, &types, &in);
    for (long i = 0; i < N * S * V; i++) {
        const long ray = i / V / S, v = i % V;
        double along = 0, size = 0;
        for (int a = 0; a < 3; a++) {
            const double d = s.direction[3 * ray + a];
            const double w = s.origin[3 * ray + a] + s.depth[i / V] * d - s.centre[3 * v + a];
            along += w * d;
            size += w * w;
        }
        const double cosine = along / sqrt(size), tolerance = EXACT ? 1e-13 : 1e-5;
        assert_close(g.angle->value[3 * i], 4 * sqrt(1 - cosine * cosine) - 1, 0, tolerance);
        assert_close(g.angle->value[3 * i + 1], 10 * (1 - cosine), 0, tolerance);
        assert_close(g.angle->value[3 * i + 2], cosine, 0, tolerance);
        assert_true(g.mask->value[i] == s.seen[i]);
    }
    lf_tape_free(tape);
}

/* ---- missing views and angles ---- */

/* Camera 0 on ray 0, at its third sample; camera 1 at the origin of ray 1, the target's own. */
static scene degenerate_scene(void)
{
    scene s = make_scene();
    memset(s.seen, 1, sizeof s.seen);
    for (int a = 0; a < 3; a++)
        s.centre[a] = s.origin[a] + s.depth[2] * s.direction[a];
    memcpy(s.centre + 3, s.origin + 3, 3 * sizeof(double));
    return s;
}

static void cameras_on_the_ray(void **state)
{
    (void)state;
    const scene s = degenerate_scene();
    net n = open_net();
    lf_tensor *field[STAGES];
    run(&n, n.tape, &s, field);
    const lf_light_rays in = rays_of(&s);
    const lf_light_geometry g = lf_light_geometry_make(n.tape, &types, &in);
    for (int k = 0; k < S; k++)
        assert_true(g.mask->value[k * V] == (k != 2)); /* at the camera: no direction */
    for (int p = 1; p < P; p++) {
        assert_true(fabs((double)g.phase->value[p]) < 1e-6);               /* ray 0, camera 0 */
        assert_true(fabs((double)g.phase->value[(V + 1) * P + p]) < 1e-6); /* ray 1, camera 1 */
    }
    for (int k = 0; k < STAGES; k++)
        for (long i = 0; i < field[k]->size; i++)
            assert_true(isfinite(field[k]->value[i]));
    close_net(&n);
}

/* With every view masked all fields of the convolution are 0; what a masked view holds never
 * counts. */
static void masked_views_do_not_count(void **state)
{
    (void)state;
    scene s = make_scene();
    memset(s.seen, 0, S * V); /* ray 0 */
    net n = open_net();
    lf_tensor *before[STAGES], *after[STAGES];
    run(&n, n.tape, &s, before);
    for (long i = 0; i < S * P * C; i++)
        assert_true(before[MEAN]->value[i] == 0);
    for (long i = 0; i < N * S * V; i++)
        for (int k = 0; k < F && !s.seen[i]; k++)
            s.feature[i * F + k] += 1000;
    run(&n, n.tape, &s, after);
    for (int k = MEAN; k < STAGES; k++)
        assert_memory_equal(after[k]->value, before[k]->value,
                            (size_t)after[k]->size * sizeof(lf_real));
    close_net(&n);
}

/* ---- attention over the views ---- */

typedef struct attention_case {
    lf_light_geometry rays;
    lf_tensor *q, *k, *value;
} attention_case;

static attention_case open_attention(lf_tape *tape, const scene *s)
{
    const lf_light_rays in = rays_of(s);
    attention_case c = {lf_light_geometry_make(tape, &types, &in),
                        lf_tensor_new(tape, 3, LF_DIMS(N, S, P * C)),
                        lf_tensor_new(tape, 4, LF_DIMS(N, S, V, P * C)),
                        lf_tensor_new(tape, 4, LF_DIMS(N, S, V, P * C))};
    lf_tensor *all[] = {c.q, c.k, c.value};
    lf_stream r = lf_stream_at(9, LF_RANDOM_TEST, 23, 0);
    for (int t = 0; t < 3; t++)
        for (long i = 0; i < all[t]->size; i++)
            all[t]->value[i] = (lf_real)lf_normal(&r);
    return c;
}

static void no_view_and_one_view(void **state)
{
    (void)state;
    scene s = make_scene();
    lf_tape *tape = lf_tape_create();
    for (int v = 0; v < V; v++) {
        s.seen[v] = 0;          /* the first point is seen by none */
        s.seen[V + v] = v == 2; /* the second by one */
    }
    const attention_case c = open_attention(tape, &s);
    const lf_attended y = lf_cross_attention(tape, c.q, c.k, c.value, &c.rays, 2);
    for (int i = 0; i < P * C; i++) {
        assert_true(y.field->value[i] == 0);
        assert_true(y.field->value[P * C + i] == c.value->value[(V + 2) * P * C + i]);
    }
    for (int v = 0; v < V; v++) {
        assert_true(y.weight->value[v] == 0);
        assert_true(y.weight->value[V + v] == (v == 2));
    }
    lf_tape_free(tape);
}

/* Two equal views share evenly; the order of views is no part of the answer; huge logits. */
static void copies_orders_and_sizes(void **state)
{
    (void)state;
    scene s = make_scene();
    memset(s.seen, 1, sizeof s.seen);
    lf_tape *tape = lf_tape_create();
    attention_case c = open_attention(tape, &s);
    const long n = P * C;
    memcpy(c.k->value + n, c.k->value, (size_t)n * sizeof(lf_real)); /* view 1 = view 0 */
    memcpy(c.value->value + n, c.value->value, (size_t)n * sizeof(lf_real));
    const lf_attended y = lf_cross_attention(tape, c.q, c.k, c.value, &c.rays, 4);
    assert_true(y.weight->value[0] == y.weight->value[1]);
    double sum = 0;
    for (int v = 0; v < V; v++)
        sum += (double)y.weight->value[v];
    assert_close(sum, 1, 0, EXACT ? 1e-15 : 1e-6);
    attention_case back = open_attention(tape, &s);
    for (long p = 0; p < N * S; p++)
        for (long v = 0; v < V; v++) {
            const long to = (p * V + V - 1 - v) * n, from = (p * V + v) * n;
            memcpy(back.k->value + to, c.k->value + from, (size_t)n * sizeof(lf_real));
            memcpy(back.value->value + to, c.value->value + from, (size_t)n * sizeof(lf_real));
        }
    const lf_attended z = lf_cross_attention(tape, c.q, back.k, back.value, &c.rays, 4);
    assert_below(relative_error(z.field->value, y.field->value, y.field->size),
                 EXACT ? 1e-12 : 1e-5);
    for (long i = 0; i < c.k->size; i++)
        c.k->value[i] *= (lf_real)1e5;
    const lf_attended large = lf_cross_attention(tape, c.q, c.k, c.value, &c.rays, 4);
    for (long i = 0; i < large.field->size; i++)
        assert_true(isfinite(large.field->value[i]));
    lf_tape_free(tape);
}

/* ---- attention along the ray ---- */

/* A ray that is seen nowhere by two views gives 0; what is no key is not heard; and adding the same
 * length to all depths changes nothing. */
static void keys_along_the_ray(void **state)
{
    (void)state;
    scene s = make_scene();
    for (int i = 0; i < S * V; i++)
        s.seen[i] = i % V == 1; /* ray 0: one view */
    for (int v = 0; v < V; v++)
        s.seen[S * V + v] = 0; /* the first sample of ray 1 */
    lf_tape *tape = lf_tape_create();
    attention_case c = open_attention(tape, &s);
    lf_tensor *w[2] = {lf_tensor_new(tape, 2, LF_DIMS(LF_ALONG_BASIS, P * C)),
                       lf_tensor_new(tape, 2, LF_DIMS(LF_ALONG_BASIS, P * C))};
    lf_stream r = lf_stream_at(9, LF_RANDOM_TEST, 24, 0);
    for (int k = 0; k < 2; k++)
        for (long i = 0; i < w[k]->size; i++)
            w[k]->value[i] = (lf_real)lf_normal(&r);
    lf_tensor *q = c.q, *k = lf_tensor_like(tape, q), *x = lf_tensor_like(tape, q);
    for (long i = 0; i < q->size; i++) {
        k->value[i] = (lf_real)lf_normal(&r);
        x->value[i] = (lf_real)lf_normal(&r);
    }
    const lf_tensor *y = lf_along_ray_attention(tape, q, k, x, w[0], w[1], &c.rays, 2);
    for (long i = 0; i < S * P * C; i++)
        assert_true(y->value[i] == 0);
    for (long i = S * P * C; i < (S + 1) * P * C; i++)
        k->value[i] = x->value[i] = 1000;
    const lf_tensor *z = lf_along_ray_attention(tape, q, k, x, w[0], w[1], &c.rays, 2);
    assert_memory_equal(z->value, y->value, (size_t)y->size * sizeof(lf_real));
    for (long i = 0; i < N * S; i++)
        c.rays.depth->value[i] += (lf_real)0.25;
    z = lf_along_ray_attention(tape, q, k, x, w[0], w[1], &c.rays, 2);
    assert_below(relative_error(z->value, y->value, y->size), EXACT ? 1e-12 : 1e-5);
    lf_tape_free(tape);
}

/* ---- irreducible translation types ---- */

enum { SOURCES = 6, POINTS = 9 };
static const lf_spectrum spectrum = {400, 0.4, 0.05}; /* up to 160; period 15.7 */

typedef struct ray_case {
    lf_ray target[N], source[SOURCES];
    lf_light_geometry rays;
    double foot[N * SOURCES];
    lf_tensor *k, *z;
} ray_case;

static void unit_ray(lf_stream *r, lf_ray *x)
{
    double d[3], p[3];
    unit_vector(r, d);
    unit_vector(r, p);
    *x = lf_ray_through(p, d);
}

static bool feet_near_by(const ray_case *c, const lf_ray *source)
{
    for (int i = 0; i < N; i++)
        if (!(fabs(lf_ray_relative(&c->target[i], source).foot) < 5))
            return false;
    return true;
}

/* Rays that pass near the origin, none so parallel that their foot is far away; but the last source
 * is parallel to the first target. */
static ray_case make_rays(void)
{
    ray_case c;
    const double aside[3] = {0.3, 0.1, -0.2};
    lf_stream r = lf_stream_at(12, LF_RANDOM_TEST, 25, 0);
    for (int i = 0; i < N; i++)
        unit_ray(&r, &c.target[i]);
    for (int s = 0; s < SOURCES - 1; s++)
        do
            unit_ray(&r, &c.source[s]);
        while (!feet_near_by(&c, &c.source[s]));
    c.source[SOURCES - 1] = lf_ray_through(aside, c.target[0].direction);
    return c;
}

/* Features of the pairs and their spectrum. */
static void run_rays(lf_tape *tape, net *n, const scene *s, ray_case *c)
{
    c->rays = lf_ray_pair_geometry(tape, &types, N, c->target, SOURCES, c->source, c->foot);
    lf_tensor *f =
        lf_leaf(tape, 4, LF_DIMS(N, 1, SOURCES, F), (lf_real *)(uintptr_t)s->feature, NULL);
    c->k = lf_ray_ray_convolution_views(tape, &n->convolution, f, &c->rays);
    c->z = lf_along_ray_spectrum(tape, c->k, &c->rays, c->foot, &spectrum);
}

static void irreducible_types_are_the_transform_of_points(void **state)
{
    (void)state;
    const scene s = make_scene();
    net n = open_net();
    ray_case c = make_rays();
    run_rays(n.tape, &n, &s, &c);
    assert_true(c.rays.mask->value[SOURCES - 1] == 0); /* parallel */
    double t[N * POINTS];
    for (int i = 0; i < N * POINTS; i++) { /* the feet, and between them */
        const int ray = i / POINTS, k = i % POINTS;
        t[i] = k < SOURCES - 1 ? c.foot[ray * SOURCES + k] + 0.01 * k : 0.3 * (k - 6);
    }
    const lf_tensor *direct =
        lf_along_ray_regular(n.tape, c.k, &c.rays, c.foot, POINTS, t, spectrum.width);
    const lf_tensor *back = lf_along_ray_inverse(n.tape, c.z, &types, N, POINTS, t, &spectrum);
    assert_below(relative_error(back->value, direct->value, direct->size), EXACT ? 1e-9 : 1e-4);
    close_net(&n);
}

/* Types (omega, w) turn by omega gamma + w tau. */
static void irreducible_types_turn(void **state)
{
    (void)state;
    const scene s = make_scene();
    net n = open_net();
    ray_case c = make_rays();
    run_rays(n.tape, &n, &s, &c);
    lf_tape *other = lf_tape_create();
    const long waves = 2 * spectrum.half + 1;
    for (int motion = 0; motion < 10; motion++) {
        const lf_frame g = random_motion((uint64_t)motion, motion % 2 ? 1000 : 2);
        ray_case m = c;
        for (int i = 0; i < N; i++)
            m.target[i] = lf_ray_move(&g, &c.target[i]);
        for (int i = 0; i < SOURCES; i++)
            m.source[i] = lf_ray_move(&g, &c.source[i]);
        lf_tape_reset(other);
        run_rays(other, &n, &s, &m);
        double worst = 0, size = 0;
        for (long r = 0; r < N * waves; r++) {
            const lf_twist h = lf_ray_twist(&g, &c.target[r / waves]);
            const double gamma = atan2(h.sine, h.cosine);
            const double along = spectrum.step * (double)(r % waves - spectrum.half) * h.shift;
            for (int k = 0; k < T; k++)
                for (int i = 0; i < C; i++) {
                    const long re = (r * 2 * T + 2 * k) * C + i, im = re + C;
                    const double turn = types.omega[k] * gamma + along;
                    const double x = (double)c.z->value[re], y = (double)c.z->value[im];
                    const double e =
                        hypot((double)m.z->value[re] - (cos(turn) * x - sin(turn) * y),
                              (double)m.z->value[im] - (sin(turn) * x + cos(turn) * y));
                    worst = larger(e, worst);
                    size = larger(hypot(x, y), size);
                }
        }
        assert_below(worst / size, layer_tolerance());
    }
    lf_tape_free(other);
    close_net(&n);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(fields_turn_with_the_frame),
        cmocka_unit_test(far_away),
        cmocka_unit_test(phases_are_powers),
        cmocka_unit_test(phases_fade_on_the_axis),
        cmocka_unit_test(nearly_parallel_rays),
        cmocka_unit_test(lists_of_types),
        cmocka_unit_test(angles_are_those_of_the_vectors),
        cmocka_unit_test(cameras_on_the_ray),
        cmocka_unit_test(masked_views_do_not_count),
        cmocka_unit_test(no_view_and_one_view),
        cmocka_unit_test(copies_orders_and_sizes),
        cmocka_unit_test(keys_along_the_ray),
        cmocka_unit_test(irreducible_types_are_the_transform_of_points),
        cmocka_unit_test(irreducible_types_turn),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
