/* sdf.c: sign and distance of a triangle soup.                                   [sdf.h says what]
 *
 * Closed meshes (every edge, vertices joined by position, has as many faces one way as the other,
 * after each part is oriented one way): the winding number is whole and decides alone, each part
 * turned to positive volume. All others:
 * Escape rule: of N fixed directions fewer than N/64 leave the mesh. They are cast eight at a time,
 * every eight spread over the whole sphere, so a point outside is known after one or two packets.
 * Visibility: a face is seen from outside if one of eight points, four a side and 0.001 diagonals
 * off it, is outside by the same rule; faces that are not seen (seats in a car) would spoil the
 * distance inside and are left out of it.
 * Orientation for the winding number: each part of the soup (sdf_soup.c) is turned so that more
 * directions escape in front of it than behind, weighted by area. A part is left out where the two
 * differ by less than a third of their sum: hidden parts, sheets, shallow bowls. An open bowl as
 * deep as a hemisphere cannot be told from a closed surface with a third of its faces missing; it
 * is filled.
 * Combined: inside by the escape rule, or winding number above 1/2 and less than half of the
 * directions escape.
 */
#include "datasets/sdf_internal.h"

#include <math.h>
#include <string.h>

#include "autograd/random.h"

lf_sdf_options lf_sdf_defaults(void)
{
    return (lf_sdf_options){.method = LF_SDF_COMBINED, .directions = 128, .thickness = 0};
}

/* ---- opening and closing ------------------------------------------------------------------ */

static lf_status check_options(const lf_sdf_options *o, lf_error *err)
{
    if (o->directions < 8 || o->directions > 1024 || o->directions % 8)
        return lf_fail(err, LF_BAD_INPUT,
                       "%d directions for the sign; allowed are 8 ... 1024, multiples of 8",
                       o->directions);
    if (!(o->thickness >= 0 && isfinite(o->thickness)))
        return lf_fail(err, LF_BAD_INPUT, "thickness %g; must be 0 or positive", o->thickness);
    if (o->method != LF_SDF_COMBINED && o->method != LF_SDF_ESCAPE && o->method != LF_SDF_WINDING)
        return lf_fail(err, LF_BAD_INPUT, "sign method %d is unknown", (int)o->method);
    return LF_OK;
}

static lf_status prepare(lf_sdf *s, const lf_mesh *mesh, lf_error *err)
{
    const int n = s->options.directions;
    s->inside_below = n / 64 > 1 ? n / 64 : 1;
    s->clear_from = n / 16 > 1 ? n / 16 : 1;
    s->packet = malloc((size_t)n / 8 * sizeof *s->packet);
    if (!s->packet)
        return lf_fail(err, LF_FAILED, "no memory for %d directions", n);
    lf_sdf_make_packets(s);
    LF_TRY(lf_surface_open(mesh, &s->all, err));
    lf_mesh_bounds(mesh, s->low, s->high);
    LF_TRY(lf_sdf_find_seen(s, mesh, err));
    lf_sdf_prepare_winding(s, mesh);
    return LF_OK;
}

lf_status lf_sdf_open(const lf_mesh *mesh, const lf_sdf_options *options, lf_sdf **out,
                      lf_error *err)
{
    LF_TRY(check_options(options, err));
    lf_sdf *s = calloc(1, sizeof *s);
    if (!s)
        return lf_fail(err, LF_FAILED, "no memory for a signed distance");
    s->options = *options;
    const lf_status status = prepare(s, mesh, err);
    if (status != LF_OK) {
        lf_sdf_close(s);
        return status;
    }
    *out = s;
    return LF_OK;
}

void lf_sdf_close(lf_sdf *s)
{
    if (!s)
        return;
    lf_surface_close(s->all);
    lf_surface_close(s->seen);
    lf_mesh_free(s->seen_mesh);
    lf_winding_close(s->winding);
    free(s->packet);
    free(s);
}

lf_sdf_report lf_sdf_report_of(const lf_sdf *s)
{
    return s->report;
}

/* ---- evaluation --------------------------------------------------------------------------- */

static bool outside_box(const lf_sdf *s, const double p[3])
{
    for (int i = 0; i < 3; i++)
        if (p[i] < s->low[i] || p[i] > s->high[i])
            return true;
    return false;
}

