/* conv.h: the ordinary convolution layer, whose filter is a parameter. */
#ifndef LF_LAYERS_CONV_H
#define LF_LAYERS_CONV_H

#include "autograd/autograd.h"
#include "autograd/ops_image.h"

typedef struct lf_conv_layer {
    const lf_parameter *weight; /* [size, size, in, out] */
    const lf_parameter *bias;   /* [out], or NULL */
    int stride;
} lf_conv_layer;

/* Registers prefix.weight with standard deviation sqrt(2 / fan) and, with `bias`, prefix.bias (0).
 * fan is what one output sums up; 0 stands for size * size * in. */
void lf_conv_layer_init(lf_store *store, const char *prefix, int in, int out, int size, int stride,
                        bool bias, int fan, lf_conv_layer *layer);
/* Zero padding size / 2: x [N, H, W, in] -> [N, ceil(H / stride), ceil(W / stride), out]. */
lf_tensor *lf_conv_layer_forward(lf_tape *tape, const lf_conv_layer *layer, lf_tensor *x);

#endif
