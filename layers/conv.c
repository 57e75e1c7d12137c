/* conv.c: the ordinary convolution layer. */
#include "layers/conv.h"

void lf_conv_layer_init(lf_store *store, const char *prefix, int in, int out, int size, int stride,
                        bool bias, int fan, lf_conv_layer *layer)
{
    LF_REQUIRE(size % 2 == 1, "a filter of even size %d", size);
    const double inputs = fan ? (double)fan : (double)size * size * in;
    char name[96];
    *layer = (lf_conv_layer){.stride = stride};
    snprintf(name, sizeof name, "%s.weight", prefix);
    layer->weight =
        lf_store_add(store, name, 4, LF_DIMS(size, size, in, out), 0, sqrt(2 / inputs), true);
    snprintf(name, sizeof name, "%s.bias", prefix);
    if (bias)
        layer->bias = lf_store_add(store, name, 1, LF_DIMS(out), 0, 0, true);
}

lf_tensor *lf_conv_layer_forward(lf_tape *tape, const lf_conv_layer *layer, lf_tensor *x)
{
    lf_tensor *bias = layer->bias ? lf_param(tape, layer->bias) : NULL;
    return lf_conv2d(tape, x, lf_param(tape, layer->weight), bias, layer->stride,
                     layer->weight->dim[0] / 2, LF_IDENTITY);
}
