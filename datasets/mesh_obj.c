/* mesh_obj.c: strict scan of Wavefront OBJ text and of the Kd colours of its .mtl files.
 *
 * Needed because OpenMesh's reader passes over a vertex line that it cannot parse (so that all
 * later indices point elsewhere), over indices that are no numbers, and keeps the materials of the
 * file before.
 */
#include "datasets/mesh_file.h"

#include <errno.h>
#include <limits.h>

typedef struct material {
    char *name;
    float kd[3];
} material;

typedef struct scan_state {
    material *materials;
    long material_count;
    long current; /* index of materials; -1 = no usemtl yet; -2 = a name without Kd */
    long *corner; /* corners of the face being read */
    long corner_capacity;
    long vertices_so_far, face_capacity;
    lf_scan scan;
} scan_state;

static void *grow(void *array, size_t size)
{
    void *bigger = realloc(array, size);
    LF_REQUIRE(bigger, "no memory for %zu bytes", size);
    return bigger;
}

static char *rest_of_line(lf_text *t)
{
    const char *word, *end = t->line_end;
    size_t length;
    if (!lf_text_word(t, &word, &length))
        return strdup("");
    while (end > word && (end[-1] == ' ' || end[-1] == '\t' || end[-1] == '\r'))
        end--;
    return strndup(word, (size_t)(end - word));
}

static long find_material(const scan_state *s, const char *name, size_t length)
{
    for (long i = s->material_count - 1; i >= 0; i--)
        if (strlen(s->materials[i].name) == length &&
            memcmp(s->materials[i].name, name, length) == 0)
            return i;
    return -2;
}

static lf_status add_kd(scan_state *s, lf_text *t, const char *name, lf_error *err)
{
    double kd[3];
    for (int i = 0; i < 3; i++)
        LF_TRY(lf_text_coordinate(t, "a Kd value", &kd[i], err));
    s->materials = grow(s->materials, (size_t)(s->material_count + 1) * sizeof *s->materials);
    material *m = &s->materials[s->material_count++];
    m->name = strdup(name);
    for (int i = 0; i < 3; i++)
        m->kd[i] = (float)(kd[i] < 0 ? 0 : kd[i] > 1 ? 1 : kd[i]);
    return LF_OK;
}

static lf_status scan_mtl_lines(scan_state *s, lf_text *t, lf_error *err)
{
    char *name = NULL;
    lf_status status = LF_OK;
    const char *word;
    size_t length;
    while (status == LF_OK && lf_text_next_line(t)) {
        if (!lf_text_word(t, &word, &length))
            continue;
        if (lf_text_is(word, length, "newmtl")) {
            free(name);
            name = rest_of_line(t);
        } else if (lf_text_is(word, length, "Kd") && name) {
            status = add_kd(s, t, name, err);
        }
    }
    free(name);
    return status;
}

/* Read <folder of the OBJ>/<name>. A file that is not there leaves its materials grey: counted. */
static lf_status scan_mtl(scan_state *s, const char *obj_path, const char *name, lf_error *err)
{
    const char *slash = strrchr(obj_path, '/');
    char path[PATH_MAX];
    const int folder = slash ? (int)(slash - obj_path) + 1 : 0;
    if (snprintf(path, sizeof path, "%.*s%s", folder, obj_path, name) >= (int)sizeof path)
        return LF_OK;
    lf_bytes file;
    if (lf_bytes_read(path, &file, NULL) != LF_OK)
        return LF_OK;
    lf_text t = lf_text_open(path, file);
    const lf_status status = scan_mtl_lines(s, &t, err);
    free(file.data);
    return status;
}

/* One corner: "7", "7/1", "7//2", "7/1/2", "-1". Only the first number counts. */
static lf_status scan_corner(scan_state *s, const lf_text *t, const char *word, size_t length,
                             long *out, lf_error *err)
{
    char text[32] = "", *stop = text;
    const char *slash = memchr(word, '/', length);
    const size_t digits = slash ? (size_t)(slash - word) : length;
    long value = 0;
    errno = 0;
    if (digits > 0 && digits < sizeof text && strspn(word, "0123456789+-") >= digits) {
        memcpy(text, word, digits);
        value = strtol(text, &stop, 10);
    }
    const bool number = stop != text && *stop == 0 && !errno;
    const long index = value < 0 ? s->vertices_so_far + value : value - 1;
    if (!number || value == 0 || index < 0 || index >= s->scan.vertices)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s:%ld: the face has the index '%.*s'; the file has %ld vertices, allowed "
                       "are 1 to %ld and, counted back from the line, -1 to -%ld",
                       t->path, t->line, (int)(length < 40 ? length : 40), word, s->scan.vertices,
                       s->scan.vertices, s->vertices_so_far);
    *out = index;
    return LF_OK;
}

