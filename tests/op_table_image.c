/* op_table_image.c: gradient checks of the ops on feature maps and of steerable filters. */
#include "layers/c8.h"
#include "tests/gradcheck.h"

static int conv_relu(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_conv2d(tape, in[0], in[1], in[2], 1, 1, LF_RELU);
    return 1;
}

static int conv_strided(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_conv2d(tape, in[0], in[1], NULL, 2, in[1]->dim[0] / 2, LF_IDENTITY);
    return 1;
}

static int conv_biased(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_conv2d(tape, in[0], in[1], in[2], 1, 0, LF_IDENTITY);
    return 1;
}

static int norm(lf_tape *tape, lf_tensor *const *in, lf_tensor **out, lf_norm_mode mode, bool relu)
{
    const long fields = in[1]->size;
    lf_real *mean = lf_alloc_reals(tape, fields), *variance = lf_alloc_reals(tape, fields);
    for (long f = 0; f < fields; f++) {
        mean[f] = (lf_real)(0.3 * (double)f);
        variance[f] = (lf_real)(0.5 + (double)f);
    }
    const bool fixed = mode == LF_NORM_RUNNING;
    const lf_field_norm_options options = {.mode = mode,
                                           .group = (int)(in[0]->dim[3] / fields),
                                           .epsilon = 1e-5,
                                           .momentum = 0.1,
                                           .relu = relu,
                                           .running_mean = fixed ? mean : NULL,
                                           .running_var = fixed ? variance : NULL};
    out[0] = lf_field_norm(tape, in[0], in[1], in[2], in[3], &options);
    if (relu)
        return 1; /* few numbers, so that no difference steps over a kink */
    out[1] = lf_field_norm(tape, out[0], in[1], in[2], NULL, &options); /* weights that vary */
    return 2;
}

static int norm_batch(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    return norm(tape, in, out, LF_NORM_BATCH, false);
}

static int norm_batch_relu(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    return norm(tape, in, out, LF_NORM_BATCH, true);
}

static int norm_running(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    return norm(tape, in, out, LF_NORM_RUNNING, false);
}

static int norm_instance(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    return norm(tape, in, out, LF_NORM_INSTANCE, false);
}

static int max_pool(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_max_pool(tape, in[0], 3, 2, 1);
    return 1;
}

static int blur(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_blur(tape, in[0]);
    return 1;
}

static int reflect_pad(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_reflect_pad(tape, in[0], 1);
    out[1] = lf_reflect_pad(tape, in[0], 2);
    return 2;
}

static int resize_aligned(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_resize(tape, in[0], 7, 8, true);
    out[1] = lf_resize(tape, in[0], 1, 2, true);
    return 2;
}

static int resize(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_resize(tape, in[0], 7, 8, false);
    out[1] = lf_resize(tape, in[0], 1, 2, false);
    return 2;
}

static int volume_slices(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_volume_slices(tape, in[0], 1);
    out[1] = lf_volume_slices(tape, in[0], 2);
    return 2;
}

/* Inside, on the far corner, outside. */
static int sample_volume(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    static const double position[5 * 3] = {0.1,  -0.3, 0.22, 0.5, 0.5, 0.5, -0.7, 0.1,
                                           0.95, 0,    0,    0,   0.4, 0.4, -0.5};
    static const long volume[5] = {1, 0, 1, 1, 0};
    out[0] = lf_sample_volume(tape, in[0], 5, position, volume);
    return 1;
}

static int group_sum(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    out[0] = lf_group_sum(tape, in[0], LF_C8);
    return 1;
}

/* The basis must outlive the backward walk: put it on the tape. */
static int c8_conv(lf_tape *tape, int size, lf_c8_cutoff cutoff, long stride, lf_tensor *const *in,
                   lf_tensor **out)
{
    lf_c8_basis own, *basis = lf_alloc(tape, sizeof *basis);
    lf_c8_basis_init(&own, size, cutoff);
    const long n = (long)size * size * own.count * LF_C8;
    *basis = own;
    basis->table = lf_alloc_reals(tape, n);
    memcpy(basis->table, own.table, (size_t)n * sizeof(lf_real));
    lf_c8_basis_free(&own);
    out[0] = lf_c8_conv2d(tape, basis, in[0], in[1], stride);
    return 1;
}

static int c8_conv_lift(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    return c8_conv(tape, 5, LF_C8_E2CNN, 2, in, out);
}

static int c8_conv_regular(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    return c8_conv(tape, 3, LF_C8_E2CNN, 1, in, out);
}

static int c8_conv_redet(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    return c8_conv(tape, 3, LF_C8_REDET, 2, in, out);
}

static int c8_conv_circulant(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out)
{
    (void)store;
    return c8_conv(tape, 1, LF_C8_E2CNN, 1, in, out);
}

#define NORM_INPUTS(height, channels, fields)                                                      \
    {                                                                                              \
        {4, {3, height, 3, channels}, FILL_NORMAL, false}, {1, {fields}, FILL_POSITIVE, false},    \
            {1, {fields}, FILL_NORMAL, false}, {4, {3, height, 3, channels}, FILL_NORMAL, false},  \
    }

