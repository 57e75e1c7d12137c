/* scene_internal.h: what the readers and writers of scenes share; own to datasets/scene*. */
#ifndef LF_DATASETS_SCENE_INTERNAL_H
#define LF_DATASETS_SCENE_INTERNAL_H

#include <limits.h>

#include "datasets/scene.h"

typedef enum lf_axes {
    LF_AXES_CV, /* x right, y down, z forward */
    LF_AXES_GL  /* x right, y up, z backward */
} lf_axes;

/* A frame as its file has it. The first pixel's centre lies at (0.5, 0.5). */
typedef struct lf_frame {
    const char *where; /* file and key or line, begins every message */
    const char *name, *path;
    lf_axes axes;
    double pose[12]; /* 3x4 row major, camera to world */
    double fx, fy, cx, cy;
    int width, height; /* that the intrinsics belong to */
    int reduced;       /* the stored picture is this many times smaller, else 1 */
    double near, far;  /* far = 0: not known yet */
    lf_scene_split split;
} lf_frame;

typedef struct lf_scene_reader {
    lf_scene *scene;
    const lf_scene_options *options;
    bool has_split; /* the files say which view belongs to which split */
} lf_scene_reader;

/* Check the frame and its picture's size, bring it to elf's conventions, append it. */
lf_status lf_scene_add_frame(lf_scene_reader *reader, const lf_frame *frame, lf_error *err);
/* Copies name and path; the rest is from *view. */
void lf_scene_append(lf_scene *scene, const char *name, const char *path,
                     const lf_scene_view *view);
/* Of a 3x3 matrix. */
double lf_determinant(const double m[9]);
LF_PRINTF(3, 4)
void lf_scene_leave_out(lf_scene *scene, const char *name, const char *reason, ...);

/* The view nearest to another, not at the same place; -1: there is none. */
long lf_scene_neighbour(const lf_scene *scene, long view);

/* pictures: scene_pictures.c */
void lf_pictures_append(lf_scene *scene, int factor);
void lf_pictures_give(lf_scene *scene, long view, uint8_t *rgb, uint8_t *alpha);
struct lf_scene_pictures *lf_pictures_create(size_t bytes);
void lf_pictures_free(struct lf_scene_pictures *pictures, long views);

/* files: scene_files.c */
bool lf_is_file(const char *path);
bool lf_is_folder(const char *path);
/* Join into out[PATH_MAX]; an absolute `name` stands alone; too long: the empty path. */
const char *lf_join(char out[PATH_MAX], const char *folder, const char *name);
/* Names in a folder that end in one of `endings` (NULL-ended, any case), sorted; 0 if no folder. */
typedef struct lf_names {
    long count;
    char **name;
} lf_names;
lf_names lf_names_list(const char *folder, const char *const *endings);
void lf_names_free(lf_names *names);
extern const char *const lf_picture_endings[];
/* <folder>/<name>, or with .png, .jpg, .jpeg, .JPG, .exr appended; false if none is there. */
bool lf_find_picture(char out[PATH_MAX], const char *folder, const char *name);
/* Leave out the pictures of `folder` that no view uses. */
void lf_scene_note_orphans(lf_scene *scene, const char *folder);
/* The last part of a path. */
const char *lf_base_name(const char *path);

/* The readers; each says whether the folder looks like its own. */
bool lf_is_nerf_synthetic(const char *path);
bool lf_is_llff(const char *path);
bool lf_is_transforms(const char *path);
bool lf_is_deepvoxels(const char *path);
bool lf_is_colmap(const char *path);
lf_status lf_read_nerf_synthetic(lf_scene_reader *reader, const char *path, lf_error *err);
lf_status lf_read_llff(lf_scene_reader *reader, const char *path, lf_error *err);
lf_status lf_read_transforms(lf_scene_reader *reader, const char *path, lf_error *err);
lf_status lf_read_deepvoxels(lf_scene_reader *reader, const char *path, lf_error *err);
lf_status lf_read_colmap(lf_scene_reader *reader, const char *path, lf_error *err);

/* The writers of poses; the pictures are written already, `name` the path of each below folder. */
lf_status lf_write_json(const lf_scene *scene, bool splits, const char *folder, char **name,
                        lf_error *err);
lf_status lf_write_llff(const lf_scene *scene, const char *folder, lf_error *err);
lf_status lf_write_deepvoxels(const lf_scene *scene, const char *folder, char **name,
                              lf_error *err);
lf_status lf_write_colmap(const lf_scene *scene, bool binary, const char *folder, char **name,
                          lf_error *err);

/* Rotation matrix, camera to world, of a camera in GL or CV axes, and the 4x4 pose. */
void lf_pose_of(const lf_camera *camera, lf_axes axes, double pose[16]);

#endif
