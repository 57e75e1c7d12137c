/* mc_table.h: the 256 cases of marching cubes, derived instead of listed.
 *
 * A cell's corner c lies at (c & 1, c >> 1 & 1, c >> 2 & 1). Its 12 edges are numbered axis * 4 + k
 * and run along +axis; lf_mc_table names both ends. Bit c of a case says that corner c is inside.
 *
 * On each face, seen from outside the cell, every run of inside corners is cut off by one directed
 * segment from the edge where the run starts to the edge where it ends: two inside corners on a
 * diagonal are separated. The rule looks at the face's own signs only, so two neighbouring cells
 * always draw the same segments, in opposite directions. The segments of a cell chain to closed
 * loops; a loop is cut into triangles by diagonals of which none lies in a face of the cell, so no
 * edge is used twice. Hence the mesh of any field is a closed 2-manifold, counter-clockwise seen
 * from outside, even where a cell is ambiguous.
 *
 * The largest case has 5 triangles. Building the table takes about 0.1 ms.
 */
#ifndef LF_EVAL_MC_TABLE_H
#define LF_EVAL_MC_TABLE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define LF_MC_TRIANGLES 5

typedef struct lf_mc_table {
    uint8_t corner[12][2];                  /* the two ends of an edge, lower one first */
    uint8_t triangles[256];                 /* how many a case has */
    uint8_t edge[256][LF_MC_TRIANGLES * 3]; /* the cell edges that carry their vertices */
} lf_mc_table;

/* Fill the table. */
void lf_mc_table_build(lf_mc_table *table);

#ifdef __cplusplus
}
#endif
#endif
