/* surface_internal.h: the surface's inside, shared by surface.c and surface_closest.c. */
#ifndef LF_DATASETS_SURFACE_INTERNAL_H
#define LF_DATASETS_SURFACE_INTERNAL_H

#include "datasets/surface.h"

#ifdef LF_EMBREE4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

struct lf_surface {
    lf_mesh *mesh;
    long *original; /* face number in the mesh of Embree's primitive, of positive area and kept */
    long primitives;
    double centre[3], diagonal;
    RTCDevice device;
    RTCScene scene;
};

/* Coordinates as Embree has them: relative to the centre, in diagonals. */
static inline void lf_surface_local(const lf_surface *s, const double p[3], float out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = (float)((p[i] - s->centre[i]) / s->diagonal);
}

static inline void lf_subtract(const double a[3], const double b[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = a[i] - b[i];
}

static inline double lf_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

#endif
