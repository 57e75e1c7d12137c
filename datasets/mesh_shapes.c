/* mesh_shapes.c: sphere, box and torus, closed and counter-clockwise seen from outside. */
#include <math.h>

#include "datasets/mesh.h"

static void set3(int32_t face[3], int32_t a, int32_t b, int32_t c)
{
    face[0] = a;
    face[1] = b;
    face[2] = c;
}

static lf_mesh *icosahedron(void)
{
    static const int32_t faces[20][3] = {
        {0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
        {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
        {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
    const double g = (1 + sqrt(5)) / 2;
    const double corners[12][3] = {{-1, g, 0}, {1, g, 0}, {-1, -g, 0}, {1, -g, 0},
                                   {0, -1, g}, {0, 1, g}, {0, -1, -g}, {0, 1, -g},
                                   {g, 0, -1}, {g, 0, 1}, {-g, 0, -1}, {-g, 0, 1}};
    lf_mesh *mesh = lf_mesh_create(12, 20);
    memcpy(mesh->vertex, corners, sizeof corners);
    memcpy(mesh->face, faces, sizeof faces);
    return mesh;
}

/* Four faces for one; each face brings its own three midpoints, welding joins them: a midpoint is
 * computed from the same two ends in the same order, so that equal ones are exactly equal. */
static lf_mesh *subdivide(const lf_mesh *in)
{
    lf_mesh *out = lf_mesh_create(in->vertices + 3 * in->faces, 4 * in->faces);
    memcpy(out->vertex, in->vertex, (size_t)in->vertices * sizeof *in->vertex);
    for (long i = 0; i < in->faces; i++) {
        const int32_t *f = in->face[i];
        const int32_t m = (int32_t)(in->vertices + 3 * i); /* m+j: middle of corners j, j+1 */
        for (int j = 0; j < 3; j++) {
            const int32_t a = f[j] < f[(j + 1) % 3] ? f[j] : f[(j + 1) % 3];
            const int32_t b = f[j] + f[(j + 1) % 3] - a;
            for (int k = 0; k < 3; k++)
                out->vertex[m + j][k] = 0.5 * (in->vertex[a][k] + in->vertex[b][k]);
            set3(out->face[4 * i + j], f[j], m + j, m + (j + 2) % 3);
        }
        set3(out->face[4 * i + 3], m, m + 1, m + 2);
    }
    lf_mesh_weld(out);
    return out;
}

lf_mesh *lf_mesh_sphere(int subdivisions, double radius, const double centre[3])
{
    LF_REQUIRE(subdivisions >= 0 && subdivisions <= 7, "%d subdivisions, allowed 0 to 7",
               subdivisions);
    lf_mesh *mesh = icosahedron();
    for (int i = 0; i < subdivisions; i++) {
        lf_mesh *finer = subdivide(mesh);
        lf_mesh_free(mesh);
        mesh = finer;
    }
    for (long i = 0; i < mesh->vertices; i++) {
        double *p = mesh->vertex[i];
        const double length = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
        for (int j = 0; j < 3; j++)
            p[j] = centre[j] + radius * p[j] / length;
    }
    return mesh;
}

lf_mesh *lf_mesh_box(const double low[3], const double high[3])
{
    /* corner i: bit 0 = high x, bit 1 = high y, bit 2 = high z */
    static const int32_t faces[12][3] = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6},
                                         {0, 1, 5}, {0, 5, 4}, {2, 6, 7}, {2, 7, 3},
                                         {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
    lf_mesh *mesh = lf_mesh_create(8, 12);
    for (int i = 0; i < 8; i++)
        for (int j = 0; j < 3; j++)
            mesh->vertex[i][j] = i >> j & 1 ? high[j] : low[j];
    memcpy(mesh->face, faces, sizeof faces);
    return mesh;
}

lf_mesh *lf_mesh_torus(double ring, double tube, int around, int across)
{
    LF_REQUIRE(around >= 3 && across >= 3 && tube < ring, "torus %d x %d, radii %g %g", around,
               across, ring, tube);
    const double turn = 2 * 3.14159265358979323846;
    lf_mesh *mesh = lf_mesh_create((long)around * across, 2L * around * across);
    for (int i = 0; i < around; i++)
        for (int j = 0; j < across; j++) {
            const double u = turn * i / around, v = turn * j / across;
            const double r = ring + tube * cos(v);
            double *p = mesh->vertex[i * across + j];
            p[0] = r * cos(u);
            p[1] = tube * sin(v);
            p[2] = r * sin(u);
            const int32_t a = i * across + j, b = (i + 1) % around * across + j,
                          c = (i + 1) % around * across + (j + 1) % across,
                          d = i * across + (j + 1) % across;
            set3(mesh->face[2 * a], a, d, c);
            set3(mesh->face[2 * a + 1], a, c, b);
        }
    return mesh;
}
