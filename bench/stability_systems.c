/* stability_systems.c: the compared systems DISN, FvOR and IBRNet to distances where geometry
 * degenerates: points at a camera's centre, on the images' borders, seen by few views or none, on
 * the border of FvOR's volume; equal views, flat pictures, scenes far away. [method.md 5c.1, 5d]
 *
 * Maps are given (inputs), so that what is measured is what comes behind the backbone: sampling,
 * FvOR's volume, pooling over views, the MLPs. Only flat pictures go through it.
 */
#include "bench/stability.h"
#include "bench/stability_scene.h"
#include "models/disn.h"
#include "models/fvor.h"
#include "models/ibrnet_sdf.h"

enum {
    SIZE = 65,
    MAP = 9,
    PICTURE = 17, /* of given ones: as good as SIZE, and quick */
    FIELDS = 4,
    GRID = 5,
    VOXELS = GRID * GRID * GRID,
    POINTS = LF_STABILITY_POINTS,
    VIEWS = LF_CUBE_VIEWS
};

#define DISTANCES LF_STABILITY_AT(1e-1, 1e-3, 1e-5, 1e-7, 1e-9, 1e-12)

/* ---- the model ------------------------------------------------------------------------------- */

static void free_model(void *model)
{
    lf_recon_free(model);
}

static lf_recon *make_model(lf_stability *s, const lf_recon_network *network)
{
    const lf_recon_config config = {.network = network,
                                    .backbone = {.in_channels = 2,
                                                 .c8 = true,
                                                 .stem_fields = 1,
                                                 .stem_size = 3,
                                                 .stages = 1,
                                                 .blocks = {1},
                                                 .fields = {1},
                                                 .first_stride = 2,
                                                 .features = FIELDS,
                                                 .momentum = 0.1},
                                    .image_size = SIZE,
                                    .sample_image = true,
                                    .mlp_widths = 1,
                                    .mlp = {16},
                                    .width = 8,
                                    .disn = {2, {8, 16}, 8},
                                    .fvor = {2, {1, 1}, GRID}};
    lf_recon *model = lf_alloc(s->tape, sizeof *model);
    lf_recon_init(model, s->store, &config);
    lf_stability_keep(s, free_model, model);
    lf_stability_parameters(s);
    return model;
}

/* ---- the scene ------------------------------------------------------------------------------- */

/* Points, and the voxels of a grid, before the eight built-in cameras; on the tape, for the
 * backward. */
typedef struct world {
    lf_stability_scene scene;
    double position[3 * POINTS], voxel[VOXELS][3];
    double uv[2 * VOXELS * VIEWS], direction[3 * VOXELS * VIEWS], distance[VOXELS * VIEWS];
    uint8_t mask[VOXELS * VIEWS];
    long first[VOXELS]; /* all 0 */
    lf_recon_points points, grid;
} world;

/* As lf_stability_scene_make; positions are those of the object, wherever that is. */
static world *make_world(lf_stability *s, const lf_recon *model, double near, double away)
{
    static const double shift[3] = {1, -0.75, 0.5};
    world *w = lf_alloc(s->tape, sizeof *w);
    lf_stability_scene unmoved;
    memset(w->first, 0, sizeof w->first);
    lf_stability_scene_make(&unmoved, near, 0);
    lf_stability_scene_make(&w->scene, near, away);
    memcpy(w->position, unmoved.point, sizeof w->position);
    lf_stability_scene *c = &w->scene;
    w->points = (lf_recon_points){POINTS,  VIEWS,    c->uv,       c->direction, c->distance,
                                  c->mask, w->first, w->position, c->direction};
    if (model->grid == 0)
        return w;
    double moved[VOXELS][3];
    lf_recon_grid(model, w->voxel);
    for (int i = 0; i < VOXELS; i++)
        for (int a = 0; a < 3; a++)
            moved[i][a] = w->voxel[i][a] + away * shift[a];
    lf_project_points(VIEWS, c->camera, VOXELS, (const double(*)[3])moved, 0, w->uv, w->direction,
                      w->distance, w->mask);
    w->grid = (lf_recon_points){VOXELS,  VIEWS,    w->uv,       w->direction, w->distance,
                                w->mask, w->first, w->voxel[0], w->direction};
    return w;
}

