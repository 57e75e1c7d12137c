/* safetensors_read.c: one file into memory, everything checked (safetensors.h describes it).
 *
 * Nothing in the file is trusted: a length is compared with the file's before anything is allocated
 * or read by it, a product of dims before it is used.
 */
#include "autograd/safetensors_format.h"

#include <errno.h>
#include <inttypes.h>
#include <jansson.h>
#include <stdlib.h>
#include <sys/stat.h>

enum { LARGEST_HEADER = 100000000 };

struct lf_safetensors {
    char *path;
    unsigned char *bytes; /* the whole file */
    size_t size;
    const unsigned char *data; /* the arrays' bytes */
    size_t data_size;
    json_t *header; /* owns names and metadata */
    lf_array *array;
    int arrays;
    bool checked;
};

static const struct {
    const char *name;
    size_t size;
} dtypes[] = {
    [LF_F32] = {"F32", 4}, [LF_F64] = {"F64", 8}, [LF_I64] = {"I64", 8}, [LF_U8] = {"U8", 1}};
enum { DTYPES = sizeof dtypes / sizeof *dtypes };

const char *lf_dtype_name(lf_dtype dtype)
{
    return dtypes[dtype].name;
}

size_t lf_dtype_size(lf_dtype dtype)
{
    return dtypes[dtype].size;
}

/* ---- the bytes ------------------------------------------------------------------------------- */

static lf_status read_bytes(lf_safetensors *f, lf_error *err)
{
    FILE *file = fopen(f->path, "rb");
    struct stat info;
    if (!file)
        return lf_fail(err, LF_BAD_INPUT, "%s: %s", f->path, strerror(errno));
    lf_status status = LF_OK;
    if (fstat(fileno(file), &info) || !S_ISREG(info.st_mode))
        status = lf_fail(err, LF_BAD_INPUT, "%s: not a file", f->path);
    else if (info.st_size < 8)
        status = lf_fail(err, LF_BAD_INPUT,
                         "%s: %lld bytes are too few for a safetensors file: truncated?", f->path,
                         (long long)info.st_size);
    else if (!(f->bytes = malloc((size_t)info.st_size)))
        status = lf_fail(err, LF_FAILED, "%s: no memory for %lld bytes", f->path,
                         (long long)info.st_size);
    else if (fread(f->bytes, 1, (size_t)info.st_size, file) != (size_t)info.st_size)
        status = lf_fail(err, LF_BAD_INPUT, "%s: %s", f->path,
                         ferror(file) ? strerror(errno) : "shrank while it was read");
    f->size = (size_t)info.st_size;
    fclose(file);
    return status;
}

static lf_status read_header(lf_safetensors *f, lf_error *err)
{
    uint64_t length = 0;
    for (int i = 0; i < 8; i++)
        length |= (uint64_t)f->bytes[i] << (8 * i);
    if (length > LARGEST_HEADER)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: a header of %" PRIu64 " bytes; at most %d are allowed: no safetensors "
                       "file",
                       f->path, length, LARGEST_HEADER);
    if (length > f->size - 8)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: truncated: the header needs %" PRIu64 " bytes, the file has %zu",
                       f->path, length + 8, f->size);
    f->data = f->bytes + 8 + length;
    f->data_size = f->size - 8 - (size_t)length;
    json_error_t where;
    f->header =
        json_loadb((const char *)f->bytes + 8, (size_t)length, JSON_REJECT_DUPLICATES, &where);
    if (!f->header)
        return lf_fail(err, LF_BAD_INPUT, "%s: the header is no JSON: %s (byte %d of the header)",
                       f->path, where.text, where.position);
    if (!json_is_object(f->header))
        return lf_fail(err, LF_BAD_INPUT, "%s: the header is no JSON object", f->path);
    return LF_OK;
}

/* ---- one entry of the header ------------------------------------------------------------------
 */

static lf_status bad_entry(const lf_safetensors *f, const char *name, const char *what,
                           lf_error *err)
{
    return lf_fail(err, LF_BAD_INPUT, "%s: array %.100s: %s", f->path, name, what);
}

static lf_status read_dtype(const lf_safetensors *f, const char *name, const json_t *entry,
                            lf_dtype *dtype, lf_error *err)
{
    const char *text = json_string_value(json_object_get(entry, "dtype"));
    for (int i = 0; text && i < DTYPES; i++)
        if (!strcmp(text, dtypes[i].name)) {
            *dtype = (lf_dtype)i;
            return LF_OK;
        }
    return lf_fail(err, LF_BAD_INPUT,
                   "%s: array %.100s: dtype %.20s; allowed are F32, F64, I64 and U8", f->path, name,
                   text ? text : "is missing");
}

