/* linear.c: linear maps, self-interaction (equivariant linear maps), MLP.          [method.md 1.7]
 */
#include "layers/layers.h"

void lf_linear_init(lf_store *store, lf_linear_layer *layer, const char *prefix, long in, long out,
                    bool bias, double gain)
{
    char name[160];
    snprintf(name, sizeof name, "%s.weight", prefix);
    const double deviation = gain / sqrt(3 * (double)(in > 0 ? in : 1));
    layer->weight = lf_store_add(store, name, 2, LF_DIMS(in, out), 0, deviation, true);
    snprintf(name, sizeof name, "%s.bias", prefix);
    layer->bias = bias ? lf_store_add(store, name, 1, LF_DIMS(out), 0, 0, true) : NULL;
}

lf_tensor *lf_linear_apply(lf_tape *tape, const lf_linear_layer *layer, lf_tensor *x,
                           lf_activation act)
{
    return lf_linear(tape, x, lf_param(tape, layer->weight),
                     layer->bias ? lf_param(tape, layer->bias) : NULL, act);
}

void lf_self_interaction_init(lf_store *store, lf_self_interaction *layer, const char *prefix,
                              long in0, long in1, long out0, long out1)
{
    char name[128];
    snprintf(name, sizeof name, "%s.scalar", prefix);
    lf_linear_init(store, &layer->scalar, name, in0, out0, true, 1);
    layer->has_vector = in1 > 0 && out1 > 0;
    if (!layer->has_vector)
        return;
    snprintf(name, sizeof name, "%s.vector", prefix);
    lf_linear_init(store, &layer->vector, name, in1, out1, false, 1);
}

lf_field lf_self_interaction_apply(lf_tape *tape, const lf_self_interaction *layer, lf_field x)
{
    lf_field y = {lf_linear_apply(tape, &layer->scalar, x.scalar, LF_IDENTITY), NULL};
    if (layer->has_vector)
        y.vector = lf_linear_apply(tape, &layer->vector, x.vector, LF_IDENTITY);
    return y;
}

void lf_mlp_init(lf_store *store, lf_mlp *mlp, const char *prefix, long in, int widths,
                 const long *width, long out)
{
    LF_REQUIRE(widths + 1 <= LF_MLP_MAX, "an MLP of %d layers", widths + 1);
    mlp->count = widths + 1;
    mlp->act = LF_RELU;
    for (int i = 0; i < mlp->count; i++) {
        char name[128];
        snprintf(name, sizeof name, "%s.%d", prefix, i);
        const long to = i < widths ? width[i] : out;
        lf_linear_init(store, &mlp->layer[i], name, in, to, true, 1);
        in = to;
    }
}

lf_tensor *lf_mlp_apply(lf_tape *tape, const lf_mlp *mlp, lf_tensor *x)
{
    for (int i = 0; i < mlp->count; i++)
        x = lf_linear_apply(tape, &mlp->layer[i], x, i + 1 < mlp->count ? mlp->act : LF_IDENTITY);
    return x;
}

double lf_mlp_macs(const lf_mlp *mlp)
{
    double macs = 0;
    for (int i = 0; i < mlp->count; i++)
        macs += (double)mlp->layer[i].weight->size;
    return macs;
}
