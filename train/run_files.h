/* run_files.h: names and checkpoints in a run's folder. Internal to train/. */
#ifndef LF_TRAIN_RUN_FILES_H
#define LF_TRAIN_RUN_FILES_H

#include "autograd/status.h"

/* A checkpoint, relative to the run's folder; printed and scanned with a long. */
#define LF_CHECKPOINT_FORMAT "checkpoints/step-%08ld.safetensors"
#define LF_CHECKPOINT_SCAN "checkpoints/step-%ld.safetensors"

/* folder/name, malloc'd. */
char *lf_path_join(const char *folder, const char *name);

/* The steps of the checkpoints of a run, rising; *steps is malloc'd. Returns their number, 0 if the
 * folder cannot be read. */
int lf_checkpoint_steps(const char *folder, long **steps);

/* LF_OK if the file can be read and is whole. */
lf_status lf_checkpoint_sound(const char *path, lf_error *err);

#endif
