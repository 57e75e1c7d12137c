/* procedural_airplane.c: airplanes; the fuselage is 1 long before normalisation, nose at z = -0.5.
 *
 * Four kinds (light propeller, airliner, business jet, fighter) set the ranges; wings (sweep,
 * taper, dihedral, height), tail (plain, T, V, twin) and engines are drawn within them.
 */
#include <math.h>

#include "datasets/procedural_build.h"

enum kind { LIGHT, AIRLINER, BUSINESS, FIGHTER, KINDS };
enum tail { TAIL_PLAIN, TAIL_T, TAIL_V, TAIL_TWIN };

typedef struct plane {
    enum kind kind;
    enum tail tail;
    double radius;              /* of the fuselage */
    double wing_y, wing_z;      /* middle of the root chord */
    double root, tip;           /* chords */
    double half_span, sweep;    /* sweep: how far the tip's middle lies behind the root's */
    double dihedral, thickness; /* rise of the tip; share of the chord */
    float body[3], trim[3];
} plane;

static void use_colour(lf_builder *b, const float colour[3])
{
    memcpy(b->colour, colour, sizeof b->colour);
}

static void draw_wing(lf_builder *b, plane *p)
{
    static const double range[KINDS][10] = {
        /* root      tip / root   half span    sweep        dihedral */
        {0.17, 0.24, 0.65, 1.00, 0.55, 0.72, 0.00, 0.04, 0.02, 0.08},
        {0.20, 0.27, 0.30, 0.45, 0.42, 0.58, 0.16, 0.28, 0.03, 0.08},
        {0.19, 0.25, 0.35, 0.50, 0.36, 0.50, 0.10, 0.22, 0.02, 0.06},
        {0.36, 0.55, 0.12, 0.35, 0.26, 0.38, 0.12, 0.24, -0.02, 0.01}};
    const double *r = range[p->kind];
    p->root = lf_build_between(b, r[0], r[1]);
    p->tip = p->root * lf_build_between(b, r[2], r[3]);
    p->half_span = lf_build_between(b, r[4], r[5]);
    p->sweep = lf_build_between(b, r[6], r[7]);
    p->dihedral = lf_build_between(b, r[8], r[9]);
    p->thickness = lf_build_between(b, 0.13, 0.17);
    const bool high = p->kind == LIGHT ? lf_build_chance(b, 0.55) : lf_build_chance(b, 0.2);
    p->wing_y = (high ? 0.75 : p->kind == FIGHTER ? 0 : -0.6) * p->radius;
    p->wing_z = lf_build_between(b, -0.12, 0.0) + (p->kind == FIGHTER ? 0.16 : 0);
}

static void draw_plane(lf_builder *b, plane *p)
{
    static const double fat[KINDS][2] = {
        {0.068, 0.092}, {0.056, 0.076}, {0.055, 0.072}, {0.052, 0.068}};
    p->kind = (enum kind)lf_build_choice(b, KINDS);
    p->radius = lf_build_between(b, fat[p->kind][0], fat[p->kind][1]);
    draw_wing(b, p);
    const double u = lf_build_between(b, 0, 1);
    if (p->kind == FIGHTER)
        p->tail = u < 0.5 ? TAIL_TWIN : TAIL_PLAIN;
    else if (p->kind == BUSINESS)
        p->tail = u < 0.8 ? TAIL_T : TAIL_PLAIN;
    else
        p->tail = u < 0.65 ? TAIL_PLAIN : u < 0.85 ? TAIL_T : TAIL_V;
    lf_build_random_colour(b);
    memcpy(p->trim, b->colour, sizeof p->trim);
    if (p->kind == AIRLINER || p->kind == BUSINESS || lf_build_chance(b, 0.4))
        lf_build_colour(b, 0.88, 0.88, 0.9);
    else
        lf_build_random_colour(b);
    memcpy(p->body, b->colour, sizeof p->body);
}

/* Rings of an ellipse along z: nose, barrel, upswept tail cone. */
static void build_fuselage(lf_builder *b, const plane *p)
{
    enum { rings = 12, corners = 16 };
    static const double at[rings] = {-0.5, -0.49, -0.47, -0.44, -0.39, -0.30,
                                     -0.1, 0.12,  0.26,  0.38,  0.46,  0.5};
    static const double airliner[rings] = {0.08, 0.38, 0.65, 0.84, 0.96, 1,
                                           1,    1,    0.93, 0.66, 0.4,  0.22};
    static const double light[rings] = {0.3, 0.52, 0.62, 0.68, 0.76, 0.92,
                                        1,   0.86, 0.64, 0.46, 0.34, 0.28};
    static const double fighter[rings] = {0.05, 0.14, 0.26, 0.40, 0.58, 0.80,
                                          1,    1.05, 1.0,  0.92, 0.8,  0.66};
    const double *shape = p->kind == LIGHT ? light : p->kind == FIGHTER ? fighter : airliner;
    const double upsweep = p->kind == FIGHTER ? 0.1 : 0.75;
    const double tall = lf_build_between(b, 0.95, 1.15);
    double point[rings][LF_RING_MAX][3];
    for (int r = 0; r < rings; r++)
        for (int i = 0; i < corners; i++) {
            const double angle = 2 * 3.14159265358979323846 * i / corners;
            const double rise = at[r] > 0.12 ? upsweep * (1 - shape[r]) * p->radius : 0;
            point[r][i][0] = p->radius * shape[r] * cos(angle);
            point[r][i][1] = p->radius * shape[r] * tall * sin(angle) + rise;
            point[r][i][2] = at[r];
        }
    use_colour(b, p->body);
    lf_build_loft(b, rings, corners, point);
}

