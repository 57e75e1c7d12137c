/* scene_set.c: see scene_set.h. */
#include "datasets/scene_set.h"

#include "datasets/scene_bounds.h"
#include "datasets/scene_internal.h"

/* A near of less than this share of far is raised to it: strata in 1 / depth need a near. */
static const double least_near = 1e-3;

static void list_views(lf_scene_entry *e)
{
    for (int s = 0; s < LF_SPLITS; s++) {
        e->view[s] = calloc((size_t)e->scene->views + 1, sizeof *e->view[s]);
        LF_REQUIRE(e->view[s], "out of memory");
    }
    for (long v = 0; v < e->scene->views; v++) {
        const int s = (int)e->scene->view[v].split;
        e->view[s][e->count[s]++] = v;
    }
}

/* ---- how the cameras stand --------------------------------------------------------------------
 */

/* Length of the mean of the unit vectors from the centre to the cameras: 1 where all stand in one
 * direction, about 0.5 on a half sphere. */
static double agreement(const lf_scene_entry *e)
{
    double mean[3] = {0};
    for (long v = 0; v < e->scene->views; v++) {
        double w[3], size = 0;
        for (int a = 0; a < 3; a++) {
            w[a] = e->scene->view[v].camera.centre[a] - e->centre[a];
            size += w[a] * w[a];
        }
        for (int a = 0; a < 3 && size > 0; a++)
            mean[a] += w[a] / sqrt(size) / (double)e->scene->views;
    }
    return sqrt(mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2]);
}

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* near and far of all views: least near, median far. */
static void file_depths(lf_scene_entry *e, const lf_scene_set_options *o)
{
    const lf_scene *s = e->scene;
    double *far = calloc((size_t)s->views, sizeof *far);
    LF_REQUIRE(far, "out of memory");
    e->near = INFINITY;
    for (long v = 0; v < s->views; v++) {
        e->near = fmin(e->near, s->view[v].near);
        far[v] = s->view[v].far;
    }
    qsort(far, (size_t)s->views, sizeof *far, by_size);
    e->far = e->builtin ? far[s->views - 1] : far[s->views / 2];
    free(far);
    if (!e->builtin && (s->depths == LF_DEPTHS_FILE || s->depths == LF_DEPTHS_POINTS)) {
        e->near *= o->near_factor;
        e->far *= o->far_factor;
    }
    e->near_raised = e->near < least_near * e->far;
    e->near = fmax(e->near, least_near * e->far);
}

/* ---- one scene ---------------------------------------------------------------------------------
 */

static lf_status look(lf_scene_entry *e, const lf_scene_set_options *o, lf_error *err)
{
    list_views(e);
    if (e->count[LF_SPLIT_TRAIN] < 2)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: %ld views to train on, and a target needs at least one source: give "
                       "more photographs, or hold out fewer (data.hold_out)",
                       e->name, e->count[LF_SPLIT_TRAIN]);
    const bool meet = lf_scene_focus(e->scene, e->centre);
    const bool around = meet && agreement(e) < 0.9;
    e->nearness = o->nearness >= 0 ? (lf_nearness)o->nearness
                  : around         ? LF_NEAR_ANGLE
                                   : LF_NEAR_DISTANCE;
    file_depths(e, o);
    if (!(e->near < e->far))
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: near %g is not below far %g: with data.near_factor %g and "
                       "data.far_factor %g nothing is left between",
                       e->name, e->near, e->far, o->near_factor, o->far_factor);
    e->white = o->white > 0;
    if (o->white < 0)
        LF_TRY(lf_entry_find_ground(e, err));
    return e->white && around && o->outlines ? lf_entry_find_bounds(e, err) : LF_OK;
}

void lf_scene_depths_of(const lf_scene_entry *e, const lf_camera *camera, double *near, double *far)
{
    *near = e->near;
    *far = e->far;
    double z = 0;
    for (int a = 0; a < 3; a++)
        z += camera->rotation[3 * a + 2] * (e->centre[a] - camera->centre[a]);
    if (e->radius > 0 && z - e->radius > least_near * (z + e->radius)) {
        *near = z - e->radius;
        *far = z + e->radius;
    }
}

/* The least whole factor that brings the longer edge of every picture below `longest`. */
static int factor_for(const lf_scene *scene, int longest)
{
    int most = 1;
    for (long v = 0; v < scene->views; v++) {
        const lf_camera *c = &scene->view[v].camera;
        const int edge = c->width > c->height ? c->width : c->height;
        if (longest > 0 && (edge + longest - 1) / longest > most)
            most = (edge + longest - 1) / longest;
    }
    return most;
}

