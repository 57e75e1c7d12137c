/* along_ray_kernels.h: the products of attention along the ray, for all queries and keys of one ray
 * and one head; formulas in along_ray_attention.c, which alone includes this.
 *
 * Numbers of a ray stand in the order of heads, [H, P, C / H], all samples of a number side by
 * side: [n, keys], keys = samples in whole vectors. What has a factor for each Gaussian has them
 * side by side, [.., BASIS], or, where the keys are a product's columns, [.., BASIS, keys].
 */
#ifndef LF_LAYERS_ALONG_RAY_KERNELS_H
#define LF_LAYERS_ALONG_RAY_KERNELS_H

#include "autograd/kernels/tile.h"
#include "autograd/kernels/vector_math.h"
#include "layers/light_blocks.h"

enum { W = LF_BLOCK_POINTS, BASIS = LF_ALONG_BASIS };

typedef struct along {
    lf_light_geometry rays;
    bool blocks;          /* fields stand in blocks; else in rows */
    long planes, c, n;    /* n = planes c */
    long scalars;         /* planes of them, first */
    long per, size, keys; /* c / heads; planes per, of a head; samples in whole vectors */
    int heads;
    lf_real scale;
    const long *place; /* [n]: where number i of a row stands in the order of heads */
    lf_real *weight;   /* [N, H, S, keys] */
    lf_real *z;        /* [N, H, S, size, BASIS], without the factor of the query */
} along;

/* Profiles of keys or values [n, BASIS], and their gradient. */
typedef struct profiles {
    lf_real *w, *dw;
} profiles;

/* One ray. */
typedef struct work {
    profiles k, v;
    lf_real *mask;                /* [keys]: 1 = a key of the ray */
    lf_real *coarse, *rest;       /* [keys]: their sum is the depth over the Gaussians' spacing */
    lf_real *near;                /* [S, keys]: exp(-D^2 / 2 s^2) */
    lf_real *of_key, *of_query;   /* [keys, BASIS] */
    lf_real *of_keys;             /* [BASIS, keys] */
    lf_real *q, *kk, *vv, *g;     /* [n, keys] */
    lf_real *dq, *dk, *dv;        /* [n, keys]; y in dq */
    lf_real *number, *pair;       /* [S, keys], of one head: logits or da; times near */
    lf_real *wide;                /* [size, BASIS, keys] keys or values */
    lf_real *rows, *turned, *sum; /* [keys, size, BASIS]: keys or values, queries, expand's */
} work;

static const lf_real zeros[LF_LAST_PANEL];

/* ---- the Gaussians -----------------------------------------------------------------------------
 */

/* Factors of sample j, t = depth / s from the middle of the ray: exp(+-t m - m^2 / 4), where m is
 * the Gaussian's middle over s. A geometric sequence, in double: 40 bits of exponent would cost
 * digits in float. */
static void load_factors(const work *w, long j, double t, const double fade[BASIS])
{
    const double step = exp(t);
    double power = exp(-t * 0.5 * (BASIS - 1));
    for (int b = 0; b < BASIS; b++, power *= step) {
        w->of_key[j * BASIS + b] = (lf_real)(fade[b] * power);
        w->of_query[j * BASIS + BASIS - 1 - b] = (lf_real)(fade[b] * power);
    }
}

/* of_keys from of_key. */
static void turn_factors(const along *t, const work *w)
{
    for (long j = 0; j < t->keys; j += LF_LANES)
        for (int b = 0; b < BASIS; b += LF_LANES) {
            lf_vec v[LF_LANES];
            for (int i = 0; i < LF_LANES; i++)
                v[i] = lf_vec_load(w->of_key + (j + i) * BASIS + b);
            lf_vec_transpose(v);
            for (int i = 0; i < LF_LANES; i++)
                lf_vec_store(w->of_keys + (b + i) * t->keys + j, v[i]);
        }
}

