/* mesh_ply.c: strict scan of PLY, text or binary of either byte order; colours of faces.
 *
 * The header names elements (vertex, face, others) with typed properties; the body holds them in
 * order. The scan walks every value, so that a wrong count or a file cut short is found before
 * any size is believed.
 */
#include "datasets/mesh_file.h"

#include <math.h>

enum { MOST_ELEMENTS = 16, MOST_PROPERTIES = 64 };

typedef struct property {
    char name[32];
    int type;      /* index of `types` */
    int list_type; /* type of the count, or -1 for a single value */
} property;

typedef struct element {
    char name[32];
    long count;
    int properties;
    property property[MOST_PROPERTIES];
} element;

typedef struct ply {
    lf_text text; /* at the body after the header (text) */
    const char *at, *end;
    bool binary, swap;
    int elements;
    element element[MOST_ELEMENTS];
    lf_scan scan;
    long *corner;
    long corner_capacity;
} ply;

static const struct {
    const char *name, *alias;
    int size;
    char kind; /* i signed, u unsigned, f floating */
} types[] = {{"char", "int8", 1, 'i'},     {"uchar", "uint8", 1, 'u'},   {"short", "int16", 2, 'i'},
             {"ushort", "uint16", 2, 'u'}, {"int", "int32", 4, 'i'},     {"uint", "uint32", 4, 'u'},
             {"float", "float32", 4, 'f'}, {"double", "float64", 8, 'f'}};

static void copy_word(char out[32], const char *word, size_t length)
{
    const size_t n = length < 31 ? length : 31;
    memcpy(out, word, n);
    out[n] = 0;
}

static lf_status header_word(lf_text *t, char out[32], lf_error *err)
{
    const char *word;
    size_t length;
    if (!lf_text_word(t, &word, &length))
        return lf_fail(err, LF_BAD_INPUT, "%s:%ld: the header line is cut short", t->path, t->line);
    copy_word(out, word, length);
    return LF_OK;
}

static lf_status header_type(lf_text *t, int *out, lf_error *err)
{
    char name[32];
    LF_TRY(header_word(t, name, err));
    for (int i = 0; i < (int)(sizeof types / sizeof *types); i++)
        if (!strcmp(name, types[i].name) || !strcmp(name, types[i].alias)) {
            *out = i;
            return LF_OK;
        }
    return lf_fail(err, LF_BAD_INPUT,
                   "%s:%ld: unknown type '%s'; PLY has char, uchar, short, ushort, int, uint, "
                   "float, double",
                   t->path, t->line, name);
}

static lf_status header_property(ply *p, lf_error *err)
{
    lf_text *t = &p->text;
    if (p->elements == 0)
        return lf_fail(err, LF_BAD_INPUT, "%s:%ld: a property before any element", t->path,
                       t->line);
    element *e = &p->element[p->elements - 1];
    if (e->properties == MOST_PROPERTIES)
        return lf_fail(err, LF_BAD_INPUT, "%s:%ld: more than %d properties in an element", t->path,
                       t->line, MOST_PROPERTIES);
    property *q = &e->property[e->properties];
    const lf_text start = *t;
    char word[32];
    LF_TRY(header_word(t, word, err));
    q->list_type = -1;
    if (!strcmp(word, "list")) {
        LF_TRY(header_type(t, &q->list_type, err));
        if (types[q->list_type].kind == 'f')
            return lf_fail(err, LF_BAD_INPUT, "%s:%ld: a list's count must be a whole number",
                           t->path, t->line);
    } else {
        *t = start;
    }
    LF_TRY(header_type(t, &q->type, err));
    LF_TRY(header_word(t, q->name, err));
    e->properties++;
    return LF_OK;
}

static const element *find_element(const ply *p, const char *name)
{
    for (int i = 0; i < p->elements; i++)
        if (!strcmp(p->element[i].name, name))
            return &p->element[i];
    return NULL;
}

static lf_status header_element(ply *p, lf_error *err)
{
    lf_text *t = &p->text;
    if (p->elements == MOST_ELEMENTS)
        return lf_fail(err, LF_BAD_INPUT, "%s:%ld: more than %d elements", t->path, t->line,
                       MOST_ELEMENTS);
    element *e = &p->element[p->elements];
    /* every element takes a byte or more, so the file's size bounds the count */
    const long most = p->end - p->at < INT32_MAX ? (long)(p->end - p->at) : INT32_MAX;
    LF_TRY(header_word(t, e->name, err));
    if (find_element(p, e->name))
        return lf_fail(err, LF_BAD_INPUT, "%s:%ld: a second element '%s'", t->path, t->line,
                       e->name);
    LF_TRY(lf_text_integer(t, "the element's count", 0, most, &e->count, err));
    e->properties = 0;
    p->elements++;
    return LF_OK;
}

