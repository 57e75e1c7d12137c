/* projection.c: see projection.h. */
#include "datasets/projection.h"

enum { V = LF_CUBE_VIEWS, BLOCK = 64 };

static const double nearest = 1e-3; /* smallest visible depth, in box diagonals */

static void *room(size_t count, size_t size)
{
    void *p = calloc(count ? count : 1, size);
    LF_REQUIRE(p, "out of memory for %zu times %zu bytes", count, size);
    return p;
}

lf_projection lf_projection_create(long points)
{
    const size_t n = (size_t)(points * V);
    return (lf_projection){room(2 * n, sizeof(double)),
                           room(3 * n, sizeof(double)),
                           room(n, sizeof(double)),
                           room(n, 1),
                           room((size_t)points, sizeof(long)),
                           room(3 * (size_t)points, sizeof(double)),
                           room(3 * n, sizeof(double))};
}

void lf_projection_free(lf_projection *p)
{
    free(p->uv);
    free(p->direction);
    free(p->distance);
    free(p->mask);
    free(p->first);
    free(p->position);
    free(p->bearing);
    *p = (lf_projection){0};
}

static void fill_block(lf_projection *p, long at, long count, const double (*point)[3],
                       const lf_shape_views *views, long first)
{
    double turned[BLOCK][3];
    for (long i = 0; i < count; i++) {
        lf_rotation_apply(views->object, point[i], turned[i]);
        p->first[at + i] = first;
        memcpy(p->position + 3 * (at + i), point[i], sizeof point[i]);
    }
    lf_project_points(V, views->camera, count, (const double(*)[3])turned, nearest,
                      p->uv + at * V * 2, p->direction + at * V * 3, p->distance + at * V,
                      p->mask + at * V);
    for (long i = at * V; i < (at + count) * V; i++)
        lf_rotation_apply_transposed(views->object, p->direction + 3 * i, p->bearing + 3 * i);
}

void lf_projection_fill(lf_projection *p, long at, long count, const double (*point)[3],
                        const lf_shape_views *views, long first)
{
    const long blocks = (count + BLOCK - 1) / BLOCK;
#pragma omp parallel for schedule(static)
    for (long b = 0; b < blocks; b++) {
        const long from = b * BLOCK, left = count - from;
        fill_block(p, at + from, left < BLOCK ? left : BLOCK, point + from, views, first);
    }
}
