/* scene_colmap_write.c: a scene as COLMAP's sparse model, one PINHOLE camera a view. The points of
 * a scene are written without tracks. */
#include "datasets/scene_internal.h"

#include <errno.h>
#include <sys/stat.h>

/* Quaternion (w, x, y, z) and translation, world to camera; w >= 0. The largest of the four
 * squares is divided by, so no accuracy is lost. */
static void quaternion_of(const lf_camera *c, double q[4], double t[3])
{
    double r[9], square[4];
    lf_rotation_transpose(c->rotation, r);
    square[0] = 1 + r[0] + r[4] + r[8];
    square[1] = 1 + r[0] - r[4] - r[8];
    square[2] = 1 - r[0] + r[4] - r[8];
    square[3] = 1 - r[0] - r[4] + r[8];
    int k = 0;
    for (int i = 1; i < 4; i++)
        k = square[i] > square[k] ? i : k;
    /* 4 q_i q_j */
    const double wx = r[7] - r[5], wy = r[2] - r[6], wz = r[3] - r[1];
    const double xy = r[1] + r[3], xz = r[2] + r[6], yz = r[5] + r[7];
    const double product[4][4] = {{square[0], wx, wy, wz},
                                  {wx, square[1], xy, xz},
                                  {wy, xy, square[2], yz},
                                  {wz, xz, yz, square[3]}};
    const double sign = product[k][0] < 0 ? -1 : 1;
    for (int i = 0; i < 4; i++)
        q[i] = sign * product[k][i] / (2 * sqrt(square[k]));
    lf_rotation_apply(r, c->centre, t);
    for (int i = 0; i < 3; i++)
        t[i] = -t[i];
}

static void put(FILE *f, uint64_t bits, int size)
{
    for (int i = 0; i < size; i++)
        fputc((int)(bits >> 8 * i & 255), f);
}

static void put_double(FILE *f, double x)
{
    uint64_t bits;
    memcpy(&bits, &x, 8);
    put(f, bits, 8);
}

static void write_cameras(FILE *f, const lf_scene *scene, bool binary)
{
    if (binary)
        put(f, (uint64_t)scene->views, 8);
    for (long v = 0; v < scene->views; v++) {
        const lf_camera *c = &scene->view[v].camera;
        const double p[4] = {c->fx, c->fy, c->cx + 0.5, c->cy + 0.5};
        if (!binary) {
            fprintf(f, "%ld PINHOLE %d %d %.17g %.17g %.17g %.17g\n", v + 1, c->width, c->height,
                    p[0], p[1], p[2], p[3]);
            continue;
        }
        put(f, (uint64_t)(v + 1), 4);
        put(f, 1, 4);
        put(f, (uint64_t)c->width, 8);
        put(f, (uint64_t)c->height, 8);
        for (int i = 0; i < 4; i++)
            put_double(f, p[i]);
    }
}

static void write_images(FILE *f, const lf_scene *scene, bool binary, char **name)
{
    if (binary)
        put(f, (uint64_t)scene->views, 8);
    for (long v = 0; v < scene->views; v++) {
        double x[7];
        const char *base = lf_base_name(name[v]);
        quaternion_of(&scene->view[v].camera, x, x + 4);
        if (!binary) {
            fprintf(f, "%ld", v + 1);
            for (int i = 0; i < 7; i++)
                fprintf(f, " %.17g", x[i]);
            fprintf(f, " %ld %s\n\n", v + 1, base);
            continue;
        }
        put(f, (uint64_t)(v + 1), 4);
        for (int i = 0; i < 7; i++)
            put_double(f, x[i]);
        put(f, (uint64_t)(v + 1), 4);
        fwrite(base, 1, strlen(base) + 1, f);
        put(f, 0, 8);
    }
}

static void write_points(FILE *f, const lf_scene *scene, bool binary)
{
    if (binary)
        put(f, (uint64_t)scene->points, 8);
    for (long i = 0; i < scene->points; i++) {
        const double *p = scene->point[i];
        if (!binary) {
            fprintf(f, "%ld %.17g %.17g %.17g 128 128 128 0\n", i + 1, p[0], p[1], p[2]);
            continue;
        }
        put(f, (uint64_t)(i + 1), 8);
        for (int k = 0; k < 3; k++)
            put_double(f, p[k]);
        put(f, 0x808080, 3);
        put_double(f, 0);
        put(f, 0, 8);
    }
}

lf_status lf_write_colmap(const lf_scene *scene, bool binary, const char *folder, char **name,
                          lf_error *err)
{
    static const char *const parts[] = {"cameras", "images", "points3D"};
    char path[PATH_MAX], base[64];
    mkdir(lf_join(path, folder, "sparse"), 0777);
    mkdir(lf_join(path, folder, "sparse/0"), 0777);
    for (int i = 0; i < 3; i++) {
        snprintf(base, sizeof base, "sparse/0/%s.%s", parts[i], binary ? "bin" : "txt");
        FILE *f = fopen(lf_join(path, folder, base), "wb");
        if (!f)
            return lf_fail(err, LF_FAILED, "%s: cannot be written: %s", path, strerror(errno));
        if (i == 0)
            write_cameras(f, scene, binary);
        else if (i == 1)
            write_images(f, scene, binary, name);
        else
            write_points(f, scene, binary);
        const int failed = ferror(f);
        if (fclose(f) || failed)
            return lf_fail(err, LF_FAILED, "%s: cannot be written: %s", path, strerror(errno));
    }
    return LF_OK;
}
