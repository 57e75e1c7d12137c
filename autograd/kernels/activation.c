/* activation.c: nonlinearities in place, and the gradient behind them from their result.
 *
 *   relu      y = max(x, 0)               dz = dy where y > 0
 *   elu       y = x > 0 ? x : e^x - 1     dz = dy (y > 0 ? 1 : y + 1)
 *   sigmoid   y = 1 / (1 + e^-x)          dz = dy y (1 - y)
 */
#include "autograd/kernels/kernels.h"
#include "autograd/kernels/wide.h"

void lf_kernel_activate(long n, lf_activation act, lf_real *y)
{
    for (long i = 0; act != LF_IDENTITY && i < n; i += LF_WIDE) {
        const long here = n - i < LF_WIDE ? n - i : LF_WIDE;
        const lf_wide x = lf_wide_load(y + i, here), zero = {0};
        const lf_wide result = act == LF_ELU       ? lf_wide_elu(x)
                               : act == LF_SIGMOID ? lf_wide_sigmoid(x)
                                                   : lf_wide_select(x < 0, zero, x);
        lf_wide_store(y + i, here, result); /* a NaN stays a NaN in all of them */
    }
}

void lf_kernel_activation_dz(long n, lf_activation act, const lf_real *y, const lf_real *dy,
                             lf_real *restrict dz)
{
    switch (act) {
    case LF_IDENTITY:
        for (long i = 0; i < n; i++)
            dz[i] = dy[i];
        break;
    case LF_RELU:
        for (long i = 0; i < n; i++)
            dz[i] = y[i] > 0 ? dy[i] : 0;
        break;
    case LF_ELU:
        for (long i = 0; i < n; i++)
            dz[i] = dy[i] * (y[i] > 0 ? 1 : y[i] + 1);
        break;
    case LF_SIGMOID:
        for (long i = 0; i < n; i++)
            dz[i] = dy[i] * y[i] * (1 - y[i]);
        break;
    }
}
