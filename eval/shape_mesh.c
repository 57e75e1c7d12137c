/* shape_mesh.c: the mesh of a shape, as a model predicts it and as it is. See evaluate.h. */
#include "eval/evaluate.h"
#include "eval/hull.h"
#include "train/progress.h"

/* A model and the views that it sees. */
typedef struct sight {
    lf_loaded *loaded;
    const lf_shape_views *views;
} sight;

static void predicted_field(void *context, long n, const double (*points)[3], float *value,
                            uint8_t *valid)
{
    const sight *s = context;
    lf_real *sdf = malloc((size_t)n * sizeof *sdf);
    LF_REQUIRE(sdf, "out of memory for %ld distances", n);
    lf_loaded_predict(s->loaded, s->views, n, points, sdf, valid);
    for (long i = 0; i < n; i++)
        value[i] = (float)sdf[i];
    free(sdf);
}

static void true_field(void *context, long n, const double (*points)[3], float *value,
                       uint8_t *valid)
{
    const lf_shape *shape = context;
    double *sdf = malloc((size_t)n * sizeof *sdf);
    LF_REQUIRE(sdf, "out of memory for %ld distances", n);
    (void)valid;
    lf_sdf_eval(shape->sdf, n, points, sdf, NULL);
    for (long i = 0; i < n; i++)
        value[i] = (float)sdf[i];
    free(sdf);
}

static lf_iso_options iso_options(const lf_config *cfg, double longest_edge, bool dense)
{
    lf_iso_options o = lf_iso_defaults();
    o.half = 0.55 * longest_edge;
    o.coarse = (int)lf_config_int(cfg, "eval.coarse");
    o.refinements = 0;
    for (long n = o.coarse; n < lf_config_int(cfg, "eval.resolution"); n *= 2)
        o.refinements++;
    o.lipschitz = lf_config_real(cfg, "eval.lipschitz");
    o.dense = dense;
    return o;
}

lf_status lf_predicted_mesh(lf_loaded *loaded, const lf_shape_views *views, double longest_edge,
                            bool dense, lf_predicted *out, lf_error *err)
{
    const lf_iso_options options = iso_options(loaded->cfg, longest_edge, dense);
    sight s = {loaded, views};
    const double start = lf_seconds_now();
    lf_loaded_encode(loaded, views);
    LF_TRY(lf_isosurface(&options, predicted_field, &s, &out->mesh, &out->iso, err));
    out->seconds = lf_seconds_now() - start;
    return LF_OK;
}

lf_status lf_hull_mesh(const lf_loaded *loaded, const lf_shape_views *views, double longest_edge,
                       lf_mesh **out, lf_error *err)
{
    const lf_iso_options options = iso_options(loaded->cfg, longest_edge, true);
    lf_hull hull = {.views = views, .channels = loaded->model.config.backbone.in_channels};
    hull.count = lf_loaded_views(loaded, hull.view);
    return lf_isosurface(&options, lf_hull_field, &hull, out, NULL, err);
}

lf_status lf_mean_shape_mesh(const lf_config *cfg, const lf_mean_shape *mean, double longest_edge,
                             lf_mesh **out, lf_error *err)
{
    const lf_iso_options options = iso_options(cfg, longest_edge, true);
    return lf_isosurface(&options, lf_mean_shape_field, (void *)(uintptr_t)mean, out, NULL, err);
}

lf_status lf_true_mesh(const lf_config *cfg, const lf_shape *shape, lf_mesh **out, lf_error *err)
{
    const lf_iso_options options = iso_options(cfg, shape->longest_edge, false);
    return lf_isosurface(&options, true_field, (void *)(uintptr_t)shape, out, NULL, err);
}
