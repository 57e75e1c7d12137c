/* op_shape.c: concat, reshape, row views, group-wise addition, sum.
 *
 *   concat      y[.., a + b + ..] = parts side by side
 *   add_group   y[q, v, ..] = x[q, v, ..] + g[q, ..]      dg[q] += sum_v dy[q, v]
 *   sum         y = sum of all x
 *
 * reshape and rows_view copy nothing: value and grad are the same memory, so there is no backward.
 */
#include <omp.h>

#include "autograd/ops.h"

enum { PARALLEL = 32768 }; /* numbers that pay for waking the threads */

static void concat_backward(const lf_node *node)
{
    const lf_tensor *y = node->out[0];
    const long cols = lf_cols(y), rows = lf_rows(y);
    long at = 0;
    for (int k = 0; k < node->n_in; k++) {
        lf_tensor *x = node->in[k];
        const long n = lf_cols(x);
#pragma omp parallel for schedule(static) if (x->size > PARALLEL && !omp_in_parallel())
        for (long r = 0; r < (x->grad ? rows : 0); r++)
            for (long i = 0; i < n; i++)
                x->grad[r * n + i] += y->grad[r * cols + at + i];
        at += n;
    }
}

lf_tensor *lf_concat(lf_tape *tape, int count, lf_tensor *const *parts)
{
    LF_REQUIRE(count >= 1 && count <= LF_MAX_IN, "lf_concat: %d parts", count);
    long cols = 0, at = 0;
    for (int k = 0; k < count; k++) {
        LF_REQUIRE(lf_rows(parts[k]) == lf_rows(parts[0]),
                   "lf_concat: part %d has %ld rows, not %ld", k, lf_rows(parts[k]),
                   lf_rows(parts[0]));
        cols += lf_cols(parts[k]);
    }
    lf_tensor *y = lf_tensor_cols(tape, parts[0], cols);
    for (int k = 0; k < count; k++) {
        const long n = lf_cols(parts[k]), rows = lf_rows(y);
#pragma omp parallel for schedule(static) if (rows * n > PARALLEL && !omp_in_parallel())
        for (long r = 0; r < rows; r++)
            memcpy(y->value + r * cols + at, parts[k]->value + r * n, (size_t)n * sizeof(lf_real));
        at += n;
    }
    lf_record(tape, "concat", concat_backward, NULL, count, parts, LF_OUT(y));
    return y;
}

lf_tensor *lf_reshape(lf_tape *tape, lf_tensor *x, int rank, const long *dim)
{
    lf_tensor *y = lf_view(tape, x, 0, rank, dim);
    LF_REQUIRE(y->size == x->size, "lf_reshape: %ld numbers into %ld", x->size, y->size);
    return y;
}

lf_tensor *lf_rows_view(lf_tape *tape, lf_tensor *x, long from, long count)
{
    LF_REQUIRE(x->rank >= 1 && from >= 0 && from + count <= x->dim[0],
               "lf_rows_view: rows %ld to %ld of %ld", from, from + count, x->dim[0]);
    const long row = x->dim[0] ? x->size / x->dim[0] : 0;
    long dim[LF_MAX_RANK] = {count};
    for (int i = 1; i < x->rank; i++)
        dim[i] = x->dim[i];
    return lf_view(tape, x, from * row, x->rank, dim);
}

static void add_group_backward(const lf_node *node)
{
    lf_tensor *x = node->in[0], *g = node->in[1];
    const lf_real *dy = node->out[0]->grad;
    const long n = g->size / g->dim[0], views = x->dim[1];
    for (long i = 0; x->grad && i < x->size; i++)
        x->grad[i] += dy[i];
    for (long q = 0; g->grad && q < g->dim[0]; q++)
        for (long v = 0; v < views; v++)
            for (long i = 0; i < n; i++)
                g->grad[q * n + i] += dy[(q * views + v) * n + i];
}

lf_tensor *lf_add_group(lf_tape *tape, lf_tensor *x, lf_tensor *y)
{
    LF_REQUIRE(x->rank >= 2 && x->dim[0] == y->dim[0] && y->size * x->dim[1] == x->size,
               "lf_add_group: x [%ld, %ld, ..] of %ld, y [%ld, ..] of %ld", x->dim[0], x->dim[1],
               x->size, y->dim[0], y->size);
    lf_tensor *out = lf_tensor_like(tape, x);
    const long n = y->size / y->dim[0], views = x->dim[1];
    for (long q = 0; q < x->dim[0]; q++)
        for (long v = 0; v < views; v++)
            for (long i = 0; i < n; i++)
                out->value[(q * views + v) * n + i] =
                    x->value[(q * views + v) * n + i] + y->value[q * n + i];
    lf_record(tape, "add_group", add_group_backward, NULL, LF_IN(x, y), LF_OUT(out));
    return out;
}

static void sum_backward(const lf_node *node)
{
    lf_tensor *x = node->in[0];
    const lf_real dy = node->out[0]->grad[0];
    for (long i = 0; i < x->size; i++)
        x->grad[i] += dy;
}

lf_tensor *lf_sum(lf_tape *tape, lf_tensor *x)
{
    lf_tensor *y = lf_tensor_new(tape, 0, NULL);
    double sum = 0;
    for (long i = 0; i < x->size; i++)
        sum += (double)x->value[i];
    y->value[0] = (lf_real)sum;
    lf_record(tape, "sum", sum_backward, NULL, LF_IN(x), LF_OUT(y));
    return y;
}
