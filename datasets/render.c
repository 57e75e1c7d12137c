/* render.c: diffuse pictures and depth by casting rays at sub-pixel centres.  [render.h has shade]
 */
#include "datasets/render.h"

#include <math.h>
#include <string.h>

lf_render_options lf_render_defaults(void)
{
    lf_render_options options = {.mode = LF_RENDER_SHADE, .rays = 3};
    const double l[3] = {0.35, 0.8, -0.5};
    const double n = sqrt(l[0] * l[0] + l[1] * l[1] + l[2] * l[2]);
    for (int i = 0; i < 3; i++)
        options.light.direction[i] = l[i] / n;
    return options;
}

int lf_render_channels(lf_render_mode mode)
{
    return mode == LF_RENDER_SHADE ? 2 : 4;
}

lf_light lf_light_rotate(const lf_light *light, const double rotation[9])
{
    lf_light out = *light;
    lf_rotation_apply(rotation, light->direction, out.direction);
    return out;
}

/* `direction` points from the viewer to the surface. */
static double shade_of(const double normal[3], const double direction[3], const lf_light *light)
{
    double nv = 0, nl = 0;
    for (int i = 0; i < 3; i++) {
        nv -= normal[i] * direction[i];
        nl += normal[i] * (light->head ? -direction[i] : light->direction[i]);
    }
    if (nv < 0) { /* turn the normal to the viewer */
        nv = -nv;
        nl = -nl;
    }
    return 0.2 + 0.3 * nv + 0.25 * (1 + nl);
}

/* The shade of lf_render. */
typedef struct diffuse {
    const lf_mesh *mesh;
    const lf_render_options *options;
} diffuse;

static void add_diffuse(const void *context, const lf_hit *hit, const double point[3],
                        const double direction[3], double *sum)
{
    const diffuse *d = context;
    const double shade = shade_of(hit->normal, direction, &d->options->light);
    (void)point;
    if (d->options->mode == LF_RENDER_SHADE) {
        sum[0] += shade;
        sum[1] += 1;
        return;
    }
    for (int i = 0; i < 3; i++)
        sum[i] += shade * (double)d->mesh->colour[hit->face][i];
    sum[3] += 1;
}

/* What the samples of a picture share. */
typedef struct picture {
    const lf_surface *surface;
    const lf_camera *camera;
    int rays, channels;
    lf_shader *shader;
    const void *context;
} picture;

/* Adds one sample to the pixel's channels. */
static void add_sample(const picture *p, double u, double v, double *sum)
{
    double direction[3], point[3];
    lf_hit hit;
    lf_camera_ray(p->camera, u, v, direction);
    if (!lf_surface_first_hit(p->surface, p->camera->centre, direction, 0, INFINITY, &hit))
        return;
    for (int i = 0; i < 3; i++)
        point[i] = p->camera->centre[i] + hit.distance * direction[i];
    p->shader(p->context, &hit, point, direction, sum);
}

static void render_pixel(const picture *p, int row, int column, float *pixel)
{
    const int s = p->rays;
    double sum[LF_RENDER_CHANNELS_MAX] = {0};
    for (int j = 0; j < s; j++)
        for (int i = 0; i < s; i++)
            add_sample(p, column + (i + 0.5) / s - 0.5, row + (j + 0.5) / s - 0.5, sum);
    for (int c = 0; c < p->channels; c++)
        pixel[c] = (float)(sum[c] / (s * s));
}

void lf_render_shaded(const lf_surface *surface, const lf_camera *camera, int rays, int channels,
                      lf_shader *shader, const void *context, float *image)
{
    LF_REQUIRE(rays >= 1 && rays <= 16, "lf_render: %d rays an edge, 1 ... 16", rays);
    LF_REQUIRE(channels >= 1 && channels <= LF_RENDER_CHANNELS_MAX, "lf_render: %d channels",
               channels);
    const picture p = {surface, camera, rays, channels, shader, context};
    const long width = camera->width;
#pragma omp parallel for schedule(dynamic, 4)
    for (int row = 0; row < camera->height; row++)
        for (int column = 0; column < camera->width; column++)
            render_pixel(&p, row, column, image + (row * width + column) * channels);
}

void lf_render(const lf_surface *surface, const lf_camera *camera, const lf_render_options *options,
               float *image)
{
    const diffuse d = {lf_surface_mesh(surface), options};
    lf_render_shaded(surface, camera, options->rays, lf_render_channels(options->mode), add_diffuse,
                     &d, image);
}

void lf_render_depth(const lf_surface *surface, const lf_camera *camera, float *depth)
{
    const double *r = camera->rotation;
#pragma omp parallel for schedule(dynamic, 4)
    for (int row = 0; row < camera->height; row++)
        for (int column = 0; column < camera->width; column++) {
            double d[3];
            lf_hit hit;
            lf_camera_ray(camera, column, row, d);
            const bool met = lf_surface_first_hit(surface, camera->centre, d, 0, INFINITY, &hit);
            const double along = d[0] * r[2] + d[1] * r[5] + d[2] * r[8];
            depth[(long)row * camera->width + column] =
                met ? (float)(hit.distance * along) : INFINITY;
        }
}

lf_status lf_render_mesh_picture(const lf_mesh *mesh, const lf_camera *camera,
                                 const float background[3], float *rgb, lf_error *err)
{
    lf_surface *surface;
    LF_TRY(lf_surface_open(mesh, &surface, err));
    const long pixels = (long)camera->width * camera->height;
    float *image = malloc((size_t)pixels * 4 * sizeof *image);
    if (!image) {
        lf_surface_close(surface);
        return lf_fail(err, LF_FAILED, "no memory for a picture of %d x %d pixels", camera->width,
                       camera->height);
    }
    lf_render_options options = lf_render_defaults();
    options.mode = LF_RENDER_COLOUR;
    lf_render(surface, camera, &options, image);
    for (long p = 0; p < pixels; p++)
        for (int c = 0; c < 3; c++)
            rgb[3 * p + c] = image[4 * p + c] + (1 - image[4 * p + 3]) * background[c];
    free(image);
    lf_surface_close(surface);
    return LF_OK;
}
