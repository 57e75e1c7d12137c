/* op_elementwise.c: add, multiply, scale, ReLU, ELU, sigmoid, number by number.
 *
 *   add        y = a + b          da += dy, db += dy
 *   multiply   y = a b            da += dy b, db += dy a
 *   scale      y = f a            da += f dy
 *   relu, elu, sigmoid            kernels/activation.c
 */
#include "autograd/ops.h"

static void require_same(const char *op, const lf_tensor *a, const lf_tensor *b)
{
    LF_REQUIRE(a->size == b->size && lf_cols(a) == lf_cols(b),
               "%s: [.., %ld] of %ld, [.., %ld] of %ld", op, lf_cols(a), a->size, lf_cols(b),
               b->size);
}

static void add_backward(const lf_node *node)
{
    for (int k = 0; k < 2; k++) {
        lf_tensor *x = node->in[k];
        for (long i = 0; x->grad && i < x->size; i++)
            x->grad[i] += node->out[0]->grad[i];
    }
}

lf_tensor *lf_add(lf_tape *tape, lf_tensor *a, lf_tensor *b)
{
    require_same("lf_add", a, b);
    lf_tensor *y = lf_tensor_like(tape, a);
    for (long i = 0; i < y->size; i++)
        y->value[i] = a->value[i] + b->value[i];
    lf_record(tape, "add", add_backward, NULL, LF_IN(a, b), LF_OUT(y));
    return y;
}

static void multiply_backward(const lf_node *node)
{
    for (int k = 0; k < 2; k++) {
        lf_tensor *x = node->in[k];
        const lf_tensor *other = node->in[1 - k];
        for (long i = 0; x->grad && i < x->size; i++)
            x->grad[i] += node->out[0]->grad[i] * other->value[i];
    }
}

lf_tensor *lf_multiply(lf_tape *tape, lf_tensor *a, lf_tensor *b)
{
    require_same("lf_multiply", a, b);
    lf_tensor *y = lf_tensor_like(tape, a);
    for (long i = 0; i < y->size; i++)
        y->value[i] = a->value[i] * b->value[i];
    lf_record(tape, "multiply", multiply_backward, NULL, LF_IN(a, b), LF_OUT(y));
    return y;
}

static void scale_backward(const lf_node *node)
{
    const lf_real factor = *(const lf_real *)node->saved;
    lf_tensor *x = node->in[0];
    for (long i = 0; i < x->size; i++)
        x->grad[i] += factor * node->out[0]->grad[i];
}

lf_tensor *lf_scale(lf_tape *tape, lf_tensor *a, lf_real factor)
{
    lf_tensor *y = lf_tensor_like(tape, a);
    for (long i = 0; i < y->size; i++)
        y->value[i] = factor * a->value[i];
    lf_real *saved = lf_alloc_reals(tape, 1);
    *saved = factor;
    lf_record(tape, "scale", scale_backward, saved, LF_IN(a), LF_OUT(y));
    return y;
}

static void activation_backward(const lf_node *node)
{
    lf_tensor *x = node->in[0];
    const lf_tensor *y = node->out[0];
    lf_real *dz = lf_alloc_reals(node->tape, y->size);
    lf_kernel_activation_dz(y->size, *(const lf_activation *)node->saved, y->value, y->grad, dz);
    for (long i = 0; i < x->size; i++)
        x->grad[i] += dz[i];
}

static lf_tensor *activation(lf_tape *tape, const char *op, lf_tensor *x, lf_activation act)
{
    lf_tensor *y = lf_tensor_like(tape, x);
    memcpy(y->value, x->value, (size_t)x->size * sizeof *y->value);
    lf_kernel_activate(y->size, act, y->value);
    lf_activation *saved = lf_alloc(tape, sizeof *saved);
    *saved = act;
    lf_record(tape, op, activation_backward, saved, LF_IN(x), LF_OUT(y));
    return y;
}

lf_tensor *lf_relu(lf_tape *tape, lf_tensor *x)
{
    return activation(tape, "relu", x, LF_RELU);
}

lf_tensor *lf_elu(lf_tape *tape, lf_tensor *x)
{
    return activation(tape, "elu", x, LF_ELU);
}

lf_tensor *lf_sigmoid(lf_tape *tape, lf_tensor *x)
{
    return activation(tape, "sigmoid", x, LF_SIGMOID);
}
