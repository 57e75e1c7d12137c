/* render_data.c: scenes, target views and their sources. See render_data.h. */
#include "train/render_data.h"

/* ---- scenes of a config -----------------------------------------------------------------------
 */

static lf_scene_kinds kinds_of(const lf_config *cfg)
{
    static const char *const name[] = {"all", "objects", "glossy", "diffuse", "forward"};
    for (int k = 0; k < 5; k++)
        if (lf_config_is(cfg, "data.kinds", name[k]))
            return (lf_scene_kinds)k;
    return LF_KINDS_ALL;
}

/* The text of a key, or NULL for "none" and "builtin". */
static const char *text_of(const lf_config *cfg, const char *key)
{
    const char *text = lf_config_string(cfg, key);
    return strcmp(text, "none") && strcmp(text, "builtin") ? text : NULL;
}

static lf_scene_set_options options_of(const lf_config *cfg)
{
    return (lf_scene_set_options){
        .root = text_of(cfg, "data.root"),
        .longest = (int)lf_config_int(cfg, "data.longest"),
        .factor = (int)lf_config_int(cfg, "data.factor"),
        .hold_out = (int)lf_config_int(cfg, "data.hold_out"),
        .outlines = lf_config_is(cfg, "data.bounds", "auto"),
        .near_factor = lf_config_real(cfg, "data.near_factor"),
        .far_factor = lf_config_real(cfg, "data.far_factor"),
        .nearness = lf_config_is(cfg, "data.nearness", "auto")    ? -1
                    : lf_config_is(cfg, "data.nearness", "angle") ? LF_NEAR_ANGLE
                                                                  : LF_NEAR_DISTANCE,
        .white = lf_config_is(cfg, "data.background", "auto")
                     ? -1
                     : lf_config_is(cfg, "data.background", "white"),
        .cache_bytes = (size_t)lf_config_int(cfg, "data.cache_mb") * 1000000,
        .kinds = kinds_of(cfg),
        .meshes = text_of(cfg, "data.scene_meshes"),
        .size = (int)lf_config_int(cfg, "data.scene_size"),
        .highlight = lf_config_real(cfg, "data.highlight"),
    };
}

/* Numbers of built-in scenes that are only tested on begin here. */
enum { FIRST_TEST = 1000000 };

static lf_status check_pictures(const lf_config *cfg, const lf_scene_entry *e, lf_error *err)
{
    const lf_feature_net net = {.config = lf_renderer_config_from(cfg).features};
    const long least = lf_feature_net_smallest(&net);
    for (long v = 0; v < e->scene->views; v++) {
        const lf_camera *c = &e->scene->view[v].camera;
        if (c->width < least || c->height < least)
            return lf_fail(
                err, LF_BAD_INPUT,
                "%s: a picture of %d x %d pixels, after reduction, and render.feature_net "
                "= %s needs %ld x %ld: change data.longest, data.factor or "
                "data.scene_size",
                e->name, c->width, c->height,
                net.config.kind == LF_FEATURES_SMALL ? "small" : "resnet34", least, least);
    }
    return LF_OK;
}

/* Training needs one view more than sources itself: see lf_render_batches_create. */
static lf_status check_views(const lf_config *cfg, const lf_scene_entry *e, const char *split,
                             lf_error *err)
{
    long targets;
    const bool own = strcmp(split, "test") == 0 && lf_config_int(cfg, "eval.sources") > 0;
    const char *const key = own ? "eval.sources" : "render.sources";
    const long sources = lf_config_int(cfg, key), there = e->count[LF_SPLIT_TRAIN];
    const bool themselves = lf_render_targets(e, split, &targets) == e->view[LF_SPLIT_TRAIN];
    if (strcmp(split, "train") == 0 || there >= sources + themselves)
        return LF_OK;
    return lf_fail(err, LF_BAD_INPUT,
                   "%s has %ld training views%s: too few for %s = %ld; lower it, or hold out fewer "
                   "(data.hold_out)",
                   e->name, there, themselves ? ", one of which is rendered" : "", key, sources);
}

/* Built-in scenes stay in memory whole: refuse what is too much before one is made. */
static lf_status check_cache(const lf_scene_set_options *o, const char *key, lf_error *err)
{
    const double needed = lf_scene_set_builtin_bytes(o);
    if (needed <= (double)o->cache_bytes)
        return LF_OK;
    return lf_fail(err, LF_BAD_INPUT,
                   "%s = %ld scenes with data.scene_size = %d take %.0f MB, and data.cache_mb = "
                   "%.0f: lower one of them, or raise data.cache_mb if this machine has the memory",
                   key, o->builtin, o->size, ceil(1e-6 * needed), 1e-6 * (double)o->cache_bytes);
}

