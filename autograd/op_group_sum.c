/* op_group_sum.c: the sum over the channels of each field.                     [ops_image.h]
 *
 *   forward    y[r, f] = sum_{a < group} x[r, group f + a]
 *   backward   dx[r, group f + a] += dy[r, f]
 *
 * What a regular -> scalar 1x1 convolution needs first: it is a linear map of this sum, with 8
 * times fewer products than on the eight orientations.                              [method.md 6]
 */
#include "autograd/ops_image.h"

static void backward(const lf_node *node)
{
    const lf_tensor *y = node->out[0];
    lf_tensor *x = node->in[0];
    const long group = x->size / y->size;
#pragma omp parallel for schedule(static)
    for (long i = 0; i < y->size; i++)
        for (long a = 0; a < group; a++)
            x->grad[i * group + a] += y->grad[i];
}

lf_tensor *lf_group_sum(lf_tape *tape, lf_tensor *x, long group)
{
    LF_REQUIRE(group >= 1 && lf_cols(x) % group == 0 && x->size > 0,
               "lf_group_sum: %ld channels in groups of %ld", lf_cols(x), group);
    lf_tensor *y = lf_tensor_cols(tape, x, lf_cols(x) / group);
#pragma omp parallel for schedule(static)
    for (long i = 0; i < y->size; i++) {
        lf_real sum = 0;
        for (long a = 0; a < group; a++)
            sum += x->value[i * group + a];
        y->value[i] = sum;
    }
    lf_record(tape, "group_sum", backward, NULL, LF_IN(x), LF_OUT(y));
    return y;
}
