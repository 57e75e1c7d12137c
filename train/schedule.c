/* schedule.c: see schedule.h. */
#include <math.h>

#include "train/schedule.h"

double lf_learning_rate(const lf_config *cfg, long step)
{
    const double lr = lf_config_real(cfg, "train.lr");
    const long warmup = lf_config_int(cfg, "train.warmup"),
               steps = lf_config_int(cfg, "train.steps");
    if (step < warmup)
        return lr * (double)(step + 1) / (double)warmup;
    if (lf_config_is(cfg, "train.schedule", "constant"))
        return lr;
    if (lf_config_is(cfg, "train.schedule", "step")) {
        const long every = lf_config_int(cfg, "train.decay_every");
        return lr * pow(lf_config_real(cfg, "train.decay_factor"), (double)(step / every));
    }
    const double final = lf_config_real(cfg, "train.final_lr");
    const long span = steps - warmup > 1 ? steps - warmup - 1 : 1;
    const double t = fmin(1, (double)(step - warmup) / (double)span);
    return lr * (final + (1 - final) * 0.5 * (1 + cos(3.141592653589793 * t)));
}
