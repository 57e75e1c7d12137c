/* op_table_layers.c: a row for every op and layer of layers/layers.h; test_ops walks them. */
#include "layers/layers.h"
#include "tests/gradcheck.h"

enum { Q = 3, V = 4 };

static lf_ray_geometry geometry(const lf_tensor *direction, const lf_tensor *mask)
{
    return (lf_ray_geometry){direction->dim[0], direction->dim[1], direction, mask};
}

/* A layer's parameters are registered at the first build and found again later: the store's count
 * decides, and a layer is rebuilt from a store by registering into a throw-away one. */
#define INIT_ONCE(type, store, ...)                                                                \
    type layer;                                                                                    \
    do {                                                                                           \
        if (lf_store_count(store) == 0) {                                                          \
            __VA_ARGS__;                                                                           \
            remember(tape, store, &layer, sizeof layer);                                           \
        } else {                                                                                   \
            recall(store, &layer, sizeof layer);                                                   \
        }                                                                                          \
    } while (0)

/* The struct is kept as bytes in an untrainable parameter: it holds only pointers into the store.
 */
static void remember(lf_tape *tape, lf_store *store, const void *layer, size_t size)
{
    (void)tape;
    const long n = (long)(size / sizeof(lf_real) + 1);
    const lf_parameter *p = lf_store_add(store, "test.layer", 1, &n, 0, 0, false);
    memcpy(lf_values(p), layer, size);
}

static void recall(const lf_store *store, void *layer, size_t size)
{
    memcpy(layer, lf_values(lf_store_find(store, "test.layer")), size);
}

static int vector_norm(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_vector_norm(tape, in[0]);
    return 1;
}

static int gate(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_gate(tape, in[0], in[1]);
    return 1;
}

static int norm_relu(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_norm_relu(tape, in[0], in[1]);
    return 1;
}

static int vector_relu(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_vector_relu(tape, in[0], in[1]);
    return 1;
}

static int inner(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_inner(tape, in[0], in[1]);
    return 1;
}

static int ray_moments(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    const lf_ray_geometry g = geometry(in[1], in[2]);
    const lf_field m = lf_ray_moments(tape, in[0], &g);
    out[0] = m.scalar;
    out[1] = m.vector;
    return 2;
}

static int tfn(lf_tape *tape, lf_tensor *s, lf_tensor *v, lf_tensor *const *rays, bool degree2,
               lf_tensor **out)
{
    const lf_ray_geometry g = geometry(rays[0], rays[1]);
    const lf_field y = lf_tfn_paths(tape, (lf_field){s, v}, &g, degree2);
    out[0] = y.scalar;
    out[1] = y.vector;
    return 2;
}

static int tfn_paths(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    return tfn(tape, in[0], in[1], in + 2, false, out);
}

static int tfn_paths2(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    return tfn(tape, in[0], in[1], in + 2, true, out);
}

static int tfn_scalars(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    return tfn(tape, in[0], NULL, in + 1, false, out);
}

static int attend(lf_tape *tape, lf_tensor *const *in, lf_tensor **out)
{
    const lf_ray_geometry g = geometry(in[4], in[5]);
    const lf_field o =
        lf_ray_attention(tape, (lf_field){in[0], in[1]}, (lf_field){in[2], in[3]}, &g, 2);
    out[0] = o.scalar;
    out[1] = o.vector;
    return 2;
}

static int ray_attention(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    return attend(tape, in, out);
}

static int ray_attention_unseen(lf_tape *tape, lf_store *store, lf_tensor *const *in,
                                lf_tensor **out)
{
    (void)store;
    for (long v = 0; v < V; v++) {
        in[5]->value[v] = 0;          /* the first point is seen by none */
        in[5]->value[V + v] = v == 1; /* the second by one */
    }
    return attend(tape, in, out);
}

static int ray_attention_scalars(lf_tape *tape, lf_store *store, lf_tensor *const *in,
                                 lf_tensor **out)
{
    (void)store;
    const lf_ray_geometry g = geometry(in[2], in[3]);
    out[0] = lf_ray_attention(tape, (lf_field){in[0], NULL}, (lf_field){in[1], NULL}, &g, 2).scalar;
    return 1;
}

static int convolution(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    INIT_ONCE(lf_ray_convolution, store, lf_ray_convolution_init(store, &layer, "conv", 5, 4, 3));
    const lf_ray_geometry g = geometry(in[1], in[2]);
    const lf_field f = lf_ray_convolution_apply(tape, &layer, in[0], &g);
    out[0] = f.scalar;
    out[1] = f.vector;
    return 2;
}

static int nonlinear(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out,
                     lf_nonlinearity kind)
{
    INIT_ONCE(lf_nonlinear, store, lf_nonlinear_init(store, &layer, "act", kind, 4, 3));
    const lf_field f = lf_nonlinear_apply(tape, &layer, (lf_field){in[0], in[1]});
    out[0] = f.scalar;
    out[1] = f.vector;
    return 2;
}

static int nonlinear_norm(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    return nonlinear(tape, store, in, out, LF_NORM_RELU);
}

static int nonlinear_gated(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    return nonlinear(tape, store, in, out, LF_GATED);
}

static int block(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out,
                 const lf_transformer_config *config, bool ray_vectors)
{
    INIT_ONCE(lf_transformer_block, store,
              lf_transformer_block_init(store, &layer, "block", config, 5, ray_vectors ? 3 : 0));
    const lf_ray_geometry g = geometry(in[4], in[5]);
    lf_field rays = {in[0], ray_vectors ? in[1] : NULL}, point = {in[2], in[3]};
    lf_transformer_block_apply(tape, &layer, &rays, &point, &g);
    out[0] = point.scalar;
    out[1] = point.vector;
    out[2] = rays.vector;
    return 3;
}

