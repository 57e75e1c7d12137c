/* op_reflect_pad.c: a border that mirrors the image at its outermost pixels.      [ops_image.h]
 *
 *   forward    y[n, i, j, c] = x[n, m(i - pad, H), m(j - pad, W), c],
 *              m(i, H) = -i for i < 0, 2 (H - 1) - i for i >= H, i between: edges come once
 *   backward   dx at the place that was read += dy
 *
 * Shapes     x [N, H, W, C] -> y [N, H + 2 pad, W + 2 pad, C]; H and W > pad, so one mirror serves.
 * Keeps      nothing but pad.
 */
#include "autograd/ops_image.h"

typedef struct kept {
    long height, width, channels, pad; /* of x */
} kept;

/* The line (or column) of x that line i of y, counted from x's first, shows. */
static long mirrored(long i, long length)
{
    return i < 0 ? -i : i >= length ? 2 * (length - 1) - i : i;
}

/* One image x[H, W, C] to y. */
static void forward_image(const kept *k, const lf_real *x, lf_real *y)
{
    const long c = k->channels, pad = k->pad;
    const size_t pixel = (size_t)c * sizeof *y;
    for (long i = -pad; i < k->height + pad; i++) {
        const lf_real *row = x + mirrored(i, k->height) * k->width * c;
        for (long j = -pad; j < 0; j++, y += c)
            memcpy(y, row + mirrored(j, k->width) * c, pixel);
        memcpy(y, row, (size_t)k->width * pixel);
        y += k->width * c;
        for (long j = k->width; j < k->width + pad; j++, y += c)
            memcpy(y, row + mirrored(j, k->width) * c, pixel);
    }
}

static const lf_real *add(long n, const lf_real *restrict from, lf_real *restrict to)
{
    for (long i = 0; i < n; i++)
        to[i] += from[i];
    return from + n;
}

static void backward_image(const kept *k, const lf_real *dy, lf_real *dx)
{
    const long c = k->channels, pad = k->pad;
    for (long i = -pad; i < k->height + pad; i++) {
        lf_real *row = dx + mirrored(i, k->height) * k->width * c;
        for (long j = -pad; j < 0; j++)
            dy = add(c, dy, row + mirrored(j, k->width) * c);
        dy = add(k->width * c, dy, row);
        for (long j = k->width; j < k->width + pad; j++)
            dy = add(c, dy, row + mirrored(j, k->width) * c);
    }
}

static long size_of(const lf_tensor *t)
{
    return t->dim[1] * t->dim[2] * t->dim[3];
}

static void backward(const lf_node *node)
{
    const lf_tensor *x = node->in[0], *y = node->out[0];
    if (!x->grad)
        return;
#pragma omp parallel for schedule(static)
    for (long n = 0; n < x->dim[0]; n++)
        backward_image(node->saved, y->grad + n * size_of(y), x->grad + n * size_of(x));
}

lf_tensor *lf_reflect_pad(lf_tape *tape, lf_tensor *x, long pad)
{
    LF_REQUIRE(x->rank == 4, "lf_reflect_pad: x of rank %d, needs 4", x->rank);
    const long *d = x->dim;
    LF_REQUIRE(pad >= 0 && d[1] > pad && d[2] > pad,
               "lf_reflect_pad: a border of %ld on [%ld,%ld,%ld,%ld]", pad, d[0], d[1], d[2], d[3]);
    kept *k = lf_alloc(tape, sizeof *k);
    *k = (kept){d[1], d[2], d[3], pad};
    lf_tensor *y = lf_tensor_new(tape, 4, LF_DIMS(d[0], d[1] + 2 * pad, d[2] + 2 * pad, d[3]));
#pragma omp parallel for schedule(static)
    for (long n = 0; n < d[0]; n++)
        forward_image(k, x->value + n * size_of(x), y->value + n * size_of(y));
    lf_record(tape, "reflect_pad", backward, k, LF_IN(x), LF_OUT(y));
    return y;
}
