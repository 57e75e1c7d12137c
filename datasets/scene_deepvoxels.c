/* scene_deepvoxels.c: intrinsics.txt, pose/%06d.txt and rgb/%06d.png.
 *
 * intrinsics.txt: "f cx cy 0.", grid centre, near plane, scale, "height width", and perhaps 1 if
 * the poses are world to camera. pose: 16 numbers, 4x4 row major, camera to world, x right, y down,
 * z forward. The first pixel's centre lies at (0.5, 0.5). Square pictures of S x S beside other
 * intrinsics are the original data's case: cx S/width, cy S/height, f S/height. near and far are
 * the distance of the camera from the origin -1 and +1, since the object lies in the unit ball.
 *
 * A split is a folder train/, validation/ or test/, with the scene's own folder below it or not.
 */
#include "datasets/scene_internal.h"

#include <errno.h>

#include "datasets/image.h"

static const char *const split_folders[LF_SPLITS] = {"train", "validation", "test"};
static const char *const text_endings[] = {".txt", NULL};

static bool has_scene(const char *folder)
{
    char file[PATH_MAX], pose[PATH_MAX];
    return lf_is_file(lf_join(file, folder, "intrinsics.txt")) &&
           lf_is_folder(lf_join(pose, folder, "pose"));
}

/* The folder of a split: PATH/train, PATH/../train/<name>, or PATH/../../train/<name> where PATH
 * itself lies in the folder of a split. */
static bool find_split(const char *path, int split, char out[PATH_MAX])
{
    const char *name = lf_base_name(path);
    char parent[PATH_MAX], below[PATH_MAX];
    if (has_scene(lf_join(out, path, split_folders[split])))
        return true;
    snprintf(parent, sizeof parent, "%.*s", (int)(name - path), path);
    if (!parent[0])
        snprintf(parent, sizeof parent, "./");
    snprintf(below, sizeof below, "%s/%.200s", split_folders[split], name);
    parent[strlen(parent) - (strlen(parent) > 1)] = 0;
    if (has_scene(lf_join(out, parent, below)))
        return true;
    bool in_split = false;
    for (int s = 0; s < LF_SPLITS; s++)
        in_split = in_split || strcmp(lf_base_name(parent), split_folders[s]) == 0;
    snprintf(below, sizeof below, "../%s/%.200s", split_folders[split], name);
    return in_split && has_scene(lf_join(out, parent, below));
}

bool lf_is_deepvoxels(const char *path)
{
    char folder[PATH_MAX];
    return has_scene(path) || find_split(path, 0, folder);
}

typedef struct intrinsics {
    double f, cx, cy;
    int width, height;
    bool world_to_camera;
} intrinsics;

/* All numbers of a text file, blanks between, at most `most`; *count how many. */
static lf_status read_numbers(const char *path, int most, double *out, int *count, lf_error *err)
{
    FILE *f = fopen(path, "r");
    if (!f)
        return lf_fail(err, LF_BAD_INPUT, "%s: cannot be opened: %s", path, strerror(errno));
    char word[128];
    lf_status status = LF_OK;
    *count = 0;
    while (status == LF_OK && fscanf(f, "%127s", word) == 1) {
        char *end;
        const double x = strtod(word, &end);
        if (*end || *count == most || !isfinite(x))
            status = lf_fail(err, LF_BAD_INPUT,
                             "%s: number %d is '%s'; at most %d finite numbers are expected", path,
                             *count + 1, word, most);
        else
            out[(*count)++] = x;
    }
    fclose(f);
    return status;
}

/* Numbers in reading order: f cx cy 0 | three | near | scale | height width | world to camera. */
static lf_status read_intrinsics(const char *folder, intrinsics *out, lf_error *err)
{
    char path[PATH_MAX];
    double x[12];
    int n;
    lf_join(path, folder, "intrinsics.txt");
    LF_TRY(read_numbers(path, 12, x, &n, err));
    if (n < 11)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: %d numbers; needed are f cx cy 0, the grid's centre (3), near plane, "
                       "scale, height width",
                       path, n);
    if (!(x[0] > 0))
        return lf_fail(err, LF_BAD_INPUT, "%s: line 1: the focal length is %g; it must be > 0",
                       path, x[0]);
    if (!(x[9] >= 1 && x[10] >= 1 && x[9] <= LF_IMAGE_SIZE_MAX && x[10] <= LF_IMAGE_SIZE_MAX))
        return lf_fail(err, LF_BAD_INPUT, "%s: line 5: height %g and width %g", path, x[9], x[10]);
    *out = (intrinsics){x[0], x[1], x[2], (int)x[10], (int)x[9], n == 12 && x[11] != 0};
    return LF_OK;
}

/* (R, t) -> (R', -R't) */
static void invert(double pose[12])
{
    double out[12];
    for (int i = 0; i < 3; i++) {
        out[4 * i + 3] = 0;
        for (int j = 0; j < 3; j++) {
            out[4 * i + j] = pose[4 * j + i];
            out[4 * i + 3] -= pose[4 * j + i] * pose[4 * j + 3];
        }
    }
    memcpy(pose, out, sizeof out);
}

