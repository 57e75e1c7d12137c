/* sdf_winding.h: generalised winding number of an unoriented triangle soup; internal to sdf.c.
 *
 *   w(p) = sum over faces of weight x solid angle / 4 pi        (1 inside a closed outward surface)
 * Solid angles after van Oosterom and Strackee 1983; far groups of faces by one dipole (Barill et
 * al., "Fast winding numbers for soups and clouds", 2018, first order).
 */
#ifndef LF_DATASETS_SDF_WINDING_H
#define LF_DATASETS_SDF_WINDING_H

#include "datasets/mesh.h"

typedef struct lf_winding lf_winding;

/* weight[face]: +1 as the corners go, -1 turned round, 0 left out. Keeps no reference. */
lf_winding *lf_winding_open(const lf_mesh *mesh, const signed char *weight);
void lf_winding_close(lf_winding *w);
double lf_winding_at(const lf_winding *w, const double p[3]);

/* Edges of the mesh, vertices at equal positions taken as one. */
typedef struct lf_soup {
    long edges, open_edges; /* open: an odd number of faces */
    bool closed;            /* every edge, with `turn`, has as many faces one way as the other: the
                               winding number is a whole number everywhere off the surface */
    int32_t *component;     /* [faces] faces joined across edges of exactly two faces */
    signed char *turn;      /* [faces] +1 or -1: with it a component is oriented one way */
    long components;
} lf_soup;

lf_soup lf_soup_open(const lf_mesh *mesh);
void lf_soup_close(lf_soup *soup);

#endif
