/* surface_closest.c: closest points.                                        [surface.h says what]
 *
 * Embree walks its tree with a search radius a little larger than the best distance so far, so that
 * the rounding of its float boxes loses nothing; the callback computes the exact closest point of
 * each triangle in double.
 */
#include "datasets/surface_internal.h"

#include <math.h>

/* ---- closest point ------------------------------------------------------------------------ */

/* Closest point of a triangle by the region of the plane that p projects to: corner, edge or
 * interior (Ericson, "Real-time collision detection", 2005, section 5.1.5). */
static void closest_on_triangle(const double p[3], const double a[3], const double b[3],
                                const double c[3], double out[3])
{
    double ab[3], ac[3], ap[3], bp[3], cp[3];
    lf_subtract(b, a, ab);
    lf_subtract(c, a, ac);
    lf_subtract(p, a, ap);
    lf_subtract(p, b, bp);
    lf_subtract(p, c, cp);
    const double d1 = lf_dot(ab, ap), d2 = lf_dot(ac, ap), d3 = lf_dot(ab, bp), d4 = lf_dot(ac, bp);
    const double d5 = lf_dot(ab, cp), d6 = lf_dot(ac, cp);
    const double vc = d1 * d4 - d3 * d2, vb = d5 * d2 - d1 * d6, va = d3 * d6 - d5 * d4;
    double v = 0, w = 0; /* out = a + v ab + w ac */
    if (d1 <= 0 && d2 <= 0) {
        v = 0;
    } else if (d3 >= 0 && d4 <= d3) {
        v = 1;
    } else if (vc <= 0 && d1 >= 0 && d3 <= 0) {
        v = d1 / (d1 - d3);
    } else if (d6 >= 0 && d5 <= d6) {
        w = 1;
    } else if (vb <= 0 && d2 >= 0 && d6 <= 0) {
        w = d2 / (d2 - d6);
    } else if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) {
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        v = 1 - w;
    } else {
        v = vb / (va + vb + vc);
        w = vc / (va + vb + vc);
    }
    for (int i = 0; i < 3; i++)
        out[i] = a[i] + v * ab[i] + w * ac[i];
}

struct search {
    const lf_surface *surface;
    const double *point;
    double best2; /* squared distance */
    double slack; /* rounding of the float search, in local units */
    lf_closest found;
};

/* The smallest radius (local units) that cannot lose a closer triangle by rounding. */
static float search_radius(const struct search *q)
{
    return (float)((sqrt(q->best2) / q->surface->diagonal) * (1 + 1e-6) + q->slack);
}

static bool visit(struct RTCPointQueryFunctionArguments *args)
{
    struct search *q = args->userPtr;
    const lf_mesh *mesh = q->surface->mesh;
    const long face = q->surface->original[args->primID];
    const int32_t *f = mesh->face[face];
    double at[3], d[3];
    closest_on_triangle(q->point, mesh->vertex[f[0]], mesh->vertex[f[1]], mesh->vertex[f[2]], at);
    lf_subtract(at, q->point, d);
    const double d2 = lf_dot(d, d);
    if (!(d2 < q->best2))
        return false;
    q->best2 = d2;
    q->found.face = face;
    for (int i = 0; i < 3; i++)
        q->found.point[i] = at[i];
    const float radius = search_radius(q);
    if (radius >= args->query->radius)
        return false;
    args->query->radius = radius;
    return true;
}

lf_closest lf_surface_closest(const lf_surface *s, const double point[3])
{
    struct search q = {.surface = s, .point = point, .best2 = INFINITY};
    q.found = (lf_closest){.face = -1, .distance = NAN, .point = {NAN, NAN, NAN}};
    double off[3];
    lf_subtract(point, s->centre, off);
    const double away = sqrt(lf_dot(off, off)) / s->diagonal;
    if (!(away < 1e30))
        return q.found;
    q.slack = 5e-7 * (1 + away);
    float local[3];
    lf_surface_local(s, point, local);
    struct RTCPointQuery query = {.x = local[0], .y = local[1], .z = local[2]};
    query.radius = (float)((away + 1) * 1.001); /* the whole box lies within */
    struct RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    rtcPointQuery(s->scene, &query, &context, visit, &q);
    q.found.distance = sqrt(q.best2);
    return q.found;
}

void lf_surface_distance_all(const lf_surface *s, long n, const double (*point)[3], double *out)
{
#pragma omp parallel for schedule(dynamic, 256)
    for (long i = 0; i < n; i++)
        out[i] = lf_surface_closest(s, point[i]).distance;
}
