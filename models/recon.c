/* recon.c: the reconstruction model, read as the paper's pipeline.                 [method.md 5a]
 */
#include "models/recon.h"

/* Depth code: distances are centred at 2.5 and scaled by 0.5 (method.md 4.4): cameras of the
 * built-in views stand 2.5 box diagonals away and the object has radius 0.5. */
static const double depth_centre = 2.5, depth_half = 0.5;

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
        .backbone = backbone_config(cfg),
        .image_size = lf_config_int(cfg, "data.image_size"),
        .sample_image = lf_config_bool(cfg, "model.sample_image"),
        .depth_octaves = (int)lf_config_int(cfg, "model.depth_octaves"),
        .block = {.scalars = lf_config_int(cfg, "model.scalars"),
                  .vectors = lf_config_int(cfg, "model.vectors"),
                  .heads = (int)lf_config_int(cfg, "model.heads"),
                  .degree2 = lf_config_bool(cfg, "model.degree2"),
                  .skip_linear = lf_config_is(cfg, "model.skip", "linear"),
                  .nonlinearity =
                      lf_config_is(cfg, "model.nonlinearity", "gated") ? LF_GATED : LF_NORM_RELU},
        .blocks = (int)lf_config_int(cfg, "model.blocks"),
    };
    const long *mlp = lf_config_ints(cfg, "model.mlp", &c.mlp_widths);
    LF_REQUIRE(c.mlp_widths < LF_MLP_MAX && c.blocks <= LF_RECON_BLOCKS, "%d MLP layers, %d blocks",
               c.mlp_widths, c.blocks);
    for (int i = 0; i < c.mlp_widths; i++)
        c.mlp[i] = mlp[i];
    return c;
}

static long depth_code_size(const lf_recon_config *c)
{
    return c->depth_octaves ? 1 + 2 * c->depth_octaves : 0;
}

long lf_recon_sampled(const lf_recon *model)
{
    return model->feature_count - depth_code_size(&model->config);
}

void lf_recon_init(lf_recon *model, lf_store *store, const lf_recon_config *config)
{
    *model = (lf_recon){.config = *config, .store = store};
    const long c0 = config->block.scalars, c1 = config->block.vectors, kept = config->blocks + 1;
    lf_backbone_init(store, "backbone", &config->backbone, &model->backbone);
    model->head_first = lf_store_size(store);
    const long maps = config->backbone.stages + (config->backbone.stem_map ? 1 : 0);
    model->feature_count = maps * config->backbone.features + depth_code_size(config) +
                           (config->sample_image ? config->backbone.in_channels : 0);
    lf_ray_convolution_init(store, &model->convolution, "convolution", model->feature_count, c0,
                            c1);
    for (int b = 0; b < config->blocks; b++) {
        char name[32];
        snprintf(name, sizeof name, "block%d", b);
        const long ray0 = b ? c0 : model->feature_count, ray1 = b ? c1 : 0;
        lf_transformer_block_init(store, &model->block[b], name, &config->block, ray0, ray1);
    }
    model->has_readout = c1 > 0;
    if (model->has_readout)
        lf_vector_neuron_init(store, &model->readout, "readout", kept * c1);
    lf_mlp_init(store, &model->head, "head", kept * (c0 + c1), config->mlp_widths, config->mlp, 1);
}

void lf_recon_free(lf_recon *model)
{
    lf_backbone_free(&model->backbone);
}

int lf_recon_maps(lf_tape *tape, const lf_recon *model, lf_tensor *images, bool training,
                  lf_tensor *maps[LF_BACKBONE_MAPS + 1])
{
    lf_scope(tape, "backbone");
    int count = lf_backbone_forward(tape, &model->backbone, images, training, maps);
    lf_scope_end(tape);
    if (model->config.sample_image)
        maps[count++] = images;
    return count;
}

/* [s', sin 2^k pi s', cos 2^k pi s'], s' = (s - centre) / half.                    [method.md 5a.3]
 */
static lf_tensor *depth_code(lf_tape *tape, const lf_recon *model, const lf_ray_geometry *rays,
                             const double *distance)
{
    const int octaves = model->config.depth_octaves;
    const long n = depth_code_size(&model->config);
    lf_tensor *code = lf_tensor_new(tape, 3, LF_DIMS(rays->points, rays->views, n));
    for (long r = 0; r < rays->points * rays->views; r++) {
        lf_real *out = code->value + r * n;
        const double s = (distance[r] - depth_centre) / depth_half;
        out[0] = (lf_real)s;
        for (int k = 0; k < octaves; k++) {
            const double phase = (double)(1 << k) * 3.141592653589793 * s;
            out[1 + 2 * k] = (lf_real)sin(phase);
            out[2 + 2 * k] = (lf_real)cos(phase);
        }
    }
    return code;
}

/* Invariants of all kept point features, joined.                                   [method.md 5a.6]
 */
static lf_tensor *invariants(lf_tape *tape, const lf_recon *model, const lf_field *kept, int count)
{
    lf_tensor *scalars[LF_RECON_BLOCKS + 2], *vectors[LF_RECON_BLOCKS + 1];
    for (int i = 0; i < count; i++) {
        scalars[i] = kept[i].scalar;
        vectors[i] = kept[i].vector;
    }
    if (!model->has_readout)
        return lf_concat(tape, count, scalars);
    lf_tensor *all = lf_concat(tape, count, vectors);
    scalars[count] = lf_vector_neuron_apply(tape, &model->readout, all);
    return lf_concat(tape, count + 1, scalars);
}

lf_tensor *lf_recon_sdf(lf_tape *tape, const lf_recon *model, lf_tensor *seen,
                        const lf_ray_geometry *rays, const double *distance, lf_field *layers)
{
    const lf_recon_config *c = &model->config;
    lf_tensor *ray = seen; /* 5a.3 */
    lf_scope(tape, "ray convolution");
    if (c->depth_octaves)
        ray = lf_concat(tape, 2, (lf_tensor *[]){seen, depth_code(tape, model, rays, distance)});
    lf_field point = lf_ray_convolution_apply(tape, &model->convolution, ray, rays); /* 5a.4 */
    lf_scope_end(tape);
    lf_field on_rays = {ray, NULL}, kept[LF_RECON_BLOCKS + 1] = {point};
    for (int b = 0; b < c->blocks; b++) { /* 5a.5 */
        lf_scope(tape, "block%d", b);
        lf_transformer_block_apply(tape, &model->block[b], &on_rays, &point, rays);
        kept[b + 1] = point;
        lf_scope_end(tape);
    }
    for (int i = 0; layers && i <= c->blocks; i++)
        layers[i] = kept[i];
    lf_scope(tape, "readout"); /* 5a.6 */
    lf_tensor *x = invariants(tape, model, kept, c->blocks + 1);
    x = lf_mlp_apply(tape, &model->head, x);
    lf_scope_end(tape);
    return x;
}
