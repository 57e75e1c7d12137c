/* checkpoint.c: see checkpoint.h. */
#include "models/checkpoint.h"

#define FORMAT "elf-checkpoint-1"

enum { NAME = 128, NUMBER = 32 };

static lf_array array_of(const lf_parameter *p, char *name, const char *prefix, const lf_real *data)
{
    snprintf(name, NAME, "%s%s", prefix, p->name);
    lf_array a = {.name = name, .dtype = LF_DTYPE_REAL, .rank = p->rank, .data = data};
    for (int i = 0; i < p->rank; i++)
        a.dim[i] = p->dim[i];
    return a;
}

lf_status lf_checkpoint_write(const char *path, const lf_store *store, const lf_adam *adam,
                              const lf_training_state *state, const lf_config *cfg,
                              const lf_fault *fault, lf_error *err)
{
    const int count = lf_store_count(store);
    lf_array *array = calloc((size_t)(3 * count + 1), sizeof *array);
    char(*name)[NAME] = calloc((size_t)(3 * count + 1), sizeof *name);
    LF_REQUIRE(array && name, "out of memory for a checkpoint of %d arrays", count);
    int n = 0;
    for (int i = 0; i < count; i++) {
        const lf_parameter *p = lf_store_at(store, i);
        array[n] = array_of(p, name[n], "", lf_values(p));
        n++;
        if (!p->trainable)
            continue;
        array[n] = array_of(p, name[n], "adam.m.", adam->m + p->offset);
        n++;
        array[n] = array_of(p, name[n], "adam.v.", adam->v + p->offset);
        n++;
    }
    char number[7][NUMBER];
    snprintf(number[0], NUMBER, "%ld", state->step);
    snprintf(number[1], NUMBER, "%ld", adam->steps);
    snprintf(number[2], NUMBER, "%.17g", state->seconds);
    snprintf(number[3], NUMBER, "%ld", state->skipped);
    snprintf(number[4], NUMBER, "%ld", state->bad_in_a_row);
    snprintf(number[5], NUMBER, "%.17g", state->loss_sum);
    snprintf(number[6], NUMBER, "%ld", state->loss_steps);
    char *text = lf_config_text(cfg);
    const lf_meta meta[] = {
        {"format", FORMAT},      {"step", number[0]},       {"adam_steps", number[1]},
        {"seconds", number[2]},  {"skipped", number[3]},    {"bad_in_a_row", number[4]},
        {"loss_sum", number[5]}, {"loss_steps", number[6]}, {"config", text}};
    const lf_status status =
        lf_safetensors_write(path, array, n, meta, (int)(sizeof meta / sizeof *meta), fault, err);
    free(text);
    free(name);
    free(array);
    return status;
}

static lf_status not_ours(const char *path, const char *what, lf_error *err)
{
    return lf_fail(err, LF_BAD_INPUT,
                   "%s: not a checkpoint of elf (%s); give a file that elf-train wrote", path,
                   what);
}

/* A number from 0 to 1e15, which fits a long. */
static lf_status read_number(const lf_safetensors *file, const char *path, const char *key,
                             double *out, lf_error *err)
{
    const char *text = lf_safetensors_meta(file, key);
    char *end = NULL;
    *out = text ? strtod(text, &end) : 0;
    if (!text || end == text || *end || !(*out >= 0 && *out <= 1e15))
        return not_ours(path, key, err);
    return LF_OK;
}

/* The losses since the last line of metrics; none if the file does not tell. */
static void read_losses(const lf_safetensors *file, lf_training_state *state)
{
    const char *sum = lf_safetensors_meta(file, "loss_sum");
    const char *steps = lf_safetensors_meta(file, "loss_steps");
    state->loss_sum = sum ? strtod(sum, NULL) : 0;
    state->loss_steps = steps ? strtol(steps, NULL, 10) : 0;
    if (state->loss_steps < 0 || state->loss_steps > state->step)
        state->loss_sum = 0, state->loss_steps = 0;
}

