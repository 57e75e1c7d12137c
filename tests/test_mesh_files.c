/* test_mesh_files.c: meshes from files and back, every bad file's message, damaged files. */
#include "tests/close.h"
#include "tests/folder.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include "datasets/mesh.h"

typedef struct folder {
    char path[64];
} folder;

static int set_up(void **state)
{
    folder *f = malloc(sizeof *f);
    strcpy(f->path, "/tmp/lf_test_mesh_XXXXXX");
    *state = f;
    return mkdtemp(f->path) ? 0 : -1;
}

static int tear_down(void **state)
{
    folder *f = *state;
    const int left = remove_tree(f->path);
    free(f);
    return left;
}

static const char *put(void **state, const char *name, const void *bytes, size_t size,
                       char out[128])
{
    const folder *f = *state;
    snprintf(out, 128, "%s/%s", f->path, name);
    FILE *file = fopen(out, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(bytes, 1, size, file), size);
    fclose(file);
    return out;
}

static const char *put_text(void **state, const char *name, const char *text, char out[128])
{
    return put(state, name, text, strlen(text), out);
}

static lf_mesh *read_good(const char *path, lf_mesh_report *report)
{
    lf_mesh *mesh = NULL;
    lf_error err = {"no message"};
    if (lf_mesh_read(path, &mesh, report, &err) != LF_OK)
        fail_msg("%s", err.text);
    return mesh;
}

static void test_obj_colours_polygons_and_indices(void **state)
{
    char path[128];
    put_text(state, "two.mtl", "newmtl red one\nKd 1 0 0.25\nnewmtl plain\nKa 1 1 1\n", path);
    put_text(state, "good.obj",
             "# comment\nmtllib two.mtl\n"
             "v 0 0 0\nv 1 0 0\nv 1 1 0.5\nv 0 1 0 1 1 1\nv 9 9 9\n"
             "f 1 2 3 4\n" /* polygon, no material */
             "usemtl red one\nf 1/1 2/2/2 3//3\n"
             "usemtl plain\nf -5 -4 -3\r\n"
             "usemtl nowhere\nf 4 2 6\nf 1 1 2\n" /* the second has two corners: dropped */
             "v 5 5 6\nf 1 2 1 4 \n"              /* a corner twice: three left */
             "f 1 2 7\nv 0.5 0 0\n",              /* forward reference, no area */
             path);
    lf_mesh_report r = {0};
    lf_mesh *m = read_good(path, &r);
    assert_int_equal(m->vertices, 7);
    assert_int_equal(m->faces, 7);
    assert_int_equal(r.polygons, 1);
    assert_int_equal(r.duplicates, 2); /* 1 2 3 three times */
    assert_int_equal(r.zero_area, 2);  /* 1 1 2 and 1 2 7 */
    assert_int_equal(r.unused_vertices, 1);
    assert_int_equal(r.missing_colours, 4);
    const float expected[7][3] = {{0.7f, 0.7f, 0.7f}, {0.7f, 0.7f, 0.7f}, {1, 0, 0.25f}};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            assert_close(m->colour[i][j], expected[i][j], 0, 1e-7);
    assert_close(m->colour[6][0], 0.7, 1e-6, 0);
    assert_close(m->vertex[2][2], 0.5, 0, 0);
    assert_int_equal(m->face[6][2], 6);
    lf_mesh_free(m);
}

/* Materials of one file do not leak into the next; a missing .mtl leaves grey and is counted. */
static void test_obj_without_mtl(void **state)
{
    char path[128];
    put_text(state, "a.obj",
             "mtllib gone.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red one\nf 1 2 3\n", path);
    lf_mesh_report r = {0};
    lf_mesh *m = read_good(path, &r);
    assert_int_equal(r.missing_colours, 1);
    assert_close(m->colour[0][0], 0.7, 1e-6, 0);
    lf_mesh_free(m);
}