/* ---- the answer ------------------------------------------------------------------------------ */

/* Maps and pictures as inputs; equal: all views the same, times `mean`. */
static lf_recon_code given_code(lf_stability *s, const lf_recon *model, bool equal, double mean)
{
    lf_recon_code code = {.views = VIEWS, .inner_maps = 1, .maps = 2};
    if (equal) {
        double *x = lf_alloc(s->tape, (size_t)(VIEWS * PICTURE * PICTURE * FIELDS) * sizeof *x);
        for (long i = 0; i < VIEWS * PICTURE * PICTURE * FIELDS; i++)
            x[i] = mean;
        code.map[0] = lf_stability_given(s, "map", 4, LF_DIMS(VIEWS, MAP, MAP, FIELDS), x, mean);
        code.map[1] =
            lf_stability_given(s, "picture", 4, LF_DIMS(VIEWS, PICTURE, PICTURE, 2), x, mean);
    } else {
        code.map[0] = lf_stability_input(s, "map", 4, LF_DIMS(VIEWS, MAP, MAP, FIELDS), 1);
        code.map[1] = lf_stability_input(s, "picture", 4, LF_DIMS(VIEWS, PICTURE, PICTURE, 2), 1);
    }
    if (model->config.network == &lf_disn)
        code.inner[0] = lf_stability_input(s, "field", 4, LF_DIMS(VIEWS, 9, 9, LF_C8), 1);
    return code;
}

static lf_tensor *answer(lf_stability *s, const lf_recon *model, lf_recon_code *code,
                         const world *w)
{
    const lf_recon_network *network = model->config.network;
    if (network->object)
        code->object = network->object(s->tape, model, false, code, &w->grid);
    const lf_recon_inputs in = lf_recon_look(s->tape, model, code, &w->points);
    return lf_recon_sdf(s->tape, model, &in, NULL);
}

static void run(lf_stability *s, const lf_recon *model, const world *w)
{
    lf_recon_code code = given_code(s, model, false, 1);
    /* so small that ReLUs hardly bend within it; FvOR's volume has too many of them */
    s->step = model->grid > 0 ? 0 : 1e-5;
    lf_stability_output(s, "distance", answer(s, model, &code, w), NULL);
}

/* ---- cases ----------------------------------------------------------------------------------- */

/* A point beside the first camera's centre. */
static void centre(lf_stability *s, const lf_recon_network *network)
{
    const lf_recon *model = make_model(s, network);
    run(s, model, make_world(s, model, s->parameter, 0));
}

/* A point on both sides of the pictures' borders, and at their corners. */
static void border(lf_stability *s, const lf_recon_network *network)
{
    const lf_recon *model = make_model(s, network);
    world *w = make_world(s, model, 0, 0);
    const double h = s->parameter, low = h, high = SIZE - 1 - h;
    for (int v = 0; v < VIEWS; v++) {
        w->scene.uv[2 * v] = v % 2 ? high : low;
        w->scene.uv[2 * v + 1] = v < 4 ? 20.5 : v < 6 ? low : high;
    }
    run(s, model, w);
}

/* A point that so many views see; with none all is masked. */
static void few_views(lf_stability *s, const lf_recon_network *network)
{
    const lf_recon *model = make_model(s, network);
    world *w = make_world(s, model, 0, 0);
    for (int v = 0; v < VIEWS; v++)
        w->scene.mask[v] = v < s->parameter;
    for (int i = 0; i < VOXELS * VIEWS && model->grid > 0; i++) /* and voxels of the first ones */
        w->mask[i] = w->mask[i] && i % VIEWS < s->parameter;
    run(s, model, w);
}

/* Views that show the same everywhere: what is left of a variance is rounding. */
static void equal_views(lf_stability *s, const lf_recon_network *network)
{
    const lf_recon *model = make_model(s, network);
    const world *w = make_world(s, model, 0, 0);
    lf_recon_code code = given_code(s, model, true, s->parameter);
    s->step = 0;
    lf_stability_output(s, "distance", answer(s, model, &code, w), NULL);
}

