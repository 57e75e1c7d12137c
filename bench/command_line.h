/* command_line.h: what elf-bench's jobs ask of their options. Errors: LF_BAD_INPUT. */
#ifndef LF_BENCH_COMMAND_LINE_H
#define LF_BENCH_COMMAND_LINE_H

#include "autograd/status.h"

/* A number from 1 to 1024. */
lf_status lf_bench_positive(const char *option, const char *text, int *value, lf_error *err);
/* A file that cannot be written is refused before an hour of measuring. */
lf_status lf_bench_check_file(const char *path, lf_error *err);
/* The same of a picture: a PNG, drawn by the program in float. */
lf_status lf_bench_check_picture(const char *path, lf_error *err);

#endif
