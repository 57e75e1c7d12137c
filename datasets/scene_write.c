/* scene_write.c: a scene as a folder in any of the layouts: checks, folders, pictures, JSON. */
#include "datasets/scene_internal.h"

#include <dirent.h>
#include <errno.h>
#include <jansson.h>
#include <sys/stat.h>

#include "datasets/image.h"

void lf_pose_of(const lf_camera *camera, lf_axes axes, double pose[16])
{
    const double sign = axes == LF_AXES_GL ? -1 : 1;
    for (int i = 0; i < 16; i++)
        pose[i] = i == 15;
    for (int i = 0; i < 3; i++) {
        pose[4 * i] = camera->rotation[3 * i];
        pose[4 * i + 1] = sign * camera->rotation[3 * i + 1];
        pose[4 * i + 2] = sign * camera->rotation[3 * i + 2];
        pose[4 * i + 3] = camera->centre[i];
    }
}

/* ---- what a layout can say ---------------------------------------------------------------- */

static bool equal(double a, double b)
{
    return fabs(a - b) <= 1e-9 * (1 + fabs(b));
}

static lf_status check_view(const lf_scene *scene, lf_scene_layout layout, const lf_scene_view *v,
                            lf_error *err)
{
    const lf_camera *c = &v->camera, *first = &scene->view[0].camera;
    const bool json = layout == LF_LAYOUT_NERF_SYNTHETIC, llff = layout == LF_LAYOUT_LLFF;
    const bool voxels = layout == LF_LAYOUT_DEEPVOXELS;
    const char *key = NULL;
    if ((json || llff || voxels) && !equal(c->fx, c->fy))
        key = "two focal lengths";
    else if ((json || llff) &&
             (!equal(c->cx, 0.5 * c->width - 0.5) || !equal(c->cy, 0.5 * c->height - 0.5)))
        key = "a principal point that is not the middle";
    else if ((json || voxels) &&
             (c->width != first->width || c->height != first->height || !equal(c->fx, first->fx)))
        key = "views of different sizes or focal lengths";
    else if (voxels && (!equal(c->cx, first->cx) || !equal(c->cy, first->cy)))
        key = "views of different principal points";
    if (key)
        return lf_fail(err, LF_BAD_INPUT,
                       "the view %s cannot be written as %s: the layout has no place for %s; "
                       "transforms.json and COLMAP do",
                       v->name, lf_scene_layout_name(layout), key);
    return LF_OK;
}

static lf_status check_scene(const lf_scene *scene, lf_scene_layout layout, lf_error *err)
{
    if (scene->views == 0)
        return lf_fail(err, LF_BAD_INPUT, "%s: the scene has no view to write", scene->folder);
    for (long i = 0; i < scene->views; i++)
        LF_TRY(check_view(scene, layout, &scene->view[i], err));
    return LF_OK;
}

/* ---- folders and pictures ----------------------------------------------------------------- */

static lf_status make_folder(const char *path, lf_error *err)
{
    if (mkdir(path, 0777) && errno != EEXIST)
        return lf_fail(err, LF_BAD_INPUT, "%s: cannot be made: %s", path, strerror(errno));
    return LF_OK;
}

/* The folder and those above it. */
static lf_status make_folders(const char *path, lf_error *err)
{
    char above[PATH_MAX];
    for (const char *slash = strchr(path + 1, '/'); slash; slash = strchr(slash + 1, '/')) {
        snprintf(above, sizeof above, "%.*s", (int)(slash - path), path);
        LF_TRY(make_folder(above, err));
    }
    return make_folder(path, err);
}

static lf_status make_empty(const char *folder, lf_error *err)
{
    LF_TRY(make_folders(folder, err));
    DIR *dir = opendir(folder);
    if (!dir)
        return lf_fail(err, LF_BAD_INPUT, "%s: cannot be opened: %s", folder, strerror(errno));
    bool empty = true;
    for (struct dirent *e; (e = readdir(dir));)
        empty = empty && (!strcmp(e->d_name, ".") || !strcmp(e->d_name, ".."));
    closedir(dir);
    if (!empty)
        return lf_fail(err, LF_BAD_INPUT, "%s: holds files; give a new or empty folder", folder);
    return LF_OK;
}

