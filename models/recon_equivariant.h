/* recon_equivariant.h: the paper's reconstruction network.                    [method.md 5a.3 -
 * 5a.6]
 *
 *   samples of the maps at a point (and its depth code)                           [Q, V, F]
 *   -> ray -> point convolution -> blocks of ray update and attention -> (F0, F1) of each
 *   -> vector neuron readout, MLP -> 10 * signed distance                          [Q, 1]
 *
 * Without vectors the readout is left out; with max_pool all between samples and MLP but a maximum
 * over the views.                                                              [method.md 5a.10]
 *
 * Exactly equivariant: of cameras and points it is told unit directions and distances alone.
 */
#ifndef LF_MODELS_RECON_EQUIVARIANT_H
#define LF_MODELS_RECON_EQUIVARIANT_H

#include "models/recon.h"

/* model.type = equivariant. */
extern const lf_recon_network lf_recon_equivariant;

#endif
