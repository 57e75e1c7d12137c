/* tfn_paths.c: the paths between types 0 and 1 along a unit direction d            [method.md 2.7]
 *
 *   out <- in, J    value                        adjoint (g = gradient of the value)
 *   0 <- 0, 0       s                            ds += g
 *   0 <- 1, 1       <d, v>                       dv += d g
 *   1 <- 1, 0       v                            dv += g
 *   1 <- 1, 1       sqrt(3/2) d x v              dv += sqrt(3/2) g x d
 *   1 <- 0, 1       sqrt3 s d                    ds += sqrt3 <d, g>
 *   1 <- 1, 2       3/sqrt2 (d <d,v> - v / 3)    dv += the same map of g (it is symmetric)
 *
 * Shapes    s [Q, V, C0], v [Q, V, 3, C1] or NULL, d [Q, V, 3];
 *           scalars [Q, V, C0 + C1], vectors [Q, V, 3, C1 + C1 + C0 (+ C1)].
 * Masked    rays that are not seen give zeros and no gradient.
 */
#include "layers/layers.h"

static const lf_real sqrt3 = (lf_real)1.7320508075688772, cross_scale = (lf_real)1.224744871391589,
                     degree2_scale = (lf_real)2.1213203435596424;

typedef struct paths {
    lf_ray_geometry rays;
    long c0, c1;
    bool degree2;
} paths;

static long scalar_cols(const paths *p)
{
    return p->c0 + p->c1;
}

static long vector_cols(const paths *p)
{
    return p->c0 + (p->degree2 ? 3 : 2) * p->c1;
}

/* The paths of one ray. s [c0], v [3, c1], out0 [scalar_cols], out1 [3, vector_cols]. */
static void forward_ray(const paths *p, const lf_real *d, const lf_real *s, const lf_real *v,
                        lf_real *restrict out0, lf_real *restrict out1)
{
    const long c0 = p->c0, c1 = p->c1, n = vector_cols(p);
    memcpy(out0, s, (size_t)c0 * sizeof *s);
    for (int a = 0; a < 3; a++)
        for (long i = 0; i < c0; i++)
            out1[a * n + 2 * c1 + i] = sqrt3 * d[a] * s[i];
    if (!c1)
        return;
    const lf_real *x = v, *y = v + c1, *z = v + 2 * c1;
    for (long i = 0; i < c1; i++)
        out0[c0 + i] = d[0] * x[i] + d[1] * y[i] + d[2] * z[i];
    memcpy(out1, x, (size_t)c1 * sizeof *v);
    memcpy(out1 + n, y, (size_t)c1 * sizeof *v);
    memcpy(out1 + 2 * n, z, (size_t)c1 * sizeof *v);
    for (long i = 0; i < c1; i++) {
        out1[c1 + i] = cross_scale * (d[1] * z[i] - d[2] * y[i]);
        out1[n + c1 + i] = cross_scale * (d[2] * x[i] - d[0] * z[i]);
        out1[2 * n + c1 + i] = cross_scale * (d[0] * y[i] - d[1] * x[i]);
    }
    for (int a = 0; p->degree2 && a < 3; a++)
        for (long i = 0; i < c1; i++)
            out1[a * n + 2 * c1 + c0 + i] =
                degree2_scale * (d[a] * out0[c0 + i] - v[a * c1 + i] / 3);
}

static void backward_scalars(const paths *p, const lf_real *d, const lf_real *g0, const lf_real *g1,
                             lf_real *restrict ds)
{
    const long n = vector_cols(p);
    const lf_real *g = g1 + 2 * p->c1;
    for (long i = 0; i < p->c0; i++)
        ds[i] += g0[i] + sqrt3 * (d[0] * g[i] + d[1] * g[n + i] + d[2] * g[2 * n + i]);
}

