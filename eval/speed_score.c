/* speed_score.c: see speed_score.h. */
#include <math.h>

#include "eval/evaluate.h"
#include "eval/file_names.h"
#include "eval/image_metrics.h"
#include "eval/metrics.h"
#include "eval/render_job.h"
#include "eval/speed_score.h"

typedef struct true_item {
    char name[192];
    lf_shape shape;  /* reconstruction */
    lf_mesh *mesh;   /* its surface on the grid of the config */
    lf_image *image; /* rendering */
} true_item;

struct lf_speed_truth {
    bool rendering;
    long samples; /* of the metrics of meshes */
    long items;
    true_item *item;
};

/* ---- the truth --------------------------------------------------------------------------------
 */

static void make_room(lf_speed_truth *t, long items)
{
    t->item = calloc((size_t)items + 1, sizeof *t->item);
    LF_REQUIRE(t->item, "out of memory for %ld items", items);
}

static lf_status open_shapes(lf_speed_truth *t, const lf_config *cfg, const char *split,
                             const char *setting, long items, lf_error *err)
{
    lf_shapes *shapes;
    LF_TRY(lf_evaluated_shapes(cfg, split, setting, NULL, &shapes, err));
    const long there = lf_shapes_count(shapes), count = items > 0 && items < there ? items : there;
    lf_status status = LF_OK;
    make_room(t, count);
    for (; status == LF_OK && t->items < count; t->items++) {
        true_item *item = &t->item[t->items];
        snprintf(item->name, sizeof item->name, "%s", lf_shapes_id(shapes, t->items));
        status = lf_shapes_load(shapes, t->items, &item->shape, err);
        if (status == LF_OK)
            status = lf_true_mesh(cfg, &item->shape, &item->mesh, err);
    }
    lf_shapes_close(shapes);
    return status;
}

static lf_status open_view(const lf_render_item *view, const char *scene, true_item *item,
                           lf_error *err)
{
    const lf_render_view_options options = {.sources = 1};
    lf_render_view v;
    snprintf(item->name, sizeof item->name, "%.90s %.90s", scene,
             view->entry->scene->view[view->target].name);
    LF_TRY(lf_render_view_open(view->entry, view->target, &options, &v, err));
    item->image = lf_picture_of(&v.pixels);
    lf_render_view_release(&v);
    return LF_OK;
}

static lf_status open_scenes(lf_speed_truth *t, const lf_config *cfg, const char *split,
                             long scenes, lf_error *err)
{
    lf_scene_set *set;
    long count;
    LF_TRY(lf_render_job_scenes(cfg, split, true, &set, err));
    lf_render_item *view = lf_render_items(cfg, split, scenes, set, &count);
    char **scene = lf_scene_file_names(set);
    lf_status status = LF_OK;
    make_room(t, count);
    for (; status == LF_OK && t->items < count; t->items++)
        status = open_view(&view[t->items], scene[view[t->items].entry - set->entry],
                           &t->item[t->items], err);
    lf_file_names_free(set->count, scene);
    free(view);
    lf_scene_set_close(set);
    return status;
}

lf_status lf_speed_truth_open(const lf_config *cfg, const char *split, const char *setting,
                              long items, lf_speed_truth **out, lf_error *err)
{
    lf_speed_truth *t = calloc(1, sizeof *t);
    LF_REQUIRE(t, "out of memory");
    t->rendering = lf_config_renders(cfg);
    t->samples = lf_config_int(cfg, "eval.points");
    const lf_status status = t->rendering ? open_scenes(t, cfg, split, items, err)
                                          : open_shapes(t, cfg, split, setting, items, err);
    if (status == LF_OK)
        *out = t;
    else
        lf_speed_truth_close(t);
    return status;
}

void lf_speed_truth_close(lf_speed_truth *t)
{
    for (long i = 0; t && i < t->items; i++) {
        lf_shape_release(&t->item[i].shape);
        lf_mesh_free(t->item[i].mesh);
        lf_image_free(t->item[i].image);
    }
    if (t)
        free(t->item);
    free(t);
}

long lf_speed_items(const lf_speed_truth *t)
{
    return t->items;
}

const char *lf_speed_item_name(const lf_speed_truth *t, long item)
{
    return t->item[item].name;
}

/* ---- scores -----------------------------------------------------------------------------------
 */

/* Differences at points that both have an opinion of. */
typedef struct differences {
    double sum, squares, largest;
    long count, known, lost;
} differences;

static void compare_numbers(const lf_raw_item *exact, const lf_raw_item *item, differences *d)
{
    for (long i = 0; i < exact->numbers; i++) {
        if (isnan(exact->number[i]))
            continue;
        d->known++;
        if (isnan(item->number[i])) {
            d->lost++;
            continue;
        }
        const double x = fabs(item->number[i] - exact->number[i]);
        d->sum += x;
        d->squares += x * x;
        d->largest = fmax(d->largest, x);
        d->count++;
    }
}

