/* recon.c: what all reconstruction models have in common. See recon.h.            [method.md 5a.2,
 * 5a.3] */
#include "models/disn.h"
#include "models/fvor.h"
#include "models/ibrnet_sdf.h"
#include "models/recon_equivariant.h"

static const lf_recon_network *const networks[] = {&lf_recon_equivariant, &lf_disn, &lf_fvor,
                                                   &lf_ibrnet_sdf};
enum { NETWORKS = sizeof networks / sizeof *networks };

/* ---- config ---- */

static const lf_recon_network *network_of(const lf_config *cfg)
{
    for (int i = 0; i < NETWORKS; i++)
        if (lf_config_is(cfg, "model.type", networks[i]->type))
            return networks[i];
    LF_REQUIRE(false, "model.type = %s reconstructs nothing", lf_config_choice(cfg, "model.type"));
    return NULL;
}

static lf_backbone_config backbone_config(const lf_config *cfg)
{
    int stages, fields;
    const long *blocks = lf_config_ints(cfg, "model.stages", &stages);
    const long *widths = lf_config_ints(cfg, "model.fields", &fields);
    LF_REQUIRE(stages == fields && stages <= LF_BACKBONE_STAGES, "%d stages, %d fields", stages,
               fields);
    lf_backbone_config b = {
        .in_channels = lf_config_is(cfg, "data.channels", "colour") ? 4 : 2,
        .c8 = lf_config_is(cfg, "model.backbone", "c8"),
        .plain_channels = (int)lf_config_int(cfg, "model.plain_channels"),
        .stem_fields = (int)lf_config_int(cfg, "model.stem_fields"),
        .stem_size = (int)lf_config_int(cfg, "model.stem_size"),
        .stem_pool = lf_config_bool(cfg, "model.stem_pool"),
        .stages = stages,
        .first_stride = (int)lf_config_int(cfg, "model.first_stride"),
        .bottleneck = lf_config_is(cfg, "model.block", "bottleneck"),
        .cutoff = lf_config_is(cfg, "model.cutoff", "redet") ? LF_C8_REDET : LF_C8_E2CNN,
        .features = (int)lf_config_int(cfg, "model.features"),
        .instance_norm = lf_config_is(cfg, "model.norm", "instance"),
        .momentum = lf_config_real(cfg, "model.norm_momentum"),
        .stem_map = lf_config_bool(cfg, "model.stem_features"),
        .antialias = lf_config_bool(cfg, "model.antialias"),
    };
    for (int s = 0; s < stages; s++) {
        b.blocks[s] = (int)blocks[s];
        b.fields[s] = (int)widths[s];
    }
    return b;
}

lf_recon_config lf_recon_config_from(const lf_config *cfg)
{
    lf_recon_config c = {
        .network = network_of(cfg),
        .backbone = backbone_config(cfg),
        .image_size = lf_config_int(cfg, "data.image_size"),
        .sample_image = lf_config_bool(cfg, "model.sample_image"),
    };
    const long *mlp = lf_config_ints(cfg, "model.mlp", &c.mlp_widths);
    LF_REQUIRE(c.mlp_widths < LF_MLP_MAX, "%d MLP layers", c.mlp_widths);
    for (int i = 0; i < c.mlp_widths; i++)
        c.mlp[i] = mlp[i];
    c.network->configure(cfg, &c);
    return c;
}

/* ---- the model ---- */

void lf_recon_backbone_init(lf_recon *model, int more_channels)
{
    const lf_recon_config *c = &model->config;
    lf_backbone_config backbone = c->backbone;
    backbone.in_channels += more_channels;
    lf_backbone_init(model->store, "backbone", &backbone, &model->backbone);
    const long maps = backbone.stages + (backbone.stem_map ? 1 : 0);
    model->feature_count =
        maps * backbone.features + (c->sample_image ? c->backbone.in_channels : 0);
}

void lf_recon_init(lf_recon *model, lf_store *store, const lf_recon_config *config)
{
    *model = (lf_recon){.config = *config, .store = store};
    config->network->init(model);
    LF_REQUIRE(model->layers <= LF_RECON_LAYERS, "%d layers to show", model->layers);
}

