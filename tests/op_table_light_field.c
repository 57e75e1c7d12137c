/* op_table_light_field.c: a row for every op and layer of layers/light_field.h. */
#include "autograd/random.h"
#include "layers/light_blocks.h"
#include "tests/gradcheck.h"

enum { N = 2, S = 4, V = 3, C = 2, T = 3, Z = 2, F = 4 };
enum { P = Z + 2 * (T - 1), Q = Z + T - 1, M = Z * Z + 2 * (T - 1) }; /* light_field.h */
static const lf_types types = {.count = T, .omega = {0, 2, 5}, .more = Z - 1},
                      single = {.count = T, .omega = {0, 2, 5}};

/* Two rays and three cameras; the second ray's first point is seen by none, its second by one. */
static lf_light_geometry geometry(lf_tape *tape)
{
    double origin[3 * N], direction[3 * N], depth[N * S], centre[3 * V];
    uint8_t seen[N * S * V];
    lf_stream r = lf_stream_at(5, LF_RANDOM_TEST, 11, 0);
    for (int i = 0; i < N; i++) {
        double size = 0;
        for (int a = 0; a < 3; a++) {
            origin[3 * i + a] = lf_normal(&r);
            direction[3 * i + a] = lf_normal(&r);
            size += direction[3 * i + a] * direction[3 * i + a];
        }
        for (int a = 0; a < 3; a++)
            direction[3 * i + a] /= sqrt(size);
        for (int s = 0; s < S; s++)
            depth[i * S + s] = 1 + s + 0.8 * lf_uniform(&r);
    }
    for (int i = 0; i < 3 * V; i++)
        centre[i] = 2 * lf_normal(&r);
    for (int i = 0; i < N * S * V; i++)
        seen[i] = i % 5 != 1;
    for (int v = 0; v < V; v++) {
        seen[S * V + v] = 0;
        seen[(S + 1) * V + v] = v == 1;
    }
    const lf_light_rays rays = {N, S, V, origin, direction, depth, centre, seen, 1, 5};
    return lf_light_geometry_make(tape, &types, &rays);
}

/* A layer's struct holds only pointers into the store: it is kept there as an untrainable array of
 * bytes between the builds of a case. True at the first build, which makes the layer. */
static bool first_build(lf_store *store, void *layer, size_t size)
{
    if (lf_store_count(store) == 0)
        return true;
    memcpy(layer, lf_values(lf_store_find(store, "test.layer")), size);
    return false;
}

static void keep(lf_store *store, const void *layer, size_t size)
{
    const long n = (long)(size / sizeof(lf_real) + 1);
    memcpy(lf_values(lf_store_add(store, "test.layer", 1, &n, 0, 0, false)), layer, size);
}

static int linear(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_so2_linear(tape, &types, in[0], in[1], in[2]);
    out[1] = lf_so2_linear(tape, &types, in[0], in[1], NULL);
    return 2;
}

static int concat(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_so2_concat(tape, &types, in[0], in[1]);
    return 1;
}

static int invariants(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_so2_invariants(tape, &types, in[0]);
    return 1;
}

static int gate(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_so2_gate(tape, &types, in[0], in[1]);
    return 1;
}

static int norm_relu(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_so2_norm_relu(tape, &types, in[0], in[1]);
    return 1;
}

static int layer_norm(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_so2_layer_norm(tape, &types, in[0], in[1]);
    return 1;
}

typedef struct nonlinear_layers {
    lf_so2_map map;
    lf_so2_gated gated;
} nonlinear_layers;

static int map_and_gate(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    nonlinear_layers l;
    if (first_build(store, &l, sizeof l)) {
        lf_so2_map_init(store, &l.map, "map", &types, C, 3, true);
        lf_so2_gated_init(store, &l.gated, "gated", &types, 3);
        keep(store, &l, sizeof l);
    }
    lf_tensor *y = lf_so2_map_apply(tape, &l.map, &types, in[0]);
    out[0] = lf_so2_gated_apply(tape, &l.gated, &types, y);
    return 1;
}

static int ray_ray(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    const lf_light_geometry g = geometry(tape);
    out[0] = lf_ray_ray_values(tape, in[0], in[1], &g);
    out[1] = lf_ray_ray_mean(tape, in[0], in[1], &g);
    return 2;
}

