/* render_rays.c: evaluation of the renderers: rays without gradient, and what they may leave out.
 * See render_work.h. */
#include <omp.h>

#include "models/render_tiles.h"

void lf_render_encode(lf_render_work *work, long views, const lf_source *source)
{
    lf_tape_reset(work->features);
    lf_tape_set_grad(work->features, false);
    lf_render_maps(work, views, source);
}

lf_render_savings lf_render_savings_none(void)
{
    return (lf_render_savings){.empty = -1};
}

typedef struct evaluation {
    lf_render_work *work;
    const lf_target_rays *rays;
    const lf_render_savings *savings;
    bool white;
    lf_ray_image *out;
} evaluation;

static bool inside(const lf_bounds *b, const double p[3])
{
    const double x = p[0] - b->centre[0], y = p[1] - b->centre[1], z = p[2] - b->centre[2];
    return b->radius <= 0 || x * x + y * y + z * z <= b->radius * b->radius;
}

/* Keep the depths of one ray that may show something, and their numbers; returns how many. */
static long keep_samples(const evaluation *e, lf_tape *tape, long ray, long samples, double *depth,
                         long *number)
{
    const lf_render_work *w = e->work;
    const lf_mark mark = lf_tape_mark(tape);
    const lf_seen_samples seen =
        lf_see_samples(tape, e->rays, ray, 1, samples, depth, w->views, w->source);
    long kept = 0;
    for (long i = 0; i < samples; i++) {
        bool any = !e->savings->unseen;
        for (long v = 0; !any && v < w->views; v++)
            any = seen.seen[i * w->views + v];
        if (any && inside(&e->savings->bounds, seen.point + 3 * i)) {
            depth[kept] = depth[i];
            number[kept++] = i;
        }
    }
    lf_tape_release(tape, mark);
    return kept;
}

/* Depths beyond which less than `stop` of the light is left are dropped. */
static long stop_samples(const lf_real *weight, long coarse, const double *coarse_depth,
                         double stop, long samples, const double *depth)
{
    double left = 1, end = INFINITY;
    for (long i = 0; i < coarse && end == INFINITY; i++) {
        left -= (double)weight[i];
        if (left < stop)
            end = i + 1 < coarse ? coarse_depth[i + 1] : INFINITY;
    }
    while (samples > 0 && depth[samples - 1] > end)
        samples--;
    return samples;
}

static void write_ray(const evaluation *e, long ray, const lf_rendered *r, long row)
{
    double opacity = 0;
    const long samples = r ? lf_cols(r->weight) : 0;
    for (long i = 0; i < samples; i++)
        opacity += (double)r->weight->value[row * samples + i];
    for (int a = 0; a < 3; a++)
        e->out->colour[3 * ray + a] = r ? r->colour->value[3 * row + a] : (lf_real)e->white;
    e->out->opacity[ray] = (lf_real)opacity;
    e->out->depth[ray] =
        opacity > 1e-3 ? (lf_real)((double)r->depth->value[row] / opacity) : (lf_real)e->rays->far;
}

/* One network on the rays of a tile, without gradient. */
static lf_passed look(const evaluation *e, lf_tape *tape, const lf_ray_tile *t, int network,
                      long *rows)
{
    lf_tensor *maps = lf_leaf(tape, 1, LF_DIMS(e->work->maps_size), e->work->maps, NULL);
    const lf_passed p = lf_render_pass(tape, e->work, t, network, maps);
    *rows += p.geometry->rays * p.geometry->samples * p.geometry->views;
    return p;
}

static void write_rays(const evaluation *e, const lf_ray_tile *t, const lf_passed *p)
{
    for (long i = 0; i < t->count; i++)
        write_ray(e, t->from + i, &p->rendered, i);
}

