/* gradcheck.h: the gradient of any function built from ops, against central differences.
 *
 * A case is a function from a few input tensors to outputs; the loss is a fixed random weighting of
 * all outputs. Every op and layer has a row in a table of cases (op_table_*.c); test_ops walks it:
 * gradients in double, and the float build's outputs and gradients against numbers that the double
 * build would give cannot be seen here, so each row also states its float tolerance for the
 * directional derivative.
 */
#ifndef LF_TESTS_GRADCHECK_H
#define LF_TESTS_GRADCHECK_H

#include "autograd/autograd.h"

enum { CASE_INPUTS = 6 };

/* What random values an input gets. */
enum case_fill {
    FILL_NORMAL,   /* standard normal */
    FILL_POSITIVE, /* uniform in (0.2, 1.2) */
    FILL_UNIT3,    /* unit 3-vectors along the last axis, which has length 3 */
    FILL_MASK,     /* 0 or 1, no gradient */
    FILL_ZERO,     /* zeros, no check of the gradient by differences at a kink: see `kink` */
    FILL_DISTINCT  /* a shuffled sequence with gaps of 0.1 (for maxima) */
};

typedef struct case_input {
    int rank;
    long dim[LF_MAX_RANK];
    enum case_fill fill;
    bool constant; /* geometry: no gradient wanted */
} case_input;

/* Build the outputs from the inputs; returns how many it wrote to out[LF_MAX_OUT]. A case that
 * needs parameters registers them in `store` (empty at the first call, kept between calls): find
 * them by name with lf_store_find if they are there already. */
typedef int case_build(lf_tape *tape, lf_store *store, lf_tensor *const *in, lf_tensor **out);

typedef struct op_case {
    const char *name; /* "softmax: masked row" */
    case_build *build;
    case_input in[CASE_INPUTS]; /* rank -1 or all zero ends the list: use {.rank = ...} rows */
    int inputs;
    double tolerance; /* of the gradient in double; 0 = the common 1e-6 */
} op_case;

extern const op_case core_cases[], image_cases[], layer_cases[];
extern const int core_case_count, image_case_count, layer_case_count;
extern const op_case light_field_cases[];
extern const int light_field_case_count;
extern const op_case ibrnet_cases[];
extern const int ibrnet_case_count;

/* Relative error of the gradient of all inputs and parameters: the largest difference from central
 * differences (step 1e-5, Richardson-extrapolated) over the largest gradient; every element of
 * small arrays, 40 of large ones. Meaningful in the double build. */
double gradient_error(const op_case *c, uint64_t seed);

/* Forward and backward once; writes loss, and the sum of |gradient|; for smoke tests in float. */
void run_case(const op_case *c, uint64_t seed, double *loss, double *gradient_size);

#endif
