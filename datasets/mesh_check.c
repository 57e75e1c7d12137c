/* mesh_check.c: is a soup closed, how many parts has it, is a point inside a part. */
#include <math.h>

#include "datasets/mesh_file.h"

typedef struct edge {
    int32_t low, high; /* vertices, low < high */
    int direction;     /* +1: the face runs from low to high */
} edge;

static int by_ends(const void *a, const void *b)
{
    const edge *p = a, *q = b;
    if (p->low != q->low)
        return p->low < q->low ? -1 : 1;
    if (p->high != q->high)
        return p->high < q->high ? -1 : 1;
    return p->direction - q->direction;
}

/* All edges of all faces, sorted; *count of them. Edges between equal corners are left out. */
static edge *sorted_edges(const lf_mesh *mesh, long *count)
{
    edge *edges = malloc((3 * (size_t)mesh->faces + 1) * sizeof *edges);
    LF_REQUIRE(edges, "no memory for the edges of %ld faces", mesh->faces);
    long n = 0;
    for (long i = 0; i < mesh->faces; i++)
        for (int j = 0; j < 3; j++) {
            const int32_t a = mesh->face[i][j], b = mesh->face[i][(j + 1) % 3];
            if (a != b)
                edges[n++] = a < b ? (edge){a, b, 1} : (edge){b, a, -1};
        }
    qsort(edges, (size_t)n, sizeof *edges, by_ends);
    *count = n;
    return edges;
}

static void count_edges(const lf_mesh *mesh, lf_mesh_report *r)
{
    long n;
    edge *e = sorted_edges(mesh, &n);
    for (long i = 0, next; i < n; i = next) {
        int sum = 0;
        for (next = i; next < n && e[next].low == e[i].low && e[next].high == e[i].high; next++)
            sum += e[next].direction;
        r->edges++;
        r->boundary += next - i == 1;
        r->non_manifold += next - i > 2;
        r->inconsistent += next - i == 2 && sum != 0;
    }
    free(e);
}

static int32_t find_root(int32_t *parent, int32_t i)
{
    while (parent[i] != i)
        i = parent[i] = parent[parent[i]];
    return i;
}

/* Components by union-find over vertices; also the number of used vertices. */
static long count_components(const lf_mesh *mesh, long *used)
{
    int32_t *parent = malloc(((size_t)mesh->vertices + 1) * sizeof *parent);
    LF_REQUIRE(parent, "no memory for %ld vertices", mesh->vertices);
    for (long i = 0; i < mesh->vertices; i++)
        parent[i] = -1;
    long components = 0;
    *used = 0;
    for (long i = 0; i < mesh->faces; i++)
        for (int j = 0; j < 3; j++)
            if (parent[mesh->face[i][j]] < 0) {
                parent[mesh->face[i][j]] = mesh->face[i][j];
                components++;
                ++*used;
            }
    for (long i = 0; i < mesh->faces; i++)
        for (int j = 1; j < 3; j++) {
            const int32_t a = find_root(parent, mesh->face[i][0]),
                          b = find_root(parent, mesh->face[i][j]);
            components -= a != b;
            parent[a < b ? b : a] = a < b ? a : b;
        }
    free(parent);
    return components;
}

void lf_mesh_closed_check(const lf_mesh *mesh, lf_mesh_report *report)
{
    lf_mesh_report *r = report;
    long used;
    r->edges = r->boundary = r->non_manifold = r->inconsistent = 0;
    count_edges(mesh, r);
    r->components = count_components(mesh, &used);
    r->euler = used - r->edges + mesh->faces;
    r->manifold = lf_openmesh_manifold(mesh);
    r->closed = mesh->faces > 0 && !r->boundary && !r->non_manifold && !r->inconsistent;
}

/* Signed solid angle of a triangle seen from p, van Oosterom and Strackee 1983, eq. 8. */
static double solid_angle(const double *a, const double *b, const double *c, const double p[3])
{
    double u[3], v[3], w[3], uu = 0, vv = 0, ww = 0, uv = 0, vw = 0, wu = 0;
    for (int j = 0; j < 3; j++) {
        u[j] = a[j] - p[j];
        v[j] = b[j] - p[j];
        w[j] = c[j] - p[j];
        uu += u[j] * u[j];
        vv += v[j] * v[j];
        ww += w[j] * w[j];
        uv += u[j] * v[j];
        vw += v[j] * w[j];
        wu += w[j] * u[j];
    }
    const double lu = sqrt(uu), lv = sqrt(vv), lw = sqrt(ww);
    const double triple = u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) +
                          u[2] * (v[0] * w[1] - v[1] * w[0]);
    return 2 * atan2(triple, lu * lv * lw + uv * lw + vw * lu + wu * lv);
}

double lf_mesh_winding(const lf_mesh *mesh, long first, long count, const double p[3])
{
    LF_REQUIRE(first >= 0 && count >= 0 && first + count <= mesh->faces, "faces %ld + %ld of %ld",
               first, count, mesh->faces);
    double sum = 0;
    for (long i = first; i < first + count; i++) {
        const int32_t *f = mesh->face[i];
        sum += solid_angle(mesh->vertex[f[0]], mesh->vertex[f[1]], mesh->vertex[f[2]], p);
    }
    return sum / (4 * 3.14159265358979323846);
}

typedef struct placed {
    double at[3];
    int32_t vertex;
} placed;

static int by_place(const void *a, const void *b)
{
    const placed *p = a, *q = b;
    for (int j = 0; j < 3; j++)
        if (p->at[j] != q->at[j])
            return p->at[j] < q->at[j] ? -1 : 1;
    return p->vertex < q->vertex ? -1 : p->vertex > q->vertex;
}

/* target[i] = first vertex at the place of vertex i. */
static void first_at_place(const lf_mesh *mesh, int32_t *target)
{
    placed *all = malloc(((size_t)mesh->vertices + 1) * sizeof *all);
    LF_REQUIRE(all, "no memory for %ld vertices", mesh->vertices);
    for (long i = 0; i < mesh->vertices; i++) {
        memcpy(all[i].at, mesh->vertex[i], sizeof all[i].at);
        all[i].vertex = (int32_t)i;
    }
    qsort(all, (size_t)mesh->vertices, sizeof *all, by_place);
    for (long i = 0, first = 0; i < mesh->vertices; i++) {
        for (int j = 0; j < 3; j++)
            if (all[i].at[j] != all[first].at[j])
                first = i;
        target[all[i].vertex] = all[first].vertex;
    }
    free(all);
}

void lf_mesh_weld(lf_mesh *mesh)
{
    int32_t *target = malloc(((size_t)mesh->vertices + 1) * sizeof *target);
    int32_t *number = malloc(((size_t)mesh->vertices + 1) * sizeof *number);
    LF_REQUIRE(target && number, "no memory for %ld vertices", mesh->vertices);
    first_at_place(mesh, target);
    for (long i = 0; i < mesh->vertices; i++)
        number[i] = -1;
    for (long i = 0; i < 3 * mesh->faces; i++)
        number[target[mesh->face[i / 3][i % 3]]] = 0;
    long kept = 0;
    for (long i = 0; i < mesh->vertices; i++)
        if (number[i] == 0) {
            memmove(mesh->vertex[kept], mesh->vertex[i], sizeof *mesh->vertex);
            number[i] = (int32_t)kept++;
        }
    for (long i = 0; i < 3 * mesh->faces; i++)
        mesh->face[i / 3][i % 3] = number[target[mesh->face[i / 3][i % 3]]];
    mesh->vertices = kept;
    free(target);
    free(number);
}
