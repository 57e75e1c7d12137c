/* image.c: pictures in memory. */
#include "datasets/image.h"

lf_image *lf_image_create(int width, int height, int channels)
{
    LF_REQUIRE(width >= 1 && height >= 1 && width <= LF_IMAGE_SIZE_MAX &&
                   height <= LF_IMAGE_SIZE_MAX && channels >= 1 && channels <= 4,
               "an image of %d x %d x %d", width, height, channels);
    lf_image *image = malloc(sizeof *image);
    const size_t values = (size_t)width * (size_t)height * (size_t)channels;
    float *pixel = calloc(values, sizeof *pixel);
    LF_REQUIRE(image && pixel, "no memory for an image of %d x %d x %d", width, height, channels);
    *image = (lf_image){width, height, channels, pixel};
    return image;
}

void lf_image_free(lf_image *image)
{
    if (!image)
        return;
    free(image->pixel);
    free(image);
}

float *lf_image_at(const lf_image *image, int column, int row)
{
    return image->pixel +
           ((size_t)row * (size_t)image->width + (size_t)column) * (size_t)image->channels;
}

void lf_image_fill(lf_image *image, const float *value)
{
    for (int row = 0; row < image->height; row++)
        for (int column = 0; column < image->width; column++)
            memcpy(lf_image_at(image, column, row), value, (size_t)image->channels * sizeof *value);
}

lf_image *lf_image_over_white(const lf_image *image)
{
    lf_image *out = lf_image_create(image->width, image->height, 3);
    const int channels = image->channels;
    for (int row = 0; row < image->height; row++)
        for (int column = 0; column < image->width; column++) {
            const float *from = lf_image_at(image, column, row);
            const float alpha = channels % 2 == 0 ? from[channels - 1] : 1;
            for (int c = 0; c < 3; c++)
                lf_image_at(out, column, row)[c] = from[channels < 3 ? 0 : c] * alpha + (1 - alpha);
        }
    return out;
}

static void paste_pixel(lf_image *into, const float *from, int from_channels, int column, int row)
{
    if (column < 0 || row < 0 || column >= into->width || row >= into->height)
        return;
    float *to = lf_image_at(into, column, row);
    for (int c = 0; c < into->channels; c++)
        to[c] = from[from_channels == 1 ? 0 : c];
}

void lf_image_paste(lf_image *into, const lf_image *from, int column, int row, int scale)
{
    LF_REQUIRE(scale >= 1 &&
                   (from->channels == into->channels ||
                    (into->channels == 3 && (from->channels == 1 || from->channels == 4))),
               "pasting %d channels into %d at scale %d", from->channels, into->channels, scale);
    for (long j = 0; j < (long)from->height * scale; j++)
        for (long i = 0; i < (long)from->width * scale; i++)
            paste_pixel(into, lf_image_at(from, (int)(i / scale), (int)(j / scale)), from->channels,
                        column + (int)i, row + (int)j);
}
