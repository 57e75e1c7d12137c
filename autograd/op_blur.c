/* op_blur.c: binomial smoothing of each channel, for maps that are subsampled next. [ops_image.h]
 *
 *   forward    y[n,i,j,c] = sum over p, q in -1 .. 1 of b_p b_q x[n, i + p, j + q, c],
 *              b = 1/4, 1/2, 1/4; lines beyond the border repeat it
 *   backward   the same of dy: the border leaves the matrix symmetric
 *
 * Shapes     x, y [N, H, W, C], of any size.
 * Keeps      x.
 * Again      y can be dropped: one pass makes it.
 */
#include "autograd/ops_image.h"

/* y[k] += the blur of three rows over the columns at left + k, middle + k and right + k, k < n. */
static void blur_columns(const lf_real *const row[3], long left, long middle, long right, long n,
                         lf_real *restrict y)
{
    const lf_real *a = row[0], *b = row[1], *c = row[2];
    for (long k = 0; k < n; k++) {
        const lf_real sides = (a[left + k] + 2 * b[left + k] + c[left + k]) +
                              (a[right + k] + 2 * b[right + k] + c[right + k]);
        const lf_real inner = a[middle + k] + 2 * b[middle + k] + c[middle + k];
        y[k] += (sides + 2 * inner) * (lf_real)0.0625;
    }
}

/* y += blurred row i of one image x[height, width, channels]. All but the outer columns are one run
 * of numbers, whatever the channels. */
static void blur_row(const lf_real *x, long height, long width, long channels, long i, lf_real *y)
{
    const long line = width * channels, last = line - channels;
    const lf_real *const row[3] = {x + (i > 0 ? i - 1 : 0) * line, x + i * line,
                                   x + (i + 1 < height ? i + 1 : i) * line};
    if (width == 1) {
        blur_columns(row, 0, 0, 0, channels, y);
        return;
    }
    blur_columns(row, 0, 0, channels, channels, y);
    blur_columns(row, 0, channels, 2 * channels, last - channels, y + channels);
    blur_columns(row, last - channels, last, last, channels, y + last);
}

/* y += blurred images x, both shaped as `shape`. */
static void blur(const lf_tensor *shape, const lf_real *x, lf_real *y)
{
    const long height = shape->dim[1], width = shape->dim[2], channels = shape->dim[3];
    const long image = height * width * channels;
#pragma omp parallel for schedule(static)
    for (long r = 0; r < shape->dim[0] * height; r++)
        blur_row(x + r / height * image, height, width, channels, r % height,
                 y + r * width * channels);
}

static void forward(const lf_node *node)
{
    lf_tensor *y = node->out[0];
    memset(y->value, 0, (size_t)y->size * sizeof(lf_real));
    blur(y, node->in[0]->value, y->value);
}

static void backward(const lf_node *node)
{
    blur(node->in[0], node->out[0]->grad, node->in[0]->grad);
}

lf_tensor *lf_blur(lf_tape *tape, lf_tensor *x)
{
    LF_REQUIRE(x->rank == 4, "lf_blur: x of rank %d, needs 4", x->rank);
    lf_tensor *y = lf_tensor_new(tape, 4, x->dim);
    forward(&(lf_node){.in = {x}, .out = {y}});
    lf_record(tape, "blur", backward, NULL, LF_IN(x), LF_OUT(y));
    lf_made_again_by(tape, y, forward);
    return y;
}