lf_status lf_render_scenes(const lf_config *cfg, const char *split, lf_scene_set_progress *progress,
                           void *context, lf_scene_set **out, lf_error *err)
{
    lf_scene_set_options o = options_of(cfg);
    const bool train = strcmp(split, "train") == 0, test = strcmp(split, "test") == 0;
    o.scenes = text_of(cfg, train ? "data.scenes" : test ? "data.test_scenes" : "data.val_scenes");
    if (train)
        o.builtin = lf_config_int(cfg, "data.builtin_scenes");
    if (test) {
        o.builtin = lf_config_int(cfg, "data.test_builtin");
        o.first = FIRST_TEST;
        o.meshes = NULL; /* unseen shapes: procedural ones of other numbers */
    }
    *out = NULL;
    if (!o.scenes && o.builtin == 0)
        return LF_OK;
    lf_scene_set *set;
    LF_TRY(check_cache(&o, test ? "data.test_builtin" : "data.builtin_scenes", err));
    LF_TRY(lf_scene_set_open(&o, progress, context, &set, err));
    lf_status status = LF_OK;
    for (long i = 0; i < set->count && status == LF_OK; i++) {
        status = check_pictures(cfg, &set->entry[i], err);
        if (status == LF_OK)
            status = check_views(cfg, &set->entry[i], split, err);
    }
    if (status == LF_OK)
        *out = set;
    else
        lf_scene_set_close(set);
    return status;
}

static lf_scene_split used_split(const lf_scene_entry *e, const char *split)
{
    const lf_scene_split s = strcmp(split, "train") == 0 ? LF_SPLIT_TRAIN
                             : strcmp(split, "val") == 0 ? LF_SPLIT_VAL
                                                         : LF_SPLIT_TEST;
    return e->count[s] ? s : LF_SPLIT_TRAIN;
}

const long *lf_render_targets(const lf_scene_entry *e, const char *split, long *count)
{
    const lf_scene_split used = used_split(e, split);
    *count = e->count[used];
    return e->view[used];
}

const char *lf_render_split(const lf_scene_entry *e, const char *split)
{
    return lf_scene_split_name(used_split(e, split));
}

const char *lf_render_split_name(const char *split, long views, long trained)
{
    if (trained == 0 || strcmp(split, "train") == 0)
        return split;
    return trained == views ? "train" : strcmp(split, "val") == 0 ? "val, train" : "test, train";
}

void lf_render_describe(FILE *out, const char *split, const lf_scene_set *set)
{
    for (long i = 0; i < set->count; i++) {
        const lf_scene_entry *e = &set->entry[i];
        const lf_camera *c = &e->scene->view[0].camera;
        double near, far;
        lf_scene_depths_of(e, c, &near, &far);
        if (e->builtin)
            continue;
        fprintf(out,
                "%s: %s: %ld + %ld + %ld views (train, val, test) of %d x %d, depths %.3g to %.3g "
                "(%s)%s, sources by %s, %s ground\n",
                split, e->name, e->count[0], e->count[1], e->count[2], c->width, c->height, near,
                far, e->radius > 0 ? "from outlines" : lf_scene_depths_name(e->scene->depths),
                e->near_raised ? " (near raised to far / 1000)" : "",
                e->nearness == LF_NEAR_ANGLE ? "angle" : "distance", e->white ? "white" : "black");
        if (e->scene->left)
            fprintf(out, "  %ld frames left out; elf-eval check-data %s lists them\n",
                    e->scene->left, e->name);
    }
}

/* ---- a target and its sources -----------------------------------------------------------------
 */

/* Moved by the options' motion, then seen from the moved centre of the scene. */
static lf_camera bring(const lf_scene_entry *e, const lf_render_view_options *o, lf_camera camera)
{
    double centre[3];
    memcpy(centre, e->centre, sizeof centre);
    if (o->motion) {
        camera = lf_camera_move(&camera, o->motion);
        lf_motion_apply(o->motion, e->centre, centre);
    }
    lf_camera_recentre(1, &camera, centre);
    return camera;
}

/* K R' [I | -c]. */
static void projection_of(const lf_camera *c, double p[12])
{
    for (int j = 0; j < 4; j++) {
        double q[3];
        for (int i = 0; i < 3; i++) {
            q[i] = j < 3 ? c->rotation[3 * j + i] : 0;
            for (int a = 0; j == 3 && a < 3; a++)
                q[i] -= c->rotation[3 * a + i] * c->centre[a];
        }
        p[j] = c->fx * q[0] + c->cx * q[2];
        p[4 + j] = c->fy * q[1] + c->cy * q[2];
        p[8 + j] = q[2];
    }
}

