/* same_arrays.h: do two safetensors files hold the same arrays, bit for bit? */
#ifndef LF_TESTS_SAME_ARRAYS_H
#define LF_TESTS_SAME_ARRAYS_H

#include "autograd/safetensors.h"

static inline bool same_array(const lf_array *a, const lf_array *b)
{
    size_t bytes = lf_dtype_size(a->dtype);
    if (!b || a->dtype != b->dtype || a->rank != b->rank)
        return false;
    for (int i = 0; i < a->rank; i++) {
        if (a->dim[i] != b->dim[i])
            return false;
        bytes *= (size_t)a->dim[i];
    }
    return memcmp(a->data, b->data, bytes) == 0;
}

/* NULL if they do, else what differs (in `text`): names, types, shapes, numbers; of the metadata
 * "step", "adam_steps" and "skipped". */
static inline const char *different_arrays(const char *first, const char *second, lf_error *text)
{
    static const char *const keys[] = {"step", "adam_steps", "skipped"};
    lf_safetensors *a = NULL, *b = NULL;
    const char *found = NULL;
    if (lf_safetensors_open(first, &a, text) != LF_OK ||
        lf_safetensors_open(second, &b, text) != LF_OK)
        found = text->text;
    for (int i = 0; !found && i < lf_safetensors_count(a); i++) {
        const lf_array *x = lf_safetensors_at(a, i);
        if (!same_array(x, lf_safetensors_find(b, x->name)))
            found = (lf_fail(text, LF_FAILED, "array %s differs", x->name), text->text);
    }
    if (!found && lf_safetensors_count(a) != lf_safetensors_count(b))
        found = "the second file holds more arrays";
    for (int k = 0; !found && k < 3; k++) {
        const char *x = lf_safetensors_meta(a, keys[k]), *y = lf_safetensors_meta(b, keys[k]);
        if ((x || y) && (!x || !y || strcmp(x, y) != 0))
            found = (lf_fail(text, LF_FAILED, "%s differs", keys[k]), text->text);
    }
    lf_safetensors_close(a);
    lf_safetensors_close(b);
    return found;
}

#endif
