/* ibrnet.c: see ibrnet.h. */
#include "models/ibrnet.h"
#include "layers/ibrnet.h"

enum { BASE = 64, FEATURES = 32, HEADS = 4, DIRECTIONS = 16, DENSITY = 16 };

static void map_init(lf_store *store, lf_linear_layer *layer, const char *prefix, const char *name,
                     int count, const long *size, double gain)
{
    char full[160];
    for (int i = 0; i < count; i++) {
        snprintf(full, sizeof full, "%s.%s.%d", prefix, name, i);
        lf_linear_init(store, &layer[i], full, size[i], size[i + 1], true, gain);
    }
}

static const lf_parameter *constant(lf_store *store, const char *prefix, const char *name, long n,
                                    double value)
{
    char full[160];
    snprintf(full, sizeof full, "%s.%s", prefix, name);
    return lf_store_add(store, full, 1, &n, value, 0, true);
}

static void transformer_init(lf_store *store, lf_ibrnet *net, const char *prefix)
{
    static const char *const name[] = {"query", "key", "value", "join"};
    lf_linear_layer *const layer[] = {&net->query, &net->key, &net->value, &net->join};
    const long n = net->config.width;
    for (int i = 0; i < 4; i++) {
        char full[160];
        snprintf(full, sizeof full, "%s.%s", prefix, name[i]);
        lf_linear_init(store, layer[i], full, n, n, false, 1);
    }
    net->gain = constant(store, prefix, "gain", n, 1);
    net->bias = constant(store, prefix, "bias", n, 0);
}

void lf_ibrnet_init(lf_store *store, lf_ibrnet *net, const char *prefix,
                    const lf_ibrnet_config *config)
{
    const long f = config->inputs, n = config->width;
    LF_REQUIRE(f >= 3 && n >= HEADS && n % HEADS == 0, "IBRNet: %ld inputs, width %ld", f, n);
    *net = (lf_ibrnet){.config = *config};
    const double kaiming = sqrt(6); /* lf_linear_init's variance is gain^2 / (3 inputs) */
    char full[160];
    net->sharpness = constant(store, prefix, "sharpness", 1, 0.2);
    map_init(store, net->direction, prefix, "direction", 2, LF_DIMS(4, DIRECTIONS, f), 1);
    map_init(store, net->base, prefix, "base", 2, LF_DIMS(3 * f, BASE, FEATURES), kaiming);
    map_init(store, net->visibility, prefix, "visibility", 2,
             LF_DIMS(FEATURES, FEATURES, FEATURES + 1), kaiming);
    map_init(store, net->again, prefix, "again", 2, LF_DIMS(FEATURES, FEATURES, 1), kaiming);
    map_init(store, net->point, prefix, "point", 2, LF_DIMS(2 * FEATURES + 1, BASE, n), kaiming);
    map_init(store, net->colour, prefix, "colour", 3, LF_DIMS(FEATURES + 5, 16, 8, 1), kaiming);
    transformer_init(store, net, prefix);
    snprintf(full, sizeof full, "%s.density", prefix);
    lf_mlp_init(store, &net->density, full, n, 1, LF_DIMS(DENSITY), 1);
    net->density.act = LF_ELU;
    if (config->softplus)
        lf_values(net->density.layer[1].bias)[0] = -2;
}

/* ---- apply -------------------------------------------------------------------------------------
 */

static lf_tensor *map(lf_tape *tape, const lf_linear_layer *layer, lf_tensor *x,
                      const lf_lanes *lanes, lf_activation act)
{
    return lf_lanes_linear(tape, 1, &x, lf_param(tape, layer->weight), lf_param(tape, layer->bias),
                           NULL, lanes, act);
}

static lf_tensor *two_maps(lf_tape *tape, const lf_linear_layer *layer, lf_tensor *x,
                           const lf_lanes *lanes)
{
    return map(tape, layer + 1, map(tape, layer, x, lanes, LF_ELU), lanes, LF_ELU);
}

/* ELU(W [mean, variance, x] + b): the first two once a point. */
static lf_tensor *base_map(lf_tape *tape, const lf_linear_layer *layer, lf_tensor *x,
                           lf_tensor *moments, const lf_lanes *lanes)
{
    const long f = x->dim[1], out = layer->weight->dim[1];
    lf_tensor *w = lf_param(tape, layer->weight);
    lf_tensor *of_moments = lf_view(tape, w, 0, 2, LF_DIMS(2 * f, out));
    lf_tensor *of_x = lf_view(tape, w, 2 * f * out, 2, LF_DIMS(f, out));
    lf_tensor *p = lf_lanes_linear(tape, 1, &moments, of_moments, lf_param(tape, layer->bias), NULL,
                                   lanes, LF_IDENTITY);
    return lf_lanes_linear(tape, 1, &x, of_x, NULL, p, lanes, LF_ELU);
}

/* Position codes of all samples [N, S, n]: sin and cos of s / 10000^(2 k / n) side by side. */
static lf_tensor *position_code(lf_tape *tape, const lf_lanes *lanes, long n)
{
    lf_tensor *code = lf_tensor_new(tape, 3, LF_DIMS(lanes->rays, lanes->samples, n));
    const long one_ray = lanes->samples * n;
    for (long i = 0; i < n; i += 2) {
        const double turn = pow(10000, -(double)i / (double)n), c = cos(turn), s = sin(turn);
        double x = 1, y = 0; /* cos, sin of the sample's number times turn */
        for (long sample = 0; lanes->rays > 0 && sample < lanes->samples; sample++) {
            code->value[sample * n + i] = (lf_real)y;
            code->value[sample * n + i + 1] = (lf_real)x;
            const double next = c * x - s * y;
            y = s * x + c * y;
            x = next;
        }
    }
    for (long ray = 1; ray < lanes->rays; ray++)
        memcpy(code->value + ray * one_ray, code->value, (size_t)one_ray * sizeof(lf_real));
    return code;
}

