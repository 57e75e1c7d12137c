/* limit.c: multiply-adds in registers, in independent chains. See limit.h. */
#include "autograd/kernels/limit.h"

#include <time.h>

#include "autograd/kernels/vector.h"

/* Independent chains: more than latency times throughput of any CPU, fewer than its registers. */
#if defined(__AVX512F__) || defined(__aarch64__)
enum { CHAINS = 24 };
#else
enum { CHAINS = 12 };
#endif

/* sum <- sum * factor + term in every chain. The empty assembly makes factor and term unknown to
 * the compiler and the sums used, so that it can neither fold the loop nor drop it. */
static void fma_chains(long steps)
{
    lf_vec sum[CHAINS], factor = lf_vec_all((lf_real)0.5), term = lf_vec_all(1);
    __asm__ volatile("" : "+m"(factor), "+m"(term));
    for (int i = 0; i < CHAINS; i++)
        sum[i] = lf_vec_all((lf_real)i);
    for (long s = 0; s < steps; s++) {
#pragma GCC unroll 24
        for (int i = 0; i < CHAINS; i++)
            sum[i] = sum[i] * factor + term;
    }
    __asm__ volatile("" ::"m"(sum));
}

double lf_limit_run(long steps, int threads)
{
#pragma omp parallel for num_threads(threads) schedule(static, 1)
    for (int t = 0; t < threads; t++)
        fma_chains(steps);
    return 2.0 * CHAINS * LF_LANES * (double)steps * threads;
}

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

double lf_limit_now(int threads)
{
    const double start = now(), operations = lf_limit_run(1 << 17, threads);
    return operations / (now() - start);
}
