/* renderer.c: see renderer.h. */
#include "models/renderer.h"

static lf_types types_of(const lf_config *cfg)
{
    int count;
    const long *omega = lf_config_ints(cfg, "render.types", &count);
    lf_types types = {.count = count};
    for (int i = 0; i < count; i++)
        types.omega[i] = (int)omega[i];
    const long scalars = lf_config_int(cfg, "render.scalars");
    types.more = scalars ? (int)(scalars / lf_config_int(cfg, "render.channels")) - 1 : 0;
    return types;
}

lf_renderer_config lf_renderer_config_from(const lf_config *cfg)
{
    const long channels = lf_config_int(cfg, "render.features");
    const long fine = lf_config_int(cfg, "render.fine_samples");
    const bool resnet = lf_config_is(cfg, "render.feature_net", "resnet34");
    return (lf_renderer_config){
        .equivariant = lf_config_is(cfg, "model.type", "renderer"),
        .features = {.kind = resnet ? LF_FEATURES_RESNET34 : LF_FEATURES_SMALL,
                     .width = lf_config_int(cfg, "render.feature_width"),
                     .features = channels * (fine > 0 ? 2 : 1),
                     .layers = {3, 4, 6}},
        .ray = {.types = types_of(cfg),
                .inputs = LF_RGB + channels,
                .channels = lf_config_int(cfg, "render.channels"),
                .hidden = lf_config_int(cfg, "render.hidden"),
                .heads = (int)lf_config_int(cfg, "render.heads"),
                .layer_norm = lf_config_bool(cfg, "render.layer_norm"),
                .along_ray = lf_config_bool(cfg, "render.along_ray")},
        .ibrnet = {.inputs = LF_RGB + channels,
                   .width = lf_config_int(cfg, "render.width"),
                   .softplus = true},
        .channels = channels,
        .sources = lf_config_int(cfg, "render.sources"),
        .samples = lf_config_int(cfg, "render.samples"),
        .fine = fine};
}

void lf_renderer_init(lf_renderer *model, lf_store *store, const lf_renderer_config *config)
{
    static const char *const name[LF_RAY_NETWORKS] = {"coarse", "fine"};
    *model = (lf_renderer){
        .config = *config, .store = store, .networks = config->fine > 0 ? LF_RAY_NETWORKS : 1};
    lf_feature_net_init(store, "features", &config->features, &model->features);
    model->head_first = lf_store_size(store);
    for (int i = 0; i < model->networks; i++) {
        if (config->equivariant)
            lf_ray_equivariant_init(store, &model->equivariant[i], name[i], &config->ray);
        else
            lf_ibrnet_init(store, &model->ibrnet[i], name[i], &config->ibrnet);
    }
}

void lf_renderer_free(lf_renderer *model)
{
    lf_feature_net_free(&model->features);
}

lf_radiance lf_renderer_radiance(lf_tape *tape, const lf_renderer *model, int network,
                                 const lf_ray_inputs *in)
{
    if (model->config.equivariant)
        return lf_ray_equivariant_apply(tape, &model->equivariant[network], in);
    return lf_ibrnet_apply(tape, &model->ibrnet[network], in);
}

lf_types lf_renderer_types(const lf_renderer *model)
{
    return model->config.equivariant ? model->config.ray.types
                                     : (lf_types){.count = 1, .omega = {0}};
}

double lf_renderer_network_macs(const lf_renderer *model, int network)
{
    const lf_renderer_config *c = &model->config;
    const long samples = c->samples + (network == LF_FINE ? c->fine : 0);
    const double sampling = 4 * (double)(c->channels + LF_RGB) * (double)c->sources;
    const double sample =
        sampling + (c->equivariant
                        ? lf_ray_equivariant_macs(&model->equivariant[0], samples, c->sources)
                        : lf_ibrnet_macs(&model->ibrnet[0], samples, c->sources));
    return (double)samples * sample;
}

double lf_renderer_ray_macs(const lf_renderer *model)
{
    double macs = 0;
    for (int i = 0; i < model->networks; i++)
        macs += lf_renderer_network_macs(model, i);
    return macs;
}

double lf_renderer_picture_macs(const lf_renderer *model, long height, long width)
{
    return lf_feature_net_macs(&model->features, height, width);
}
