/* matmul.c: c (+)= a b for large matrices.
 *
 * Both factors are packed: DEPTH columns of up to ROWS rows of a into a block that stays in L2,
 * with rows a little longer than a power of two, which would map them all to the same few cache
 * sets; the matching rows of b, panel after panel, into L1. Rows are shared between the threads.
 */
#include <omp.h>
#include <string.h>

#include "autograd/kernels/tile.h"

/* A block of a with panels of 512 terms is 590 kB: for the 1 MB and more of L2 of CPUs with 512-bit
 * vectors, where it gives 92 % of the multiply-add limit instead of 86 % with 256 terms. */
enum {
    DEPTH = LF_VEC_BYTES == 64 ? 512 : 256,
    ROW = DEPTH + 64 / (int)sizeof(lf_real), /* numbers from row to row of a's block */
    ROWS = 288 * 4 / (int)sizeof(lf_real)
};

typedef struct matrices {
    long n, k;
    const lf_real *a, *b;
    lf_real *c;
    bool accumulate;
} matrices;

/* Terms [l, l + depth) of rows [i, i + rows). */
static void add_terms(const matrices *m, long i, long rows, long l, long depth)
{
    static const lf_real zeros[LF_LAST_PANEL];
    _Alignas(64) lf_real block[ROWS * ROW];
    _Alignas(64) lf_real panel[DEPTH * LF_LAST_PANEL];
    for (long r = 0; r < rows; r++)
        memcpy(block + r * ROW, m->a + (i + r) * m->k + l, (size_t)depth * sizeof *block);
    for (long p = 0; p < lf_panels(m->n); p++) {
        const long j = p * LF_PANEL, width = lf_panel_width(m->n, j);
        const lf_product t = {.window = {1, depth, 0},
                              .panel = panel,
                              .panel_step = lf_panel_step(width),
                              .column = j,
                              .width = width,
                              .start = l == 0 && !m->accumulate ? zeros : NULL};
        lf_pack(depth, width, m->b + l * m->n + j, m->n, panel);
        lf_tile_product_even(&t, rows, block, ROW, m->c + i * m->n, m->n);
    }
}

static void matmul_rows(const matrices *m, long i, long rows)
{
    long l = 0;
    do {
        const long depth = m->k - l < DEPTH ? m->k - l : DEPTH;
        add_terms(m, i, rows, l, depth);
        l += depth;
    } while (l < m->k);
}

void lf_kernel_matmul(long m, long n, long k, const lf_real *a, const lf_real *b, lf_real *c,
                      bool accumulate)
{
    enum { WORTH = 1 << 18 }; /* products that pay for a team of threads */
    const matrices all = {n, k, a, b, c, accumulate};
    const bool serial = omp_in_parallel() || (double)m * (double)n * (double)k < WORTH;
    const long threads = serial ? 1 : omp_get_max_threads();
    const long share = (m + threads - 1) / threads;
    const long block = share < LF_TILE ? LF_TILE : lf_next_part(share, ROWS);
#pragma omp parallel for schedule(static) if (!serial)
    for (long i = 0; i < m; i += block)
        matmul_rows(&all, i, m - i < block ? m - i : block);
}
