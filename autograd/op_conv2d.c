/* op_conv2d.c: y = act(x * w + b), a correlation with zero padding.            [ops_image.h]
 *
 *   forward    y[n,i,j,o] =
 *                act(b[o] + sum_{p,q,c} x[n, i s + p - pad, j s + q - pad, c] w[p,q,c,o])
 *   backward   g = dy where the activation passes;  dx += adjoint in x of g,
 *              dw += adjoint in w of g,  db += sum over images and pixels of g
 *
 * Keeps      x, w, and y (for the activation's mask).
 * Cost       2 k k Ci Co flops an output pixel forward, and for each of dx and dw.
 */
#include "autograd/ops_image.h"

static lf_conv shape_of(const lf_tensor *x, const lf_tensor *w, long stride, long pad)
{
    return lf_conv_shape(x->dim[0], x->dim[1], x->dim[2], x->dim[3], w->dim[3], w->dim[0], stride,
                         pad);
}

typedef struct kept {
    lf_conv shape;
    lf_activation act;
} kept;

/* The gradient behind the activation, in the place of that of y, which nobody reads after this. */
static const lf_real *behind(const lf_tensor *y, lf_activation act)
{
    const long images = y->dim[0], n = y->size / (images ? images : 1);
#pragma omp parallel for schedule(static)
    for (long i = 0; i < images; i++)
        lf_kernel_activation_dz(n, act, y->value + i * n, y->grad + i * n, y->grad + i * n);
    return y->grad;
}

static void backward(const lf_node *node)
{
    const kept *k = node->saved;
    const lf_tensor *y = node->out[0];
    lf_tensor *x = node->in[0], *w = node->in[1], *b = node->in[2];
    const lf_real *g = k->act == LF_IDENTITY ? y->grad : behind(y, k->act);
    lf_real *scratch = lf_alloc_reals(node->tape, lf_conv_scratch(&k->shape));
    if (w->grad)
        lf_kernel_conv_dw(&k->shape, x->value, g, w->grad, b ? b->grad : NULL, scratch);
    if (x->grad)
        lf_kernel_conv_dx(&k->shape, g, w->value, x->grad, scratch);
}

lf_tensor *lf_conv2d(lf_tape *tape, lf_tensor *x, lf_tensor *w, lf_tensor *b, long stride, long pad,
                     lf_activation act)
{
    LF_REQUIRE(x->rank == 4 && w->rank == 4, "lf_conv2d: x of rank %d and w of rank %d, need 4",
               x->rank, w->rank);
    LF_REQUIRE(w->dim[0] == w->dim[1] && w->dim[2] == x->dim[3],
               "lf_conv2d: x has %ld channels, w is [%ld,%ld,%ld,%ld]", x->dim[3], w->dim[0],
               w->dim[1], w->dim[2], w->dim[3]);
    LF_REQUIRE(!b || b->size == w->dim[3], "lf_conv2d: %ld biases for %ld outputs", b->size,
               w->dim[3]);
    LF_REQUIRE(!b || !b->wants || w->wants,
               "lf_conv2d: a bias with gradient needs a filter with one");
    kept *k = lf_alloc(tape, sizeof *k);
    *k = (kept){shape_of(x, w, stride, pad), act};
    const lf_conv *s = &k->shape;
    lf_tensor *y = lf_tensor_new(tape, 4, LF_DIMS(s->images, s->out_height, s->out_width, s->out));
    const lf_mark mark = lf_tape_mark(tape);
    lf_real *scratch = lf_alloc_reals(tape, lf_conv_scratch(s));
    const bool fused = lf_activation_fused(act);
    lf_kernel_conv(s, x->value, w->value, b ? b->value : NULL, fused ? act : LF_IDENTITY, y->value,
                   scratch);
    lf_tape_release(tape, mark);
    const long n = y->size / (s->images ? s->images : 1);
#pragma omp parallel for schedule(static)
    for (long i = 0; i < (fused ? 0 : s->images); i++)
        lf_kernel_activate(n, act, y->value + i * n);
    const double pixels = (double)(s->images * s->out_height * s->out_width);
    lf_products_of(tape, pixels * (double)w->size, x, w);
    lf_record(tape, "conv2d", backward, k, LF_IN(x, w, b), LF_OUT(y));
    return y;
}
