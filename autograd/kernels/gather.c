/* gather.c: see gather.h. */
#include <string.h>

#include "autograd/kernels/gather.h"
#include "autograd/status.h"

/* Columns of pixels that `columns` grid columns look at; likewise for lines. */
static long reach(const lf_gather *g, long columns)
{
    return (columns - 1) * g->stride + g->window;
}

/* No window leaves the image: it can be read in place. */
static bool inside(const lf_gather *g)
{
    return g->border <= 0 && reach(g, g->lines) - g->border <= g->height &&
           reach(g, g->columns) - g->border <= g->width;
}

/* Numbers that a block of lines x columns takes at most: its lines may lie in several images, and
 * each image's part has rows of its own. */
static long numbers(const lf_gather *g, long lines, long columns)
{
    const long parts = lines < 2 ? 1 : (lines - 2) / g->lines + 2;
    long rows = lines * g->stride + parts * (g->window - g->stride);
    if (g->stride > g->window)
        rows = lines * g->stride;
    return rows * reach(g, columns) * g->channels;
}

bool lf_gather_fits(const lf_gather *g)
{
    return inside(g) || numbers(g, 1, 1) <= LF_GATHER;
}

lf_block lf_gather_block(const lf_gather *g, long lines)
{
    lf_block b = {.lines = lines < LF_GATHER_LINES ? lines : LF_GATHER_LINES,
                  .columns = g->columns};
    if (inside(g))
        return b;
    while (b.columns > 1 && numbers(g, 1, b.columns) > LF_GATHER)
        b.columns = (b.columns + 1) / 2;
    while (b.lines > 1 && numbers(g, b.lines, b.columns) > LF_GATHER)
        b.lines--;
    return b;
}

/* Copy pixels [column, column + count) of one image row, zeros where there are none. row is NULL
 * above and below the image. */
static void copy_row(const lf_gather *g, const lf_real *row, long column, long count, lf_real *to)
{
    const long c = g->channels, end = column + count;
    const long from = column < 0 ? 0 : column, until = end < g->width ? end : g->width;
    if (!row || until <= from) {
        memset(to, 0, (size_t)(count * c) * sizeof *to);
        return;
    }
    memset(to, 0, (size_t)((from - column) * c) * sizeof *to);
    memcpy(to + (from - column) * c, row + from * c, (size_t)((until - from) * c) * sizeof *to);
    memset(to + (until - column) * c, 0, (size_t)((end - until) * c) * sizeof *to);
}

/* The part of a block that lies in one image: `lines` lines from grid line `first`. */
static void fetch_part(const lf_gather *g, const lf_block *b, long image, long first, long lines,
                       lf_real *buffer)
{
    const lf_real *pixels = g->image + image * g->height * g->width * g->channels;
    const long across = reach(g, b->columns);
    for (long i = 0; i < reach(g, lines); i++) {
        const long h = first * g->stride - g->border + i;
        const lf_real *row = h >= 0 && h < g->height ? pixels + h * g->width * g->channels : NULL;
        copy_row(g, row, b->column * g->stride - g->border, across,
                 buffer + i * across * g->channels);
    }
}

static void fetch_in_place(const lf_gather *g, const lf_block *b, lf_gathered *out)
{
    out->pitch = g->width * g->channels;
    for (long l = 0; l < b->lines; l++) {
        const long n = (b->line + l) / g->lines, i = (b->line + l) % g->lines;
        const long h = i * g->stride - g->border, v = b->column * g->stride - g->border;
        out->line[l] = g->image + ((n * g->height + h) * g->width + v) * g->channels;
    }
}

void lf_gather_fetch(const lf_gather *g, const lf_block *b, lf_real *buffer, lf_gathered *out)
{
    LF_REQUIRE(b->lines <= LF_GATHER_LINES, "block of %ld lines", b->lines);
    if (inside(g)) {
        fetch_in_place(g, b, out);
        return;
    }
    out->pitch = reach(g, b->columns) * g->channels;
    for (long l = 0, lines; l < b->lines; l += lines) {
        const long first = (b->line + l) % g->lines, left = b->lines - l;
        lines = left < g->lines - first ? left : g->lines - first;
        fetch_part(g, b, (b->line + l) / g->lines, first, lines, buffer);
        for (long i = 0; i < lines; i++)
            out->line[l + i] = buffer + i * g->stride * out->pitch;
        buffer += reach(g, lines) * out->pitch;
    }
}
