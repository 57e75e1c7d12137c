/* procedural_build.h: the parts that procedural shapes are made of; own to datasets/procedural*.
 *
 * Every part is a loft: `rings` closed polygons of `corners` points each, joined one to the next,
 * with a fan from its mean point over the first and the last. Rings must be star-shaped seen from
 * their mean. The winding is turned outward by the sign of the volume.
 */
#ifndef LF_DATASETS_PROCEDURAL_BUILD_H
#define LF_DATASETS_PROCEDURAL_BUILD_H

#include "autograd/random.h"
#include "datasets/procedural.h"

typedef struct lf_builder {
    lf_mesh *mesh;
    lf_parts parts;
    float colour[3]; /* of the next parts */
    lf_stream random;
} lf_builder;

enum { LF_RING_MAX = 24, LF_RINGS_MAX = 16 };

void lf_build_loft(lf_builder *b, int rings, int corners, double (*point)[LF_RING_MAX][3]);

/* Box of the given centre and half sizes. */
void lf_build_box(lf_builder *b, double x, double y, double z, double hx, double hy, double hz);

/* Bar from one end to the other. The end polygons are perpendicular to the coordinate axis `axis`
 * (0 x, 1 y, 2 z), with half widths half[2] along the next two axes in the order x, y, z, x;
 * sides 4 gives rectangles, more gives ellipses. */
typedef struct lf_end {
    double at[3];
    double half[2];
} lf_end;
void lf_build_bar(lf_builder *b, int axis, int sides, lf_end from, lf_end to);

void lf_build_ellipsoid(lf_builder *b, const double centre[3], const double radius[3]);

/* Uniform in low..high; true with probability p; one of n. */
double lf_build_between(lf_builder *b, double low, double high);
bool lf_build_chance(lf_builder *b, double p);
int lf_build_choice(lf_builder *b, int n);

void lf_build_colour(lf_builder *b, double red, double green, double blue);
/* A colour of its own, neither black nor white. */
void lf_build_random_colour(lf_builder *b);

void lf_build_chair(lf_builder *b);
void lf_build_airplane(lf_builder *b);
void lf_build_car(lf_builder *b);

#endif
