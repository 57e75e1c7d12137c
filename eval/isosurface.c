/* isosurface.c: which points of the grid are evaluated, coarse to fine; iso_mesh.c marches. */
#include <math.h>

#include "eval/iso_grid.h"
#include "eval/isosurface.h"

typedef struct sampler {
    lf_iso_grid grid;
    const lf_iso_options *options;
    lf_field_fn *field;
    void *context;
    lf_iso_report report;
    long *queue; /* [batch]: grid points to evaluate */
    long queued;
    double (*point)[3]; /* [batch] */
    float *value;       /* [batch] */
    uint8_t *valid;     /* [batch] */
} sampler;

/* A growing list of cells, packed as lf_iso_cell does. */
typedef struct cell_list {
    long *cell, count, room;
} cell_list;

lf_iso_options lf_iso_defaults(void)
{
    return (lf_iso_options){
        .half = 0.55, .coarse = 32, .refinements = 2, .lipschitz = 1, .batch = 65536};
}

static lf_status check_options(const lf_iso_options *o, lf_error *err)
{
    if (!(o->half > 0 && o->half < 1e30))
        return lf_fail(err, LF_BAD_INPUT, "isosurface: half edge %g, must be above 0", o->half);
    if (o->coarse < 2 || o->refinements < 0 || o->refinements > 10 ||
        o->coarse > LF_ISO_RESOLUTION_MAX >> o->refinements)
        return lf_fail(err, LF_BAD_INPUT,
                       "isosurface: %d cells a side halved %d times; the first grid needs at least "
                       "2 and the last may have at most %d",
                       o->coarse, o->refinements, LF_ISO_RESOLUTION_MAX);
    if (!(o->lipschitz >= 0) || o->batch < 1)
        return lf_fail(err, LF_BAD_INPUT,
                       "isosurface: lipschitz %g (must be >= 0), batch %ld (must be >= 1)",
                       o->lipschitz, o->batch);
    return LF_OK;
}

/* ---- evaluating points ------------------------------------------------------------------- */

static void point_position(const lf_iso_grid *g, long id, double point[3])
{
    const long n = lf_iso_side(g) + 1;
    const long index[3] = {id % n - 1, id / n % n - 1, id / (n * n) - 1};
    for (int i = 0; i < 3; i++)
        point[i] = lf_iso_position(g, index[i]);
}

/* Evaluate what is queued. */
static void flush(sampler *s)
{
    if (!s->queued)
        return;
    for (long i = 0; i < s->queued; i++)
        point_position(&s->grid, s->queue[i], s->point[i]);
    memset(s->valid, 1, (size_t)s->queued);
    s->field(s->context, s->queued, (const double(*)[3])s->point, s->value, s->valid);
    for (long i = 0; i < s->queued; i++) {
        const int usable = s->valid[i] && !isnan(s->value[i]);
        s->grid.value[s->queue[i]] = usable ? s->value[i] : INFINITY;
        s->report.invalid += !usable;
    }
    s->report.evaluations += s->queued;
    s->queued = 0;
}

static void request(sampler *s, long id)
{
    if (s->grid.known[id])
        return;
    s->grid.known[id] = 1;
    s->queue[s->queued++] = id;
    if (s->queued == s->options->batch)
        flush(s);
}

/* Points of a cell of `stride` finest cells a side whose lowest corner is p: id of corner c. */
static long corner_point(const lf_iso_grid *g, const long p[3], long stride, int c)
{
    return lf_iso_point(g, p[0] + stride * (c & 1), p[1] + stride * (c >> 1 & 1),
                        p[2] + stride * (c >> 2));
}

static void request_cell(sampler *s, const long p[3], long stride)
{
    for (int c = 0; c < 8; c++)
        request(s, corner_point(&s->grid, p, stride, c));
}

/* ---- refining levels --------------------------------------------------------------------- */

/* One level: cells [side]^3 of `stride` finest cells each; chosen[i] = the cell is of interest. */
typedef struct level {
    long side, stride;
    uint8_t *chosen;
} level;

static long level_index(const level *l, long x, long y, long z)
{
    return (z * l->side + y) * l->side + x;
}

static int on_boundary(const level *l, const long cell[3], int corner)
{
    for (int i = 0; i < 3; i++) {
        const long at = cell[i] + (corner >> i & 1);
        if (at == 0 || at == l->side)
            return 1;
    }
    return 0;
}

static double edge_of(const sampler *s, const level *l)
{
    return 2 * s->grid.half * (double)l->stride / s->grid.resolution;
}

/* May the surface meet the cell: corners of both signs, inside where the cube ends, or a value that
 * is small against half the diagonal? */
static int may_cross(const sampler *s, const level *l, const long cell[3])
{
    const double reach = s->options->lipschitz * 0.5 * sqrt(3.0) * edge_of(s, l);
    const long p[3] = {cell[0] * l->stride, cell[1] * l->stride, cell[2] * l->stride};
    int inside = 0, near = 0;
    for (int c = 0; c < 8; c++) {
        const float v = s->grid.value[corner_point(&s->grid, p, l->stride, c)];
        if (v < 0 && on_boundary(l, cell, c))
            return 1;
        inside += v < 0;
        near |= fabs((double)v) <= reach;
    }
    return near || (inside > 0 && inside < 8);
}

