/* ibrnet_linear.c: y = act(x w + b + p) of features in lanes                   [layers/ibrnet.h]
 *
 *   backward  dz = act'(y) dy;  dx += dz w^T,  dw += sum over rows and lanes of x dz,  db += dz,
 *             dp[block] += the sum over its rows of dz
 *
 * Shapes    x parts [R, Ci, L], w [sum Ci, Co], b [Co], p [B, Co, L], y [R, Co, L].
 * Keeps     y. dz is written over dy, which nobody reads again.
 *
 * Rows are worked on two at a time, so that what one step writes the next finds in the cache.
 */
#include "layers/ibrnet_product.h"
#include "layers/lanes_math.h"

enum { W = 0, BIAS = 1, POINT = 2, PARTS = 3 }; /* inputs of the node */

typedef struct linear {
    lf_activation act;
    const lf_lanes *lanes;
} linear;

static void elu(long n, lf_real *y)
{
    for (long i = 0; i < n; i += LF_LANES)
        lf_vec_store(y + i, lf_vec_elu(lf_vec_load(y + i)));
}

static void behind_elu(long n, const lf_real *y, lf_real *dy)
{
    const lf_vec zero = {0};
    for (long i = 0; i < n; i += LF_LANES)
        lf_vec_store(dy + i, lf_vec_load(dy + i) * (lf_vec_min(lf_vec_load(y + i), zero) + 1));
}

/* y[row] = p of its block, for the product to start from. */
static void start_from_point(const linear *t, long first, long rows, const lf_tensor *p, lf_real *y)
{
    const long size = p->dim[1] * LF_LANES;
    for (long r = first; r < first + rows; r++)
        memcpy(y + r * size, p->value + t->lanes->block[r] * size, (size_t)size * sizeof *y);
}

static void add(long n, const lf_real *x, lf_real *restrict y)
{
    for (long i = 0; i < n; i++)
        y[i] += x[i];
}

static long next_rows(long left)
{
    return left < LF_LANES_ROWS ? left : LF_LANES_ROWS;
}

/* ---- backward ----------------------------------------------------------------------------------
 */

/* db and dp of some rows. */
static void offset_gradients(const lf_node *node, long first, long rows)
{
    const linear *t = node->saved;
    const lf_tensor *p = node->in[POINT], *y = node->out[0];
    const long size = y->dim[1] * LF_LANES;
    for (long r = first; p && p->grad && r < first + rows; r++)
        add(size, y->grad + r * size, p->grad + t->lanes->block[r] * size);
}

/* The products dz w^T of the parts that want a gradient. */
static int parts_back(const lf_node *node, lf_lanes_product *job)
{
    const lf_tensor *w = node->in[W], *y = node->out[0];
    long from = 0;
    int count = 0;
    for (int k = PARTS; k < node->n_in; k++) {
        const lf_tensor *x = node->in[k];
        if (x->grad)
            job[count++] = (lf_lanes_product){.parts = 1,
                                              .x = {y->grad},
                                              .c = {w->dim[1]},
                                              .w = w->value + from * w->dim[1],
                                              .step = w->dim[1],
                                              .turned = true,
                                              .y = x->grad,
                                              .out = x->dim[1],
                                              .accumulate = true};
        from += x->dim[1];
    }
    return count;
}

/* dw and db from dz. */
static void matrix_gradients(const lf_node *node)
{
    const lf_tensor *w = node->in[W], *bias = node->in[BIAS], *z = node->out[0];
    const long rows = z->dim[0], out = w->dim[1];
    lf_real *panels = lf_alloc_reals(node->tape, z->size);
    lf_real *scratch = lf_alloc_reals(node->tape, lf_lanes_outer_scratch(rows));
    lf_lanes_panels(rows, out, z->grad, panels);
    if (bias && bias->grad)
        lf_lanes_sums(rows, out, panels, bias->grad);
    long from = 0;
    for (int k = PARTS; w->grad && k < node->n_in; k++) {
        const lf_tensor *x = node->in[k];
        lf_lanes_outer(rows, x->dim[1], x->value, out, panels, w->grad + from * out, scratch);
        from += x->dim[1];
    }
}

static void backward(const lf_node *node)
{
    const linear *t = node->saved;
    const lf_tensor *w = node->in[W], *bias = node->in[BIAS], *y = node->out[0];
    const long size = w->dim[1] * LF_LANES;
    lf_lanes_product job[LF_LANES_PARTS];
    const int count = parts_back(node, job);
    for (long r = 0, rows; r < y->dim[0]; r += rows) {
        rows = next_rows(y->dim[0] - r);
        if (t->act == LF_ELU)
            behind_elu(rows * size, y->value + r * size, y->grad + r * size);
        offset_gradients(node, r, rows);
        for (int k = 0; k < count; k++)
            lf_lanes_product_rows(&job[k], r, rows);
    }
    if (w->grad || (bias && bias->grad))
        matrix_gradients(node);
}

/* ---- the op ------------------------------------------------------------------------------------
 */

static void forward(lf_lanes_product *job, const linear *t, lf_tensor *y, const lf_tensor *p)
{
    const long size = y->dim[1] * LF_LANES;
    job->accumulate = p != NULL;
    for (long r = 0, rows; r < y->dim[0]; r += rows) {
        rows = next_rows(y->dim[0] - r);
        if (p)
            start_from_point(t, r, rows, p, y->value);
        lf_lanes_product_rows(job, r, rows);
        if (t->act == LF_ELU)
            elu(rows * size, y->value + r * size);
    }
}

lf_tensor *lf_lanes_linear(lf_tape *tape, int parts, lf_tensor *const *x, lf_tensor *w,
                           lf_tensor *b, lf_tensor *p, const lf_lanes *lanes, lf_activation act)
{
    LF_REQUIRE(parts >= 1 && parts <= LF_LANES_PARTS && (act == LF_IDENTITY || act == LF_ELU) &&
                   (!b || !p),
               "lf_lanes_linear: %d parts, activation %d, b and p", parts, (int)act);
    const long rows = x[0]->dim[0], out = w->dim[1];
    lf_tensor *y = lf_tensor_new(tape, 3, LF_DIMS(rows, out, LF_LANES));
    lf_lanes_product job = {.parts = parts,
                            .w = w->value,
                            .step = out,
                            .bias = b ? b->value : NULL,
                            .y = y->value,
                            .out = out};
    lf_tensor *in[PARTS + LF_LANES_PARTS] = {w, b, p};
    long total = 0;
    for (int k = 0; k < parts; k++) {
        LF_REQUIRE(x[k]->rank == 3 && x[k]->dim[0] == rows && x[k]->dim[2] == LF_LANES,
                   "lf_lanes_linear: part %d of %ld for %ld rows", k, x[k]->size, rows);
        in[PARTS + k] = x[k];
        job.x[k] = x[k]->value;
        total += job.c[k] = x[k]->dim[1];
    }
    LF_REQUIRE(total == w->dim[0] && (!b || b->size == out) &&
                   (!p || (p->size == lanes->blocks * out * LF_LANES && rows == lanes->rows)),
               "lf_lanes_linear: %ld channels, w [%ld, %ld], b [%ld], p of %ld", total, w->dim[0],
               out, b ? b->size : -1, p ? p->size : -1);
    linear *t = lf_alloc(tape, sizeof *t);
    *t = (linear){act, lf_lanes_keep(tape, lanes)};
    forward(&job, t, y, p);
    lf_record(tape, "lanes_linear", backward, t, PARTS + parts, in, LF_OUT(y));
    return y;
}