const op_case image_cases[] = {
    {"conv2d: 3x3, bias, ReLU",
     conv_relu,
     {{4, {2, 5, 4, 3}, FILL_NORMAL, false},
      {4, {3, 3, 3, 2}, FILL_NORMAL, false},
      {1, {2}, FILL_NORMAL, false}},
     3,
     0},
    {"conv2d: 3x3, stride 2",
     conv_strided,
     {{4, {3, 7, 6, 2}, FILL_NORMAL, false}, {4, {3, 3, 2, 5}, FILL_NORMAL, false}},
     2,
     0},
    {"conv2d: 7x7, stride 2",
     conv_strided,
     {{4, {2, 9, 9, 3}, FILL_NORMAL, false}, {4, {7, 7, 3, 4}, FILL_NORMAL, false}},
     2,
     0},
    {"conv2d: 1x1, bias",
     conv_biased,
     {{4, {2, 3, 3, 4}, FILL_NORMAL, false},
      {4, {1, 1, 4, 3}, FILL_NORMAL, false},
      {1, {3}, FILL_NORMAL, false}},
     3,
     0},
    {"conv2d: 1x1, stride 2",
     conv_strided,
     {{4, {2, 5, 5, 4}, FILL_NORMAL, false}, {4, {1, 1, 4, 3}, FILL_NORMAL, false}},
     2,
     0},
    {"field_norm: batch, regular fields", norm_batch, NORM_INPUTS(4, 16, 2), 4, 0},
    {"field_norm: batch, plain, ReLU", norm_batch_relu, NORM_INPUTS(2, 3, 3), 4, 0},
    {"field_norm: batch, regular, ReLU", norm_batch_relu, NORM_INPUTS(1, 8, 1), 4, 0},
    {"field_norm: running statistics", norm_running, NORM_INPUTS(4, 8, 1), 4, 0},
    {"field_norm: instance", norm_instance, NORM_INPUTS(4, 16, 2), 4, 0},
    {"max_pool: 3x3, stride 2", max_pool, {{4, {2, 5, 7, 3}, FILL_DISTINCT, false}}, 1, 0},
    {"blur", blur, {{4, {2, 4, 6, 3}, FILL_NORMAL, false}}, 1, 0},
    {"blur: one line", blur, {{4, {2, 1, 3, 2}, FILL_NORMAL, false}}, 1, 0},
    {"reflect_pad: wide", reflect_pad, {{4, {2, 4, 6, 3}, FILL_NORMAL, false}}, 1, 0},
    {"reflect_pad: smallest", reflect_pad, {{4, {2, 3, 3, 2}, FILL_NORMAL, false}}, 1, 0},
    {"resize: corners aligned", resize_aligned, {{4, {2, 4, 5, 3}, FILL_NORMAL, false}}, 1, 0},
    {"resize: aligned, one line", resize_aligned, {{4, {2, 1, 3, 2}, FILL_NORMAL, false}}, 1, 0},
    {"resize: corners not aligned", resize, {{4, {2, 4, 5, 3}, FILL_NORMAL, false}}, 1, 0},
    {"resize: not aligned, one line", resize, {{4, {2, 1, 3, 2}, FILL_NORMAL, false}}, 1, 0},
    {"volume_slices", volume_slices, {{5, {2, 5, 2, 3, 2}, FILL_NORMAL, false}}, 1, 0},
    {"volume_slices: one", volume_slices, {{5, {2, 1, 2, 2, 3}, FILL_NORMAL, false}}, 1, 0},
    {"sample_volume", sample_volume, {{5, {2, 3, 4, 5, 2}, FILL_NORMAL, false}}, 1, 0},
    {"group_sum", group_sum, {{4, {2, 3, 2, 16}, FILL_NORMAL, false}}, 1, 0},
    {"c8_conv2d: lift, 5x5, stride 2",
     c8_conv_lift,
     {{4, {2, 7, 5, 3}, FILL_NORMAL, false}, {3, {2, 3, 11}, FILL_NORMAL, false}},
     2,
     0},
    {"c8_conv2d: regular, 3x3",
     c8_conv_regular,
     {{4, {2, 3, 4, 24}, FILL_NORMAL, false}, {4, {2, 3, 8, 6}, FILL_NORMAL, false}},
     2,
     0},
    {"c8_conv2d: regular, 3x3, 3r, stride 2",
     c8_conv_redet,
     {{4, {2, 5, 3, 16}, FILL_NORMAL, false}, {4, {1, 2, 8, 8}, FILL_NORMAL, false}},
     2,
     0},
    {"c8_conv2d: block-circulant 1x1",
     c8_conv_circulant,
     {{4, {2, 3, 3, 16}, FILL_NORMAL, false}, {4, {3, 2, 8, 1}, FILL_NORMAL, false}},
     2,
     0},
};
const int image_case_count = (int)(sizeof image_cases / sizeof *image_cases);
