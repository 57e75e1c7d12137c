/* c8_block.h: convolution + norm units and residual blocks, over regular C8 fields or over plain
 * channels by one switch, so that the two kinds of network differ in nothing else.
 *                                                                        [method.md 5a.1, 5a.2]
 * Widths are counted in fields: a field is eight channels. In a plain network it is just
 * `channels_per_field` channels, with ordinary filters and norm statistics of their own.
 */
#ifndef LF_LAYERS_C8_BLOCK_H
#define LF_LAYERS_C8_BLOCK_H

#include "layers/c8.h"
#include "layers/conv.h"

/* What all units of a network have in common. */
typedef struct lf_unit_config {
    bool c8; /* false: plain channels */
    lf_c8_cutoff cutoff;
    bool instance_norm;     /* statistics of each image by itself; false: of the batch */
    double momentum;        /* of the running statistics */
    int channels_per_field; /* LF_C8 if c8 */
} lf_unit_config;

typedef struct lf_norm_layer {
    const lf_parameter *scale, *shift;              /* [fields], or [channels] if plain */
    const lf_parameter *running_mean, *running_var; /* not trainable; NULL with instance norm */
    int group;
    double momentum;
} lf_norm_layer;

/* Registers prefix.scale (1), prefix.shift (0), prefix.running_mean (0), prefix.running_var (1). */
void lf_norm_layer_init(lf_store *store, const char *prefix, int fields,
                        const lf_unit_config *config, lf_norm_layer *layer);
/* relu and residual (NULL: none) as in lf_field_norm. Training takes and records the batch's
 * statistics, otherwise the running ones are used. */
lf_tensor *lf_norm_layer_forward(lf_tape *tape, const lf_norm_layer *layer, lf_tensor *x,
                                 lf_tensor *residual, bool relu, bool training);

/* Convolution without bias, then norm. Parameters: prefix.weight and prefix.norm.*. */
typedef struct lf_unit {
    bool c8;
    lf_c8_conv steerable; /* if c8 */
    lf_conv_layer plain;  /* otherwise */
    lf_norm_layer norm;
} lf_unit;

/* in: fields, or channels if `lift` (the first layer of a network); out: fields. */
void lf_unit_init(lf_store *store, const char *prefix, const lf_unit_config *config, bool lift,
                  int in, int out, int size, int stride, lf_unit *unit);
void lf_unit_free(lf_unit *unit);
lf_tensor *lf_unit_forward(lf_tape *tape, const lf_unit *unit, lf_tensor *x, lf_tensor *residual,
                           bool relu, bool training);

/* relu(last(...relu(first(x))) + shortcut(x)): basic 3x3, 3x3; bottleneck 1x1, 3x3, 1x1 with a
 * quarter of the fields in the middle. The stride is the first 3x3's; the shortcut is a 1x1 unit
 * where the shape changes and x elsewhere. Parameters: prefix.conv1.*, ..., prefix.shortcut.*. */
typedef struct lf_block {
    int units;
    lf_unit unit[3];
    bool has_shortcut;
    lf_unit shortcut;
} lf_block;

void lf_block_init(lf_store *store, const char *prefix, const lf_unit_config *config,
                   bool bottleneck, int in, int out, int stride, lf_block *block);
void lf_block_free(lf_block *block);
lf_tensor *lf_block_forward(lf_tape *tape, const lf_block *block, lf_tensor *x, bool training);

#endif