static lf_status choose(const lf_scene_entry *e, const lf_camera *camera, long target,
                        const lf_render_view_options *o, long *out, lf_error *err)
{
    const long *from = e->view[LF_SPLIT_TRAIN], count = e->count[LF_SPLIT_TRAIN];
    lf_status status;
    if (o->draw)
        status = lf_scene_draw_sources(e->scene, camera, e->nearness, e->centre, count, from,
                                       target, 0, o->pool, o->draw, o->sources, out, err);
    else
        status = lf_scene_nearest(e->scene, camera, e->nearness, e->centre, count, from, target,
                                  o->sources, out, err);
    return status == LF_OK ? LF_OK
                           : lf_error_context(err, status, "render.sources = %ld (or eval.sources)",
                                              o->sources);
}

static lf_status hold_sources(lf_render_view *v, const lf_render_view_options *o, lf_error *err)
{
    for (; v->sources < o->sources; v->sources++) {
        const long view = v->source_view[v->sources];
        lf_pixels p;
        LF_TRY(lf_scene_hold(v->entry->scene, view, &p, err));
        const lf_camera c = bring(v->entry, o, v->entry->scene->view[view].camera);
        lf_source *s = v->source + v->sources;
        *s = (lf_source){.width = p.width, .height = p.height, .rgb = p.rgb};
        memcpy(s->centre, c.centre, sizeof s->centre);
        projection_of(&c, s->projection);
    }
    return LF_OK;
}

static lf_status open_view(const lf_scene_entry *e, const lf_camera *camera, long target,
                           const lf_render_view_options *o, lf_render_view *out, lf_error *err)
{
    lf_render_view v = {.entry = e, .target = -1, .camera = bring(e, o, *camera)};
    v.bounds.radius = e->radius; /* its centre is the origin */
    lf_scene_depths_of(e, camera, &v.near, &v.far);
    v.source_view = calloc((size_t)o->sources, sizeof *v.source_view);
    v.source = calloc((size_t)o->sources, sizeof *v.source);
    LF_REQUIRE(v.source_view && v.source, "out of memory");
    lf_status status = choose(e, camera, target, o, v.source_view, err);
    if (status == LF_OK)
        status = hold_sources(&v, o, err);
    if (status == LF_OK && target >= 0) {
        status = lf_scene_hold(e->scene, target, &v.pixels, err);
        v.target = status == LF_OK ? target : -1;
    }
    if (status == LF_OK)
        *out = v;
    else
        lf_render_view_release(&v);
    return status;
}

lf_status lf_render_view_open(const lf_scene_entry *e, long target, const lf_render_view_options *o,
                              lf_render_view *out, lf_error *err)
{
    return open_view(e, &e->scene->view[target].camera, target, o, out, err);
}

lf_status lf_render_camera_open(const lf_scene_entry *e, const lf_camera *camera,
                                const lf_render_view_options *o, lf_render_view *out, lf_error *err)
{
    return open_view(e, camera, -1, o, out, err);
}

void lf_render_view_release(lf_render_view *v)
{
    for (long i = 0; i < v->sources; i++)
        lf_scene_release(v->entry->scene, v->source_view[i]);
    if (v->target >= 0)
        lf_scene_release(v->entry->scene, v->target);
    free(v->source_view);
    free(v->source);
    *v = (lf_render_view){0};
}

/* ---- rays -------------------------------------------------------------------------------------
 */

lf_pixel_rays lf_pixel_rays_create(const lf_render_view *v, long count, const long *pixel)
{
    lf_pixel_rays r = {.number = calloc((size_t)count * 7 + 1, sizeof(double))};
    LF_REQUIRE(r.number, "out of memory for %ld rays", count);
    double *origin = r.number, *direction = origin + 3 * count, *stretch = direction + 3 * count;
    for (long i = 0; i < count; i++) {
        memcpy(origin + 3 * i, v->camera.centre, sizeof v->camera.centre);
        lf_camera_ray(&v->camera, (double)(pixel[i] % v->camera.width),
                      (double)(pixel[i] / v->camera.width), direction + 3 * i);
        double z = 0;
        for (int a = 0; a < 3; a++)
            z += v->camera.rotation[3 * a + 2] * direction[3 * i + a];
        stretch[i] = 1 / z;
    }
    r.rays = (lf_target_rays){count, origin, direction, stretch, v->near, v->far};
    return r;
}

void lf_pixel_rays_free(lf_pixel_rays *r)
{
    free(r->number);
    *r = (lf_pixel_rays){0};
}
