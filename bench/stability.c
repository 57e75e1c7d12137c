/* stability.c: see stability.h. */
#include <stdlib.h>

#include "bench/stability.h"

enum { DRAWS = 4, DIFFERENCES = 12 };

static const lf_stability_table *const tables[] = {
    &lf_stability_rays,       &lf_stability_points, &lf_stability_far,    &lf_stability_attention,
    &lf_stability_degenerate, &lf_stability_sums,   &lf_stability_images, &lf_stability_systems};
enum { TABLES = sizeof tables / sizeof *tables };

static const double smallest = 1e-30; /* below this a number is 0: float ends soon after */

#ifdef LF_DOUBLE
static const bool exact_build = true;
static const double last_place = 2.220446049250313e-16, nudge = 5.9604644775390625e-8;
#else
static const bool exact_build = false;
/* moves well above rounding, so that rounding does not look like the case's condition */
static const double last_place = 1.1920928955078125e-7, nudge = 4.8828125e-4;
#endif

/* How a run differs from the first one of its case. */
typedef struct change {
    double nudge; /* relative, of all inputs and parameters */
    int draw;
    int input; /* of which one number is moved; -1: none; the store is LF_STABILITY_INPUTS */
    long at;
    double by;
} change;

typedef struct input {
    const char *name;
    lf_tensor *x;
    double unit;        /* of the steps of differences */
    long double *exact; /* of the gradient */
    double condition;   /* at least */
} input;

struct lf_stability_state {
    change change;
    int inputs, outputs;
    input input[LF_STABILITY_INPUTS];
    lf_tensor *output[LF_STABILITY_ARRAYS];
    bool stored;
    void (*done)(void *x);
    void *kept;
};

static void *room(long count, size_t size)
{
    void *p = calloc(count > 0 ? (size_t)count : 1, size);
    LF_REQUIRE(p, "out of memory for %ld times %zu bytes", count, size);
    return p;
}

/* ---- cases ----------------------------------------------------------------------------------- */

const lf_stability_case *lf_stability_at(int i)
{
    for (int t = 0; t < TABLES; t++) {
        if (i < tables[t]->count)
            return &tables[t]->cases[i];
        i -= tables[t]->count;
    }
    return NULL;
}

const lf_stability_case *lf_stability_find(const char *name)
{
    const lf_stability_case *c;
    for (int i = 0; (c = lf_stability_at(i)); i++)
        if (strcmp(c->name, name) == 0)
            return c;
    return NULL;
}

double lf_stability_limit(const lf_stability_case *c)
{
    return c->limit > 0 ? c->limit : LF_STABILITY_ULPS;
}

/* ---- inputs ---------------------------------------------------------------------------------- */

/* The numbers of input i as this run has them: rounded to float, then moved. */
static void settle(const lf_stability *s, int i, long count, lf_real *x)
{
    const change *c = &s->state->change;
    lf_stream r = lf_stream_at(71, LF_RANDOM_TEST, (uint64_t)c->draw, (uint64_t)i);
    for (long k = 0; k < count; k++) {
        x[k] = (lf_real)(float)x[k];
        const double move = c->nudge * (2 * lf_uniform(&r) - 1);
        if (c->nudge > 0)
            x[k] += (lf_real)(move * (s->pictures && i < LF_STABILITY_INPUTS ? 1 : (double)x[k]));
        if (c->input == i && c->at == k)
            x[k] += (lf_real)c->by;
    }
}

static lf_tensor *leaf(lf_stability *s, const char *name, int rank, const long *dim,
                       const double *value, double scale, double unit, bool wants)
{
    long size = 1;
    for (int i = 0; i < rank; i++)
        size *= dim[i];
    lf_real *x = lf_alloc_reals(s->tape, size), *grad = NULL;
    lf_stream r = lf_stream_at(72, LF_RANDOM_TEST, lf_name_hash(s->c->name), lf_name_hash(name));
    for (long i = 0; i < size; i++)
        x[i] = (lf_real)(value ? value[i] : scale * lf_normal(&r));
    if (!wants)
        return lf_leaf(s->tape, rank, dim, x, NULL);
    struct lf_stability_state *t = s->state;
    LF_REQUIRE(t->inputs < LF_STABILITY_INPUTS, "%s: too many inputs", s->c->name);
    settle(s, t->inputs, size, x);
    grad = lf_alloc_reals(s->tape, size);
    memset(grad, 0, (size_t)size * sizeof *grad);
    t->input[t->inputs] = (input){name, lf_leaf(s->tape, rank, dim, x, grad), unit, NULL, 1};
    return t->input[t->inputs++].x;
}

