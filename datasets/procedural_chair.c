/* procedural_chair.c: chairs, in metres before normalisation; y = 0 is the floor, the back at +z.
 *
 * Six kinds of legs, four kinds of seats, five kinds of backs, three kinds of arms, with free
 * proportions: a shape of the test set is always a new one.
 */
#include <math.h>

#include "datasets/procedural_build.h"

enum leg_style { LEGS_STRAIGHT, LEGS_SPLAYED, LEGS_TAPERED, LEGS_SLED, LEGS_PEDESTAL, LEGS_PANELS };
enum seat_style { SEAT_SQUARE, SEAT_ROUND, SEAT_TRAPEZE, SEAT_CUSHION };
enum back_style { BACK_SOLID, BACK_SLATS, BACK_FRAME, BACK_CURVED, BACK_RAIL };
enum arm_style { ARMS_POSTS, ARMS_SOLID, ARMS_FLOATING };

typedef struct chair {
    double hw, hd;      /* half width and depth of the seat */
    double seat, thick; /* height of the seat's lower side, its thickness */
    double leg;         /* half width of a leg */
    double back, lean;  /* height of the back above the seat, how far its top is behind */
    double half_back;   /* half thickness of the back */
    enum leg_style legs;
    enum seat_style seats;
    enum back_style backs;
    float frame[3], cover[3]; /* colours of legs and of seat and back */
} chair;

static void use_colour(lf_builder *b, const float colour[3])
{
    memcpy(b->colour, colour, sizeof b->colour);
}

static lf_end end_at(double x, double y, double z, double h0, double h1)
{
    return (lf_end){{x, y, z}, {h0, h1}};
}

static void draw_chair(lf_builder *b, chair *c)
{
    c->hw = lf_build_between(b, 0.20, 0.31);
    c->hd = lf_build_between(b, 0.20, 0.29);
    c->seat = lf_build_between(b, 0.32, 0.50);
    c->thick = lf_build_between(b, 0.045, 0.10);
    c->leg = lf_build_between(b, 0.024, 0.038);
    c->back = lf_build_between(b, 0.34, 0.62);
    c->lean = lf_build_between(b, 0.0, 0.13);
    c->half_back = lf_build_between(b, 0.023, 0.036);
    c->legs = (enum leg_style)lf_build_choice(b, 6);
    c->seats = (enum seat_style)lf_build_choice(b, 4);
    c->backs = (enum back_style)lf_build_choice(b, 5);
    lf_build_random_colour(b);
    memcpy(c->frame, b->colour, sizeof c->frame);
    lf_build_random_colour(b);
    memcpy(c->cover, b->colour, sizeof c->cover);
}

static void build_seat(lf_builder *b, const chair *c)
{
    const double y0 = c->seat, y1 = c->seat + c->thick;
    use_colour(b, c->cover);
    if (c->seats == SEAT_ROUND) {
        lf_build_bar(b, 1, 20, end_at(0, y0, 0, c->hw, c->hd), end_at(0, y1, 0, c->hw, c->hd));
    } else if (c->seats == SEAT_TRAPEZE) { /* wider in front */
        lf_build_bar(b, 2, 4, end_at(0, (y0 + y1) / 2, -c->hd, c->hw, c->thick / 2),
                     end_at(0, (y0 + y1) / 2, c->hd, 0.78 * c->hw, c->thick / 2));
    } else {
        lf_build_box(b, 0, (y0 + y1) / 2, 0, c->hw, c->thick / 2, c->hd);
    }
    if (c->seats == SEAT_CUSHION)
        lf_build_bar(b, 1, 16, end_at(0, y1 - 0.01, 0, 0.93 * c->hw, 0.93 * c->hd),
                     end_at(0, y1 + 0.045, 0, 0.8 * c->hw, 0.8 * c->hd));
}

/* Where legs stand: closer to the middle under a round or narrowing seat. */
static double leg_inset(const chair *c)
{
    return c->seats == SEAT_ROUND ? 0.66 : c->seats == SEAT_TRAPEZE ? 0.72 : 0.97;
}

static void build_four_legs(lf_builder *b, const chair *c)
{
    const double inset = leg_inset(c), top = c->seat + 0.5 * c->thick;
    const double spread = c->legs == LEGS_SPLAYED ? lf_build_between(b, 1.12, 1.4) : 1;
    const double foot = c->legs == LEGS_TAPERED ? 0.62 : 1,
                 head = c->legs == LEGS_TAPERED ? 1.45 : 1;
    const double x = inset * c->hw - c->leg, z = inset * c->hd - c->leg;
    const int sides = lf_build_chance(b, 0.5) ? 4 : 10;
    const bool stretchers = lf_build_chance(b, 0.35);
    const double height = lf_build_between(b, 0.25, 0.45);
    const double at = 1 + (spread - 1) * (1 - height); /* spread of the legs at that height */
    for (int i = 0; i < 4; i++) {
        const double sx = i & 1 ? x : -x, sz = i & 2 ? z : -z;
        lf_build_bar(b, 1, sides, end_at(spread * sx, 0, spread * sz, foot * c->leg, foot * c->leg),
                     end_at(sx, top, sz, head * c->leg, head * c->leg));
    }
    for (int i = 0; stretchers && i < 2; i++) {
        const double sx = (i ? x : -x) * at;
        lf_build_bar(b, 2, 4, end_at(sx, height * c->seat, -z * at, 0.023, 0.023),
                     end_at(sx, height * c->seat, z * at, 0.023, 0.023));
    }
    if (stretchers)
        lf_build_box(b, 0, height * c->seat, 0, x * at, 0.023, 0.023);
}

