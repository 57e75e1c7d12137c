/* mesh.c: making, copying, moving and measuring meshes. */
#include "datasets/mesh.h"

#include <math.h>

#include "autograd/random.h"

static void *array(long count, size_t size)
{
    LF_REQUIRE(count >= 0 && count <= INT32_MAX, "a mesh array of %ld elements", count);
    void *made = calloc((size_t)count + 1, size); /* never NULL, even when empty */
    LF_REQUIRE(made, "no memory for %ld elements of a mesh", count);
    return made;
}

lf_mesh *lf_mesh_create(long vertices, long faces)
{
    lf_mesh *mesh = array(1, sizeof *mesh);
    mesh->vertices = vertices;
    mesh->faces = faces;
    mesh->vertex = array(vertices, sizeof *mesh->vertex);
    mesh->face = array(faces, sizeof *mesh->face);
    mesh->colour = array(faces, sizeof *mesh->colour);
    lf_mesh_paint(mesh, LF_MESH_GREY, LF_MESH_GREY, LF_MESH_GREY);
    return mesh;
}

lf_mesh *lf_mesh_copy(const lf_mesh *mesh)
{
    lf_mesh *copy = lf_mesh_create(0, 0);
    lf_mesh_append(copy, mesh);
    return copy;
}

void lf_mesh_free(lf_mesh *mesh)
{
    if (!mesh)
        return;
    free(mesh->vertex);
    free(mesh->face);
    free(mesh->colour);
    free(mesh);
}

void lf_mesh_append(lf_mesh *mesh, const lf_mesh *more)
{
    const long v = mesh->vertices + more->vertices, f = mesh->faces + more->faces;
    double(*vertex)[3] = array(v, sizeof *vertex);
    int32_t(*face)[3] = array(f, sizeof *face);
    float(*colour)[3] = array(f, sizeof *colour);
    memcpy(vertex, mesh->vertex, (size_t)mesh->vertices * sizeof *vertex);
    memcpy(vertex + mesh->vertices, more->vertex, (size_t)more->vertices * sizeof *vertex);
    memcpy(face, mesh->face, (size_t)mesh->faces * sizeof *face);
    for (long i = 0; i < more->faces; i++)
        for (int j = 0; j < 3; j++)
            face[mesh->faces + i][j] = more->face[i][j] + (int32_t)mesh->vertices;
    memcpy(colour, mesh->colour, (size_t)mesh->faces * sizeof *colour);
    memcpy(colour + mesh->faces, more->colour, (size_t)more->faces * sizeof *colour);
    free(mesh->vertex);
    free(mesh->face);
    free(mesh->colour);
    *mesh = (lf_mesh){v, f, vertex, face, colour};
}

void lf_mesh_paint(lf_mesh *mesh, float red, float green, float blue)
{
    for (long i = 0; i < mesh->faces; i++) {
        mesh->colour[i][0] = red;
        mesh->colour[i][1] = green;
        mesh->colour[i][2] = blue;
    }
}

static double determinant(const double m[9])
{
    return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
           m[2] * (m[3] * m[7] - m[4] * m[6]);
}

void lf_mesh_transform(lf_mesh *mesh, const double matrix[9], const double shift[3])
{
    static const double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    const double *m = matrix ? matrix : identity;
    for (long i = 0; i < mesh->vertices; i++) {
        const double x = mesh->vertex[i][0], y = mesh->vertex[i][1], z = mesh->vertex[i][2];
        for (int j = 0; j < 3; j++)
            mesh->vertex[i][j] = m[3 * j] * x + m[3 * j + 1] * y + m[3 * j + 2] * z + shift[j];
    }
    if (determinant(m) >= 0)
        return;
    for (long i = 0; i < mesh->faces; i++) {
        const int32_t second = mesh->face[i][1];
        mesh->face[i][1] = mesh->face[i][2];
        mesh->face[i][2] = second;
    }
}

void lf_mesh_bounds(const lf_mesh *mesh, double low[3], double high[3])
{
    for (int j = 0; j < 3; j++) {
        low[j] = mesh->faces ? INFINITY : 0;
        high[j] = mesh->faces ? -INFINITY : 0;
    }
    for (long i = 0; i < 3 * mesh->faces; i++) {
        const double *p = mesh->vertex[mesh->face[i / 3][i % 3]];
        for (int j = 0; j < 3; j++) {
            low[j] = fmin(low[j], p[j]);
            high[j] = fmax(high[j], p[j]);
        }
    }
}

/* Covariance of the corners about their mean, scaled by 1 / diagonal^2 against overflow. */
static void covariance(const lf_mesh *mesh, double diagonal, double c[3][3])
{
    double mean[3] = {0};
    const double n = 3 * (double)mesh->faces;
    for (long i = 0; i < 3 * mesh->faces; i++)
        for (int j = 0; j < 3; j++)
            mean[j] += mesh->vertex[mesh->face[i / 3][i % 3]][j] / diagonal / n;
    memset(c, 0, 9 * sizeof(double));
    for (long i = 0; i < 3 * mesh->faces; i++)
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++) {
                const double *p = mesh->vertex[mesh->face[i / 3][i % 3]];
                c[j][k] += (p[j] / diagonal - mean[j]) * (p[k] / diagonal - mean[k]) / n;
            }
}

