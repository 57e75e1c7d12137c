/* op_resize.c: feature maps at another size, bilinear.                            [ops_image.h]
 *
 *   forward    y[n, i, j, c] = x at line r(i, H, h), column r(j, W, w), bilinear, where
 *              corners aligned       r(i, H, h) = i (H - 1) / (h - 1), 0 if h = 1
 *              corners not aligned   r(i, H, h) = max(0, (i + 1/2) H / h - 1/2)
 *              and a neighbour beyond the last line is that line itself
 *   backward   the adjoint: dx at the four neighbours += weight dy
 *
 * Shapes     x [N, H, W, C] -> y [N, h, w, C]; all sizes >= 1. Both conventions are those that
 *            image libraries call align_corners true and false. There is no averaging on shrinking.
 * Keeps      the places and weights of every line and column, in double until they are weights.
 */
#include "autograd/ops_image.h"

/* Line (or column) i of y is (1 - part) x[low] + part x[high]. */
typedef struct place {
    long low, high;
    lf_real part;
} place;

typedef struct kept {
    long from[2], to[2], channels; /* H, W; h, w */
    place *line, *column;          /* [h], [w] */
} kept;

static place *places(lf_tape *tape, long from, long to, bool aligned)
{
    place *p = lf_alloc(tape, (size_t)to * sizeof *p);
    for (long i = 0; i < to; i++) {
        double at = ((double)i + 0.5) * (double)from / (double)to - 0.5;
        if (aligned)
            at = to > 1 ? (double)(i * (from - 1)) / (double)(to - 1) : 0;
        at = at > 0 ? at : 0;
        const long low = (long)at < from - 1 ? (long)at : from - 1;
        p[i] = (place){low, low + (low < from - 1), (lf_real)(at - (double)low)};
    }
    return p;
}

/* y = (1 - a) ((1 - b) x00 + b x01) + a ((1 - b) x10 + b x11), a pixel's channels */
static void forward_pixel(long channels, lf_real a, lf_real b, const lf_real *restrict top,
                          const lf_real *restrict bottom, long low, long high, lf_real *restrict y)
{
    const lf_real w00 = (1 - a) * (1 - b), w01 = (1 - a) * b, w10 = a * (1 - b), w11 = a * b;
    for (long c = 0; c < channels; c++)
        y[c] = w00 * top[low + c] + w01 * top[high + c] + w10 * bottom[low + c] +
               w11 * bottom[high + c];
}

static void forward_image(const kept *k, const lf_real *x, lf_real *y)
{
    const long c = k->channels, pitch = k->from[1] * c;
    for (long i = 0; i < k->to[0]; i++) {
        const place l = k->line[i];
        for (long j = 0; j < k->to[1]; j++, y += c) {
            const place m = k->column[j];
            forward_pixel(c, l.part, m.part, x + l.low * pitch, x + l.high * pitch, m.low * c,
                          m.high * c, y);
        }
    }
}

static void add_scaled(long n, lf_real w, const lf_real *restrict from, lf_real *restrict to)
{
    for (long i = 0; i < n; i++)
        to[i] += w * from[i];
}

/* Across first: the line of gradients at x's columns, row[W, C], then that line to two lines. */
static void backward_image(const kept *k, const lf_real *dy, lf_real *row, lf_real *dx)
{
    const long c = k->channels, pitch = k->from[1] * c;
    for (long i = 0; i < k->to[0]; i++) {
        const place l = k->line[i];
        memset(row, 0, (size_t)pitch * sizeof *row);
        for (long j = 0; j < k->to[1]; j++, dy += c) {
            const place m = k->column[j];
            add_scaled(c, 1 - m.part, dy, row + m.low * c);
            add_scaled(c, m.part, dy, row + m.high * c);
        }
        add_scaled(pitch, 1 - l.part, row, dx + l.low * pitch);
        add_scaled(pitch, l.part, row, dx + l.high * pitch);
    }
}

static void backward(const lf_node *node)
{
    const kept *k = node->saved;
    const lf_tensor *x = node->in[0], *y = node->out[0];
    const long input = k->from[0] * k->from[1] * k->channels;
    const long output = k->to[0] * k->to[1] * k->channels, row = k->from[1] * k->channels;
    if (!x->grad)
        return;
    lf_real *rows = lf_alloc_reals(node->tape, x->dim[0] * row);
#pragma omp parallel for schedule(static)
    for (long n = 0; n < x->dim[0]; n++)
        backward_image(k, y->grad + n * output, rows + n * row, x->grad + n * input);
}

lf_tensor *lf_resize(lf_tape *tape, lf_tensor *x, long height, long width, bool aligned)
{
    LF_REQUIRE(x->rank == 4, "lf_resize: x of rank %d, needs 4", x->rank);
    const long *d = x->dim;
    LF_REQUIRE(height >= 1 && width >= 1 && d[1] >= 1 && d[2] >= 1,
               "lf_resize: [%ld,%ld,%ld,%ld] to %ldx%ld", d[0], d[1], d[2], d[3], height, width);
    kept *k = lf_alloc(tape, sizeof *k);
    *k = (kept){{d[1], d[2]}, {height, width}, d[3], NULL, NULL};
    k->line = places(tape, d[1], height, aligned);
    k->column = places(tape, d[2], width, aligned);
    lf_tensor *y = lf_tensor_new(tape, 4, LF_DIMS(d[0], height, width, d[3]));
    const long input = d[1] * d[2] * d[3], output = height * width * d[3];
#pragma omp parallel for schedule(static)
    for (long n = 0; n < d[0]; n++)
        forward_image(k, x->value + n * input, y->value + n * output);
    lf_record(tape, "resize", backward, k, LF_IN(x), LF_OUT(y));
    return y;
}
