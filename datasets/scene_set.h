/* scene_set.h: the scenes that a renderer trains on or is evaluated on. [docs/scenes.md]
 *
 * Scenes from files and built-in ones, each with what rendering must know of it: whether cameras
 * surround it, what shines through, where near and far lie, which views belong to which split.
 * Everything is found from the scene's own training views and moves with its frame.
 *
 * Errors and ownership as in scene.h.
 */
#ifndef LF_DATASETS_SCENE_SET_H
#define LF_DATASETS_SCENE_SET_H

#include "datasets/scene.h"
#include "datasets/scene_make.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct lf_scene_entry {
    lf_scene *scene;
    char *name;
    bool builtin;
    lf_nearness nearness;
    bool white;       /* behind the scene */
    double centre[3]; /* of the scene: of its bounds, or what the cameras look at */
    double radius;    /* nothing lies further from the centre, by the pictures' outlines; 0: not
                         known */
    double near, far; /* depths of all views where radius is 0; 0 < near < far */
    bool near_raised; /* the files say a near of (almost) 0 */
    long count[LF_SPLITS];
    long *view[LF_SPLITS]; /* indices of the views of a split */
} lf_scene_entry;

typedef struct lf_scene_set {
    long count;
    lf_scene_entry *entry;
} lf_scene_set;

typedef enum lf_scene_kinds {
    LF_KINDS_ALL,     /* glossy, diffuse, forward in turn */
    LF_KINDS_OBJECTS, /* glossy, diffuse in turn */
    LF_KINDS_GLOSSY,
    LF_KINDS_DIFFUSE,
    LF_KINDS_FORWARD
} lf_scene_kinds;

typedef struct lf_scene_set_options {
    const char *root;   /* where relative paths begin; NULL: here */
    const char *scenes; /* folders of scenes, or of scenes' folders, commas between; NULL: none */
    int longest;        /* reduce until the longer edge has at most so many pixels; 0: not */
    int factor;         /* reduce by this instead; 0: by longest */
    int hold_out;       /* as in scene.h */
    bool outlines;      /* bounds from the outlines of objects on white ground */
    double near_factor, far_factor; /* of the least near and the median far, where files say them */
    int nearness;                   /* lf_nearness, or -1: by how the cameras stand */
    int white;          /* 1 white, 0 black, -1: white if pictures are clear or have a white rim */
    size_t cache_bytes; /* of all scenes' pictures together; built-in ones stay in memory */
    long builtin;       /* built-in scenes */
    lf_scene_kinds kinds;
    const char
        *meshes;      /* folder of meshes to make them from, all of them; NULL: procedural shapes */
    long first;       /* number of the first built-in one: other numbers, other scenes */
    int size;         /* pixels along an edge of their pictures */
    double highlight; /* of the glossy ones, as in scene_make.h */
    uint64_t seed;
} lf_scene_set_options;

/* Open all scenes; built-in ones are rendered, in turn. `progress` (may be NULL) is called with the
 * number done. LF_BAD_INPUT: a folder that is no scene, no scene at all, fewer than two training
 * views, no mesh in the folder, a `longest` that asks for more than LF_FACTOR_MAX. */
typedef void lf_scene_set_progress(void *context, long done, long total);
lf_status lf_scene_set_open(const lf_scene_set_options *options, lf_scene_set_progress *progress,
                            void *context, lf_scene_set **out, lf_error *err);
void lf_scene_set_close(lf_scene_set *set);

/* Bytes of the pictures of the built-in scenes that the options ask for; nothing is made. */
double lf_scene_set_builtin_bytes(const lf_scene_set_options *options);

/* Depths between which a camera of this scene's frame sees something: by the bounds, if there are
 * any and the camera stands outside them, else near and far. */
void lf_scene_depths_of(const lf_scene_entry *entry, const lf_camera *camera, double *near,
                        double *far);

#ifdef __cplusplus
}
#endif
#endif