static int convolution(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    const lf_light_geometry g = geometry(tape);
    lf_ray_ray_convolution l;
    if (first_build(store, &l, sizeof l)) {
        lf_ray_ray_convolution_init(store, &l, "conv", &types, F, C, 5);
        keep(store, &l, sizeof l);
    }
    out[0] = lf_ray_ray_convolution_apply(tape, &l, in[0], &g);
    out[1] = lf_ray_ray_convolution_views(tape, &l, in[0], &g);
    return 2;
}

static int cross_attention(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    const lf_light_geometry g = geometry(tape);
    const lf_attended y = lf_cross_attention(tape, in[0], in[1], in[2], &g, 2);
    out[0] = y.field;
    out[1] = y.weight;
    return 2;
}

static int blend(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_blend_views(tape, in[0], in[1]);
    out[1] = lf_blend_columns(tape, in[0], in[1], 2);
    return 2;
}

static int cross_attention_layer(lf_tape *tape, lf_store *store, lf_tensor *const *in,
                                 lf_tensor **out)
{
    const lf_light_geometry g = geometry(tape);
    lf_cross_attention_layer l;
    if (first_build(store, &l, sizeof l)) {
        lf_cross_attention_init(store, &l, "cross", &types, F, C, 5, 2);
        keep(store, &l, sizeof l);
    }
    const lf_attended y = lf_cross_attention_apply(tape, &l, in[0], in[1], &g);
    out[0] = y.field;
    out[1] = y.weight;
    return 2;
}

static int along_ray(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    const lf_light_geometry g = geometry(tape);
    out[0] = lf_along_ray_attention(tape, in[0], in[1], in[2], in[3], in[4], &g, 2);
    return 1;
}

/* 19 samples of one ray: more than one block of keys. */
static int along_long_ray(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    lf_tensor *count = lf_tensor_new(tape, 2, LF_DIMS(1, 19)), *depth = lf_tensor_like(tape, count);
    for (int i = 0; i < 19; i++) {
        count->value[i] = (lf_real)(i % 5);
        depth->value[i] = (lf_real)(i + 0.3 * (i % 3)) / 20;
    }
    const lf_light_geometry g = {1, 19, 1, types, NULL, NULL, NULL, count, depth};
    out[0] = lf_along_ray_attention(tape, in[0], in[1], in[2], in[3], in[4], &g, 1);
    return 1;
}

static int along_ray_layer(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    const lf_light_geometry g = geometry(tape);
    lf_along_ray_layer l;
    if (first_build(store, &l, sizeof l)) {
        lf_along_ray_init(store, &l, "along", &types, C, 3, 2);
        keep(store, &l, sizeof l);
    }
    out[0] = lf_along_ray_apply(tape, &l, in[0], &g);
    return 1;
}

/* ---- the same in blocks ---- */

typedef struct block_layers {
    lf_ray_ray_convolution convolution;
    lf_cross_attention_layer cross;
    lf_so2_map map;
    lf_mlp mlp;
} block_layers;

static block_layers make_block_layers(lf_store *store)
{
    block_layers l;
    if (first_build(store, &l, sizeof l)) {
        lf_ray_ray_convolution_init(store, &l.convolution, "conv", &types, F, C, 5);
        lf_cross_attention_init(store, &l.cross, "cross", &types, F, C, 5, 2);
        lf_so2_map_init(store, &l.map, "map", &types, C, 3, true);
        lf_mlp_init(store, &l.mlp, "mlp", P * C, 1, LF_DIMS(4), 3);
        l.mlp.act = LF_ELU;
        keep(store, &l, sizeof l);
    }
    return l;
}

/* Convolution, keys and values, attention; f [N, S, V, F], point [N, S, P C]. */
static int blocks_of_views(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    const lf_light_geometry g = geometry(tape);
    const lf_blocks k = lf_blocks_make(tape, &g);
    const block_layers l = make_block_layers(store);
    lf_tensor *f = lf_blocks_of_views(tape, &k, in[0]), *q = lf_blocks_of_points(tape, &k, in[1]);
    lf_tensor *mean = lf_blocks_convolution(tape, &k, &l.convolution, f, true);
    lf_tensor *view = lf_blocks_convolution(tape, &k, &l.convolution, f, false);
    lf_tensor *key = lf_blocks_update(tape, &k, &l.cross.update[0], view, q);
    const lf_attended y = lf_blocks_attention(tape, &k, q, key, view, 2);
    out[0] = lf_blocks_rows(tape, &k, mean);
    out[1] = lf_blocks_rows(tape, &k, y.field);
    out[2] = y.weight;
    return 3;
}

