/* scene_files.c: names, folders and pictures of a scene. */
#include "datasets/scene_internal.h"

#include <dirent.h>
#include <strings.h>
#include <sys/stat.h>

const char *const lf_picture_endings[] = {".png", ".jpg", ".jpeg", ".exr", ".tif", ".tiff", NULL};

bool lf_is_file(const char *path)
{
    struct stat info;
    return stat(path, &info) == 0 && S_ISREG(info.st_mode);
}

bool lf_is_folder(const char *path)
{
    struct stat info;
    return stat(path, &info) == 0 && S_ISDIR(info.st_mode);
}

const char *lf_join(char out[PATH_MAX], const char *folder, const char *name)
{
    char joined[PATH_MAX];
    const int n = name[0] == '/' || !folder[0] ? snprintf(joined, PATH_MAX, "%s", name)
                                               : snprintf(joined, PATH_MAX, "%s/%s", folder, name);
    if (n >= PATH_MAX)
        joined[0] = 0;
    memcpy(out, joined, PATH_MAX);
    return out;
}

const char *lf_base_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

static bool ends_in(const char *name, const char *const *endings)
{
    const size_t n = strlen(name);
    for (; *endings; endings++) {
        const size_t m = strlen(*endings);
        if (n > m && strcasecmp(name + n - m, *endings) == 0)
            return true;
    }
    return false;
}

static int by_name(const void *a, const void *b)
{
    return strcmp(*(char *const *)a, *(char *const *)b);
}

lf_names lf_names_list(const char *folder, const char *const *endings)
{
    lf_names names = {0};
    DIR *dir = opendir(folder);
    if (!dir)
        return names;
    for (struct dirent *entry; (entry = readdir(dir));) {
        if (entry->d_name[0] == '.' || !ends_in(entry->d_name, endings))
            continue;
        names.name = realloc(names.name, (size_t)(names.count + 1) * sizeof *names.name);
        LF_REQUIRE(names.name, "out of memory");
        names.name[names.count] = strdup(entry->d_name);
        LF_REQUIRE(names.name[names.count], "out of memory");
        names.count++;
    }
    closedir(dir);
    if (names.count)
        qsort(names.name, (size_t)names.count, sizeof *names.name, by_name);
    return names;
}

void lf_names_free(lf_names *names)
{
    for (long i = 0; i < names->count; i++)
        free(names->name[i]);
    free(names->name);
    *names = (lf_names){0};
}

bool lf_find_picture(char out[PATH_MAX], const char *folder, const char *name)
{
    static const char *const tails[] = {"", ".png", ".jpg", ".jpeg", ".JPG", ".exr"};
    char base[PATH_MAX];
    lf_join(base, folder, name);
    for (size_t i = 0; i < sizeof tails / sizeof *tails; i++)
        if (snprintf(out, PATH_MAX, "%s%s", base, tails[i]) < PATH_MAX && lf_is_file(out))
            return true;
    return false;
}

/* The same file under two spellings ("./a" and "a")? */
static bool same_file(const char *a, const char *b)
{
    struct stat x, y;
    return strcmp(a, b) == 0 ||
           (stat(a, &x) == 0 && stat(b, &y) == 0 && x.st_ino == y.st_ino && x.st_dev == y.st_dev);
}

static bool is_used(const lf_scene *scene, const char *name, const char *path)
{
    for (long i = 0; i < scene->views; i++)
        if (scene->view[i].path && strcmp(lf_base_name(scene->view[i].path), name) == 0 &&
            same_file(scene->view[i].path, path))
            return true;
    return false;
}

void lf_scene_note_orphans(lf_scene *scene, const char *folder)
{
    lf_names names = lf_names_list(folder, lf_picture_endings);
    for (long i = 0; i < names.count; i++) {
        char path[PATH_MAX];
        const char *name = names.name[i];
        /* depth and normal maps that NeRF-Synthetic keeps beside its pictures */
        if (strstr(name, "_depth_") || strstr(name, "_normal_"))
            continue;
        if (!is_used(scene, name, lf_join(path, folder, name)))
            lf_scene_leave_out(scene, path, "a picture without a frame");
    }
    lf_names_free(&names);
}
