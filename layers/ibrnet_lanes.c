/* ibrnet_lanes.c: rows to lanes and back; products of lanes.                   [layers/ibrnet.h]
 *
 *   add_rows   z[r, c, l] = x[point(r, l), view(r), c] + y[r, c, l]     dx += dz, dy += dz
 *   to_rows    z[point(b, l), c] = x[b, c, l]                           dx += dz
 *   scale      z[r, c, l] = x[r, c, l] w[r, l]                          dx += w dz, dw += <x, dz>
 *
 * Degenerate  lanes beyond the last point are 0 and get no gradient.
 */
#include "layers/ibrnet.h"
#include "autograd/kernels/vector_math.h"

/* ---- which rows there are ----------------------------------------------------------------------
 */

static long lanes_of_block(const lf_lanes *lanes, long block)
{
    const long left = lanes->points - block * LF_LANES;
    return left < LF_LANES ? left : LF_LANES;
}

static bool seen_by(const lf_lanes *lanes, const lf_real *mask, long block, long view)
{
    for (long l = 0; l < lanes_of_block(lanes, block); l++)
        if (mask[(block * LF_LANES + l) * lanes->views + view] > 0)
            return true;
    return false;
}

/* Fill in the rows of every block. */
static void find_rows(lf_tape *tape, lf_lanes *lanes, const lf_real *mask)
{
    long *first = lf_alloc(tape, (size_t)(lanes->blocks + 1) * sizeof *first);
    long *view = lf_alloc(tape, (size_t)(lanes->blocks * lanes->views) * sizeof *view);
    long *block = lf_alloc(tape, (size_t)(lanes->blocks * lanes->views) * sizeof *block);
    lanes->first = first;
    lanes->view = view;
    lanes->block = block;
    for (long b = 0; b < lanes->blocks; b++) {
        first[b] = lanes->rows;
        for (long v = 0; v < lanes->views; v++)
            if (seen_by(lanes, mask, b, v)) {
                block[lanes->rows] = b;
                view[lanes->rows++] = v;
            }
    }
    first[lanes->blocks] = lanes->rows;
}

static lf_tensor *lowest_of(lf_tape *tape, const lf_lanes *lanes, const lf_real *difference)
{
    lf_tensor *lowest = lf_tensor_new(tape, 3, LF_DIMS(lanes->blocks, 1, LF_LANES));
    memset(lowest->value, 0, (size_t)lowest->size * sizeof(lf_real));
    for (long p = 0; p < lanes->points; p++) {
        lf_real least = difference[p * lanes->views * 4 + 3];
        for (long v = 1; v < lanes->views; v++) {
            const lf_real dot = difference[(p * lanes->views + v) * 4 + 3];
            least = dot < least ? dot : least;
        }
        lowest->value[p] = least;
    }
    return lowest;
}

/* Channels [i, i + LF_LANES) of the points of a full row. */
LF_INLINE void turn(long i, const lf_real *x, long step, lf_real *to)
{
    lf_vec v[LF_LANES];
    for (int l = 0; l < LF_LANES; l++)
        v[l] = lf_vec_load(x + l * step + i);
    lf_vec_transpose(v);
    for (int l = 0; l < LF_LANES; l++)
        lf_vec_store(to + (i + l) * LF_LANES, v[l]);
}

/* Copy c numbers of each point of one row's view into lanes; zeros beyond the last point. */
static void gather(const lf_lanes *lanes, long block, long view, long c, const lf_real *x,
                   lf_real *to)
{
    const long count = lanes_of_block(lanes, block), step = lanes->views * c;
    x += (block * LF_LANES * lanes->views + view) * c;
    if (count == LF_LANES && c >= LF_LANES) {
        for (long i = 0; i < c; i += LF_LANES)
            turn(i + LF_LANES <= c ? i : c - LF_LANES, x, step, to);
        return;
    }
    if (count < LF_LANES)
        memset(to, 0, (size_t)(c * LF_LANES) * sizeof *to);
    for (long l = 0; l < count; l++)
        for (long i = 0; i < c; i++)
            to[i * LF_LANES + l] = x[l * step + i];
}

