/* reference.h: what a piece of work computes in float against the same in double.
 *
 * A program of this kind is built twice from one source, NAME in float and NAME-f64 in double, side
 * by side. Work gives what it computes as named arrays (lf_outputs). NAME starts NAME-f64 with the
 * same work, reads its arrays from a pipe and compares. Both start from the same numbers: inputs
 * and parameters are rounded to float in both (lf_reference_input, lf_reference_round), so that
 * what differs is how they are computed.
 *
 *     lf_outputs *got = lf_outputs_create(), *exact;
 *     lf_outputs_add(got, "colour", count, colour);
 *     LF_TRY(lf_reference_find("elf-bench-f64", path, sizeof path, err));
 *     LF_TRY(lf_reference_run((const char *[]){path, "--reference", "conv-64", NULL}, &exact,
 * err)); LF_TRY(lf_outputs_compare(got, exact, errors, err));
 *
 * Ownership: outputs copy what is added. Errors: LF_FAILED with what is missing or does not fit.
 * Threads: outputs belong to one at a time.
 */
#ifndef LF_BENCH_REFERENCE_H
#define LF_BENCH_REFERENCE_H

#include "autograd/real.h"
#include "autograd/status.h"

enum { LF_OUTPUTS_MAX = 16, LF_OUTPUT_NAME = 32 };

/* ---- inputs ---------------------------------------------------------------------------------- */

/* The nearest float, in either precision. */
static inline lf_real lf_reference_input(double x)
{
    return (lf_real)(float)x;
}

/* The same for numbers that are there already: a store's parameters. */
void lf_reference_round(long count, lf_real *x);
/* The same for inputs that are double in both precisions. */
void lf_reference_round_doubles(long count, double *x);

/* ---- outputs --------------------------------------------------------------------------------- */

typedef struct lf_output {
    char name[LF_OUTPUT_NAME];
    long count;
    double *value; /* [count] */
} lf_output;

typedef struct lf_outputs {
    int count;
    lf_output array[LF_OUTPUTS_MAX];
} lf_outputs;

lf_outputs *lf_outputs_create(void);
void lf_outputs_free(lf_outputs *outputs);
/* Append a copy of value [count] under a name that is new. */
void lf_outputs_add(lf_outputs *outputs, const char *name, long count, const lf_real *value);
void lf_outputs_add_floats(lf_outputs *outputs, const char *name, long count, const float *value);
void lf_outputs_add_doubles(lf_outputs *outputs, const char *name, long count, const double *value);

/* To and from another program on the same machine. `name` stands for the file in messages. */
lf_status lf_outputs_write(const lf_outputs *outputs, FILE *file, const char *name, lf_error *err);
lf_status lf_outputs_read(FILE *file, const char *name, lf_outputs **out, lf_error *err);

/* ---- errors ---------------------------------------------------------------------------------- */

typedef struct lf_output_error {
    char name[LF_OUTPUT_NAME]; /* of the array */
    double largest;            /* largest |got - exact| over largest |exact| */
    double l2;                 /* root of the sum of squares of got - exact over that of exact */
} lf_output_error;

/* The error of each array of `got` into errors[0 .. got->count). LF_FAILED: other arrays, numbers
 * that are not finite, or an exact array of zeros beside one that is not. */
lf_status lf_outputs_compare(const lf_outputs *got, const lf_outputs *exact,
                             lf_output_error *errors, lf_error *err);

/* ---- the program in double ------------------------------------------------------------------- */

/* The path of the program `name` beside this one. LF_FAILED: there is none. */
lf_status lf_reference_find(const char *name, char *path, size_t size, lf_error *err);
/* Run the program argv[0] (a path; argv ends with NULL) and read the outputs that it writes to its
 * standard output. */
lf_status lf_reference_run(const char *const *argv, lf_outputs **out, lf_error *err);

#endif
