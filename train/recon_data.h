/* recon_data.h: reconstruction's data and validation, from a config. */
#ifndef LF_TRAIN_RECON_DATA_H
#define LF_TRAIN_RECON_DATA_H

#include "configs/configs.h"
#include "datasets/projection.h"
#include "models/recon_work.h"

/* Options of a split of a config's data, as training uses them. */
lf_shapes_options lf_shapes_options_from(const lf_config *cfg, const char *split);

/* Agreement with shapes that are not trained on, at fixed points. */
typedef struct lf_agreement {
    double loss; /* as in training, mean over the points of all shapes */
    double iou;  /* of the signs at the uniform points, mean over shapes */
} lf_agreement;
lf_agreement lf_validate_shapes(lf_recon_work *work, const lf_config *cfg, const lf_shapes *shapes);

#endif
