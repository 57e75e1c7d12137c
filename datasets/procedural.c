/* procedural.c: lofts, bars, ellipsoids, and the table of families. */
#include "datasets/procedural.h"

#include <math.h>

#include "datasets/procedural_build.h"

static const struct {
    const char *name;
    void (*build)(lf_builder *b);
} families[] = {{"chair", lf_build_chair}, {"airplane", lf_build_airplane}, {"car", lf_build_car}};

static void put_face(lf_mesh *mesh, long *at, int a, int b, int c)
{
    mesh->face[*at][0] = a;
    mesh->face[*at][1] = b;
    mesh->face[*at][2] = c;
    ++*at;
}

static void mean_point(int corners, double (*ring)[3], double mean[3])
{
    for (int j = 0; j < 3; j++) {
        mean[j] = 0;
        for (int i = 0; i < corners; i++)
            mean[j] += ring[i][j] / corners;
    }
}

/* Ring r, corner i is vertex r * corners + i; the two last vertices are the caps' middles. */
static lf_mesh *loft(int rings, int corners, double (*point)[LF_RING_MAX][3])
{
    lf_mesh *mesh = lf_mesh_create((long)rings * corners + 2, 2L * rings * corners);
    const int first = rings * corners, last = first + 1, top = (rings - 1) * corners;
    long at = 0;
    for (int r = 0; r < rings; r++)
        for (int i = 0; i < corners; i++) {
            const int a = r * corners + i, b = r * corners + (i + 1) % corners;
            memcpy(mesh->vertex[a], point[r][i], sizeof *mesh->vertex);
            if (r + 1 < rings) {
                put_face(mesh, &at, a, b, b + corners);
                put_face(mesh, &at, a, b + corners, a + corners);
            }
        }
    mean_point(corners, point[0], mesh->vertex[first]);
    mean_point(corners, point[rings - 1], mesh->vertex[last]);
    for (int i = 0; i < corners; i++) {
        put_face(mesh, &at, (i + 1) % corners, i, first);
        put_face(mesh, &at, top + i, top + (i + 1) % corners, last);
    }
    return mesh;
}

static void turn_outward(lf_mesh *mesh)
{
    if (lf_mesh_volume(mesh) >= 0)
        return;
    for (long i = 0; i < mesh->faces; i++) {
        const int32_t second = mesh->face[i][1];
        mesh->face[i][1] = mesh->face[i][2];
        mesh->face[i][2] = second;
    }
}

void lf_build_loft(lf_builder *b, int rings, int corners, double (*point)[LF_RING_MAX][3])
{
    LF_REQUIRE(rings >= 2 && rings <= LF_RINGS_MAX && corners >= 3 && corners <= LF_RING_MAX,
               "a loft of %d rings of %d corners", rings, corners);
    LF_REQUIRE(b->parts.count < LF_PARTS_MAX, "more than %d parts", (int)LF_PARTS_MAX);
    lf_mesh *part = loft(rings, corners, point);
    turn_outward(part);
    lf_mesh_paint(part, b->colour[0], b->colour[1], b->colour[2]);
    lf_mesh_append(b->mesh, part);
    lf_mesh_free(part);
    b->parts.first[++b->parts.count] = b->mesh->faces;
}

void lf_build_bar(lf_builder *b, int axis, int sides, lf_end from, lf_end to)
{
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    const int a0 = u < v ? u : v, a1 = u < v ? v : u; /* the two other axes in rising order */
    const double reach = sides == 4 ? sqrt(2) : 1;    /* corners of a square lie further out */
    const lf_end *ends[2] = {&from, &to};
    double point[2][LF_RING_MAX][3];
    for (int r = 0; r < 2; r++)
        for (int i = 0; i < sides; i++) {
            const double angle = 2 * 3.14159265358979323846 * (i + 0.5) / sides;
            memcpy(point[r][i], ends[r]->at, sizeof point[r][i]);
            point[r][i][a0] += reach * ends[r]->half[0] * cos(angle);
            point[r][i][a1] += reach * ends[r]->half[1] * sin(angle);
        }
    lf_build_loft(b, 2, sides, point);
}

void lf_build_box(lf_builder *b, double x, double y, double z, double hx, double hy, double hz)
{
    const lf_end low = {{x, y - hy, z}, {hx, hz}}, high = {{x, y + hy, z}, {hx, hz}};
    lf_build_bar(b, 1, 4, low, high);
}

void lf_build_ellipsoid(lf_builder *b, const double centre[3], const double radius[3])
{
    enum { rings = 9, corners = 12 };
    double point[rings][LF_RING_MAX][3];
    for (int r = 0; r < rings; r++) {
        const double polar = 3.14159265358979323846 * (r + 0.35) / (rings - 0.3);
        for (int i = 0; i < corners; i++) {
            const double angle = 2 * 3.14159265358979323846 * i / corners;
            point[r][i][0] = centre[0] + radius[0] * sin(polar) * cos(angle);
            point[r][i][1] = centre[1] + radius[1] * sin(polar) * sin(angle);
            point[r][i][2] = centre[2] + radius[2] * cos(polar);
        }
    }
    lf_build_loft(b, rings, corners, point);
}

double lf_build_between(lf_builder *b, double low, double high)
{
    return low + (high - low) * lf_uniform(&b->random);
}

bool lf_build_chance(lf_builder *b, double p)
{
    return lf_uniform(&b->random) < p;
}

int lf_build_choice(lf_builder *b, int n)
{
    return (int)lf_index(&b->random, n);
}

void lf_build_colour(lf_builder *b, double red, double green, double blue)
{
    b->colour[0] = (float)red;
    b->colour[1] = (float)green;
    b->colour[2] = (float)blue;
}

/* Hue uniform, moderate saturation and value. */
void lf_build_random_colour(lf_builder *b)
{
    const double hue = lf_build_between(b, 0, 6), strength = lf_build_between(b, 0.2, 0.8);
    const double value = lf_build_between(b, 0.35, 0.9);
    double rgb[3];
    for (int i = 0; i < 3; i++) {
        const double k = fmod(hue + 5 - 2 * i, 6);
        rgb[i] = value * (1 - strength * fmax(0, fmin(1, fmin(k, 4 - k))));
    }
    lf_build_colour(b, rgb[0], rgb[1], rgb[2]);
}

lf_status lf_procedural_mesh(const char *family, uint64_t seed, uint64_t index, lf_mesh **out,
                             lf_parts *parts, lf_error *err)
{
    const uint64_t count = sizeof families / sizeof *families;
    uint64_t which = 0;
    while (which < count && strcmp(family, families[which].name) != 0)
        which++;
    if (which == count)
        return lf_fail(err, LF_BAD_INPUT,
                       "'%s' is no procedural family; allowed are chair, airplane, car", family);
    lf_builder b = {.mesh = lf_mesh_create(0, 0),
                    .random = lf_stream_at(seed, LF_RANDOM_SHAPE, which, index)};
    families[which].build(&b);
    const lf_status status = lf_mesh_normalise(b.mesh, err);
    LF_REQUIRE(status == LF_OK, "%s %llu is flat", family, (unsigned long long)index);
    if (parts)
        *parts = b.parts;
    *out = b.mesh;
    return LF_OK;
}

bool lf_procedural_inside(const lf_mesh *mesh, const lf_parts *parts, const double p[3])
{
    for (int i = 0; i < parts->count; i++) {
        const long first = parts->first[i], count = parts->first[i + 1] - first;
        if (lf_mesh_winding(mesh, first, count, p) > 0.5)
            return true;
    }
    return false;
}
