/* sdf_sight.c: what rays tell about a soup: which points are enclosed, which faces are seen from
 * outside, which side of a part is its front.                                  [sdf.c says the
 * rules]
 */
#include "datasets/sdf_internal.h"

#include <math.h>
#include <string.h>

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
void lf_sdf_make_packets(lf_sdf *s)
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
int lf_sdf_escapes(const lf_sdf *s, const double p[3], int packets, int enough)
{
    int out = 0;
    for (int k = 0; k < packets && out < enough; k++)
        out += 8 - __builtin_popcount(lf_surface_any_hit8(s->all, p, s->packet[k]));
    return out;
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
        if (lf_sdf_escapes(s, p, s->options.directions / 8, s->inside_below) >= s->inside_below)
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

lf_status lf_sdf_find_seen(lf_sdf *s, const lf_mesh *mesh, lf_error *err)
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
        front[f] = sqrt(n) * lf_sdf_escapes(s, p, packets, 8 * packets);
        back[f] = sqrt(n) * lf_sdf_escapes(s, q, packets, 8 * packets);
    }
}

/* Turns every part whose front does not see more than its back. */
static void turn_by_sight(const lf_sdf *s, const lf_mesh *mesh, lf_soup *soup)
{
    const size_t faces = (size_t)mesh->faces, parts = (size_t)soup->components;
    double *front = malloc(faces * sizeof *front), *back = malloc(faces * sizeof *back);
    double *sum = calloc(2 * parts, sizeof *sum);
    LF_REQUIRE(front && back && sum, "lf_sdf_open: no memory for %ld faces", mesh->faces);
    look_both_ways(s, mesh, soup->turn, front, back);
    for (size_t f = 0; f < faces; f++) {
        sum[2 * (size_t)soup->component[f]] += front[f];
        sum[2 * (size_t)soup->component[f] + 1] += back[f];
    }
    for (size_t f = 0; f < faces; f++) {
        const double *part = &sum[2 * (size_t)soup->component[f]];
        const double gain = part[0] - part[1], clear = (part[0] + part[1]) / 3;
        if (!(fabs(gain) > clear))
            soup->turn[f] = 0;
        else if (gain < 0)
            soup->turn[f] = (signed char)-soup->turn[f];
    }
    free(front);
    free(back);
    free(sum);
}

/* Turns every part of negative volume (six times: the sum of determinants from the box's centre).
 */
static void turn_by_volume(const lf_sdf *s, const lf_mesh *mesh, lf_soup *soup)
{
    double *volume = calloc((size_t)soup->components, sizeof *volume), c[3];
    LF_REQUIRE(volume, "lf_sdf_open: no memory for %ld parts", soup->components);
    lf_surface_centre(s->all, c);
    for (long f = 0; f < mesh->faces; f++) {
        double r[3][3];
        for (int k = 0; k < 9; k++)
            r[k / 3][k % 3] = mesh->vertex[mesh->face[f][k / 3]][k % 3] - c[k % 3];
        volume[soup->component[f]] +=
            soup->turn[f] * (r[0][0] * (r[1][1] * r[2][2] - r[1][2] * r[2][1]) +
                             r[0][1] * (r[1][2] * r[2][0] - r[1][0] * r[2][2]) +
                             r[0][2] * (r[1][0] * r[2][1] - r[1][1] * r[2][0]));
    }
    for (long f = 0; f < mesh->faces; f++)
        if (volume[soup->component[f]] < 0)
            soup->turn[f] = (signed char)-soup->turn[f];
    free(volume);
}

void lf_sdf_prepare_winding(lf_sdf *s, const lf_mesh *mesh)
{
    lf_soup soup = lf_soup_open(mesh);
    s->report.edges = soup.edges;
    s->report.open_edges = soup.open_edges;
    s->report.closed = soup.closed;
    if (s->options.method != LF_SDF_ESCAPE) {
        if (soup.closed)
            turn_by_volume(s, mesh, &soup);
        else
            turn_by_sight(s, mesh, &soup);
        s->winding = lf_winding_open(mesh, soup.turn);
    }
    lf_soup_close(&soup);
}
