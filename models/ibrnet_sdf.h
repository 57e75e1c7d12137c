/* ibrnet_sdf.h: IBRNet as a predictor of signed distances, which the paper compares with: of a
 * point alone, without a target ray.                                                   [method.md
 * 5c.1]
 *
 *   samples of the maps at a point                                             [Q, V, F]
 *   -> IBRNet's aggregation over the views, told each view's direction in the object's frame
 * instead of differences from a target's; first weights are even, for there is no target to be near
 * to
 *   -> MLP with ELU, width -> .. -> 1: 10 * signed distance                      [Q, 1]
 *
 * Unchanged when cameras and object move together, and by the order of the views; with a C8
 * backbone when a view is rolled. Not when the object's frame turns: the directions are told in it.
 */
#ifndef LF_MODELS_IBRNET_SDF_H
#define LF_MODELS_IBRNET_SDF_H

#include "models/recon.h"

/* model.type = ibrnet-sdf. */
extern const lf_recon_network lf_ibrnet_sdf;

#endif
