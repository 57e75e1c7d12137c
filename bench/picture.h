/* picture.h: what elf-bench found, as a picture of two panels.            [docs/performance.md]
 *
 * Above, the roofline: rate of each case against its operations a byte, below what multiply-adds
 * and the bandwidths of memory and caches allow. Below, time against error. A case is a labelled
 * point in the colour of its group.
 */
#ifndef LF_BENCH_PICTURE_H
#define LF_BENCH_PICTURE_H

#include "bench/measure.h"

enum { LF_PICTURE_WIDTH = 1200, LF_PICTURE_HEIGHT = 1600 };

/* Write a PNG. LF_BAD_INPUT: no case has both operations and bytes. */
lf_status lf_bench_picture(const char *path, const lf_bench_result *results, int count,
                           const lf_seen_limits *seen, lf_error *err);

#endif
