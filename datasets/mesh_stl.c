/* mesh_stl.c: strict scan of STL, text or binary. It has no colours and no shared vertices.
 *
 *   text     solid name / facet normal .. / outer loop / vertex x y z (3) / endloop / endfacet /
 *            endsolid
 *   binary   80 bytes, count (uint32), then 50 bytes each: normal, 3 vertices (float32), 2 bytes
 */
#include "datasets/mesh_file.h"

#include <math.h>

enum { HEAD = 84, FACET = 50 };

/* OpenMesh takes coordinates for equal that differ by less than 1.2e-38: such differences are
 * removed beforehand. */
#define TINY 1e-30

static uint32_t little_endian(const char *at)
{
    const unsigned char *b = (const unsigned char *)at;
    return (uint32_t)b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24;
}

static double little_endian_float(const char *at)
{
    const uint32_t bits = little_endian(at);
    float x;
    memcpy(&x, &bits, sizeof x);
    return (double)x;
}

static bool same(const double a[3], const double b[3])
{
    return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}

/* OpenMesh merges equal positions and drops a facet with two of them. */
static void keep_facet(lf_scan *scan, double corner[3][3])
{
    const float zero = 0;
    const uint16_t attribute = 0;
    for (int i = 0; i < 3; i++)
        lf_scan_emit(scan, &zero, sizeof zero);
    for (int i = 0; i < 9; i++) {
        const double given = corner[i / 3][i % 3];
        const float x = fabs(given) < TINY ? 0 : (float)given;
        lf_scan_emit(scan, &x, sizeof x);
        corner[i / 3][i % 3] = (double)x;
    }
    lf_scan_emit(scan, &attribute, sizeof attribute);
    if (same(corner[0], corner[1]) || same(corner[1], corner[2]) || same(corner[2], corner[0]))
        scan->degenerate++;
    else
        scan->faces++;
}

/* The head of the clean copy: blanks and a place for the count. */
static void begin_clean(lf_scan *scan)
{
    char head[HEAD + 1];
    memset(head, ' ', HEAD);
    head[HEAD] = 0;
    lf_scan_emit_text(scan, head);
    scan->binary = true;
}

static void end_clean(lf_scan *scan)
{
    const uint32_t count = (uint32_t)(scan->faces + scan->degenerate);
    const size_t size = scan->clean.size;
    scan->clean.size = HEAD - sizeof count;
    lf_scan_emit(scan, &count, sizeof count);
    scan->clean.size = size;
}

/* Binary if the size agrees with the count: many binary files also begin with "solid". */
static bool is_binary(lf_bytes file, uint32_t *count)
{
    if (file.size < HEAD)
        return false;
    *count = little_endian(file.data + 80);
    if (file.size == HEAD + (size_t)*count * FACET)
        return true;
    return memcmp(file.data, "solid", 5) != 0;
}

static lf_status scan_binary(const char *path, lf_bytes file, uint32_t count, lf_scan *scan,
                             lf_error *err)
{
    if (file.size != HEAD + (size_t)count * FACET)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: a binary STL of %u facets has %zu bytes, the file has %zu", path, count,
                       HEAD + (size_t)count * FACET, file.size);
    for (uint32_t i = 0; i < count; i++) {
        const char *at = file.data + HEAD + (size_t)i * FACET + 12;
        double corner[3][3];
        for (int j = 0; j < 9; j++) {
            corner[j / 3][j % 3] = little_endian_float(at + 4 * j);
            LF_TRY(lf_coordinate_check(corner[j / 3][j % 3], path, "facet", (long)i, err));
        }
        keep_facet(scan, corner);
    }
    return LF_OK;
}

static lf_status scan_text(lf_text *t, lf_scan *scan, lf_error *err)
{
    const char *word;
    size_t length;
    double corner[3][3];
    int corners = 0;
    bool ended = false;
    while (lf_text_next_line(t)) {
        if (!lf_text_word(t, &word, &length))
            continue;
        if (lf_text_is(word, length, "vertex")) {
            if (corners == 3)
                return lf_fail(err, LF_BAD_INPUT, "%s:%ld: a facet has more than 3 vertices",
                               t->path, t->line);
            for (int i = 0; i < 3; i++)
                LF_TRY(lf_text_coordinate(t, "a coordinate", &corner[corners][i], err));
            corners++;
        } else if (lf_text_is(word, length, "endfacet")) {
            if (corners != 3)
                return lf_fail(err, LF_BAD_INPUT, "%s:%ld: a facet has %d vertices, needs 3",
                               t->path, t->line, corners);
            keep_facet(scan, corner);
            corners = 0;
        } else if (lf_text_is(word, length, "endsolid")) {
            ended = true;
        }
    }
    if (!ended || corners)
        return lf_fail(err, LF_BAD_INPUT, "%s:%ld: the file ends before endsolid", t->path,
                       t->line);
    return LF_OK;
}

static lf_status scan_stl(lf_bytes file, lf_text *t, lf_scan *scan, lf_error *err)
{
    uint32_t count = 0;
    if (is_binary(file, &count))
        return scan_binary(t->path, file, count, scan, err);
    if (file.size >= 5 && memcmp(file.data, "solid", 5) == 0)
        return scan_text(t, scan, err);
    return lf_fail(err, LF_BAD_INPUT,
                   "%s: neither a text STL (begins with solid) nor a binary one (84 bytes and "
                   "50 a facet; the file has %zu)",
                   t->path, file.size);
}

lf_status lf_scan_stl(const char *path, lf_bytes file, lf_scan *out, lf_error *err)
{
    lf_scan scan = {.vertices = -1};
    lf_text t = lf_text_open(path, file);
    begin_clean(&scan);
    const lf_status status = scan_stl(file, &t, &scan, err);
    end_clean(&scan);
    if (status == LF_OK)
        *out = scan;
    else
        lf_scan_free(&scan);
    return status;
}
