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

LF_INLINE lf_vec behind(lf_vec y, lf_vec dy, lf_activation act)
{
    const lf_vec zero = {0};
    return act == LF_ELU       ? dy * lf_vec_select(y > 0, lf_vec_all(1), y + 1)
           : act == LF_SIGMOID ? dy * y * (1 - y)
           : act == LF_RELU    ? lf_vec_select(y > 0, dy, zero)
                               : dy;
}

LF_INLINE void all_behind(long n, const lf_activation act, const lf_real *y, const lf_real *dy,
                          lf_real *dz)
{
    const long whole = n / LF_LANES * LF_LANES;
    for (long i = 0; i < whole; i += LF_LANES)
        lf_vec_store(dz + i, behind(lf_vec_load(y + i), lf_vec_load(dy + i), act));
    lf_vec_store_part(dz + whole, n - whole,
                      behind(lf_vec_load_part(y + whole, n - whole),
                             lf_vec_load_part(dy + whole, n - whole), act));
}

void lf_kernel_activation_dz(long n, lf_activation act, const lf_real *y, const lf_real *dy,
                             lf_real *dz)
{
    if (act == LF_ELU)
        all_behind(n, LF_ELU, y, dy, dz);
    else if (act == LF_SIGMOID)
        all_behind(n, LF_SIGMOID, y, dy, dz);
    else
        all_behind(n, act, y, dy, dz);
}
