/* run_find.c: the checkpoint that a path means, and the run it belongs to. */
#include "train/run_dir.h"

#include <dirent.h>
#include <errno.h>
#include <sys/stat.h>

#include "autograd/safetensors.h"
#include "train/run_files.h"

char *lf_path_join(const char *folder, const char *name)
{
    const size_t length = strlen(folder) + strlen(name) + 2;
    char *path = malloc(length);
    LF_REQUIRE(path, "run: out of memory");
    snprintf(path, length, "%s/%s", folder, name);
    return path;
}

/* The step in "step-00000012.safetensors", or -1 for any other name. */
static long step_of(const char *name)
{
    long step = -1;
    if (sscanf(name, "step-%18ld", &step) != 1 || step < 0)
        return -1;
    char again[64];
    snprintf(again, sizeof again, "step-%08ld.safetensors", step);
    return strcmp(name, again) ? -1 : step;
}

static int rising(const void *a, const void *b)
{
    const long x = *(const long *)a, y = *(const long *)b;
    return (x > y) - (x < y);
}

int lf_checkpoint_steps(const char *folder, long **steps)
{
    char *path = lf_path_join(folder, "checkpoints");
    DIR *d = opendir(path);
    int n = 0, room = 64;
    *steps = malloc((size_t)room * sizeof **steps);
    LF_REQUIRE(*steps, "run: out of memory");
    for (struct dirent *e = d ? readdir(d) : NULL; e; e = readdir(d)) {
        const long step = step_of(e->d_name);
        if (step < 0)
            continue;
        if (n == room) {
            room *= 2;
            *steps = realloc(*steps, (size_t)room * sizeof **steps);
            LF_REQUIRE(*steps, "run: out of memory");
        }
        (*steps)[n++] = step;
    }
    if (d)
        closedir(d);
    free(path);
    qsort(*steps, (size_t)n, sizeof **steps, rising);
    return n;
}

lf_status lf_checkpoint_sound(const char *path, lf_error *err)
{
    lf_safetensors *file = NULL;
    const lf_status status = lf_safetensors_open(path, &file, err);
    lf_safetensors_close(file);
    return status;
}

/* The newest sound checkpoint of the folder; those passed over go into the note. */
static lf_status find_newest(const char *folder, lf_found *found, lf_error *err)
{
    long *steps;
    int n = lf_checkpoint_steps(folder, &steps);
    lf_error damage = {""};
    lf_status status = lf_fail(err, LF_BAD_INPUT, "%s: no checkpoint in its folder checkpoints%s",
                               folder, n ? " is sound" : "");
    for (; n > 0 && status != LF_OK; n--) {
        char name[64];
        snprintf(name, sizeof name, LF_CHECKPOINT_FORMAT, steps[n - 1]);
        char *path = lf_path_join(folder, name);
        status = lf_checkpoint_sound(path, &damage);
        const size_t used = strlen(found->note);
        if (status == LF_OK) {
            found->checkpoint = path;
            found->step = steps[n - 1];
            break;
        }
        snprintf(found->note + used, sizeof found->note - used, "passed over %s\n", damage.text);
        free(path);
    }
    free(steps);
    if (status != LF_OK && *damage.text)
        return lf_fail(err, LF_BAD_INPUT, "%s: no checkpoint is sound: %.600s", folder,
                       damage.text);
    return status;
}

/* The run's folder of .../checkpoints/step-N.safetensors; NULL if the file lies elsewhere. */
static char *folder_of(const char *checkpoint)
{
    const char *slash = strrchr(checkpoint, '/'), *name = slash ? slash + 1 : checkpoint;
    static const char within[] = "checkpoints/";
    const size_t length = (size_t)(name - checkpoint), tail = sizeof within - 1;
    if (step_of(name) < 0 || length < tail || strncmp(name - tail, within, tail))
        return NULL;
    if (length == tail)
        return strdup(".");
    if (name[-(ptrdiff_t)tail - 1] != '/')
        return NULL;
    return length == tail + 1 ? strdup("/") : strndup(checkpoint, length - tail - 1);
}

lf_status lf_run_find(const char *path, lf_found *out, lf_error *err)
{
    lf_found found = {.step = -1};
    struct stat info;
    if (stat(path, &info))
        return lf_fail(err, LF_BAD_INPUT, "%s: %s", path, strerror(errno));
    if (S_ISDIR(info.st_mode)) {
        LF_TRY(find_newest(path, &found, err));
        found.directory = strdup(path);
    } else {
        const char *slash = strrchr(path, '/');
        LF_TRY(lf_checkpoint_sound(path, err));
        found.directory = folder_of(path);
        found.checkpoint = strdup(path);
        found.step = step_of(slash ? slash + 1 : path);
    }
    *out = found;
    return LF_OK;
}

void lf_found_free(lf_found *found)
{
    free(found->directory);
    free(found->checkpoint);
    *found = (lf_found){.step = -1};
}
