/* scene_json.c: transforms.json (instant-ngp, nerfstudio) and NeRF-Synthetic's three files.
 *
 * transform_matrix: camera to world, 4x4, OpenGL axes (x right, y up, looking along -z). The first
 * pixel's centre lies at (0.5, 0.5); cx and cy default to the middle of the picture.
 */
#include "datasets/scene_internal.h"

#include <jansson.h>

#include "datasets/image.h"

typedef struct file {
    lf_scene_reader *reader;
    const char *path;
    char folder[PATH_MAX];
    json_t *root;
    bool synthetic;
    lf_scene_split split;
} file;

bool lf_is_nerf_synthetic(const char *path)
{
    char name[PATH_MAX];
    return lf_is_file(lf_join(name, path, "transforms_train.json"));
}

bool lf_is_transforms(const char *path)
{
    char name[PATH_MAX];
    const size_t n = strlen(path);
    return lf_is_file(lf_join(name, path, "transforms.json")) ||
           (n > 5 && strcmp(path + n - 5, ".json") == 0 && lf_is_file(path));
}

/* A number of the frame, else of the file, else `otherwise`. */
static lf_status number(const file *f, const json_t *frame, const char *where, const char *key,
                        double otherwise, double *out, lf_error *err)
{
    const json_t *value = frame ? json_object_get(frame, key) : NULL;
    if (!value)
        value = json_object_get(f->root, key);
    if (!value) {
        *out = otherwise;
        return LF_OK;
    }
    if (!json_is_number(value) || !isfinite(json_number_value(value)))
        return lf_fail(err, LF_BAD_INPUT, "%s: \"%s\" must be a number", where, key);
    *out = json_number_value(value);
    return LF_OK;
}

static lf_status read_matrix(const json_t *frame, const char *where, double pose[12], lf_error *err)
{
    const json_t *matrix = json_object_get(frame, "transform_matrix");
    if (!json_is_array(matrix) || json_array_size(matrix) < 3 || json_array_size(matrix) > 4)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: \"transform_matrix\" must be an array of 4 (or 3) rows", where);
    for (size_t i = 0; i < 3; i++) {
        const json_t *row = json_array_get(matrix, i);
        if (!json_is_array(row) || json_array_size(row) != 4)
            return lf_fail(err, LF_BAD_INPUT,
                           "%s: \"transform_matrix\"[%zu] must be an array of 4 numbers", where, i);
        for (size_t j = 0; j < 4; j++) {
            if (!json_is_number(json_array_get(row, j)))
                return lf_fail(err, LF_BAD_INPUT,
                               "%s: \"transform_matrix\"[%zu][%zu] must be a number", where, i, j);
            pose[4 * i + j] = json_number_value(json_array_get(row, j));
        }
    }
    return LF_OK;
}

static lf_status refuse_lens(const file *f, const json_t *frame, const char *where, lf_error *err)
{
    static const char *const keys[] = {"k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"};
    static const char *const models[] = {"OPENCV",        "PINHOLE", "SIMPLE_PINHOLE",
                                         "SIMPLE_RADIAL", "RADIAL",  "PERSPECTIVE"};
    for (size_t i = 0; i < sizeof keys / sizeof *keys; i++) {
        double k = 0;
        LF_TRY(number(f, frame, where, keys[i], 0, &k, err));
        if (k != 0)
            return lf_fail(err, LF_BAD_INPUT,
                           "%s: \"%s\" is %g: lens distortion is not read; undistort the pictures "
                           "first (colmap image_undistorter) and set it to 0",
                           where, keys[i], k);
    }
    const json_t *model = json_object_get(frame, "camera_model");
    if (!model)
        model = json_object_get(f->root, "camera_model");
    bool known = !model;
    for (size_t i = 0; model && i < sizeof models / sizeof *models; i++)
        known = known || (json_is_string(model) && !strcmp(json_string_value(model), models[i]));
    if (!known || json_is_true(json_object_get(f->root, "is_fisheye")))
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: the camera model %s is not read; OPENCV, PINHOLE, SIMPLE_PINHOLE, "
                       "SIMPLE_RADIAL and RADIAL without distortion are",
                       where, json_is_string(model) ? json_string_value(model) : "is_fisheye");
    if (json_object_get(frame, "mask_path"))
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: \"mask_path\" is not read; put the mask into the picture as alpha, or "
                       "take the key out",
                       where);
    return LF_OK;
}