/* exp(-D^2 / 2 s^2) of all pairs: D / s = coarse + rest, the square of coarse is exact. */
static void load_near(const along *t, const work *w)
{
    for (long i = 0; i < t->rays.samples; i++)
        for (long j = 0; j < t->keys; j += LF_LANES) {
            const lf_vec d = lf_vec_load(w->coarse + j) - w->coarse[i];
            const lf_vec e = lf_vec_load(w->rest + j) - w->rest[i];
            lf_vec_store(w->near + i * t->keys + j, lf_vec_exp((lf_real)-0.5 * d * d) *
                                                        lf_vec_exp(-e * (d + (lf_real)0.5 * e)));
        }
}

/* ---- keys, values, queries with a factor for each Gaussian -------------------------------------
 */

/* x of one head [size, keys] -> wide. */
static void load_wide(const along *t, const work *w, const lf_real *x)
{
    for (long i = 0; i < t->size; i++)
        for (long j = 0; j < t->keys; j += LF_LANES) {
            const lf_vec v = lf_vec_load(x + i * t->keys + j);
            for (int b = 0; b < BASIS; b++)
                lf_vec_store(w->wide + (i * BASIS + b) * t->keys + j,
                             v * lf_vec_load(w->of_keys + b * t->keys + j));
        }
}

/* x of one head [size, keys] -> rows. */
static void load_rows(const along *t, const work *w, const lf_real *x)
{
    for (long j = 0; j < t->rays.samples; j++)
        for (int b = 0; b < BASIS; b += LF_LANES) {
            const lf_vec f = lf_vec_load(w->of_key + j * BASIS + b);
            for (long i = 0; i < t->size; i++)
                lf_vec_store(w->rows + (j * t->size + i) * BASIS + b, x[i * t->keys + j] * f);
        }
}

/* x conj(w_b) of one head: x [size, keys], profile [size, BASIS] -> turned. */
static void load_turned(const along *t, const work *w, const lf_real *x, const lf_real *profile)
{
    const long keys = t->keys, row = t->size * BASIS;
    for (int b = 0; b < BASIS; b += LF_LANES) {
        const lf_real *f = w->of_query + b;
        for (long i = 0; i < t->scalars * t->per; i++) {
            const lf_vec own = lf_vec_load(profile + i * BASIS + b);
            for (long s = 0; s < t->rays.samples; s++)
                lf_vec_store(w->turned + s * row + i * BASIS + b,
                             x[i * keys + s] * own * lf_vec_load(f + s * BASIS));
        }
        for (long i = t->scalars * t->per; i < t->size;
             i += i % t->per == t->per - 1 ? t->per + 1 : 1) {
            const long o = i + t->per;
            const lf_vec re = lf_vec_load(profile + i * BASIS + b);
            const lf_vec im = lf_vec_load(profile + o * BASIS + b);
            for (long s = 0; s < t->rays.samples; s++) {
                const lf_vec by = lf_vec_load(f + s * BASIS);
                const lf_real u = x[i * keys + s], v = x[o * keys + s];
                lf_real *out = w->turned + s * row + b;
                lf_vec_store(out + i * BASIS, by * (u * re + v * im));
                lf_vec_store(out + o * BASIS, by * (v * re - u * im));
            }
        }
    }
}

