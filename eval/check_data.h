/* check_data.h: elf-eval check-data: what a folder of posed photographs is. */
#ifndef LF_EVAL_CHECK_DATA_H
#define LF_EVAL_CHECK_DATA_H

#include <stdio.h>

#include "datasets/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Open the scene, print what it is (layout, views a split, sizes, lenses, depths, frames left out,
 * how far corners lie from their epipolar lines) to `out` (NULL: nothing), and draw it into the PNG
 * `picture` (NULL: none). The errors are those of lf_scene_open and lf_scene_draw. */
lf_status lf_check_data(const char *path, const char *picture, FILE *out, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
