/* linear.c: y = act(x w + b), its two backwards, and the general matrix product.
 *
 *   forward   rows of y by tiles, the whole sum in registers          2 rows in out flops each
 *   dx        the same with w transposed while it is packed
 *   dw        tiles of w's gradient, summed over blocks of rows that stay in L1
 *
 * One output is a dot product a row instead; it is bound by reading x.
 */
#include <omp.h>
#include <string.h>

#include "autograd/kernels/product.h"
#include "autograd/kernels/tile.h"

enum {
    PARALLEL_ROWS = 4096, /* fewer are not worth a team */
    LANES = 8,            /* lanes of lf_kernel_linear_dw_lanes */
    LANE_ROWS = 512,      /* rows of a lane at least */
    DW_ROWS = 128         /* rows of x and dy in L1 */
};

static lf_real dot(long n, const lf_real *x, const lf_real *w)
{
    lf_vec sum = {0}, more = {0};
    long i = 0;
    for (; i + LF_PANEL <= n; i += LF_PANEL) {
        sum += lf_vec_load(x + i) * lf_vec_load(w + i);
        more += lf_vec_load(x + i + LF_LANES) * lf_vec_load(w + i + LF_LANES);
    }
    sum += more;
    for (; i < n; i += LF_LANES) {
        const long rest = n - i < LF_LANES ? n - i : LF_LANES;
        sum += lf_vec_load_part(x + i, rest) * lf_vec_load_part(w + i, rest);
    }
    lf_real all = 0;
    for (int l = 0; l < LF_LANES; l++)
        all += sum[l];
    return all;
}

static void one_output(long rows, long in, const lf_real *x, const lf_real *w, lf_real b,
                       lf_activation act, lf_real *y)
{
#pragma omp parallel for schedule(static) if (rows >= PARALLEL_ROWS && !omp_in_parallel())
    for (long r = 0; r < rows; r++) {
        const lf_real sum = b + dot(in, x + r * in, w);
        y[r] = act == LF_RELU && sum < 0 ? 0 : sum;
    }
}

void lf_kernel_linear(long rows, long in, long out, const lf_real *x, const lf_real *w,
                      const lf_real *b, lf_activation act, lf_real *y)
{
    const lf_blocked p = {
        .rows = rows, .in = in, .out = out, .x = x, .b = w, .bias = b, .act = act, .y = y};
    if (out == 1)
        one_output(rows, in, x, w, b ? b[0] : 0, act, y);
    else
        lf_product_all(&p, PARALLEL_ROWS);
}

void lf_kernel_linear_dx(long rows, long in, long out, const lf_real *dy, const lf_real *w,
                         lf_real *dx)
{
    const lf_blocked p = {.rows = rows,
                          .in = out,
                          .out = in,
                          .x = dy,
                          .b = w,
                          .transposed = true,
                          .accumulate = true,
                          .y = dx};
    lf_product_all(&p, PARALLEL_ROWS);
}

/* dw += x^T dy over a block of rows, for the columns of one panel; dy readable in whole vectors. */
static void dw_panel(long rows, long in, long out, const lf_real *x, const lf_real *dy,
                     long dy_step, long width, lf_real *dw)
{
    const lf_pixels g = {1, rows, 0, in, 0, dy_step};
    for (long i = 0, n; i < in; i += n) {
        n = lf_next_part(in - i, LF_TILE);
        lf_tile_outer(&g, n, width, x + i, dy, dw + i * out, out);
    }
}

static void dw_block(long rows, long in, long out, const lf_real *x, const lf_real *dy, lf_real *dw)
{
    _Alignas(64) lf_real buffer[DW_ROWS * LF_PANEL];
    for (long j = 0; j < out; j += LF_PANEL) {
        const long width = out - j < LF_PANEL ? out - j : LF_PANEL;
        if (width % LF_LANES == 0) {
            dw_panel(rows, in, out, x, dy + j, out, width, dw + j);
            continue;
        }
        lf_pack(rows, width, dy + j, out, buffer);
        dw_panel(rows, in, out, x, buffer, lf_panel_step(width), width, dw + j);
    }
}

void lf_kernel_linear_dw(long rows, long in, long out, const lf_real *x, const lf_real *dy,
                         lf_real *dw, lf_real *db)
{
    for (long r = 0, n; r < rows; r += n) {
        n = lf_next_part(rows - r, DW_ROWS);
        if (out == 1) /* dw as one row: dy^T x */
            dw_block(n, 1, in, dy + r, x + r * in, dw);
        else
            dw_block(n, in, out, x + r * in, dy + r * out, dw);
        if (db)
            lf_column_sums(n, out, dy + r * out, out, db);
    }
}

/* ---- dw in lanes ----------------------------------------------------------------------------- */

static long lanes_of(long rows)
{
    const long lanes = rows / LANE_ROWS;
    return lanes < 1 ? 1 : lanes > LANES ? LANES : lanes;
}

long lf_linear_dw_scratch(long rows, long in, long out)
{
    return lanes_of(rows) * (in + 1) * out;
}

void lf_kernel_linear_dw_lanes(long rows, long in, long out, const lf_real *x, const lf_real *dy,
                               lf_real *dw, lf_real *db, lf_real *scratch)
{
    const long lanes = lanes_of(rows), each = (rows + lanes - 1) / lanes, size = (in + 1) * out;
#pragma omp parallel for schedule(static)
    for (long l = 0; l < lanes; l++) {
        const long first = l * each, left = rows - first;
        lf_real *sum = scratch + l * size;
        memset(sum, 0, (size_t)size * sizeof *sum);
        if (left > 0)
            lf_kernel_linear_dw(left < each ? left : each, in, out, x + first * in,
                                dy + first * out, sum, db ? sum + in * out : NULL);
    }
    for (long l = 0; l < lanes; l++) {
        const lf_real *sum = scratch + l * size;
        for (long i = 0; i < in * out; i++)
            dw[i] += sum[i];
        for (long o = 0; db && o < out; o++)
            db[o] += sum[in * out + o];
    }
}

/* ---- matmul ---------------------------------------------------------------------------------- */

void lf_kernel_matmul(long m, long n, long k, const lf_real *a, const lf_real *b, lf_real *c,
                      bool accumulate)
{
    const lf_blocked p = {
        .rows = m, .in = k, .out = n, .x = a, .b = b, .accumulate = accumulate, .y = c};
    lf_product_all(&p, m * n * k >= 1L << 18 ? 2 : m + 1);
}
