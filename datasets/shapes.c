/* shapes.c: see shapes.h. */
#include "datasets/category.h"
#include "datasets/procedural.h"
#include "datasets/shapes.h"

/* Built-in splits are disjoint ranges of indices of one family. */
enum { VAL_FIRST = 1000000, TEST_FIRST = 2000000, SHAPE_SEED = 1 };
static const double file_thickness = 0.004;

typedef struct item {
    char *id, *path; /* path NULL: built-in */
    long builtin;    /* index in the family */
    float (*samples)[4];
    lf_shape_views *views; /* [draws] */
    uint8_t *images;       /* of all draws */
    long doubtful;
} item;

struct lf_shapes {
    lf_shapes_options options;
    char *root, *category, *split;
    item *item;
    long count;
};

static long image_bytes(const lf_shapes *s)
{
    return lf_views_floats(&s->options.views);
}

static long sample_count(const lf_shapes *s)
{
    return s->options.points_uniform + s->options.points_near;
}

static char *copy_text(const char *text)
{
    char *copy = strdup(text);
    LF_REQUIRE(copy, "out of memory for a name");
    return copy;
}

static item *grow(lf_shapes *s, long more)
{
    s->item = realloc(s->item, (size_t)(s->count + more) * sizeof *s->item);
    LF_REQUIRE(s->item, "out of memory for %ld shapes", s->count + more);
    item *first = s->item + s->count;
    memset(first, 0, (size_t)more * sizeof *first);
    s->count += more;
    return first;
}

static long first_builtin(const char *split)
{
    return strcmp(split, "train") == 0 ? 0 : strcmp(split, "val") == 0 ? VAL_FIRST : TEST_FIRST;
}

static void add_builtin(lf_shapes *s)
{
    const long n = s->options.builtin, from = first_builtin(s->split);
    item *x = n > 0 ? grow(s, n) : NULL;
    for (long i = 0; i < n; i++) {
        char id[64];
        snprintf(id, sizeof id, "%s-%s-%04ld", s->category, s->split, i);
        x[i].id = copy_text(id);
        x[i].builtin = from + i;
    }
}

static lf_status add_files(lf_shapes *s, lf_error *err)
{
    lf_category *category;
    LF_TRY(lf_category_open(s->root, s->category, s->split, &category, err));
    const long limit = s->options.limit;
    const long n = limit > 0 && category->count > limit ? limit : category->count;
    item *x = grow(s, n);
    for (long i = 0; i < n; i++) {
        x[i].id = copy_text(category->item[i].id);
        x[i].path = copy_text(category->item[i].path);
    }
    lf_category_close(category);
    return LF_OK;
}

/* LF_BAD_INPUT with the known families unless this is one. */
static lf_status known_family(const char *category, lf_error *err)
{
    lf_mesh *mesh;
    LF_TRY(lf_procedural_mesh(category, SHAPE_SEED, 0, &mesh, NULL, err));
    lf_mesh_free(mesh);
    return LF_OK;
}

lf_status lf_shapes_open(const lf_shapes_options *options, lf_shapes **out, lf_error *err)
{
    lf_shapes *s = calloc(1, sizeof *s);
    LF_REQUIRE(s, "out of memory for a list of shapes");
    s->options = *options;
    s->root = copy_text(options->root);
    s->category = copy_text(options->category);
    s->split = copy_text(options->split);
    if (s->options.draws < 1 || options->views.setting == LF_SETTING_I)
        s->options.draws = 1;
    const bool builtin = strcmp(s->root, LF_BUILTIN) == 0;
    lf_status status = LF_OK;
    if (builtin || options->builtin > 0)
        status = known_family(s->category, err);
    if (status == LF_OK && builtin && options->builtin < 1)
        status = lf_fail(err, LF_BAD_INPUT,
                         "%s %s: the split %s has no shapes; say how many with data.%s_shapes",
                         s->root, s->category, s->split, s->split);
    if (status == LF_OK && !builtin)
        status = add_files(s, err);
    if (status != LF_OK) {
        lf_shapes_close(s);
        return status;
    }
    if (builtin || strcmp(s->split, "train") == 0)
        add_builtin(s);
    *out = s;
    return LF_OK;
}

void lf_shapes_close(lf_shapes *s)
{
    if (!s)
        return;
    for (long i = 0; i < s->count; i++) {
        free(s->item[i].id);
        free(s->item[i].path);
        free(s->item[i].samples);
        free(s->item[i].views);
        free(s->item[i].images);
    }
    free(s->item);
    free(s->root);
    free(s->category);
    free(s->split);
    free(s);
}

long lf_shapes_count(const lf_shapes *s)
{
    return s->count;
}

const char *lf_shapes_id(const lf_shapes *s, long index)
{
    return s->item[index].id;
}

bool lf_shapes_is_builtin(const lf_shapes *s, long index)
{
    return s->item[index].path == NULL;
}

size_t lf_shapes_bytes(const lf_shapes *s)
{
    const size_t views =
        (size_t)s->options.draws * ((size_t)image_bytes(s) + sizeof(lf_shape_views));
    return (size_t)s->count * (views + (size_t)sample_count(s) * 4 * sizeof(float));
}

/* ---- one shape ---- */

