/* disn.c: see disn.h. */
#include "models/disn.h"

typedef struct stream {
    lf_mlp point, decoder;
} stream;

typedef struct disn {
    lf_linear_layer whole; /* last level's channels -> G */
    stream global, local;
} disn;

static void configure(const lf_config *cfg, lf_recon_config *c)
{
    const long *point = lf_config_ints(cfg, "model.point", &c->disn.point_widths);
    LF_REQUIRE(c->disn.point_widths <= LF_MLP_MAX, "%d point layers", c->disn.point_widths);
    for (int i = 0; i < c->disn.point_widths; i++)
        c->disn.point[i] = point[i];
    c->disn.global = lf_config_int(cfg, "model.global");
}

/* Channels of the last level; of regular fields their sum over orientations. */
static long last_channels(const lf_backbone_config *b)
{
    return (b->c8 ? 1 : b->plain_channels) * (long)b->fields[b->stages - 1];
}

static void stream_init(lf_recon *model, stream *s, const char *name, long inputs)
{
    const lf_recon_config *c = &model->config;
    const int last = c->disn.point_widths - 1;
    char full[64];
    snprintf(full, sizeof full, "%s.point", name);
    lf_mlp_init(model->store, &s->point, full, 3, last, c->disn.point, c->disn.point[last]);
    snprintf(full, sizeof full, "%s.decoder", name);
    lf_mlp_init(model->store, &s->decoder, full, c->disn.point[last] + inputs, c->mlp_widths,
                c->mlp, 1);
}

static void init(lf_recon *model)
{
    disn *net = calloc(1, sizeof *net);
    LF_REQUIRE(net, "out of memory");
    model->net = net;
    lf_recon_backbone_init(model, 0);
    lf_linear_init(model->store, &net->whole, "whole", last_channels(&model->config.backbone),
                   model->config.disn.global, true, 1);
    model->head_first = lf_store_size(model->store);
    stream_init(model, &net->global, "global", model->config.disn.global);
    stream_init(model, &net->local, "local", model->feature_count);
}

/* Global numbers of every object [S, G]. */
static lf_tensor *object(lf_tape *tape, const lf_recon *model, bool training,
                         const lf_recon_code *code, const lf_recon_points *grid)
{
    (void)training, (void)grid;
    const disn *net = model->net;
    lf_tensor *x = code->inner[code->inner_maps - 1];
    if (model->config.backbone.c8)
        x = lf_group_sum(tape, x, LF_C8);
    const long images = x->dim[0], c = lf_cols(x), views = code->views;
    x = lf_reshape(tape, x, 3, LF_DIMS(images, x->dim[1] * x->dim[2], c));
    x = lf_pool_views(tape, x, NULL, LF_POOL_MEAN);
    x = lf_linear_apply(tape, &net->whole, x, LF_RELU);
    x = lf_reshape(tape, x, 3, LF_DIMS(images / views, views, lf_cols(x)));
    return lf_pool_views(tape, x, NULL, LF_POOL_MAX);
}

static lf_tensor *recall(lf_tape *tape, const lf_recon *model, lf_tensor *object,
                         const lf_recon_points *p)
{
    (void)model;
    return lf_gather_rows(tape, object, p->count, lf_recon_objects(tape, p));
}

static lf_tensor *stream_apply(lf_tape *tape, const char *name, const stream *s,
                               lf_tensor *position, lf_tensor *features)
{
    lf_scope(tape, "%s", name);
    lf_tensor *x = lf_relu(tape, lf_mlp_apply(tape, &s->point, position));
    x = lf_mlp_apply(tape, &s->decoder, lf_concat(tape, 2, (lf_tensor *[]){x, features}));
    lf_scope_end(tape);
    return x;
}

static lf_tensor *sdf(lf_tape *tape, const lf_recon *model, const lf_recon_inputs *in,
                      lf_field *layers)
{
    (void)layers;
    const disn *net = model->net;
    lf_scope(tape, "views");
    lf_tensor *position = lf_tensor_new(tape, 2, LF_DIMS(in->points->count, 3));
    for (long i = 0; i < position->size; i++) /* the object in a ball of radius 1, as in DISN */
        position->value[i] = (lf_real)(2 * in->points->position[i]);
    lf_tensor *local = lf_pool_views(tape, in->seen, in->rays.mask, LF_POOL_MAX);
    lf_scope_end(tape);
    lf_scope(tape, "streams");
    lf_tensor *x = lf_add(tape, stream_apply(tape, "global", &net->global, position, in->known),
                          stream_apply(tape, "local", &net->local, position, local));
    lf_scope_end(tape);
    return x;
}

static double stream_macs(const stream *s)
{
    return lf_mlp_macs(&s->point) + lf_mlp_macs(&s->decoder);
}

static void cost(const lf_recon *model, long views, lf_recon_cost *cost)
{
    const disn *net = model->net;
    cost->object += (double)views * (double)net->whole.weight->size;
    cost->point += stream_macs(&net->global) + stream_macs(&net->local);
}

const lf_recon_network lf_disn = {.type = "disn",
                                  .configure = configure,
                                  .init = init,
                                  .object = object,
                                  .recall = recall,
                                  .sdf = sdf,
                                  .cost = cost};
