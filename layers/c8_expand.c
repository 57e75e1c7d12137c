/* c8_expand.c: steerable weights to an ordinary filter, and back.    [c8.h; method.md 5a.1, 4.9]
 *
 *   forward    W[p; i, r; o, a] = sum_b w[o][i][(r - a) mod 8][b] B[p][b][a]
 *   backward   dw[o][i][s][b] += sum_{p, a} dW[p; i, (s + a) mod 8; o, a] B[p][b][a]
 *              (a lift has one r and no s)
 *
 * The eight orientations a of one output field are one vector. Written backwards and twice,
 * t[u] = w[(-u) mod 8] for u = 0..15, the weights that the vector needs for input orientation r are
 * the eight adjacent numbers t[8 - r + a]; no number is gathered one by one, and the transpose adds
 * into the same places.
 *
 * Keeps      w and the basis table.
 * Cost       2 count flops a number of the filter, forward and backward.
 * Threads    input fields are independent.
 */
#include "layers/c8.h"

/* The eight orientations; loads and stores of any alignment. */
typedef lf_real vec
    __attribute__((vector_size(LF_C8 * sizeof(lf_real)), aligned(sizeof(lf_real)), may_alias));

enum { DOUBLED = 2 * LF_C8 };

typedef struct shape {
    long pixels, count, in, out,
        turns; /* in, out: fields; turns: 8 orientations of the input or 1 */
} shape;

static shape shape_of(const lf_c8_basis *basis, const lf_tensor *w)
{
    return (shape){(long)basis->size * basis->size, basis->count, w->dim[1], w->dim[0],
                   w->rank == 4 ? LF_C8 : 1};
}

/* t[out][count][16] of input field i; a lift has the same weight for every orientation. */
static void unfold(const shape *s, const lf_real *w, long i, lf_real *t)
{
    for (long o = 0; o < s->out; o++) {
        const lf_real *from = w + (o * s->in + i) * s->turns * s->count;
        for (long b = 0; b < s->count; b++, t += DOUBLED)
            for (long u = 0; u < DOUBLED; u++)
                t[u] = from[(s->turns == 1 ? 0 : (DOUBLED - u) % LF_C8) * s->count + b];
    }
}

/* The transpose: dw of input field i += what was added into t. */
static void fold(const shape *s, const lf_real *t, long i, lf_real *dw)
{
    for (long o = 0; o < s->out; o++) {
        lf_real *to = dw + (o * s->in + i) * s->turns * s->count;
        for (long b = 0; b < s->count; b++, t += DOUBLED)
            for (long u = 0; u < DOUBLED; u++)
                to[(s->turns == 1 ? 0 : (DOUBLED - u) % LF_C8) * s->count + b] += t[u];
    }
}

/* Filter numbers of input channel (i, r), all pixels and outputs: f points at pixel 0, output 0. */
static void expand_channel(const shape *s, const lf_real *table, const lf_real *t, lf_real *f)
{
    const long pixel = s->in * s->turns * s->out * LF_C8;
    for (long o = 0; o < s->out; o++, t += s->count * DOUBLED, f += LF_C8)
        for (long p = 0; p < s->pixels; p++) {
            const vec *basis = (const vec *)(table + p * s->count * LF_C8);
            vec sum = *(const vec *)t * basis[0];
            for (long b = 1; b < s->count; b++)
                sum += *(const vec *)(t + b * DOUBLED) * basis[b];
            *(vec *)(f + p * pixel) = sum;
        }
}

static void reduce_channel(const shape *s, const lf_real *table, const lf_real *df, lf_real *dt)
{
    const long pixel = s->in * s->turns * s->out * LF_C8;
    for (long o = 0; o < s->out; o++, dt += s->count * DOUBLED, df += LF_C8)
        for (long p = 0; p < s->pixels; p++) {
            const vec *basis = (const vec *)(table + p * s->count * LF_C8);
            const vec d = *(const vec *)(df + p * pixel);
            for (long b = 0; b < s->count; b++)
                *(vec *)(dt + b * DOUBLED) += d * basis[b];
        }
}

static void backward(const lf_node *node)
{
    const lf_c8_basis *basis = node->saved;
    lf_tensor *w = node->in[0];
    const shape s = shape_of(basis, w);
    const long doubled = s.out * s.count * DOUBLED;
    lf_real *t = lf_alloc_reals(node->tape, s.in * doubled);
#pragma omp parallel for schedule(static)
    for (long i = 0; i < s.in; i++) {
        lf_real *own = t + i * doubled;
        memset(own, 0, (size_t)doubled * sizeof *own);
        for (long r = 0; r < s.turns; r++)
            reduce_channel(&s, basis->table, node->out[0]->grad + (i * s.turns + r) * s.out * LF_C8,
                           own + LF_C8 - r);
        fold(&s, own, i, w->grad);
    }
}

lf_tensor *lf_c8_expand(lf_tape *tape, const lf_c8_basis *basis, lf_tensor *w)
{
    LF_REQUIRE(w->rank == 3 || (w->rank == 4 && w->dim[2] == LF_C8),
               "lf_c8_expand: weights of rank %d", w->rank);
    LF_REQUIRE(lf_cols(w) == basis->count, "lf_c8_expand: %ld weights for %d basis functions",
               lf_cols(w), basis->count);
    const shape s = shape_of(basis, w);
    const long k = basis->size, doubled = s.out * s.count * DOUBLED;
    lf_tensor *f = lf_tensor_new(tape, 4, LF_DIMS(k, k, s.in * s.turns, s.out * LF_C8));
    lf_real *t = lf_alloc_reals(tape, s.in * doubled);
#pragma omp parallel for schedule(static)
    for (long i = 0; i < s.in; i++) {
        unfold(&s, w->value, i, t + i * doubled);
        for (long r = 0; r < s.turns; r++)
            expand_channel(&s, basis->table, t + i * doubled + LF_C8 - r,
                           f->value + (i * s.turns + r) * s.out * LF_C8);
    }
    lf_record(tape, "c8_expand", backward, (void *)basis, LF_IN(w), LF_OUT(f));
    return f;
}
