/* along_ray_kernels.h: the sums of attention along the ray over keys, Gaussians and the numbers of
 * a head, for one query; formulas in along_ray_attention.c, which alone includes this.
 *
 * Two layouts. Keys side by side, [blocks of keys, numbers, LF_BLOCK_POINTS], for products and
 * expand; the 16 Gaussians side by side for collect, where a vector holds one z of all b. The
 * numbers of a row are ordered by heads: [H, P, C / H].
 */
#ifndef LF_LAYERS_ALONG_RAY_KERNELS_H
#define LF_LAYERS_ALONG_RAY_KERNELS_H

#include "layers/block_kernels.h"
#include "layers/light_field.h"

enum {
    W = LF_BLOCK_POINTS,
    BASIS = LF_ALONG_BASIS,
    TERMS = BASIS + 1,      /* with the constant */
    ROW = BASIS + LF_LANES, /* numbers of a matrix row: BASIS Gaussians, the constant, none */
    BASIS_VECTORS = BASIS / LF_LANES,
    COLLECT_TILE = BASIS_VECTORS <= 2   ? 6
                   : BASIS_VECTORS <= 6 ? 12 / BASIS_VECTORS
                                        : 1
};

typedef struct along {
    lf_light_geometry rays;
    long planes, c, n, per, size; /* n = planes c; per = c / heads; size = planes per, of a head */
    int heads;
    lf_real scale;
    long blocks;       /* of keys of one ray */
    const long *place; /* [n]: where number i of a row stands in the order of heads */
    lf_real *weight;   /* [N, S, H, blocks, W] */
    lf_real *z;        /* [N, S, n, BASIS] */
} along;

/* One ray's keys or values: as rows, and side by side with the gradient. */
typedef struct keys {
    lf_real *row;         /* [S, n] */
    lf_real *wide, *grad; /* [blocks, n, W] */
    lf_real *profile;     /* [n, BASIS] the weights of the Gaussians */
    lf_real *dprofile;    /* the same, over all rays */
} keys;

typedef struct work {
    keys k, v;
    lf_real *mask;     /* [blocks, W]: 1 = a key of the ray */
    lf_real *depth;    /* [blocks, W] */
    lf_real *phi;      /* [blocks, TERMS, W] */
    lf_real *phi_row;  /* [blocks W, BASIS] */
    lf_real *pairs;    /* [blocks W, BASIS] of one head: numbers times phi_row */
    lf_real *matrix;   /* [n, ROW] of a query: q conj(w_b), then q */
    lf_real *x;        /* [n]: a query's row */
    lf_real *number;   /* [H, blocks, W] */
    lf_real *r;        /* [n, BASIS] */
    lf_real *constant; /* [n] */
    lf_real *buffer;   /* [max(TERMS, size), W] */
} work;

/* Gaussians of all keys from the depth of one sample, in both layouts. */
static void load_gaussians(const along *t, const work *w, lf_real depth)
{
    const lf_real spacing = (lf_real)2 / (BASIS - 1);
    for (long k = 0; k < t->blocks; k++) {
        lf_real *phi = w->phi + k * TERMS * W;
        for (int h = 0; h < LF_PARTS; h++) {
            const lf_vec at = (lf_block_get(w->depth, k, h) - depth + 1) / spacing;
            for (int b = 0; b < BASIS; b++) {
                const lf_vec d = at - (lf_real)b;
                lf_block_set(phi, b, h, lf_vec_exp((lf_real)-0.5 * d * d));
            }
            lf_block_set(phi, BASIS, h, lf_vec_all(1));
        }
        for (long l = 0; l < W; l++)
            for (int b = 0; b < BASIS; b++)
                w->phi_row[(k * W + l) * BASIS + b] = phi[b * W + l];
    }
}

/* x conj(w_b) for all b, and x, to the matrix; x [n] in the order of heads. */
static void load_matrix(const along *t, const work *w, const lf_real *x, const lf_real *profile)
{
    const long per = t->per;
    for (long j = 0; j < t->n; j++) {
        const long plane = j % t->size / per;
        const lf_real *own = profile + j * BASIS;
        /* real part: x_re w_re + x_im w_im; imaginary part: x_im w_re - x_re w_im */
        const bool re = plane % 2;
        const lf_real *real = plane && !re ? own - per * BASIS : own;
        const lf_real *imag = re ? own + per * BASIS : own;
        const lf_real other = plane == 0 ? 0 : re ? x[j + per] : -x[j - per];
        lf_real *out = w->matrix + j * ROW;
        for (int b = 0; b < BASIS; b += LF_LANES)
            lf_vec_store(out + b, x[j] * lf_vec_load(real + b) + other * lf_vec_load(imag + b));
        out[BASIS] = x[j];
    }
}

/* number[h, k] = sum_b phi_b <row b of the matrix, x>_h of all keys. */
static void products(const along *t, const work *w, const lf_real *x, lf_real *number)
{
    for (int head = 0; head < t->heads; head++)
        for (long k = 0; k < t->blocks; k++) {
            const lf_real *phi = w->phi + k * TERMS * W;
            const lf_block_terms terms = {.in = t->size,
                                          .x = x + (k * t->n + head * t->size) * W,
                                          .w = {w->matrix + head * t->size * ROW, ROW, 1}};
            lf_block_product(&terms, TERMS, w->buffer);
            for (int h = 0; h < LF_PARTS; h++) {
                lf_vec sum = {0};
                for (int b = 0; b < TERMS; b++)
                    sum += lf_block_get(phi, b, h) * lf_block_get(w->buffer, b, h);
                lf_block_set(number, head * t->blocks + k, h, sum);
            }
        }
}

