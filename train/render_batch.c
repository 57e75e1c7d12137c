/* render_batch.c: which scene, target view, sources and pixels a training step sees.
 *
 * A step takes one target view: a scene from files with the probability data.real_share (where both
 * kinds are there), else a built-in one; one of its training views; sources as IBRNet draws them;
 * train.rays of 4 train.rays random pixels; where the ground is white, pure white ones last with
 * the probability train.white_share, so that the empty ground of an object does not fill the step.
 */
#include "train/render_data.h"

struct lf_render_batches {
    const lf_config *cfg;
    const lf_scene_set *scenes;
    long real, rays;
    long *order; /* scenes, those from files first */
    lf_render_view view;
    bool open;
    lf_pixel_rays pixel_rays;
    long *pixel;
    float *colour;
};

enum { DRAWN = 4 }; /* pixels drawn for one that is used */

static void *room(size_t count, size_t size)
{
    void *p = calloc(count ? count : 1, size);
    LF_REQUIRE(p, "out of memory for %zu times %zu bytes", count, size);
    return p;
}

lf_status lf_render_batches_create(const lf_config *cfg, const lf_scene_set *scenes,
                                   lf_render_batches **out, lf_error *err)
{
    const long sources = lf_config_int(cfg, "render.sources");
    for (long i = 0; i < scenes->count; i++)
        if (scenes->entry[i].count[LF_SPLIT_TRAIN] < sources + 1)
            return lf_fail(err, LF_BAD_INPUT,
                           "%s has %ld training views: render.sources = %ld needs one more than "
                           "itself; lower it, or hold out fewer (data.hold_out)",
                           scenes->entry[i].name, scenes->entry[i].count[LF_SPLIT_TRAIN], sources);
    lf_render_batches *b = room(1, sizeof *b);
    b->cfg = cfg;
    b->scenes = scenes;
    b->rays = lf_config_int(cfg, "train.rays");
    b->order = room((size_t)scenes->count, sizeof *b->order);
    b->pixel = room((size_t)(DRAWN * b->rays), 2 * sizeof *b->pixel);
    b->colour = room((size_t)b->rays, 3 * sizeof *b->colour);
    long n = 0;
    for (int builtin = 0; builtin < 2; builtin++) {
        for (long i = 0; i < scenes->count; i++)
            if (scenes->entry[i].builtin == (builtin == 1))
                b->order[n++] = i;
        if (!builtin)
            b->real = n;
    }
    *out = b;
    return LF_OK;
}

static void close_step(lf_render_batches *b)
{
    if (b->open)
        lf_render_view_release(&b->view);
    lf_pixel_rays_free(&b->pixel_rays);
    b->open = false;
}

void lf_render_batches_free(lf_render_batches *b)
{
    if (!b)
        return;
    close_step(b);
    free(b->order);
    free(b->pixel);
    free(b->colour);
    free(b);
}

static const lf_scene_entry *draw_scene(const lf_render_batches *b, lf_stream *s)
{
    const long made = b->scenes->count - b->real;
    const bool real = lf_uniform(s) < (made == 0 ? 1
                                       : b->real ? lf_config_real(b->cfg, "data.real_share")
                                                 : 0);
    const long i = real ? lf_index(s, b->real) : b->real + lf_index(s, made);
    return &b->scenes->entry[b->order[i]];
}

/* The first b->rays of b->pixel; on a white ground, white ones last. */
static void draw_pixels(lf_render_batches *b, bool ground, lf_stream *s)
{
    const lf_pixels *p = &b->view.pixels;
    const long drawn = DRAWN * b->rays, all = (long)p->width * p->height;
    const double share = ground ? lf_config_real(b->cfg, "train.white_share") : 0;
    long *late = b->pixel + drawn, first = 0, last = 0;
    for (long i = 0; i < drawn; i++) {
        const long at = lf_index(s, all);
        const uint8_t *rgb = p->rgb + 3 * at;
        const bool put_back = lf_uniform(s) < share;
        if (put_back && rgb[0] == 255 && rgb[1] == 255 && rgb[2] == 255)
            late[last++] = at;
        else
            b->pixel[first++] = at;
    }
    for (long i = 0; first < b->rays; i++)
        b->pixel[first++] = late[i];
    for (long i = 0; i < 3 * b->rays; i++)
        b->colour[i] = (float)p->rgb[3 * b->pixel[i / 3] + i % 3] / 255;
}

lf_status lf_render_batches_at(lf_render_batches *b, long step, lf_render_batch *out, lf_error *err)
{
    const uint64_t seed = (uint64_t)lf_config_int(b->cfg, "train.seed");
    lf_stream rays = lf_stream_at(seed, LF_RANDOM_RAYS, (uint64_t)step, 0);
    lf_stream sources = lf_stream_at(seed, LF_RANDOM_SOURCES, (uint64_t)step, 0);
    const lf_scene_entry *e = draw_scene(b, &rays);
    const long target = e->view[LF_SPLIT_TRAIN][lf_index(&rays, e->count[LF_SPLIT_TRAIN])];
    int pools;
    const long *pool = lf_config_ints(b->cfg, "train.pool", &pools);
    const lf_render_view_options o = {
        .sources = lf_config_int(b->cfg, "render.sources"),
        .draw = &sources,
        .pool = {0.01 * (double)pool[0], 0.01 * (double)pool[1], 0.01 * (double)pool[2]}};
    close_step(b);
    LF_TRY(lf_render_view_open(e, target, &o, &b->view, err));
    b->open = true;
    draw_pixels(b, e->white, &rays);
    b->pixel_rays = lf_pixel_rays_create(&b->view, b->rays, b->pixel);
    *out = (lf_render_batch){.rays = b->pixel_rays.rays,
                             .colour = b->colour,
                             .white = e->white,
                             .seen_samples = lf_config_int(b->cfg, "train.seen_samples"),
                             .seed = seed,
                             .step = step,
                             .views = b->view.sources,
                             .source = b->view.source};
    return LF_OK;
}
