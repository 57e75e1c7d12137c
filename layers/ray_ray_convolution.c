/* ray_ray_convolution.c: scalar ray features to fields along a target ray     [method.md 2.3, 5b.3]
 *
 *   values   k_v = (1 + a) z_v m_v                dm_v += (1 + a) conj(z_v) dk_v
 *                                                 da   += Re <conj(z_v) dk_v, m_v>
 *   mean     y = sum_v mask_v k_v / max(1, sum_v mask_v);  dk_v = mask_v dy / max(1, sum mask)
 *
 * Shapes     m, k [N, S, V, P C], a [N, S, V, Q C], y [N, S, P C]; z = 1 for the scalars.
 * Masked     views that do not see the point are not computed: zeros, no gradient.
 */
#include "layers/light_field.h"

typedef struct turn {
    lf_light_geometry rays;
    long c;
    bool mean;
} turn;

/* y += weight (1 + a) z m for one (ray, sample, view). */
static void add_view(const turn *t, lf_real weight, const lf_real *z, const lf_real *m,
                     const lf_real *a, lf_real *restrict y)
{
    const long c = t->c;
    for (long i = 0; i < lf_types_scalars(&t->rays.types) * c; i++)
        y[i] += weight * (1 + a[i]) * m[i];
    for (long k = 1; k < t->rays.types.count; k++) {
        const lf_real x = z[2 * k - 1], s = z[2 * k];
        const long plane = lf_types_plane(&t->rays.types, k);
        const lf_real *re = m + plane * c, *im = re + c;
        const lf_real *ak = a + lf_types_gate(&t->rays.types, k) * c;
        lf_real *yr = y + plane * c, *yi = yr + c;
        for (long i = 0; i < c; i++) {
            const lf_real f = weight * (1 + ak[i]);
            yr[i] += f * (x * re[i] - s * im[i]);
            yi[i] += f * (s * re[i] + x * im[i]);
        }
    }
}

static void add_view_backward(const turn *t, lf_real weight, const lf_real *z, const lf_real *m,
                              const lf_real *a, const lf_real *dy, lf_real *restrict dm,
                              lf_real *restrict da)
{
    const long c = t->c;
    for (long i = 0; i < lf_types_scalars(&t->rays.types) * c; i++) {
        if (dm)
            dm[i] += weight * (1 + a[i]) * dy[i];
        if (da)
            da[i] += weight * m[i] * dy[i];
    }
    for (long k = 1; k < t->rays.types.count; k++) {
        const lf_real x = weight * z[2 * k - 1], s = weight * z[2 * k];
        const long re = lf_types_plane(&t->rays.types, k) * c, im = re + c;
        const long gate = lf_types_gate(&t->rays.types, k) * c;
        for (long i = 0; i < c; i++) {
            const lf_real gr = x * dy[re + i] + s * dy[im + i];
            const lf_real gi = x * dy[im + i] - s * dy[re + i];
            if (dm) {
                dm[re + i] += (1 + a[gate + i]) * gr;
                dm[im + i] += (1 + a[gate + i]) * gi;
            }
            if (da)
                da[gate + i] += m[re + i] * gr + m[im + i] * gi;
        }
    }
}

/* 1 for values; 1 / (views that see the point) for the mean, 0 if there is none. */
static lf_real view_weight(const turn *t, const lf_real *mask)
{
    if (!t->mean)
        return 1;
    long seen = 0;
    for (long v = 0; v < t->rays.views; v++)
        seen += mask[v] > 0;
    return seen ? 1 / (lf_real)seen : 0;
}

static void backward(const lf_node *node)
{
    const turn *t = node->saved;
    const lf_tensor *m = node->in[0], *a = node->in[1];
    const long views = t->rays.views, n = lf_cols(m), na = lf_cols(a);
    const long phases = lf_types_phases(&t->rays.types);
    for (long p = 0; p < t->rays.rays * t->rays.samples; p++) {
        const lf_real *mask = t->rays.mask->value + p * views;
        const lf_real *z = t->rays.phase->value + p / t->rays.samples * views * phases;
        const lf_real weight = view_weight(t, mask);
        for (long v = 0; v < views; v++) {
            const long pv = p * views + v;
            if (!(mask[v] > 0))
                continue;
            add_view_backward(t, weight, z + v * phases, m->value + pv * n, a->value + pv * na,
                              node->out[0]->grad + (t->mean ? p : pv) * n,
                              m->grad ? m->grad + pv * n : NULL,
                              a->grad ? a->grad + pv * na : NULL);
        }
    }
}

