/* optim.c: see optim.h. */
#include "autograd/optim.h"

static lf_real *zeros(long n)
{
    lf_real *x = calloc((size_t)(n > 0 ? n : 1), sizeof *x);
    LF_REQUIRE(x, "out of memory for %ld moments", n);
    return x;
}

void lf_adam_init(lf_adam *adam, const lf_adam_config *config, const lf_store *store)
{
    const long n = lf_store_size(store);
    *adam = (lf_adam){*config, zeros(n), zeros(n), n, 0};
}

void lf_adam_free(lf_adam *adam)
{
    free(adam->m);
    free(adam->v);
    *adam = (lf_adam){0};
}

void lf_adam_step(lf_adam *adam, lf_store *store, double lr)
{
    LF_REQUIRE(adam->size == lf_store_size(store), "moments for %ld numbers, a store of %ld",
               adam->size, lf_store_size(store));
    const lf_adam_config *c = &adam->config;
    const double t = (double)++adam->steps;
    const lf_real b1 = (lf_real)c->beta1, b2 = (lf_real)c->beta2, eps = (lf_real)c->eps;
    /* not 1 - b2, which is 1e-5 off in float */
    const lf_real a1 = (lf_real)(1 - c->beta1), a2 = (lf_real)(1 - c->beta2);
    const lf_real rate = (lf_real)(lr / (1 - pow(c->beta1, t)));
    const lf_real correction = (lf_real)(1 / (1 - pow(c->beta2, t)));
    const lf_real decay = (lf_real)(c->decoupled ? 0 : c->weight_decay);
    const lf_real shrink = (lf_real)(c->decoupled ? 1 - lr * c->weight_decay : 1);
    for (int i = 0; i < lf_store_count(store); i++) {
        const lf_parameter *p = lf_store_at(store, i);
        if (!p->trainable)
            continue;
        lf_real *restrict x = lf_values(p), *restrict m = adam->m + p->offset;
        lf_real *restrict v = adam->v + p->offset;
        const lf_real *restrict grad = lf_grads(p);
        for (long k = 0; k < p->size; k++) {
            const lf_real g = grad[k] + decay * x[k];
            m[k] = b1 * m[k] + a1 * g;
            v[k] = b2 * v[k] + a2 * g * g;
            x[k] = shrink * x[k] - rate * m[k] / (LF_SQRT(v[k] * correction) + eps);
        }
    }
}

double lf_gradient_norm(const lf_store *store)
{
    double sum = 0;
    for (int i = 0; i < lf_store_count(store); i++) {
        const lf_parameter *p = lf_store_at(store, i);
        const lf_real *g = lf_grads(p);
        for (long k = 0; p->trainable && k < p->size; k++)
            sum += (double)g[k] * (double)g[k];
    }
    return sqrt(sum);
}

void lf_gradient_scale(lf_store *store, double factor)
{
    lf_real *g = lf_store_grads(store);
    for (long k = 0; k < lf_store_size(store); k++)
        g[k] *= (lf_real)factor;
}