static void keep_face(scan_state *s)
{
    lf_scan *scan = &s->scan;
    if (scan->faces == s->face_capacity) {
        s->face_capacity = 2 * s->face_capacity + 64;
        scan->colour = grow(scan->colour, (size_t)s->face_capacity * sizeof *scan->colour);
    }
    for (int i = 0; i < 3; i++)
        scan->colour[scan->faces][i] =
            s->current >= 0 ? s->materials[s->current].kd[i] : LF_MESH_GREY;
    scan->missing_colours += s->current == -2;
    scan->faces++;
}

static lf_status scan_face(scan_state *s, lf_text *t, lf_error *err)
{
    const char *word;
    size_t length;
    long n = 0;
    for (; lf_text_word(t, &word, &length); n++) {
        if (n == s->corner_capacity) {
            s->corner_capacity = 2 * s->corner_capacity + 16;
            s->corner = grow(s->corner, (size_t)s->corner_capacity * sizeof *s->corner);
        }
        LF_TRY(scan_corner(s, t, word, length, &s->corner[n], err));
    }
    if (n < 3)
        return lf_fail(err, LF_BAD_INPUT, "%s:%ld: the face has %ld corners, needs 3 or more",
                       t->path, t->line, n);
    if (lf_distinct3(n, s->corner) < 3)
        s->scan.degenerate++;
    else
        keep_face(s);
    return LF_OK;
}

static lf_status scan_vertex(lf_text *t, lf_error *err)
{
    double x;
    LF_TRY(lf_text_coordinate(t, "x", &x, err));
    LF_TRY(lf_text_coordinate(t, "y", &x, err));
    return lf_text_coordinate(t, "z", &x, err);
}

static lf_status scan_vertices(scan_state *s, lf_text t, lf_error *err)
{
    const char *word;
    size_t length;
    double x;
    while (lf_text_next_line(&t)) {
        if (!lf_text_word(&t, &word, &length))
            continue;
        if (t.line_end > word && (t.line_end[-1] == '\\') && *word != '#')
            return lf_fail(err, LF_BAD_INPUT,
                           "%s:%ld: the line goes on after '\\', which is not read; join the lines",
                           t.path, t.line);
        if (lf_text_is(word, length, "v")) {
            LF_TRY(scan_vertex(&t, err));
            s->scan.vertices++;
        } else if (lf_text_is(word, length, "vt")) {
            LF_TRY(lf_text_coordinate(&t, "a texture coordinate", &x, err));
            LF_TRY(lf_text_coordinate(&t, "a texture coordinate", &x, err));
        }
    }
    if (s->scan.vertices > INT32_MAX)
        return lf_fail(err, LF_BAD_INPUT, "%s: more than 2^31 vertices", t.path);
    return LF_OK;
}

static lf_status scan_faces(scan_state *s, lf_text t, lf_error *err)
{
    const char *word;
    size_t length;
    lf_status status = LF_OK;
    while (status == LF_OK && lf_text_next_line(&t)) {
        if (!lf_text_word(&t, &word, &length))
            continue;
        if (lf_text_is(word, length, "v")) {
            s->vertices_so_far++;
        } else if (lf_text_is(word, length, "f")) {
            status = scan_face(s, &t, err);
        } else if (lf_text_is(word, length, "usemtl")) {
            char *name = rest_of_line(&t);
            s->current = find_material(s, name, strlen(name));
            free(name);
        } else if (lf_text_is(word, length, "mtllib")) {
            char *name = rest_of_line(&t);
            status = scan_mtl(s, t.path, name, err);
            free(name);
        }
    }
    return status;
}

lf_status lf_scan_obj(const char *path, lf_bytes file, lf_scan *out, lf_error *err)
{
    scan_state s = {.current = -1};
    lf_status status = scan_vertices(&s, lf_text_open(path, file), err);
    if (status == LF_OK)
        status = scan_faces(&s, lf_text_open(path, file), err);
    for (long i = 0; i < s.material_count; i++)
        free(s.materials[i].name);
    free(s.materials);
    free(s.corner);
    if (status == LF_OK)
        *out = s.scan;
    else
        lf_scan_free(&s.scan);
    return status;
}
