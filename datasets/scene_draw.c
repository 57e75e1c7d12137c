/* scene_draw.c: a picture of a scene's cameras, epipolar lines and bounds. */
#include "datasets/scene_internal.h"

#include "datasets/image.h"

enum { MARGIN = 8, PANEL = 400, HALF_WIDTH = 600, MOST_HEIGHT = 450, TITLE = 20, PAIRS = 2 };
enum { MARKS = 12 };

typedef struct place {
    double x, y; /* pixels of the canvas */
} place;

static const float black[3] = {0, 0, 0}, grey[3] = {0.72f, 0.72f, 0.72f}, orange[3] = {1, 0.55f, 0};
static const float split_colour[LF_SPLITS][3] = {
    {0.1f, 0.3f, 0.9f}, {0.1f, 0.6f, 0.2f}, {0.9f, 0.15f, 0.1f}};

/* A colour of mark i: around the circle of hues. */
static void mark_colour(int i, float out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = (float)(0.5 + 0.5 * cos(6.283185307 * ((double)i / MARKS - k / 3.0)));
}

static void dot(lf_image *to, double x, double y, const float *colour)
{
    if (x >= 0 && y >= 0 && x < to->width && y < to->height)
        memcpy(lf_image_at(to, (int)x, (int)y), colour, 3 * sizeof(float));
}

/* Only inside the box; a longer line than 20000 pixels is drawn by its first part. */
static void line(lf_image *to, place a, place b, const int box[4], const float *colour)
{
    const double length = hypot(b.x - a.x, b.y - a.y);
    const long n = isfinite(length) ? (long)fmin(20000, 2 * length) + 1 : 0;
    for (long i = 0; i <= n; i++) {
        const double t = (double)i / fmax(1, 2 * length > 20000 ? 2 * length : (double)n);
        const double x = a.x + t * (b.x - a.x), y = a.y + t * (b.y - a.y);
        if (x >= box[0] && y >= box[1] && x < box[2] && y < box[3])
            dot(to, x, y, colour);
    }
}

static void square(lf_image *to, place p, double half, const int box[4], const float *colour)
{
    const place c[4] = {{p.x - half, p.y - half},
                        {p.x + half, p.y - half},
                        {p.x + half, p.y + half},
                        {p.x - half, p.y + half}};
    for (int i = 0; i < 4; i++)
        line(to, c[i], c[(i + 1) % 4], box, colour);
}

/* ---- cameras in space --------------------------------------------------------------------- */

typedef struct panel {
    int across, up; /* axes of the world */
    double low[2], scale;
    int box[4];
} panel;

static place on_panel(const panel *p, const double x[3])
{
    return (place){p->box[0] + (x[p->across] - p->low[0]) * p->scale,
                   p->box[3] - (x[p->up] - p->low[1]) * p->scale};
}

/* The point of a view at a pixel and a depth. */
static void point_at(const lf_camera *c, double u, double v, double depth, double out[3])
{
    double d[3];
    lf_camera_ray(c, u, v, d);
    const double ahead = d[0] * c->rotation[2] + d[1] * c->rotation[5] + d[2] * c->rotation[8];
    for (int k = 0; k < 3; k++)
        out[k] = c->centre[k] + depth / ahead * d[k];
}

/* Corner i of the picture, going round. */
static void corner_at(const lf_camera *c, int i, double depth, double out[3])
{
    point_at(c, i == 1 || i == 2 ? c->width - 0.5 : -0.5, i >= 2 ? c->height - 0.5 : -0.5, depth,
             out);
}

/* The box of centres and focus, 15 % larger all round. */
static panel panel_of(const lf_scene *scene, const double focus[3], int across, int up,
                      const int box[4])
{
    panel p = {.across = across, .up = up};
    double low[3], high[3], size = 1e-9;
    for (int k = 0; k < 3; k++) {
        low[k] = high[k] = focus[k];
        for (long v = 0; v < scene->views; v++) {
            low[k] = fmin(low[k], scene->view[v].camera.centre[k]);
            high[k] = fmax(high[k], scene->view[v].camera.centre[k]);
        }
        size = fmax(size, high[k] - low[k]);
    }
    memcpy(p.box, box, sizeof p.box);
    p.scale = (box[2] - box[0]) / (1.3 * size);
    p.low[0] = 0.5 * (low[across] + high[across]) - 0.65 * size;
    p.low[1] = 0.5 * (low[up] + high[up]) - 0.65 * size;
    return p;
}

