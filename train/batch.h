/* batch.h: which shapes, views and points a training step sees.
 *
 * A pure function of (config, step): epochs are shuffled lists of the shapes, a step takes the next
 * train.shapes_per_step of them, one draw of the setting each, and train.points_per_shape of their
 * stored points. Nothing depends on earlier calls, so a resumed run sees the same batches.
 */
#ifndef LF_TRAIN_BATCH_H
#define LF_TRAIN_BATCH_H

#include "configs/configs.h"
#include "datasets/projection.h"
#include "models/recon_work.h"

typedef struct lf_batches lf_batches;

/* Keeps references to cfg and shapes. The model says which grid it needs; NULL: none. */
lf_batches *lf_batches_create(const lf_config *cfg, const lf_recon *model, const lf_shapes *shapes);
void lf_batches_free(lf_batches *batches);

/* Steps in an epoch, rounded up. */
long lf_batches_epoch(const lf_batches *batches);

typedef struct lf_batch {
    lf_recon_images images; /* shapes_per_step * 8, premultiplied, 0 to 1 */
    lf_recon_points points; /* shapes_per_step * points_per_shape, as the 8 views see them */
    const float *sdf;       /* [points] true distances, unit: the box diagonal */
} lf_batch;

/* The batch of a step; its memory is the batches' and lasts until the next call. */
lf_batch lf_batches_at(lf_batches *batches, long step);

#endif
