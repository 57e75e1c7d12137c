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
 *
 * Of an image of very many pixels a part is summed by itself before it is added to the rest, which
 * keeps the digits that many small addends to a large sum would lose.
 */
#include <omp.h>
#include <string.h>

#include "autograd/kernels/gather.h"
#include "autograd/kernels/tile.h"

enum {
    MAX_LANES = 8,
    LANE_PIXELS = 32, /* output pixels of an image that pay for one more lane */
    PIXELS = 192,     /* of a block: x and dy of a tile stay in L1 */
    PART = 1 << 14    /* output pixels of an image that are summed by themselves */
};

static long min(long a, long b)
{
    return a < b ? a : b;
}

static long filter_size(const lf_conv *s)
{
    return s->size * s->size * s->in * s->out;
}

/* How many lanes of images; lane l takes images l, l + lanes, ..., and lanes are added in their
 * order. */
static long lanes_of(const lf_conv *s)
{
    const long most = s->out_height * s->out_width / LANE_PIXELS;
    return most < 1 ? 1 : min(min(most, MAX_LANES), s->images < 1 ? 1 : s->images);
}

/* Images have parts that are summed by themselves. */
static bool in_parts(const lf_conv *s)
{
    return s->out_height * s->out_width > PART;
}

long lf_conv_dw_scratch(const lf_conv *s)
{
    const long lanes = lanes_of(s), each = filter_size(s) + s->out;
    return (lanes == 1 ? 0 : lanes * each) + (in_parts(s) ? lanes * each : 0);
}

/* The gradients that one task sums: columns [first, first + columns) of o. Of a part of an image,
 * if `all` is not NULL: there it is added to what has been summed. */
typedef struct part {
    const lf_conv *s;
    const lf_real *x, *dy;
    lf_real *dw, *db;
    long first, columns;
    lf_real *all, *all_b;
} part;

/* rows x columns of two filters, `step` apart: from goes to `to`, and is 0 then. */
static void hand_over(long rows, long columns, long step, lf_real *from, lf_real *to)
{
    for (long r = 0; r < rows; r++)
        for (long j = 0; j < columns; j++) {
            to[r * step + j] += from[r * step + j];
            from[r * step + j] = 0;
        }
}

static void end_part(const part *t)
{
    const long o = t->s->out;
    hand_over(filter_size(t->s) / o, t->columns, o, t->dw + t->first, t->all + t->first);
    if (t->db)
        hand_over(1, t->columns, o, t->db + t->first, t->all_b + t->first);
}

/* One panel of o over a block of pixels; dy readable in whole vectors. */
static void add_panel(const lf_conv *s, const lf_pixels *g, const lf_gathered *in, long line,
                      const lf_real *dy, long width, lf_real *dw)
{
    const long run = s->size * s->in;
    for (long p = 0; p < s->size; p++)
        lf_tile_outer(g, run, width, in->line[line] + p * in->pitch, dy, dw + p * run * s->out,
                      s->out);
}

/* dy of the pixels of g as rows of whole vectors in buffer; returns g with dy's steps there. */
static lf_pixels pack_pixels(const lf_pixels *g, const lf_real *dy, long width, lf_real *buffer)
{
    const long step = lf_panel_step(width);
    lf_pixels packed = *g;
    packed.y_step = step;
    packed.y_line = g->columns * step;
    packed.y_image = g->lines * packed.y_line;
    for (long n = 0; n < g->images; n++)
        for (long l = 0; l < g->lines; l++)
            lf_pack(g->columns, width, dy + n * g->y_image + l * g->y_line, g->y_step,
                    buffer + n * packed.y_image + l * packed.y_line);
    return packed;
}

/* At most PIXELS pixels of a gathered block from its line `line` on; dy is the first one's. */
static void add_pixels(const part *t, const lf_pixels *g, const lf_gathered *in, long line,
                       const lf_real *dy)
{
    _Alignas(64) lf_real buffer[PIXELS * LF_LAST_PANEL];
    const lf_conv *s = t->s;
    for (long j = t->first, width; j < t->first + t->columns; j += width) {
        width = lf_panel_width(s->out, j);
        if (width == lf_panel_step(width)) {
            add_panel(s, g, in, line, dy + j, width, t->dw + j);
            continue;
        }
        const lf_pixels packed = pack_pixels(g, dy + j, width, buffer);
        add_panel(s, &packed, in, line, buffer, width, t->dw + j);
    }
    for (long n = 0; t->db && n < g->images; n++)
        for (long l = 0; l < g->lines; l++)
            lf_column_sums(g->columns, t->columns, dy + n * g->y_image + l * g->y_line + t->first,
                           s->out, t->db + t->first);
}

