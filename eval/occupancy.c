/* occupancy.c: winding number of a closed mesh round points, by columns along z.
 *
 * The winding number round p is the sum over the faces that lie above p of +1 where the face is
 * seen counter-clockwise from above and -1 where clockwise. Whether p's column passes through a
 * face is decided by crossings of the face's sides with the ray from p along +x in the xy plane,
 * and a side is always computed from its vertex of lower number to the other: both faces at a side
 * decide alike, so no column slips between two faces or meets both. Cost: faces sorted into about
 * `faces` square columns; a query looks at one of them.
 */
#include <math.h>

#include "eval/metrics.h"

#define COLUMNS_MAX 1024 /* a side */

typedef struct columns {
    const lf_mesh *mesh;
    double low[3], high[3], scale[2];
    long side;
    long *start;   /* [side^2 + 1]: first entry of each column */
    int32_t *face; /* faces whose box touches the column */
} columns;

static long column_of(const columns *c, int axis, double at)
{
    const double i = floor((at - c->low[axis]) * c->scale[axis]);
    return i < 0 ? 0 : i >= (double)c->side ? c->side - 1 : (long)i;
}

/* Range of columns that a face touches: [x0, x1] x [y0, y1]. */
static void face_columns(const columns *c, long face, long range[4])
{
    for (int axis = 0; axis < 2; axis++) {
        double low = INFINITY, high = -INFINITY;
        for (int k = 0; k < 3; k++) {
            const double v = c->mesh->vertex[c->mesh->face[face][k]][axis];
            low = fmin(low, v);
            high = fmax(high, v);
        }
        range[2 * axis] = column_of(c, axis, low);
        range[2 * axis + 1] = column_of(c, axis, high);
    }
}

/* Count the entries of the columns, or with `fill` write them; start[] moves on by one column. */
static void visit_faces(columns *c, int fill)
{
    for (long f = 0; f < c->mesh->faces; f++) {
        long r[4];
        face_columns(c, f, r);
        for (long y = r[2]; y <= r[3]; y++)
            for (long x = r[0]; x <= r[1]; x++) {
                long *next = &c->start[y * c->side + x + !fill];
                if (fill)
                    c->face[*next] = (int32_t)f;
                ++*next;
            }
    }
}

/* Entries that all columns together would have. */
static double count_entries(const columns *c)
{
    double entries = 0;
    for (long f = 0; f < c->mesh->faces; f++) {
        long r[4];
        face_columns(c, f, r);
        entries += (double)(r[1] - r[0] + 1) * (double)(r[3] - r[2] + 1);
    }
    return entries;
}

static void choose_side(columns *c)
{
    c->side = (long)fmin(1 + sqrt((double)c->mesh->faces), COLUMNS_MAX);
    for (;; c->side /= 2) {
        for (int i = 0; i < 2; i++)
            c->scale[i] = (double)c->side / fmax(c->high[i] - c->low[i], 1e-300);
        if (c->side < 2 || count_entries(c) <= 32.0 * (double)c->mesh->faces)
            return; /* many faces as wide as the mesh: fewer columns */
    }
}

static lf_status columns_build(columns *c, const lf_mesh *mesh, lf_error *err)
{
    *c = (columns){.mesh = mesh};
    lf_mesh_bounds(mesh, c->low, c->high);
    choose_side(c);
    const long count = c->side * c->side;
    c->start = calloc((size_t)count + 1, sizeof *c->start);
    if (c->start) {
        visit_faces(c, 0);
        for (long i = 0; i < count; i++)
            c->start[i + 1] += c->start[i];
        c->face = malloc(((size_t)c->start[count] + 1) * sizeof *c->face);
    }
    if (!c->face) {
        free(c->start);
        return lf_fail(err, LF_FAILED, "occupancy of %ld faces: not enough memory", mesh->faces);
    }
    visit_faces(c, 1); /* start[i] is now where column i ends */
    return LF_OK;
}

/* +1, -1 or 0: does the ray from p along +x cross the side a -> b upwards, downwards or not? */
static int side_crossing(const lf_mesh *mesh, int32_t a, int32_t b, const double p[3])
{
    const double *u = mesh->vertex[a < b ? a : b], *v = mesh->vertex[a < b ? b : a];
    const int up = v[1] > p[1];
    if ((u[1] > p[1]) == up)
        return 0;
    /* fma fixes the rounding: the same number wherever the compiler puts this */
    const double left = fma(v[0] - u[0], p[1] - u[1], -((v[1] - u[1]) * (p[0] - u[0])));
    if (up ? !(left > 0) : !(left < 0))
        return 0;
    return up == (a < b) ? 1 : -1;
}

/* Is the plane of the face above p? Called only where p's column passes through the face. */
static int face_above(const lf_mesh *mesh, const int32_t face[3], const double p[3])
{
    const double *a = mesh->vertex[face[0]], *b = mesh->vertex[face[1]], *c = mesh->vertex[face[2]];
    const double low = fmin(a[2], fmin(b[2], c[2])), high = fmax(a[2], fmax(b[2], c[2]));
    if (p[2] < low || p[2] >= high)
        return p[2] < low;
    const double u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
    const double v[3] = {c[0] - a[0], c[1] - a[1], c[2] - a[2]};
    const double w[3] = {p[0] - a[0], p[1] - a[1], p[2] - a[2]};
    const double nx = u[1] * v[2] - u[2] * v[1], ny = u[2] * v[0] - u[0] * v[2];
    const double nz = u[0] * v[1] - u[1] * v[0];
    const double height = nx * w[0] + ny * w[1] + nz * w[2]; /* of p over the plane, times |n| */
    return nz > 0 ? height < 0 : height > 0;
}

static int winding(const columns *c, const double p[3])
{
    for (int i = 0; i < 3; i++)
        if (!(p[i] >= c->low[i] && p[i] <= c->high[i]))
            return 0;
    const long at = column_of(c, 1, p[1]) * c->side + column_of(c, 0, p[0]);
    int sum = 0;
    for (long i = at ? c->start[at - 1] : 0; i < c->start[at]; i++) {
        const int32_t *f = c->mesh->face[c->face[i]];
        int turns = 0;
        for (int k = 0; k < 3; k++)
            turns += side_crossing(c->mesh, f[k], f[(k + 1) % 3], p);
        if (turns && face_above(c->mesh, f, p))
            sum += turns;
    }
    return sum;
}

lf_status lf_winding_occupancy(const lf_mesh *closed, long n, const double (*point)[3],
                               uint8_t *inside, lf_error *err)
{
    columns c;
    LF_TRY(columns_build(&c, closed, err));
#pragma omp parallel for schedule(static)
    for (long i = 0; i < n; i++)
        inside[i] = winding(&c, point[i]) != 0;
    free(c.start);
    free(c.face);
    return LF_OK;
}
