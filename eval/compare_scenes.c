/* compare_scenes.c: the rows of compare-runs for renderers: a view as it is, with the frame turned,
 * and what that changed. */
#include <math.h>

#include "eval/colour_map.h"
#include "eval/compare_runs.h"
#include "eval/file_names.h"
#include "eval/image_metrics.h"
#include "eval/render_job.h"
#include "eval/render_montage.h"
#include "models/checkpoint.h"
#include "train/run_dir.h"

enum { PLAIN, TURNED, CHANGE, ROWS }; /* of a view */

#define CHANGE_MOST 0.04 /* where the colours of the change end; colours go to 1 */

typedef struct block {
    const lf_compare_runs_options *o;
    lf_picture_table *table;
    long first, items;
    lf_image **truth; /* [items] of the leader; the table's */
    const char *run, *leader;
} block;

/* One run at work. */
typedef struct rendering_run {
    lf_loaded_renderer *loaded;
    const lf_scene_set *set;
    char **scene; /* names */
    int column;
} rendering_run;

/* ---- one view ---- */

static lf_status render(const rendering_run *r, const lf_render_item *item, const lf_motion *motion,
                        lf_image **out, lf_error *err)
{
    const lf_render_view_options o = {.sources = lf_render_sources(r->loaded), .motion = motion};
    lf_render_view v;
    LF_TRY(lf_render_view_open(item->entry, item->target, &o, &v, err));
    lf_rendering whole = lf_render_whole(r->loaded, &v);
    lf_render_view_release(&v);
    *out = whole.image;
    whole.image = NULL;
    lf_rendering_free(&whole);
    return LF_OK;
}

/* What turning changed, coloured, and its mean over pixels and channels. */
static lf_status change_of(const lf_image *a, const lf_image *b, lf_image **out, double *mean,
                           lf_error *err)
{
    lf_image *map;
    LF_TRY(lf_image_error_map(a, b, &map, err));
    const long n = (long)map->width * map->height;
    *out = lf_image_create(map->width, map->height, 3);
    *mean = 0;
    for (long i = 0; i < n; i++) {
        *mean += (double)map->pixel[i] / (double)n;
        lf_colour_at(LF_COLOURS_HEAT, (double)map->pixel[i] / CHANGE_MOST, (*out)->pixel + 3 * i);
    }
    lf_image_free(map);
    return LF_OK;
}

static lf_status put_picture(const block *b, long row, int column, lf_image *image,
                             const lf_image *truth, lf_error *err)
{
    double psnr = NAN;
    const lf_status status = lf_psnr(image, truth, &psnr, err);
    lf_picture_table_put(b->table, row, column, image);
    lf_picture_table_note(b->table, row, column, "%.2f dB", psnr);
    return status;
}

static lf_status show_view(block *b, const rendering_run *r, long item, const lf_render_item *at,
                           lf_error *err)
{
    const long row = b->first + ROWS * item;
    const int column = LF_SCENE_TRUTHS + r->column;
    const lf_motion motion = lf_render_rotation(0);
    lf_image *plain, *turned, *change;
    double mean = 0;
    LF_TRY(render(r, at, NULL, &plain, err));
    LF_TRY(put_picture(b, row + PLAIN, column, plain, b->truth[item], err));
    LF_TRY(render(r, at, &motion, &turned, err));
    LF_TRY(put_picture(b, row + TURNED, column, turned, b->truth[item], err));
    LF_TRY(change_of(plain, turned, &change, &mean, err));
    lf_picture_table_put(b->table, row + CHANGE, column, change);
    lf_picture_table_note(b->table, row + CHANGE, column, "%.2f", 255 * mean);
    return LF_OK;
}

/* ---- one run ---- */

static lf_status true_view(const rendering_run *r, const lf_render_item *item, lf_image **out,
                           lf_error *err)
{
    const lf_render_view_options o = {.sources = lf_render_sources(r->loaded)};
    lf_render_view v;
    LF_TRY(lf_render_view_open(item->entry, item->target, &o, &v, err));
    *out = lf_picture_of(&v.pixels);
    lf_render_view_release(&v);
    return LF_OK;
}

