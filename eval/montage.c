/* montage.c: a row a shape, its input views beside pictures of both meshes. */
#include "datasets/camera.h"
#include "datasets/image.h"
#include "datasets/render.h"
#include "eval/montage.h"

enum { GAP = 6, TEXT = 2, LINE = 8 * TEXT + GAP }; /* pixels; TEXT scales the 5x7 font */

#define SHADE_DIM 0.8f /* the brightest shade is 1, which white ground would swallow */

static const float black[3] = {0, 0, 0}, white[3] = {1, 1, 1};

lf_montage_options lf_montage_defaults(void)
{
    return (lf_montage_options){.cell = 129, .views = 4, .viewpoints = 2};
}

/* Left edge of picture `column` of the row. */
static int column_left(const lf_montage_options *o, int column)
{
    const int groups = (column >= o->views) + (column >= o->views + o->viewpoints);
    return GAP + column * (o->cell + GAP) + groups * 2 * GAP; /* wider between the three groups */
}

static int total_width(const lf_montage_options *o)
{
    return column_left(o, o->views + 2 * o->viewpoints);
}

static int row_top(const lf_montage_options *o, long row)
{
    return GAP + LINE + (int)row * (LINE + o->cell + GAP);
}

static lf_status check(long rows, const lf_montage_options *o, lf_error *err)
{
    if (o->cell < 16 || o->cell > 1024 || o->views < 0 || o->views > 64 || o->viewpoints < 1 ||
        o->viewpoints > 2)
        return lf_fail(err, LF_BAD_INPUT,
                       "montage: cell %d (16 to 1024), views %d (0 to 64), viewpoints %d (1 or 2)",
                       o->cell, o->views, o->viewpoints);
    const long most = (LF_IMAGE_SIZE_MAX - 2 * GAP - LINE) / (LINE + o->cell + GAP);
    if (rows < 1 || rows > most)
        return lf_fail(err, LF_BAD_INPUT, "montage: %ld rows, must be 1 to %ld", rows, most);
    if (total_width(o) > LF_IMAGE_SIZE_MAX)
        return lf_fail(err, LF_BAD_INPUT, "montage: %d pixels wide, at most %d; fewer views",
                       total_width(o), LF_IMAGE_SIZE_MAX);
    return LF_OK;
}

/* Channel c of a view at pixel (column, row), over white. */
static float over_white(const lf_montage_row *r, const float *view, int column, int row, int c)
{
    const float *p = view + ((long)row * r->size + column) * r->channels;
    return (r->channels == 2 ? SHADE_DIM * p[0] : p[c]) + (1 - p[r->channels - 1]);
}

lf_image *lf_montage_view(const lf_montage_row *r, int view, int cell)
{
    lf_image *picture = lf_image_create(cell, cell, 3);
    const float *image = r->images + (long)view * r->size * r->size * r->channels;
    const float step = (float)(r->size - 1) / (float)(cell - 1);
    const int last = r->size - 1;
    for (int y = 0; y < cell; y++)
        for (int x = 0; x < cell; x++) {
            const float u = (float)x * step, v = (float)y * step;
            const int i = (int)u, j = (int)v, i1 = i < last ? i + 1 : last,
                      j1 = j < last ? j + 1 : last;
            const float a = u - (float)i, b = v - (float)j;
            float *out = lf_image_at(picture, x, y);
            for (int c = 0; c < 3; c++)
                out[c] = (1 - b) * ((1 - a) * over_white(r, image, i, j, c) +
                                    a * over_white(r, image, i1, j, c)) +
                         b * ((1 - a) * over_white(r, image, i, j1, c) +
                              a * over_white(r, image, i1, j1, c));
        }
    return picture;
}

