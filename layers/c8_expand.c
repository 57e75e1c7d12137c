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

enum { DOUBLED = 2 * LF_C8, PART = 8 /* members whose sums fit in registers */ };

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

/* Filter numbers of input channel (i, r) for `width` output fields: t and f point at the first of
 * them, f at pixel 0. Called with constant counts and widths, so that the weights stay in registers
 * and each basis vector is read once for all `width`. */
__attribute__((always_inline)) static inline void
expand_some(const shape *s, long count, long width, const lf_real *restrict table,
            const lf_real *restrict t, lf_real *restrict f)
{
    const long pixel = s->in * s->turns * s->out * LF_C8;
    for (long p = 0; p < s->pixels; p++, table += count * LF_C8, f += pixel) {
        vec sum[2] = {{0}, {0}};
        for (long b = 0; b < count; b++)
            for (long o = 0; o < width; o++)
                sum[o] += *(const vec *)(t + (o * count + b) * DOUBLED) *
                          *(const vec *)(table + b * LF_C8);
        for (long o = 0; o < width; o++)
            *(vec *)(f + o * LF_C8) = sum[o];
    }
}

/* The transpose: dt += what df holds of the same numbers. `count` members from b on. */
__attribute__((always_inline)) static inline void
reduce_some(const shape *s, long count, long width, const lf_real *restrict table,
            const lf_real *restrict df, lf_real *restrict dt)
{
    const long pixel = s->in * s->turns * s->out * LF_C8;
    vec sum[2][PART];
    for (long o = 0; o < width; o++)
        for (long b = 0; b < count; b++)
            sum[o][b] = *(const vec *)(dt + (o * s->count + b) * DOUBLED);
    for (long p = 0; p < s->pixels; p++, table += s->count * LF_C8, df += pixel)
        for (long b = 0; b < count; b++)
            for (long o = 0; o < width; o++)
                sum[o][b] += *(const vec *)(df + o * LF_C8) * *(const vec *)(table + b * LF_C8);
    for (long o = 0; o < width; o++)
        for (long b = 0; b < count; b++)
            *(vec *)(dt + (o * s->count + b) * DOUBLED) = sum[o][b];
}

static void expand_channel(const shape *s, const lf_real *table, const lf_real *t, lf_real *f)
{
    const long step = s->count * DOUBLED;
    for (long o = 0; o < s->out; o += 2, t += 2 * step, f += 2 * LF_C8) {
        const long width = s->out - o < 2 ? 1 : 2;
        if (s->count == 1 && width == 2)
            expand_some(s, 1, 2, table, t, f);
        else if (s->count == 6 && width == 2)
            expand_some(s, 6, 2, table, t, f);
        else if (s->count == 8 && width == 2)
            expand_some(s, 8, 2, table, t, f);
        else
            expand_some(s, s->count, width, table, t, f);
    }
}

static void reduce_channel(const shape *s, const lf_real *table, const lf_real *df, lf_real *dt)
{
    const long step = s->count * DOUBLED;
    for (long o = 0; o < s->out; o += 2, dt += 2 * step, df += 2 * LF_C8) {
        const long width = s->out - o < 2 ? 1 : 2;
        for (long b = 0; b < s->count; b += PART) {
            const long count = s->count - b < PART ? s->count - b : PART;
            const lf_real *from = table + b * LF_C8;
            if (count == 1 && width == 2)
                reduce_some(s, 1, 2, from, df, dt + b * DOUBLED);
            else if (count == 6 && width == 2)
                reduce_some(s, 6, 2, from, df, dt + b * DOUBLED);
            else if (count == PART && width == 2)
                reduce_some(s, PART, 2, from, df, dt + b * DOUBLED);
            else
                reduce_some(s, count, width, from, df, dt + b * DOUBLED);
        }
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
