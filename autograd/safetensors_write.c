/* safetensors_write.c: arrays and metadata into one file (safetensors.h describes it). */
#include "autograd/safetensors_format.h"

#include <jansson.h>
#include <stdlib.h>

static size_t array_bytes(const lf_array *array)
{
    size_t bytes = lf_dtype_size(array->dtype);
    for (int i = 0; i < array->rank; i++)
        bytes *= (size_t)array->dim[i]; /* it is in memory, so this cannot overflow */
    return bytes;
}

/* The pieces of the file after its header: numbers of 8 bytes first, then 4, then 1. order[i] is
 * the array of piece i. */
static void arrange(const lf_array *array, int arrays, lf_bytes *piece, int *order)
{
    int n = 0;
    for (size_t size = 8; size; size /= 2)
        for (int i = 0; i < arrays; i++)
            if (lf_dtype_size(array[i].dtype) == size) {
                order[n] = i;
                piece[n++] = (lf_bytes){array[i].data, array_bytes(&array[i])};
            }
}

static bool add_metadata(json_t *header, const lf_meta *meta, int metas, const char *checksum,
                         lf_error *err)
{
    json_t *object = json_object();
    for (int i = 0; i < metas; i++)
        if (json_object_set_new(object, meta[i].key, json_string(meta[i].value))) {
            lf_fail(err, LF_BAD_INPUT, "metadata %.80s is no UTF-8 text", meta[i].key);
            json_decref(object);
            return false;
        }
    json_object_set_new(object, LF_CHECKSUM_KEY, json_string(checksum));
    json_object_set_new(header, LF_METADATA_KEY, object);
    return true;
}

static bool add_array(json_t *header, const lf_array *array, size_t begin, size_t end,
                      lf_error *err)
{
    json_t *shape = json_array();
    for (int i = 0; i < array->rank; i++)
        json_array_append_new(shape, json_integer(array->dim[i]));
    LF_REQUIRE(!json_object_get(header, array->name), "safetensors: %s is given twice",
               array->name);
    json_t *entry = json_pack("{s:s, s:o, s:[I, I]}", "dtype", lf_dtype_name(array->dtype), "shape",
                              shape, "data_offsets", (json_int_t)begin, (json_int_t)end);
    if (!json_object_set_new(header, array->name, entry))
        return true;
    lf_fail(err, LF_BAD_INPUT, "array name %.80s is no UTF-8 text", array->name);
    return false;
}

/* The JSON header, padded to 8 bytes with its length in front; malloc'd. NULL: see err. */
static char *make_header(const lf_array *array, int arrays, const lf_bytes *piece, const int *order,
                         const lf_meta *meta, int metas, size_t *size, lf_error *err)
{
    XXH3_state_t *state = XXH3_createState();
    LF_REQUIRE(state, "safetensors: out of memory");
    XXH3_128bits_reset(state);
    for (int i = 0; i < arrays; i++)
        if (piece[i].size)
            XXH3_128bits_update(state, piece[i].data, piece[i].size);
    char checksum[33], *file = NULL;
    lf_checksum_text(state, checksum);
    XXH3_freeState(state);

    json_t *header = json_object();
    bool ok = add_metadata(header, meta, metas, checksum, err);
    size_t at = 0;
    for (int i = 0; i < arrays && ok; at += piece[i++].size)
        ok = add_array(header, &array[order[i]], at, at + piece[i].size, err);
    char *json = ok ? json_dumps(header, JSON_COMPACT) : NULL;
    json_decref(header);
    if (json) {
        const size_t length = strlen(json), padded = (length + 7) / 8 * 8;
        file = malloc(8 + padded);
        LF_REQUIRE(file, "safetensors: out of memory");
        for (int i = 0; i < 8; i++)
            file[i] = (char)(unsigned char)(padded >> (8 * i));
        memset(file + 8, ' ', padded);
        memcpy(file + 8, json, length);
        *size = 8 + padded;
    }
    free(json);
    return file;
}

lf_status lf_safetensors_write(const char *path, const lf_array *array, int arrays,
                               const lf_meta *meta, int metas, const lf_fault *fault, lf_error *err)
{
    lf_bytes *piece = malloc((size_t)(arrays + 1) * sizeof *piece);
    int *order = malloc((size_t)(arrays + 1) * sizeof *order);
    LF_REQUIRE(piece && order, "safetensors: out of memory");
    arrange(array, arrays, piece + 1, order);
    lf_error why;
    char *header = make_header(array, arrays, piece + 1, order, meta, metas, &piece[0].size, &why);
    piece[0].data = header;
    lf_status status = header ? lf_atomic_write(path, piece, arrays + 1, fault, err)
                              : lf_fail(err, LF_BAD_INPUT, "%s: %s", path, why.text);
    free(header);
    free(order);
    free(piece);
    return status;
}
