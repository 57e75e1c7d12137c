/* scene_make.c: cameras and pictures of a built-in scene.                      [scene_make.h] */
#include "datasets/scene_make_internal.h"

#include <strings.h>

static const double pi = 3.14159265358979323846;
static const double object_near = 2.6, object_far = 5.6, object_focal = 1.389;
static const double cap_low = -0.1, cap_high = 0.98; /* z of the viewing direction */
static const double room_focal = 0.85;
enum { VIEWS_MAX = 10000, TEST_EVERY = 8 };

static const char *const kind_names[] = {"glossy", "diffuse", "forward"};

lf_scene_make_options lf_scene_make_defaults(void)
{
    return (lf_scene_make_options){.kind = LF_KIND_GLOSSY,
                                   .size = 100,
                                   .train_views = 35,
                                   .test_views = 5,
                                   .rays = 3,
                                   .highlight = 1};
}

const char *lf_scene_kind_name(lf_scene_kind kind)
{
    LF_REQUIRE(kind < LF_SCENE_KINDS, "kind %d of a scene", (int)kind);
    return kind_names[kind];
}

lf_status lf_scene_kind_parse(const char *name, lf_scene_kind *out, lf_error *err)
{
    for (int i = 0; i < LF_SCENE_KINDS; i++)
        if (strcasecmp(name, kind_names[i]) == 0) {
            *out = (lf_scene_kind)i;
            return LF_OK;
        }
    return lf_fail(err, LF_BAD_INPUT, "\"%.100s\" is no kind of scene: glossy, diffuse or forward",
                   name);
}

/* ---- cameras ------------------------------------------------------------------------------ */

/* Two numbers in [0, 1): train views by the additive sequence of the plastic number with a random
 * start (Roberts, 2018), test views uniform. */
static void draw_place(const lf_scene_make_options *o, bool test, long number, lf_stream *s,
                       double out[2])
{
    static const double step[2] = {0.7548776662466927, 0.5698402909980532};
    lf_stream start = lf_stream_at(o->seed, LF_RANDOM_SCENE, LF_PART_VIEWS, o->index);
    for (int i = 0; i < 2; i++) {
        const double x = lf_uniform(&start) + (double)number * step[i], u = lf_uniform(s);
        out[i] = test ? u : x - floor(x);
    }
}

static void set_lens(lf_camera *c, double focal, int width, int height)
{
    c->fx = c->fy = focal;
    c->width = width;
    c->height = height;
    c->cx = 0.5 * width - 0.5;
    c->cy = 0.5 * height - 0.5;
}

/* On the cap, further away where the object's reach asks for it; y up. */
static lf_camera object_camera(const lf_world *w, int size, const double place[2], lf_stream *s)
{
    const double zero[3] = {0, 0, 0};
    double reach = 0;
    for (long v = 0; v < w->mesh->vertices; v++) {
        const double *p = w->mesh->vertex[v];
        reach = fmax(reach, sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]));
    }
    const double distance = fmax(3.8 + 0.4 * lf_uniform(s), object_near + reach + 1e-3);
    const double rise = cap_low + (cap_high - cap_low) * place[1], round = 2 * pi * place[0];
    const double across = distance * sqrt(1 - rise * rise);
    const double centre[3] = {across * cos(round), distance * rise, across * sin(round)};
    lf_camera c = lf_camera_look_at(centre, zero, 0.3, size);
    set_lens(&c, object_focal * size, size, size);
    return c;
}

/* On the patch before the room, y up. */
static lf_camera room_camera(const lf_world *w, int size, const double place[2], lf_stream *s)
{
    const double wide = w->depth / 3, high = 0.6 * wide;
    const double centre[3] = {wide * (place[0] - 0.5), high * (place[1] - 0.5),
                              0.1 * wide * (lf_uniform(s) - 0.5)};
    const double target[3] = {0, -0.1, -0.9 * w->depth};
    lf_camera c = lf_camera_look_at(centre, target, 0.3, size);
    set_lens(&c, room_focal * size, size, 2 * (int)lrint(0.375 * size));
    return c;
}

lf_camera lf_world_camera(const lf_world *world, const lf_scene_make_options *o, bool test,
                          long number)
{
    const long part = (test ? LF_PART_TEST : LF_PART_TRAIN) + number;
    lf_stream s = lf_stream_at(o->seed, LF_RANDOM_SCENE, (uint64_t)part, o->index);
    double place[2];
    lf_motion turn = {.translation = {0, 0, 0}};
    draw_place(o, test, number, &s, place);
    const lf_camera c = o->kind == LF_KIND_FORWARD ? room_camera(world, o->size, place, &s)
                                                   : object_camera(world, o->size, place, &s);
    lf_world_turn(turn.rotation);
    return lf_camera_move(&c, &turn);
}

