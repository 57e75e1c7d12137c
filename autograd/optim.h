/* optim.h: Adam and AdamW over a parameter store, gradient clipping.
 *
 *   m <- b1 m + (1 - b1) g,  v <- b2 v + (1 - b2) g^2
 *   x <- x - lr (m / (1 - b1^t)) / (sqrt(v / (1 - b2^t)) + eps)
 * Adam adds weight_decay x to g; AdamW takes lr weight_decay x off x instead (Loshchilov and Hutter
 * 2019). Untrainable parameters stay.
 */
#ifndef LF_AUTOGRAD_OPTIM_H
#define LF_AUTOGRAD_OPTIM_H

#include "autograd/autograd.h"

typedef struct lf_adam_config {
    double beta1, beta2, eps, weight_decay;
    bool decoupled; /* AdamW */
} lf_adam_config;

/* Moments in the store's order, lf_store_size numbers each; owned. */
typedef struct lf_adam {
    lf_adam_config config;
    lf_real *m, *v;
    long size, steps; /* steps taken */
} lf_adam;

void lf_adam_init(lf_adam *adam, const lf_adam_config *config, const lf_store *store);
void lf_adam_free(lf_adam *adam);
/* One step with the gradients in the store. */
void lf_adam_step(lf_adam *adam, lf_store *store, double lr);

/* Euclidean norm of all gradients of trainable parameters; NaN or infinite if one is. */
double lf_gradient_norm(const lf_store *store);
/* Multiply all gradients by `factor`. */
void lf_gradient_scale(lf_store *store, double factor);

#endif
