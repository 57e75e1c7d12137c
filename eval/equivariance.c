/* equivariance.c: see equivariance.h.
 *
 * A probe runs the model on views and points and keeps what every layer gives at the points: the
 * backbone's fields and scalar maps are sampled at the projections, so that they can be compared
 * whatever the images did. Under a roll of view v by k eighths the orientations of a field shift by
 * k; scalars stay; vectors turn with the frame.
 */
#include <math.h>

#include "autograd/random.h"
#include "eval/equivariance.h"
#include "eval/report.h"
#include "train/run_dir.h"
#include "train/recon_data.h"

enum { V = LF_CUBE_VIEWS, POINTS = 512, LAYERS = 32, EIGHTHS = 8 };

typedef enum law { SCALAR, FIELD, VECTOR } law;

typedef struct layer {
    char name[48];
    law law;
    long cols; /* numbers a row: FIELD 8 per field, VECTOR 3 rows of `cols` */
    long rows; /* points, or points * views */
    lf_real *value;
} layer;

typedef struct probe {
    int count;
    layer layer[LAYERS];
} probe;

static void probe_free(probe *p)
{
    for (int i = 0; i < p->count; i++)
        free(p->layer[i].value);
    p->count = 0;
}

static void keep(probe *p, law kind, const lf_tensor *t, const char *format, int number)
{
    LF_REQUIRE(p->count < LAYERS, "more than %d layers", LAYERS);
    layer *l = &p->layer[p->count++];
    snprintf(l->name, sizeof l->name, format, number);
    l->law = kind;
    l->cols = lf_cols(t);
    l->rows = kind == VECTOR ? lf_rows(t) / 3 : lf_rows(t);
    l->value = malloc((size_t)t->size * sizeof(lf_real));
    LF_REQUIRE(l->value, "out of memory for %ld numbers", t->size);
    memcpy(l->value, t->value, (size_t)t->size * sizeof(lf_real));
}

/* ---- running the model ---- */

static lf_tensor *image_tensor(lf_tape *tape, const lf_recon *model, const uint8_t *images)
{
    const lf_recon_config *c = &model->config;
    lf_tensor *t =
        lf_tensor_new(tape, 4, LF_DIMS(V, c->image_size, c->image_size, c->backbone.in_channels));
    float *pixels = malloc((size_t)t->size * sizeof *pixels);
    LF_REQUIRE(pixels, "out of memory for %ld pixels", t->size);
    lf_shapes_pixels(images, t->size, pixels);
    for (long i = 0; i < t->size; i++)
        t->value[i] = (lf_real)pixels[i];
    free(pixels);
    return t;
}

/* The backbone's inner maps at the projections. */
static void keep_inner(probe *p, lf_tape *tape, const lf_recon *model, const lf_recon_code *code,
                       const lf_recon_inputs *in)
{
    const long size = model->config.image_size;
    for (int i = 0; i < code->inner_maps; i++) {
        const lf_tensor *t =
            lf_sample_maps(tape, 1, (lf_tensor *const *)code->inner + i, size, size, POINTS, V,
                           in->points->uv, in->rays.mask->value, in->points->first);
        keep(p, model->config.backbone.c8 ? FIELD : SCALAR, t,
             i ? "backbone stage %d" : "backbone stem", i);
    }
}

