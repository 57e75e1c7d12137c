/* recon_work.c: tiles, lanes and workers of the reconstruction model. See recon_work.h. */
#include <omp.h>
#include "models/recon_work.h"

typedef struct lane {
    lf_real *grad; /* of the head's parameters */
    double loss;
    char nonfinite[64]; /* of the first tile that had one; the tape forgets it at the next tile */
} lane;

struct lf_recon_work {
    const lf_recon *model;
    long tile, head_size;
    lf_tape *features;
    lf_tape *worker[LF_RECON_LANES]; /* one a thread; any tile may run on any of them */
    lane lane[LF_RECON_LANES];
    lf_tensor *map[LF_BACKBONE_MAPS + 1]; /* on `features`, after lf_recon_encode */
    int maps;
};

/* Threads of a team: no more than there are tapes for. */
static int workers(void)
{
    return omp_get_max_threads() < LF_RECON_LANES ? omp_get_max_threads() : LF_RECON_LANES;
}

lf_recon_work *lf_recon_work_create(const lf_recon *model, long tile)
{
    lf_recon_work *work = calloc(1, sizeof *work);
    LF_REQUIRE(work && tile >= 1, "a workspace with tiles of %ld points", tile);
    work->model = model;
    work->tile = tile;
    work->head_size = lf_store_size(model->store) - model->head_first;
    work->features = lf_tape_create();
    for (int l = 0; l < LF_RECON_LANES; l++) {
        work->worker[l] = lf_tape_create();
        work->lane[l].grad = calloc((size_t)work->head_size, sizeof(lf_real));
        LF_REQUIRE(work->lane[l].grad, "out of memory for %ld gradients", work->head_size);
    }
    return work;
}

void lf_recon_work_free(lf_recon_work *work)
{
    if (!work)
        return;
    lf_tape_free(work->features);
    for (int l = 0; l < LF_RECON_LANES; l++) {
        lf_tape_free(work->worker[l]);
        free(work->lane[l].grad);
    }
    free(work);
}

void lf_recon_work_check(lf_recon_work *work, bool on)
{
    lf_tape_set_check(work->features, on);
    for (int l = 0; l < LF_RECON_LANES; l++)
        lf_tape_set_check(work->worker[l], on);
}

void lf_recon_work_watch(lf_recon_work *work, lf_profile *profile)
{
    lf_profile_watch(profile, work->features, 0);
    for (int l = 0; l < LF_RECON_LANES; l++)
        lf_profile_watch(profile, work->worker[l], workers());
}

static bool is_forward(const char *found)
{
    return found && strncmp(found, "forward", 7) == 0;
}

/* In the order of the work: forward of the features, of a tile, backward of a tile, of the rest. */
const char *lf_recon_nonfinite(const lf_recon_work *work)
{
    const char *features = lf_tape_nonfinite(work->features), *tile = NULL;
    if (is_forward(features))
        return features;
    for (int l = 0; l < LF_RECON_LANES; l++) {
        const char *found = work->lane[l].nonfinite;
        if (found[0] && (!tile || (is_forward(found) && !is_forward(tile))))
            tile = found;
    }
    return tile ? tile : features;
}

size_t lf_recon_work_bytes(const lf_recon_work *work)
{
    size_t bytes = lf_tape_peak(work->features);
    for (int l = 0; l < LF_RECON_LANES; l++)
        bytes += lf_tape_peak(work->worker[l]) + (size_t)work->head_size * sizeof(lf_real);
    return bytes;
}

/* Directions and visibility of the points [from, from + count) as tensors of `tape`. */
static lf_ray_geometry rays_of(lf_tape *tape, const lf_recon_points *p, long from, long count)
{
    lf_tensor *direction = lf_tensor_new(tape, 3, LF_DIMS(count, p->views, 3));
    lf_tensor *mask = lf_tensor_new(tape, 2, LF_DIMS(count, p->views));
    for (long i = 0; i < direction->size; i++)
        direction->value[i] = (lf_real)p->direction[from * p->views * 3 + i];
    for (long i = 0; i < mask->size; i++)
        mask->value[i] = p->mask[from * p->views + i];
    return (lf_ray_geometry){count, p->views, direction, mask};
}