static int block_norm(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    const lf_transformer_config c = {4, 2, 2, false, false, LF_NORM_RELU};
    return block(tape, store, in, out, &c, true);
}

static int block_gated(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    const lf_transformer_config c = {4, 2, 2, true, true, LF_GATED};
    return block(tape, store, in, out, &c, false);
}

static int linear_layer(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    INIT_ONCE(lf_linear_layer, store, lf_linear_init(store, &layer, "linear", 5, 4, true, 1));
    out[0] = lf_linear_apply(tape, &layer, in[0], LF_RELU);
    return 1;
}

static int self_interaction(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    INIT_ONCE(lf_self_interaction, store,
              lf_self_interaction_init(store, &layer, "mix", 4, 3, 5, 2));
    const lf_field f = lf_self_interaction_apply(tape, &layer, (lf_field){in[0], in[1]});
    out[0] = f.scalar;
    out[1] = f.vector;
    return 2;
}

static int vector_neuron(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    INIT_ONCE(lf_vector_neuron, store, lf_vector_neuron_init(store, &layer, "readout", 4));
    out[0] = lf_vector_neuron_apply(tape, &layer, in[0]);
    return 1;
}

static int mlp(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    INIT_ONCE(lf_mlp, store, lf_mlp_init(store, &layer, "mlp", 5, 2, LF_DIMS(7, 6), 1));
    out[0] = lf_mlp_apply(tape, &layer, in[0]);
    return 1;
}

#define X(...)                                                                                     \
    {                                                                                              \
        .rank = sizeof((long[]){__VA_ARGS__}) / sizeof(long), .dim = { __VA_ARGS__ }               \
    }
#define FILLED(kind, ...)                                                                          \
    {                                                                                              \
        .rank = sizeof((long[]){__VA_ARGS__}) / sizeof(long), .dim = {__VA_ARGS__}, .fill = (kind) \
    }
#define DIRECTIONS                                                                                 \
    {                                                                                              \
        .rank = 3, .dim = {Q, V, 3}, .fill = FILL_UNIT3, .constant = true                          \
    }
#define MASK FILLED(FILL_MASK, Q, V)

const op_case layer_cases[] = {
    {"vector_norm", vector_norm, {X(2, 3, 4)}, 1, 0},
    {"vector_norm: zero vectors", vector_norm, {FILLED(FILL_ZERO, 2, 3, 4)}, 1, 0},
    {"gate", gate, {X(2, 3, 4), X(2, 4)}, 2, 0},
    {"norm_relu", norm_relu, {X(5, 3, 4), X(4)}, 2, 0},
    {"vector_relu", vector_relu, {X(5, 3, 4), X(5, 3, 4)}, 2, 0},
    {"inner", inner, {X(5, 3, 4), X(5, 3, 4)}, 2, 0},
    {"ray_moments", ray_moments, {X(Q, V, 5), DIRECTIONS, MASK}, 3, 0},
    {"tfn_paths", tfn_paths, {X(Q, V, 4), X(Q, V, 3, 2), DIRECTIONS, MASK}, 4, 0},
    {"tfn_paths: J = 2", tfn_paths2, {X(Q, V, 4), X(Q, V, 3, 2), DIRECTIONS, MASK}, 4, 0},
    {"tfn_paths: scalars only", tfn_scalars, {X(Q, V, 4), DIRECTIONS, MASK}, 3, 0},
    {"ray_attention",
     ray_attention,
     {X(Q, 4), X(Q, 3, 2), X(Q, V, 8), X(Q, V, 3, 4), DIRECTIONS, MASK},
     6,
     0},
    {"ray_attention: no view, one view",
     ray_attention_unseen,
     {X(Q, 4), X(Q, 3, 2), X(Q, V, 8), X(Q, V, 3, 4), DIRECTIONS, MASK},
     6,
     0},
    {"ray_attention: three channels a head, which fit no lanes",
     ray_attention,
     {X(Q, 6), X(Q, 3, 6), X(Q, V, 12), X(Q, V, 3, 12), DIRECTIONS, MASK},
     6,
     0},
    {"ray_attention: scalars only",
     ray_attention_scalars,
     {X(Q, 4), X(Q, V, 8), DIRECTIONS, MASK},
     4,
     0},
    {"ray_convolution", convolution, {X(Q, V, 5), DIRECTIONS, MASK}, 3, 0},
    {"nonlinear: norm", nonlinear_norm, {X(Q, V, 4), X(Q, V, 3, 3)}, 2, 0},
    {"nonlinear: gated", nonlinear_gated, {X(Q, V, 4), X(Q, V, 3, 3)}, 2, 0},
    {"transformer block: norm",
     block_norm,
     {X(Q, V, 5), X(Q, V, 3, 3), X(Q, 4), X(Q, 3, 2), DIRECTIONS, MASK},
     6,
     0},
    {"transformer block: gated, J = 2, first",
     block_gated,
     {X(Q, V, 5), X(Q, V, 3, 3), X(Q, 4), X(Q, 3, 2), DIRECTIONS, MASK},
     6,
     0},
    {"linear layer", linear_layer, {X(4, 5)}, 1, 0},
    {"self_interaction", self_interaction, {X(Q, V, 4), X(Q, V, 3, 3)}, 2, 0},
    {"vector_neuron", vector_neuron, {X(Q, 3, 4)}, 1, 0},
    {"mlp", mlp, {X(4, 5)}, 1, 0},
};
const int layer_case_count = sizeof layer_cases / sizeof *layer_cases;