/* x += number[h, k] sum_b phi_b row b of the matrix. */
static void expand(const along *t, const work *w, const lf_real *number, lf_real *x)
{
    for (int head = 0; head < t->heads; head++)
        for (long k = 0; k < t->blocks; k++) {
            const lf_block_terms terms = {.in = TERMS,
                                          .x = w->phi + k * TERMS * W,
                                          .w = {w->matrix + head * t->size * ROW, 1, ROW}};
            lf_real *out = x + (k * t->n + head * t->size) * W;
            lf_block_product(&terms, t->size, w->buffer);
            for (int h = 0; h < LF_PARTS; h++) {
                const lf_vec by = lf_block_get(number, head * t->blocks + k, h);
                for (long i = 0; i < t->size; i++)
                    lf_block_add(out, i, h, by * lf_block_get(w->buffer, i, h));
            }
        }
}

/* z [tile numbers, BASIS] = sum over keys of pairs [keys, BASIS] times x [keys, n]. */
LF_INLINE void collect_tile(const int tile, long count, long n, const lf_real *pairs,
                            const lf_real *x, lf_real *z)
{
    lf_vec sum[6][BASIS_VECTORS];
    for (int i = 0; i < tile; i++)
        for (int b = 0; b < BASIS_VECTORS; b++)
            sum[i][b] = (lf_vec){0};
    for (long j = 0; j < count; j++)
        for (int i = 0; i < tile; i++) {
            const lf_vec by = lf_vec_all(x[j * n + i]);
            for (int b = 0; b < BASIS_VECTORS; b++)
                sum[i][b] += by * lf_vec_load(pairs + j * BASIS + b * LF_LANES);
        }
    for (int i = 0; i < tile; i++)
        for (int b = 0; b < BASIS_VECTORS; b++)
            lf_vec_store(z + i * BASIS + b * LF_LANES, sum[i][b]);
}

/* The numbers of one head in nearly equal tiles. */
static void collect_head(const along *t, const work *w, const lf_real *x, lf_real *z)
{
    const long parts = (t->size + COLLECT_TILE - 1) / COLLECT_TILE;
    for (long p = 0, i = 0; p < parts; p++) {
        const long size = (t->size - i + parts - p - 1) / (parts - p);
        switch (size) {
#define TILE(count)                                                                                \
    case count:                                                                                    \
        collect_tile(count, t->rays.samples, t->n, w->pairs, x + i, z + i * BASIS);                \
        break;
            TILE(1)
            TILE(2)
            TILE(3)
            TILE(4)
            TILE(5)
            TILE(6)
#undef TILE
        }
        i += size;
    }
}

/* z_b = sum_j number_j phi_b x_j -> z [n, BASIS]; the constant's -> constant [n]. */
static void collect(const along *t, const work *w, const lf_real *number, const keys *x, lf_real *z)
{
    const long samples = t->rays.samples;
    for (int head = 0; head < t->heads; head++) {
        const lf_real *by = number + head * t->blocks * W;
        for (long j = 0; j < samples; j++)
            for (int b = 0; b < BASIS; b += LF_LANES)
                lf_vec_store(w->pairs + j * BASIS + b,
                             by[j] * lf_vec_load(w->phi_row + j * BASIS + b));
        collect_head(t, w, x->row + head * t->size, z + head * t->size * BASIS);
        for (long i = head * t->size; i < (head + 1) * t->size; i++) {
            lf_vec sum = {0};
            for (long k = 0; k < t->blocks; k++)
                for (int h = 0; h < LF_PARTS; h++)
                    sum += lf_block_get(by, k, h) * lf_block_get(x->wide, k * t->n + i, h);
            w->constant[i] = lf_vec_total(sum);
        }
    }
}

/* y [n] = constant + sum_b w_b z_b. */
static void join(const along *t, const work *w, const lf_real *profile, const lf_real *z,
                 lf_real *y)
{
    const long per = t->per;
    for (long j = 0; j < t->n; j++) {
        const long plane = j % t->size / per;
        const bool re = plane % 2;
        /* real part: w_re z_re - w_im z_im; imaginary part: w_re z_im + w_im z_re */
        const lf_real *real = profile + (plane && !re ? j - per : j) * BASIS;
        const lf_real *imag = profile + (re ? j + per : j) * BASIS;
        const lf_real *own = z + j * BASIS;
        const lf_real *other = plane == 0 ? own : re ? own + per * BASIS : own - per * BASIS;
        const lf_real turn = plane == 0 ? 0 : re ? -1 : 1;
        lf_vec sum = {0};
        for (int b = 0; b < BASIS; b += LF_LANES)
            sum += lf_vec_load(real + b) * lf_vec_load(own + b) +
                   turn * lf_vec_load(imag + b) * lf_vec_load(other + b);
        y[j] = w->constant[j] + lf_vec_total(sum);
    }
}

/* dw_b += x conj(z_b): x [n], z [n, BASIS]. */
static void add_profile(const along *t, const lf_real *x, const lf_real *z, lf_real *dw)
{
    const long per = t->per;
    for (long j = 0; j < t->n; j++) {
        const long plane = j % t->size / per;
        const bool re = plane % 2;
        /* real: x_re z_re + x_im z_im; imaginary: x_im z_re - x_re z_im */
        const long other = plane == 0 ? j : re ? j + per : j - per;
        const lf_real own = plane && !re ? -x[other] : x[j];
        const lf_real cross = plane == 0 ? 0 : re ? x[other] : x[j];
        for (int b = 0; b < BASIS; b += LF_LANES)
            lf_vec_store(dw + j * BASIS + b, lf_vec_load(dw + j * BASIS + b) +
                                                 own * lf_vec_load(z + j * BASIS + b) +
                                                 cross * lf_vec_load(z + other * BASIS + b));
    }
}

#endif
