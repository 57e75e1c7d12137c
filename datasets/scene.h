/* scene.h: posed photographs of one scene, from five layouts and back.             docs/scenes.md
 *
 * Cameras are those of camera.h: camera to world, x right, y down, z forward, pixel centres at
 * integers. Where a file puts the centre of the first pixel at (0.5, 0.5), as all five layouts do,
 * half a pixel is taken off cx and cy. near and far are depths along the camera's z axis.
 *
 * Pictures stay on disk and come on demand, 8 bits a channel over white, into a cache that is
 * bounded in bytes. A scene of 100 pictures of 800 x 800 with alpha takes 256 MB when all are held.
 *
 * Ownership: lf_scene_open and lf_scene_create give a scene that the caller closes once;
 *            lf_scene_close(NULL) does nothing. What a scene points to belongs to it.
 * Errors:    LF_BAD_INPUT with file and key or line; outputs untouched.
 * Threads:   lf_scene_hold and lf_scene_release from any thread; the rest from one at a time.
 */
#ifndef LF_DATASETS_SCENE_H
#define LF_DATASETS_SCENE_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "autograd/status.h"
#include "datasets/camera.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum lf_scene_layout {
    LF_LAYOUT_NERF_SYNTHETIC, /* transforms_{train,val,test}.json */
    LF_LAYOUT_LLFF,           /* poses_bounds.npy, images/ */
    LF_LAYOUT_TRANSFORMS,     /* transforms.json of instant-ngp and nerfstudio */
    LF_LAYOUT_DEEPVOXELS,     /* intrinsics.txt, pose/, rgb/ */
    LF_LAYOUT_COLMAP_TEXT,    /* cameras.txt, images.txt, points3D.txt, images/ */
    LF_LAYOUT_COLMAP_BINARY,  /* the same as .bin */
    LF_LAYOUTS,
    LF_LAYOUT_NONE = LF_LAYOUTS /* made by lf_scene_create */
} lf_scene_layout;

typedef enum lf_scene_split {
    LF_SPLIT_TRAIN,
    LF_SPLIT_VAL,
    LF_SPLIT_TEST,
    LF_SPLITS
} lf_scene_split;

/* Where near and far come from. */
typedef enum lf_scene_depths {
    LF_DEPTHS_FILE,    /* the scene's files say them */
    LF_DEPTHS_USUAL,   /* what everybody uses with the layout: 2, 6; distance -1, +1 (DeepVoxels) */
    LF_DEPTHS_POINTS,  /* 0.1 and 99.9 percentile of the depths of the points that a view sees */
    LF_DEPTHS_GUESSED, /* 0.2 and 5 times the depth of the point that the cameras look at */
    LF_DEPTHS_GIVEN    /* by the options */
} lf_scene_depths;

typedef struct lf_scene_view {
    char *name;       /* unique within the scene */
    char *path;       /* of the picture; NULL: the pixels were given */
    lf_camera camera; /* of the picture as lf_scene_hold gives it, after reduction */
    double near, far; /* 0 <= near < far, world units along z */
    bool alpha;       /* the picture has alpha: lf_pixels.alpha is there */
    lf_scene_split split;
} lf_scene_view;

/* A frame without picture, or a picture without frame. */
typedef struct lf_left_out {
    char *name, *reason;
} lf_left_out;

typedef struct lf_scene {
    lf_scene_layout layout;
    lf_scene_depths depths; /* the least certain of all views */
    char *folder;
    long views;
    lf_scene_view *view; /* [views] */
    long left;
    lf_left_out *left_out; /* [left] */
    long points;
    double (*point)[3];  /* [points] of a COLMAP model, world */
    long observations;   /* of points in views, COLMAP only */
    double reprojection; /* median distance of point and observation, file's pixels; NaN: none */
    struct lf_scene_pictures *pictures;
} lf_scene;

enum { LF_FACTOR_MAX = 64 };

typedef struct lf_scene_options {
    int factor;         /* reduce pictures this many times, 1 ... LF_FACTOR_MAX */
    int hold_out;       /* layouts without a split: views 0, n, 2n, ... are test; 0: none is */
    double near, far;   /* instead of the files' where far > 0 */
    size_t cache_bytes; /* of pictures held in memory */
} lf_scene_options;

lf_scene_options lf_scene_defaults(void); /* 1, 8, 0, 0, 512 MB */

/* Read a scene; its layout is recognised by its files. A folder that fits no layout: the message
 * names what each reader looked for. */
lf_status lf_scene_open(const char *path, const lf_scene_options *options, lf_scene **out,
                        lf_error *err);
void lf_scene_close(lf_scene *scene);

/* The scenes at a path, sorted by name: the path itself if it fits a layout, else every folder in
 * it that does (hidden ones left out). Nothing is read. *folders [*count] are paths; free them with
 * lf_scene_folders_free. LF_BAD_INPUT: there is none; the message names what was looked for. */
lf_status lf_scene_folders(const char *path, long *count, char ***folders, lf_error *err);
void lf_scene_folders_free(long count, char **folders);

