/* op_sample_maps.c: bilinear samples of feature maps at projected points           [method.md 5a.3]
 *
 *   y[q, v, c] = sum over 4 texels t of w_t map[first_q + v][t][c],  w_t the bilinear weights at
 *                (u (w_m - 1) / (W - 1), v (h_m - 1) / (H - 1));  0 where the mask is 0
 *   backward    dmap[n][t][c] += w_t dy[q, v, c]
 *
 * Shapes     maps[m] [N, h_m, w_m, C_m], uv [Q, V, 2], mask [Q, V], first [Q]; y [Q, V, sum C_m].
 * Keeps      uv, mask and first (the caller's, until backward).
 * Threads    forward over points; backward over images, each image's points in order, so the sum
 *            has the same bits for any number of threads.
 */
#include "autograd/ops.h"

typedef struct sampling {
    long height, width, points, views;
    const double *uv;
    const lf_real *mask;
    const long *first;
} sampling;

typedef struct texels {
    long offset[4]; /* in numbers, from the start of the image's map */
    lf_real weight[4];
} texels;

/* Cell and fraction of one coordinate on an axis of n texels. */
static long cell(double at, long n, lf_real *fraction)
{
    long i = (long)floor(at);
    i = i < 0 ? 0 : i > n - 2 ? n - 2 : i;
    if (n == 1)
        i = 0;
    *fraction = n == 1 ? 0 : (lf_real)(at - (double)i);
    return i;
}

static texels locate(const sampling *s, const lf_tensor *map, const double *uv)
{
    const long h = map->dim[1], w = map->dim[2], c = map->dim[3];
    lf_real fx, fy;
    const double sx = s->width > 1 ? (double)(w - 1) / (double)(s->width - 1) : 0;
    const double sy = s->height > 1 ? (double)(h - 1) / (double)(s->height - 1) : 0;
    const long x = cell(uv[0] * sx, w, &fx), y = cell(uv[1] * sy, h, &fy);
    const long right = w > 1 ? c : 0, down = h > 1 ? w * c : 0, at = (y * w + x) * c;
    return (texels){{at, at + right, at + down, at + down + right},
                    {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy}};
}

static void sample_point(const sampling *s, const lf_tensor *map, long qv, long image,
                         lf_real *restrict y)
{
    const long c = map->dim[3];
    const texels t = locate(s, map, s->uv + 2 * qv);
    const lf_real *base = map->value + image * map->dim[1] * map->dim[2] * c;
    const lf_real *a = base + t.offset[0], *b = base + t.offset[1];
    const lf_real *d = base + t.offset[2], *e = base + t.offset[3];
    for (long i = 0; i < c; i++)
        y[i] = t.weight[0] * a[i] + t.weight[1] * b[i] + t.weight[2] * d[i] + t.weight[3] * e[i];
}

static void spread_point(const sampling *s, const lf_tensor *map, long qv, long image,
                         const lf_real *restrict dy)
{
    const long c = map->dim[3];
    const texels t = locate(s, map, s->uv + 2 * qv);
    lf_real *base = map->grad + image * map->dim[1] * map->dim[2] * c;
    for (int k = 0; k < 4; k++) {
        lf_real *restrict g = base + t.offset[k];
        for (long i = 0; i < c; i++)
            g[i] += t.weight[k] * dy[i];
    }
}

static void backward_image(const lf_node *node, long image)
{
    const sampling *s = node->saved;
    const lf_tensor *y = node->out[0];
    const long cols = lf_cols(y);
    for (long q = 0; q < s->points; q++) {
        const long v = image - s->first[q], qv = q * s->views + v;
        if (v < 0 || v >= s->views || !(s->mask[qv] > 0))
            continue;
        long at = 0;
        for (int m = 0; m < node->n_in; m++) {
            if (node->in[m]->grad)
                spread_point(s, node->in[m], qv, image, y->grad + qv * cols + at);
            at += node->in[m]->dim[3];
        }
    }
}

static void backward(const lf_node *node)
{
    const long images = node->in[0]->dim[0];
#pragma omp parallel for schedule(static)
    for (long n = 0; n < images; n++)
        backward_image(node, n);
}

static void forward_point(const sampling *s, int count, lf_tensor *const *maps, long q,
                          lf_tensor *y)
{
    const long cols = lf_cols(y);
    for (long v = 0; v < s->views; v++) {
        const long qv = q * s->views + v;
        lf_real *row = y->value + qv * cols;
        if (!(s->mask[qv] > 0)) {
            memset(row, 0, (size_t)cols * sizeof *row);
            continue;
        }
        for (int m = 0; m < count; m++) {
            sample_point(s, maps[m], qv, s->first[q] + v, row);
            row += maps[m]->dim[3];
        }
    }
}

/* Four numbers a channel of every seen entry, forward and back. */
static void count_products(lf_tape *tape, int maps, lf_tensor *const *map, long entries,
                           const lf_real *mask)
{
    double channels = 0, wanted = 0;
    for (int m = 0; m < maps; m++) {
        channels += (double)map[m]->dim[3];
        wanted += map[m]->wants ? (double)map[m]->dim[3] : 0;
    }
    const double seen = lf_present(entries, mask);
    lf_products(tape, 4 * seen * channels, 4 * seen * wanted);
}

lf_tensor *lf_sample_maps(lf_tape *tape, int count, lf_tensor *const *maps, long height, long width,
                          long points, long views, const double *uv, const lf_real *mask,
                          const long *first)
{
    long cols = 0;
    LF_REQUIRE(count >= 1 && count <= LF_MAX_IN, "lf_sample_maps: %d maps", count);
    for (int m = 0; m < count; m++) {
        LF_REQUIRE(maps[m]->rank == 4 && maps[m]->dim[0] == maps[0]->dim[0],
                   "lf_sample_maps: map %d has rank %d and %ld images", m, maps[m]->rank,
                   maps[m]->dim[0]);
        cols += maps[m]->dim[3];
    }
    sampling *s = lf_alloc(tape, sizeof *s);
    *s = (sampling){height, width, points, views, uv, mask, first};
    lf_tensor *y = lf_tensor_new(tape, 3, LF_DIMS(points, views, cols));
#pragma omp parallel for schedule(static)
    for (long q = 0; q < points; q++)
        forward_point(s, count, maps, q, y);
    if (lf_profiled(tape))
        count_products(tape, count, maps, points * views, mask);
    lf_record(tape, "sample_maps", backward, s, count, maps, LF_OUT(y));
    return y;
}
