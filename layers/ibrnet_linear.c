/* ibrnet_linear.c: y = act(x w + b + p) of features in lanes                   [layers/ibrnet.h]
 *
 *   backward  dz = act'(y) dy;  dx += dz w^T,  dw += sum over rows and lanes of x dz,  db += dz,
 *             dp[block] += the sum over its rows of dz
 *
 * Shapes    x parts [R, Ci, L], w [sum Ci, Co], b [Co], p [B, Co, L], y [R, Co, L].
 * Keeps     y. dz is written over dy, which nobody reads again.
 *
 * Register tiles, a vector being LF_LANES of a row's L points:
 *   product   two vectors of points by OUTS results; a term is two loads of x, OUTS numbers of w
 *   outer     OUTER_IN by OUTER_OUT numbers of dw, each a vector of partial sums over the points,
 *             added up across the vector at the end
 * Each sum has one order, whatever the tile's size.
 */
#include "autograd/kernels/tile.h"
#include "layers/ibrnet.h"

enum { PER = LF_WIDE / LF_LANES }; /* vectors in a row's L points */
#if defined(__AVX512F__) || defined(__aarch64__)
enum { OUTS = 12, OUTER_IN = 6, OUTER_OUT = 4 }; /* of 32 registers */
#else
enum { OUTS = 6, OUTER_IN = 4, OUTER_OUT = 3 }; /* of 16 */
#endif

/* Vector n of channel 0 of x [R, c, L]. */
static lf_real *vector_at(lf_real *x, long n, long c)
{
    return x + n / PER * c * LF_WIDE + n % PER * LF_LANES;
}

/* ---- product -----------------------------------------------------------------------------------
 */

typedef struct product {
    int parts;
    lf_real *x[LF_LANES_PARTS];
    long c[LF_LANES_PARTS]; /* channels of each part */
    const lf_real *w;       /* [sum of c, step]: the first `out` columns count */
    long step;
    const lf_real *bias; /* [out] or NULL */
    lf_real *y;          /* [R, out, L] */
    long out;
    bool accumulate; /* start from y */
} product;

/* Results o .. o + outs - 1 of the vectors n .. n + wide - 1. */
LF_INLINE void product_tile(const product *p, long n, long o, const int wide, const int outs)
{
    lf_vec sum[2][OUTS];
    lf_real *y[2] = {vector_at(p->y, n, p->out) + o * LF_WIDE,
                     vector_at(p->y, n + wide - 1, p->out) + o * LF_WIDE};
    for (int v = 0; v < wide; v++)
        for (int t = 0; t < outs; t++)
            sum[v][t] = p->accumulate ? lf_vec_load(y[v] + t * LF_WIDE)
                                      : lf_vec_all(p->bias ? p->bias[o + t] : 0);
    const lf_real *w = p->w + o;
    for (int part = 0; part < p->parts; part++) {
        const lf_real *a = vector_at(p->x[part], n, p->c[part]);
        const lf_real *b = vector_at(p->x[part], n + wide - 1, p->c[part]);
        for (long i = 0; i < p->c[part]; i++, w += p->step) {
            const lf_vec u = lf_vec_load(a + i * LF_WIDE), v = lf_vec_load(b + i * LF_WIDE);
#pragma GCC unroll 12
            for (int t = 0; t < outs; t++) {
                const lf_vec factor = lf_vec_all(w[t]);
                sum[0][t] += u * factor;
                if (wide > 1)
                    sum[1][t] += v * factor;
            }
        }
    }
    for (int v = 0; v < wide; v++)
        for (int t = 0; t < outs; t++)
            lf_vec_store(y[v] + t * LF_WIDE, sum[v][t]);
}

#define TILE(wide, outs)                                                                           \
    case outs:                                                                                     \
        product_tile(p, n, o, wide, outs);                                                         \
        break;
#if defined(__AVX512F__) || defined(__aarch64__)
#define LARGE_TILES(wide)                                                                          \
    TILE(wide, 7) TILE(wide, 8) TILE(wide, 9) TILE(wide, 10) TILE(wide, 11) TILE(wide, 12)
#else
#define LARGE_TILES(wide)
#endif
#define TILES(wide)                                                                                \
    switch (outs) {                                                                                \
        TILE(wide, 1)                                                                              \
        TILE(wide, 2) TILE(wide, 3) TILE(wide, 4) TILE(wide, 5) TILE(wide, 6) LARGE_TILES(wide)    \
    }

static void product_columns(const product *p, long n, int wide)
{
    for (long o = 0, outs; o < p->out; o += outs) {
        outs = lf_next_part(p->out - o, OUTS);
        if (wide == 2)
            TILES(2)
        else
            TILES(1)
    }
}

