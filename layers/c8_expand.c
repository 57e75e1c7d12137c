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
 * Cost       2 count flops a number of the filter, forward and backward.
 * Threads    input fields are independent.
 */
#include <omp.h>

#include "autograd/kernels/vector.h"
#include "layers/c8.h"

/* The eight orientations; loads and stores of any alignment. */
typedef lf_real vec
    __attribute__((vector_size(LF_C8 * sizeof(lf_real)), aligned(sizeof(lf_real)), may_alias));

/* Those of two fields. */
typedef lf_real wide
    __attribute__((vector_size(2 * LF_C8 * sizeof(lf_real)), aligned(sizeof(lf_real)), may_alias));

enum {
    DOUBLED = 2 * LF_C8,
    PART = 8, /* members whose sums fit in registers */
    PAIRS = LF_VEC_BYTES == 64 && sizeof(lf_real) == 4 ? 2 : 1
};

/* Numbers of t of one input field. */
static long doubled(const lf_c8_filter *s)
{
    return s->out * s->count * DOUBLED;
}

/* t[out][count][16] of input field i; a lift has the same weight for every orientation. */
static void unfold(const lf_c8_filter *s, const lf_real *w, long i, lf_real *t)
{
    for (long o = 0; o < s->out; o++) {
        const lf_real *from = w + (o * s->in + i) * s->turns * s->count;
        const long step = s->turns == 1 ? 0 : s->count;
        for (long b = 0; b < s->count; b++, t += DOUBLED) {
            const lf_real *w0 = from + b, *w4 = w0 + 4 * step;
            const vec turned = {w0[0], w4[3 * step], w4[2 * step], w4[step],
                                w4[0], w0[3 * step], w0[2 * step], w0[step]};
            *(vec *)t = *(vec *)(t + LF_C8) = turned;
        }
    }
}

/* The transpose: dw of input field i += what was added into t. */
static void fold(const lf_c8_filter *s, const lf_real *t, long i, lf_real *dw)
{
    for (long o = 0; o < s->out; o++) {
        lf_real *to = dw + (o * s->in + i) * s->turns * s->count;
        const long step = s->turns == 1 ? 0 : s->count;
        for (long b = 0; b < s->count; b++, t += DOUBLED) {
            const vec sum = *(const vec *)t + *(const vec *)(t + LF_C8);
            for (long u = 0; u < LF_C8; u++)
                to[(LF_C8 - u) % LF_C8 * step + b] += sum[u];
        }
    }
}

