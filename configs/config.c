/* config.c: a config in memory: defaults, overrides, getters, text, help. */
#include "configs/config.h"

#include <stdlib.h>

lf_config *lf_config_defaults(void)
{
    lf_config *cfg = malloc(sizeof *cfg);
    lf_value *value = calloc((size_t)lf_schema_size, sizeof *value);
    LF_REQUIRE(cfg && value, "configs: out of memory");
    cfg->value = value;
    for (int i = 0; i < lf_schema_size; i++) {
        const lf_key *key = &lf_schema[i];
        LF_REQUIRE(lf_value_parse(key, key->standard, &value[i], NULL) == LF_OK,
                   "configs: the default of %s is not allowed by its own row", key->name);
    }
    return cfg;
}

void lf_config_free(lf_config *cfg)
{
    if (cfg)
        free(cfg->value);
    free(cfg);
}

lf_status lf_config_assign(lf_config *cfg, const char *key, const char *text, lf_error *err)
{
    const int index = lf_schema_find(key);
    if (index < 0)
        return lf_fail(err, LF_BAD_INPUT,
                       "unknown key %.80s; the nearest is %s (elf-train --help-config lists all)",
                       key, lf_schema_nearest(key));
    lf_value value = {.given = true, .line = cfg->value[index].line};
    lf_error why;
    if (lf_value_parse(&lf_schema[index], text, &value, &why) != LF_OK)
        return lf_fail(err, LF_BAD_INPUT, "%s = %.100s: %s", key, text, why.text);
    cfg->value[index] = value;
    return LF_OK;
}

/* text[0..length) without blanks at its ends, into out[size]; false if it is too long. */
static bool trim(const char *text, size_t length, char *out, size_t size)
{
    for (; length && strchr(" \t", *text); text++)
        length--;
    while (length && strchr(" \t", text[length - 1]))
        length--;
    if (length >= size)
        return false;
    memcpy(out, text, length);
    out[length] = 0;
    return true;
}

lf_status lf_config_set(lf_config *cfg, const char *assignment, lf_error *err)
{
    const char *equals = strchr(assignment, '=');
    char key[128], text[1024];
    if (!equals)
        return lf_fail(err, LF_BAD_INPUT, "--set %.100s: allowed is section.key=value", assignment);
    if (!trim(assignment, (size_t)(equals - assignment), key, sizeof key) ||
        !trim(equals + 1, strlen(equals + 1), text, sizeof text))
        return lf_fail(err, LF_BAD_INPUT, "--set %.60s...: too long", assignment);
    lf_error why;
    if (lf_config_assign(cfg, key, text, &why) != LF_OK)
        return lf_fail(err, LF_BAD_INPUT, "--set: %s", why.text);
    return LF_OK;
}

/* Does the key say what the network is, and not how it is trained or used? */
static bool of_network(const char *key)
{
    static const char *const use[] = {"model.norm_momentum", "render.sources", "render.samples",
                                      "render.fine_samples"};
    for (size_t i = 0; i < sizeof use / sizeof *use; i++)
        if (!strcmp(key, use[i]))
            return false;
    return !strncmp(key, "model.", 6) || !strncmp(key, "render.", 7) || !strcmp(key, "loss.scale");
}

lf_status lf_config_set_trained(lf_config *cfg, int n, const char *const *assignment, lf_error *err)
{
    lf_config changed = {malloc((size_t)lf_schema_size * sizeof *changed.value)};
    LF_REQUIRE(changed.value, "configs: out of memory");
    memcpy(changed.value, cfg->value, (size_t)lf_schema_size * sizeof *changed.value);
    lf_status status = LF_OK;
    for (int i = 0; status == LF_OK && i < n; i++)
        status = lf_config_set(&changed, assignment[i], err);
    for (int i = 0; status == LF_OK && i < lf_schema_size; i++) {
        const lf_key *key = &lf_schema[i];
        char was[256], is[256];
        if (!of_network(key->name))
            continue;
        lf_value_print(key, &cfg->value[i], was);
        lf_value_print(key, &changed.value[i], is);
        if (strcmp(was, is) != 0)
            status = lf_fail(err, LF_BAD_INPUT,
                             "--set %s=%s: the network was trained with %s, and another value is "
                             "another model: leave it out, or train that one from a config",
                             key->name, is, was);
    }
    if (status == LF_OK)
        status = lf_config_check(&changed, err);
    if (status == LF_OK)
        memcpy(cfg->value, changed.value, (size_t)lf_schema_size * sizeof *changed.value);
    free(changed.value);
    return status;
}

