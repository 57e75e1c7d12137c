/* sdf.c: sign and distance of a triangle soup.                                   [sdf.h says what]
 *
 * Escape rule: of N fixed directions fewer than N/64 leave the mesh. They are cast eight at a time,
 * every eight spread over the whole sphere, so a point outside is known after one or two packets.
 * Visibility: a face is seen from outside if one of eight points, four a side and 0.001 diagonals
 * off it, is outside by the same rule; faces that are not seen (seats in a car) would spoil the
 * distance inside and are left out of it.
 * Orientation for the winding number: each part of the soup (sdf_soup.c) is turned so that more
 * directions escape in front of it than behind, weighted by area; a part with no clear
 * front, hidden or a flat sheet, is left out.
 * Combined: the winding number speaks only where the mesh has open edges, and only for points where
 * less than half of the directions escape.
 */
#include "datasets/sdf.h"

#include <math.h>
#include <string.h>

#include "autograd/random.h"
#include "datasets/sdf_winding.h"
#include "datasets/surface.h"

struct lf_sdf {
    lf_sdf_options options;
    lf_sdf_report report;
    int inside_below;       /* escapes that still count as inside, exclusive */
    int clear_from;         /* escapes from which a point is clearly outside */
    float (*packet)[3][8];  /* [directions / 8] */
    lf_surface *all;        /* every face: the sign's rays */
    lf_mesh *seen_mesh;     /* faces seen from outside ... */
    lf_surface *seen;       /* ... for the distance */
    lf_winding *winding;    /* NULL unless the sign uses it */
    double low[3], high[3]; /* box of the mesh */
};

lf_sdf_options lf_sdf_defaults(void)
{
    return (lf_sdf_options){.method = LF_SDF_COMBINED, .directions = 128, .thickness = 0};
}

/* ---- directions --------------------------------------------------------------------------- */

static int coprime_stride(int n)
{
    for (int s = (int)(0.618 * n); s > 1; s--) {
        int a = s, b = n;
        while (b) {
            const int r = a % b;
            a = b;
            b = r;
        }
        if (a == 1)
            return s;
    }
    return 1;
}

/* Fibonacci sphere; lane k of a packet lies in the k-th eighth of the sphere from pole to pole. */
static void make_packets(lf_sdf *s)
{
    const int n = s->options.directions, packets = n / 8, stride = coprime_stride(packets);
    const double golden = 3.14159265358979323846 * (3 - sqrt(5));
    for (int p = 0; p < packets; p++)
        for (int k = 0; k < 8; k++) {
            const int i = (int)((long)p * stride % packets) + packets * k;
            const double z = 1 - (2 * i + 1.0) / n, r = sqrt(1 - z * z);
            /* turned by a fixed odd angle: no direction lies in a plane of the axes */
            s->packet[p][0][k] = (float)(r * cos(golden * i + 0.377));
            s->packet[p][1][k] = (float)(r * sin(golden * i + 0.377));
            s->packet[p][2][k] = (float)z;
        }
}

/* How many directions leave the mesh from p, counted in packets until `enough` or `packets`. */
static int escapes(const lf_sdf *s, const double p[3], int packets, int enough)
{
    int out = 0;
    for (int k = 0; k < packets && out < enough; k++)
        out += 8 - __builtin_popcount(lf_surface_any_hit8(s->all, p, s->packet[k]));
    return out;
}

static bool outside_box(const lf_sdf *s, const double p[3])
{
    for (int i = 0; i < 3; i++)
        if (p[i] < s->low[i] || p[i] > s->high[i])
            return true;
    return false;
}

/* ---- visibility and orientation ----------------------------------------------------------- */

/* Point k of a face (0 the middle, 1..3 towards the corners), moved by `off` along its normal.
 * false if the face has no area. */
static bool probe(const lf_mesh *mesh, long face, int k, double off, double out[3])
{
    const double *c[3];
    double a[3], b[3], n[3];
    for (int j = 0; j < 3; j++)
        c[j] = mesh->vertex[mesh->face[face][j]];
    for (int i = 0; i < 3; i++) {
        a[i] = c[1][i] - c[0][i];
        b[i] = c[2][i] - c[0][i];
    }
    n[0] = a[1] * b[2] - a[2] * b[1];
    n[1] = a[2] * b[0] - a[0] * b[2];
    n[2] = a[0] * b[1] - a[1] * b[0];
    const double size = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    if (!(size > 0))
        return false;
    for (int i = 0; i < 3; i++) {
        out[i] = off * n[i] / size;
        for (int j = 0; j < 3; j++)
            out[i] += c[j][i] * (k == 0 ? 1.0 / 3 : (k == j + 1 ? 0.8 : 0.1));
    }
    return true;
}

static bool face_seen(const lf_sdf *s, const lf_mesh *mesh, long face)
{
    const double off = 1e-3 * lf_surface_diagonal(s->all);
    for (int k = 0; k < 8; k++) {
        double p[3];
        if (!probe(mesh, face, k / 2, k % 2 ? -off : off, p))
            return false;
        if (escapes(s, p, s->options.directions / 8, s->inside_below) >= s->inside_below)
            return true;
    }
    return false;
}

