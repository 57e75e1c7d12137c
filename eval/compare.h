/* compare.h: the figures of any two mesh files ("elf-eval compare-meshes A B"). */
#ifndef LF_EVAL_COMPARE_H
#define LF_EVAL_COMPARE_H

#include <stdio.h>

#include "autograd/status.h"
#include "eval/metrics.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct lf_compare_options {
    lf_metric_options metric;
    bool normalise;   /* first centre each mesh and give its box a diagonal of 1; default no: both
                         files are taken to be in one frame */
    const char *json; /* a file for the object as well, or NULL */
} lf_compare_options;

lf_compare_options lf_compare_defaults(void);

/* Score the mesh in file `predicted` against the one in file `truth` and print a JSON object to
 * `out` (NULL: nowhere); docs/formats.md names its keys. Chamfer, accuracy and completeness are
 * times 10. A predicted mesh without area is an empty prediction, not an error; a file without
 * faces is one. LF_BAD_INPUT: a file that cannot be read as a mesh, a truth without area, options
 * out of range; nothing is printed then. */
lf_status lf_compare_meshes(const char *predicted, const char *truth,
                            const lf_compare_options *options, FILE *out, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
