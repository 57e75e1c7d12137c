/* ibrnet.c: see ibrnet.h. */
#include "models/ibrnet.h"

enum { DIRECTIONS = 4, HEADS = 4, DENSITY = 16 };

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
    char full[160];
    net->sharpness = constant(store, prefix, "sharpness", 1, 0.2);
    lf_ibrnet_aggregation_init(store, &net->views, prefix, DIRECTIONS, f, n);
    lf_ibrnet_maps_init(store, net->colour, prefix, "colour", 3,
                        LF_DIMS(LF_IBRNET_FEATURES + 1 + DIRECTIONS, 16, 8, 1), LF_IBRNET_KAIMING);
    transformer_init(store, net, prefix);
    snprintf(full, sizeof full, "%s.density", prefix);
    lf_mlp_init(store, &net->density, full, n, 1, LF_DIMS(DENSITY), 1);
    net->density.act = LF_ELU;
    if (config->softplus)
        lf_values(net->density.layer[1].bias)[0] = -2;
}

/* ---- apply -------------------------------------------------------------------------------------
 */

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

static lf_tensor *density(lf_tape *tape, const lf_ibrnet *net, lf_tensor *point,
                          const lf_lanes *lanes, const lf_tensor *count)
{
    lf_tensor *x = lf_lanes_to_rows(tape, point, lanes);
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

static lf_tensor *colour(lf_tape *tape, const lf_ibrnet *net, const lf_ibrnet_aggregated *views,
                         lf_tensor *turned, lf_tensor *seen, const lf_lanes *lanes)
{
    const lf_linear_layer *layer = net->colour;
    lf_tensor *parts[] = {views->view, views->visibility, turned};
    lf_tensor *h = lf_lanes_linear(tape, 3, parts, lf_param(tape, layer[0].weight),
                                   lf_param(tape, layer[0].bias), NULL, lanes, LF_ELU);
    h = lf_ibrnet_map(tape, &layer[1], h, lanes, LF_ELU);
    return lf_ibrnet_colour(tape, lf_ibrnet_map(tape, &layer[2], h, lanes, LF_IDENTITY), seen,
                            lanes);
}

lf_radiance lf_ibrnet_apply(lf_tape *tape, const lf_ibrnet *net, const lf_ray_inputs *in)
{
    LF_REQUIRE(in->difference && lf_cols(in->seen) == net->config.inputs,
               "IBRNet: %ld numbers a sample and view for %ld; differences: %s", lf_cols(in->seen),
               net->config.inputs, in->difference ? "given" : "missing");
    lf_scope(tape, "directions");
    const lf_lanes lanes = lf_lanes_make(tape, in->geometry->mask, in->difference);
    lf_tensor *turned = lf_leaf(tape, 3, lanes.difference->dim, lanes.difference->value, NULL);
    lf_tensor *w = lf_ibrnet_weights(tape, lf_param(tape, net->sharpness), &lanes);
    lf_scope_end(tape);
    const lf_ibrnet_aggregated x =
        lf_ibrnet_aggregate(tape, &net->views, in->seen, turned, w, &lanes);
    lf_scope(tape, "colour");
    lf_tensor *blend = colour(tape, net, &x, turned, in->seen, &lanes);
    lf_scope_end(tape);
    lf_scope(tape, "density");
    lf_tensor *sigma = density(tape, net, x.point, &lanes, in->geometry->count);
    lf_scope_end(tape);
    return (lf_radiance){blend, sigma};
}

double lf_ibrnet_macs(const lf_ibrnet *net, long samples, long views)
{
    const double n = (double)net->config.width;
    const double colour = (LF_IBRNET_FEATURES + 1 + DIRECTIONS) * 16 + 16 * 8 + 8 + 3;
    const double along = 4 * n * n + 2 * (double)samples * n + n * DENSITY + DENSITY;
    return (double)views * (lf_ibrnet_view_macs(&net->views) + colour) +
           lf_ibrnet_point_macs(&net->views) + along;
}