/* Size, focal lengths and principal point; the picture says what the file does not. */
static lf_status read_lens(const file *f, const json_t *frame, lf_frame *out, lf_error *err)
{
    int width, height, channels;
    double w = 0, h = 0, angle_x = NAN, angle_y = NAN;
    lf_status status = lf_image_read_size(out->path, &width, &height, &channels, err);
    if (status != LF_OK)
        return lf_error_context(err, status, "%s", out->where);
    LF_TRY(refuse_lens(f, frame, out->where, err));
    LF_TRY(number(f, frame, out->where, "w", width, &w, err));
    LF_TRY(number(f, frame, out->where, "h", height, &h, err));
    if (!(w >= 1 && h >= 1 && w <= LF_IMAGE_SIZE_MAX && h <= LF_IMAGE_SIZE_MAX) || floor(w) != w ||
        floor(h) != h)
        return lf_fail(err, LF_BAD_INPUT, "%s: \"w\" and \"h\" are %g and %g: no size of a picture",
                       out->where, w, h);
    out->width = (int)w;
    out->height = (int)h;
    LF_TRY(number(f, frame, out->where, "camera_angle_x", NAN, &angle_x, err));
    LF_TRY(number(f, frame, out->where, "camera_angle_y", NAN, &angle_y, err));
    if (angle_x <= 0 || angle_x >= 3.1415 || angle_y <= 0 || angle_y >= 3.1415)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: \"camera_angle_x\" or \"camera_angle_y\" is not between 0 and pi",
                       out->where);
    LF_TRY(number(f, frame, out->where, "fl_x", 0.5 * w / tan(0.5 * angle_x), &out->fx, err));
    if (isnan(out->fx))
        return lf_fail(err, LF_BAD_INPUT, "%s: neither \"fl_x\" nor \"camera_angle_x\" is there",
                       out->where);
    const double fy = isnan(angle_y) ? out->fx : 0.5 * h / tan(0.5 * angle_y);
    const bool by_fx = json_object_get(frame, "fl_x") || json_object_get(f->root, "fl_x");
    LF_TRY(number(f, frame, out->where, "fl_y", by_fx ? out->fx : fy, &out->fy, err));
    LF_TRY(number(f, frame, out->where, "cx", 0.5 * w, &out->cx, err));
    return number(f, frame, out->where, "cy", 0.5 * h, &out->cy, err);
}

static bool is_listed(const json_t *list, const char *name)
{
    for (size_t i = 0; i < json_array_size(list); i++) {
        const json_t *one = json_array_get(list, i);
        if (json_is_string(one) && strcmp(json_string_value(one), name) == 0)
            return true;
    }
    return false;
}

/* nerfstudio's lists of file names; false: the frame is in none. */
static bool read_split(const file *f, const char *name, lf_scene_split *split)
{
    static const char *const keys[] = {"train_filenames", "val_filenames", "test_filenames"};
    if (f->synthetic || !f->reader->has_split)
        return true;
    for (int s = 0; s < LF_SPLITS; s++)
        if (is_listed(json_object_get(f->root, keys[s]), name)) {
            *split = (lf_scene_split)s;
            return true;
        }
    return false;
}

static lf_status read_depths(const file *f, const json_t *frame, lf_frame *out, lf_error *err)
{
    LF_TRY(number(f, frame, out->where, "near", f->synthetic ? 2 : 0, &out->near, err));
    LF_TRY(number(f, frame, out->where, "far", f->synthetic ? 6 : 0, &out->far, err));
    const bool said = json_object_get(frame, "far") || json_object_get(f->root, "far");
    if (said && out->far <= 0)
        return lf_fail(err, LF_BAD_INPUT, "%s: \"far\" is %g; it must be > 0", out->where,
                       out->far);
    if (f->synthetic && !said)
        f->reader->scene->depths = LF_DEPTHS_USUAL;
    return LF_OK;
}

