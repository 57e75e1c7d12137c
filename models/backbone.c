/* backbone.c: residual network from images to scalar feature maps.  [backbone.h; method.md 5a.2] */
#include "models/backbone.h"

enum { NAME = 96 };

static void check_config(const lf_backbone_config *c)
{
    LF_REQUIRE(c->in_channels >= 1 && c->stem_fields >= 1 && c->features >= 1,
               "a backbone of %d channels, %d stem fields, %d features", c->in_channels,
               c->stem_fields, c->features);
    LF_REQUIRE(c->stages >= 1 && c->stages <= LF_BACKBONE_STAGES, "a backbone of %d stages",
               c->stages);
    for (int s = 0; s < c->stages; s++)
        LF_REQUIRE(c->blocks[s] >= 1 && c->fields[s] >= 1, "stage %d: %d blocks, %d fields", s + 1,
                   c->blocks[s], c->fields[s]);
}

/* Channels of a field. */
static int per_field(const lf_backbone_config *c)
{
    return c->c8 ? LF_C8 : c->plain_channels;
}

/* Fields of map m: 0 the stem, else the stage. */
static int fields_of(const lf_backbone_config *c, int m)
{
    return m == 0 ? c->stem_fields : c->fields[m - 1];
}

/* A regular -> scalar 1x1 layer is a linear map of the sum over orientations. [method.md 6] */
static void init_heads(lf_store *store, const char *prefix, lf_backbone *b)
{
    const lf_backbone_config *c = &b->config;
    char name[NAME];
    for (int m = c->stem_map ? 0 : 1; m <= c->stages; m++) {
        const int channels = per_field(c) * fields_of(c, m);
        snprintf(name, sizeof name, "%s.head%d", prefix, m);
        lf_conv_layer_init(store, name, c->c8 ? channels / LF_C8 : channels, c->features, 1, 1,
                           true, channels, &b->head[m]);
    }
}

void lf_backbone_init(lf_store *store, const char *prefix, const lf_backbone_config *config,
                      lf_backbone *backbone)
{
    check_config(config);
    const lf_unit_config unit = {config->c8, config->cutoff, config->instance_norm,
                                 config->momentum, per_field(config)};
    char name[NAME];
    *backbone = (lf_backbone){.config = *config};
    for (int s = 0; s < config->stages; s++)
        backbone->block_count += config->blocks[s];
    backbone->block = calloc((size_t)backbone->block_count, sizeof *backbone->block);
    LF_REQUIRE(backbone->block, "out of memory for %d blocks", backbone->block_count);
    snprintf(name, sizeof name, "%s.stem", prefix);
    lf_unit_init(store, name, &unit, true, config->in_channels, config->stem_fields,
                 config->stem_size, 2, &backbone->stem);
    lf_block *block = backbone->block;
    for (int s = 0; s < config->stages; s++)
        for (int i = 0; i < config->blocks[s]; i++) {
            const int stride = i > 0 ? 1 : (s == 0 ? config->first_stride : 2);
            snprintf(name, sizeof name, "%s.stage%d.block%d", prefix, s + 1, i);
            lf_block_init(store, name, &unit, config->bottleneck,
                          fields_of(config, i == 0 ? s : s + 1), config->fields[s], stride,
                          block++);
        }
    init_heads(store, prefix, backbone);
}

void lf_backbone_free(lf_backbone *backbone)
{
    lf_unit_free(&backbone->stem);
    for (int i = 0; i < backbone->block_count; i++)
        lf_block_free(&backbone->block[i]);
    free(backbone->block);
    *backbone = (lf_backbone){0};
}

/* What reads x at every other pixel, or between pixels, aliases; so does a filter that was turned
 * by 45 degrees on the grid. */
static lf_tensor *smoothed(lf_tape *tape, const lf_backbone_config *c, lf_tensor *x)
{
    return c->antialias ? lf_blur(tape, x) : x;
}

/* The map of a stem or stage, and its own values gone where something else stands for them. */
static lf_tensor *finished(lf_tape *tape, const lf_backbone_config *c, lf_tensor *x)
{
    lf_tensor *map = smoothed(tape, c, x);
    if (map != x)
        lf_drop(tape, x);
    return map;
}

