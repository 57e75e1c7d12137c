/* autograd.h: reverse-mode automatic differentiation on a tape.                [docs/tour.md]
 *
 * A tape owns every tensor and node made in one piece of work, in one arena that is reset and not
 * freed: in the steady state a training step calls no allocator. Ops compute forward at once and
 * record a node; lf_backward walks the nodes in reverse. Parameters live outside tapes, in a store.
 *
 * Layout:  row-major, contiguous; feature maps are [images, height, width, channels], a C8 field's
 *          eight orientations are adjacent channels (channel = 8 * field + orientation); 3-vectors
 *          are [..., 3, channels], so that mixing channels is one linear map of the last axis.
 * Errors:  a wrong shape is the caller's mistake: the op prints the shapes and aborts.
 * Threads: a tape belongs to one thread at a time. Ops use OpenMP when they are called outside a
 *          parallel region and run single-threaded inside one; results do not depend on it.
 */
#ifndef LF_AUTOGRAD_H
#define LF_AUTOGRAD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "autograd/real.h"
#include "autograd/status.h"

enum { LF_MAX_RANK = 5, LF_MAX_IN = 8, LF_MAX_OUT = 3 };

/* ---- tensors --------------------------------------------------------------------------------- */

typedef struct lf_tensor {
    int rank;
    long dim[LF_MAX_RANK];
    long size;      /* product of the dims */
    lf_real *value; /* [size] */
    lf_real *grad;  /* [size]; NULL before the backward walk reaches the tensor: see lf_grad */
    bool wants;     /* a gradient flows into this tensor */
    struct lf_tensor *of; /* a view's tensor, whose numbers from `offset` on it shows; or NULL */
    long offset;
    bool passing, dropped; /* the values may be dropped, and were: see lf_drop */
    long node;             /* that makes them again, counted from 1 */
} lf_tensor;

/* Length of the last axis (1 for rank 0), and size / that. */
static inline long lf_cols(const lf_tensor *t)
{
    return t->rank ? t->dim[t->rank - 1] : 1;
}

static inline long lf_rows(const lf_tensor *t)
{
    return lf_cols(t) ? t->size / lf_cols(t) : 0;
}

/* ---- parameters ------------------------------------------------------------------------------ */

typedef struct lf_store lf_store;

/* One named array of the store; `offset` counts lf_reals from the store's start. */
typedef struct lf_parameter {
    lf_store *store;
    char name[96]; /* dotted: backbone.stage2.block0.conv1.weight */
    int rank;
    long dim[LF_MAX_RANK];
    long offset, size;
    bool trainable; /* false: a running statistic, saved but never optimised */
} lf_parameter;

lf_store *lf_store_create(uint64_t seed);
void lf_store_free(lf_store *store);

/* Add an array, filled with `mean` + `deviation` * standard normal numbers that depend on the seed
 * and the name alone. The pointer stays valid as long as the store. The name must be new. */
const lf_parameter *lf_store_add(lf_store *store, const char *name, int rank, const long *dim,
                                 double mean, double deviation, bool trainable);

/* The parameter with that name, or NULL. */
const lf_parameter *lf_store_find(const lf_store *store, const char *name);
int lf_store_count(const lf_store *store);
const lf_parameter *lf_store_at(const lf_store *store, int index);
long lf_store_size(const lf_store *store);      /* lf_reals in value[], padding included */
long lf_store_trainable(const lf_store *store); /* numbers that the optimiser changes */

/* Flat arrays of lf_store_size numbers, in the store's order; valid until the next lf_store_add. */
lf_real *lf_store_values(const lf_store *store);
lf_real *lf_store_grads(const lf_store *store);
lf_real *lf_values(const lf_parameter *p); /* of one parameter */
lf_real *lf_grads(const lf_parameter *p);
void lf_store_zero_grads(lf_store *store);

/* ---- tape ------------------------------------------------------------------------------------ */

typedef struct lf_tape lf_tape;
typedef struct lf_node lf_node;
typedef void lf_backward_fn(const lf_node *node);

/* What an op leaves behind for its backward. */
struct lf_node {
    const char *op;
    lf_backward_fn *backward;
    lf_backward_fn *again; /* the forward once more, into out[0]->value; or NULL */
    lf_tape *tape;         /* for scratch memory during backward */
    void *saved;           /* the op's own data, in the arena */
    int n_in, n_out;
    lf_tensor *in[LF_MAX_IN], *out[LF_MAX_OUT];
};

lf_tape *lf_tape_create(void);
void lf_tape_free(lf_tape *tape);
/* Forget all tensors and nodes; memory is kept for the next use. */
void lf_tape_reset(lf_tape *tape);
/* Without gradients (evaluation) no op records a node and no tensor has a grad. Default: with. */
void lf_tape_set_grad(lf_tape *tape, bool on);
/* Name the first op that produces a NaN or infinity, forward or backward: see lf_tape_nonfinite. */
void lf_tape_set_check(lf_tape *tape, bool on);
/* "forward of softmax" or so, or NULL if everything was finite since the last reset. */
const char *lf_tape_nonfinite(const lf_tape *tape);
/* Gradients of parameters go to `lane` (which stands for the store's numbers from `first` on)
 * instead of the store's own gradients; NULL: back to the store. */
