/* op_field_norm.c: normalise fields, then affine map, residual and ReLU in the same pass.
 *                                                       [ops_image.h; method.md 4.6, 4.7, 5a.1]
 *   forward    u = (x - mean_f) / sqrt(var_f + epsilon),  y = act(gamma_f u + beta_f + r)
 *   backward   g = dy where the activation passes,  dr += g,  dbeta_f += sum g,
 *              dgamma_f += sum g u,
 *              dx += gamma_f / sqrt(var_f + epsilon) (g - mean(g) - u mean(g u))
 *              where the means run over what the statistics ran over; they are absent if the
 *              statistics are constants (RUNNING).
 *
 * Shapes     x, r, y: [N, H, W, C]; a field is `group` adjacent channels, F = C / group.
 * Keeps      x, r, and mean and 1 / sqrt(var + epsilon) a channel (and an image, for INSTANCE).
 * Order      every image sums by itself: runs of rows in lf_real, runs joined in double; images
 *            join in double in their order. So threads change nothing, and a constant channel has
 *            variance 0 up to rounding of its mean.
 * Again      y can be dropped: one pass makes it from x, r and the statistics.
 * Cost       three passes over x forward (two of them on an image that is still in the cache), two
 *            backward.
 */
#include "autograd/ops_image.h"

enum { RUN = 4096 }; /* numbers summed in lf_real before they join in double; C is at most this */

typedef struct kept {
    lf_field_norm_options o;
    long images, pixels, channels, fields,
        statistics;          /* statistics: images, or 1 for all of them */
    lf_real *mean, *inverse; /* [statistics, channels] */
} kept;

/* Statistics of image n start here, in mean and inverse. */
static long part(const kept *k, long n)
{
    return k->statistics == 1 ? 0 : n * k->channels;
}

static long rows_of_run(const kept *k)
{
    const long rows = RUN / k->channels;
    return rows < 64 ? rows : 64;
}

static void join(long n, lf_real *run, double *sum)
{
    for (long c = 0; c < n; c++) {
        sum[c] += (double)run[c];
        run[c] = 0;
    }
}

/* sum[c] += sum of `rows` rows of x[c] */
static void sum_run(long rows, long channels, const lf_real *restrict x, lf_real *restrict run)
{
    long r = 0;
    for (; r + 4 <= rows; r += 4, x += 4 * channels)
        for (long c = 0; c < channels; c++)
            run[c] += (x[c] + x[c + channels]) + (x[c + 2 * channels] + x[c + 3 * channels]);
    for (; r < rows; r++, x += channels)
        for (long c = 0; c < channels; c++)
            run[c] += x[c];
}

/* run[c] += sum of rows of (x[c] - mean[c])^2 */
static void square_run(long rows, long channels, const lf_real *restrict x,
                       const lf_real *restrict mean, lf_real *restrict run)
{
    long r = 0;
    for (; r + 2 <= rows; r += 2, x += 2 * channels)
        for (long c = 0; c < channels; c++) {
            const lf_real a = x[c] - mean[c], b = x[c + channels] - mean[c];
            run[c] += a * a + b * b;
        }
    for (; r < rows; r++, x += channels)
        for (long c = 0; c < channels; c++)
            run[c] += (x[c] - mean[c]) * (x[c] - mean[c]);
}

/* Fold channels into fields: out[f] = scale * sum of its channels. */
static void fold(const kept *k, const double *channel, double scale, double *out)
{
    for (long f = 0; f < k->fields; f++) {
        out[f] = 0;
        for (long a = 0; a < k->o.group; a++)
            out[f] += channel[f * k->o.group + a];
        out[f] *= scale;
    }
}

/* Mean and variance of one image's fields, two passes; sum[channels] is scratch. */
static void image_statistics(const kept *k, const lf_real *x, double *sum, double *mean,
                             double *variance)
{
    lf_real run[RUN], centre[RUN];
    const long channels = k->channels, step = rows_of_run(k);
    const double share = 1.0 / (double)(k->pixels * k->o.group);
    memset(run, 0, (size_t)channels * sizeof *run);
    memset(sum, 0, (size_t)channels * sizeof *sum);
    for (long r = 0; r < k->pixels; r += step) {
        sum_run(r + step < k->pixels ? step : k->pixels - r, channels, x + r * channels, run);
        join(channels, run, sum);
    }
    fold(k, sum, share, mean);
    for (long c = 0; c < channels; c++)
        centre[c] = (lf_real)mean[c / k->o.group];
    memset(sum, 0, (size_t)channels * sizeof *sum);
    for (long r = 0; r < k->pixels; r += step) {
        square_run(r + step < k->pixels ? step : k->pixels - r, channels, x + r * channels, centre,
                   run);
        join(channels, run, sum);
    }
    fold(k, sum, share, variance);
}

