/* product.h: blocked matrix products over the register tiles, shared by linear maps and matmul. */
#ifndef LF_AUTOGRAD_KERNELS_PRODUCT_H
#define LF_AUTOGRAD_KERNELS_PRODUCT_H

#include "autograd/kernels/kernels.h"

/* y[rows, out] = act(start + x[rows, in] b), where b[in, out] is stored as it is (b_step = out) or
 * transposed (as [out, in], b_step = in). Without `accumulate` a sum starts from bias (NULL: 0). */
typedef struct lf_blocked {
    long rows, in, out;
    const lf_real *x, *b, *bias;
    bool transposed, accumulate;
    lf_activation act;
    lf_real *y;
} lf_blocked;

/* Serial; rows of different calls may run in parallel and give the same bits as one call. */
void lf_product_rows(const lf_blocked *p, long first, long rows);
/* All rows, in parallel if there are at least `parallel_from` of them. */
void lf_product_all(const lf_blocked *p, long parallel_from);

#endif
