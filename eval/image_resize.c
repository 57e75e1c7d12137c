/* image_resize.c: a triangle filter along columns, then along rows. */
#include "eval/image_resize.h"

#include <math.h>

/* One line of `count` pixels, `step` values apart, becomes `fresh` pixels, `fresh_step` apart. */
static void resize_line(const float *from, int count, long step, float *to, int fresh,
                        long fresh_step, int channels)
{
    const double s = (double)count / fresh, radius = fmax(1, s);
    for (int x = 0; x < fresh; x++) {
        const double u = (x + 0.5) * s - 0.5;
        const int first = (int)fmax(0, ceil(u - radius));
        const int last = (int)fmin(count - 1, floor(u + radius));
        double sum[4] = {0}, weights = 0;
        for (int i = first; i <= last; i++) {
            const double w = fmax(0, 1 - fabs(i - u) / radius);
            weights += w;
            for (int c = 0; c < channels; c++)
                sum[c] += w * (double)from[i * step + c];
        }
        for (int c = 0; c < channels; c++)
            to[x * fresh_step + c] = (float)(sum[c] / weights);
    }
}

lf_image *lf_image_resize(const lf_image *image, int width, int height)
{
    const int channels = image->channels;
    lf_image *wide = lf_image_create(width, image->height, channels);
    lf_image *out = lf_image_create(width, height, channels);
    for (int row = 0; row < image->height; row++)
        resize_line(lf_image_at(image, 0, row), image->width, channels, lf_image_at(wide, 0, row),
                    width, channels, channels);
    for (int column = 0; column < width; column++)
        resize_line(lf_image_at(wide, column, 0), image->height, (long)width * channels,
                    lf_image_at(out, column, 0), height, (long)width * channels, channels);
    lf_image_free(wide);
    return out;
}

void lf_image_fit(int image_width, int image_height, int width, int height, int *out_width,
                  int *out_height)
{
    const double scale = fmin((double)width / image_width, (double)height / image_height);
    *out_width = (int)fmax(1, fmin(width, round(image_width * scale)));
    *out_height = (int)fmax(1, fmin(height, round(image_height * scale)));
}
