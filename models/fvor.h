/* fvor.h: FvOR's shape module with given poses: a compared system.                [method.md 5d.2]
 *
 *   images and the coordinates of their pixels -> backbone -> scalar maps
 *   volume    over the cube of edge 1 at the origin, n^3 voxels: mean over the views of the samples
 *             of the maps; code of the voxel's place -> 3-D U-Net           [objects, n, n, n, G]
 *   decoder   at a point: trilinear sample of the volume, mean over the views of the samples of the
 *             maps, code of the place -> MLP -> 10 * signed distance                      [Q, 1]
 *   code      x, sin 2^k x, cos 2^k x, k = 0, 1: 15 numbers, in the object's frame
 *
 *   U-Net     1x1x1 to the first width; each further level 3x3x3 with stride 2, 3x3x3; back up:
 *             trilinear, 3x3x3, + what the level had before; 3x3x3 last. Batch norm and ReLU after
 *             all but the last.
 *
 * Not equivariant: volume and code have the axes of the object's frame.
 */
#ifndef LF_MODELS_FVOR_H
#define LF_MODELS_FVOR_H

#include "models/recon.h"

/* model.type = fvor. */
extern const lf_recon_network lf_fvor;

#endif
