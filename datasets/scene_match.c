/* scene_match.c: do corners of one view lie on their epipolar lines in another? Grey patches are
 * compared by normalised correlation along the line and beside it. */
#include "datasets/scene_internal.h"

enum { HALF = 4, SIDE = 2 * HALF + 1, PATCH = SIDE * SIDE };
static const double least = 0.85, step = 0.5; /* correlation; pixels */

static double grey_at(const lf_pixels *p, int column, int row)
{
    const uint8_t *c = p->rgb + 3 * ((size_t)row * (size_t)p->width + (size_t)column);
    return (0.299 * c[0] + 0.587 * c[1] + 0.114 * c[2]) / 255;
}

/* Bilinear; the patch must lie inside. */
static double grey(const lf_pixels *p, double u, double v)
{
    const int i = (int)u, j = (int)v;
    const double a = u - i, b = v - j;
    return (1 - b) * ((1 - a) * grey_at(p, i, j) + a * grey_at(p, i + 1, j)) +
           b * ((1 - a) * grey_at(p, i, j + 1) + a * grey_at(p, i + 1, j + 1));
}

/* The patch less its mean, divided by its length; false outside the picture or without contrast. */
static bool patch_at(const lf_pixels *p, double u, double v, double out[PATCH])
{
    if (!(u >= HALF && v >= HALF && u < p->width - HALF - 1 && v < p->height - HALF - 1))
        return false;
    double mean = 0, square = 0;
    for (int k = 0; k < PATCH; k++) {
        out[k] = grey(p, u + k % SIDE - HALF, v + k / SIDE - HALF);
        mean += out[k] / PATCH;
    }
    for (int k = 0; k < PATCH; k++) {
        out[k] -= mean;
        square += out[k] * out[k];
    }
    for (int k = 0; k < PATCH; k++)
        out[k] /= sqrt(square) + 1e-12;
    return square > 1e-3;
}

/* -1 where the patch cannot be taken. */
static double correlation(const double a[PATCH], const lf_pixels *p, double u, double v)
{
    double b[PATCH], sum = 0;
    if (!patch_at(p, u, v, b))
        return -1;
    for (int k = 0; k < PATCH; k++)
        sum += a[k] * b[k];
    return sum;
}

/* The ends of the epipolar line between near and far, pixels of `to`; the depth of the near end is
 * raised until it lies before `to`. */
static bool line_of(const lf_scene *scene, long from, long to, const double uv[2], double end[2][2])
{
    const lf_scene_view *a = &scene->view[from], *b = &scene->view[to];
    double d[3], p[3], depth;
    lf_camera_ray(&a->camera, uv[0], uv[1], d);
    const double ahead =
        d[0] * a->camera.rotation[2] + d[1] * a->camera.rotation[5] + d[2] * a->camera.rotation[8];
    const double far = a->far / ahead;
    double near = fmax(a->near, 1e-3 * a->far) / ahead;
    for (int e = 0; e < 2; e++) {
        bool seen = false;
        for (int attempt = 0; !seen && attempt < 40; attempt++) {
            for (int k = 0; k < 3; k++)
                p[k] = a->camera.centre[k] + (e ? far : near) * d[k];
            seen = lf_camera_project(&b->camera, p, 1e-3 * b->far, end[e], &depth);
            if (!seen && e)
                return false;
            near += seen ? 0 : 0.025 * (far - near);
        }
        if (!seen)
            return false;
    }
    return true;
}

/* Shorten the line to the picture and its surroundings; false if nothing is left. */
static bool clip(const lf_camera *c, double end[2][2])
{
    double low = 0, high = 1;
    const double size[2] = {c->width - 1, c->height - 1};
    const double d[2] = {end[1][0] - end[0][0], end[1][1] - end[0][1]};
    for (int k = 0; k < 2; k++) {
        const double x = (-LF_FIT_REACH - end[0][k]) / d[k];
        const double y = (size[k] + LF_FIT_REACH - end[0][k]) / d[k];
        if (fabs(d[k]) < 1e-9)
            continue;
        low = fmax(low, fmin(x, y));
        high = fmin(high, fmax(x, y));
    }
    if (!(low < high))
        return false;
    const double start[2] = {end[0][0], end[0][1]};
    for (int k = 0; k < 2; k++) {
        end[0][k] = start[k] + low * d[k];
        end[1][k] = start[k] + high * d[k];
    }
    return true;
}

bool lf_scene_match(const lf_scene *scene, long from, const lf_pixels *from_pixels, long to,
                    const lf_pixels *to_pixels, const double uv[2], double match[2], double *off)
{
    double patch[PATCH], end[2][2], best = least;
    if (!patch_at(from_pixels, uv[0], uv[1], patch) || !line_of(scene, from, to, uv, end) ||
        !clip(&scene->view[to].camera, end))
        return false;
    const double x = end[1][0] - end[0][0], y = end[1][1] - end[0][1], length = hypot(x, y);
    const double across[2] = {length > 0 ? -y / length : 0, length > 0 ? x / length : 1};
    const long steps = (long)(length / step) + 1, sides = (long)(LF_FIT_REACH / step);
    double along = -1;
    long side = 0;
    for (long i = 0; i <= steps; i++)
        for (long j = -sides; j <= sides; j++) {
            const double t = (double)i / (double)steps, s = (double)j * step;
            const double c = correlation(patch, to_pixels, end[0][0] + t * x + s * across[0],
                                         end[0][1] + t * y + s * across[1]);
            if (c > best) {
                best = c;
                along = t;
                side = j;
            }
        }
    if (along < 0)
        return false;
    double c[3];
    for (int k = 0; k < 3; k++) {
        const double s = (double)(side + k - 1) * step;
        c[k] = correlation(patch, to_pixels, end[0][0] + along * x + s * across[0],
                           end[0][1] + along * y + s * across[1]);
    }
    const double bend = c[0] - 2 * c[1] + c[2];
    const double top = bend < 0 ? 0.5 * (c[0] - c[2]) / bend : 0;
    *off = ((double)side + fmin(0.5, fmax(-0.5, top))) * step;
    for (int k = 0; k < 2; k++)
        match[k] = end[0][k] + along * (k ? y : x) + *off * across[k];
    return true;
}