/* All layers at the projections by `views`; these may come from moved cameras and points. */
static probe run_model(const lf_recon *model, const uint8_t *images, const lf_shape_views *views,
                       const lf_projection *projection)
{
    probe p = {0};
    lf_tape *tape = lf_tape_create();
    lf_tape_set_grad(tape, false);
    lf_seen_grid grid = lf_seen_grid_create(model, 1);
    lf_seen_grid_fill(&grid, 0, views, 0);
    lf_recon_code code;
    lf_recon_encode_images(tape, model, image_tensor(tape, model, images), V,
                           lf_seen_grid_points(&grid), false, &code);
    const lf_recon_points points = lf_seen_points(projection, POINTS);
    const lf_recon_inputs in = lf_recon_look(tape, model, &code, &points);
    keep_inner(&p, tape, model, &code, &in);
    keep(&p, SCALAR, in.seen, "features of the rays", 0);
    if (in.known)
        keep(&p, SCALAR, in.known, "features of the object", 0);
    lf_field kept[LF_RECON_LAYERS];
    const lf_tensor *x = lf_recon_sdf(tape, model, &in, kept);
    for (int b = 0; b < model->layers; b++) {
        keep(&p, SCALAR, kept[b].scalar, b ? "block %d, scalars" : "convolution, scalars", b - 1);
        if (kept[b].vector)
            keep(&p, VECTOR, kept[b].vector, b ? "block %d, vectors" : "convolution, vectors",
                 b - 1);
    }
    keep(&p, SCALAR, x, "signed distance", 0);
    lf_seen_grid_free(&grid);
    lf_tape_free(tape);
    return p;
}

/* ---- comparing ---- */

typedef struct deviation {
    double largest, sum, size;
    long count;
} deviation;

static void deviate(deviation *d, double a, double b)
{
    const double e = fabs(a - b);
    d->largest = e > d->largest || isnan(e) ? e : d->largest;
    d->sum += e;
    d->size = fabs(b) > d->size ? fabs(b) : d->size;
    d->count++;
}

/* What the transformation did: rotation of the frame, eighth turns of each view. */
typedef struct element {
    lf_motion motion;
    int eighths[V];
} element;

static void compare_row(deviation *d, const layer *before, const layer *after, const element *g,
                        long row)
{
    const long c = before->cols;
    if (before->law == VECTOR) {
        for (long i = 0; i < c; i++) {
            const lf_real *v = before->value + 3 * row * c + i, *w = after->value + 3 * row * c + i;
            double turned[3] = {(double)v[0], (double)v[c], (double)v[2 * c]};
            lf_rotation_apply(g->motion.rotation, turned, turned);
            for (int a = 0; a < 3; a++)
                deviate(d, (double)w[a * c], turned[a]);
        }
        return;
    }
    const int shift = before->law == FIELD ? g->eighths[row % V] : 0;
    for (long i = 0; i < c; i++) {
        const long j = before->law == FIELD ? i / EIGHTHS * EIGHTHS + (i + shift) % EIGHTHS : i;
        deviate(d, (double)after->value[row * c + j], (double)before->value[row * c + i]);
    }
}

static void compare(deviation *d, const probe *before, const probe *after, const element *g)
{
    for (int l = 0; l < before->count; l++)
        for (long r = 0; r < before->layer[l].rows; r++)
            compare_row(&d[l], &before->layer[l], &after->layer[l], g, r);
}

/* ---- the transformations ---- */

typedef struct subject {
    lf_loaded *loaded;
    const lf_shapes *shapes;
    lf_shape shape;
    lf_shape_views views;
    uint8_t *images, *turned;
    double (*point)[3];
    lf_projection projection;
    probe before;
} subject;

static element no_element(void)
{
    element g = {0};
    lf_rotation_identity(g.motion.rotation);
    return g;
}

/* Cameras and points moved by g; the images stay. */
static void try_motion(subject *s, lf_stream *stream, deviation *d)
{
    element g = no_element();
    g.motion = lf_motion_random(stream, 1000);
    lf_shape_views moved = s->views;
    double(*point)[3] = calloc(POINTS, sizeof *point);
    LF_REQUIRE(point, "out of memory for %d points", POINTS);
    for (int v = 0; v < V; v++)
        moved.camera[v] = lf_camera_move(&s->views.camera[v], &g.motion);
    for (int i = 0; i < POINTS; i++)
        lf_motion_apply(&g.motion, s->point[i], point[i]);
    lf_projection_fill(&s->projection, 0, POINTS, (const double(*)[3])point, &moved, 0);
    probe after = run_model(&s->loaded->model, s->images, &moved, &s->projection);
    compare(d, &s->before, &after, &g);
    probe_free(&after);
    free(point);
}

