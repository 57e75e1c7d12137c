/* ray_frame.h: oriented rays, their frames, and how a rigid motion turns a ray about itself.
 *                                                                        [method.md 1.1 - 1.4, 1.6]
 * A ray is x = (d, m): unit direction d and moment m = p x d of any of its points p. The base ray
 * is the z axis. The section s(x) is one motion that takes the base ray to x; its rotation S(d) is
 * a frame with third axis d. What is left of a motion g between the frames of x and g x is a
 * rotation by gamma about the base ray and a shift by tau along it: the twist.
 *
 * Everything is double, in both builds: geometry is rounded to lf_real only when it becomes a
 * feature. Matrices are row-major. Nothing allocates; all functions may run in any thread.
 * Degenerate: S(d) jumps at d = +-e3, where it is diag(1, 1, 1) and diag(-1, 1, -1); near them it
 * is orthonormal to rounding, and gamma is exact to about 1e-16 / hypot(d_x, d_y).
 */
#ifndef LF_LAYERS_RAY_FRAME_H
#define LF_LAYERS_RAY_FRAME_H

#ifdef __cplusplus
extern "C" {
#endif

/* A rigid motion p -> R p + t; as a frame, the columns of R are its axes and t its origin. */
typedef struct lf_frame {
    double rotation[9];
    double origin[3];
} lf_frame;

typedef struct lf_ray {
    double direction[3]; /* unit */
    double moment[3];    /* orthogonal to it; its length is the distance from the origin */
} lf_ray;

/* An element (gamma, tau) of the base ray's stabiliser, gamma by its cosine and sine. */
typedef struct lf_twist {
    double cosine, sine, shift;
} lf_twist;

/* ---- motions --------------------------------------------------------------------------------- */

/* a b: first b, then a. */
lf_frame lf_frame_compose(const lf_frame *a, const lf_frame *b);
lf_frame lf_frame_inverse(const lf_frame *g);
/* out = R p + t; out may be p. */
void lf_frame_apply(const lf_frame *g, const double p[3], double out[3]);

/* ---- rays ------------------------------------------------------------------------------------ */

/* The ray through a point in a unit direction; the z axis. */
lf_ray lf_ray_through(const double point[3], const double direction[3]);
lf_ray lf_ray_base(void);
/* g x = (R d, R m + t x R d) */
lf_ray lf_ray_move(const lf_frame *g, const lf_ray *x);
/* The same ray with its moment taken about q: (d, m - q x d). */
lf_ray lf_ray_about(const lf_ray *x, const double q[3]);

/* d x m, the point of the ray that is nearest to the origin; the point foot + t d; and the t of a
 * point of the ray, <p, d>. A motion shifts t by the twist's shift. */
void lf_ray_foot(const lf_ray *x, double foot[3]);
void lf_ray_point(const lf_ray *x, double t, double point[3]);
double lf_ray_parameter(const lf_ray *x, const double point[3]);

/* ---- section and twist ----------------------------------------------------------------------- */

/* S(d) = R_Z(alpha) R_Y(beta), d = (sin beta cos alpha, sin beta sin alpha, cos beta). */
void lf_ray_axes(const double direction[3], double axes[9]);
/* s(x) = (S(d), foot): takes the base ray to x. */
lf_frame lf_ray_section(const lf_ray *x);
/* h(g, x) = s(g x)^-1 g s(x):  R_Z(gamma) = S(R d)' R S(d),  tau = <t, R d>. */
lf_twist lf_ray_twist(const lf_frame *g, const lf_ray *x);

/* The sum of both (the stabiliser is abelian); the opposite; the motion itself. */
lf_twist lf_twist_compose(const lf_twist *a, const lf_twist *b);
lf_twist lf_twist_inverse(const lf_twist *h);
lf_frame lf_twist_frame(const lf_twist *h);

#ifdef __cplusplus
}
#endif
#endif