static void backward_vectors(const paths *p, const lf_real *d, const lf_real *g0, const lf_real *g1,
                             lf_real *restrict dv)
{
    const long c1 = p->c1, n = vector_cols(p);
    const lf_real *gd = g0 + p->c0, *gc = g1 + c1, *g2 = g1 + 2 * c1 + p->c0;
    for (long i = 0; i < c1; i++) {
        const lf_real x = gc[i], y = gc[n + i], z = gc[2 * n + i];
        dv[i] += d[0] * gd[i] + g1[i] + cross_scale * (y * d[2] - z * d[1]);
        dv[c1 + i] += d[1] * gd[i] + g1[n + i] + cross_scale * (z * d[0] - x * d[2]);
        dv[2 * c1 + i] += d[2] * gd[i] + g1[2 * n + i] + cross_scale * (x * d[1] - y * d[0]);
    }
    for (long i = 0; p->degree2 && i < c1; i++) {
        const lf_real x = g2[i], y = g2[n + i], z = g2[2 * n + i];
        const lf_real along = d[0] * x + d[1] * y + d[2] * z;
        dv[i] += degree2_scale * (d[0] * along - x / 3);
        dv[c1 + i] += degree2_scale * (d[1] * along - y / 3);
        dv[2 * c1 + i] += degree2_scale * (d[2] * along - z / 3);
    }
}

static void backward(const lf_node *node)
{
    const paths *p = node->saved;
    lf_tensor *s = node->in[0], *v = node->in[1];
    for (long r = 0; r < p->rays.points * p->rays.views; r++) {
        if (!(p->rays.mask->value[r] > 0))
            continue;
        const lf_real *d = p->rays.direction->value + 3 * r;
        const lf_real *g0 = node->out[0]->grad + r * scalar_cols(p);
        const lf_real *g1 = node->out[1]->grad + 3 * r * vector_cols(p);
        if (s->grad)
            backward_scalars(p, d, g0, g1, s->grad + r * p->c0);
        if (v && v->grad)
            backward_vectors(p, d, g0, g1, v->grad + 3 * r * p->c1);
    }
}

/* A ray: 3 a channel for sqrt3 s d and for <d, v>, 6 for d x v, and 3 more for d <d, v>; the last
 * one's adjoint has an inner product of its own. */
static void count_products(lf_tape *tape, const paths *p, lf_field x)
{
    const double seen = lf_present(p->rays.points * p->rays.views, p->rays.mask->value);
    const double c0 = (double)p->c0, c1 = (double)p->c1, degree2 = p->degree2 ? 3 : 0;
    const double scalars = x.scalar->wants ? 3 * c0 : 0;
    const double vectors = x.vector && x.vector->wants ? (9 + 2 * degree2) * c1 : 0;
    lf_products(tape, seen * (3 * c0 + (9 + degree2) * c1), seen * (scalars + vectors));
}

lf_field lf_tfn_paths(lf_tape *tape, lf_field x, const lf_ray_geometry *rays, bool degree2)
{
    paths *p = lf_alloc(tape, sizeof *p);
    *p = (paths){*rays, lf_cols(x.scalar), x.vector ? lf_cols(x.vector) : 0, degree2};
    const long n = rays->points * rays->views;
    LF_REQUIRE(lf_rows(x.scalar) == n && (!x.vector || lf_rows(x.vector) == 3 * n),
               "lf_tfn_paths: scalars have %ld rows, not %ld", lf_rows(x.scalar), n);
    const long points = rays->points, views = rays->views;
    lf_field y = {lf_tensor_new(tape, 3, LF_DIMS(points, views, scalar_cols(p))),
                  lf_tensor_new(tape, 4, LF_DIMS(points, views, 3, vector_cols(p)))};
    for (long r = 0; r < n; r++) {
        lf_real *y0 = y.scalar->value + r * scalar_cols(p);
        lf_real *y1 = y.vector->value + 3 * r * vector_cols(p);
        if (rays->mask->value[r] > 0) {
            forward_ray(p, rays->direction->value + 3 * r, x.scalar->value + r * p->c0,
                        x.vector ? x.vector->value + 3 * r * p->c1 : NULL, y0, y1);
        } else {
            memset(y0, 0, (size_t)scalar_cols(p) * sizeof *y0);
            memset(y1, 0, (size_t)(3 * vector_cols(p)) * sizeof *y1);
        }
    }
    if (lf_profiled(tape))
        count_products(tape, p, x);
    lf_record(tape, "tfn_paths", backward, p, LF_IN(x.scalar, x.vector),
              LF_OUT(y.scalar, y.vector));
    return y;
}
