/* linear.c: y = act(x w + b) and its two backwards.
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
    for (; i + 2 * LF_LANES <= n; i += 2 * LF_LANES) {
        sum += lf_vec_load(x + i) * lf_vec_load(w + i);
        more += lf_vec_load(x + i + LF_LANES) * lf_vec_load(w + i + LF_LANES);
    }
    sum += more;
    for (; i < n; i += LF_LANES) {
        const long rest = n - i < LF_LANES ? n - i : LF_LANES;
        sum += lf_vec_load_part(x + i, rest) * lf_vec_load_part(w + i, rest);
    }
    return lf_vec_sum(sum);
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

/* dw += x^T dy for the columns [j, j + width) of one panel, over a block of rows. Whole vectors are
 * read from dy, so its last rows, from which they would pass the end, go through a buffer. */
static void dw_panel(long rows, long in, long out, const lf_real *x, const lf_real *dy, long j,
                     long width, lf_real *dw)
{
    _Alignas(64) lf_real buffer[LF_LANES * LF_LAST_PANEL];
    const long step = lf_panel_step(width), passing = (j + step + out - 1) / out - 1;
    const long last = width == step ? 0 : passing < rows ? passing : rows, most = rows - last;
    const lf_pixels direct = {
        .images = 1, .lines = 1, .columns = most, .x_step = in, .y_step = out};
    const lf_pixels packed = {
        .images = 1, .lines = 1, .columns = last, .x_step = in, .y_step = step};
    lf_pack(last, width, dy + most * out + j, out, buffer);
    lf_tile_outer(&direct, in, width, x, dy + j, dw + j, out);
    if (last > 0)
        lf_tile_outer(&packed, in, width, x + most * in, buffer, dw + j, out);
}

static void dw_block(long rows, long in, long out, const lf_real *x, const lf_real *dy, lf_real *dw)
{
    for (long k = 0; k < lf_panels(out); k++)
        dw_panel(rows, in, out, x, dy, k * LF_PANEL, lf_panel_width(out, k * LF_PANEL), dw);
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
