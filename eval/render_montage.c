/* render_montage.c: a row a view; heights of rows follow their pictures. */
#include "eval/render_montage.h"

#include <math.h>

#include "eval/colour_map.h"
#include "eval/image_metrics.h"
#include "eval/image_resize.h"

enum { GAP = 8, BELOW = 14, BAR = 128 }; /* pixels: between pictures; below a row; of a scale */
enum { RENDERED, TRUTH, ERROR, DEPTH, SHOWN };

static const float black[3] = {0, 0, 0}, white[3] = {1, 1, 1}, grey[3] = {0.45f, 0.45f, 0.45f};

lf_render_montage_options lf_render_montage_defaults(void)
{
    return (lf_render_montage_options){.cell = 160, .views = 3, .error_most = 0.2};
}

/* ---- layout ------------------------------------------------------------------------------- */

/* The font's scale: small cells have small letters. */
static int text_scale(const lf_render_montage_options *o)
{
    return o->cell < 112 ? 1 : 2;
}

static int line_height(const lf_render_montage_options *o)
{
    return 8 * text_scale(o) + GAP;
}

/* Left edge of picture `column`; a wider gap after the source views. */
static int column_left(const lf_render_montage_options *o, int column)
{
    const bool shown = o->views > 0 && column >= o->views;
    return GAP + column * (o->cell + GAP) + (shown ? 2 * GAP : 0);
}

static int total_width(const lf_render_montage_options *o)
{
    return column_left(o, o->views + SHOWN);
}

static int fitted_height(const lf_image *image, int cell)
{
    int width, height = 0;
    if (image)
        lf_image_fit(image->width, image->height, cell, cell, &width, &height);
    return height;
}

/* Of the tallest picture of a row. */
static int row_height(const lf_render_row *r, const lf_render_montage_options *o)
{
    int height = fitted_height(r->rendered, o->cell);
    const int views = r->sources < o->views ? r->sources : o->views;
    const int truth = fitted_height(r->truth, o->cell);
    height = truth > height ? truth : height;
    for (int i = 0; i < views; i++) {
        const int source = fitted_height(r->source[i], o->cell);
        height = source > height ? source : height;
    }
    return height;
}

static lf_status check(long rows, const lf_render_row *row, const lf_render_montage_options *o,
                       int *total_height, lf_error *err)
{
    if (o->cell < 32 || o->cell > 1024 || o->views < 0 || o->views > 16 || !(o->error_most > 0))
        return lf_fail(err, LF_BAD_INPUT,
                       "montage: cell %d (32 to 1024), views %d (0 to 16), error_most %g (> 0)",
                       o->cell, o->views, o->error_most);
    long height = 2 * GAP + 2L * line_height(o);
    for (long i = 0; i < rows && height <= LF_IMAGE_SIZE_MAX; i++) {
        if (row[i].depth && !(row[i].near >= 0 && row[i].near < row[i].far))
            return lf_fail(err, LF_BAD_INPUT, "montage: row %ld: near %g, far %g; 0 <= near < far",
                           i, row[i].near, row[i].far);
        height += line_height(o) + row_height(&row[i], o) + BELOW;
    }
    if (rows < 1 || height > LF_IMAGE_SIZE_MAX)
        return lf_fail(err, LF_BAD_INPUT,
                       "montage: %ld rows; one at least, and no more than %d pixels high", rows,
                       LF_IMAGE_SIZE_MAX);
    *total_height = (int)height;
    return LF_OK;
}

/* ---- what the cells show ------------------------------------------------------------------ */

lf_status lf_image_error_map(const lf_image *a, const lf_image *b, lf_image **out, lf_error *err)
{
    LF_TRY(lf_images_agree(a, b, err));
    lf_image *x = lf_image_for_metrics(a), *y = lf_image_for_metrics(b);
    *out = lf_image_create(a->width, a->height, 1);
    for (long i = 0; i < (long)a->width * a->height; i++) {
        float sum = 0;
        for (int c = 0; c < 3; c++)
            sum += fabsf(x->pixel[3 * i + c] - y->pixel[3 * i + c]);
        (*out)->pixel[i] = sum / 3;
    }
    lf_image_free(x);
    lf_image_free(y);
    return LF_OK;
}

lf_image *lf_depth_picture(const float *depth, int width, int height, double near, double far)
{
    lf_image *out = lf_image_create(width, height, 3);
    for (long i = 0; i < (long)width * height; i++) {
        const double d = (double)depth[i];
        const double t =
            near > 0 ? (1 / d - 1 / far) / (1 / near - 1 / far) : (far - d) / (far - near);
        if (isfinite(d))
            lf_colour_at(LF_COLOURS_SEA, near > 0 && d <= 0 ? 1 : t, out->pixel + 3 * i);
        else
            memcpy(out->pixel + 3 * i, white, sizeof white);
    }
    return out;
}

/* A picture in its cell, in the middle of the width. */
static void draw_fitted(lf_image *canvas, const lf_image *image, int cell, int left, int top)
{
    int width, height;
    lf_image_fit(image->width, image->height, cell, cell, &width, &height);
    lf_image *fitted = lf_image_resize(image, width, height);
    lf_image_paste(canvas, fitted, left + (cell - width) / 2, top, 1);
    lf_image_free(fitted);
}

static void draw_picture(lf_image *canvas, const lf_image *image, int cell, int left, int top)
{
    if (!image)
        return;
    lf_image *opaque = lf_image_over_white(image);
    draw_fitted(canvas, opaque, cell, left, top);
    lf_image_free(opaque);
}

