/* ray_samples.c: see ray_samples.h.
 *
 *   strata     1/z_i = 1/near + (i + x_i) / S (1/far - 1/near),  x_i in (0, 1)
 *   refined    cdf over the bins between middles of 1/z, inverted at u
 *   seen       z > 1e-6 far, 0 <= u <= W - 1, 0 <= v <= H - 1; a masked pixel is (0, 0)
 */
#include "models/ray_samples.h"

void lf_strata(long samples, double near, double far, lf_stream *stream, double *depth)
{
    LF_REQUIRE(samples >= 1 && near > 0 && far > near, "strata: %ld samples from %g to %g", samples,
               near, far);
    for (long i = 0; i < samples; i++) {
        const double t = ((double)i + (stream ? lf_uniform(stream) : 0.5)) / (double)samples;
        depth[i] = 1 / ((1 - t) / near + t / far);
    }
}

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* One depth in each of `count` strata of equal size between the inverse depths a and b. */
static void spread(double a, double b, long count, lf_stream *stream, double *out)
{
    for (long i = 0; i < count; i++) {
        const double t = ((double)i + (stream ? lf_uniform(stream) : 0.5)) / (double)count;
        out[i] = 1 / (a + t * (b - a));
    }
}

/* Bins i = 0 .. samples - 3 between the middles i and i + 1, of weight[i + 1]. */
void lf_refine(long samples, const double *depth, const lf_real *weight, long fine,
               lf_stream *stream, double *out)
{
    const long bins = samples - 2;
    double total = 0, below = 0;
    for (long i = 0; i < samples; i++)
        out[i] = depth[i];
    if (bins < 1) {
        spread(1 / depth[0], 1 / depth[samples - 1], fine, stream, out + samples);
        qsort(out, (size_t)(samples + fine), sizeof *out, by_size);
        return;
    }
    for (long i = 0; i < bins; i++)
        total += (double)weight[i + 1] + 1e-5;
    long bin = 0;
    for (long k = 0; k < fine; k++) {
        /* one draw in each of `fine` strata: rising, so that one pass finds all bins */
        const double x = stream ? lf_uniform(stream) : 0.5;
        const double u = total * ((double)k + x) / (double)fine;
        double share = (double)weight[bin + 1] + 1e-5;
        while (bin < bins - 1 && below + share < u) {
            below += share;
            share = (double)weight[++bin + 1] + 1e-5;
        }
        const double t = (u - below) / share, inside = t < 0 ? 0 : t > 1 ? 1 : t;
        const double a = 0.5 * (1 / depth[bin] + 1 / depth[bin + 1]);
        const double b = 0.5 * (1 / depth[bin + 1] + 1 / depth[bin + 2]);
        out[samples + k] = 1 / (a + inside * (b - a));
    }
    qsort(out, (size_t)(samples + fine), sizeof *out, by_size);
}

static bool project(const lf_source *s, const double p[3], double least, double uv[2])
{
    double q[3];
    for (int i = 0; i < 3; i++) {
        const double *row = s->projection + 4 * i;
        q[i] = row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3];
    }
    uv[0] = uv[1] = 0;
    if (!(q[2] > least))
        return false;
    const double u = q[0] / q[2], v = q[1] / q[2];
    if (!(u >= 0 && u <= (double)(s->width - 1) && v >= 0 && v <= (double)(s->height - 1)))
        return false;
    uv[0] = u;
    uv[1] = v;
    return true;
}

lf_seen_samples lf_see_samples(lf_tape *tape, const lf_target_rays *rays, long from, long count,
                               long samples, const double *depth, long views,
                               const lf_source *source)
{
    const size_t n = (size_t)(count * samples), v = (size_t)views;
    lf_seen_samples s = {lf_alloc(tape, n * v * 2 * sizeof *s.uv), lf_alloc(tape, n * v),
                         lf_alloc(tape, n * 3 * sizeof *s.point),
                         lf_alloc(tape, n * sizeof *s.along),
                         lf_alloc(tape, v * 3 * sizeof *s.centres)};
    for (long k = 0; k < views; k++)
        memcpy(s.centres + 3 * k, source[k].centre, sizeof source[k].centre);
    for (long i = 0; i < count * samples; i++) {
        const long ray = from + i / samples;
        s.along[i] = depth[i] * rays->stretch[ray];
        for (int a = 0; a < 3; a++)
            s.point[3 * i + a] =
                rays->origin[3 * ray + a] + s.along[i] * rays->direction[3 * ray + a];
        for (long k = 0; k < views; k++)
            s.seen[i * views + k] =
                project(source + k, s.point + 3 * i, 1e-6 * rays->far, s.uv + 2 * (i * views + k));
    }
    return s;
}

lf_tensor *lf_ray_differences(lf_tape *tape, const lf_target_rays *rays, long from, long count,
                              long samples, const lf_seen_samples *seen, long views)
{
    lf_tensor *y = lf_tensor_new(tape, 4, LF_DIMS(count, samples, views, 4));
    for (long i = 0; i < count * samples * views; i++) {
        const double *p = seen->point + 3 * (i / views), *c = seen->centres + 3 * (i % views);
        const double *d = rays->direction + 3 * (from + i / views / samples);
        const double to[3] = {c[0] - p[0], c[1] - p[1], c[2] - p[2]};
        const double far = hypot(hypot(to[0], to[1]), to[2]);
        double difference[3], square = 0;
        for (int a = 0; a < 3; a++) {
            const double b = far > 0 ? to[a] / far : -d[a];
            difference[a] = -d[a] - b;
            square += difference[a] * difference[a];
        }
        const double size = fmax(sqrt(square), 1e-6);
        for (int a = 0; a < 3; a++)
            y->value[4 * i + a] = (lf_real)(difference[a] / size);
        y->value[4 * i + 3] = (lf_real)(-square / 2); /* <a, b> - 1 of unit vectors */
    }
    return y;
}
