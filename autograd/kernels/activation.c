/* activation.c: nonlinearities in place, and the gradient behind them from their result.
 *
 *   relu      y = max(x, 0)               dz = dy where y > 0
 *   elu       y = x > 0 ? x : e^x - 1     dz = dy (y > 0 ? 1 : y + 1)
 *   sigmoid   y = 1 / (1 + e^-x)          dz = dy y (1 - y)
 */
#include "autograd/kernels/kernels.h"
#include "autograd/kernels/wide.h"

/* n <= LF_WIDE numbers; a NaN stays a NaN. */
LF_INLINE void activate(const long n, const bool sigmoid, lf_real *y)
{
    const lf_wide x = lf_wide_load(y, n);
    lf_wide_store(y, n, sigmoid ? lf_wide_sigmoid(x) : lf_wide_elu(x));
}

LF_INLINE void activate_all(long n, const bool sigmoid, lf_real *y)
{
    for (; n >= LF_WIDE; n -= LF_WIDE, y += LF_WIDE)
        activate(LF_WIDE, sigmoid, y); /* of a size that the compiler knows */
    if (n > 0)
        activate(n, sigmoid, y);
}

void lf_kernel_activate(long n, lf_activation act, lf_real *y)
{
    if (act == LF_ELU)
        activate_all(n, false, y);
    else if (act == LF_SIGMOID)
        activate_all(n, true, y);
    for (long i = 0; act == LF_RELU && i < n; i++)
        y[i] = y[i] < 0 ? 0 : y[i];
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
