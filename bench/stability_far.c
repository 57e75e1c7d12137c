/* stability_far.c: scenes far from the origin.                          [method.md 4.1, 4.5]
 * Cameras and points are moved by a number of scene sizes and rounded there: what the network then
 * sees differs by |t| 1e-16 of a scene, which is the condition of its geometry. Exact is what the
 * same case gives at the origin, where it is computed in double.
 */
#include "bench/stability.h"
#include "bench/stability_scene.h"
#include "layers/light_blocks.h"
#include "models/ray_samples.h"

#define AWAY LF_STABILITY_AT(1, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7)

static void projection(lf_stability *s)
{
    lf_stability_scene here, there;
    long double direction[3 * LF_STABILITY_SEEN], uv[2 * LF_STABILITY_SEEN];
    lf_stability_scene_make(&here, 0, 0);
    lf_stability_scene_make(&there, 0, s->parameter);
    lf_stability_scene_exact(&here, direction, uv);
    s->geometry = 10 * s->parameter;
    lf_stability_numbers(s, "direction", 3 * LF_STABILITY_SEEN, there.direction, direction);
    lf_stability_numbers(s, "pixel", 2 * LF_STABILITY_SEEN, there.uv, uv);
}

static void point_head(lf_stability *s)
{
    lf_stability_scene there;
    lf_stability_scene_make(&there, 0, s->parameter);
    s->geometry = 10 * s->parameter;
    lf_stability_scene_head(s, &there);
}

/* ---- rendering ------------------------------------------------------------------------------- */

enum { RAYS = 2, SAMPLES = 4, V = 3, F = 5, C = 2, PLANES = 5 };
static const lf_types types = {.count = 3, .omega = {0, 1, 4}};

typedef struct light_scene {
    double origin[3 * RAYS], direction[3 * RAYS], stretch[RAYS], depth[RAYS * SAMPLES];
    lf_source source[V];
} light_scene;

/* K R' [I | -c] of a camera at c that looks along z with focal length 50. */
static void look(lf_source *s, const double c[3])
{
    const double k[12] = {50, 0, 32, 0, 0, 50, 32, 0, 0, 0, 1, 0};
    *s = (lf_source){.width = 65, .height = 65};
    memcpy(s->projection, k, sizeof k);
    memcpy(s->centre, c, sizeof s->centre);
    for (int i = 0; i < 3; i++)
        for (int a = 0; a < 3; a++)
            s->projection[4 * i + 3] -= k[4 * i + a] * c[a];
}

static void make_light_scene(light_scene *l, double away)
{
    const double shift[3] = {away, -0.75 * away, 0.5 * away};
    for (int i = 0; i < RAYS; i++) {
        const double d[3] = {0.1 + 0.2 * i, -0.15, 1}, size = hypot(hypot(d[0], d[1]), d[2]);
        for (int a = 0; a < 3; a++) {
            l->origin[3 * i + a] = 0.1 * a - 0.2 + shift[a];
            l->direction[3 * i + a] = d[a] / size;
        }
        l->stretch[i] = size;
        for (int k = 0; k < SAMPLES; k++)
            l->depth[i * SAMPLES + k] = 1.5 + k;
    }
    for (int v = 0; v < V; v++)
        look(&l->source[v], (const double[3]){0.4 * v - 0.3 + shift[0], 0.3 - 0.2 * v + shift[1],
                                              -0.1 * v + shift[2]});
}

/* Pixels by projection matrices. */
static void sources(lf_stability *s)
{
    light_scene l;
    long double exact[RAYS * SAMPLES * V * 2];
    for (int there = 0; there < 2; there++) {
        make_light_scene(&l, there ? s->parameter : 0);
        const lf_target_rays rays = {RAYS, l.origin, l.direction, l.stretch, 1, 6};
        const lf_seen_samples seen =
            lf_see_samples(s->tape, &rays, 0, RAYS, SAMPLES, l.depth, V, l.source);
        for (int i = 0; !there && i < RAYS * SAMPLES * V * 2; i++)
            exact[i] = seen.uv[i];
        if (there)
            lf_stability_numbers(s, "pixel", RAYS * SAMPLES * V * 2, seen.uv, exact);
    }
    s->geometry = 10 * s->parameter;
}

/* Convolution and attention on geometry made there; blocks are what the renderer runs. */
static void light_layers(lf_stability *s)
{
    light_scene l;
    make_light_scene(&l, s->parameter);
    double centre[3 * V];
    uint8_t seen[RAYS * SAMPLES * V];
    memset(seen, 1, sizeof seen);
    for (int v = 0; v < V; v++)
        memcpy(centre + 3 * v, l.source[v].centre, sizeof l.source[v].centre);
    const lf_light_rays rays = {RAYS,    SAMPLES, V,    l.origin, l.direction,
                                l.depth, centre,  seen, 1,        6};
    const lf_light_geometry g = lf_light_geometry_make(s->tape, &types, &rays);
    lf_ray_ray_convolution convolution;
    lf_cross_attention_layer layer;
    lf_ray_ray_convolution_init(s->store, &convolution, "convolution", &types, F, C, 6);
    lf_cross_attention_init(s->store, &layer, "cross", &types, F, C, 6, 2);
    lf_stability_parameters(s);
    lf_tensor *f = lf_stability_input(s, "f", 4, LF_DIMS(RAYS, SAMPLES, V, F), 1);
    const lf_blocks k = lf_blocks_make(s->tape, &g);
    lf_tensor *views = lf_blocks_of_views(s->tape, &k, f);
    lf_tensor *point = lf_blocks_convolution(s->tape, &k, &convolution, views, true);
    const lf_attended y = lf_blocks_cross(s->tape, &k, &layer, views, point);
    s->geometry = 40 * s->parameter;
    lf_stability_output(s, "field", lf_blocks_rows(s->tape, &k, y.field), NULL);
    lf_stability_output(s, "weight", y.weight, NULL);
}

/* Two rays by their moments, which are as large as the distance from the origin. */
static void ray_pair(lf_stability *s)
{
    double number[3];
    long double exact[3];
    for (int there = 0; there < 2; there++) {
        light_scene l;
        make_light_scene(&l, there ? s->parameter : 0);
        const lf_ray x = lf_ray_through(l.origin, l.direction);
        const lf_ray y = lf_ray_through(l.source[2].centre, l.direction + 3);
        const lf_ray_pair p = lf_ray_relative(&x, &y);
        number[0] = p.azimuth[0];
        number[1] = p.azimuth[1];
        number[2] = p.distance;
        for (int i = 0; !there && i < 3; i++)
            exact[i] = number[i];
    }
    s->geometry = 100 * s->parameter;
    lf_stability_numbers(s, "pair", 3, number, exact);
}

static const lf_stability_case cases[] = {
    {"far: projection", "away", projection, AWAY},
    {"far: point head", "away", point_head, AWAY},
    {"far: pixels of samples", "away", sources, AWAY},
    {"far: convolution, attention", "away", light_layers, AWAY},
    {"far: ray pair", "away", ray_pair, AWAY},
};

const lf_stability_table lf_stability_far = {cases, sizeof cases / sizeof *cases};