static void draw_camera(lf_image *to, const panel *p, const lf_scene_view *v)
{
    const double depth = 0.05 * (p->box[2] - p->box[0]) / p->scale;
    const float *colour = split_colour[v->split];
    double near[3], far[3], corner[4][3];
    const double u = 0.5 * (v->camera.width - 1), w = 0.5 * (v->camera.height - 1);
    point_at(&v->camera, u, w, v->near, near);
    point_at(&v->camera, u, w, v->far, far);
    line(to, on_panel(p, near), on_panel(p, far), p->box, grey);
    for (int i = 0; i < 4; i++)
        corner_at(&v->camera, i, depth, corner[i]);
    for (int i = 0; i < 4; i++) {
        line(to, on_panel(p, v->camera.centre), on_panel(p, corner[i]), p->box, colour);
        line(to, on_panel(p, corner[i]), on_panel(p, corner[(i + 1) % 4]), p->box,
             i == 0 ? black : colour); /* the upper edge */
    }
}

static void draw_panels(lf_image *to, const lf_scene *scene)
{
    static const int axes[3][2] = {{0, 1}, {0, 2}, {1, 2}};
    double focus[3];
    lf_scene_focus(scene, focus);
    for (int i = 0; i < 3; i++) {
        const int left = MARGIN + i * (PANEL + MARGIN / 2);
        const int box[4] = {left, TITLE + MARGIN, left + PANEL, TITLE + MARGIN + PANEL};
        const panel p = panel_of(scene, focus, axes[i][0], axes[i][1], box);
        char title[64];
        snprintf(title, sizeof title, "%c right, %c up", "xyz"[axes[i][0]], "xyz"[axes[i][1]]);
        lf_image_text(to, title, left, MARGIN, 2, black);
        for (long n = 0; n < scene->points; n += 1 + scene->points / 5000) {
            const place at = on_panel(&p, scene->point[n]);
            line(to, at, at, box, orange);
        }
        for (long v = 0; v < scene->views; v++)
            draw_camera(to, &p, &scene->view[v]);
        square(to, on_panel(&p, focus), 4, box, black);
        square(to, (place){left + PANEL / 2.0, TITLE + MARGIN + PANEL / 2.0}, PANEL / 2.0 - 1, box,
               grey);
    }
}

/* ---- pairs of views ----------------------------------------------------------------------- */

typedef struct shown {
    lf_pixels pixels;
    long view;
    double scale;
    int box[4];
} shown;

static place on_shown(const shown *s, const double uv[2])
{
    return (place){s->box[0] + (uv[0] + 0.5) * s->scale, s->box[1] + (uv[1] + 0.5) * s->scale};
}

static shown show(lf_image *to, const lf_scene *scene, long view, lf_pixels pixels, int left,
                  int top)
{
    shown s = {.pixels = pixels, .view = view};
    s.scale = fmin((double)HALF_WIDTH / pixels.width, (double)MOST_HEIGHT / pixels.height);
    const int width = (int)(pixels.width * s.scale), height = (int)(pixels.height * s.scale);
    const int box[4] = {left, top + TITLE, left + width, top + TITLE + height};
    memcpy(s.box, box, sizeof box);
    for (int j = 0; j < height; j++)
        for (int i = 0; i < width; i++) {
            const int u = (int)((i + 0.5) / s.scale), v = (int)((j + 0.5) / s.scale);
            const uint8_t *c = pixels.rgb + 3 * ((size_t)v * (size_t)pixels.width + (size_t)u);
            const float value[3] = {(float)c[0] / 255, (float)c[1] / 255, (float)c[2] / 255};
            dot(to, left + i, top + TITLE + j, value);
        }
    char title[64];
    snprintf(title, sizeof title, "%.46s", scene->view[view].name);
    lf_image_text(to, title, left, top + 2, 2, black);
    return s;
}

