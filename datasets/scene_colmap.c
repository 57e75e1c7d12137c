/* scene_colmap.c: a sparse model of COLMAP, text or binary, and its pictures.
 *
 * images: quaternion (w, x, y, z) and translation, world to camera, x right, y down, z forward.
 * Intrinsics have the first pixel's centre at (0.5, 0.5). Of the camera models, those without
 * distortion are read, and SIMPLE_RADIAL, RADIAL and OPENCV if their coefficients are 0.
 */
#include "datasets/scene_colmap.h"

static const struct {
    const char *name;
    int id, parameters, focals;
} models[] = {{"SIMPLE_PINHOLE", 0, 3, 1},
              {"PINHOLE", 1, 4, 2},
              {"SIMPLE_RADIAL", 2, 4, 1},
              {"RADIAL", 3, 5, 1},
              {"OPENCV", 4, 8, 2}};
enum { MODELS = sizeof models / sizeof *models };

static bool find_model(const char *path, char out[PATH_MAX], bool *binary)
{
    static const char *const folders[] = {"sparse/0", "sparse", "."};
    for (size_t i = 0; i < sizeof folders / sizeof *folders; i++) {
        char file[PATH_MAX];
        lf_join(out, path, folders[i]);
        *binary = lf_is_file(lf_join(file, out, "cameras.bin"));
        if (*binary || lf_is_file(lf_join(file, out, "cameras.txt")))
            return true;
    }
    return false;
}

bool lf_is_colmap(const char *path)
{
    char folder[PATH_MAX];
    bool binary;
    return find_model(path, folder, &binary);
}

int lf_colmap_model(const char *name, int id)
{
    for (int i = 0; i < MODELS; i++)
        if (name ? strcmp(models[i].name, name) == 0 : models[i].id == id)
            return i;
    return -1;
}

int lf_colmap_parameters(int model)
{
    return models[model].parameters;
}

lf_status lf_colmap_set_lens(const char *where, int model, const double *p,
                             lf_colmap_camera *camera, lf_error *err)
{
    const int n = models[model].focals;
    camera->fx = p[0];
    camera->fy = p[n - 1];
    camera->cx = p[n];
    camera->cy = p[n + 1];
    for (int i = n + 2; i < models[model].parameters; i++)
        if (p[i] != 0)
            return lf_fail(err, LF_BAD_INPUT,
                           "%s: the camera model %s has distortion (parameter %d is %g): "
                           "undistort first (colmap image_undistorter)",
                           where, models[model].name, i + 1, p[i]);
    return LF_OK;
}

static const lf_colmap_camera *camera_of(const lf_colmap *model, long id)
{
    for (long i = 0; i < model->cameras; i++)
        if (model->camera[i].id == id)
            return &model->camera[i];
    return NULL;
}

/* Camera to world of a quaternion and translation, world to camera. */
static lf_status read_pose(const lf_colmap_image *image, const char *where, double pose[12],
                           lf_error *err)
{
    double q[4], norm = 0;
    for (int i = 0; i < 4; i++)
        norm += image->q[i] * image->q[i];
    if (!(fabs(norm - 1) < 1e-3))
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: the quaternion has length %g; it must be 1 (to 1e-3)", where,
                       sqrt(norm));
    for (int i = 0; i < 4; i++)
        q[i] = image->q[i] / sqrt(norm);
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double r[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                         2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                         2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
    for (int i = 0; i < 3; i++) {
        pose[4 * i + 3] = 0;
        for (int j = 0; j < 3; j++) {
            pose[4 * i + j] = r[3 * j + i];
            pose[4 * i + 3] -= r[3 * j + i] * image->t[j];
        }
    }
    return LF_OK;
}

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static int by_id(const void *a, const void *b)
{
    const lf_colmap_point *x = a, *y = b;
    return (x->id > y->id) - (x->id < y->id);
}

/* Depths of the points an image sees: near and far; the errors of reprojection are appended. */
static void see_points(const lf_colmap *model, const lf_colmap_image *image, lf_frame *f,
                       double **error, long *errors)
{
    double *depth = malloc((size_t)(image->seen + 1) * sizeof *depth);
    *error = realloc(*error, (size_t)(*errors + image->seen + 1) * sizeof **error);
    LF_REQUIRE(depth && *error, "out of memory");
    long n = 0;
    for (long i = 0; i < image->seen; i++) {
        const lf_colmap_point key = {.id = image->observation[i].point};
        const lf_colmap_point *p =
            model->points ? bsearch(&key, model->point, (size_t)model->points, sizeof key, by_id)
                          : NULL;
        double q[3];
        if (!p)
            continue;
        for (int k = 0; k < 3; k++)
            q[k] = f->pose[k] * (p->at[0] - f->pose[3]) + f->pose[4 + k] * (p->at[1] - f->pose[7]) +
                   f->pose[8 + k] * (p->at[2] - f->pose[11]);
        if (!(q[2] > 0))
            continue;
        depth[n++] = q[2];
        (*error)[(*errors)++] = hypot(f->fx * q[0] / q[2] + f->cx - image->observation[i].u,
                                      f->fy * q[1] / q[2] + f->cy - image->observation[i].v);
    }
    if (n >= 2) {
        qsort(depth, (size_t)n, sizeof *depth, by_value);
        f->near = depth[(long)(0.001 * (double)(n - 1) + 0.5)];
        f->far = depth[(long)(0.999 * (double)(n - 1) + 0.5)];
        if (f->near >= f->far)
            f->near = f->far = 0;
    }
    free(depth);
}

