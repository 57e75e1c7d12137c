/* mesh_write.c: binary little-endian PLY, whole or not at all. */
#include "datasets/mesh_file.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <unistd.h>

static unsigned char byte(float c)
{
    return (unsigned char)lround(255.0 * (double)(c < 0 ? 0 : c > 1 ? 1 : c));
}

static bool put(FILE *f, const void *bytes, size_t size)
{
    const uint16_t one = 1;
    unsigned char copy[8];
    const bool little = *(const unsigned char *)&one == 1;
    for (size_t i = 0; i < size; i++)
        copy[i] = ((const unsigned char *)bytes)[little ? i : size - 1 - i];
    return fwrite(copy, 1, size, f) == size;
}

/* The layout that OpenMesh writes for a half-edge mesh. */
static bool write_soup(FILE *f, const lf_mesh *mesh)
{
    bool ok = fprintf(f,
                      "ply\nformat binary_little_endian 1.0\nelement vertex %ld\n"
                      "property float x\nproperty float y\nproperty float z\n"
                      "element face %ld\nproperty list uchar int vertex_indices\n"
                      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                      "end_header\n",
                      mesh->vertices, mesh->faces) > 0;
    for (long i = 0; ok && i < 3 * mesh->vertices; i++) {
        const float x = (float)mesh->vertex[i / 3][i % 3];
        ok = put(f, &x, sizeof x);
    }
    for (long i = 0; ok && i < mesh->faces; i++) {
        const unsigned char three = 3;
        ok = put(f, &three, 1);
        for (int j = 0; ok && j < 3; j++)
            ok = put(f, &mesh->face[i][j], sizeof(int32_t));
        for (int j = 0; ok && j < 3; j++) {
            const unsigned char c = byte(mesh->colour[i][j]);
            ok = put(f, &c, 1);
        }
    }
    return ok;
}

static lf_status write_soup_file(const char *path, const lf_mesh *mesh, lf_error *err)
{
    FILE *f = fopen(path, "wb");
    if (!f)
        return lf_fail(err, LF_FAILED, "%s: cannot be written: %s", path, strerror(errno));
    const bool written = write_soup(f, mesh);
    if (fclose(f) != 0 || !written)
        return lf_fail(err, LF_FAILED, "%s: cannot be written: %s", path, strerror(errno));
    return LF_OK;
}

lf_status lf_mesh_write_ply(const char *path, const lf_mesh *mesh, lf_error *err)
{
    char temporary[PATH_MAX];
    if (snprintf(temporary, sizeof temporary, "%s.part.%ld", path, (long)getpid()) >=
        (int)sizeof temporary)
        return lf_fail(err, LF_FAILED, "%s: the name is too long", path);
    bool taken = false;
    lf_status status = lf_openmesh_write_ply(temporary, mesh, &taken, err);
    if (status == LF_OK && !taken)
        status = write_soup_file(temporary, mesh, err);
    if (status == LF_OK && rename(temporary, path) != 0)
        status = lf_fail(err, LF_FAILED, "%s: cannot be renamed from %s: %s", path, temporary,
                         strerror(errno));
    if (status != LF_OK)
        remove(temporary);
    return status;
}
