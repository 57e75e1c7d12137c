/* mesh.h: triangle meshes, from files and back.
 *
 * A mesh is a soup: any three vertices may form a face, edges may have one, two or many faces, and
 * nothing that a file holds is lost. Faces are counter-clockwise seen from outside where the
 * orientation is known (the shapes of procedural.h); collections of artists' meshes hold faces of
 * either orientation. Unit: the file's own, until lf_mesh_normalise.
 *
 * Ownership: *_read, *_copy and lf_mesh_create give a mesh that the caller frees once with
 *            lf_mesh_free; lf_mesh_free(NULL) does nothing.
 * Errors:    every lf_status function fills *err (may be NULL) and leaves its outputs untouched.
 * Threads:   no hidden state except while a file is read or written: OpenMesh's writers share one
 *            table, so those calls take turns behind a lock.
 */
#ifndef LF_DATASETS_MESH_H
#define LF_DATASETS_MESH_H

#include <stdbool.h>
#include <stdint.h>

#include "autograd/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct lf_mesh {
    long vertices, faces;
    double (*vertex)[3]; /* [vertices][3] */
    int32_t (*face)[3];  /* [faces][3], indices of vertices, counted from 0 */
    float (*colour)[3];  /* [faces][3], red green blue as displayed, 0..1; never NULL */
} lf_mesh;

#define LF_MESH_GREY 0.7f           /* each channel of a face whose file names no colour */
#define LF_MESH_COORDINATE_MAX 1e30 /* a coordinate beyond it is taken for a broken file */

/* What lf_mesh_read saw and lf_mesh_closed_check counted; each function fills its own part. */
typedef struct lf_mesh_report {
    /* lf_mesh_read */
    long polygons;        /* faces of more than three corners, cut into a fan */
    long zero_area;       /* faces of no area; those with fewer than three different corners are
                             dropped in OBJ and STL files, the others kept */
    long duplicates;      /* triangles with the same three vertices as an earlier one (kept) */
    long unused_vertices; /* vertices that no face uses (kept) */
    long missing_colours; /* faces whose material has no Kd in any .mtl file: grey */
    /* lf_mesh_closed_check */
    long edges;        /* undirected edges */
    long boundary;     /* edges with one face */
    long non_manifold; /* edges with more than two faces */
    long inconsistent; /* edges whose two faces run along it in the same direction */
    long components;   /* sets of faces that share vertices */
    long euler;        /* used vertices - edges + faces */
    bool manifold;     /* OpenMesh's half-edge mesh takes every face: what lf_mesh_write_ply asks */
    bool closed;       /* every edge has two faces that run along it in opposite directions */
} lf_mesh_report;

/* A mesh of the given sizes: vertices and faces zero, colours grey. Aborts if memory runs out or
 * a size is negative; sizes from outside are bounded by their file's size before this call. */
lf_mesh *lf_mesh_create(long vertices, long faces);
lf_mesh *lf_mesh_copy(const lf_mesh *mesh);
void lf_mesh_free(lf_mesh *mesh);

/* Read an OBJ (with the Kd colours of its .mtl files, a usemtl group each), PLY (text or binary),
 * OFF or STL file; the ending of the name says which. Polygons become fans, counted. STL has no
 * shared vertices: equal positions are merged. OpenMesh reads positions with 32 bits. `report` may
 * be NULL. LF_BAD_INPUT: no such file, unknown ending, no vertex or face, a coordinate that is not
 * finite or beyond LF_MESH_COORDINATE_MAX, a face with an index outside the vertices or with fewer
 * than three corners, a file that ends early. */
lf_status lf_mesh_read(const char *path, lf_mesh **out, lf_mesh_report *report, lf_error *err);

/* Write binary PLY (32-bit positions, 8-bit colours a face). A temporary file is renamed over
 * `path`, so that no reader sees half a mesh. A manifold mesh goes through OpenMesh's half-edge
 * mesh; a soup that it cannot hold is written by elf's own writer. LF_FAILED if the disk refuses.
 */
lf_status lf_mesh_write_ply(const char *path, const lf_mesh *mesh, lf_error *err);

/* Bounds of the vertices that faces use; a mesh without faces has low = high = 0. */
void lf_mesh_bounds(const lf_mesh *mesh, double low[3], double high[3]);

/* Move and scale: the bounding box of the used vertices gets its centre at the origin and a
 * diagonal of length 1 (hence every vertex within radius 0.5). LF_BAD_INPUT, mesh untouched, if
 * there is no face, or all faces lie in one plane (thickness below 1e-6 of the diagonal in some
 * direction): such a sheet has no inside. */
lf_status lf_mesh_normalise(lf_mesh *mesh, lf_error *err);

/* Sum of the triangles' areas. */
double lf_mesh_area(const lf_mesh *mesh);

/* Volume enclosed by a closed, consistently oriented mesh (positive if outward): sum of the signed
 * tetrahedra from the origin. Parts that overlap count twice. */
double lf_mesh_volume(const lf_mesh *mesh);

/* n points, uniform in area, into point[n][3]; the face of each into face[n] unless NULL. Point i
 * depends on (seed, item, i) alone: any prefix is the same for any n and any number of threads.
 * LF_BAD_INPUT if the mesh has no area. */
lf_status lf_mesh_sample_surface(const lf_mesh *mesh, long n, uint64_t seed, uint64_t item,
                                 double (*point)[3], int32_t *face, lf_error *err);

/* Fill the counts of lf_mesh_closed_check in *report (the rest stays). Any soup will do. */
void lf_mesh_closed_check(const lf_mesh *mesh, lf_mesh_report *report);

/* Winding number of the faces [first, first + count) around p: 1 inside a closed outward part, 0
 * outside, between for open meshes (sum of solid angles / 4 pi, van Oosterom and Strackee 1983). */
double lf_mesh_winding(const lf_mesh *mesh, long first, long count, const double p[3]);

/* Merge vertices of exactly equal positions; faces stay, unused vertices go. */
void lf_mesh_weld(lf_mesh *mesh);

/* Append the vertices and faces of `more` to `mesh`. */
void lf_mesh_append(lf_mesh *mesh, const lf_mesh *more);

/* Give every face one colour. */
void lf_mesh_paint(lf_mesh *mesh, float red, float green, float blue);

/* x -> matrix x + shift for every vertex; matrix NULL = identity, row-major 3x3. Faces are turned
 * round if the matrix mirrors, so that outward stays outward. */
void lf_mesh_transform(lf_mesh *mesh, const double matrix[9], const double shift[3]);

/* Closed, outward oriented. Sphere: icosahedron subdivided 0..7 times, 20*4^k faces, vertices on
 * the sphere (inscribed). Box: from low to high, 12 faces. Torus: around the y axis; `around`
 * segments along the ring of radius `ring`, `across` along the tube of radius `tube` < ring. */
lf_mesh *lf_mesh_sphere(int subdivisions, double radius, const double centre[3]);
lf_mesh *lf_mesh_box(const double low[3], const double high[3]);
lf_mesh *lf_mesh_torus(double ring, double tube, int around, int across);

#ifdef __cplusplus
}
#endif
#endif