/* ---- pictures ----------------------------------------------------------------------------- */

/* Buffers of one view. */
typedef struct canvas {
    float *image, *depth; /* [height][width][4], [height][width] */
    uint8_t *rgb, *alpha;
} canvas;

static canvas canvas_of(int size)
{
    const size_t pixels = (size_t)size * (size_t)size;
    const canvas c = {malloc(4 * pixels * sizeof(float)), malloc(pixels * sizeof(float)),
                      malloc(3 * pixels), malloc(pixels)};
    LF_REQUIRE(c.image && c.depth && c.rgb && c.alpha, "no memory for %zu pixels", pixels);
    return c;
}

static void canvas_free(canvas *c)
{
    free(c->image);
    free(c->depth);
    free(c->rgb);
    free(c->alpha);
}

static uint8_t byte_of(float x)
{
    return (uint8_t)lrintf(255 * fminf(1, fmaxf(0, x)));
}

/* Over white. */
static void fill_bytes(canvas *c, long pixels)
{
    for (long p = 0; p < pixels; p++) {
        const float *from = c->image + 4 * p;
        c->alpha[p] = byte_of(from[3]);
        for (int k = 0; k < 3; k++)
            c->rgb[3 * p + k] = byte_of(from[k] + 1 - from[3]);
    }
}

static void room_bounds(const lf_world *w, const lf_camera *camera, float *depth, double *near,
                        double *far)
{
    float least = INFINITY, largest = 0;
    lf_render_depth(w->surface, camera, depth);
    for (long p = 0; p < (long)camera->width * camera->height; p++) {
        least = fminf(least, depth[p]);
        largest = isfinite(depth[p]) ? fmaxf(largest, depth[p]) : largest;
    }
    *near = 0.95 * (double)least;
    *far = 1.05 * (double)largest;
}

static void add_view(lf_scene *scene, const lf_world *w, const lf_scene_make_options *o, canvas *c,
                     bool test, long number)
{
    const bool room = o->kind == LF_KIND_FORWARD;
    const lf_camera camera = lf_world_camera(w, o, test, number);
    double near = object_near, far = object_far;
    char name[32];
    lf_render_shaded(w->surface, &camera, o->rays, 4, lf_world_shade, w, c->image);
    fill_bytes(c, (long)camera.width * camera.height);
    if (room)
        room_bounds(w, &camera, c->depth, &near, &far);
    snprintf(name, sizeof name, "%s%05ld", test ? "test" : "train", number);
    lf_scene_add(scene, name, &camera, near, far, test ? LF_SPLIT_TEST : LF_SPLIT_TRAIN, c->rgb,
                 room ? NULL : c->alpha);
}

static lf_status check(const lf_scene_make_options *o, lf_error *err)
{
    LF_REQUIRE(o->kind < LF_SCENE_KINDS, "kind %d of a scene", (int)o->kind);
    if (o->size < 8 || o->size > 4096)
        return lf_fail(err, LF_BAD_INPUT, "a built-in scene of %d pixels: 8 to 4096", o->size);
    if (!(o->highlight >= 0 && o->highlight <= 100))
        return lf_fail(err, LF_BAD_INPUT, "highlights %g times as strong: 0 to 100", o->highlight);
    if (o->rays < 1 || o->rays > 16)
        return lf_fail(err, LF_BAD_INPUT, "a built-in scene with %d rays an edge: 1 to 16",
                       o->rays);
    if (o->train_views < 1 || o->test_views < 0 || o->train_views > VIEWS_MAX ||
        o->test_views > VIEWS_MAX || o->train_views + o->test_views > VIEWS_MAX)
        return lf_fail(err, LF_BAD_INPUT,
                       "a built-in scene of %ld train and %ld test views: at least 1 and 0, %d "
                       "together at most",
                       o->train_views, o->test_views, (int)VIEWS_MAX);
    return LF_OK;
}

lf_status lf_scene_make(const lf_scene_make_options *o, lf_scene **out, lf_error *err)
{
    lf_world *world;
    char name[64];
    LF_TRY(check(o, err));
    LF_TRY(lf_world_make(o, &world, err));
    snprintf(name, sizeof name, "built-in %s %llu of seed %llu", lf_scene_kind_name(o->kind),
             (unsigned long long)o->index, (unsigned long long)o->seed);
    lf_scene *scene = lf_scene_create(name);
    canvas c = canvas_of(o->size);
    long train = 0, test = 0;
    for (long i = 0; i < o->train_views + o->test_views; i++) {
        const bool held = test < o->test_views && (i % TEST_EVERY == 0 || train == o->train_views);
        add_view(scene, world, o, &c, held, held ? test++ : train++);
    }
    canvas_free(&c);
    lf_world_free(world);
    *out = scene;
    return LF_OK;
}
