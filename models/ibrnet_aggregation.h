/* ibrnet_aggregation.h: how IBRNet joins what the source views see at a point: the part of it that
 * the renderer (ibrnet.h) and the SDF predictor (ibrnet_sdf.h) share.                [method.md 5c]
 *
 *   direction  D -> 16 -> F of what is known of each view's direction, added to what it sees
 *   base       with its mean and variance under first weights: 3 F -> 64 -> 32
 *   visibility 32 -> 32 -> 33: a residual and a first visibility; 32 -> 32 -> 1: a second
 *   point      mean, variance, mean weight under the second: 65 -> 64 -> width
 *
 * ELU after every map but the last of the second visibility, which a sigmoid follows. Features and
 * maps in lanes: see layers/ibrnet.h. The mean and variance's share of base's first map is computed
 * once a point.
 */
#ifndef LF_MODELS_IBRNET_AGGREGATION_H
#define LF_MODELS_IBRNET_AGGREGATION_H

#include "layers/ibrnet.h"
#include "layers/layers.h"

enum { LF_IBRNET_FEATURES = 32 }; /* of each view behind base */

typedef struct lf_ibrnet_aggregation {
    lf_linear_layer direction[2], base[2], visibility[2], again[2], point[2];
} lf_ibrnet_aggregation;

/* D = directions, F = inputs. Base, visibility and point: normal, variance 2 / inputs; direction as
 * lf_linear_init makes it. */
void lf_ibrnet_aggregation_init(lf_store *store, lf_ibrnet_aggregation *net, const char *prefix,
                                long directions, long inputs, long width);

typedef struct lf_ibrnet_aggregated {
    lf_tensor *view;       /* [R, 32, L] features of each view */
    lf_tensor *visibility; /* [R, 1, L] the second */
    lf_tensor *point;      /* [B, width, L] */
} lf_ibrnet_aggregated;

/* seen [.., V, F], direction [R, D, L], first weights [R, 1, L]. */
lf_ibrnet_aggregated lf_ibrnet_aggregate(lf_tape *tape, const lf_ibrnet_aggregation *net,
                                         lf_tensor *seen, lf_tensor *direction, lf_tensor *weight,
                                         const lf_lanes *lanes);

/* Linear maps `name`.0, .1, .. of sizes size[0] -> size[1] -> .. below prefix, with bias. */
void lf_ibrnet_maps_init(lf_store *store, lf_linear_layer *layer, const char *prefix,
                         const char *name, int count, const long *size, double gain);

/* act(x w + b) of rows or points in lanes. */
lf_tensor *lf_ibrnet_map(lf_tape *tape, const lf_linear_layer *layer, lf_tensor *x,
                         const lf_lanes *lanes, lf_activation act);

/* Multiply-adds, forward: of each view of a point, and of the point. */
double lf_ibrnet_view_macs(const lf_ibrnet_aggregation *net);
double lf_ibrnet_point_macs(const lf_ibrnet_aggregation *net);

/* lf_linear_init's gain for normal weights of variance 2 / inputs. */
#define LF_IBRNET_KAIMING sqrt(6)

#endif