static lf_status read_frame(const file *f, size_t i, lf_error *err)
{
    char where[PATH_MAX + 64], path[PATH_MAX];
    const json_t *frame = json_array_get(json_object_get(f->root, "frames"), i);
    const json_t *name = json_object_get(frame, "file_path");
    snprintf(where, sizeof where, "%s: frames[%zu]", f->path, i);
    if (!json_is_string(name))
        return lf_fail(err, LF_BAD_INPUT, "%s: \"file_path\" must be a text", where);
    lf_frame out = {.where = where, .name = json_string_value(name), .axes = LF_AXES_GL};
    out.split = f->split;
    out.reduced = 1;
    LF_TRY(read_matrix(frame, where, out.pose, err));
    if (!lf_find_picture(path, f->folder, out.name)) {
        lf_scene_leave_out(f->reader->scene, out.name, "%s: there is no such picture", where);
        return LF_OK;
    }
    if (!read_split(f, out.name, &out.split)) {
        lf_scene_leave_out(f->reader->scene, out.name,
                           "%s: in none of train_, val_ and test_filenames", where);
        return LF_OK;
    }
    out.path = path;
    if (strncmp(out.name, "./", 2) == 0)
        out.name += 2;
    LF_TRY(read_lens(f, frame, &out, err));
    LF_TRY(read_depths(f, frame, &out, err));
    return lf_scene_add_frame(f->reader, &out, err);
}

/* Every picture folder that a view comes from, once. */
static void note_orphans(lf_scene *scene)
{
    for (long i = 0; i < scene->views; i++) {
        const char *path = scene->view[i].path;
        const long n = lf_base_name(path) - path;
        bool seen = false;
        for (long j = 0; j < i && !seen; j++)
            seen = lf_base_name(scene->view[j].path) - scene->view[j].path == n &&
                   strncmp(scene->view[j].path, path, (size_t)n) == 0;
        if (!seen && n > 1) {
            char folder[PATH_MAX];
            snprintf(folder, sizeof folder, "%.*s", (int)(n - 1), path);
            lf_scene_note_orphans(scene, folder);
        }
    }
}

static lf_status read_file(file *f, lf_error *err)
{
    json_error_t error;
    if (!(f->root = json_load_file(f->path, 0, &error)))
        return lf_fail(err, LF_BAD_INPUT, "%s:%d:%d: is no JSON: %s", f->path, error.line,
                       error.column, error.text);
    if (!json_is_array(json_object_get(f->root, "frames")))
        return lf_fail(err, LF_BAD_INPUT, "%s: \"frames\" must be an array", f->path);
    if (!f->synthetic)
        f->reader->has_split = json_object_get(f->root, "train_filenames") != NULL;
    lf_status status = LF_OK;
    for (size_t i = 0; status == LF_OK && i < json_array_size(json_object_get(f->root, "frames"));
         i++)
        status = read_frame(f, i, err);
    return status;
}

static lf_status read_one(lf_scene_reader *reader, const char *path, bool synthetic,
                          lf_scene_split split, lf_error *err)
{
    file f = {.reader = reader, .path = path, .synthetic = synthetic, .split = split};
    const long n = lf_base_name(path) - path;
    snprintf(f.folder, sizeof f.folder, "%.*s", (int)(n > 1 ? n - 1 : n), path);
    const lf_status status = read_file(&f, err);
    json_decref(f.root);
    return status;
}

lf_status lf_read_transforms(lf_scene_reader *reader, const char *path, lf_error *err)
{
    char name[PATH_MAX];
    reader->scene->layout = LF_LAYOUT_TRANSFORMS;
    reader->scene->depths = LF_DEPTHS_FILE;
    LF_TRY(read_one(reader, lf_is_folder(path) ? lf_join(name, path, "transforms.json") : path,
                    false, LF_SPLIT_TRAIN, err));
    note_orphans(reader->scene);
    return LF_OK;
}

lf_status lf_read_nerf_synthetic(lf_scene_reader *reader, const char *path, lf_error *err)
{
    reader->scene->layout = LF_LAYOUT_NERF_SYNTHETIC;
    reader->scene->depths = LF_DEPTHS_FILE;
    reader->has_split = true;
    for (int s = 0; s < LF_SPLITS; s++) {
        char name[PATH_MAX], base[64];
        snprintf(base, sizeof base, "transforms_%s.json", lf_scene_split_name((lf_scene_split)s));
        lf_join(name, path, base);
        if (lf_is_file(name))
            LF_TRY(read_one(reader, name, true, (lf_scene_split)s, err));
    }
    note_orphans(reader->scene);
    return LF_OK;
}
