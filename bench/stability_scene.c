/* stability_scene.c: see stability_scene.h. */
#include "bench/stability_scene.h"
#include "models/recon_equivariant.h"

enum { SIZE = 65 };

void lf_stability_scene_make(lf_stability_scene *scene, double near, double away)
{
    static const double place[LF_STABILITY_POINTS][3] = {
        {0.05, -0.1, 0.2}, {-0.2, 0.15, 0.1}, {0.1, 0.2, -0.15}};
    static const double shift[3] = {1, -0.75, 0.5};
    lf_camera_cube(SIZE, scene->camera);
    memcpy(scene->point, place, sizeof place);
    const double *c = scene->camera[0].centre;
    for (int i = 0; near > 0 && i < 3; i++) /* aside, within the half angle of 12 degrees */
        scene->point[0][i] = c[i] + near * (scene->camera[0].rotation[3 * i + 2] +
                                            0.1 * scene->camera[0].rotation[3 * i]);
    for (int i = 0; i < 3; i++) {
        for (int v = 0; v < LF_CUBE_VIEWS; v++)
            scene->camera[v].centre[i] += away * shift[i];
        for (int q = 0; q < LF_STABILITY_POINTS; q++)
            scene->point[q][i] += away * shift[i];
    }
    lf_project_points(LF_CUBE_VIEWS, scene->camera, LF_STABILITY_POINTS,
                      (const double(*)[3])scene->point, 0, scene->uv, scene->direction,
                      scene->distance, scene->mask);
}

void lf_stability_scene_exact(const lf_stability_scene *scene,
                              long double direction[3 * LF_STABILITY_SEEN],
                              long double uv[2 * LF_STABILITY_SEEN])
{
    for (int i = 0; i < LF_STABILITY_SEEN; i++) {
        const lf_camera *c = &scene->camera[i % LF_CUBE_VIEWS];
        const double *p = scene->point[i / LF_CUBE_VIEWS];
        long double w[3], q[3] = {0, 0, 0};
        for (int a = 0; a < 3; a++) {
            w[a] = (long double)p[a] - c->centre[a];
            for (int k = 0; k < 3; k++)
                q[k] += c->rotation[3 * a + k] * w[a];
        }
        const long double far = sqrtl(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
        for (int a = 0; a < 3; a++)
            direction[3 * i + a] = far >= 1e-9L ? w[a] / far : 0;
        uv[2 * i] = scene->mask[i] ? c->fx * q[0] / q[2] + c->cx : scene->uv[2 * i];
        uv[2 * i + 1] = scene->mask[i] ? c->fy * q[1] / q[2] + c->cy : scene->uv[2 * i + 1];
    }
}

static void free_model(void *model)
{
    lf_recon_free(model);
}

/* A small one with random weights. */
static lf_recon *make_model(lf_stability *s)
{
    const lf_recon_config config = {.network = &lf_recon_equivariant,
                                    .backbone = {.in_channels = 2,
                                                 .c8 = true,
                                                 .stem_fields = 1,
                                                 .stem_size = 3,
                                                 .stages = 1,
                                                 .blocks = {1},
                                                 .fields = {1},
                                                 .first_stride = 1,
                                                 .features = 4},
                                    .image_size = SIZE,
                                    .sample_image = true,
                                    .block = {.scalars = 8, .vectors = 4, .heads = 2},
                                    .blocks = 2,
                                    .mlp_widths = 1,
                                    .mlp = {16}};
    lf_recon *model = lf_alloc(s->tape, sizeof *model);
    lf_recon_init(model, s->store, &config);
    lf_stability_keep(s, free_model, model);
    lf_stability_parameters(s);
    return model;
}

void lf_stability_scene_head(lf_stability *s, const lf_stability_scene *scene)
{
    const lf_recon *model = make_model(s);
    double mask[LF_STABILITY_SEEN];
    for (int i = 0; i < LF_STABILITY_SEEN; i++)
        mask[i] = scene->mask[i];
    const long *rays = LF_DIMS(LF_STABILITY_POINTS, LF_CUBE_VIEWS, 3);
    lf_recon_inputs in = {.rays = {LF_STABILITY_POINTS, LF_CUBE_VIEWS,
                                   lf_stability_constant(s, 3, rays, scene->direction),
                                   lf_stability_constant(s, 2, rays, mask)}};
    in.seen = lf_stability_input(
        s, "seen", 3, LF_DIMS(LF_STABILITY_POINTS, LF_CUBE_VIEWS, model->feature_count), 1);
    lf_stability_output(s, "distance", lf_recon_sdf(s->tape, model, &in, NULL), NULL);
}
