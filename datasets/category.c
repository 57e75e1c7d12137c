/* category.c: lists of ids, or a folder's own files, to mesh paths. */
#include "datasets/category.h"

#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <strings.h>
#include <sys/stat.h>

#include "autograd/random.h"

static const char *const splits[3] = {"train", "val", "test"};
static const char *const endings[] = {".obj", ".ply", ".off", ".stl"};

const char *lf_category_drawn_split(const char *id)
{
    lf_stream s = lf_stream_at(0, LF_RANDOM_SHUFFLE, 0, lf_name_hash(id));
    const double u = lf_uniform(&s);
    return splits[u < 0.7 ? 0 : u < 0.8 ? 1 : 2];
}

void lf_category_close(lf_category *category)
{
    if (!category)
        return;
    for (long i = 0; i < category->count; i++) {
        free(category->item[i].id);
        free(category->item[i].path);
    }
    free(category->item);
    free(category);
}

static bool is_file(const char *path)
{
    struct stat info;
    return stat(path, &info) == 0 && S_ISREG(info.st_mode);
}

static bool is_folder(const char *path)
{
    struct stat info;
    return stat(path, &info) == 0 && S_ISDIR(info.st_mode);
}

/* The mesh file of <folder>/<id>/, if there is one. */
static bool find_model(const char *folder, const char *id, char path[PATH_MAX])
{
    static const char *const names[] = {"model.obj",
                                        "models/model_normalized.obj",
                                        "model_normalized.obj",
                                        "model.ply",
                                        "model.off",
                                        "model.stl"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (snprintf(path, PATH_MAX, "%s/%s/%s", folder, id, names[i]) < PATH_MAX && is_file(path))
            return true;
    return false;
}

/* The mesh of a listed id: in its own folder, or the file <folder>/<id>.obj and the like. */
static bool find_listed(const char *folder, const char *id, char path[PATH_MAX])
{
    if (find_model(folder, id, path))
        return true;
    for (size_t i = 0; i < sizeof endings / sizeof *endings; i++)
        if (snprintf(path, PATH_MAX, "%s/%s%s", folder, id, endings[i]) < PATH_MAX && is_file(path))
            return true;
    return false;
}

static void add_item(lf_category *c, const char *id, size_t id_length, const char *path)
{
    lf_category_item *items = realloc(c->item, (size_t)(c->count + 1) * sizeof *items);
    LF_REQUIRE(items, "no memory for %ld shapes", c->count + 1);
    c->item = items;
    items[c->count++] = (lf_category_item){strndup(id, id_length), strdup(path)};
}

/* Cut comment and blanks; the id begins at the returned place. */
static char *trim(char *line)
{
    line[strcspn(line, "#\r\n")] = 0;
    while (*line == ' ' || *line == '\t')
        line++;
    size_t n = strlen(line);
    while (n > 0 && (line[n - 1] == ' ' || line[n - 1] == '\t'))
        line[--n] = 0;
    return line;
}

static lf_status add_listed(lf_category *c, const char *folder, const char *list, long number,
                            const char *id, lf_error *err)
{
    char path[PATH_MAX];
    if (strchr(id, '/') || !strcmp(id, ".") || !strcmp(id, ".."))
        return lf_fail(err, LF_BAD_INPUT,
                       "%s:%ld: '%s' is no id: it must name a folder or a mesh beside the list",
                       list, number, id);
    for (long i = 0; i < c->count; i++)
        if (!strcmp(c->item[i].id, id))
            return lf_fail(err, LF_BAD_INPUT, "%s:%ld: the id '%s' is listed twice", list, number,
                           id);
    if (!find_listed(folder, id, path))
        return lf_fail(err, LF_BAD_INPUT,
                       "%s:%ld: the shape '%s' has no mesh: expected %s/%s/model.obj, "
                       "models/model_normalized.obj or %s/%s.obj (.ply, .off, .stl); mend the list "
                       "or add the file",
                       list, number, id, folder, id, folder, id);
    add_item(c, id, strlen(id), path);
    return LF_OK;
}

static lf_status read_list(lf_category *c, const char *folder, const char *list, lf_error *err)
{
    FILE *f = fopen(list, "r");
    if (!f)
        return lf_fail(err, LF_BAD_INPUT, "%s: cannot be opened: %s", list, strerror(errno));
    char *line = NULL;
    size_t capacity = 0;
    lf_status status = LF_OK;
    for (long number = 1; status == LF_OK && getline(&line, &capacity, f) >= 0; number++) {
        const char *id = trim(line);
        if (*id)
            status = add_listed(c, folder, list, number, id, err);
    }
    free(line);
    fclose(f);
    return status;
}

/* The layout with lists: every wanted split must have one. */
static lf_status open_lists(lf_category *c, const char *folder, const char *split, lf_error *err)
{
    for (int i = 0; i < 3; i++) {
        char list[PATH_MAX];
        if (strcmp(split, "all") != 0 && strcmp(split, splits[i]) != 0)
            continue;
        if (snprintf(list, sizeof list, "%s/%s.lst", folder, splits[i]) >= PATH_MAX)
            return lf_fail(err, LF_BAD_INPUT, "%s: the name is too long", folder);
        if (!is_file(list))
            return lf_fail(err, LF_BAD_INPUT,
                           "%s: there is no such list, though the category has lists of other "
                           "splits; write it, one id a line, or ask for another split",
                           list);
        LF_TRY(read_list(c, folder, list, err));
    }
    return LF_OK;
}

static size_t mesh_name_length(const char *name)
{
    const size_t n = strlen(name);
    for (size_t i = 0; i < sizeof endings / sizeof *endings; i++)
        if (n > 4 && !strcasecmp(name + n - 4, endings[i]))
            return n - 4;
    return 0;
}

/* One entry of a folder without lists: a mesh file, a subfolder with a model, or nothing. */
static void add_entry(lf_category *c, const char *folder, const char *name, const char *split)
{
    char path[PATH_MAX];
    size_t length = mesh_name_length(name);
    if (name[0] == '.' || snprintf(path, sizeof path, "%s/%s", folder, name) >= PATH_MAX)
        return;
    if (is_folder(path)) {
        length = strlen(name);
        if (!find_model(folder, name, path))
            return;
    } else if (length == 0 || !is_file(path)) {
        return;
    }
    add_item(c, name, length, path);
    const char *drawn = lf_category_drawn_split(c->item[c->count - 1].id);
    if (strcmp(split, "all") != 0 && strcmp(split, drawn) != 0) {
        c->count--;
        free(c->item[c->count].id);
        free(c->item[c->count].path);
    }
}

static lf_status open_folder(lf_category *c, const char *folder, const char *split, lf_error *err)
{
    DIR *d = opendir(folder);
    if (!d)
        return lf_fail(err, LF_BAD_INPUT, "%s: cannot be opened: %s", folder, strerror(errno));
    for (const struct dirent *e = readdir(d); e; e = readdir(d))
        add_entry(c, folder, e->d_name, split);
    closedir(d);
    c->drawn = true;
    return LF_OK;
}

static int by_id(const void *a, const void *b)
{
    return strcmp(((const lf_category_item *)a)->id, ((const lf_category_item *)b)->id);
}

static lf_status finish(lf_category *c, const char *folder, const char *split, lf_error *err)
{
    if (c->count == 0)
        return lf_fail(err, LF_BAD_INPUT, "%s: the split '%s' has no shape%s", folder, split,
                       c->drawn ? " (no .lst file found; split drawn by a hash of the names): add "
                                  "meshes, or write train.lst, val.lst and test.lst there, one "
                                  "name without its ending a line"
                                : "");
    qsort(c->item, (size_t)c->count, sizeof *c->item, by_id);
    for (long i = 1; i < c->count; i++)
        if (!strcmp(c->item[i - 1].id, c->item[i].id))
            return lf_fail(err, LF_BAD_INPUT, "%s and %s have the same id '%s'; rename one",
                           c->item[i - 1].path, c->item[i].path, c->item[i].id);
    return LF_OK;
}

static bool has_lists(const char *folder)
{
    for (int i = 0; i < 3; i++) {
        char list[PATH_MAX];
        if (snprintf(list, sizeof list, "%s/%s.lst", folder, splits[i]) < PATH_MAX && is_file(list))
            return true;
    }
    return false;
}

lf_status lf_category_open(const char *root, const char *category, const char *split,
                           lf_category **out, lf_error *err)
{
    char folder[PATH_MAX];
    if (strcmp(split, "all") != 0 && strcmp(split, splits[0]) != 0 &&
        strcmp(split, splits[1]) != 0 && strcmp(split, splits[2]) != 0)
        return lf_fail(err, LF_BAD_INPUT, "'%s' is no split; allowed are train, val, test, all",
                       split);
    if (snprintf(folder, sizeof folder, "%s/%s", root, category) >= PATH_MAX || !is_folder(folder))
        return lf_fail(err, LF_BAD_INPUT,
                       "%s/%s: there is no such folder; a category is a folder under data.root; "
                       "data.root = builtin has procedural shapes",
                       root, category);
    lf_category *c = calloc(1, sizeof *c);
    LF_REQUIRE(c, "no memory");
    lf_status status =
        has_lists(folder) ? open_lists(c, folder, split, err) : open_folder(c, folder, split, err);
    if (status == LF_OK)
        status = finish(c, folder, split, err);
    if (status == LF_OK)
        *out = c;
    else
        lf_category_close(c);
    return status;
}