/* One Jacobi rotation of the symmetric c and the columns of v that makes c[p][q] zero. */
static void jacobi_rotate(double c[3][3], double v[3][3], int p, int q)
{
    if (c[p][q] == 0)
        return;
    const double theta = (c[q][q] - c[p][p]) / (2 * c[p][q]);
    const double t = copysign(1, theta) / (fabs(theta) + hypot(theta, 1));
    const double cosine = 1 / hypot(t, 1), sine = t * cosine;
    for (int k = 0; k < 3; k++) {
        const double a = c[k][p], b = c[k][q];
        c[k][p] = cosine * a - sine * b;
        c[k][q] = sine * a + cosine * b;
    }
    for (int k = 0; k < 3; k++) {
        const double a = c[p][k], b = c[q][k], x = v[k][p], y = v[k][q];
        c[p][k] = cosine * a - sine * b;
        c[q][k] = sine * a + cosine * b;
        v[k][p] = cosine * x - sine * y;
        v[k][q] = sine * x + cosine * y;
    }
}

/* Smallest extent over the principal directions, as a share of the diagonal. */
static double thickness(const lf_mesh *mesh, double diagonal)
{
    double c[3][3], v[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, least = INFINITY;
    covariance(mesh, diagonal, c);
    for (int sweep = 0; sweep < 12; sweep++)
        for (int p = 0; p < 3; p++)
            jacobi_rotate(c, v, p, (p + 1) % 3);
    for (int axis = 0; axis < 3; axis++) {
        double low = INFINITY, high = -INFINITY;
        for (long i = 0; i < 3 * mesh->faces; i++) {
            const double *p = mesh->vertex[mesh->face[i / 3][i % 3]];
            const double along = (p[0] * v[0][axis] + p[1] * v[1][axis] + p[2] * v[2][axis]);
            low = fmin(low, along / diagonal);
            high = fmax(high, along / diagonal);
        }
        least = fmin(least, high - low);
    }
    return least;
}

lf_status lf_mesh_normalise(lf_mesh *mesh, lf_error *err)
{
    double low[3], high[3];
    lf_mesh_bounds(mesh, low, high);
    if (mesh->faces == 0)
        return lf_fail(err, LF_BAD_INPUT, "the mesh has no face");
    const double diagonal = hypot(hypot(high[0] - low[0], high[1] - low[1]), high[2] - low[2]);
    if (!(diagonal > 0))
        return lf_fail(err, LF_BAD_INPUT, "all vertices of the mesh are one point");
    const double thick = thickness(mesh, diagonal);
    if (thick < 1e-6)
        return lf_fail(err, LF_BAD_INPUT,
                       "the mesh is a flat sheet: its thickness is %.1e of its diagonal, needs "
                       "1e-6 or more; a sheet has no inside to learn",
                       thick);
    for (long i = 0; i < mesh->vertices; i++)
        for (int j = 0; j < 3; j++)
            mesh->vertex[i][j] =
                ((mesh->vertex[i][j] - low[j]) - 0.5 * (high[j] - low[j])) / diagonal;
    return LF_OK;
}

static double face_area(const lf_mesh *mesh, long i)
{
    const double *a = mesh->vertex[mesh->face[i][0]], *b = mesh->vertex[mesh->face[i][1]],
                 *c = mesh->vertex[mesh->face[i][2]];
    double u[3], v[3];
    for (int j = 0; j < 3; j++) {
        u[j] = b[j] - a[j];
        v[j] = c[j] - a[j];
    }
    return 0.5 * hypot(hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2]),
                       u[0] * v[1] - u[1] * v[0]);
}

double lf_mesh_area(const lf_mesh *mesh)
{
    double sum = 0;
    for (long i = 0; i < mesh->faces; i++)
        sum += face_area(mesh, i);
    return sum;
}

double lf_mesh_volume(const lf_mesh *mesh)
{
    double sum = 0;
    for (long i = 0; i < mesh->faces; i++) {
        double m[9];
        for (int j = 0; j < 9; j++)
            m[j] = mesh->vertex[mesh->face[i][j / 3]][j % 3];
        sum += determinant(m) / 6;
    }
    return sum;
}

/* First face whose running area exceeds `target`. */
static long find_face(const double *running, long faces, double target)
{
    long low = 0, high = faces - 1;
    while (low < high) {
        const long middle = low + (high - low) / 2;
        if (running[middle] > target)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

static void sample_face(const lf_mesh *mesh, long face, double s, double t, double point[3])
{
    const double r = sqrt(s), u = 1 - r, v = r * (1 - t), w = r * t;
    const int32_t *f = mesh->face[face];
    for (int j = 0; j < 3; j++)
        point[j] =
            u * mesh->vertex[f[0]][j] + v * mesh->vertex[f[1]][j] + w * mesh->vertex[f[2]][j];
}

lf_status lf_mesh_sample_surface(const lf_mesh *mesh, long n, uint64_t seed, uint64_t item,
                                 double (*point)[3], int32_t *face, lf_error *err)
{
    double *running = array(mesh->faces, sizeof *running), total = 0;
    for (long i = 0; i < mesh->faces; i++)
        running[i] = total += face_area(mesh, i);
    if (!(total > 0) || !isfinite(total)) {
        free(running);
        return lf_fail(err, LF_BAD_INPUT, "the mesh has the area %g; nothing to sample", total);
    }
#pragma omp parallel for schedule(static)
    for (long i = 0; i < n; i++) {
        lf_stream s = lf_stream_at(seed, LF_RANDOM_SURFACE, (uint64_t)i, item);
        const long f = find_face(running, mesh->faces, total * lf_uniform(&s));
        const double a = lf_uniform(&s), b = lf_uniform(&s);
        sample_face(mesh, f, a, b, point[i]);
        if (face)
            face[i] = (int32_t)f;
    }
    free(running);
    return LF_OK;
}
