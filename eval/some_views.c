/* some_views.c: see some_views.h. */
#include "eval/some_views.h"

enum { V = LF_CUBE_VIEWS };

void lf_some_views(int count, int view[LF_CUBE_VIEWS])
{
    /* bit v: view v; corner v has the signs of its three bits */
    static const uint8_t chosen[V + 1] = {0, 0x01, 0x81, 0x29, 0x69, 0xe9, 0xf9, 0xfb, 0xff};
    LF_REQUIRE(count >= 1 && count <= V, "%d of %d views", count, (int)V);
    int n = 0;
    for (int v = 0; v < V; v++)
        if (chosen[count] >> v & 1)
            view[n++] = v;
}

/* Rows of `size` bytes, V a point, become `count` a point; none is written before it is read. */
static void pack(void *rows, size_t size, long points, int count, const int *view)
{
    char *bytes = rows;
    for (long q = 0; q < points; q++)
        for (int i = 0; i < count; i++)
            memmove(bytes + (size_t)(q * count + i) * size,
                    bytes + (size_t)(q * V + view[i]) * size, size);
}

void lf_keep_views(lf_projection *p, long points, int count, const int *view)
{
    pack(p->uv, 2 * sizeof *p->uv, points, count, view);
    pack(p->direction, 3 * sizeof *p->direction, points, count, view);
    pack(p->distance, sizeof *p->distance, points, count, view);
    pack(p->mask, sizeof *p->mask, points, count, view);
    pack(p->bearing, 3 * sizeof *p->bearing, points, count, view);
}
