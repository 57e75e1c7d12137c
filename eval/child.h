/* child.h: run a program of elf that stands beside this one, and wait for it. */
#ifndef LF_EVAL_CHILD_H
#define LF_EVAL_CHILD_H

#include "autograd/status.h"

/* The path of `name` in the folder of the running program; malloc'd. LF_BAD_INPUT if there is no
 * such program: build or install all programs. */
lf_status lf_child_find(const char *name, char **path, lf_error *err);

/* Run it with arguments argv (argv[0] its name, NULL at the end); its standard output is thrown
 * away. If it fails: its exit code as status, and what it said on standard error as text. Meanwhile
 * Ctrl-C ends the child alone: LF_STOPPED, so that the caller can clean up. One caller at a time.
 */
lf_status lf_child_run(const char *path, char *const argv[], lf_error *err);

#endif
