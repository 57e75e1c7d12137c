/* make_scene.h: elf-eval make-scene: a built-in scene as a folder on disk. */
#ifndef LF_EVAL_MAKE_SCENE_H
#define LF_EVAL_MAKE_SCENE_H

#include <stdio.h>

#include "datasets/scene_make.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Texts are borrowed and may be NULL where said. */
typedef struct lf_make_scene_options {
    const char *kind;   /* glossy, diffuse or forward */
    const char *folder; /* new or empty */
    const char *layout; /* nerf-synthetic, llff, transforms, deepvoxels, colmap-text or
                           colmap-binary; NULL: nerf-synthetic, for forward llff */
    const char *mesh;   /* NULL: a made-up shape */
    uint64_t seed, index;
    int size;
    long views; /* every 8th is a test view, the first one too */
} lf_make_scene_options;

lf_make_scene_options lf_make_scene_defaults(void); /* seed 0, index 0, 100 pixels, 40 views */

/* Make the scene, write it, say on `out` (NULL: nothing) what was written and what the layout could
 * not keep. LF_BAD_INPUT: a missing or unknown kind, layout or folder, and the errors of
 * lf_scene_make and lf_scene_write. */
lf_status lf_make_scene_job(const lf_make_scene_options *options, FILE *out, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