/* Samples of the maps at the points [from, from + count), on `tape`. */
static lf_tensor *sample(lf_tape *tape, const lf_recon_work *work, const lf_recon_points *p,
                         long from, long count, lf_ray_geometry *rays)
{
    const long size = work->model->config.image_size;
    *rays = rays_of(tape, p, from, count);
    return lf_sample_maps(tape, work->maps, work->map, size, size, count, p->views,
                          p->uv + from * p->views * 2, rays->mask->value, p->first + from);
}

static lf_tensor *image_leaf(lf_recon_work *work, long images, const lf_real *image)
{
    const lf_recon_config *c = &work->model->config;
    /* a leaf without grad is only read */
    return lf_leaf(work->features, 4,
                   LF_DIMS(images, c->image_size, c->image_size, c->backbone.in_channels),
                   (lf_real *)(uintptr_t)image, NULL);
}

/* ---- training ---- */

typedef struct batch {
    lf_recon_work *work;
    const lf_recon_points *points;
    const float *sdf;
    const lf_sdf_loss_config *loss;
    lf_tensor *seen; /* [Q, V, F] on the features' tape, with grad */
    lf_ray_geometry rays;
} batch;

/* Forward and backward of one tile; its gradients go to the lane and to its rows of seen->grad. */
static double run_tile(const batch *b, lf_tape *tape, const lane *l, long from, long count)
{
    const long views = b->points->views;
    lf_tape_reset(tape);
    lf_tape_set_lane(tape, l->grad, b->work->model->head_first);
    lf_tensor *seen = lf_rows_view(tape, b->seen, from, count);
    lf_tensor direction = *b->rays.direction, mask = *b->rays.mask;
    const lf_ray_geometry rays = {count, views, lf_rows_view(tape, &direction, from, count),
                                  lf_rows_view(tape, &mask, from, count)};
    lf_tensor *x =
        lf_recon_sdf(tape, b->work->model, seen, &rays, b->points->distance + from * views, NULL);
    lf_scope(tape, "loss");
    lf_tensor *loss = lf_sdf_loss(tape, x, b->sdf + from, b->loss);
    lf_scope_end(tape);
    lf_backward(tape, loss, (lf_real)(1 / (double)b->points->count));
    return (double)loss->value[0];
}

static void run_lane(const batch *b, lf_tape *tape, int number)
{
    lane *l = &b->work->lane[number];
    const long tile = b->work->tile, count = b->points->count, tiles = (count + tile - 1) / tile;
    lf_scope(tape, "lanes");
    memset(l->grad, 0, (size_t)b->work->head_size * sizeof *l->grad);
    lf_scope_end(tape);
    l->loss = 0;
    l->nonfinite[0] = 0;
    for (long t = number; t < tiles; t += LF_RECON_LANES) {
        const long from = t * tile;
        l->loss += run_tile(b, tape, l, from, count - from < tile ? count - from : tile);
        const char *found = lf_tape_nonfinite(tape);
        if (found && !l->nonfinite[0])
            snprintf(l->nonfinite, sizeof l->nonfinite, "%s", found);
    }
}

static double reduce_lanes(const lf_recon_work *work)
{
    lf_real *grad = lf_store_grads(work->model->store) + work->model->head_first;
    double loss = 0;
    for (int l = 0; l < LF_RECON_LANES; l++) {
        loss += work->lane[l].loss;
        for (long i = 0; i < work->head_size; i++)
            grad[i] += work->lane[l].grad[i];
    }
    return loss;
}

double lf_recon_step(lf_recon_work *work, long images, const lf_real *image,
                     const lf_recon_points *points, const float *sdf,
                     const lf_sdf_loss_config *loss)
{
    lf_tape *tape = work->features;
    lf_store_zero_grads(work->model->store);
    lf_tape_reset(tape);
    lf_tape_set_grad(tape, true);
    work->maps = lf_recon_maps(tape, work->model, image_leaf(work, images, image), true, work->map);
    batch b = {work, points, sdf, loss, NULL, {0}};
    lf_scope(tape, "samples");
    b.seen = sample(tape, work, points, 0, points->count, &b.rays);
    lf_grad(tape, b.seen); /* tiles add to their own rows of it */
    lf_scope_end(tape);
    lf_scope(tape, LF_SCOPE_TEAM);
#pragma omp parallel for schedule(dynamic, 1) num_threads(workers())
    for (int l = 0; l < LF_RECON_LANES; l++)
        run_lane(&b, work->worker[omp_get_thread_num()], l);
    lf_scope_end(tape);
    lf_scope(tape, "lanes");
    const double total = reduce_lanes(work);
    lf_scope_end(tape);
    lf_backward_from(tape);
    return total / (double)points->count;
}

