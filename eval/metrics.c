/* metrics.c: IoU and Chamfer-L1 of two meshes; metrics.h has the definitions. */
#include <math.h>

#include "autograd/random.h"
#include "datasets/surface.h"
#include "eval/metrics.h"

/* Truth samples must not be the prediction's where both meshes are the same. */
#define TRUTH_SEED 0x9E3779B97F4A7C15u

lf_metric_options lf_metric_defaults(void)
{
    return (lf_metric_options){.samples = LF_METRIC_SAMPLES};
}

const char *lf_metric_text(void)
{
    return "unit         the longest edge of the true shape's bounding box is 1; the prediction "
           "is\n"
           "             scored in the same frame, never fitted to the truth\n"
           "IoU          |A and B| / |A or B| over 100000 points, uniform in the cube of edge 1.1\n"
           "             round the centre of the true shape's box; no point in either: 1\n"
           "Chamfer-L1   (mean distance from the prediction to the truth + mean distance from the\n"
           "             truth to the prediction) / 2, Euclidean, not squared, from 100000\n"
           "             area-uniform samples of each to the nearest sample of the other;\n"
           "             reported times 10\n"
           "empty        a prediction without a surface counts with IoU 0 and Chamfer-L1 sqrt(3)\n"
           "             (times 10: 17.32), stays in every mean, and is counted apart\n";
}

const char *lf_occupancy_name(lf_occupancy occupancy)
{
    return occupancy == LF_OCCUPANCY_WINDING ? "winding number" : "signed distance";
}

void lf_metric_points(const double low[3], const double high[3], const lf_metric_options *options,
                      double (*point)[3])
{
    /* Kronecker sequence of the root of x^4 = x + 1: evenly spread in three dimensions */
    const double root = 1.2207440846057596;
    const double step[3] = {1 / root, 1 / (root * root), 1 / (root * root * root)};
    const double edge = fmax(high[0] - low[0], fmax(high[1] - low[1], high[2] - low[2]));
    lf_stream s = lf_stream_at(options->seed, LF_RANDOM_METRIC, 0, options->item);
    const double shift[3] = {lf_uniform(&s), lf_uniform(&s), lf_uniform(&s)};
    for (long i = 0; i < options->samples; i++)
        for (int k = 0; k < 3; k++) {
            double u = shift[k] + (double)i * step[k];
            u -= floor(u);
            point[i][k] = (low[k] + high[k]) / 2 + LF_METRIC_CUBE * edge * (u - 0.5);
        }
}

double lf_iou(long n, const uint8_t *a, const uint8_t *b)
{
    long both = 0, either = 0;
    for (long i = 0; i < n; i++) {
        both += a[i] && b[i];
        either += a[i] || b[i];
    }
    return either ? (double)both / (double)either : 1;
}

static lf_status sdf_occupancy(const lf_sdf *sdf, long n, const double (*point)[3], uint8_t *inside,
                               lf_error *err)
{
    double *value = malloc((size_t)n * sizeof *value);
    if (!value)
        return lf_fail(err, LF_FAILED, "occupancy of %ld points: not enough memory", n);
    lf_sdf_eval(sdf, n, point, value, NULL);
    for (long i = 0; i < n; i++)
        inside[i] = value[i] < 0;
    free(value);
    return LF_OK;
}

/* Inside flags by `given` if there is one, else by winding number if the mesh is closed, else by an
 * lf_sdf of its own; *how says which. */
static lf_status occupancy(const lf_mesh *mesh, const lf_sdf *given, long n,
                           const double (*point)[3], uint8_t *inside, lf_occupancy *how,
                           lf_error *err)
{
    *how = LF_OCCUPANCY_SDF;
    if (given)
        return sdf_occupancy(given, n, point, inside, err);
    lf_mesh_report report = {0};
    lf_mesh_closed_check(mesh, &report);
    if (report.closed) {
        *how = LF_OCCUPANCY_WINDING;
        return lf_winding_occupancy(mesh, n, point, inside, err);
    }
    const lf_sdf_options options = lf_sdf_defaults();
    lf_sdf *sdf = NULL;
    LF_TRY(lf_sdf_open(mesh, &options, &sdf, err));
    const lf_status status = sdf_occupancy(sdf, n, point, inside, err);
    lf_sdf_close(sdf);
    return status;
}

static lf_status check_options(const lf_metric_options *o, lf_error *err)
{
    if (o->samples < 1 || o->samples > LF_METRIC_SAMPLES_MAX)
        return lf_fail(err, LF_BAD_INPUT, "metrics: %ld samples, must be 1 to %d", o->samples,
                       LF_METRIC_SAMPLES_MAX);
    return LF_OK;
}

