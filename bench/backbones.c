/* backbones.c: networks from pictures to feature maps, alone: the C8 residual network, the plain
 * one of as many channels, and IBRNet's feature network. Forward, and training steps: forward, loss
 * (sum over the maps of their mean squares), backward, Adam, as the PyTorch comparison times them.
 *
 * Filters are expanded in every run. Operations are counted by formula, convolutions alone.
 */
#include "autograd/optim.h"
#include "bench/bench.h"
#include "models/backbone.h"
#include "models/feature_net.h"

enum { C8, PLAIN, FEATURE_NET, KINDS, TRAIN = 8 /* else forward */ };

typedef struct net_work {
    lf_bench_work work;
    int kind;
    bool training;
    lf_store *store;
    lf_backbone backbone;
    lf_feature_net net;
    lf_adam adam;
    lf_tape *tape;
    long images, size;
    lf_real *image;
    int maps;
    lf_tensor *map[LF_BACKBONE_MAPS]; /* of the last run, on the tape */
    double loss;
} net_work;

static void forward(net_work *w)
{
    lf_tape_reset(w->tape);
    lf_tape_set_grad(w->tape, w->training);
    lf_tensor *x = lf_leaf(w->tape, 4, LF_DIMS(w->images, w->size, w->size, 3), w->image, NULL);
    if (w->kind != FEATURE_NET) {
        w->maps = lf_backbone_forward(w->tape, &w->backbone, x, w->training, w->map);
        return;
    }
    w->maps = 1;
    w->map[0] = lf_feature_net_forward(w->tape, &w->net, x);
}

static void backward(net_work *w)
{
    w->loss = 0;
    lf_store_zero_grads(w->store);
    for (int m = 0; m < w->maps; m++) {
        const lf_tensor *map = w->map[m];
        lf_real *grad = lf_grad(w->tape, w->map[m]);
        double sum = 0;
        for (long i = 0; i < map->size; i++) {
            grad[i] += 2 * map->value[i] / (lf_real)map->size;
            sum += (double)(map->value[i] * map->value[i]);
        }
        w->loss += sum / (double)map->size;
    }
    lf_backward_from(w->tape);
}

static void run_net(lf_bench_work *work)
{
    net_work *w = (net_work *)work;
    forward(w);
    if (w->training) {
        backward(w);
        lf_adam_step(&w->adam, w->store, 1e-4);
    }
    const double copies = w->training ? 4 : 2; /* values, gradients, two moments */
    work->memory =
        (double)lf_tape_peak(w->tape) + copies * sizeof(lf_real) * (double)lf_store_size(w->store);
    work->bytes = 2 * work->memory;
}

static void net_outputs(lf_bench_work *work, lf_outputs *to)
{
    net_work *w = (net_work *)work;
    forward(w);
    for (int m = 0; m < w->maps; m++) {
        char name[LF_OUTPUT_NAME];
        snprintf(name, sizeof name, "map %d", m);
        lf_outputs_add(to, name, w->map[m]->size, w->map[m]->value);
    }
    if (!w->training)
        return;
    backward(w);
    lf_outputs_add_doubles(to, "loss", 1, &w->loss);
    lf_outputs_add(to, "gradient", lf_store_size(w->store), lf_store_grads(w->store));
}

static void close_net(lf_bench_work *work)
{
    net_work *w = (net_work *)work;
    if (w->kind == FEATURE_NET)
        lf_feature_net_free(&w->net);
    else
        lf_backbone_free(&w->backbone);
    lf_adam_free(&w->adam);
    lf_tape_free(w->tape);
    lf_store_free(w->store);
    free(w->image);
    free(w);
}

/* The network, and its multiply-adds of one picture, forward. */
static double init_net(net_work *w, int base)
{
    if (w->kind == FEATURE_NET) {
        const lf_feature_config config = {LF_FEATURES_RESNET34, 64, 64, {3, 4, 6}};
        lf_feature_net_init(w->store, "net", &config, &w->net);
        return lf_feature_net_macs(&w->net, w->size, w->size);
    }
    const lf_backbone_config config = {.in_channels = 3,
                                       .c8 = w->kind == C8,
                                       .plain_channels = 8,
                                       .stem_fields = base,
                                       .stem_size = 7,
                                       .stem_pool = true,
                                       .stages = 4,
                                       .blocks = {2, 2, 2, 2},
                                       .fields = {base, 2 * base, 4 * base, 8 * base},
                                       .first_stride = 1,
                                       .cutoff = LF_C8_E2CNN,
                                       .features = 16,
                                       .momentum = 0.1};
    lf_backbone_init(w->store, "net", &config, &w->backbone);
    return lf_backbone_macs(&w->backbone, w->size, w->size).macs;
}

/* size: images, pixels an edge, fields of the stem and first stage */
static lf_bench_work *open_net(const lf_bench_case *c)
{
    net_work *w = lf_bench_room(1, sizeof *w);
    w->kind = c->variant & ~TRAIN;
    w->training = (c->variant & TRAIN) != 0;
    w->images = c->size[0];
    w->size = c->size[1];
    w->store = lf_store_create(1);
    const double macs = init_net(w, (int)c->size[2]);
    lf_reference_round(lf_store_size(w->store), lf_store_values(w->store));
    const lf_adam_config adam = {.beta1 = 0.9, .beta2 = 0.999, .eps = 1e-8};
    if (w->training)
        lf_adam_init(&w->adam, &adam, w->store);
    w->tape = lf_tape_create();
    const long pixels = w->images * w->size * w->size * 3;
    w->image = lf_bench_room(pixels, sizeof *w->image);
    lf_bench_fill(pixels, w->image, 0, 1, 0);
    w->work = (lf_bench_work){.flop = (w->training ? 6 : 2) * macs * (double)w->images,
                              .run = run_net,
                              .outputs = net_outputs,
                              .close = close_net};
    return &w->work;
}

/* An odd size is exact under quarter turns; 64 and 137 are those of the PyTorch comparison. */
#define NET(name, what, size, base, kind)                                                          \
    {name "-forward", what ", forward", open_net, {8, size, base}, kind},                          \
    {                                                                                              \
        name, what ", training step", open_net, {8, size, base}, kind | TRAIN                      \
    }

static const lf_bench_case cases[] = {
    NET("c8-tiny-65", "C8 ResNet of 4 to 32 fields, 8 views 65x65", 65, 4, C8),
    NET("plain-tiny-65", "ResNet of 32 to 256 channels, 8 views 65x65", 65, 4, PLAIN),
    NET("c8-small-129", "C8 ResNet of 8 to 64 fields, 8 views 129x129", 129, 8, C8),
    NET("plain-small-129", "ResNet of 64 to 512 channels, 8 views 129x129", 129, 8, PLAIN),
    NET("c8-tiny-64", "C8 ResNet of 4 to 32 fields, 8 views 64x64", 64, 4, C8),
    NET("c8-small-137", "C8 ResNet of 8 to 64 fields, 8 views 137x137", 137, 8, C8),
    NET("plain-tiny-64", "ResNet of 32 to 256 channels, 8 views 64x64", 64, 4, PLAIN),
    NET("feature-net-64", "IBRNet's feature network, 8 views 64x64", 64, 0, FEATURE_NET),
};

const lf_bench_table lf_bench_backbones = {"networks", cases, sizeof cases / sizeof *cases, false};