static lf_status add_image(lf_scene_reader *reader, const lf_colmap *model, const char *file,
                           const char *folder, const lf_colmap_image *image, double **error,
                           long *errors, lf_error *err)
{
    char where[PATH_MAX + 300], path[PATH_MAX];
    snprintf(where, sizeof where, "%s: image %.200s", file, image->name);
    const lf_colmap_camera *camera = camera_of(model, image->camera);
    if (!camera)
        return lf_fail(err, LF_BAD_INPUT, "%s: names the camera %ld, which is not in cameras",
                       where, image->camera);
    if (!lf_is_file(lf_join(path, folder, image->name))) {
        lf_scene_leave_out(reader->scene, image->name, "%s: there is no such picture", where);
        return LF_OK;
    }
    lf_frame f = {.where = where, .name = image->name, .path = path, .reduced = 1};
    f.width = camera->width;
    f.height = camera->height;
    f.fx = camera->fx;
    f.fy = camera->fy;
    f.cx = camera->cx;
    f.cy = camera->cy;
    LF_TRY(read_pose(image, where, f.pose, err));
    see_points(model, image, &f, error, errors);
    return lf_scene_add_frame(reader, &f, err);
}

static int by_image_name(const void *a, const void *b)
{
    return strcmp(((const lf_colmap_image *)a)->name, ((const lf_colmap_image *)b)->name);
}

static lf_status add_images(lf_scene_reader *reader, lf_colmap *model, const char *file,
                            const char *folder, lf_error *err)
{
    lf_scene *scene = reader->scene;
    double *error = NULL;
    long errors = 0;
    lf_status status = LF_OK;
    if (model->images)
        qsort(model->image, (size_t)model->images, sizeof *model->image, by_image_name);
    if (model->points)
        qsort(model->point, (size_t)model->points, sizeof *model->point, by_id);
    for (long i = 0; status == LF_OK && i < model->images; i++)
        status = add_image(reader, model, file, folder, &model->image[i], &error, &errors, err);
    if (errors) {
        qsort(error, (size_t)errors, sizeof *error, by_value);
        scene->reprojection = error[errors / 2];
        scene->observations = errors;
    }
    free(error);
    if (status == LF_OK && model->points) {
        scene->points = model->points;
        scene->point = malloc((size_t)model->points * sizeof *scene->point);
        LF_REQUIRE(scene->point, "out of memory");
        for (long i = 0; i < model->points; i++)
            memcpy(scene->point[i], model->point[i].at, sizeof scene->point[i]);
    }
    return status;
}

lf_status lf_read_colmap(lf_scene_reader *reader, const char *path, lf_error *err)
{
    char folder[PATH_MAX], file[PATH_MAX], images[PATH_MAX];
    static const char *const picture_folders[] = {"images", "../images", "../../images"};
    lf_colmap model = {0};
    bool binary;
    find_model(path, folder, &binary);
    reader->scene->layout = binary ? LF_LAYOUT_COLMAP_BINARY : LF_LAYOUT_COLMAP_TEXT;
    reader->scene->depths = LF_DEPTHS_POINTS;
    int i = 0;
    while (i < 3 && !lf_is_folder(lf_join(images, path, picture_folders[i])))
        i++;
    if (i == 3)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: the model's pictures are missing: there is no folder images/ in it or "
                       "above it",
                       path);
    lf_status status = binary ? lf_colmap_read_binary(folder, &model, err)
                              : lf_colmap_read_text(folder, &model, err);
    if (status == LF_OK)
        status =
            add_images(reader, &model, lf_join(file, folder, binary ? "images.bin" : "images.txt"),
                       images, err);
    lf_colmap_free(&model);
    if (status == LF_OK)
        lf_scene_note_orphans(reader->scene, images);
    return status;
}

void lf_colmap_free(lf_colmap *model)
{
    for (long i = 0; i < model->images; i++) {
        free(model->image[i].name);
        free(model->image[i].observation);
    }
    free(model->camera);
    free(model->image);
    free(model->point);
    *model = (lf_colmap){0};
}
