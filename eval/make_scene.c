/* make_scene.c: a built-in scene made and written. */
#include "eval/make_scene.h"

#include <string.h>

static const char *const layout_names[LF_LAYOUTS] = {
    "nerf-synthetic", "llff", "transforms", "deepvoxels", "colmap-text", "colmap-binary"};
enum { TEST_EVERY = 8 };

lf_make_scene_options lf_make_scene_defaults(void)
{
    return (lf_make_scene_options){.size = 100, .views = 40};
}

static lf_status parse_layout(const char *name, lf_scene_kind kind, lf_scene_layout *out,
                              lf_error *err)
{
    *out = kind == LF_KIND_FORWARD ? LF_LAYOUT_LLFF : LF_LAYOUT_NERF_SYNTHETIC;
    if (!name)
        return LF_OK;
    for (int i = 0; i < LF_LAYOUTS; i++)
        if (strcmp(name, layout_names[i]) == 0) {
            *out = (lf_scene_layout)i;
            return LF_OK;
        }
    return lf_fail(err, LF_BAD_INPUT,
                   "--layout %.100s: give nerf-synthetic, llff, transforms, deepvoxels, "
                   "colmap-text or colmap-binary",
                   name);
}

static lf_status settings_of(const lf_make_scene_options *o, lf_scene_make_options *make,
                             lf_scene_layout *layout, lf_error *err)
{
    if (!o->kind)
        return lf_fail(err, LF_BAD_INPUT, "make-scene: say which kind: glossy, diffuse or forward");
    if (!o->folder)
        return lf_fail(err, LF_BAD_INPUT, "make-scene: say where to, with --out DIR");
    if (o->views < 2)
        return lf_fail(err, LF_BAD_INPUT, "--views %ld: one train and one test view are the least",
                       o->views);
    *make = lf_scene_make_defaults();
    LF_TRY(lf_scene_kind_parse(o->kind, &make->kind, err));
    LF_TRY(parse_layout(o->layout, make->kind, layout, err));
    make->seed = o->seed;
    make->index = o->index;
    make->size = o->size;
    make->mesh = o->mesh;
    make->test_views = (o->views + TEST_EVERY - 1) / TEST_EVERY;
    make->train_views = o->views - make->test_views;
    return LF_OK;
}

static void print(FILE *out, const lf_scene *scene, lf_scene_layout layout, const char *folder)
{
    const lf_camera *c = &scene->view[0].camera;
    double near = INFINITY, far = 0;
    for (long i = 0; i < scene->views; i++) {
        near = fmin(near, scene->view[i].near);
        far = fmax(far, scene->view[i].far);
    }
    fprintf(out, "%-12s%s\n%-12s%s\n%-12s%s\n", "scene", scene->folder, "folder", folder, "layout",
            lf_scene_layout_name(layout));
    fprintf(out, "%-12s%ld train, %ld test, %d x %d pixels, focal length %.6g pixels\n", "views",
            lf_scene_count(scene, LF_SPLIT_TRAIN), lf_scene_count(scene, LF_SPLIT_TEST), c->width,
            c->height, c->fx);
    fprintf(out, "%-12s%.4g and %.4g\n", "near, far", near, far);
    const bool split = layout != LF_LAYOUT_LLFF && layout < LF_LAYOUT_COLMAP_TEXT;
    if (!split)
        fprintf(out,
                "%-12sthe layout has no split: views 0, 8, 16, ... are read as test views, "
                "which they are\n",
                "note");
    if (layout >= LF_LAYOUT_DEEPVOXELS)
        fprintf(out, "%-12sthe layout has no near and far: give them when you read it\n", "note");
}

lf_status lf_make_scene_job(const lf_make_scene_options *options, FILE *out, lf_error *err)
{
    lf_scene_make_options make;
    lf_scene_layout layout = LF_LAYOUT_NONE;
    lf_scene *scene;
    LF_TRY(settings_of(options, &make, &layout, err));
    LF_TRY(lf_scene_make(&make, &scene, err));
    const lf_status status = lf_scene_write(scene, layout, options->folder, err);
    if (status == LF_OK && out)
        print(out, scene, layout, options->folder);
    lf_scene_close(scene);
    return status;
}