static bool is_inside(const lf_sdf *s, const double p[3], bool count, bool *doubtful)
{
    const int packets = s->options.directions / 8, half = s->options.directions / 2;
    *doubtful = false;
    if (outside_box(s, p))
        return false;
    if (s->winding && s->report.closed)
        return lf_winding_at(s->winding, p) > 0.5;

    const bool rule = s->options.method != LF_SDF_WINDING;
    int out = 0;
    if (rule || count) {
        out = lf_sdf_escapes(s, p, packets, count ? s->clear_from : s->inside_below);
        *doubtful = out >= 1 && out < s->clear_from;
    }
    if (rule && out < s->inside_below)
        return true;
    if (!s->winding || lf_winding_at(s->winding, p) <= 0.5)
        return false;
    return !rule || lf_sdf_escapes(s, p, packets, half) < half;
}

void lf_sdf_eval(const lf_sdf *s, long n, const double (*point)[3], double *out, long *doubtful)
{
    long doubts = 0;
#pragma omp parallel for schedule(dynamic, 256) reduction(+ : doubts)
    for (long i = 0; i < n; i++) {
        const double distance = lf_surface_closest(s->seen, point[i]).distance;
        if (!isfinite(distance)) {
            out[i] = NAN;
            continue;
        }
        bool doubt;
        const bool inside = is_inside(s, point[i], doubtful != NULL, &doubt);
        out[i] = (inside ? -distance : distance) - s->options.thickness;
        doubts += doubt;
    }
    if (doubtful)
        *doubtful = doubts;
}

/* ---- samples ------------------------------------------------------------------------------ */

static void uniform_points(const lf_sdf *s, long n, uint64_t seed, uint64_t item, double (*p)[3])
{
    double half = 0;
    for (int i = 0; i < 3; i++)
        half = fmax(half, 0.55 * (s->high[i] - s->low[i]));
    for (long k = 0; k < n; k++) {
        lf_stream r = lf_stream_at(seed, LF_RANDOM_VOLUME, (uint64_t)k, item);
        for (int i = 0; i < 3; i++)
            p[k][i] = (s->low[i] + s->high[i]) / 2 + half * (2 * lf_uniform(&r) - 1);
    }
}

static void near_points(const lf_sdf *s, long n, uint64_t seed, uint64_t item, double (*p)[3])
{
    const double diagonal = lf_surface_diagonal(s->all);
    for (long k = 0; k < n; k++) {
        lf_stream r = lf_stream_at(seed, LF_RANDOM_NEAR, (uint64_t)k, item);
        const double sigma = (lf_uniform(&r) < 0.5 ? 0.01 : 0.03) * diagonal;
        for (int i = 0; i < 3; i++)
            p[k][i] += sigma * lf_normal(&r);
    }
}

void lf_sdf_samples(const lf_sdf *s, long n_uniform, long n_near, uint64_t seed, uint64_t item,
                    float (*out)[4], long *doubtful)
{
    LF_REQUIRE(n_uniform >= 0 && n_near >= 0, "lf_sdf_samples: %ld uniform, %ld near", n_uniform,
               n_near);
    const long n = n_uniform + n_near;
    double(*p)[3] = malloc((size_t)n * sizeof *p + 1),
    *value = malloc((size_t)n * sizeof *value + 1);
    LF_REQUIRE(p && value, "lf_sdf_samples: no memory for %ld points", n);
    uniform_points(s, n_uniform, seed, item, p);
    /* seen_mesh has an area: lf_surface_open took it */
    if (n_near > 0) {
        const lf_status status =
            lf_mesh_sample_surface(s->seen_mesh, n_near, seed, item, p + n_uniform, NULL, NULL);
        LF_REQUIRE(status == LF_OK, "lf_sdf_samples: a surface without area");
        near_points(s, n_near, seed, item, p + n_uniform);
    }
    for (long k = 0; k < n; k++)
        for (int i = 0; i < 3; i++)
            p[k][i] = out[k][i] = (float)p[k][i]; /* the value belongs to the stored point */
    lf_sdf_eval(s, n, (const double(*)[3])p, value, doubtful);
    for (long k = 0; k < n; k++)
        out[k][3] = (float)value[k];
    free(p);
    free(value);
}