/* ---- evaluation ---- */

void lf_recon_encode(lf_recon_work *work, long images, const lf_real *image)
{
    lf_tape_reset(work->features);
    lf_tape_set_grad(work->features, false);
    work->maps = lf_recon_maps(work->features, work->model, image_leaf(work, images, image), false,
                               work->map);
}

static void predict_tile(const lf_recon_work *work, lf_tape *tape, const lf_recon_points *p,
                         long from, long count, double scale, float *sdf, uint8_t *valid)
{
    lf_ray_geometry rays;
    lf_tape_reset(tape);
    lf_tensor *seen = sample(tape, work, p, from, count, &rays);
    const lf_tensor *x =
        lf_recon_sdf(tape, work->model, seen, &rays, p->distance + from * p->views, NULL);
    for (long q = 0; q < count; q++) {
        sdf[from + q] = (float)((double)x->value[q] / scale);
        uint8_t any = 0;
        for (long v = 0; v < p->views; v++)
            any |= p->mask[(from + q) * p->views + v];
        if (valid)
            valid[from + q] = any;
    }
}

void lf_recon_predict(lf_recon_work *work, const lf_recon_points *points, double scale, float *sdf,
                      uint8_t *valid)
{
    const long tile = work->tile, tiles = (points->count + tile - 1) / tile;
    for (int w = 0; w < LF_RECON_LANES; w++)
        lf_tape_set_grad(work->worker[w], false);
#pragma omp parallel for schedule(dynamic, 1) num_threads(workers())
    for (long t = 0; t < tiles; t++) {
        const long from = t * tile, left = points->count - from;
        predict_tile(work, work->worker[omp_get_thread_num()], points, from,
                     left < tile ? left : tile, scale, sdf, valid);
    }
    for (int w = 0; w < LF_RECON_LANES; w++)
        lf_tape_set_grad(work->worker[w], true);
}

/* ---- cost ---- */

/* Products of one block a point with V views. */
static double block_macs(const lf_transformer_config *c, double views, double ray0, double ray1)
{
    const double c0 = (double)c->scalars, c1 = (double)c->vectors;
    const double update = ray0 * c0 + 3 * ray1 * c1 + c0 * c0 + 3 * c1 * c1; /* a ray */
    const double paths = c0 + (c->degree2 ? 3 : 2) * c1;
    const double keys = (c0 + c1) * 2 * c0 + 3 * paths * 2 * c1, attend = 2 * (c0 + 3 * c1);
    const double point = 3 * (c0 * c0 + 3 * c1 * c1); /* from_point, query, mix */
    return views * (update + keys + attend) + point;
}

double lf_recon_macs(const lf_recon *model, long images, long points, long views)
{
    const lf_recon_config *c = &model->config;
    const double c0 = (double)c->block.scalars, c1 = (double)c->block.vectors;
    const double f = (double)model->feature_count, v = (double)views;
    const lf_backbone_cost cost = lf_backbone_macs(&model->backbone, c->image_size, c->image_size);
    double point = v * 4 * f + f * c0 + 3 * f * c1;
    for (int b = 0; b < c->blocks; b++)
        point += block_macs(&c->block, v, b ? c0 : f, b ? c1 : 0);
    const double kept = (double)(c->blocks + 1);
    point += 2 * 3 * kept * c1 * kept * c1;
    double in = kept * (c0 + c1);
    for (int i = 0; i < c->mlp_widths; i++) {
        point += in * (double)c->mlp[i];
        in = (double)c->mlp[i];
    }
    return cost.macs * (double)images + (point + in) * (double)points;
}
