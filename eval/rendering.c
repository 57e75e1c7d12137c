/* rendering.c: a renderer from its checkpoint, its scenes, and one view. See render_job.h. */
#include "eval/image_resize.h"
#include "eval/render_job.h"
#include "models/checkpoint.h"
#include "train/progress.h"

/* ---- the model --------------------------------------------------------------------------------
 */

lf_status lf_loaded_renderer_open(const char *checkpoint, lf_config *cfg, lf_loaded_renderer *l,
                                  lf_error *err)
{
    lf_training_state state;
    lf_config *again;
    *l = (lf_loaded_renderer){.cfg = cfg};
    lf_status status = lf_checkpoint_config(checkpoint, &again, &state, err);
    if (status != LF_OK)
        return status;
    lf_config_free(again);
    l->step = state.step;
    const lf_renderer_config config = lf_renderer_config_from(cfg);
    l->store = lf_store_create(0);
    lf_renderer_init(&l->model, l->store, &config);
    l->work = lf_render_work_create(&l->model, lf_config_int(cfg, "train.tile_rays"));
    return lf_checkpoint_read(checkpoint, l->store, NULL, err);
}

void lf_loaded_renderer_close(lf_loaded_renderer *l)
{
    lf_render_work_free(l->work);
    if (l->store)
        lf_renderer_free(&l->model);
    lf_store_free(l->store);
    lf_config_free(l->cfg);
    *l = (lf_loaded_renderer){0};
}

long lf_render_sources(const lf_loaded_renderer *l)
{
    const long sources = lf_config_int(l->cfg, "eval.sources");
    return sources ? sources : l->model.config.sources;
}

/* ---- one view ---------------------------------------------------------------------------------
 */

lf_render_savings lf_render_savings_from(const lf_loaded_renderer *l)
{
    lf_render_savings s = lf_render_savings_none();
    /* IBRNet's ray transformer looks at unseen samples, too */
    s.unseen = l->model.config.equivariant && lf_config_bool(l->cfg, "eval.skip_unseen");
    s.stop = lf_config_real(l->cfg, "eval.stop");
    s.empty = lf_config_real(l->cfg, "eval.empty");
    return s;
}

/* The view at 1 / eval.shrink of its size; borders of both pictures coincide. */
static lf_render_view shrunk(const lf_render_view *v, long shrink)
{
    lf_render_view small = *v;
    lf_camera *c = &small.camera;
    c->width = (int)((v->camera.width + shrink / 2) / shrink);
    c->height = (int)((v->camera.height + shrink / 2) / shrink);
    c->width = c->width < 1 ? 1 : c->width;
    c->height = c->height < 1 ? 1 : c->height;
    const double x = (double)c->width / v->camera.width, y = (double)c->height / v->camera.height;
    c->fx *= x;
    c->fy *= y;
    c->cx = (c->cx + 0.5) * x - 0.5;
    c->cy = (c->cy + 0.5) * y - 0.5;
    return small;
}

/* What the network gives for every pixel of a view. */
typedef struct pixels {
    lf_real *colour, *depth, *opacity; /* parts of one array, which begins with the colours */
    long rows;
} pixels;

static pixels render_pixels(lf_loaded_renderer *l, const lf_render_view *v)
{
    const long n = (long)v->camera.width * v->camera.height;
    long *pixel = malloc((size_t)n * sizeof *pixel);
    lf_real *number = malloc((size_t)n * 5 * sizeof *number);
    LF_REQUIRE(pixel && number, "out of memory for %ld pixels", n);
    for (long i = 0; i < n; i++)
        pixel[i] = i;
    lf_render_savings savings = lf_render_savings_from(l);
    if (lf_config_bool(l->cfg, "eval.skip_outside"))
        savings.bounds = v->bounds;
    lf_pixel_rays rays = lf_pixel_rays_create(v, n, pixel);
    lf_ray_image image = {number, number + 3 * n, number + 4 * n, 0};
    lf_render_encode(l->work, v->sources, v->source);
    lf_render_rays(l->work, &rays.rays, v->entry->white, &savings, &image);
    lf_pixel_rays_free(&rays);
    free(pixel);
    return (pixels){image.colour, image.depth, image.opacity, image.rows};
}