/* Spread a field's mean and variance over its channels, ready for use. */
static void spread(const kept *k, long at, long f, double mean, double variance)
{
    for (long a = 0; a < k->o.group; a++) {
        k->mean[at + f * k->o.group + a] = (lf_real)mean;
        k->inverse[at + f * k->o.group + a] = (lf_real)(1 / sqrt(variance + k->o.epsilon));
    }
}

/* Join the images' mean[N, F] and variance[N, F] to those of the whole batch. */
static void batch_statistics(const kept *k, const double *mean, const double *variance)
{
    const lf_field_norm_options *o = &k->o;
    for (long f = 0; f < k->fields; f++) {
        double m = 0, v = 0;
        for (long n = 0; n < k->images; n++)
            m += mean[n * k->fields + f] / (double)k->images;
        for (long n = 0; n < k->images; n++) {
            const double d = mean[n * k->fields + f] - m;
            v += (variance[n * k->fields + f] + d * d) / (double)k->images;
        }
        spread(k, 0, f, m, v);
        if (o->running_mean) {
            o->running_mean[f] =
                (lf_real)((1 - o->momentum) * (double)o->running_mean[f] + o->momentum * m);
            o->running_var[f] =
                (lf_real)((1 - o->momentum) * (double)o->running_var[f] + o->momentum * v);
        }
    }
}

static void find_statistics(lf_tape *tape, kept *k, const lf_real *x)
{
    k->statistics = k->o.mode == LF_NORM_INSTANCE ? k->images : 1;
    k->mean = lf_alloc_reals(tape, k->statistics * k->channels);
    k->inverse = lf_alloc_reals(tape, k->statistics * k->channels);
    if (k->o.mode == LF_NORM_RUNNING) {
        for (long f = 0; f < k->fields; f++)
            spread(k, 0, f, (double)k->o.running_mean[f], (double)k->o.running_var[f]);
        return;
    }
    const lf_mark mark = lf_tape_mark(tape);
    const size_t bytes = (size_t)(k->images * k->channels) * sizeof(double);
    double *sum = lf_alloc(tape, bytes), *mean = lf_alloc(tape, bytes);
    double *variance = lf_alloc(tape, bytes);
#pragma omp parallel for schedule(static)
    for (long n = 0; n < k->images; n++)
        image_statistics(k, x + n * k->pixels * k->channels, sum + n * k->channels,
                         mean + n * k->fields, variance + n * k->fields);
    if (k->o.mode == LF_NORM_BATCH)
        batch_statistics(k, mean, variance);
    else
        for (long n = 0; n < k->images; n++)
            for (long f = 0; f < k->fields; f++)
                spread(k, part(k, n), f, mean[n * k->fields + f], variance[n * k->fields + f]);
    lf_tape_release(tape, mark);
}

/* y = act((x - mean) scale + shift + r) on `rows` rows; mean, scale, shift a channel, r or NULL. */
static void apply(long rows, long channels, bool relu, const lf_real *restrict x,
                  const lf_real *restrict mean, const lf_real *restrict scale,
                  const lf_real *restrict shift, const lf_real *restrict r, lf_real *restrict y)
{
    const lf_real lowest = relu ? 0 : -INFINITY;
    for (long i = 0; i < rows; i++, x += channels, y += channels, r += r ? channels : 0)
        if (r)
            for (long c = 0; c < channels; c++) {
                const lf_real u = (x[c] - mean[c]) * scale[c] + shift[c] + r[c];
                y[c] = u < lowest ? lowest : u;
            }
        else
            for (long c = 0; c < channels; c++) {
                const lf_real u = (x[c] - mean[c]) * scale[c] + shift[c];
                y[c] = u < lowest ? lowest : u;
            }
}

static void forward_image(const kept *k, long n, const lf_real *x, const lf_real *gamma,
                          const lf_real *beta, const lf_real *r, lf_real *y)
{
    lf_real scale[RUN], shift[RUN];
    const long at = n * k->pixels * k->channels;
    for (long c = 0; c < k->channels; c++) {
        scale[c] = gamma[c / k->o.group] * k->inverse[part(k, n) + c];
        shift[c] = beta[c / k->o.group];
    }
    apply(k->pixels, k->channels, k->o.relu, x + at, k->mean + part(k, n), scale, shift,
          r ? r + at : NULL, y + at);
}