/* The part of a segment of space that the view sees from the front. */
static void draw_segment(lf_image *to, const lf_scene *scene, const shown *s, const double a[3],
                         const double b[3], const float *colour)
{
    enum { PARTS = 200 };
    place last = {0, 0};
    bool was = false;
    const lf_scene_view *view = &scene->view[s->view];
    for (int i = 0; i <= PARTS; i++) {
        double x[3], uv[2], depth;
        /* finer near a, as depths are */
        const double t = pow((double)i / PARTS, 2);
        for (int k = 0; k < 3; k++)
            x[k] = a[k] + t * (b[k] - a[k]);
        const bool is = lf_camera_project(&view->camera, x, 1e-3 * view->far, uv, &depth);
        const place at = is ? on_shown(s, uv) : last;
        if (is && was)
            line(to, last, at, s->box, colour);
        last = at;
        was = is;
    }
}

/* Where `other` sees the near and far rectangles of the view `of`. */
static void draw_bounds(lf_image *to, const lf_scene *scene, const shown *other, long of)
{
    const lf_scene_view *v = &scene->view[of];
    double near[4][3], far[4][3];
    for (int i = 0; i < 4; i++) {
        corner_at(&v->camera, i, v->near, near[i]);
        corner_at(&v->camera, i, v->far, far[i]);
    }
    for (int i = 0; i < 4; i++) {
        draw_segment(to, scene, other, near[i], near[(i + 1) % 4], orange);
        draw_segment(to, scene, other, far[i], far[(i + 1) % 4], grey);
        draw_segment(to, scene, other, near[i], far[i], grey);
    }
}

static void draw_lines(lf_image *to, const lf_scene *scene, const shown *a, const shown *b)
{
    double uv[MARKS][2];
    const long n = lf_scene_corners(&a->pixels, 4, 3, uv);
    const lf_scene_view *from = &scene->view[a->view];
    for (long i = 0; i < n; i++) {
        double near[3], far[3], match[2], off;
        float colour[3];
        mark_colour((int)i, colour);
        point_at(&from->camera, uv[i][0], uv[i][1], from->near, near);
        point_at(&from->camera, uv[i][0], uv[i][1], from->far, far);
        square(to, on_shown(a, uv[i]), 5, a->box, colour);
        square(to, on_shown(a, uv[i]), 4, a->box, colour);
        draw_segment(to, scene, b, near, far, colour);
        if (!lf_scene_match(scene, a->view, &a->pixels, b->view, &b->pixels, uv[i], match, &off))
            continue;
        square(to, on_shown(b, match), 5, b->box, colour);
        square(to, on_shown(b, match), 4, b->box, colour);
    }
}

static lf_status draw_pair(lf_image *to, const lf_scene *scene, int pair, long from, long other,
                           lf_error *err)
{
    const int top = MARGIN + TITLE + PANEL + MARGIN + pair * (MOST_HEIGHT + TITLE + MARGIN);
    lf_pixels p, q;
    LF_TRY(lf_scene_hold(scene, from, &p, err));
    const lf_status status = lf_scene_hold(scene, other, &q, err);
    if (status == LF_OK) {
        const shown a = show(to, scene, from, p, MARGIN, top);
        const shown b = show(to, scene, other, q, MARGIN + HALF_WIDTH + MARGIN, top);
        draw_bounds(to, scene, &a, other);
        draw_bounds(to, scene, &b, from);
        draw_lines(to, scene, &a, &b);
        lf_scene_release(scene, other);
    }
    lf_scene_release(scene, from);
    return status;
}

lf_status lf_scene_draw(const lf_scene *scene, const char *png, lf_error *err)
{
    const float white[3] = {1, 1, 1};
    lf_image *to = lf_image_create(
        2 * HALF_WIDTH + 3 * MARGIN,
        MARGIN + TITLE + PANEL + MARGIN + PAIRS * (MOST_HEIGHT + TITLE + MARGIN), 3);
    lf_image_fill(to, white);
    draw_panels(to, scene);
    lf_status status = LF_OK;
    for (int i = 0; status == LF_OK && i < PAIRS; i++) {
        const long from = i * (scene->views / PAIRS), other = lf_scene_neighbour(scene, from);
        if (other >= 0)
            status = draw_pair(to, scene, i, from, other, err);
    }
    if (status == LF_OK)
        status = lf_image_write_png(png, to, err);
    lf_image_free(to);
    return status;
}
