/* reference.c: every kernel as plain loops, the definition that the fast ones are tested against.
 *
 * Sums are kept in double in both precisions, so that the float build's reference is good to one
 * rounding and the difference to a fast kernel is the fast kernel's own error.
 */
#include "autograd/kernels/kernels.h"

static lf_real activate(double sum, lf_activation act)
{
    return (lf_real)(act == LF_RELU && sum < 0 ? 0 : sum);
}

void lf_ref_linear(long rows, long in, long out, const lf_real *x, const lf_real *w,
                   const lf_real *b, lf_activation act, lf_real *y)
{
    for (long r = 0; r < rows; r++)
        for (long o = 0; o < out; o++) {
            double sum = b ? (double)b[o] : 0;
            for (long i = 0; i < in; i++)
                sum += (double)x[r * in + i] * (double)w[i * out + o];
            y[r * out + o] = activate(sum, act);
        }
}

void lf_ref_linear_dx(long rows, long in, long out, const lf_real *dy, const lf_real *w,
                      lf_real *dx)
{
    for (long r = 0; r < rows; r++)
        for (long i = 0; i < in; i++) {
            double sum = (double)dx[r * in + i];
            for (long o = 0; o < out; o++)
                sum += (double)dy[r * out + o] * (double)w[i * out + o];
            dx[r * in + i] = (lf_real)sum;
        }
}

void lf_ref_linear_dw(long rows, long in, long out, const lf_real *x, const lf_real *dy,
                      lf_real *dw, lf_real *db)
{
    for (long i = 0; i < in; i++)
        for (long o = 0; o < out; o++) {
            double sum = (double)dw[i * out + o];
            for (long r = 0; r < rows; r++)
                sum += (double)x[r * in + i] * (double)dy[r * out + o];
            dw[i * out + o] = (lf_real)sum;
        }
    for (long o = 0; db && o < out; o++) {
        double sum = (double)db[o];
        for (long r = 0; r < rows; r++)
            sum += (double)dy[r * out + o];
        db[o] = (lf_real)sum;
    }
}

void lf_ref_matmul(long m, long n, long k, const lf_real *a, const lf_real *b, lf_real *c,
                   bool accumulate)
{
    for (long i = 0; i < m; i++)
        for (long j = 0; j < n; j++) {
            double sum = accumulate ? (double)c[i * n + j] : 0;
            for (long l = 0; l < k; l++)
                sum += (double)a[i * k + l] * (double)b[l * n + j];
            c[i * n + j] = (lf_real)sum;
        }
}

/* Offset of pixel (i, j) of image n in an array of `channels`, or -1 outside the image. */
static long pixel(const lf_conv *s, long n, long i, long j, long channels)
{
    if (i < 0 || j < 0 || i >= s->height || j >= s->width)
        return -1;
    return ((n * s->height + i) * s->width + j) * channels;
}

/* sum over taps and channels of x * w, for output (n, i, j, o) */
static double conv_at(const lf_conv *s, const lf_real *x, const lf_real *w, long n, long i, long j,
                      long o)
{
    double sum = 0;
    for (long p = 0; p < s->size; p++)
        for (long q = 0; q < s->size; q++) {
            const long from =
                pixel(s, n, i * s->stride + p - s->pad, j * s->stride + q - s->pad, s->in);
            for (long c = 0; from >= 0 && c < s->in; c++)
                sum +=
                    (double)x[from + c] * (double)w[((p * s->size + q) * s->in + c) * s->out + o];
        }
    return sum;
}

void lf_ref_conv(const lf_conv *s, const lf_real *x, const lf_real *w, const lf_real *b,
                 lf_activation act, lf_real *y, lf_real *scratch)
{
    (void)scratch;
    for (long n = 0; n < s->images; n++)
        for (long i = 0; i < s->out_height; i++)
            for (long j = 0; j < s->out_width; j++)
                for (long o = 0; o < s->out; o++) {
                    const double sum = conv_at(s, x, w, n, i, j, o) + (b ? (double)b[o] : 0);
                    y[((n * s->out_height + i) * s->out_width + j) * s->out + o] =
                        activate(sum, act);
                }
}

/* What reaches input (n, h, v, c): every tap (p, q) whose output pixel lies in the image. */
static double conv_dx_at(const lf_conv *s, const lf_real *dy, const lf_real *w, long n, long h,
                         long v, long c)
{
    double sum = 0;
    for (long p = 0; p < s->size; p++)
        for (long q = 0; q < s->size; q++) {
            const long a = h + s->pad - p, b = v + s->pad - q;
            if (a < 0 || b < 0 || a % s->stride || b % s->stride ||
                a / s->stride >= s->out_height || b / s->stride >= s->out_width)
                continue;
            const lf_real *d =
                dy + ((n * s->out_height + a / s->stride) * s->out_width + b / s->stride) * s->out;
            for (long o = 0; o < s->out; o++)
                sum += (double)d[o] * (double)w[((p * s->size + q) * s->in + c) * s->out + o];
        }
    return sum;
}

void lf_ref_conv_dx(const lf_conv *s, const lf_real *dy, const lf_real *w, lf_real *dx,
                    lf_real *scratch)
{
    (void)scratch;
    for (long n = 0; n < s->images; n++)
        for (long h = 0; h < s->height; h++)
            for (long v = 0; v < s->width; v++)
                for (long c = 0; c < s->in; c++) {
                    lf_real *d = dx + pixel(s, n, h, v, s->in) + c;
                    *d = (lf_real)((double)*d + conv_dx_at(s, dy, w, n, h, v, c));
                }
}

/* sum over images and output pixels of x at tap (p, q), channel c, times dy at channel o */
static double conv_dw_at(const lf_conv *s, const lf_real *x, const lf_real *dy, long p, long q,
                         long c, long o)
{
    double sum = 0;
    for (long n = 0; n < s->images; n++)
        for (long i = 0; i < s->out_height; i++)
            for (long j = 0; j < s->out_width; j++) {
                const long from =
                    pixel(s, n, i * s->stride + p - s->pad, j * s->stride + q - s->pad, s->in);
                if (from >= 0)
                    sum += (double)x[from + c] *
                           (double)dy[((n * s->out_height + i) * s->out_width + j) * s->out + o];
            }
    return sum;
}

void lf_ref_conv_dw(const lf_conv *s, const lf_real *x, const lf_real *dy, lf_real *dw, lf_real *db,
                    lf_real *scratch)
{
    (void)scratch;
    for (long p = 0; p < s->size; p++)
        for (long q = 0; q < s->size; q++)
            for (long c = 0; c < s->in; c++)
                for (long o = 0; o < s->out; o++) {
                    lf_real *d = dw + ((p * s->size + q) * s->in + c) * s->out + o;
                    *d = (lf_real)((double)*d + conv_dw_at(s, x, dy, p, q, c, o));
                }
    for (long o = 0; db && o < s->out; o++) {
        double sum = (double)db[o];
        for (long m = 0; m < s->images * s->out_height * s->out_width; m++)
            sum += (double)dy[m * s->out + o];
        db[o] = (lf_real)sum;
    }
}
