/* procedural_car.c: cars, about 4.4 long before normalisation; y = 0 is the road, bonnet at -z.
 *
 * A body lofted across the width, a glass cabin lofted upwards under a roof, four wheels, lights.
 * Seven kinds set the profile; all lengths are drawn.
 */
#include <math.h>

#include "datasets/procedural_build.h"

enum kind { SEDAN, HATCH, WAGON, COUPE, SUV, VAN, PICKUP, KINDS };

typedef struct car {
    enum kind kind;
    double front, rear;      /* z of the bumpers */
    double half;             /* half width */
    double sill, belt, roof; /* heights: lower edge, window line, roof */
    double nose;             /* height of the bonnet's front edge */
    double glass[4];         /* z of windscreen foot, roof front, roof rear, rear window foot */
    double wheel, track[2];  /* radius; z of the axles */
    float paint[3];
} car;

static void use_colour(lf_builder *b, const float colour[3])
{
    memcpy(b->colour, colour, sizeof b->colour);
}

static void draw_glass(lf_builder *b, car *c)
{
    static const double shares[KINDS][4] = {/* of the length, from the front */
                                            {0.27, 0.42, 0.70, 0.84}, {0.26, 0.41, 0.86, 0.97},
                                            {0.25, 0.38, 0.92, 0.98}, {0.33, 0.47, 0.66, 0.90},
                                            {0.26, 0.37, 0.90, 0.97}, {0.05, 0.17, 0.97, 0.985},
                                            {0.26, 0.38, 0.56, 0.60}};
    for (int i = 0; i < 4; i++) {
        const double jitter = c->kind == VAN || i == 3 ? 0.006 : 0.02;
        const double share = shares[c->kind][i] + lf_build_between(b, -jitter, jitter);
        c->glass[i] = c->front + share * (c->rear - c->front);
    }
}

static void draw_car(lf_builder *b, car *c)
{
    static const double roofs[KINDS][2] = {{1.38, 1.50}, {1.42, 1.56}, {1.42, 1.54}, {1.20, 1.32},
                                           {1.65, 1.85}, {1.85, 2.25}, {1.68, 1.85}};
    static const double lengths[KINDS][2] = {{4.3, 4.9}, {3.6, 4.2}, {4.4, 4.8}, {4.1, 4.6},
                                             {4.3, 4.8}, {4.3, 5.2}, {4.8, 5.4}};
    c->kind = (enum kind)lf_build_choice(b, KINDS);
    const double length = lf_build_between(b, lengths[c->kind][0], lengths[c->kind][1]);
    const bool tall = c->kind == SUV || c->kind == PICKUP || c->kind == VAN;
    c->front = -0.5 * length;
    c->rear = 0.5 * length;
    c->half = lf_build_between(b, 0.84, tall ? 1.0 : 0.93);
    c->wheel = lf_build_between(b, 0.31, 0.36) + (tall ? 0.05 : 0);
    c->sill = c->wheel * lf_build_between(b, 0.6, 0.8);
    c->roof = lf_build_between(b, roofs[c->kind][0], roofs[c->kind][1]);
    c->belt = c->roof * lf_build_between(b, 0.60, 0.66);
    c->nose = c->belt * lf_build_between(b, 0.72, 0.88);
    c->track[0] = c->front + lf_build_between(b, 0.17, 0.20) * length;
    c->track[1] = c->rear - lf_build_between(b, 0.18, 0.22) * length;
    draw_glass(b, c);
    lf_build_random_colour(b);
    memcpy(c->paint, b->colour, sizeof c->paint);
}

/* Side view of the body in (z, y), drawn in a little near the sides so that edges are round. */
static void body_ring(const car *c, double x, double inset, double (*ring)[3])
{
    const double tail = c->kind == PICKUP ? c->belt : c->belt - 0.04;
    const double z[8] = {c->front + 0.10, c->front,       c->front + 0.10, c->glass[0],
                         c->glass[3],     c->rear - 0.05, c->rear,         c->rear - 0.12};
    const double y[8] = {
        c->sill, 0.5 * (c->sill + c->nose), c->nose, c->belt, c->belt, tail, 0.65 * tail, c->sill};
    const double zm = 0.5 * (c->front + c->rear), ym = 0.5 * (c->sill + c->belt);
    for (int i = 0; i < 8; i++) {
        ring[i][0] = x;
        ring[i][1] = y[i] + inset * (ym - y[i]);
        ring[i][2] = z[i] + 0.25 * inset * (zm - z[i]);
    }
}

static void build_body(lf_builder *b, const car *c)
{
    static const double across[6] = {-1, -0.96, -0.8, 0.8, 0.96, 1};
    static const double inset[6] = {0.22, 0.07, 0, 0, 0.07, 0.22};
    double point[6][LF_RING_MAX][3];
    for (int r = 0; r < 6; r++)
        body_ring(c, across[r] * c->half, inset[r], point[r]);
    use_colour(b, c->paint);
    lf_build_loft(b, 6, 8, point);
}

/* A rectangle at one height: z from front to rear, half width. */
static void level(double (*ring)[3], double y, double front, double rear, double half)
{
    const double x[4] = {-half, half, half, -half}, z[4] = {front, front, rear, rear};
    for (int i = 0; i < 4; i++) {
        ring[i][0] = x[i];
        ring[i][1] = y;
        ring[i][2] = z[i];
    }
}

