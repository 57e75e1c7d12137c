/* op_group_sum.c: the sum over the channels of each field.                     [ops_image.h]
 *
 *   forward    y[r, f] = sum_{a < group} x[r, group f + a]
 *   backward   dx[r, group f + a] += dy[r, f]
 *
 * What a regular -> scalar 1x1 convolution needs first: it is a linear map of this sum, with 8
 * times fewer products than on the eight orientations.                              [method.md 6]
 */
#include "autograd/ops_image.h"

/* Eight numbers in pairs: short chains of additions. */
static lf_real sum8(const lf_real *x)
{
    return ((x[0] + x[1]) + (x[2] + x[3])) + ((x[4] + x[5]) + (x[6] + x[7]));
}

static lf_real sum(long group, const lf_real *x)
{
    lf_real total = 0;
    for (long a = 0; a < group; a++)
        total += x[a];
    return total;
}

static void backward(const lf_node *node)
{
    const lf_tensor *y = node->out[0];
    lf_tensor *x = node->in[0];
    const long group = x->size / y->size;
    lf_real *restrict dx = x->grad;
#pragma omp parallel for schedule(static)
    for (long i = 0; i < y->size; i++) {
        const lf_real g = y->grad[i];
        if (group == 8)
            for (long a = 0; a < 8; a++)
                dx[i * 8 + a] += g;
        else
            for (long a = 0; a < group; a++)
                dx[i * group + a] += g;
    }
}

lf_tensor *lf_group_sum(lf_tape *tape, lf_tensor *x, long group)
{
    LF_REQUIRE(group >= 1 && lf_cols(x) % group == 0 && x->size > 0,
               "lf_group_sum: %ld channels in groups of %ld", lf_cols(x), group);
    lf_tensor *y = lf_tensor_cols(tape, x, lf_cols(x) / group);
#pragma omp parallel for schedule(static)
    for (long i = 0; i < y->size; i++)
        y->value[i] = group == 8 ? sum8(x->value + i * 8) : sum(group, x->value + i * group);
    lf_record(tape, "group_sum", backward, NULL, LF_IN(x), LF_OUT(y));
    return y;
}
