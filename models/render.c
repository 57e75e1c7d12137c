/* render.c: see render.h. */
#include "models/render.h"

static lf_types types_of(const lf_config *cfg)
{
    int count;
    const long *omega = lf_config_ints(cfg, "render.types", &count);
    lf_types types = {.count = count};
    for (int i = 0; i < count; i++)
        types.omega[i] = (int)omega[i];
    return types;
}

lf_render_config lf_render_config_from(const lf_config *cfg)
{
    const long channels = lf_config_int(cfg, "render.features");
    const long fine = lf_config_int(cfg, "render.fine_samples");
    const bool resnet = lf_config_is(cfg, "render.feature_net", "resnet34");
    return (lf_render_config){
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

void lf_render_init(lf_render *model, lf_store *store, const lf_render_config *config)
{
    static const char *const name[LF_RAY_NETWORKS] = {"coarse", "fine"};
    *model = (lf_render){
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

void lf_render_free(lf_render *model)
{
    lf_feature_net_free(&model->features);
}

lf_radiance lf_render_radiance(lf_tape *tape, const lf_render *model, int network,
                               const lf_ray_inputs *in)
{
    if (model->config.equivariant)
        return lf_ray_equivariant_apply(tape, &model->equivariant[network], in);
    return lf_ibrnet_apply(tape, &model->ibrnet[network], in);
}

lf_types lf_render_types(const lf_render *model)
{
    return model->config.equivariant ? model->config.ray.types : (lf_types){1, {0}};
}

static double sample_macs(const lf_render *model, long samples)
{
    const lf_render_config *c = &model->config;
    const double sampling = 4 * (double)(c->channels + LF_RGB) * (double)c->sources;
    return sampling + (c->equivariant
                           ? lf_ray_equivariant_macs(&model->equivariant[0], samples, c->sources)
                           : lf_ibrnet_macs(&model->ibrnet[0], samples, c->sources));
}

double lf_render_ray_macs(const lf_render *model)
{
    const lf_render_config *c = &model->config;
    double macs = (double)c->samples * sample_macs(model, c->samples);
    const long all = c->samples + c->fine;
    if (c->fine > 0)
        macs += (double)all * sample_macs(model, all);
    return macs;
}

double lf_render_picture_macs(const lf_render *model, long height, long width)
{
    return lf_feature_net_macs(&model->features, height, width);
}
