/* op_squared_error.c: L = sum_r w_r sum_c (x_rc - t_rc)^2,  dx_rc += 2 dL w_r (x_rc - t_rc)
 *
 * Shapes     x [.., C] (rows r), t like x, w one number a row or NULL (1); L [], summed in double,
 *            with what each addition rounds off kept (Neumaier).
 * Keeps      t and w (the caller's, until backward).
 */
#include "autograd/ops.h"

typedef struct target {
    const float *value, *weight;
} target;

static double weight_of(const target *t, long row)
{
    return t->weight ? (double)t->weight[row] : 1;
}

static void backward(const lf_node *node)
{
    const target *t = node->saved;
    lf_tensor *x = node->in[0];
    const double dl = (double)node->out[0]->grad[0];
    for (long i = 0; i < x->size; i++) {
        const double w = weight_of(t, i / lf_cols(x));
        if (w != 0)
            x->grad[i] += (lf_real)(2 * dl * w * ((double)x->value[i] - (double)t->value[i]));
    }
}

lf_tensor *lf_squared_error(lf_tape *tape, lf_tensor *x, const float *value, const float *weight)
{
    target *t = lf_alloc(tape, sizeof *t);
    *t = (target){value, weight};
    lf_tensor *loss = lf_tensor_new(tape, 0, NULL);
    double sum = 0, lost = 0;
    for (long i = 0; i < x->size; i++) {
        const double d = (double)x->value[i] - (double)value[i], w = weight_of(t, i / lf_cols(x));
        const double term = w != 0 ? w * d * d : 0, next = sum + term;
        lost += fabs(sum) >= fabs(term) ? sum - next + term : term - next + sum;
        sum = next;
    }
    loss->value[0] = (lf_real)(isfinite(sum) ? sum + lost : sum);
    lf_record(tape, "squared_error", backward, t, LF_IN(x), LF_OUT(loss));
    return loss;
}