static lf_tensor *turn_views(lf_tape *tape, lf_tensor *m, lf_tensor *a,
                             const lf_light_geometry *rays, bool mean)
{
    const long planes = lf_types_planes(&rays->types), views = rays->views;
    const long phases = lf_types_phases(&rays->types);
    const long points = rays->rays * rays->samples, n = lf_cols(m), na = lf_cols(a);
    turn *t = lf_alloc(tape, sizeof *t);
    *t = (turn){*rays, n / planes, mean};
    LF_REQUIRE(n % planes == 0 && lf_rows(m) == points * views && lf_rows(a) == points * views &&
                   na == lf_types_gates(&rays->types) * t->c,
               "lf_ray_ray: m [%ld, %ld], a [%ld, %ld] for %ld points of %ld views", lf_rows(m), n,
               lf_rows(a), na, points, views);
    lf_tensor *y = mean ? lf_tensor_new(tape, 3, LF_DIMS(rays->rays, rays->samples, n))
                        : lf_tensor_new(tape, 4, LF_DIMS(rays->rays, rays->samples, views, n));
    memset(y->value, 0, (size_t)y->size * sizeof *y->value);
    for (long p = 0; p < points; p++) {
        const lf_real *mask = rays->mask->value + p * views;
        const lf_real *z = rays->phase->value + p / rays->samples * views * phases;
        const lf_real weight = view_weight(t, mask);
        for (long v = 0; v < views; v++)
            if (mask[v] > 0)
                add_view(t, weight, z + v * phases, m->value + (p * views + v) * n,
                         a->value + (p * views + v) * na,
                         y->value + (mean ? p : p * views + v) * n);
    }
    if (lf_profiled(tape)) { /* (1 + a) z m: 3 a number, 1 a scalar */
        const double scalars = (double)(lf_types_scalars(&rays->types) * t->c);
        const double products = scalars + 3 * ((double)n - scalars);
        lf_products_of(tape, products * lf_present(rays->mask->size, rays->mask->value), m, a);
    }
    lf_record(tape, mean ? "ray_ray_mean" : "ray_ray_values", backward, t, LF_IN(m, a), LF_OUT(y));
    return y;
}

lf_tensor *lf_ray_ray_values(lf_tape *tape, lf_tensor *m, lf_tensor *a,
                             const lf_light_geometry *rays)
{
    return turn_views(tape, m, a, rays, false);
}

lf_tensor *lf_ray_ray_mean(lf_tape *tape, lf_tensor *m, lf_tensor *a, const lf_light_geometry *rays)
{
    return turn_views(tape, m, a, rays, true);
}

/* ---- the layer --------------------------------------------------------------------------------
 */

void lf_ray_ray_convolution_init(lf_store *store, lf_ray_ray_convolution *layer, const char *prefix,
                                 const lf_types *types, long in, long channels, long hidden)
{
    char name[160];
    snprintf(name, sizeof name, "%s.map", prefix);
    lf_linear_init(store, &layer->map, name, in, lf_types_planes(types) * channels, true, 1);
    snprintf(name, sizeof name, "%s.profile", prefix);
    lf_mlp_init(store, &layer->profile, name, 3, 1, &hidden, lf_types_gates(types) * channels);
}

static lf_tensor *apply(lf_tape *tape, const lf_ray_ray_convolution *layer, lf_tensor *f,
                        const lf_light_geometry *rays, bool mean)
{
    lf_tensor *m = lf_linear_apply(tape, &layer->map, f, LF_IDENTITY);
    lf_tensor *angle = lf_leaf(tape, rays->angle->rank, rays->angle->dim, rays->angle->value, NULL);
    return turn_views(tape, m, lf_mlp_apply(tape, &layer->profile, angle), rays, mean);
}

lf_tensor *lf_ray_ray_convolution_apply(lf_tape *tape, const lf_ray_ray_convolution *layer,
                                        lf_tensor *f, const lf_light_geometry *rays)
{
    return apply(tape, layer, f, rays, true);
}

lf_tensor *lf_ray_ray_convolution_views(lf_tape *tape, const lf_ray_ray_convolution *layer,
                                        lf_tensor *f, const lf_light_geometry *rays)
{
    return apply(tape, layer, f, rays, false);
}
