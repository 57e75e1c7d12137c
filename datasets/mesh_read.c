/* mesh_read.c: a mesh from a file: scan, OpenMesh, comparison of the two, report. */
#include "datasets/mesh_file.h"

#include <math.h>
#include <strings.h>

typedef lf_status (*scanner)(const char *path, lf_bytes file, lf_scan *out, lf_error *err);

static const struct {
    const char *ending;
    scanner scan;
} formats[] = {
    {"obj", lf_scan_obj}, {"ply", lf_scan_ply}, {"off", lf_scan_off}, {"stl", lf_scan_stl}};

static int find_format(const char *path)
{
    const char *dot = strrchr(path, '.');
    for (int i = 0; dot && i < (int)(sizeof formats / sizeof *formats); i++)
        if (!strcasecmp(dot + 1, formats[i].ending))
            return i;
    return -1;
}

/* OpenMesh must have delivered what the scan saw, with usable numbers. */
static lf_status compare(const char *path, const lf_scan *scan, const lf_soup *soup, lf_error *err)
{
    if ((scan->vertices >= 0 && soup->vertices != scan->vertices) || soup->faces != scan->faces)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: OpenMesh's reader delivers %ld vertices and %ld faces, the file holds "
                       "%ld and %ld: the file is malformed in a way that the check does not name",
                       path, soup->vertices, soup->faces, scan->vertices, scan->faces);
    for (long i = 0; i < 3 * soup->vertices; i++)
        LF_TRY(lf_coordinate_check(soup->vertex[i / 3][i % 3], path, "vertex", i / 3, err));
    for (long i = 0; i < 3 * soup->triangles; i++)
        if (soup->face[i / 3][i % 3] < 0 || soup->face[i / 3][i % 3] >= soup->vertices)
            return lf_fail(err, LF_BAD_INPUT, "%s: face %ld has the index %d of %ld vertices", path,
                           soup->source[i / 3], soup->face[i / 3][i % 3], soup->vertices);
    return LF_OK;
}

static lf_mesh *assemble(const lf_scan *scan, const lf_soup *soup)
{
    lf_mesh *mesh = lf_mesh_create(soup->vertices, soup->triangles);
    memcpy(mesh->vertex, soup->vertex, (size_t)soup->vertices * sizeof *mesh->vertex);
    memcpy(mesh->face, soup->face, (size_t)soup->triangles * sizeof *mesh->face);
    for (long i = 0; scan->colour && i < soup->triangles; i++)
        memcpy(mesh->colour[i], scan->colour[soup->source[i]], sizeof *mesh->colour);
    return mesh;
}

static bool without_area(const lf_mesh *mesh, const int32_t f[3])
{
    double u[3], v[3], uu = 0, vv = 0, ww = 0;
    for (int j = 0; j < 3; j++) {
        u[j] = mesh->vertex[f[1]][j] - mesh->vertex[f[0]][j];
        v[j] = mesh->vertex[f[2]][j] - mesh->vertex[f[0]][j];
        uu += u[j] * u[j];
        vv += v[j] * v[j];
        ww += (u[j] - v[j]) * (u[j] - v[j]);
    }
    const double longest = fmax(uu, fmax(vv, ww)); /* squared */
    const double cross = hypot(hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2]),
                               u[0] * v[1] - u[1] * v[0]);
    return cross <= 1e-9 * longest;
}

static int by_corners(const void *a, const void *b)
{
    return memcmp(a, b, sizeof(int32_t[3])); /* any total order will do */
}

static void sort3(int32_t f[3])
{
    for (int i = 0; i < 3; i++) /* bubble: (0,1) (1,2) (0,1) */
        if (f[i % 2] > f[i % 2 + 1]) {
            const int32_t t = f[i % 2];
            f[i % 2] = f[i % 2 + 1];
            f[i % 2 + 1] = t;
        }
}

static long count_duplicates(const lf_mesh *mesh)
{
    int32_t(*sorted)[3] = malloc(((size_t)mesh->faces + 1) * sizeof *sorted);
    LF_REQUIRE(sorted, "no memory for %ld faces", mesh->faces);
    memcpy(sorted, mesh->face, (size_t)mesh->faces * sizeof *sorted);
    for (long i = 0; i < mesh->faces; i++)
        sort3(sorted[i]);
    qsort(sorted, (size_t)mesh->faces, sizeof *sorted, by_corners);
    long count = 0;
    for (long i = 1; i < mesh->faces; i++)
        count += by_corners(sorted[i - 1], sorted[i]) == 0;
    free(sorted);
    return count;
}

static long count_unused(const lf_mesh *mesh)
{
    bool *used = calloc((size_t)mesh->vertices + 1, sizeof *used);
    LF_REQUIRE(used, "no memory for %ld vertices", mesh->vertices);
    for (long i = 0; i < 3 * mesh->faces; i++)
        used[mesh->face[i / 3][i % 3]] = true;
    long count = 0;
    for (long i = 0; i < mesh->vertices; i++)
        count += !used[i];
    free(used);
    return count;
}

static void fill_report(const lf_scan *scan, const lf_soup *soup, const lf_mesh *mesh,
                        lf_mesh_report *report)
{
    report->polygons = soup->polygons;
    report->zero_area = scan->degenerate;
    for (long i = 0; i < mesh->faces; i++)
        report->zero_area += without_area(mesh, mesh->face[i]);
    report->duplicates = count_duplicates(mesh);
    report->unused_vertices = count_unused(mesh);
    report->missing_colours = scan->missing_colours;
}

static lf_status read_bytes(const char *path, int format, lf_bytes file, lf_mesh **out,
                            lf_mesh_report *report, lf_error *err)
{
    lf_scan scan = {0};
    lf_soup soup = {0};
    lf_status status = formats[format].scan(path, file, &scan, err);
    if (status == LF_OK && (scan.vertices == 0 || scan.faces == 0))
        status = lf_fail(err, LF_BAD_INPUT, "%s: the mesh has %ld vertices and %ld usable faces",
                         path, scan.vertices < 0 ? 0 : scan.vertices, scan.faces);
    if (status == LF_OK)
        status = lf_openmesh_read(path, formats[format].ending, scan.clean.data ? scan.clean : file,
                                  scan.binary, &soup, err);
    if (status == LF_OK)
        status = compare(path, &scan, &soup, err);
    if (status == LF_OK) {
        *out = assemble(&scan, &soup);
        if (report)
            fill_report(&scan, &soup, *out, report);
    }
    lf_soup_free(&soup);
    lf_scan_free(&scan);
    return status;
}

lf_status lf_mesh_read(const char *path, lf_mesh **out, lf_mesh_report *report, lf_error *err)
{
    const int format = find_format(path);
    if (format < 0)
        return lf_fail(err, LF_BAD_INPUT, "%s: a mesh file ends in .obj, .ply, .off or .stl", path);
    lf_bytes file;
    LF_TRY(lf_bytes_read(path, &file, err));
    const lf_status status = read_bytes(path, format, file, out, report, err);
    free(file.data);
    return status;
}