static void test_off_colours_comments_prefixes(void **state)
{
    static const char *const heads[] = {"OFF\n4 2 0 # counts\n", "# hello\nCOFF 4 2 0\n",
                                        "OFF 4 2 0\n", "OFF\r\n\n# x\n4 2\n"};
    for (int i = 0; i < 4; i++) {
        char path[128], text[512];
        snprintf(text, sizeof text,
                 "%s0.5 0 0 1 1 1 1 # a\n1 0 0\n\n1 1 0.5\n0 1 0\n"
                 "4 0 1 2 3 255 51 0\n3 0 1 0 0.5 0.25 1.0 # c",
                 heads[i]);
        put_text(state, "good.off", text, path);
        lf_mesh_report r = {0};
        lf_mesh *m = read_good(path, &r);
        assert_int_equal(m->vertices, 4);
        assert_int_equal(m->faces, 3);
        assert_int_equal(r.polygons, 1);
        assert_int_equal(r.zero_area, 1);
        assert_close(m->vertex[0][0], 0.5, 0, 0);
        assert_close(m->colour[1][1], 0.2, 1e-6, 0);
        assert_close(m->colour[2][0], 0.5, 1e-6, 0);
        lf_mesh_free(m);
    }
}

static const char ply_head[] = "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 4\n"
                               "property double x\nproperty float y\nproperty float z\n"
                               "element face 2\nproperty list uchar int vertex_index\n"
                               "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                               "end_header\n";

static void test_ply_text(void **state)
{
    char path[128], text[1024];
    snprintf(text, sizeof text,
             "%s0.5 0 0\n1 0 0\n1 1 0.5\n0 1 0\n4 0 1 2 3 255 51 0\n3 0 1 3 0 0 255\n", ply_head);
    lf_mesh_report r = {0};
    lf_mesh *m = read_good(put_text(state, "good.ply", text, path), &r);
    assert_int_equal(m->faces, 3);
    assert_int_equal(r.polygons, 1);
    assert_close(m->vertex[0][0], 0.5, 0, 0);
    assert_close(m->colour[0][1], 0.2, 1e-6, 0);
    assert_close(m->colour[2][2], 1, 1e-6, 0);
    lf_mesh_free(m);
}

static size_t put_float(char *at, float x, bool big)
{
    unsigned char b[4];
    memcpy(b, &x, 4);
    for (int i = 0; i < 4; i++)
        at[i] = (char)b[big ? 3 - i : i];
    return 4;
}

static size_t put_int(char *at, uint32_t x, bool big)
{
    for (int i = 0; i < 4; i++)
        at[i] = (char)(x >> 8 * (big ? 3 - i : i));
    return 4;
}