static void forward_images(const kept *k, const lf_tensor *x, const lf_tensor *gamma,
                           const lf_tensor *beta, const lf_tensor *r, lf_tensor *y)
{
#pragma omp parallel for schedule(static)
    for (long n = 0; n < k->images; n++)
        forward_image(k, n, x->value, gamma->value, beta->value, r ? r->value : NULL, y->value);
}

static void again(const lf_node *node)
{
    forward_images(node->saved, node->in[0], node->in[1], node->in[2], node->in[3], node->out[0]);
}

/* ---- backward -------------------------------------------------------------------------------- */

/* g = dy where y > 0, on n numbers; without ReLU g is dy. */
static const lf_real *passed(bool relu, long n, const lf_real *restrict dy,
                             const lf_real *restrict y, lf_real *restrict g)
{
    if (!relu)
        return dy;
    for (long i = 0; i < n; i++)
        g[i] = y[i] > 0 ? dy[i] : 0;
    return g;
}

/* by[c] += sum of rows of g, bx[c] += sum of rows of g (x - mean) */
static void product_run(long rows, long channels, const lf_real *restrict g,
                        const lf_real *restrict x, const lf_real *restrict mean,
                        lf_real *restrict by, lf_real *restrict bx)
{
    long r = 0;
    for (; r + 2 <= rows; r += 2, x += 2 * channels, g += 2 * channels)
        for (long c = 0; c < channels; c++) {
            by[c] += g[c] + g[c + channels];
            bx[c] += g[c] * (x[c] - mean[c]) + g[c + channels] * (x[c + channels] - mean[c]);
        }
    for (; r < rows; r++, x += channels, g += channels)
        for (long c = 0; c < channels; c++) {
            by[c] += g[c];
            bx[c] += g[c] * (x[c] - mean[c]);
        }
}

/* sums[0, f] = sum of g, sums[1, f] = sum of g u of image n; `channel` [2, channels] is scratch;
 * dr += g on the way. */
static void image_sums(const lf_node *node, long n, double *channel, double *sums)
{
    const kept *k = node->saved;
    const lf_tensor *x = node->in[0], *r = node->in[3], *y = node->out[0];
    lf_real run[2][RUN], buffer[RUN];
    const long channels = k->channels, step = rows_of_run(k);
    const lf_real *mean = k->mean + part(k, n), *inverse = k->inverse + part(k, n);
    memset(run, 0, sizeof run);
    memset(channel, 0, 2 * (size_t)channels * sizeof *channel);
    for (long row = 0; row < k->pixels; row += step) {
        const long rows = row + step < k->pixels ? step : k->pixels - row;
        const long at = (n * k->pixels + row) * channels;
        const lf_real *g = passed(k->o.relu, rows * channels, y->grad + at, y->value + at, buffer);
        if (r && r->grad)
            for (long i = 0; i < rows * channels; i++)
                r->grad[at + i] += g[i];
        product_run(rows, channels, g, x->value + at, mean, run[0], run[1]);
        join(channels, run[0], channel);
        join(channels, run[1], channel + channels);
    }
    for (long c = 0; c < channels; c++)
        channel[channels + c] *= (double)inverse[c];
    fold(k, channel, 1, sums);
    fold(k, channel + channels, 1, sums + k->fields);
}

/* dbeta and dgamma from the sums[N, 2, F] of all images, in their order. */
static void affine_gradients(const kept *k, const double *sums, lf_real *dgamma, lf_real *dbeta)
{
    for (long f = 0; f < k->fields; f++) {
        double b = 0, g = 0;
        for (long n = 0; n < k->images; n++) {
            b += sums[2 * n * k->fields + f];
            g += sums[(2 * n + 1) * k->fields + f];
        }
        if (dbeta)
            dbeta[f] += (lf_real)b;
        if (dgamma)
            dgamma[f] += (lf_real)g;
    }
}

/* means[statistics, 2, F]: mean(g) and mean(g u) over what the statistics ran over. */
static void field_means(const kept *k, const double *sums, double *means)
{
    const long images = k->images / k->statistics;
    const double share = 1.0 / (double)(images * k->pixels * k->o.group);
    for (long i = 0; i < k->statistics; i++)
        for (long f = 0; f < 2 * k->fields; f++) {
            double sum = 0;
            for (long m = i * images; k->o.mode != LF_NORM_RUNNING && m < (i + 1) * images; m++)
                sum += sums[2 * m * k->fields + f];
            means[2 * i * k->fields + f] = sum * share;
        }
}

