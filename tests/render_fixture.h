/* render_fixture.h: a small renderer with random weights, and a made-up scene for it: four sources
 * of random pictures around the origin and ten rays of a target. */
#ifndef LF_TESTS_RENDER_FIXTURE_H
#define LF_TESTS_RENDER_FIXTURE_H

#include "datasets/camera.h"
#include "models/render_work.h"
#include "tests/close.h"

#define EXACT (sizeof(lf_real) == 8) /* the double build */

enum { SOURCES = 4, MOST_SOURCES = 5, RAYS = 10, WIDTH = 24, HEIGHT = 20 };

typedef struct stage {
    lf_camera target, camera[MOST_SOURCES];
    lf_source source[MOST_SOURCES];
    long views, rays;
    uint8_t rgb[MOST_SOURCES][WIDTH * HEIGHT * 3];
    double origin[3 * RAYS], direction[3 * RAYS], stretch[RAYS];
    double near, far;
    float colour[3 * RAYS]; /* of the target */
    long seen_samples;
    bool white;
} stage;

/* K R' [I | -c] */
static inline lf_source source_of(const lf_camera *c, const uint8_t *rgb)
{
    lf_source s = {.width = c->width, .height = c->height, .rgb = rgb};
    memcpy(s.centre, c->centre, sizeof s.centre);
    for (int j = 0; j < 4; j++) {
        double q[3];
        for (int i = 0; i < 3; i++)
            q[i] = j < 3 ? c->rotation[3 * j + i]
                         : -c->rotation[i] * c->centre[0] - c->rotation[3 + i] * c->centre[1] -
                               c->rotation[6 + i] * c->centre[2];
        s.projection[j] = c->fx * q[0] + c->cx * q[2];
        s.projection[4 + j] = c->fy * q[1] + c->cy * q[2];
        s.projection[8 + j] = q[2];
    }
    return s;
}

static inline lf_camera camera_at(double x, double y, double z, double roll)
{
    lf_camera c = lf_camera_look_at((const double[3]){x, y, z}, (const double[3]){0.02, 0.03, 0.01},
                                    0.25, WIDTH);
    c = lf_camera_roll(&c, roll);
    c.height = HEIGHT;
    c.cy = 0.5 * (HEIGHT - 1);
    return c;
}

/* Ray `r` through pixel coordinates (u, v) of the target. */
static inline void aim(stage *s, int r, double u, double v)
{
    const double *m = s->target.rotation;
    double *d = s->direction + 3 * r;
    lf_camera_ray(&s->target, u, v, d);
    memcpy(s->origin + 3 * r, s->target.centre, sizeof s->target.centre);
    s->stretch[r] = 1 / (m[2] * d[0] + m[5] * d[1] + m[8] * d[2]);
}

static inline void aim_all(stage *s)
{
    for (int r = 0; r < RAYS; r++)
        aim(s, r, 3 + 1.9 * r, 2 + (double)(7 * r % 16));
}

static inline void place_source(stage *s, int v, lf_camera camera)
{
    s->camera[v] = camera;
    s->source[v] = source_of(&s->camera[v], s->rgb[v]);
}

static inline void make_stage(stage *s)
{
    lf_stream r = lf_stream_at(21, LF_RANDOM_TEST, 5, 0);
    *s = (stage){.views = SOURCES, .rays = RAYS, .near = 2.5, .far = 5.5, .white = true};
    for (int v = 0; v < MOST_SOURCES; v++)
        for (int i = 0; i < WIDTH * HEIGHT * 3; i++)
            s->rgb[v][i] = (uint8_t)lf_index(&r, 256);
    place_source(s, 0, camera_at(3.8, 0.6, 0.4, 0.1));
    place_source(s, 1, camera_at(3.2, -1.1, 1.7, 1));
    place_source(s, 2, camera_at(3, 1.5, -1.6, -2));
    place_source(s, 3, camera_at(2, 0.3, 3.3, 0.4));
    place_source(s, 4, camera_at(1, 3.3, 1.2, 3));
    s->target = camera_at(3.6, 0.2, 1.3, 0.3);
    aim_all(s);
    for (int i = 0; i < 3 * RAYS; i++)
        s->colour[i] = (float)lf_uniform(&r);
}

/* All poses moved. */
static inline void move_stage(stage *s, const lf_motion *g)
{
    s->target = lf_camera_move(&s->target, g);
    for (int v = 0; v < MOST_SOURCES; v++)
        place_source(s, v, lf_camera_move(&s->camera[v], g));
    for (int r = 0; r < RAYS; r++) {
        lf_motion_apply(g, s->origin + 3 * r, s->origin + 3 * r);
        lf_rotation_apply(g->rotation, s->direction + 3 * r, s->direction + 3 * r);
    }
}

static inline lf_render_batch batch_of(const stage *s)
{
    return (lf_render_batch){
        .rays = {s->rays, s->origin, s->direction, s->stretch, s->near, s->far},
        .colour = s->colour,
        .white = s->white,
        .seen_samples = s->seen_samples,
        .seed = 4,
        .step = 3,
        .views = s->views,
        .source = s->source};
}

