/* value.c: values of the schema's types, from text and to text. */
#include "configs/schema.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>

const char *lf_choice_at(const char *choices, long index, int *length)
{
    const char *word = choices;
    for (; index > 0 && (word = strchr(word, '|')); index--)
        word++;
    *length = word ? (int)strcspn(word, "|") : 0;
    return word ? word : "";
}

long lf_choice_find(const char *choices, const char *word)
{
    int length;
    for (long i = 0;; i++) {
        const char *at = lf_choice_at(choices, i, &length);
        if (!length)
            return -1;
        if (strlen(word) == (size_t)length && !strncmp(at, word, (size_t)length))
            return i;
    }
}

static void print_choices(const char *choices, char *text, size_t size)
{
    size_t used = (size_t)snprintf(text, size, "one of");
    int length;
    for (long i = 0; used < size; i++) {
        const char *word = lf_choice_at(choices, i, &length);
        if (!length)
            return;
        used += (size_t)snprintf(text + used, size - used, "%s %.*s", i ? "," : "", length, word);
    }
}

void lf_key_allowed(const lf_key *key, char text[256])
{
    const double low = key->low, high = key->high;
    switch (key->type) {
    case LF_KEY_INT:
        snprintf(text, 256, "a whole number from %.0f to %.0f", low, high);
        break;
    case LF_KEY_REAL:
        snprintf(text, 256, "a number from %.15g to %.15g", low, high);
        break;
    case LF_KEY_BOOL:
        snprintf(text, 256, "true or false");
        break;
    case LF_KEY_CHOICE:
        print_choices(key->choices, text, 256);
        break;
    case LF_KEY_INTS:
        snprintf(text, 256, "1 to %d whole numbers from %.0f to %.0f, with commas between",
                 LF_CONFIG_LIST, low, high);
        break;
    case LF_KEY_TEXT:
    case LF_KEY_PATH:
        snprintf(text, 256, "%s of 1 to %d bytes", key->type == LF_KEY_PATH ? "a path" : "text",
                 LF_CONFIG_TEXT);
        break;
    }
}

static lf_status refuse(const lf_key *key, lf_error *err)
{
    char allowed[256];
    lf_key_allowed(key, allowed);
    return lf_fail(err, LF_BAD_INPUT, "allowed is %s", allowed);
}

/* A whole number that fills text[0..length), within the range. */
static bool parse_int(const lf_key *key, const char *text, size_t length, long *out)
{
    char copy[32], *end;
    if (length == 0 || length >= sizeof copy)
        return false;
    memcpy(copy, text, length);
    copy[length] = 0;
    if (!isdigit((unsigned char)copy[0]) && copy[0] != '-' && copy[0] != '+')
        return false;
    errno = 0;
    const long n = strtol(copy, &end, 10);
    if (errno || *end || !isdigit((unsigned char)end[-1]))
        return false;
    *out = n;
    return (double)n >= key->low && (double)n <= key->high;
}

static bool parse_real(const lf_key *key, const char *text, double *out)
{
    char *end;
    if (!*text || text[strspn(text, "0123456789+-.eE")])
        return false; /* strtod would also take inf, nan and hexadecimal */
    const double x = strtod(text, &end);
    if (end == text || *end || !isfinite(x))
        return false;
    *out = x;
    return x >= key->low && x <= key->high;
}

static bool parse_bool(const char *text, long *out)
{
    *out = !strcmp(text, "true") || !strcmp(text, "yes");
    return *out || !strcmp(text, "false") || !strcmp(text, "no");
}

static bool parse_ints(const lf_key *key, const char *text, lf_value *value)
{
    value->integer = 0;
    for (;;) {
        text += strspn(text, " \t");
        size_t length = strcspn(text, ",");
        const char *next = text + length;
        while (length && (text[length - 1] == ' ' || text[length - 1] == '\t'))
            length--;
        if (value->integer == LF_CONFIG_LIST ||
            !parse_int(key, text, length, &value->list[value->integer]))
            return false;
        value->integer++;
        if (!*next)
            return true;
        text = next + 1;
    }
}

