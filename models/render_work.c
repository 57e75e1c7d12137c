/* render_work.c: the workspace of the renderers, one network on a tile, and the training step. See
 * render_work.h. */
#include <omp.h>

#include "models/render_tiles.h"

static void *room(size_t bytes)
{
    void *p = calloc(1, bytes ? bytes : 1);
    LF_REQUIRE(p, "out of memory for %zu bytes", bytes);
    return p;
}

int lf_render_workers(void)
{
    const int n = omp_get_max_threads();
    return n < LF_RENDER_LANES ? n : LF_RENDER_LANES;
}

lf_render_work *lf_render_work_create(const lf_renderer *model, long tile)
{
    LF_REQUIRE(tile >= 1, "a workspace with tiles of %ld rays", tile);
    lf_render_work *w = room(sizeof *w);
    w->model = model;
    w->tile = tile;
    w->head_size = lf_store_size(model->store) - model->head_first;
    w->features = lf_tape_create();
    for (int l = 0; l < LF_RENDER_LANES; l++) {
        w->worker[l] = lf_tape_create();
        w->lane[l].grad = room((size_t)w->head_size * sizeof(lf_real));
    }
    return w;
}

void lf_render_work_free(lf_render_work *w)
{
    if (!w)
        return;
    lf_tape_free(w->features);
    for (int l = 0; l < LF_RENDER_LANES; l++) {
        lf_tape_free(w->worker[l]);
        free(w->lane[l].grad);
        free(w->lane[l].maps);
    }
    free(w->view);
    free(w->map);
    free(w->maps);
    free(w);
}

void lf_render_work_check(lf_render_work *w, bool on)
{
    lf_tape_set_check(w->features, on);
    for (int l = 0; l < LF_RENDER_LANES; l++)
        lf_tape_set_check(w->worker[l], on);
}

void lf_render_work_watch(lf_render_work *w, lf_profile *profile)
{
    lf_profile_watch(profile, w->features, 0);
    for (int l = 0; l < LF_RENDER_LANES; l++)
        lf_profile_watch(profile, w->worker[l], lf_render_workers());
}

static bool is_forward(const char *found)
{
    return found && strncmp(found, "forward", 7) == 0;
}

/* In the order of the work: forward of the features, of a tile, backward of a tile, of the rest. */
const char *lf_render_nonfinite(const lf_render_work *w)
{
    const char *features = lf_tape_nonfinite(w->features), *tile = NULL;
    if (is_forward(features))
        return features;
    for (int l = 0; l < LF_RENDER_LANES; l++) {
        const char *found = w->lane[l].nonfinite;
        if (found[0] && (!tile || (is_forward(found) && !is_forward(tile))))
            tile = found;
    }
    return tile ? tile : features;
}

size_t lf_render_work_bytes(const lf_render_work *w)
{
    size_t bytes = lf_tape_peak(w->features) + (size_t)w->maps_room * sizeof(lf_real);
    for (int l = 0; l < LF_RENDER_LANES; l++)
        bytes += lf_tape_peak(w->worker[l]) +
                 (size_t)(w->head_size + w->lane[l].maps_room) * sizeof(lf_real);
    return bytes;
}

/* ---- features ---------------------------------------------------------------------------------
 */

static lf_tensor *pictures(lf_tape *tape, long count, const lf_source *source)
{
    const long n = source->height * source->width * LF_RGB;
    lf_tensor *x =
        lf_tensor_new(tape, 4, LF_DIMS(count, source->height, source->width, (long)LF_RGB));
#pragma omp parallel for schedule(static)
    for (long v = 0; v < count; v++)
        for (long i = 0; i < n; i++)
            x->value[v * n + i] = (lf_real)source[v].rgb[i] * (lf_real)(1.0 / 255);
    return x;
}

static bool one_size(long views, const lf_source *source)
{
    for (long v = 1; v < views; v++)
        if (source[v].width != source->width || source[v].height != source->height)
            return false;
    return true;
}

