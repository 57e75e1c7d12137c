/* schedule.h: the learning rate of a step.
 *
 *   warm-up    lr (s + 1) / warmup                       for s < warmup
 *   constant   lr
 *   cosine     lr (f + (1 - f) (1 + cos(pi t)) / 2)      t = share of the steps after the warm-up
 *   step       lr factor^floor(s / every)
 */
#ifndef LF_TRAIN_SCHEDULE_H
#define LF_TRAIN_SCHEDULE_H

#include "configs/configs.h"

/* Learning rate of step `step`, counted from 0; a function of the config and the step alone. */
double lf_learning_rate(const lf_config *cfg, long step);

#endif