/* A tetrahedron as binary PLY; returns its size. */
static size_t binary_ply(char *out, bool big)
{
    size_t n = (size_t)sprintf(out,
                               "ply\nformat binary_%s_endian 1.0\nelement vertex 4\n"
                               "property float x\nproperty float y\nproperty float z\n"
                               "element face 4\nproperty list uchar uint vertex_indices\n"
                               "end_header\n",
                               big ? "big" : "little");
    static const float p[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    static const uint32_t f[4][3] = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
    for (int i = 0; i < 12; i++)
        n += put_float(out + n, p[i / 3][i % 3], big);
    for (int i = 0; i < 4; i++) {
        out[n++] = 3;
        for (int j = 0; j < 3; j++)
            n += put_int(out + n, f[i][j], big);
    }
    return n;
}

static size_t binary_stl(char *out)
{
    static const float p[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    static const int f[4][3] = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
    memset(out, 's', 80);
    size_t n = 80 + put_int(out + 80, 4, false);
    for (int i = 0; i < 4; i++) {
        for (int j = 0; j < 3; j++)
            n += put_float(out + n, 0, false);
        for (int j = 0; j < 9; j++)
            n += put_float(out + n, p[f[i][j / 3]][j % 3], false);
        out[n++] = 0;
        out[n++] = 0;
    }
    return n;
}

static const char stl_text[] =
    "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 0 1 0\nvertex 1 0 0\nendloop\n"
    "endfacet\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 0 1\nendloop\n"
    "endfacet\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 0 0 1\nvertex 0 1 0\nendloop\n"
    "endfacet\nfacet normal 0 0 1\nouter loop\nvertex 1 0 0\nvertex 0 1 0\nvertex 0 0 1\nendloop\n"
    "endfacet\nendsolid s\n";

static void check_tetrahedron(const char *path)
{
    lf_mesh_report r = {0};
    lf_mesh *m = read_good(path, &r);
    assert_int_equal(m->vertices, 4);
    assert_int_equal(m->faces, 4);
    lf_mesh_closed_check(m, &r);
    assert_true(r.closed && r.manifold);
    assert_int_equal(r.euler, 2);
    assert_close(lf_mesh_volume(m), 1.0 / 6, 1e-7, 0);
    lf_mesh_free(m);
}

static void test_tetrahedron_in_every_format(void **state)
{
    char path[128], bytes[2048];
    check_tetrahedron(put(state, "little.ply", bytes, binary_ply(bytes, false), path));
    check_tetrahedron(put(state, "big.PLY", bytes, binary_ply(bytes, true), path));
    check_tetrahedron(put(state, "binary.stl", bytes, binary_stl(bytes), path));
    check_tetrahedron(put_text(state, "text.stl", stl_text, path));
    check_tetrahedron(put_text(state, "t.off",
                               "OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n"
                               "3 0 3 2\n3 1 2 3\n",
                               path));
}

/* Bad text files: name, content, what the message must say. */
static const struct {
    const char *name, *text, *message;
} bad[] = {
    {"none.xyz", "1 2 3\n", "ends in .obj, .ply, .off or .stl"},
    {"noending", "1 2 3\n", "ends in .obj, .ply, .off or .stl"},
    {"empty.obj", "", "the file is empty"},
    {"nothing.obj", "# nothing\n", "0 vertices and 0 usable faces"},
    {"points.obj", "v 0 0 0\nv 1 0 0\n", "2 vertices and 0 usable faces"},
    {"degenerate.obj", "v 0 0 0\nv 1 0 0\nf 1 2 1\n", "2 vertices and 0 usable faces"},
    {"zero.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "zero.obj:4: the face has the index '0'"},
    {"beyond.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n",
     "beyond.obj:4: the face has the index '4'"},
    {"before.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -4\n",
     "before.obj:4: the face has the index '-4'"},
    {"huge.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999\n", "huge.obj:4: the face"},
    {"word.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 x\n", "word.obj:4: the face has the index 'x'"},
    {"slash.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 /3\n",
     "slash.obj:4: the face has the index '/3'"},
    {"two.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n", "two.obj:4: the face has 2 corners"},
    {"nan.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "nan.obj:1: z is 'nan'"},
    {"inf.obj", "v 0 0 0\nv inf 0 0\nv 0 1 0\nf 1 2 3\n", "inf.obj:2: x is 'inf'"},
    {"far.obj", "v 0 0 0\nv 1e31 0 0\nv 0 1 0\nf 1 2 3\n", "far.obj:2: x is '1e31'"},
    {"hex.obj", "v 0 0 0\nv 0x10 0 0\nv 0 1 0\nf 1 2 3\n", "hex.obj:2: x is '0x10'"},
    {"short.obj", "v 0 0\nf 1 1 1\n", "short.obj:1: the line ends where z should stand"},
    {"split.obj", "v 0 0 \\\n0\n", "split.obj:1: the line goes on"},
    {"vt.obj", "v 0 0 0\nvt 1\nf 1 1 1\n", "vt.obj:2: the line ends where a texture"},
    {"kd.obj", "mtllib bad.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
     "bad.mtl:2: a Kd value is 'red'"},
    {"word.off", "FFO\n", "word.off:1: an OFF file begins with OFF"},
    {"binary.off", "OFF BINARY\n", "binary OFF is not read"},
    {"alone.off", "OFF", "the file ends after 1 of 2 header lines"},
    {"counts.off", "OFF\n-1 2 3\n", "counts.off:2: the number of vertices is '-1'"},
    {"many.off", "OFF\n4 1000000000 0\n", "many.off:2: the number of faces"},
    {"cut.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n", "the file ends after 2 of 3 vertices"},
    {"cut2.off", "OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "the file ends after 1 of 2 faces"},
    {"index.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n",
     "index.off:6: a corner's index is '3'"},
    {"corners.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n2 0 1\n",
     "corners.off:6: the number of corners"},
    {"nan.off", "OFF\n3 1 0\n0 0 0\nnan 0 0\n0 1 0\n3 0 1 2\n", "nan.off:4: x is 'nan'"},
    {"none.off", "OFF\n0 0 0\n", "0 vertices and 0 usable faces"},
    {"word.ply", "play\n", "word.ply:1: a PLY file begins with the line 'ply'"},
    {"head.ply", "ply\nformat ascii 1.0\nelement vertex 3\n", "the file ends before end_header"},
    {"format.ply", "ply\nformat roman 1.0\n", "format.ply:2: format 'roman'"},
    {"noformat.ply", "ply\nend_header\n", "the header has no format line"},
    {"type.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty long x\n",
     "type.ply:4: unknown type 'long'"},
    {"first.ply", "ply\nformat ascii 1.0\nproperty float x\n",
     "first.ply:3: a property before any"},
    {"list.ply", "ply\nformat ascii 1.0\nelement face 1\nproperty list float int vertex_index\n",
     "list.ply:4: a list's count"},
    {"count.ply", "ply\nformat ascii 1.0\nelement vertex 123456789\n",
     "count.ply:3: the element's count"},
    {"strange.ply", "ply\nformat ascii 1.0\nstrange\n",
     "strange.ply:3: unknown header word 'strange'"},
    {"xyz.ply",
     "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nelement face 0\nend_header\n",
     "needs an element vertex with x, y, z"},
    {"nolist.ply",
     "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
     "property float z\nelement face 1\nproperty int a\nend_header\n0 0 0\n1\n",
     "the faces have no list vertex_indices"},
    {"twice.ply", "ply\nformat ascii 1.0\nelement face 1\nelement face 2\n",
     "twice.ply:4: a second element 'face'"},
    {"head.stl", "liquid\n", "neither a text STL"},
    {"cut.stl", "solid\nfacet\nouter loop\nvertex 0 0 0\n", "the file ends before endsolid"},
    {"two.stl", "solid\nvertex 0 0 0\nendfacet\nendsolid\n", "two.stl:3: a facet has 1 vertices"},
    {"four.stl", "solid\nvertex 0 0 0\nvertex 0 0 1\nvertex 0 1 0\nvertex 1 1 1\n",
     "four.stl:5: a facet has more"},
    {"nan.stl", "solid\nvertex 0 0 nan\n", "nan.stl:2: a coordinate is 'nan'"},
    {"none.stl", "solid\nendsolid\n", "0 vertices and 0 usable faces"},
};

static void expect_bad(const char *path, const char *message)
{
    lf_mesh *mesh = NULL;
    lf_error err = {"no message"};
    assert_int_equal(lf_mesh_read(path, &mesh, NULL, &err), LF_BAD_INPUT);
    assert_null(mesh);
    if (!strstr(err.text, message))
        fail_msg("%s: message '%s' lacks '%s'", path, err.text, message);
    assert_int_equal(lf_mesh_read(path, &mesh, NULL, NULL), LF_BAD_INPUT);
}

static void test_bad_files(void **state)
{
    char path[128];
    put_text(state, "bad.mtl", "newmtl a\nKd red 0 0\n", path);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        expect_bad(put_text(state, bad[i].name, bad[i].text, path), bad[i].message);
    const folder *f = *state;
    snprintf(path, sizeof path, "%s/gone.obj", f->path);
    expect_bad(path, "gone.obj: cannot be opened: No such file");
    snprintf(path, sizeof path, "%s/folder.obj", f->path);
    mkdir(path, 0700);
    expect_bad(path, "is not a regular file");
}

static void expect_bad_ply_body(void **state, const char *body, const char *message)
{
    char path[128], text[1024];
    snprintf(text, sizeof text, "%s%s", ply_head, body);
    expect_bad(put_text(state, "body.ply", text, path), message);
}

static void test_bad_ply_bodies(void **state)
{
    const char *v = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n";
    char body[256];
    expect_bad_ply_body(state, "0 0 0\n1 0 0\n", "ends after 2 of 4 of element vertex");
    expect_bad_ply_body(state, "0 0 0\n1 0 inf\n", "body.ply:15: vertex is 'inf'");
    snprintf(body, sizeof body, "%s3 0 1 4 0 0 0\n3 0 1 2 0 0 0\n", v);
    expect_bad_ply_body(state, body, "face 0 has the index 4");
    snprintf(body, sizeof body, "%s3 0 1 -1 0 0 0\n3 0 1 2 0 0 0\n", v);
    expect_bad_ply_body(state, body, "face 0 has the index -1");
    snprintf(body, sizeof body, "%s3 0 1 2 0 0 0\n2 0 1 0 0 0\n", v);
    expect_bad_ply_body(state, body, "face 1 has 2 corners");
    snprintf(body, sizeof body, "%s3 0 1 2 0 0 0\n200 0 1 0 0 0\n", v);
    expect_bad_ply_body(state, body, "face 1 has a list of 200 values");
    snprintf(body, sizeof body, "%s3 0 1 2 0 0 0\n3 0 1\n", v);
    expect_bad_ply_body(state, body, "the line ends where face should stand");
}

/* Bytes changed in binary files. */
static void test_bad_binary(void **state)
{
    char path[128], bytes[2048];
    size_t n = binary_ply(bytes, false);
    const size_t body = n - 4 * 13 - 48;
    put_float(bytes + body, NAN, false);
    expect_bad(put(state, "nan.ply", bytes, n, path), "vertex 0 has a coordinate nan");
    put_float(bytes + body, 2e30f, false);
    expect_bad(put(state, "far.ply", bytes, n, path), "vertex 0 has a coordinate 2e+30");
    n = binary_ply(bytes, false);
    put_int(bytes + n - 4, 4, false);
    expect_bad(put(state, "index.ply", bytes, n, path), "face 3 has the index 4");
    n = binary_stl(bytes);
    put_float(bytes + 84 + 12, INFINITY, false);
    expect_bad(put(state, "inf.stl", bytes, n, path), "facet 0 has a coordinate inf");
    n = binary_stl(bytes);
    expect_bad(put(state, "cut.stl", bytes, n - 1, path), "a binary STL of 4 facets has 284 bytes");
}

/* Every prefix, and every file with one byte changed, is read or refused; never worse. */
static void try_all_cuts(void **state, const char *name, const char *bytes, size_t size)
{
    char path[128], changed[2048];
    int refused = 0;
    for (size_t n = 1; n <= 2 * size; n++) {
        lf_mesh *mesh = NULL;
        lf_error err = {""};
        memcpy(changed, bytes, size);
        if (n > size)
            changed[n - size - 1] = (char)(changed[n - size - 1] ^ (1 << n % 8));
        put(state, name, changed, n > size ? size : n, path);
        if (lf_mesh_read(path, &mesh, NULL, &err) == LF_OK) {
            assert_true(mesh->faces > 0 && lf_mesh_area(mesh) >= 0);
        } else {
            assert_null(mesh);
            assert_true(err.text[0]);
            refused++;
        }
        lf_mesh_free(mesh);
    }
    assert_true(refused > 0);
}

static void test_cut_and_changed_files(void **state)
{
    char bytes[2048];
    static const char obj[] = "mtllib q.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0.5\nv 0 1 -2.5e-1\n"
                              "usemtl a\nvt 0 1\nvn 0 0 1\nf 1/1/1 2//1 3\nf -4 -3 -2 -1\n";
    static const char off[] =
        "COFF\n3 2 0\n0 0 0 1\n1 0 0\n0 1 0.5 # x\n3 0 1 2 255 0 0\n3 2 1 0\n";
    try_all_cuts(state, "c.obj", obj, sizeof obj - 1);
    try_all_cuts(state, "c.off", off, sizeof off - 1);
    try_all_cuts(state, "c.stl", stl_text, 330);
    try_all_cuts(state, "b.stl", bytes, binary_stl(bytes));
    try_all_cuts(state, "c.ply", bytes, binary_ply(bytes, false));
    const size_t n = (size_t)snprintf(bytes, sizeof bytes,
                                      "%s0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
                                      "4 0 1 2 3 9 9 9\n3 0 1 2 9 9 9\n",
                                      ply_head);
    try_all_cuts(state, "t.ply", bytes, n);
}

static void check_round_trip(void **state, lf_mesh *mesh)
{
    const folder *f = *state;
    char path[128];
    lf_error err = {""};
    for (long i = 0; i < mesh->faces; i++)
        mesh->colour[i][i % 3] = (float)(i % 256) / 255;
    snprintf(path, sizeof path, "%s/written.ply", f->path);
    assert_int_equal(lf_mesh_write_ply(path, mesh, &err), LF_OK);
    lf_mesh *back = read_good(path, NULL);
    assert_int_equal(back->vertices, mesh->vertices);
    assert_int_equal(back->faces, mesh->faces);
    for (long i = 0; i < 3 * mesh->vertices; i++)
        assert_close(back->vertex[i / 3][i % 3], mesh->vertex[i / 3][i % 3], 1e-7, 0);
    assert_memory_equal(back->face, mesh->face, (size_t)mesh->faces * sizeof *mesh->face);
    for (long i = 0; i < 3 * mesh->faces; i++)
        assert_close(back->colour[i / 3][i % 3], mesh->colour[i / 3][i % 3], 0, 0.5 / 255 + 1e-6);
    lf_mesh_free(back);
}

static void test_write_ply(void **state)
{
    lf_mesh *torus = lf_mesh_torus(0.5, 0.2, 20, 10);
    check_round_trip(state, torus); /* through the half-edge mesh */
    lf_mesh_append(torus, torus);
    torus->face[0][0] = torus->face[5][1]; /* any soup */
    torus->face[1][0] = torus->face[1][1];
    lf_mesh_report r = {0};
    lf_mesh_closed_check(torus, &r);
    assert_false(r.manifold);
    check_round_trip(state, torus);
    lf_error err = {""};
    assert_int_equal(lf_mesh_write_ply("/nowhere/at/all.ply", torus, &err), LF_FAILED);
    assert_non_null(strstr(err.text, "/nowhere/at/all.ply"));
    lf_mesh_free(torus);
}

/* OpenMesh reports a bad file on std::cerr; nothing of that may be seen. */
static void test_silence(void **state)
{
    char path[128], seen[128];
    const folder *f = *state;
    put_text(state, "quiet.obj",
             "mtllib gone.mtl\nusemtl gone\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
             "f 3 2 1\nf 1 2 3\n",
             path);
    snprintf(seen, sizeof seen, "%s/stderr", f->path);
    fflush(stderr);
    const int keep = dup(2), file = open(seen, O_CREAT | O_WRONLY, 0600);
    dup2(file, 2);
    lf_mesh *m = read_good(path, NULL);
    lf_mesh_report r = {0};
    lf_mesh_closed_check(m, &r);
    fflush(stderr);
    dup2(keep, 2);
    close(file);
    close(keep);
    struct stat info;
    assert_int_equal(stat(seen, &info), 0);
    assert_int_equal(info.st_size, 0);
    assert_false(r.manifold);
    lf_mesh_free(m);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_obj_colours_polygons_and_indices),
        cmocka_unit_test(test_obj_without_mtl),
        cmocka_unit_test(test_off_colours_comments_prefixes),
        cmocka_unit_test(test_ply_text),
        cmocka_unit_test(test_tetrahedron_in_every_format),
        cmocka_unit_test(test_bad_files),
        cmocka_unit_test(test_bad_ply_bodies),
        cmocka_unit_test(test_bad_binary),
        cmocka_unit_test(test_cut_and_changed_files),
        cmocka_unit_test(test_write_ply),
        cmocka_unit_test(test_silence),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