/* Vectors of the rows [first, first + rows). */
static void product_rows(const product *p, long first, long rows)
{
    for (long n = first * PER; n < (first + rows) * PER; n += 2)
        product_columns(p, n, n + 1 < (first + rows) * PER ? 2 : 1);
}

/* ---- outer -------------------------------------------------------------------------------------
 */

/* w[i, o] += sum over rows and lanes of x[r, i, l] dz[r, o, l], a tile of it. */
LF_INLINE void outer_tile(long rows, long ci, const lf_real *x, long co, const lf_real *dz,
                          lf_real *w, const int ins, const int outs)
{
    lf_vec sum[OUTER_IN][OUTER_OUT] = {{{0}}};
    for (long r = 0; r < rows; r++, x += ci * LF_WIDE, dz += co * LF_WIDE)
        for (int v = 0; v < PER; v++) {
            lf_vec g[OUTER_OUT];
#pragma GCC unroll 4
            for (int o = 0; o < outs; o++)
                g[o] = lf_vec_load(dz + o * LF_WIDE + v * LF_LANES);
#pragma GCC unroll 6
            for (int i = 0; i < ins; i++) {
                const lf_vec a = lf_vec_load(x + i * LF_WIDE + v * LF_LANES);
#pragma GCC unroll 4
                for (int o = 0; o < outs; o++)
                    sum[i][o] += a * g[o];
            }
        }
    for (int i = 0; i < ins; i++)
        for (int o = 0; o < outs; o++)
            w[i * co + o] += lf_vec_sum(sum[i][o]);
}

#define OUTER(ins, outs)                                                                           \
    case outs:                                                                                     \
        outer_tile(rows, ci, x, co, dz, w, ins, outs);                                             \
        break;
#if defined(__AVX512F__) || defined(__aarch64__)
#define OUTERS(ins)                                                                                \
    case ins:                                                                                      \
        switch (outs) {                                                                            \
            OUTER(ins, 1) OUTER(ins, 2) OUTER(ins, 3) OUTER(ins, 4)                                \
        }                                                                                          \
        break;
#else
#define OUTERS(ins)                                                                                \
    case ins:                                                                                      \
        switch (outs) {                                                                            \
            OUTER(ins, 1) OUTER(ins, 2) OUTER(ins, 3)                                              \
        }                                                                                          \
        break;
#endif

static void outer_any(long rows, long ci, const lf_real *x, long co, const lf_real *dz, lf_real *w,
                      long ins, long outs)
{
    switch (ins) {
        OUTERS(1)
        OUTERS(2)
        OUTERS(3)
        OUTERS(4)
#if defined(__AVX512F__) || defined(__aarch64__)
        OUTERS(5)
        OUTERS(6)
#endif
    }
}

/* All of it: the columns of dz stay in the cache while x passes. */
static void outer(long rows, long ci, const lf_real *x, long co, const lf_real *dz, lf_real *w)
{
    for (long o = 0, outs; o < co; o += outs) {
        outs = lf_next_part(co - o, OUTER_OUT);
        for (long i = 0, ins; i < ci; i += ins) {
            ins = lf_next_part(ci - i, OUTER_IN);
            outer_any(rows, ci, x + i * LF_WIDE, co, dz + o * LF_WIDE, w + i * co + o, ins, outs);
        }
    }
}

/* ---- the op ------------------------------------------------------------------------------------
 */

enum { W = 0, BIAS = 1, POINT = 2, PARTS = 3 }; /* inputs of the node */

typedef struct linear {
    lf_activation act;
    long blocks;
    const long *first;
} linear;

/* y += p of the rows' block; nonlinearity. */
static void finish_block(const linear *t, lf_tensor *y, const lf_tensor *p, long b)
{
    const long size = y->dim[1] * LF_WIDE;
    for (long r = t->first[b]; p && r < t->first[b + 1]; r++)
        for (long i = 0; i < size; i++)
            y->value[r * size + i] += p->value[b * size + i];
}

static void elu(long n, lf_real *y)
{
    for (long i = 0; i < n; i += LF_WIDE)
        lf_wide_store(y + i, LF_WIDE, lf_wide_elu(lf_wide_load(y + i, LF_WIDE)));
}

static void behind_elu(long n, const lf_real *y, lf_real *restrict dy)
{
    for (long i = 0; i < n; i++)
        dy[i] *= (y[i] < 0 ? y[i] : 0) + 1;
}

static void point_gradient(const linear *t, const lf_tensor *y, lf_real *restrict dp)
{
    const long size = y->dim[1] * LF_WIDE;
    for (long b = 0; b < t->blocks; b++)
        for (long r = t->first[b]; r < t->first[b + 1]; r++)
            for (long i = 0; i < size; i++)
                dp[b * size + i] += y->grad[r * size + i];
}