lf_tensor *lf_stability_input(lf_stability *s, const char *name, int rank, const long *dim,
                              double scale)
{
    return leaf(s, name, rank, dim, NULL, scale, scale, true);
}

lf_tensor *lf_stability_small(lf_stability *s, const char *name, int rank, const long *dim,
                              double scale, double unit)
{
    return leaf(s, name, rank, dim, NULL, scale, unit, true);
}

lf_tensor *lf_stability_given(lf_stability *s, const char *name, int rank, const long *dim,
                              const double *value, double unit)
{
    return leaf(s, name, rank, dim, value, 1, unit, true);
}

lf_tensor *lf_stability_constant(lf_stability *s, int rank, const long *dim, const double *value)
{
    return leaf(s, "", rank, dim, value, 1, 1, false);
}

void lf_stability_parameters(lf_stability *s)
{
    for (int i = 0; i < lf_store_count(s->store); i++) {
        const lf_parameter *p = lf_store_at(s->store, i);
        lf_stream r = lf_stream_at(76, LF_RANDOM_TEST, 0, lf_name_hash(p->name));
        for (long k = 0; p->rank == 1 && p->trainable && k < p->size; k++)
            lf_values(p)[k] += (lf_real)(0.3 * lf_normal(&r));
    }
    settle(s, LF_STABILITY_INPUTS, lf_store_size(s->store), lf_store_values(s->store));
    lf_store_zero_grads(s->store);
    s->state->stored = true;
}

void lf_stability_keep(lf_stability *s, void (*done)(void *x), void *x)
{
    LF_REQUIRE(!s->state->done, "%s: one thing is kept already", s->c->name);
    s->state->done = done;
    s->state->kept = x;
}

/* ---- outputs --------------------------------------------------------------------------------- */

static lf_stability_array *add_array(lf_stability *s, const char *name, bool gradient, long count,
                                     const long double *exact)
{
    LF_REQUIRE(s->arrays < LF_STABILITY_ARRAYS, "%s: too many arrays", s->c->name);
    lf_stability_array *a = &s->array[s->arrays++];
    *a = (lf_stability_array){.name = name,
                              .gradient = gradient,
                              .count = count,
                              .value = room(count, sizeof(double)),
                              .least = 1,
                              .condition = NAN,
                              .error = NAN,
                              .ulps = NAN};
    if (exact) {
        a->exact = room(count, sizeof *exact);
        memcpy(a->exact, exact, (size_t)count * sizeof *exact);
    }
    return a;
}

void lf_stability_output(lf_stability *s, const char *name, lf_tensor *x, const long double *exact)
{
    lf_stability_array *a = add_array(s, name, false, x->size, exact);
    for (long i = 0; i < x->size; i++)
        a->value[i] = (double)x->value[i];
    s->state->output[s->state->outputs++] = x;
}

void lf_stability_numbers(lf_stability *s, const char *name, long count, const double *value,
                          const long double *exact)
{
    lf_stability_array *a = add_array(s, name, false, count, exact);
    memcpy(a->value, value, (size_t)count * sizeof *value);
}

double lf_stability_weight(int output, long i)
{
    lf_stream r = lf_stream_at(73, LF_RANDOM_TEST, (uint64_t)output, (uint64_t)i);
    return (double)(float)(0.5 + lf_uniform(&r));
}

static input *input_named(lf_stability *s, const char *name)
{
    for (int i = 0; i < s->state->inputs; i++)
        if (strcmp(s->state->input[i].name, name) == 0)
            return &s->state->input[i];
    LF_REQUIRE(false, "%s: no input %s", s->c->name, name);
}

