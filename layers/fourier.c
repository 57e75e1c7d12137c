/* fourier.c: fields along a ray by irreducible translation types, and the same fields at points
 *                                                                         [method.md 2.1 - 2.4]
 *   relative   s(x)^-1 y = (d, m): rho = hypot(d_x, d_y), azimuth (d_x, d_y) / rho,
 *              cos theta = d_z, signed distance m_z / rho, foot g = (d_x m_y - d_y m_x) / rho^2
 *   spectrum   z_w = sum_y mu_y exp(+i w g_y) k_y,                 types (omega, w)
 *   inverse    v_t = step / 2 pi sum_w exp(-(width w)^2 / 2) exp(-i w t) z_w
 *   regular    v_t = sum_y mu_y G(t - g_y) k_y,  G the normal density of deviation `width`
 *              mu_y = mask_y / max(1, sum mask)
 *
 * The last three are y_na = sum_b E_nab x_nb with complex E made of geometry;
 * dx_nb += conj(E_nab) dy_na.
 *
 * Shapes      k [N, 1, Y, P C], z [N, W, 2 count C], v [N, S, P C]. In z the scalars are pairs too:
 *             with w they turn.
 * Keeps       E.
 * Degenerate  parallel rays (rho < 1e-9) have no foot and are masked.
 */
#include "layers/light_field.h"

static const double pi = 3.14159265358979323846, parallel = 1e-9;

/* ---- geometry ------------------------------------------------------------------------------- */

lf_ray_pair lf_ray_relative(const lf_ray *x, const lf_ray *y)
{
    const lf_frame section = lf_ray_section(x), back = lf_frame_inverse(&section);
    const lf_ray r = lf_ray_move(&back, y);
    const double *d = r.direction, *m = r.moment, rho = hypot(d[0], d[1]);
    if (rho < parallel)
        return (lf_ray_pair){.parallel = true, .azimuth = {1, 0}, .cosine = d[2] < 0 ? -1 : 1};
    return (lf_ray_pair){.azimuth = {d[0] / rho, d[1] / rho},
                         .sine = rho,
                         .cosine = d[2],
                         .distance = m[2] / rho,
                         .foot = (d[0] * m[1] - d[1] * m[0]) / (rho * rho)};
}

lf_light_geometry lf_ray_pair_geometry(lf_tape *tape, const lf_types *types, long targets,
                                       const lf_ray *x, long sources, const lf_ray *y, double *foot)
{
    LF_REQUIRE(lf_types_valid(types) && targets >= 1 && sources >= 1,
               "lf_ray_pair_geometry: %d types, %ld and %ld rays", types->count, targets, sources);
    const long phases = lf_types_phases(types);
    lf_tensor *phase = lf_tensor_new(tape, 3, LF_DIMS(targets, sources, phases));
    lf_tensor *angle = lf_tensor_new(tape, 4, LF_DIMS(targets, 1, sources, 3));
    lf_tensor *mask = lf_tensor_new(tape, 3, LF_DIMS(targets, 1, sources));
    lf_tensor *count = lf_tensor_new(tape, 2, LF_DIMS(targets, 1)),
              *depth = lf_tensor_like(tape, count);
    memset(count->value, 0, (size_t)targets * sizeof *count->value);
    memset(depth->value, 0, (size_t)targets * sizeof *depth->value);
    for (long i = 0; i < targets * sources; i++) {
        const lf_ray_pair p = lf_ray_relative(&x[i / sources], &y[i % sources]);
        double z[LF_PHASES_MAX];
        lf_harmonics(types, p.azimuth[0], p.azimuth[1], 0, z);
        for (long k = 0; k < phases; k++)
            phase->value[i * phases + k] = (lf_real)z[k];
        angle->value[3 * i] = (lf_real)(4 * p.sine - 1);
        angle->value[3 * i + 1] = (lf_real)p.distance;
        angle->value[3 * i + 2] = (lf_real)p.cosine;
        mask->value[i] = !p.parallel;
        count->value[i / sources] += mask->value[i];
        foot[i] = p.foot;
    }
    return (lf_light_geometry){targets, 1, sources, *types, phase, angle, mask, count, depth};
}

/* ---- sums with complex coefficients ------------------------------------------------------------
 */

typedef struct mix {
    lf_types types;
    long groups, out, in, c;  /* N, a, b, channels */
    bool pairs_in, pairs_out; /* scalars are pairs there */
    lf_real *coefficient;     /* [N, a, b, 2] */
} mix;

/* Where type k has its real and imaginary part in a row; -1: it has none. */
static void parts(bool pairs, long c, int k, long *re, long *im)
{
    *re = pairs ? 2 * k * c : (k ? 2 * k - 1 : 0) * c;
    *im = pairs || k ? *re + c : -1;
}

/* y += (e_re + i e_im) x */
static void add_rotated(const mix *t, lf_real e_re, lf_real e_im, bool pairs_x, const lf_real *x,
                        bool pairs_y, lf_real *restrict y)
{
    for (int k = 0; k < t->types.count; k++) {
        long xr, xi, yr, yi;
        parts(pairs_x, t->c, k, &xr, &xi);
        parts(pairs_y, t->c, k, &yr, &yi);
        for (long i = 0; i < t->c; i++) {
            const lf_real re = x[xr + i], im = xi < 0 ? 0 : x[xi + i];
            y[yr + i] += e_re * re - e_im * im;
            if (yi >= 0)
                y[yi + i] += e_re * im + e_im * re;
        }
    }
}