static void place_maps(lf_render_work *w, const lf_tensor *map, long first, long count)
{
    const long size = map->size / count;
    for (long v = first; v < first + count; v++) {
        const lf_source *s = w->source + v;
        w->view[v] = (lf_view_map){s->rgb,      s->height,
                                   s->width,    (double)lf_feature_net_stride(&w->model->features),
                                   map->dim[1], map->dim[2],
                                   map->dim[3], w->maps_size};
        w->maps_size += size;
    }
}

/* Maps of all views on the features' tape: together, or one by one where sizes differ. */
void lf_render_maps(lf_render_work *w, long views, const lf_source *source)
{
    const bool together = one_size(views, source);
    if (views > w->views_room) {
        free(w->view);
        free(w->map);
        w->view = room((size_t)views * sizeof *w->view);
        w->map = room((size_t)views * sizeof(lf_tensor *));
        w->views_room = views;
    }
    w->views = views;
    w->source = source;
    w->batches = together ? 1 : views;
    w->maps_size = 0;
    const long each = together ? views : 1;
    for (long b = 0; b < w->batches; b++) {
        lf_scope(w->features, "pictures");
        lf_tensor *x = pictures(w->features, each, source + b);
        lf_scope_end(w->features);
        w->map[b] = lf_feature_net_forward(w->features, &w->model->features, x);
        place_maps(w, w->map[b], b * each, each);
    }
    if (w->maps_size > w->maps_room) {
        free(w->maps);
        w->maps = room((size_t)w->maps_size * sizeof *w->maps);
        w->maps_room = w->maps_size;
    }
    lf_scope(w->features, "maps");
    for (long b = 0, at = 0; b < w->batches; at += w->map[b++]->size)
        memcpy(w->maps + at, w->map[b]->value, (size_t)w->map[b]->size * sizeof *w->maps);
    lf_scope_end(w->features);
}

/* ---- one network on one tile ------------------------------------------------------------------
 */

static const lf_light_geometry *geometry_of(lf_tape *tape, const lf_render_work *w,
                                            const lf_ray_tile *t, const lf_seen_samples *seen)
{
    const lf_types types = lf_renderer_types(w->model);
    const lf_light_rays rays = {t->count,
                                t->samples,
                                w->views,
                                t->rays->origin + 3 * t->from,
                                t->rays->direction + 3 * t->from,
                                seen->along,
                                seen->centres,
                                seen->seen,
                                t->rays->near,
                                t->rays->far};
    lf_light_geometry *geometry = lf_alloc(tape, sizeof *geometry);
    *geometry = lf_light_geometry_make(tape, &types, &rays);
    return geometry;
}

lf_passed lf_render_pass(lf_tape *tape, const lf_render_work *w, const lf_ray_tile *t, int network,
                         lf_tensor *maps)
{
    const long channels = w->model->config.channels, points = t->count * t->samples;
    lf_scope(tape, network == LF_COARSE ? "coarse" : "fine");
    lf_scope(tape, "geometry");
    const lf_seen_samples seen =
        lf_see_samples(tape, t->rays, t->from, t->count, t->samples, t->depth, w->views, w->source);
    lf_passed p = {.geometry = geometry_of(tape, w, t, &seen)};
    const lf_tensor *difference =
        w->model->config.equivariant
            ? NULL
            : lf_ray_differences(tape, t->rays, t->from, t->count, t->samples, &seen, w->views);
    lf_scope_end(tape);
    lf_scope(tape, "samples");
    lf_tensor *y = lf_sample_views(tape, maps, w->views, w->view, network * channels, channels,
                                   points, seen.uv, p.geometry->mask->value);
    const lf_ray_inputs in = {
        lf_reshape(tape, y, 4, LF_DIMS(t->count, t->samples, w->views, LF_RGB + channels)),
        p.geometry, difference};
    lf_scope_end(tape);
    const lf_radiance radiance = lf_renderer_radiance(tape, w->model, network, &in);
    lf_scope(tape, "volume");
    lf_tensor *depth = lf_tensor_new(tape, 2, LF_DIMS(t->count, t->samples));
    for (long i = 0; i < points; i++)
        depth->value[i] = (lf_real)t->depth[i];
    p.rendered = lf_volume(tape, radiance.sigma, radiance.colour, depth, t->white);
    lf_scope_end(tape);
    lf_scope_end(tape);
    return p;
}

