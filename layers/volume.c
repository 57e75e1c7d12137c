/* volume.c: densities; colours, weights and depths of rays from densities and colours at samples
 *                                                                      [method.md 4.2, 4.9, 5b.1]
 *   density: sigma = max(t, 0) + log1p(exp(-|t|)),  dt = dsigma / (1 + e^-t)
 *   T_i = exp(-sum_{j<i} min(sigma_j, 80)),  alpha_i = -expm1(-sigma_i),  w_i = T_i alpha_i
 *   colour = sum_i w_i c_i (+ 1 - sum_i w_i on white),  depth = sum_i w_i t_i
 *   backward, g_i = <dcolour, c_i> + dw_i + t_i ddepth (- sum dcolour on white):
 *     dsigma_i = T_i exp(-sigma_i) g_i - sum_{j>i} w_j g_j,  dc_i = w_i dcolour
 *
 * Shapes      sigma [N, S] >= 0, c [N, S, 3], t [N, S]; colour [N, 3], w [N, S], depth [N].
 * Keeps       w and T; sums run in double.
 * Degenerate  no density: the background. An opaque sample: nothing behind it counts, exp(-80).
 */
#include "layers/light_field.h"

static const double most = 80; /* exp(-80) is 0 beside 1, and not denormal in float */

typedef struct volume {
    long samples;
    bool white;
    const lf_tensor *depth;
    lf_real *before; /* T [N, S] */
} volume;

static void forward_ray(const volume *v, long ray, const lf_real *sigma, const lf_real *c,
                        lf_tensor *const *out)
{
    const long n = v->samples;
    double sum = 0, opacity = 0, colour[3] = {0, 0, 0}, depth = 0;
    for (long i = 0; i < n; i++) {
        const double s = (double)sigma[i], before = exp(-sum), w = before * -expm1(-s);
        v->before[ray * n + i] = (lf_real)before;
        out[1]->value[ray * n + i] = (lf_real)w;
        opacity += w;
        depth += w * (double)v->depth->value[ray * n + i];
        for (int a = 0; a < 3; a++)
            colour[a] += w * (double)c[3 * i + a];
        sum += s > most ? most : s; /* NaN stays NaN */
    }
    for (int a = 0; a < 3; a++)
        out[0]->value[3 * ray + a] = (lf_real)(colour[a] + (v->white ? 1 - opacity : 0));
    out[2]->value[ray] = (lf_real)depth;
}

static void backward_ray(const volume *v, const lf_node *node, long ray)
{
    const lf_tensor *sigma = node->in[0], *c = node->in[1];
    const lf_real *dcolour = node->out[0]->grad + 3 * ray;
    const double ddepth = (double)node->out[2]->grad[ray];
    const double rest = v->white ? (double)dcolour[0] + (double)dcolour[1] + (double)dcolour[2] : 0;
    double behind = 0; /* sum of w_j g_j over j > i */
    for (long i = (ray + 1) * v->samples - 1; i >= ray * v->samples; i--) {
        const double w = (double)node->out[1]->value[i];
        double g = (double)node->out[1]->grad[i] + (double)v->depth->value[i] * ddepth - rest;
        for (int a = 0; a < 3; a++) {
            g += (double)dcolour[a] * (double)c->value[3 * i + a];
            if (c->grad)
                c->grad[3 * i + a] += (lf_real)(w * (double)dcolour[a]);
        }
        if (sigma->grad)
            sigma->grad[i] +=
                (lf_real)((double)v->before[i] * exp(-(double)sigma->value[i]) * g - behind);
        behind += w * g;
    }
}

static void backward(const lf_node *node)
{
    const volume *v = node->saved;
    for (long ray = 0; ray < lf_rows(node->in[0]); ray++)
        backward_ray(v, node, ray);
}

lf_rendered lf_volume(lf_tape *tape, lf_tensor *sigma, lf_tensor *colour, const lf_tensor *depth,
                      bool white)
{
    LF_REQUIRE(sigma->rank == 2 && colour->size == 3 * sigma->size && depth->size == sigma->size,
               "lf_volume: %ld densities, %ld colours, %ld depths", sigma->size, colour->size,
               depth->size);
    const long rays = sigma->dim[0], n = sigma->dim[1];
    volume *v = lf_alloc(tape, sizeof *v);
    *v = (volume){n, white, depth, lf_alloc_reals(tape, sigma->size)};
    lf_rendered r = {lf_tensor_new(tape, 2, LF_DIMS(rays, 3)), lf_tensor_like(tape, sigma),
                     lf_tensor_new(tape, 1, LF_DIMS(rays))};
    lf_tensor *out[] = {r.colour, r.weight, r.depth};
    for (long ray = 0; ray < rays; ray++)
        forward_ray(v, ray, sigma->value + ray * n, colour->value + 3 * ray * n, out);
    lf_record(tape, "volume", backward, v, LF_IN(sigma, colour), 3, out);
    return r;
}

/* ---- densities ---------------------------------------------------------------------------------
 */

static void density_backward(const lf_node *node)
{
    lf_tensor *t = node->in[0];
    const lf_real *count = node->saved, *dy = node->out[0]->grad;
    for (long i = 0; i < t->size; i++) {
        const lf_real e = LF_EXP(-LF_FABS(t->value[i]));
        if (count[i] > 0)
            t->grad[i] += dy[i] * (t->value[i] >= 0 ? 1 : e) / (1 + e);
    }
}

lf_tensor *lf_density(lf_tape *tape, lf_tensor *t, const lf_tensor *count)
{
    LF_REQUIRE(t->size == count->size && count->rank == 2, "lf_density: t of %ld, count of %ld",
               t->size, count->size);
    lf_tensor *sigma = lf_tensor_like(tape, count);
    for (long i = 0; i < t->size; i++) {
        const double x = (double)t->value[i], y = (x > 0 ? x : 0) + log1p(exp(-fabs(x)));
        sigma->value[i] = count->value[i] > 0 ? (lf_real)y : 0;
    }
    lf_record(tape, "density", density_backward, count->value, LF_IN(t), LF_OUT(sigma));
    return sigma;
}