/* The smaller eigenvalue of the sum of gradient squares over 5 x 5 pixels. */
static double corner_strength(const lf_pixels *p, int column, int row)
{
    double xx = 0, xy = 0, yy = 0;
    for (int j = row - 2; j <= row + 2; j++)
        for (int i = column - 2; i <= column + 2; i++) {
            const double x = grey_at(p, i + 1, j) - grey_at(p, i - 1, j);
            const double y = grey_at(p, i, j + 1) - grey_at(p, i, j - 1);
            xx += x * x;
            xy += x * y;
            yy += y * y;
        }
    return 0.5 * (xx + yy) - hypot(0.5 * (xx - yy), xy);
}

long lf_scene_corners(const lf_pixels *p, int columns, int rows, double (*uv)[2])
{
    long n = 0;
    for (int cell = 0; cell < columns * rows; cell++) {
        const int low = p->width * (cell % columns) / columns,
                  top = p->height * (cell / columns) / rows;
        const int right = p->width * (cell % columns + 1) / columns;
        const int bottom = p->height * (cell / columns + 1) / rows;
        double best = 0.02;
        bool found = false;
        for (int j = top; j < bottom; j++)
            for (int i = low; i < right; i++) {
                if (i < HALF + 1 || j < HALF + 1 || i >= p->width - HALF - 1 ||
                    j >= p->height - HALF - 1)
                    continue;
                const double s = corner_strength(p, i, j);
                if (s > best) {
                    best = s;
                    found = true;
                    uv[n][0] = i;
                    uv[n][1] = j;
                }
            }
        n += found;
    }
    return n;
}

enum { COLUMNS = 6, ROWS = 5, CORNERS = COLUMNS * ROWS };

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The view nearest to another, not at the same place; -1: there is none. */
long lf_scene_neighbour(const lf_scene *scene, long view)
{
    long best = -1;
    double least_far = INFINITY;
    for (long i = 0; i < scene->views; i++) {
        const double *a = scene->view[view].camera.centre, *b = scene->view[i].camera.centre;
        const double far = hypot(hypot(a[0] - b[0], a[1] - b[1]), a[2] - b[2]);
        if (far > 0 && far < least_far) {
            least_far = far;
            best = i;
        }
    }
    return best;
}

/* Match the corners of one view; distances are appended. */
static void fit_pair(const lf_scene *scene, long from, long to, const lf_pixels *a,
                     const lf_pixels *b, lf_line_fit *fit, double *off)
{
    double uv[CORNERS][2], found[CORNERS];
    const long n = lf_scene_corners(a, COLUMNS, ROWS, uv);
#pragma omp parallel for schedule(dynamic)
    for (long i = 0; i < n; i++) {
        double match[2];
        if (!lf_scene_match(scene, from, a, to, b, uv[i], match, &found[i]))
            found[i] = INFINITY;
    }
    for (long i = 0; i < n; i++)
        if (isfinite(found[i]))
            off[fit->matches++] = fabs(found[i]);
    fit->corners += n;
    fit->pairs++;
}

static lf_status fit_views(const lf_scene *scene, long pairs, lf_line_fit *fit, double *off,
                           lf_error *err)
{
    for (long i = 0; i < pairs; i++) {
        const long from = i * scene->views / pairs, to = lf_scene_neighbour(scene, from);
        lf_pixels a, b;
        if (to < 0)
            continue;
        LF_TRY(lf_scene_hold(scene, from, &a, err));
        const lf_status status = lf_scene_hold(scene, to, &b, err);
        if (status == LF_OK) {
            fit_pair(scene, from, to, &a, &b, fit, off);
            lf_scene_release(scene, to);
        }
        lf_scene_release(scene, from);
        LF_TRY(status);
    }
    return LF_OK;
}

lf_status lf_scene_fit_lines(const lf_scene *scene, long pairs, lf_line_fit *out, lf_error *err)
{
    pairs = pairs < scene->views ? pairs : scene->views;
    lf_line_fit fit = {.median = NAN, .within_one = NAN};
    double *off = malloc((size_t)(pairs * CORNERS + 1) * sizeof *off);
    LF_REQUIRE(off, "out of memory");
    const lf_status status = fit_views(scene, pairs, &fit, off, err);
    if (status == LF_OK && fit.matches) {
        long near = 0;
        qsort(off, (size_t)fit.matches, sizeof *off, by_value);
        for (long i = 0; i < fit.matches; i++)
            near += off[i] <= 1;
        fit.median = off[fit.matches / 2];
        fit.within_one = (double)near / (double)fit.matches;
    }
    free(off);
    if (status == LF_OK)
        *out = fit;
    return status;
}