static lf_status header_format(ply *p, lf_error *err)
{
    char format[32];
    LF_TRY(header_word(&p->text, format, err));
    const bool little = !strcmp(format, "binary_little_endian"),
               big = !strcmp(format, "binary_big_endian");
    if (!little && !big && strcmp(format, "ascii") != 0)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s:%ld: format '%s'; PLY has ascii, binary_little_endian, "
                       "binary_big_endian",
                       p->text.path, p->text.line, format);
    p->binary = little || big;
    const uint16_t one = 1;
    p->swap = p->binary && little != (*(const char *)&one == 1);
    return LF_OK;
}

static lf_status scan_header(ply *p, lf_error *err)
{
    lf_text *t = &p->text;
    bool format = false;
    char word[32];
    if (!lf_text_next_line(t) || header_word(t, word, NULL) != LF_OK || strcmp(word, "ply") != 0)
        return lf_fail(err, LF_BAD_INPUT, "%s:1: a PLY file begins with the line 'ply'", t->path);
    while (lf_text_next_line(t)) {
        if (header_word(t, word, NULL) != LF_OK)
            continue;
        if (!strcmp(word, "end_header")) {
            p->at = t->line_end < t->end ? t->line_end + 1 : t->end;
            if (!format)
                return lf_fail(err, LF_BAD_INPUT, "%s: the header has no format line", t->path);
            return LF_OK;
        }
        if (!strcmp(word, "format")) {
            LF_TRY(header_format(p, err));
            format = true;
        } else if (!strcmp(word, "element")) {
            LF_TRY(header_element(p, err));
        } else if (!strcmp(word, "property")) {
            LF_TRY(header_property(p, err));
        } else if (strcmp(word, "comment") != 0 && strcmp(word, "obj_info") != 0) {
            return lf_fail(err, LF_BAD_INPUT, "%s:%ld: unknown header word '%s'", t->path, t->line,
                           word);
        }
    }
    return lf_fail(err, LF_BAD_INPUT, "%s: the file ends before end_header", t->path);
}

static double binary_value(const char *bytes, int type, bool swap)
{
    unsigned char b[8] = {0};
    const int size = types[type].size;
    for (int i = 0; i < size; i++)
        b[i] = (unsigned char)bytes[swap ? size - 1 - i : i];
    const bool is_signed = types[type].kind == 'i';
    if (types[type].kind == 'f') {
        float f;
        double d;
        memcpy(&f, b, sizeof f);
        memcpy(&d, b, sizeof d);
        return size == 4 ? (double)f : d;
    }
    if (size == 1)
        return is_signed ? (double)(signed char)b[0] : (double)b[0];
    if (size == 2) {
        uint16_t u;
        memcpy(&u, b, sizeof u);
        return is_signed ? (double)(int16_t)u : (double)u;
    }
    uint32_t u;
    memcpy(&u, b, sizeof u);
    return is_signed ? (double)(int32_t)u : (double)u;
}

static lf_status next_value(ply *p, const element *e, long item, int type, double *out,
                            lf_error *err)
{
    if (!p->binary)
        return lf_text_coordinate(&p->text, e->name, out, err);
    if (p->end - p->at < types[type].size)
        return lf_fail(err, LF_BAD_INPUT, "%s: the file ends in %s %ld of %ld", p->text.path,
                       e->name, item, e->count);
    *out = binary_value(p->at, type, p->swap);
    p->at += types[type].size;
    return LF_OK;
}

/* The corners of a face; indices are checked against the vertex element's count. */
static lf_status scan_corners(ply *p, const element *e, long item, const property *q, long n,
                              lf_error *err)
{
    if (n < 3)
        return lf_fail(err, LF_BAD_INPUT, "%s: face %ld has %ld corners, needs 3 or more",
                       p->text.path, item, n);
    if (n > p->corner_capacity) {
        long *bigger = realloc(p->corner, (size_t)n * sizeof *bigger);
        LF_REQUIRE(bigger, "no memory for a face of %ld corners", n);
        p->corner = bigger;
        p->corner_capacity = n;
    }
    for (long i = 0; i < n; i++) {
        double x;
        LF_TRY(next_value(p, e, item, q->type, &x, err));
        if (!(x >= 0 && x < (double)p->scan.vertices) || x != floor(x))
            return lf_fail(err, LF_BAD_INPUT,
                           "%s: face %ld has the index %g; the file has %ld vertices, allowed are "
                           "0 to %ld",
                           p->text.path, item, x, p->scan.vertices, p->scan.vertices - 1);
        p->corner[i] = (long)x;
    }
    return LF_OK;
}

static lf_status scan_list(ply *p, const element *e, long item, const property *q, bool corners,
                           long *count, lf_error *err)
{
    double n, skipped;
    LF_TRY(next_value(p, e, item, q->list_type, &n, err));
    const double left = (double)(p->binary ? p->end - p->at : p->text.line_end - p->text.at);
    if (!(n >= 0 && n <= left) || n != floor(n))
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: %s %ld has a list of %g values, more than the file holds", p->text.path,
                       e->name, item, n);
    if (corners) {
        *count = (long)n;
        return scan_corners(p, e, item, q, (long)n, err);
    }
    for (long i = 0; i < (long)n; i++)
        LF_TRY(next_value(p, e, item, q->type, &skipped, err));
    return LF_OK;
}

