/* scene_bounds.c: what outlines on white ground say of a scene: a visual hull on a grid.
 *
 * A cell of the grid is empty if some training view shows only ground where a ball round it
 * projects; outside a picture whose rim is all ground there is nothing. The ball round the middle
 * of the cells that are left bounds the scene.
 */
#include "datasets/scene_bounds.h"

static bool is_ground(const lf_pixels *p, long i)
{
    if (p->alpha)
        return p->alpha[i] == 0;
    return p->rgb[3 * i] >= 250 && p->rgb[3 * i + 1] >= 250 && p->rgb[3 * i + 2] >= 250;
}

/* Is this share of the picture's rim ground? */
static bool has_rim(const lf_pixels *p, double share)
{
    long rim = 0, ground = 0;
    for (long i = 0; i < (long)p->width * p->height; i++) {
        const long x = i % p->width, y = i / p->width;
        if (x && y && x < p->width - 1 && y < p->height - 1)
            continue;
        rim++;
        ground += is_ground(p, i);
    }
    return (double)ground >= share * (double)rim;
}

static bool is_opaque(const lf_pixels *p)
{
    for (long i = 0; i < (long)p->width * p->height; i++)
        if (p->alpha && p->alpha[i] < 255)
            return false;
    return true;
}

lf_status lf_entry_find_ground(lf_scene_entry *e, lf_error *err)
{
    const long n = e->count[LF_SPLIT_TRAIN], looked = n < 4 ? n : 4;
    bool clear = false, rims = true; /* colours of what is clear are over white */
    for (long i = 0; !clear && i < looked; i++) {
        const long v = e->view[LF_SPLIT_TRAIN][i * n / looked];
        lf_pixels p;
        LF_TRY(lf_scene_hold(e->scene, v, &p, err));
        clear = !is_opaque(&p);
        p.alpha = NULL;
        rims = rims && has_rim(&p, 0.98);
        lf_scene_release(e->scene, v);
    }
    e->white = clear || rims;
    return LF_OK;
}

enum { GRID = 48 };

/* Cells of a cube that may hold something: all at first. */
typedef struct hull {
    double corner[3], edge; /* of the cube; of a cell */
    bool *may;              /* [GRID^3] */
} hull;

static void cell_centre(const hull *h, long cell, double p[3])
{
    const long at[3] = {cell / GRID / GRID, cell / GRID % GRID, cell % GRID};
    for (int a = 0; a < 3; a++)
        p[a] = h->corner[a] + ((double)at[a] + 0.5) * h->edge;
}

/* One view of the scene, and whether its rim is all ground: then nothing lies outside it. */
typedef struct outline {
    const lf_camera *camera;
    lf_pixels pixels;
    bool whole;
} outline;

/* Does the view show only ground where a ball round the cell projects? */
static bool shows_ground(const outline *o, const double p[3], double radius)
{
    double uv[2], depth;
    const lf_camera *c = o->camera;
    const int width = o->pixels.width, height = o->pixels.height;
    if (!lf_camera_project(c, p, 2 * radius, uv, &depth))
        return false;
    /* off the axis by an angle the ball is seen wider by 1 / its cosine, at most */
    const double wider = hypot(1, hypot((uv[0] - c->cx) / c->fx, (uv[1] - c->cy) / c->fy));
    const double reach = ceil(fmax(c->fx, c->fy) * wider * radius / (depth - radius)) + 1;
    const double left = uv[0] - reach, right = uv[0] + reach;
    const double top = uv[1] - reach, bottom = uv[1] + reach;
    if (!o->whole && (left < 0 || right > width - 1 || top < 0 || bottom > height - 1))
        return false; /* what leaves the picture is not known */
    for (long y = lround(fmax(top, 0)); y <= lround(fmin(bottom, height - 1)); y++)
        for (long x = lround(fmax(left, 0)); x <= lround(fmin(right, width - 1)); x++)
            if (!is_ground(&o->pixels, y * width + x))
                return false;
    return true;
}

static lf_status carve(const lf_scene_entry *e, hull *h, lf_error *err)
{
    for (long i = 0; i < e->count[LF_SPLIT_TRAIN]; i++) {
        const long v = e->view[LF_SPLIT_TRAIN][i];
        outline o = {.camera = &e->scene->view[v].camera};
        LF_TRY(lf_scene_hold(e->scene, v, &o.pixels, err));
        o.whole = has_rim(&o.pixels, 1);
#pragma omp parallel for schedule(static)
        for (long c = 0; c < (long)GRID * GRID * GRID; c++) {
            double p[3];
            cell_centre(h, c, p);
            if (h->may[c] && shows_ground(&o, p, 0.8661 * h->edge))
                h->may[c] = false;
        }
        lf_scene_release(e->scene, v);
    }
    return LF_OK;
}

/* The ball round the middle of what is left; radius 0 if nothing or almost all is. */
static void enclose(const hull *h, lf_scene_entry *e)
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    double middle[3], p[3], radius = 0;
    for (long c = 0; c < (long)GRID * GRID * GRID; c++) {
        cell_centre(h, c, p);
        for (int a = 0; a < 3 && h->may[c]; a++) {
            low[a] = fmin(low[a], p[a]);
            high[a] = fmax(high[a], p[a]);
        }
    }
    for (int a = 0; a < 3; a++)
        middle[a] = 0.5 * (low[a] + high[a]);
    for (long c = 0; c < (long)GRID * GRID * GRID; c++) {
        cell_centre(h, c, p);
        if (h->may[c])
            radius =
                fmax(radius, hypot(hypot(p[0] - middle[0], p[1] - middle[1]), p[2] - middle[2]));
    }
    if (!(radius > 0) || radius > 0.45 * GRID * h->edge)
        return;
    memcpy(e->centre, middle, sizeof middle);
    e->radius = radius + 0.8661 * h->edge;
}

lf_status lf_entry_find_bounds(lf_scene_entry *e, lf_error *err)
{
    double nearest = INFINITY;
    for (long v = 0; v < e->scene->views; v++) {
        const double *c = e->scene->view[v].camera.centre;
        nearest = fmin(nearest,
                       hypot(hypot(c[0] - e->centre[0], c[1] - e->centre[1]), c[2] - e->centre[2]));
    }
    hull h = {.edge = 1.4 * nearest / GRID, .may = malloc((size_t)GRID * GRID * GRID)};
    LF_REQUIRE(h.may, "out of memory");
    memset(h.may, true, (size_t)GRID * GRID * GRID);
    for (int a = 0; a < 3; a++)
        h.corner[a] = e->centre[a] - 0.5 * GRID * h.edge;
    const lf_status status = carve(e, &h, err);
    if (status == LF_OK)
        enclose(&h, e);
    free(h.may);
    return status;
}
