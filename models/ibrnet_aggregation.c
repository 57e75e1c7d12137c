/* ibrnet_aggregation.c: see ibrnet_aggregation.h. */
#include "models/ibrnet_aggregation.h"

enum { BASE = 64, FEATURES = LF_IBRNET_FEATURES, DIRECTIONS = 16 };

void lf_ibrnet_maps_init(lf_store *store, lf_linear_layer *layer, const char *prefix,
                         const char *name, int count, const long *size, double gain)
{
    char full[160];
    for (int i = 0; i < count; i++) {
        snprintf(full, sizeof full, "%s.%s.%d", prefix, name, i);
        lf_linear_init(store, &layer[i], full, size[i], size[i + 1], true, gain);
    }
}

void lf_ibrnet_aggregation_init(lf_store *store, lf_ibrnet_aggregation *net, const char *prefix,
                                long directions, long inputs, long width)
{
    const double gain = LF_IBRNET_KAIMING;
    lf_ibrnet_maps_init(store, net->direction, prefix, "direction", 2,
                        LF_DIMS(directions, DIRECTIONS, inputs), 1);
    lf_ibrnet_maps_init(store, net->base, prefix, "base", 2, LF_DIMS(3 * inputs, BASE, FEATURES),
                        gain);
    lf_ibrnet_maps_init(store, net->visibility, prefix, "visibility", 2,
                        LF_DIMS(FEATURES, FEATURES, FEATURES + 1), gain);
    lf_ibrnet_maps_init(store, net->again, prefix, "again", 2, LF_DIMS(FEATURES, FEATURES, 1),
                        gain);
    lf_ibrnet_maps_init(store, net->point, prefix, "point", 2,
                        LF_DIMS(2 * FEATURES + 1, BASE, width), gain);
}

/* ---- apply ---- */

lf_tensor *lf_ibrnet_map(lf_tape *tape, const lf_linear_layer *layer, lf_tensor *x,
                         const lf_lanes *lanes, lf_activation act)
{
    return lf_lanes_linear(tape, 1, &x, lf_param(tape, layer->weight), lf_param(tape, layer->bias),
                           NULL, lanes, act);
}

static lf_tensor *two_maps(lf_tape *tape, const lf_linear_layer *layer, lf_tensor *x,
                           const lf_lanes *lanes, lf_activation last)
{
    x = lf_ibrnet_map(tape, layer, x, lanes, LF_ELU);
    return lf_ibrnet_map(tape, layer + 1, x, lanes, last);
}

/* Both maps of base; of the first, W [mean, variance, x] + b, the first two once a point. */
static lf_tensor *base_maps(lf_tape *tape, const lf_linear_layer *layer, lf_tensor *x,
                            lf_tensor *moments, const lf_lanes *lanes)
{
    const long f = x->dim[1], out = layer->weight->dim[1];
    lf_tensor *w = lf_param(tape, layer->weight);
    lf_tensor *of_moments = lf_view(tape, w, 0, 2, LF_DIMS(2 * f, out));
    lf_tensor *of_x = lf_view(tape, w, 2 * f * out, 2, LF_DIMS(f, out));
    lf_tensor *p = lf_lanes_linear(tape, 1, &moments, of_moments, lf_param(tape, layer->bias), NULL,
                                   lanes, LF_IDENTITY);
    x = lf_lanes_linear(tape, 1, &x, of_x, NULL, p, lanes, LF_ELU);
    return lf_ibrnet_map(tape, layer + 1, x, lanes, LF_ELU);
}

lf_ibrnet_aggregated lf_ibrnet_aggregate(lf_tape *tape, const lf_ibrnet_aggregation *net,
                                         lf_tensor *seen, lf_tensor *direction, lf_tensor *weight,
                                         const lf_lanes *lanes)
{
    lf_scope(tape, "directions");
    lf_tensor *f = lf_lanes_add_rows(
        tape, seen, two_maps(tape, net->direction, direction, lanes, LF_ELU), lanes);
    lf_scope_end(tape);
    lf_scope(tape, "base");
    lf_tensor *moments = lf_ibrnet_moments(tape, f, weight, lanes, false);
    lf_tensor *x = base_maps(tape, net->base, f, moments, lanes);
    lf_scope_end(tape);
    lf_scope(tape, "visibility");
    lf_tensor *r = two_maps(tape, net->visibility, lf_lanes_scale(tape, x, weight), lanes, LF_ELU);
    const lf_ibrnet_residual updated = lf_ibrnet_residual_apply(tape, x, r, lanes);
    const lf_ibrnet_visibility again = lf_ibrnet_visibility_apply(
        tape, two_maps(tape, net->again, updated.visible, lanes, LF_IDENTITY), lanes);
    lf_scope_end(tape);
    lf_scope(tape, "point");
    moments = lf_ibrnet_moments(tape, updated.x, again.weight, lanes, true);
    const lf_ibrnet_aggregated y = {updated.x, again.visibility,
                                    two_maps(tape, net->point, moments, lanes, LF_ELU)};
    lf_scope_end(tape);
    return y;
}

/* ---- cost ---- */

static double maps_macs(const lf_linear_layer *layer)
{
    return (double)(layer[0].weight->size + layer[1].weight->size);
}

/* Of base's first matrix a view has a third. */
double lf_ibrnet_view_macs(const lf_ibrnet_aggregation *net)
{
    const double f = (double)net->direction[1].weight->dim[1];
    const double moments = 2 * 2 * (f + FEATURES); /* mean and variance */
    return maps_macs(net->direction) + maps_macs(net->base) - 2 * f * BASE +
           maps_macs(net->visibility) + maps_macs(net->again) + moments;
}

double lf_ibrnet_point_macs(const lf_ibrnet_aggregation *net)
{
    return 2 * (double)net->direction[1].weight->dim[1] * BASE + maps_macs(net->point);
}
