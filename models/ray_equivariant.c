/* ray_equivariant.c: see ray_equivariant.h. */
#include "models/ray_equivariant.h"

#include "layers/light_blocks.h"

enum { DENSITY_WIDTH = 16 };

static const char *const norm_name[] = {"convolution_norm", "cross_norm", "along_norm"};

static void require_config(const lf_ray_equivariant_config *c)
{
    LF_REQUIRE(lf_types_valid(&c->types) && c->inputs >= LF_RGB && c->channels >= 1 &&
                   c->hidden >= 1 && c->heads >= 1 && c->channels % c->heads == 0,
               "ray_equivariant: %d types, %ld inputs, %ld channels, %ld hidden, %d heads",
               c->types.count, c->inputs, c->channels, c->hidden, c->heads);
}

static void density_init(lf_store *store, lf_mlp *mlp, const char *prefix, long in)
{
    char name[96];
    snprintf(name, sizeof name, "%s.density", prefix);
    lf_mlp_init(store, mlp, name, in, 2, LF_DIMS(DENSITY_WIDTH, DENSITY_WIDTH), 1);
    mlp->act = LF_ELU;
    lf_values(mlp->layer[2].bias)[0] = -2; /* softplus(-2) = 0.13: rays start half transparent */
}

void lf_ray_equivariant_init(lf_store *store, lf_ray_equivariant *net, const char *prefix,
                             const lf_ray_equivariant_config *config)
{
    const lf_types *types = &config->types;
    const long c = config->channels, invariants = lf_types_gates(types) * c;
    char name[96];
    require_config(config);
    *net = (lf_ray_equivariant){.config = *config};
    snprintf(name, sizeof name, "%s.convolution", prefix);
    lf_ray_ray_convolution_init(store, &net->convolution, name, types, config->inputs, c,
                                config->hidden);
    snprintf(name, sizeof name, "%s.cross", prefix);
    lf_cross_attention_init(store, &net->cross, name, types, config->inputs, c, config->hidden,
                            config->heads);
    snprintf(name, sizeof name, "%s.along", prefix);
    if (config->along_ray)
        lf_along_ray_init(store, &net->along, name, types, c, c, config->heads);
    for (int i = 0; config->layer_norm && i < (config->along_ray ? 3 : 2); i++) {
        snprintf(name, sizeof name, "%s.%s.gain", prefix, norm_name[i]);
        net->gain[i] = lf_store_add(store, name, 1, LF_DIMS(invariants), 1, 0, true);
    }
    snprintf(name, sizeof name, "%s.gated", prefix);
    lf_so2_gated_init(store, &net->gated, name, types, c);
    snprintf(name, sizeof name, "%s.mix", prefix);
    lf_so2_map_init(store, &net->mix, name, types, c, c, true);
    density_init(store, &net->density, prefix, invariants + 1);
}

static lf_tensor *norm(lf_tape *tape, const lf_ray_equivariant *net, int place, lf_tensor *x)
{
    const lf_parameter *gain = net->gain[place];
    return gain ? lf_blocks_norm(tape, &net->config.types, x, lf_param(tape, gain)) : x;
}

/* [invariants of x; views that see a sample over all views, less a half]: [B, 1, Q C + 1, W].
 */
static lf_tensor *density_inputs(lf_tape *tape, const lf_blocks *blocks, lf_tensor *x)
{
    const lf_light_geometry *rays = blocks->rays;
    lf_tensor *n = lf_blocks_invariants(tape, &blocks->types, x);
    lf_tensor *share = lf_tensor_new(tape, 3, LF_DIMS(rays->rays, rays->samples, 1));
    for (long i = 0; i < share->size; i++)
        share->value[i] = rays->count->value[i] / (lf_real)rays->views - (lf_real)0.5;
    lf_tensor *s = lf_blocks_of_points(tape, blocks, share);
    lf_tensor *parts[] = {
        lf_reshape(tape, n, 2, LF_DIMS(blocks->blocks, n->dim[2] * LF_BLOCK_POINTS)),
        lf_reshape(tape, s, 2, LF_DIMS(blocks->blocks, LF_BLOCK_POINTS))};
    return lf_reshape(tape, lf_concat(tape, 2, parts), 4,
                      LF_DIMS(blocks->blocks, 1, n->dim[2] + 1, LF_BLOCK_POINTS));
}

