/* ibrnet_sdf.c: see ibrnet_sdf.h. */
#include "models/ibrnet_aggregation.h"
#include "models/ibrnet_sdf.h"

enum { DIRECTION = 3 };

typedef struct ibrnet_sdf {
    lf_ibrnet_aggregation views;
    lf_mlp head;
} ibrnet_sdf;

static void configure(const lf_config *cfg, lf_recon_config *c)
{
    c->width = lf_config_int(cfg, "model.width");
}

static void init(lf_recon *model)
{
    const lf_recon_config *c = &model->config;
    ibrnet_sdf *net = calloc(1, sizeof *net);
    LF_REQUIRE(net, "out of memory");
    model->net = net;
    lf_recon_backbone_init(model, 0);
    model->head_first = lf_store_size(model->store);
    lf_ibrnet_aggregation_init(model->store, &net->views, "views", DIRECTION, model->feature_count,
                               c->width);
    lf_mlp_init(model->store, &net->head, "head", c->width, c->mlp_widths, c->mlp, 1);
    net->head.act = LF_ELU;
}

/* Directions in the object's frame, [Q, 1, V, 3]. */
static lf_tensor *directions(lf_tape *tape, const lf_recon_points *p)
{
    lf_tensor *d = lf_tensor_new(tape, 4, LF_DIMS(p->count, 1, p->views, DIRECTION));
    for (long i = 0; i < d->size; i++)
        d->value[i] = (lf_real)p->bearing[i];
    return d;
}

static lf_tensor *sdf(lf_tape *tape, const lf_recon *model, const lf_recon_inputs *in,
                      lf_field *layers)
{
    (void)layers; /* it shows none */
    const ibrnet_sdf *net = model->net;
    const long points = in->points->count, views = in->points->views;
    const lf_tensor *mask = in->rays.mask;
    lf_scope(tape, "directions");
    const lf_lanes lanes =
        lf_lanes_make(tape, lf_leaf(tape, 3, LF_DIMS(points, 1, views), mask->value, NULL), NULL);
    lf_tensor *direction = lf_lanes_add_rows(tape, directions(tape, in->points), NULL, &lanes);
    lf_tensor *weight = lf_ibrnet_even_weights(tape, &lanes);
    lf_scope_end(tape);
    const lf_ibrnet_aggregated x =
        lf_ibrnet_aggregate(tape, &net->views, in->seen, direction, weight, &lanes);
    lf_scope(tape, "head");
    lf_tensor *y = lf_lanes_to_rows(tape, x.point, &lanes);
    y = lf_mlp_apply(tape, &net->head,
                     lf_reshape(tape, y, 2, LF_DIMS(points, model->config.width)));
    lf_scope_end(tape);
    return y;
}

static void cost(const lf_recon *model, long views, lf_recon_cost *cost)
{
    const ibrnet_sdf *net = model->net;
    cost->point += (double)views * lf_ibrnet_view_macs(&net->views);
    cost->point += lf_ibrnet_point_macs(&net->views) + lf_mlp_macs(&net->head);
}

const lf_recon_network lf_ibrnet_sdf = {
    .type = "ibrnet-sdf", .configure = configure, .init = init, .sdf = sdf, .cost = cost};
