/* npy.h: NumPy's .npy files of real numbers, one array a file (format versions 1, 2 and 3).
 *
 * Read: little-endian float64 ('<f8') and float32 ('<f4'), C order, at most 8 axes; anything else
 * is refused by name. Written: version 1, '<f8'.
 *
 * Ownership: lf_npy_read gives value, which the caller frees with free().
 * Errors:    LF_BAD_INPUT names the file and what is wrong; outputs untouched.
 */
#ifndef LF_DATASETS_NPY_H
#define LF_DATASETS_NPY_H

#include "autograd/status.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { LF_NPY_AXES = 8 };

typedef struct lf_npy {
    int axes;
    long shape[LF_NPY_AXES];
    long count;    /* product of shape */
    double *value; /* [count], the last axis runs fastest */
} lf_npy;

lf_status lf_npy_read(const char *path, lf_npy *out, lf_error *err);
lf_status lf_npy_write(const char *path, int axes, const long *shape, const double *value,
                       lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