static lf_status read_state(const lf_safetensors *file, const char *path, lf_training_state *state,
                            long *adam_steps, lf_error *err)
{
    double step, adam, seconds, skipped, bad;
    const char *format = lf_safetensors_meta(file, "format");
    if (!format || strcmp(format, FORMAT) != 0)
        return not_ours(path, "no format " FORMAT " in its metadata", err);
    LF_TRY(read_number(file, path, "step", &step, err));
    LF_TRY(read_number(file, path, "adam_steps", &adam, err));
    LF_TRY(read_number(file, path, "seconds", &seconds, err));
    LF_TRY(read_number(file, path, "skipped", &skipped, err));
    LF_TRY(read_number(file, path, "bad_in_a_row", &bad, err));
    if (state) {
        *state = (lf_training_state){(long)step, (long)skipped, (long)bad, seconds, 0, 0};
        read_losses(file, state);
    }
    if (adam_steps)
        *adam_steps = (long)adam;
    return LF_OK;
}

lf_status lf_checkpoint_config(const char *path, lf_config **cfg, lf_training_state *state,
                               lf_error *err)
{
    lf_safetensors *file;
    LF_TRY(lf_safetensors_open(path, &file, err));
    lf_status status = read_state(file, path, state, NULL, err);
    if (status == LF_OK) {
        const char *text = lf_safetensors_meta(file, "config");
        status = text ? lf_config_parse_text(text, path, cfg, err) : not_ours(path, "config", err);
    }
    lf_safetensors_close(file);
    return status;
}

/* Every array of the file must be one that the model has. */
static lf_status find_strangers(const lf_safetensors *file, const char *path, const lf_store *store,
                                lf_error *err)
{
    for (int i = 0; i < lf_safetensors_count(file); i++) {
        const char *name = lf_safetensors_at(file, i)->name;
        const bool moment = strncmp(name, "adam.", 5) == 0;
        if (!moment && !lf_store_find(store, name))
            return lf_fail(err, LF_BAD_INPUT,
                           "%s: holds %s, which this model has not: the checkpoint belongs to "
                           "another model",
                           path, name);
    }
    return LF_OK;
}

static lf_status read_arrays(const lf_safetensors *file, const lf_store *store, const char *prefix,
                             bool all, lf_real *out, lf_error *err)
{
    for (int i = 0; i < lf_store_count(store); i++) {
        const lf_parameter *p = lf_store_at(store, i);
        char name[NAME];
        snprintf(name, sizeof name, "%s%s", prefix, p->name);
        if (all || p->trainable)
            LF_TRY(lf_safetensors_copy(file, name, p->rank, p->dim, out + p->offset, err));
    }
    return LF_OK;
}

lf_status lf_checkpoint_read(const char *path, lf_store *store, lf_adam *adam, lf_error *err)
{
    lf_safetensors *file;
    LF_TRY(lf_safetensors_open(path, &file, err));
    const size_t bytes = (size_t)lf_store_size(store) * sizeof(lf_real);
    lf_real *values = calloc(1, bytes ? bytes : 1);
    LF_REQUIRE(values, "out of memory for %zu bytes of parameters", bytes);
    long adam_steps = 0;
    lf_status status = read_state(file, path, NULL, &adam_steps, err);
    if (status == LF_OK)
        status = find_strangers(file, path, store, err);
    if (status == LF_OK)
        status = read_arrays(file, store, "", true, values, err);
    if (status == LF_OK && adam)
        status = read_arrays(file, store, "adam.m.", false, adam->m, err);
    if (status == LF_OK && adam)
        status = read_arrays(file, store, "adam.v.", false, adam->v, err);
    if (status == LF_OK) {
        memcpy(lf_store_values(store), values, bytes);
        if (adam)
            adam->steps = adam_steps;
    }
    free(values);
    lf_safetensors_close(file);
    return status;
}