static lf_status open_folder(const char *folder, const lf_scene_set_options *o, size_t bytes,
                             lf_scene_entry *e, lf_error *err)
{
    lf_scene_options options = lf_scene_defaults();
    options.hold_out = o->hold_out;
    options.cache_bytes = bytes;
    options.factor = o->factor > 0 ? o->factor : 1;
    LF_TRY(lf_scene_open(folder, &options, &e->scene, err));
    const int factor = o->factor > 0 ? 1 : factor_for(e->scene, o->longest);
    if (factor > LF_FACTOR_MAX)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: data.longest = %d asks for pictures reduced %d times, %d is the most: "
                       "raise data.longest",
                       folder, o->longest, factor, (int)LF_FACTOR_MAX);
    if (factor > 1) {
        lf_scene_close(e->scene);
        e->scene = NULL;
        options.factor = factor;
        LF_TRY(lf_scene_open(folder, &options, &e->scene, err));
    }
    return look(e, o, err);
}

enum { ROOM_TRAIN = 12, ROOM_TEST = 3 };

static lf_scene_kind kind_of(lf_scene_kinds kinds, long number)
{
    switch (kinds) {
    case LF_KINDS_GLOSSY:
        return LF_KIND_GLOSSY;
    case LF_KINDS_DIFFUSE:
        return LF_KIND_DIFFUSE;
    case LF_KINDS_FORWARD:
        return LF_KIND_FORWARD;
    case LF_KINDS_OBJECTS:
        return number % 2 ? LF_KIND_DIFFUSE : LF_KIND_GLOSSY;
    default:
        return number % 3 == 0   ? LF_KIND_GLOSSY
               : number % 3 == 1 ? LF_KIND_DIFFUSE
                                 : LF_KIND_FORWARD;
    }
}

static lf_status make(long number, const char *mesh, const lf_scene_set_options *o,
                      lf_scene_entry *e, lf_error *err)
{
    lf_scene_make_options options = lf_scene_make_defaults();
    options.kind = kind_of(o->kinds, number);
    options.seed = o->seed;
    options.index = (uint64_t)number;
    options.size = o->size;
    options.highlight = o->highlight;
    options.mesh = mesh;
    if (options.kind == LF_KIND_FORWARD) { /* a patch needs fewer views than a half sphere */
        options.train_views = ROOM_TRAIN;
        options.test_views = ROOM_TEST;
    }
    LF_TRY(lf_scene_make(&options, &e->scene, err));
    return look(e, o, err);
}

double lf_scene_set_builtin_bytes(const lf_scene_set_options *o)
{
    const lf_scene_make_options object = lf_scene_make_defaults();
    const double edge = (double)o->size, high = 2 * round(0.375 * edge); /* of a room's pictures */
    const double room = (ROOM_TRAIN + ROOM_TEST) * edge * high * 3;      /* no alpha */
    const double around = (double)(object.train_views + object.test_views) * edge * edge * 4;
    double bytes = 0;
    for (long i = 0; i < o->builtin; i++)
        bytes += kind_of(o->kinds, o->first + i) == LF_KIND_FORWARD ? room : around;
    return bytes;
}

/* ---- lists -------------------------------------------------------------------------------------
 */

typedef struct list {
    long count, room;
    char **path;
} list;

static void add(list *l, const char *path)
{
    if (l->count == l->room) {
        l->room = l->room ? 2 * l->room : 16;
        l->path = realloc(l->path, (size_t)l->room * sizeof *l->path);
        LF_REQUIRE(l->path, "out of memory");
    }
    l->path[l->count] = strdup(path);
    LF_REQUIRE(l->path[l->count++], "out of memory");
}

static void clear(list *l)
{
    for (long i = 0; i < l->count; i++)
        free(l->path[i]);
    free(l->path);
    *l = (list){0};
}

/* Scenes of a comma-separated list; a folder of scenes stands for all of them. */
static lf_status list_scenes(const lf_scene_set_options *o, list *out, lf_error *err)
{
    const char *at = o->scenes;
    while (at && *at) {
        char name[PATH_MAX], path[PATH_MAX];
        at += strspn(at, " \t,");
        const size_t length = strcspn(at, ",");
        size_t end = length;
        while (end && (at[end - 1] == ' ' || at[end - 1] == '\t'))
            end--;
        if (end) {
            snprintf(name, sizeof name, "%.*s", (int)end, at);
            lf_join(path, o->root ? o->root : ".", name);
            char **folder = NULL;
            long count = 0;
            LF_TRY(lf_scene_folders(path, &count, &folder, err));
            for (long i = 0; i < count; i++)
                add(out, folder[i]);
            lf_scene_folders_free(count, folder);
        }
        at += length;
    }
    return LF_OK;
}

