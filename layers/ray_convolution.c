/* ray_convolution.c: ray -> point convolution with support d0 = 0           [method.md 2.5, 5a.4]
 *
 *   moments   m0 = (1/n) sum_v r_v,  m1 = (sqrt3 / n) sum_v d_v r_v,  n = max(1, views that see p)
 *   layer     F0 = W0 m0 + b,  F1 = W1 m1
 *   backward  dr_v += (dm0 + sqrt3 sum_a d_va dm1_a) / n   for the views that see p
 *
 * Shapes    r [Q, V, C], d [Q, V, 3], mask [Q, V]; m0 [Q, C], m1 [Q, 3, C].
 * Degenerate  a point that no view sees: zeros, no gradient.
 */
#include "layers/layers.h"

static const lf_real sqrt3 = (lf_real)1.7320508075688772;

static lf_real inverse_count(const lf_ray_geometry *rays, long q)
{
    lf_real seen = 0;
    for (long v = 0; v < rays->views; v++)
        seen += rays->mask->value[q * rays->views + v];
    return seen > 1 ? 1 / seen : 1;
}

static void moments_of_point(const lf_ray_geometry *rays, long q, long c, const lf_real *r,
                             lf_real *restrict m0, lf_real *restrict m1)
{
    const lf_real scale = inverse_count(rays, q);
    memset(m0, 0, (size_t)c * sizeof *m0);
    memset(m1, 0, (size_t)(3 * c) * sizeof *m1);
    for (long v = 0; v < rays->views; v++) {
        const long qv = q * rays->views + v;
        if (!(rays->mask->value[qv] > 0))
            continue;
        const lf_real *d = rays->direction->value + 3 * qv, *x = r + qv * c;
        const lf_real w = sqrt3 * scale, dx = w * d[0], dy = w * d[1], dz = w * d[2];
        for (long i = 0; i < c; i++) {
            m0[i] += scale * x[i];
            m1[i] += dx * x[i];
            m1[c + i] += dy * x[i];
            m1[2 * c + i] += dz * x[i];
        }
    }
}

static void moments_backward(const lf_node *node)
{
    const lf_ray_geometry *rays = node->saved;
    lf_tensor *r = node->in[0];
    const long c = lf_cols(r);
    for (long qv = 0; qv < rays->points * rays->views; qv++) {
        if (!(rays->mask->value[qv] > 0))
            continue;
        const long q = qv / rays->views;
        const lf_real scale = inverse_count(rays, q), w = sqrt3 * scale;
        const lf_real *d = rays->direction->value + 3 * qv;
        const lf_real *g0 = node->out[0]->grad + q * c, *g1 = node->out[1]->grad + 3 * q * c;
        lf_real *restrict dr = r->grad + qv * c;
        for (long i = 0; i < c; i++)
            dr[i] += scale * g0[i] + w * (d[0] * g1[i] + d[1] * g1[c + i] + d[2] * g1[2 * c + i]);
    }
}

lf_field lf_ray_moments(lf_tape *tape, lf_tensor *r, const lf_ray_geometry *rays)
{
    LF_REQUIRE(lf_rows(r) == rays->points * rays->views, "lf_ray_moments: r has %ld rows, not %ld",
               lf_rows(r), rays->points * rays->views);
    const long c = lf_cols(r);
    lf_field m = {lf_tensor_new(tape, 2, LF_DIMS(rays->points, c)),
                  lf_tensor_new(tape, 3, LF_DIMS(rays->points, 3, c))};
    for (long q = 0; q < rays->points; q++)
        moments_of_point(rays, q, c, r->value, m.scalar->value + q * c,
                         m.vector->value + 3 * q * c);
    lf_ray_geometry *saved = lf_alloc(tape, sizeof *saved);
    *saved = *rays;
    if (lf_profiled(tape)) {
        const double seen = lf_present(rays->points * rays->views, rays->mask->value);
        lf_products(tape, 4 * seen * (double)c, r->wants ? 4 * seen * (double)c : 0);
    }
    lf_record(tape, "ray_moments", moments_backward, saved, LF_IN(r), LF_OUT(m.scalar, m.vector));
    return m;
}

void lf_ray_convolution_init(lf_store *store, lf_ray_convolution *layer, const char *prefix,
                             long in, long out0, long out1)
{
    char name[128];
    snprintf(name, sizeof name, "%s.scalar", prefix);
    lf_linear_init(store, &layer->scalar, name, in, out0, true, 1);
    layer->has_vector = out1 > 0;
    if (!layer->has_vector)
        return;
    snprintf(name, sizeof name, "%s.vector", prefix);
    lf_linear_init(store, &layer->vector, name, in, out1, false, 1);
}

lf_field lf_ray_convolution_apply(lf_tape *tape, const lf_ray_convolution *layer, lf_tensor *r,
                                  const lf_ray_geometry *rays)
{
    const lf_field m = lf_ray_moments(tape, r, rays);
    lf_field f = {lf_linear_apply(tape, &layer->scalar, m.scalar, LF_IDENTITY), NULL};
    if (layer->has_vector)
        f.vector = lf_linear_apply(tape, &layer->vector, m.vector, LF_IDENTITY);
    return f;
}
