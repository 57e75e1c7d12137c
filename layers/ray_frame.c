/* ray_frame.c: Plücker rays, the section and the twist.          [ray_frame.h; method.md 1.1 - 1.6]
 *
 *   S(d) = | c d_z  -s  c r |     r = hypot(d_x, d_y),  (c, s) = (d_x, d_y) / r, or (1, 0) if r = 0
 *          | s d_z   c  s r |
 *          |  -r     0  d_z |     no angle is formed, nothing is subtracted
 */
#include "layers/ray_frame.h"

#include <math.h>

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* out = r p; out must not be p. */
static void rotate(const double r[9], const double p[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = dot(r + 3 * i, p);
}

/* ---- motions --------------------------------------------------------------------------------- */

lf_frame lf_frame_compose(const lf_frame *a, const lf_frame *b)
{
    lf_frame g;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            g.rotation[3 * i + j] = a->rotation[3 * i] * b->rotation[j] +
                                    a->rotation[3 * i + 1] * b->rotation[3 + j] +
                                    a->rotation[3 * i + 2] * b->rotation[6 + j];
    lf_frame_apply(a, b->origin, g.origin);
    return g;
}

lf_frame lf_frame_inverse(const lf_frame *g)
{
    lf_frame inverse;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            inverse.rotation[3 * i + j] = g->rotation[3 * j + i];
    rotate(inverse.rotation, g->origin, inverse.origin);
    for (int i = 0; i < 3; i++)
        inverse.origin[i] = -inverse.origin[i];
    return inverse;
}

void lf_frame_apply(const lf_frame *g, const double p[3], double out[3])
{
    double turned[3];
    rotate(g->rotation, p, turned);
    for (int i = 0; i < 3; i++)
        out[i] = turned[i] + g->origin[i];
}

/* ---- rays ------------------------------------------------------------------------------------ */

lf_ray lf_ray_through(const double point[3], const double direction[3])
{
    lf_ray x = {{direction[0], direction[1], direction[2]}, {0, 0, 0}};
    cross(point, direction, x.moment);
    return x;
}

lf_ray lf_ray_base(void)
{
    return (lf_ray){{0, 0, 1}, {0, 0, 0}};
}

lf_ray lf_ray_move(const lf_frame *g, const lf_ray *x)
{
    lf_ray y;
    double shift[3];
    rotate(g->rotation, x->direction, y.direction);
    rotate(g->rotation, x->moment, y.moment);
    cross(g->origin, y.direction, shift);
    for (int i = 0; i < 3; i++)
        y.moment[i] += shift[i];
    return y;
}

lf_ray lf_ray_about(const lf_ray *x, const double q[3])
{
    lf_ray y = *x;
    double shift[3];
    cross(q, x->direction, shift);
    for (int i = 0; i < 3; i++)
        y.moment[i] -= shift[i];
    return y;
}

void lf_ray_foot(const lf_ray *x, double foot[3])
{
    cross(x->direction, x->moment, foot);
}

void lf_ray_point(const lf_ray *x, double t, double point[3])
{
    lf_ray_foot(x, point);
    for (int i = 0; i < 3; i++)
        point[i] += t * x->direction[i];
}

double lf_ray_parameter(const lf_ray *x, const double point[3])
{
    return dot(point, x->direction);
}

/* ---- section and twist ----------------------------------------------------------------------- */

void lf_ray_axes(const double direction[3], double axes[9])
{
    const double z = direction[2], r = hypot(direction[0], direction[1]);
    const double c = r > 0 ? direction[0] / r : 1, s = r > 0 ? direction[1] / r : 0;
    const double rows[9] = {c * z, -s, c * r, s * z, c, s * r, -r, 0, z};
    for (int i = 0; i < 9; i++)
        axes[i] = rows[i];
}

lf_frame lf_ray_section(const lf_ray *x)
{
    lf_frame s;
    lf_ray_axes(x->direction, s.rotation);
    lf_ray_foot(x, s.origin);
    return s;
}

lf_twist lf_ray_twist(const lf_frame *g, const lf_ray *x)
{
    double before[9], after[9], direction[3], tangent[3];
    lf_ray_axes(x->direction, before);
    rotate(g->rotation, x->direction, direction);
    lf_ray_axes(direction, after);
    rotate(g->rotation, (const double[3]){before[0], before[3], before[6]}, tangent);
    return (lf_twist){dot((const double[3]){after[0], after[3], after[6]}, tangent),
                      dot((const double[3]){after[1], after[4], after[7]}, tangent),
                      dot(g->origin, direction)};
}

lf_twist lf_twist_compose(const lf_twist *a, const lf_twist *b)
{
    return (lf_twist){a->cosine * b->cosine - a->sine * b->sine,
                      a->sine * b->cosine + a->cosine * b->sine, a->shift + b->shift};
}

lf_twist lf_twist_inverse(const lf_twist *h)
{
    return (lf_twist){h->cosine, -h->sine, -h->shift};
}

lf_frame lf_twist_frame(const lf_twist *h)
{
    return (lf_frame){{h->cosine, -h->sine, 0, h->sine, h->cosine, 0, 0, 0, 1}, {0, 0, h->shift}};
}
