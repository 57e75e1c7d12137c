/* compare_shapes.c: the rows of compare-runs for reconstruction: a shape in a setting each. */
#include "eval/compare_runs.h"
#include "eval/evaluate.h"
#include "eval/metrics.h"
#include "eval/montage.h"

enum { V = LF_CUBE_VIEWS, SETTINGS = 5, EDGE = 144 };

/* What the first run of a part saw, and all others must see. */
typedef struct seen {
    char *id;
    lf_camera camera[V];
} seen;

typedef struct block {
    const lf_compare_runs_options *o;
    lf_picture_table *table;
    int settings;
    char *setting[SETTINGS]; /* NULL: the training's */
    long first, items;       /* row of the table; shapes */
    seen *seen;              /* [items][settings] */
    const char *run, *leader;
    lf_setting trained, used[SETTINGS]; /* of the leader */
    bool mixed;                         /* not all were trained in one setting */
} block;

/* One run on one shape in one setting. */
typedef struct sample {
    lf_loaded *loaded;
    const lf_shapes *shapes;
    lf_shape shape;
    lf_shape_views views;
    uint8_t *images;
    lf_mesh *truth;
    lf_predicted predicted;
} sample;

static long row_of(const block *b, long item, int setting)
{
    return b->first + item * b->settings + setting;
}

/* ---- cells ---- */

static void put_views(const block *b, const sample *s, long row)
{
    const lf_recon_config *c = &s->loaded->model.config;
    const long n = V * c->image_size * c->image_size * c->backbone.in_channels;
    float *pixels = malloc((size_t)n * sizeof *pixels);
    LF_REQUIRE(pixels, "out of memory for %ld pixels", n);
    lf_shapes_pixels(s->images, n, pixels);
    const lf_montage_row views = {.views = V,
                                  .size = (int)c->image_size,
                                  .channels = c->backbone.in_channels,
                                  .images = pixels};
    for (int i = 0; i < LF_SHAPE_VIEWS; i++)
        lf_picture_table_put(b->table, row, i,
                             lf_montage_view(&views, i * V / LF_SHAPE_VIEWS, EDGE));
    free(pixels);
}

static lf_status put_mesh(const block *b, const sample *s, long row, int column, long item,
                          lf_error *err)
{
    lf_metric_options metric = lf_metric_defaults();
    lf_score score;
    lf_image *picture;
    metric.samples = lf_config_int(s->loaded->cfg, "eval.points");
    metric.item = (uint64_t)item;
    LF_TRY(lf_score_meshes(s->predicted.mesh, s->truth, s->shape.sdf, &metric, &score, err));
    LF_TRY(lf_montage_mesh(s->predicted.mesh, LF_MONTAGE_PREDICTED, 0, EDGE, &picture, err));
    lf_picture_table_put(b->table, row, LF_SHAPE_VIEWS + column, picture);
    if (s->predicted.mesh->faces)
        lf_picture_table_note(b->table, row, LF_SHAPE_VIEWS + column, "IoU %.3f", score.iou);
    else
        lf_picture_table_note(b->table, row, LF_SHAPE_VIEWS + column, "empty");
    return LF_OK;
}

static lf_status put_truth(const block *b, const sample *s, long row, lf_error *err)
{
    lf_image *picture;
    LF_TRY(lf_montage_mesh(s->truth, LF_MONTAGE_TRUE, 0, EDGE, &picture, err));
    lf_picture_table_put(b->table, row, b->table->columns - 1, picture);
    return LF_OK;
}

/* ---- one run ---- */

static bool same_pose(const lf_camera *a, const lf_camera *b)
{
    return memcmp(a->rotation, b->rotation, sizeof a->rotation) == 0 &&
           memcmp(a->centre, b->centre, sizeof a->centre) == 0;
}

/* The leader says what is seen; what the others see is compared. */
static lf_status check_seen(block *b, const sample *s, long item, int setting, lf_error *err)
{
    seen *x = &b->seen[item * b->settings + setting];
    const char *id = lf_shapes_id(s->shapes, item);
    if (b->run == b->leader) {
        x->id = strdup(id);
        LF_REQUIRE(x->id, "out of memory");
        memcpy(x->camera, s->views.camera, sizeof x->camera);
        return LF_OK;
    }
    if (strcmp(id, x->id) != 0)
        return lf_fail(err, LF_BAD_INPUT, "shape %ld is %s, and %s of %s: their data differ", item,
                       id, x->id, b->leader);
    for (int v = 0; v < V; v++)
        if (!same_pose(&s->views.camera[v], &x->camera[v]))
            return lf_fail(err, LF_BAD_INPUT, "sees %s from other cameras than %s", id, b->leader);
    return LF_OK;
}

static lf_status show_sample(block *b, sample *s, int column, long item, int setting, lf_error *err)
{
    const long row = row_of(b, item, setting);
    LF_TRY(lf_shapes_load(s->shapes, item, &s->shape, err));
    LF_TRY(lf_shapes_render(s->shapes, &s->shape, item, 0, &s->views, s->images, err));
    LF_TRY(check_seen(b, s, item, setting, err));
    LF_TRY(
        lf_predicted_mesh(s->loaded, &s->views, s->shape.longest_edge, false, &s->predicted, err));
    LF_TRY(lf_true_mesh(s->loaded->cfg, &s->shape, &s->truth, err));
    LF_TRY(put_mesh(b, s, row, column, item, err));
    if (b->run != b->leader)
        return LF_OK;
    put_views(b, s, row);
    return put_truth(b, s, row, err);
}