/* What one comparison works with; everything is freed by score_free. */
typedef struct work {
    const lf_mesh *predicted, *truth;
    const lf_sdf *truth_sdf;
    const lf_metric_options *options;
    double low[3], high[3];  /* box of the truth */
    double (*a)[3], (*b)[3]; /* [samples]: points of IoU, then samples of prediction and truth */
    uint8_t *inside_a, *inside_b;
} work;

static lf_status score_iou(work *w, lf_score *s, lf_error *err)
{
    const long n = w->options->samples;
    const double(*point)[3] = (const double(*)[3])w->a;
    lf_metric_points(w->low, w->high, w->options, w->a);
    LF_TRY(occupancy(w->truth, w->truth_sdf, n, point, w->inside_b, &s->occupancy_truth, err));
    for (long i = 0; i < n; i++)
        s->inside_truth += w->inside_b[i];
    if (s->empty)
        return LF_OK;
    LF_TRY(occupancy(w->predicted, NULL, n, point, w->inside_a, &s->occupancy_predicted, err));
    for (long i = 0; i < n; i++)
        s->inside_predicted += w->inside_a[i];
    s->iou = lf_iou(n, w->inside_a, w->inside_b);
    return LF_OK;
}

/* Mean distance of the samples to the surface itself. */
static lf_status mean_to_surface(const lf_mesh *mesh, long n, const double (*point)[3], double *out,
                                 lf_error *err)
{
    lf_surface *surface = NULL;
    double *distance = malloc((size_t)n * sizeof *distance), sum = 0;
    if (!distance)
        return lf_fail(err, LF_FAILED, "distances of %ld points: not enough memory", n);
    const lf_status status = lf_surface_open(mesh, &surface, err);
    if (status == LF_OK) {
        lf_surface_distance_all(surface, n, point, distance);
        for (long i = 0; i < n; i++)
            sum += distance[i];
        *out = sum / (double)n;
    }
    lf_surface_close(surface);
    free(distance);
    return status;
}

static lf_status score_chamfer(work *w, lf_score *s, lf_error *err)
{
    const lf_metric_options *o = w->options;
    const long n = o->samples;
    const double(*a)[3] = (const double(*)[3])w->a, (*b)[3] = (const double(*)[3])w->b;
    double accuracy = 0, completeness = 0;
    LF_TRY(lf_mesh_sample_surface(w->predicted, n, o->seed, o->item, w->a, NULL, err));
    LF_TRY(lf_mesh_sample_surface(w->truth, n, o->seed ^ TRUTH_SEED, o->item, w->b, NULL, err));
    if (o->exact) {
        LF_TRY(mean_to_surface(w->truth, n, a, &accuracy, err));
        LF_TRY(mean_to_surface(w->predicted, n, b, &completeness, err));
    } else {
        accuracy = lf_mean_nearest(n, a, n, b);
        completeness = lf_mean_nearest(n, b, n, a);
    }
    s->accuracy = accuracy / s->edge;
    s->completeness = completeness / s->edge;
    s->chamfer_l1 = (s->accuracy + s->completeness) / 2;
    return LF_OK;
}

static lf_status score(work *w, lf_score *s, lf_error *err)
{
    const size_t n = (size_t)w->options->samples;
    w->a = malloc(n * sizeof *w->a);
    w->b = malloc(n * sizeof *w->b);
    w->inside_a = malloc(n);
    w->inside_b = malloc(n);
    if (!w->a || !w->b || !w->inside_a || !w->inside_b)
        return lf_fail(err, LF_FAILED, "metrics with %zu samples: not enough memory", n);
    LF_TRY(score_iou(w, s, err));
    return s->empty ? LF_OK : score_chamfer(w, s, err);
}

lf_status lf_score_meshes(const lf_mesh *predicted, const lf_mesh *truth, const lf_sdf *truth_sdf,
                          const lf_metric_options *options, lf_score *out, lf_error *err)
{
    LF_TRY(check_options(options, err));
    work w = {.predicted = predicted, .truth = truth, .truth_sdf = truth_sdf, .options = options};
    lf_mesh_bounds(truth, w.low, w.high);
    const double edge =
        fmax(w.high[0] - w.low[0], fmax(w.high[1] - w.low[1], w.high[2] - w.low[2]));
    if (truth->faces < 1 || !(edge > 0) || !(lf_mesh_area(truth) > 0))
        return lf_fail(err, LF_BAD_INPUT,
                       "metrics: the true mesh (%ld faces, longest box edge %g) has no surface",
                       truth->faces, edge);
    lf_score s = {.edge = edge,
                  .empty = predicted->faces < 1 || !(lf_mesh_area(predicted) > 0),
                  .accuracy = LF_CHAMFER_EMPTY,
                  .completeness = LF_CHAMFER_EMPTY,
                  .chamfer_l1 = LF_CHAMFER_EMPTY};
    const lf_status status = score(&w, &s, err);
    free(w.a);
    free(w.b);
    free(w.inside_a);
    free(w.inside_b);
    if (status == LF_OK)
        *out = s;
    return status;
}
