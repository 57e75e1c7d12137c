/* conv.c: 2-D convolution forward and its adjoint in x, as products without an unfolded copy.
 *
 * With channels last, the window of one output pixel is `size` runs of size * in adjacent numbers
 * of a zero-bordered image (gather.h): a row of the product tile. The filter, seen as a matrix
 * [size * size * in, out], is the panel.
 *
 * dx: input pixel (h, v) gets what the taps p = (h + pad) mod stride, + stride, + 2 stride, ...
 * carry to it, from output rows that are adjacent and go down as p goes up; likewise for columns.
 * So the input pixels fall into stride^2 classes, and each class is a convolution of dy, without
 * stride, by its own taps flipped and transposed.
 */
#include <omp.h>
#include <stdint.h>
#include <string.h>

#include "autograd/kernels/gather.h"
#include "autograd/kernels/tile.h"
#include "autograd/status.h"

enum {
    CHUNK = 42 * LF_TILE, /* pixels whose addresses are listed at a time */
    MAX_STRIDE = 4,       /* of dx */
    MAX_CLASSES = MAX_STRIDE * MAX_STRIDE
};

/* Results go to pixel (line * step + i0, column * step + j0) of [images, height, width, channels],
 * where that exists. */
typedef struct target {
    lf_real *image;
    long height, width, channels, step;
} target;

/* One product over all grid points: taps[0] x taps[1] last pixels of each window. */
typedef struct class
{
    long taps[2], residue[2];
    long i0, j0;
    long first;            /* the panel that lies at `panels` */
    const lf_real *panels; /* from it on, one after another: [terms][panel_step] */
    lf_real *packed;       /* the same, still to be filled; NULL: they are the filter itself */
} class;

/* Panels [first, first + count) of the result's channels. */
typedef struct panel_range {
    long first, count;
} panel_range;

/* `flipped`: the filter is read as the adjoint does. */
typedef struct plan {
    const lf_conv *s;
    const lf_real *w;
    bool flipped;
    lf_gather from;
    target to;
    const lf_real *bias;
    bool accumulate;
    lf_activation act;
} plan;

static lf_real *align(lf_real *p)
{
    return (lf_real *)(((uintptr_t)p + 63) / 64 * 64);
}

/* Numbers in a row of all panels. */
static long padded(long channels)
{
    return lf_panel_step(channels);
}

static long min(long a, long b)
{
    return a < b ? a : b;
}

/* ---- panels ---------------------------------------------------------------------------------- */

/* Panel k of a class of dx: rows (tap, tap, out) from the last tap to the first, columns in. */
static void pack_flipped(const lf_conv *s, const lf_real *w, const class *c, long k, lf_real *panel)
{
    const long r = c->residue[0], q = c->residue[1];
    const long width = lf_panel_width(s->in, k * LF_PANEL);
    for (long p = c->taps[0] - 1; p >= 0; p--)
        for (long o = c->taps[1] - 1; o >= 0; o--) {
            const long tap = (r + p * s->stride) * s->size + q + o * s->stride;
            lf_pack_transposed(s->out, width, w + (tap * s->in + k * LF_PANEL) * s->out, s->out,
                               panel);
            panel += s->out * lf_panel_step(width);
        }
}

/* Panel k of every class. */
static void pack_panel(const plan *p, long classes, const class *c, long k)
{
    for (; classes > 0; classes--, c++) {
        const long depth = c->taps[0] * c->taps[1] * p->from.channels;
        lf_real *panel = c->packed + (k - c->first) * depth * LF_PANEL;
        if (c->packed && p->flipped)
            pack_flipped(p->s, p->w, c, k, panel);
        else if (c->packed)
            lf_pack(depth, lf_panel_width(p->s->out, k * LF_PANEL), p->w + k * LF_PANEL, p->s->out,
                    panel);
    }
}

/* ---- the grid -------------------------------------------------------------------------------- */

/* The columns of the given panels of the result, for `count` pixels. */
static void run_pixels(const plan *p, const class *c, panel_range only, const lf_gathered *in,
                       long count, const lf_real *const *x, lf_real *const *y)
{
    const long depth = c->taps[0] * c->taps[1] * p->from.channels;
    for (long k = only.first; k < only.first + only.count; k++) {
        _Alignas(64) lf_real start[LF_LAST_PANEL] = {0};
        const long j = k * LF_PANEL, width = lf_panel_width(p->to.channels, j);
        if (p->bias)
            memcpy(start, p->bias + j, (size_t)width * sizeof *start);
        const lf_product t = {.window = {c->taps[0], c->taps[1] * p->from.channels, in->pitch},
                              .panel = c->panels + (k - c->first) * LF_PANEL * depth,
                              .panel_step = lf_panel_step(width),
                              .column = j,
                              .width = width,
                              .start = p->accumulate ? NULL : start,
                              .act = p->act};
        lf_tile_product(&t, count, x, y);
    }
}