static void build_cabin(lf_builder *b, const car *c)
{
    double point[2][LF_RING_MAX][3];
    const double lean = lf_build_between(b, 0.80, 0.88), top = lean * c->half;
    level(point[0], c->belt - 0.08, c->glass[0], c->glass[3], 0.94 * c->half);
    level(point[1], c->roof - 0.03, c->glass[1], c->glass[2], top);
    lf_build_colour(b, 0.16, 0.2, 0.25);
    lf_build_loft(b, 2, 4, point);
    level(point[0], c->roof - 0.07, c->glass[1] - 0.05, c->glass[2] + 0.04, 1.02 * top);
    level(point[1], c->roof, c->glass[1] + 0.08, c->glass[2] - 0.08, 0.9 * top);
    use_colour(b, c->paint);
    lf_build_loft(b, 2, 4, point);
    if (c->kind == VAN && lf_build_chance(b, 0.6)) { /* closed sides behind the driver */
        const double z = c->glass[1] + 0.22 * (c->glass[2] - c->glass[1]);
        level(point[0], c->belt - 0.1, z, c->glass[3] + 0.01, 0.96 * c->half);
        level(point[1], c->roof - 0.02, z, c->glass[2] + 0.01, top + 0.02);
        lf_build_loft(b, 2, 4, point);
    }
}

static void build_pillars(lf_builder *b, const car *c)
{
    const double z = 0.5 * (c->glass[1] + c->glass[2]), top = 0.87 * c->half;
    if (c->kind == PICKUP || c->kind == COUPE)
        return;
    use_colour(b, c->paint);
    for (int side = -1; side <= 1; side += 2)
        lf_build_bar(b, 1, 4, (lf_end){{side * 0.93 * c->half, c->belt - 0.1, z}, {0.035, 0.06}},
                     (lf_end){{side * top, c->roof - 0.03, z}, {0.035, 0.05}});
}

/* Tread, then a lighter hub, for each corner. */
static void build_wheels(lf_builder *b, const car *c)
{
    const double r = c->wheel, wide = lf_build_between(b, 0.10, 0.13), x = c->half - 0.5 * wide;
    const double hub = r * lf_build_between(b, 0.5, 0.7);
    for (int i = 0; i < 4; i++) {
        const double side = i & 1 ? 1 : -1, z = c->track[i / 2];
        lf_build_colour(b, 0.08, 0.08, 0.08);
        lf_build_bar(b, 0, 18, (lf_end){{side * (x - wide), r, z}, {r, r}},
                     (lf_end){{side * (x + wide), r, z}, {r, r}});
        lf_build_colour(b, 0.65, 0.65, 0.68);
        lf_build_bar(b, 0, 12, (lf_end){{side * x, r, z}, {hub, hub}},
                     (lf_end){{side * (x + wide + 0.02), r, z}, {0.9 * hub, 0.9 * hub}});
    }
}

static void build_lights(lf_builder *b, const car *c)
{
    const double x = 0.7 * c->half, wide = lf_build_between(b, 0.10, 0.17);
    const double front_y = 0.55 * c->nose + 0.45 * (0.5 * (c->sill + c->nose));
    for (int side = -1; side <= 1; side += 2) {
        lf_build_colour(b, 0.95, 0.93, 0.75);
        lf_build_box(b, side * x, front_y, c->front + 0.08, wide, 0.06, 0.07);
        lf_build_colour(b, 0.75, 0.08, 0.06);
        lf_build_box(b, side * 1.08 * x, 0.8 * c->belt, c->rear - 0.06, 0.6 * wide, 0.07, 0.05);
    }
    lf_build_colour(b, 0.2, 0.2, 0.2);
    lf_build_box(b, 0, c->sill + 0.1, c->front + 0.06, 0.86 * c->half, 0.07, 0.09);
    lf_build_box(b, 0, c->sill + 0.1, c->rear - 0.07, 0.86 * c->half, 0.07, 0.09);
}

static void build_spoiler(lf_builder *b, const car *c)
{
    const double y = c->belt + lf_build_between(b, 0.14, 0.24), z = c->rear - 0.18;
    use_colour(b, c->paint);
    lf_build_box(b, 0, y, z, 0.85 * c->half, 0.03, 0.13);
    for (int side = -1; side <= 1; side += 2)
        lf_build_box(b, side * 0.6 * c->half, 0.5 * (y + c->belt - 0.1), z, 0.03,
                     0.5 * (y - c->belt + 0.1), 0.06);
}

/* The pickup's bed: walls above the body behind the cabin. */
static void build_bed(lf_builder *b, const car *c)
{
    const double z0 = c->glass[3] - 0.05, z1 = c->rear - 0.02, high = 0.13;
    use_colour(b, c->paint);
    for (int side = -1; side <= 1; side += 2)
        lf_build_box(b, side * 0.92 * c->half, c->belt - 0.02, 0.5 * (z0 + z1), 0.05, high,
                     0.5 * (z1 - z0));
    lf_build_box(b, 0, c->belt - 0.02, z1 - 0.05, 0.92 * c->half, high, 0.05);
}

void lf_build_car(lf_builder *b)
{
    car c;
    draw_car(b, &c);
    build_body(b, &c);
    build_cabin(b, &c);
    build_pillars(b, &c);
    build_wheels(b, &c);
    build_lights(b, &c);
    if (c.kind == PICKUP)
        build_bed(b, &c);
    else if (c.kind == COUPE || (c.kind == SEDAN && lf_build_chance(b, 0.25)))
        build_spoiler(b, &c);
    if (c.kind == SUV && lf_build_chance(b, 0.6)) {
        lf_build_colour(b, 0.12, 0.12, 0.12); /* spare wheel */
        lf_build_bar(b, 2, 16, (lf_end){{0, 0.95 * c.belt, c.rear - 0.06}, {0.33, 0.33}},
                     (lf_end){{0, 0.95 * c.belt, c.rear + 0.14}, {0.33, 0.33}});
    }
}
