/* limit.h: the machine's own limit of multiply-adds, which times are compared with. */
#ifndef LF_AUTOGRAD_KERNELS_LIMIT_H
#define LF_AUTOGRAD_KERNELS_LIMIT_H

/* Do `steps` rounds of independent multiply-adds in registers on each of `threads` threads: the
 * operations done, two a multiply-add. */
double lf_limit_run(long steps, int threads);

/* Operations a second of one run of about a millisecond. The limit is the largest of many: single
 * ones may be disturbed. */
double lf_limit_now(int threads);

#endif
