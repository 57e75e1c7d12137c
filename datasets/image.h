/* image.h: pictures, from files and to PNG, behind OpenImageIO.
 *
 * Values are 0..1 as stored in the file (display values, i.e. sRGB for ordinary pictures): nothing
 * is linearised. Row 0 is the top row, column 0 the left one; pixel (i, j) is column i, row j.
 *
 * Ownership: lf_image_read and lf_image_create give an image that the caller frees once with
 *            lf_image_free; lf_image_free(NULL) does nothing.
 * Errors:    every lf_status function fills *err (may be NULL) and leaves its outputs untouched.
 * Threads:   different images are independent.
 */
#ifndef LF_DATASETS_IMAGE_H
#define LF_DATASETS_IMAGE_H

#include <stdbool.h>

#include "autograd/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct lf_image {
    int width, height;
    int channels; /* 1 grey, 2 grey and alpha, 3 red green blue, 4 with alpha (straight) */
    float *pixel; /* [height][width][channels], 0..1 */
} lf_image;

enum { LF_IMAGE_SIZE_MAX = 32768 }; /* pixels a side */

/* All values 0. Aborts on sizes outside 1..LF_IMAGE_SIZE_MAX and channels outside 1..4. */
lf_image *lf_image_create(int width, int height, int channels);
void lf_image_free(lf_image *image);

/* The values of one pixel, [channels]. */
float *lf_image_at(const lf_image *image, int column, int row);

/* Read any picture that OpenImageIO knows (PNG, JPEG, EXR, TIFF, ...); 8 and 16 bits become 0..1,
 * floating values outside are cut to 0..1. The EXIF orientation is applied, so row 0 is the top.
 * Alpha comes straight: EXR and TIFF that store colours multiplied by it are divided. LF_BAD_INPUT:
 * no such file, not a picture, cut short, no pixel, larger than LF_IMAGE_SIZE_MAX, CMYK or more
 * than 4 channels, values that are not finite, deep or volume pictures; WebP and JPEG 2000 with
 * alpha where OpenImageIO gives it multiplied only. */
lf_status lf_image_read(const char *path, lf_image **out, lf_error *err);

/* Only the header: the size after orientation. */
lf_status lf_image_read_size(const char *path, int *width, int *height, int *channels,
                             lf_error *err);

/* Write 8 bits a channel, value v as round(255 v) after cutting to 0..1 (NaN as 0). A temporary
 * file is renamed over `path`. LF_BAD_INPUT unless the name ends in .png; LF_FAILED if the disk
 * refuses. */
lf_status lf_image_write_png(const char *path, const lf_image *image, lf_error *err);

/* Over white: colour c with alpha a becomes c a + (1 - a); grey becomes three equal channels. A
 * new image of 3 channels. */
lf_image *lf_image_over_white(const lf_image *image);

void lf_image_fill(lf_image *image, const float *value); /* value[channels] */

/* Put `from` into `into` with its top left corner at (column, row), each pixel `scale` times
 * repeated both ways; what falls outside is cut off. Channels: equal, or grey into colour, or
 * colour with alpha into colour (alpha dropped). */
void lf_image_paste(lf_image *into, const lf_image *from, int column, int row, int scale);

/* Write text in a built-in 5x7 font, each dot `scale` pixels wide, top left corner at (column,
 * row); value[channels] is the colour. A letter takes lf_image_text_width(1, scale) columns and 8 *
 * scale rows; other characters than A-Z a-z 0-9 space . , : ; / - + _ % ( ) = < > # ' ! ? are
 * boxes. */
void lf_image_text(lf_image *into, const char *text, int column, int row, int scale,
                   const float *value);
int lf_image_text_width(int letters, int scale);

#ifdef __cplusplus
}
#endif
#endif
