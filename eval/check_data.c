/* check_data.c: a scene described in words. */
#include "eval/check_data.h"

enum { FIT_PAIRS = 12 };

typedef struct range {
    double low, high;
} range;

static void widen(range *r, double x)
{
    r->low = fmin(r->low, x);
    r->high = fmax(r->high, x);
}

static void print_range(FILE *out, const char *name, range r, const char *unit)
{
    if (r.high - r.low <= 1e-9 * fabs(r.high))
        fprintf(out, "%-12s%.6g%s\n", name, r.high, unit);
    else
        fprintf(out, "%-12s%.6g to %.6g%s\n", name, r.low, r.high, unit);
}

static void print_cameras(FILE *out, const lf_scene *scene)
{
    const range none = {INFINITY, -INFINITY};
    range width = none, height = none, fx = none, fy = none, x = none, y = none, near = none,
          far = none;
    long alpha = 0;
    for (long i = 0; i < scene->views; i++) {
        const lf_scene_view *v = &scene->view[i];
        widen(&width, v->camera.width);
        widen(&height, v->camera.height);
        widen(&fx, v->camera.fx);
        widen(&fy, v->camera.fy);
        widen(&x, v->camera.cx - 0.5 * (v->camera.width - 1));
        widen(&y, v->camera.cy - 0.5 * (v->camera.height - 1));
        widen(&near, v->near);
        widen(&far, v->far);
        alpha += v->alpha;
    }
    print_range(out, "width", width, " pixels");
    print_range(out, "height", height, " pixels");
    print_range(out, "focal x", fx, " pixels");
    print_range(out, "focal y", fy, " pixels");
    print_range(out, "centre x", x, " pixels right of the middle");
    print_range(out, "centre y", y, " pixels below the middle");
    fprintf(out, "%-12s%ld of %ld views\n", "alpha", alpha, scene->views);
    print_range(out, "near", near, "");
    print_range(out, "far", far, "");
    fprintf(out, "%-12s%s\n", "depths", lf_scene_depths_name(scene->depths));
}

static void print_fit(FILE *out, const lf_scene *scene, const lf_line_fit *fit)
{
    if (scene->points)
        fprintf(out, "%-12s%ld of the model; %ld seen, median distance %.3g pixels\n", "points",
                scene->points, scene->observations, scene->reprojection);
    if (fit->matches)
        fprintf(
            out,
            "%-12s%ld of %ld corners of %ld views are found again in the next view, median %.2f "
            "pixels from the line, %.0f %% within 1 (chance: 4 pixels, 12 %%)\n",
            "epipolar", fit->matches, fit->corners, fit->pairs, fit->median, 100 * fit->within_one);
    else
        fprintf(out, "%-12sno corner of %ld is found again\n", "epipolar", fit->corners);
    if (fit->corners >= 20 && (fit->matches * 10 < fit->corners || !(fit->median <= 1)))
        fprintf(out,
                "%-12spoor: poses, axes or focal lengths may be wrong (or the views lie too far "
                "apart, or have little texture); look at the picture (--out F.png)\n",
                "verdict");
}

static void print_left_out(FILE *out, const lf_scene *scene)
{
    enum { MOST = 20 };
    fprintf(out, "%-12s%ld\n", "left out", scene->left);
    for (long i = 0; i < scene->left && i < MOST; i++)
        fprintf(out, "  %s: %s\n", scene->left_out[i].name, scene->left_out[i].reason);
    if (scene->left > MOST)
        fprintf(out, "  and %ld more\n", scene->left - MOST);
}

static lf_status describe(const lf_scene *scene, FILE *out, lf_error *err)
{
    lf_line_fit fit;
    fprintf(out, "%-12s%s\n%-12s%s\n", "folder", scene->folder, "layout",
            lf_scene_layout_name(scene->layout));
    fprintf(out, "%-12s%ld train, %ld val, %ld test\n", "views",
            lf_scene_count(scene, LF_SPLIT_TRAIN), lf_scene_count(scene, LF_SPLIT_VAL),
            lf_scene_count(scene, LF_SPLIT_TEST));
    print_cameras(out, scene);
    print_left_out(out, scene);
    LF_TRY(lf_scene_fit_lines(scene, FIT_PAIRS, &fit, err));
    print_fit(out, scene, &fit);
    return LF_OK;
}

lf_status lf_check_data(const char *path, const char *picture, FILE *out, lf_error *err)
{
    const lf_scene_options options = lf_scene_defaults();
    lf_scene *scene;
    LF_TRY(lf_scene_open(path, &options, &scene, err));
    lf_status status = out ? describe(scene, out, err) : LF_OK;
    if (status == LF_OK && picture)
        status = lf_scene_draw(scene, picture, err);
    if (status == LF_OK && picture && out)
        fprintf(out, "%-12s%s\n", "picture", picture);
    lf_scene_close(scene);
    return status;
}
