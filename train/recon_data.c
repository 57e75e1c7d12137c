/* recon_data.c: the [data] keys as options of the shapes; what networks are told of points. */
#include "train/recon_data.h"

static lf_views_options views_options(const lf_config *cfg)
{
    lf_views_options v = {.size = (int)lf_config_int(cfg, "data.image_size"),
                          .render = lf_render_defaults()};
    lf_error err;
    const lf_status status =
        lf_setting_parse(lf_config_choice(cfg, "data.setting"), &v.setting, &err);
    LF_REQUIRE(status == LF_OK, "%s", err.text);
    if (lf_config_is(cfg, "data.channels", "colour"))
        v.render.mode = LF_RENDER_COLOUR;
    v.render.rays = (int)lf_config_int(cfg, "data.supersample");
    v.render.light.head = lf_config_is(cfg, "data.light", "head");
    return v;
}

lf_shapes_options lf_shapes_options_from(const lf_config *cfg, const char *split)
{
    const char *root = lf_config_string(cfg, "data.root");
    const bool train = strcmp(split, "train") == 0, builtin = strcmp(root, LF_BUILTIN) == 0;
    const bool val = strcmp(split, "val") == 0;
    const long most = val ? lf_config_int(cfg, "data.val_shapes") : 0; /* of a folder; 0: all */
    const char *const count = train ? "data.shapes" : val ? "data.val_shapes" : "data.test_shapes";
    lf_shapes_options o = {
        .root = root,
        .category = lf_config_string(cfg, "data.category"),
        .split = split,
        .limit = most,
        .sign = lf_config_is(cfg, "data.sign", "escape")    ? LF_SDF_ESCAPE
                : lf_config_is(cfg, "data.sign", "winding") ? LF_SDF_WINDING
                                                            : LF_SDF_COMBINED,
        .thickness = lf_config_real(cfg, "data.thickness"),
        .points_uniform = lf_config_int(cfg, "data.points_uniform"),
        .points_near = lf_config_int(cfg, "data.points_near"),
        .views = views_options(cfg),
        .draws = train ? lf_config_int(cfg, "data.draws") : 1,
        /* what is evaluated must not change with the seed of a training */
        .seed = train ? (uint64_t)lf_config_int(cfg, "train.seed") : 1,
    };
    o.builtin = lf_config_int(cfg, builtin ? count : "data.extra_builtin");
    return o;
}

lf_recon_points lf_seen_points(const lf_projection *p, long count)
{
    return (lf_recon_points){.count = count,
                             .views = LF_CUBE_VIEWS,
                             .uv = p->uv,
                             .direction = p->direction,
                             .distance = p->distance,
                             .mask = p->mask,
                             .first = p->first,
                             .position = p->position,
                             .bearing = p->bearing};
}

lf_seen_grid lf_seen_grid_create(const lf_recon *model, long shapes)
{
    lf_seen_grid grid = {.count = model ? model->grid * model->grid * model->grid : 0};
    if (grid.count == 0)
        return grid;
    grid.point = calloc((size_t)grid.count, sizeof *grid.point);
    LF_REQUIRE(grid.point, "out of memory for a grid of %ld points", grid.count);
    lf_recon_grid(model, grid.point);
    grid.projection = lf_projection_create(shapes * grid.count);
    grid.points = lf_seen_points(&grid.projection, shapes * grid.count);
    return grid;
}

void lf_seen_grid_free(lf_seen_grid *grid)
{
    free(grid->point);
    lf_projection_free(&grid->projection);
    *grid = (lf_seen_grid){0};
}

void lf_seen_grid_fill(lf_seen_grid *grid, long slot, const lf_shape_views *views, long first)
{
    if (grid->count > 0)
        lf_projection_fill(&grid->projection, slot * grid->count, grid->count,
                           (const double(*)[3])grid->point, views, first);
}

const lf_recon_points *lf_seen_grid_points(const lf_seen_grid *grid)
{
    return grid->count > 0 ? &grid->points : NULL;
}
