/* safetensors.h: named arrays in one file that any safetensors reader opens.
 *
 * The file:  8 bytes        length n of the header, little-endian
 *            n bytes        JSON: {"__metadata__": {key: text}, name: {"dtype", "shape",
 *                           "data_offsets": [begin, end]}, ...}, padded with spaces to 8 bytes
 *            the rest       the arrays, row-major, little-endian, without gaps
 * Arrays of 8-byte numbers come first, then 4-byte, then bytes, so that each is aligned. The
 * metadata key "xxh3_128" is the checksum of all array bytes, 32 hexadecimal digits; a file without
 * it (made by another program) is read without that check.
 */
#ifndef LF_AUTOGRAD_SAFETENSORS_H
#define LF_AUTOGRAD_SAFETENSORS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "autograd/atomic_file.h"
#include "autograd/real.h"
#include "autograd/status.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { LF_ARRAY_RANK = 8 };

typedef enum lf_dtype { LF_F32, LF_F64, LF_I64, LF_U8 } lf_dtype;

/* The dtype of lf_real in this build. */
#ifdef LF_DOUBLE
#define LF_DTYPE_REAL LF_F64
#else
#define LF_DTYPE_REAL LF_F32
#endif

/* "F32" and so on; bytes of one number. */
const char *lf_dtype_name(lf_dtype dtype);
size_t lf_dtype_size(lf_dtype dtype);

/* One array. When writing, the caller's memory; when reading, the file's. */
typedef struct lf_array {
    const char *name;
    lf_dtype dtype;
    int rank; /* 0: one number */
    long dim[LF_ARRAY_RANK];
    const void *data; /* from a file: aligned to its number's size only if the writer did so */
} lf_array;

typedef struct lf_meta {
    const char *key, *value;
} lf_meta;

/* ---- writing --------------------------------------------------------------------------------- */

/* Replace the file `path` by these arrays and metadata, whole or not at all (atomic_file.h; fault
 * as there, NULL except in tests). Names must differ. LF_FAILED if the machine refuses (disk full),
 * LF_BAD_INPUT if the folder does not exist or a text is not UTF-8. */
lf_status lf_safetensors_write(const char *path, const lf_array *array, int arrays,
                               const lf_meta *meta, int metas, const lf_fault *fault,
                               lf_error *err);

/* ---- reading --------------------------------------------------------------------------------- */

typedef struct lf_safetensors lf_safetensors;

/* Read the whole file into memory and check everything: lengths, JSON, names, types, shapes,
 * offsets (inside, without overlap or gap), checksum. LF_BAD_INPUT says which file and what is
 * wrong. */
lf_status lf_safetensors_open(const char *path, lf_safetensors **out, lf_error *err);
void lf_safetensors_close(lf_safetensors *file);

int lf_safetensors_count(const lf_safetensors *file);
/* Array number `index`, in the order of the bytes; or the one with that name, or NULL. */
const lf_array *lf_safetensors_at(const lf_safetensors *file, int index);
const lf_array *lf_safetensors_find(const lf_safetensors *file, const char *name);
/* The metadata text, or NULL. Owned by the file. */
const char *lf_safetensors_meta(const lf_safetensors *file, const char *key);
/* Does the file carry a checksum (which then was right)? */
bool lf_safetensors_checked(const lf_safetensors *file);

/* Copy an array of numbers F32 or F64 into `out`, converted to lf_real. LF_BAD_INPUT, naming file,
 * array, found and expected shape, if it is missing or has another shape or type. */
lf_status lf_safetensors_copy(const lf_safetensors *file, const char *name, int rank,
                              const long *dim, lf_real *out, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