/* The other way: add the c numbers of lanes to those of each point. */
static void scatter_add(const lf_lanes *lanes, long block, long view, long c, const lf_real *from,
                        lf_real *x)
{
    const long count = lanes_of_block(lanes, block), step = lanes->views * c;
    x += (block * LF_LANES * lanes->views + view) * c;
    long i = 0;
    for (; count == LF_LANES && i + LF_LANES <= c; i += LF_LANES) {
        lf_vec v[LF_LANES];
        for (int l = 0; l < LF_LANES; l++)
            v[l] = lf_vec_load(from + (i + l) * LF_LANES);
        lf_vec_transpose(v);
        for (int l = 0; l < LF_LANES; l++)
            lf_vec_store(x + l * step + i, lf_vec_load(x + l * step + i) + v[l]);
    }
    for (; i < c; i++)
        for (long l = 0; l < count; l++)
            x[l * step + i] += from[i * LF_LANES + l];
}

/* c numbers of each point and view: [R, c, L]. */
static lf_tensor *in_lanes(lf_tape *tape, const lf_lanes *lanes, long c, const lf_real *x)
{
    lf_tensor *y = lf_tensor_new(tape, 3, LF_DIMS(lanes->rows, c, LF_LANES));
    for (long r = 0; r < lanes->rows; r++)
        gather(lanes, lanes->block[r], lanes->view[r], c, x, y->value + r * c * LF_LANES);
    return y;
}

lf_lanes lf_lanes_make(lf_tape *tape, const lf_tensor *mask, const lf_tensor *difference)
{
    LF_REQUIRE(mask->rank == 3 && mask->dim[2] >= 1 &&
                   (!difference || difference->size == 4 * mask->size),
               "lf_lanes_make: mask of rank %d, %ld numbers; differences of %ld", mask->rank,
               mask->size, difference ? difference->size : 0);
    lf_lanes lanes = {.rays = mask->dim[0], .samples = mask->dim[1], .views = mask->dim[2]};
    lanes.points = lanes.rays * lanes.samples;
    lanes.blocks = (lanes.points + LF_LANES - 1) / LF_LANES;
    find_rows(tape, &lanes, mask->value);
    lanes.mask = in_lanes(tape, &lanes, 1, mask->value);
    if (difference) {
        lanes.difference = in_lanes(tape, &lanes, 4, difference->value);
        lanes.lowest = lowest_of(tape, &lanes, difference->value);
    }
    return lanes;
}

lf_lanes *lf_lanes_keep(lf_tape *tape, const lf_lanes *lanes)
{
    lf_lanes *copy = lf_alloc(tape, sizeof *copy);
    *copy = *lanes;
    return copy;
}

/* ---- rows to lanes -----------------------------------------------------------------------------
 */

static void add_rows_backward(const lf_node *node)
{
    const lf_lanes *lanes = node->saved;
    lf_tensor *x = node->in[0], *y = node->in[1];
    const long c = lf_cols(x);
    const lf_real *dz = node->out[0]->grad;
    for (long i = 0; y && y->grad && i < y->size; i++)
        y->grad[i] += dz[i];
    for (long r = 0; x->grad && r < lanes->rows; r++)
        scatter_add(lanes, lanes->block[r], lanes->view[r], c, dz + r * c * LF_LANES, x->grad);
}