static const lf_value *get(const lf_config *cfg, const char *key, lf_key_type type)
{
    const int i = lf_schema_find(key);
    LF_REQUIRE(i >= 0, "configs: no key %s in the schema", key);
    const lf_key_type found = lf_schema[i].type == LF_KEY_PATH ? LF_KEY_TEXT : lf_schema[i].type;
    LF_REQUIRE(found == type, "configs: %s is asked for as another type than the schema's", key);
    return &cfg->value[i];
}

long lf_config_int(const lf_config *cfg, const char *key)
{
    return get(cfg, key, LF_KEY_INT)->integer;
}

double lf_config_real(const lf_config *cfg, const char *key)
{
    return get(cfg, key, LF_KEY_REAL)->real;
}

bool lf_config_bool(const lf_config *cfg, const char *key)
{
    return get(cfg, key, LF_KEY_BOOL)->integer != 0;
}

const char *lf_config_string(const lf_config *cfg, const char *key)
{
    return get(cfg, key, LF_KEY_TEXT)->text;
}

const char *lf_config_choice(const lf_config *cfg, const char *key)
{
    return get(cfg, key, LF_KEY_CHOICE)->text;
}

bool lf_config_is(const lf_config *cfg, const char *key, const char *word)
{
    const lf_value *value = get(cfg, key, LF_KEY_CHOICE);
    const long index = lf_choice_find(lf_schema[lf_schema_find(key)].choices, word);
    LF_REQUIRE(index >= 0, "configs: %s is no choice of %s", word, key);
    return value->integer == index;
}

const long *lf_config_ints(const lf_config *cfg, const char *key, int *count)
{
    const lf_value *value = get(cfg, key, LF_KEY_INTS);
    *count = (int)value->integer;
    return value->list;
}

bool lf_config_given(const lf_config *cfg, const char *key)
{
    const int i = lf_schema_find(key);
    LF_REQUIRE(i >= 0, "configs: no key %s in the schema", key);
    return cfg->value[i].given;
}

/* All keys as INI text; with comments, the help. */
static void print_all(const lf_config *cfg, bool help, FILE *out)
{
    const char *section = "";
    size_t length = 0;
    for (int i = 0; i < lf_schema_size; i++) {
        const lf_key *key = &lf_schema[i];
        char text[256], allowed[256];
        if (strncmp(section, key->name, length + 1) || !length) {
            section = key->name;
            length = strcspn(section, ".");
            fprintf(out, "%s[%.*s]\n", i ? "\n" : "", (int)length, section);
        }
        lf_value_print(key, &cfg->value[i], text);
        lf_key_allowed(key, allowed);
        if (help)
            fprintf(out, "# %s\n# Allowed: %s.\n", key->help, allowed);
        fprintf(out, "%s = %s\n", key->name + length + 1, text);
    }
}

char *lf_config_text(const lf_config *cfg)
{
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    LF_REQUIRE(out, "configs: out of memory");
    print_all(cfg, false, out);
    LF_REQUIRE(!fclose(out), "configs: out of memory");
    return text;
}

void lf_config_help(FILE *out)
{
    lf_config *cfg = lf_config_defaults();
    fprintf(out, "# Every key with its default. An INI file gives those that differ;\n"
                 "# --set section.key=value overrides one on the command line.\n\n");
    print_all(cfg, true, out);
    lf_config_free(cfg);
}
