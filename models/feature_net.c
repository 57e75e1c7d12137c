/* feature_net.c: from pictures to feature maps.                  [feature_net.h; method.md 5b.1] */
#include "autograd/ops.h"
#include "models/feature_net.h"

enum { NAME = 96 }; /* as lf_parameter.name */

/* Places in lf_feature_net.unit. */
enum { DOWN_1, DOWN_2, DOWN_3, DOWN_4, JOIN };
enum { STEM, UP_3, JOIN_3, UP_2, JOIN_2 };

/* ---- parameters ------------------------------------------------------------------------------ */

/* What a unit is: channels, filter, and what follows it. */
typedef struct shape {
    long in, out;
    int size, stride;
    bool bias, norm;
} shape;

static void init_unit(lf_store *store, const char *prefix, const char *what, shape s,
                      lf_feature_unit *unit)
{
    char name[2 * NAME], part[2 * NAME + 8];
    const int fan = 6 * s.size * s.size * (int)s.in; /* variance 2 / fan = 1 / (3 fan in) */
    snprintf(name, sizeof name, "%s.%s", prefix, what);
    *unit = (lf_feature_unit){.scale = NULL};
    lf_conv_layer_init(store, name, (int)s.in, (int)s.out, s.size, s.stride, s.bias, fan,
                       &unit->conv);
    if (!s.norm)
        return;
    snprintf(part, sizeof part, "%s.scale", name);
    unit->scale = lf_store_add(store, part, 1, LF_DIMS(s.out), 1, 0, true);
    snprintf(part, sizeof part, "%s.shift", name);
    unit->shift = lf_store_add(store, part, 1, LF_DIMS(s.out), 0, 0, true);
}

static void init_small(lf_store *store, const char *prefix, lf_feature_net *net)
{
    static const char *const name[] = {"down1", "down2", "down3", "down4", "join"};
    const long w = net->config.width;
    const shape units[] = {{3, w, 5, 2, true, false},
                           {w, w, 3, 1, true, false},
                           {w, 2 * w, 3, 2, true, false},
                           {2 * w, 2 * w, 3, 1, true, false},
                           {3 * w, 2 * w, 3, 1, true, false}};
    for (int i = 0; i < LF_FEATURE_UNITS; i++)
        init_unit(store, prefix, name[i], units[i], &net->unit[i]);
    init_unit(store, prefix, "out", (shape){2 * w, net->config.features, 1, 1, true, false},
              &net->out);
}

static void init_block(lf_store *store, const char *prefix, long in, long out, int stride,
                       lf_feature_block *block)
{
    *block = (lf_feature_block){.has_shortcut = stride != 1 || in != out};
    init_unit(store, prefix, "conv1", (shape){in, out, 3, stride, false, true}, &block->conv1);
    init_unit(store, prefix, "conv2", (shape){out, out, 3, 1, false, true}, &block->conv2);
    if (block->has_shortcut)
        init_unit(store, prefix, "shortcut", (shape){in, out, 1, stride, false, true},
                  &block->shortcut);
}

static void init_blocks(lf_store *store, const char *prefix, lf_feature_net *net)
{
    const lf_feature_config *c = &net->config;
    for (int s = 0; s < LF_FEATURE_STAGES; s++)
        net->block_count += c->layers[s];
    net->block = calloc((size_t)net->block_count, sizeof *net->block);
    LF_REQUIRE(net->block, "out of memory for %d blocks", net->block_count);
    lf_feature_block *block = net->block;
    long in = c->width;
    for (int s = 0; s < LF_FEATURE_STAGES; s++)
        for (int i = 0; i < c->layers[s]; i++) {
            char name[NAME];
            snprintf(name, sizeof name, "%s.stage%d.block%d", prefix, s + 1, i);
            init_block(store, name, in, c->width << s, i == 0 ? 2 : 1, block++);
            in = c->width << s;
        }
}

static void init_resnet(lf_store *store, const char *prefix, lf_feature_net *net)
{
    static const char *const name[] = {"stem", "up3", "join3", "up2", "join2"};
    const long w = net->config.width, features = net->config.features;
    const shape units[] = {{3, w, 7, 2, false, true},
                           {4 * w, 2 * w, 3, 1, true, true},
                           {4 * w, 2 * w, 3, 1, true, true},
                           {2 * w, w, 3, 1, true, true},
                           {2 * w, features, 3, 1, true, true}};
    for (int i = 0; i < LF_FEATURE_UNITS; i++)
        init_unit(store, prefix, name[i], units[i], &net->unit[i]);
    init_blocks(store, prefix, net);
    init_unit(store, prefix, "out", (shape){features, features, 1, 1, true, false}, &net->out);
}

void lf_feature_net_init(lf_store *store, const char *prefix, const lf_feature_config *config,
                         lf_feature_net *net)
{
    LF_REQUIRE(config->width >= 1 && config->features >= 1,
               "a feature network of width %ld with %ld features", config->width, config->features);
    *net = (lf_feature_net){.config = *config};
    if (config->kind == LF_FEATURES_SMALL) {
        init_small(store, prefix, net);
        return;
    }
    for (int s = 0; s < LF_FEATURE_STAGES; s++)
        LF_REQUIRE(config->layers[s] >= 1, "stage %d of a feature network: %d blocks", s + 1,
                   config->layers[s]);
    init_resnet(store, prefix, net);
}

void lf_feature_net_free(lf_feature_net *net)
{
    free(net->block);
    *net = (lf_feature_net){.block = NULL};
}

/* ---- forward --------------------------------------------------------------------------------- */

