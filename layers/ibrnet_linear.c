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
#include "autograd/kernels/vector_math.h"

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

/* What the walk over the rows leaves for the sums over all of them. */
typedef struct backward_work {
    lf_real *left[LF_LANES_PARTS], *right; /* panels of x and of dz; right NULL: no dw */
    lf_real *bias;                         /* [Co, L] partial sums, or NULL */
    lf_lanes_product job[LF_LANES_PARTS];  /* dz w^T of the parts that want a gradient */
    int jobs;
} backward_work;

/* db, dp and the panels of some rows. */
static void add_rows(const lf_node *node, const backward_work *work, long first, long rows)
{
    const linear *t = node->saved;
    const lf_tensor *p = node->in[POINT], *y = node->out[0];
    const long all = y->dim[0], out = y->dim[1], size = out * LF_LANES;
    for (long r = first; r < first + rows; r++) {
        if (p && p->grad)
            add(size, y->grad + r * size, p->grad + t->lanes->block[r] * size);
        if (work->bias)
            add(size, y->grad + r * size, work->bias);
    }
    if (!work->right)
        return;
    lf_lanes_right_panels(all, first, rows, out, y->grad, work->right);
    for (int k = 0; k < node->n_in - PARTS; k++) {
        const lf_tensor *x = node->in[PARTS + k];
        lf_lanes_left_panels(all, first, rows, x->dim[1], x->value, work->left[k]);
    }
}

static void open_work(const lf_node *node, backward_work *work)
{
    const lf_tensor *w = node->in[W], *bias = node->in[BIAS], *y = node->out[0];
    const long out = w->dim[1];
    *work = (backward_work){.jobs = 0};
    if (w->grad)
        work->right = lf_alloc_reals(node->tape, y->size);
    if (bias && bias->grad) {
        work->bias = lf_alloc_reals(node->tape, out * LF_LANES);
        memset(work->bias, 0, (size_t)(out * LF_LANES) * sizeof(lf_real));
    }
    long from = 0;
    for (int k = 0; k < node->n_in - PARTS; k++) {
        const lf_tensor *x = node->in[PARTS + k];
        if (w->grad)
            work->left[k] = lf_alloc_reals(node->tape, x->size);
        if (x->grad)
            work->job[work->jobs++] = (lf_lanes_product){.parts = 1,
                                                         .x = {y->grad},
                                                         .c = {out},
                                                         .w = w->value + from * out,
                                                         .step = out,
                                                         .turned = true,
                                                         .y = x->grad,
                                                         .out = x->dim[1],
                                                         .accumulate = true};
        from += x->dim[1];
    }
}

/* dw and db. */
static void close_work(const lf_node *node, const backward_work *work)
{
    const lf_tensor *w = node->in[W], *y = node->out[0];
    const long out = w->dim[1];
    for (long o = 0; work->bias && o < out; o++)
        node->in[BIAS]->grad[o] += lf_vec_total(lf_vec_load(work->bias + o * LF_LANES));
    long from = 0;
    for (int k = 0; work->right && k < node->n_in - PARTS; k++) {
        const long in = node->in[PARTS + k]->dim[1];
        lf_lanes_outer(y->dim[0], in, work->left[k], out, work->right, w->grad + from * out);
        from += in;
    }
}

static void backward(const lf_node *node)
{
    const linear *t = node->saved;
    const lf_tensor *y = node->out[0];
    const long size = y->dim[1] * LF_LANES;
    backward_work work;
    open_work(node, &work);
    for (long r = 0, rows; r < y->dim[0]; r += rows) {
        rows = next_rows(y->dim[0] - r);
        if (t->act == LF_ELU)
            behind_elu(rows * size, y->value + r * size, y->grad + r * size);
        add_rows(node, &work, r, rows);
        for (int k = 0; k < work.jobs; k++)
            lf_lanes_product_rows(&work.job[k], r, rows);
    }
    close_work(node, &work);
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

/* Of the pairs of a point and a view that sees it, or, in maps of points, of the points. */
static void count_products(lf_tape *tape, const lf_lanes *lanes, int parts, lf_tensor *const *x,
                           const lf_tensor *w)
{
    const double rows = x[0]->dim[0] == lanes->rows
                            ? lf_present(lanes->mask->size, lanes->mask->value)
                            : (double)lanes->points;
    double back = w->wants ? (double)w->dim[0] : 0;
    for (int k = 0; k < parts; k++)
        back += x[k]->wants ? (double)x[k]->dim[1] : 0;
    lf_products(tape, rows * (double)w->size, rows * back * (double)w->dim[1]);
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
    if (lf_profiled(tape))
        count_products(tape, lanes, parts, x, w);
    lf_record(tape, "lanes_linear", backward, t, PARTS + parts, in, LF_OUT(y));
    return y;
}
