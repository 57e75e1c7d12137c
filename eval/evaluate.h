/* evaluate.h: a checkpoint over a split in a setting: meshes, scores, a picture. [method.md 5a.8-9]
 */
#ifndef LF_EVAL_EVALUATE_H
#define LF_EVAL_EVALUATE_H

#include "configs/configs.h"
#include "datasets/projection.h"
#include "eval/isosurface.h"
#include "eval/mean_shape.h"
#include "models/recon_work.h"

/* A model loaded from a checkpoint, ready to predict. Its parts refer to each other: never copy it.
 */
typedef struct lf_loaded {
    lf_config *cfg; /* the checkpoint's, with overrides */
    lf_store *store;
    lf_recon model;
    lf_recon_work *work;
    lf_real *image;     /* of the last encode */
    lf_setting trained; /* the setting of the training, whatever the overrides say */
    long step;
} lf_loaded;

/* `checkpoint` is a file or a run's folder (its newest sound checkpoint); sets[n] are "key=value".
 */
lf_status lf_loaded_open(const char *checkpoint, int n, const char *const *sets, lf_loaded *out,
                         lf_error *err);
void lf_loaded_close(lf_loaded *loaded);

/* Numbers of the views that the model is given, eval.sources of them or all; returns how many. */
int lf_loaded_views(const lf_loaded *loaded, int view[LF_CUBE_VIEWS]);

/* Features of eight views given with 8 bits, or of eval.sources of them; then distances at points
 * of the shape (unit: box diagonal) as those views see them. valid may be NULL. */
void lf_loaded_encode(lf_loaded *loaded, const lf_shape_views *views);
void lf_loaded_predict(lf_loaded *loaded, const lf_shape_views *views, long n,
                       const double (*point)[3], lf_real *sdf, uint8_t *valid);

typedef struct lf_predicted {
    lf_mesh *mesh; /* the caller's, in the frame of the shape */
    lf_iso_report iso;
    double seconds; /* from views to mesh */
} lf_predicted;
/* The surface as the model sees it in these views, on the grid of eval.resolution round a shape
 * with that longest edge of its box; `dense`: every point of the grid. Errors of lf_isosurface. */
lf_status lf_predicted_mesh(lf_loaded *loaded, const lf_shape_views *views, double longest_edge,
                            bool dense, lf_predicted *out, lf_error *err);
/* The visual hull of the views that the model is given (hull.h) on the same grid, every point of
 * it; the caller frees it. Errors of lf_isosurface. */
lf_status lf_hull_mesh(const lf_loaded *loaded, const lf_shape_views *views, double longest_edge,
                       lf_mesh **out, lf_error *err);
/* The mean shape (mean_shape.h) on the same grid, every point of it; the caller frees it. */
lf_status lf_mean_shape_mesh(const lf_config *cfg, const lf_mean_shape *mean, double longest_edge,
                             lf_mesh **out, lf_error *err);
/* The zero level of the true distance on the same grid; the caller frees it. */
lf_status lf_true_mesh(const lf_config *cfg, const lf_shape *shape, lf_mesh **out, lf_error *err);

typedef struct lf_evaluate_options {
    const char *setting; /* NULL: the training's */
    const char *split;   /* train, val or test */
    const char *json;    /* report, or NULL */
    const char *out;     /* folder for meshes and montage.png, or NULL */
    long shapes;         /* at most so many; 0: all */
    long pictures;       /* rows of the montage */
    double roll;         /* degrees; every view rolled by this as well, and rendered again */
    bool dense, quiet, exact;
    bool baselines; /* score what learns nothing, too */
} lf_evaluate_options;

/* The shapes of a split in a setting (NULL: the training's), which *used, unless NULL, tells; the
 * caller closes them. Errors of lf_setting_parse and lf_shapes_open. */
lf_status lf_evaluated_shapes(const lf_config *cfg, const char *split, const char *setting,
                              lf_setting *used, lf_shapes **out, lf_error *err);

/* Score every shape. LF_BAD_INPUT for a setting, split or data that do not exist. */
lf_status lf_evaluate(lf_loaded *loaded, const lf_evaluate_options *options, lf_error *err);

#endif