/* Pictures of one colour, backbone and all. */
static void flat(lf_stability *s, const lf_recon_network *network)
{
    const lf_recon *model = make_model(s, network);
    const world *w = make_world(s, model, 0, 0);
    double *x = lf_alloc(s->tape, (size_t)(VIEWS * SIZE * SIZE * 2) * sizeof *x);
    for (long i = 0; i < VIEWS * SIZE * SIZE * 2; i++)
        x[i] = s->parameter;
    s->pictures = true;
    s->step = 0;
    lf_tensor *picture = lf_stability_given(s, "picture", 4, LF_DIMS(VIEWS, SIZE, SIZE, 2), x, 1);
    lf_recon_code code;
    lf_recon_encode_images(s->tape, model, picture, VIEWS, model->grid > 0 ? &w->grid : NULL, false,
                           &code);
    const lf_recon_inputs in = lf_recon_look(s->tape, model, &code, &w->points);
    lf_stability_output(s, "distance", lf_recon_sdf(s->tape, model, &in, NULL), NULL);
}

/* Exact is what the same network says at the origin. */
static void far(lf_stability *s, const lf_recon_network *network)
{
    const lf_recon *model = make_model(s, network);
    lf_recon_code code = given_code(s, model, false, 1);
    long double exact[POINTS];
    lf_tensor *y = answer(s, model, &code, make_world(s, model, 0, 0));
    for (int q = 0; q < POINTS; q++)
        exact[q] = y->value[q];
    s->step = 0;
    s->geometry = 10.0 * SIZE * s->parameter; /* of pixels, SIZE an edge */
    y = answer(s, model, &code, make_world(s, model, 0, s->parameter));
    lf_stability_output(s, "distance", y, exact);
}

/* FvOR: points beside a face and a corner of the volume, inside and outside, and beside a voxel. */
static void fvor_volume(lf_stability *s)
{
    const lf_recon *model = make_model(s, &lf_fvor);
    world *w = make_world(s, model, 0, 0);
    const double h = s->parameter;
    const double at[3 * POINTS] = {0.5 - h, 0.1,      -0.5 + h, 0.5 + h,  -0.5 - h,
                                   0.5 + h, 0.25 + h, -h,       -0.25 + h};
    memcpy(w->position, at, sizeof at);
    run(s, model, w);
}

#define OF_EACH(what)                                                                              \
    static void disn_##what(lf_stability *s)                                                       \
    {                                                                                              \
        what(s, &lf_disn);                                                                         \
    }                                                                                              \
    static void fvor_##what(lf_stability *s)                                                       \
    {                                                                                              \
        what(s, &lf_fvor);                                                                         \
    }                                                                                              \
    static void ibrnet_##what(lf_stability *s)                                                     \
    {                                                                                              \
        what(s, &lf_ibrnet_sdf);                                                                   \
    }
OF_EACH(centre)
OF_EACH(border)
OF_EACH(few_views)
OF_EACH(equal_views)
OF_EACH(flat)
OF_EACH(far)

#define SYSTEM(name, of, lost)                                                                     \
    {name ": camera's centre", "distance to centre", of##_centre, DISTANCES},                      \
        {name ": image's border", "distance to border", of##_border, DISTANCES},                   \
        {name ": few views", "views", of##_few_views, LF_STABILITY_AT(0, 1, 2, 8)},                \
        {name ": equal views", "value", of##_equal_views, LF_STABILITY_AT(0, 1, 1e2, 1e4),         \
         .limit = lost},                                                                           \
        {name ": flat pictures", "colour", of##_flat, LF_STABILITY_AT(0, 0.3, 0.7, 1)},            \
    {                                                                                              \
        name ": far away", "away", of##_far, LF_STABILITY_AT(1, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7) \
    }

static const lf_stability_case cases[] = {
    SYSTEM("DISN", disn, 0),
    SYSTEM("FvOR", fvor, 0),
    {"FvOR: volume's border", "distance to border", fvor_volume, DISTANCES},
    SYSTEM("IBRNet-SDF", ibrnet, 2e3),
};

const lf_stability_table lf_stability_systems = {cases, sizeof cases / sizeof *cases};
