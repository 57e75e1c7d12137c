/* pareto.h: which settings are worth having: none is better in both respects; and which of those
 * that are good enough is the fastest.
 */
#ifndef LF_EVAL_PARETO_H
#define LF_EVAL_PARETO_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

/* on[i] of n points (cost, error), both better the smaller: no other point is at most as large in
 * both and smaller in one. Equal points are on the front together; a point with a coordinate that
 * is NaN is not, and dominates none. */
void lf_pareto_front(long n, const double *cost, const double *error, bool *on);

/* The point of least cost among those whose quality (the larger the better) is at least `exact` -
 * tolerance; of several the one of best quality, then the first. -1 if there is none. */
long lf_pareto_choose(long n, const double *cost, const double *quality, double exact,
                      double tolerance);

#ifdef __cplusplus
}
#endif
#endif
