/* feature_cost.c: sizes and costs of the feature networks.                       [feature_net.h] */
#include "models/feature_net.h"

static bool is_small(const lf_feature_net *net)
{
    return net->config.kind == LF_FEATURES_SMALL;
}

/* The coarsest map has 2 lines, so that it can be mirrored: 2 -> 3 -> 5 (-> 9 -> 17). */
long lf_feature_net_smallest(const lf_feature_net *net)
{
    return is_small(net) ? 5 : 17;
}

long lf_feature_net_stride(const lf_feature_net *net)
{
    return is_small(net) ? 2 : 4;
}

long lf_feature_net_lines(const lf_feature_net *net, long lines)
{
    return is_small(net) ? (lines + 1) / 2 : ((lines + 1) / 2 + 1) / 2;
}

/* ---- costs ----------------------------------------------------------------------------------- */

typedef struct extent {
    long height, width;
} extent;

typedef struct counts {
    double macs, kept;
} counts;

static double pixels(extent e)
{
    return (double)e.height * (double)e.width;
}

/* Add one unit on a map of size `in`; returns the size of its result. */
static extent count_unit(const lf_feature_unit *unit, extent in, counts *cost)
{
    const lf_parameter *w = unit->conv.weight;
    const long border = w->dim[0] / 2 * 2, stride = unit->conv.stride;
    const extent padded = {in.height + border, in.width + border};
    const extent out = {(in.height + stride - 1) / stride, (in.width + stride - 1) / stride};
    cost->macs += pixels(out) * (double)w->size;
    cost->kept += pixels(out) * (double)w->dim[3] * (unit->scale ? 2 : 1);
    cost->kept += border ? pixels(padded) * (double)w->dim[2] : 0;
    return out;
}

static counts count_small(const lf_feature_net *net, extent at)
{
    const lf_feature_unit *u = net->unit;
    counts cost = {0, 3 * pixels(at)};
    extent p = {0, 0};
    for (int i = 0; i < 4; i++) {
        at = count_unit(&u[i], at, &cost);
        p = i == 1 ? at : p;
    }
    cost.kept += 5 * (double)net->config.width * pixels(p); /* resized, joined */
    count_unit(&net->out, count_unit(&u[4], p, &cost), &cost);
    return cost;
}

static counts count_resnet(const lf_feature_net *net, extent at)
{
    const lf_feature_unit *u = net->unit;
    const lf_feature_block *block = net->block;
    counts cost = {0, 0};
    extent stage[LF_FEATURE_STAGES];
    at = count_unit(&u[0], at, &cost);
    for (int s = 0; s < LF_FEATURE_STAGES; s++) {
        for (int i = 0; i < net->config.layers[s]; i++, block++) {
            if (block->has_shortcut)
                count_unit(&block->shortcut, at, &cost);
            at = count_unit(&block->conv2, count_unit(&block->conv1, at, &cost), &cost);
        }
        stage[s] = at;
    }
    const double w = (double)net->config.width, c = (double)net->config.features;
    cost.kept += pixels(stage[1]) * w * (4 + 4 + 2 + 2); /* resized, joined, two ELUs */
    cost.kept += pixels(stage[0]) * (w * (2 + 2 + 1) + c);
    for (int i = 1; i < LF_FEATURE_UNITS; i++)
        count_unit(&u[i], stage[i < 3 ? 1 : 0], &cost);
    count_unit(&net->out, stage[0], &cost);
    return cost;
}

static counts count(const lf_feature_net *net, long height, long width)
{
    const extent at = {height, width};
    return is_small(net) ? count_small(net, at) : count_resnet(net, at);
}

double lf_feature_net_macs(const lf_feature_net *net, long height, long width)
{
    return count(net, height, width).macs;
}

double lf_feature_net_kept(const lf_feature_net *net, long height, long width)
{
    return count(net, height, width).kept;
}
