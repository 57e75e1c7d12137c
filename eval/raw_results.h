/* raw_results.h: what a network gives for some test items, before anything is scored: the file of
 * elf-eval --measure, which another process reads.                            [docs/formats.md]
 *
 * A safetensors file. Of item i: "i.seconds", "i.cpu_seconds", "i.before_mb", "i.peak_mb", "i.work"
 * (F64, one each), * "i.numbers" [n] (F64; NaN: no opinion), and of a reconstruction "i.vertices"
 * [v, 3] (F64) and "i.faces" [f, 3] (I64). Metadata: "format" = "elf-raw-1", "precision", "items",
 * "memory".
 */
#ifndef LF_EVAL_RAW_RESULTS_H
#define LF_EVAL_RAW_RESULTS_H

#include "autograd/status.h"
#include "datasets/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct lf_raw_item {
    double seconds; /* of the network and what follows to a mesh or a picture; no reading of data */
    double cpu_seconds; /* of all threads, meanwhile */
    double before_mb;   /* resident set of the process before, 10^6 bytes */
    double peak_mb;     /* the largest meanwhile */
    double work;        /* reconstruction: points evaluated; rendering: (sample, view) pairs */
    long numbers;
    double *number; /* distances at fixed points (NaN: seen by no view), or colours of the pixels */
    lf_mesh *mesh;  /* NULL: a rendering */
} lf_raw_item;

typedef struct lf_raw {
    char precision[8];  /* "f32", "f64" */
    bool whole_process; /* peak_mb is that of the process so far: the system cannot reset it */
    long items;
    lf_raw_item *item;
} lf_raw;

/* Room for so many items, all zero. Free it once; lf_raw_free(NULL) does nothing. */
lf_raw *lf_raw_create(long items);
void lf_raw_free(lf_raw *raw);

/* Errors of safetensors.h; LF_BAD_INPUT, too, if a file is not of this format. */
lf_status lf_raw_write(const char *path, const lf_raw *raw, lf_error *err);
lf_status lf_raw_read(const char *path, lf_raw **out, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