/* Rays with as many samples each, together. */
static long run_plain(const evaluation *e, lf_tape *tape, long from, long count)
{
    const lf_renderer_config *c = &e->work->model->config;
    const long samples = c->samples, all = samples + c->fine;
    long rows = 0;
    lf_tape_reset(tape);
    double *depth = lf_alloc(tape, (size_t)(count * all) * sizeof *depth);
    double *coarse = lf_alloc(tape, (size_t)(count * samples) * sizeof *coarse);
    for (long i = 0; i < count; i++)
        lf_strata(samples, e->rays->near, e->rays->far, NULL, coarse + i * samples);
    lf_ray_tile t = {e->rays, from, count, samples, coarse, e->white};
    lf_passed p = look(e, tape, &t, LF_COARSE, &rows);
    if (e->work->model->networks > 1) {
        const lf_real *weight = p.rendered.weight->value;
        for (long i = 0; i < count; i++)
            lf_refine(samples, coarse + i * samples, weight + i * samples, c->fine, NULL,
                      depth + i * all);
        t.samples = all;
        t.depth = depth;
        p = look(e, tape, &t, LF_FINE, &rows);
    }
    write_rays(e, &t, &p);
    return rows;
}

/* One ray with the samples that it needs, of those that it would have: places of fine samples
 * follow the weights of all coarse ones, 0 where one was left out. */
static long run_saving(const evaluation *e, lf_tape *tape, long ray)
{
    const lf_renderer_config *c = &e->work->model->config;
    const long samples = c->samples, all = samples + c->fine;
    long rows = 0;
    lf_tape_reset(tape);
    double *coarse = lf_alloc(tape, (size_t)samples * sizeof *coarse);
    double *depth = lf_alloc(tape, (size_t)all * sizeof *depth);
    long *number = lf_alloc(tape, (size_t)all * sizeof *number);
    lf_real *weight = lf_alloc_reals(tape, samples);
    double opacity = 0;
    lf_strata(samples, e->rays->near, e->rays->far, NULL, coarse);
    memcpy(depth, coarse, (size_t)samples * sizeof *depth);
    memset(weight, 0, (size_t)samples * sizeof *weight);
    lf_ray_tile t = {e->rays, ray,     1, keep_samples(e, tape, ray, samples, depth, number),
                     depth,   e->white};
    lf_passed p;
    if (t.samples)
        p = look(e, tape, &t, LF_COARSE, &rows);
    for (long i = 0; i < t.samples; i++) {
        weight[number[i]] = p.rendered.weight->value[i];
        opacity += (double)weight[number[i]];
    }
    if (e->work->model->networks > 1 && opacity > e->savings->empty) {
        double *refined = lf_alloc(tape, (size_t)all * sizeof *refined);
        lf_refine(samples, coarse, weight, c->fine, NULL, refined);
        t.samples = e->savings->stop > 0
                        ? stop_samples(weight, samples, coarse, e->savings->stop, all, refined)
                        : all;
        t.samples = keep_samples(e, tape, ray, t.samples, refined, number);
        t.depth = refined;
        if (t.samples)
            p = look(e, tape, &t, LF_FINE, &rows);
    }
    write_ray(e, ray, t.samples ? &p.rendered : NULL, 0);
    return rows;
}

static bool saves(const lf_render_savings *s)
{
    return s->unseen || s->bounds.radius > 0 || s->stop > 0 || s->empty >= 0;
}

void lf_render_rays(lf_render_work *work, const lf_target_rays *rays, bool white,
                    const lf_render_savings *savings, lf_ray_image *out)
{
    const evaluation e = {work, rays, savings, white, out};
    const bool saving = saves(savings);
    const long each = saving ? 1 : work->tile, tiles = (rays->count + each - 1) / each;
    long rows = 0;
    for (int l = 0; l < LF_RENDER_LANES; l++)
        lf_tape_set_grad(work->worker[l], false);
#pragma omp parallel for schedule(dynamic, 4) num_threads(lf_render_workers()) reduction(+ : rows)
    for (long t = 0; t < tiles; t++) {
        lf_tape *tape = work->worker[omp_get_thread_num()];
        const long from = t * each, left = rays->count - from;
        rows += saving ? run_saving(&e, tape, from)
                       : run_plain(&e, tape, from, left < each ? left : each);
    }
    for (int l = 0; l < LF_RENDER_LANES; l++)
        lf_tape_set_grad(work->worker[l], true);
    out->rows = rows;
}
