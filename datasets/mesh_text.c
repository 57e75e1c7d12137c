/* mesh_text.c: a file in memory, read line by line and word by word, with checked numbers. */
#include "datasets/mesh_file.h"

#include <errno.h>
#include <math.h>
#include <sys/stat.h>

#define BIGGEST_FILE ((off_t)4 << 30)

static lf_status read_all(FILE *f, const char *path, size_t size, lf_bytes *out, lf_error *err)
{
    char *data = malloc(size + 1);
    if (!data)
        return lf_fail(err, LF_FAILED, "%s: no memory for %zu bytes", path, size);
    if (fread(data, 1, size, f) != size) {
        free(data);
        return lf_fail(err, LF_FAILED, "%s: cannot be read to its end: %s", path, strerror(errno));
    }
    data[size] = 0;
    *out = (lf_bytes){data, size};
    return LF_OK;
}

lf_status lf_bytes_read(const char *path, lf_bytes *out, lf_error *err)
{
    FILE *f = fopen(path, "rb");
    if (!f)
        return lf_fail(err, LF_BAD_INPUT, "%s: cannot be opened: %s", path, strerror(errno));
    struct stat info;
    lf_status status;
    if (fstat(fileno(f), &info) || !S_ISREG(info.st_mode))
        status = lf_fail(err, LF_BAD_INPUT, "%s: is not a regular file", path);
    else if (info.st_size == 0)
        status = lf_fail(err, LF_BAD_INPUT, "%s: the file is empty", path);
    else if (info.st_size > BIGGEST_FILE)
        status = lf_fail(err, LF_BAD_INPUT, "%s: the file is larger than 4 GiB", path);
    else
        status = read_all(f, path, (size_t)info.st_size, out, err);
    fclose(f);
    return status;
}

void lf_scan_free(lf_scan *scan)
{
    free(scan->colour);
    free(scan->clean.data);
    *scan = (lf_scan){0};
}

static char *make_room(lf_scan *scan, size_t size)
{
    if (scan->clean.size + size > scan->clean_capacity) {
        scan->clean_capacity = 2 * scan->clean_capacity + size + 1024;
        scan->clean.data = realloc(scan->clean.data, scan->clean_capacity);
        LF_REQUIRE(scan->clean.data, "no memory for %zu bytes", scan->clean_capacity);
    }
    scan->clean.size += size;
    return scan->clean.data + scan->clean.size - size;
}

void lf_scan_emit(lf_scan *scan, const void *number, size_t size)
{
    const uint16_t one = 1;
    const bool little = *(const unsigned char *)&one == 1;
    char *to = make_room(scan, size);
    for (size_t i = 0; i < size; i++)
        to[i] = ((const char *)number)[little ? i : size - 1 - i];
}

void lf_scan_emit_text(lf_scan *scan, const char *text)
{
    memcpy(make_room(scan, strlen(text)), text, strlen(text));
}

int lf_distinct3(long n, const long *corner)
{
    long seen[3];
    int count = 0;
    for (long i = 0; i < n && count < 3; i++) {
        bool repeated = false;
        for (int j = 0; j < count; j++)
            repeated = repeated || seen[j] == corner[i];
        if (!repeated)
            seen[count++] = corner[i];
    }
    return count;
}

lf_text lf_text_open(const char *path, lf_bytes file)
{
    return (lf_text){path, file.data, file.data, file.data + file.size, 0};
}

bool lf_text_next_line(lf_text *t)
{
    /* the first call starts at the file's first byte, later ones after the line feed */
    const char *start = t->line == 0 ? t->at : t->line_end + 1;
    if (start >= t->end)
        return false;
    const char *feed = memchr(start, '\n', (size_t)(t->end - start));
    t->at = start;
    t->line_end = feed ? feed : t->end;
    t->line++;
    return true;
}

static bool blank(char c)
{
    return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f';
}

bool lf_text_word(lf_text *t, const char **word, size_t *length)
{
    while (t->at < t->line_end && blank(*t->at))
        t->at++;
    *word = t->at;
    while (t->at < t->line_end && !blank(*t->at))
        t->at++;
    *length = (size_t)(t->at - *word);
    return *length > 0;
}

bool lf_text_is(const char *word, size_t length, const char *expected)
{
    return strlen(expected) == length && memcmp(word, expected, length) == 0;
}

lf_status lf_coordinate_check(double x, const char *path, const char *what, long number,
                              lf_error *err)
{
    if (isfinite(x) && fabs(x) <= LF_MESH_COORDINATE_MAX)
        return LF_OK;
    return lf_fail(err, LF_BAD_INPUT,
                   "%s: %s %ld has a coordinate %g; coordinates must be finite and within %g", path,
                   what, number, x, LF_MESH_COORDINATE_MAX);
}

/* A decimal number that fills the word; hexadecimal, nan and inf are refused. */
static bool parse_decimal(const char *word, size_t length, double *out)
{
    char text[64], *stop;
    if (length >= sizeof text || strspn(word, "0123456789+-.eE") < length)
        return false;
    memcpy(text, word, length);
    text[length] = 0;
    *out = strtod(text, &stop);
    return *stop == 0 && stop != text;
}

lf_status lf_text_coordinate(lf_text *t, const char *what, double *out, lf_error *err)
{
    const char *word;
    size_t length;
    if (!lf_text_word(t, &word, &length))
        return lf_fail(err, LF_BAD_INPUT, "%s:%ld: the line ends where %s should stand", t->path,
                       t->line, what);
    double x;
    if (!parse_decimal(word, length, &x) || !isfinite(x) || fabs(x) > LF_MESH_COORDINATE_MAX)
        return lf_fail(
            err, LF_BAD_INPUT, "%s:%ld: %s is '%.*s', must be a finite decimal number within %g",
            t->path, t->line, what, (int)(length < 40 ? length : 40), word, LF_MESH_COORDINATE_MAX);
    *out = x;
    return LF_OK;
}

lf_status lf_text_integer(lf_text *t, const char *what, long low, long high, long *out,
                          lf_error *err)
{
    const char *word;
    size_t length;
    if (!lf_text_word(t, &word, &length))
        return lf_fail(err, LF_BAD_INPUT, "%s:%ld: the line ends where %s should stand", t->path,
                       t->line, what);
    char text[32] = "", *stop = text;
    long value = 0;
    if (length < sizeof text && strspn(word, "0123456789+-") >= length) {
        memcpy(text, word, length);
        text[length] = 0;
        errno = 0;
        value = strtol(text, &stop, 10);
    }
    if (stop == text || *stop || errno || value < low || value > high)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s:%ld: %s is '%.*s', must be a whole number from %ld to %ld", t->path,
                       t->line, what, (int)(length < 40 ? length : 40), word, low, high);
    *out = value;
    return LF_OK;
}
