/* harmonics.c: how source cameras look at the points of a target ray   [method.md 4.1, 4.4, 5b.2]
 *
 * Per (ray, view), o the ray's origin, c the camera's centre, S = S(d) the ray's frame:
 *   (u_x, u_y, -a) = S' (o - c):  perpendicular offset u, and the depth a where the camera projects
 *   z = (u_x + i u_y) / |u|,      phase of type omega: z^omega |u|^2 / (|u|^2 + epsilon^2)
 * Per (ray, sample, view), tau the sample's depth:
 *   h = hypot(tau - a, |u|),       cos theta = (tau - a) / h,  sin theta = |u| / h
 *
 * The direction from the camera to any point of the ray has the azimuth of u: one phase serves all
 * samples, and it does not lose digits when theta is small. Differences of positions are formed
 * first, so far scenes keep the digits that their coordinates have.
 */
#include "layers/light_field.h"

bool lf_types_valid(const lf_types *types)
{
    if (types->count < 1 || types->count > LF_TYPES_MAX || types->omega[0] != 0 ||
        types->more < 0 || types->more >= LF_SCALARS_MAX)
        return false;
    for (int k = 1; k < types->count; k++)
        if (types->omega[k] <= types->omega[k - 1] || types->omega[k] > LF_OMEGA_MAX)
            return false;
    return true;
}

void lf_harmonics(const lf_types *types, double x, double y, double epsilon, double *phase)
{
    const double r = hypot(x, y);
    double c = r > 0 ? x / r : 1, s = r > 0 ? y / r : 0; /* z^bit */
    const double fade = r > 0 ? 1 / (1 + (epsilon / r) * (epsilon / r)) : 0;
    phase[0] = 1;
    for (int k = 1; k < types->count; k++) {
        phase[2 * k - 1] = fade;
        phase[2 * k] = 0;
    }
    for (int bit = 1; bit <= types->omega[types->count - 1]; bit *= 2) {
        for (int k = 1; k < types->count; k++) {
            double *re = &phase[2 * k - 1], *im = &phase[2 * k], p = *re;
            if (!(types->omega[k] & bit))
                continue;
            *re = p * c - *im * s;
            *im = p * s + *im * c;
        }
        const double twice = 2 * c * s;
        c = (c - s) * (c + s);
        s = twice;
    }
}

/* One ray's numbers of all views: phases, |u| and a. */
static void ray_views(const lf_types *types, const lf_light_rays *in, long ray, lf_real *phase,
                      double *offset, double *along)
{
    double axes[9], z[LF_PHASES_MAX];
    const long phases = lf_types_phases(types);
    lf_ray_axes(in->direction + 3 * ray, axes);
    for (long v = 0; v < in->views; v++) {
        double u[3] = {0, 0, 0}; /* S' (o - c) */
        for (int i = 0; i < 3; i++) {
            const double w = in->origin[3 * ray + i] - in->centre[3 * v + i];
            for (int a = 0; a < 3; a++)
                u[a] += axes[3 * i + a] * w;
        }
        offset[v] = hypot(u[0], u[1]);
        along[v] = -u[2];
        lf_harmonics(types, u[0], u[1], 1e-4 * (in->far - in->near), z);
        for (long p = 0; p < phases; p++)
            phase[v * phases + p] = (lf_real)z[p];
    }
}

/* 4 sin - 1, 10 (1 - cos), cos of the angle at a point `ahead` of the camera's projection; false
 * where the camera is at the point. 1 - cos = sin^2 / (1 + cos) keeps its digits for small angles.
 */
static bool view_angle(double ahead, double offset, double least, lf_real *out)
{
    const double h = sqrt(ahead * ahead + offset * offset);
    const bool apart = h > least;
    const double cosine = apart ? ahead / h : 1, sine = apart ? offset / h : 0;
    const double versine = cosine > 0 ? sine * sine / (1 + cosine) : 1 - cosine;
    out[0] = (lf_real)(4 * sine - 1);
    out[1] = (lf_real)(10 * versine);
    out[2] = (lf_real)cosine;
    return apart;
}

static void require_rays(const lf_types *types, const lf_light_rays *in)
{
    LF_REQUIRE(lf_types_valid(types), "lf_light_geometry: %d types", types->count);
    LF_REQUIRE(in->rays >= 1 && in->samples >= 1 && in->views >= 1 && in->far > in->near,
               "lf_light_geometry: %ld rays, %ld samples, %ld views, near %g, far %g", in->rays,
               in->samples, in->views, in->near, in->far);
}

lf_light_geometry lf_light_geometry_make(lf_tape *tape, const lf_types *types,
                                         const lf_light_rays *in)
{
    require_rays(types, in);
    const long n = in->rays, s = in->samples, v = in->views, phases = lf_types_phases(types);
    lf_tensor *phase = lf_tensor_new(tape, 3, LF_DIMS(n, v, phases));
    lf_tensor *angle = lf_tensor_new(tape, 4, LF_DIMS(n, s, v, 3));
    lf_tensor *mask = lf_tensor_new(tape, 3, LF_DIMS(n, s, v));
    lf_tensor *count = lf_tensor_new(tape, 2, LF_DIMS(n, s)), *depth = lf_tensor_like(tape, count);
    const double range = in->far - in->near;
    const lf_mark mark = lf_tape_mark(tape);
    double *offset = lf_alloc(tape, 2 * (size_t)v * sizeof *offset), *along = offset + v;
    for (long ray = 0; ray < n; ray++) {
        ray_views(types, in, ray, phase->value + ray * v * phases, offset, along);
        for (long i = ray * s; i < (ray + 1) * s; i++) {
            depth->value[i] = (lf_real)((in->depth[i] - in->near) / range);
            count->value[i] = 0;
            for (long k = 0; k < v; k++) {
                lf_real *a = angle->value + 3 * (i * v + k);
                const bool apart = view_angle(in->depth[i] - along[k], offset[k], 1e-9 * range, a);
                mask->value[i * v + k] = in->seen[i * v + k] && apart;
                count->value[i] += mask->value[i * v + k];
            }
        }
    }
    lf_tape_release(tape, mark);
    return (lf_light_geometry){n, s, v, *types, phase, angle, mask, count, depth};
}
