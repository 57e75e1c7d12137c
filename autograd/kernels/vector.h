/* vector.h: the machine's widest vector of lf_reals as a GCC vector type.
 *
 * The width follows the compiler's target: 64 bytes with AVX-512, 32 with AVX, else 16. Memory
 * operands carry the alignment of one lf_real, so every pointer into an array will do.
 */
#ifndef LF_AUTOGRAD_KERNELS_VECTOR_H
#define LF_AUTOGRAD_KERNELS_VECTOR_H

#include "autograd/real.h"

#if defined(__AVX512F__)
#include <immintrin.h>
#define LF_VEC_BYTES 64
#elif defined(__AVX__)
#define LF_VEC_BYTES 32
#else
#define LF_VEC_BYTES 16
#endif

typedef lf_real lf_vec __attribute__((vector_size(LF_VEC_BYTES)));
typedef lf_real lf_vec_mem
    __attribute__((vector_size(LF_VEC_BYTES), aligned(sizeof(lf_real)), may_alias));

enum { LF_LANES = LF_VEC_BYTES / sizeof(lf_real) }; /* numbers in a vector */

#define LF_INLINE static inline __attribute__((always_inline))

LF_INLINE lf_vec lf_vec_load(const lf_real *p)
{
    return *(const lf_vec_mem *)p;
}

LF_INLINE void lf_vec_store(lf_real *p, lf_vec v)
{
    *(lf_vec_mem *)p = v;
}

LF_INLINE lf_vec lf_vec_all(lf_real x)
{
    return x - (lf_vec){0};
}

/* The sum of all numbers. */
LF_INLINE lf_real lf_vec_sum(lf_vec v)
{
#if defined(__AVX512F__) && defined(LF_DOUBLE)
    return _mm512_reduce_add_pd((__m512d)v);
#elif defined(__AVX512F__)
    return _mm512_reduce_add_ps((__m512)v);
#else
    lf_real sum = 0;
    for (int i = 0; i < LF_LANES; i++)
        sum += v[i];
    return sum;
#endif
}

/* max(v, 0), and NaN where v is NaN */
LF_INLINE lf_vec lf_vec_relu(lf_vec v)
{
    const lf_vec zero = {0};
#if defined(__AVX512F__) && defined(LF_DOUBLE)
    return (lf_vec)_mm512_max_pd((__m512d)zero, (__m512d)v); /* of a NaN: the second operand */
#elif defined(__AVX512F__)
    return (lf_vec)_mm512_max_ps((__m512)zero, (__m512)v);
#else
    return (lf_vec)(~(v < zero) & (__typeof__(v < zero))v);
#endif
}

/* The first n numbers at p, zeros behind; 0 <= n <= LF_LANES. Nothing beyond them is read. */
LF_INLINE lf_vec lf_vec_load_part(const lf_real *p, long n)
{
#if defined(__AVX512F__) && defined(LF_DOUBLE)
    return (lf_vec)_mm512_maskz_loadu_pd((__mmask8)((1u << n) - 1), p);
#elif defined(__AVX512F__)
    return (lf_vec)_mm512_maskz_loadu_ps((__mmask16)((1u << n) - 1), p);
#else
    lf_vec v = {0};
    for (long i = 0; i < n; i++)
        v[i] = p[i];
    return v;
#endif
}

/* Store the first n numbers of v; nothing beyond them is written. */
LF_INLINE void lf_vec_store_part(lf_real *p, long n, lf_vec v)
{
#if defined(__AVX512F__) && defined(LF_DOUBLE)
    _mm512_mask_storeu_pd(p, (__mmask8)((1u << n) - 1), (__m512d)v);
#elif defined(__AVX512F__)
    _mm512_mask_storeu_ps(p, (__mmask16)((1u << n) - 1), (__m512)v);
#else
    for (long i = 0; i < n; i++)
        p[i] = v[i];
#endif
}

#endif
