/* c8_conv.c: convolution over regular fields, and its layer.    [c8.h; method.md 5a.1, 4.9]
 *
 *   forward    y = x * W,  W the filter of the weights w (c8_expand.c)
 *   backward   dW = adjoint in W of dy, dw += what folds back from it;  dx += adjoint in x of dy
 *
 * Keeps      x and w. W is made anew for dx: all filters of a network together are larger than its
 *            maps, and expanding one takes a tenth of the product's time.
 * Cost       that of conv2d, and 2 count flops a number of W forward and for each of dw and dx.
 */
#include "layers/c8.h"

typedef struct kept {
    lf_conv shape;
    lf_c8_filter filter;
} kept;

static void expand(lf_tape *tape, const kept *k, const lf_tensor *w, lf_real *f)
{
    const lf_mark mark = lf_tape_mark(tape);
    lf_c8_expand(&k->filter, w->value, f, lf_alloc_reals(tape, lf_c8_filter_scratch(&k->filter)));
    lf_tape_release(tape, mark);
}

/* With room for the filter's gradient. */
static void add_dw(lf_tape *tape, const kept *k, const lf_tensor *x, const lf_tensor *w,
                   const lf_real *dy, lf_real *df)
{
    const lf_mark mark = lf_tape_mark(tape);
    memset(df, 0, (size_t)lf_c8_filter_size(&k->filter) * sizeof *df);
    lf_kernel_conv_dw(&k->shape, x->value, dy, df, NULL,
                      lf_alloc_reals(tape, lf_conv_dw_scratch(&k->shape)));
    lf_tape_release(tape, mark);
    lf_c8_fold(&k->filter, df, w->grad, lf_alloc_reals(tape, lf_c8_filter_scratch(&k->filter)));
    lf_tape_release(tape, mark);
}

static void backward(const lf_node *node)
{
    const kept *k = node->saved;
    lf_tape *tape = node->tape;
    const lf_tensor *x = node->in[0], *w = node->in[1];
    const lf_real *dy = node->out[0]->grad;
    lf_real *f = lf_scratch_reals(tape, lf_c8_filter_size(&k->filter));
    if (w->grad)
        add_dw(tape, k, x, w, dy, f);
    if (!x->grad)
        return;
    expand(tape, k, w, f);
    lf_kernel_conv_dx(&k->shape, dy, f, x->grad,
                      lf_scratch_reals(tape, lf_conv_scratch(&k->shape)));
}

lf_tensor *lf_c8_conv2d(lf_tape *tape, const lf_c8_basis *basis, lf_tensor *x, lf_tensor *w,
                        long stride)
{
    const lf_c8_filter filter = lf_c8_filter_of(basis, w);
    LF_REQUIRE(x->rank == 4 && x->dim[3] == filter.in * filter.turns,
               "lf_c8_conv2d: x of rank %d with %ld channels for %ld fields of %ld", x->rank,
               lf_cols(x), filter.in, filter.turns);
    kept *k = lf_alloc(tape, sizeof *k);
    *k = (kept){lf_conv_shape(x->dim[0], x->dim[1], x->dim[2], x->dim[3], filter.out * LF_C8,
                              filter.size, stride, filter.size / 2),
                filter};
    const lf_conv *s = &k->shape;
    lf_tensor *y = lf_tensor_new(tape, 4, LF_DIMS(s->images, s->out_height, s->out_width, s->out));
    const lf_mark mark = lf_tape_mark(tape);
    lf_real *f = lf_alloc_reals(tape, lf_c8_filter_size(&filter));
    expand(tape, k, w, f);
    lf_kernel_conv(s, x->value, f, NULL, LF_IDENTITY, y->value,
                   lf_alloc_reals(tape, lf_conv_scratch(s)));
    lf_tape_release(tape, mark);
    const double pixels = (double)(s->images * s->out_height * s->out_width);
    lf_products_of(tape, pixels * (double)lf_c8_filter_size(&filter), x, w);
    lf_record(tape, "c8_conv2d", backward, k, LF_IN(x, w), LF_OUT(y));
    return y;
}

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
    return lf_c8_conv2d(tape, &layer->basis, x, lf_param(tape, layer->weight), layer->stride);
}
