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

/* z [R, co, L] in the order that the sums below read it, as many numbers. */
void lf_lanes_panels(long rows, long co, const lf_real *z, lf_real *panels);

/* w[i, o] += sum over rows and lanes of x[r, i, l] z[r, o, l]: x [R, ci, L], z as panels; scratch
 * holds lf_lanes_outer_scratch numbers. */
void lf_lanes_outer(long rows, long ci, const lf_real *x, long co, const lf_real *panels,
                    lf_real *w, lf_real *scratch);
long lf_lanes_outer_scratch(long rows);

/* sum[o] += sum over rows and lanes of z[r, o, l], z as panels */
void lf_lanes_sums(long rows, long co, const lf_real *panels, lf_real *sum);

#endif