/* Two frames that stand on runners. */
static void build_sled(lf_builder *b, const chair *c)
{
    const double x = leg_inset(c) * c->hw - c->leg, z = leg_inset(c) * c->hd - c->leg;
    const double top = c->seat + 0.5 * c->thick, forward = lf_build_between(b, 0, 0.5) * z;
    const bool cantilever = lf_build_chance(b, 0.4); /* no rear legs: the seat floats */
    for (int side = -1; side <= 1; side += 2) {
        lf_build_bar(b, 2, 4, end_at(side * x, c->leg, -z - c->leg, c->leg, c->leg),
                     end_at(side * x, c->leg, z + c->leg, c->leg, c->leg));
        lf_build_bar(b, 1, 4, end_at(side * x, 0, -z, c->leg, c->leg),
                     end_at(side * x, top, -z, c->leg, c->leg));
        if (!cantilever)
            lf_build_bar(b, 1, 4, end_at(side * x, 0, z, c->leg, c->leg),
                         end_at(side * x, top, z - forward, c->leg, c->leg));
    }
    if (cantilever)
        lf_build_box(b, 0, c->leg, z, x, c->leg, c->leg);
}

/* One column on a star of arms with feet, or on a disc. */
static void build_pedestal(lf_builder *b, const chair *c)
{
    const double radius = lf_build_between(b, 0.20, 0.29),
                 column = lf_build_between(b, 0.028, 0.05);
    lf_build_bar(b, 1, 12, end_at(0, 0.03, 0, column, column),
                 end_at(0, c->seat + 0.5 * c->thick, 0, column, column));
    if (lf_build_chance(b, 0.3)) {
        lf_build_bar(b, 1, 20, end_at(0, 0, 0, radius, radius),
                     end_at(0, 0.045, 0, 0.9 * radius, 0.9 * radius));
        return;
    }
    const int arms = 4 + lf_build_choice(b, 2);
    for (int i = 0; i < arms; i++) {
        const double angle = 2 * 3.14159265358979323846 * (i + 0.25) / arms;
        const double x = radius * cos(angle), z = radius * sin(angle);
        const int axis = fabs(x) > fabs(z) ? 0 : 2;
        const bool along_x = axis == 0;
        lf_build_bar(b, axis, 4,
                     end_at(0, 0.09, 0, along_x ? 0.027 : 0.029, along_x ? 0.029 : 0.027),
                     end_at(x, 0.055, z, along_x ? 0.024 : 0.025, along_x ? 0.025 : 0.024));
        lf_build_ellipsoid(b, (double[3]){x, 0.03, z}, (double[3]){0.032, 0.032, 0.032});
    }
}

static void build_panels(lf_builder *b, const chair *c)
{
    const double x = leg_inset(c) * c->hw - c->leg, depth = leg_inset(c) * c->hd;
    const double half = 0.5 * (c->seat + 0.5 * c->thick);
    for (int side = -1; side <= 1; side += 2)
        lf_build_box(b, side * x, half, 0, c->leg, half, depth);
    if (lf_build_chance(b, 0.5))
        lf_build_box(b, 0, half, depth - c->leg, x, half, c->leg);
}

static void build_legs(lf_builder *b, const chair *c)
{
    use_colour(b, c->frame);
    if (c->legs == LEGS_SLED)
        build_sled(b, c);
    else if (c->legs == LEGS_PEDESTAL)
        build_pedestal(b, c);
    else if (c->legs == LEGS_PANELS)
        build_panels(b, c);
    else
        build_four_legs(b, c);
}

/* A piece of the back between two heights (shares of the back's height) and two sides. */
static void back_piece(lf_builder *b, const chair *c, double x0, double x1, double low, double high)
{
    const double base = c->seat + 0.4 * c->thick, half = (x1 - x0) / 2;
    const double z = (c->seats == SEAT_ROUND ? 0.80 : 0.98) * c->hd - 0.028;
    lf_build_bar(
        b, 1, 4, end_at((x0 + x1) / 2, base + low * c->back, z + low * c->lean, half, c->half_back),
        end_at((x0 + x1) / 2, base + high * c->back, z + high * c->lean, half, c->half_back));
}

