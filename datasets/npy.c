/* npy.c: header text and numbers of .npy files. */
#include "datasets/npy.h"

#include <errno.h>
#include <stdbool.h>
#include <stdint.h>

#include "datasets/mesh_file.h"

enum { MAGIC = 6, NPY_ALIGN = 64 };

/* What follows "'key':" in the header, or NULL. */
static const char *value_of(const char *header, const char *key)
{
    const char *at = strstr(header, key);
    if (!at)
        return NULL;
    at += strlen(key);
    at += strspn(at, " ");
    if (*at++ != ':')
        return NULL;
    return at + strspn(at, " ");
}

static lf_status read_shape(const char *path, const char *header, lf_npy *npy, lf_error *err)
{
    const char *at = value_of(header, "'shape'");
    if (!at || *at++ != '(')
        return lf_fail(err, LF_BAD_INPUT, "%s: the .npy header has no 'shape': (...)", path);
    npy->count = 1;
    for (;;) {
        at += strspn(at, " ,");
        if (*at == ')')
            return LF_OK;
        char *end;
        errno = 0;
        const long n = strtol(at, &end, 10);
        if (end == at || errno || n < 1 || npy->axes == LF_NPY_AXES ||
            __builtin_mul_overflow(npy->count, n, &npy->count) || npy->count > 1L << 40)
            return lf_fail(err, LF_BAD_INPUT,
                           "%s: the .npy header has a shape that cannot be read (%.40s); 1 to %d "
                           "axes of at least 1 are taken",
                           path, at, LF_NPY_AXES);
        npy->shape[npy->axes++] = n;
        at = end;
    }
}

/* Bytes a number: 8 or 4. */
static lf_status read_kind(const char *path, const char *header, size_t *size, lf_error *err)
{
    const char *descr = value_of(header, "'descr'"), *order = value_of(header, "'fortran_order'");
    if (!descr || !order)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: the .npy header lacks 'descr' or 'fortran_order': it is damaged", path);
    if (strncmp(order, "False", 5) != 0)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: the array is in Fortran order; save numpy.ascontiguousarray(a)", path);
    *size = strncmp(descr, "'<f8'", 5) == 0 ? 8 : strncmp(descr, "'<f4'", 5) == 0 ? 4 : 0;
    if (!*size)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: the numbers are of type %.12s; '<f8' and '<f4' are read: save "
                       "a.astype('<f8')",
                       path, descr);
    return LF_OK;
}

static double number_at(const char *data, size_t size, long i)
{
    uint64_t bits = 0;
    for (size_t k = 0; k < size; k++)
        bits |= (uint64_t)(unsigned char)data[(size_t)i * size + k] << 8 * k;
    if (size == 4) {
        const uint32_t low = (uint32_t)bits;
        float x;
        memcpy(&x, &low, 4);
        return (double)x;
    }
    double x;
    memcpy(&x, &bits, 8);
    return x;
}

static lf_status read_header(const char *path, lf_bytes file, lf_npy *npy, size_t *size,
                             size_t *begin, lf_error *err)
{
    const unsigned char *d = (const unsigned char *)file.data;
    if (file.size < 12 || memcmp(d, "\x93NUMPY", MAGIC) != 0)
        return lf_fail(err, LF_BAD_INPUT, "%s: is no .npy file (it does not begin with \\x93NUMPY)",
                       path);
    if (d[6] < 1 || d[6] > 3)
        return lf_fail(err, LF_BAD_INPUT, "%s: .npy version %d; 1, 2 and 3 are read", path, d[6]);
    const size_t start = d[6] == 1 ? 10 : 12;
    const size_t length =
        d[6] == 1 ? (size_t)d[8] | (size_t)d[9] << 8
                  : (size_t)d[8] | (size_t)d[9] << 8 | (size_t)d[10] << 16 | (size_t)d[11] << 24;
    if (length > file.size - start || length > 65536)
        return lf_fail(err, LF_BAD_INPUT, "%s: the .npy header is cut short or damaged", path);
    char *header = strndup(file.data + start, length);
    LF_REQUIRE(header, "out of memory");
    lf_status status = read_kind(path, header, size, err);
    if (status == LF_OK)
        status = read_shape(path, header, npy, err);
    free(header);
    *begin = start + length;
    return status;
}

static lf_status read_array(const char *path, lf_bytes file, lf_npy *npy, lf_error *err)
{
    size_t size = 8, begin = 0;
    LF_TRY(read_header(path, file, npy, &size, &begin, err));
    if ((file.size - begin) / size != (size_t)npy->count || (file.size - begin) % size)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: the header promises %ld numbers of %zu bytes, %zu bytes follow: the "
                       "file is cut short or damaged",
                       path, npy->count, size, file.size - begin);
    npy->value = malloc((size_t)npy->count * sizeof *npy->value);
    if (!npy->value)
        return lf_fail(err, LF_FAILED, "%s: no memory for %ld numbers", path, npy->count);
    for (long i = 0; i < npy->count; i++)
        npy->value[i] = number_at(file.data + begin, size, i);
    return LF_OK;
}

lf_status lf_npy_read(const char *path, lf_npy *out, lf_error *err)
{
    lf_bytes file;
    lf_npy npy = {0};
    LF_TRY(lf_bytes_read(path, &file, err));
    const lf_status status = read_array(path, file, &npy, err);
    free(file.data);
    if (status == LF_OK)
        *out = npy;
    return status;
}

static bool write_array(FILE *f, int axes, const long *shape, const double *value)
{
    char text[256] = "{'descr': '<f8', 'fortran_order': False, 'shape': (";
    size_t used = strlen(text);
    long count = 1;
    for (int i = 0; i < axes; i++) {
        used += (size_t)snprintf(text + used, sizeof text - used, "%ld%s", shape[i],
                                 axes == 1      ? ","
                                 : i + 1 < axes ? ", "
                                                : "");
        count *= shape[i];
    }
    used += (size_t)snprintf(text + used, sizeof text - used, "), }");
    while ((10 + used + 1) % NPY_ALIGN)
        text[used++] = ' ';
    text[used++] = '\n';
    const char head[10] = {(char)0x93,       'N', 'U', 'M', 'P', 'Y', 1, 0, (char)(used & 255),
                           (char)(used >> 8)};
    if (fwrite(head, 1, 10, f) != 10 || fwrite(text, 1, used, f) != used)
        return false;
    for (long i = 0; i < count; i++) {
        uint64_t bits;
        char bytes[8];
        memcpy(&bits, &value[i], 8);
        for (int k = 0; k < 8; k++)
            bytes[k] = (char)(bits >> 8 * k & 255);
        if (fwrite(bytes, 1, 8, f) != 8)
            return false;
    }
    return true;
}

lf_status lf_npy_write(const char *path, int axes, const long *shape, const double *value,
                       lf_error *err)
{
    LF_REQUIRE(axes >= 1 && axes <= LF_NPY_AXES, "%d axes", axes);
    FILE *f = fopen(path, "wb");
    if (!f)
        return lf_fail(err, LF_FAILED, "%s: cannot be written: %s", path, strerror(errno));
    const bool written = write_array(f, axes, shape, value);
    if (fclose(f) || !written)
        return lf_fail(err, LF_FAILED, "%s: cannot be written: %s", path, strerror(errno));
    return LF_OK;
}
