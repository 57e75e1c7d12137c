/* light_field.h: features at points along a target ray, seen as points of that ray: the layers of
 * neural rendering.                               [method.md 1.5, 1.6, 2.1 - 2.4, 2.8, 5b.2 - 5b.5]
 *
 * A field has types omega: the list always starts with 0 (scalars), the others are pairs that turn
 * by Rot(omega gamma) when the frame of their ray turns by gamma about it. C channels of each, Z
 * times as many scalars. A feature of one point is a row of R = P C numbers, P = Z + 2 (count - 1)
 * planes of C channels each:
 *
 *   [ scalars Z C | re C, im C of omega_1 | re C, im C of omega_2 | .. ]
 *
 * so that all inner loops run over channels. Numbers that do not turn (gates, profiles, norms,
 * gains) are [.., Q C], Q = Z + count - 1: those of the scalars, then C a type.
 *
 * Sizes: N rays (target rays), S samples a ray, V source views. Geometry is made in double, without
 * gradient; it becomes lf_real only as a feature. Ops run on the calling thread.
 */
#ifndef LF_LAYERS_LIGHT_FIELD_H
#define LF_LAYERS_LIGHT_FIELD_H

#include "layers/layers.h"
#include "layers/ray_frame.h"

enum { LF_ALONG_BASIS = 16, LF_KEY_VIEWS = 2 };
enum { LF_TYPES_MAX = 9, LF_OMEGA_MAX = 1024, LF_SCALARS_MAX = 64 };
enum { LF_PHASES_MAX = 2 * LF_TYPES_MAX - 1 };

typedef struct lf_types {
    int count; /* 1 .. LF_TYPES_MAX */
    int omega[LF_TYPES_MAX];
    int more; /* planes of scalars besides the first: Z - 1, 0 .. LF_SCALARS_MAX - 1 */
} lf_types;

/* The list is well formed: omega[0] = 0, then ascending, at most LF_OMEGA_MAX; Z is in range. */
bool lf_types_valid(const lf_types *types);
/* Z, P, Q of above. */
static inline long lf_types_scalars(const lf_types *types)
{
    return 1L + types->more;
}
static inline long lf_types_planes(const lf_types *types)
{
    return 2L * types->count - 1 + types->more;
}
static inline long lf_types_gates(const lf_types *types)
{
    return (long)types->count + types->more;
}
/* Plane of the real part of type k >= 1; the imaginary part is the next. */
static inline long lf_types_plane(const lf_types *types, long k)
{
    return 2 * k - 1 + types->more;
}
/* Block of type k >= 1, and of plane p, among the numbers that do not turn. */
static inline long lf_types_gate(const lf_types *types, long k)
{
    return k + types->more;
}
static inline long lf_types_gate_of_plane(const lf_types *types, long p)
{
    return p <= types->more ? p : types->more + (p - types->more + 1) / 2;
}
/* Phases of a ray and a view: 1 for all scalars, a pair a type. */
static inline long lf_types_phases(const lf_types *types)
{
    return 2L * types->count - 1;
}
/* A map within each type has matrices [Ci, Co]: Z^2 of the scalars, then A and B of each type. The
 * number of the A of type k >= 1, how many there are, and products of one row over Ci Co (complex
 * ones are four real ones). */
static inline long lf_types_matrix(const lf_types *types, long k)
{
    return lf_types_scalars(types) * lf_types_scalars(types) + 2 * (k - 1);
}
static inline long lf_types_matrices(const lf_types *types)
{
    return lf_types_matrix(types, types->count);
}
static inline double lf_types_products(const lf_types *types)
{
    return (double)(lf_types_matrix(types, 1) + 4L * (types->count - 1));
}

/* ---- geometry ------------------------------------------------------------------------------- */

/* What the layers know about how V source cameras look at S points of each of N target rays. */
typedef struct lf_light_geometry {
    long rays, samples, views;
    lf_types types;
    const lf_tensor *phase; /* [N, V, 2 count - 1]: 1, fade cos(omega alpha), fade sin, .. */
    const lf_tensor *angle; /* [N, S, V, 3]: 4 sin theta - 1, 10 (1 - cos theta), cos theta */
    const lf_tensor *mask;  /* [N, S, V]: 1 = the view sees the point */
    const lf_tensor *count; /* [N, S]: views that see the point */
    const lf_tensor *depth; /* [N, S]: (depth - near) / (far - near) */
} lf_light_geometry;