static long cols_of(const mix *t, bool pairs)
{
    return (pairs ? 2L * t->types.count : lf_types_planes(&t->types)) * t->c;
}

static void backward(const lf_node *node)
{
    const mix *t = node->saved;
    const long nx = cols_of(t, t->pairs_in), ny = cols_of(t, t->pairs_out);
    for (long r = 0; r < t->groups * t->out; r++)
        for (long b = 0; b < t->in; b++) {
            const lf_real *e = t->coefficient + 2 * (r * t->in + b);
            add_rotated(t, e[0], -e[1], t->pairs_out, node->out[0]->grad + r * ny, t->pairs_in,
                        node->in[0]->grad + (r / t->out * t->in + b) * nx);
        }
}

static lf_tensor *apply(lf_tape *tape, const char *op, mix *t, lf_tensor *x)
{
    const long nx = cols_of(t, t->pairs_in), ny = cols_of(t, t->pairs_out);
    lf_tensor *y = lf_tensor_new(tape, 3, LF_DIMS(t->groups, t->out, ny));
    memset(y->value, 0, (size_t)y->size * sizeof *y->value);
    for (long r = 0; r < t->groups * t->out; r++)
        for (long b = 0; b < t->in; b++) {
            const lf_real *e = t->coefficient + 2 * (r * t->in + b);
            add_rotated(t, e[0], e[1], t->pairs_in, x->value + (r / t->out * t->in + b) * nx,
                        t->pairs_out, y->value + r * ny);
        }
    lf_record(tape, op, backward, t, LF_IN(x), LF_OUT(y));
    return y;
}

static mix *mix_new(lf_tape *tape, const lf_types *types, long groups, long out, long in,
                    bool pairs_in, bool pairs_out, const lf_tensor *x)
{
    mix *t = lf_alloc(tape, sizeof *t);
    *t = (mix){*types, groups, out, in, 1, pairs_in, pairs_out, NULL};
    t->c = lf_cols(x) / cols_of(t, pairs_in);
    LF_REQUIRE(types->more == 0 && t->c >= 1 && x->size == groups * in * cols_of(t, pairs_in),
               "fields along rays: %ld numbers for %ld rays of %ld rows", x->size, groups, in);
    t->coefficient = lf_alloc_reals(tape, 2 * groups * out * in);
    return t;
}

/* ---- the three ----------------------------------------------------------------------------------
 */

static double frequency(const lf_spectrum *s, long index)
{
    return s->step * (double)(index - s->half);
}

static double view_weight(const lf_light_geometry *rays, long i)
{
    const double seen = (double)rays->count->value[i / rays->views];
    return (double)rays->mask->value[i] / (seen > 1 ? seen : 1);
}

lf_tensor *lf_along_ray_spectrum(lf_tape *tape, lf_tensor *k, const lf_light_geometry *rays,
                                 const double *foot, const lf_spectrum *spectrum)
{
    const long waves = 2 * spectrum->half + 1, sources = rays->views;
    mix *t = mix_new(tape, &rays->types, rays->rays, waves, sources, false, true, k);
    for (long r = 0; r < rays->rays * waves; r++)
        for (long b = 0; b < sources; b++) {
            const long i = r / waves * sources + b;
            const double turn = frequency(spectrum, r % waves) * foot[i];
            t->coefficient[2 * (r * sources + b)] = (lf_real)(view_weight(rays, i) * cos(turn));
            t->coefficient[2 * (r * sources + b) + 1] = (lf_real)(view_weight(rays, i) * sin(turn));
        }
    return apply(tape, "along_ray_spectrum", t, k);
}

lf_tensor *lf_along_ray_inverse(lf_tape *tape, lf_tensor *z, const lf_types *types, long rays,
                                long samples, const double *t, const lf_spectrum *spectrum)
{
    const long waves = 2 * spectrum->half + 1;
    mix *m = mix_new(tape, types, rays, samples, waves, true, false, z);
    for (long r = 0; r < rays * samples; r++)
        for (long b = 0; b < waves; b++) {
            const double w = frequency(spectrum, b), s = spectrum->width * w;
            const double size = spectrum->step / (2 * pi) * exp(-s * s / 2);
            m->coefficient[2 * (r * waves + b)] = (lf_real)(size * cos(w * t[r]));
            m->coefficient[2 * (r * waves + b) + 1] = (lf_real)(-size * sin(w * t[r]));
        }
    return apply(tape, "along_ray_inverse", m, z);
}

lf_tensor *lf_along_ray_regular(lf_tape *tape, lf_tensor *k, const lf_light_geometry *rays,
                                const double *foot, long samples, const double *t, double width)
{
    const long sources = rays->views;
    mix *m = mix_new(tape, &rays->types, rays->rays, samples, sources, false, false, k);
    for (long r = 0; r < rays->rays * samples; r++)
        for (long b = 0; b < sources; b++) {
            const long i = r / samples * sources + b;
            const double s = (t[r] - foot[i]) / width;
            const double density = exp(-s * s / 2) / (width * sqrt(2 * pi));
            m->coefficient[2 * (r * sources + b)] = (lf_real)(view_weight(rays, i) * density);
            m->coefficient[2 * (r * sources + b) + 1] = 0;
        }
    return apply(tape, "along_ray_regular", m, k);
}
