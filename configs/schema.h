/* schema.h: the table of all keys, and values of its types. Internal to configs/. */
#ifndef LF_CONFIGS_SCHEMA_H
#define LF_CONFIGS_SCHEMA_H

#include <stdbool.h>

#include "autograd/status.h"

enum {
    LF_CONFIG_TEXT = 160, /* most bytes of a text or path */
    LF_CONFIG_LIST = 8    /* most numbers of a list */
};

typedef enum lf_key_type {
    LF_KEY_INT,
    LF_KEY_REAL,
    LF_KEY_BOOL,
    LF_KEY_TEXT,
    LF_KEY_CHOICE,
    LF_KEY_INTS,
    LF_KEY_PATH
} lf_key_type;

typedef struct lf_key {
    const char *name; /* "section.key" */
    lf_key_type type;
    const char *standard; /* the default, as written in a file */
    double low, high;     /* range of numbers, both ends allowed; of each number of a list */
    const char *choices;  /* "a|b|c" for LF_KEY_CHOICE */
    const char *help;     /* one sentence */
} lf_key;

/* All keys, grouped by section. */
extern const lf_key lf_schema[];
extern const int lf_schema_size;

/* Index of a key, or -1. */
int lf_schema_find(const char *name);
/* Is there a key in this section? */
bool lf_schema_section(const char *section);
/* The known key that differs least from `name`; the known section that differs least. */
const char *lf_schema_nearest(const char *name);
void lf_schema_nearest_section(const char *section, char nearest[64]);

typedef struct lf_value {
    long integer;              /* int, bool (0 or 1), choice (index), ints (count) */
    double real;               /* real */
    long list[LF_CONFIG_LIST]; /* ints */
    char text[LF_CONFIG_TEXT + 1];
    bool given;
    int line; /* where the file that is being read gave it; 0: not yet */
} lf_value;

/* The value that `text` writes. On LF_BAD_INPUT the message is what is wrong and what is allowed,
 * without file and key. */
lf_status lf_value_parse(const lf_key *key, const char *text, lf_value *value, lf_error *err);
/* The value in a form that parses to the same bits. text holds 256 bytes. */
void lf_value_print(const lf_key *key, const lf_value *value, char text[256]);
/* "whole number from 1 to 10", "one of a, b, c", ... */
void lf_key_allowed(const lf_key *key, char text[256]);
/* The word number `index` of "a|b|c", or its length 0 if there are fewer. */
const char *lf_choice_at(const char *choices, long index, int *length);
/* The number of `word` in "a|b|c", or -1. */
long lf_choice_find(const char *choices, const char *word);

#endif