typedef struct lf_light_rays {
    long rays, samples, views;
    const double *origin, *direction; /* [N, 3]; unit, from the camera into the scene */
    const double *depth;              /* [N, S], along the unit direction */
    const double *centre;             /* [V, 3] of the source cameras */
    const uint8_t *seen;              /* [N, S, V] */
    double near, far;                 /* far > near */
} lf_light_rays;

/* (x, y) -> phases of all types [2 count - 1]: z = (x + i y) / r, r = |(x, y)|, z^omega by repeated
 * squaring, times fade = r^2 / (r^2 + epsilon^2); zeros for omega > 0 where r = 0.
 *                                                                                 [method.md 4.1]
 */
void lf_harmonics(const lf_types *types, double x, double y, double epsilon, double *phase);

/* All of it for a set of rays; epsilon = 1e-4 (far - near). A point at a source camera's centre
 * (within 1e-9 (far - near)) is masked there.                                     [method.md 5b.2]
 */
lf_light_geometry lf_light_geometry_make(lf_tape *tape, const lf_types *types,
                                         const lf_light_rays *rays);

/* ---- maps within a type --------------------------------------------------------------------- */

/* Complex-linear map: x [.., P Ci], w [Z^2 + 2 (count - 1), Ci, Co] -> [.., P Co]. The first Z^2 of
 * w are the real matrix [Z Ci, Z Co] of the scalars, then come A and B of each type: y = (A + i B)
 * x. b [Z Co] is added to the scalars; NULL: none. */
lf_tensor *lf_so2_linear(lf_tape *tape, const lf_types *types, lf_tensor *x, lf_tensor *w,
                         lf_tensor *b);

typedef struct lf_so2_map {
    const lf_parameter *weight; /* [Z^2 + 2 (count - 1), Ci, Co] */
    const lf_parameter *bias;   /* [Z Co] or NULL */
} lf_so2_map;
/* Normal weights of variance 1 / (Z Ci) for scalars, 1 / (2 Ci) for A and B, so that the size of a
 * field stays; bias 0. A third of it cost 2 dB after 700 steps of rendering. */
void lf_so2_map_init(lf_store *store, lf_so2_map *layer, const char *prefix, const lf_types *types,
                     long in, long out, bool bias);
lf_tensor *lf_so2_map_apply(lf_tape *tape, const lf_so2_map *layer, const lf_types *types,
                            lf_tensor *x);

/* Channels of a field to the left and to the right: a [.., P Ca], b [.., P Cb] -> [.., P (Ca +
 * Cb)].
 */
lf_tensor *lf_so2_concat(lf_tape *tape, const lf_types *types, lf_tensor *a, lf_tensor *b);

/* ---- nonlinearities, all on invariants --------------------------------------------------------
 */

/* Scalars as they are, and norms sqrt(|z|^2 + 1e-12): [.., P C] -> [.., Q C]. */
lf_tensor *lf_so2_invariants(lf_tape *tape, const lf_types *types, lf_tensor *x);

/* y0 = x0 + ELU(h0), y_k = sigmoid(h_k) x_k: x [.., P C], h [.., Q C].        [method.md 2.9]
 */
lf_tensor *lf_so2_gate(lf_tape *tape, const lf_types *types, lf_tensor *x, lf_tensor *h);

/* y0 = ReLU(x0 + beta_0), y_k = x_k ReLU(n + beta_k) / n, n = sqrt(|x_k|^2 + 1e-8); beta [Q C].
 */
lf_tensor *lf_so2_norm_relu(lf_tape *tape, const lf_types *types, lf_tensor *x, lf_tensor *beta);

/* y = gain x / sqrt(mean of x^2 over the row + 1e-4); gain [Q C]. */
lf_tensor *lf_so2_layer_norm(lf_tape *tape, const lf_types *types, lf_tensor *x, lf_tensor *gain);

/* Gated nonlinearity whose gates are a linear map of the invariants. */
typedef struct lf_so2_gated {
    lf_linear_layer gate; /* [Q C] -> [Q C] */
} lf_so2_gated;
void lf_so2_gated_init(lf_store *store, lf_so2_gated *layer, const char *prefix,
                       const lf_types *types, long channels);
lf_tensor *lf_so2_gated_apply(lf_tape *tape, const lf_so2_gated *layer, const lf_types *types,
                              lf_tensor *x);

/* ---- rays to rays -----------------------------------------------------------------------------
 */

