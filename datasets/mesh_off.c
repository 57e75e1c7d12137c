/* mesh_off.c: strict scan of Object File Format text (OFF, COFF, NOFF, ...), colours of faces.
 *
 *     OFF                    optional prefixes: ST, C, N (texture, colour, normal of each vertex)
 *     vertices faces edges
 *     x y z ...              one vertex a line
 *     n i_1 ... i_n [r g b [a]]   one face a line, indices from 0; colour 0..255 or 0..1
 *
 * OpenMesh's reader takes comments and some trailing values for indices. The scan therefore
 * overwrites with blanks, in the bytes that the reader gets next, all that it need not see:
 * comments, the header's prefixes, normals and colours.
 */
#include "datasets/mesh_file.h"

#include <limits.h>

/* Go to the next line that holds something; comments, from '#' to the line's end, are blanked. */
static bool next_content(lf_text *t)
{
    while (lf_text_next_line(t)) {
        char *mark = memchr(t->at, '#', (size_t)(t->line_end - t->at));
        if (mark)
            memset(mark, ' ', (size_t)(t->line_end - mark));
        const char *word;
        size_t length;
        lf_text look = *t;
        if (lf_text_word(&look, &word, &length))
            return true;
    }
    return false;
}

/* Blank the rest of the line. */
static void forget_rest(lf_text *t)
{
    memset((char *)t->at, ' ', (size_t)(t->line_end - t->at));
}

static lf_status ends_early(const lf_text *t, const char *what, long found, long count,
                            lf_error *err)
{
    return lf_fail(err, LF_BAD_INPUT, "%s:%ld: the file ends after %ld of %ld %s", t->path, t->line,
                   found, count, what);
}

/* Make the file begin with the line "OFF" and blanks up to `after`, the header word's end. */
static void put_header(lf_text *t, lf_bytes file, const char *after)
{
    if (after >= t->end)
        return; /* nothing follows: the scan will say so */
    memset(file.data, ' ', (size_t)(after - file.data));
    memcpy(file.data, "OFF\n", 4);
    if (t->at == file.data + 3 && t->at < t->line_end)
        t->at++; /* the counts follow on the same line */
}

/* "OFF" with its prefixes; the counts may stand on the same line. */
static lf_status scan_header(lf_text *t, lf_bytes file, lf_error *err)
{
    const char *word, *next;
    size_t length, next_length;
    if (!next_content(t))
        return lf_fail(err, LF_BAD_INPUT, "%s: the file has no line", t->path);
    lf_text_word(t, &word, &length);
    if (length < 3 || memcmp(word + length - 3, "OFF", 3) != 0 || strspn(word, "STCN") + 3 < length)
        return lf_fail(err, LF_BAD_INPUT, "%s:%ld: an OFF file begins with OFF, found '%.*s'",
                       t->path, t->line, (int)(length < 20 ? length : 20), word);
    put_header(t, file, word + length);
    lf_text look = *t;
    if (!lf_text_word(&look, &next, &next_length))
        return next_content(t) ? LF_OK : ends_early(t, "header lines", 1, 2, err);
    if (lf_text_is(next, next_length, "BINARY"))
        return lf_fail(err, LF_BAD_INPUT,
                       "%s:%ld: binary OFF is not read; save it as text or as PLY", t->path,
                       t->line);
    return LF_OK;
}

/* Colour after the corners: whole numbers mean 0..255, a point means 0..1; none means grey. */
static void read_colour(lf_text t, float colour[3])
{
    float value[3];
    bool fraction = false;
    for (int i = 0; i < 3; i++) {
        const char *word;
        size_t length;
        double x;
        lf_text look = t;
        if (lf_text_coordinate(&t, "a colour", &x, NULL) != LF_OK)
            return;
        lf_text_word(&look, &word, &length);
        fraction = fraction || memchr(word, '.', length);
        value[i] = (float)x;
    }
    for (int i = 0; i < 3; i++) {
        const float v = fraction ? value[i] : value[i] / 255;
        colour[i] = v < 0 ? 0 : v > 1 ? 1 : v;
    }
}

static lf_status scan_face(lf_text *t, lf_scan *scan, lf_error *err)
{
    long n, corner;
    LF_TRY(lf_text_integer(t, "the number of corners", 3, INT_MAX, &n, err));
    for (long i = 0; i < n; i++)
        LF_TRY(lf_text_integer(t, "a corner's index", 0, scan->vertices - 1, &corner, err));
    float *colour = scan->colour[scan->faces++];
    colour[0] = colour[1] = colour[2] = LF_MESH_GREY;
    read_colour(*t, colour);
    forget_rest(t);
    return LF_OK;
}

static lf_status scan_body(lf_text *t, long faces, lf_scan *scan, lf_error *err)
{
    double x;
    for (long i = 0; i < scan->vertices; i++) {
        if (!next_content(t))
            return ends_early(t, "vertices", i, scan->vertices, err);
        LF_TRY(lf_text_coordinate(t, "x", &x, err));
        LF_TRY(lf_text_coordinate(t, "y", &x, err));
        LF_TRY(lf_text_coordinate(t, "z", &x, err));
        forget_rest(t);
    }
    for (long i = 0; i < faces; i++) {
        if (!next_content(t))
            return ends_early(t, "faces", i, faces, err);
        LF_TRY(scan_face(t, scan, err));
    }
    return LF_OK;
}

lf_status lf_scan_off(const char *path, lf_bytes file, lf_scan *out, lf_error *err)
{
    lf_text t = lf_text_open(path, file);
    long vertices, faces;
    const long most = file.size < INT32_MAX ? (long)file.size : INT32_MAX; /* each has a byte */
    LF_TRY(scan_header(&t, file, err));
    LF_TRY(lf_text_integer(&t, "the number of vertices", 0, most, &vertices, err));
    LF_TRY(lf_text_integer(&t, "the number of faces", 0, most, &faces, err));
    lf_scan scan = {.vertices = vertices};
    scan.colour = malloc(((size_t)faces + 1) * sizeof *scan.colour);
    LF_REQUIRE(scan.colour, "no memory for the colours of %ld faces", faces);
    const lf_status status = scan_body(&t, faces, &scan, err);
    if (status == LF_OK)
        *out = scan;
    else
        lf_scan_free(&scan);
    return status;
}
