/* file_names.c: see file_names.h. */
#include "eval/file_names.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static char **list_of(long count)
{
    char **name = calloc((size_t)count + 1, sizeof *name);
    LF_REQUIRE(name, "out of memory for %ld names", count);
    return name;
}

static char *copy_of(const char *text, size_t length)
{
    char *copy = strndup(text, length);
    LF_REQUIRE(copy, "out of memory");
    for (char *c = copy; *c; c++)
        if (*c == '/')
            *c = '-';
    return copy;
}

static bool is_taken(long count, char *const *name, const char *text)
{
    for (long i = 0; i < count; i++)
        if (strcmp(name[i], text) == 0)
            return true;
    return false;
}

/* Each name that one before it has gets the least free number from 2. */
static void number_equal(long count, char **name)
{
    for (long i = 1; i < count; i++) {
        const size_t room = strlen(name[i]) + 24;
        char *text = calloc(room, 1);
        LF_REQUIRE(text, "out of memory");
        snprintf(text, room, "%s", name[i]);
        for (long k = 2; is_taken(i, name, text); k++)
            snprintf(text, room, "%s-%ld", name[i], k);
        free(name[i]);
        name[i] = text;
    }
}

/* Where the last `parts` parts of a path begin. */
static const char *tail_of(const char *path, int parts)
{
    const char *at = path + strlen(path);
    while (at > path && (at[-1] != '/' || --parts > 0))
        at--;
    return *at ? at : path;
}

char **lf_scene_file_names(const lf_scene_set *set)
{
    char **name = list_of(set->count);
    for (long i = 0; i < set->count; i++) {
        const char *own = set->entry[i].name, *last = tail_of(own, 1);
        bool shared = strcmp(last, ".") == 0 || strcmp(last, "..") == 0;
        for (long j = 0; j < set->count && !shared; j++)
            shared = j != i && strcmp(tail_of(set->entry[j].name, 1), last) == 0;
        const char *from = tail_of(own, shared ? 2 : 1);
        name[i] = copy_of(from, strlen(from));
    }
    number_equal(set->count, name);
    return name;
}

char **lf_view_file_names(const lf_scene *scene)
{
    char **name = list_of(scene->views);
    for (long i = 0; i < scene->views; i++) {
        const char *all = scene->view[i].name, *own = strncmp(all, "./", 2) ? all : all + 2;
        const char *dot = strrchr(tail_of(own, 1), '.');
        name[i] = copy_of(own, dot && dot != tail_of(own, 1) ? (size_t)(dot - own) : strlen(own));
    }
    number_equal(scene->views, name);
    return name;
}

void lf_file_names_free(long count, char **name)
{
    for (long i = 0; name && i < count; i++)
        free(name[i]);
    free(name);
}
