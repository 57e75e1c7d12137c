/* iso_mesh.c: marching cubes over the active cells of a grid.
 *
 * Cells are visited slab by slab along z. A vertex belongs to a grid edge; the vertices of the
 * two planes of a slab and of the edges between them are remembered by number, so that neighbours
 * share them. Memory: 5 numbers a point of one plane, beside the mesh.
 */
#include <math.h>

#include "eval/iso_grid.h"
#include "eval/mc_table.h"

#define EDGE_MARGIN 1e-4 /* of the edge parameter [method.md 4.8] */

typedef struct builder {
    const lf_iso_grid *grid;
    lf_mc_table table;
    int32_t *plane[2]; /* [2 axes][points a plane]: vertex on the x or y edge from a point, or -1 */
    int32_t *upright;  /* [points a plane]: vertex on the z edge from a point of the lower plane */
    double (*vertex)[3];
    int32_t (*face)[3];
    long vertices, faces, vertex_room, face_room;
} builder;

/* Make room for `needed` rows of `row` bytes in *array; 0 if there is no memory. */
static int reserve(void **array, long *room, long needed, size_t row)
{
    if (needed <= *room)
        return 1;
    const long grown = *room ? 2 * *room : 4096;
    void *moved = grown < INT32_MAX ? realloc(*array, (size_t)grown * row) : NULL;
    if (!moved)
        return 0;
    *array = moved;
    *room = grown;
    return 1;
}

/* Where between two neighbouring grid points the field is zero: 0 at a, 1 at b. One of them may be
 * infinitely far outside; then the surface closes at the other. */
static double edge_parameter(float a, float b)
{
    double t = (double)a / ((double)a - (double)b);
    if (isinf(a))
        t = 1;
    else if (isinf(b))
        t = 0;
    return fmin(fmax(t, EDGE_MARGIN), 1 - EDGE_MARGIN);
}

/* The vertex on the edge along `axis` from grid point p, made if it is new; -1 without memory. */
static int32_t edge_vertex(builder *b, int32_t *slot, const long p[3], int axis)
{
    const lf_iso_grid *g = b->grid;
    if (*slot >= 0)
        return *slot;
    if (!reserve((void **)&b->vertex, &b->vertex_room, b->vertices + 1, sizeof *b->vertex))
        return -1;
    long q[3] = {p[0], p[1], p[2]};
    q[axis]++;
    const double t = edge_parameter(g->value[lf_iso_point(g, p[0], p[1], p[2])],
                                    g->value[lf_iso_point(g, q[0], q[1], q[2])]);
    double *v = b->vertex[b->vertices];
    for (int i = 0; i < 3; i++)
        v[i] = lf_iso_position(g, p[i]);
    v[axis] += t * (lf_iso_position(g, q[axis]) - v[axis]);
    return *slot = (int32_t)b->vertices++;
}

/* The vertex on edge `edge` of cell (x, y, z). */
static int32_t cell_vertex(builder *b, const long cell[3], int edge)
{
    const long n = lf_iso_side(b->grid) + 1;
    const int corner = b->table.corner[edge][0], axis = edge / 4;
    const long p[3] = {cell[0] + (corner & 1), cell[1] + (corner >> 1 & 1),
                       cell[2] + (corner >> 2)};
    const long at = (p[1] + 1) * n + p[0] + 1;
    int32_t *slot = axis == 2 ? b->upright + at : b->plane[corner >> 2] + axis * n * n + at;
    return edge_vertex(b, slot, p, axis);
}

static int cell_case(const lf_iso_grid *g, const long cell[3])
{
    int inside = 0;
    for (int c = 0; c < 8; c++) {
        const long p =
            lf_iso_point(g, cell[0] + (c & 1), cell[1] + (c >> 1 & 1), cell[2] + (c >> 2));
        inside |= (g->value[p] < 0) << c;
    }
    return inside;
}

/* Append the triangles of one cell; 0 without memory. */
static int march_cell(builder *b, const long cell[3])
{
    const int inside = cell_case(b->grid, cell), count = b->table.triangles[inside];
    if (count &&
        !reserve((void **)&b->face, &b->face_room, b->faces + LF_MC_TRIANGLES, sizeof *b->face))
        return 0;
    for (int t = 0; t < count; t++) {
        for (int i = 0; i < 3; i++) {
            const int32_t v = cell_vertex(b, cell, b->table.edge[inside][3 * t + i]);
            if (v < 0)
                return 0;
            b->face[b->faces][i] = v;
        }
        b->faces++;
    }
    return 1;
}

static int march_slab(builder *b, long z)
{
    const lf_iso_grid *g = b->grid;
    const long n = lf_iso_side(g) + 1;
    int32_t *swap = b->plane[0];
    b->plane[0] = b->plane[1];
    b->plane[1] = swap;
    memset(b->plane[1], 0xff, (size_t)(2 * n * n) * sizeof(int32_t));
    memset(b->upright, 0xff, (size_t)(n * n) * sizeof(int32_t));
    for (long y = -1; y <= g->resolution; y++)
        for (long x = -1; x <= g->resolution; x++)
            if (g->active[lf_iso_cell(g, x, y, z)] && !march_cell(b, (const long[3]){x, y, z}))
                return 0;
    return 1;
}

static int march(builder *b)
{
    const lf_iso_grid *g = b->grid;
    const size_t n = (size_t)lf_iso_side(g) + 1;
    for (int i = 0; i < 2; i++) {
        b->plane[i] = malloc(2 * n * n * sizeof(int32_t));
        if (!b->plane[i])
            return 0;
        memset(b->plane[i], 0xff, 2 * n * n * sizeof(int32_t));
    }
    b->upright = malloc(n * n * sizeof(int32_t));
    if (!b->upright)
        return 0;
    for (long z = -1; z <= g->resolution; z++)
        if (!march_slab(b, z))
            return 0;
    return 1;
}

lf_status lf_iso_mesh(const lf_iso_grid *grid, lf_mesh **out, lf_error *err)
{
    builder b = {.grid = grid};
    lf_mc_table_build(&b.table);
    const int done = march(&b);
    if (done) {
        lf_mesh *mesh = lf_mesh_create(b.vertices, b.faces);
        if (b.vertices)
            memcpy(mesh->vertex, b.vertex, (size_t)b.vertices * sizeof *b.vertex);
        if (b.faces)
            memcpy(mesh->face, b.face, (size_t)b.faces * sizeof *b.face);
        *out = mesh;
    }
    for (int i = 0; i < 2; i++)
        free(b.plane[i]);
    free(b.upright);
    free(b.vertex);
    free(b.face);
    return done ? LF_OK
                : lf_fail(err, LF_FAILED,
                          "marching cubes at resolution %d: not enough memory after %ld faces; "
                          "choose a smaller resolution",
                          grid->resolution, b.faces);
}