static void set_lens(const intrinsics *in, int width, int height, lf_frame *f)
{
    const bool square = width == height && (width != in->width || height != in->height);
    f->width = square ? width : in->width;
    f->height = square ? height : in->height;
    f->fx = f->fy = square ? in->f * height / in->height : in->f;
    f->cx = square ? in->cx * width / in->width : in->cx;
    f->cy = square ? in->cy * height / in->height : in->cy;
}

static lf_status add_pose(lf_scene_reader *reader, const char *folder, const char *base,
                          const intrinsics *in, lf_scene_split split, lf_error *err)
{
    char pose[PATH_MAX], rgb[PATH_MAX], path[PATH_MAX], name[320];
    double x[16];
    int n, width, height, channels;
    snprintf(name, sizeof name, "%s/%.*s",
             reader->has_split ? split_folders[split] : lf_base_name(folder), (int)strlen(base) - 4,
             base);
    lf_join(pose, lf_join(path, folder, "pose"), base);
    LF_TRY(read_numbers(pose, 16, x, &n, err));
    if (n != 16)
        return lf_fail(err, LF_BAD_INPUT, "%s: %d numbers; a pose has 16", pose, n);
    if (!lf_find_picture(path, lf_join(rgb, folder, "rgb"), lf_base_name(name))) {
        lf_scene_leave_out(reader->scene, name, "%s: there is no such picture", pose);
        return LF_OK;
    }
    LF_TRY(lf_image_read_size(path, &width, &height, &channels, err));
    lf_frame f = {.where = pose, .name = name, .path = path, .reduced = 1, .split = split};
    set_lens(in, width, height, &f);
    memcpy(f.pose, x, sizeof f.pose);
    if (in->world_to_camera)
        invert(f.pose);
    const double distance = hypot(hypot(f.pose[3], f.pose[7]), f.pose[11]);
    f.near = fmax(0, distance - 1);
    f.far = distance + 1;
    return lf_scene_add_frame(reader, &f, err);
}

static lf_status read_split(lf_scene_reader *reader, const char *folder, lf_scene_split split,
                            lf_error *err)
{
    char pose[PATH_MAX], rgb[PATH_MAX];
    intrinsics in = {0};
    LF_TRY(read_intrinsics(folder, &in, err));
    lf_names names = lf_names_list(lf_join(pose, folder, "pose"), text_endings);
    lf_status status = LF_OK;
    for (long i = 0; status == LF_OK && i < names.count; i++)
        status = add_pose(reader, folder, names.name[i], &in, split, err);
    lf_names_free(&names);
    if (status == LF_OK)
        lf_scene_note_orphans(reader->scene, lf_join(rgb, folder, "rgb"));
    return status;
}

lf_status lf_read_deepvoxels(lf_scene_reader *reader, const char *path, lf_error *err)
{
    char folder[PATH_MAX];
    reader->scene->layout = LF_LAYOUT_DEEPVOXELS;
    reader->scene->depths = LF_DEPTHS_USUAL;
    if (!find_split(path, 0, folder))
        return read_split(reader, path, LF_SPLIT_TRAIN, err);
    reader->has_split = true;
    for (int s = 0; s < LF_SPLITS; s++)
        if (find_split(path, s, folder))
            LF_TRY(read_split(reader, folder, (lf_scene_split)s, err));
    return LF_OK;
}

static lf_status write_text(const char *path, const char *text, lf_error *err)
{
    FILE *f = fopen(path, "w");
    if (!f)
        return lf_fail(err, LF_FAILED, "%s: cannot be written: %s", path, strerror(errno));
    const bool written = fputs(text, f) >= 0;
    if (fclose(f) || !written)
        return lf_fail(err, LF_FAILED, "%s: cannot be written: %s", path, strerror(errno));
    return LF_OK;
}

lf_status lf_write_deepvoxels(const lf_scene *scene, const char *folder, char **name, lf_error *err)
{
    char path[PATH_MAX], below[64], text[512];
    const lf_camera *c = &scene->view[0].camera;
    snprintf(text, sizeof text, "%.17g %.17g %.17g 0.\n0. 0. 0.\n1.\n1.\n%d %d\n", c->fx,
             c->cx + 0.5, c->cy + 0.5, c->height, c->width);
    for (int s = 0; s < LF_SPLITS; s++) {
        snprintf(below, sizeof below, "%s/intrinsics.txt", split_folders[s]);
        if (lf_scene_count(scene, (lf_scene_split)s))
            LF_TRY(write_text(lf_join(path, folder, below), text, err));
    }
    for (long v = 0; v < scene->views; v++) {
        double pose[16];
        size_t used = 0;
        lf_pose_of(&scene->view[v].camera, LF_AXES_CV, pose);
        for (int i = 0; i < 16; i++)
            used += (size_t)snprintf(text + used, sizeof text - used, "%.17g%s", pose[i],
                                     i < 15 ? " " : "\n");
        snprintf(below, sizeof below, "%s/pose/%.6s.txt", split_folders[scene->view[v].split],
                 lf_base_name(name[v]));
        LF_TRY(write_text(lf_join(path, folder, below), text, err));
    }
    return LF_OK;
}
