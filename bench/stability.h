/* stability.h: hard cases of geometry, layers and losses: what they compute in this precision, what
 * it must be where that is known, and how much of an error belongs to the case itself.
 *                                                                       [docs/stability.md]
 * A case is a function of one parameter (an angle, a distance, a size). It makes its inputs, runs
 * ops on them and names what came out; the gradient of a fixed weighting of all outputs to all
 * inputs follows by itself. All random numbers are a function of the case, and inputs are rounded
 * to float in both precisions: float and double solve the same problem.
 *
 * Errors of an array are the largest difference over the largest value, or over the case's scale if
 * that is larger; the largest difference itself where all values are below 1e-30. Its condition is
 * how much the array moves when inputs and parameters move by half a float's last place, over that
 * half place, and at least 1: so error / (condition * last place) is about 1 for a computation that
 * loses nothing of its own.
 *
 * Ownership: a run owns its arrays, tape and store; close it once.
 */
#ifndef LF_BENCH_STABILITY_H
#define LF_BENCH_STABILITY_H

#include "autograd/autograd.h"
#include "autograd/random.h"

enum { LF_STABILITY_INPUTS = 6, LF_STABILITY_ARRAYS = 14, LF_STABILITY_PARAMETERS = 16 };

typedef struct lf_stability lf_stability;

typedef struct lf_stability_case {
    const char *name;      /* unique */
    const char *parameter; /* what it is: "angle" */
    void (*run)(lf_stability *s);
    int count;
    double at[LF_STABILITY_PARAMETERS]; /* the parameter's values */
    double limit; /* last places that are known to be lost, where docs/stability.md says why; 0:
                     LF_STABILITY_ULPS */
} lf_stability_case;

/* The count and the values of the parameter, for a row of a table. */
#define LF_STABILITY_AT(...)                                                                       \
    .count = sizeof((double[]){__VA_ARGS__}) / sizeof(double), .at = {__VA_ARGS__}

/* More last places of an error than this are marked, and so are larger differences. */
#define LF_STABILITY_ULPS 10.0
#define LF_STABILITY_DIFFERENCE 1e-6
double lf_stability_limit(const lf_stability_case *c);

typedef struct lf_stability_table {
    const lf_stability_case *cases;
    int count;
} lf_stability_table;

extern const lf_stability_table lf_stability_rays;       /* stability_rays.c */
extern const lf_stability_table lf_stability_points;     /* stability_points.c */
extern const lf_stability_table lf_stability_far;        /* stability_far.c */
extern const lf_stability_table lf_stability_attention;  /* stability_attention.c */
extern const lf_stability_table lf_stability_degenerate; /* stability_degenerate.c */
extern const lf_stability_table lf_stability_sums;       /* stability_sums.c */
extern const lf_stability_table lf_stability_images;     /* stability_images.c */
extern const lf_stability_table lf_stability_systems;    /* stability_systems.c */

/* All tables in their order: case number i, NULL beyond the last. */
const lf_stability_case *lf_stability_at(int i);
const lf_stability_case *lf_stability_find(const char *name);

/* ---- one run --------------------------------------------------------------------------------- */

/* What a case computed under one name. */
typedef struct lf_stability_array {
    const char *name; /* a constant of the case, or the input's whose gradient it is */
    bool gradient;
    long count;
    double *value;
    long double *exact;            /* NULL: not known */
    double least;                  /* of the condition */
    double condition, error, ulps; /* lf_stability_measure; NAN: not known */
} lf_stability_array;

struct lf_stability {
    const lf_stability_case *c;
    double parameter;
    lf_tape *tape;
    lf_store *store; /* empty at first, for layers' parameters */
    /* set by the case */
    double condition; /* of all arrays, at least; default 1 */
    double geometry;  /* condition of what is double in both precisions, as positions; default 0 */
    double scale; /* what numbers are small beside, if all of an array may be rounding; default 0 */
    bool pictures; /* inputs are pixels: they move by half a last place of 1, not of their own */
    double step;   /* of differences, in units of their input; default 1e-4; 0: none are made */
    /* made by the functions below */
    int arrays;
    lf_stability_array array[LF_STABILITY_ARRAYS];
    struct lf_stability_state *state;
};

/* Run a case at a parameter, with gradients. */
lf_stability *lf_stability_open(const lf_stability_case *c, double parameter);
void lf_stability_close(lf_stability *s);
bool lf_stability_finite(const lf_stability *s);

/* Fill in every array's condition, and its error against `exact`; gradients without one are
 * compared with central differences in the double build. Runs the case some dozens of times. */
void lf_stability_measure(lf_stability *s);
/* The same error against other numbers [count], as of a program in double, in units of this
 * build's last place times `condition`. */
void lf_stability_compare(const lf_stability *s, lf_stability_array *a, const double *other,
                          double condition);
/* A last place of float or double times the condition, and what geometry in double adds. */
double lf_stability_unit(const lf_stability *s, double condition);

/* ---- for cases ------------------------------------------------------------------------------- */

/* A leaf of normal numbers times `scale`, with a gradient. `scale` is also the unit of the steps of
 * its differences: s->step units. */
lf_tensor *lf_stability_input(lf_stability *s, const char *name, int rank, const long *dim,
                              double scale);
/* The same with a unit of its own, for inputs that are smaller than where the function bends. */
lf_tensor *lf_stability_small(lf_stability *s, const char *name, int rank, const long *dim,
                              double scale, double unit);
/* Given numbers, rounded to float. */
lf_tensor *lf_stability_given(lf_stability *s, const char *name, int rank, const long *dim,
                              const double *value, double unit);
/* Numbers without a gradient, not rounded and not moved: geometry and masks. */
lf_tensor *lf_stability_constant(lf_stability *s, int rank, const long *dim, const double *value);
/* Round what layers put into s->store, once all of them are there; what starts at 0 or 1 for all
 * channels (biases, gains) gets some variety. Its gradient is an array. */
void lf_stability_parameters(lf_stability *s);

/* Call done(x) when the run is closed: for models, which must outlive the backward walk. */
void lf_stability_keep(lf_stability *s, void (*done)(void *x), void *x);

/* An output; its exact values [x->size] or NULL. */
void lf_stability_output(lf_stability *s, const char *name, lf_tensor *x, const long double *exact);
/* Numbers that no gradient flows into. */
void lf_stability_numbers(lf_stability *s, const char *name, long count, const double *value,
                          const long double *exact);
/* Number i of the weights of an output in the loss, the outputs counted from 0. */
double lf_stability_weight(int output, long i);
/* The gradient of an input is known: [size]. Before the case returns. */
void lf_stability_gradient(lf_stability *s, const char *input, const long double *exact);
/* A condition of that gradient which random moves do not show: of sums whose terms cancel. */
void lf_stability_condition(lf_stability *s, const char *input, double condition);

#endif
