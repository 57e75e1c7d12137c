/* stability_points.c: points near a ray, near a camera's centre, near a pixel's line, near the
 * surface.                                                     [method.md 4.4, 5a.3, 5a.7, 5b.2]
 * Differences of neighbouring doubles are exact, so a direction to a point beside a centre keeps
 * all its digits.
 */
#include "autograd/ops.h"
#include "bench/stability.h"
#include "bench/stability_scene.h"

#define DISTANCES                                                                                  \
    LF_STABILITY_AT(1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)

/* ---- near a ray ------------------------------------------------------------------------------ */

/* The moment about a point beside the ray: as long as the distance, orthogonal to the ray. */
static void moment_about_point(lf_stability *s)
{
    const double d[3] = {0.36, 0.48, 0.8}, p[3] = {0.3, -0.7, 0.2};
    const lf_ray x = lf_ray_through(p, d);
    double axes[9], q[3];
    long double exact[3];
    lf_ray_axes(d, axes);
    for (int a = 0; a < 3; a++)
        q[a] = p[a] + 0.4 * d[a] + s->parameter * axes[3 * a];
    const lf_ray y = lf_ray_about(&x, q);
    for (int a = 0; a < 3; a++) {
        const int i = (a + 1) % 3, j = (a + 2) % 3;
        exact[a] = ((long double)p[i] - q[i]) * d[j] - ((long double)p[j] - q[j]) * d[i];
    }
    s->geometry = 1 / s->parameter;
    lf_stability_numbers(s, "moment", 3, y.moment, exact);
}

/* ---- near a centre --------------------------------------------------------------------------- */

/* Directions and pixels of a point beside the first of the built-in cameras. */
static void projection(lf_stability *s)
{
    lf_stability_scene scene;
    lf_stability_scene_make(&scene, s->parameter, 0);
    long double direction[3 * LF_STABILITY_SEEN], uv[2 * LF_STABILITY_SEEN];
    lf_stability_scene_exact(&scene, direction, uv);
    lf_stability_numbers(s, "direction", 3 * LF_STABILITY_SEEN, scene.direction, direction);
    lf_stability_numbers(s, "pixel", 2 * LF_STABILITY_SEEN, scene.uv, uv);
}

/* The reconstruction network behind the sampling, of such a point. */
static void point_head(lf_stability *s)
{
    lf_stability_scene scene;
    lf_stability_scene_make(&scene, s->parameter, 0);
    lf_stability_scene_head(s, &scene);
}

/* A source camera beside a sample of a target ray: the angle turns there. */
static void sample_at_centre(lf_stability *s)
{
    enum { V = 2, S = 3 };
    const lf_types types = {.count = 3, .omega = {0, 1, 4}};
    const double origin[3] = {0, 0, 0}, d[3] = {0, 0.6, 0.8}, depth[S] = {1, 2, 3};
    double centre[3 * V], axes[9];
    uint8_t seen[S * V] = {1, 1, 1, 1, 1, 1};
    long double angle[S * V * 3];
    lf_ray_axes(d, axes);
    for (int v = 0; v < V; v++)
        for (int a = 0; a < 3; a++)
            centre[3 * v + a] = 2 * d[a] + s->parameter * ((0.6 + v) * axes[3 * a] + 0.8 * d[a]);
    const lf_light_rays rays = {1, S, V, origin, d, depth, centre, seen, 1, 5};
    const lf_light_geometry g = lf_light_geometry_make(s->tape, &types, &rays);
    for (int i = 0; i < S * V; i++) {
        long double along = 0, size = 0, w[3];
        for (int a = 0; a < 3; a++) {
            w[a] = (long double)depth[i / V] * d[a] - centre[3 * (i % V) + a];
            along += w[a] * d[a];
            size += w[a] * w[a];
        }
        long double beside = 0; /* |w - <w, d> d|^2 */
        for (int a = 0; a < 3; a++)
            beside += (w[a] - along * d[a]) * (w[a] - along * d[a]);
        const long double h = sqrtl(size), sine = sqrtl(beside) / h, cosine = along / h;
        const bool apart = h > 4e-9L;
        angle[3 * i] = apart ? 4 * sine - 1 : -1;
        angle[3 * i + 1] = !apart ? 0 : 10 * (cosine > 0 ? sine * sine / (1 + cosine) : 1 - cosine);
        angle[3 * i + 2] = apart ? cosine : 1;
    }
    s->geometry = 4 / s->parameter;
    lf_tensor phase = *g.phase, seen_angle = *g.angle;
    lf_stability_output(s, "angle", &seen_angle, angle);
    lf_stability_output(s, "phase", &phase, NULL);
}