/* One class over one gathered block: list the pixels' addresses, a chunk at a time. */
static void run_class(const plan *p, const class *c, panel_range only, const lf_block *b,
                      const lf_gathered *in)
{
    const lf_real *x[CHUNK];
    lf_real *y[CHUNK];
    const lf_gather *g = &p->from;
    const target *to = &p->to;
    const long skip = (g->window - c->taps[0]) * in->pitch + (g->window - c->taps[1]) * g->channels;
    long count = 0;
    for (long l = 0; l < b->lines; l++) {
        const long n = (b->line + l) / g->lines;
        const long h = (b->line + l) % g->lines * to->step + c->i0;
        for (long j = 0; h >= 0 && h < to->height && j < b->columns; j++) {
            const long v = (b->column + j) * to->step + c->j0;
            if (v < 0 || v >= to->width)
                continue;
            x[count] = in->line[l] + j * g->stride * g->channels + skip;
            y[count++] = to->image + ((n * to->height + h) * to->width + v) * to->channels;
            if (count == CHUNK) {
                run_pixels(p, c, only, in, count, x, y);
                count = 0;
            }
        }
    }
    run_pixels(p, c, only, in, count, x, y);
}

static void run_block(const plan *p, long classes, const class *c, panel_range only,
                      const lf_block *b)
{
    _Alignas(64) lf_real buffer[LF_GATHER];
    lf_gathered in;
    lf_gather_fetch(&p->from, b, buffer, &in);
    for (long k = 0; k < classes; k++)
        run_class(p, &c[k], only, b, &in);
}

/* Nested teams are of one thread, whatever OMP_MAX_ACTIVE_LEVELS says: scratch is for that. */
static long threads_now(void)
{
    return omp_in_parallel() ? 1 : omp_get_max_threads();
}

/* Numbers of the panels of one thread, where every thread packs those that it uses. */
static long room_of_thread(const lf_conv *s, long channels)
{
    return s->size * s->size * channels * LF_LAST_PANEL;
}

/* Panel k of the result for all pixels, packed at `room` first. */
static void run_panel(const plan *p, long classes, const class *c, long k, lf_real *room,
                      const lf_block *all)
{
    class own[MAX_CLASSES];
    for (long i = 0; i < classes; i++) {
        own[i] = c[i];
        own[i].first = k;
        own[i].panels = own[i].packed = room;
        room += c[i].taps[0] * c[i].taps[1] * p->from.channels * LF_LAST_PANEL;
    }
    pack_panel(p, classes, own, k);
    run_block(p, classes, own, (panel_range){k, 1}, all);
}

/* One block for all pixels, parallel over panels: a filter larger than the image is then read by
 * one thread only, and a packed panel stays in its cache. */
static void run_panels(const plan *p, long classes, const class *c, const lf_block *all)
{
    const long each = room_of_thread(p->s, p->from.channels);
#pragma omp parallel for schedule(static) num_threads((int)threads_now())
    for (long k = 0; k < lf_panels(p->to.channels); k++)
        run_panel(p, classes, c, k, c->packed + omp_get_thread_num() * each, all);
}

/* Parallel over blocks of lines and columns. */
static void run_blocks(const plan *p, long classes, const class *c, lf_block size, long threads)
{
    const lf_gather *g = &p->from;
    const long total = g->images * g->lines;
    const long across = (g->columns + size.columns - 1) / size.columns;
    /* a multiple of the threads, so that they end together */
    long down = (total + size.lines - 1) / size.lines;
    down = (down + threads - 1) / threads * threads;
    size.lines = (total + down - 1) / down;
#pragma omp parallel for schedule(static) if (lf_panels(p->to.channels) > 1)
    for (long k = 0; k < lf_panels(p->to.channels); k++)
        pack_panel(p, classes, c, k);
#pragma omp parallel for schedule(static)
    for (long k = 0; k < down * across; k++) {
        lf_block b = {k / across * size.lines, size.lines, k % across * size.columns, size.columns};
        b.lines = min(b.lines, total - b.line);
        b.columns = min(b.columns, g->columns - b.column);
        if (b.lines > 0)
            run_block(p, classes, c, (panel_range){0, lf_panels(p->to.channels)}, &b);
    }
}

/* All of the grid is one block, and there are panels for all threads. */
static bool by_panels(const lf_gather *g, long channels)
{
    const long total = g->images * g->lines, threads = threads_now();
    const lf_block size = lf_gather_block(g, total);
    return size.lines == total && size.columns == g->columns && total * g->columns <= CHUNK &&
           lf_panels(channels) % threads == 0;
}

/* Every class over the whole grid. */
static void run_grid(const plan *p, long classes, const class *c)
{
    const lf_gather *g = &p->from;
    const long total = g->images * g->lines, threads = threads_now();
    const lf_block all = {0, total, 0, g->columns};
    if (total == 0)
        return;
    if (c->packed && by_panels(g, p->to.channels))
        run_panels(p, classes, c, &all);
    else
        run_blocks(p, classes, c, lf_gather_block(g, (total + threads - 1) / threads), threads);
}

