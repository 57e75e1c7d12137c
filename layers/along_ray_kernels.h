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
    COLLECT_TILE = BASIS_VECTORS == 1   ? 16
                   : BASIS_VECTORS == 2 ? 6
                   : BASIS_VECTORS <= 6 ? 12 / BASIS_VECTORS
                                        : 1
};

/* A number of a row, in the order of heads: the profile's rows of its complex weight, the other
 * part of the pair, and 1 for a real part, -1 for an imaginary one, 0 for a scalar. */
typedef struct pair_number {
    long real, imag, other;
    lf_real sign;
} pair_number;

typedef struct along {
    lf_light_geometry rays;
    long planes, c, n, per, size; /* n = planes c; per = c / heads; size = planes per, of a head */
    int heads;
    lf_real scale;
    long blocks;             /* of keys of one ray */
    const long *place;       /* [n]: where number i of a row stands in the order of heads */
    const pair_number *pair; /* [n], in the order of heads */
    lf_real *weight;         /* [N, S, H, blocks, W] */
    lf_real *z;              /* [N, S, n, BASIS] */
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
    lf_real *mask;    /* [blocks, W]: 1 = a key of the ray */
    lf_real *depth;   /* [blocks, W] */
    lf_real *phi;     /* [blocks, TERMS, W] */
    lf_real *phi_row; /* [blocks W, BASIS] */
    lf_real *pairs;   /* [blocks W, BASIS] of one head: numbers times phi_row */
    lf_real *matrix;  /* [n, ROW] of a query: q conj(w_b), then q */
    lf_real *x;       /* [n]: a query's row */
    lf_real *number;  /* [H, blocks, W] */
    lf_real *r;       /* [n, BASIS] */
    lf_real *buffer;  /* [blocks, max(TERMS, size), W] */
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
        for (long l = 0; l < W; l += LF_LANES)
            for (int b = 0; b < BASIS; b += LF_LANES) {
                lf_vec v[LF_LANES];
                for (int i = 0; i < LF_LANES; i++)
                    v[i] = lf_vec_load(phi + (b + i) * W + l);
                lf_vec_transpose(v);
                for (int i = 0; i < LF_LANES; i++)
                    lf_vec_store(w->phi_row + (k * W + l + i) * BASIS + b, v[i]);
            }
    }
}

/* x conj(w_b) for all b, and x, to the matrix; x [n] in the order of heads. */
static void load_matrix(const along *t, const work *w, const lf_real *x, const lf_real *profile)
{
    for (long j = 0; j < t->n; j++) {
        /* real part: x_re w_re + x_im w_im; imaginary part: x_im w_re - x_re w_im */
        const pair_number *p = t->pair + j;
        const lf_real *real = profile + p->real * BASIS, *imag = profile + p->imag * BASIS;
        const lf_real other = p->sign * x[p->other];
        lf_real *out = w->matrix + j * ROW;
        for (int b = 0; b < BASIS; b += LF_LANES)
            lf_vec_store(out + b, x[j] * lf_vec_load(real + b) + other * lf_vec_load(imag + b));
        out[BASIS] = x[j];
    }
}

/* number[h, k] = sum_b phi_b <row b of the matrix, x>_h of all keys. */
static void products(const along *t, const work *w, const lf_real *x, lf_real *number)
{
    for (int head = 0; head < t->heads; head++) {
        const lf_block_terms terms = {.in = t->size,
                                      .x = x + head * t->size * W,
                                      .w = {w->matrix + head * t->size * ROW, ROW, 1},
                                      .groups = t->blocks,
                                      .x_step = t->n * W,
                                      .y_step = TERMS * W};
        lf_block_product(&terms, TERMS, w->buffer);
        for (long k = 0; k < t->blocks; k++)
            for (int h = 0; h < LF_PARTS; h++) {
                const lf_real *phi = w->phi + k * TERMS * W, *y = w->buffer + k * TERMS * W;
                lf_vec sum[4] = {lf_block_get(phi, BASIS, h) * lf_block_get(y, BASIS, h)};
                for (int b = 0; b < BASIS; b += 4)
                    for (int i = 0; i < 4; i++)
                        sum[i] += lf_block_get(phi, b + i, h) * lf_block_get(y, b + i, h);
                lf_block_set(number, head * t->blocks + k, h,
                             (sum[0] + sum[1]) + (sum[2] + sum[3]));
            }
    }
}

