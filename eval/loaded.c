/* loaded.c: a model from its checkpoint. See evaluate.h. */
#include "eval/evaluate.h"
#include "eval/some_views.h"
#include "models/checkpoint.h"
#include "train/recon_data.h"
#include "train/run_dir.h"

enum { V = LF_CUBE_VIEWS };

static lf_status load(const char *path, int n, const char *const *sets, lf_loaded *l, lf_error *err)
{
    lf_training_state state;
    LF_TRY(lf_checkpoint_config(path, &l->cfg, &state, err));
    LF_TRY(lf_setting_parse(lf_config_choice(l->cfg, "data.setting"), &l->trained, err));
    LF_TRY(lf_config_set_trained(l->cfg, n, sets, err));
    l->step = state.step;
    const lf_recon_config config = lf_recon_config_from(l->cfg);
    l->store = lf_store_create(0);
    lf_recon_init(&l->model, l->store, &config);
    l->work = lf_recon_work_create(&l->model, lf_config_int(l->cfg, "train.tile_points"));
    return lf_checkpoint_read(path, l->store, NULL, err);
}

lf_status lf_loaded_open(const char *checkpoint, int n, const char *const *sets, lf_loaded *out,
                         lf_error *err)
{
    lf_found found = {0};
    *out = (lf_loaded){0}; /* filled in place: the workspace refers to out->model */
    LF_TRY(lf_run_find(checkpoint, &found, err));
    if (found.note[0])
        fprintf(stderr, "elf-eval: %s\n", found.note);
    const lf_status status = load(found.checkpoint, n, sets, out, err);
    lf_found_free(&found);
    if (status != LF_OK)
        lf_loaded_close(out);
    return status;
}

void lf_loaded_close(lf_loaded *l)
{
    lf_recon_work_free(l->work);
    free(l->image);
    if (l->store)
        lf_recon_free(&l->model);
    lf_store_free(l->store);
    lf_config_free(l->cfg);
    *l = (lf_loaded){0};
}

int lf_loaded_views(const lf_loaded *l, int view[V])
{
    const int sources = (int)lf_config_int(l->cfg, "eval.sources"), used = sources ? sources : V;
    lf_some_views(used, view);
    return used;
}

void lf_loaded_encode(lf_loaded *l, const lf_shape_views *views)
{
    const lf_recon_config *c = &l->model.config;
    int view[V];
    const int used = lf_loaded_views(l, view);
    const long each = c->image_size * c->image_size * c->backbone.in_channels, n = used * each;
    float *pixels = malloc((size_t)n * sizeof *pixels);
    LF_REQUIRE(pixels, "out of memory for %ld pixels", n);
    for (int i = 0; i < used; i++)
        lf_shapes_pixels(views->images + view[i] * each, each, pixels + i * each);
    /* the features refer to the image (it is sampled too), which must stay until the next call */
    free(l->image);
    l->image = malloc((size_t)n * sizeof *l->image);
    LF_REQUIRE(l->image, "out of memory for %ld pixels", n);
    for (long i = 0; i < n; i++)
        l->image[i] = (lf_real)pixels[i];
    free(pixels);
    lf_seen_grid grid = lf_seen_grid_create(&l->model, 1);
    lf_seen_grid_fill(&grid, 0, views, 0);
    if (used < V && grid.count > 0) {
        lf_keep_views(&grid.projection, grid.count, used, view);
        grid.points.views = used;
    }
    const lf_recon_images images = {used, used, l->image, lf_seen_grid_points(&grid)};
    lf_recon_encode(l->work, &images);
    lf_seen_grid_free(&grid);
}

void lf_loaded_predict(lf_loaded *l, const lf_shape_views *views, long n, const double (*point)[3],
                       lf_real *sdf, uint8_t *valid)
{
    const double scale = lf_config_real(l->cfg, "loss.scale");
    int view[V];
    const int used = lf_loaded_views(l, view);
    lf_projection p = lf_projection_create(n);
    lf_projection_fill(&p, 0, n, point, views, 0);
    lf_recon_points points = lf_seen_points(&p, n);
    if (used < V)
        lf_keep_views(&p, n, used, view);
    points.views = used;
    lf_recon_predict(l->work, &points, scale, sdf, valid);
    lf_projection_free(&p);
}
