/* recon_work.c: tiles, lanes and workers of the reconstruction models. See recon_work.h. */
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
    lf_recon_code code; /* on `features`, after lf_recon_encode */
};

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

/* Threads of a team: no more than there are tapes for. */
static int workers(void)
{
    return omp_get_max_threads() < LF_RECON_LANES ? omp_get_max_threads() : LF_RECON_LANES;
}

void lf_recon_work_watch(lf_recon_work *work, lf_profile *profile)
{
    lf_profile_watch(profile, work->features, 0);
    for (int l = 0; l < LF_RECON_LANES; l++)
        lf_profile_watch(profile, work->worker[l], workers());
}

static lf_tensor *image_leaf(lf_recon_work *work, const lf_recon_images *images)
{
    const lf_recon_config *c = &work->model->config;
    /* a leaf without grad is only read */
    return lf_leaf(work->features, 4,
                   LF_DIMS(images->count, c->image_size, c->image_size, c->backbone.in_channels),
                   (lf_real *)(uintptr_t)images->pixel, NULL);
}

static void encode(lf_recon_work *work, const lf_recon_images *images, bool training)
{
    lf_tape_reset(work->features);
    lf_tape_set_grad(work->features, training);
    lf_recon_encode_images(work->features, work->model, image_leaf(work, images), images->views,
                           images->grid, training, &work->code);
    for (int m = 0; training && m < work->code.inner_maps; m++)
        lf_drop(work->features, work->code.inner[m]);
}

/* ---- training ---- */

typedef struct batch {
    lf_recon_work *work;
    const lf_recon_points *points;
    const float *sdf;
    const lf_sdf_loss_config *loss;
    lf_recon_inputs in; /* of all points, on the features' tape, with grad */
} batch;

/* Rows [from, from + count) of the samples, with a gradient of the tile's own. */
static lf_tensor *seen_rows(lf_tape *tape, const lf_tensor *seen, long from, long count)
{
    const long row = seen->size / seen->dim[0];
    lf_real *grad = seen->wants ? lf_alloc_reals(tape, count * row) : NULL;
    if (grad)
        memset(grad, 0, (size_t)(count * row) * sizeof *grad);
    return lf_leaf(tape, 3, LF_DIMS(count, seen->dim[1], seen->dim[2]), seen->value + from * row,
                   grad);
}

/* Rows [from, from + count) of all inputs, on a tile's tape. */
static lf_recon_inputs rows_of(lf_tape *tape, const lf_recon_inputs *in,
                               const lf_recon_points *points, long from)
{
    const long count = points->count;
    lf_tensor direction = *in->rays.direction, mask = *in->rays.mask;
    return (lf_recon_inputs){.seen = seen_rows(tape, in->seen, from, count),
                             .known = in->known ? lf_rows_view(tape, in->known, from, count) : NULL,
                             .rays = {count, points->views,
                                      lf_rows_view(tape, &direction, from, count),
                                      lf_rows_view(tape, &mask, from, count)},
                             .points = points};
}

/* Forward and backward of one tile; its gradients go to the lane and to its rows of the inputs':
 * that of the samples takes their place, since no other tile reads these rows. */
static double run_tile(const batch *b, lf_tape *tape, const lane *l, long from, long count)
{
    lf_tape_reset(tape);
    lf_tape_set_lane(tape, l->grad, b->work->model->head_first);
    const lf_recon_points points = lf_recon_slice(b->points, from, count);
    const lf_recon_inputs in = rows_of(tape, &b->in, &points, from);
    lf_tensor *x = lf_recon_sdf(tape, b->work->model, &in, NULL);
    lf_scope(tape, "loss");
    lf_tensor *loss = lf_sdf_loss(tape, x, b->sdf + from, b->loss);
    lf_scope_end(tape);
    lf_backward(tape, loss, (lf_real)(1 / (double)b->points->count));
    if (in.seen->grad)
        memcpy(in.seen->value, in.seen->grad, (size_t)in.seen->size * sizeof *in.seen->grad);
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

double lf_recon_step(lf_recon_work *work, const lf_recon_images *images,
                     const lf_recon_points *points, const float *sdf,
                     const lf_sdf_loss_config *loss)
{
    lf_store_zero_grads(work->model->store);
    encode(work, images, true);
    batch b = {work, points, sdf, loss,
               lf_recon_look(work->features, work->model, &work->code, points)};
    if (b.in.known)
        lf_grad(work->features, b.in.known); /* tiles add to their own rows of it */
    lf_scope(work->features, LF_SCOPE_TEAM);
#pragma omp parallel for schedule(dynamic, 1) num_threads(workers())
    for (int l = 0; l < LF_RECON_LANES; l++)
        run_lane(&b, work->worker[omp_get_thread_num()], l);
    lf_scope_end(work->features);
    lf_scope(work->features, "lanes");
    const double total = reduce_lanes(work);
    lf_scope_end(work->features);
    lf_grad_in_place(work->features, b.in.seen); /* written by the tiles */
    lf_backward_from(work->features);
    return total / (double)points->count;
}

/* ---- evaluation ---- */

void lf_recon_encode(lf_recon_work *work, const lf_recon_images *images)
{
    encode(work, images, false);
}

static void predict_tile(const lf_recon_work *work, lf_tape *tape, const lf_recon_points *p,
                         long from, long count, double scale, lf_real *sdf, uint8_t *valid)
{
    lf_tape_reset(tape);
    const lf_recon_points points = lf_recon_slice(p, from, count);
    const lf_recon_inputs in = lf_recon_look(tape, work->model, &work->code, &points);
    const lf_tensor *x = lf_recon_sdf(tape, work->model, &in, NULL);
    for (long q = 0; q < count; q++) {
        sdf[from + q] = (lf_real)((double)x->value[q] / scale);
        uint8_t any = 0;
        for (long v = 0; v < p->views; v++)
            any |= p->mask[(from + q) * p->views + v];
        if (valid)
            valid[from + q] = any;
    }
}

void lf_recon_predict(lf_recon_work *work, const lf_recon_points *points, double scale,
                      lf_real *sdf, uint8_t *valid)
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

double lf_recon_macs(const lf_recon *model, long images, long points, long views)
{
    const lf_recon_cost cost = lf_recon_costs(model, views);
    return cost.image * (double)images + cost.object * (double)images / (double)views +
           cost.point * (double)points;
}