/* Bent round the sitter: rectangles lofted along x, the sides further forward. */
static void build_curved_back(lf_builder *b, const chair *c, double half_width)
{
    enum { rings = 9 };
    double point[rings][LF_RING_MAX][3];
    const double bend = lf_build_between(b, 0.06, 0.16), start = lf_build_between(b, 0, 0.25);
    const double base = c->seat + 0.4 * c->thick, z = 0.98 * c->hd - 0.028;
    for (int r = 0; r < rings; r++) {
        const double t = 2.0 * r / (rings - 1) - 1;
        for (int i = 0; i < 4; i++) {
            const double height = i < 2 ? start : 1 - 0.12 * t * t;
            point[r][i][0] = half_width * t;
            point[r][i][1] = base + height * c->back;
            point[r][i][2] = z + height * c->lean - bend * t * t +
                             (i == 0 || i == 3 ? -1.2 : 1.2) * c->half_back;
        }
    }
    lf_build_loft(b, rings, 4, point);
    if (start > 0.05)
        for (int side = -1; side <= 1; side += 2)
            back_piece(b, c, side * 0.3 * half_width - c->half_back,
                       side * 0.3 * half_width + c->half_back, 0, start + 0.1);
}

static void build_slats(lf_builder *b, const chair *c, double w)
{
    const int slats = 3 + lf_build_choice(b, 3);
    const double half = fmin(lf_build_between(b, 0.023, 0.035), 0.7 * w / slats);
    for (int i = 0; i < slats; i++) {
        const double x = (w - half) * (2.0 * i / (slats - 1) - 1);
        back_piece(b, c, x - half, x + half, 0, 0.96);
    }
    back_piece(b, c, -w, w, 0.84, 1);
}

static void build_frame_back(lf_builder *b, const chair *c, double w)
{
    const int rails = 2 + lf_build_choice(b, 3);
    const double half = lf_build_between(b, 0.04, 0.08);
    back_piece(b, c, -w, -w + 2 * c->half_back, 0, 1);
    back_piece(b, c, w - 2 * c->half_back, w, 0, 1);
    for (int i = 0; i < rails; i++) {
        const double top = 1 - 0.62 * i / (rails - 1.0 + 0.5);
        back_piece(b, c, -w, w, top - 2 * half * 0.7, top);
    }
}

/* One wide rail on two posts that lie within its thickness. */
static void build_rail(lf_builder *b, const chair *c, double w)
{
    const double low = lf_build_between(b, 0.35, 0.6);
    chair slim = *c;
    slim.half_back = 0.85 * c->half_back;
    for (int side = -1; side <= 1; side += 2) {
        const double x = side * (0.75 * w - c->half_back);
        back_piece(b, &slim, x - c->half_back, x + c->half_back, 0, 0.9);
    }
    use_colour(b, c->cover);
    back_piece(b, c, -w, w, low, 1);
}

static void build_back(lf_builder *b, const chair *c)
{
    const double narrow = c->seats == SEAT_ROUND ? 0.72 : c->seats == SEAT_TRAPEZE ? 0.78 : 0.98;
    const double w = narrow * c->hw;
    use_colour(b, c->backs == BACK_SOLID || c->backs == BACK_CURVED ? c->cover : c->frame);
    if (c->backs == BACK_SOLID) {
        back_piece(b, c, -w, w, 0, 1);
    } else if (c->backs == BACK_SLATS) {
        build_slats(b, c, w);
    } else if (c->backs == BACK_FRAME) {
        build_frame_back(b, c, w);
    } else if (c->backs == BACK_CURVED) {
        build_curved_back(b, c, w);
    } else {
        build_rail(b, c, w);
    }
}

static void build_arms(lf_builder *b, const chair *c)
{
    const enum arm_style style = (enum arm_style)lf_build_choice(b, 3);
    const double y = c->seat + c->thick, height = lf_build_between(b, 0.16, 0.26);
    const double half = lf_build_between(b, 0.024, 0.04), front = lf_build_between(b, 0.6, 0.98);
    const double x = c->hw + half - 0.015;
    const double z0 = -front * c->hd, z1 = 0.96 * c->hd;
    use_colour(b, style == ARMS_SOLID ? c->cover : c->frame);
    for (int side = -1; side <= 1; side += 2) {
        if (style == ARMS_SOLID) {
            lf_build_box(b, side * x, y + (height - c->thick) / 2, (z0 + z1) / 2, half,
                         (height + c->thick) / 2, (z1 - z0) / 2);
            continue;
        }
        lf_build_box(b, side * x, y + height, (z0 + z1) / 2, half, 0.024, (z1 - z0) / 2);
        lf_build_box(b, side * x, y + (height - c->thick) / 2, z1 - 0.03, 0.024,
                     (height + c->thick) / 2, 0.024);
        if (style == ARMS_POSTS)
            lf_build_box(b, side * x, y + (height - c->thick) / 2, z0 + 0.06, 0.024,
                         (height + c->thick) / 2, 0.024);
    }
}

void lf_build_chair(lf_builder *b)
{
    chair c;
    draw_chair(b, &c);
    build_seat(b, &c);
    build_legs(b, &c);
    build_back(b, &c);
    const bool straight = c.seats == SEAT_SQUARE || c.seats == SEAT_CUSHION;
    if (straight && lf_build_chance(b, 0.5))
        build_arms(b, &c); /* round and narrowing seats would leave the posts in the air */
}
