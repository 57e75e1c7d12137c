/* random.h: counter-based random numbers. (seed, purpose, step, item) names a number; nothing
 * depends on the order of calls or on threads. Philox 4x32-10 of Random123 (Salmon et al.,
 * "Parallel random numbers: as easy as 1, 2, 3", 2011). No state, so every folder may include it.
 *
 *     lf_stream s = lf_stream_at(seed, LF_RANDOM_POINTS, step, item);
 *     double u = lf_uniform(&s), n = lf_normal(&s);
 */
#ifndef LF_AUTOGRAD_RANDOM_H
#define LF_AUTOGRAD_RANDOM_H

#include <math.h>
#include <stdint.h>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wsign-conversion"
#pragma GCC diagnostic ignored "-Wshadow"
#include <Random123/philox.h>
#pragma GCC diagnostic pop

/* What a number is for: two purposes never share a number. Append only; the values are in runs. */
enum lf_random_purpose {
    LF_RANDOM_INIT = 1,    /* initial weights, item = hash of the parameter's name */
    LF_RANDOM_SHUFFLE = 2, /* order of the items of an epoch */
    LF_RANDOM_POINTS = 3,  /* which stored samples a step draws */
    LF_RANDOM_SETTING = 4, /* rolls, look-at points and rotations of the settings Z, R, Y, SO3 */
    LF_RANDOM_SHAPE = 5,   /* parameters of a procedural shape */
    LF_RANDOM_SURFACE = 6, /* area-uniform samples of a surface */
    LF_RANDOM_VOLUME = 7,  /* uniform samples of a volume */
    LF_RANDOM_NEAR = 8,    /* offsets of near-surface samples */
    LF_RANDOM_GROUP = 9,   /* group elements of equivariance checks */
    LF_RANDOM_TEST = 10,   /* tests and benchmarks */
    LF_RANDOM_METRIC = 11, /* sample points of metrics */
    LF_RANDOM_SCENE = 12   /* built-in scenes: objects, paint, light, cameras */
};

/* A short sequence of numbers that belongs to one (seed, purpose, step, item). */
typedef struct lf_stream {
    uint32_t key[2];
    uint32_t counter[4];
    uint32_t block[4];
    int used; /* numbers of `block` already given out; 4 = none left */
} lf_stream;

/* Hash of a name, for the `item` of things that have a name and no number (FNV-1a, 64 bits). */
static inline uint64_t lf_name_hash(const char *name)
{
    uint64_t h = 1469598103934665603u;
    for (; *name; name++)
        h = (h ^ (unsigned char)*name) * 1099511628211u;
    return h;
}

/* The sequence of (seed, purpose, step, item). `item` is used whole (64 bits), `step` mod 2^32;
 * sequences of up to 2^32 numbers do not overlap for different names. */
static inline lf_stream lf_stream_at(uint64_t seed, uint32_t purpose, uint64_t step, uint64_t item)
{
    /* purpose is mixed into the key so that all four counter words stay free */
    const uint64_t key = seed ^ (0x9E3779B97F4A7C15u * (uint64_t)purpose);
    lf_stream s = {{(uint32_t)key, (uint32_t)(key >> 32)},
                   {0, (uint32_t)step, (uint32_t)item, (uint32_t)(item >> 32)},
                   {0, 0, 0, 0},
                   4};
    return s;
}

/* 32 random bits. */
static inline uint32_t lf_bits(lf_stream *s)
{
    if (s->used == 4) {
        philox4x32_ctr_t counter = {{s->counter[0], s->counter[1], s->counter[2], s->counter[3]}};
        philox4x32_key_t key = {{s->key[0], s->key[1]}};
        const philox4x32_ctr_t out = philox4x32(counter, key);
        for (int i = 0; i < 4; i++)
            s->block[i] = out.v[i];
        s->counter[0]++;
        s->used = 0;
    }
    return s->block[s->used++];
}

/* Uniform in (0, 1), never 0 and never 1; 32 bits of resolution. */
static inline double lf_uniform(lf_stream *s)
{
    return ((double)lf_bits(s) + 0.5) * (1.0 / 4294967296.0);
}

/* Uniform in {0, ..., n-1}; n >= 1 and below 2^31 (bias below n / 2^32). */
static inline long lf_index(lf_stream *s, long n)
{
    return (long)(((uint64_t)lf_bits(s) * (uint64_t)n) >> 32);
}

/* Standard normal (Box-Muller, one of the pair). */
static inline double lf_normal(lf_stream *s)
{
    const double r = sqrt(-2.0 * log(lf_uniform(s)));
    return r * cos(6.283185307179586 * lf_uniform(s));
}

#endif
