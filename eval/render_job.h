/* render_job.h: what elf-eval does with a renderer's checkpoint: score held-out views, render a
 * path, check its invariance.                                            [method.md 5b.6, 5b.7]
 */
#ifndef LF_EVAL_RENDER_JOB_H
#define LF_EVAL_RENDER_JOB_H

#include "datasets/camera_path.h"
#include "eval/lpips.h"
#include "train/render_data.h"

/* A renderer loaded from a checkpoint. Its parts refer to each other: never copy it. */
typedef struct lf_loaded_renderer {
    lf_config *cfg; /* the checkpoint's, with overrides; owned */
    lf_store *store;
    lf_renderer model;
    lf_render_work *work;
    long step;
} lf_loaded_renderer;

/* Takes over cfg, the config inside `checkpoint` (a file) with overrides. Fill *out in place. */
lf_status lf_loaded_renderer_open(const char *checkpoint, lf_config *cfg, lf_loaded_renderer *out,
                                  lf_error *err);
void lf_loaded_renderer_close(lf_loaded_renderer *loaded);

typedef struct lf_render_job {
    const char *setting;       /* I, SO3 or NULL (I) */
    const char *split;         /* train, val or test */
    const char *json, *out;    /* or NULL */
    const char *lpips_weights; /* or NULL */
    lf_lpips_net lpips_net;
    const char *path; /* spiral or orbit, or NULL: held-out views */
    long frames;      /* of the path */
    long scenes;      /* at most so many; 0: all */
    long pictures;    /* rows of the montage */
    bool baselines;   /* score what learns nothing, too */
    bool quiet;
} lf_render_job;

/* Render and score the split's views of every scene; with `out` the pictures go there, as PNG
 * (<scene>-<view>-rendered.png, -true.png; names as in file_names.h), and montage.png. In setting
 * SO3 every view is rendered in LF_ROTATIONS random frames: figures are means over them, the pixel
 * variance between them. LF_BAD_INPUT: another setting, too few source views, pictures that cannot
 * be read. */
enum { LF_ROTATIONS = 6 };
lf_status lf_render_evaluate(lf_loaded_renderer *loaded, const lf_render_job *job, lf_error *err);
/* The frame of rotation k, the same for every view. */
lf_motion lf_render_rotation(long k);

/* Render a path through each scene to <out>/<scene>/frame-%04d.png, names as in file_names.h. */
lf_status lf_render_path(lf_loaded_renderer *loaded, const lf_render_job *job, lf_error *err);

/* Move the frame of some views by `count` random motions (translations to 1000 scene radii) and
 * print how far colours and depths move. */
lf_status lf_render_check(lf_loaded_renderer *loaded, const lf_render_job *job, long count,
                          lf_error *err);

/* ---- shared by the jobs -----------------------------------------------------------------------
 */

/* Source views of an evaluated view: eval.sources, or the training's. */
long lf_render_sources(const lf_loaded_renderer *loaded);

/* A whole view in a frame. */
typedef struct lf_rendering {
    lf_image *image; /* 3 channels */
    lf_real *colour; /* [height][width][3] the same, as the network gave it */
    float *depth;    /* [height][width]; INFINITY: nothing there */
    double seconds;
    long rows; /* (sample, source view) pairs given to the networks, coarse and fine, seen or not */
} lf_rendering;
/* What `cfg` allows to leave out. */
lf_render_savings lf_render_savings_from(const lf_loaded_renderer *loaded);
/* With eval.shrink above 1 the view is rendered smaller and enlarged again. */
lf_rendering lf_render_whole(lf_loaded_renderer *loaded, const lf_render_view *view);
void lf_rendering_free(lf_rendering *r);
/* The pixels as an image of three channels; the caller frees it. */
lf_image *lf_picture_of(const lf_pixels *pixels);
/* The scenes of a split, described on stdout unless `quiet`: those of the training if none are
 * named for it. The caller closes them. */
lf_status lf_render_job_scenes(const lf_config *cfg, const char *split, bool quiet,
                               lf_scene_set **set, lf_error *err);
/* A view that is evaluated. */
typedef struct lf_render_item {
    const lf_scene_entry *entry;
    long target;
} lf_render_item;
/* Views of the split of at most `scenes` scenes (0: all), scene after scene, of each at most
 * eval.views, evenly over its list; the caller frees them. */
lf_render_item *lf_render_items(const lf_config *cfg, const char *split, long scenes,
                                const lf_scene_set *set, long *count);

#endif
