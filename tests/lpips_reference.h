/* lpips_reference.h: LPIPS in plain loops in double, channels first, over random weights in the
 * layouts of their file. */
#ifndef LF_TESTS_LPIPS_REFERENCE_H
#define LF_TESTS_LPIPS_REFERENCE_H

#include "autograd/safetensors.h"
#include "datasets/image.h"
#include "eval/lpips.h"

enum { MOST_ARRAYS = 32 };

typedef struct weights {
    int count;
    char name[MOST_ARRAYS][40];
    lf_array array[MOST_ARRAYS]; /* the data is allocated, F32 */
} weights;

/* The same numbers each time; freed by free_weights. */
void random_weights(lf_lpips_net net, weights *w);
void free_weights(weights *w);
lf_array *array_of(weights *w, const char *name);
void write_weights(const weights *w, const char *path);

/* The distance of two images of three channels in [0, 1]. */
double lpips_reference(lf_lpips_net net, weights *w, const lf_image *a, const lf_image *b);

#endif
