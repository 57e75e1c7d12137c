/* batch.c: see batch.h. */
#include "autograd/random.h"
#include "train/batch.h"
#include "train/recon_data.h"

enum { V = LF_CUBE_VIEWS };

struct lf_batches {
    const lf_shapes *shapes;
    long per_step, points, near_points; /* a shape */
    long uniform_stored, near_stored;
    uint64_t seed;
    long *order, entries; /* one epoch: indices of shapes, shuffled */
    long epoch;           /* which epoch `order` holds; -1 none */
    long *list;           /* the epoch in unshuffled order */
    long image_size;      /* numbers of one shape's views */
    float *pixels;
    lf_real *image;
    float *sdf;
    double (*point)[3];
    lf_projection projection;
    lf_seen_grid grid;
};

static void *room(size_t count, size_t size)
{
    void *p = calloc(count ? count : 1, size);
    LF_REQUIRE(p, "out of memory for %zu times %zu bytes", count, size);
    return p;
}

static void list_epoch(lf_batches *b, const lf_config *cfg)
{
    const long count = lf_shapes_count(b->shapes);
    long builtin = 0;
    for (long i = 0; i < count; i++)
        builtin += lf_shapes_is_builtin(b->shapes, i);
    /* real shapes are repeated only where built-in ones are mixed in */
    const long repeat = builtin > 0 && builtin < count ? lf_config_int(cfg, "data.real_repeat") : 1;
    b->entries = builtin + (count - builtin) * repeat;
    b->list = room((size_t)b->entries, sizeof *b->list);
    b->order = room((size_t)b->entries, sizeof *b->order);
    long n = 0;
    for (long i = 0; i < count; i++)
        for (long k = 0; k < (lf_shapes_is_builtin(b->shapes, i) ? 1 : repeat); k++)
            b->list[n++] = i;
}

lf_batches *lf_batches_create(const lf_config *cfg, const lf_recon *model, const lf_shapes *shapes)
{
    lf_batches *b = room(1, sizeof *b);
    b->shapes = shapes;
    b->per_step = lf_config_int(cfg, "train.shapes_per_step");
    b->points = lf_config_int(cfg, "train.points_per_shape");
    b->near_points = lround(lf_config_real(cfg, "train.near_fraction") * (double)b->points);
    b->uniform_stored = lf_config_int(cfg, "data.points_uniform");
    b->near_stored = lf_config_int(cfg, "data.points_near");
    b->seed = (uint64_t)lf_config_int(cfg, "train.seed");
    b->epoch = -1;
    list_epoch(b, cfg);
    const long size = lf_config_int(cfg, "data.image_size");
    b->image_size = V * size * size * (lf_config_is(cfg, "data.channels", "colour") ? 4 : 2);
    b->pixels = room((size_t)b->image_size, sizeof *b->pixels);
    b->image = room((size_t)(b->per_step * b->image_size), sizeof *b->image);
    b->sdf = room((size_t)(b->per_step * b->points), sizeof *b->sdf);
    b->point = room((size_t)b->points, sizeof *b->point);
    b->projection = lf_projection_create(b->per_step * b->points);
    b->grid = lf_seen_grid_create(model, b->per_step);
    return b;
}

void lf_batches_free(lf_batches *b)
{
    if (!b)
        return;
    lf_seen_grid_free(&b->grid);
    lf_projection_free(&b->projection);
    free(b->order);
    free(b->list);
    free(b->pixels);
    free(b->image);
    free(b->sdf);
    free(b->point);
    free(b);
}

long lf_batches_epoch(const lf_batches *b)
{
    return (b->entries + b->per_step - 1) / b->per_step;
}

/* Fisher-Yates of the list, for one epoch. */
static void shuffle(lf_batches *b, long epoch)
{
    lf_stream s = lf_stream_at(b->seed, LF_RANDOM_SHUFFLE, (uint64_t)epoch, 0);
    memcpy(b->order, b->list, (size_t)b->entries * sizeof *b->order);
    for (long i = b->entries - 1; i > 0; i--) {
        const long j = lf_index(&s, i + 1), x = b->order[i];
        b->order[i] = b->order[j];
        b->order[j] = x;
    }
    b->epoch = epoch;
}

static void draw_points(lf_batches *b, long step, long slot, const float (*samples)[4])
{
    lf_stream s = lf_stream_at(b->seed, LF_RANDOM_POINTS, (uint64_t)step, (uint64_t)slot);
    for (long i = 0; i < b->points; i++) {
        const bool near = i < b->near_points;
        const long k = near ? b->uniform_stored + lf_index(&s, b->near_stored)
                            : lf_index(&s, b->uniform_stored);
        for (int a = 0; a < 3; a++)
            b->point[i][a] = (double)samples[k][a];
        b->sdf[slot * b->points + i] = samples[k][3];
    }
}

lf_batch lf_batches_at(lf_batches *b, long step)
{
    for (long slot = 0; slot < b->per_step; slot++) {
        const long n = step * b->per_step + slot, epoch = n / b->entries;
        if (epoch != b->epoch)
            shuffle(b, epoch);
        const long index = b->order[n % b->entries];
        const lf_shape_views *views = lf_shapes_views(b->shapes, index, epoch);
        lf_shapes_pixels(views->images, b->image_size, b->pixels);
        for (long i = 0; i < b->image_size; i++)
            b->image[slot * b->image_size + i] = (lf_real)b->pixels[i];
        draw_points(b, step, slot, lf_shapes_samples(b->shapes, index));
        lf_projection_fill(&b->projection, slot * b->points, b->points,
                           (const double(*)[3])b->point, views, slot * V);
        lf_seen_grid_fill(&b->grid, slot, views, slot * V);
    }
    const lf_recon_images images = {b->per_step * V, V, b->image, lf_seen_grid_points(&b->grid)};
    return (lf_batch){images, lf_seen_points(&b->projection, b->per_step * b->points), b->sdf};
}