/* ---- near a line of pixels ------------------------------------------------------------------- */

/* Places beside a pixel's centre and beside the image's rim. */
static void sample_maps(lf_stability *s)
{
    enum { SIZE = 9, QUERIES = 3 };
    const double h = s->parameter;
    const double places[2 * QUERIES] = {3 + h, 4 - h, h, SIZE - 1 - h, 6, 2 + h};
    double *uv = lf_alloc(s->tape, sizeof places); /* the backward reads them, too */
    long *first = lf_alloc(s->tape, QUERIES * sizeof *first);
    lf_real *mask = lf_alloc_reals(s->tape, QUERIES);
    memcpy(uv, places, sizeof places);
    for (int i = 0; i < QUERIES; i++) {
        first[i] = 0;
        mask[i] = 1;
    }
    lf_tensor *fine = lf_stability_input(s, "fine", 4, LF_DIMS(1, SIZE, SIZE, 2), 1);
    lf_tensor *coarse = lf_stability_input(s, "coarse", 4, LF_DIMS(1, 5, 5, 1), 1);
    lf_tensor *maps[] = {fine, coarse};
    lf_stability_output(s, "samples",
                        lf_sample_maps(s->tape, 2, maps, SIZE, SIZE, QUERIES, 1, uv, mask, first),
                        NULL);
}

/* ---- near the surface ------------------------------------------------------------------------ */

/* Predictions beside the truth, the truth beside the surface and beside the clamp. */
static void sdf_loss(lf_stability *s)
{
    enum { POINTS = 6 };
    static const lf_sdf_loss_config config = {10, 0.1, 0.01, 4};
    const double t[POINTS] = {0.05, -0.03, s->parameter, -s->parameter, 0.1, -0.1};
    float *sdf = lf_alloc(s->tape, POINTS * sizeof *sdf);
    double x[POINTS];
    for (int i = 0; i < POINTS; i++) {
        sdf[i] = (float)t[i];
        x[i] = 10 * (double)sdf[i] + (i % 2 ? 1 : -1) * s->parameter;
    }
    lf_tensor *p = lf_stability_given(s, "x", 2, LF_DIMS(POINTS, 1), x, s->parameter);
    long double loss = 0, slope[POINTS];
    for (int i = 0; i < POINTS; i++) {
        const long double clip = config.scale * config.clamp, z = config.scale * (double)sdf[i];
        const long double target = z < -clip ? -clip : z > clip ? clip : z;
        const long double d = p->value[i] - target;
        const bool beyond = target >= clip ? d >= 0 : target <= -clip && d <= 0;
        const long double w = sdf[i] <= 0.01 ? 4 : 1;
        loss += beyond ? 0 : w * fabsl(d);
        slope[i] = beyond ? 0 : w * lf_stability_weight(0, 0) * ((d > 0) - (d < 0));
    }
    lf_stability_output(s, "loss", lf_sdf_loss(s->tape, p, sdf, &config), &loss);
    lf_stability_gradient(s, "x", slope);
}

static const lf_stability_case cases[] = {
    {"moment about a point", "distance to ray", moment_about_point, DISTANCES},
    {"projection at a centre", "distance to centre", projection, DISTANCES},
    {"point head at a centre", "distance to centre", point_head, DISTANCES},
    {"sample at a centre", "distance to centre", sample_at_centre, DISTANCES},
    {"sampled maps", "distance to pixel", sample_maps, DISTANCES},
    {"signed distance loss", "distance to truth", sdf_loss, DISTANCES},
};

const lf_stability_table lf_stability_points = {cases, sizeof cases / sizeof *cases};
