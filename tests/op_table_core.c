/* op_table_core.c: a row for every op of autograd/ops.h; test_ops walks them. */
#include "autograd/ops.h"
#include "tests/gradcheck.h"

static int linear(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_linear(tape, in[0], in[1], in[2], LF_IDENTITY);
    return 1;
}

static int linear_relu(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_linear(tape, in[0], in[1], NULL, LF_RELU);
    return 1;
}

static int add(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_add(tape, in[0], in[1]);
    return 1;
}

static int multiply(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_multiply(tape, in[0], in[1]);
    return 1;
}

static int scale(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_scale(tape, in[0], (lf_real)-2.5);
    return 1;
}

static int relu(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_relu(tape, in[0]);
    return 1;
}

static int sigmoid(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_sigmoid(tape, in[0]);
    return 1;
}

static int add_group(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_add_group(tape, in[0], in[1]);
    return 1;
}

static int linear_elu(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_linear(tape, in[0], in[1], in[2], LF_ELU);
    out[1] = lf_linear(tape, in[0], in[1], in[2], LF_SIGMOID);
    return 2;
}

static int elu(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_elu(tape, in[0]);
    return 1;
}

static int concat(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_multiply(tape, lf_concat(tape, 2, in), in[2]);
    return 1;
}

static int reshape_and_rows(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    lf_tensor *x = lf_reshape(tape, lf_relu(tape, in[0]), 2, LF_DIMS(6, 2));
    out[0] = lf_multiply(tape, lf_rows_view(tape, x, 1, 4), in[1]);
    return 1;
}

static int sum(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_sum(tape, in[0]);
    return 1;
}

static int softmax(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_softmax(tape, in[0], in[1]);
    return 1;
}

static int softmax_empty(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    for (long i = 0; i < 4; i++)
        in[1]->value[i] = 0; /* the first row has no entry */
    out[0] = lf_softmax(tape, in[0], in[1]);
    return 1;
}

static int sample_maps(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    enum { POINTS = 5, VIEWS = 2 };
    static const long first[POINTS] = {0, 0, 2, 2, 0};
    static const double uv[POINTS * VIEWS * 2] = {0, 0,   8,   8,   3.3, 1.7, 7.9, 0.1, 4, 4,
                                                  2, 5.5, 6.1, 6.1, 1.2, 8,   8,   0,   5, 0.5};
    out[0] = lf_sample_maps(tape, 2, in, 9, 9, POINTS, VIEWS, uv, in[2]->value, first);
    return 1;
}

/* Two views of different sizes; a point on the border, one beyond the map's outermost centres. */
static int sample_views(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    enum { POINTS = 3, VIEWS = 2 };
    static const double uv[POINTS * VIEWS * 2] = {0, 0, 6, 4, 3.3, 1.7, 2.9, 0.1, 4, 4, 2, 3.5};
    static uint8_t rgb[5 * 7 * 3];
    for (int i = 0; i < 5 * 7 * 3; i++)
        rgb[i] = (uint8_t)(i * 37);
    lf_view_map *view = lf_alloc(tape, VIEWS * sizeof *view);
    view[0] = (lf_view_map){rgb, 5, 5, 2, 3, 3, 4, 0};
    view[1] = (lf_view_map){rgb, 5, 7, 2, 3, 4, 4, 36};
    out[0] = lf_sample_views(tape, in[0], VIEWS, view, 1, 2, POINTS, uv, in[1]->value);
    return 1;
}

static int gather_rows(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    static const long row[5] = {2, 0, 2, 2, 0};
    out[0] = lf_gather_rows(tape, in[0], 5, row);
    return 1;
}

static int pool_views(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    for (long v = 0; v < 4; v++)
        in[1]->value[v] = 0; /* no view sees the first point */
    out[0] = lf_pool_views(tape, in[0], in[1], LF_POOL_MEAN);
    out[1] = lf_pool_views(tape, in[0], in[1], LF_POOL_MAX);
    return 2;
}

static int pool_all(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_pool_views(tape, in[0], NULL, LF_POOL_MEAN);
    out[1] = lf_pool_views(tape, in[0], NULL, LF_POOL_MAX);
    return 2;
}

static int squared_error(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    static const float target[6] = {0.1f, -0.4f, 2, 0, 0.3f, 1}, weight[2] = {0.5f, 0};
    out[0] = lf_squared_error(tape, in[0], target, NULL);
    out[1] = lf_squared_error(tape, in[0], target, weight);
    return 2;
}

static int sdf_loss(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    static const float sdf[6] = {-0.3f, -0.02f, 0.005f, 0.013f, 0.06f, 0.5f};
    const lf_sdf_loss_config config = {10, 0.1, 0.01, 4};
    out[0] = lf_sdf_loss(tape, in[0], sdf, &config);
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

const op_case core_cases[] = {
    {"linear", linear, {X(3, 5, 7), X(7, 4), X(4)}, 3, 0},
    {"linear: wide rows", linear, {X(20, 34), X(34, 33), X(33)}, 3, 0},
    {"linear: one output", linear, {X(9, 16), X(16, 1), X(1)}, 3, 0},
    {"linear: ReLU, no bias", linear_relu, {X(6, 5), X(5, 8)}, 2, 0},
    {"linear: ELU, sigmoid", linear_elu, {X(6, 5), X(5, 7), X(7)}, 3, 0},
    {"elu", elu, {X(5, 7)}, 1, 0},
    {"add", add, {X(3, 4), X(3, 4)}, 2, 0},
    {"multiply", multiply, {X(3, 4), X(3, 4)}, 2, 0},
    {"scale", scale, {X(5)}, 1, 0},
    {"relu", relu, {X(4, 6)}, 1, 0},
    {"sigmoid", sigmoid, {X(4, 6)}, 1, 0},
    {"add_group", add_group, {X(3, 4, 5), X(3, 5)}, 2, 0},
    {"add_group: vectors", add_group, {X(2, 3, 3, 4), X(2, 3, 4)}, 2, 0},
    {"concat", concat, {X(3, 4), X(3, 2), X(3, 6)}, 3, 0},
    {"reshape, rows_view", reshape_and_rows, {FILLED(FILL_POSITIVE, 3, 4), X(4, 2)}, 2, 0},
    {"sum", sum, {X(3, 4)}, 1, 0},
    {"softmax: masked", softmax, {X(3, 8), FILLED(FILL_MASK, 3, 8)}, 2, 0},
    {"softmax: a row with none", softmax_empty, {X(3, 4), FILLED(FILL_MASK, 3, 4)}, 2, 0},
    {"sample_maps", sample_maps, {X(4, 9, 9, 3), X(4, 5, 5, 2), FILLED(FILL_MASK, 5, 2)}, 3, 0},
    {"sample_views", sample_views, {X(84), FILLED(FILL_MASK, 3, 2)}, 2, 0},
    {"gather_rows", gather_rows, {X(3, 4)}, 1, 0},
    {"pool_views: masked", pool_views, {X(5, 4, 3), FILLED(FILL_MASK, 5, 4)}, 2, 0},
    {"pool_views: all", pool_all, {X(3, 6, 2)}, 1, 0},
    {"squared_error", squared_error, {X(2, 3)}, 1, 0},
    {"sdf_loss", sdf_loss, {X(6, 1)}, 1, 0},
};
const int core_case_count = sizeof core_cases / sizeof *core_cases;
