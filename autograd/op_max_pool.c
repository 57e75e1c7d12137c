/* op_max_pool.c: the largest value of each window, channel by channel.          [ops_image.h]
 *
 *   forward    y[n,i,j,c] = max over 0 <= p, q < size of x[n, i s + p - pad, j s + q - pad, c]
 *   backward   dx at the place of the maximum += dy
 *
 * Keeps      the place of each maximum as p * size + q, one byte an output.
 * Degenerate a window always meets the image, since pad < size; ties go to the first in row order.
 */
#include "autograd/ops_image.h"

#include "autograd/kernels/vector_math.h"

typedef struct kept {
    lf_conv shape;
    unsigned char *place; /* [images, out_height, out_width, channels] */
} kept;

/* Channels [c, c + count) of output pixel (i, j) of one image x[height, width, channels]. */
static void forward_part(const lf_conv *s, const lf_real *x, long i, long j, long c, long count,
                         lf_real *y, unsigned char *place)
{
    lf_vec largest = {0}, at = {0};
    bool first = true;
    for (long p = 0; p < s->size; p++) {
        const long row = i * s->stride + p - s->pad;
        for (long q = 0; row >= 0 && row < s->height && q < s->size; q++) {
            const long col = j * s->stride + q - s->pad;
            if (col < 0 || col >= s->width)
                continue;
            const lf_vec v = lf_vec_load_part(x + (row * s->width + col) * s->in + c, count);
            const lf_vec here = lf_vec_all((lf_real)(p * s->size + q));
            at = first ? here : lf_vec_select(v > largest, here, at);
            largest = first ? v : lf_vec_select(v > largest, v, largest);
            first = false;
        }
    }
    lf_vec_store_part(y + c, count, largest);
    for (long k = 0; k < count; k++)
        place[c + k] = (unsigned char)at[k];
}

static void forward_pixel(const lf_conv *s, const lf_real *x, long i, long j, lf_real *y,
                          unsigned char *place)
{
    for (long c = 0; c < s->in; c += LF_LANES)
        forward_part(s, x, i, j, c, s->in - c < LF_LANES ? s->in - c : LF_LANES, y, place);
}

static void forward_image(const lf_conv *s, const lf_real *x, lf_real *y, unsigned char *place)
{
    for (long i = 0; i < s->out_height; i++)
        for (long j = 0; j < s->out_width; j++) {
            const long at = (i * s->out_width + j) * s->in;
            forward_pixel(s, x, i, j, y + at, place + at);
        }
}

static void backward_image(const lf_conv *s, const lf_real *dy, const unsigned char *place,
                           lf_real *dx)
{
    for (long i = 0; i < s->out_height; i++)
        for (long j = 0; j < s->out_width; j++)
            for (long c = 0; c < s->in; c++) {
                const long at = (i * s->out_width + j) * s->in + c;
                const long row = i * s->stride + place[at] / s->size - s->pad;
                const long col = j * s->stride + place[at] % s->size - s->pad;
                dx[(row * s->width + col) * s->in + c] += dy[at];
            }
}

static void backward(const lf_node *node)
{
    const kept *k = node->saved;
    const lf_conv *s = &k->shape;
    const long input = s->height * s->width * s->in, output = s->out_height * s->out_width * s->in;
#pragma omp parallel for schedule(static)
    for (long n = 0; n < s->images; n++)
        backward_image(s, node->out[0]->grad + n * output, k->place + n * output,
                       node->in[0]->grad + n * input);
}

lf_tensor *lf_max_pool(lf_tape *tape, lf_tensor *x, long size, long stride, long pad)
{
    LF_REQUIRE(x->rank == 4, "lf_max_pool: x of rank %d, needs 4", x->rank);
    LF_REQUIRE(size >= 1 && size <= 15 && pad < size, "lf_max_pool: size %ld, pad %ld", size, pad);
    kept *k = lf_alloc(tape, sizeof *k);
    const long *d = x->dim;
    k->shape = lf_conv_shape(d[0], d[1], d[2], d[3], d[3], size, stride, pad);
    const lf_conv *s = &k->shape;
    lf_tensor *y = lf_tensor_new(tape, 4, LF_DIMS(s->images, s->out_height, s->out_width, s->in));
    k->place = lf_alloc(tape, (size_t)y->size);
    const long input = d[1] * d[2] * d[3], output = s->out_height * s->out_width * s->in;
#pragma omp parallel for schedule(static)
    for (long n = 0; n < s->images; n++)
        forward_image(s, x->value + n * input, y->value + n * output, k->place + n * output);
    lf_record(tape, "max_pool", backward, k, LF_IN(x), LF_OUT(y));
    return y;
}