/* The leader's views make the rows; the others' photographs are compared with them. */
static lf_status take_view(block *b, const rendering_run *r, long item, const lf_render_item *at,
                           lf_error *err)
{
    lf_image *truth;
    LF_TRY(true_view(r, at, &truth, err));
    if (b->run != b->leader) {
        const lf_image *first = b->truth[item];
        const bool same = truth->width == first->width && truth->height == first->height &&
                          memcmp(truth->pixel, first->pixel,
                                 (size_t)(3L * truth->width * truth->height) * sizeof(float)) == 0;
        lf_image_free(truth);
        return same ? LF_OK
                    : lf_fail(err, LF_BAD_INPUT, "view %ld is not that of %s: their scenes differ",
                              item, b->leader);
    }
    const long row = b->first + ROWS * item;
    b->truth[item] = truth;
    lf_picture_table_put(b->table, row + PLAIN, 0, truth);
    if (at->entry->builtin) /* whose name says its kind */
        lf_picture_table_caption(b->table, row + PLAIN, "%s: in I", at->entry->scene->folder);
    else
        lf_picture_table_caption(b->table, row + PLAIN, "%s %s: in I",
                                 r->scene[at->entry - r->set->entry],
                                 at->entry->scene->view[at->target].name);
    lf_picture_table_caption(b->table, row + TURNED, "the same with the frame turned: in SO3");
    lf_picture_table_caption(b->table, row + CHANGE,
                             "change: black 0, white %.0f of 255; mean below", 255 * CHANGE_MOST);
    return LF_OK;
}

static lf_status take_rows(block *b, long there, lf_error *err)
{
    if (b->run != b->leader)
        return there >= b->items
                   ? LF_OK
                   : lf_fail(err, LF_BAD_INPUT, "has %ld views and %s more", there, b->leader);
    b->items = b->o->items < there ? b->o->items : there;
    b->first = lf_picture_table_add(b->table, ROWS * b->items);
    b->truth = calloc((size_t)b->items + 1, sizeof(lf_image *));
    LF_REQUIRE(b->truth, "out of memory");
    return LF_OK;
}

static lf_status show_set(block *b, rendering_run *r, lf_error *err)
{
    long there;
    lf_render_item *item = lf_render_items(r->loaded->cfg, b->o->split, 0, r->set, &there);
    r->scene = lf_scene_file_names(r->set);
    lf_status status = take_rows(b, there, err);
    for (long i = 0; status == LF_OK && i < b->items; i++) {
        status = take_view(b, r, i, &item[i], err);
        if (status == LF_OK)
            status = show_view(b, r, i, &item[i], err);
    }
    lf_file_names_free(r->set->count, r->scene);
    free(item);
    return status;
}

/* The config of the checkpoint with the overrides: one view of each scene unless they say more. */
static lf_status config_of(const block *b, const char *checkpoint, lf_config **out, lf_error *err)
{
    lf_config *cfg;
    LF_TRY(lf_checkpoint_config(checkpoint, &cfg, NULL, err));
    lf_status status = lf_config_set(cfg, "eval.views=1", err);
    if (status == LF_OK)
        status = lf_config_set_trained(cfg, b->o->sets, b->o->set, err);
    if (status == LF_OK)
        *out = cfg;
    else
        lf_config_free(cfg);
    return status;
}

static lf_status show_run(block *b, int column, lf_error *err)
{
    lf_found found = {0};
    lf_config *cfg = NULL;
    lf_loaded_renderer loaded = {0};
    lf_scene_set *set = NULL;
    LF_TRY(lf_run_find(b->run, &found, err));
    if (found.note[0])
        fprintf(stderr, "elf-eval: %s\n", found.note);
    lf_status status = config_of(b, found.checkpoint, &cfg, err);
    if (status == LF_OK)
        status = lf_loaded_renderer_open(found.checkpoint, cfg, &loaded, err);
    if (status == LF_OK)
        status = lf_render_job_scenes(loaded.cfg, b->o->split, true, &set, err);
    if (status == LF_OK)
        status = show_set(b, &(rendering_run){&loaded, set, NULL, column}, err);
    lf_scene_set_close(set);
    lf_loaded_renderer_close(&loaded);
    lf_found_free(&found);
    return status;
}

/* ---- a part ---- */

static lf_status show_part(block *b, int part, lf_error *err)
{
    const lf_run_columns *runs = b->o->runs;
    lf_status status = LF_OK;
    b->leader = lf_run_first(runs, part);
    for (int c = 0; status == LF_OK && c < runs->columns; c++) {
        b->run = lf_run_at(runs, c, part);
        if (!b->run)
            continue;
        if (!b->o->quiet)
            printf("%s\n", b->run);
        status = show_run(b, c, err);
        if (status != LF_OK)
            lf_error_context(err, status, "%s", b->run);
    }
    for (int c = 0; status == LF_OK && c < runs->columns; c++)
        for (long i = 0; !lf_run_at(runs, c, part) && i < ROWS * b->items; i++)
            lf_picture_table_note(b->table, b->first + i, LF_SCENE_TRUTHS + c, "not run");
    free(b->truth);
    return status;
}

lf_status lf_compare_scenes(const lf_compare_runs_options *o, lf_picture_table *table,
                            lf_error *err)
{
    for (int p = 0; p < o->runs->parts; p++) {
        block b = {.o = o, .table = table};
        LF_TRY(show_part(&b, p, err));
    }
    return LF_OK;
}