const char *lf_scene_layout_name(lf_scene_layout layout);
const char *lf_scene_split_name(lf_scene_split split); /* "train", "val", "test" */
const char *lf_scene_depths_name(lf_scene_depths depths);
long lf_scene_count(const lf_scene *scene, lf_scene_split split);

/* ---- pictures ----------------------------------------------------------------------------- */

typedef struct lf_pixels {
    int width, height;
    const uint8_t *rgb;   /* [height][width][3], over white */
    const uint8_t *alpha; /* [height][width], or NULL: opaque everywhere */
} lf_pixels;

/* The picture of a view, read if it is not in memory; it stays until lf_scene_release has been
 * called as often as lf_scene_hold. Pictures in hold may exceed the bound of the cache. */
lf_status lf_scene_hold(const lf_scene *scene, long view, lf_pixels *out, lf_error *err);
void lf_scene_release(const lf_scene *scene, long view);
/* Bytes of pictures in memory now. */
size_t lf_scene_bytes(const lf_scene *scene);

/* ---- own scenes and writing --------------------------------------------------------------- */

/* An empty scene. */
lf_scene *lf_scene_create(const char *name);
/* Add a view with its pixels, which are copied; alpha may be NULL. Aborts on a camera that
 * lf_camera_check refuses, near >= far, or pixels of another size than the camera's. */
void lf_scene_add(lf_scene *scene, const char *name, const lf_camera *camera, double near,
                  double far, lf_scene_split split, const uint8_t *rgb, const uint8_t *alpha);

/* Write the scene in a layout into a new or empty folder, pictures as PNG. LF_BAD_INPUT: the folder
 * holds files, or the layout cannot say it (fx != fy, a centre that is not the middle, views of
 * different sizes); the message names view and key. A layout without a split (LLFF, COLMAP) keeps
 * the order of views. */
lf_status lf_scene_write(const lf_scene *scene, lf_scene_layout layout, const char *folder,
                         lf_error *err);

/* ---- choice of source views --------------------------------------------------------------- */

typedef enum lf_nearness {
    LF_NEAR_ANGLE,   /* angle at `centre` between the camera centres (objects) */
    LF_NEAR_DISTANCE /* distance of the camera centres (forward-facing scenes) */
} lf_nearness;

/* The `count` candidates nearest to the target, nearest first; ties by smaller index. `centre` is
 * needed for LF_NEAR_ANGLE and must be moved with the frame. A candidate equal to
 * `exclude` (-1: none) is left out. LF_BAD_INPUT: more asked for than there are. */
lf_status lf_scene_nearest(const lf_scene *scene, const lf_camera *target, lf_nearness nearness,
                           const double centre[3], long candidates, const long *candidate,
                           long exclude, long count, long *out, lf_error *err);

/* As IBRNet trains (Wang et al., 2021): the pool is the nearest count x {1, 2, 3} with probability
 * `pool[0..2]` (sum 1), cut at the number of candidates; `count` of it without replacement, in
 * order of nearness; with probability `include` the target itself (`exclude`) may be drawn. A
 * function of its arguments; `stream` names the draw. */
lf_status lf_scene_draw_sources(const lf_scene *scene, const lf_camera *target,
                                lf_nearness nearness, const double centre[3], long candidates,
                                const long *candidate, long exclude, double include,
                                const double pool[3], lf_stream *stream, long count, long *out,
                                lf_error *err);

/* The point nearest to all optical axes (least squares); where they are nearly parallel, the point
 * in front of the mean camera at twice the extent of the centres (1 if they coincide), and false.
 */
bool lf_scene_focus(const lf_scene *scene, double out[3]);

/* ---- are the poses right? ----------------------------------------------------------------- */

typedef struct lf_line_fit {
    long pairs, corners; /* looked at */
    long matches;        /* corners with a clear match (correlation >= 0.85) in the other view */
    double median;       /* distance of the matches from the epipolar lines, pixels; NaN: none */
    double within_one;   /* share of them within one pixel */
} lf_line_fit;

enum { LF_FIT_REACH = 8 }; /* pixels on either side of a line; chance would give the median 4 */

/* The point of view `to` within LF_FIT_REACH pixels of the epipolar line of pixel uv of view
 * `from`, between near and far, whose 9 x 9 grey values correlate best. False: the line misses the
 * picture or nothing correlates by 0.85. `off` is the distance from the line, by a parabola. */
bool lf_scene_match(const lf_scene *scene, long from, const lf_pixels *from_pixels, long to,
                    const lf_pixels *to_pixels, const double uv[2], double match[2], double *off);
/* Strong corners, at most one a cell of columns x rows cells; uv [columns * rows][2]. Number. */
long lf_scene_corners(const lf_pixels *pixels, int columns, int rows, double (*uv)[2]);
/* Up to `pairs` views and their nearest others. */
lf_status lf_scene_fit_lines(const lf_scene *scene, long pairs, lf_line_fit *out, lf_error *err);

/* A picture of 1224 pixels' width: the cameras seen along the three axes of the world (train blue,
 * val green, test red; lines from near to far); two pairs of views: corners of one, their epipolar
 * lines from near to far in the other with the matches as squares, and each view's near and far
 * rectangles as the other sees them. */
lf_status lf_scene_draw(const lf_scene *scene, const char *png, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