lf_status lf_montage_mesh(const lf_mesh *mesh, lf_montage_colour colour, int viewpoint, int cell,
                          lf_image **out, lf_error *err)
{
    static const float colours[2][3] = {{0.62f, 0.74f, 0.9f}, {0.8f, 0.8f, 0.78f}};
    const double centres[2][3] = {{1.5, 1.1, -1.66}, {-2.1, 0.7, -1.16}}, origin[3] = {0, 0, 0};
    const double half_angle = 0.215; /* radians; radius 0.54 at the cameras' distance of 2.5 */
    const lf_camera camera = lf_camera_look_at(centres[viewpoint], origin, half_angle, cell);
    lf_image *picture = lf_image_create(cell, cell, 3);
    lf_image_fill(picture, white);
    lf_status status = LF_OK;
    if (mesh && mesh->faces >= 1 && lf_mesh_area(mesh) > 0) {
        lf_mesh *painted = lf_mesh_copy(mesh);
        lf_mesh_paint(painted, colours[colour][0], colours[colour][1], colours[colour][2]);
        status = lf_render_mesh_picture(painted, &camera, white, picture->pixel, err);
        lf_mesh_free(painted);
    }
    if (status == LF_OK)
        *out = picture;
    else
        lf_image_free(picture);
    return status;
}

static void draw_view(lf_image *canvas, const lf_montage_row *r, int view, int cell, int left,
                      int top)
{
    lf_image *picture = lf_montage_view(r, view, cell);
    lf_image_paste(canvas, picture, left, top, 1);
    lf_image_free(picture);
}

static lf_status draw_mesh(lf_image *canvas, const lf_mesh *mesh, lf_montage_colour colour,
                           int viewpoint, int cell, int left, int top, lf_error *err)
{
    lf_image *picture = NULL;
    LF_TRY(lf_montage_mesh(mesh, colour, viewpoint, cell, &picture, err));
    lf_image_paste(canvas, picture, left, top, 1);
    lf_image_free(picture);
    return LF_OK;
}

static lf_status draw_row(lf_image *canvas, const lf_montage_row *r, const lf_montage_options *o,
                          int top, lf_error *err)
{
    const int views = r->views < o->views ? r->views : o->views;
    LF_REQUIRE(!views || (r->images && r->size >= 1 && (r->channels == 2 || r->channels == 4)),
               "montage: %d views of size %d with %d channels", r->views, r->size, r->channels);
    if (r->caption)
        lf_image_text(canvas, r->caption, GAP, top, TEXT, black);
    top += LINE;
    for (int i = 0; i < views; i++)
        draw_view(canvas, r, i * r->views / views, o->cell, column_left(o, i), top);
    for (int i = 0; i < o->viewpoints; i++) {
        LF_TRY(draw_mesh(canvas, r->predicted, LF_MONTAGE_PREDICTED, i, o->cell,
                         column_left(o, o->views + i), top, err));
        LF_TRY(draw_mesh(canvas, r->truth, LF_MONTAGE_TRUE, i, o->cell,
                         column_left(o, o->views + o->viewpoints + i), top, err));
    }
    return LF_OK;
}

static void draw_heads(lf_image *canvas, const lf_montage_options *o)
{
    lf_image_fill(canvas, white);
    if (o->views)
        lf_image_text(canvas, "input views", column_left(o, 0), GAP, TEXT, black);
    lf_image_text(canvas, "predicted", column_left(o, o->views), GAP, TEXT, black);
    lf_image_text(canvas, "true", column_left(o, o->views + o->viewpoints), GAP, TEXT, black);
}

lf_status lf_montage_write(const char *path, long rows, const lf_montage_row *row,
                           const lf_montage_options *options, lf_error *err)
{
    LF_TRY(check(rows, options, err));
    lf_image *canvas = lf_image_create(total_width(options), row_top(options, rows), 3);
    draw_heads(canvas, options);
    lf_status status = LF_OK;
    for (long i = 0; status == LF_OK && i < rows; i++)
        status = draw_row(canvas, &row[i], options, row_top(options, i), err);
    if (status == LF_OK)
        status = lf_image_write_png(path, canvas, err);
    lf_image_free(canvas);
    return status;
}
