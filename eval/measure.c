/* measure.c: see measure.h. */
#include <malloc.h>
#include <math.h>
#include <time.h>

#include "eval/measure.h"
#include "eval/metrics.h"
#include "eval/raw_results.h"

/* ---- memory -----------------------------------------------------------------------------------
 */

/* Let the largest resident set count from here; false: the system cannot. */
static bool reset_peak(void)
{
#ifdef __GLIBC__
    malloc_trim(0);
#endif
    FILE *file = fopen("/proc/self/clear_refs", "w");
    if (!file)
        return false;
    const bool written = fputs("5", file) >= 0;
    return fclose(file) == 0 && written;
}

/* A field of /proc/self/status, in kB there; 10^6 bytes, or NaN without /proc. VmHWM is the largest
 * resident set, which a reset brings down, unlike ru_maxrss. */
static double resident_mb(const char *field)
{
    FILE *file = fopen("/proc/self/status", "r");
    const size_t length = strlen(field);
    char line[256];
    double kib = NAN;
    while (file && fgets(line, sizeof line, file))
        if (strncmp(line, field, length) == 0)
            kib = strtod(line + length, NULL);
    if (file)
        fclose(file);
    return kib * 1024e-6;
}

/* Of all threads of this process so far. */
static double cpu_now(void)
{
    struct timespec t = {0};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void start_item(lf_raw *raw, lf_raw_item *item)
{
    raw->whole_process |= !reset_peak();
    item->before_mb = resident_mb("VmRSS:");
    item->cpu_seconds = -cpu_now();
}

static void end_item(lf_raw_item *item)
{
    item->cpu_seconds += cpu_now();
    item->peak_mb = resident_mb("VmHWM:");
}

/* ---- reconstruction --------------------------------------------------------------------------
 */

/* The distances at fixed points of the shape's cube. */
static void measure_points(lf_loaded *l, const lf_shape_views *views, const double low[3],
                           const double high[3], double edge, lf_raw_item *item)
{
    enum { N = LF_MEASURE_POINTS };
    const lf_metric_options options = {.samples = N};
    double(*point)[3] = calloc(N, sizeof *point);
    lf_real *sdf = calloc(N, sizeof *sdf);
    uint8_t *valid = calloc(N, 1);
    item->numbers = N;
    item->number = calloc(N, sizeof *item->number);
    LF_REQUIRE(point && sdf && valid && item->number, "out of memory for %d points", (int)N);
    lf_metric_points(low, high, &options, point);
    lf_loaded_predict(l, views, N, (const double(*)[3])point, sdf, valid);
    for (int i = 0; i < N; i++)
        item->number[i] = valid[i] ? (double)sdf[i] / edge : NAN;
    free(point);
    free(sdf);
    free(valid);
}

static lf_status measure_shape(lf_loaded *l, const lf_shapes *shapes, long index, uint8_t *images,
                               lf_raw *raw, lf_error *err)
{
    lf_raw_item *item = &raw->item[index];
    lf_shape shape;
    lf_shape_views views;
    double low[3], high[3];
    LF_TRY(lf_shapes_load(shapes, index, &shape, err));
    const lf_status made = lf_shapes_render(shapes, &shape, index, 0, &views, images, err);
    const double edge = shape.longest_edge;
    lf_mesh_bounds(shape.mesh, low, high);
    lf_shape_release(&shape);
    if (made != LF_OK)
        return made;
    start_item(raw, item);
    lf_predicted p;
    LF_TRY(lf_predicted_mesh(l, &views, edge, false, &p, err));
    end_item(item);
    item->seconds = p.seconds;
    item->work = (double)p.iso.evaluations;
    item->mesh = p.mesh;
    measure_points(l, &views, low, high, edge, item);
    return LF_OK;
}

lf_status lf_measure_shapes(lf_loaded *l, const lf_measure_options *o, lf_error *err)
{
    const lf_recon_config *c = &l->model.config;
    lf_shapes *shapes;
    LF_TRY(lf_evaluated_shapes(l->cfg, o->split, o->setting, NULL, &shapes, err));
    const long there = lf_shapes_count(shapes);
    lf_raw *raw = lf_raw_create(o->items > 0 && o->items < there ? o->items : there);
    uint8_t *images =
        malloc((size_t)(LF_CUBE_VIEWS * c->image_size * c->image_size * c->backbone.in_channels));
    LF_REQUIRE(images, "out of memory for views");
    snprintf(raw->precision, sizeof raw->precision, "%s", LF_REAL_NAME);
    lf_status status = LF_OK;
    for (long i = 0; status == LF_OK && i < raw->items; i++)
        status = measure_shape(l, shapes, i, images, raw, err);
    if (status == LF_OK)
        status = lf_raw_write(o->file, raw, err);
    lf_raw_free(raw);
    free(images);
    lf_shapes_close(shapes);
    return status;
}

/* ---- rendering --------------------------------------------------------------------------------
 */

static lf_status measure_view(lf_loaded_renderer *l, const lf_render_item *view, lf_raw *raw,
                              lf_raw_item *item, lf_error *err)
{
    const lf_render_view_options options = {.sources = lf_render_sources(l)};
    lf_render_view v;
    LF_TRY(lf_render_view_open(view->entry, view->target, &options, &v, err));
    start_item(raw, item);
    lf_rendering r = lf_render_whole(l, &v);
    end_item(item);
    item->seconds = r.seconds;
    item->work = (double)r.rows;
    item->numbers = 3L * v.camera.width * v.camera.height;
    item->number = malloc((size_t)item->numbers * sizeof *item->number);
    LF_REQUIRE(item->number, "out of memory for %ld colours", item->numbers);
    for (long i = 0; i < item->numbers; i++)
        item->number[i] = (double)r.colour[i];
    lf_rendering_free(&r);
    lf_render_view_release(&v);
    return LF_OK;
}

lf_status lf_measure_views(lf_loaded_renderer *l, const lf_measure_options *o, lf_error *err)
{
    lf_scene_set *set;
    long items;
    LF_TRY(lf_render_job_scenes(l->cfg, o->split, true, &set, err));
    lf_render_item *view = lf_render_items(l->cfg, o->split, o->items, set, &items);
    lf_raw *raw = lf_raw_create(items);
    snprintf(raw->precision, sizeof raw->precision, "%s", LF_REAL_NAME);
    lf_status status = LF_OK;
    for (long i = 0; status == LF_OK && i < items; i++)
        status = measure_view(l, &view[i], raw, &raw->item[i], err);
    if (status == LF_OK)
        status = lf_raw_write(o->file, raw, err);
    lf_raw_free(raw);
    free(view);
    lf_scene_set_close(set);
    return status;
}
