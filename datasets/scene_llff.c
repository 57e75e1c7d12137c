/* scene_llff.c: poses_bounds.npy beside images/.
 *
 * One row a picture, in the order of the sorted file names: a 3x5 matrix, row major, then near and
 * far. Its columns, all in the world: down, right, backward, centre, (height, width, focal). The
 * principal point is the middle of the picture: (W/2, H/2) with the first pixel's centre at
 * (0.5, 0.5). With a factor the folder images_<factor> is taken if it is there.
 */
#include "datasets/scene_internal.h"

#include "datasets/npy.h"

enum { ROW = 17 };

bool lf_is_llff(const char *path)
{
    char name[PATH_MAX];
    return lf_is_file(lf_join(name, path, "poses_bounds.npy"));
}

static lf_frame frame_of_row(const double *row)
{
    lf_frame f = {.axes = LF_AXES_CV, .near = row[15], .far = row[16], .fx = row[14]};
    for (int i = 0; i < 3; i++) {
        f.pose[4 * i] = row[5 * i + 1];
        f.pose[4 * i + 1] = row[5 * i];
        f.pose[4 * i + 2] = -row[5 * i + 2];
        f.pose[4 * i + 3] = row[5 * i + 3];
    }
    f.fy = f.fx;
    f.cx = 0.5 * row[9];
    f.cy = 0.5 * row[4];
    return f;
}

static lf_status add_row(lf_scene_reader *reader, const char *file, const char *folder,
                         const char *name, long i, const double *row, int reduced, lf_error *err)
{
    char where[PATH_MAX + 32], path[PATH_MAX];
    lf_frame f = frame_of_row(row);
    snprintf(where, sizeof where, "%s: row %ld", file, i);
    if (!(row[4] >= 1 && row[9] >= 1 && row[4] <= 1e6 && row[9] <= 1e6))
        return lf_fail(err, LF_BAD_INPUT, "%s: height %g and width %g (columns 4 and 9)", where,
                       row[4], row[9]);
    if (!(row[16] > 0))
        return lf_fail(err, LF_BAD_INPUT, "%s: far (column 16) is %g; it must be > 0", where,
                       row[16]);
    f.where = where;
    f.name = name;
    f.path = lf_join(path, folder, name);
    f.width = (int)row[9];
    f.height = (int)row[4];
    f.reduced = reduced;
    return lf_scene_add_frame(reader, &f, err);
}

static lf_status add_rows(lf_scene_reader *reader, const char *file, const lf_npy *npy,
                          const char *folder, const lf_names *names, int reduced, lf_error *err)
{
    if (npy->axes != 2 || npy->shape[1] != ROW)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: the array has %d axes, the last of %ld; N x 17 is needed", file,
                       npy->axes, npy->shape[npy->axes - 1]);
    if (names->count != npy->shape[0])
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: %ld rows, but %ld pictures in %s; each row needs its picture, in the "
                       "order of the names",
                       file, npy->shape[0], names->count, folder);
    for (long i = 0; i < names->count; i++)
        LF_TRY(
            add_row(reader, file, folder, names->name[i], i, npy->value + ROW * i, reduced, err));
    return LF_OK;
}

lf_status lf_read_llff(lf_scene_reader *reader, const char *path, lf_error *err)
{
    char file[PATH_MAX], folder[PATH_MAX], small[32];
    int reduced = reader->options->factor;
    lf_npy npy;
    reader->scene->layout = LF_LAYOUT_LLFF;
    LF_TRY(lf_npy_read(lf_join(file, path, "poses_bounds.npy"), &npy, err));
    snprintf(small, sizeof small, "images_%d", reduced);
    if (reduced == 1 || !lf_is_folder(lf_join(folder, path, small))) {
        lf_join(folder, path, "images");
        reduced = 1;
    }
    lf_names names = lf_names_list(folder, lf_picture_endings);
    const lf_status status = add_rows(reader, file, &npy, folder, &names, reduced, err);
    lf_names_free(&names);
    free(npy.value);
    return status;
}

lf_status lf_write_llff(const lf_scene *scene, const char *folder, lf_error *err)
{
    char path[PATH_MAX];
    const long shape[2] = {scene->views, ROW};
    double *value = calloc((size_t)scene->views, ROW * sizeof *value);
    LF_REQUIRE(value, "out of memory");
    for (long v = 0; v < scene->views; v++) {
        const lf_camera *c = &scene->view[v].camera;
        double *row = value + ROW * v;
        for (int i = 0; i < 3; i++) {
            row[5 * i] = c->rotation[3 * i + 1];
            row[5 * i + 1] = c->rotation[3 * i];
            row[5 * i + 2] = -c->rotation[3 * i + 2];
            row[5 * i + 3] = c->centre[i];
        }
        row[4] = c->height;
        row[9] = c->width;
        row[14] = c->fx;
        row[15] = scene->view[v].near;
        row[16] = scene->view[v].far;
    }
    const lf_status status =
        lf_npy_write(lf_join(path, folder, "poses_bounds.npy"), 2, shape, value, err);
    free(value);
    return status;
}
