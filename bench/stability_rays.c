/* stability_rays.c: rays that are nearly parallel, and directions near the poles of the section.
 *                                                          [method.md 1.3, 1.4, 2.1
 * - 2.4, 4.1, 4.3] Exact numbers are the same formulas in long double, of the same inputs. A
 * frame's azimuth is made of numbers as small as the angle that are sums of numbers of size 1, so
 * what hangs on it has the condition 1 / angle in the geometry's double.
 */
#include "bench/stability.h"
#include "layers/light_blocks.h"

#define ANGLES                                                                                     \
    LF_STABILITY_AT(1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
#define POLES                                                                                      \
    LF_STABILITY_AT(1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 0)

/* ---- long double ----------------------------------------------------------------------------- */

static void exact_axes(const double d[3], long double axes[9])
{
    const long double x = d[0], y = d[1], z = d[2], r = hypotl(x, y);
    const long double c = r > 0 ? x / r : 1, s = r > 0 ? y / r : 0;
    const long double rows[9] = {c * z, -s, c * r, s * z, c, s * r, -r, 0, z};
    memcpy(axes, rows, sizeof rows);
}

static void exact_rotate(const double r[9], const double p[3], long double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = (long double)r[3 * i] * p[0] + (long double)r[3 * i + 1] * p[1] +
                 (long double)r[3 * i + 2] * p[2];
}

/* <column `column` of axes, v> */
static long double along(const long double axes[9], int column, const long double v[3])
{
    return axes[column] * v[0] + axes[3 + column] * v[1] + axes[6 + column] * v[2];
}

static void exact_cross(const long double a[3], const long double b[3], long double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* ---- the section and the twist --------------------------------------------------------------- */

/* A unit direction at the sine `away` from the pole of that sign. */
static void near_pole(double away, double sign, double d[3])
{
    const double alpha = 0.7;
    d[0] = away * cos(alpha);
    d[1] = away * sin(alpha);
    d[2] = sign * sqrt((1 - away) * (1 + away));
}

static void section(lf_stability *s)
{
    double axes[18], d[3];
    long double exact[18];
    for (int pole = 0; pole < 2; pole++) {
        near_pole(s->parameter, 1 - 2 * pole, d);
        lf_ray_axes(d, axes + 9 * pole);
        exact_axes(d, exact + 9 * pole);
    }
    lf_stability_numbers(s, "axes", 18, axes, exact);
}

static lf_frame some_motion(void)
{
    const double a = 1.1, b = -0.6;
    const lf_frame x = {{1, 0, 0, 0, cos(a), -sin(a), 0, sin(a), cos(a)}, {0.3, -0.2, 0.5}};
    const lf_frame z = {{cos(b), -sin(b), 0, sin(b), cos(b), 0, 0, 0, 1}, {-0.4, 0.1, 0.2}};
    return lf_frame_compose(&x, &z);
}

static void exact_twist(const lf_frame *g, const double d[3], long double h[3])
{
    long double before[9], after[9], direction[3], tangent[3];
    double rounded[3];
    exact_axes(d, before);
    exact_rotate(g->rotation, d, direction);
    for (int i = 0; i < 3; i++)
        tangent[i] = g->rotation[3 * i] * before[0] + g->rotation[3 * i + 1] * before[3] +
                     g->rotation[3 * i + 2] * before[6];
    for (int i = 0; i < 3; i++)
        rounded[i] = (double)direction[i];
    exact_axes(rounded, after);
    h[0] = along(after, 0, tangent);
    h[1] = along(after, 1, tangent);
    h[2] = g->origin[0] * direction[0] + g->origin[1] * direction[1] + g->origin[2] * direction[2];
}

/* Away from a pole, and towards it by the inverse motion; the pole itself is not met again. */
static void twist(lf_stability *s)
{
    double d[3], h[6];
    long double exact[6];
    const lf_frame g = some_motion(), back = lf_frame_inverse(&g);
    near_pole(s->parameter, 1, d);
    lf_ray x = lf_ray_through((const double[3]){0.2, -0.7, 0.4}, d);
    const int ways = s->parameter > 0 ? 2 : 1;
    for (int way = 0; way < ways; way++) {
        const lf_twist t = lf_ray_twist(way ? &back : &g, &x);
        memcpy(h + 3 * way, (const double[3]){t.cosine, t.sine, t.shift}, 3 * sizeof *h);
        exact_twist(way ? &back : &g, x.direction, exact + 3 * way);
        x = lf_ray_move(&g, &x);
    }
    s->geometry = s->parameter > 0 ? 1 / s->parameter : 1;
    lf_stability_numbers(s, "twists", 3 * ways, h, exact);
}

/* ---- two rays -------------------------------------------------------------------------------- */

enum { TARGETS = 2, SOURCES = 3 };

/* The rays y stand at the angle s->parameter to x and pass it at some tenths. */
static void bundle(const lf_stability *s, lf_ray x[TARGETS], lf_ray y[SOURCES])
{
    const double p[3] = {0.3, -0.4, 0.2}, d[3] = {0.36, 0.48, 0.8};
    double axes[9];
    lf_ray_axes(d, axes);
    for (int i = 0; i < TARGETS + SOURCES; i++) {
        const double turn = 1.3 * i + 0.4, tilt = i < TARGETS ? 0 : s->parameter * (0.7 + 0.2 * i);
        double q[3], e[3];
        for (int a = 0; a < 3; a++) {
            const double *row = axes + 3 * a;
            e[a] = sin(tilt) * (cos(turn) * row[0] + sin(turn) * row[1]) + cos(tilt) * row[2];
            q[a] = p[a] + 0.2 * (cos(2 * turn) * row[0] - sin(2 * turn) * row[1]);
        }
        *(i < TARGETS ? &x[i] : &y[i - TARGETS]) = lf_ray_through(q, e);
    }
}

/* method.md 2.1: cosine and sine of the azimuth, of the angle, distance; foot [1]. */
static void exact_pair(const lf_ray *x, const lf_ray *y, long double out[5], long double *foot)
{
    long double axes[9], d[3], m[3], f[3], shift[3], w[3], moment[3], direction[3];
    exact_axes(x->direction, axes);
    for (int i = 0; i < 3; i++) {
        d[i] = x->direction[i];
        m[i] = x->moment[i];
        direction[i] = y->direction[i];
    }
    exact_cross(d, m, f);
    exact_cross(f, direction, shift); /* moment about x's foot: m_y - f x d_y */
    for (int i = 0; i < 3; i++)
        moment[i] = y->moment[i] - shift[i];
    for (int a = 0; a < 3; a++) {
        w[a] = along(axes, a, direction);
        m[a] = along(axes, a, moment);
    }
    const long double rho = hypotl(w[0], w[1]);
    const bool parallel = rho < 1e-9L;
    out[0] = parallel ? 1 : w[0] / rho;
    out[1] = parallel ? 0 : w[1] / rho;
    out[2] = parallel ? 0 : rho;
    out[3] = parallel ? (w[2] < 0 ? -1 : 1) : w[2];
    out[4] = parallel ? 0 : m[2] / rho;
    *foot = parallel ? 0 : (w[0] * m[1] - w[1] * m[0]) / (rho * rho);
}

static void ray_pair(lf_stability *s)
{
    enum { PAIRS = TARGETS * SOURCES };
    lf_ray x[TARGETS], y[SOURCES];
    double number[5 * PAIRS], sine[PAIRS], foot[PAIRS];
    long double exact[5 * PAIRS], exact_sine[PAIRS], exact_foot[PAIRS];
    bundle(s, x, y);
    for (int i = 0; i < PAIRS; i++) {
        const lf_ray_pair p = lf_ray_relative(&x[i / SOURCES], &y[i % SOURCES]);
        const double all[5] = {p.azimuth[0], p.azimuth[1], p.sine, p.cosine, p.distance};
        memcpy(number + 5 * i, all, sizeof all);
        sine[i] = p.sine;
        foot[i] = p.foot;
        exact_pair(&x[i / SOURCES], &y[i % SOURCES], exact + 5 * i, &exact_foot[i]);
        exact_sine[i] = exact[5 * i + 2];
    }
    s->geometry = 1 / s->parameter;
    lf_stability_numbers(s, "pair", 5 * PAIRS, number, exact);
    lf_stability_numbers(s, "sine", PAIRS, sine, exact_sine);
    lf_stability_numbers(s, "foot", PAIRS, foot, exact_foot);
}

/* Fields along a ray from rays that are nearly parallel to it: their feet are far away, and a
 * frequency w turns by w foot. */
static void along_ray_spectrum(lf_stability *s)
{
    const lf_types types = {.count = 3, .omega = {0, 1, 3}};
    const lf_spectrum spectrum = {2, 0.7, 0.3};
    lf_ray x[TARGETS], y[SOURCES];
    double foot[TARGETS * SOURCES];
    bundle(s, x, y);
    const lf_light_geometry g = lf_ray_pair_geometry(s->tape, &types, TARGETS, x, SOURCES, y, foot);
    lf_tensor *k = lf_stability_input(s, "k", 4, LF_DIMS(TARGETS, 1, SOURCES, 10), 1);
    s->geometry = 1 / s->parameter / s->parameter;
    lf_stability_output(s, "spectrum", lf_along_ray_spectrum(s->tape, k, &g, foot, &spectrum),
                        NULL);
}

/* ---- layers ---------------------------------------------------------------------------------- */

enum { Q = 3, V = 4, F = 5, RAYS = 2, SAMPLES = 3, C = 2 };

/* Directions from all views to a point within the angle; every view sees every point. */
static lf_ray_geometry narrow(lf_stability *s)
{
    double d[Q * V * 3], mask[Q * V];
    for (int i = 0; i < Q * V; i++) {
        const double turn = 2.1 * i, tilt = s->parameter * (1 + 0.1 * i);
        d[3 * i] = sin(tilt) * cos(turn);
        d[3 * i + 1] = sin(tilt) * sin(turn);
        d[3 * i + 2] = cos(tilt);
        mask[i] = 1;
    }
    return (lf_ray_geometry){Q, V, lf_stability_constant(s, 3, LF_DIMS(Q, V, 3), d),
                             lf_stability_constant(s, 2, LF_DIMS(Q, V), mask)};
}

static void ray_convolution(lf_stability *s)
{
    const lf_ray_geometry rays = narrow(s);
    lf_ray_convolution layer;
    lf_ray_convolution_init(s->store, &layer, "convolution", F, 4, 3);
    lf_stability_parameters(s);
    lf_tensor *r = lf_stability_input(s, "r", 3, LF_DIMS(Q, V, F), 1);
    const lf_field y = lf_ray_convolution_apply(s->tape, &layer, r, &rays);
    lf_stability_output(s, "scalars", y.scalar, NULL);
    lf_stability_output(s, "vectors", y.vector, NULL);
}

static void transformer(lf_stability *s)
{
    const lf_ray_geometry rays = narrow(s);
    const lf_transformer_config config = {
        .scalars = 4, .vectors = 2, .heads = 2, .degree2 = true, .nonlinearity = LF_GATED};
    lf_transformer_block block;
    lf_transformer_block_init(s->store, &block, "block", &config, F, 3);
    lf_stability_parameters(s);
    lf_field ray = {lf_stability_input(s, "ray0", 3, LF_DIMS(Q, V, F), 1),
                    lf_stability_input(s, "ray1", 4, LF_DIMS(Q, V, 3, 3), 1)};
    lf_field point = {lf_stability_input(s, "point0", 2, LF_DIMS(Q, 4), 1),
                      lf_stability_input(s, "point1", 3, LF_DIMS(Q, 3, 2), 1)};
    lf_transformer_block_apply(s->tape, &block, &ray, &point, &rays);
    lf_stability_output(s, "scalars", point.scalar, NULL);
    lf_stability_output(s, "vectors", point.vector, NULL);
}

/* Source cameras so near the target rays that they see the samples within the angle. */
static lf_light_geometry beside(lf_stability *s, const lf_types *types)
{
    double origin[3 * RAYS], direction[3 * RAYS], centre[3 * V], depth[RAYS * SAMPLES];
    uint8_t seen[RAYS * SAMPLES * V];
    const double d[3] = {0.48, 0.6, 0.64}, o[3] = {-1, 0.5, -0.3};
    double axes[9];
    lf_ray_axes(d, axes);
    for (int v = 0; v < V; v++)
        for (int a = 0; a < 3; a++)
            centre[3 * v + a] =
                o[a] - 0.3 * v * d[a] +
                3 * s->parameter * (cos(1.7 * v) * axes[3 * a] + sin(1.7 * v) * axes[3 * a + 1]);
    for (int i = 0; i < RAYS; i++) {
        for (int a = 0; a < 3; a++) {
            origin[3 * i + a] = o[a];
            direction[3 * i + a] =
                cos(s->parameter * i) * d[a] + sin(s->parameter * i) * axes[3 * a];
        }
        for (int k = 0; k < SAMPLES; k++)
            depth[i * SAMPLES + k] = 1.3 + k + 0.1 * i;
    }
    memset(seen, 1, sizeof seen);
    const lf_light_rays rays = {RAYS, SAMPLES, V, origin, direction, depth, centre, seen, 1, 5};
    s->geometry = (double)types->omega[types->count - 1] / s->parameter;
    return lf_light_geometry_make(s->tape, types, &rays);
}

static const lf_types types = {.count = 3, .omega = {0, 1, 4}};
enum { PLANES = 5 };

static void ray_ray_convolution(lf_stability *s)
{
    const lf_light_geometry g = beside(s, &types);
    lf_ray_ray_convolution layer;
    lf_ray_ray_convolution_init(s->store, &layer, "convolution", &types, F, C, 6);
    lf_stability_parameters(s);
    lf_tensor *f = lf_stability_input(s, "f", 4, LF_DIMS(RAYS, SAMPLES, V, F), 1);
    lf_stability_output(s, "field", lf_ray_ray_convolution_apply(s->tape, &layer, f, &g), NULL);
}

static void cross(lf_stability *s, bool blocks)
{
    const lf_light_geometry g = beside(s, &types);
    lf_cross_attention_layer layer;
    lf_cross_attention_init(s->store, &layer, "cross", &types, F, C, 6, 2);
    lf_stability_parameters(s);
    lf_tensor *f = lf_stability_input(s, "f", 4, LF_DIMS(RAYS, SAMPLES, V, F), 1);
    lf_tensor *q = lf_stability_input(s, "point", 3, LF_DIMS(RAYS, SAMPLES, PLANES * C), 1);
    lf_attended y;
    if (blocks) {
        const lf_blocks k = lf_blocks_make(s->tape, &g);
        y = lf_blocks_cross(s->tape, &k, &layer, lf_blocks_of_views(s->tape, &k, f),
                            lf_blocks_of_points(s->tape, &k, q));
        y.field = lf_blocks_rows(s->tape, &k, y.field);
    } else {
        y = lf_cross_attention_apply(s->tape, &layer, f, q, &g);
    }
    lf_stability_output(s, "field", y.field, NULL);
    lf_stability_output(s, "weight", y.weight, NULL);
}

static void cross_attention(lf_stability *s)
{
    cross(s, false);
}

static void cross_attention_blocks(lf_stability *s)
{
    cross(s, true);
}

static const lf_stability_case cases[] = {
    {"section", "sine to pole", section, POLES},
    {"twist", "sine to pole", twist, POLES},
    {"ray pair", "angle", ray_pair, ANGLES},
    {"along-ray spectrum", "angle", along_ray_spectrum, ANGLES},
    {"ray convolution", "angle", ray_convolution, ANGLES},
    {"transformer block", "angle", transformer, ANGLES},
    {"ray-ray convolution", "angle", ray_ray_convolution, ANGLES},
    {"cross attention", "angle", cross_attention, ANGLES},
    {"cross attention, blocks", "angle", cross_attention_blocks, ANGLES},
};

const lf_stability_table lf_stability_rays = {cases, sizeof cases / sizeof *cases};