static lf_tensor *convolve(lf_tape *tape, const lf_conv_layer *c, lf_tensor *x, lf_activation act)
{
    const long pad = c->weight->dim[0] / 2;
    return lf_conv2d(tape, pad ? lf_reflect_pad(tape, x, pad) : x, lf_param(tape, c->weight),
                     c->bias ? lf_param(tape, c->bias) : NULL, c->stride, 0, act);
}

/* The unit with its norm, plus `residual` (NULL: none), then ReLU if asked. */
static lf_tensor *normed(lf_tape *tape, const lf_feature_unit *unit, lf_tensor *x,
                         lf_tensor *residual, bool relu)
{
    const lf_field_norm_options options = {
        .mode = LF_NORM_INSTANCE, .group = 1, .epsilon = 1e-5, .relu = relu};
    return lf_field_norm(tape, convolve(tape, &unit->conv, x, LF_IDENTITY),
                         lf_param(tape, unit->scale), lf_param(tape, unit->shift), residual,
                         &options);
}

/* [x at the size of `finer`; finer] */
static lf_tensor *joined(lf_tape *tape, lf_tensor *x, lf_tensor *finer, bool aligned)
{
    lf_tensor *resized = lf_resize(tape, x, finer->dim[1], finer->dim[2], aligned);
    return lf_concat(tape, 2, (lf_tensor *[]){resized, finer});
}

/* 2 x - 1, without a gradient. */
static lf_tensor *centred(lf_tape *tape, const lf_tensor *x)
{
    lf_tensor *y = lf_tensor_like(tape, x);
    for (long i = 0; i < x->size; i++)
        y->value[i] = 2 * x->value[i] - 1;
    return y;
}

static lf_tensor *forward_small(lf_tape *tape, const lf_feature_net *net, lf_tensor *images)
{
    const lf_feature_unit *u = net->unit;
    lf_scope(tape, "down");
    lf_tensor *x = convolve(tape, &u[DOWN_1].conv, centred(tape, images), LF_ELU);
    lf_tensor *p = convolve(tape, &u[DOWN_2].conv, x, LF_ELU);
    lf_tensor *q = convolve(tape, &u[DOWN_3].conv, p, LF_ELU);
    q = convolve(tape, &u[DOWN_4].conv, q, LF_ELU);
    lf_scope_end(tape);
    lf_scope(tape, "up");
    x = convolve(tape, &u[JOIN].conv, joined(tape, q, p, false), LF_ELU);
    x = convolve(tape, &net->out.conv, x, LF_IDENTITY);
    lf_scope_end(tape);
    return x;
}

static lf_tensor *forward_block(lf_tape *tape, const lf_feature_block *block, lf_tensor *x)
{
    lf_tensor *shortcut = block->has_shortcut ? normed(tape, &block->shortcut, x, NULL, false) : x;
    x = normed(tape, &block->conv1, x, NULL, true);
    return normed(tape, &block->conv2, x, shortcut, true);
}

static lf_tensor *forward_up(lf_tape *tape, const lf_feature_unit *unit, lf_tensor *x)
{
    return lf_elu(tape, normed(tape, unit, x, NULL, false));
}

/* U([U(x at the size of finer); finer]) */
static lf_tensor *forward_join(lf_tape *tape, const lf_feature_unit *up,
                               const lf_feature_unit *join, lf_tensor *x, lf_tensor *finer)
{
    x = lf_resize(tape, x, finer->dim[1], finer->dim[2], true);
    x = forward_up(tape, up, x);
    return forward_up(tape, join, lf_concat(tape, 2, (lf_tensor *[]){x, finer}));
}

static lf_tensor *forward_resnet(lf_tape *tape, const lf_feature_net *net, lf_tensor *images)
{
    const lf_feature_unit *u = net->unit;
    lf_scope(tape, "stem");
    lf_tensor *x = normed(tape, &u[STEM], images, NULL, true), *stage[LF_FEATURE_STAGES];
    lf_scope_end(tape);
    const lf_feature_block *block = net->block;
    for (int s = 0; s < LF_FEATURE_STAGES; s++) {
        lf_scope(tape, "stage%d", s + 1);
        for (int i = 0; i < net->config.layers[s]; i++)
            x = forward_block(tape, block++, x);
        stage[s] = x;
        lf_scope_end(tape);
    }
    lf_scope(tape, "up");
    x = forward_join(tape, &u[UP_3], &u[JOIN_3], x, stage[1]);
    x = forward_join(tape, &u[UP_2], &u[JOIN_2], x, stage[0]);
    x = convolve(tape, &net->out.conv, x, LF_IDENTITY);
    lf_scope_end(tape);
    return x;
}

lf_tensor *lf_feature_net_forward(lf_tape *tape, const lf_feature_net *net, lf_tensor *images)
{
    const long smallest = lf_feature_net_smallest(net), *d = images->dim;
    LF_REQUIRE(images->rank == 4 && d[3] == 3,
               "lf_feature_net_forward: images of rank %d, [..,%ld]", images->rank,
               lf_cols(images));
    LF_REQUIRE(d[1] >= smallest && d[2] >= smallest,
               "lf_feature_net_forward: images of %ld x %ld pixels, need %ld x %ld", d[1], d[2],
               smallest, smallest);
    lf_scope(tape, "features");
    lf_tensor *maps = net->config.kind == LF_FEATURES_SMALL ? forward_small(tape, net, images)
                                                            : forward_resnet(tape, net, images);
    lf_scope_end(tape);
    return maps;
}