/* One image turned by a quarter: the camera rolled by +90 degrees sees the picture turned
 * counter-clockwise; new (column, row) = old (size - 1 - row, column). */
static void turn_quarter(const uint8_t *from, uint8_t *to, long size, long channels)
{
    for (long row = 0; row < size; row++)
        for (long column = 0; column < size; column++)
            memcpy(to + (row * size + column) * channels,
                   from + (column * size + size - 1 - row) * channels, (size_t)channels);
}

static void turn_image(uint8_t *image, uint8_t *scratch, long size, long channels, int quarters)
{
    for (int k = 0; k < quarters; k++) {
        turn_quarter(image, scratch, size, channels);
        memcpy(image, scratch, (size_t)(size * size * channels));
    }
}

/* Every view rolled by its own multiple of 90 degrees (extra = 0) or that and 45 degrees (1). */
static lf_status try_roll(subject *s, lf_stream *stream, int extra, deviation *d, lf_error *err)
{
    const lf_recon_config *c = &s->loaded->model.config;
    const long size = c->image_size, channels = c->backbone.in_channels;
    const long bytes = size * size * channels;
    element g = no_element();
    lf_shape_views rolled = s->views;
    uint8_t *scratch = malloc((size_t)bytes);
    LF_REQUIRE(scratch, "out of memory for an image");
    memcpy(s->turned, s->images, (size_t)(V * bytes));
    for (int v = 0; v < V; v++) {
        const int quarters = (int)lf_index(stream, 4);
        g.eighths[v] = 2 * quarters + extra;
        rolled.camera[v] = lf_camera_roll(&s->views.camera[v], g.eighths[v] * 0.7853981633974483);
        turn_image(s->turned + v * bytes, scratch, size, channels, quarters);
    }
    free(scratch);
    if (extra)
        LF_TRY(lf_shapes_render_views(s->shapes, &s->shape, &rolled, s->turned, err));
    lf_projection_fill(&s->projection, 0, POINTS, (const double(*)[3])s->point, &rolled, 0);
    probe after = run_model(&s->loaded->model, s->turned, &rolled, &s->projection);
    compare(d, &s->before, &after, &g);
    probe_free(&after);
    return LF_OK;
}

/* ---- the report ---- */

enum { MOTION, QUARTER, EIGHTH, KINDS };
static const char *const kind_name[KINDS] = {"motion", "quarter", "eighth"};

typedef struct table {
    deviation cell[KINDS][LAYERS];
    char name[LAYERS][48];
    int layers;
} table;

static lf_status try_shape(subject *s, long index, long elements, table *t, lf_error *err)
{
    lf_stream stream = lf_stream_at(1, LF_RANDOM_GROUP, 0, (uint64_t)index);
    LF_TRY(lf_shapes_load(s->shapes, index, &s->shape, err));
    LF_TRY(lf_shapes_render(s->shapes, &s->shape, index, 0, &s->views, s->images, err));
    for (int i = 0; i < POINTS; i++) /* within the sphere that every roll shows whole */
        for (int a = 0; a < 3; a++)
            s->point[i][a] = 0.57 * (lf_uniform(&stream) - 0.5);
    lf_projection_fill(&s->projection, 0, POINTS, (const double(*)[3])s->point, &s->views, 0);
    s->before = run_model(&s->loaded->model, s->images, &s->views, &s->projection);
    t->layers = s->before.count;
    for (int l = 0; l < t->layers; l++)
        memcpy(t->name[l], s->before.layer[l].name, sizeof t->name[l]);
    lf_status status = LF_OK;
    for (long n = 0; n < elements && status == LF_OK; n++) {
        try_motion(s, &stream, t->cell[MOTION]);
        status = try_roll(s, &stream, 0, t->cell[QUARTER], err);
        if (status == LF_OK)
            status = try_roll(s, &stream, 1, t->cell[EIGHTH], err);
    }
    probe_free(&s->before);
    lf_shape_release(&s->shape);
    return status;
}

