/* c8_conv.c: the convolution layer over regular fields.                [c8.h; method.md 5a.1] */
#include "layers/c8.h"

void lf_c8_conv_init(lf_store *store, const char *prefix, bool lift, int in, int out, int size,
                     int stride, lf_c8_cutoff cutoff, lf_c8_conv *layer)
{
    *layer = (lf_c8_conv){.stride = stride};
    lf_c8_basis_init(&layer->basis, size, cutoff);
    const int count = layer->basis.count, turns = lift ? 1 : LF_C8;
    const double deviation = sqrt(2.0 / ((double)in * count * turns));
    char name[96];
    snprintf(name, sizeof name, "%s.weight", prefix);
    layer->weight =
        lift ? lf_store_add(store, name, 3, LF_DIMS(out, in, count), 0, deviation, true)
             : lf_store_add(store, name, 4, LF_DIMS(out, in, LF_C8, count), 0, deviation, true);
}

void lf_c8_conv_free(lf_c8_conv *layer)
{
    lf_c8_basis_free(&layer->basis);
}

lf_tensor *lf_c8_conv_forward(lf_tape *tape, const lf_c8_conv *layer, lf_tensor *x)
{
    lf_tensor *filter = lf_c8_expand(tape, &layer->basis, lf_param(tape, layer->weight));
    return lf_conv2d(tape, x, filter, NULL, layer->stride, layer->basis.size / 2, LF_IDENTITY);
}