/* dx += a g - b - d (x - mean) on `rows` rows; a, b, d a channel */
static void dx_rows(long rows, long channels, const lf_real *restrict g, const lf_real *restrict x,
                    const lf_real *restrict mean, const lf_real *restrict a,
                    const lf_real *restrict b, const lf_real *restrict d, lf_real *restrict dx)
{
    for (long r = 0; r < rows; r++, g += channels, x += channels, dx += channels)
        for (long c = 0; c < channels; c++)
            dx[c] += a[c] * g[c] - (b[c] + d[c] * (x[c] - mean[c]));
}

static void image_dx(const lf_node *node, long n, const double *means)
{
    const kept *k = node->saved;
    const lf_tensor *x = node->in[0], *gamma = node->in[1], *y = node->out[0];
    lf_real buffer[RUN], a[RUN], b[RUN], d[RUN];
    const long channels = k->channels, step = rows_of_run(k);
    means += k->statistics == 1 ? 0 : 2 * n * k->fields;
    for (long c = 0; c < channels; c++) {
        const long f = c / k->o.group;
        const double inverse = (double)k->inverse[part(k, n) + c];
        const double scale = (double)gamma->value[f] * inverse;
        a[c] = (lf_real)scale;
        b[c] = (lf_real)(scale * means[f]);
        d[c] = (lf_real)(scale * inverse * means[k->fields + f]);
    }
    for (long row = 0; row < k->pixels; row += step) {
        const long rows = row + step < k->pixels ? step : k->pixels - row;
        const long at = (n * k->pixels + row) * channels;
        const lf_real *g = passed(k->o.relu, rows * channels, y->grad + at, y->value + at, buffer);
        dx_rows(rows, channels, g, x->value + at, k->mean + part(k, n), a, b, d, x->grad + at);
    }
}

static void backward(const lf_node *node)
{
    const kept *k = node->saved;
    double *channel = lf_alloc(node->tape, (size_t)(2 * k->images * k->channels) * sizeof(double));
    double *sums = lf_alloc(node->tape, (size_t)(2 * k->images * k->fields) * sizeof(double));
#pragma omp parallel for schedule(static)
    for (long n = 0; n < k->images; n++)
        image_sums(node, n, channel + 2 * n * k->channels, sums + 2 * n * k->fields);
    affine_gradients(k, sums, node->in[1]->grad, node->in[2]->grad);
    if (!node->in[0]->grad)
        return;
    double *means = lf_alloc(node->tape, (size_t)(2 * k->statistics * k->fields) * sizeof(double));
    field_means(k, sums, means);
#pragma omp parallel for schedule(static)
    for (long n = 0; n < k->images; n++)
        image_dx(node, n, means);
}

static void check_arguments(const lf_tensor *x, const lf_tensor *gamma, const lf_tensor *beta,
                            const lf_tensor *r, const lf_field_norm_options *o)
{
    LF_REQUIRE(x->rank == 4 && x->size > 0, "lf_field_norm: x of rank %d and %ld numbers", x->rank,
               x->size);
    LF_REQUIRE(o->group >= 1 && x->dim[3] % o->group == 0 && x->dim[3] <= RUN,
               "lf_field_norm: %ld channels in groups of %d", x->dim[3], o->group);
    LF_REQUIRE(gamma->size == x->dim[3] / o->group && beta->size == gamma->size,
               "lf_field_norm: %ld scales and %ld shifts for %ld fields", gamma->size, beta->size,
               x->dim[3] / o->group);
    LF_REQUIRE(!r || (r->size == x->size && r->dim[3] == x->dim[3]),
               "lf_field_norm: a residual of %ld numbers for %ld", r->size, x->size);
    LF_REQUIRE(o->mode != LF_NORM_RUNNING || (o->running_mean && o->running_var),
               "lf_field_norm: running statistics are missing");
}

lf_tensor *lf_field_norm(lf_tape *tape, lf_tensor *x, lf_tensor *gamma, lf_tensor *beta,
                         lf_tensor *residual, const lf_field_norm_options *options)
{
    check_arguments(x, gamma, beta, residual, options);
    kept *k = lf_alloc(tape, sizeof *k);
    *k = (kept){.o = *options,
                .images = x->dim[0],
                .pixels = x->dim[1] * x->dim[2],
                .channels = x->dim[3],
                .fields = x->dim[3] / options->group};
    find_statistics(tape, k, x->value);
    lf_tensor *y = lf_tensor_like(tape, x);
    forward_images(k, x, gamma, beta, residual, y);
    lf_record(tape, "field_norm", backward, k, LF_IN(x, gamma, beta, residual), LF_OUT(y));
    lf_made_again_by(tape, y, again);
    return y;
}