/* The same for the eighth of the cell at corner c, of which that corner and the cell's centre are
 * known: every point of it is within sqrt(5)/4 of the cell's edge of one of the two. */
static int octant_may_cross(const sampler *s, const level *l, const long cell[3], int c)
{
    const double reach = s->options->lipschitz * 0.25 * sqrt(5.0) * edge_of(s, l);
    const long half = l->stride / 2;
    const long p[3] = {cell[0] * l->stride, cell[1] * l->stride, cell[2] * l->stride};
    const float at = s->grid.value[corner_point(&s->grid, p, l->stride, c)];
    const float centre = s->grid.value[corner_point(&s->grid, p, half, 7)];
    return (at < 0) != (centre < 0) || (at < 0 && on_boundary(l, cell, c)) ||
           fmin(fabs((double)at), fabs((double)centre)) <= reach;
}

/* Count the steps from the cell's centre to its corners, and those that are steeper than trusted.
 */
static void count_slopes(sampler *s, const level *l, const long p[3])
{
    const double trusted = s->options->lipschitz * 0.5 * sqrt(3.0) * edge_of(s, l);
    const float centre = s->grid.value[corner_point(&s->grid, p, l->stride / 2, 7)];
    for (int c = 0; c < 8; c++) {
        const float at = s->grid.value[corner_point(&s->grid, p, l->stride, c)];
        s->report.steps += isfinite(at - centre);
        s->report.steep += isfinite(at - centre) && fabs((double)(at - centre)) > trusted;
    }
}

/* Corners of the chosen cells; then the centres of those that the surface may meet, which stay
 * chosen. */
static void sample_level(sampler *s, level *l)
{
    for (long z = 0; z < l->side; z++)
        for (long y = 0; y < l->side; y++)
            for (long x = 0; x < l->side; x++)
                if (l->chosen[level_index(l, x, y, z)])
                    request_cell(s, (const long[3]){x * l->stride, y * l->stride, z * l->stride},
                                 l->stride);
    flush(s);
    for (long z = 0; z < l->side; z++)
        for (long y = 0; y < l->side; y++)
            for (long x = 0; x < l->side; x++) {
                const long cell[3] = {x, y, z}, half = l->stride / 2;
                uint8_t *chosen = &l->chosen[level_index(l, x, y, z)];
                *chosen = *chosen && may_cross(s, l, cell);
                if (*chosen)
                    request(s, lf_iso_point(&s->grid, x * l->stride + half, y * l->stride + half,
                                            z * l->stride + half));
            }
    flush(s);
}

/* Replace a sampled level by the next finer one; 0 without memory. */
static int split_level(sampler *s, level *l)
{
    const size_t cells = (size_t)(l->side * l->side * l->side);
    level fine = {2 * l->side, l->stride / 2, calloc(8 * cells, 1)};
    if (!fine.chosen)
        return 0;
    for (long z = 0; z < l->side; z++)
        for (long y = 0; y < l->side; y++)
            for (long x = 0; x < l->side; x++) {
                const long cell[3] = {x, y, z};
                if (l->chosen[level_index(l, x, y, z)])
                    count_slopes(s, l,
                                 (const long[3]){x * l->stride, y * l->stride, z * l->stride});
                for (int c = 0; l->chosen[level_index(l, x, y, z)] && c < 8; c++)
                    fine.chosen[level_index(&fine, 2 * x + (c & 1), 2 * y + (c >> 1 & 1),
                                            2 * z + (c >> 2))] =
                        (uint8_t)octant_may_cross(s, l, cell, c);
            }
    free(l->chosen);
    *l = fine;
    return 1;
}

/* ---- following the surface on the finest grid ---------------------------------------------- */

static int list_push(cell_list *list, long cell)
{
    if (list->count == list->room) {
        const long room = list->room ? 2 * list->room : 4096;
        long *moved = realloc(list->cell, (size_t)room * sizeof *moved);
        if (!moved)
            return 0;
        list->cell = moved;
        list->room = room;
    }
    list->cell[list->count++] = cell;
    return 1;
}

static int activate(sampler *s, cell_list *list, const long p[3])
{
    const long cell = lf_iso_cell(&s->grid, p[0], p[1], p[2]);
    s->grid.active[cell] = 1;
    request_cell(s, p, 1);
    return list_push(list, cell);
}

/* Inside corners, 0..4, of the face of cell p towards +axis (side 1) or -axis (side 0). */
static int face_inside(const lf_iso_grid *g, const long p[3], int axis, int side)
{
    int inside = 0;
    for (int c = 0; c < 8; c++)
        if ((c >> axis & 1) == side)
            inside += g->value[corner_point(g, p, 1, c)] < 0;
    return inside;
}

/* Put the neighbours that the surface enters from `cell` on the list. In the layer around the cube
 * a cell is also entered where the whole face is inside, because its other side is not. */
