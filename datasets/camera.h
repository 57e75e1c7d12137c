/* camera.h: pinhole cameras, rigid motions, projection of points, and the evaluation settings.
 *
 * Everything is double. Conventions (method.md 1.1, 5a.3):
 *   camera axes   x right, y down, z forward (right x down = forward)
 *   rotation      camera to world, 3x3 row major; its columns are right, down, forward
 *   pixels        centres at integers: column 0 ... width-1, row 0 ... height-1
 *   projection    q = R'(p - c),  u = fx q.x / q.z + cx,  v = fy q.y / q.z + cy
 *   pixel ray     from the camera into the scene
 * Nothing here allocates; all functions may be called from any thread.
 */
#ifndef LF_DATASETS_CAMERA_H
#define LF_DATASETS_CAMERA_H

#include <stdbool.h>
#include <stdint.h>

#include "autograd/random.h"
#include "autograd/status.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    LF_CUBE_VIEWS = 8 /* cameras of every setting: the corners of a cube */
};

typedef struct lf_camera {
    double rotation[9];
    double centre[3];
    double fx, fy, cx, cy; /* pixels */
    int width, height;     /* pixels */
} lf_camera;

/* A rigid motion g = (R, t): p -> R p + t. */
typedef struct lf_motion {
    double rotation[9];
    double translation[3];
} lf_motion;

/* ---- rotations and motions ---------------------------------------------------------------- */

void lf_rotation_identity(double r[9]);
/* out = a b. `out` may be a or b. */
void lf_rotation_multiply(const double a[9], const double b[9], double out[9]);
void lf_rotation_transpose(const double a[9], double out[9]);
/* out = r p and out = r' p. `out` may be p. */
void lf_rotation_apply(const double r[9], const double p[3], double out[3]);
void lf_rotation_apply_transposed(const double r[9], const double p[3], double out[3]);
/* Right-handed rotation about axis 0, 1 or 2 by `angle`; multiples of pi/2 are exact. */
void lf_rotation_axis(int axis, double angle, double out[9]);
/* Uniform in SO(3) (a normalised quaternion of four normal numbers). */
void lf_rotation_random(lf_stream *stream, double out[9]);

/* Uniform rotation; translation uniform in the ball of radius `translation`. */
lf_motion lf_motion_random(lf_stream *stream, double translation);
lf_motion lf_motion_inverse(const lf_motion *g);
void lf_motion_apply(const lf_motion *g, const double p[3], double out[3]);

/* ---- cameras ------------------------------------------------------------------------------ */

/* A camera of size x size pixels at `centre` looking at `target`, half field of view (between the
 * centres of the border pixels) `half_angle` radians, +y of the world up in the image (+x where
 * the view is along y). */
lf_camera lf_camera_look_at(const double centre[3], const double target[3], double half_angle,
                            int size);
/* The eight corners of a cube at distance 2.5 from the origin, looking at it, half field of view
 * 12 degrees: an object of box diagonal 1 fits under every roll. View v has the signs of its bits:
 * bit 0 x, bit 1 y, bit 2 z, set = positive. */
void lf_camera_cube(int size, lf_camera out[LF_CUBE_VIEWS]);
/* Rolled about the optical axis: rotation * R_z(angle). */
lf_camera lf_camera_roll(const lf_camera *camera, double angle);
/* The camera moved with the frame: (R rotation, R centre + t). */
lf_camera lf_camera_move(const lf_camera *camera, const lf_motion *g);
/* Mean of the camera centres; subtract it from cameras and points before computing in float
 * (method.md 4.5). */
void lf_camera_mean_centre(int n, const lf_camera *camera, double out[3]);
void lf_camera_recentre(int n, lf_camera *camera, const double origin[3]);

/* Refuses a camera that cannot be used: rotation not orthonormal with determinant 1 (to 1e-6),
 * focal length or size not positive, anything not finite. `name` starts the message. */
lf_status lf_camera_check(const lf_camera *camera, const char *name, lf_error *err);

/* Pixel coordinates and depth (camera z) of a point; false where the depth is below `near` and uv
 * is not written. Points beside the image are projected too. */
bool lf_camera_project(const lf_camera *camera, const double point[3], double near, double uv[2],
                       double *depth);
/* Unit direction of the ray through pixel coordinates (u, v). */
void lf_camera_ray(const lf_camera *camera, double u, double v, double direction[3]);

/* The rays from `views` cameras through `points` query points (method.md 5a.3, 4.4). For point q
 * and view k, at index q * views + k:
 *
 *   uv        [Q,V,2]  pixel coordinates; clamped into the image where masked, so always safe to
 *                      read
 *   direction [Q,V,3]  (p - c)/|p - c|; zero where p is the camera centre (|p - c| < 1e-9)
 *   distance  [Q,V]    |p - c|
 *   mask      [Q,V]    1 where depth > near, 0 <= u <= width-1, 0 <= v <= height-1 and the
 *                      direction exists; else 0
 *
 * Any output may be NULL. A point that is not finite is masked in every view. */
void lf_project_points(int views, const lf_camera *camera, long points, const double (*point)[3],
                       double near, double *uv, double *direction, double *distance, uint8_t *mask);

/* ---- settings ----------------------------------------------------------------------------- */

/* method.md 5a.8. The light does not turn with a roll and does not turn with the object. */
typedef enum lf_setting {
    LF_SETTING_I,   /* nothing is moved */
    LF_SETTING_Z,   /* every view rolled by its own angle, uniform in (-pi, pi] */
    LF_SETTING_R,   /* every view looks at its own point, uniform in the ball of 0.1 object radius
                       (0.05) round the centre, then its own roll */
    LF_SETTING_Y,   /* the object turned about y by one uniform angle */
    LF_SETTING_SO3, /* the object turned by one uniform rotation */
    LF_SETTINGS
} lf_setting;

/* "I", "Z", "R", "Y", "SO3"; the parser takes "SO(3)" and lower case as well. */
const char *lf_setting_name(lf_setting setting);
lf_status lf_setting_parse(const char *name, lf_setting *out, lf_error *err);

/* Cameras and rotation of the object of one draw: a pure function of its arguments. The object's
 * points are at object * p in the frame of the cameras. */
void lf_setting_draw(lf_setting setting, int size, uint64_t seed, uint64_t draw, uint64_t item,
                     lf_camera camera[LF_CUBE_VIEWS], double object[9]);

#ifdef __cplusplus
}
#endif
#endif
