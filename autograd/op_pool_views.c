/* op_pool_views.c: one row of the rows that several views (or pixels) give.        [method.md 5d.1]
 *
 *   mean   y[q, c] = (1 / n_q) sum_v k[q, v] x[q, v, c],  n_q = max(1, sum_v k[q, v])
 *   max    y[q, c] = largest x[q, v, c] of the views with k[q, v] > 0
 *   backward   dx[q, v] += k[q, v] dy[q] / n_q;  of the largest: dx[q, v*, c] += dy[q, c], the
 * first of equal ones
 *
 * Shapes     x [Q, V, C], k [Q, V] or NULL (all 1); y [Q, C].
 * Degenerate  a row without views: zeros, no gradient.
 * Keeps      the mask (the caller's, until backward); max: v* of every number.
 * Threads    over rows.
 */
#include "autograd/ops.h"

typedef struct kept {
    const lf_real *mask; /* or NULL */
    lf_pooling pooling;
    int *from; /* max: [Q, C] view of each number, -1 none */
} kept;

static bool is_seen(const kept *k, long qv)
{
    return !k->mask || k->mask[qv] > 0;
}

static lf_real share(const kept *k, long q, long views)
{
    long seen = 0;
    for (long v = 0; v < views; v++)
        seen += is_seen(k, q * views + v);
    return 1 / (lf_real)(seen > 1 ? seen : 1);
}

static void backward(const lf_node *node)
{
    const kept *k = node->saved;
    const lf_tensor *y = node->out[0];
    lf_tensor *x = node->in[0];
    const long views = x->dim[1], c = lf_cols(x);
#pragma omp parallel for schedule(static)
    for (long q = 0; q < x->dim[0]; q++) {
        const lf_real *dy = y->grad + q * c;
        if (k->pooling == LF_POOL_MAX) {
            for (long i = 0; i < c; i++)
                if (k->from[q * c + i] >= 0)
                    x->grad[(q * views + k->from[q * c + i]) * c + i] += dy[i];
            continue;
        }
        const lf_real w = share(k, q, views);
        for (long v = 0; v < views; v++)
            for (long i = 0; is_seen(k, q * views + v) && i < c; i++)
                x->grad[(q * views + v) * c + i] += w * dy[i];
    }
}

static void mean_row(const kept *k, const lf_tensor *x, long q, lf_real *restrict y)
{
    const long views = x->dim[1], c = lf_cols(x);
    const lf_real w = share(k, q, views);
    for (long v = 0; v < views; v++) {
        const lf_real *row = x->value + (q * views + v) * c;
        for (long i = 0; is_seen(k, q * views + v) && i < c; i++)
            y[i] += w * row[i];
    }
}

/* NaN is larger than everything, so that none is lost. */
static void max_row(const kept *k, const lf_tensor *x, long q, lf_real *restrict y)
{
    const long views = x->dim[1], c = lf_cols(x);
    int *from = k->from + q * c;
    for (long i = 0; i < c; i++)
        from[i] = -1;
    for (long v = 0; v < views; v++) {
        const lf_real *row = x->value + (q * views + v) * c;
        for (long i = 0; is_seen(k, q * views + v) && i < c; i++)
            if (from[i] < 0 || row[i] > y[i] || (isnan(row[i]) && !isnan(y[i]))) {
                y[i] = row[i];
                from[i] = (int)v;
            }
    }
}

lf_tensor *lf_pool_views(lf_tape *tape, lf_tensor *x, const lf_tensor *mask, lf_pooling pooling)
{
    LF_REQUIRE(x->rank == 3 && (!mask || mask->size == x->dim[0] * x->dim[1]),
               "lf_pool_views: rank %d, %ld rows of %ld, %ld in the mask", x->rank, x->dim[0],
               x->dim[1], mask ? mask->size : 0);
    const long c = lf_cols(x);
    lf_tensor *y = lf_tensor_new(tape, 2, LF_DIMS(x->dim[0], c));
    kept *k = lf_alloc(tape, sizeof *k);
    *k = (kept){mask ? mask->value : NULL, pooling, NULL};
    if (pooling == LF_POOL_MAX)
        k->from = lf_alloc(tape, (size_t)y->size * sizeof *k->from);
#pragma omp parallel for schedule(static)
    for (long q = 0; q < x->dim[0]; q++) {
        lf_real *row = y->value + q * c;
        memset(row, 0, (size_t)c * sizeof *row);
        if (pooling == LF_POOL_MAX)
            max_row(k, x, q, row);
        else
            mean_row(k, x, q, row);
    }
    lf_record(tape, "pool_views", backward, k, LF_IN(x), LF_OUT(y));
    return y;
}
