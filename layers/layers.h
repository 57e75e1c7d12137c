/* layers.h: the layers after the backbone: linear maps, fields of types 0 and 1 on points and rays,
 * the ray -> point convolution, SE(3) attention, vector neurons, MLP.   [method.md 1.7, 2.5 - 2.9,
 * 5a]
 *
 * A layer is a struct of parameter pointers, an init that registers them under a dotted prefix, and
 * a forward. A type-0 feature is [.., C]; a type-1 feature is [.., 3, C], components x, y, z in the
 * frame of the points. Ray features at a point are [Q, V, ..]: Q points, V views.
 *
 * Equivariance: with g = (R, t) applied to cameras and points, directions turn by R; scalars stay
 * and vectors turn by R, exactly (tests/test_equivariance.c).
 */
#ifndef LF_LAYERS_H
#define LF_LAYERS_H

#include "autograd/ops.h"

/* Features by type at the same place; vector is NULL where there is no type 1. */
typedef struct lf_field {
    lf_tensor *scalar; /* [.., C0] */
    lf_tensor *vector; /* [.., 3, C1] */
} lf_field;

/* How the rays through Q points look: geometry, made in double, without gradient. */
typedef struct lf_ray_geometry {
    long points, views;
    const lf_tensor *direction; /* [Q, V, 3], unit, from the camera to the point */
    const lf_tensor *mask;      /* [Q, V], 1 = the view sees the point */
} lf_ray_geometry;

/* ---- linear maps --------------------------------------------------------------------------------
 */

typedef struct lf_linear_layer {
    const lf_parameter *weight; /* [in, out] */
    const lf_parameter *bias;   /* [out] or NULL */
} lf_linear_layer;

/* Weights normal with deviation gain / sqrt(3 in), bias 0: the variance of the uniform +-1/sqrt(in)
 * that the recipes were found with. Three times that variance cost 0.15 IoU after 1000 steps. */
void lf_linear_init(lf_store *store, lf_linear_layer *layer, const char *prefix, long in, long out,
                    bool bias, double gain);
lf_tensor *lf_linear_apply(lf_tape *tape, const lf_linear_layer *layer, lf_tensor *x,
                           lf_activation act);

/* Equivariant linear map (self-interaction): one matrix for scalars with bias, one for vectors
 * without. A missing type on either side (size 0) is left out.                    [method.md 1.7]
 */
typedef struct lf_self_interaction {
    lf_linear_layer scalar, vector;
    bool has_vector;
} lf_self_interaction;
void lf_self_interaction_init(lf_store *store, lf_self_interaction *layer, const char *prefix,
                              long in0, long in1, long out0, long out1);
lf_field lf_self_interaction_apply(lf_tape *tape, const lf_self_interaction *layer, lf_field x);

enum { LF_MLP_MAX = 8 };
typedef struct lf_mlp {
    int count;         /* linear maps */
    lf_activation act; /* between them */
    lf_linear_layer layer[LF_MLP_MAX];
} lf_mlp;
/* Sizes in -> width[0] -> .. -> width[widths - 1] -> out; act is LF_RELU, for the caller to change.
 */
void lf_mlp_init(lf_store *store, lf_mlp *mlp, const char *prefix, long in, int widths,
                 const long *width, long out);
lf_tensor *lf_mlp_apply(lf_tape *tape, const lf_mlp *mlp, lf_tensor *x);
double lf_mlp_macs(const lf_mlp *mlp); /* multiply-adds of a row */

/* ---- nonlinearities -----------------------------------------------------------------------------
 */

typedef enum lf_nonlinearity { LF_NORM_RELU, LF_GATED } lf_nonlinearity;

/* Norms over the 3 components: v [.., 3, C] -> sqrt(|v|^2 + 1e-12) [.., C].       [method.md 4.2]
 */
lf_tensor *lf_vector_norm(lf_tape *tape, lf_tensor *v);
/* v [.., 3, C] times g [.., C] per channel. */
lf_tensor *lf_gate(lf_tape *tape, lf_tensor *v, lf_tensor *g);
/* v -> v ReLU(n + beta) / n, n = sqrt(|v|^2 + 1e-8); beta [C].                    [method.md 2.9]
 */
lf_tensor *lf_norm_relu(lf_tape *tape, lf_tensor *v, lf_tensor *beta);

typedef struct lf_nonlinear {
    lf_nonlinearity kind;
    const lf_parameter *beta; /* norm: [C1] */
    lf_linear_layer gate;     /* gated: [scalars, norms] -> gates, and */
    lf_linear_layer mix;      /*        norms -> scalars, the only way from type 1 to type 0 */
} lf_nonlinear;
void lf_nonlinear_init(lf_store *store, lf_nonlinear *layer, const char *prefix,
                       lf_nonlinearity kind, long c0, long c1);
