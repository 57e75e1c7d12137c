/* op_sdf_loss.c: weighted L1 on clamped signed distances, summed                 [method.md 5a.7]
 *
 *   L = sum_i w_i | x~_i - clip(s t_i) |,   clip(z) = max(-c, min(c, z)),  c = s * clamp
 *   x~_i = min(x_i, c) where the target is clipped above, max(x_i, -c) where it is clipped below,
 *          x_i elsewhere: a prediction beyond the clamp costs nothing on the right side of the
 *          surface and still has a gradient on the wrong one
 *   w_i = near_weight if t_i <= near (this holds for the whole inside), else 1
 *   dx_i += dL w_i sign(x~_i - clip(s t_i))
 *
 * Shapes     x [.., 1] (n numbers), t [n], L [].
 */
#include "autograd/ops.h"

typedef struct sdf_loss {
    const float *sdf;
    lf_sdf_loss_config config;
} sdf_loss;

static double clip(double z, double c)
{
    return z < -c ? -c : z > c ? c : z;
}

static double weight(const sdf_loss *s, long i)
{
    return (double)s->sdf[i] <= s->config.near ? s->config.near_weight : 1;
}

/* x~ - clip(s t): 0 where both lie beyond the clamp on the same side. */
static double difference(const sdf_loss *s, const lf_tensor *x, long i)
{
    const double c = s->config.scale * s->config.clamp;
    const double target = clip(s->config.scale * (double)s->sdf[i], c), p = (double)x->value[i];
    if ((target >= c && p >= c) || (target <= -c && p <= -c))
        return 0;
    return p - target;
}

static void backward(const lf_node *node)
{
    const sdf_loss *s = node->saved;
    lf_tensor *x = node->in[0];
    const double dl = (double)node->out[0]->grad[0];
    for (long i = 0; i < x->size; i++) {
        const double d = difference(s, x, i);
        x->grad[i] += (lf_real)(dl * weight(s, i) * ((d > 0) - (d < 0)));
    }
}

lf_tensor *lf_sdf_loss(lf_tape *tape, lf_tensor *x, const float *sdf,
                       const lf_sdf_loss_config *config)
{
    LF_REQUIRE(lf_cols(x) == 1, "lf_sdf_loss: x [.., %ld], needs [.., 1]", lf_cols(x));
    sdf_loss *saved = lf_alloc(tape, sizeof *saved);
    *saved = (sdf_loss){sdf, *config};
    lf_tensor *loss = lf_tensor_new(tape, 0, NULL);
    double sum = 0;
    for (long i = 0; i < x->size; i++)
        sum += weight(saved, i) * fabs(difference(saved, x, i));
    loss->value[0] = (lf_real)sum;
    lf_record(tape, "sdf_loss", backward, saved, LF_IN(x), LF_OUT(loss));
    return loss;
}
