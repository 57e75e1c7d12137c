/* views.c: eight rendered views of one draw of a setting. A turned object is rendered by turning
 * cameras and light the other way: the mesh and its index stay as they are. */
#include "datasets/views.h"

long lf_views_floats(const lf_views_options *options)
{
    return LF_CUBE_VIEWS * (long)options->size * options->size *
           lf_render_channels(options->render.mode);
}

static lf_status check_options(const lf_views_options *options, lf_error *err)
{
    if (options->size < 2 || options->size > 8192)
        return lf_fail(err, LF_BAD_INPUT, "image size %d, allowed are 2 ... 8192", options->size);
    if (options->render.rays < 1 || options->render.rays > 16)
        return lf_fail(err, LF_BAD_INPUT, "%d rays an edge of a pixel, allowed are 1 ... 16",
                       options->render.rays);
    return LF_OK;
}

lf_status lf_views_render(const lf_surface *surface, const lf_views_options *options,
                          const lf_camera camera[LF_CUBE_VIEWS], const double object[9],
                          float *images, lf_error *err)
{
    LF_TRY(check_options(options, err));
    lf_motion back = {.translation = {0, 0, 0}};
    lf_rotation_transpose(object, back.rotation);
    lf_render_options render = options->render;
    render.light = lf_light_rotate(&options->render.light, back.rotation);
    const long floats = lf_views_floats(options) / LF_CUBE_VIEWS;
    for (int v = 0; v < LF_CUBE_VIEWS; v++) {
        LF_REQUIRE(camera[v].width == options->size && camera[v].height == options->size,
                   "lf_views_render: camera %d has %d x %d pixels, the views %d", v,
                   camera[v].width, camera[v].height, options->size);
        const lf_camera turned = lf_camera_move(&camera[v], &back);
        lf_render(surface, &turned, &render, images + v * floats);
    }
    return LF_OK;
}

lf_status lf_views_make(const lf_surface *surface, const lf_views_options *options, uint64_t seed,
                        uint64_t draw, uint64_t item, lf_camera camera[LF_CUBE_VIEWS],
                        double object[9], float *images, lf_error *err)
{
    LF_TRY(check_options(options, err));
    lf_setting_draw(options->setting, options->size, seed, draw, item, camera, object);
    return lf_views_render(surface, options, camera, object, images, err);
}