void lf_recon_free(lf_recon *model)
{
    lf_backbone_free(&model->backbone);
    free(model->net);
    model->net = NULL;
}

void lf_recon_grid(const lf_recon *model, double (*point)[3])
{
    const long n = model->grid;
    for (long i = 0; i < n * n * n; i++) {
        const long at[3] = {i % n, i / n % n, i / n / n};
        for (int a = 0; a < 3; a++)
            point[i][a] = (double)at[a] / (double)(n - 1) - 0.5;
    }
}

/* ---- images ---- */

void lf_recon_encode_images(lf_tape *tape, const lf_recon *model, lf_tensor *images, long views,
                            const lf_recon_points *grid, bool training, lf_recon_code *code)
{
    const lf_recon_network *network = model->config.network;
    lf_scope(tape, "images");
    lf_tensor *view = network->view ? network->view(tape, model, images) : images;
    lf_scope_end(tape);
    LF_REQUIRE(views >= 1 && images->dim[0] % views == 0, "%ld images of objects in %ld views",
               images->dim[0], views);
    *code = (lf_recon_code){.views = views};
    lf_scope(tape, "backbone");
    code->inner_maps = lf_backbone_fields(tape, &model->backbone, view, training, code->inner);
    code->maps = lf_backbone_scalars(tape, &model->backbone, code->inner, code->map);
    lf_scope_end(tape);
    if (model->config.sample_image)
        code->map[code->maps++] = images;
    LF_REQUIRE(model->grid == 0 || grid, "a network with a grid is not told how views see it");
    lf_scope(tape, "object");
    if (network->object)
        code->object = network->object(tape, model, training, code, grid);
    lf_scope_end(tape);
}

/* ---- points ---- */

static lf_ray_geometry rays_of(lf_tape *tape, const lf_recon_points *p)
{
    lf_tensor *direction = lf_tensor_new(tape, 3, LF_DIMS(p->count, p->views, 3));
    lf_tensor *mask = lf_tensor_new(tape, 2, LF_DIMS(p->count, p->views));
    for (long i = 0; i < direction->size; i++)
        direction->value[i] = (lf_real)p->direction[i];
    for (long i = 0; i < mask->size; i++)
        mask->value[i] = p->mask[i];
    return (lf_ray_geometry){p->count, p->views, direction, mask};
}

lf_recon_inputs lf_recon_look(lf_tape *tape, const lf_recon *model, const lf_recon_code *code,
                              const lf_recon_points *points)
{
    const lf_recon_network *network = model->config.network;
    const long size = model->config.image_size;
    lf_scope(tape, "samples");
    lf_recon_inputs in = {.rays = rays_of(tape, points), .points = points};
    in.seen =
        lf_sample_maps(tape, code->maps, (lf_tensor *const *)code->map, size, size, points->count,
                       points->views, points->uv, in.rays.mask->value, points->first);
    if (network->recall)
        in.known = network->recall(tape, model, code->object, points);
    lf_scope_end(tape);
    return in;
}

const long *lf_recon_objects(lf_tape *tape, const lf_recon_points *points)
{
    long *object = lf_alloc(tape, (size_t)points->count * sizeof *object);
    for (long q = 0; q < points->count; q++)
        object[q] = points->first[q] / points->views;
    return object;
}

lf_tensor *lf_recon_sdf(lf_tape *tape, const lf_recon *model, const lf_recon_inputs *in,
                        lf_field *layers)
{
    return model->config.network->sdf(tape, model, in, layers);
}

/* ---- cost ---- */

lf_recon_cost lf_recon_costs(const lf_recon *model, long views)
{
    const lf_recon_config *c = &model->config;
    const lf_backbone_cost b = lf_backbone_macs(&model->backbone, c->image_size, c->image_size);
    const double pixels = (double)(c->image_size * c->image_size);
    lf_recon_cost cost = {.image = b.macs,
                          .image_kept = b.kept + pixels * c->backbone.in_channels,
                          .point = (double)views * 4 * (double)model->feature_count,
                          .point_kept = (double)views * (double)model->feature_count};
    c->network->cost(model, views, &cost);
    return cost;
}
