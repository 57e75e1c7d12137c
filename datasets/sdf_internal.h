/* sdf_internal.h: the prepared soup, shared by sdf.c and sdf_sight.c. */
#ifndef LF_DATASETS_SDF_INTERNAL_H
#define LF_DATASETS_SDF_INTERNAL_H

#include "datasets/sdf.h"
#include "datasets/sdf_winding.h"
#include "datasets/surface.h"

struct lf_sdf {
    lf_sdf_options options;
    lf_sdf_report report;
    int inside_below;       /* escapes that still count as inside, exclusive */
    int clear_from;         /* escapes from which a point is clearly outside */
    float (*packet)[3][8];  /* [directions / 8] */
    lf_surface *all;        /* every face: the sign's rays */
    lf_mesh *seen_mesh;     /* faces seen from outside ... */
    lf_surface *seen;       /* ... for the distance */
    lf_winding *winding;    /* NULL unless the sign uses it */
    double low[3], high[3]; /* box of the mesh */
};

/* Fill s->packet: the directions, eight at a time. */
void lf_sdf_make_packets(lf_sdf *s);
/* How many directions leave the mesh from p, counted in packets until `enough` or `packets`. */
int lf_sdf_escapes(const lf_sdf *s, const double p[3], int packets, int enough);
/* Fill s->seen_mesh and s->seen. */
lf_status lf_sdf_find_seen(lf_sdf *s, const lf_mesh *mesh, lf_error *err);
/* Fill s->winding where the sign uses it, and the edge counts of the report. */
void lf_sdf_prepare_winding(lf_sdf *s, const lf_mesh *mesh);

#endif
