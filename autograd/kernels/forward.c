#include "autograd/kernels/kernels.h"
#include "autograd/status.h"

void lf_kernel_linear(long rows, long in, long out, const lf_real *x, const lf_real *w,
                      const lf_real *b, lf_activation act, lf_real *y)
{
    lf_ref_linear(rows, in, out, x, w, b, act, y);
}
void lf_kernel_linear_dx(long rows, long in, long out, const lf_real *dy, const lf_real *w,
                         lf_real *dx)
{
    lf_ref_linear_dx(rows, in, out, dy, w, dx);
}
void lf_kernel_linear_dw(long rows, long in, long out, const lf_real *x, const lf_real *dy,
                         lf_real *dw, lf_real *db)
{
    lf_ref_linear_dw(rows, in, out, x, dy, dw, db);
}
void lf_kernel_linear_dw_lanes(long rows, long in, long out, const lf_real *x, const lf_real *dy,
                               lf_real *dw, lf_real *db, lf_real *scratch)
{
    (void)scratch;
    lf_ref_linear_dw(rows, in, out, x, dy, dw, db);
}
long lf_linear_dw_scratch(long rows, long in, long out)
{
    (void)rows;
    return 8 * (in + 1) * out + 64;
}
void lf_kernel_matmul(long m, long n, long k, const lf_real *a, const lf_real *b, lf_real *c,
                      bool accumulate)
{
    lf_ref_matmul(m, n, k, a, b, c, accumulate);
}
lf_conv lf_conv_shape(long images, long height, long width, long in, long out, long size,
                      long stride, long pad)
{
    LF_REQUIRE(size >= 1 && stride >= 1 && pad >= 0 && height + 2 * pad >= size &&
                   width + 2 * pad >= size,
               "lf_conv_shape: filter %ld, stride %ld, pad %ld on %ldx%ld", size, stride, pad,
               height, width);
    return (lf_conv){images,
                     height,
                     width,
                     in,
                     out,
                     size,
                     stride,
                     pad,
                     (height + 2 * pad - size) / stride + 1,
                     (width + 2 * pad - size) / stride + 1};
}
long lf_conv_scratch(const lf_conv *s)
{
    (void)s;
    return 1;
}
void lf_kernel_conv(const lf_conv *s, const lf_real *x, const lf_real *w, const lf_real *b,
                    lf_activation act, lf_real *y, lf_real *scratch)
{
    lf_ref_conv(s, x, w, b, act, y, scratch);
}
void lf_kernel_conv_dx(const lf_conv *s, const lf_real *dy, const lf_real *w, lf_real *dx,
                       lf_real *scratch)
{
    lf_ref_conv_dx(s, dy, w, dx, scratch);
}
void lf_kernel_conv_dw(const lf_conv *s, const lf_real *x, const lf_real *dy, lf_real *dw,
                       lf_real *db, lf_real *scratch)
{
    lf_ref_conv_dw(s, x, dy, dw, db, scratch);
}
