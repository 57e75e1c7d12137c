/* mean_shape.c: see mean_shape.h. */
#include <math.h>

#include "eval/mean_shape.h"

enum { N = LF_MEAN_NODES, NODES = N * N * N, LEVELS = 19 };

const char *lf_mean_shape_text(void)
{
    return "mean of up to 64 shapes of the training split: inside is what more than so many of "
           "them "
           "contain, the share with the largest IoU over them; it sees no view, stands in the "
           "object's frame, and is scored as the prediction is";
}

static void set_nodes(double (*node)[3])
{
    for (long i = 0; i < NODES; i++) {
        const long at[3] = {i % N, i / N % N, i / N / N};
        for (int k = 0; k < 3; k++)
            node[i][k] = (double)at[k] / (N - 1) - 0.5;
    }
}

static double iou_of(const uint8_t *inside, const float *share, double level)
{
    long both = 0, either = 0;
    for (long i = 0; i < NODES; i++) {
        const bool in = share[i] > level;
        both += in && inside[i];
        either += in || inside[i];
    }
    return either ? (double)both / (double)either : 1;
}

/* inside[shapes][NODES] of shapes evenly over the list. */
static lf_status look(const lf_shapes *shapes, long used, uint8_t *inside, lf_error *err)
{
    double(*node)[3] = malloc(NODES * sizeof *node), *sdf = malloc(NODES * sizeof *sdf);
    LF_REQUIRE(node && sdf, "out of memory for the nodes of the mean shape");
    set_nodes(node);
    lf_status status = LF_OK;
    for (long k = 0; k < used && status == LF_OK; k++) {
        lf_shape shape;
        status = lf_shapes_load(shapes, k * lf_shapes_count(shapes) / used, &shape, err);
        if (status != LF_OK)
            break;
        lf_sdf_eval(shape.sdf, NODES, (const double(*)[3])node, sdf, NULL);
        for (long i = 0; i < NODES; i++)
            inside[k * NODES + i] = sdf[i] < 0;
        lf_shape_release(&shape);
    }
    free(sdf);
    free(node);
    return status;
}

/* Near 0.05 number, and no share of a node: neighbours of equal shares are not on the level. */
static double level_at(int number, long shapes)
{
    return (floor(0.05 * number * (double)shapes) + 0.5) / (double)shapes;
}

static double best_level(const lf_mean_shape *mean, const uint8_t *inside)
{
    double best = -1, level = 0;
    for (int l = 1; l <= LEVELS; l++) {
        double iou = 0;
        for (long k = 0; k < mean->shapes; k++)
            iou += iou_of(inside + k * NODES, mean->share, level_at(l, mean->shapes));
        if (iou > best) {
            best = iou;
            level = level_at(l, mean->shapes);
        }
    }
    return level;
}

lf_status lf_mean_shape_make(const lf_shapes *shapes, lf_mean_shape *out, lf_error *err)
{
    const long count = lf_shapes_count(shapes),
               used = count < LF_MEAN_SHAPES ? count : LF_MEAN_SHAPES;
    LF_REQUIRE(used > 0, "mean shape of no shapes");
    uint8_t *inside = malloc((size_t)used * NODES);
    *out = (lf_mean_shape){used, 0, calloc(NODES, sizeof *out->share)};
    LF_REQUIRE(inside && out->share, "out of memory for the mean of %ld shapes", used);
    const lf_status status = look(shapes, used, inside, err);
    if (status == LF_OK) {
        for (long i = 0; i < NODES; i++) {
            long in = 0;
            for (long k = 0; k < used; k++)
                in += inside[k * NODES + i];
            out->share[i] = (float)((double)in / (double)used);
        }
        out->level = best_level(out, inside);
    } else {
        lf_mean_shape_free(out);
    }
    free(inside);
    return status;
}

void lf_mean_shape_free(lf_mean_shape *mean)
{
    free(mean->share);
    *mean = (lf_mean_shape){0};
}

static double share_at(const lf_mean_shape *mean, const double p[3])
{
    long at[3];
    double part[3], sum = 0;
    for (int k = 0; k < 3; k++) {
        const double x = (p[k] + 0.5) * (N - 1);
        if (!(x >= 0 && x <= N - 1))
            return 0;
        at[k] = x < N - 1 ? (long)x : N - 2;
        part[k] = x - (double)at[k];
    }
    for (int corner = 0; corner < 8; corner++) {
        const int i = corner & 1, j = corner >> 1 & 1, k = corner >> 2;
        const double weight =
            (i ? part[0] : 1 - part[0]) * (j ? part[1] : 1 - part[1]) * (k ? part[2] : 1 - part[2]);
        sum += weight * (double)mean->share[((at[2] + k) * N + at[1] + j) * N + at[0] + i];
    }
    return sum;
}

void lf_mean_shape_field(void *mean, long n, const double (*points)[3], float *value,
                         uint8_t *valid)
{
    const lf_mean_shape *m = mean;
#pragma omp parallel for schedule(static, 1024)
    for (long i = 0; i < n; i++) {
        value[i] = (float)(m->level - share_at(m, points[i]));
        valid[i] = 1;
    }
}
