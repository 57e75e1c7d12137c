/* scene.c: the scene type: opening by layout, frames to views, splits, depths. */
#include "datasets/scene_internal.h"

static const struct {
    const char *name, *files;
    bool (*is)(const char *path);
    lf_status (*read)(lf_scene_reader *reader, const char *path, lf_error *err);
} readers[] = {
    {"NeRF-Synthetic", "transforms_train.json", lf_is_nerf_synthetic, lf_read_nerf_synthetic},
    {"LLFF", "poses_bounds.npy", lf_is_llff, lf_read_llff},
    {"transforms.json", "transforms.json", lf_is_transforms, lf_read_transforms},
    {"DeepVoxels", "intrinsics.txt with pose/ (also in train/, or ../train/<name>)",
     lf_is_deepvoxels, lf_read_deepvoxels},
    {"COLMAP", "cameras.txt or .bin (also in sparse/0/ or sparse/)", lf_is_colmap, lf_read_colmap},
};
enum { READERS = sizeof readers / sizeof *readers };

const char *lf_scene_layout_name(lf_scene_layout layout)
{
    static const char *const names[] = {"NeRF-Synthetic", "LLFF",          "transforms.json",
                                        "DeepVoxels",     "COLMAP (text)", "COLMAP (binary)",
                                        "made in memory"};
    return names[layout];
}

const char *lf_scene_split_name(lf_scene_split split)
{
    static const char *const names[] = {"train", "val", "test"};
    return names[split];
}

const char *lf_scene_depths_name(lf_scene_depths depths)
{
    static const char *const names[] = {"from the files", "usual for the layout",
                                        "from the points that each view sees",
                                        "guessed from where the cameras look", "given"};
    return names[depths];
}

lf_scene_options lf_scene_defaults(void)
{
    return (lf_scene_options){1, 8, 0, 0, (size_t)512 << 20};
}

long lf_scene_count(const lf_scene *scene, lf_scene_split split)
{
    long n = 0;
    for (long i = 0; i < scene->views; i++)
        n += scene->view[i].split == split;
    return n;
}

static lf_scene *create(const char *folder, size_t bytes)
{
    lf_scene *scene = calloc(1, sizeof *scene);
    LF_REQUIRE(scene, "out of memory");
    scene->layout = LF_LAYOUT_NONE;
    scene->folder = strdup(folder);
    scene->reprojection = NAN;
    scene->pictures = lf_pictures_create(bytes);
    return scene;
}

lf_scene *lf_scene_create(const char *name)
{
    return create(name, 0);
}

void lf_scene_close(lf_scene *scene)
{
    if (!scene)
        return;
    lf_pictures_free(scene->pictures, scene->views);
    for (long i = 0; i < scene->views; i++) {
        free(scene->view[i].name);
        free(scene->view[i].path);
    }
    for (long i = 0; i < scene->left; i++) {
        free(scene->left_out[i].name);
        free(scene->left_out[i].reason);
    }
    free(scene->view);
    free(scene->left_out);
    free(scene->point);
    free(scene->folder);
    free(scene);
}

void lf_scene_leave_out(lf_scene *scene, const char *name, const char *reason, ...)
{
    char text[512];
    va_list args;
    va_start(args, reason);
    vsnprintf(text, sizeof text, reason, args);
    va_end(args);
    scene->left_out = realloc(scene->left_out, (size_t)(scene->left + 1) * sizeof *scene->left_out);
    LF_REQUIRE(scene->left_out, "out of memory");
    scene->left_out[scene->left++] = (lf_left_out){strdup(name), strdup(text)};
}

void lf_scene_append(lf_scene *scene, const char *name, const char *path, const lf_scene_view *view)
{
    scene->view = realloc(scene->view, (size_t)(scene->views + 1) * sizeof *scene->view);
    LF_REQUIRE(scene->view, "out of memory");
    scene->view[scene->views] = *view;
    scene->view[scene->views].name = strdup(name);
    scene->view[scene->views].path = path ? strdup(path) : NULL;
    LF_REQUIRE(scene->view[scene->views].name, "out of memory");
    scene->views++;
}

void lf_scene_add(lf_scene *scene, const char *name, const lf_camera *camera, double near,
                  double far, lf_scene_split split, const uint8_t *rgb, const uint8_t *alpha)
{
    lf_error err;
    LF_REQUIRE(lf_camera_check(camera, name, &err) == LF_OK, "%s", err.text);
    LF_REQUIRE(near >= 0 && near < far, "%s: near %g, far %g", name, near, far);
    const size_t pixels = (size_t)camera->width * (size_t)camera->height;
    uint8_t *colours = malloc(3 * pixels), *alphas = alpha ? malloc(pixels) : NULL;
    LF_REQUIRE(colours && (alphas || !alpha), "no memory for %zu pixels", pixels);
    memcpy(colours, rgb, 3 * pixels);
    if (alpha)
        memcpy(alphas, alpha, pixels);
    lf_scene_append(scene, name, NULL,
                    &(lf_scene_view){NULL, NULL, *camera, near, far, alpha != NULL, split});
    lf_pictures_append(scene, 1);
    lf_pictures_give(scene, scene->views - 1, colours, alphas);
}

/* ---- after the frames --------------------------------------------------------------------- */