int lf_backbone_fields(lf_tape *tape, const lf_backbone *backbone, lf_tensor *images, bool training,
                       lf_tensor *maps[LF_BACKBONE_MAPS])
{
    const lf_backbone_config *c = &backbone->config;
    lf_scope(tape, "stem");
    lf_tensor *x = smoothed(tape, c, images);
    x = finished(tape, c, lf_unit_forward(tape, &backbone->stem, x, NULL, true, training));
    maps[0] = x;
    if (c->stem_pool)
        x = lf_max_pool(tape, x, 3, 2, 1);
    lf_scope_end(tape);
    const lf_block *block = backbone->block;
    for (int s = 0; s < c->stages; s++) {
        lf_scope(tape, "stage%d", s + 1);
        for (int i = 0; i < c->blocks[s]; i++) {
            lf_tensor *before = x;
            x = lf_block_forward(tape, block++, before, training);
            if (i > 0)
                lf_drop(tape, before);
        }
        x = maps[s + 1] = finished(tape, c, x);
        lf_scope_end(tape);
    }
    return c->stages + 1;
}

int lf_backbone_scalars(lf_tape *tape, const lf_backbone *backbone, lf_tensor *const *inner,
                        lf_tensor *maps[LF_BACKBONE_MAPS])
{
    const lf_backbone_config *c = &backbone->config;
    int count = 0;
    lf_scope(tape, "heads");
    for (int m = c->stem_map ? 0 : 1; m <= c->stages; m++) {
        lf_tensor *x = c->c8 ? lf_group_sum(tape, inner[m], LF_C8) : inner[m];
        maps[count++] = lf_conv_layer_forward(tape, &backbone->head[m], x);
    }
    lf_scope_end(tape);
    return count;
}

int lf_backbone_forward(lf_tape *tape, const lf_backbone *backbone, lf_tensor *images,
                        bool training, lf_tensor *maps[LF_BACKBONE_MAPS])
{
    lf_tensor *inner[LF_BACKBONE_MAPS];
    const int fields = lf_backbone_fields(tape, backbone, images, training, inner);
    const int count = lf_backbone_scalars(tape, backbone, inner, maps);
    for (int m = 0; m < fields; m++)
        lf_drop(tape, inner[m]);
    return count;
}

/* ---- cost ------------------------------------------------------------------------------------ */

typedef struct extent {
    long height, width;
} extent;

static extent strided(extent e, int stride)
{
    return (extent){(e.height + stride - 1) / stride, (e.width + stride - 1) / stride};
}

/* Add one unit's convolution and parameters; returns the size of its output. */
static extent count_unit(const lf_unit *unit, extent in, lf_backbone_cost *cost)
{
    const lf_parameter *w = unit->c8 ? unit->steerable.weight : unit->plain.weight;
    const extent out = strided(in, unit->c8 ? unit->steerable.stride : unit->plain.stride);
    const long size = unit->c8 ? unit->steerable.basis.size : w->dim[0];
    const long turns = unit->c8 && w->rank == 4 ? LF_C8 : 1;
    const long pairs = unit->c8 ? w->dim[0] * LF_C8 * w->dim[1] * turns : w->dim[2] * w->dim[3];
    const long channels = unit->c8 ? w->dim[0] * LF_C8 : w->dim[3];
    cost->macs += (double)(out.height * out.width * size * size) * (double)pairs;
    cost->kept += (double)(out.height * out.width) * (double)channels;
    cost->parameters += w->size + unit->norm.scale->size + unit->norm.shift->size;
    return out;
}

static extent count_block(const lf_block *block, extent in, lf_backbone_cost *cost)
{
    extent out = in;
    for (int i = 0; i < block->units; i++)
        out = count_unit(&block->unit[i], out, cost);
    if (block->has_shortcut)
        count_unit(&block->shortcut, in, cost);
    return out;
}

static void count_head(const lf_conv_layer *head, extent at, lf_backbone_cost *cost)
{
    cost->macs += (double)(at.height * at.width) * (double)head->weight->size;
    cost->parameters += head->weight->size + head->bias->size;
    cost->height[cost->maps] = at.height;
    cost->width[cost->maps++] = at.width;
}

lf_backbone_cost lf_backbone_macs(const lf_backbone *backbone, long height, long width)
{
    const lf_backbone_config *c = &backbone->config;
    lf_backbone_cost cost = {0};
    extent at = count_unit(&backbone->stem, (extent){height, width}, &cost);
    if (c->stem_map)
        count_head(&backbone->head[0], at, &cost);
    if (c->stem_pool)
        at = strided(at, 2);
    const lf_block *block = backbone->block;
    for (int s = 0; s < c->stages; s++) {
        for (int i = 0; i < c->blocks[s]; i++)
            at = count_block(block++, at, &cost);
        count_head(&backbone->head[s + 1], at, &cost);
    }
    return cost;
}