/* Length of the UTF-8 character at s, or 0: wrong lead or continuation bytes. */
static int utf8_length(const unsigned char *s)
{
    const int n = s[0] < 0x80 ? 1 : s[0] >= 0xF0 ? 4 : s[0] >= 0xE0 ? 3 : s[0] >= 0xC2 ? 2 : 0;
    for (int i = 1; i < n; i++)
        if ((s[i] & 0xC0) != 0x80)
            return 0;
    return s[0] > 0xF4 ? 0 : n;
}

/* Text must survive a file: no control characters, nothing that an INI reader takes for a comment
 * or strips. */
static lf_status parse_text(const lf_key *key, const char *text, lf_value *value, lf_error *err)
{
    const size_t length = strlen(text);
    if (length == 0)
        return refuse(key, err);
    if (length > LF_CONFIG_TEXT)
        return lf_fail(err, LF_BAD_INPUT, "%zu bytes are too long, allowed is at most %d%s", length,
                       LF_CONFIG_TEXT,
                       key->type == LF_KEY_PATH ? "; use a shorter path or a symbolic link" : "");
    for (const char *c = text; *c;) {
        const int n = utf8_length((const unsigned char *)c);
        if (!n || (unsigned char)*c < ' ' || *c == 127)
            return lf_fail(err, LF_BAD_INPUT,
                           "byte 0x%02X is not allowed, only printable characters in UTF-8",
                           (unsigned char)*c);
        c += n;
    }
    if (strstr(text, " ;") || *text == ';' || *text == ' ' || text[length - 1] == ' ')
        return lf_fail(err, LF_BAD_INPUT,
                       "a ';' at the start or after a blank begins a comment, and blanks at the "
                       "ends are lost: not allowed in text");
    memcpy(value->text, text, length + 1);
    return LF_OK;
}

lf_status lf_value_parse(const lf_key *key, const char *text, lf_value *value, lf_error *err)
{
    bool ok = false;
    switch (key->type) {
    case LF_KEY_INT:
        ok = parse_int(key, text, strlen(text), &value->integer);
        break;
    case LF_KEY_REAL:
        ok = parse_real(key, text, &value->real);
        break;
    case LF_KEY_BOOL:
        ok = parse_bool(text, &value->integer);
        break;
    case LF_KEY_CHOICE:
        value->integer = lf_choice_find(key->choices, text);
        ok = value->integer >= 0;
        break;
    case LF_KEY_INTS:
        ok = parse_ints(key, text, value);
        break;
    case LF_KEY_TEXT:
    case LF_KEY_PATH:
        return parse_text(key, text, value, err);
    }
    if (!ok)
        return refuse(key, err);
    if (key->type == LF_KEY_CHOICE) { /* lf_config_choice gives out the word */
        int length;
        const char *word = lf_choice_at(key->choices, value->integer, &length);
        snprintf(value->text, sizeof value->text, "%.*s", length, word);
    }
    return LF_OK;
}

/* The shortest decimal that reads back as x. */
static void print_real(double x, char text[256])
{
    for (int digits = 6; digits <= 17; digits++) {
        snprintf(text, 256, "%.*g", digits, x);
        if (strtod(text, NULL) == x)
            return;
    }
}

void lf_value_print(const lf_key *key, const lf_value *value, char text[256])
{
    size_t used = 0;
    switch (key->type) {
    case LF_KEY_INT:
        snprintf(text, 256, "%ld", value->integer);
        break;
    case LF_KEY_REAL:
        print_real(value->real, text);
        break;
    case LF_KEY_BOOL:
        snprintf(text, 256, "%s", value->integer ? "true" : "false");
        break;
    case LF_KEY_INTS:
        for (long i = 0; i < value->integer; i++)
            used +=
                (size_t)snprintf(text + used, 256 - used, "%s%ld", i ? ", " : "", value->list[i]);
        break;
    case LF_KEY_CHOICE:
    case LF_KEY_TEXT:
    case LF_KEY_PATH:
        snprintf(text, 256, "%s", value->text);
        break;
    }
}