/* ---- training ---------------------------------------------------------------------------------
 */

typedef struct step {
    lf_render_work *work;
    const lf_render_batch *batch;
    double *depth; /* [N, S] */
    float *counts; /* [N] 1 = the ray's error counts */
    long counted;
} step;

static lf_stream stream_of(const lf_render_batch *b, long ray, int network)
{
    return lf_stream_at(b->seed, LF_RANDOM_DEPTH, (uint64_t)b->step,
                        (uint64_t)(LF_RAY_NETWORKS * ray + network));
}

/* Depths of the coarse samples, and which rays count. */
static void draw_ray(const step *s, lf_tape *tape, long ray)
{
    const lf_render_work *w = s->work;
    const long samples = w->model->config.samples;
    double *depth = s->depth + ray * samples;
    lf_stream stream = stream_of(s->batch, ray, LF_COARSE);
    lf_scope(tape, "places");
    lf_strata(samples, s->batch->rays.near, s->batch->rays.far, &stream, depth);
    lf_tape_reset(tape);
    const lf_seen_samples seen =
        lf_see_samples(tape, &s->batch->rays, ray, 1, samples, depth, w->views, w->source);
    long good = 0;
    for (long i = 0; i < samples; i++) {
        long views = 0;
        for (long v = 0; v < w->views; v++)
            views += seen.seen[i * w->views + v];
        good += views >= LF_KEY_VIEWS;
    }
    s->counts[ray] = good > s->batch->seen_samples;
    lf_scope_end(tape);
}

static lf_tensor *loss_of(const step *s, lf_tape *tape, const lf_passed *p, long from)
{
    lf_scope(tape, "loss");
    lf_tensor *loss =
        lf_squared_error(tape, p->rendered.colour, s->batch->colour + 3 * from, s->counts + from);
    lf_scope_end(tape);
    return loss;
}

static double refine_rays(const step *s, lf_tape *tape, const lf_ray_tile *coarse,
                          const lf_real *weight, lf_tensor *maps, lf_tensor **loss)
{
    const lf_renderer_config *c = &s->work->model->config;
    const long all = c->samples + c->fine;
    lf_scope(tape, "places");
    double *depth = lf_alloc(tape, (size_t)(coarse->count * all) * sizeof *depth);
    for (long i = 0; i < coarse->count; i++) {
        lf_stream stream = stream_of(s->batch, coarse->from + i, LF_FINE);
        lf_refine(c->samples, coarse->depth + i * c->samples, weight + i * c->samples, c->fine,
                  &stream, depth + i * all);
    }
    lf_scope_end(tape);
    lf_ray_tile fine = *coarse;
    fine.samples = all;
    fine.depth = depth;
    const lf_passed p = lf_render_pass(tape, s->work, &fine, LF_FINE, maps);
    *loss = loss_of(s, tape, &p, fine.from);
    return (double)(*loss)->value[0];
}

static double run_tile(const step *s, lf_tape *tape, const lf_render_lane *l, long from, long count)
{
    lf_render_work *w = s->work;
    const long samples = w->model->config.samples;
    lf_tape_reset(tape);
    lf_tape_set_lane(tape, l->grad, w->model->head_first);
    lf_tensor *maps = lf_leaf(tape, 1, LF_DIMS(w->maps_size), w->maps, l->maps);
    const lf_ray_tile t = {&s->batch->rays,           from,           count, samples,
                           s->depth + from * samples, s->batch->white};
    const lf_passed p = lf_render_pass(tape, w, &t, LF_COARSE, maps);
    lf_tensor *loss = loss_of(s, tape, &p, from);
    double error = (double)loss->value[0];
    if (w->model->networks > 1) {
        lf_tensor *fine;
        error += refine_rays(s, tape, &t, p.rendered.weight->value, maps, &fine);
        loss = lf_add(tape, loss, fine);
    }
    lf_backward(tape, loss, (lf_real)(1 / (3.0 * (double)s->counted)));
    return error;
}

