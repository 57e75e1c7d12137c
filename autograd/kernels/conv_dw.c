/* conv_dw.c: the gradient of a convolution's filter,
 *
 *   dw[p, q, c, o] += sum over images and output pixels of x[pixel at tap (p, q), c] dy[pixel, o]
 *
 * For one filter row p, (q, c) runs over size * in adjacent numbers of the zero-bordered image:
 * LF_TILE of them by a panel of o are an outer tile, whose sum runs over a block of pixels in
 * cache.
 *
 * Work is cut by lanes of images where images are large (each lane has a filter of its own to sum
 * into) and by panels of o where they are small and adding up the lanes would cost more than it
 * saves. Both cuts depend on the shape alone.
 */
#include <omp.h>
#include <string.h>

#include "autograd/kernels/gather.h"
#include "autograd/kernels/lanes.h"
#include "autograd/kernels/tile.h"

enum {
    MAX_LANES = 8,
    LANE_PIXELS = 32, /* output pixels of an image that pay for one more lane */
    PIXELS = 192      /* of a block: x and dy of a tile stay in L1 */
};

static long min(long a, long b)
{
    return a < b ? a : b;
}

long lf_conv_lanes(const lf_conv *s)
{
    const long most = s->out_height * s->out_width / LANE_PIXELS;
    return most < 1 ? 1 : min(min(most, MAX_LANES), s->images < 1 ? 1 : s->images);
}

/* The gradients that one task sums: columns [first, first + columns) of o. */
typedef struct part {
    const lf_conv *s;
    const lf_real *x, *dy;
    lf_real *dw, *db;
    long first, columns;
} part;

/* One panel of o over a block of pixels; dy readable in whole vectors. */
static void add_panel(const lf_conv *s, const lf_pixels *g, const lf_gathered *in, long line,
                      const lf_real *dy, long width, lf_real *dw)
{
    const long run = s->size * s->in;
    for (long p = 0; p < s->size; p++)
        for (long i = 0, n; i < run; i += n) {
            n = lf_next_part(run - i, LF_TILE);
            lf_tile_outer(g, n, width, in->line[line] + p * in->pitch + i, dy,
                          dw + (p * run + i) * s->out, s->out);
        }
}

/* Lines [line, line + lines) of a gathered block; dy is the block's first pixel there. */
static void add_lines(const part *t, const lf_block *b, const lf_gathered *in, long line,
                      long lines, const lf_real *dy)
{
    _Alignas(64) lf_real buffer[(PIXELS + 1) * LF_PANEL];
    const lf_conv *s = t->s;
    lf_pixels g = {
        lines, b->columns, s->stride * in->pitch, s->stride * s->in, s->out_width * s->out, s->out};
    for (long j = t->first; j < t->first + t->columns; j += LF_PANEL) {
        const long width = min(s->out - j, LF_PANEL);
        if (width % LF_LANES == 0) {
            add_panel(s, &g, in, line, dy + j, width, t->dw + j);
            continue;
        }
        const long step = lf_panel_step(width);
        const lf_pixels packed = {lines, b->columns, g.x_line, g.x_step, b->columns * step, step};
        for (long l = 0; l < lines; l++)
            lf_pack(b->columns, width, dy + l * g.y_line + j, s->out, buffer + l * packed.y_line);
        add_panel(s, &packed, in, line, buffer, width, t->dw + j);
    }
    for (long l = 0; t->db && l < lines; l++)
        lf_column_sums(b->columns, t->columns, dy + l * g.y_line + t->first, s->out,
                       t->db + t->first);
}

static void add_block(const part *t, const lf_gather *g, const lf_block *b)
{
    _Alignas(64) lf_real buffer[LF_GATHER];
    lf_gathered in;
    lf_gather_fetch(g, b, buffer, &in);
    const long most = PIXELS / b->columns < 1 ? 1 : PIXELS / b->columns;
    for (long l = 0, lines; l < b->lines; l += lines) {
        lines = lf_next_part(b->lines - l, most);
        add_lines(t, b, &in, l, lines,
                  t->dy + ((b->line + l) * t->s->out_width + b->column) * t->s->out);
    }
}

static void add_image(const part *t, const lf_gather *g, long image)
{
    lf_block size = lf_gather_block(g, g->lines);
    size.columns = min(size.columns, PIXELS);
    for (long i = 0; i < g->lines; i += size.lines)
        for (long j = 0; j < g->columns; j += size.columns) {
            const lf_block b = {image * g->lines + i, min(size.lines, g->lines - i), j,
                                min(size.columns, g->columns - j)};
            add_block(t, g, &b);
        }
}

/* ---- lanes ----------------------------------------------------------------------------------- */

static void sum_lane(const part *t, const lf_gather *g, long lane, long lanes, long size,
                     lf_real *scratch)
{
    part own = *t;
    own.dw = scratch + lane * size;
    own.db = t->db ? own.dw + size - t->s->out : NULL;
    memset(own.dw, 0, (size_t)size * sizeof *own.dw);
    for (long n = lane; n < t->s->images; n += lanes)
        add_image(&own, g, n);
}

static void add_lanes(long count, long lanes, long size, const lf_real *scratch, lf_real *to)
{
#pragma omp parallel for schedule(static)
    for (long i = 0; i < count; i++) {
        lf_real sum = to[i];
        for (long l = 0; l < lanes; l++)
            sum += scratch[l * size + i];
        to[i] = sum;
    }
}

void lf_kernel_conv_dw(const lf_conv *s, const lf_real *x, const lf_real *dy, lf_real *dw,
                       lf_real *db, lf_real *scratch)
{
    const lf_gather g = {x,         s->images,     s->height,    s->width,
                         s->in,     s->out_height, s->out_width, s->size,
                         s->stride, s->pad};
    const long lanes = lf_conv_lanes(s), filter = s->size * s->size * s->in * s->out;
    if (!lf_gather_fits(&g)) {
        lf_ref_conv_dw(s, x, dy, dw, db, scratch);
        return;
    }
    if (lanes == 1) {
#pragma omp parallel for schedule(static)
        for (long j = 0; j < s->out; j += LF_PANEL) {
            const part t = {s, x, dy, dw, db, j, min(s->out - j, LF_PANEL)};
            for (long n = 0; n < s->images; n++)
                add_image(&t, &g, n);
        }
        return;
    }
    const part all = {s, x, dy, dw, db, 0, s->out};
#pragma omp parallel for schedule(static)
    for (long l = 0; l < lanes; l++)
        sum_lane(&all, &g, l, lanes, filter + s->out, scratch);
    add_lanes(filter, lanes, filter + s->out, scratch, dw);
    if (db)
        add_lanes(s->out, lanes, filter + s->out, scratch + filter, db);
}
