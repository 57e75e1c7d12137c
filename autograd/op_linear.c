/* op_linear.c: y = act(x w + b).
 *
 *   backward   dz = act'(y) dy,  dx += dz w^T,  dw += x^T dz,  db += sum dz
 *
 * Shapes     x [.., in], w [in, out], b [out] or NULL, y [.., out].
 * Keeps      x and y.
 */
#include "autograd/ops.h"

enum { LONG = 8192 }; /* rows, more than tiles have: threads pay, and shorter sums round less */

/* The gradient behind the activation: dy itself, or a copy in the arena. */
static const lf_real *behind_activation(const lf_node *node)
{
    const lf_tensor *y = node->out[0];
    const lf_activation act = *(const lf_activation *)node->saved;
    if (act == LF_IDENTITY)
        return y->grad;
    lf_real *dz = lf_alloc_reals(node->tape, y->size);
    lf_kernel_activation_dz(y->size, act, y->value, y->grad, dz);
    return dz;
}

static void backward(const lf_node *node)
{
    const lf_tensor *x = node->in[0], *w = node->in[1], *b = node->in[2];
    const long rows = lf_rows(x), in = w->dim[0], out = w->dim[1];
    const lf_real *dz = behind_activation(node);
    if (x->grad)
        lf_kernel_linear_dx(rows, in, out, dz, w->value, x->grad);
    lf_real *db = b ? b->grad : NULL;
    if (w->grad && rows >= LONG)
        lf_kernel_linear_dw_lanes(rows, in, out, x->value, dz, w->grad, db,
                                  lf_alloc_reals(node->tape, lf_linear_dw_scratch(rows, in, out)));
    else if (w->grad)
        lf_kernel_linear_dw(rows, in, out, x->value, dz, w->grad, db);
}

lf_tensor *lf_linear(lf_tape *tape, lf_tensor *x, lf_tensor *w, lf_tensor *b, lf_activation act)
{
    LF_REQUIRE(w->rank == 2 && lf_cols(x) == w->dim[0] && (!b || b->size == w->dim[1]),
               "lf_linear: x [.., %ld], w [%ld, %ld], b [%ld]", lf_cols(x), w->dim[0], w->dim[1],
               b ? b->size : -1);
    LF_REQUIRE(!b || !b->wants || w->wants,
               "lf_linear: a bias with gradient needs a matrix with one");
    lf_tensor *y = lf_tensor_cols(tape, x, w->dim[1]);
    const bool fused = lf_activation_fused(act);
    lf_kernel_linear(lf_rows(x), w->dim[0], w->dim[1], x->value, w->value, b ? b->value : NULL,
                     fused ? act : LF_IDENTITY, y->value);
    if (!fused)
        lf_kernel_activate(y->size, act, y->value);
    lf_activation *saved = lf_alloc(tape, sizeof *saved);
    *saved = act;
    lf_products_of(tape, (double)x->size * (double)w->dim[1], x, w);
    lf_record(tape, "linear", backward, saved, LF_IN(x, w, b), LF_OUT(y));
    return y;
}