/* ---- forward --------------------------------------------------------------------------------- */

static lf_gather windows(const lf_conv *s, const lf_real *x)
{
    return (lf_gather){x,       s->images, s->height, s->width, s->in, s->out_height, s->out_width,
                       s->size, s->stride, s->pad};
}

/* The filter can be read in place: it is one panel wide, in whole vectors. */
static bool one_panel(const lf_conv *s, const lf_real *w)
{
    return s->out <= LF_LAST_PANEL && s->out % LF_LANES == 0 && (uintptr_t)w % LF_VEC_BYTES == 0;
}

void lf_kernel_conv(const lf_conv *s, const lf_real *x, const lf_real *w, const lf_real *b,
                    lf_activation act, lf_real *y, lf_real *scratch)
{
    const plan p = {.s = s,
                    .w = w,
                    .from = windows(s, x),
                    .to = {y, s->out_height, s->out_width, s->out, 1},
                    .bias = b,
                    .act = act};
    if (!lf_gather_fits(&p.from)) {
        lf_ref_conv(s, x, w, b, act, y, scratch);
        return;
    }
    class all = {.taps = {s->size, s->size}, .panels = w};
    if (!one_panel(s, w))
        all.panels = all.packed = align(scratch);
    run_grid(&p, 1, &all);
}

/* ---- backward in x --------------------------------------------------------------------------- */

/* Taps of residue r: p = r, r + stride, ... < size. */
static long taps_of(const lf_conv *s, long r)
{
    return r < s->size ? (s->size - r + s->stride - 1) / s->stride : 0;
}

/* Class (r, q) with room for its panels at `room`; returns the room's end. */
static lf_real *make_class(const lf_conv *s, long r, long q, lf_real *room, class *c)
{
    const long shift = s->pad / s->stride * s->stride - s->pad; /* of the grid's first line */
    *c = (class){{taps_of(s, r), taps_of(s, q)}, {r, q}, shift + r, shift + q, 0, room, room};
    return room + c->taps[0] * c->taps[1] * s->out * padded(s->in);
}

/* The grid of dx: point (i, j) sees the output pixels that reach the inputs of its classes. */
static lf_gather dx_windows(const lf_conv *s, const lf_real *dy)
{
    const long window = (s->size + s->stride - 1) / s->stride, first = s->pad / s->stride;
    return (lf_gather){dy,
                       s->images,
                       s->out_height,
                       s->out_width,
                       s->out,
                       (s->height - 1 + s->pad) / s->stride - first + 1,
                       (s->width - 1 + s->pad) / s->stride - first + 1,
                       window,
                       1,
                       window - 1 - first};
}

void lf_kernel_conv_dx(const lf_conv *s, const lf_real *dy, const lf_real *w, lf_real *dx,
                       lf_real *scratch)
{
    const plan p = {.s = s,
                    .w = w,
                    .flipped = true,
                    .from = dx_windows(s, dy),
                    .to = {dx, s->height, s->width, s->in, s->stride},
                    .accumulate = true};
    if (!lf_gather_fits(&p.from) || s->stride > MAX_STRIDE) {
        lf_ref_conv_dx(s, dy, w, dx, scratch);
        return;
    }
    class c[MAX_CLASSES];
    long classes = 0;
    lf_real *room = align(scratch);
    for (long r = 0; r < min(s->stride, s->size); r++)
        for (long q = 0; q < min(s->stride, s->size); q++)
            room = make_class(s, r, q, room, &c[classes++]);
    run_grid(&p, classes, c);
}

/* ---- shapes ---------------------------------------------------------------------------------- */

lf_conv lf_conv_shape(long images, long height, long width, long in, long out, long size,
                      long stride, long pad)
{
    LF_REQUIRE(size >= 1 && stride >= 1 && pad >= 0 && height + 2 * pad >= size &&
                   width + 2 * pad >= size,
               "lf_conv_shape: filter %ld, stride %ld, pad %ld on %ldx%ld", size, stride, pad,
               height, width);
    return (lf_conv){images,
                     height,
                     width,
                     in,
                     out,
                     size,
                     stride,
                     pad,
                     (height + 2 * pad - size) / stride + 1,
                     (width + 2 * pad - size) / stride + 1};
}

/* Of a product over grid g from `terms` channels to `channels`. */
static long scratch_of(const lf_conv *s, const lf_gather *g, long terms, long channels)
{
    return by_panels(g, channels) ? threads_now() * room_of_thread(s, terms)
                                  : s->size * s->size * terms * padded(channels);
}

long lf_conv_scratch(const lf_conv *s)
{
    const lf_gather forward = windows(s, NULL), dx = dx_windows(s, NULL);
    const long slack = 64 / (long)sizeof(lf_real), a = scratch_of(s, &forward, s->in, s->out);
    const long b = scratch_of(s, &dx, s->out, s->in), dw = lf_conv_dw_scratch(s);
    const long most = a > b ? a : b;
    return slack + (most > dw ? most : dw);
}
