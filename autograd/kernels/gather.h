/* gather.h: blocks of images with their zero border, as convolutions read them.
 *
 * A grid of lines x columns lies over each image: grid point (i, j) looks at the window of
 * `window` x `window` pixels whose first is (i stride - border, j stride - border); pixels outside
 * the image are zero. A block of grid lines (counted through all images) by grid columns is copied
 * with its zeros into a buffer that stays in L2, or read in place where no zeros are needed.
 */
#ifndef LF_AUTOGRAD_KERNELS_GATHER_H
#define LF_AUTOGRAD_KERNELS_GATHER_H

#include "autograd/kernels/kernels.h"

enum {
    LF_GATHER_BYTES = 256 * 1024,                        /* of a block's buffer */
    LF_GATHER = LF_GATHER_BYTES / (long)sizeof(lf_real), /* the same in numbers */
    LF_GATHER_LINES = 256                                /* lines of a block at most */
};

typedef struct lf_gather {
    const lf_real *image; /* [images, height, width, channels] */
    long images, height, width, channels;
    long lines, columns;         /* the grid of one image */
    long window, stride, border; /* border may be negative: the grid starts inside */
} lf_gather;

typedef struct lf_block {
    long line, lines; /* of all images' lines, images * lines of them */
    long column, columns;
} lf_block;

/* Where the windows of a block are: grid point (l, j), counted from the block's corner, starts at
 * line[l] + j * stride * channels; a window's next row is `pitch` numbers on. */
typedef struct lf_gathered {
    const lf_real *line[LF_GATHER_LINES];
    long pitch;
} lf_gathered;

/* Whether one window fits into the buffer, without which no block exists. */
bool lf_gather_fits(const lf_gather *g);
/* The size of blocks that fit, at most `lines` lines: line and column are 0. */
lf_block lf_gather_block(const lf_gather *g, long lines);
/* Fetch block b, which must fit; buffer holds LF_GATHER numbers. */
void lf_gather_fetch(const lf_gather *g, const lf_block *b, lf_real *buffer, lf_gathered *out);

#endif