/* Views whose file says no depths: from where the cameras look. */
static void guess_depths(lf_scene *scene)
{
    double focus[3];
    lf_scene_focus(scene, focus);
    for (long i = 0; i < scene->views; i++) {
        lf_scene_view *v = &scene->view[i];
        double depth = 0;
        if (v->far > 0)
            continue;
        for (int k = 0; k < 3; k++)
            depth += v->camera.rotation[3 * k + 2] * (focus[k] - v->camera.centre[k]);
        if (!(depth > 0))
            depth = 1;
        v->near = 0.2 * depth;
        v->far = 5 * depth;
        scene->depths = LF_DEPTHS_GUESSED;
    }
}

static lf_status finish(lf_scene_reader *r, const char *path, lf_error *err)
{
    lf_scene *scene = r->scene;
    if (scene->views == 0)
        return lf_fail(err, LF_BAD_INPUT, "%s: no view could be read%s%s%s%s", path,
                       scene->left ? "; the first left out is " : "",
                       scene->left ? scene->left_out[0].name : "", scene->left ? ": " : "",
                       scene->left ? scene->left_out[0].reason : "");
    for (long i = 0; i < scene->views; i++) {
        lf_scene_view *v = &scene->view[i];
        if (!r->has_split)
            v->split = r->options->hold_out > 0 && i % r->options->hold_out == 0 ? LF_SPLIT_TEST
                                                                                 : LF_SPLIT_TRAIN;
        if (r->options->far > 0) {
            v->near = r->options->near;
            v->far = r->options->far;
            scene->depths = LF_DEPTHS_GIVEN;
        }
    }
    guess_depths(scene);
    return LF_OK;
}

static lf_status check_options(const lf_scene_options *o, lf_error *err)
{
    if (o->factor < 1 || o->factor > LF_FACTOR_MAX)
        return lf_fail(err, LF_BAD_INPUT, "factor %d: pictures are reduced 1 to %d times",
                       o->factor, (int)LF_FACTOR_MAX);
    if (o->hold_out < 0)
        return lf_fail(err, LF_BAD_INPUT, "hold_out %d: give 0 (none) or every how many views",
                       o->hold_out);
    if ((o->far != 0 || o->near != 0) && !(o->near >= 0 && o->near < o->far && isfinite(o->far)))
        return lf_fail(err, LF_BAD_INPUT, "near %g and far %g: 0 <= near < far is needed", o->near,
                       o->far);
    return LF_OK;
}

/* `what` says what the path is not. */
static lf_status no_layout(const char *path, const char *what, lf_error *err)
{
    char text[768] = "";
    for (size_t i = 0; i < READERS; i++) {
        const size_t used = strlen(text);
        snprintf(text + used, sizeof text - used, "%s%s: %s", i ? "; " : "", readers[i].name,
                 readers[i].files);
    }
    return lf_fail(err, LF_BAD_INPUT, "%.200s: %s: none of these files is there: %s", path, what,
                   text);
}

/* The number of the reader whose layout fits, or of readers: none. */
static size_t reader_of(const char *path)
{
    size_t i = 0;
    while (i < READERS && !readers[i].is(path))
        i++;
    return i;
}

/* Without slashes at the end. */
static lf_status plain_path(const char *path, char out[PATH_MAX], lf_error *err)
{
    size_t n = strlen(path);
    while (n > 1 && path[n - 1] == '/')
        n--;
    if (n >= PATH_MAX || n == 0)
        return lf_fail(err, LF_BAD_INPUT, "the path of the scene is empty or too long");
    memcpy(out, path, n);
    out[n] = 0;
    return LF_OK;
}

lf_status lf_scene_open(const char *path, const lf_scene_options *options, lf_scene **out,
                        lf_error *err)
{
    char folder[PATH_MAX];
    LF_TRY(check_options(options, err));
    LF_TRY(plain_path(path, folder, err));
    const size_t i = reader_of(folder);
    if (i == READERS)
        return no_layout(folder, "is no scene", err);
    lf_scene_reader reader = {create(folder, options->cache_bytes), options, false};
    lf_status status = readers[i].read(&reader, folder, err);
    if (status == LF_OK)
        status = finish(&reader, folder, err);
    if (status == LF_OK)
        *out = reader.scene;
    else
        lf_scene_close(reader.scene);
    return status;
}

/* ---- several scenes ----------------------------------------------------------------------- */

lf_status lf_scene_folders(const char *path, long *count, char ***folders, lf_error *err)
{
    static const char *const any[] = {"", NULL};
    char root[PATH_MAX], folder[PATH_MAX];
    LF_TRY(plain_path(path, root, err));
    const bool one = reader_of(root) < READERS;
    lf_names names = {0};
    if (!one)
        names = lf_names_list(root, any);
    char **found = calloc((size_t)names.count + 1, sizeof *found);
    LF_REQUIRE(found, "out of memory");
    long n = 0;
    if (one)
        found[n++] = strdup(root);
    for (long i = 0; i < names.count; i++) {
        lf_join(folder, root, names.name[i]);
        if (lf_is_folder(folder) && reader_of(folder) < READERS)
            found[n++] = strdup(folder);
    }
    lf_names_free(&names);
    for (long i = 0; i < n; i++)
        LF_REQUIRE(found[i], "out of memory");
    if (n == 0) {
        free(found);
        return no_layout(root, "is no scene and no folder in it is one", err);
    }
    *count = n;
    *folders = found;
    return LF_OK;
}

void lf_scene_folders_free(long count, char **folders)
{
    for (long i = 0; i < count; i++)
        free(folders[i]);
    free(folders);
}
