/* test_along_ray.c: attention along the ray, in rows and in blocks, against its formula as plain
 * loops in double: results, and gradients along a direction. The sizes are those at which vectors,
 * panels and blocks of points end early; memory that is not written first holds NaN.
 *                                                                          [method.md 2.8, 5b.5]
 */
#include "autograd/random.h"
#include "layers/light_blocks.h"
#include "tests/close.h"

#define EXACT (sizeof(lf_real) == 8) /* the double build */

enum { BASIS = LF_ALONG_BASIS, INPUTS = 5, VIEWS = 2 };

typedef struct shape {
    long rays, samples, types, more, channels; /* more: planes of scalars */
    int heads;
} shape;

static const shape shapes[] = {
    {1, 1, 1, 0, 1, 1},  {3, 1, 2, 0, 2, 1},  {2, 3, 3, 0, 3, 3},   {2, 7, 2, 0, 5, 1},
    {2, 8, 2, 0, 5, 5},  {3, 9, 1, 0, 4, 2},  {1, 15, 3, 0, 4, 2},  {3, 16, 2, 0, 3, 1},
    {2, 17, 3, 0, 1, 1}, {1, 31, 2, 0, 6, 2}, {2, 32, 1, 0, 2, 1},  {1, 33, 9, 0, 2, 2},
    {1, 48, 2, 0, 3, 3}, {1, 53, 2, 0, 7, 7}, {2, 5, 1, 0, 64, 64}, {1, 65, 1, 0, 1, 1},
    {2, 7, 1, 2, 3, 1},  {2, 17, 3, 1, 4, 2}, {1, 33, 2, 4, 2, 2},  {3, 9, 4, 7, 2, 1},
};
enum { SHAPES = sizeof shapes / sizeof *shapes };

static long row_of(const shape *s)
{
    return (2 * s->types - 1 + s->more) * s->channels;
}

/* Of q, k, v [N, S, P C] and the profiles of keys and values [BASIS, P C]. */
static long size_of(const shape *s, int input)
{
    return (input < 3 ? s->rays * s->samples : BASIS) * row_of(s);
}

/* ---- the formula ------------------------------------------------------------------------------
 */

typedef struct complex_number {
    double re, im;
} complex_number;

