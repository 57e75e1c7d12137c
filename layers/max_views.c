/* max_views.c: maximum over the views of a point                                  [method.md 5a.10]
 *
 *   y_c = max over the views with k = 1 of r_vc
 *   backward   dr_vc += dy_c for the first view v that has the largest
 *
 * Shapes      r [Q, V, C], mask k [Q, V]; y [Q, C].
 * Keeps       which view had it.
 * Degenerate  a point that no view sees: zeros, no gradient. A NaN counts as the largest.
 */
#include "layers/layers.h"

enum { NONE = -1 };

static void backward(const lf_node *node)
{
    const int *from = node->saved;
    const lf_tensor *y = node->out[0];
    lf_tensor *r = node->in[0];
    const long c = lf_cols(r), views = lf_rows(r) / lf_rows(y);
    for (long i = 0; i < y->size; i++)
        if (from[i] != NONE)
            r->grad[(i / c * views + from[i]) * c + i % c] += y->grad[i];
}

static void largest_of_point(long views, long c, const lf_real *mask, const lf_real *r, lf_real *y,
                             int *from)
{
    for (long i = 0; i < c; i++) {
        y[i] = 0;
        from[i] = NONE;
    }
    for (long v = 0; v < views; v++) {
        if (!(mask[v] > 0))
            continue;
        for (long i = 0; i < c; i++)
            if (from[i] == NONE || !(r[v * c + i] <= y[i] || isnan(y[i]))) {
                y[i] = r[v * c + i];
                from[i] = (int)v;
            }
    }
}

lf_tensor *lf_max_views(lf_tape *tape, lf_tensor *r, const lf_ray_geometry *rays)
{
    LF_REQUIRE(lf_rows(r) == rays->points * rays->views, "lf_max_views: r has %ld rows, not %ld",
               lf_rows(r), rays->points * rays->views);
    const long c = lf_cols(r), views = rays->views;
    lf_tensor *y = lf_tensor_new(tape, 2, LF_DIMS(rays->points, c));
    int *from = lf_alloc(tape, (size_t)y->size * sizeof *from);
    for (long q = 0; q < rays->points; q++)
        largest_of_point(views, c, rays->mask->value + q * views, r->value + q * views * c,
                         y->value + q * c, from + q * c);
    lf_record(tape, "max_views", backward, from, LF_IN(r), LF_OUT(y));
    return y;
}
