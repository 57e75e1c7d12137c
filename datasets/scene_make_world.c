/* scene_make_world.c: meshes, paints and light of a built-in scene. All is put together with y up,
 * as meshes are, cameras of FORWARD looking along -z, and turned at the end. */
#include "datasets/scene_make_internal.h"

#include "datasets/procedural.h"

static const char *const families[] = {"chair", "airplane", "car"};
enum { FAMILIES = 3, OBJECTS_MIN = 4, OBJECTS_MAX = 6 };

void lf_world_turn(double rotation[9])
{
    lf_rotation_axis(0, 0.5 * 3.14159265358979323846, rotation);
}

void lf_world_free(lf_world *world)
{
    if (!world)
        return;
    lf_surface_close(world->surface);
    lf_mesh_free(world->mesh);
    free(world);
}

/* One number a statement: C leaves the order of evaluation within a list open. */
static double between(lf_stream *s, double low, double high)
{
    return low + (high - low) * lf_uniform(s);
}

/* The scene's mesh file, or shape `shape` of a family; box centred, diagonal 1. */
static lf_status load(const lf_scene_make_options *o, bool file, int family, uint64_t shape,
                      lf_mesh **out, lf_error *err)
{
    if (!file || !o->mesh)
        return lf_procedural_mesh(families[family], o->seed, shape, out, NULL, err);
    lf_mesh *mesh;
    LF_TRY(lf_mesh_read(o->mesh, &mesh, NULL, err));
    const lf_status status = lf_mesh_normalise(mesh, err);
    if (status != LF_OK) {
        lf_mesh_free(mesh);
        return lf_error_context(err, status, "%s", o->mesh);
    }
    *out = mesh;
    return LF_OK;
}

/* Scale, turn about y, shift. */
static void place(lf_mesh *mesh, double scale, double yaw, const double shift[3])
{
    double r[9];
    lf_rotation_axis(1, yaw, r);
    for (int i = 0; i < 9; i++)
        r[i] *= scale;
    lf_mesh_transform(mesh, r, shift);
}

/* Append a mesh with a paint of its own; the mesh is freed. */
static void add(lf_world *w, const lf_scene_make_options *o, lf_mesh *mesh, double scale,
                double strength)
{
    LF_REQUIRE(w->paints < LF_PAINTS_MAX, "more than %d paints", (int)LF_PAINTS_MAX);
    lf_stream s =
        lf_stream_at(o->seed, LF_RANDOM_SCENE, (uint64_t)(LF_PART_PAINT + w->paints), o->index);
    lf_mesh_append(w->mesh, mesh);
    lf_mesh_free(mesh);
    w->paint[w->paints++] = lf_paint_random(&s, scale, strength);
    w->first[w->paints] = w->mesh->faces;
}

/* ---- objects ------------------------------------------------------------------------------ */

static lf_status make_object(lf_world *w, const lf_scene_make_options *o, lf_stream *s,
                             lf_error *err)
{
    const double diagonal = between(s, 1.9, 2.5), zero[3] = {0, 0, 0};
    const double turn = between(s, -3.14159265, 3.14159265), rise = between(s, 0.4, 1.1);
    lf_mesh *mesh;
    /* a family is not tied to what else goes round with the index, as a scene's kind does */
    const uint64_t round = o->index / FAMILIES;
    LF_TRY(load(o, true, (int)((o->index + round) % FAMILIES), round, &mesh, err));
    place(mesh, diagonal, 0, zero);
    add(w, o, mesh, 1, 1);
    w->light[0] = cos(rise) * cos(turn);
    w->light[1] = sin(rise);
    w->light[2] = cos(rise) * sin(turn);
    const double strength = between(s, 0.3, 0.7);
    w->highlight = o->kind == LF_KIND_GLOSSY ? o->highlight * strength : 0;
    return LF_OK;
}

/* ---- rooms -------------------------------------------------------------------------------- */

typedef struct room {
    double half_width, floor, ceiling, depth;
} room;

/* The box of the room, which the cameras stand in: each wall has a colour of its own. */
static lf_mesh *walls(const room *r, lf_stream *s)
{
    const double low[3] = {-r->half_width, r->floor, -r->depth};
    const double high[3] = {r->half_width, r->ceiling, 1.5};
    lf_mesh *mesh = lf_mesh_box(low, high);
    for (long f = 0; f < mesh->faces; f += 2) /* two triangles a wall */
        for (int c = 0; c < 3; c++)
            mesh->colour[f][c] = mesh->colour[f + 1][c] = (float)between(s, 0.3, 1);
    return mesh;
}

