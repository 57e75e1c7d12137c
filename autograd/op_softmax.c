/* op_softmax.c: y = softmax(x) along the last axis, over the entries a mask allows  [method.md 4.6]
 *
 *   forward    y_i = k_i exp(x_i - m) / sum_j k_j exp(x_j - m),   m = max over entries with k = 1
 *   backward   dx_i += y_i (g_i - sum_j y_j g_j),  g = dy less that of the largest y: where that
 *              is nearly 1 the others keep their digits, and its own gradient is made of theirs
 *
 * Shapes     x, y, mask k: [.., n], n >= 1; the mask may be absent.
 * Keeps      y only.
 * Degenerate a row with no entry allowed gives zeros, not NaN.
 */
#include "autograd/ops.h"

static void forward_row(long n, const lf_real *x, const lf_real *mask, lf_real *y)
{
    lf_real largest = -INFINITY, sum = 0;
    for (long i = 0; i < n; i++)
        if (!mask || mask[i] > 0)
            largest = x[i] > largest ? x[i] : largest;
    for (long i = 0; i < n; i++) {
        y[i] = !mask || mask[i] > 0 ? LF_EXP(x[i] - largest) : 0;
        sum += y[i];
    }
    for (long i = 0; sum > 0 && i < n; i++)
        y[i] /= sum; /* sum >= 1: the largest term is exp(0) */
}

static void backward_row(long n, const lf_real *y, const lf_real *dy, lf_real *restrict dx)
{
    lf_real pull = 0;
    long top = 0;
    for (long i = 1; i < n; i++)
        top = y[i] > y[top] ? i : top;
    for (long i = 0; i < n; i++)
        pull += y[i] * (dy[i] - dy[top]);
    for (long i = 0; i < n; i++)
        dx[i] += y[i] * (dy[i] - dy[top] - pull);
}

static void backward(const lf_node *node)
{
    const lf_tensor *y = node->out[0];
    const long n = lf_cols(y);
    for (long r = 0; r < lf_rows(y); r++)
        backward_row(n, y->value + r * n, y->grad + r * n, node->in[0]->grad + r * n);
}

lf_tensor *lf_softmax(lf_tape *tape, lf_tensor *x, const lf_tensor *mask)
{
    LF_REQUIRE(x->rank >= 1 && lf_cols(x) >= 1, "lf_softmax: x has rank %d", x->rank);
    LF_REQUIRE(!mask || mask->size == x->size, "lf_softmax: mask of %ld for x of %ld", mask->size,
               x->size);
    lf_tensor *y = lf_tensor_like(tape, x);
    const long n = lf_cols(x);
    for (long r = 0; r < lf_rows(x); r++)
        forward_row(n, x->value + r * n, mask ? mask->value + r * n : NULL, y->value + r * n);
    lf_record(tape, "softmax", backward, NULL, LF_IN(x), LF_OUT(y));
    return y;
}
