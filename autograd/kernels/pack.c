/* pack.c: panels of a matrix, whole vectors a row, and column sums (tile.h). */
#include "autograd/kernels/tile.h"

void lf_pack(long k, long width, const lf_real *b, long step, lf_real *panel)
{
    const long to = lf_panel_step(width);
    for (long l = 0; l < k; l++)
        for (long j = 0; j < to; j += LF_LANES) {
            const lf_real *from = b + l * step + j;
            lf_vec_store(panel + l * to + j, width - j >= LF_LANES
                                                 ? lf_vec_load(from)
                                                 : lf_vec_load_part(from, width - j));
        }
}

typedef __typeof__((lf_vec){0} < (lf_vec){0}) mask;

/* Lane i is number from[i] of a, c written one after the other. */
LF_INLINE lf_vec shuffle(lf_vec a, lf_vec c, mask from)
{
#ifdef __clang__ /* has shuffles by constants only; unrolled, it sees that these are constant */
    lf_vec y;
    _Pragma("GCC unroll 16") for (int i = 0; i < LF_LANES; i++) y[i] =
        from[i] < LF_LANES ? a[from[i]] : c[from[i] - LF_LANES];
    return y;
#else
    return __builtin_shuffle(a, c, from);
#endif
}

/* A square of LF_LANES rows, transposed by halves: at distance h, the number at (i, j) with
 * i & h = 0, j & h != 0 changes places with the one at (i + h, j - h). */
LF_INLINE void transpose_square(const lf_real *b, long step, lf_real *panel, long to)
{
    lf_vec row[LF_LANES];
    _Pragma("GCC unroll 16") for (int i = 0; i < LF_LANES; i++) row[i] = lf_vec_load(b + i * step);
    _Pragma("GCC unroll 4") for (int h = 1; h < LF_LANES; h *= 2)
    {
        mask low, high;
        _Pragma("GCC unroll 16") for (int j = 0; j < LF_LANES; j++)
        {
            low[j] = j & h ? LF_LANES + j - h : j;
            high[j] = j & h ? LF_LANES + j : j + h;
        }
        _Pragma("GCC unroll 16") for (int i = 0; i < LF_LANES; i++) if (!(i & h))
        {
            const lf_vec a = row[i], c = row[i + h];
            row[i] = shuffle(a, c, low);
            row[i + h] = shuffle(a, c, high);
        }
    }
    _Pragma("GCC unroll 16") for (int i = 0; i < LF_LANES; i++)
        lf_vec_store(panel + i * to, row[i]);
}

static void transpose_part(long k, long width, const lf_real *b, long step, lf_real *panel, long to)
{
    for (long l = 0; l < k; l++)
        for (long j = 0; j < LF_LANES; j++)
            panel[l * to + j] = j < width ? b[j * step + l] : 0;
}

void lf_pack_transposed(long k, long width, const lf_real *b, long step, lf_real *panel)
{
    const long to = lf_panel_step(width);
    for (long j = 0; j < to; j += LF_LANES) {
        long l = 0;
        for (; width - j >= LF_LANES && l + LF_LANES <= k; l += LF_LANES)
            transpose_square(b + j * step + l, step, panel + l * to + j, to);
        transpose_part(k - l, width - j, b + j * step + l, step, panel + l * to + j, to);
    }
}

void lf_column_sums(long rows, long width, const lf_real *y, long step, lf_real *sum)
{
    for (long j = 0; j < width; j += LF_LANES) {
        const long n = width - j < LF_LANES ? width - j : LF_LANES;
        lf_vec part[4] = {{0}, {0}, {0}, {0}};
        const lf_real *from = y + j;
        long r = 0;
        for (; n == LF_LANES && r + 4 <= rows; r += 4, from += 4 * step)
            _Pragma("GCC unroll 4") for (int k = 0; k < 4; k++) part[k] +=
                lf_vec_load(from + k * step);
        for (; r < rows; r++, from += step)
            part[r & 3] += lf_vec_load_part(from, n);
        const lf_vec all = (part[0] + part[1]) + (part[2] + part[3]);
        for (long i = 0; i < n; i++)
            sum[j + i] += all[i];
    }
}