/* A block inside one image, some lines at a time, or of several whole images. */
static void add_block(const part *t, const lf_gather *g, const lf_block *b)
{
    _Alignas(64) lf_real buffer[LF_GATHER];
    const lf_conv *s = t->s;
    lf_gathered in;
    lf_gather_fetch(g, b, buffer, &in);
    const lf_real *dy = t->dy + (b->line * s->out_width + b->column) * s->out;
    const long line = s->out_width * s->out;
    lf_pixels all = {1, 0, b->columns, 0, s->stride * in.pitch, s->stride * s->in, 0, line, s->out};
    if (b->lines > g->lines) {
        all.images = b->lines / g->lines;
        all.lines = g->lines;
        all.x_image = in.line[g->lines] - in.line[0];
        all.y_image = g->lines * line;
        add_pixels(t, &all, &in, 0, dy);
        return;
    }
    const long most = PIXELS / b->columns;
    for (long l = 0; l < b->lines; l += all.lines) {
        all.lines = lf_next_part(b->lines - l, most);
        add_pixels(t, &all, &in, l, dy + l * line);
    }
}

static void add_image(const part *t, const lf_gather *g, long image)
{
    lf_block size = lf_gather_block(g, g->lines);
    size.columns = min(size.columns, PIXELS);
    long pixels = 0;
    for (long i = 0; i < g->lines; i += size.lines) {
        for (long j = 0; j < g->columns; j += size.columns) {
            const lf_block b = {image * g->lines + i, min(size.lines, g->lines - i), j,
                                min(size.columns, g->columns - j)};
            add_block(t, g, &b);
        }
        pixels += size.lines * g->columns;
        if (t->all && (pixels >= PART || i + size.lines >= g->lines)) {
            end_part(t);
            pixels = 0;
        }
    }
}

/* All images, several at a time if they are small: a filter larger than the caches should not be
 * read and written for every few pixels. */
static void add_images(const part *t, const lf_gather *g)
{
    const long fit = lf_gather_block(g, g->images * g->lines).lines / g->lines;
    const long each = min(fit, PIXELS / (g->lines * g->columns));
    for (long n = 0, count; n < g->images; n += count) {
        count = each < 2 ? 1 : min(each, g->images - n);
        const lf_block b = {n * g->lines, count * g->lines, 0, g->columns};
        if (count == 1)
            add_image(t, g, n);
        else
            add_block(t, g, &b);
    }
}

/* ---- lanes ----------------------------------------------------------------------------------- */

/* Lets t sum parts by themselves, in room [filter, bias]: all 0 to begin with. */
static void use_parts(part *t, lf_real *room)
{
    t->all = t->dw;
    t->all_b = t->db;
    t->dw = room;
    t->db = t->db ? room + filter_size(t->s) : NULL;
}

static void sum_lane(const part *t, const lf_gather *g, long lane, long lanes, long size,
                     lf_real *scratch)
{
    part own = *t;
    own.dw = scratch + lane * size;
    own.db = t->db ? own.dw + size - t->s->out : NULL;
    memset(own.dw, 0, (size_t)size * sizeof *own.dw);
    if (in_parts(t->s)) {
        lf_real *room = scratch + (lanes + lane) * size;
        memset(room, 0, (size_t)size * sizeof *room);
        use_parts(&own, room);
    }
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
    const long lanes = lanes_of(s), filter = filter_size(s);
    if (!lf_gather_fits(&g)) {
        lf_ref_conv_dw(s, x, dy, dw, db, scratch);
        return;
    }
    if (lanes == 1) {
        memset(scratch, 0, (size_t)lf_conv_dw_scratch(s) * sizeof *scratch);
#pragma omp parallel for schedule(static)
        for (long k = 0; k < lf_panels(s->out); k++) {
            const long j = k * LF_PANEL;
            part t = {s, x, dy, dw, db, j, lf_panel_width(s->out, j), NULL, NULL};
            if (in_parts(s))
                use_parts(&t, scratch);
            add_images(&t, &g);
        }
        return;
    }
    const part all = {s, x, dy, dw, db, 0, s->out, NULL, NULL};
#pragma omp parallel for schedule(static)
    for (long l = 0; l < lanes; l++)
        sum_lane(&all, &g, l, lanes, filter + s->out, scratch);
    add_lanes(filter, lanes, filter + s->out, scratch, dw);
    if (db)
        add_lanes(s->out, lanes, filter + s->out, scratch + filter, db);
}
