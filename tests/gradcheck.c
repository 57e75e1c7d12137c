/* gradcheck.c: see gradcheck.h. */
#include "autograd/optim.h"
#include "autograd/random.h"
#include "tests/gradcheck.h"

typedef struct check {
    const op_case *c;
    uint64_t seed;
    lf_store *store;
    lf_tape *tape;
    lf_real *value[CASE_INPUTS], *grad[CASE_INPUTS];
    long size[CASE_INPUTS];
} check;

static void fill(lf_real *x, const case_input *in, long n, lf_stream *s)
{
    for (long i = 0; i < n; i++) {
        switch (in->fill) {
        case FILL_NORMAL:
        case FILL_UNIT3:
            x[i] = (lf_real)lf_normal(s);
            break;
        case FILL_POSITIVE:
            x[i] = (lf_real)(0.2 + lf_uniform(s));
            break;
        case FILL_MASK:
            x[i] = (lf_real)(lf_uniform(s) < 0.6);
            break;
        case FILL_ZERO:
            x[i] = 0;
            break;
        case FILL_DISTINCT:
            x[i] = (lf_real)(0.1 * (double)((i * 7919) % n) - 0.05 * (double)n);
            break;
        }
    }
    if (in->fill == FILL_UNIT3)
        for (long i = 0; i + 2 < n; i += 3) {
            const lf_real r = LF_SQRT(x[i] * x[i] + x[i + 1] * x[i + 1] + x[i + 2] * x[i + 2]);
            for (int k = 0; k < 3; k++)
                x[i + k] /= r;
        }
}

static void open_check(check *k, const op_case *c, uint64_t seed)
{
    *k = (check){.c = c, .seed = seed, .store = lf_store_create(seed), .tape = lf_tape_create()};
    for (int i = 0; i < c->inputs; i++) {
        k->size[i] = 1;
        for (int a = 0; a < c->in[i].rank; a++)
            k->size[i] *= c->in[i].dim[a];
        k->value[i] = calloc((size_t)k->size[i], sizeof(lf_real));
        k->grad[i] = calloc((size_t)k->size[i], sizeof(lf_real));
        lf_stream s = lf_stream_at(seed, LF_RANDOM_TEST, 1, (uint64_t)i);
        fill(k->value[i], &c->in[i], k->size[i], &s);
    }
}

static void close_check(check *k)
{
    for (int i = 0; i < k->c->inputs; i++) {
        free(k->value[i]);
        free(k->grad[i]);
    }
    lf_tape_free(k->tape);
    lf_store_free(k->store);
}

/* Loss = sum of fixed random weights times all outputs; optionally the backward walk. */
static double loss_of(check *k, bool backward)
{
    lf_tensor *in[CASE_INPUTS] = {NULL}, *out[LF_MAX_OUT] = {NULL};
    lf_tape_reset(k->tape);
    for (int i = 0; i < k->c->inputs; i++) {
        const bool fixed = k->c->in[i].constant || k->c->in[i].fill == FILL_MASK;
        in[i] = lf_leaf(k->tape, k->c->in[i].rank, k->c->in[i].dim, k->value[i],
                        fixed ? NULL : k->grad[i]);
    }
    const int n = k->c->build(k->tape, k->store, in, out);
    lf_stream s = lf_stream_at(k->seed, LF_RANDOM_TEST, 2, 0);
    double loss = 0;
    for (int o = 0; o < n; o++) {
        lf_real *grad = backward ? lf_grad(k->tape, out[o]) : NULL;
        for (long i = 0; i < out[o]->size; i++) {
            const double w = 0.5 + lf_uniform(&s);
            loss += w * (double)out[o]->value[i];
            if (grad)
                grad[i] += (lf_real)w;
        }
    }
    if (backward)
        lf_backward_from(k->tape);
    return loss;
}

static double slope(check *k, lf_real *x)
{
    const double at = (double)*x, h = 1e-4;
    double d[2];
    for (int half = 0; half < 2; half++) {
        const double step = half ? h / 2 : h;
        *x = (lf_real)(at + step);
        const double up = loss_of(k, false);
        *x = (lf_real)(at - step);
        d[half] = (up - loss_of(k, false)) / (2 * step);
    }
    *x = (lf_real)at;
    return (4 * d[1] - d[0]) / 3;
}

/* Compare n gradients with slopes; keep the worst difference and the largest slope. */
static void compare(check *k, lf_real *x, const lf_real *grad, long n, double *worst, double *size)
{
    const long stride = n <= 60 ? 1 : n / 40;
    for (long i = 0; i < n; i += stride) {
        const double s = slope(k, x + i), d = fabs(s - (double)grad[i]);
        *worst = d > *worst || isnan(d) ? d : *worst;
        *size = fabs(s) > *size ? fabs(s) : *size;
    }
}

static void halve(check *k)
{
    for (int i = 0; i < k->c->inputs; i++)
        for (long j = 0; j < k->size[i]; j++)
            k->grad[i][j] /= 2;
    lf_gradient_scale(k->store, 0.5);
}

double gradient_error(const op_case *c, uint64_t seed)
{
    check k;
    open_check(&k, c, seed);
    loss_of(&k, false); /* registers the parameters */
    lf_store_zero_grads(k.store);
    loss_of(&k, true);
    loss_of(&k, true); /* a backward adds: twice the gradient now */
    halve(&k);
    double worst = 0, size = 1e-12;
    for (int i = 0; i < c->inputs; i++)
        if (!c->in[i].constant && c->in[i].fill != FILL_MASK)
            compare(&k, k.value[i], k.grad[i], k.size[i], &worst, &size);
    for (int p = 0; p < lf_store_count(k.store); p++) {
        const lf_parameter *q = lf_store_at(k.store, p);
        if (q->trainable)
            compare(&k, lf_values(q), lf_grads(q), q->size, &worst, &size);
    }
    close_check(&k);
    return worst / size;
}

void run_case(const op_case *c, uint64_t seed, double *loss, double *gradient_size)
{
    check k;
    open_check(&k, c, seed);
    loss_of(&k, false);
    lf_store_zero_grads(k.store);
    *loss = loss_of(&k, true);
    *gradient_size = 0;
    for (int i = 0; i < c->inputs; i++)
        for (long j = 0; j < k.size[i]; j++)
            *gradient_size += fabs((double)k.grad[i][j]);
    close_check(&k);
}