/* Which channel a property is: 0 red, 1 green, 2 blue, -1 none. */
static int channel(const property *q)
{
    static const char *const names[3] = {"red", "green", "blue"};
    for (int i = 0; i < 3; i++)
        if (q->list_type < 0 && !strcmp(q->name, names[i]))
            return i;
    return -1;
}

static bool is_axis(const property *q)
{
    return q->list_type < 0 && q->name[0] >= 'x' && q->name[0] <= 'z' && !q->name[1];
}

static void keep_face(ply *p, long corners, const float colour[3])
{
    const int32_t count = (int32_t)corners;
    lf_scan_emit(&p->scan, &count, sizeof count);
    for (long i = 0; i < corners; i++) {
        const int32_t index = (int32_t)p->corner[i];
        lf_scan_emit(&p->scan, &index, sizeof index);
    }
    memcpy(p->scan.colour[p->scan.faces++], colour, 3 * sizeof *colour);
}

static lf_status scan_item(ply *p, const element *e, long item, lf_error *err)
{
    const bool vertex = !strcmp(e->name, "vertex"), face = !strcmp(e->name, "face");
    float colour[3] = {LF_MESH_GREY, LF_MESH_GREY, LF_MESH_GREY};
    float position[3] = {0};
    long corners = -1;
    for (int i = 0; i < e->properties; i++) {
        const property *q = &e->property[i];
        double x;
        if (q->list_type >= 0) {
            const bool list =
                face && (!strcmp(q->name, "vertex_indices") || !strcmp(q->name, "vertex_index"));
            LF_TRY(scan_list(p, e, item, q, list, &corners, err));
            continue;
        }
        LF_TRY(next_value(p, e, item, q->type, &x, err));
        if (vertex && is_axis(q)) {
            LF_TRY(lf_coordinate_check(x, p->text.path, "vertex", item, err));
            position[q->name[0] - 'x'] = (float)x;
        }
        if (channel(q) >= 0) {
            const double c = types[q->type].kind == 'f' ? x : x / 255;
            colour[channel(q)] = (float)(c >= 0 ? (c <= 1 ? c : 1) : 0);
        }
    }
    if (face && corners < 0)
        return lf_fail(err, LF_BAD_INPUT, "%s: the faces have no list vertex_indices",
                       p->text.path);
    if (vertex)
        for (int i = 0; i < 3; i++)
            lf_scan_emit(&p->scan, &position[i], sizeof *position);
    if (face)
        keep_face(p, corners, colour);
    return LF_OK;
}

static lf_status scan_element(ply *p, const element *e, lf_error *err)
{
    for (long item = 0; item < e->count; item++) {
        const char *word;
        size_t length;
        lf_text look;
        do { /* text: an item a line; empty lines are passed over */
            if (!p->binary && !lf_text_next_line(&p->text))
                return lf_fail(err, LF_BAD_INPUT,
                               "%s: the file ends after %ld of %ld of element %s", p->text.path,
                               item, e->count, e->name);
            look = p->text;
        } while (!p->binary && !lf_text_word(&look, &word, &length));
        LF_TRY(scan_item(p, e, item, err));
    }
    return LF_OK;
}

static void write_clean_header(ply *p, long vertices, long faces)
{
    char text[320];
    snprintf(text, sizeof text,
             "ply\nformat binary_little_endian 1.0\nelement vertex %ld\nproperty float x\n"
             "property float y\nproperty float z\nelement face %ld\n"
             "property list int int vertex_indices\nend_header\n",
             vertices, faces);
    lf_scan_emit_text(&p->scan, text);
}

static lf_status scan_ply(ply *p, lf_error *err)
{
    LF_TRY(scan_header(p, err));
    const element *vertex = find_element(p, "vertex"), *face = find_element(p, "face");
    unsigned axes = 0;
    for (int i = 0; vertex && i < vertex->properties; i++)
        if (is_axis(&vertex->property[i]))
            axes |= 1U << (vertex->property[i].name[0] - 'x');
    if (!vertex || !face || axes != 7 || face < vertex)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: a mesh needs an element vertex with x, y, z and then an element face",
                       p->text.path);
    write_clean_header(p, vertex->count, face->count);
    p->scan.vertices = vertex->count;
    p->scan.colour = malloc(((size_t)face->count + 1) * sizeof *p->scan.colour);
    LF_REQUIRE(p->scan.colour, "no memory for the colours of %ld faces", face->count);
    for (int i = 0; i < p->elements; i++)
        LF_TRY(scan_element(p, &p->element[i], err));
    return LF_OK;
}

lf_status lf_scan_ply(const char *path, lf_bytes file, lf_scan *out, lf_error *err)
{
    ply *p = calloc(1, sizeof *p);
    LF_REQUIRE(p, "no memory");
    p->text = lf_text_open(path, file);
    p->at = file.data;
    p->end = file.data + file.size;
    const lf_status status = scan_ply(p, err);
    if (status == LF_OK)
        *out = p->scan;
    else
        lf_scan_free(&p->scan);
    free(p->corner);
    free(p);
    return status;
}