/* x += number[h, k] sum_b phi_b row b of the matrix. */
static void expand(const along *t, const work *w, const lf_real *number, lf_real *x)
{
    for (int head = 0; head < t->heads; head++) {
        const lf_block_terms terms = {.in = TERMS,
                                      .x = w->phi,
                                      .w = {w->matrix + head * t->size * ROW, 1, ROW},
                                      .groups = t->blocks,
                                      .x_step = TERMS * W,
                                      .y_step = t->size * W};
        lf_block_product(&terms, t->size, w->buffer);
        for (long k = 0; k < t->blocks; k++)
            for (int h = 0; h < LF_PARTS; h++) {
                const lf_vec by = lf_block_get(number, head * t->blocks + k, h);
                lf_real *out = x + (k * t->n + head * t->size) * W;
                for (long i = 0; i < t->size; i++)
                    lf_block_add(out, i, h, by * lf_block_get(w->buffer + k * t->size * W, i, h));
            }
    }
}

/* z [tile numbers, BASIS] = sum over keys of pairs [keys, BASIS] times x [keys, n]. */
LF_INLINE void collect_tile(const int tile, long count, long n, const lf_real *pairs,
                            const lf_real *x, lf_real *z)
{
    lf_vec sum[COLLECT_TILE][BASIS_VECTORS];
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
#if LF_VEC_BYTES == 64 && !defined(LF_DOUBLE)
            TILE(7)
            TILE(8)
            TILE(9)
            TILE(10)
            TILE(11)
            TILE(12)
            TILE(13)
            TILE(14)
            TILE(15)
            TILE(16)
#endif
#undef TILE
        }
        i += size;
    }
}

/* z_b = sum_j number_j phi_b x_j -> z [n, BASIS]. */
static void collect(const along *t, const work *w, const lf_real *number, const keys *x, lf_real *z)
{
    for (int head = 0; head < t->heads; head++) {
        const lf_real *by = number + head * t->blocks * W;
        for (long j = 0; j < t->rays.samples; j++)
            for (int b = 0; b < BASIS; b += LF_LANES)
                lf_vec_store(w->pairs + j * BASIS + b,
                             by[j] * lf_vec_load(w->phi_row + j * BASIS + b));
        collect_head(t, w, x->row + head * t->size, z + head * t->size * BASIS);
    }
}

/* What the constant and the Gaussians give number j, as a vector still to be summed up. */
static lf_vec join_number(const along *t, const lf_real *by, const keys *x, const lf_real *z,
                          long j)
{
    /* real part: w_re z_re - w_im z_im; imaginary part: w_re z_im + w_im z_re */
    const pair_number *p = t->pair + j;
    const lf_real *real = x->profile + p->real * BASIS, *imag = x->profile + p->imag * BASIS;
    const lf_real *own = z + j * BASIS, *other = z + p->other * BASIS;
    lf_vec sum = {0}, more = {0};
    for (int b = 0; b < BASIS; b += LF_LANES) {
        sum += lf_vec_load(real + b) * lf_vec_load(own + b);
        more -= p->sign * lf_vec_load(imag + b) * lf_vec_load(other + b);
    }
    for (long k = 0; k < t->blocks; k++)
        for (int h = 0; h < LF_PARTS; h++)
            sum += lf_block_get(by, k, h) * lf_block_get(x->wide, k * t->n + j, h);
    return sum + more;
}

/* y [n] = sum_j number_j x_j + sum_b w_b z_b. */
static void join(const along *t, const lf_real *number, const keys *x, const lf_real *z, lf_real *y)
{
    for (int head = 0; head < t->heads; head++) {
        const lf_real *by = number + head * t->blocks * W;
        const long last = (head + 1) * t->size;
        for (long j = head * t->size; j < last; j += 4) {
            lf_vec four[4] = {{0}};
            lf_real total[4];
            for (long i = 0; i < 4 && j + i < last; i++)
                four[i] = join_number(t, by, x, z, j + i);
            lf_vec_totals(four, total);
            for (long i = 0; i < 4 && j + i < last; i++)
                y[j + i] = total[i];
        }
    }
}

/* dw_b += x conj(z_b): x [n], z [n, BASIS]. */
static void add_profile(const along *t, const lf_real *x, const lf_real *z, lf_real *dw)
{
    for (long j = 0; j < t->n; j++) {
        /* real: x_re z_re + x_im z_im; imaginary: x_im z_re - x_re z_im */
        const pair_number *p = t->pair + j;
        const lf_real own = p->sign < 0 ? -x[p->other] : x[j];
        const lf_real cross = p->sign > 0 ? x[p->other] : p->sign < 0 ? x[j] : 0;
        for (int b = 0; b < BASIS; b += LF_LANES)
            lf_vec_store(dw + j * BASIS + b, lf_vec_load(dw + j * BASIS + b) +
                                                 own * lf_vec_load(z + j * BASIS + b) +
                                                 cross * lf_vec_load(z + p->other * BASIS + b));
    }
}

#endif
