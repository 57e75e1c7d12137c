/* op_sample_views.c: what source views show at projected points: colours and features
 *                                                                               [method.md 5b.1]
 *   y[q, v] = [ bilinear rgb of the picture at (u, w) / 255 | bilinear features of the map there ]
 *   map texel of (u, w): (u, w) / stride, cut to the map;  0 where the mask is 0
 *   backward    dmap[t][c] += w_t dy[q, v, 3 + c];  pictures have no gradient
 *
 * Shapes     maps: one flat array, of view v [h_v, w_v, all channels] from offset_v on, of which
 *            `channels` from `first` are read; uv [Q, V, 2], mask [Q, V]; y [Q, V, 3 + channels].
 * Keeps      views, uv and mask (the caller's, until backward).
 * Threads    the calling one.
 */
#include "autograd/ops.h"

typedef struct sampling {
    const lf_view_map *view;
    long points, views, first, channels;
    const double *uv;
    const lf_real *mask;
} sampling;

/* The four texels around a place and their weights. */
typedef struct texels {
    long at[4]; /* texel numbers */
    lf_real weight[4];
} texels;

/* Cell and fraction on an axis of n texels, the place cut to [0, n - 1]. */
static long cell(double at, long n, lf_real *fraction)
{
    at = at < 0 ? 0 : at > (double)(n - 1) ? (double)(n - 1) : at;
    long i = (long)at;
    i = i > n - 2 ? (n > 1 ? n - 2 : 0) : i;
    *fraction = (lf_real)(at - (double)i);
    return i;
}

static texels locate(double u, double w, long height, long width)
{
    lf_real fx, fy;
    const long x = cell(u, width, &fx), y = cell(w, height, &fy), at = y * width + x;
    const long right = width > 1, down = height > 1 ? width : 0;
    return (texels){{at, at + right, at + down, at + down + right},
                    {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy}};
}

static texels locate_map(const lf_view_map *v, const double *uv)
{
    return locate(uv[0] / v->stride, uv[1] / v->stride, v->map_height, v->map_width);
}

static void sample_colour(const lf_view_map *v, const double *uv, lf_real *restrict y)
{
    const texels t = locate(uv[0], uv[1], v->height, v->width);
    for (int a = 0; a < 3; a++) {
        lf_real sum = 0;
        for (int k = 0; k < 4; k++)
            sum += t.weight[k] * (lf_real)v->rgb[3 * t.at[k] + a];
        y[a] = sum * (lf_real)(1.0 / 255);
    }
}

static void sample_features(const sampling *s, const lf_tensor *maps, const lf_view_map *v,
                            const double *uv, lf_real *restrict y)
{
    const texels t = locate_map(v, uv);
    const lf_real *base = maps->value + v->offset + s->first, *texel[4];
    for (int k = 0; k < 4; k++)
        texel[k] = base + t.at[k] * v->map_channels;
    for (long i = 0; i < s->channels; i++)
        y[i] = t.weight[0] * texel[0][i] + t.weight[1] * texel[1][i] + t.weight[2] * texel[2][i] +
               t.weight[3] * texel[3][i];
}

static void backward(const lf_node *node)
{
    const sampling *s = node->saved;
    const lf_tensor *maps = node->in[0], *y = node->out[0];
    for (long i = 0; i < s->points * s->views; i++) {
        const lf_view_map *v = s->view + i % s->views;
        if (!(s->mask[i] > 0))
            continue;
        const texels t = locate_map(v, s->uv + 2 * i);
        const lf_real *dy = y->grad + i * lf_cols(y) + 3;
        lf_real *base = maps->grad + v->offset + s->first;
        for (int k = 0; k < 4; k++) {
            lf_real *restrict g = base + t.at[k] * v->map_channels;
            for (long c = 0; c < s->channels; c++)
                g[c] += t.weight[k] * dy[c];
        }
    }
}

lf_tensor *lf_sample_views(lf_tape *tape, lf_tensor *maps, long views, const lf_view_map *view,
                           long first, long channels, long points, const double *uv,
                           const lf_real *mask)
{
    for (long v = 0; v < views; v++)
        LF_REQUIRE(
            first >= 0 && channels >= 0 && first + channels <= view[v].map_channels &&
                view[v].offset + view[v].map_height * view[v].map_width * view[v].map_channels <=
                    maps->size,
            "lf_sample_views: channels %ld to %ld of view %ld, which has %ld of %ld x %ld", first,
            first + channels, v, view[v].map_channels, view[v].map_height, view[v].map_width);
    sampling *s = lf_alloc(tape, sizeof *s);
    *s = (sampling){view, points, views, first, channels, uv, mask};
    lf_tensor *y = lf_tensor_new(tape, 3, LF_DIMS(points, views, 3 + channels));
    const long cols = lf_cols(y);
    for (long i = 0; i < points * views; i++) {
        lf_real *row = y->value + i * cols;
        if (!(mask[i] > 0)) {
            memset(row, 0, (size_t)cols * sizeof *row);
            continue;
        }
        sample_colour(view + i % views, uv + 2 * i, row);
        sample_features(s, maps, view + i % views, uv + 2 * i, row + 3);
    }
    if (lf_profiled(tape)) {
        const double seen = lf_present(points * views, mask);
        lf_products(tape, 4 * seen * (double)cols, maps->wants ? 4 * seen * (double)channels : 0);
    }
    lf_record(tape, "sample_views", backward, s, LF_IN(maps), LF_OUT(y));
    return y;
}