static lf_status load_mesh(const lf_shapes *s, const item *x, lf_mesh **mesh, lf_error *err)
{
    if (!x->path)
        return lf_procedural_mesh(s->category, SHAPE_SEED, (uint64_t)x->builtin, mesh, NULL, err);
    LF_TRY(lf_mesh_read(x->path, mesh, NULL, err));
    const lf_status status = lf_mesh_normalise(*mesh, err);
    if (status == LF_OK)
        return LF_OK;
    lf_mesh_free(*mesh);
    return lf_error_context(err, status, "%s", x->path);
}

lf_status lf_shapes_load(const lf_shapes *s, long index, lf_shape *out, lf_error *err)
{
    const item *x = &s->item[index];
    lf_shape shape = {0};
    LF_TRY(load_mesh(s, x, &shape.mesh, err));
    double low[3], high[3];
    lf_mesh_bounds(shape.mesh, low, high);
    for (int a = 0; a < 3; a++)
        if (high[a] - low[a] > shape.longest_edge)
            shape.longest_edge = high[a] - low[a];
    lf_sdf_options sdf = lf_sdf_defaults();
    sdf.method = s->options.sign;
    sdf.thickness = s->options.thickness >= 0 ? s->options.thickness : x->path ? file_thickness : 0;
    lf_status status = lf_surface_open(shape.mesh, &shape.surface, err);
    if (status == LF_OK)
        status = lf_sdf_open(shape.mesh, &sdf, &shape.sdf, err);
    if (status != LF_OK) {
        lf_shape_release(&shape);
        return lf_error_context(err, status, "%s", x->path ? x->path : x->id);
    }
    *out = shape;
    return LF_OK;
}

void lf_shape_release(lf_shape *shape)
{
    lf_sdf_close(shape->sdf);
    lf_surface_close(shape->surface);
    lf_mesh_free(shape->mesh);
    *shape = (lf_shape){0};
}

lf_status lf_shapes_render_views(const lf_shapes *s, const lf_shape *shape, lf_shape_views *views,
                                 uint8_t *images, lf_error *err)
{
    const long n = image_bytes(s);
    float *pixels = malloc((size_t)n * sizeof *pixels);
    LF_REQUIRE(pixels, "out of memory for views of %ld numbers", n);
    const lf_status status = lf_views_render(shape->surface, &s->options.views, views->camera,
                                             views->object, pixels, err);
    for (long i = 0; status == LF_OK && i < n; i++) {
        const float v = pixels[i] < 0 ? 0 : pixels[i] > 1 ? 1 : pixels[i];
        images[i] = (uint8_t)(v * 255.0f + 0.5f);
    }
    views->images = images;
    free(pixels);
    return status;
}

lf_status lf_shapes_render(const lf_shapes *s, const lf_shape *shape, long index, long draw,
                           lf_shape_views *out, uint8_t *images, lf_error *err)
{
    lf_setting_draw(s->options.views.setting, s->options.views.size, s->options.seed,
                    (uint64_t)draw, lf_name_hash(s->item[index].id), out->camera, out->object);
    return lf_shapes_render_views(s, shape, out, images, err);
}

/* ---- all shapes ---- */

static lf_status prepare_item(lf_shapes *s, long index, lf_error *err)
{
    item *x = &s->item[index];
    const long draws = s->options.draws, bytes = image_bytes(s);
    lf_shape shape;
    LF_TRY(lf_shapes_load(s, index, &shape, err));
    x->samples = malloc((size_t)sample_count(s) * sizeof *x->samples);
    x->views = malloc((size_t)draws * sizeof *x->views);
    x->images = malloc((size_t)(draws * bytes));
    LF_REQUIRE(x->samples && x->views && x->images, "out of memory for %ld views", draws);
    lf_sdf_samples(shape.sdf, s->options.points_uniform, s->options.points_near, s->options.seed,
                   lf_name_hash(x->id), x->samples, &x->doubtful);
    lf_status status = LF_OK;
    for (long d = 0; d < draws && status == LF_OK; d++)
        status = lf_shapes_render(s, &shape, index, d, &x->views[d], x->images + d * bytes, err);
    lf_shape_release(&shape);
    return status;
}

lf_status lf_shapes_prepare(lf_shapes *s, lf_shapes_progress *progress, void *context,
                            lf_error *err)
{
    lf_status first = LF_OK;
    long done = 0, failed = s->count;
#pragma omp parallel for schedule(dynamic, 1)
    for (long i = 0; i < s->count; i++) {
        lf_error mine;
        lf_status status = LF_OK;
        bool skip;
#pragma omp atomic read
        skip = first;
        if (!skip)
            status = prepare_item(s, i, &mine);
#pragma omp critical
        {
            if (status != LF_OK && i < failed) {
                first = status;
                failed = i;
                if (err)
                    *err = mine;
            }
            done++;
            if (progress && first == LF_OK)
                progress(context, done, s->count);
        }
    }
    return first;
}

void lf_shapes_doubtful(const lf_shapes *s, long *doubtful, long *samples)
{
    *doubtful = 0;
    for (long i = 0; i < s->count; i++)
        *doubtful += s->item[i].doubtful;
    *samples = s->count * sample_count(s);
}

const float (*lf_shapes_samples(const lf_shapes *s, long index))[4]
{
    return (const float(*)[4])s->item[index].samples;
}

const lf_shape_views *lf_shapes_views(const lf_shapes *s, long index, long draw)
{
    return &s->item[index].views[draw % s->options.draws];
}

void lf_shapes_pixels(const uint8_t *images, long n, float *out)
{
    for (long i = 0; i < n; i++)
        out[i] = (float)images[i] * (1.0f / 255.0f);
}