static double relative(const deviation *d, double value)
{
    return d->size > 0 ? value / d->size : value;
}

static void print_table(const table *t, long elements, long shapes)
{
    printf("largest (mean) difference from the transformation law, relative to the layer's largest "
           "value;\n%ld elements of each kind on %ld shapes, %d points\n\n%-24s",
           elements, shapes, POINTS, "layer");
    const char *const heading[KINDS] = {"frame moved", "quarter turns", "eighth turns"};
    for (int k = 0; k < KINDS; k++)
        printf("  %*s", k + 1 < KINDS ? -17 : 0, heading[k]);
    printf("\n");
    for (int l = 0; l < t->layers; l++) {
        printf("%-24s", t->name[l]);
        for (int k = 0; k < KINDS; k++) {
            const deviation *d = &t->cell[k][l];
            printf("  %.1e (%.1e)", relative(d, d->largest),
                   relative(d, d->sum / (double)(d->count ? d->count : 1)));
        }
        printf("\n");
    }
}

static json_t *table_json(const table *t, long elements, long shapes)
{
    json_t *root = json_pack("{s:s, s:I, s:I, s:i}", "experiment", "equivariance", "elements",
                             (json_int_t)elements, "shapes", (json_int_t)shapes, "points", POINTS);
    json_t *layers = json_array();
    for (int l = 0; l < t->layers; l++) {
        json_t *row = json_pack("{s:s}", "layer", t->name[l]);
        for (int k = 0; k < KINDS; k++) {
            const deviation *d = &t->cell[k][l];
            json_t *cell = json_object(); /* a NaN stands as null: it must not vanish */
            lf_json_real(cell, "largest", relative(d, d->largest));
            lf_json_real(cell, "mean", relative(d, d->sum / (double)(d->count ? d->count : 1)));
            json_object_set_new(row, kind_name[k], cell);
        }
        json_array_append_new(layers, row);
    }
    json_object_set_new(root, "layers", layers);
    return root;
}

static lf_status finish(const table *t, const lf_equivariance_options *o, long shapes,
                        lf_error *err)
{
    if (!o->quiet)
        print_table(t, o->elements, shapes);
    if (!o->json)
        return LF_OK;
    json_t *json = table_json(t, o->elements, shapes);
    const lf_status status = lf_json_write(o->json, json, err);
    json_decref(json);
    return status;
}

static lf_status check_shapes(subject *s, const lf_equivariance_options *o, lf_error *err)
{
    table *t = calloc(1, sizeof *t);
    LF_REQUIRE(t, "out of memory for a table");
    const long count = lf_shapes_count(s->shapes), shapes = o->shapes < count ? o->shapes : count;
    lf_status status = LF_OK;
    for (long i = 0; i < shapes && status == LF_OK; i++)
        status = try_shape(s, i, o->elements, t, err);
    if (status == LF_OK)
        status = finish(t, o, shapes, err);
    free(t);
    return status;
}

lf_status lf_check_equivariance(lf_loaded *loaded, const lf_equivariance_options *options,
                                lf_error *err)
{
    const lf_recon_config *c = &loaded->model.config;
    const size_t bytes = (size_t)(V * c->image_size * c->image_size * c->backbone.in_channels);
    lf_shapes_options data = lf_shapes_options_from(loaded->cfg, options->split);
    data.views.setting = LF_SETTING_I;
    lf_shapes *shapes;
    LF_TRY(lf_shapes_open(&data, &shapes, err));
    subject s = {.loaded = loaded,
                 .shapes = shapes,
                 .images = malloc(bytes),
                 .turned = malloc(bytes),
                 .point = calloc(POINTS, sizeof *s.point),
                 .projection = lf_projection_create(POINTS)};
    LF_REQUIRE(s.images && s.turned && s.point, "out of memory for views");
    const lf_status status = check_shapes(&s, options, err);
    lf_projection_free(&s.projection);
    free(s.images);
    free(s.turned);
    free(s.point);
    lf_shapes_close(shapes);
    return status;
}