/* Make the folders of a path below `folder`. */
static lf_status make_way(const char *folder, const char *name, lf_error *err)
{
    char path[PATH_MAX];
    lf_join(path, folder, name);
    for (char *slash = path + strlen(folder) + 1; (slash = strchr(slash, '/')); slash++) {
        *slash = 0;
        LF_TRY(make_folder(path, err));
        *slash = '/';
    }
    return LF_OK;
}

/* Straight colour of a value over white. */
static float straight(uint8_t over_white, uint8_t alpha)
{
    if (!alpha)
        return 1;
    return fminf(1, fmaxf(0, ((float)over_white - 255 + (float)alpha) / (float)alpha));
}

static lf_status write_picture(const lf_scene *scene, long view, const char *path, lf_error *err)
{
    lf_pixels p;
    LF_TRY(lf_scene_hold(scene, view, &p, err));
    const int channels = p.alpha ? 4 : 3;
    lf_image *image = lf_image_create(p.width, p.height, channels);
    for (size_t i = 0; i < (size_t)p.width * (size_t)p.height; i++) {
        float *to = image->pixel + i * (size_t)channels;
        for (size_t c = 0; c < 3; c++)
            to[c] = straight(p.rgb[3 * i + c], p.alpha ? p.alpha[i] : 255);
        if (p.alpha)
            to[3] = (float)p.alpha[i] / 255;
    }
    lf_scene_release(scene, view);
    const lf_status status = lf_image_write_png(path, image, err);
    lf_image_free(image);
    return status;
}

/* The picture's path below the scene's folder; `number` counts within the split. */
static char *picture_name(lf_scene_layout layout, lf_scene_split split, long view, long number)
{
    static const char *const folders[] = {"train", "validation", "test"};
    char name[128];
    switch (layout) {
    case LF_LAYOUT_NERF_SYNTHETIC:
        snprintf(name, sizeof name, "%s/r_%ld.png", lf_scene_split_name(split), number);
        break;
    case LF_LAYOUT_DEEPVOXELS:
        snprintf(name, sizeof name, "%s/rgb/%06ld.png", folders[split], number);
        break;
    default:
        snprintf(name, sizeof name, "images/image%06ld.png", view);
    }
    char *copy = strdup(name);
    LF_REQUIRE(copy, "out of memory");
    return copy;
}

static lf_status write_pictures(const lf_scene *scene, lf_scene_layout layout, const char *folder,
                                char **name, lf_error *err)
{
    long number[LF_SPLITS] = {0};
    for (long v = 0; v < scene->views; v++) {
        char path[PATH_MAX], pose[64];
        const lf_scene_split split = scene->view[v].split;
        name[v] = picture_name(layout, split, v, number[split]++);
        LF_TRY(make_way(folder, name[v], err));
        if (layout == LF_LAYOUT_DEEPVOXELS) {
            snprintf(pose, sizeof pose, "%.*s/pose/x", (int)(strchr(name[v], '/') - name[v]),
                     name[v]);
            LF_TRY(make_way(folder, pose, err));
        }
        LF_TRY(write_picture(scene, v, lf_join(path, folder, name[v]), err));
    }
    return LF_OK;
}

static lf_status write_poses(const lf_scene *scene, lf_scene_layout layout, const char *folder,
                             char **name, lf_error *err)
{
    switch (layout) {
    case LF_LAYOUT_NERF_SYNTHETIC:
        return lf_write_json(scene, true, folder, name, err);
    case LF_LAYOUT_TRANSFORMS:
        return lf_write_json(scene, false, folder, name, err);
    case LF_LAYOUT_LLFF:
        return lf_write_llff(scene, folder, err);
    case LF_LAYOUT_DEEPVOXELS:
        return lf_write_deepvoxels(scene, folder, name, err);
    case LF_LAYOUT_COLMAP_TEXT:
        return lf_write_colmap(scene, false, folder, name, err);
    default:
        return lf_write_colmap(scene, true, folder, name, err);
    }
}

lf_status lf_scene_write(const lf_scene *scene, lf_scene_layout layout, const char *folder,
                         lf_error *err)
{
    LF_REQUIRE(layout >= 0 && layout < LF_LAYOUTS, "layout %d", (int)layout);
    LF_TRY(check_scene(scene, layout, err));
    LF_TRY(make_empty(folder, err));
    char **name = calloc((size_t)scene->views, sizeof *name);
    LF_REQUIRE(name, "out of memory");
    lf_status status = write_pictures(scene, layout, folder, name, err);
    if (status == LF_OK)
        status = write_poses(scene, layout, folder, name, err);
    for (long v = 0; v < scene->views; v++)
        free(name[v]);
    free(name);
    return status;
}