static int spread(sampler *s, long cell, cell_list *list)
{
    const lf_iso_grid *g = &s->grid;
    const long n = lf_iso_side(g), p[3] = {cell % n - 1, cell / n % n - 1, cell / (n * n) - 1};
    for (int f = 0; f < 6; f++) {
        long q[3] = {p[0], p[1], p[2]};
        const int axis = f / 2, side = f & 1;
        q[axis] += side ? 1 : -1;
        if (q[axis] < -1 || q[axis] > g->resolution || g->active[lf_iso_cell(g, q[0], q[1], q[2])])
            continue;
        const int inside = face_inside(g, p, axis, side);
        const int around = q[axis] == -1 || q[axis] == g->resolution;
        if (inside && (inside < 4 || around) && !activate(s, list, q))
            return 0;
    }
    return 1;
}

/* From the chosen cells of the finest level on, until no cell is left that the surface enters. */
static int follow(sampler *s, const level *l)
{
    cell_list now = {0}, next = {0};
    int ok = 1;
    for (long z = 0; z < l->side; z++)
        for (long y = 0; y < l->side; y++)
            for (long x = 0; ok && x < l->side; x++)
                if (l->chosen[level_index(l, x, y, z)])
                    ok = activate(s, &now, (const long[3]){x, y, z});
    flush(s);
    while (ok && now.count) {
        next.count = 0;
        for (long i = 0; ok && i < now.count; i++)
            ok = spread(s, now.cell[i], &next);
        flush(s);
        const cell_list swap = now;
        now = next;
        next = swap;
    }
    free(now.cell);
    free(next.cell);
    return ok;
}

/* ---- the whole ------------------------------------------------------------------------------ */

static int sample_sparse(sampler *s)
{
    const long side = s->options->coarse;
    level l = {side, 1L << s->options->refinements, malloc((size_t)(side * side * side))};
    if (!l.chosen)
        return 0;
    memset(l.chosen, 1, (size_t)(side * side * side));
    int ok = 1;
    for (int i = 0; ok && i < s->options->refinements; i++) {
        sample_level(s, &l);
        ok = split_level(s, &l);
    }
    ok = ok && follow(s, &l);
    free(l.chosen);
    return ok;
}

static void sample_dense(sampler *s)
{
    const long n = s->grid.resolution, side = lf_iso_side(&s->grid);
    for (long z = 0; z <= n; z++)
        for (long y = 0; y <= n; y++)
            for (long x = 0; x <= n; x++)
                request(s, lf_iso_point(&s->grid, x, y, z));
    flush(s);
    memset(s->grid.active, 1, (size_t)(side * side * side));
}

/* The layer around the cube is known and outside. */
static void surround(lf_iso_grid *g)
{
    const long n = g->resolution;
    for (long z = -1; z <= n + 1; z++)
        for (long y = -1; y <= n + 1; y++) {
            const int whole = z < 0 || z > n || y < 0 || y > n;
            for (long x = -1; x <= n + 1; x += whole ? 1 : n + 2) {
                g->known[lf_iso_point(g, x, y, z)] = 1;
                g->value[lf_iso_point(g, x, y, z)] = INFINITY;
            }
        }
}

static int allocate(sampler *s)
{
    const size_t side = (size_t)lf_iso_side(&s->grid),
                 points = (side + 1) * (side + 1) * (side + 1);
    const size_t batch = (size_t)s->options->batch;
    s->grid.value = malloc(points * sizeof *s->grid.value);
    s->grid.known = calloc(points, 1);
    s->grid.active = calloc(side * side * side, 1);
    s->queue = calloc(batch, sizeof *s->queue);
    s->point = calloc(batch, sizeof *s->point);
    s->value = calloc(batch, sizeof *s->value);
    s->valid = calloc(batch, 1);
    return s->grid.value && s->grid.known && s->grid.active && s->queue && s->point && s->value &&
           s->valid;
}

static void release(sampler *s)
{
    free(s->grid.value);
    free(s->grid.known);
    free(s->grid.active);
    free(s->queue);
    free(s->point);
    free(s->value);
    free(s->valid);
}

static int sample(sampler *s)
{
    if (!allocate(s))
        return 0;
    surround(&s->grid);
    if (!s->options->dense)
        return sample_sparse(s);
    sample_dense(s);
    return 1;
}

lf_status lf_isosurface(const lf_iso_options *options, lf_field_fn *field, void *context,
                        lf_mesh **out, lf_iso_report *report, lf_error *err)
{
    LF_TRY(check_options(options, err));
    const int resolution = options->coarse << options->refinements;
    const long n = resolution + 1;
    sampler s = {.grid = {.half = options->half, .resolution = resolution},
                 .options = options,
                 .field = field,
                 .context = context,
                 .report = {.resolution = resolution, .dense_evaluations = n * n * n}};
    lf_status status = sample(&s) ? lf_iso_mesh(&s.grid, out, err)
                                  : lf_fail(err, LF_FAILED,
                                            "isosurface at resolution %d: not enough memory; "
                                            "choose a smaller resolution",
                                            resolution);
    if (status == LF_OK && report)
        *report = s.report;
    release(&s);
    return status;
}