void lf_tape_set_lane(lf_tape *tape, lf_real *lane, long first);
/* Bytes in use since the last reset, and the most ever. */
size_t lf_tape_bytes(const lf_tape *tape);
size_t lf_tape_peak(const lf_tape *tape);

/* Scratch or saved memory; 64-byte aligned, not cleared. It lives until the reset, inside a
 * backward until that backward returns, and not longer than a release allows. */
void *lf_alloc(lf_tape *tape, size_t bytes);
/* Give back all that was allocated since the mark: for scratch that a forward needs no longer. */
typedef struct lf_mark {
    const void *block;
    size_t used;
} lf_mark;
lf_mark lf_tape_mark(const lf_tape *tape);
void lf_tape_release(lf_tape *tape, lf_mark mark);
lf_real *lf_alloc_reals(lf_tape *tape, long n);
/* The same for a backward, until it returns: from memory that tensors have left, if there is such.
 */
lf_real *lf_scratch_reals(lf_tape *tape, long n);

/* A tensor of the tape, values not set, no grad (lf_record gives it one if it needs it). */
lf_tensor *lf_tensor_new(lf_tape *tape, int rank, const long *dim);
lf_tensor *lf_tensor_like(lf_tape *tape, const lf_tensor *shape);
/* The same rows with another last axis: dims of x, the last one replaced by `cols`. */
lf_tensor *lf_tensor_cols(lf_tape *tape, const lf_tensor *x, long cols);
/* Values and, if the tape is on and x wants one, gradient of x from number `offset` on. */
lf_tensor *lf_view(lf_tape *tape, lf_tensor *x, long offset, int rank, const long *dim);
/* The caller's memory seen as a tensor; grad may be NULL. The memory must outlive the tape's use.
 */
lf_tensor *lf_leaf(lf_tape *tape, int rank, const long *dim, lf_real *value, lf_real *grad);
/* A parameter seen as a tensor; its grad is the lane's or the store's. */
lf_tensor *lf_param(lf_tape *tape, const lf_parameter *p);

#define LF_DIMS(...) ((const long[]){__VA_ARGS__})

/* The last act of every op: record the node, and mark the outputs as wanting a gradient, if an
 * input does and the tape is on. Inputs may be NULL (an absent bias). In the backward every output
 * has a grad, every input that wants one has one, the others have NULL. */
void lf_record(lf_tape *tape, const char *op, lf_backward_fn *backward, void *saved, int n_in,
               lf_tensor *const *in, int n_out, lf_tensor *const *out);
#define LF_IN(...)                                                                                 \
    (int)(sizeof((lf_tensor *[]){__VA_ARGS__}) / sizeof(lf_tensor *)), (lf_tensor *[])             \
    {                                                                                              \
        __VA_ARGS__                                                                                \
    }
#define LF_OUT(...) LF_IN(__VA_ARGS__)

/* Directly after lf_record: `again` computes the values of t, the node's only output, once more
 * from its inputs, to the same bits and without side effects. */
void lf_made_again_by(lf_tape *tape, lf_tensor *t, lf_backward_fn *again);
/* The values of t, and of its views, are needed no more in the forward: their memory serves the
 * next tensor, and the backward makes them again when it needs them. Not between a mark and its
 * release. Does nothing to a tensor that no op makes again. */
void lf_drop(lf_tape *tape, lf_tensor *t);

/* ---- what a profile is told ------------------------------------------------------------------
 * All of this does nothing unless a profile watches the tape.                 [autograd/profile.h]
 */

/* What is done on the tape until the scope's end belongs to this part of the model: "block%d".
 * Scopes nest, their names are joined by '/'; each needs its end. */
LF_PRINTF(2, 3)
void lf_scope(lf_tape *tape, const char *format, ...);
void lf_scope_end(lf_tape *tape);

/* The op that is recorded next computes so many multiply-adds, by its formula, forward and in its
 * backward. An op that does not say counts as unknown. */
void lf_products(lf_tape *tape, double forward, double backward);
/* The same of products of numbers of a with numbers of b: the backward has as many for each of the
 * two that wants a gradient. */
void lf_products_of(lf_tape *tape, double products, const lf_tensor *a, const lf_tensor *b);
/* To leave out what only a count needs; and how many of n marks of a mask are set. */
bool lf_profiled(const lf_tape *tape);
double lf_present(long n, const lf_real *mask);

/* The gradient of a tensor, made and zeroed if it is not there yet; NULL if it wants none. For
 * callers that add to it before lf_backward_from. The walk makes the others when it needs them and
 * reuses their memory as soon as their node has run, so a gradient is gone after the walk; those of
 * leaves and parameters, which are the caller's, stay. */
lf_real *lf_grad(lf_tape *tape, lf_tensor *t);
/* The same in the place of the values, not zeroed: for a caller that has no further use for these
 * and writes every number of the gradient. Neither may the op that made the tensor need its values
 * in the backward, nor may t be a view, a leaf or have a gradient already. NULL if it wants none.
 */
lf_real *lf_grad_in_place(lf_tape *tape, lf_tensor *t);

/* Add d(loss)/d(tensor) to the grad of every tensor the loss depends on; loss has one element and
 * `seed` is its own gradient (1, or a weight). */
void lf_backward(lf_tape *tape, lf_tensor *loss, lf_real seed);
/* The same from tensors whose lf_grad the caller has filled. */
void lf_backward_from(lf_tape *tape);

#endif
