/* scene_select.c: where the cameras look, and which views are near to another. */
#include "datasets/scene_internal.h"

/* Solve the symmetric 3x3 system m x = b by Cramer's rule; false if m is nearly singular. */
static bool solve3(const double m[9], const double b[3], double x[3])
{
    const double det = lf_determinant(m);
    const double size = (m[0] + m[4] + m[8]) / 3;
    if (!(fabs(det) > 1e-3 * size * size * size))
        return false;
    for (int k = 0; k < 3; k++) {
        double c[9];
        memcpy(c, m, sizeof c);
        for (int i = 0; i < 3; i++)
            c[3 * i + k] = b[i];
        x[k] = lf_determinant(c) / det;
    }
    return true;
}

static void far_ahead(const lf_scene *scene, double out[3])
{
    double mean[3] = {0}, ahead[3] = {0}, extent = 0;
    for (long i = 0; i < scene->views; i++)
        for (int k = 0; k < 3; k++) {
            mean[k] += scene->view[i].camera.centre[k] / (double)scene->views;
            ahead[k] += scene->view[i].camera.rotation[3 * k + 2] / (double)scene->views;
        }
    for (long i = 0; i < scene->views; i++) {
        const double *c = scene->view[i].camera.centre;
        extent = fmax(extent, 2 * hypot(hypot(c[0] - mean[0], c[1] - mean[1]), c[2] - mean[2]));
    }
    for (int k = 0; k < 3; k++)
        out[k] = mean[k] + (extent > 0 ? 2 * extent : 1) * ahead[k];
}

bool lf_scene_focus(const lf_scene *scene, double out[3])
{
    double m[9] = {0}, b[3] = {0}, mean[3] = {0}, x[3];
    for (long v = 0; v < scene->views; v++)
        for (int k = 0; k < 3; k++)
            mean[k] += scene->view[v].camera.centre[k] / (double)scene->views;
    for (long v = 0; v < scene->views; v++) {
        const lf_camera *c = &scene->view[v].camera;
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                const double p = (i == j) - c->rotation[3 * i + 2] * c->rotation[3 * j + 2];
                m[3 * i + j] += p;
                b[i] += p * (c->centre[j] - mean[j]);
            }
    }
    if (!solve3(m, b, x)) {
        far_ahead(scene, out);
        return false;
    }
    for (int k = 0; k < 3; k++)
        out[k] = x[k] + mean[k];
    return true;
}

/* ---- nearness ----------------------------------------------------------------------------- */

typedef struct ranked {
    double far;
    long view;
} ranked;

static int by_far(const void *a, const void *b)
{
    const ranked *x = a, *y = b;
    if (x->far != y->far)
        return x->far < y->far ? -1 : 1;
    return (x->view > y->view) - (x->view < y->view);
}

/* Angle between a - o and b - o; pi where one is o. By atan2, accurate near 0 as well. */
static double angle_at(const double o[3], const double a[3], const double b[3])
{
    double x[3], y[3];
    for (int i = 0; i < 3; i++) {
        x[i] = a[i] - o[i];
        y[i] = b[i] - o[i];
    }
    const double c[3] = {x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2],
                         x[0] * y[1] - x[1] * y[0]};
    const double dot = x[0] * y[0] + x[1] * y[1] + x[2] * y[2];
    const double cross = hypot(hypot(c[0], c[1]), c[2]);
    return cross == 0 && dot == 0 ? 3.14159265358979323846 : atan2(cross, dot);
}

static double how_far(lf_nearness nearness, const double centre[3], const lf_camera *a,
                      const lf_camera *b)
{
    if (nearness == LF_NEAR_ANGLE)
        return angle_at(centre, a->centre, b->centre);
    return hypot(hypot(a->centre[0] - b->centre[0], a->centre[1] - b->centre[1]),
                 a->centre[2] - b->centre[2]);
}

/* All candidates but `exclude`, nearest first; the caller frees. */
static ranked *rank(const lf_scene *scene, const lf_camera *target, lf_nearness nearness,
                    const double centre[3], long candidates, const long *candidate, long exclude,
                    long *count)
{
    ranked *r = malloc((size_t)(candidates + 1) * sizeof *r);
    LF_REQUIRE(r, "out of memory");
    *count = 0;
    for (long i = 0; i < candidates; i++) {
        const long v = candidate[i];
        LF_REQUIRE(v >= 0 && v < scene->views, "view %ld of %ld", v, scene->views);
        if (v != exclude)
            r[(*count)++] = (ranked){how_far(nearness, centre, target, &scene->view[v].camera), v};
    }
    qsort(r, (size_t)*count, sizeof *r, by_far);
    return r;
}

static lf_status enough(const lf_scene *scene, long asked, long there, lf_error *err)
{
    if (asked <= there)
        return LF_OK;
    return lf_fail(err, LF_BAD_INPUT,
                   "%s: %ld source views are asked for, %ld are there; ask for fewer",
                   scene->folder, asked, there);
}

lf_status lf_scene_nearest(const lf_scene *scene, const lf_camera *target, lf_nearness nearness,
                           const double centre[3], long candidates, const long *candidate,
                           long exclude, long count, long *out, lf_error *err)
{
    long there;
    ranked *r = rank(scene, target, nearness, centre, candidates, candidate, exclude, &there);
    const lf_status status = enough(scene, count, there, err);
    for (long i = 0; status == LF_OK && i < count; i++)
        out[i] = r[i].view;
    free(r);
    return status;
}

/* Keep `count` of r[n], drawn without replacement, in their order (selection sampling). */
static void thin(ranked *r, long n, long count, lf_stream *stream, long *out)
{
    long taken = 0;
    for (long i = 0; i < n; i++)
        if (lf_uniform(stream) * (double)(n - i) < (double)(count - taken))
            out[taken++] = r[i].view;
}

lf_status lf_scene_draw_sources(const lf_scene *scene, const lf_camera *target,
                                lf_nearness nearness, const double centre[3], long candidates,
                                const long *candidate, long exclude, double include,
                                const double pool[3], lf_stream *stream, long count, long *out,
                                lf_error *err)
{
    const double u = lf_uniform(stream), with = lf_uniform(stream);
    const long times = u < pool[0] ? 1 : u < pool[0] + pool[1] ? 2 : 3;
    long there;
    ranked *r = rank(scene, target, nearness, centre, candidates, candidate,
                     with < include ? -1 : exclude, &there);
    const lf_status status = enough(scene, count, there, err);
    if (status == LF_OK)
        thin(r, times * count < there ? times * count : there, count, stream, out);
    free(r);
    return status;
}