static complex_number times(complex_number a, complex_number b)
{
    return (complex_number){a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
}

/* Number c of part t of a row [P, C]: the planes of scalars, then the types. */
static long part_at(const shape *s, long t, long c)
{
    return (t <= s->more ? t : 2 * t - s->more - 1) * s->channels + c;
}

static complex_number number_at(const shape *s, const double *row, long t, long c)
{
    const long re = part_at(s, t, c);
    return (complex_number){row[re], t > s->more ? row[re + s->channels] : 0};
}

/* c(D) x */
static complex_number turned(const shape *s, const double *profile, double d, const double *x,
                             long t, long c)
{
    const double spacing = 2.0 / (BASIS - 1);
    complex_number by = {1, 0};
    for (int b = 0; b < BASIS; b++) {
        const double u = (d + 1 - b * spacing) / spacing;
        const complex_number w = number_at(s, profile + b * row_of(s), t, c);
        by.re += w.re * exp(-u * u / 2);
        by.im += w.im * exp(-u * u / 2);
    }
    return times(by, number_at(s, x, t, c));
}

/* Weights [S] of query i of a ray, one head: softmax over the keys; 0 without one. */
static void weigh(const shape *s, const double *const x[INPUTS], const double *depth,
                  const double *count, long first, long i, int head, double *weight)
{
    const long per = s->channels / s->heads, n = row_of(s);
    double sum = 0, largest = -INFINITY;
    for (long j = 0; j < s->samples; j++) {
        const double d = depth[first + j] - depth[first + i];
        weight[j] = 0;
        for (long t = 0; t < s->types + s->more; t++)
            for (long c = head * per; c < (head + 1) * per; c++) {
                const complex_number q = number_at(s, x[0] + (first + i) * n, t, c);
                const complex_number k = turned(s, x[3], d, x[1] + (first + j) * n, t, c);
                weight[j] += (q.re * k.re + q.im * k.im) / sqrt((double)n / s->heads);
            }
        if (count[first + j] >= LF_KEY_VIEWS)
            largest = fmax(largest, weight[j]);
    }
    for (long j = 0; j < s->samples; j++)
        sum += weight[j] = count[first + j] >= LF_KEY_VIEWS ? exp(weight[j] - largest) : 0;
    for (long j = 0; sum > 0 && j < s->samples; j++)
        weight[j] /= sum;
}

static void formula(const shape *s, const double *const x[INPUTS], const double *depth,
                    const double *count, double *y)
{
    const long n = row_of(s), per = s->channels / s->heads;
    double *weight = malloc((size_t)s->samples * sizeof *weight);
    memset(y, 0, (size_t)size_of(s, 0) * sizeof *y);
    for (long p = 0; p < s->rays * s->samples; p++)
        for (int h = 0; h < s->heads; h++) {
            const long first = p / s->samples * s->samples;
            weigh(s, x, depth, count, first, p - first, h, weight);
            for (long j = first; j < first + s->samples; j++)
                for (long t = 0; t < s->types + s->more; t++)
                    for (long c = h * per; c < (h + 1) * per; c++) {
                        const complex_number v =
                            turned(s, x[4], depth[j] - depth[p], x[2] + j * n, t, c);
                        double *to = y + p * n + part_at(s, t, c);
                        to[0] += weight[j - first] * v.re;
                        if (t > s->more)
                            to[s->channels] += weight[j - first] * v.im;
                    }
        }
    free(weight);
}

/* ---- a case ------------------------------------------------------------------------------------
 */

typedef struct attention_case {
    shape s;
    double *x[INPUTS], *along[INPUTS], *g; /* inputs, a direction, the gradient of y */
    double *depth, *count;
} attention_case;

/* Numbers that float has, too. */
static double *numbers(long n, double scale, uint64_t item)
{
    double *x = malloc((size_t)n * sizeof *x);
    lf_stream r = lf_stream_at(11, LF_RANDOM_TEST, 31, item);
    for (long i = 0; i < n; i++)
        x[i] = (double)(float)(scale * lf_normal(&r));
    return x;
}

static attention_case make_case(shape s)
{
    attention_case c = {.s = s};
    const long points = s.rays * s.samples;
    for (int i = 0; i < INPUTS; i++) {
        c.x[i] = numbers(size_of(&s, i), i < 3 ? 1 : 0.5, (uint64_t)i);
        c.along[i] = numbers(size_of(&s, i), 1, 10 + (uint64_t)i);
    }
    c.g = numbers(size_of(&s, 0), 1, 20);
    c.depth = numbers(points, 1, 21);
    c.count = numbers(points, 1, 22);
    for (long p = 0; p < points; p++) { /* not in order: the op need not know */
        c.depth[p] = (double)(float)(0.5 + 0.5 * sin(7 * c.depth[p]));
        c.count[p] = s.samples > 1 && p % 5 == 1 ? 1 : 2;
    }
    return c;
}

static void free_case(attention_case *c)
{
    for (int i = 0; i < INPUTS; i++) {
        free(c->x[i]);
        free(c->along[i]);
    }
    free(c->g);
    free(c->depth);
    free(c->count);
}

static lf_tensor *filled(lf_tape *tape, int rank, const long *dim, const double *x)
{
    lf_tensor *t = lf_tensor_new(tape, rank, dim);
    for (long i = 0; i < t->size; i++)
        t->value[i] = (lf_real)(x ? x[i] : 1);
    return t;
}

static lf_light_geometry geometry_of(lf_tape *tape, const attention_case *c)
{
    const shape *s = &c->s;
    const long n = s->rays, phases = 2 * s->types - 1;
    lf_light_geometry g = {
        n,    s->samples, VIEWS, {.count = (int)s->types, .omega = {0}, .more = (int)s->more},
        NULL, NULL,       NULL,  NULL,
        NULL};
    for (int t = 1; t < s->types; t++)
        g.types.omega[t] = t;
    g.phase = filled(tape, 3, LF_DIMS(n, VIEWS, phases), NULL);
    g.angle = filled(tape, 4, LF_DIMS(n, s->samples, VIEWS, 3), NULL);
    g.mask = filled(tape, 3, LF_DIMS(n, s->samples, VIEWS), NULL);
    g.count = filled(tape, 2, LF_DIMS(n, s->samples), c->count);
    g.depth = filled(tape, 2, LF_DIMS(n, s->samples), c->depth);
    return g;
}

/* y in rows, and the inputs' gradients added to grad. */
static lf_tensor *run(lf_tape *tape, const attention_case *c, bool blocks, lf_real *const *grad)
{
    const shape *s = &c->s;
    const long n = row_of(s);
    const lf_light_geometry g = geometry_of(tape, c);
    lf_tensor *x[INPUTS], *y;
    for (int i = 0; i < INPUTS; i++) {
        const long rows[3] = {s->rays, s->samples, n}, profile[2] = {BASIS, n};
        const lf_tensor *t = filled(tape, i < 3 ? 3 : 2, i < 3 ? rows : profile, c->x[i]);
        x[i] = lf_leaf(tape, t->rank, t->dim, t->value, grad[i]);
    }
    if (blocks) {
        const lf_blocks k = lf_blocks_make(tape, &g);
        for (int i = 0; i < 3; i++)
            x[i] = lf_blocks_of_points(tape, &k, x[i]);
        y = lf_blocks_rows(
            tape, &k, lf_blocks_along_attention(tape, &k, x[0], x[1], x[2], x[3], x[4], s->heads));
    } else
        y = lf_along_ray_attention(tape, x[0], x[1], x[2], x[3], x[4], &g, s->heads);
    lf_real *dy = lf_grad(tape, y);
    for (long i = 0; i < y->size; i++)
        dy[i] = (lf_real)c->g[i];
    lf_backward_from(tape);
    return y;
}

/* A tape whose memory holds NaN. */
static lf_tape *nan_tape(void)
{
    enum { BYTES = 48 << 20 };
    lf_tape *tape = lf_tape_create();
    lf_alloc(tape, BYTES);
    lf_tape_reset(tape);
    memset(lf_alloc(tape, BYTES), 0xff, BYTES);
    lf_tape_reset(tape);
    return tape;
}

/* d<g, y> / dt of inputs x + t along, by central differences of the formula. */
static double slope(const attention_case *c)
{
    const double step = 1e-5;
    double result = 0, *moved[INPUTS], *y = malloc((size_t)size_of(&c->s, 0) * sizeof *y);
    for (int side = -1; side <= 1; side += 2) {
        for (int i = 0; i < INPUTS; i++) {
            const long n = size_of(&c->s, i);
            moved[i] = malloc((size_t)n * sizeof *moved[i]);
            for (long k = 0; k < n; k++)
                moved[i][k] = c->x[i][k] + side * step * c->along[i][k];
        }
        formula(&c->s, (const double *const *)moved, c->depth, c->count, y);
        for (long i = 0; i < size_of(&c->s, 0); i++)
            result += side * c->g[i] * y[i] / (2 * step);
        for (int i = 0; i < INPUTS; i++)
            free(moved[i]);
    }
    free(y);
    return result;
}

static void check(const attention_case *c, bool blocks)
{
    const long size = size_of(&c->s, 0);
    lf_real *grad[INPUTS];
    for (int i = 0; i < INPUTS; i++)
        grad[i] = calloc((size_t)size_of(&c->s, i), sizeof **grad);
    double *expected = malloc((size_t)size * sizeof *expected), sum = 0, squares = 0;
    lf_tape *tape = nan_tape();
    const lf_tensor *y = run(tape, c, blocks, grad);
    formula(&c->s, (const double *const *)c->x, c->depth, c->count, expected);
    assert_below(relative_error(y->value, expected, size), EXACT ? 1e-12 : 1e-5);
    for (int i = 0; i < INPUTS; i++)
        for (long k = 0; k < size_of(&c->s, i); k++) {
            const double term = (double)grad[i][k] * c->along[i][k];
            sum += term;
            squares += term * term;
        }
    assert_close(sum, slope(c), 0, (EXACT ? 1e-8 : 2e-5) * sqrt(squares));
    lf_tape_free(tape);
    free(expected);
    for (int i = 0; i < INPUTS; i++)
        free(grad[i]);
}

static void rows_and_blocks(void **state)
{
    (void)state;
    for (int k = 0; k < SHAPES; k++) {
        attention_case c = make_case(shapes[k]);
        check(&c, false);
        check(&c, true);
        free_case(&c);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(rows_and_blocks)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
