/* op_gather_rows.c: rows by number.                                                [method.md 5d.1]
 *
 *   forward    y[q] = x[row_q]
 *   backward   dx[s] += sum over q with row_q = s of dy[q], in the order of q
 *
 * Shapes     x [S, C], row [Q]; y [Q, C].
 * Keeps      the numbers of the rows (the caller's, until backward).
 * Threads    forward over q, backward over s: the same bits for any number of threads.
 */
#include "autograd/ops.h"

static void backward(const lf_node *node)
{
    const long *row = node->saved;
    const lf_tensor *y = node->out[0];
    lf_tensor *x = node->in[0];
    const long c = lf_cols(x);
#pragma omp parallel for schedule(static)
    for (long s = 0; s < x->dim[0]; s++)
        for (long q = 0; q < y->dim[0]; q++)
            for (long i = 0; row[q] == s && i < c; i++)
                x->grad[s * c + i] += y->grad[q * c + i];
}

lf_tensor *lf_gather_rows(lf_tape *tape, lf_tensor *x, long count, const long *row)
{
    LF_REQUIRE(x->rank == 2, "lf_gather_rows: rank %d", x->rank);
    for (long q = 0; q < count; q++)
        LF_REQUIRE(row[q] >= 0 && row[q] < x->dim[0], "lf_gather_rows: row %ld of %ld", row[q],
                   x->dim[0]);
    const long c = lf_cols(x);
    lf_tensor *y = lf_tensor_new(tape, 2, LF_DIMS(count, c));
    for (long q = 0; q < count; q++)
        memcpy(y->value + q * c, x->value + row[q] * c, (size_t)c * sizeof(lf_real));
    lf_record(tape, "gather_rows", backward, (void *)(uintptr_t)row, LF_IN(x), LF_OUT(y));
    return y;
}
