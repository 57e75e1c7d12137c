/* pareto.c: see pareto.h. */
#include "eval/pareto.h"

#include <math.h>

static bool dominates(double cost_a, double error_a, double cost_b, double error_b)
{
    return cost_a <= cost_b && error_a <= error_b && (cost_a < cost_b || error_a < error_b);
}

void lf_pareto_front(long n, const double *cost, const double *error, bool *on)
{
    for (long i = 0; i < n; i++) {
        on[i] = !isnan(cost[i]) && !isnan(error[i]);
        for (long j = 0; on[i] && j < n; j++)
            on[i] = !dominates(cost[j], error[j], cost[i], error[i]);
    }
}

long lf_pareto_choose(long n, const double *cost, const double *quality, double exact,
                      double tolerance)
{
    long best = -1;
    for (long i = 0; i < n; i++) {
        if (!(quality[i] >= exact - tolerance) || isnan(cost[i]))
            continue;
        if (best < 0 || cost[i] < cost[best] ||
            (!(cost[i] > cost[best]) && quality[i] > quality[best]))
            best = i;
    }
    return best;
}
