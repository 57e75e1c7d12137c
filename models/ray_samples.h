/* ray_samples.h: target rays, samples on them, and how source views see these.      [method.md
 * 5b.1]
 *
 * Pure numbers: a source view is a projection matrix, a centre and a picture. Depths are measured
 * along the target camera's axis (z) and become distances along the ray by its stretch. All in
 * double; nothing here has a gradient.
 */
#ifndef LF_MODELS_RAY_SAMPLES_H
#define LF_MODELS_RAY_SAMPLES_H

#include "autograd/random.h"
#include "models/ray_network.h"

typedef struct lf_source {
    double projection[12]; /* K R' [I | -c], row major: (u z, v z, z) of (p, 1); pixel centres at
                              integers */
    double centre[3];
    long width, height;
    const uint8_t *rgb; /* [height][width][3] */
} lf_source;

/* Where there may be something: nothing is dense outside the ball; radius 0: anywhere. */
typedef struct lf_bounds {
    double centre[3], radius;
} lf_bounds;

typedef struct lf_target_rays {
    long count;
    const double *origin, *direction; /* [N, 3]; unit directions, from the camera into the scene */
    const double *stretch;            /* [N] distance along the ray of depth 1 */
    double near, far;                 /* depths, 0 < near < far */
} lf_target_rays;

/* Depths of one ray in `samples` strata of equal size in 1 / depth, rising: one in each, at a
 * place drawn from `stream`, or in the middle if that is NULL. */
void lf_strata(long samples, double near, double far, lf_stream *stream, double *depth);

/* `fine` more depths where the weights [samples] of the depths [samples] are large, and all of them
 * sorted: out [samples + fine]. The inner weights + 1e-5 are a density that is constant between
 * the middles of neighbouring depths, in 1 / depth; it is inverted at random places, or at evenly
 * spaced ones if stream is NULL. Two samples have no inner one: even between them.
 *                                                                               [method.md 5b.1]
 */
void lf_refine(long samples, const double *depth, const lf_real *weight, long fine,
               lf_stream *stream, double *out);

/* The views that see each sample, and where. */
typedef struct lf_seen_samples {
    double *uv;      /* [N, S, V, 2] pixels */
    uint8_t *seen;   /* [N, S, V] in front of the view and inside its picture */
    double *point;   /* [N, S, 3] */
    double *along;   /* [N, S] distance along the ray */
    double *centres; /* [V, 3] */
} lf_seen_samples;

/* Of rays [from, from + count) with depths [count, samples]; arrays are the tape's. */
lf_seen_samples lf_see_samples(lf_tape *tape, const lf_target_rays *rays, long from, long count,
                               long samples, const double *depth, long views,
                               const lf_source *source);

/* IBRNet's differences [N, S, V, 4] of rays [from, from + count): (a - b) / |a - b| and <a, b> - 1,
 * a and b the unit vectors from the sample to the target's and the source's centre; 0 for a sample
 * at a source's centre. */
lf_tensor *lf_ray_differences(lf_tape *tape, const lf_target_rays *rays, long from, long count,
                              long samples, const lf_seen_samples *seen, long views);

#endif
