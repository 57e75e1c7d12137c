/* recon_data.h: reconstruction's data and validation, from a config. */
#ifndef LF_TRAIN_RECON_DATA_H
#define LF_TRAIN_RECON_DATA_H

#include "configs/configs.h"
#include "datasets/projection.h"
#include "models/recon_work.h"

/* Options of a split of a config's data, as training uses them. */
lf_shapes_options lf_shapes_options_from(const lf_config *cfg, const char *split);

/* The first `count` of the projected points, as a network gets them. */
lf_recon_points lf_seen_points(const lf_projection *p, long count);

/* How the views of shapes see a network's grid: room for that many shapes; none without a model. */
typedef struct lf_seen_grid {
    long count; /* points of a shape; 0: the network has no grid */
    double (*point)[3];
    lf_projection projection;
    lf_recon_points points; /* of all shapes, once they are filled */
} lf_seen_grid;
lf_seen_grid lf_seen_grid_create(const lf_recon *model, long shapes);
void lf_seen_grid_free(lf_seen_grid *grid);
/* The views of shape number `slot`, whose images are numbered from `first`. */
void lf_seen_grid_fill(lf_seen_grid *grid, long slot, const lf_shape_views *views, long first);
/* Its points, or NULL without a grid. */
const lf_recon_points *lf_seen_grid_points(const lf_seen_grid *grid);

/* Agreement with shapes that are not trained on, at fixed points. */
typedef struct lf_agreement {
    double loss; /* as in training, mean over the points of all shapes */
    double iou;  /* of the signs at the uniform points, mean over shapes */
} lf_agreement;
lf_agreement lf_validate_shapes(lf_recon_work *work, const lf_recon *model, const lf_config *cfg,
                                const lf_shapes *shapes);

#endif