static int blocks_cross(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    const lf_light_geometry g = geometry(tape);
    const lf_blocks k = lf_blocks_make(tape, &g);
    const block_layers l = make_block_layers(store);
    const lf_attended y = lf_blocks_cross(tape, &k, &l.cross, lf_blocks_of_views(tape, &k, in[0]),
                                          lf_blocks_of_points(tape, &k, in[1]));
    out[0] = lf_blocks_rows(tape, &k, y.field);
    out[1] = y.weight;
    return 2;
}

/* x [N, S, P C], gain [Q C], gates w [Q C, Q C], b [Q C]. */
static int blocks_of_points(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    const lf_light_geometry g = geometry(tape);
    const lf_blocks k = lf_blocks_make(tape, &g);
    const block_layers l = make_block_layers(store);
    lf_tensor *x = lf_blocks_of_points(tape, &k, in[0]);
    x = lf_blocks_norm(tape, &types, x, in[1]);
    lf_tensor *y = lf_blocks_gated(tape, &types, x, in[2], in[3]);
    y = lf_blocks_map(tape, &types, &l.map, y);
    out[0] = lf_blocks_rows(tape, &k, lf_blocks_invariants(tape, &types, y));
    out[1] = lf_blocks_rows(tape, &k, lf_blocks_mlp(tape, &l.mlp, x));
    out[2] = lf_blocks_rows(
        tape, &k,
        lf_blocks_linear(tape, x, lf_param(tape, l.mlp.layer[0].weight), NULL, LF_SIGMOID));
    return 3;
}

static int blocks_along(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    const lf_light_geometry g = geometry(tape);
    const lf_blocks k = lf_blocks_make(tape, &g);
    lf_along_ray_layer l;
    if (first_build(store, &l, sizeof l)) {
        lf_along_ray_init(store, &l, "along", &types, C, 3, 2);
        keep(store, &l, sizeof l);
    }
    lf_tensor *x = lf_blocks_of_points(tape, &k, in[0]);
    out[0] = lf_blocks_rows(tape, &k, lf_blocks_along(tape, &k, &l, x));
    return 1;
}

static int blocks_along_attention(lf_tape *tape, lf_store *store, lf_tensor *const *in,
                                  lf_tensor **out)
{
    (void)store;
    const lf_light_geometry g = geometry(tape);
    const lf_blocks k = lf_blocks_make(tape, &g);
    lf_tensor *x[3];
    for (int i = 0; i < 3; i++)
        x[i] = lf_blocks_of_points(tape, &k, in[i]);
    out[0] = lf_blocks_rows(tape, &k,
                            lf_blocks_along_attention(tape, &k, x[0], x[1], x[2], in[3], in[4], 2));
    return 1;
}

/* Two target and four source rays; the fields at three points of each. */
static int fourier(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    lf_ray ray[6];
    lf_stream r = lf_stream_at(6, LF_RANDOM_TEST, 12, 0);
    for (int i = 0; i < 6; i++) {
        const double angle = lf_normal(&r), tilt = lf_normal(&r);
        const double p[3] = {lf_normal(&r), lf_normal(&r), lf_normal(&r)};
        const double d[3] = {cos(tilt) * cos(angle), cos(tilt) * sin(angle), sin(tilt)};
        ray[i] = lf_ray_through(p, d);
    }
    double foot[2 * 4];
    const double t[] = {-1, 0, 1, -2, 0.5, 2};
    const lf_spectrum s = {3, 0.7, 0.3};
    const lf_light_geometry g = lf_ray_pair_geometry(tape, &single, 2, ray, 4, ray + 2, foot);
    out[0] = lf_along_ray_spectrum(tape, in[0], &g, foot, &s);
    out[1] = lf_along_ray_inverse(tape, in[1], &single, 2, 3, t, &s);
    out[2] = lf_along_ray_regular(tape, in[0], &g, foot, 3, t, 1.5);
    return 3;
}

/* The third sample is seen by none. */
static int density(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    lf_tensor *count = lf_tensor_new(tape, 2, LF_DIMS(2, 3));
    for (int i = 0; i < 6; i++)
        count->value[i] = (lf_real)(i != 2);
    out[0] = lf_density(tape, in[0], count);
    return 1;
}

static int volume(lf_tape *tape, lf_tensor *const *in, lf_tensor **out, bool white)
{
    const lf_rendered r = lf_volume(tape, in[0], in[1], in[2], white);
    out[0] = r.colour;
    out[1] = r.weight;
    out[2] = r.depth;
    return 3;
}

