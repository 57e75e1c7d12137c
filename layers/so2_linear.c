/* so2_linear.c: complex-linear maps of fields along a ray [method.md 1.5, 4.9]
 *
 *   scalars   y = x W + b                       dW += x dy, dx += dy W', db += dy
 *   type k    y = (A + i B) x:                  y_re = x_re A - x_im B,  y_im = x_re B + x_im A
 *             dA += x_re dy_re + x_im dy_im     dx_re += dy_re A' + dy_im B'
 *             dB += x_re dy_im - x_im dy_re     dx_im += dy_im A' - dy_re B'
 *
 * Shapes      x [.., P Ci], w [Z^2 + 2 (count - 1), Ci, Co], b [Z Co] or NULL, y [.., P Co].
 * A map with A and B is what commutes with every turn; types never mix. The adjoint is a map of the
 * same kind, with A' and -B' in place of A and B. Channels are few, so rows run side by side:
 * blocks of rows are transposed, and one vector holds one number of each; the gradient of the
 * weights is kept a lane and joined at the end.
 */
#include "layers/light_field.h"

typedef struct so2_linear {
    lf_types types;
    long in, out;
} so2_linear;

/* One number of LANES rows side by side. */
typedef lf_real lanes __attribute__((vector_size(64), may_alias));
enum { LANES = 64 / sizeof(lf_real) };

/* Rows of x [rows <= LANES, cols] as lanes [cols]; missing rows are 0. */
static void gather(long rows, long cols, const lf_real *x, lanes *restrict out)
{
    lf_real *t = (lf_real *)out;
    if (rows < LANES)
        memset(out, 0, (size_t)cols * sizeof *out);
    for (long r = 0; r < rows; r++)
        for (long c = 0; c < cols; c++)
            t[c * LANES + r] = x[r * cols + c];
}

static void scatter_add(long rows, long cols, const lanes *x, lf_real *restrict out)
{
    const lf_real *t = (const lf_real *)x;
    for (long r = 0; r < rows; r++)
        for (long c = 0; c < cols; c++)
            out[r * cols + c] += t[c * LANES + r];
}

/* y = (A + i B) x for all types of LANES rows. x [P ci], w as in the file's head, y [P co]. */
static void map_lanes(const lf_types *types, long ci, long co, const lanes *x, const lf_real *w,
                      lanes *restrict y)
{
    const long si = lf_types_scalars(types) * ci, so = lf_types_scalars(types) * co;
    for (long o = 0; o < so; o++) {
        lanes sum = {0};
        for (long i = 0; i < si; i++)
            sum += w[i * so + o] * x[i];
        y[o] = sum;
    }
    for (int k = 1; k < types->count; k++) {
        const long plane = lf_types_plane(types, k);
        const lf_real *a = w + lf_types_matrix(types, k) * ci * co, *b = a + ci * co;
        const lanes *xr = x + plane * ci, *xi = xr + ci;
        lanes *yr = y + plane * co, *yi = yr + co;
        for (long o = 0; o < co; o++) {
            lanes re = {0}, im = {0};
            for (long i = 0; i < ci; i++) {
                const lf_real u = a[i * co + o], v = b[i * co + o];
                re += u * xr[i] - v * xi[i];
                im += v * xr[i] + u * xi[i];
            }
            yr[o] = re;
            yi[o] = im;
        }
    }
}

/* dw of LANES rows, each lane a sum of its own. */
static void add_weight_gradient(const so2_linear *t, const lanes *x, const lanes *dy,
                                lanes *restrict dw)
{
    const long ci = t->in, co = t->out;
    const long si = lf_types_scalars(&t->types) * ci, so = lf_types_scalars(&t->types) * co;
    for (long i = 0; i < si; i++)
        for (long o = 0; o < so; o++)
            dw[i * so + o] += x[i] * dy[o];
    for (int k = 1; k < t->types.count; k++) {
        const long plane = lf_types_plane(&t->types, k);
        lanes *da = dw + lf_types_matrix(&t->types, k) * ci * co, *db = da + ci * co;
        const lanes *xr = x + plane * ci, *xi = xr + ci;
        const lanes *gr = dy + plane * co, *gi = gr + co;
        for (long i = 0; i < ci; i++) {
            const lanes re = xr[i], im = xi[i];
            for (long o = 0; o < co; o++) {
                da[i * co + o] += re * gr[o] + im * gi[o];
                db[i * co + o] += re * gi[o] - im * gr[o];
            }
        }
    }
}