/* Dims, and the bytes that they stand for. */
static lf_status read_shape(const lf_safetensors *f, const json_t *entry, lf_array *array,
                            size_t *bytes, lf_error *err)
{
    const json_t *shape = json_object_get(entry, "shape");
    if (!json_is_array(shape))
        return bad_entry(f, array->name, "shape is missing or no list", err);
    if (json_array_size(shape) > LF_ARRAY_RANK)
        return bad_entry(f, array->name, "shape has more than 8 dims", err);
    array->rank = (int)json_array_size(shape);
    *bytes = lf_dtype_size(array->dtype);
    for (int i = 0; i < array->rank; i++) {
        const json_t *dim = json_array_get(shape, (size_t)i);
        const json_int_t n = json_integer_value(dim);
        if (!json_is_integer(dim) || n < 0)
            return bad_entry(f, array->name, "shape has a dim that is no whole number >= 0", err);
        if (__builtin_mul_overflow(*bytes, (size_t)n, bytes))
            return bad_entry(f, array->name, "shape has more bytes than can be counted", err);
        array->dim[i] = (long)n;
    }
    return LF_OK;
}

static lf_status read_entry(const lf_safetensors *f, const char *name, const json_t *entry,
                            lf_array *array, lf_error *err)
{
    array->name = name;
    size_t bytes = 0;
    LF_TRY(read_dtype(f, name, entry, &array->dtype, err));
    LF_TRY(read_shape(f, entry, array, &bytes, err));
    const json_t *offsets = json_object_get(entry, "data_offsets");
    const json_t *first = json_array_get(offsets, 0), *last = json_array_get(offsets, 1);
    if (json_array_size(offsets) != 2 || !json_is_integer(first) || !json_is_integer(last))
        return bad_entry(f, name, "data_offsets is not [begin, end]", err);
    const json_int_t begin = json_integer_value(first), end = json_integer_value(last);
    if (begin < 0 || end < begin)
        return bad_entry(f, name, "data_offsets end before they begin", err);
    if ((size_t)end > f->data_size)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: truncated: array %.100s ends at byte %lld of %zu bytes of data",
                       f->path, name, (long long)end, f->data_size);
    if ((size_t)(end - begin) != bytes)
        return bad_entry(f, name, "data_offsets do not fit the shape", err);
    array->data = f->data + begin;
    return LF_OK;
}

/* ---- all entries ------------------------------------------------------------------------------
 */

static size_t bytes_of(const lf_array *array)
{
    size_t bytes = lf_dtype_size(array->dtype);
    for (int i = 0; i < array->rank; i++)
        bytes *= (size_t)array->dim[i];
    return bytes;
}

/* Arrays in the order of their bytes; empty ones before others. */
static int by_offset(const void *a, const void *b)
{
    const lf_array *x = a, *y = b;
    if (x->data != y->data)
        return (const char *)x->data < (const char *)y->data ? -1 : 1;
    return (bytes_of(x) > 0) - (bytes_of(y) > 0);
}

static lf_status check_cover(const lf_safetensors *f, lf_error *err)
{
    const unsigned char *at = f->data;
    for (int i = 0; i < f->arrays; i++) {
        const unsigned char *begin = f->array[i].data;
        if (begin < at)
            return bad_entry(f, f->array[i].name, "overlaps another array", err);
        if (begin > at)
            return bad_entry(f, f->array[i].name, "stands behind a gap", err);
        at += bytes_of(&f->array[i]);
    }
    if (at != f->data + f->data_size)
        return lf_fail(err, LF_BAD_INPUT, "%s: %zu bytes behind the last array", f->path,
                       (size_t)(f->data + f->data_size - at));
    return LF_OK;
}

static lf_status read_entries(lf_safetensors *f, lf_error *err)
{
    f->array = calloc(json_object_size(f->header) + 1, sizeof *f->array);
    if (!f->array)
        return lf_fail(err, LF_FAILED, "%s: out of memory", f->path);
    const char *name;
    json_t *entry;
    json_object_foreach(f->header, name, entry)
    {
        if (strcmp(name, LF_METADATA_KEY) != 0)
            LF_TRY(read_entry(f, name, entry, &f->array[f->arrays++], err));
    }
    qsort(f->array, (size_t)f->arrays, sizeof *f->array, by_offset);
    return check_cover(f, err);
}