/* dw_b += x conj(z_b) of one head: x [size, keys], z [S, size, BASIS], dw [size, BASIS]. */
static void add_profile(const along *t, const work *w, const lf_real *x, const lf_real *z,
                        lf_real *dw)
{
    const long keys = t->keys, row = t->size * BASIS;
    for (int b = 0; b < BASIS; b += LF_LANES) {
        const lf_real *f = w->of_query + b;
        for (long i = 0; i < t->scalars * t->per; i++) {
            lf_vec sum = lf_vec_load(dw + i * BASIS + b);
            for (long s = 0; s < t->rays.samples; s++)
                sum += lf_vec_load(f + s * BASIS) * x[i * keys + s] *
                       lf_vec_load(z + s * row + i * BASIS + b);
            lf_vec_store(dw + i * BASIS + b, sum);
        }
        for (long i = t->scalars * t->per; i < t->size;
             i += i % t->per == t->per - 1 ? t->per + 1 : 1) {
            const long o = i + t->per;
            lf_vec re = lf_vec_load(dw + i * BASIS + b), im = lf_vec_load(dw + o * BASIS + b);
            for (long s = 0; s < t->rays.samples; s++) {
                const lf_vec by = lf_vec_load(f + s * BASIS);
                const lf_vec u = by * x[i * keys + s], v = by * x[o * keys + s];
                const lf_vec zr = lf_vec_load(z + s * row + i * BASIS + b);
                const lf_vec zi = lf_vec_load(z + s * row + o * BASIS + b);
                re += u * zr + v * zi;
                im += v * zr - u * zi;
            }
            lf_vec_store(dw + i * BASIS + b, re);
            lf_vec_store(dw + o * BASIS + b, im);
        }
    }
}

/* ---- products of all samples with all samples --------------------------------------------------
 */

/* pair = number * near. */
static void load_pair(const along *t, const work *w, const lf_real *number)
{
    for (long i = 0; i < t->rays.samples * t->keys; i += LF_LANES)
        lf_vec_store(w->pair + i, lf_vec_load(number + i) * lf_vec_load(w->near + i));
}

/* y = x m: x [rows, terms] with rows x_step apart, m [terms, columns], y [rows, columns] with rows
 * `step` apart. */
static void multiply(const lf_real *x, long x_step, long rows, long terms, const lf_real *m,
                     long columns, long step, lf_real *y)
{
    for (long j = 0, width; j < columns; j += width) {
        width = lf_panel_width(columns, j);
        const lf_product p = {.window = {1, terms, 0},
                              .panel = m + j,
                              .panel_step = step,
                              .column = j,
                              .width = width,
                              .start = zeros,
                              .act = LF_IDENTITY};
        lf_tile_product_even(&p, rows, x, x_step, y, step);
    }
}

/* number_ij = near_ij <turned_i, wide_j> + <x_i, y_j>: x, y [size, keys] of one head; what stands
 * behind the samples only has its factor. */
static void products(const along *t, const work *w, const lf_real *x, const lf_real *y,
                     lf_real *number)
{
    const long s = t->rays.samples, keys = t->keys, row = t->size * BASIS;
    const lf_pixels constant = {1, 1, t->size, 0, 0, keys, 0, 0, keys};
    multiply(w->turned, row, s, row, w->wide, s, keys, number);
    for (long i = 0; i < s * keys; i += LF_LANES)
        lf_vec_store(number + i, lf_vec_load(number + i) * lf_vec_load(w->near + i));
    for (long j = 0, width; j < s; j += width) {
        width = lf_panel_width(s, j);
        lf_tile_outer(&constant, s, width, x, y + j, number + j, keys);
    }
}

/* z_i = sum_j pair_ij rows_j: z [S, size, BASIS]. */
static void collect(const along *t, const work *w, lf_real *z)
{
    const long s = t->rays.samples, row = t->size * BASIS;
    multiply(w->pair, t->keys, s, s, w->rows, row, row, z);
}