lf_tensor *lf_lanes_add_rows(lf_tape *tape, lf_tensor *x, lf_tensor *y, const lf_lanes *lanes)
{
    const long c = lf_cols(x);
    LF_REQUIRE(lf_rows(x) == lanes->points * lanes->views &&
                   (!y || y->size == lanes->rows * c * LF_LANES),
               "lf_lanes_add_rows: %ld rows of %ld for %ld points of %ld views, %ld lanes",
               lf_rows(x), c, lanes->points, lanes->views, y ? y->size : -1);
    lf_tensor *z = lf_tensor_new(tape, 3, LF_DIMS(lanes->rows, c, LF_LANES));
    for (long r = 0; r < lanes->rows; r++)
        gather(lanes, lanes->block[r], lanes->view[r], c, x->value, z->value + r * c * LF_LANES);
    for (long i = 0; y && i < z->size; i++)
        z->value[i] += y->value[i];
    lf_record(tape, "lanes_add_rows", add_rows_backward, lf_lanes_keep(tape, lanes), LF_IN(x, y),
              LF_OUT(z));
    return z;
}

/* ---- lanes to rows -----------------------------------------------------------------------------
 */

static void to_rows_backward(const lf_node *node)
{
    lf_tensor *x = node->in[0];
    const long c = x->dim[1], points = lf_rows(node->out[0]);
    const lf_real *dz = node->out[0]->grad;
    for (long p = 0; p < points; p++)
        for (long i = 0; i < c; i++)
            x->grad[(p / LF_LANES * c + i) * LF_LANES + p % LF_LANES] += dz[p * c + i];
}

lf_tensor *lf_lanes_to_rows(lf_tape *tape, lf_tensor *x, const lf_lanes *lanes)
{
    LF_REQUIRE(x->rank == 3 && x->dim[0] == lanes->blocks && x->dim[2] == LF_LANES,
               "lf_lanes_to_rows: x of %ld for %ld blocks", x->size, lanes->blocks);
    const long c = x->dim[1];
    lf_tensor *z = lf_tensor_new(tape, 3, LF_DIMS(lanes->rays, lanes->samples, c));
    for (long p = 0; p < lanes->points; p++)
        for (long i = 0; i < c; i++)
            z->value[p * c + i] = x->value[(p / LF_LANES * c + i) * LF_LANES + p % LF_LANES];
    lf_record(tape, "lanes_to_rows", to_rows_backward, NULL, LF_IN(x), LF_OUT(z));
    return z;
}

/* ---- products ----------------------------------------------------------------------------------
 */

static void scale_backward(const lf_node *node)
{
    lf_tensor *x = node->in[0], *w = node->in[1];
    const long c = x->dim[1];
    for (long r = 0; r < x->dim[0]; r++) {
        const lf_vec factor = lf_vec_load(w->value + r * LF_LANES);
        lf_vec sum = {0};
        for (long i = r * c; i < (r + 1) * c; i++) {
            const lf_vec dz = lf_vec_load(node->out[0]->grad + i * LF_LANES);
            sum += dz * lf_vec_load(x->value + i * LF_LANES);
            if (x->grad) {
                lf_real *dx = x->grad + i * LF_LANES;
                lf_vec_store(dx, lf_vec_load(dx) + dz * factor);
            }
        }
        for (int l = 0; w->grad && l < LF_LANES; l++)
            w->grad[r * LF_LANES + l] += sum[l];
    }
}

lf_tensor *lf_lanes_scale(lf_tape *tape, lf_tensor *x, lf_tensor *w)
{
    LF_REQUIRE(x->rank == 3 && x->dim[2] == LF_LANES && w->size == x->dim[0] * LF_LANES,
               "lf_lanes_scale: x of %ld, w of %ld", x->size, w->size);
    lf_tensor *z = lf_tensor_like(tape, x);
    const long c = x->dim[1];
    for (long r = 0; r < x->dim[0]; r++) {
        const lf_vec factor = lf_vec_load(w->value + r * LF_LANES);
        for (long i = r * c; i < (r + 1) * c; i++)
            lf_vec_store(z->value + i * LF_LANES, factor * lf_vec_load(x->value + i * LF_LANES));
    }
    lf_record(tape, "lanes_scale", scale_backward, NULL, LF_IN(x, w), LF_OUT(z));
    return z;
}