/* One section of a wing: a slim hexagon in the plane across the span. `up` is the direction of
 * thickness: (0,1,0) for wings, (1,0,0) for fins, between for V tails. */
static void section(double (*ring)[3], const double at[3], double chord, double thickness,
                    const double up[3])
{
    static const double along[6] = {-0.5, -0.3, 0.1, 0.5, 0.1, -0.3};
    static const double across[6] = {0, 0.5, 0.45, 0.06, -0.4, -0.5};
    for (int i = 0; i < 6; i++) {
        for (int j = 0; j < 3; j++)
            ring[i][j] = at[j] + up[j] * across[i] * thickness;
        ring[i][2] += along[i] * chord;
    }
}

static void build_wing(lf_builder *b, const plane *p)
{
    double point[5][LF_RING_MAX][3];
    const double up[3] = {0, 1, 0}, share[5] = {-1, -0.5, 0, 0.5, 1};
    for (int r = 0; r < 5; r++) {
        const double t = fabs(share[r]), chord = p->root + t * (p->tip - p->root);
        const double at[3] = {share[r] * p->half_span, p->wing_y + t * p->dihedral,
                              p->wing_z + t * p->sweep};
        section(point[r], at, chord, fmax(p->thickness * chord * (1 - 0.25 * t), 0.026), up);
    }
    use_colour(b, p->body);
    lf_build_loft(b, 5, 6, point);
}

/* A fin or half tailplane from root to tip. */
static void build_fin(lf_builder *b, const double root[3], double root_chord, const double tip[3],
                      double tip_chord)
{
    double point[2][LF_RING_MAX][3], up[3];
    const double dx = tip[0] - root[0], dy = tip[1] - root[1], length = hypot(dx, dy);
    up[0] = -dy / length;
    up[1] = dx / length;
    up[2] = 0;
    section(point[0], root, root_chord, fmax(0.14 * root_chord, 0.023), up);
    section(point[1], tip, tip_chord, fmax(0.13 * tip_chord, 0.020), up);
    lf_build_loft(b, 2, 6, point);
}

static void build_tail(lf_builder *b, const plane *p)
{
    const double y = p->kind == FIGHTER ? 0.5 * p->radius : 0.55 * p->radius;
    const double height = lf_build_between(b, 0.14, 0.20), chord = lf_build_between(b, 0.12, 0.17);
    const double span = lf_build_between(b, 0.15, 0.22), back = lf_build_between(b, 0.03, 0.09);
    const double z = 0.5 - 0.5 * chord, taper = lf_build_between(b, 0.5, 0.75);
    const double flat_y = p->tail == TAIL_T ? y + height : 0.35 * y;
    use_colour(b, p->trim);
    if (p->tail == TAIL_V) {
        for (int side = -1; side <= 1; side += 2)
            build_fin(b, (double[3]){0, 0.6 * y, z}, chord,
                      (double[3]){side * 0.8 * span, y + 0.8 * height, z + back}, taper * chord);
        return;
    }
    const int fins = p->tail == TAIL_TWIN ? 2 : 1;
    for (int i = 0; i < fins; i++) {
        const double x = fins == 2 ? (2 * i - 1) * 0.75 * p->radius : 0;
        build_fin(b, (double[3]){x, 0.3 * y, z}, chord,
                  (double[3]){x + (fins == 2 ? (2 * i - 1) * 0.03 : 0), y + height, z + back},
                  (p->tail == TAIL_T ? 0.8 : taper) * chord);
    }
    const double shift = p->tail == TAIL_T ? back : 0;
    for (int side = -1; side <= 1; side += 2)
        build_fin(b, (double[3]){-side * 0.01, flat_y, z + shift}, 0.8 * chord,
                  (double[3]){side * span, flat_y + 0.02, z + shift + 0.6 * back}, 0.5 * chord);
}

/* A jet engine: a barrel along z with narrower ends. */
static void build_nacelle(lf_builder *b, double x, double y, double z, double radius, double length)
{
    enum { rings = 4, corners = 12 };
    static const double at[rings] = {-0.5, -0.35, 0.2, 0.5}, wide[rings] = {0.85, 1, 0.95, 0.6};
    double point[rings][LF_RING_MAX][3];
    for (int r = 0; r < rings; r++)
        for (int i = 0; i < corners; i++) {
            const double angle = 2 * 3.14159265358979323846 * i / corners;
            point[r][i][0] = x + radius * wide[r] * cos(angle);
            point[r][i][1] = y + radius * wide[r] * sin(angle);
            point[r][i][2] = z + length * at[r];
        }
    lf_build_loft(b, rings, corners, point);
}