/* x + join(attention), normalised. */
static lf_tensor *along_ray(lf_tape *tape, const lf_ibrnet *net, lf_tensor *x,
                            const lf_tensor *count)
{
    lf_scope(tape, "along ray");
    lf_tensor *q = lf_linear_apply(tape, &net->query, x, LF_IDENTITY);
    lf_tensor *k = lf_linear_apply(tape, &net->key, x, LF_IDENTITY);
    lf_tensor *v = lf_linear_apply(tape, &net->value, x, LF_IDENTITY);
    lf_tensor *heard = lf_sample_attention(tape, q, k, v, count, HEADS);
    heard = lf_linear_apply(tape, &net->join, heard, LF_IDENTITY);
    x = lf_layer_norm(tape, lf_add(tape, x, heard), lf_param(tape, net->gain),
                      lf_param(tape, net->bias));
    lf_scope_end(tape);
    return x;
}

static lf_tensor *density(lf_tape *tape, const lf_ibrnet *net, lf_tensor *moments,
                          const lf_lanes *lanes, const lf_tensor *count)
{
    lf_tensor *x = lf_lanes_to_rows(tape, two_maps(tape, net->point, moments, lanes), lanes);
    x = lf_add(tape, x, position_code(tape, lanes, net->config.width));
    lf_tensor *t = lf_mlp_apply(tape, &net->density, along_ray(tape, net, x, count));
    if (net->config.softplus)
        return lf_density(tape, t, count);
    lf_tensor *seen = lf_tensor_like(tape, count);
    for (long i = 0; i < seen->size; i++)
        seen->value[i] = (lf_real)(count->value[i] > 0);
    t = lf_reshape(tape, lf_relu(tape, t), 2, LF_DIMS(lanes->rays, lanes->samples));
    return lf_multiply(tape, t, seen);
}

static lf_tensor *colour(lf_tape *tape, const lf_ibrnet *net, lf_tensor *x, lf_tensor *visibility,
                         lf_tensor *turned, lf_tensor *seen, const lf_lanes *lanes)
{
    const lf_linear_layer *layer = net->colour;
    lf_tensor *parts[] = {x, visibility, turned};
    lf_tensor *h = lf_lanes_linear(tape, 3, parts, lf_param(tape, layer[0].weight),
                                   lf_param(tape, layer[0].bias), NULL, lanes, LF_ELU);
    h = map(tape, &layer[1], h, lanes, LF_ELU);
    return lf_ibrnet_colour(tape, map(tape, &layer[2], h, lanes, LF_IDENTITY), seen, lanes);
}

lf_radiance lf_ibrnet_apply(lf_tape *tape, const lf_ibrnet *net, const lf_ray_inputs *in)
{
    LF_REQUIRE(in->difference && lf_cols(in->seen) == net->config.inputs,
               "IBRNet: %ld numbers a sample and view for %ld; differences: %s", lf_cols(in->seen),
               net->config.inputs, in->difference ? "given" : "missing");
    lf_scope(tape, "directions");
    const lf_lanes lanes = lf_lanes_make(tape, in->geometry->mask, in->difference);
    lf_tensor *turned = lf_leaf(tape, 3, lanes.difference->dim, lanes.difference->value, NULL);
    lf_tensor *f =
        lf_lanes_add_rows(tape, in->seen, two_maps(tape, net->direction, turned, &lanes), &lanes);
    lf_scope_end(tape);
    lf_scope(tape, "base");
    lf_tensor *w = lf_ibrnet_weights(tape, lf_param(tape, net->sharpness), &lanes);
    lf_tensor *moments = lf_ibrnet_moments(tape, f, w, &lanes, false);
    lf_tensor *x =
        map(tape, &net->base[1], base_map(tape, &net->base[0], f, moments, &lanes), &lanes, LF_ELU);
    lf_scope_end(tape);
    lf_scope(tape, "visibility");
    lf_tensor *r = two_maps(tape, net->visibility, lf_lanes_scale(tape, x, w), &lanes);
    const lf_ibrnet_residual updated = lf_ibrnet_residual_apply(tape, x, r, &lanes);
    const lf_ibrnet_visibility seen = lf_ibrnet_visibility_apply(
        tape, two_maps(tape, net->again, updated.visible, &lanes), &lanes);
    moments = lf_ibrnet_moments(tape, updated.x, seen.weight, &lanes, true);
    lf_scope_end(tape);
    lf_scope(tape, "colour");
    lf_tensor *blend = colour(tape, net, updated.x, seen.visibility, turned, in->seen, &lanes);
    lf_scope_end(tape);
    lf_scope(tape, "density");
    lf_tensor *sigma = density(tape, net, moments, &lanes, in->geometry->count);
    lf_scope_end(tape);
    return (lf_radiance){blend, sigma};
}

double lf_ibrnet_macs(const lf_ibrnet *net, long samples, long views)
{
    const double f = (double)net->config.inputs, n = (double)net->config.width, c = FEATURES;
    const double directions = 4 * DIRECTIONS + DIRECTIONS * f, base = f * BASE + BASE * c;
    const double visibility = c * c + c * (c + 1) + c * c + c;
    const double moments = 2 * 2 * (f + c); /* mean and variance */
    const double colour = (c + 5) * 16 + 16 * 8 + 8 + 3;
    const double point = 2 * f * BASE + (2 * c + 1) * BASE + BASE * n;
    const double along = 4 * n * n + 2 * (double)samples * n + n * DENSITY + DENSITY;
    return (double)views * (directions + base + visibility + moments + colour) + point + along;
}
