/* stability_report.h: the table of `elf-bench stability`. [docs/stability.md] */
#ifndef LF_BENCH_STABILITY_REPORT_H
#define LF_BENCH_STABILITY_REPORT_H

#include "autograd/status.h"

/* elf-bench stability [CASE...] [--worst] [--check] [--list] [--json FILE]: errors of every case
 * and parameter, in float and in double, by the program in double beside this one. argv[0] is
 * "stability". */
lf_status lf_stability_main(int argc, char **argv, lf_error *err);

#endif
