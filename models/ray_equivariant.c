/* ray_equivariant.c: see ray_equivariant.h. */
#include "models/ray_equivariant.h"

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
    const long c = config->channels, invariants = types->count * c;
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
    return gain ? lf_so2_layer_norm(tape, &net->config.types, x, lf_param(tape, gain)) : x;
}

/* Views that see a sample over all views, less a half: [N, S, 1]. */
static lf_tensor *view_share(lf_tape *tape, const lf_light_geometry *rays)
{
    lf_tensor *share = lf_tensor_new(tape, 3, LF_DIMS(rays->rays, rays->samples, 1));
    for (long i = 0; i < share->size; i++)
        share->value[i] = rays->count->value[i] / (lf_real)rays->views - (lf_real)0.5;
    return share;
}

static lf_tensor *density(lf_tape *tape, const lf_ray_equivariant *net, lf_tensor *x,
                          const lf_light_geometry *rays)
{
    const lf_types *types = &net->config.types;
    lf_tensor *y =
        lf_so2_map_apply(tape, &net->mix, types, lf_so2_gated_apply(tape, &net->gated, types, x));
    lf_tensor *parts[] = {lf_so2_invariants(tape, types, lf_add(tape, x, y)),
                          view_share(tape, rays)};
    lf_tensor *t = lf_mlp_apply(tape, &net->density, lf_concat(tape, 2, parts));
    return lf_density(tape, t, rays->count);
}

lf_radiance lf_ray_equivariant_apply(lf_tape *tape, const lf_ray_equivariant *net,
                                     const lf_ray_inputs *in)
{
    const lf_light_geometry *rays = in->geometry;
    LF_REQUIRE(rays->types.count == net->config.types.count &&
                   lf_cols(in->seen) == net->config.inputs,
               "ray_equivariant: %d types, %ld numbers a view, not %d and %ld", rays->types.count,
               lf_cols(in->seen), net->config.types.count, net->config.inputs);
    lf_tensor *x = lf_ray_ray_convolution_apply(tape, &net->convolution, in->seen, rays);
    x = norm(tape, net, 0, x);
    const lf_attended a = lf_cross_attention_apply(tape, &net->cross, in->seen, x, rays);
    x = norm(tape, net, 1, a.field);
    if (net->config.along_ray)
        x = norm(tape, net, 2, lf_add(tape, x, lf_along_ray_apply(tape, &net->along, x, rays)));
    return (lf_radiance){lf_blend_columns(tape, a.weight, in->seen, LF_RGB),
                         density(tape, net, x, rays)};
}

/* Of a map within each type from ci to co channels: complex products are four real ones. */
static double map_macs(const lf_types *types, double ci, double co)
{
    return (1 + 4.0 * (types->count - 1)) * ci * co;
}

double lf_ray_equivariant_macs(const lf_ray_equivariant *net, long samples, long views)
{
    const lf_ray_equivariant_config *config = &net->config;
    const lf_types *types = &config->types;
    const double c = (double)config->channels, hidden = (double)config->hidden;
    const double row = (double)lf_types_planes(types) * c, gates = types->count * c;
    const double kernel = ((double)config->inputs + 3) * row + (3 + gates) * hidden;
    const double update = 2 * map_macs(types, c, 2 * c) + 4 * gates * gates;
    const double view = 3 * kernel + 2 * update + 2 * row;
    const double pair = 2 * (2 * row + row);
    const double along = 4 * map_macs(types, c, c) + (double)samples * pair;
    const double point = map_macs(types, c, c) + 2 * map_macs(types, c, 2 * c) + gates * gates +
                         map_macs(types, c, c) + (gates + 1 + DENSITY_WIDTH + 1) * DENSITY_WIDTH;
    return (double)views * view + point + (config->along_ray ? along : 0);
}
