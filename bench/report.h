/* report.h: what elf-bench found, as text and as JSON.                    [docs/performance.md] */
#ifndef LF_BENCH_REPORT_H
#define LF_BENCH_REPORT_H

#include <jansson.h>

#include "bench/measure.h"

/* A line that names the columns, and a line of them. */
void lf_bench_head(FILE *to);
void lf_bench_line(FILE *to, const lf_bench_result *result);

/* A table in Markdown of every array's error against double: its head, and the rows of a case. */
void lf_bench_error_head(FILE *to);
void lf_bench_error_rows(FILE *to, const lf_bench_result *result);

/* {"precision", "threads", "vector_bytes", "compiler", "limits": {"gflops", "gbytes_per_s": {BYTES:
 * ...}}, "results": [...]}; of the result of a case what is known of it. The caller's. */
json_t *lf_bench_json(const lf_bench_result *results, int count, const lf_seen_limits *seen,
                      int threads);
/* Write it to a file, whole or not at all. */
lf_status lf_bench_json_write(const char *path, const json_t *report, lf_error *err);

#endif
