/* sdf_soup.c: which faces of a soup hang together, and how to orient each part one way.
 *
 * Vertices at equal positions count as one. Edges are sorted by their two vertices; an edge of
 * exactly two faces joins them, an edge of one or of three and more does not. Two joined faces are
 * oriented alike if they run along their edge in opposite directions.
 */
#include "datasets/sdf_winding.h"

#include <stdlib.h>
#include <string.h>

struct corner {
    double at[3];
    int32_t vertex;
};

static int by_position(const void *a, const void *b)
{
    const struct corner *x = a, *y = b;
    for (int i = 0; i < 3; i++)
        if (x->at[i] != y->at[i])
            return x->at[i] < y->at[i] ? -1 : 1;
    return (x->vertex > y->vertex) - (x->vertex < y->vertex);
}

static bool same_position(const struct corner *a, const struct corner *b)
{
    return a->at[0] == b->at[0] && a->at[1] == b->at[1] && a->at[2] == b->at[2];
}

/* joined[vertex] = the least vertex at the same position. */
static int32_t *join_vertices(const lf_mesh *mesh)
{
    const size_t n = (size_t)mesh->vertices;
    struct corner *c = malloc(n * sizeof *c);
    int32_t *joined = malloc(n * sizeof *joined);
    LF_REQUIRE(c && joined, "lf_soup_open: no memory for %ld vertices", mesh->vertices);
    for (size_t v = 0; v < n; v++) {
        for (int i = 0; i < 3; i++)
            c[v].at[i] = mesh->vertex[v][i];
        c[v].vertex = (int32_t)v;
    }
    qsort(c, n, sizeof *c, by_position);
    for (size_t v = 0; v < n; v++) {
        const bool same = v > 0 && same_position(&c[v], &c[v - 1]);
        joined[c[v].vertex] = same ? joined[c[v - 1].vertex] : c[v].vertex;
    }
    free(c);
    return joined;
}

struct edge {
    int32_t low, high, face;
    signed char along; /* +1 if the face runs from low to high */
};

static int by_vertices(const void *a, const void *b)
{
    const struct edge *x = a, *y = b;
    if (x->low != y->low)
        return x->low < y->low ? -1 : 1;
    if (x->high != y->high)
        return x->high < y->high ? -1 : 1;
    return (x->face > y->face) - (x->face < y->face);
}

static long collect_edges(const lf_mesh *mesh, const int32_t *joined, struct edge *edge)
{
    long n = 0;
    for (long f = 0; f < mesh->faces; f++) {
        int32_t v[3];
        for (int k = 0; k < 3; k++)
            v[k] = joined[mesh->face[f][k]];
        if (v[0] == v[1] || v[1] == v[2] || v[2] == v[0])
            continue;
        for (int k = 0; k < 3; k++) {
            const int32_t a = v[k], b = v[(k + 1) % 3];
            edge[n++] = (struct edge){a < b ? a : b, a < b ? b : a, (int32_t)f, a < b ? 1 : -1};
        }
    }
    qsort(edge, (size_t)n, sizeof *edge, by_vertices);
    return n;
}

/* neighbour[3 face + slot] = 2 x other face + (1 if it must be turned against this one), -1 none.
 */
static void link_faces(lf_soup *soup, const struct edge *edge, long edges, int64_t *neighbour)
{
    for (long i = 0, next; i < edges; i = next) {
        for (next = i + 1;
             next < edges && edge[next].low == edge[i].low && edge[next].high == edge[i].high;)
            next++;
        soup->edges++;
        soup->open_edges += (next - i) % 2;
        if (next - i != 2 || edge[i].face == edge[i + 1].face)
            continue;
        const int64_t against = edge[i].along == edge[i + 1].along;
        for (int side = 0; side < 2; side++) {
            int64_t *slot = neighbour + 3 * (long)edge[i + side].face;
            while (*slot >= 0)
                slot++;
            *slot = 2 * (int64_t)edge[i + 1 - side].face + against;
        }
    }
}

/* Breadth-first from every face that no component holds yet. */
static void spread(lf_soup *soup, long faces, const int64_t *neighbour)
{
    int32_t *queue = malloc((size_t)faces * sizeof *queue);
    LF_REQUIRE(queue, "lf_soup_open: no memory for %ld faces", faces);
    for (long seed = 0; seed < faces; seed++) {
        if (soup->component[seed] >= 0)
            continue;
        long head = 0, tail = 0;
        queue[tail++] = (int32_t)seed;
        soup->component[seed] = (int32_t)soup->components;
        soup->turn[seed] = 1;
        while (head < tail) {
            const int32_t f = queue[head++];
            for (int k = 0; k < 3; k++) {
                const int64_t link = neighbour[3 * (long)f + k];
                if (link < 0 || soup->component[link / 2] >= 0)
                    continue;
                soup->component[link / 2] = (int32_t)soup->components;
                soup->turn[link / 2] = (signed char)(link % 2 ? -soup->turn[f] : soup->turn[f]);
                queue[tail++] = (int32_t)(link / 2);
            }
        }
        soup->components++;
    }
    free(queue);
}

/* Whether the turned faces run along every edge as often one way as the other. */
static bool is_closed(const lf_soup *soup, const struct edge *edge, long edges)
{
    for (long i = 0, next; i < edges; i = next) {
        int sum = 0;
        for (next = i;
             next < edges && edge[next].low == edge[i].low && edge[next].high == edge[i].high;
             next++)
            sum += edge[next].along * soup->turn[edge[next].face];
        if (sum)
            return false;
    }
    return edges > 0;
}

lf_soup lf_soup_open(const lf_mesh *mesh)
{
    const size_t faces = (size_t)mesh->faces;
    lf_soup soup = {.component = malloc(faces * sizeof *soup.component),
                    .turn = malloc(faces * sizeof *soup.turn)};
    struct edge *edge = malloc(3 * faces * sizeof *edge);
    int64_t *neighbour = malloc(3 * faces * sizeof *neighbour);
    LF_REQUIRE(soup.component && soup.turn && edge && neighbour,
               "lf_soup_open: no memory for %ld faces", mesh->faces);
    memset(soup.component, -1, faces * sizeof *soup.component);
    memset(neighbour, -1, 3 * faces * sizeof *neighbour);
    int32_t *joined = join_vertices(mesh);
    const long edges = collect_edges(mesh, joined, edge);
    link_faces(&soup, edge, edges, neighbour);
    spread(&soup, mesh->faces, neighbour);
    soup.closed = is_closed(&soup, edge, edges);
    free(joined);
    free(edge);
    free(neighbour);
    return soup;
}

void lf_soup_close(lf_soup *soup)
{
    free(soup->component);
    free(soup->turn);
    soup->component = NULL;
    soup->turn = NULL;
}
