/* op_table_ibrnet.c: a row for every op of layers/ibrnet.h, and the whole network. */
#include "autograd/random.h"
#include "layers/ibrnet.h"
#include "models/ibrnet.h"
#include "tests/gradcheck.h"

/* 18 points: the last block has lanes without a point in both precisions. */
enum { N = 2, S = 9, V = 3, F = 5, POINTS = N * S };
enum { BLOCKS = (POINTS + LF_LANES - 1) / LF_LANES };

/* What the views see: the third nothing of the first LF_LANES points, so that their block has two
 * rows; one point is seen by none, one by one view. */
static lf_tensor *mask_of(lf_tape *tape)
{
    lf_tensor *mask = lf_tensor_new(tape, 3, LF_DIMS(N, S, V));
    for (long i = 0; i < mask->size; i++)
        mask->value[i] = (lf_real)(i % 5 != 1 && (i % V != 2 || i / V >= LF_LANES));
    for (int v = 0; v < V; v++) {
        mask->value[2 * V + v] = 0;
        mask->value[17 * V + v] = v == 1;
    }
    return mask;
}

static lf_lanes lanes_of(lf_tape *tape)
{
    lf_tensor *difference = lf_tensor_new(tape, 4, LF_DIMS(N, S, V, 4));
    lf_stream r = lf_stream_at(5, LF_RANDOM_TEST, 31, 0);
    for (long i = 0; i < difference->size; i++)
        difference->value[i] = (lf_real)(2 * lf_uniform(&r) - 1);
    return lf_lanes_make(tape, mask_of(tape), difference);
}

/* Numbers [N, S, V, C] in the lanes of the rows there are: [R, C, L]. */
static lf_tensor *rows(lf_tape *tape, lf_tensor *x, const lf_lanes *lanes)
{
    return lf_lanes_add_rows(tape, x, NULL, lanes);
}

static int add_rows(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    const lf_lanes lanes = lanes_of(tape);
    lf_tensor *y = rows(tape, in[1], &lanes);
    out[0] =
        lf_lanes_add_rows(tape, in[0], lf_lanes_scale(tape, y, rows(tape, in[2], &lanes)), &lanes);
    return 1;
}

static int to_rows(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    const lf_lanes lanes = lanes_of(tape);
    out[0] = lf_lanes_to_rows(tape, in[0], &lanes);
    return 1;
}

/* Two parts, a point's share and ELU; and a plain map of points with a bias. */
static int linear(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    const lf_lanes lanes = lanes_of(tape);
    lf_tensor *parts[] = {rows(tape, in[0], &lanes), rows(tape, in[1], &lanes)};
    lf_tensor *y = lf_lanes_linear(tape, 2, parts, in[2], NULL, in[4], &lanes, LF_ELU);
    lf_tensor *turned = lf_reshape(tape, in[2], 2, LF_DIMS(in[2]->dim[1], in[2]->dim[0]));
    out[0] = lf_lanes_linear(tape, 1, &in[4], turned, in[3], NULL, &lanes, LF_IDENTITY);
    out[1] = y;
    return 2;
}

static int weights(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    const lf_lanes lanes = lanes_of(tape);
    out[0] = lf_ibrnet_weights(tape, in[0], &lanes);
    return 1;
}

static int moments(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    const lf_lanes lanes = lanes_of(tape);
    lf_tensor *x = rows(tape, in[0], &lanes), *w = rows(tape, in[1], &lanes);
    out[0] = lf_ibrnet_moments(tape, x, w, &lanes, true);
    out[1] = lf_ibrnet_moments(tape, x, w, &lanes, false);
    out[2] = lf_ibrnet_moments(tape, x, lf_ibrnet_even_weights(tape, &lanes), &lanes, true);
    return 3;
}

static int residual(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    const lf_lanes lanes = lanes_of(tape);
    const lf_ibrnet_residual y = lf_ibrnet_residual_apply(tape, rows(tape, in[0], &lanes),
                                                          rows(tape, in[1], &lanes), &lanes);
    out[0] = y.x;
    out[1] = y.visible;
    return 2;
}

static int visibility(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    const lf_lanes lanes = lanes_of(tape);
    const lf_ibrnet_visibility y =
        lf_ibrnet_visibility_apply(tape, rows(tape, in[0], &lanes), &lanes);
    out[0] = y.visibility;
    out[1] = y.weight;
    return 2;
}

