/* activation.c: nonlinearities in place, and the gradient behind them from their result.
 *
 *   relu      y = max(x, 0)               dz = dy where y > 0
 *   elu       y = x > 0 ? x : e^x - 1     dz = dy (y > 0 ? 1 : y + 1)
 *   sigmoid   y = 1 / (1 + e^-x)          dz = dy y (1 - y)
 */
#include "autograd/kernels/kernels.h"
#include "autograd/kernels/vector_math.h"

LF_INLINE lf_vec activate(lf_vec x, lf_activation act)
{
    /* a NaN stays a NaN in all of them */
    return act == LF_ELU ? lf_vec_elu(x) : act == LF_SIGMOID ? lf_vec_sigmoid(x) : lf_vec_relu(x);
}

void lf_kernel_activate(long n, lf_activation act, lf_real *y)
{
    const long whole = act == LF_IDENTITY ? 0 : n / LF_LANES * LF_LANES;
    for (long i = 0; i < whole; i += LF_LANES)
        lf_vec_store(y + i, activate(lf_vec_load(y + i), act));
    if (act != LF_IDENTITY && whole < n)
        lf_vec_store_part(y + whole, n - whole,
                          activate(lf_vec_load_part(y + whole, n - whole), act));
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
