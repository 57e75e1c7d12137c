/* mc_table.c: the cases of marching cubes from a rule for faces; mc_table.h gives the rule. */
#include <string.h>

#include "autograd/status.h"
#include "eval/mc_table.h"

typedef struct cell {
    uint8_t face[6][4];       /* corners of a face, counter-clockwise seen from outside */
    uint8_t between[8][8];    /* edge between two neighbouring corners */
    uint8_t coplanar[12][12]; /* do two edges lie on a common face? */
} cell;

static void build_edges(lf_mc_table *table, cell *c)
{
    int edge = 0;
    for (int axis = 0; axis < 3; axis++)
        for (int corner = 0; corner < 8; corner++) {
            if (corner >> axis & 1)
                continue;
            const int other = corner | 1 << axis;
            table->corner[edge][0] = (uint8_t)corner;
            table->corner[edge][1] = (uint8_t)other;
            c->between[corner][other] = c->between[other][corner] = (uint8_t)edge++;
        }
}

static void build_faces(cell *c)
{
    for (int f = 0; f < 6; f++) {
        const int axis = f / 2, side = f & 1, u = 1 << (axis + 1) % 3, v = 1 << (axis + 2) % 3;
        const int base = side << axis, ring[4] = {base, base | u, base | u | v, base | v};
        for (int i = 0; i < 4; i++)
            c->face[f][i] = (uint8_t)ring[side ? i : 3 - i];
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++)
                c->coplanar[c->between[c->face[f][i]][c->face[f][(i + 1) % 4]]]
                           [c->between[c->face[f][j]][c->face[f][(j + 1) % 4]]] = 1;
    }
}

/* The edge that follows each crossed edge on its loop; 12 where an edge is not crossed. */
static void link_segments(const cell *c, int inside, uint8_t next[12])
{
    memset(next, 12, 12);
    for (int f = 0; f < 6; f++)
        for (int i = 0; i < 4; i++) {
            const uint8_t *ring = c->face[f];
            if (!(inside >> ring[i] & 1) || (inside >> ring[(i + 1) & 3] & 1))
                continue;
            int start = i; /* first corner of the run of inside corners that ends at i */
            while (inside >> ring[(start + 3) & 3] & 1)
                start = (start + 3) & 3;
            next[c->between[ring[(start + 3) & 3]][ring[start]]] =
                c->between[ring[i]][ring[(i + 1) & 3]];
        }
}

/* Cut loop[0..n-1] into triangles appended at out[3 * *count]; 0 if every way needs a diagonal
 * that lies in a face. The side loop[0], loop[n-1] is given. */
static int cut(const cell *c, int n, const uint8_t *loop, uint8_t *out, int *count)
{
    if (n < 3)
        return 1;
    for (int k = 1; k < n - 1; k++) {
        const int before = *count;
        if ((k > 1 && c->coplanar[loop[0]][loop[k]]) ||
            (k < n - 2 && c->coplanar[loop[k]][loop[n - 1]]))
            continue;
        LF_REQUIRE(before < LF_MC_TRIANGLES, "marching cubes: a case has too many triangles");
        const uint8_t triangle[3] = {loop[0], loop[k], loop[n - 1]};
        memcpy(out + 3 * (*count)++, triangle, 3);
        if (cut(c, k + 1, loop, out, count) && cut(c, n - k, loop + k, out, count))
            return 1;
        *count = before;
    }
    return 0;
}

static void build_case(lf_mc_table *table, const cell *c, int inside)
{
    uint8_t next[12], loop[12];
    int count = 0;
    link_segments(c, inside, next);
    for (uint8_t first = 0; first < 12; first++) {
        int n = 0;
        for (uint8_t edge = first; next[edge] < 12;) {
            const uint8_t following = next[edge];
            loop[n++] = edge;
            next[edge] = 12;
            edge = following;
        }
        LF_REQUIRE(cut(c, n, loop, table->edge[inside], &count),
                   "marching cubes: case %d needs a diagonal in a face", inside);
    }
    table->triangles[inside] = (uint8_t)count;
}

void lf_mc_table_build(lf_mc_table *table)
{
    cell c;
    memset(&c, 0, sizeof c);
    memset(table, 0, sizeof *table);
    build_edges(table, &c);
    build_faces(&c);
    for (int inside = 0; inside < 256; inside++)
        build_case(table, &c, inside);
}