static void bias_gradient(const lf_tensor *y, lf_real *db)
{
    for (long o = 0; o < y->dim[1]; o++) {
        lf_wide sum = {0};
        for (long r = 0; r < y->dim[0]; r++)
            sum += lf_wide_load(y->grad + (r * y->dim[1] + o) * LF_WIDE, LF_WIDE);
        db[o] += lf_wide_sum(sum);
    }
}

/* dx of one part += dz w^T; turned [Co, Ci] is w transposed. */
static void part_gradient(const lf_tensor *y, lf_tensor *x, const lf_real *turned, long step)
{
    const product p = {.parts = 1,
                       .x = {y->grad},
                       .c = {y->dim[1]},
                       .w = turned,
                       .step = step,
                       .y = x->grad,
                       .out = x->dim[1],
                       .accumulate = true};
    product_rows(&p, 0, y->dim[0]);
}

static lf_real *transposed(lf_tape *tape, const lf_tensor *w)
{
    const long in = w->dim[0], out = w->dim[1];
    lf_real *turned = lf_alloc_reals(tape, in * out);
    for (long i = 0; i < in; i++)
        for (long o = 0; o < out; o++)
            turned[o * in + i] = w->value[i * out + o];
    return turned;
}

static void backward(const lf_node *node)
{
    const linear *t = node->saved;
    const lf_tensor *w = node->in[W], *bias = node->in[BIAS], *point = node->in[POINT];
    const lf_tensor *y = node->out[0];
    if (t->act == LF_ELU)
        behind_elu(y->size, y->value, y->grad);
    if (point && point->grad)
        point_gradient(t, y, point->grad);
    if (bias && bias->grad)
        bias_gradient(y, bias->grad);
    const lf_real *turned = transposed(node->tape, w);
    long from = 0;
    for (int k = PARTS; k < node->n_in; k++) {
        lf_tensor *x = node->in[k];
        if (x->grad)
            part_gradient(y, x, turned + from, w->dim[0]);
        if (w->grad)
            outer(y->dim[0], x->dim[1], x->value, w->dim[1], y->grad, w->grad + from * w->dim[1]);
        from += x->dim[1];
    }
}

static void forward(const product *p, const linear *t, lf_tensor *y, const lf_tensor *point)
{
    product_rows(p, 0, y->dim[0]);
    for (long b = 0; point && b < t->blocks; b++)
        finish_block(t, y, point, b);
    if (t->act == LF_ELU)
        elu(y->size, y->value);
}

lf_tensor *lf_lanes_linear(lf_tape *tape, int parts, lf_tensor *const *x, lf_tensor *w,
                           lf_tensor *b, lf_tensor *p, const lf_lanes *lanes, lf_activation act)
{
    LF_REQUIRE(parts >= 1 && parts <= LF_LANES_PARTS && (act == LF_IDENTITY || act == LF_ELU),
               "lf_lanes_linear: %d parts, activation %d", parts, (int)act);
    const long rows = x[0]->dim[0], out = w->dim[1];
    lf_tensor *y = lf_tensor_new(tape, 3, LF_DIMS(rows, out, LF_WIDE));
    product job = {.parts = parts,
                   .w = w->value,
                   .step = out,
                   .bias = b ? b->value : NULL,
                   .y = y->value,
                   .out = out};
    lf_tensor *in[PARTS + LF_LANES_PARTS] = {w, b, p};
    long total = 0;
    for (int k = 0; k < parts; k++) {
        LF_REQUIRE(x[k]->rank == 3 && x[k]->dim[0] == rows && x[k]->dim[2] == LF_WIDE,
                   "lf_lanes_linear: part %d of %ld for %ld rows", k, x[k]->size, rows);
        in[PARTS + k] = x[k];
        job.x[k] = x[k]->value;
        total += job.c[k] = x[k]->dim[1];
    }
    LF_REQUIRE(total == w->dim[0] && (!b || b->size == out) &&
                   (!p || (p->size == lanes->blocks * out * LF_WIDE && rows == lanes->rows)),
               "lf_lanes_linear: %ld channels, w [%ld, %ld], b [%ld], p of %ld", total, w->dim[0],
               out, b ? b->size : -1, p ? p->size : -1);
    linear *t = lf_alloc(tape, sizeof *t);
    *t = (linear){act, lanes->blocks, lanes->first};
    forward(&job, t, y, p);
    lf_record(tape, "lanes_linear", backward, t, PARTS + parts, in, LF_OUT(y));
    return y;
}
