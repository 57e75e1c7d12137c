/* read.c: INI text into a config, through inih.
 *
 * inih tells its handler no line number, cuts long lines, goes on after errors and takes an
 * indented line for more of the value above. So it reads through next_line, which counts lines,
 * refuses what inih would get wrong, and ends the text at the first fault.
 */
#include "configs/config.h"

#include <errno.h>
#include <ini.h>
#include <stdlib.h>

enum { MAX_FILE = 1 << 20, MAX_SECTION = 49 };

typedef struct reader {
    lf_config *cfg;
    const char *name; /* of the file */
    const char *at, *end;
    int line;       /* the last one handed to inih */
    int fault_line; /* 0: none */
    lf_error why;   /* the fault, without file and line */
} reader;

/* A section head must name a known section: inih would not tell us of an empty one. */
static bool check_section(reader *r, const char *text)
{
    const size_t length = strcspn(text, "]");
    char section[MAX_SECTION + 1], nearest[64];
    if (text[length] != ']')
        return true; /* inih reports it */
    if (length > MAX_SECTION) {
        lf_fail(&r->why, LF_BAD_INPUT, "the section name has %zu bytes, allowed are %d", length,
                MAX_SECTION);
        return false;
    }
    memcpy(section, text, length);
    section[length] = 0;
    if (lf_schema_section(section))
        return true;
    lf_schema_nearest_section(section, nearest);
    lf_fail(&r->why, LF_BAD_INPUT, "unknown section [%s]; the nearest is [%s]", section, nearest);
    return false;
}

static bool check_line(reader *r, const char *text, size_t length, int room)
{
    if (memchr(text, 0, length)) {
        lf_fail(&r->why, LF_BAD_INPUT, "a NUL byte; a config is plain text");
        return false;
    }
    if (length + 2 > (size_t)room) {
        lf_fail(&r->why, LF_BAD_INPUT, "the line has %zu bytes, allowed are %d", length, room - 2);
        return false;
    }
    size_t blanks = 0;
    while (blanks < length && strchr(" \t\v\f\r", text[blanks]))
        blanks++;
    if (blanks && blanks < length && text[blanks] != ';' && text[blanks] != '#') {
        lf_fail(&r->why, LF_BAD_INPUT,
                "the line begins with a blank; keys and sections begin in "
                "the first column");
        return false;
    }
    return true;
}

/* The line reader of inih: like fgets. */
static char *next_line(char *line, int room, void *user)
{
    reader *r = user;
    if (r->fault_line || r->at == r->end)
        return NULL;
    const char *text = r->at;
    const char *stop = memchr(text, '\n', (size_t)(r->end - text));
    const size_t length = (size_t)((stop ? stop : r->end) - text);
    r->at = stop ? stop + 1 : r->end;
    r->line++;
    bool good = check_line(r, text, length, room);
    if (good) {
        memcpy(line, text, length);
        line[length] = '\n';
        line[length + 1] = 0;
        good = line[0] != '[' || check_section(r, line + 1);
    }
    if (!good)
        r->fault_line = r->line;
    return good ? line : NULL;
}

static lf_status set_from_file(reader *r, const char *section, const char *name, const char *text)
{
    char key[256];
    if (!*section)
        return lf_fail(&r->why, LF_BAD_INPUT, "key %s stands before any [section]", name);
    snprintf(key, sizeof key, "%s.%s", section, name);
    const int index = lf_schema_find(key);
    if (index >= 0 && r->cfg->value[index].line)
        return lf_fail(&r->why, LF_BAD_INPUT, "%s is given a second time, first in line %d", key,
                       r->cfg->value[index].line);
    LF_TRY(lf_config_assign(r->cfg, key, text, &r->why));
    r->cfg->value[index].line = r->line;
    return LF_OK;
}

/* The handler of inih: nonzero is success. */
static int handle(void *user, const char *section, const char *name, const char *value)
{
    reader *r = user;
    if (r->fault_line)
        return 1;
    if (set_from_file(r, section, name, value) != LF_OK)
        r->fault_line = r->line;
    return 1; /* goes on until next_line ends the text */
}

/* Values of the text into cfg, which is spoilt on failure. */
static lf_status read_into(lf_config *cfg, const char *text, size_t length, const char *name,
                           lf_error *err)
{
    reader r = {cfg, name, text, text + length, 0, 0, {""}};
    const int line = ini_parse_stream(next_line, &r, handle, &r);
    if (line < 0)
        return lf_fail(err, LF_FAILED, "%s: out of memory", name);
    if (line > 0 && (!r.fault_line || line < r.fault_line))
        return lf_fail(err, LF_BAD_INPUT,
                       "%s:%d: neither a [section] nor \"key = value\" nor a # comment", name,
                       line);
    if (r.fault_line)
        return lf_fail(err, LF_BAD_INPUT, "%s:%d: %s", name, r.fault_line, r.why.text);
    return LF_OK;
}

static lf_status create(const char *text, size_t length, const char *name, lf_config **out,
                        lf_error *err)
{
    lf_config *cfg = lf_config_defaults();
    const lf_status status = read_into(cfg, text, length, name, err);
    if (status == LF_OK)
        *out = cfg;
    else
        lf_config_free(cfg);
    return status;
}

lf_status lf_config_parse_text(const char *text, const char *name, lf_config **out, lf_error *err)
{
    return create(text, strlen(text), name, out, err);
}

lf_status lf_config_load(const char *path, lf_config **out, lf_error *err)
{
    if (!path)
        return create("", 0, "defaults", out, err);
    FILE *file = fopen(path, "rb");
    if (!file)
        return lf_fail(err, LF_BAD_INPUT, "%s: %s", path, strerror(errno));
    char *text = malloc(MAX_FILE + 1);
    const size_t length = text ? fread(text, 1, MAX_FILE + 1, file) : 0;
    lf_status status = LF_OK;
    if (!text)
        status = lf_fail(err, LF_FAILED, "%s: out of memory", path);
    else if (ferror(file))
        status = lf_fail(err, LF_BAD_INPUT, "%s: %s", path, strerror(errno));
    else if (length > MAX_FILE)
        status = lf_fail(err, LF_BAD_INPUT, "%s: more than %d bytes are no config", path, MAX_FILE);
    else
        status = create(text, length, path, out, err);
    fclose(file);
    free(text);
    return status;
}
