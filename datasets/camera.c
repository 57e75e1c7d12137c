/* camera.c: rotations, rigid motions, pinhole cameras, rays through points.
 * Conventions in camera.h; method.md 1.1, 4.4, 4.5, 5a.3. */
#include "datasets/camera.h"

#include <math.h>
#include <string.h>
#include <strings.h>

static const double pi = 3.14159265358979323846;

/* ---- rotations and motions ---------------------------------------------------------------- */

void lf_rotation_identity(double r[9])
{
    for (int i = 0; i < 9; i++)
        r[i] = i % 4 == 0;
}

void lf_rotation_multiply(const double a[9], const double b[9], double out[9])
{
    double c[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            c[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
    memcpy(out, c, sizeof c);
}

void lf_rotation_transpose(const double a[9], double out[9])
{
    double c[9];
    for (int i = 0; i < 9; i++)
        c[i] = a[3 * (i % 3) + i / 3];
    memcpy(out, c, sizeof c);
}

void lf_rotation_apply(const double r[9], const double p[3], double out[3])
{
    const double x = p[0], y = p[1], z = p[2];
    for (int i = 0; i < 3; i++)
        out[i] = r[3 * i] * x + r[3 * i + 1] * y + r[3 * i + 2] * z;
}

void lf_rotation_apply_transposed(const double r[9], const double p[3], double out[3])
{
    const double x = p[0], y = p[1], z = p[2];
    for (int i = 0; i < 3; i++)
        out[i] = r[i] * x + r[3 + i] * y + r[6 + i] * z;
}

/* cos and sin, exact at multiples of pi/2 (as far as the angle itself names them in double). */
static void exact_cos_sin(double angle, double *c, double *s)
{
    static const double table[4][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}};
    const double quarter = angle / (pi / 2), nearest = round(quarter);
    if (fabs(quarter - nearest) < 1e-15 * (1 + fabs(nearest))) {
        const int k = (int)(nearest - 4 * floor(nearest / 4));
        *c = table[k][0];
        *s = table[k][1];
    } else {
        *c = cos(angle);
        *s = sin(angle);
    }
}

void lf_rotation_axis(int axis, double angle, double out[9])
{
    LF_REQUIRE(axis >= 0 && axis < 3, "lf_rotation_axis: axis %d, must be 0, 1 or 2", axis);
    const int i = (axis + 1) % 3, j = (axis + 2) % 3;
    double c, s;
    exact_cos_sin(angle, &c, &s);
    lf_rotation_identity(out);
    out[3 * i + i] = c;
    out[3 * j + j] = c;
    out[3 * i + j] = -s;
    out[3 * j + i] = s;
}

void lf_rotation_random(lf_stream *stream, double out[9])
{
    double q[4], n = 0;
    for (int i = 0; i < 4; i++) {
        q[i] = lf_normal(stream);
        n += q[i] * q[i];
    }
    n = sqrt(n); /* zero with probability 2^-120 */
    const double w = q[0] / n, x = q[1] / n, y = q[2] / n, z = q[3] / n;
    const double r[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                         2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                         2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
    memcpy(out, r, sizeof r);
}

/* Uniform in the ball: a normal direction and the cube root of a uniform number. */
static void random_in_ball(lf_stream *stream, double radius, double out[3])
{
    double n = 0;
    for (int i = 0; i < 3; i++) {
        out[i] = lf_normal(stream);
        n += out[i] * out[i];
    }
    const double scale = radius * cbrt(lf_uniform(stream)) / sqrt(n);
    for (int i = 0; i < 3; i++)
        out[i] *= scale;
}

lf_motion lf_motion_random(lf_stream *stream, double translation)
{
    lf_motion g;
    lf_rotation_random(stream, g.rotation);
    random_in_ball(stream, translation, g.translation);
    return g;
}

lf_motion lf_motion_inverse(const lf_motion *g)
{
    lf_motion inverse;
    lf_rotation_transpose(g->rotation, inverse.rotation);
    lf_rotation_apply(inverse.rotation, g->translation, inverse.translation);
    for (int i = 0; i < 3; i++)
        inverse.translation[i] = -inverse.translation[i];
    return inverse;
}

void lf_motion_apply(const lf_motion *g, const double p[3], double out[3])
{
    lf_rotation_apply(g->rotation, p, out);
    for (int i = 0; i < 3; i++)
        out[i] += g->translation[i];
}

/* ---- cameras ------------------------------------------------------------------------------ */

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double normalise(double a[3])
{
    const double n = sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    if (n > 0)
        for (int i = 0; i < 3; i++)
            a[i] /= n;
    return n;
}

lf_camera lf_camera_look_at(const double centre[3], const double target[3], double half_angle,
                            int size)
{
    LF_REQUIRE(size >= 2, "lf_camera_look_at: size %d, at least 2 pixels", size);
    double right[3], down[3], forward[3];
    for (int i = 0; i < 3; i++)
        forward[i] = target[i] - centre[i];
    LF_REQUIRE(normalise(forward) > 0, "lf_camera_look_at: target is the camera centre");
    cross(forward, (const double[3]){0, 1, 0}, right);
    if (normalise(right) < 1e-6) {
        cross(forward, (const double[3]){1, 0, 0}, right);
        normalise(right);
    }
    cross(forward, right, down);

    const double middle = (size - 1) / 2.0, focal = middle / tan(half_angle);
    lf_camera camera = {
        .fx = focal, .fy = focal, .cx = middle, .cy = middle, .width = size, .height = size};
    for (int i = 0; i < 3; i++) {
        camera.centre[i] = centre[i];
        camera.rotation[3 * i] = right[i];
        camera.rotation[3 * i + 1] = down[i];
        camera.rotation[3 * i + 2] = forward[i];
    }
    return camera;
}

lf_camera lf_camera_roll(const lf_camera *camera, double angle)
{
    double roll[9];
    lf_rotation_axis(2, angle, roll);
    lf_camera out = *camera;
    lf_rotation_multiply(camera->rotation, roll, out.rotation);
    return out;
}

lf_camera lf_camera_move(const lf_camera *camera, const lf_motion *g)
{
    lf_camera out = *camera;
    lf_rotation_multiply(g->rotation, camera->rotation, out.rotation);
    lf_motion_apply(g, camera->centre, out.centre);
    return out;
}

void lf_camera_mean_centre(int n, const lf_camera *camera, double out[3])
{
    LF_REQUIRE(n > 0, "lf_camera_mean_centre: %d cameras", n);
    for (int i = 0; i < 3; i++) {
        /* the mean of differences: exact far from the origin as well */
        double sum = 0;
        for (int k = 0; k < n; k++)
            sum += camera[k].centre[i] - camera[0].centre[i];
        out[i] = camera[0].centre[i] + sum / n;
    }
}

void lf_camera_recentre(int n, lf_camera *camera, const double origin[3])
{
    for (int k = 0; k < n; k++)
        for (int i = 0; i < 3; i++)
            camera[k].centre[i] -= origin[i];
}

/* Largest deviation of R'R from the identity, and of the determinant from 1; NAN stays NAN. */
static double rotation_defect(const double r[9])
{
    double t[9], worst = 0, right_x_down[3];
    lf_rotation_transpose(r, t);
    lf_rotation_multiply(t, r, t);
    for (int i = 0; i < 9; i++) {
        const double e = fabs(t[i] - (i % 4 == 0));
        worst = e <= worst ? worst : e;
    }
    cross((const double[3]){r[0], r[3], r[6]}, (const double[3]){r[1], r[4], r[7]}, right_x_down);
    const double det = right_x_down[0] * r[2] + right_x_down[1] * r[5] + right_x_down[2] * r[8];
    return fmax(worst, fabs(det - 1)) + 0 * (worst + det);
}

lf_status lf_camera_check(const lf_camera *camera, const char *name, lf_error *err)
{
    const double defect = rotation_defect(camera->rotation);
    if (!(defect <= 1e-6))
        return lf_fail(
            err, LF_BAD_INPUT,
            "%s: the camera's rotation deviates from a rotation (orthonormal, determinant "
            "1) by %g, allowed is 1e-6; check for a scale, a mirror or swapped axes",
            name, defect);
    for (int i = 0; i < 3; i++)
        if (!isfinite(camera->centre[i]))
            return lf_fail(err, LF_BAD_INPUT, "%s: the camera's centre is not finite", name);
    if (!(camera->fx > 0 && camera->fy > 0 && isfinite(camera->fx) && isfinite(camera->fy)))
        return lf_fail(err, LF_BAD_INPUT, "%s: focal length %g, %g; must be positive and finite",
                       name, camera->fx, camera->fy);
    if (!isfinite(camera->cx) || !isfinite(camera->cy))
        return lf_fail(err, LF_BAD_INPUT, "%s: the principal point is not finite", name);
    if (camera->width < 1 || camera->height < 1 || camera->width > 65536 || camera->height > 65536)
        return lf_fail(err, LF_BAD_INPUT, "%s: image size %d x %d, allowed are 1 ... 65536", name,
                       camera->width, camera->height);
    return LF_OK;
}

bool lf_camera_project(const lf_camera *camera, const double point[3], double near, double uv[2],
                       double *depth)
{
    const double *c = camera->centre;
    double q[3] = {point[0] - c[0], point[1] - c[1], point[2] - c[2]};
    lf_rotation_apply_transposed(camera->rotation, q, q);
    *depth = q[2];
    if (!(q[2] > near && q[2] > 0))
        return false;
    uv[0] = camera->fx * q[0] / q[2] + camera->cx;
    uv[1] = camera->fy * q[1] / q[2] + camera->cy;
    return true;
}

void lf_camera_ray(const lf_camera *camera, double u, double v, double direction[3])
{
    const double q[3] = {(u - camera->cx) / camera->fx, (v - camera->cy) / camera->fy, 1};
    lf_rotation_apply(camera->rotation, q, direction);
    normalise(direction);
}

/* Into [0, high]; what is not a number becomes 0. */
static double clamp(double x, double high)
{
    return x >= 0 ? (x <= high ? x : high) : 0;
}

static void project_one(const lf_camera *camera, const double p[3], double near, double uv[2],
                        double direction[3], double *distance, uint8_t *mask)
{
    const double right = camera->width - 1, bottom = camera->height - 1;
    double depth,
        d[3] = {p[0] - camera->centre[0], p[1] - camera->centre[1], p[2] - camera->centre[2]};
    uv[0] = camera->cx;
    uv[1] = camera->cy;
    bool valid = lf_camera_project(camera, p, near, uv, &depth) && uv[0] >= 0 && uv[0] <= right &&
                 uv[1] >= 0 && uv[1] <= bottom;
    uv[0] = clamp(uv[0], right);
    uv[1] = clamp(uv[1], bottom);
    *distance = normalise(d);
    if (!(*distance >= 1e-9 && isfinite(*distance))) {
        valid = false;
        d[0] = d[1] = d[2] = 0;
        *distance = isfinite(*distance) ? *distance : 0;
    }
    memcpy(direction, d, sizeof d);
    *mask = valid;
}

void lf_project_points(int views, const lf_camera *camera, long points, const double (*point)[3],
                       double near, double *uv, double *direction, double *distance, uint8_t *mask)
{
#pragma omp parallel for schedule(static)
    for (long q = 0; q < points; q++) {
        for (int k = 0; k < views; k++) {
            const long at = q * views + k;
            double pixel[2], d[3], length;
            uint8_t seen;
            project_one(&camera[k], point[q], near, pixel, d, &length, &seen);
            if (uv)
                memcpy(uv + 2 * at, pixel, sizeof pixel);
            if (direction)
                memcpy(direction + 3 * at, d, sizeof d);
            if (distance)
                distance[at] = length;
            if (mask)
                mask[at] = seen;
        }
    }
}

void lf_camera_cube(int size, lf_camera out[LF_CUBE_VIEWS])
{
    const double along = 2.5 / sqrt(3), origin[3] = {0, 0, 0};
    for (int v = 0; v < LF_CUBE_VIEWS; v++) {
        const double centre[3] = {v & 1 ? along : -along, v & 2 ? along : -along,
                                  v & 4 ? along : -along};
        out[v] = lf_camera_look_at(centre, origin, 12 * pi / 180, size);
    }
}

/* ---- settings ----------------------------------------------------------------------------- */

static const char *const setting_names[LF_SETTINGS] = {"I", "Z", "R", "Y", "SO3"};

const char *lf_setting_name(lf_setting setting)
{
    LF_REQUIRE(setting >= 0 && setting < LF_SETTINGS, "lf_setting_name: %d", (int)setting);
    return setting_names[setting];
}

lf_status lf_setting_parse(const char *name, lf_setting *out, lf_error *err)
{
    for (int s = 0; s < LF_SETTINGS; s++)
        if (strcasecmp(name, setting_names[s]) == 0) {
            *out = (lf_setting)s;
            return LF_OK;
        }
    if (strcasecmp(name, "SO(3)") == 0) {
        *out = LF_SETTING_SO3;
        return LF_OK;
    }
    return lf_fail(err, LF_BAD_INPUT, "setting '%s' is unknown; known are I, Z, R, Y and SO3",
                   name);
}

/* Numbers are drawn per view in a fixed order, so Z and R roll every view by its own angle. */
void lf_setting_draw(lf_setting setting, int size, uint64_t seed, uint64_t draw, uint64_t item,
                     lf_camera camera[LF_CUBE_VIEWS], double object[9])
{
    const double look_at_radius = 0.1 * 0.5;
    lf_stream s = lf_stream_at(seed, LF_RANDOM_SETTING, draw, item);
    lf_camera_cube(size, camera);
    lf_rotation_identity(object);
    if (setting == LF_SETTING_Y)
        lf_rotation_axis(1, 2 * pi * lf_uniform(&s), object);
    if (setting == LF_SETTING_SO3)
        lf_rotation_random(&s, object);
    if (setting != LF_SETTING_Z && setting != LF_SETTING_R)
        return;
    for (int v = 0; v < LF_CUBE_VIEWS; v++) {
        if (setting == LF_SETTING_R) {
            double target[3];
            random_in_ball(&s, look_at_radius, target);
            camera[v] = lf_camera_look_at(camera[v].centre, target, 12 * pi / 180, size);
        }
        camera[v] = lf_camera_roll(&camera[v], 2 * pi * lf_uniform(&s) - pi);
    }
}
