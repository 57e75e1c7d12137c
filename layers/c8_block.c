/* c8_block.c: convolution + norm units and residual blocks.        [c8_block.h; method.md 5a.2] */
#include "layers/c8_block.h"

enum { NAME = 96 }; /* as lf_parameter.name */

static const lf_parameter *add(lf_store *store, const char *prefix, const char *what, long n,
                               double value, bool trainable)
{
    char name[NAME];
    snprintf(name, sizeof name, "%s.%s", prefix, what);
    return lf_store_add(store, name, 1, LF_DIMS(n), value, 0, trainable);
}

void lf_norm_layer_init(lf_store *store, const char *prefix, int fields,
                        const lf_unit_config *config, lf_norm_layer *layer)
{
    const long n = config->c8 ? fields : (long)fields * config->channels_per_field;
    *layer = (lf_norm_layer){.group = config->c8 ? LF_C8 : 1, .momentum = config->momentum};
    layer->scale = add(store, prefix, "scale", n, 1, true);
    layer->shift = add(store, prefix, "shift", n, 0, true);
    if (!config->instance_norm) {
        layer->running_mean = add(store, prefix, "running_mean", n, 0, false);
        layer->running_var = add(store, prefix, "running_var", n, 1, false);
    }
}

lf_tensor *lf_norm_layer_forward(lf_tape *tape, const lf_norm_layer *layer, lf_tensor *x,
                                 lf_tensor *residual, bool relu, bool training)
{
    const bool instance = !layer->running_mean;
    const lf_field_norm_options options = {
        .mode = instance ? LF_NORM_INSTANCE : (training ? LF_NORM_BATCH : LF_NORM_RUNNING),
        .group = layer->group,
        .epsilon = 1e-5,
        .momentum = layer->momentum,
        .relu = relu,
        .running_mean = instance ? NULL : lf_values(layer->running_mean),
        .running_var = instance ? NULL : lf_values(layer->running_var)};
    return lf_field_norm(tape, x, lf_param(tape, layer->scale), lf_param(tape, layer->shift),
                         residual, &options);
}

void lf_unit_init(lf_store *store, const char *prefix, const lf_unit_config *config, bool lift,
                  int in, int out, int size, int stride, lf_unit *unit)
{
    const int per_field = config->channels_per_field;
    char norm[NAME];
    LF_REQUIRE(per_field >= 1 && (!config->c8 || per_field == LF_C8), "%s: a field of %d channels",
               prefix, per_field);
    snprintf(norm, sizeof norm, "%s.norm", prefix);
    *unit = (lf_unit){.c8 = config->c8};
    if (config->c8)
        lf_c8_conv_init(store, prefix, lift, in, out, size, stride, config->cutoff,
                        &unit->steerable);
    else
        lf_conv_layer_init(store, prefix, lift ? in : in * per_field, out * per_field, size, stride,
                           false, 0, &unit->plain);
    lf_norm_layer_init(store, norm, out, config, &unit->norm);
}

void lf_unit_free(lf_unit *unit)
{
    if (unit->c8)
        lf_c8_conv_free(&unit->steerable);
}

lf_tensor *lf_unit_forward(lf_tape *tape, const lf_unit *unit, lf_tensor *x, lf_tensor *residual,
                           bool relu, bool training)
{
    lf_tensor *y = unit->c8 ? lf_c8_conv_forward(tape, &unit->steerable, x)
                            : lf_conv_layer_forward(tape, &unit->plain, x);
    return lf_norm_layer_forward(tape, &unit->norm, y, residual, relu, training);
}

static void init_part(lf_store *store, const char *prefix, const char *part,
                      const lf_unit_config *config, int in, int out, int size, int stride,
                      lf_unit *unit)
{
    char name[NAME];
    snprintf(name, sizeof name, "%s.%s", prefix, part);
    lf_unit_init(store, name, config, false, in, out, size, stride, unit);
}

void lf_block_init(lf_store *store, const char *prefix, const lf_unit_config *config,
                   bool bottleneck, int in, int out, int stride, lf_block *block)
{
    LF_REQUIRE(!bottleneck || out % 4 == 0, "a bottleneck of %d fields, needs a multiple of 4",
               out);
    const int middle = out / 4;
    *block = (lf_block){.units = bottleneck ? 3 : 2, .has_shortcut = stride != 1 || in != out};
    if (bottleneck) {
        init_part(store, prefix, "conv1", config, in, middle, 1, 1, &block->unit[0]);
        init_part(store, prefix, "conv2", config, middle, middle, 3, stride, &block->unit[1]);
        init_part(store, prefix, "conv3", config, middle, out, 1, 1, &block->unit[2]);
    } else {
        init_part(store, prefix, "conv1", config, in, out, 3, stride, &block->unit[0]);
        init_part(store, prefix, "conv2", config, out, out, 3, 1, &block->unit[1]);
    }
    if (block->has_shortcut)
        init_part(store, prefix, "shortcut", config, in, out, 1, stride, &block->shortcut);
}

void lf_block_free(lf_block *block)
{
    for (int i = 0; i < block->units; i++)
        lf_unit_free(&block->unit[i]);
    if (block->has_shortcut)
        lf_unit_free(&block->shortcut);
}

lf_tensor *lf_block_forward(lf_tape *tape, const lf_block *block, lf_tensor *x, bool training)
{
    lf_tensor *r =
        block->has_shortcut ? lf_unit_forward(tape, &block->shortcut, x, NULL, false, training) : x;
    lf_tensor *y = x;
    for (int i = 0; i < block->units; i++) {
        const bool last = i + 1 == block->units;
        lf_tensor *before = y;
        y = lf_unit_forward(tape, &block->unit[i], before, last ? r : NULL, true, training);
        if (i > 0)
            lf_drop(tape, before);
    }
    if (block->has_shortcut)
        lf_drop(tape, r);
    return y;
}
