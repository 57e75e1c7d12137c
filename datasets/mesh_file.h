/* mesh_file.h: what the readers of mesh files share; own to datasets/mesh*.
 *
 * A file is read once into memory. A scan of elf's own (one for each format) walks it strictly:
 * every coordinate, index and size is checked and errors name the line. Then OpenMesh's reader
 * delivers the geometry, from the same bytes (OBJ, OFF) or from a plain binary copy (PLY, STL) that
 * the scan writes: OpenMesh's own parsers of headers and words can hang on a damaged file. The scan
 * counts what OpenMesh must deliver, so that nothing is dropped without a word, and collects the
 * colours.
 */
#ifndef LF_DATASETS_MESH_FILE_H
#define LF_DATASETS_MESH_FILE_H

#include <stddef.h>

#include "datasets/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A whole file; `data` ends with a 0 that `size` does not count. Caller frees data. */
typedef struct lf_bytes {
    char *data;
    size_t size;
} lf_bytes;

lf_status lf_bytes_read(const char *path, lf_bytes *out, lf_error *err);

/* What a scan found. `colour` is [faces][3] of the faces that OpenMesh must deliver, in order,
 * or NULL if the file has no colours. The arrays are freed by lf_scan_free. */
typedef struct lf_scan {
    long vertices;   /* -1: not comparable (STL merges them) */
    long faces;      /* that OpenMesh must deliver */
    long degenerate; /* that it drops (OBJ, STL): fewer than three different corners */
    long missing_colours;
    float (*colour)[3];
    lf_bytes clean; /* what OpenMesh reads instead of the file, if data is not NULL */
    size_t clean_capacity;
    bool binary; /* OpenMesh must be told that an STL is binary */
} lf_scan;

/* Append a number to `clean`, least significant byte first; a text as it is. */
void lf_scan_emit(lf_scan *scan, const void *number, size_t size);
void lf_scan_emit_text(lf_scan *scan, const char *text);

void lf_scan_free(lf_scan *scan);

/* Each scan returns LF_BAD_INPUT with file and line (text) or element number (binary). */
lf_status lf_scan_obj(const char *path, lf_bytes file, lf_scan *out, lf_error *err);
lf_status lf_scan_ply(const char *path, lf_bytes file, lf_scan *out, lf_error *err);
lf_status lf_scan_off(const char *path, lf_bytes file, lf_scan *out, lf_error *err);
lf_status lf_scan_stl(const char *path, lf_bytes file, lf_scan *out, lf_error *err);

/* Number of different indices among corner[n], stopping at 3. */
int lf_distinct3(long n, const long *corner);

/* Text, line by line and word by word. A word is [word, word + length), not ended by a 0. */
typedef struct lf_text {
    const char *path;
    const char *at, *line_end, *end; /* rest of this line; end of the file */
    long line;                       /* counted from 1 */
} lf_text;

lf_text lf_text_open(const char *path, lf_bytes file);
bool lf_text_next_line(lf_text *t);                               /* false at the end */
bool lf_text_word(lf_text *t, const char **word, size_t *length); /* false at the line's end */
bool lf_text_is(const char *word, size_t length, const char *expected);

/* The next word of the line as a coordinate (finite, within LF_MESH_COORDINATE_MAX) or as a whole
 * number from low to high. `what` names it in the message. */
lf_status lf_text_coordinate(lf_text *t, const char *what, double *out, lf_error *err);
lf_status lf_text_integer(lf_text *t, const char *what, long low, long high, long *out,
                          lf_error *err);

/* LF_BAD_INPUT unless x is a usable coordinate; `where` is "file:line" or the like. */
lf_status lf_coordinate_check(double x, const char *path, const char *what, long number,
                              lf_error *err);

/* The soup that OpenMesh's reader delivers. source[i] is the number of the file's face that
 * triangle i is cut from. Freed by lf_soup_free. */
typedef struct lf_soup {
    long vertices, triangles, faces, polygons;
    double (*vertex)[3];
    int32_t (*face)[3];
    long *source;
} lf_soup;

void lf_soup_free(lf_soup *soup);

/* Read the bytes of a file of the given ending ("obj", "ply", "off", "stl"). */
lf_status lf_openmesh_read(const char *path, const char *ending, lf_bytes file, bool binary,
                           lf_soup *out, lf_error *err);

/* Whether the half-edge mesh takes every face. */
bool lf_openmesh_manifold(const lf_mesh *mesh);

/* Write binary PLY at `path` (no renaming). *taken is false, and nothing is written, if the
 * half-edge mesh cannot hold the faces. */
lf_status lf_openmesh_write_ply(const char *path, const lf_mesh *mesh, bool *taken, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
