/* product.c: y (+)= x b for rows in blocks of the cache (product.h).
 *
 * For each block of ROWS rows, of DEPTH terms of the sum and of one panel's columns: pack that part
 * of b into a panel that stays in L1 (unless b is as narrow as a panel and lies right already),
 * then run the tiles over the rows. A row's sum is cut at multiples of DEPTH and goes through
 * memory.
 */
#include <omp.h>
#include <stdint.h>
#include <string.h>

#include "autograd/kernels/product.h"
#include "autograd/kernels/tile.h"

enum { ROWS = 480, DEPTH = 256 };

static bool usable_as_panel(const lf_blocked *p, long width)
{
    return !p->transposed && p->out == width && width % LF_LANES == 0 &&
           (uintptr_t)p->b % LF_VEC_BYTES == 0;
}

/* Point *t to terms [k, k + depth) of the columns in t, packing them into buffer if need be. */
static void set_panel(const lf_blocked *p, long k, long depth, lf_product *t, lf_real *buffer)
{
    t->window = (lf_window){1, depth, 0};
    t->panel_step = lf_panel_step(t->width);
    t->panel = buffer;
    if (usable_as_panel(p, t->width))
        t->panel = p->b + k * p->out;
    else if (p->transposed)
        lf_pack_transposed(depth, t->width, p->b + t->column * p->in + k, p->in, buffer);
    else
        lf_pack(depth, t->width, p->b + k * p->out + t->column, p->out, buffer);
}

/* All terms of one panel's columns for the rows [first, first + rows). */
static void run_panel(const lf_blocked *p, long first, long rows, long column)
{
    _Alignas(64) lf_real buffer[DEPTH * LF_LAST_PANEL], start[LF_LAST_PANEL] = {0};
    lf_product t = {.column = column, .width = lf_panel_width(p->out, column)};
    if (p->bias)
        memcpy(start, p->bias + column, (size_t)t.width * sizeof *start);
    long k = 0;
    do {
        const long depth = p->in - k < DEPTH ? p->in - k : DEPTH;
        set_panel(p, k, depth, &t, buffer);
        t.start = k == 0 && !p->accumulate ? start : NULL;
        t.act = k + depth == p->in ? p->act : LF_IDENTITY;
        lf_tile_product_even(&t, rows, p->x + first * p->in + k, p->in, p->y + first * p->out,
                             p->out);
        k += depth;
    } while (k < p->in);
}

void lf_product_rows(const lf_blocked *p, long first, long rows)
{
    for (long r = 0; r < rows; r += ROWS)
        for (long k = 0; k < lf_panels(p->out); k++)
            run_panel(p, first + r, rows - r < ROWS ? rows - r : ROWS, k * LF_PANEL);
}

void lf_product_all(const lf_blocked *p, long parallel_from)
{
    if (p->rows < parallel_from || omp_in_parallel()) {
        lf_product_rows(p, 0, p->rows);
        return;
    }
    const long threads = omp_get_max_threads();
    long block = (p->rows + threads - 1) / threads;
    block = block > ROWS ? ROWS : (block + LF_TILE - 1) / LF_TILE * LF_TILE;
#pragma omp parallel for schedule(static)
    for (long r = 0; r < p->rows; r += block)
        lf_product_rows(p, r, p->rows - r < block ? p->rows - r : block);
}