/* Scalar ray features f_v, mapped to all types, turned to the target ray's frame:
 *   k_v = (1 + a_k) z_v^omega m_v per type,   zeros where the view does not see the point
 * m [N, S, V, P C] = W f: a real map of scalars gives any complex number; a [N, S, V, Q C]: the
 * profile over the angle, as its difference from 1. -> [N, S, V, P C]      [method.md 2.3, 5b.4] */
lf_tensor *lf_ray_ray_values(lf_tape *tape, lf_tensor *m, lf_tensor *a,
                             const lf_light_geometry *rays);
/* Their mean over the views that see the point -> [N, S, P C]; zeros where none does.       [5b.3]
 */
lf_tensor *lf_ray_ray_mean(lf_tape *tape, lf_tensor *m, lf_tensor *a,
                           const lf_light_geometry *rays);

/* Ray -> ray convolution, output regular in translation, support d0 = 0. The profile is an MLP of
 * the angles, 3 -> hidden -> Q C. The bias of the map is a scalar feature that is 1. */
typedef struct lf_ray_ray_convolution {
    lf_linear_layer map; /* [F, P C] */
    lf_mlp profile;
} lf_ray_ray_convolution;
void lf_ray_ray_convolution_init(lf_store *store, lf_ray_ray_convolution *layer, const char *prefix,
                                 const lf_types *types, long in, long channels, long hidden);
/* f [N, S, V, F] -> the mean [N, S, P C], and one value a view [N, S, V, P C]. */
lf_tensor *lf_ray_ray_convolution_apply(lf_tape *tape, const lf_ray_ray_convolution *layer,
                                        lf_tensor *f, const lf_light_geometry *rays);
lf_tensor *lf_ray_ray_convolution_views(lf_tape *tape, const lf_ray_ray_convolution *layer,
                                        lf_tensor *f, const lf_light_geometry *rays);

/* ---- attention over the source views ----------------------------------------------------------
 */

typedef struct lf_attended {
    lf_tensor *field;  /* [N, S, P C] */
    lf_tensor *weight; /* [N, S, V]: the mean of the heads' weights */
} lf_attended;

/* q [N, S, P C], k and values [N, S, V, P C]; heads split the channels of every type evenly, logits
 * are over sqrt(P C / heads). Unseen views have weight 0; a point that no view sees gives zeros. */
lf_attended lf_cross_attention(lf_tape *tape, lf_tensor *q, lf_tensor *k, lf_tensor *value,
                               const lf_light_geometry *rays, int heads);

/* sum_v weight_v x_v: [N, S, V], [N, S, V, D] -> [N, S, D]; the colour of a point from its views.
 */
lf_tensor *lf_blend_views(lf_tape *tape, lf_tensor *weight, lf_tensor *x);
/* The same of the first columns of x alone. */
lf_tensor *lf_blend_columns(lf_tape *tape, lf_tensor *weight, lf_tensor *x, long columns);

/* What a view's key or value becomes beside the query: linear of [view; query] to 2 C channels,
 * gated, linear to C. */
typedef struct lf_view_update {
    lf_so2_map from_view, from_point, out;
    lf_so2_gated gated;
} lf_view_update;

/* Keys and values by ray -> ray kernels of their own, their updates, attention, residual.   [5b.4]
 */
typedef struct lf_cross_attention_layer {
    int heads;
    lf_so2_map query;
    lf_ray_ray_convolution kernel[2]; /* keys, values */
    lf_view_update update[2];
} lf_cross_attention_layer;
void lf_cross_attention_init(lf_store *store, lf_cross_attention_layer *layer, const char *prefix,
                             const lf_types *types, long in, long channels, long hidden, int heads);
/* f [N, S, V, F], point [N, S, P C]; the field is the updated point. */
lf_attended lf_cross_attention_apply(lf_tape *tape, const lf_cross_attention_layer *layer,
                                     lf_tensor *f, lf_tensor *point, const lf_light_geometry *rays);

/* ---- attention along the ray ------------------------------------------------------------------
 */

/* Between the samples of a ray: keys and values of sample j are multiplied, per type and channel,
 * by c(depth_j - depth_i) = 1 + 16 Gaussians on [-1, 1] with complex weights [16, P C] (real for
 * scalars). q, k, values [N, S, P C] -> [N, S, P C]. Samples that less than LF_KEY_VIEWS views see
 * are no keys; without any key the result is 0.                              [method.md 2.8, 5b.5]
 */