/* Colours and depths at the size of the whole view. */
static void enlarge(const pixels *p, const lf_camera *from, const lf_camera *to, lf_rendering *r)
{
    lf_image *small = lf_image_create(from->width, from->height, 3);
    for (long i = 0; i < 3L * from->width * from->height; i++)
        small->pixel[i] = (float)p->colour[i];
    r->image = lf_image_resize(small, to->width, to->height);
    lf_image_free(small);
    for (long i = 0; i < (long)to->width * to->height; i++) {
        const long column = i % to->width * from->width / to->width;
        const long at = i / to->width * from->height / to->height * from->width + column;
        /* below: nothing there */
        r->depth[i] = p->opacity[at] < (lf_real)0.05 ? INFINITY : (float)p->depth[at];
    }
}

lf_rendering lf_render_whole(lf_loaded_renderer *l, const lf_render_view *v)
{
    const long shrink = lf_config_int(l->cfg, "eval.shrink");
    const long n = (long)v->camera.width * v->camera.height;
    lf_rendering r = {.depth = malloc((size_t)n * sizeof(float))};
    LF_REQUIRE(r.depth, "out of memory for %ld pixels", n);
    const double start = lf_seconds_now();
    const lf_render_view seen = shrink > 1 ? shrunk(v, shrink) : *v;
    const pixels p = render_pixels(l, &seen);
    enlarge(&p, &seen.camera, &v->camera, &r);
    r.seconds = lf_seconds_now() - start;
    r.rows = p.rows;
    r.colour = p.colour;
    if (shrink > 1) {
        r.colour = realloc(p.colour, (size_t)n * 3 * sizeof *r.colour);
        LF_REQUIRE(r.colour, "out of memory for %ld pixels", n);
        for (long i = 0; i < 3 * n; i++)
            r.colour[i] = (lf_real)r.image->pixel[i];
    }
    return r;
}

void lf_rendering_free(lf_rendering *r)
{
    lf_image_free(r->image);
    free(r->colour);
    free(r->depth);
    *r = (lf_rendering){0};
}

/* ---- scenes and pictures ---------------------------------------------------------------------
 */

lf_image *lf_picture_of(const lf_pixels *p)
{
    lf_image *image = lf_image_create(p->width, p->height, 3);
    for (long i = 0; i < 3L * p->width * p->height; i++)
        image->pixel[i] = (float)p->rgb[i] / 255;
    return image;
}

lf_status lf_render_job_scenes(const lf_config *cfg, const char *split, bool quiet,
                               lf_scene_set **set, lf_error *err)
{
    LF_TRY(lf_render_scenes(cfg, split, NULL, NULL, set, err));
    if (!*set) {
        split = "train";
        LF_TRY(lf_render_scenes(cfg, split, NULL, NULL, set, err));
    }
    if (!quiet)
        lf_render_describe(stdout, split, *set);
    return LF_OK;
}

lf_render_item *lf_render_items(const lf_config *cfg, const char *split, long scenes,
                                const lf_scene_set *set, long *count)
{
    const long most = lf_config_int(cfg, "eval.views");
    const long used = scenes > 0 && scenes < set->count ? scenes : set->count;
    lf_render_item *item = NULL;
    *count = 0;
    for (long i = 0; i < used; i++) {
        long there;
        const long *target = lf_render_targets(&set->entry[i], split, &there);
        const long n = most > 0 && most < there ? most : there;
        item = realloc(item, (size_t)(*count + n + 1) * sizeof *item);
        LF_REQUIRE(item, "out of memory for %ld views", *count + n);
        for (long k = 0; k < n; k++)
            item[(*count)++] = (lf_render_item){&set->entry[i], target[k * there / n]};
    }
    return item;
}