static lf_status show_shape(block *b, lf_loaded *loaded, const lf_shapes *shapes, int column,
                            long item, int setting, lf_error *err)
{
    const lf_recon_config *c = &loaded->model.config;
    sample s = {.loaded = loaded, .shapes = shapes};
    s.images = malloc((size_t)(V * c->image_size * c->image_size * c->backbone.in_channels));
    LF_REQUIRE(s.images, "out of memory for views");
    const lf_status status = show_sample(b, &s, column, item, setting, err);
    lf_mesh_free(s.predicted.mesh);
    lf_mesh_free(s.truth);
    lf_shape_release(&s.shape);
    free(s.images);
    return status;
}

/* The leader's shapes make the rows. */
static lf_status take_rows(block *b, const lf_shapes *shapes, lf_error *err)
{
    const long there = lf_shapes_count(shapes);
    if (b->run != b->leader)
        return there >= b->items
                   ? LF_OK
                   : lf_fail(err, LF_BAD_INPUT, "has %ld shapes and %s more", there, b->leader);
    if (b->seen)
        return LF_OK;
    b->items = b->o->items < there ? b->o->items : there;
    b->first = lf_picture_table_add(b->table, b->items * b->settings);
    b->seen = calloc((size_t)(b->items * b->settings) + 1, sizeof *b->seen);
    LF_REQUIRE(b->seen, "out of memory");
    return LF_OK;
}

static lf_status show_setting(block *b, lf_loaded *loaded, int column, int setting, lf_error *err)
{
    lf_shapes *shapes;
    LF_TRY(lf_evaluated_shapes(loaded->cfg, b->o->split, b->setting[setting], &b->used[setting],
                               &shapes, err));
    lf_status status = take_rows(b, shapes, err);
    for (long i = 0; status == LF_OK && i < b->items; i++)
        status = show_shape(b, loaded, shapes, column, i, setting, err);
    lf_shapes_close(shapes);
    return status;
}

static lf_status show_run(block *b, int column, lf_error *err)
{
    lf_loaded loaded;
    LF_TRY(lf_loaded_open(b->run, b->o->sets, b->o->set, &loaded, err));
    if (b->run == b->leader)
        b->trained = loaded.trained;
    b->mixed |= loaded.trained != b->trained;
    lf_status status = LF_OK;
    for (int s = 0; status == LF_OK && s < b->settings; s++)
        status = show_setting(b, &loaded, column, s, err);
    lf_loaded_close(&loaded);
    return status;
}

/* ---- a part ---- */

static void finish_rows(block *b, int part)
{
    for (long i = 0; i < b->items; i++)
        for (int s = 0; s < b->settings; s++) {
            const char *id = b->seen[i * b->settings + s].id, *in = lf_setting_name(b->used[s]);
            if (b->mixed)
                lf_picture_table_caption(b->table, row_of(b, i, s), "%s   seen in %s", id, in);
            else
                lf_picture_table_caption(b->table, row_of(b, i, s),
                                         "%s   trained in %s, seen in %s", id,
                                         lf_setting_name(b->trained), in);
            for (int c = 0; c < b->o->runs->columns; c++)
                if (!lf_run_at(b->o->runs, c, part))
                    lf_picture_table_note(b->table, row_of(b, i, s), LF_SHAPE_VIEWS + c, "not run");
        }
}

static lf_status show_part(const block *from, int part, lf_error *err)
{
    block b = *from;
    const lf_run_columns *runs = b.o->runs;
    b.leader = lf_run_first(runs, part);
    lf_status status = LF_OK;
    for (int c = 0; status == LF_OK && c < runs->columns; c++) {
        b.run = lf_run_at(runs, c, part);
        if (!b.run)
            continue;
        if (!b.o->quiet)
            printf("%s\n", b.run);
        status = show_run(&b, c, err);
        if (status != LF_OK)
            lf_error_context(err, status, "%s", b.run);
    }
    if (status == LF_OK)
        finish_rows(&b, part);
    for (long i = 0; b.seen && i < b.items * b.settings; i++)
        free(b.seen[i].id);
    free(b.seen);
    return status;
}

/* "I,Z" into its parts, which point into `text`; NULL is one setting, the training's. */
static lf_status parse_settings(block *b, char *text, lf_error *err)
{
    lf_setting setting;
    b->settings = text ? 0 : 1;
    for (char *at = text; at; b->settings++) {
        if (b->settings == SETTINGS)
            return lf_fail(err, LF_BAD_INPUT, "--setting: more than %d", (int)SETTINGS);
        b->setting[b->settings] = at;
        at = strchr(at, ',');
        if (at)
            *at++ = 0;
        LF_TRY(lf_setting_parse(b->setting[b->settings], &setting, err));
    }
    return LF_OK;
}

lf_status lf_compare_shapes(const lf_compare_runs_options *o, lf_picture_table *table,
                            lf_error *err)
{
    block b = {.o = o, .table = table};
    char *text = o->settings ? strdup(o->settings) : NULL;
    LF_REQUIRE(text || !o->settings, "out of memory");
    lf_status status = parse_settings(&b, text, err);
    for (int p = 0; status == LF_OK && p < o->runs->parts; p++)
        status = show_part(&b, p, err);
    free(text);
    return status;
}