/* The faces with keep[face] != 0, vertices as they are. */
static lf_mesh *part_of(const lf_mesh *mesh, const uint8_t *keep, long kept)
{
    lf_mesh *part = lf_mesh_create(mesh->vertices, kept);
    memcpy(part->vertex, mesh->vertex, (size_t)mesh->vertices * sizeof *part->vertex);
    long n = 0;
    for (long f = 0; f < mesh->faces; f++)
        if (keep[f])
            memcpy(part->face[n++], mesh->face[f], sizeof *part->face);
    return part;
}

static lf_status find_seen(lf_sdf *s, const lf_mesh *mesh, lf_error *err)
{
    uint8_t *seen = malloc((size_t)mesh->faces);
    if (!seen)
        return lf_fail(err, LF_FAILED, "no memory for %ld faces", mesh->faces);
    long kept = 0;
#pragma omp parallel for schedule(dynamic, 64) reduction(+ : kept)
    for (long f = 0; f < mesh->faces; f++) {
        seen[f] = face_seen(s, mesh, f);
        kept += seen[f];
    }
    s->report.faces = mesh->faces;
    s->report.hidden = mesh->faces - kept;
    /* if nothing is seen, all faces lie within 0.001 of each other: take them all */
    s->seen_mesh = kept ? part_of(mesh, seen, kept) : lf_mesh_copy(mesh);
    free(seen);
    return lf_surface_open(s->seen_mesh, &s->seen, err);
}

/* front[f], back[f]: area x directions (of 32) that escape on either side of the turned face. */
static void look_both_ways(const lf_sdf *s, const lf_mesh *mesh, const signed char *turn,
                           double *front, double *back)
{
    const double off = 1e-3 * lf_surface_diagonal(s->all);
    const int packets = s->options.directions / 8 < 4 ? s->options.directions / 8 : 4;
#pragma omp parallel for schedule(dynamic, 64)
    for (long f = 0; f < mesh->faces; f++) {
        double p[3], q[3], n = 0;
        front[f] = back[f] = 0;
        if (!probe(mesh, f, 0, turn[f] * off, p) || !probe(mesh, f, 0, -turn[f] * off, q))
            continue;
        const double *a = mesh->vertex[mesh->face[f][0]], *b = mesh->vertex[mesh->face[f][1]];
        const double *c = mesh->vertex[mesh->face[f][2]];
        for (int i = 0; i < 3; i++) {
            const int j = (i + 1) % 3;
            const double x = (b[i] - a[i]) * (c[j] - a[j]) - (b[j] - a[j]) * (c[i] - a[i]);
            n += x * x;
        }
        front[f] = sqrt(n) * escapes(s, p, packets, 8 * packets);
        back[f] = sqrt(n) * escapes(s, q, packets, 8 * packets);
    }
}

static void orient(lf_sdf *s, const lf_mesh *mesh, lf_soup *soup)
{
    const size_t faces = (size_t)mesh->faces, parts = (size_t)soup->components;
    double *front = malloc(faces * sizeof *front), *back = malloc(faces * sizeof *back);
    double *sum = calloc(2 * parts, sizeof *sum);
    LF_REQUIRE(front && back && sum, "lf_sdf_open: no memory for %ld faces", mesh->faces);
    look_both_ways(s, mesh, soup->turn, front, back);
    for (size_t f = 0; f < faces; f++) {
        sum[2 * soup->component[f]] += front[f];
        sum[2 * soup->component[f] + 1] += back[f];
    }
    for (size_t f = 0; f < faces; f++) {
        const double *part = &sum[2 * soup->component[f]];
        const double gain = part[0] - part[1], clear = 0.1 * (part[0] + part[1]);
        if (!(fabs(gain) > clear))
            soup->turn[f] = 0;
        else if (gain < 0)
            soup->turn[f] = (signed char)-soup->turn[f];
    }
    s->winding = lf_winding_open(mesh, soup->turn);
    free(front);
    free(back);
    free(sum);
}

static void prepare_winding(lf_sdf *s, const lf_mesh *mesh)
{
    lf_soup soup = lf_soup_open(mesh);
    s->report.edges = soup.edges;
    s->report.open_edges = soup.open_edges;
    const bool holes = soup.open_edges > 0;
    if (s->options.method == LF_SDF_WINDING || (s->options.method == LF_SDF_COMBINED && holes))
        orient(s, mesh, &soup);
    s->report.uses_winding = s->winding != NULL;
    lf_soup_close(&soup);
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
    make_packets(s);
    LF_TRY(lf_surface_open(mesh, &s->all, err));
    lf_mesh_bounds(mesh, s->low, s->high);
    LF_TRY(find_seen(s, mesh, err));
    prepare_winding(s, mesh);
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

static bool winding_inside(const lf_sdf *s, const double p[3])
{
    const int half = s->options.directions / 2;
    if (lf_winding_at(s->winding, p) <= 0.5)
        return false;
    return s->options.method == LF_SDF_WINDING ||
           escapes(s, p, s->options.directions / 8, half) < half;
}

static bool is_inside(const lf_sdf *s, const double p[3], bool count, bool *doubtful)
{
    *doubtful = false;
    if (outside_box(s, p))
        return false;
    if (s->options.method == LF_SDF_WINDING && !count)
        return winding_inside(s, p);
    const int enough = count ? s->clear_from : s->inside_below;
    const int out = escapes(s, p, s->options.directions / 8, enough);
    *doubtful = out >= 1 && out < s->clear_from;
    if (s->options.method == LF_SDF_WINDING)
        return winding_inside(s, p);
    return out < s->inside_below || (s->winding && winding_inside(s, p));
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