/* ---- JSON --------------------------------------------------------------------------------- */

static json_t *matrix_of(const lf_camera *camera)
{
    double pose[16];
    json_t *rows = json_array();
    lf_pose_of(camera, LF_AXES_GL, pose);
    for (int i = 0; i < 4; i++) {
        json_t *row = json_array();
        for (int j = 0; j < 4; j++)
            json_array_append_new(row, json_real(pose[4 * i + j]));
        json_array_append_new(rows, row);
    }
    return rows;
}

static json_t *frame_of(const lf_scene_view *v, bool synthetic, const char *name)
{
    const lf_camera *c = &v->camera;
    char text[160];
    /* NeRF-Synthetic names its pictures without the ending */
    snprintf(text, sizeof text, "%s%.*s", synthetic ? "./" : "",
             (int)(strlen(name) - (synthetic ? 4 : 0)), name);
    json_t *frame = json_object();
    json_object_set_new(frame, "file_path", json_string(text));
    if (!synthetic) {
        json_object_set_new(frame, "fl_x", json_real(c->fx));
        json_object_set_new(frame, "fl_y", json_real(c->fy));
        json_object_set_new(frame, "cx", json_real(c->cx + 0.5));
        json_object_set_new(frame, "cy", json_real(c->cy + 0.5));
        json_object_set_new(frame, "w", json_integer(c->width));
        json_object_set_new(frame, "h", json_integer(c->height));
    }
    if (!synthetic || v->near != 2 || v->far != 6) {
        json_object_set_new(frame, "near", json_real(v->near));
        json_object_set_new(frame, "far", json_real(v->far));
    }
    json_object_set_new(frame, "transform_matrix", matrix_of(c));
    return frame;
}

static lf_status dump(json_t *root, const char *path, lf_error *err)
{
    const int failed = json_dump_file(root, path, JSON_INDENT(1) | JSON_REAL_PRECISION(17));
    json_decref(root);
    if (failed)
        return lf_fail(err, LF_FAILED, "%s: cannot be written: %s", path, strerror(errno));
    return LF_OK;
}

static lf_status write_synthetic(const lf_scene *scene, lf_scene_split split, const char *folder,
                                 char **name, lf_error *err)
{
    char path[PATH_MAX], base[64];
    const lf_camera *c = &scene->view[0].camera;
    json_t *root = json_object(), *frames = json_array();
    json_object_set_new(root, "camera_angle_x", json_real(2 * atan(0.5 * c->width / c->fx)));
    for (long v = 0; v < scene->views; v++)
        if (scene->view[v].split == split)
            json_array_append_new(frames, frame_of(&scene->view[v], true, name[v]));
    json_object_set_new(root, "frames", frames);
    snprintf(base, sizeof base, "transforms_%s.json", lf_scene_split_name(split));
    return dump(root, lf_join(path, folder, base), err);
}

static lf_status write_transforms(const lf_scene *scene, const char *folder, char **name,
                                  lf_error *err)
{
    static const char *const keys[] = {"train_filenames", "val_filenames", "test_filenames"};
    char path[PATH_MAX];
    json_t *root = json_object(), *frames = json_array(), *list[LF_SPLITS];
    json_object_set_new(root, "camera_model", json_string("PINHOLE"));
    for (int s = 0; s < LF_SPLITS; s++)
        list[s] = json_array();
    for (long v = 0; v < scene->views; v++) {
        json_array_append_new(frames, frame_of(&scene->view[v], false, name[v]));
        json_array_append_new(list[scene->view[v].split], json_string(name[v]));
    }
    json_object_set_new(root, "frames", frames);
    for (int s = 0; s < LF_SPLITS; s++)
        json_object_set_new(root, keys[s], list[s]);
    return dump(root, lf_join(path, folder, "transforms.json"), err);
}

lf_status lf_write_json(const lf_scene *scene, bool splits, const char *folder, char **name,
                        lf_error *err)
{
    if (!splits)
        return write_transforms(scene, folder, name, err);
    for (int s = 0; s < LF_SPLITS; s++)
        LF_TRY(write_synthetic(scene, (lf_scene_split)s, folder, name, err));
    return LF_OK;
}