static void clear_lane(const lf_render_work *w, lf_render_lane *l)
{
    if (l->maps_room < w->maps_size) {
        free(l->maps);
        l->maps = room((size_t)w->maps_size * sizeof *l->maps);
        l->maps_room = w->maps_size;
    }
    memset(l->grad, 0, (size_t)w->head_size * sizeof *l->grad);
    memset(l->maps, 0, (size_t)w->maps_size * sizeof *l->maps);
    l->loss = 0;
    l->nonfinite[0] = 0;
}

static void run_lane(const step *s, lf_tape *tape, int number)
{
    lf_render_lane *l = &s->work->lane[number];
    const long rays = s->work->tile, count = s->batch->rays.count;
    lf_scope(tape, "lanes");
    clear_lane(s->work, l);
    lf_scope_end(tape);
    for (long t = number; t * rays < count; t += LF_RENDER_LANES) {
        const long from = t * rays, left = count - from;
        l->loss += run_tile(s, tape, l, from, left < rays ? left : rays);
        const char *found = lf_tape_nonfinite(tape);
        if (found && !l->nonfinite[0])
            snprintf(l->nonfinite, sizeof l->nonfinite, "%s", found);
    }
}

enum { PIECE = 1024 }; /* numbers of all lanes that are added at a time */

/* Lanes in their order, into the store and into the gradients of the maps. */
static double reduce_lanes(const lf_render_work *w)
{
    lf_real *grad = lf_store_grads(w->model->store) + w->model->head_first;
    double loss = 0;
    for (int l = 0; l < LF_RENDER_LANES; l++) {
        loss += w->lane[l].loss;
        for (long i = 0; i < w->head_size; i++)
            grad[i] += w->lane[l].grad[i];
    }
    for (long b = 0, at = 0; b < w->batches; at += w->map[b++]->size) {
        lf_real *g = lf_grad(w->features, w->map[b]);
        const long size = w->map[b]->size;
#pragma omp parallel for schedule(static)
        for (long first = 0; first < size; first += PIECE) {
            const long end = first + PIECE < size ? first + PIECE : size;
            for (int l = 0; l < LF_RENDER_LANES; l++)
                for (long i = first; i < end; i++)
                    g[i] += w->lane[l].maps[at + i];
        }
    }
    return loss;
}

static void draw_rays(step *s)
{
    const long count = s->batch->rays.count;
    lf_scope(s->work->features, LF_SCOPE_TEAM);
#pragma omp parallel for schedule(static) num_threads(lf_render_workers())
    for (long r = 0; r < count; r++)
        draw_ray(s, s->work->worker[omp_get_thread_num()], r);
    lf_scope_end(s->work->features);
    for (long r = 0; r < count; r++)
        s->counted += s->counts[r] > 0;
}

double lf_render_step(lf_render_work *work, const lf_render_batch *batch, long *counted)
{
    const long count = batch->rays.count;
    lf_store_zero_grads(work->model->store);
    lf_tape_reset(work->features);
    lf_tape_set_grad(work->features, true);
    lf_render_maps(work, batch->views, batch->source);
    step s = {
        work, batch,
        lf_alloc(work->features, (size_t)(count * work->model->config.samples) * sizeof(double)),
        lf_alloc(work->features, (size_t)count * sizeof(float)), 0};
    draw_rays(&s);
    if (counted)
        *counted = s.counted;
    if (s.counted == 0)
        return 0;
    lf_scope(work->features, LF_SCOPE_TEAM);
#pragma omp parallel for schedule(dynamic, 1) num_threads(lf_render_workers())
    for (int l = 0; l < LF_RENDER_LANES; l++)
        run_lane(&s, work->worker[omp_get_thread_num()], l);
    lf_scope_end(work->features);
    lf_scope(work->features, "lanes");
    const double total = reduce_lanes(work);
    lf_scope_end(work->features);
    lf_backward_from(work->features);
    return total / (3.0 * (double)s.counted);
}