/* x_j = sum_i number_ij y_i + sum_b of_key_jb sum_i pair_ij turned_ib: x, y [size, keys]. */
static void expand(const along *t, const work *w, const lf_real *number, const lf_real *y,
                   lf_real *x)
{
    const long s = t->rays.samples, keys = t->keys, row = t->size * BASIS;
    const lf_pixels queries = {1, 1, s, 0, 0, keys, 0, 0, row};
    memset(w->sum, 0, (size_t)(keys * row) * sizeof *w->sum);
    for (long j = 0, width; j < row; j += width) {
        width = lf_panel_width(row, j);
        lf_tile_outer(&queries, s, width, w->pair, w->turned + j, w->sum + j, row);
    }
    for (long i = 0; i < t->size; i++)
        for (long j = 0; j < keys; j += LF_LANES) {
            lf_vec v[LF_LANES];
            for (long l = 0; l < LF_LANES; l++) {
                v[l] = (lf_vec){0};
                for (int b = 0; b < BASIS; b += LF_LANES)
                    v[l] += lf_vec_load(w->of_key + (j + l) * BASIS + b) *
                            lf_vec_load(w->sum + (j + l) * row + i * BASIS + b);
            }
            lf_vec_store(x + i * keys + j, lf_vec_fold(v));
        }
    for (long j = 0, width; j < s; j += width) {
        width = lf_panel_width(s, j);
        const lf_product p = {.window = {1, s, 0},
                              .panel = number + j,
                              .panel_step = keys,
                              .column = j,
                              .width = width,
                              .act = LF_IDENTITY};
        lf_tile_product_even(&p, t->size, y, keys, x, keys);
    }
}

/* What query s adds to number i of y, as a vector still to be summed up: the keys' x [keys] times
 * `by` [keys], and re z_own + sign im z_other over the Gaussians. */
LF_INLINE lf_vec join_number(const long keys, const lf_real *by, const lf_real *x, const lf_real *f,
                             const lf_real *re, const lf_real *im, lf_real sign, const lf_real *own,
                             const lf_real *other)
{
    lf_vec sum = {0}, more = {0};
    for (long j = 0; j < keys; j += LF_LANES)
        sum += lf_vec_load(by + j) * lf_vec_load(x + j);
    for (int b = 0; b < BASIS; b += LF_LANES)
        more += lf_vec_load(f + b) * (lf_vec_load(re + b) * lf_vec_load(own + b) +
                                      sign * lf_vec_load(im + b) * lf_vec_load(other + b));
    return sum + more;
}

LF_INLINE void join_keys(const long keys, const along *t, const work *w, const lf_real *number,
                         const lf_real *x, const lf_real *weight, const lf_real *z, lf_real *y)
{
    const long row = t->size * BASIS, last = t->rays.samples - 1;
    for (long i = 0; i < t->size; i++) {
        /* real part: w_re z_re - w_im z_im; imaginary part: w_re z_im + w_im z_re */
        const long part = i / t->per - t->scalars; /* of a pair: real ones are even */
        const long other = part < 0 ? i : part % 2 == 0 ? i + t->per : i - t->per;
        const lf_real sign = part < 0 ? 0 : part % 2 == 0 ? -1 : 1;
        const lf_real *re = weight + (part > 0 && part % 2 ? other : i) * BASIS;
        const lf_real *im = weight + (part > 0 && part % 2 ? i : other) * BASIS;
        for (long j = 0; j < keys; j += LF_LANES) {
            lf_vec v[LF_LANES];
#pragma GCC unroll 16
            for (long l = 0; l < LF_LANES; l++) {
                const long s = j + l < last ? j + l : last; /* what lies behind is not read */
                v[l] =
                    join_number(keys, number + s * keys, x + i * keys, w->of_query + s * BASIS, re,
                                im, sign, z + s * row + i * BASIS, z + s * row + other * BASIS);
            }
            lf_vec_store(y + i * keys + j, lf_vec_fold(v));
        }
    }
}

/* y_i = sum_j number_ij x_j + sum_b w_b z_ib: x, y [size, keys], z [S, size, BASIS] of one head. */
static void join(const along *t, const work *w, const lf_real *number, const lf_real *x,
                 const lf_real *weight, const lf_real *z, lf_real *y)
{
    switch (t->keys / LF_LANES) {
    case 2:
        join_keys(2 * LF_LANES, t, w, number, x, weight, z, y);
        break;
    case 3:
        join_keys(3 * LF_LANES, t, w, number, x, weight, z, y);
        break;
    default:
        join_keys(t->keys, t, w, number, x, weight, z, y);
    }
}

#endif