/* Two fields beside each other. */
static inline wide both(vec a, vec c)
{
    return __builtin_shufflevector(a, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
}

/* Filter numbers of input channel (i, r) for `pairs` pairs of output fields: t and f point at the
 * first of them, f at pixel 0. Called with constant counts and pairs, so that the weights stay in
 * registers and each basis vector is read once for all of them. */
__attribute__((always_inline)) static inline void
expand_pairs(const lf_c8_filter *s, long count, long pairs, const lf_real *restrict table,
             const lf_real *restrict t, lf_real *restrict f)
{
    const long pixel = s->in * s->turns * s->out * LF_C8;
    wide w[PAIRS][PART];
    for (long q = 0; q < pairs; q++)
        for (long b = 0; b < count; b++)
            w[q][b] = both(*(const vec *)(t + (2 * q * count + b) * DOUBLED),
                           *(const vec *)(t + ((2 * q + 1) * count + b) * DOUBLED));
    for (long p = 0; p < s->size * s->size; p++, table += count * LF_C8, f += pixel) {
        wide sum[PAIRS] = {{0}};
        for (long b = 0; b < count; b++) {
            const vec member = *(const vec *)(table + b * LF_C8);
            for (long q = 0; q < pairs; q++)
                sum[q] += w[q][b] * both(member, member);
        }
        for (long q = 0; q < pairs; q++)
            *(wide *)(f + q * DOUBLED) = sum[q];
    }
}

/* The same for one field and any count. */
static void expand_one(const lf_c8_filter *s, const lf_real *restrict table,
                       const lf_real *restrict t, lf_real *restrict f)
{
    const long pixel = s->in * s->turns * s->out * LF_C8;
    for (long p = 0; p < s->size * s->size; p++, table += s->count * LF_C8, f += pixel) {
        vec sum = {0};
        for (long b = 0; b < s->count; b++)
            sum += *(const vec *)(t + b * DOUBLED) * *(const vec *)(table + b * LF_C8);
        *(vec *)f = sum;
    }
}

/* The transpose: dt += what df holds of the same numbers. `count` members from b on. */
__attribute__((always_inline)) static inline void
reduce_some(const lf_c8_filter *s, long count, long width, const lf_real *restrict table,
            const lf_real *restrict df, lf_real *restrict dt)
{
    const long pixel = s->in * s->turns * s->out * LF_C8;
    vec sum[2][PART];
    for (long o = 0; o < width; o++)
        for (long b = 0; b < count; b++)
            sum[o][b] = *(const vec *)(dt + (o * s->count + b) * DOUBLED);
    for (long p = 0; p < s->size * s->size; p++, table += s->count * LF_C8, df += pixel)
        for (long b = 0; b < count; b++)
            for (long o = 0; o < width; o++)
                sum[o][b] += *(const vec *)(df + o * LF_C8) * *(const vec *)(table + b * LF_C8);
    for (long o = 0; o < width; o++)
        for (long b = 0; b < count; b++)
            *(vec *)(dt + (o * s->count + b) * DOUBLED) = sum[o][b];
}

static void expand_channel(const lf_c8_filter *s, const lf_real *table, const lf_real *t,
                           lf_real *f)
{
    const long step = s->count * DOUBLED;
    for (long o = 0, n; o < s->out; o += n, t += n * step, f += n * LF_C8) {
        const bool all = s->out - o >= 2 * PAIRS;
        n = 2 * PAIRS;
        if (s->count == 1 && all)
            expand_pairs(s, 1, PAIRS, table, t, f);
        else if (s->count == 6 && all)
            expand_pairs(s, 6, PAIRS, table, t, f);
        else if (s->count == 8 && all)
            expand_pairs(s, 8, PAIRS, table, t, f);
        else {
            n = 1;
            expand_one(s, table, t, f);
        }
    }
}

static void reduce_channel(const lf_c8_filter *s, const lf_real *table, const lf_real *df,
                           lf_real *dt)
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

lf_c8_filter lf_c8_filter_of(const lf_c8_basis *basis, const lf_tensor *w)
{
    LF_REQUIRE(w->rank == 3 || (w->rank == 4 && w->dim[2] == LF_C8),
               "a steerable filter of weights of rank %d", w->rank);
    LF_REQUIRE(lf_cols(w) == basis->count, "%ld weights for %d basis functions", lf_cols(w),
               basis->count);
    return (lf_c8_filter){basis->table, basis->size, basis->count,
                          w->dim[1],    w->dim[0],   w->rank == 4 ? LF_C8 : 1};
}

long lf_c8_filter_size(const lf_c8_filter *s)
{
    return s->size * s->size * s->in * s->turns * s->out * LF_C8;
}

long lf_c8_filter_scratch(const lf_c8_filter *s)
{
    return omp_get_max_threads() * doubled(s);
}

void lf_c8_expand(const lf_c8_filter *s, const lf_real *w, lf_real *f, lf_real *scratch)
{
#pragma omp parallel for schedule(static)
    for (long i = 0; i < s->in; i++) {
        lf_real *t = scratch + omp_get_thread_num() * doubled(s);
        unfold(s, w, i, t);
        for (long r = 0; r < s->turns; r++)
            expand_channel(s, s->table, t + LF_C8 - r, f + (i * s->turns + r) * s->out * LF_C8);
    }
}

void lf_c8_fold(const lf_c8_filter *s, const lf_real *df, lf_real *dw, lf_real *scratch)
{
#pragma omp parallel for schedule(static)
    for (long i = 0; i < s->in; i++) {
        lf_real *t = scratch + omp_get_thread_num() * doubled(s);
        memset(t, 0, (size_t)doubled(s) * sizeof *t);
        for (long r = 0; r < s->turns; r++)
            reduce_channel(s, s->table, df + (i * s->turns + r) * s->out * LF_C8, t + LF_C8 - r);
        fold(s, t, i, dw);
    }
}