/* Engines under the wing at a share of the half span, with pylons. */
static void build_wing_engines(lf_builder *b, const plane *p, double share, bool propeller)
{
    const double chord = p->root + share * (p->tip - p->root), radius = propeller ? 0.026 : 0.03;
    const double y = p->wing_y + share * p->dihedral - (propeller ? 0 : 0.036);
    const double z = p->wing_z + share * p->sweep - 0.45 * chord;
    for (int side = -1; side <= 1; side += 2) {
        const double x = side * share * p->half_span;
        use_colour(b, p->trim);
        build_nacelle(b, x, y, z, radius, propeller ? 0.9 * chord : 0.14);
        if (propeller) {
            lf_build_colour(b, 0.15, 0.15, 0.15);
            lf_build_box(b, x, y, z - 0.46 * chord, 0.007, 0.09, 0.007);
        } else {
            lf_build_box(b, x, y + 0.022, z + 0.03, 0.008, 0.02, 0.06);
        }
    }
}

static void build_nose_propeller(lf_builder *b, const plane *p)
{
    const double spinner = 0.36 * p->radius, blade = lf_build_between(b, 1.5, 1.9) * p->radius;
    lf_build_colour(b, 0.15, 0.15, 0.15);
    lf_build_bar(b, 2, 12, (lf_end){{0, 0, -0.55}, {0.006, 0.006}},
                 (lf_end){{0, 0, -0.49}, {spinner, spinner}});
    const bool upright = lf_build_chance(b, 0.5);
    lf_build_box(b, 0, 0, -0.517, upright ? 0.012 : blade, upright ? blade : 0.012, 0.007);
    if (lf_build_chance(b, 0.4))
        lf_build_box(b, 0, 0, -0.517, upright ? blade : 0.012, upright ? 0.012 : blade, 0.007);
}

static void build_rear_engines(lf_builder *b, const plane *p)
{
    const double radius = lf_build_between(b, 0.026, 0.034), x = p->radius + 0.8 * radius;
    use_colour(b, p->trim);
    for (int side = -1; side <= 1; side += 2) {
        build_nacelle(b, side * x, 0.35 * p->radius, 0.27, radius, 0.16);
        lf_build_box(b, side * 0.7 * x, 0.35 * p->radius, 0.27, 0.4 * x, 0.009, 0.05);
    }
}

static void build_engines(lf_builder *b, const plane *p)
{
    if (p->kind == LIGHT) {
        if (lf_build_chance(b, 0.7))
            build_nose_propeller(b, p);
        else
            build_wing_engines(b, p, 0.3, true);
    } else if (p->kind == AIRLINER) {
        build_wing_engines(b, p, 0.34, false);
        if (lf_build_chance(b, 0.35))
            build_wing_engines(b, p, 0.62, false);
    } else if (p->kind == BUSINESS) {
        build_rear_engines(b, p);
    } else { /* fighter: nozzle */
        lf_build_colour(b, 0.2, 0.2, 0.22);
        build_nacelle(b, 0, 0.1 * p->radius, 0.5, 0.62 * p->radius, 0.08);
    }
}

/* Cockpit or windscreen. */
static void build_canopy(lf_builder *b, const plane *p)
{
    const double z = p->kind == LIGHT ? -0.2 : p->kind == FIGHTER ? -0.25 : -0.42;
    const double length = p->kind == LIGHT ? 0.14 : p->kind == FIGHTER ? 0.13 : 0.045;
    const double y = (p->kind == FIGHTER ? 0.55 : p->kind == LIGHT ? 0.75 : 0.5) * p->radius;
    lf_build_colour(b, 0.2, 0.28, 0.36);
    lf_build_ellipsoid(b, (double[3]){0, y, z},
                       (double[3]){0.62 * p->radius, 0.55 * p->radius, length});
}

static void build_gear(lf_builder *b, const plane *p)
{
    const double y = -p->radius - lf_build_between(b, 0.05, 0.08), x = 0.09, z = p->wing_z - 0.03;
    for (int i = 0; i < 3; i++) {
        const double at[3] = {i == 2 ? 0 : (2 * i - 1) * x, y, i == 2 ? -0.4 : z};
        use_colour(b, p->body);
        lf_build_bar(b, 1, 4, (lf_end){{at[0], at[1], at[2]}, {0.008, 0.01}},
                     (lf_end){{0.4 * at[0], -0.4 * p->radius, at[2]}, {0.01, 0.014}});
        lf_build_colour(b, 0.1, 0.1, 0.1);
        lf_build_bar(b, 0, 12, (lf_end){{at[0] - 0.012, at[1], at[2]}, {0.028, 0.028}},
                     (lf_end){{at[0] + 0.012, at[1], at[2]}, {0.028, 0.028}});
    }
}

void lf_build_airplane(lf_builder *b)
{
    plane p;
    draw_plane(b, &p);
    build_fuselage(b, &p);
    build_wing(b, &p);
    build_tail(b, &p);
    build_engines(b, &p);
    build_canopy(b, &p);
    if (p.kind == LIGHT && lf_build_chance(b, 0.7))
        build_gear(b, &p);
}