/* ---- a model ---- */

typedef struct net {
    lf_store *store;
    lf_renderer model;
    lf_render_work *work;
} net;

typedef struct net_options {
    bool ibrnet;
    bool alone; /* no attention along the ray (the equivariant one) */
    bool wide;  /* the features of two networks, also where there is one */
    long fine, tile;
    lf_types types;
} net_options;

enum { SAMPLES = 8 };

/* Weights whose biases and gains are not those of a new model. */
static inline void stir(lf_store *store)
{
    for (int i = 0; i < lf_store_count(store); i++) {
        const lf_parameter *p = lf_store_at(store, i);
        lf_stream s = lf_stream_at(9, LF_RANDOM_TEST, 6, lf_name_hash(p->name));
        for (long k = 0; p->rank == 1 && k < p->size; k++)
            lf_values(p)[k] += (lf_real)(0.3 * lf_normal(&s));
    }
}

static inline void open_net(net *n, net_options o)
{
    const lf_types types = o.types.count ? o.types : (lf_types){.count = 3, .omega = {0, 2, 5}};
    const lf_renderer_config config = {.equivariant = !o.ibrnet,
                                       .features = {.kind = LF_FEATURES_SMALL,
                                                    .width = 4,
                                                    .features = o.fine > 0 || o.wide ? 6 : 3},
                                       .ray = {types, LF_RGB + 3, 2, 4, 2, true, !o.alone},
                                       .ibrnet = {LF_RGB + 3, 8, true},
                                       .channels = 3,
                                       .sources = SOURCES,
                                       .samples = SAMPLES,
                                       .fine = o.fine};
    n->store = lf_store_create(11);
    lf_renderer_init(&n->model, n->store, &config);
    stir(n->store);
    n->work = lf_render_work_create(&n->model, o.tile ? o.tile : 4);
    lf_render_work_check(n->work, true);
}

static inline void close_net(net *n)
{
    lf_render_work_free(n->work);
    lf_renderer_free(&n->model);
    lf_store_free(n->store);
}

/* Add to the last bias of the densities. */
static inline void shift_density(net *n, double bias)
{
    for (int i = 0; i < n->model.networks; i++) {
        const lf_parameter *p = n->model.config.equivariant
                                    ? n->model.equivariant[i].density.layer[2].bias
                                    : n->model.ibrnet[i].density.layer[1].bias;
        lf_values(p)[0] += (lf_real)bias;
    }
}

/* Loss and gradients of a step. */
typedef struct gradient {
    double loss;
    long counted, size;
    lf_real *value; /* owned */
} gradient;

static inline gradient step_of(const net *n, const stage *s)
{
    gradient g = {.size = lf_store_size(n->store)};
    const lf_render_batch b = batch_of(s);
    g.loss = lf_render_step(n->work, &b, &g.counted);
    g.value = malloc((size_t)g.size * sizeof *g.value);
    assert_non_null(g.value);
    memcpy(g.value, lf_store_grads(n->store), (size_t)g.size * sizeof *g.value);
    return g;
}

static inline bool same_step(const gradient *a, const gradient *b)
{
    return a->loss == b->loss && a->size == b->size && a->counted == b->counted &&
           memcmp(a->value, b->value, (size_t)a->size * sizeof *a->value) == 0;
}

/* Relative difference of loss and gradients. */
static inline double step_difference(const gradient *a, const gradient *b)
{
    return larger(fabs(a->loss - b->loss) / fabs(b->loss),
                  relative_error(a->value, b->value, a->size));
}

typedef struct image {
    lf_real colour[3 * RAYS], depth[RAYS], opacity[RAYS];
    long rows;
} image;

static inline image render_saving(const net *n, const stage *s, const lf_render_savings *savings)
{
    image x;
    lf_ray_image out = {x.colour, x.depth, x.opacity, 0};
    const lf_render_batch b = batch_of(s);
    lf_render_encode(n->work, b.views, b.source);
    lf_render_rays(n->work, &b.rays, b.white, savings, &out);
    x.rows = out.rows;
    return x;
}

static inline image render(const net *n, const stage *s)
{
    const lf_render_savings none = lf_render_savings_none();
    return render_saving(n, s, &none);
}

/* Largest difference of two renderings, depths in units of far. */
static inline double difference(const image *a, const image *b, double far)
{
    double worst = 0;
    for (int i = 0; i < 3 * RAYS; i++)
        worst = larger(worst, fabs((double)a->colour[i] - (double)b->colour[i]));
    for (int i = 0; i < RAYS; i++) {
        worst = larger(worst, fabs((double)a->depth[i] - (double)b->depth[i]) / far);
        worst = larger(worst, fabs((double)a->opacity[i] - (double)b->opacity[i]));
    }
    return worst;
}

#endif