lf_tensor *lf_along_ray_attention(lf_tape *tape, lf_tensor *q, lf_tensor *k, lf_tensor *value,
                                  lf_tensor *key_profile, lf_tensor *value_profile,
                                  const lf_light_geometry *rays, int heads);

/* Query, keys and values by maps, attention, and the heads joined to `out` channels. No residual.
 */
typedef struct lf_along_ray_layer {
    int heads;
    lf_so2_map query, key, value, join;
    const lf_parameter *profile[2]; /* of keys, of values */
} lf_along_ray_layer;
void lf_along_ray_init(lf_store *store, lf_along_ray_layer *layer, const char *prefix,
                       const lf_types *types, long channels, long out, int heads);
lf_tensor *lf_along_ray_apply(lf_tape *tape, const lf_along_ray_layer *layer, lf_tensor *x,
                              const lf_light_geometry *rays);

/* ---- irreducible translation types, and their Fourier transform -------------------------------
 */

/* How ray y lies to ray x, in the frame of x.                                     [method.md 2.1]
 */
typedef struct lf_ray_pair {
    bool parallel;       /* within 1e-9: azimuth, distance and foot have no meaning */
    double azimuth[2];   /* cosine and sine of alpha */
    double sine, cosine; /* of the angle between the rays */
    double distance;     /* signed; 0 = they meet */
    double foot;         /* parameter t on x of the common perpendicular */
} lf_ray_pair;
lf_ray_pair lf_ray_relative(const lf_ray *x, const lf_ray *y);

/* Geometry of Y source rays beside N target rays, as V = Y views of one sample: phases of the
 * azimuth, "angles" [N, 1, Y, 3] = 4 sin theta - 1, signed distance, cos theta; mask 0 for parallel
 * rays; the feet go to foot [N, Y]. With it lf_ray_ray_values gives k_y of every pair. */
lf_light_geometry lf_ray_pair_geometry(lf_tape *tape, const lf_types *types, long targets,
                                       const lf_ray *x, long sources, const lf_ray *y,
                                       double *foot);

/* Frequencies step (n - half), n = 0 .. 2 half; fields along the ray have the period 2 pi / step,
 * and details down to `width`. */
typedef struct lf_spectrum {
    long half;
    double step, width;
} lf_spectrum;

/* Types (omega, w) for all w of the spectrum: z_w = mean_y exp(i w foot_y) k_y.
 * k [N, 1, Y, P C] -> [N, 2 half + 1, 2 count C], for every type [re C | im C]: the scalars are
 * pairs as well, Z = 1. Each turns by omega gamma + w tau.                    [method.md 2.2, 2.4]
 */
lf_tensor *lf_along_ray_spectrum(lf_tape *tape, lf_tensor *k, const lf_light_geometry *rays,
                                 const double *foot, const lf_spectrum *spectrum);
/* Back to points t [rays, samples] of the target rays, smoothed by a Gaussian of the spectrum's
 * width: -> [rays, samples, P C]. */
lf_tensor *lf_along_ray_inverse(lf_tape *tape, lf_tensor *z, const lf_types *types, long rays,
                                long samples, const double *t, const lf_spectrum *spectrum);
/* The same field straight from the rays: a ray counts at the point t = foot, as a normal density of
 * deviation `width`: -> [N, samples, P C].                                    [method.md 2.3, 2.4]
 */
lf_tensor *lf_along_ray_regular(lf_tape *tape, lf_tensor *k, const lf_light_geometry *rays,
                                const double *foot, long samples, const double *t, double width);

/* ---- volume rendering -------------------------------------------------------------------------
 */

/* Densities from an MLP's last numbers t [N, S, 1]: softplus(t) where a view sees the sample, 0 and
 * no gradient where none does; count [N, S] -> [N, S].                       [method.md 4.2, 5b.5]
 */
lf_tensor *lf_density(lf_tape *tape, lf_tensor *t, const lf_tensor *count);

typedef struct lf_rendered {
    lf_tensor *colour; /* [N, 3] */
    lf_tensor *weight; /* [N, S]: the share of each sample; their sum is the opacity */
    lf_tensor *depth;  /* [N]: sum of weights times depths */
} lf_rendered;

/* Densities sigma [N, S] >= 0 (per sample: no interval lengths), colours [N, S, 3] and depths [N,
 * S] in order along the ray. What is not covered is black, or white.              [method.md 4.9,
 * 5b.1]
 */
lf_rendered lf_volume(lf_tape *tape, lf_tensor *sigma, lf_tensor *colour, const lf_tensor *depth,
                      bool white);

#endif
