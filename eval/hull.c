/* hull.c: see hull.h. */
#include "eval/hull.h"

static const double nearest = 1e-3; /* smallest visible depth, as the networks have it */

const char *lf_hull_text(void)
{
    return "visual hull of the same views: inside is what projects into the mask (bilinear, above "
           "1/2) of every view; on the same grid, all of it, and scored as the prediction is";
}

static double clamp(double x, double high)
{
    return x > 0 ? (x < high ? x : high) : 0;
}

/* The mask between four pixel centres; beyond the outermost ones as at the nearest place there. */
static double mask_at(const uint8_t *image, int width, int height, int channels, const double uv[2])
{
    const double u = clamp(uv[0], width - 1);
    const double v = clamp(uv[1], height - 1);
    const int i = (int)u, j = (int)v;
    const double a = u - i, b = v - j;
    const long across = i < width - 1 ? channels : 0;
    const long down = j < height - 1 ? (long)width * channels : 0;
    const uint8_t *at = image + ((long)j * width + i) * channels + channels - 1;
    return ((1 - b) * ((1 - a) * at[0] + a * at[across]) +
            b * ((1 - a) * at[down] + a * at[down + across])) /
           255;
}

/* Least mask over the views that have p before them; *seen: there is such a view. */
static double least_mask(const lf_hull *h, const double p[3], bool *seen)
{
    double q[3], least = 1;
    lf_rotation_apply(h->views->object, p, q);
    *seen = false;
    for (int k = 0; k < h->count && least > 0; k++) {
        const lf_camera *c = &h->views->camera[h->view[k]];
        const long each = (long)c->width * c->height * h->channels;
        double uv[2], depth;
        if (!lf_camera_project(c, q, nearest, uv, &depth))
            continue;
        *seen = true;
        const uint8_t *image = h->views->images + h->view[k] * each;
        const double mask = mask_at(image, c->width, c->height, h->channels, uv);
        least = mask < least ? mask : least;
    }
    return least;
}

void lf_hull_field(void *hull, long n, const double (*points)[3], float *value, uint8_t *valid)
{
    const lf_hull *h = hull;
#pragma omp parallel for schedule(static, 1024)
    for (long i = 0; i < n; i++) {
        bool seen;
        value[i] = (float)(0.5 - least_mask(h, points[i], &seen));
        valid[i] = seen;
    }
}
