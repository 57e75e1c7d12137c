/* scene_frame.c: a frame as a file has it becomes a view in elf's conventions, or is refused. */
#include "datasets/scene_internal.h"

#include "datasets/image.h"

/* The largest entry of |R'R - 1|. */
static double not_orthonormal(const double r[9])
{
    double worst = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const double dot = r[i] * r[j] + r[3 + i] * r[3 + j] + r[6 + i] * r[6 + j];
            worst = fmax(worst, fabs(dot - (i == j)));
        }
    return worst;
}

double lf_determinant(const double r[9])
{
    return r[0] * (r[4] * r[8] - r[5] * r[7]) - r[1] * (r[3] * r[8] - r[5] * r[6]) +
           r[2] * (r[3] * r[7] - r[4] * r[6]);
}

/* The nearest rotation, by Newton's steps R <- R (3 - R'R) / 2: files keep 4 to 17 digits. */
static void make_orthonormal(double r[9])
{
    for (int step = 0; step < 4; step++) {
        double t[9], c[9];
        lf_rotation_transpose(r, t);
        lf_rotation_multiply(t, r, c);
        for (int i = 0; i < 9; i++)
            c[i] = (i % 4 == 0) * 1.5 - 0.5 * c[i];
        lf_rotation_multiply(r, c, r);
    }
}

static lf_status read_rotation(const lf_frame *f, lf_camera *camera, lf_error *err)
{
    const double sign = f->axes == LF_AXES_GL ? -1 : 1;
    for (int i = 0; i < 12; i++)
        if (!isfinite(f->pose[i]))
            return lf_fail(err, LF_BAD_INPUT, "%s: the pose holds a number that is not finite",
                           f->where);
    for (int i = 0; i < 3; i++) {
        camera->rotation[3 * i] = f->pose[4 * i];
        camera->rotation[3 * i + 1] = sign * f->pose[4 * i + 1];
        camera->rotation[3 * i + 2] = sign * f->pose[4 * i + 2];
        camera->centre[i] = f->pose[4 * i + 3];
    }
    const double det = lf_determinant(camera->rotation), off = not_orthonormal(camera->rotation);
    if (!(off <= 1e-3) || det < 0)
        return lf_fail(
            err, LF_BAD_INPUT,
            "%s: the pose is no rotation: det R = %.6g, |R'R - 1| = %.3g; it must be 1 and 0 (to "
            "1e-3). %s",
            f->where, det, off,
            off <= 1e-3 ? "One axis is mirrored: negate it"
                        : "Take scale and shear out of the matrix and scale the centre instead");
    make_orthonormal(camera->rotation);
    return LF_OK;
}

/* Centres move with the size: u' + 1/2 = (u + 1/2) s. */
static void scale_camera(lf_camera *c, double sx, double sy, int width, int height)
{
    c->fx *= sx;
    c->fy *= sy;
    c->cx = (c->cx + 0.5) * sx - 0.5;
    c->cy = (c->cy + 0.5) * sy - 0.5;
    c->width = width;
    c->height = height;
}

static lf_status fit_picture(const lf_frame *f, int factor, lf_camera *c, int width, int height,
                             lf_error *err)
{
    const double wide = (double)f->width / f->reduced, high = (double)f->height / f->reduced;
    const double slack = f->reduced > 1 ? 1 : 0;
    if (fabs(width - wide) > slack || fabs(height - high) > slack)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: the picture %s is %d x %d pixels, the intrinsics belong to %g x %g; "
                       "resize one to the other",
                       f->where, f->path, width, height, wide, high);
    scale_camera(c, (double)width / f->width, (double)height / f->height, width, height);
    if (width < factor || height < factor)
        return lf_fail(err, LF_BAD_INPUT, "%s: %d x %d pixels cannot be reduced %d times", f->path,
                       width, height, factor);
    scale_camera(c, 1.0 / factor, 1.0 / factor, width / factor, height / factor);
    return LF_OK;
}

static lf_status check_intrinsics(const lf_frame *f, lf_error *err)
{
    if (!(f->fx > 0 && f->fy > 0 && isfinite(f->fx) && isfinite(f->fy)))
        return lf_fail(err, LF_BAD_INPUT, "%s: the focal lengths are %g and %g; both must be > 0",
                       f->where, f->fx, f->fy);
    if (!isfinite(f->cx) || !isfinite(f->cy))
        return lf_fail(err, LF_BAD_INPUT, "%s: the principal point is %g, %g", f->where, f->cx,
                       f->cy);
    if (f->width < 1 || f->height < 1)
        return lf_fail(err, LF_BAD_INPUT, "%s: the size is %d x %d pixels", f->where, f->width,
                       f->height);
    if (f->far != 0 && !(f->near >= 0 && f->near < f->far && isfinite(f->far)))
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: near %g and far %g; 0 <= near < far is needed (depths along the "
                       "camera's axis)",
                       f->where, f->near, f->far);
    return LF_OK;
}

lf_status lf_scene_add_frame(lf_scene_reader *reader, const lf_frame *f, lf_error *err)
{
    lf_scene *scene = reader->scene;
    const int factor = f->reduced > 1 ? 1 : reader->options->factor;
    int width, height, channels;
    lf_camera c = {.fx = f->fx, .fy = f->fy, .cx = f->cx - 0.5, .cy = f->cy - 0.5};
    for (long i = 0; i < scene->views; i++)
        if (strcmp(scene->view[i].name, f->name) == 0)
            return lf_fail(err, LF_BAD_INPUT, "%s: the frame %s is there twice", f->where, f->name);
    LF_TRY(check_intrinsics(f, err));
    LF_TRY(read_rotation(f, &c, err));
    lf_status status = lf_image_read_size(f->path, &width, &height, &channels, err);
    if (status != LF_OK)
        return lf_error_context(err, status, "%s", f->where);
    LF_TRY(fit_picture(f, factor, &c, width, height, err));
    LF_TRY(lf_camera_check(&c, f->where, err));
    lf_scene_append(scene, f->name, f->path,
                    &(lf_scene_view){NULL, NULL, c, f->near, f->far, channels % 2 == 0, f->split});
    lf_pictures_append(scene, factor);
    return LF_OK;
}
