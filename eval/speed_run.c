/* speed_run.c: one setting in a process of its own. See speed_error.h. */
#include <dirent.h>
#include <errno.h>
#include <unistd.h>

#include "eval/child.h"
#include "eval/speed_error.h"
#include "eval/speed_settings.h"

lf_status lf_speed_runner_open(const lf_speed_options *options, lf_speed_runner *out, lf_error *err)
{
    *out = (lf_speed_runner){.options = options};
    lf_status status = lf_child_find("elf-eval", &out->program[0], err);
    if (status == LF_OK)
        status = lf_child_find("elf-eval-f64", &out->program[1], err);
    if (status != LF_OK)
        lf_speed_runner_close(out);
    return status;
}

void lf_speed_runner_close(lf_speed_runner *r)
{
    free(r->program[0]);
    free(r->program[1]);
    *r = (lf_speed_runner){0};
}

/* ---- the folder of the results ----------------------------------------------------------------
 */

enum { FOLDER = 64 };

static lf_status make_folder(char folder[FOLDER], lf_error *err)
{
    snprintf(folder, FOLDER, P_tmpdir "/elf-speed-error-%ld-XXXXXX", (long)getpid());
    if (mkdtemp(folder))
        return LF_OK;
    return lf_fail(err, LF_FAILED, "cannot make a temporary folder in " P_tmpdir ": %s",
                   strerror(errno));
}

/* With what a program left that was ended while it wrote. */
static void remove_folder(const char *folder)
{
    DIR *dir = opendir(folder);
    for (struct dirent *entry; dir && (entry = readdir(dir));)
        unlinkat(dirfd(dir), entry->d_name, 0); /* fails for . and .. */
    if (dir)
        closedir(dir);
    rmdir(folder);
}

/* ---- the command ------------------------------------------------------------------------------
 */

/* A command line whose words are owned. */
typedef struct command {
    char *word[2 * (256 + LF_SPEED_KEYS) + 32];
    int words;
} command;

LF_PRINTF(2, 3)
static void say(command *c, const char *format, ...)
{
    va_list args;
    LF_REQUIRE(c->words + 1 < (int)(sizeof c->word / sizeof *c->word), "too many words");
    va_start(args, format);
    LF_REQUIRE(vasprintf(&c->word[c->words++], format, args) >= 0, "out of memory");
    va_end(args);
}

static void say_two(command *c, const char *option, const char *value)
{
    say(c, "%s", option);
    say(c, "%s", value);
}

static void make_command(const lf_speed_runner *r, const lf_speed_setting *s, const char *file,
                         command *c)
{
    const lf_speed_options *o = r->options;
    say(c, "%s", s->f64 ? "elf-eval-f64" : "elf-eval");
    say_two(c, "--checkpoint", o->checkpoint);
    say_two(c, "--measure", file);
    say_two(c, "--split", o->split);
    if (o->setting)
        say_two(c, "--setting", o->setting);
    if (o->items)
        say(c, "--shapes"), say(c, "%ld", o->items);
    if (o->threads)
        say(c, "--threads"), say(c, "%d", o->threads);
    for (int i = 0; i < o->sets; i++)
        say_two(c, "--set", o->set[i]);
    if (o->views)
        say(c, "--set"), say(c, "eval.views=%ld", o->views);
    for (int i = 0; i < s->keys; i++)
        say_two(c, "--set", s->key[i]);
}

lf_status lf_speed_run(const lf_speed_runner *r, const lf_speed_setting *s, lf_raw **out,
                       lf_error *err)
{
    command c = {{0}, 0};
    char folder[FOLDER], file[FOLDER + 24];
    LF_TRY(make_folder(folder, err));
    snprintf(file, sizeof file, "%s/raw.safetensors", folder);
    make_command(r, s, file, &c);
    lf_status status = lf_child_run(r->program[s->f64], c.word, err);
    if (status == LF_OK)
        status = lf_raw_read(file, out, err);
    remove_folder(folder);
    for (int i = 0; i < c.words; i++)
        free(c.word[i]);
    return status == LF_OK ? LF_OK : lf_error_context(err, status, "the setting '%s'", s->name);
}
