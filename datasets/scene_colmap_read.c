/* scene_colmap_read.c: cameras, images and points3D, as text and as binary (little-endian). */
#include "datasets/scene_colmap.h"

#include <errno.h>

#include "datasets/image.h"
#include "datasets/mesh_file.h"

/* Room in an array that doubles: full at 0 and at powers of two. */
static void *more(void *array, long count, size_t size)
{
    if (count & (count - 1))
        return array;
    array = realloc(array, (count ? 2 * (size_t)count : 1) * size);
    LF_REQUIRE(array, "out of memory");
    return array;
}

lf_colmap_camera *lf_colmap_more_cameras(lf_colmap *m)
{
    m->camera = more(m->camera, m->cameras, sizeof *m->camera);
    m->camera[m->cameras] = (lf_colmap_camera){0};
    return &m->camera[m->cameras++];
}

lf_colmap_image *lf_colmap_more_images(lf_colmap *m)
{
    m->image = more(m->image, m->images, sizeof *m->image);
    m->image[m->images] = (lf_colmap_image){0};
    return &m->image[m->images++];
}

lf_colmap_point *lf_colmap_more_points(lf_colmap *m)
{
    m->point = more(m->point, m->points, sizeof *m->point);
    m->point[m->points] = (lf_colmap_point){0};
    return &m->point[m->points++];
}

void lf_colmap_see(lf_colmap_image *image, double u, double v, int64_t point)
{
    image->observation = more(image->observation, image->seen, sizeof *image->observation);
    image->observation[image->seen++] = (lf_colmap_seen){u, v, point};
}

static lf_status set_size(const char *where, double width, double height, lf_colmap_camera *camera,
                          lf_error *err)
{
    if (!(width >= 1 && height >= 1 && width <= LF_IMAGE_SIZE_MAX && height <= LF_IMAGE_SIZE_MAX))
        return lf_fail(err, LF_BAD_INPUT, "%s: the size is %g x %g pixels", where, width, height);
    camera->width = (int)width;
    camera->height = (int)height;
    return LF_OK;
}

/* ---- text --------------------------------------------------------------------------------- */

typedef struct text {
    FILE *f;
    const char *path;
    char *line, *at;
    size_t capacity;
    long number;
    char where[PATH_MAX + 32];
} text;

/* The next line; comments and, unless `blank`, empty lines are passed over. False at the end. */
static bool next_line(text *t, bool blank)
{
    while (getline(&t->line, &t->capacity, t->f) >= 0) {
        t->number++;
        t->line[strcspn(t->line, "\r\n")] = 0;
        t->at = t->line + strspn(t->line, " \t");
        if (*t->at == '#' || (!*t->at && !blank))
            continue;
        snprintf(t->where, sizeof t->where, "%s:%ld", t->path, t->number);
        return true;
    }
    return false;
}

static bool next_number(text *t, double *out)
{
    char *end;
    *out = strtod(t->at, &end);
    if (end == t->at || (*end && *end != ' ' && *end != '\t') || !isfinite(*out))
        return false;
    t->at = end + strspn(end, " \t");
    return true;
}

static lf_status numbers(text *t, int count, double *out, const char *what, lf_error *err)
{
    for (int i = 0; i < count; i++)
        if (!next_number(t, &out[i]))
            return lf_fail(err, LF_BAD_INPUT, "%s: number %d of %s cannot be read: '%.40s'",
                           t->where, i + 1, what, t->at);
    return LF_OK;
}

/* CAMERA_ID MODEL WIDTH HEIGHT PARAMS[] */
static lf_status text_camera(text *t, lf_colmap *m, lf_error *err)
{
    double id, size[2], parameter[8];
    char name[64] = "";
    LF_TRY(numbers(t, 1, &id, "the camera's id", err));
    const size_t n = strcspn(t->at, " \t");
    snprintf(name, sizeof name, "%.*s", (int)(n < 63 ? n : 63), t->at);
    t->at += n;
    t->at += strspn(t->at, " \t");
    const int model = lf_colmap_model(name, 0);
    if (model < 0)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: the camera model '%s' is not read; SIMPLE_PINHOLE, PINHOLE, and "
                       "SIMPLE_RADIAL, RADIAL, OPENCV without distortion are: undistort first "
                       "(colmap image_undistorter)",
                       t->where, name);
    LF_TRY(numbers(t, 2, size, "the size", err));
    LF_TRY(numbers(t, lf_colmap_parameters(model), parameter, "the parameters", err));
    lf_colmap_camera *camera = lf_colmap_more_cameras(m);
    camera->id = (long)id;
    LF_TRY(set_size(t->where, size[0], size[1], camera, err));
    return lf_colmap_set_lens(t->where, model, parameter, camera, err);
}

/* IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of POINTS2D: X Y POINT3D_ID */
static lf_status text_image(text *t, lf_colmap *m, lf_error *err)
{
    double x[9], seen[3];
    LF_TRY(numbers(t, 9, x, "the image", err));
    if (!*t->at)
        return lf_fail(err, LF_BAD_INPUT, "%s: the image has no name", t->where);
    lf_colmap_image *image = lf_colmap_more_images(m);
    memcpy(image->q, x + 1, sizeof image->q);
    memcpy(image->t, x + 5, sizeof image->t);
    image->camera = (long)x[8];
    image->name = strdup(t->at);
    LF_REQUIRE(image->name, "out of memory");
    if (!next_line(t, true))
        return LF_OK;
    while (*t->at) {
        LF_TRY(numbers(t, 3, seen, "an observation", err));
        if (seen[2] >= 0)
            lf_colmap_see(image, seen[0], seen[1], (int64_t)seen[2]);
    }
    return LF_OK;
}

/* POINT3D_ID X Y Z R G B ERROR TRACK[] */
static lf_status text_point(text *t, lf_colmap *m, lf_error *err)
{
    double x[4];
    LF_TRY(numbers(t, 4, x, "the point", err));
    lf_colmap_point *p = lf_colmap_more_points(m);
    p->id = (int64_t)x[0];
    memcpy(p->at, x + 1, sizeof p->at);
    return LF_OK;
}

static lf_status read_text(const char *folder, const char *name, bool needed, lf_colmap *m,
                           lf_status (*one)(text *, lf_colmap *, lf_error *), lf_error *err)
{
    char path[PATH_MAX];
    text t = {.path = lf_join(path, folder, name)};
    if (!needed && !lf_is_file(path))
        return LF_OK;
    if (!(t.f = fopen(path, "r")))
        return lf_fail(err, LF_BAD_INPUT, "%s: cannot be opened: %s", path, strerror(errno));
    lf_status status = LF_OK;
    while (status == LF_OK && next_line(&t, false))
        status = one(&t, m, err);
    free(t.line);
    fclose(t.f);
    return status;
}

lf_status lf_colmap_read_text(const char *folder, lf_colmap *model, lf_error *err)
{
    LF_TRY(read_text(folder, "cameras.txt", true, model, text_camera, err));
    LF_TRY(read_text(folder, "images.txt", true, model, text_image, err));
    return read_text(folder, "points3D.txt", false, model, text_point, err);
}

/* ---- binary ------------------------------------------------------------------------------- */

typedef struct binary {
    const char *path;
    lf_bytes file;
    size_t at;
    uint64_t element;
} binary;

static lf_status cut_short(const binary *b, lf_error *err)
{
    return lf_fail(err, LF_BAD_INPUT,
                   "%s: element %llu at byte %zu of %zu: the file is cut short "
                   "or damaged",
                   b->path, (unsigned long long)b->element, b->at, b->file.size);
}

/* An unsigned little-endian number of `size` bytes. */
static bool take(binary *b, size_t size, uint64_t *out)
{
    if (b->file.size - b->at < size)
        return false;
    *out = 0;
    for (size_t i = 0; i < size; i++)
        *out |= (uint64_t)(unsigned char)b->file.data[b->at + i] << 8 * i;
    b->at += size;
    return true;
}

static lf_status take_doubles(binary *b, int count, double *out, lf_error *err)
{
    for (int i = 0; i < count; i++) {
        uint64_t bits;
        if (!take(b, 8, &bits))
            return cut_short(b, err);
        memcpy(&out[i], &bits, 8);
        if (!isfinite(out[i]))
            return lf_fail(err, LF_BAD_INPUT,
                           "%s: element %llu at byte %zu: a number is not finite", b->path,
                           (unsigned long long)b->element, b->at - 8);
    }
    return LF_OK;
}