static const char *const mesh_endings[] = {".obj", ".ply", ".off", ".stl", NULL};

/* Meshes of a folder, <id>/model.obj and <id>/models/model_normalized.obj, and the same of the
 * folder's categories: depth 3. */
static void find_meshes(const char *folder, int depth, list *out)
{
    static const char *const all[] = {"", NULL};
    lf_names files = lf_names_list(folder, mesh_endings);
    char path[PATH_MAX];
    for (long i = 0; i < files.count; i++)
        if (lf_is_file(lf_join(path, folder, files.name[i])))
            add(out, path);
    lf_names_free(&files);
    lf_names below = lf_names_list(folder, all);
    for (long i = 0; depth > 0 && i < below.count; i++)
        if (lf_is_folder(lf_join(path, folder, below.name[i])))
            find_meshes(path, depth - 1, out);
    lf_names_free(&below);
}

static lf_status list_meshes(const lf_scene_set_options *o, list *out, lf_error *err)
{
    if (!o->meshes || o->builtin == 0)
        return LF_OK;
    find_meshes(o->meshes, 3, out);
    if (out->count)
        return LF_OK;
    return lf_fail(err, LF_BAD_INPUT,
                   "%s: no mesh to make scenes from (data.scene_meshes): looked for .obj, .ply, "
                   ".off and .stl in it and three folders down",
                   o->meshes);
}

/* ---- the set -----------------------------------------------------------------------------------
 */

static lf_status fill(lf_scene_set *set, const list *scenes, const list *meshes,
                      const lf_scene_set_options *o, lf_scene_set_progress *progress, void *context,
                      lf_error *err)
{
    const long total = scenes->count + o->builtin;
    const double left = fmax((double)o->cache_bytes - lf_scene_set_builtin_bytes(o), 0);
    for (long i = 0; i < total; i++) {
        lf_scene_entry *e = &set->entry[set->count++];
        const long number = o->first + i - scenes->count;
        char name[64];
        e->builtin = i >= scenes->count;
        snprintf(name, sizeof name, "built-in %ld", number);
        e->name = strdup(e->builtin ? name : scenes->path[i]);
        LF_REQUIRE(e->name, "out of memory");
        /* far apart in the list, so that categories mix */
        const char *mesh = meshes->count ? meshes->path[number * 7919 % meshes->count] : NULL;
        LF_TRY(e->builtin
                   ? make(number, mesh, o, e, err)
                   : open_folder(scenes->path[i], o, (size_t)left / (size_t)scenes->count, e, err));
        if (progress)
            progress(context, i + 1, total);
    }
    return LF_OK;
}

lf_status lf_scene_set_open(const lf_scene_set_options *o, lf_scene_set_progress *progress,
                            void *context, lf_scene_set **out, lf_error *err)
{
    list scenes = {0}, meshes = {0};
    lf_scene_set *set = calloc(1, sizeof *set);
    LF_REQUIRE(set, "out of memory");
    lf_status status = list_scenes(o, &scenes, err);
    if (status == LF_OK)
        status = list_meshes(o, &meshes, err);
    if (status == LF_OK && scenes.count + o->builtin == 0)
        status = lf_fail(err, LF_BAD_INPUT, "no scene is given");
    if (status == LF_OK) {
        set->entry = calloc((size_t)(scenes.count + o->builtin), sizeof *set->entry);
        LF_REQUIRE(set->entry, "out of memory");
        status = fill(set, &scenes, &meshes, o, progress, context, err);
    }
    clear(&scenes);
    clear(&meshes);
    if (status == LF_OK)
        *out = set;
    else
        lf_scene_set_close(set);
    return status;
}

void lf_scene_set_close(lf_scene_set *set)
{
    if (!set)
        return;
    for (long i = 0; i < set->count; i++) {
        lf_scene_close(set->entry[i].scene);
        free(set->entry[i].name);
        for (int s = 0; s < LF_SPLITS; s++)
            free(set->entry[i].view[s]);
    }
    free(set->entry);
    free(set);
}
