/* nearest.c: nearest neighbours among points by a balanced k-d tree without pointers: the middle
 * point of a range splits it along the range's longest side. */
#include <float.h>
#include <math.h>

#include "eval/metrics.h"

#define LEAF 12 /* points that are searched one by one */

typedef struct tree {
    double (*point)[3];
    uint8_t *axis; /* of the middle point of a range longer than LEAF */
} tree;

static void swap_points(double a[3], double b[3])
{
    for (int i = 0; i < 3; i++) {
        const double t = a[i];
        a[i] = b[i];
        b[i] = t;
    }
}

/* Order [low, high) so that `middle` has its place along the axis (Hoare's selection). */
static void select_middle(double (*point)[3], long low, long high, long middle, int axis)
{
    for (high--; low < high;) {
        const double pivot = point[(low + high) / 2][axis];
        long i = low, j = high;
        while (i <= j) {
            while (point[i][axis] < pivot)
                i++;
            while (point[j][axis] > pivot)
                j--;
            if (i <= j)
                swap_points(point[i++], point[j--]);
        }
        if (middle <= j)
            high = j;
        else if (middle >= i)
            low = i;
        else
            return;
    }
}

static int longest_side(const tree *t, long low, long high)
{
    double size[3] = {0};
    for (int a = 0; a < 3; a++) {
        double least = INFINITY, most = -INFINITY;
        for (long i = low; i < high; i++) {
            least = fmin(least, t->point[i][a]);
            most = fmax(most, t->point[i][a]);
        }
        size[a] = most - least;
    }
    return size[0] >= size[1] && size[0] >= size[2] ? 0 : size[1] >= size[2] ? 1 : 2;
}

static void build(const tree *t, long low, long high)
{
    if (high - low <= LEAF)
        return;
    const long middle = (low + high) / 2;
    const int axis = longest_side(t, low, high);
    select_middle(t->point, low, high, middle, axis);
    t->axis[middle] = (uint8_t)axis;
    build(t, low, middle);
    build(t, middle + 1, high);
}

static double squared(const double a[3], const double b[3])
{
    const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
    return x * x + y * y + z * z;
}

/* A query: its point, the least squared distance so far, and how far outside the box of the
 * range under search the point lies along each axis. */
typedef struct query {
    const double *point;
    double best, outside[3];
} query;

/* Distances are numbers: fmin's care for NaN, a call each, is 2 % of an evaluation. */
static double smaller(double a, double b)
{
    return b < a ? b : a;
}

static void search(const tree *t, long low, long high, query *q)
{
    if (high - low <= LEAF) {
        for (long i = low; i < high; i++)
            q->best = smaller(q->best, squared(q->point, t->point[i]));
        return;
    }
    const long middle = (low + high) / 2;
    const int axis = t->axis[middle];
    const double over = q->point[axis] - t->point[middle][axis], before = q->outside[axis];
    q->best = smaller(q->best, squared(q->point, t->point[middle]));
    search(t, over < 0 ? low : middle + 1, over < 0 ? middle : high, q);
    q->outside[axis] = over; /* the other half begins beyond the middle */
    if (squared(q->outside, (const double[3]){0}) < q->best)
        search(t, over < 0 ? middle + 1 : low, over < 0 ? high : middle, q);
    q->outside[axis] = before;
}

double lf_mean_nearest(long n, const double (*from)[3], long m, const double (*to)[3])
{
    LF_REQUIRE(n >= 1 && m >= 1, "nearest of %ld to %ld points", n, m);
    tree t = {malloc((size_t)m * sizeof *t.point), malloc((size_t)m)};
    double *distance = malloc((size_t)n * sizeof *distance), sum = 0;
    LF_REQUIRE(t.point && t.axis && distance, "nearest of %ld points: out of memory", n + m);
    memcpy(t.point, to, (size_t)m * sizeof *t.point);
    build(&t, 0, m);
#pragma omp parallel for schedule(dynamic, 1024)
    for (long i = 0; i < n; i++) {
        query q = {from[i], DBL_MAX, {0}};
        search(&t, 0, m, &q);
        distance[i] = sqrt(q.best);
    }
    for (long i = 0; i < n; i++)
        sum += distance[i];
    free(t.point);
    free(t.axis);
    free(distance);
    return sum / (double)n;
}