static bool same_mesh(const lf_mesh *a, const lf_mesh *b)
{
    return a->vertices == b->vertices && a->faces == b->faces &&
           memcmp(a->vertex, b->vertex, (size_t)a->vertices * sizeof *a->vertex) == 0 &&
           memcmp(a->face, b->face, (size_t)a->faces * sizeof *a->face) == 0;
}

/* Chamfer distance, to the surface, between a mesh and the exact one: 0 for the same mesh; an empty
 * one is as far away as an empty prediction from the truth. */
static lf_status mesh_error(const lf_speed_truth *t, const true_item *truth, const lf_mesh *exact,
                            const lf_mesh *mesh, double *out, lf_error *err)
{
    lf_metric_options options = lf_metric_defaults();
    options.samples = t->samples;
    options.exact = true;
    *out = same_mesh(mesh, exact) ? 0 : LF_CHAMFER_EMPTY;
    if (*out == 0 || mesh->faces == 0 || exact->faces == 0)
        return LF_OK;
    lf_score score;
    LF_TRY(lf_score_meshes(mesh, exact, NULL, &options, &score, err));
    *out =
        score.empty ? LF_CHAMFER_EMPTY : score.chamfer_l1 * score.edge / truth->shape.longest_edge;
    return LF_OK;
}

static lf_status score_shape(const lf_speed_truth *t, long i, const lf_raw_item *exact,
                             const lf_raw_item *item, lf_speed_figures *sum, lf_error *err)
{
    const true_item *truth = &t->item[i];
    lf_metric_options options = lf_metric_defaults();
    options.samples = t->samples;
    options.item = (uint64_t)i;
    lf_score score;
    double error;
    LF_TRY(lf_score_meshes(item->mesh, truth->mesh, truth->shape.sdf, &options, &score, err));
    LF_TRY(mesh_error(t, truth, exact->mesh, item->mesh, &error, err));
    sum->metric += score.iou;
    sum->chamfer += score.chamfer_l1;
    sum->error += error;
    return LF_OK;
}

static lf_status score_picture(const lf_speed_truth *t, long i, const lf_raw_item *item,
                               lf_speed_figures *sum, lf_error *err)
{
    const lf_image *truth = t->item[i].image;
    lf_image *image = lf_image_create(truth->width, truth->height, 3);
    double psnr = 0;
    for (long k = 0; k < item->numbers; k++)
        image->pixel[k] = (float)item->number[k];
    const lf_status status = lf_psnr(image, truth, &psnr, err);
    lf_image_free(image);
    sum->metric += psnr;
    return status;
}

/* The results are those of the truth's items. */
static lf_status check_results(const lf_speed_truth *t, const lf_raw *exact, const lf_raw *raw,
                               lf_error *err)
{
    bool same = raw->items == t->items && exact->items == t->items;
    for (long i = 0; same && i < t->items; i++) {
        const lf_image *image = t->item[i].image;
        same = raw->item[i].numbers == exact->item[i].numbers &&
               !raw->item[i].mesh == t->rendering && !exact->item[i].mesh == t->rendering &&
               (!image || raw->item[i].numbers == 3L * image->width * image->height);
    }
    return same ? LF_OK
                : lf_fail(err, LF_FAILED,
                          "the results of two settings are not of the same items; did the data "
                          "change meanwhile?");
}

static void finish(const lf_speed_truth *t, const differences *d, lf_speed_figures *f)
{
    const double items = (double)t->items, count = (double)(d->count ? d->count : 1);
    f->work /= items;
    f->metric /= items;
    f->point_mean = d->sum / count;
    f->point_largest = d->largest;
    f->unseen = (double)d->lost / (double)(d->known ? d->known : 1);
    f->chamfer = t->rendering ? NAN : f->chamfer / items;
    f->error = t->rendering ? sqrt(d->squares / count) : f->error / items;
}

lf_status lf_speed_score(const lf_speed_truth *t, const lf_raw *exact, const lf_raw *raw,
                         lf_speed_figures *out, lf_error *err)
{
    lf_speed_figures f = {.seconds = NAN, .cpu_seconds = NAN, .memory_mb = NAN, .peak_mb = NAN};
    differences d = {0};
    LF_TRY(check_results(t, exact, raw, err));
    for (long i = 0; i < t->items; i++) {
        const lf_raw_item *item = &raw->item[i];
        LF_TRY(t->rendering ? score_picture(t, i, item, &f, err)
                            : score_shape(t, i, &exact->item[i], item, &f, err));
        compare_numbers(&exact->item[i], item, &d);
        f.work += item->work;
    }
    finish(t, &d, &f);
    *out = f;
    return LF_OK;
}