/* Errors are averaged by the resizing, then coloured. */
static lf_status draw_error(lf_image *canvas, const lf_render_row *r,
                            const lf_render_montage_options *o, int left, int top, lf_error *err)
{
    lf_image *error = NULL;
    int width, height;
    if (!r->rendered || !r->truth)
        return LF_OK;
    LF_TRY(lf_image_error_map(r->rendered, r->truth, &error, err));
    lf_image_fit(error->width, error->height, o->cell, o->cell, &width, &height);
    lf_image *fitted = lf_image_resize(error, width, height);
    lf_image *coloured = lf_image_create(width, height, 3);
    for (long i = 0; i < (long)width * height; i++)
        lf_colour_at(LF_COLOURS_HEAT, (double)fitted->pixel[i] / o->error_most,
                     coloured->pixel + 3 * i);
    lf_image_paste(canvas, coloured, left + (o->cell - width) / 2, top, 1);
    lf_image_free(error);
    lf_image_free(fitted);
    lf_image_free(coloured);
    return LF_OK;
}

static void draw_depth(lf_image *canvas, const lf_render_row *r, int cell, int left, int top)
{
    if (!r->depth || !r->rendered)
        return;
    lf_image *picture =
        lf_depth_picture(r->depth, r->rendered->width, r->rendered->height, r->near, r->far);
    draw_fitted(canvas, picture, cell, left, top);
    lf_image_free(picture);
}

/* ---- the whole ---------------------------------------------------------------------------- */

static void draw_caption(lf_image *canvas, const lf_render_row *r, int top, int scale)
{
    char text[256], psnr[32] = "", depth[64] = "";
    if (!isnan(r->psnr))
        snprintf(psnr, sizeof psnr, "   PSNR %.2f dB", r->psnr);
    if (r->depth)
        snprintf(depth, sizeof depth, "   depth %.3g to %.3g", r->near, r->far);
    snprintf(text, sizeof text, "%s%s%s%s%s", r->scene ? r->scene : "",
             r->scene && r->view ? "   " : "", r->view ? r->view : "", psnr, depth);
    lf_image_text(canvas, text, GAP, top, scale, black);
}

static lf_status draw_row(lf_image *canvas, const lf_render_row *r,
                          const lf_render_montage_options *o, int *top, lf_error *err)
{
    const int views = r->sources < o->views ? r->sources : o->views;
    const int first = o->views, cell = o->cell;
    draw_caption(canvas, r, *top, text_scale(o));
    const int y = *top + line_height(o) - GAP / 2;
    for (int i = 0; i < views; i++)
        draw_picture(canvas, r->source[i], cell, column_left(o, i), y);
    draw_picture(canvas, r->rendered, cell, column_left(o, first + RENDERED), y);
    draw_picture(canvas, r->truth, cell, column_left(o, first + TRUTH), y);
    draw_depth(canvas, r, cell, column_left(o, first + DEPTH), y);
    *top += line_height(o) + row_height(r, o) + BELOW;
    return draw_error(canvas, r, o, column_left(o, first + ERROR), y, err);
}

static void draw_heads(lf_image *canvas, const lf_render_montage_options *o)
{
    static const char *const title[SHOWN] = {"rendered", "true", "error", "depth"};
    const int scale = text_scale(o);
    const bool wide = o->views * (o->cell + GAP) >= lf_image_text_width(20, scale);
    lf_image_fill(canvas, white);
    if (o->views)
        lf_image_text(canvas, wide ? "nearest source views" : "sources", GAP, GAP, scale, grey);
    for (int i = 0; i < SHOWN; i++)
        lf_image_text(canvas, title[i], column_left(o, o->views + i), GAP, scale, grey);
}

/* "error 0 [colours] 0.2", its right end at `right`; returns its left end. */
static int draw_scale(lf_image *canvas, lf_colour_map map, const char *low, const char *high,
                      int right, int top, int scale)
{
    const int bar = BAR / 2 * scale;
    int left = right - lf_image_text_width((int)strlen(high), scale);
    lf_image_text(canvas, high, left, top, scale, grey);
    left -= bar + GAP;
    for (int x = 0; x < bar; x++)
        for (int y = 0; y < 7 * scale; y++)
            if (left + x >= 0)
                lf_colour_at(map, x / (bar - 1.0), lf_image_at(canvas, left + x, top + y));
    left -= lf_image_text_width((int)strlen(low), scale) + GAP;
    lf_image_text(canvas, low, left, top, scale, grey);
    return left;
}

static void draw_scales(lf_image *canvas, const lf_render_montage_options *o, int top)
{
    const int scale = total_width(o) < 720 ? 1 : text_scale(o);
    char high[32];
    snprintf(high, sizeof high, "%g", o->error_most);
    const int left =
        draw_scale(canvas, LF_COLOURS_SEA, "depth: far", "near", total_width(o) - GAP, top, scale);
    draw_scale(canvas, LF_COLOURS_HEAT, "error: 0", high, left - 4 * GAP, top, scale);
}

lf_status lf_render_montage_write(const char *path, long rows, const lf_render_row *row,
                                  const lf_render_montage_options *options, lf_error *err)
{
    int height = 0, top = GAP + line_height(options);
    LF_TRY(check(rows, row, options, &height, err));
    lf_image *canvas = lf_image_create(total_width(options), height, 3);
    draw_heads(canvas, options);
    lf_status status = LF_OK;
    for (long i = 0; status == LF_OK && i < rows; i++) {
        status = draw_row(canvas, &row[i], options, &top, err);
        if (status != LF_OK)
            lf_error_context(err, status, "montage: row %ld", i);
    }
    draw_scales(canvas, options, top);
    if (status == LF_OK)
        status = lf_image_write_png(path, canvas, err);
    lf_image_free(canvas);
    return status;
}