/* ReLU on scalars; the norm or gated nonlinearity on vectors. */
lf_field lf_nonlinear_apply(lf_tape *tape, const lf_nonlinear *layer, lf_field x);

/* ---- rays to points ---- */

/* Means over the views that see the point: m0 = mean_v r_v [Q, C] and
 * m1 = mean_v sqrt(3) d_v r_v [Q, 3, C], of ray features r [Q, V, C].          [method.md 2.5,
 * 5a.4] */
lf_field lf_ray_moments(lf_tape *tape, lf_tensor *r, const lf_ray_geometry *rays);

/* Ray -> point convolution, kernel support d0 = 0: F0 = mean_v W0 r_v, F1 = mean_v sqrt3 (W1 r_v)
 * d_v, computed as linear maps of the moments (the same numbers, V times fewer products). */
typedef struct lf_ray_convolution {
    lf_linear_layer scalar, vector;
    bool has_vector;
} lf_ray_convolution;
void lf_ray_convolution_init(lf_store *store, lf_ray_convolution *layer, const char *prefix,
                             long in, long out0, long out1);
lf_field lf_ray_convolution_apply(lf_tape *tape, const lf_ray_convolution *layer, lf_tensor *r,
                                  const lf_ray_geometry *rays);

/* All paths of the TFN kernels along d, before their channel matrices, joined per type:
 *   scalars  [ s | <d, v> ]                                             [Q, V, C0 + C1]
 *   vectors  [ v | sqrt(3/2) d x v | sqrt3 s d (| 3/sqrt2 (d<d,v> - v/3)) ]  [Q, V, 3, 2 C1 + C0 (+
 * C1)] x.vector may be NULL (C1 = 0); the last path only with degree2. [method.md 2.7] */
lf_field lf_tfn_paths(lf_tape *tape, lf_field x, const lf_ray_geometry *rays, bool degree2);

/* Multi-head attention over the views of a point.                             [method.md 2.6, 5a.5]
 *   w_{v,h} = softmax_v (<q, k_v>_h / sqrt(D)),  D = real components of a head's key
 *   o = sum_v w_v val_v, per head
 * q0 [Q, C0], q1 [Q, 3, C1]; kv0 [Q, V, 2 C0], kv1 [Q, V, 3, 2 C1]: keys, then values. C1 may be 0
 * (q1 and kv1 NULL). Heads split the channels of both types evenly. Unseen views have weight 0; a
 * point that no view sees gives zeros. */
lf_field lf_ray_attention(lf_tape *tape, lf_field q, lf_field kv, const lf_ray_geometry *rays,
                          int heads);

/* One block of the ray -> point transformer: rays hear the point (concatenation, self-interaction,
 * nonlinearity, self-interaction), then the point attends to its rays.             [method.md 5a.5]
 */
typedef struct lf_transformer_config {
    long scalars, vectors; /* C0, C1 of points and of updated rays */
    int heads;
    bool degree2;     /* also the J = 2 path */
    bool skip_linear; /* F <- o + W F instead of F <- F + W o */
    lf_nonlinearity nonlinearity;
} lf_transformer_config;
typedef struct lf_transformer_block {
    lf_transformer_config config;
    lf_self_interaction from_ray, from_point, out_ray; /* the ray update */
    lf_nonlinear nonlinear;
    lf_linear_layer keys_values0, keys_values1; /* channel matrices of the TFN paths */
    lf_self_interaction query, mix;
    bool has_vector;
} lf_transformer_block;
void lf_transformer_block_init(lf_store *store, lf_transformer_block *block, const char *prefix,
                               const lf_transformer_config *config, long ray0, long ray1);
/* rays and point are replaced by their updates. */
void lf_transformer_block_apply(lf_tape *tape, const lf_transformer_block *block, lf_field *rays,
                                lf_field *point, const lf_ray_geometry *geometry);

/* ---- points to scalars ---- */

/* Vector-neuron LeakyReLU: u = p where <p,k> >= 0, else p - 0.8 <p,k> / (|k|^2 + 1e-6) k, per
 * channel; p, k [.., 3, C]. [method.md 2.9] */
lf_tensor *lf_vector_relu(lf_tape *tape, lf_tensor *p, lf_tensor *k);
/* Inner products per channel: a, b [.., 3, C] -> [.., C]. */
lf_tensor *lf_inner(lf_tape *tape, lf_tensor *a, lf_tensor *b);

/* Vector neuron layer and inner product to scalars: u = VN(v), <v_i, u_i>.          [method.md
 * 5a.6] */
typedef struct lf_vector_neuron {
    lf_linear_layer feature, direction;
} lf_vector_neuron;
void lf_vector_neuron_init(lf_store *store, lf_vector_neuron *layer, const char *prefix, long c);
lf_tensor *lf_vector_neuron_apply(lf_tape *tape, const lf_vector_neuron *layer, lf_tensor *v);

#endif