void lf_stability_gradient(lf_stability *s, const char *name, const long double *exact)
{
    input *in = input_named(s, name);
    in->exact = lf_alloc(s->tape, (size_t)in->x->size * sizeof *exact);
    memcpy(in->exact, exact, (size_t)in->x->size * sizeof *exact);
}

void lf_stability_condition(lf_stability *s, const char *name, double condition)
{
    input_named(s, name)->condition = condition;
}

/* ---- running --------------------------------------------------------------------------------- */

static double loss_of(const lf_stability *s)
{
    double loss = 0;
    for (int o = 0; o < s->state->outputs; o++)
        for (long i = 0; i < s->state->output[o]->size; i++)
            loss += lf_stability_weight(o, i) * (double)s->state->output[o]->value[i];
    return loss;
}

static void add_gradient(lf_stability *s, const char *name, long count, const lf_real *x,
                         const long double *exact, double least)
{
    lf_stability_array *a = add_array(s, name, true, count, exact);
    a->least = least;
    for (long i = 0; i < count; i++)
        a->value[i] = (double)x[i];
}

static void backward(lf_stability *s)
{
    const struct lf_stability_state *t = s->state;
    bool any = false;
    for (int o = 0; o < t->outputs; o++) {
        lf_real *g = t->output[o]->wants ? lf_grad(s->tape, t->output[o]) : NULL;
        for (long i = 0; g && i < t->output[o]->size; i++)
            g[i] += (lf_real)lf_stability_weight(o, i);
        any |= g != NULL;
    }
    if (!any)
        return;
    lf_backward_from(s->tape);
    for (int i = 0; i < t->inputs; i++)
        add_gradient(s, t->input[i].name, t->input[i].x->size, t->input[i].x->grad,
                     t->input[i].exact, t->input[i].condition);
    if (t->stored)
        add_gradient(s, "parameters", lf_store_size(s->store), lf_store_grads(s->store), NULL, 1);
}

static lf_stability *open_changed(const lf_stability_case *c, double parameter, change by,
                                  bool gradients)
{
    lf_stability *s = room(1, sizeof *s);
    *s = (lf_stability){.c = c,
                        .parameter = parameter,
                        .tape = lf_tape_create(),
                        .store = lf_store_create(5),
                        .condition = 1,
                        .step = 1e-4,
                        .state = room(1, sizeof *s->state)};
    s->state->change = by;
    lf_tape_set_grad(s->tape, gradients);
    c->run(s);
    if (gradients)
        backward(s);
    return s;
}

lf_stability *lf_stability_open(const lf_stability_case *c, double parameter)
{
    return open_changed(c, parameter, (change){.input = -1}, true);
}

void lf_stability_close(lf_stability *s)
{
    for (int i = 0; i < s->arrays; i++) {
        free(s->array[i].value);
        free(s->array[i].exact);
    }
    if (s->state->done)
        s->state->done(s->state->kept);
    lf_tape_free(s->tape);
    lf_store_free(s->store);
    free(s->state);
    free(s);
}

bool lf_stability_finite(const lf_stability *s)
{
    for (int a = 0; a < s->arrays; a++)
        for (long i = 0; i < s->array[a].count; i++)
            if (!isfinite(s->array[a].value[i]))
                return false;
    return true;
}

/* ---- measuring ------------------------------------------------------------------------------- */

static double larger(double a, double b)
{
    return a > b || isnan(a) ? a : b; /* a NaN stays */
}

/* Conditions of all arrays: the most that they move when all inputs do, of some draws. */
static void find_conditions(lf_stability *s)
{
    for (int a = 0; a < s->arrays; a++)
        s->array[a].condition = larger(s->condition, s->array[a].least);
    for (int draw = 0; draw < DRAWS; draw++) {
        lf_stability *moved =
            open_changed(s->c, s->parameter, (change){nudge, draw, -1, 0, 0}, true);
        for (int a = 0; a < s->arrays; a++) {
            lf_stability_array *x = &s->array[a];
            double size = 0, most = 0;
            for (long i = 0; i < x->count; i++) {
                size = larger(fabs(x->value[i]), size);
                most = larger(fabs(moved->array[a].value[i] - x->value[i]), most);
            }
            size = larger(s->scale, size);
            x->condition = larger(most / (size > smallest ? size : 1) / nudge, x->condition);
        }
        lf_stability_close(moved);
    }
}