/* A ball, a ring or a box, diagonal of its box about 1. */
static lf_mesh *solid(lf_stream *s)
{
    const double zero[3] = {0, 0, 0};
    double low[3], high[3];
    float colour[3];
    lf_mesh *mesh;
    for (int i = 0; i < 3; i++) {
        high[i] = between(s, 0.15, 0.4);
        low[i] = -high[i];
        colour[i] = (float)lf_uniform(s);
    }
    const long which = lf_index(s, 3);
    if (which == 0)
        mesh = lf_mesh_sphere(4, 0.33, zero);
    else if (which == 1)
        mesh = lf_mesh_torus(0.28, 0.4 * high[0], 48, 24);
    else
        mesh = lf_mesh_box(low, high);
    lf_mesh_paint(mesh, colour[0], colour[1], colour[2]);
    return mesh;
}

/* Lift the mesh to stand on the floor or to float at a height that the cameras see. */
static void lift(lf_mesh *mesh, const room *r, double depth, lf_stream *s)
{
    double low[3], high[3];
    lf_mesh_bounds(mesh, low, high);
    const bool floats = lf_uniform(s) < 0.5;
    const double seen = fmin(0.3 * depth, 1.2), height = between(s, -seen, seen);
    const double least = r->floor - low[1], most = r->ceiling - high[1];
    const double shift[3] = {0, floats ? fmin(most, fmax(least, height)) : least, 0};
    lf_mesh_transform(mesh, NULL, shift);
}

/* Object `i` of `n`: each in its own range of depths, the nearest first, left and right by turns.
 */
static lf_status furnish(lf_world *w, const lf_scene_make_options *o, const room *r, lf_stream *s,
                         int i, int n, lf_error *err)
{
    const bool shape = lf_uniform(s) < 0.6 || i == 0;
    const int family = (int)lf_index(s, FAMILIES);
    lf_mesh *mesh;
    if (shape)
        LF_TRY(load(o, i == 0, family, OBJECTS_MAX * o->index + (uint64_t)i, &mesh, err));
    else
        mesh = solid(s);
    const double depth = 2.5 + (r->depth - 3.3) * (i + lf_uniform(s)) / n;
    const double size = between(s, 0.35, 0.5) * (depth + 0.6);
    const double reach = fmin(0.5 * depth, r->half_width - 0.5 * size);
    const double side = i % 2 ? 1 : -1, x = side * reach * between(s, 0.05, 0.95);
    const double yaw = between(s, -3.14159265, 3.14159265), at[3] = {x, 0, -depth};
    place(mesh, size, yaw, at);
    lift(mesh, r, depth, s);
    add(w, o, mesh, 1, 0.8);
    return LF_OK;
}

static lf_status make_room(lf_world *w, const lf_scene_make_options *o, lf_stream *s, lf_error *err)
{
    static const double least[3] = {-0.7, 0.4, 0.5}, most[3] = {0.7, 0.9, 1};
    room r = {.depth = 6};
    double light[3];
    r.half_width = between(s, 2.2, 2.8);
    r.floor = -between(s, 1.4, 1.7);
    r.ceiling = between(s, 1.6, 1.9);
    w->depth = r.depth;
    const int objects = OBJECTS_MIN + (int)lf_index(s, OBJECTS_MAX - OBJECTS_MIN + 1);
    for (int i = 0; i < 3; i++)
        light[i] = between(s, least[i], most[i]);
    const double n = hypot(hypot(light[0], light[1]), light[2]);
    for (int i = 0; i < 3; i++)
        w->light[i] = light[i] / n;
    add(w, o, walls(&r, s), 0.5, 0.6);
    for (int i = 0; i < objects; i++)
        LF_TRY(furnish(w, o, &r, s, i, objects, err));
    return LF_OK;
}

/* ---- both --------------------------------------------------------------------------------- */

static lf_status build(lf_world *w, const lf_scene_make_options *o, lf_error *err)
{
    const double zero[3] = {0, 0, 0};
    double turn[9];
    lf_stream s = lf_stream_at(o->seed, LF_RANDOM_SCENE, LF_PART_WORLD, o->index);
    if (o->kind == LF_KIND_FORWARD)
        LF_TRY(make_room(w, o, &s, err));
    else
        LF_TRY(make_object(w, o, &s, err));
    lf_world_turn(turn);
    lf_mesh_transform(w->mesh, turn, zero);
    lf_rotation_apply(turn, w->light, w->light);
    const lf_status status = lf_surface_open(w->mesh, &w->surface, err);
    return status == LF_OK || !o->mesh ? status : lf_error_context(err, status, "%s", o->mesh);
}

lf_status lf_world_make(const lf_scene_make_options *options, lf_world **out, lf_error *err)
{
    lf_world *w = calloc(1, sizeof *w);
    LF_REQUIRE(w, "out of memory");
    w->mesh = lf_mesh_create(0, 0);
    const lf_status status = build(w, options, err);
    if (status == LF_OK)
        *out = w;
    else
        lf_world_free(w);
    return status;
}
