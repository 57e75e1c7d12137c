/* render_data.h: what a renderer sees: target rays with their colours, and source views.
 *                                                                                [method.md 5b.1]
 * Cameras are moved by a motion (the settings, checks) and brought close to the origin before
 * projection matrices are made of them, in double.                            [method.md 4.5]
 */
#ifndef LF_TRAIN_RENDER_DATA_H
#define LF_TRAIN_RENDER_DATA_H

#include <stdio.h>

#include "configs/configs.h"
#include "datasets/scene_set.h"
#include "models/render_work.h"

/* The scenes of a split of a config: "train", "val" or "test". Where none are named for "val" or
 * "test": NULL, and the training scenes serve, with the views of lf_render_targets. LF_BAD_INPUT:
 * as lf_scene_set_open; built-in scenes that take more than data.cache_mb; pictures too small for
 * the feature network; for "val" and "test" too few views for render.sources. */
lf_status lf_render_scenes(const lf_config *cfg, const char *split, lf_scene_set_progress *progress,
                           void *context, lf_scene_set **out, lf_error *err);

/* Views of a scene to render, and the views they are rendered from. For training both are the
 * training views. For "val" and "test" the targets are the views of that split, or the training
 * views where it has none (each left out of its own sources). */
const long *lf_render_targets(const lf_scene_entry *entry, const char *split, long *count);
/* The split of those views: `split`, or "train". */
const char *lf_render_split(const lf_scene_entry *entry, const char *split);
/* The same of several scenes' views, `trained` of which are training views that stand in for the
 * split's: `split`, "train", or both as "test, train". */
const char *lf_render_split_name(const char *split, long views, long trained);

/* A line a scene from files: views, depths, how sources are chosen, ground; and what was left out.
 */
void lf_render_describe(FILE *out, const char *split, const lf_scene_set *set);

/* One target view with its sources, held in memory: pictures stay until lf_render_view_release. */
typedef struct lf_render_view {
    const lf_scene_entry *entry;
    long target;      /* view of the scene; -1: a camera that is no view of it */
    lf_camera camera; /* of the target, moved and recentred */
    double near, far;
    lf_bounds bounds; /* moved and recentred; radius 0: none */
    lf_pixels pixels; /* of the target; rgb NULL for a camera */
    long sources;
    long *source_view; /* [sources] views of the scene, nearest first */
    lf_source *source; /* [sources] */
} lf_render_view;

typedef struct lf_render_view_options {
    long sources;
    const lf_motion *motion; /* of the whole frame; NULL: none */
    lf_stream *draw;         /* draws the sources as IBRNet trains; NULL: the nearest */
    double pool[3];          /* of the draw */
} lf_render_view_options;

/* View `target` of the scene with its sources. LF_BAD_INPUT: fewer views than sources are asked
 * for, or a picture that cannot be read. Release it on success. */
lf_status lf_render_view_open(const lf_scene_entry *entry, long target,
                              const lf_render_view_options *options, lf_render_view *out,
                              lf_error *err);
/* The same for any camera in the scene's frame. */
lf_status lf_render_camera_open(const lf_scene_entry *entry, const lf_camera *camera,
                                const lf_render_view_options *options, lf_render_view *out,
                                lf_error *err);
void lf_render_view_release(lf_render_view *view);

/* Rays of pixels of the target, arrays owned. */
typedef struct lf_pixel_rays {
    lf_target_rays rays;
    double *number; /* origin [N, 3], direction [N, 3], stretch [N] */
} lf_pixel_rays;
/* Of `count` pixels, by number (row * width + column). Free it once. */
lf_pixel_rays lf_pixel_rays_create(const lf_render_view *view, long count, const long *pixel);
void lf_pixel_rays_free(lf_pixel_rays *rays);

/* ---- training ---------------------------------------------------------------------------------
 */

typedef struct lf_render_batches lf_render_batches;

/* Keeps references to both arguments. LF_BAD_INPUT: a scene with too few views. */
lf_status lf_render_batches_create(const lf_config *cfg, const lf_scene_set *scenes,
                                   lf_render_batches **out, lf_error *err);
void lf_render_batches_free(lf_render_batches *batches);
/* The batch of a step, a pure function of (config, step); its memory lasts until the next call. */
lf_status lf_render_batches_at(lf_render_batches *batches, long step, lf_render_batch *out,
                               lf_error *err);

#endif