double lf_stability_unit(const lf_stability *s, double condition)
{
    return last_place * condition + 2.220446049250313e-16 * s->geometry;
}

static void set_error(const lf_stability *s, lf_stability_array *a, long double most,
                      long double size, double condition)
{
    size = size > s->scale ? size : (long double)s->scale;
    a->error = (double)(size > smallest ? most / size : most);
    a->ulps = a->error / lf_stability_unit(s, condition);
}

static void compare_exact(const lf_stability *s, lf_stability_array *a)
{
    long double most = 0, size = 0;
    for (long i = 0; i < a->count; i++) {
        const long double d = fabsl((long double)a->value[i] - a->exact[i]);
        most = d > most || isnan(d) ? d : most;
        size = fabsl(a->exact[i]) > size ? fabsl(a->exact[i]) : size;
    }
    set_error(s, a, most, size, a->condition);
}

void lf_stability_compare(const lf_stability *s, lf_stability_array *a, const double *other,
                          double condition)
{
    double most = 0, size = 0;
    for (long i = 0; i < a->count; i++) {
        most = larger(fabs(a->value[i] - other[i]), most);
        size = larger(fabs(other[i]), size);
    }
    a->condition = condition;
    set_error(s, a, most, size, condition);
}

/* Central differences of the loss, Richardson-extrapolated; *noise: at least their rounding. */
static double slope(const lf_stability *s, int in, long at, double h, double *noise)
{
    double d[2];
    for (int half = 0; half < 2; half++) {
        double loss[2];
        for (int side = 0; side < 2; side++) {
            const double by = (side ? -1 : 1) * (half ? h / 2 : h);
            lf_stability *moved =
                open_changed(s->c, s->parameter, (change){0, 0, in, at, by}, false);
            loss[side] = loss_of(moved);
            *noise = larger(last_place * fabs(loss[side]) / h, *noise);
            lf_stability_close(moved);
        }
        d[half] = (loss[0] - loss[1]) / (half ? h : 2 * h);
    }
    return (4 * d[1] - d[0]) / 3;
}

/* Whether number i of the store is one that optimisers change. */
static bool trainable(const lf_store *store, long i)
{
    for (int p = 0; p < lf_store_count(store); p++) {
        const lf_parameter *q = lf_store_at(store, p);
        if (i >= q->offset && i < q->offset + q->size)
            return q->trainable;
    }
    return false;
}

/* Some numbers of a gradient against differences, which do not see slopes below the loss's rounding
 * over the step. */
static void compare_slopes(const lf_stability *s, lf_stability_array *a, int in, double unit)
{
    double most = 0, size = s->scale, noise = 0;
    const long stride = a->count > DIFFERENCES ? a->count / DIFFERENCES : 1;
    for (long i = 0; i < a->count; i++)
        size = larger(fabs(a->value[i]), size);
    for (long i = stride / 2; i < a->count; i += stride)
        if (in < LF_STABILITY_INPUTS || trainable(s->store, i))
            most = larger(fabs(slope(s, in, i, s->step * unit, &noise) - a->value[i]), most);
    size = larger(1e7 * noise, size);
    a->error = size > 0 ? most / size : most;
}

static void find_gradient_errors(lf_stability *s)
{
    const struct lf_stability_state *t = s->state;
    int in = 0;
    for (int k = 0; k < s->arrays; k++) {
        lf_stability_array *a = &s->array[k];
        if (!a->gradient)
            continue;
        const bool stored = in == t->inputs;
        if (!a->exact && exact_build && s->step > 0)
            compare_slopes(s, a, stored ? LF_STABILITY_INPUTS : in, stored ? 1 : t->input[in].unit);
        in++;
    }
}

void lf_stability_measure(lf_stability *s)
{
    find_conditions(s);
    for (int a = 0; a < s->arrays; a++)
        if (s->array[a].exact)
            compare_exact(s, &s->array[a]);
    find_gradient_errors(s);
}