/* out[i] += the sum of the lanes of x[i]. */
static void add_lanes(long n, const lanes *x, lf_real *restrict out)
{
    for (long i = 0; i < n; i++) {
        lf_real sum = 0;
        for (int l = 0; l < LANES; l++)
            sum += x[i][l];
        out[i] += sum;
    }
}

/* to [columns, rows] = sign times the transpose of from [rows, columns]. */
static void transpose(long rows, long columns, lf_real sign, const lf_real *from, lf_real *to)
{
    for (long r = 0; r < rows; r++)
        for (long c = 0; c < columns; c++)
            to[c * rows + r] = sign * from[r * columns + c];
}

/* The adjoint's weights, Co and Ci in each other's place: A' and -B'. */
static lf_real *adjoint_weights(lf_tape *tape, const so2_linear *t, const lf_real *w)
{
    const long ci = t->in, co = t->out, scalars = lf_types_scalars(&t->types);
    lf_real *adjoint = lf_alloc_reals(tape, lf_types_matrices(&t->types) * ci * co);
    transpose(scalars * ci, scalars * co, 1, w, adjoint);
    for (int k = 1; k < t->types.count; k++) {
        const long at = lf_types_matrix(&t->types, k) * ci * co;
        transpose(ci, co, 1, w + at, adjoint + at);
        transpose(ci, co, -1, w + at + ci * co, adjoint + at + ci * co);
    }
    return adjoint;
}

/* Scalars are the first Z Co numbers of a row. */
static void bias_backward(const lf_tensor *b, const lf_tensor *y)
{
    for (long r = 0; r < lf_rows(y); r++)
        for (long o = 0; o < b->size; o++)
            b->grad[o] += y->grad[r * lf_cols(y) + o];
}

static void backward(const lf_node *node)
{
    const so2_linear *t = node->saved;
    const lf_tensor *x = node->in[0], *w = node->in[1], *b = node->in[2], *y = node->out[0];
    const long rows = lf_rows(x), ci = lf_cols(x), co = lf_cols(y);
    const lf_real *adjoint = x->grad ? adjoint_weights(node->tape, t, w->value) : NULL;
    lanes *lx = lf_alloc(node->tape, (size_t)(ci + co + w->size) * sizeof *lx);
    lanes *ly = lx + ci, *dw = ly + co;
    memset(dw, 0, (size_t)w->size * sizeof *dw);
    for (long r = 0; r < rows; r += LANES) {
        const long n = rows - r < LANES ? rows - r : LANES;
        gather(n, co, y->grad + r * co, ly);
        if (w->grad) {
            gather(n, ci, x->value + r * ci, lx);
            add_weight_gradient(t, lx, ly, dw);
        }
        if (x->grad) {
            map_lanes(&t->types, t->out, t->in, ly, adjoint, lx);
            scatter_add(n, ci, lx, x->grad + r * ci);
        }
    }
    if (w->grad)
        add_lanes(w->size, dw, w->grad);
    if (b && b->grad)
        bias_backward(b, y);
}

lf_tensor *lf_so2_linear(lf_tape *tape, const lf_types *types, lf_tensor *x, lf_tensor *w,
                         lf_tensor *b)
{
    const long planes = lf_types_planes(types), ci = lf_cols(x), rows = lf_rows(x);
    LF_REQUIRE(w->rank == 3 && w->dim[0] == lf_types_matrices(types) && ci == planes * w->dim[1],
               "lf_so2_linear: x [.., %ld], w of %ld matrices, %d types", ci, w->dim[0],
               types->count);
    const long scalars = lf_types_scalars(types);
    LF_REQUIRE(!b || b->size == scalars * w->dim[2], "lf_so2_linear: b of %ld, not %ld", b->size,
               scalars * w->dim[2]);
    so2_linear *t = lf_alloc(tape, sizeof *t);
    *t = (so2_linear){*types, w->dim[1], w->dim[2]};
    const long co = planes * t->out;
    lf_tensor *y = lf_tensor_cols(tape, x, co);
    const lf_mark mark = lf_tape_mark(tape);
    lanes *lx = lf_alloc(tape, (size_t)(ci + co) * sizeof *lx), *ly = lx + ci;
    memset(y->value, 0, (size_t)y->size * sizeof *y->value);
    for (long r = 0; b && r < rows; r++)
        memcpy(y->value + r * co, b->value, (size_t)b->size * sizeof *y->value);
    for (long r = 0; r < rows; r += LANES) {
        const long n = rows - r < LANES ? rows - r : LANES;
        gather(n, ci, x->value + r * ci, lx);
        map_lanes(types, t->in, t->out, lx, w->value, ly);
        scatter_add(n, co, ly, y->value + r * co);
    }
    lf_tape_release(tape, mark);
    const double products = lf_types_products(types) * (double)(t->in * t->out);
    lf_products_of(tape, (double)rows * products, x, w);
    lf_record(tape, "so2_linear", backward, t, LF_IN(x, w, b), LF_OUT(y));
    return y;
}