static int volume_black(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    return volume(tape, in, out, false);
}

static int volume_white(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    return volume(tape, in, out, true);
}

/* An opaque sample in the middle of the first ray. */
static int volume_opaque(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    in[0]->value[3] = 1000;
    return volume(tape, in, out, false);
}

#define X(...)                                                                                     \
    {                                                                                              \
        .rank = sizeof((long[]){__VA_ARGS__}) / sizeof(long), .dim = { __VA_ARGS__ }               \
    }
#define FILLED(kind, ...)                                                                          \
    {                                                                                              \
        .rank = sizeof((long[]){__VA_ARGS__}) / sizeof(long), .dim = {__VA_ARGS__}, .fill = (kind) \
    }

#define DENSITY FILLED(FILL_POSITIVE, 2, 6)
#define DEPTHS                                                                                     \
    {                                                                                              \
        .rank = 2, .dim = {2, 6}, .fill = FILL_POSITIVE, .constant = true                          \
    }

#define ROWS X(N, S, P *C)
#define PROFILE X(LF_ALONG_BASIS, P *C)

const op_case light_field_cases[] = {
    {"so2_linear", linear, {X(21, P *C), X(M, C, 3), X(Z * 3)}, 3, 0},
    {"so2_concat", concat, {X(6, P *C), X(6, P * 3)}, 2, 0},
    {"so2_invariants", invariants, {X(6, P *C)}, 1, 0},
    {"so2_invariants: zeros", invariants, {FILLED(FILL_ZERO, 2, P *C)}, 1, 0},
    {"so2_gate", gate, {X(6, P *C), X(6, Q *C)}, 2, 0},
    {"so2_norm_relu", norm_relu, {X(6, P *C), X(Q *C)}, 2, 0},
    {"so2_layer_norm", layer_norm, {X(6, P *C), X(Q *C)}, 2, 0},
    {"so2_layer_norm: zeros", layer_norm, {FILLED(FILL_ZERO, 2, P *C), X(Q *C)}, 2, 0},
    {"so2 map, gated", map_and_gate, {X(6, P *C)}, 1, 0},
    {"ray_ray: values, mean", ray_ray, {X(N, S, V, P *C), X(N, S, V, Q *C)}, 2, 0},
    {"ray_ray_convolution", convolution, {X(N, S, V, F)}, 1, 0},
    {"cross_attention", cross_attention, {X(N, S, P *C), X(N, S, V, P *C), X(N, S, V, P *C)}, 3, 0},
    {"blend_views", blend, {X(N, S, V), X(N, S, V, 3)}, 2, 0},
    {"cross attention layer", cross_attention_layer, {X(N, S, V, F), X(N, S, P *C)}, 2, 0},
    {"along_ray_attention", along_ray, {ROWS, ROWS, ROWS, PROFILE, PROFILE}, 5, 0},
    {"along_ray_attention: long ray",
     along_long_ray,
     {X(19, P *C), X(19, P *C), X(19, P *C), PROFILE, PROFILE},
     5,
     0},
    {"along ray layer", along_ray_layer, {ROWS}, 1, 0},
    {"blocks: views", blocks_of_views, {X(N, S, V, F), ROWS}, 2, 0},
    {"blocks: cross attention layer", blocks_cross, {X(N, S, V, F), ROWS}, 2, 0},
    {"blocks: points", blocks_of_points, {ROWS, X(Q *C), X(Q *C, Q *C), X(Q *C)}, 4, 0},
    {"blocks: along ray layer", blocks_along, {ROWS}, 1, 0},
    {"blocks: along ray attention",
     blocks_along_attention,
     {ROWS, ROWS, ROWS, PROFILE, PROFILE},
     5,
     0},
    {"along_ray: spectrum, inverse, regular",
     fourier,
     {X(2, 1, 4, (2 * T - 1) * C), X(2, 7, 2 * T * C)},
     2,
     0},
    {"density", density, {X(2, 3, 1)}, 1, 0},
    {"volume", volume_black, {DENSITY, X(2, 6, 3), DEPTHS}, 3, 0},
    {"volume: white", volume_white, {DENSITY, X(2, 6, 3), DEPTHS}, 3, 0},
    {"volume: opaque", volume_opaque, {DENSITY, X(2, 6, 3), DEPTHS}, 3, 0},
};
const int light_field_case_count = sizeof light_field_cases / sizeof *light_field_cases;
