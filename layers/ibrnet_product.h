/* ibrnet_product.h: the products under lf_lanes_linear: rows of LF_LANES points side by side times
 * matrices too narrow for autograd/kernels' tiles of rows. Serial; nothing is allocated.
 */
#ifndef LF_LAYERS_IBRNET_PRODUCT_H
#define LF_LAYERS_IBRNET_PRODUCT_H

#include "layers/ibrnet.h"

enum { LF_LANES_ROWS = 2 }; /* rows of a register tile */

typedef struct lf_lanes_product {
    int parts;
    const lf_real *x[LF_LANES_PARTS]; /* [R, c, L] each */
    long c[LF_LANES_PARTS];
    const lf_real *w; /* [sum of c, step], of which the first `out` columns count, */
    long step;
    bool turned;         /* or its transpose, [out, step] */
    const lf_real *bias; /* [out] or NULL */
    lf_real *y;          /* [R, out, L] */
    long out;
    bool accumulate; /* start from y, not from the bias */
} lf_lanes_product;

/* y = bias + x w or y += x w, the rows [first, first + rows), at most LF_LANES_ROWS of them. */
void lf_lanes_product_rows(const lf_lanes_product *p, long first, long rows);

/* The rows [first, first + count) of the operands of the sum below into the order that it reads
 * them in: x [R, c, L] as the left one, z [R, c, L] as the right one; panels [R c L]. */
void lf_lanes_left_panels(long rows, long first, long count, long c, const lf_real *x,
                          lf_real *panels);
void lf_lanes_right_panels(long rows, long first, long count, long c, const lf_real *z,
                           lf_real *panels);

/* w[i, o] += sum over rows and lanes of x[r, i, l] z[r, o, l], both as panels of all rows. */
void lf_lanes_outer(long rows, long ci, const lf_real *left, long co, const lf_real *right,
                    lf_real *w);

#endif