/* ---- the layer --------------------------------------------------------------------------------
 */

void lf_so2_map_init(lf_store *store, lf_so2_map *layer, const char *prefix, const lf_types *types,
                     long in, long out, bool bias)
{
    LF_REQUIRE(lf_types_valid(types) && in >= 1 && out >= 1, "%s: %ld -> %ld channels of %d types",
               prefix, in, out, types->count);
    char name[160];
    const long matrices = lf_types_matrices(types), scalars = lf_types_scalars(types);
    snprintf(name, sizeof name, "%s.weight", prefix);
    layer->weight =
        lf_store_add(store, name, 3, LF_DIMS(matrices, in, out), 0, 1 / sqrt((double)in), true);
    lf_real *w = lf_values(layer->weight);
    const lf_real of_scalars = (lf_real)(1 / sqrt((double)scalars));
    for (long i = 0; i < scalars * scalars * in * out; i++)
        w[i] *= of_scalars;
    for (long i = scalars * scalars * in * out; i < matrices * in * out; i++)
        w[i] *= (lf_real)0.7071067811865476; /* |A + i B|^2 as for the scalars */
    snprintf(name, sizeof name, "%s.bias", prefix);
    layer->bias = bias ? lf_store_add(store, name, 1, LF_DIMS(scalars * out), 0, 0, true) : NULL;
}

lf_tensor *lf_so2_map_apply(lf_tape *tape, const lf_so2_map *layer, const lf_types *types,
                            lf_tensor *x)
{
    return lf_so2_linear(tape, types, x, lf_param(tape, layer->weight),
                         layer->bias ? lf_param(tape, layer->bias) : NULL);
}

/* ---- side by side ------------------------------------------------------------------------------
 */

static void concat_backward(const lf_node *node)
{
    const lf_tensor *y = node->out[0];
    const long planes = *(const long *)node->saved, cols = lf_cols(y) / planes;
    const long ca = lf_cols(node->in[0]) / planes;
    for (long r = 0; r < lf_rows(y) * planes; r++)
        for (int part = 0; part < 2; part++) {
            const long c = part ? cols - ca : ca;
            lf_real *dx = node->in[part]->grad;
            for (long i = 0; dx && i < c; i++)
                dx[r * c + i] += y->grad[r * cols + (part ? ca : 0) + i];
        }
}

lf_tensor *lf_so2_concat(lf_tape *tape, const lf_types *types, lf_tensor *a, lf_tensor *b)
{
    long *planes = lf_alloc(tape, sizeof *planes);
    *planes = lf_types_planes(types);
    LF_REQUIRE(lf_cols(a) % *planes == 0 && lf_cols(b) % *planes == 0 && lf_rows(a) == lf_rows(b),
               "lf_so2_concat: %ld rows of %ld and %ld of %ld", lf_rows(a), lf_cols(a), lf_rows(b),
               lf_cols(b));
    const long ca = lf_cols(a) / *planes, cb = lf_cols(b) / *planes;
    lf_tensor *y = lf_tensor_cols(tape, a, *planes * (ca + cb));
    for (long r = 0; r < lf_rows(a) * *planes; r++) {
        lf_real *out = y->value + r * (ca + cb);
        memcpy(out, a->value + r * ca, (size_t)ca * sizeof *out);
        memcpy(out + ca, b->value + r * cb, (size_t)cb * sizeof *out);
    }
    lf_record(tape, "so2_concat", concat_backward, planes, LF_IN(a, b), LF_OUT(y));
    return y;
}
