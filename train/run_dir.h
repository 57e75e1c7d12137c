/* run_dir.h: the folder of one training run.
 *
 *     config.ini                          the resolved configuration
 *     metrics.jsonl                       one JSON object a line, in the order of steps
 *     checkpoints/step-%08d.safetensors   the last K and the best by validation
 *     latest                              text: the newest checkpoint, relative to the folder
 *     best                                text: the best checkpoint and its score
 *
 * config.ini, latest, best and the checkpoints are replaced whole or not at all; lines of
 * metrics.jsonl are whole. A folder is open in one process at a time.
 */
#ifndef LF_TRAIN_RUN_DIR_H
#define LF_TRAIN_RUN_DIR_H

#include <jansson.h>
#include <stdbool.h>

#include "autograd/status.h"

typedef struct lf_run lf_run;

/* Start a run in the folder `out`, made with its parents if it is not there. LF_BAD_INPUT if `out`
 * holds another run (any of the names above) or is no folder; what is there stays as it is. */
lf_status lf_run_create(const char *out, const char *config_text, lf_run **run, lf_error *err);

/* LF_BAD_INPUT, in the words of lf_run_create, if `out` holds another run, is no folder, or cannot
 * be made for lack of permission. Nothing is made. */
lf_status lf_run_vacant(const char *out, lf_error *err);

/* Go on with the run in `directory` after step `step`: metrics of later steps are cut off, damaged
 * checkpoints of later steps get the suffix .damaged. LF_BAD_INPUT if there are sound checkpoints
 * of later steps (they would be lost) or another process writes to the run. */
lf_status lf_run_open(const char *directory, long step, lf_run **run, lf_error *err);
void lf_run_close(lf_run *run);

/* Make the folder `path` and its parents; no error if it is there. LF_BAD_INPUT: something else has
 * that name, or it cannot be made; LF_FAILED: the disk is full. */
lf_status lf_make_folders(const char *path, lf_error *err);

const char *lf_run_path(const lf_run *run);
/* The path of a checkpoint, for the caller to write. malloc'd. */
char *lf_run_checkpoint(const lf_run *run, long step);

/* After checkpoint `step` was written: point `latest` to it, note it as the best if its validation
 * `score` is the lowest so far (NAN: not validated), and delete all but the last `keep` and the
 * best. */
lf_status lf_run_saved(lf_run *run, long step, double score, int keep, lf_error *err);

/* Append one line to metrics.jsonl. Takes over `object`, which has an integer "step". */
lf_status lf_run_log(lf_run *run, json_t *object, lf_error *err);
/* object[key] = value; null if value is not finite, which JSON cannot say. */
void lf_json_real(json_t *object, const char *key, double value);

/* Where a run can go on. */
typedef struct lf_found {
    char *directory;  /* the run's folder, or NULL if the checkpoint stands alone; malloc'd */
    char *checkpoint; /* path; malloc'd */
    long step;        /* from the file's name; -1 if that has none */
    char note[512];   /* damaged checkpoints that were passed over, or "" */
} lf_found;

/* `path` is a run's folder (its newest sound checkpoint is found) or a checkpoint (which must be
 * sound). Release with lf_found_free. */
lf_status lf_run_find(const char *path, lf_found *found, lf_error *err);
void lf_found_free(lf_found *found);

#endif