static lf_status check_metadata(lf_safetensors *f, lf_error *err)
{
    json_t *meta = json_object_get(f->header, LF_METADATA_KEY), *value;
    const char *key;
    if (meta && !json_is_object(meta))
        return lf_fail(err, LF_BAD_INPUT, "%s: __metadata__ is no JSON object", f->path);
    json_object_foreach(meta, key, value)
    {
        if (!json_is_string(value))
            return lf_fail(err, LF_BAD_INPUT, "%s: metadata %.100s is no text", f->path, key);
    }
    const char *expected = lf_safetensors_meta(f, LF_CHECKSUM_KEY);
    if (!expected)
        return LF_OK;
    XXH3_state_t *state = XXH3_createState();
    LF_REQUIRE(state, "safetensors: out of memory");
    XXH3_128bits_reset(state);
    if (f->data_size)
        XXH3_128bits_update(state, f->data, f->data_size);
    char found[33];
    lf_checksum_text(state, found);
    XXH3_freeState(state);
    if (strcmp(found, expected) != 0)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: damaged: the checksum of its data is %s, its header says %.40s",
                       f->path, found, expected);
    f->checked = true;
    return LF_OK;
}

/* ---- public -----------------------------------------------------------------------------------
 */

static lf_status read_all(lf_safetensors *f, lf_error *err)
{
    LF_TRY(read_bytes(f, err));
    LF_TRY(read_header(f, err));
    LF_TRY(read_entries(f, err));
    return check_metadata(f, err);
}

lf_status lf_safetensors_open(const char *path, lf_safetensors **out, lf_error *err)
{
    lf_safetensors *f = calloc(1, sizeof *f);
    if (!f || !(f->path = strdup(path))) {
        free(f);
        return lf_fail(err, LF_FAILED, "%s: out of memory", path);
    }
    const lf_status status = read_all(f, err);
    if (status == LF_OK)
        *out = f;
    else
        lf_safetensors_close(f);
    return status;
}

void lf_safetensors_close(lf_safetensors *file)
{
    if (!file)
        return;
    json_decref(file->header);
    free(file->array);
    free(file->bytes);
    free(file->path);
    free(file);
}

int lf_safetensors_count(const lf_safetensors *file)
{
    return file->arrays;
}

const lf_array *lf_safetensors_at(const lf_safetensors *file, int index)
{
    LF_REQUIRE(index >= 0 && index < file->arrays, "safetensors: no array %d", index);
    return &file->array[index];
}

const lf_array *lf_safetensors_find(const lf_safetensors *file, const char *name)
{
    for (int i = 0; i < file->arrays; i++)
        if (!strcmp(file->array[i].name, name))
            return &file->array[i];
    return NULL;
}

const char *lf_safetensors_meta(const lf_safetensors *file, const char *key)
{
    return json_string_value(json_object_get(json_object_get(file->header, LF_METADATA_KEY), key));
}

bool lf_safetensors_checked(const lf_safetensors *file)
{
    return file->checked;
}

static void print_shape(char text[200], int rank, const long *dim)
{
    size_t used = (size_t)snprintf(text, 200, "[");
    for (int i = 0; i < rank; i++)
        used += (size_t)snprintf(text + used, 200 - used, "%s%ld", i ? ", " : "", dim[i]);
    snprintf(text + used, 200 - used, "]");
}

lf_status lf_safetensors_copy(const lf_safetensors *file, const char *name, int rank,
                              const long *dim, lf_real *out, lf_error *err)
{
    const lf_array *array = lf_safetensors_find(file, name);
    if (!array)
        return lf_fail(err, LF_BAD_INPUT, "%s: array %s is missing", file->path, name);
    if (array->dtype != LF_F32 && array->dtype != LF_F64)
        return lf_fail(err, LF_BAD_INPUT, "%s: array %s is %s; expected is F32 or F64", file->path,
                       name, lf_dtype_name(array->dtype));
    if (array->rank != rank || (rank && memcmp(array->dim, dim, (size_t)rank * sizeof *dim) != 0)) {
        char found[200], expected[200];
        print_shape(found, array->rank, array->dim);
        print_shape(expected, rank, dim);
        return lf_fail(err, LF_BAD_INPUT, "%s: array %s has shape %s; expected is %s", file->path,
                       name, found, expected);
    }
    const size_t size = lf_dtype_size(array->dtype), n = bytes_of(array) / size;
    const char *from = array->data;
    for (size_t i = 0; i < n; i++) { /* the bytes may be unaligned */
        float f;
        double d;
        memcpy(size == 4 ? (void *)&f : (void *)&d, from + i * size, size);
        out[i] = size == 4 ? (lf_real)f : (lf_real)d;
    }
    return LF_OK;
}
