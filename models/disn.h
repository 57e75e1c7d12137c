/* disn.h: DISN with given poses, over several views: a compared system.           [method.md 5d.1]
 *
 *   images -> backbone -> scalar maps of every level
 *   global    numbers of each image: mean of the last level, linear, ReLU; largest over the views
 *                                                                                    [objects, G]
 *   local     samples of the maps at the projections of a point, largest over the views     [Q, F]
 *   point     x (object's frame, twice the box diagonal's unit) -> MLP; one for each stream [Q, P]
 *   global stream [point; global] -> MLP -> 1,  local stream [point; local] -> MLP -> 1
 *   their sum is 10 * signed distance                                                       [Q, 1]
 *
 * Not equivariant: it is told positions in the object's frame, and so which way is up.
 */
#ifndef LF_MODELS_DISN_H
#define LF_MODELS_DISN_H

#include "models/recon.h"

/* model.type = disn. */
extern const lf_recon_network lf_disn;

#endif