static lf_tensor *density(lf_tape *tape, const lf_ray_equivariant *net, const lf_blocks *blocks,
                          lf_tensor *x)
{
    lf_tensor *y = lf_blocks_gated(tape, &blocks->types, x, lf_param(tape, net->gated.gate.weight),
                                   lf_param(tape, net->gated.gate.bias));
    x = lf_add(tape, x, lf_blocks_map(tape, &blocks->types, &net->mix, y));
    lf_tensor *t = lf_blocks_mlp(tape, &net->density, density_inputs(tape, blocks, x));
    return lf_density(tape, lf_blocks_rows(tape, blocks, t), blocks->rays->count);
}

lf_radiance lf_ray_equivariant_apply(lf_tape *tape, const lf_ray_equivariant *net,
                                     const lf_ray_inputs *in)
{
    const lf_light_geometry *rays = in->geometry;
    LF_REQUIRE(rays->types.count == net->config.types.count &&
                   rays->types.more == net->config.types.more &&
                   lf_cols(in->seen) == net->config.inputs,
               "ray_equivariant: %d types, %ld numbers a view, not %d and %ld", rays->types.count,
               lf_cols(in->seen), net->config.types.count, net->config.inputs);
    lf_scope(tape, "blocks");
    const lf_blocks blocks = lf_blocks_make(tape, rays);
    lf_tensor *f = lf_blocks_of_views(tape, &blocks, in->seen);
    lf_scope_end(tape);
    lf_scope(tape, "ray convolution");
    lf_tensor *x = lf_blocks_convolution(tape, &blocks, &net->convolution, f, true);
    x = norm(tape, net, 0, x);
    lf_scope_end(tape);
    lf_scope(tape, "cross attention");
    const lf_attended a = lf_blocks_cross(tape, &blocks, &net->cross, f, x);
    x = norm(tape, net, 1, a.field);
    lf_scope_end(tape);
    lf_scope(tape, "along ray");
    if (net->config.along_ray)
        x = norm(tape, net, 2, lf_add(tape, x, lf_blocks_along(tape, &blocks, &net->along, x)));
    lf_scope_end(tape);
    lf_scope(tape, "readout");
    const lf_radiance radiance = {lf_blend_columns(tape, a.weight, in->seen, LF_RGB),
                                  density(tape, net, &blocks, x)};
    lf_scope_end(tape);
    return radiance;
}

double lf_ray_equivariant_macs(const lf_ray_equivariant *net, long samples, long views)
{
    const lf_ray_equivariant_config *config = &net->config;
    const lf_types *types = &config->types;
    const double c = (double)config->channels, hidden = (double)config->hidden;
    const double row = (double)lf_types_planes(types) * c,
                 gates = (double)lf_types_gates(types) * c;
    const double scalars = (double)lf_types_scalars(types) * c, others = row - scalars;
    const double kernel =
        (double)config->inputs * row + scalars + 3 * others + (3 + gates) * hidden;
    const double map = lf_types_products(types) * c * c; /* from C to C channels */
    const double update = 4 * map + 4 * gates * gates;
    const double view = 3 * kernel + 2 * update + 2 * row;
    const double pair = 4 * scalars + 6 * others;
    const double along = 4 * map + (double)samples * pair;
    const double point = 6 * map + gates * gates + (gates + 1 + DENSITY_WIDTH + 1) * DENSITY_WIDTH;
    return (double)views * view + point + (config->along_ray ? along : 0);
}
