/* camera_path.h: cameras along a closed path through a scene, for a video.
 *
 * Let the scene have cameras (R_i, c_i) with columns right, down, forward, and f be the focus.
 * Orbit, for objects seen from around: a circle about the axis a, of length 1 and along the
 * minimiser of mean (a . right_i)^2 + 0.001 |a - u|^2, u the direction of minus the mean of the
 * downs: the mean up, but across all rights where no camera is rolled. With
 *   o_i = c_i - f,  elevation e_i = atan2(o_i . a, |o_i - (o_i . a) a|)
 * its cameras stand at f + d (cos e (cos p h + sin p a x h) + sin e a), d the mean of |o_i|, e that
 * of e_i, p = 2 pi k / frames, and look at f, a up. h is the direction of the mean of o_i across a:
 * the first frame stands where the cameras stand on average. Where they stand all around, so that
 * it vanishes (below 1e-6 d), h is that of the first o_i that has one.
 * Spiral, for cameras that face forward [Mildenhall et al. 2019, LLFF]: with the mean pose M (mean
 * centre m, forward the mean of the forwards, right across it and the mean of the downs) and r the
 * 0.9 quantile of |M'(c_i - m)| for each axis, linear between order statistics, times 0.7,
 *   c(p) = m + M (r_x cos p, r_y sin p, r_z sin(p / 2)),   p = 4 pi k / frames,
 * looking at m + z forward, z = (f - m) . forward, the mean's down down. The quantile and 0.7 keep
 * it among the cameras.
 *
 * Size and intrinsics are those of the scene's camera with the median focal length fx (the lower of
 * two). A motion of all cameras and of f moves the path with them.
 */
#ifndef LF_DATASETS_CAMERA_PATH_H
#define LF_DATASETS_CAMERA_PATH_H

#include "datasets/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum lf_path_kind { LF_PATH_SPIRAL, LF_PATH_ORBIT, LF_PATHS } lf_path_kind;
/* "spiral", "orbit". */
const char *lf_path_kind_name(lf_path_kind kind);
/* The other way round. LF_BAD_INPUT names both. */
lf_status lf_path_kind_parse(const char *name, lf_path_kind *out, lf_error *err);

/* out[frames], frames >= 1; `focus` as lf_scene_focus gives it. LF_BAD_INPUT: no cameras, ups or
 * forwards that cancel, all cameras at the focus (orbit), a focus that is not in front (spiral). */
lf_status lf_camera_path(lf_path_kind kind, const lf_scene *scene, const double focus[3],
                         long frames, lf_camera *out, lf_error *err);

/* The line for a POSIX shell that makes <folder>/video.mp4 of <folder>/frame-0000.png and on, with
 * ffmpeg, H.264. Returns its length; where that is not below `size`, `line` is empty. */
size_t lf_camera_path_ffmpeg(char *line, size_t size, const char *folder, int fps);

#ifdef __cplusplus
}
#endif
#endif