static int colours(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    const lf_lanes lanes = lanes_of(tape);
    out[0] = lf_ibrnet_colour(tape, rows(tape, in[0], &lanes), in[1], &lanes);
    return 1;
}

/* The second sample of each ray has one view. */
static int attention(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    lf_tensor *count = lf_tensor_new(tape, 2, LF_DIMS(N, S));
    for (long i = 0; i < count->size; i++)
        count->value[i] = i % S == 1 ? 1 : 3;
    out[0] = lf_sample_attention(tape, in[0], in[1], in[2], count, 2);
    return 1;
}

static int norm(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_layer_norm(tape, in[0], in[1], in[2]);
    return 1;
}

/* The network's struct holds pointers into the store: it is kept there, as bytes. */
static void find_network(lf_store *store, lf_ibrnet *net)
{
    const long n = (long)(sizeof *net / sizeof(lf_real) + 1);
    if (lf_store_count(store) > 0) {
        memcpy(net, lf_values(lf_store_find(store, "test.network")), sizeof *net);
        return;
    }
    const lf_ibrnet_config config = {F, 8, true};
    lf_ibrnet_init(store, net, "ibrnet", &config);
    memcpy(lf_values(lf_store_add(store, "test.network", 1, &n, 0, 0, false)), net, sizeof *net);
}

static int network(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    lf_ibrnet net;
    find_network(store, &net);
    lf_tensor *mask = mask_of(tape), *count = lf_tensor_new(tape, 2, LF_DIMS(N, S));
    for (long i = 0; i < count->size; i++) {
        count->value[i] = 0;
        for (int v = 0; v < V; v++)
            count->value[i] += mask->value[i * V + v];
    }
    const lf_light_geometry geometry = {
        .rays = N, .samples = S, .views = V, .mask = mask, .count = count};
    const lf_ray_inputs inputs = {in[0], &geometry, in[1]};
    const lf_radiance y = lf_ibrnet_apply(tape, &net, &inputs);
    out[0] = y.colour;
    out[1] = y.sigma;
    return 2;
}

#define X(...)                                                                                     \
    {                                                                                              \
        .rank = sizeof((long[]){__VA_ARGS__}) / sizeof(long), .dim = { __VA_ARGS__ }               \
    }
#define POSITIVE(...)                                                                              \
    {                                                                                              \
        .rank = sizeof((long[]){__VA_ARGS__}) / sizeof(long), .dim = {__VA_ARGS__},                \
        .fill = FILL_POSITIVE                                                                      \
    }
#define FIXED(...)                                                                                 \
    {                                                                                              \
        .rank = sizeof((long[]){__VA_ARGS__}) / sizeof(long), .dim = {__VA_ARGS__},                \
        .constant = true                                                                           \
    }
#define SEEN(c) X(N, S, V, c)
#define SAMPLES X(N, S, 6)

const op_case ibrnet_cases[] = {
    {"lanes: add_rows, scale", add_rows, {SEEN(F), SEEN(F), SEEN(1)}, 3, 0},
    {"lanes: to_rows", to_rows, {X(BLOCKS, 4, LF_LANES)}, 1, 0},
    {"lanes_linear", linear, {SEEN(7), SEEN(4), X(11, 15), X(11), X(BLOCKS, 15, LF_LANES)}, 5, 0},
    {"ibrnet_weights", weights, {X(1)}, 1, 0},
    {"ibrnet_moments", moments, {SEEN(F), POSITIVE(N, S, V, 1)}, 2, 0},
    {"ibrnet_residual", residual, {SEEN(F), SEEN(F + 1)}, 2, 0},
    {"ibrnet_visibility", visibility, {SEEN(1)}, 1, 0},
    {"ibrnet_colour", colours, {SEEN(1), SEEN(F)}, 2, 0},
    {"sample_attention", attention, {SAMPLES, SAMPLES, SAMPLES}, 3, 0},
    {"layer_norm", norm, {X(7, 6), X(6), X(6)}, 3, 0},
    /* differences cross the kinks of a thousand ELUs: their error falls with the step */
    {"ibrnet", network, {SEEN(F), FIXED(N, S, V, 4)}, 2, 1e-5},
};
const int ibrnet_case_count = sizeof ibrnet_cases / sizeof *ibrnet_cases;