/* camera_id i32, model i32, width u64, height u64, parameters f64 */
static lf_status binary_camera(binary *b, lf_colmap *m, lf_error *err)
{
    uint64_t id, number, width, height;
    double parameter[8];
    char where[PATH_MAX + 32];
    snprintf(where, sizeof where, "%s: camera %llu", b->path, (unsigned long long)b->element);
    if (!take(b, 4, &id) || !take(b, 4, &number) || !take(b, 8, &width) || !take(b, 8, &height))
        return cut_short(b, err);
    const int model = lf_colmap_model(NULL, (int)(uint32_t)number);
    if (model < 0)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: COLMAP's camera model number %lld is not read; SIMPLE_PINHOLE, "
                       "PINHOLE, and SIMPLE_RADIAL, RADIAL, OPENCV without distortion are: "
                       "undistort first (colmap image_undistorter)",
                       where, (long long)number);
    LF_TRY(take_doubles(b, lf_colmap_parameters(model), parameter, err));
    lf_colmap_camera *camera = lf_colmap_more_cameras(m);
    camera->id = (long)id;
    LF_TRY(set_size(where, (double)width, (double)height, camera, err));
    return lf_colmap_set_lens(where, model, parameter, camera, err);
}

/* image_id u32, q f64[4], t f64[3], camera_id u32, name\0, n u64, (x f64, y f64, point i64)[n] */
static lf_status binary_image(binary *b, lf_colmap *m, lf_error *err)
{
    uint64_t id, camera, count;
    double x[7];
    if (!take(b, 4, &id))
        return cut_short(b, err);
    LF_TRY(take_doubles(b, 7, x, err));
    if (!take(b, 4, &camera))
        return cut_short(b, err);
    const char *name = b->file.data + b->at;
    const size_t length = strnlen(name, b->file.size - b->at);
    b->at += length;
    if (!take(b, 1, &id) || !take(b, 8, &count) || count > (b->file.size - b->at) / 24)
        return cut_short(b, err);
    lf_colmap_image *image = lf_colmap_more_images(m);
    memcpy(image->q, x, sizeof image->q);
    memcpy(image->t, x + 4, sizeof image->t);
    image->camera = (long)camera;
    image->name = strndup(name, length);
    LF_REQUIRE(image->name, "out of memory");
    for (uint64_t i = 0; i < count; i++) {
        uint64_t point;
        LF_TRY(take_doubles(b, 2, x, err));
        if (!take(b, 8, &point))
            return cut_short(b, err);
        if (point != UINT64_MAX)
            lf_colmap_see(image, x[0], x[1], (int64_t)point);
    }
    return LF_OK;
}

/* point_id u64, xyz f64[3], rgb u8[3], error f64, n u64, (image u32, index u32)[n] */
static lf_status binary_point(binary *b, lf_colmap *m, lf_error *err)
{
    uint64_t id, skip, count;
    double at[3];
    if (!take(b, 8, &id))
        return cut_short(b, err);
    LF_TRY(take_doubles(b, 3, at, err));
    if (!take(b, 3, &skip) || !take(b, 8, &skip) || !take(b, 8, &count) ||
        count > (b->file.size - b->at) / 8)
        return cut_short(b, err);
    b->at += 8 * (size_t)count;
    lf_colmap_point *p = lf_colmap_more_points(m);
    p->id = (int64_t)id;
    memcpy(p->at, at, sizeof p->at);
    return LF_OK;
}

static lf_status read_elements(binary *b, lf_colmap *m,
                               lf_status (*one)(binary *, lf_colmap *, lf_error *), lf_error *err)
{
    uint64_t count;
    if (!take(b, 8, &count))
        return cut_short(b, err);
    for (b->element = 0; b->element < count; b->element++)
        LF_TRY(one(b, m, err));
    if (b->at != b->file.size)
        return lf_fail(err, LF_BAD_INPUT, "%s: %zu bytes follow the last of %llu elements", b->path,
                       b->file.size - b->at, (unsigned long long)count);
    return LF_OK;
}

static lf_status read_binary(const char *folder, const char *name, bool needed, lf_colmap *m,
                             lf_status (*one)(binary *, lf_colmap *, lf_error *), lf_error *err)
{
    char path[PATH_MAX];
    binary b = {.path = lf_join(path, folder, name)};
    if (!needed && !lf_is_file(path))
        return LF_OK;
    LF_TRY(lf_bytes_read(path, &b.file, err));
    const lf_status status = read_elements(&b, m, one, err);
    free(b.file.data);
    return status;
}

lf_status lf_colmap_read_binary(const char *folder, lf_colmap *model, lf_error *err)
{
    LF_TRY(read_binary(folder, "cameras.bin", true, model, binary_camera, err));
    LF_TRY(read_binary(folder, "images.bin", true, model, binary_image, err));
    return read_binary(folder, "points3D.bin", false, model, binary_point, err);
}
