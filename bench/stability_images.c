/* stability_images.c: pictures of one colour.                             [method.md 4.7, 5a.2,
 * 5b.1] Where every pixel is the same a normalisation divides what rounding left by the root of its
 * epsilon: 300 times, layer after layer.
 */
#include "autograd/ops_image.h"
#include "bench/stability.h"
#include "models/backbone.h"
#include "models/feature_net.h"

#define COLOURS LF_STABILITY_AT(0, 0.3, 0.7, 1)

static lf_tensor *flat(lf_stability *s, long count, long edge, long channels)
{
    const long n = count * edge * edge * channels;
    double *x = lf_alloc(s->tape, (size_t)n * sizeof *x);
    for (long i = 0; i < n; i++)
        x[i] = s->parameter;
    s->pictures = true;
    return lf_stability_given(s, "picture", 4, LF_DIMS(count, edge, edge, channels), x, 1);
}

/* The norm by itself: the shift must be all that is left. */
static void field_norm(lf_stability *s)
{
    enum { EDGE = 31, C = 3 };
    double x[EDGE * EDGE * C];
    long double y[EDGE * EDGE * C];
    for (int i = 0; i < EDGE * EDGE * C; i++)
        x[i] = s->parameter * (1 + 10 * (i % C));
    lf_tensor *flat_x = lf_stability_given(s, "x", 4, LF_DIMS(1, EDGE, EDGE, C), x, 1e-2);
    lf_tensor *gamma = lf_stability_input(s, "gamma", 1, LF_DIMS(C), 1);
    lf_tensor *beta = lf_stability_input(s, "beta", 1, LF_DIMS(C), 1);
    for (int i = 0; i < EDGE * EDGE * C; i++)
        y[i] = beta->value[i % C];
    /* its terms g u are 0, where u may be what the mean's last place leaves */
    lf_stability_condition(s, "gamma", EDGE * EDGE * x[C - 1] / sqrt(1e-5));
    const lf_field_norm_options o = {.mode = LF_NORM_INSTANCE, .group = 1, .epsilon = 1e-5};
    s->scale = 1;
    lf_stability_output(s, "y", lf_field_norm(s->tape, flat_x, gamma, beta, NULL, &o), y);
}

static void free_features(void *net)
{
    lf_feature_net_free(net);
}

static void features(lf_stability *s, const lf_feature_config *config)
{
    lf_feature_net *net = lf_alloc(s->tape, sizeof *net);
    lf_feature_net_init(s->store, "features", config, net);
    lf_stability_keep(s, free_features, net);
    lf_stability_parameters(s);
    s->step = 0;
    s->scale = 1;
    lf_stability_output(s, "map", lf_feature_net_forward(s->tape, net, flat(s, 1, 33, 3)), NULL);
}

static void small_net(lf_stability *s)
{
    features(s, &(lf_feature_config){LF_FEATURES_SMALL, 8, 6, {0}});
}

static void residual_net(lf_stability *s)
{
    features(s, &(lf_feature_config){LF_FEATURES_RESNET34, 8, 6, {1, 1, 1}});
}

static void free_backbone(void *net)
{
    lf_backbone_free(net);
}

/* The reconstruction network's maps of flat views; statistics of the batch or of each image. */
static void backbone(lf_stability *s, bool instance)
{
    const lf_backbone_config config = {.in_channels = 2,
                                       .c8 = true,
                                       .stem_fields = 2,
                                       .stem_size = 5,
                                       .stages = 2,
                                       .blocks = {1, 1},
                                       .fields = {2, 3},
                                       .first_stride = 1,
                                       .features = 4,
                                       .instance_norm = instance,
                                       .momentum = 0.1};
    static const char *const name[] = {"map 0", "map 1", "map 2"};
    lf_backbone *net = lf_alloc(s->tape, sizeof *net);
    lf_tensor *maps[LF_BACKBONE_MAPS];
    lf_backbone_init(s->store, "backbone", &config, net);
    lf_stability_keep(s, free_backbone, net);
    lf_stability_parameters(s);
    s->step = 0;
    const int count = lf_backbone_forward(s->tape, net, flat(s, 2, 33, 2), true, maps);
    for (int m = 0; m < count; m++)
        lf_stability_output(s, name[m], maps[m], NULL);
}

static void batch_backbone(lf_stability *s)
{
    backbone(s, false);
}

static void instance_backbone(lf_stability *s)
{
    backbone(s, true);
}

static const lf_stability_case cases[] = {
    {"flat: norm", "colour", field_norm, COLOURS},
    {"flat: small features", "colour", small_net, COLOURS},
    {"flat: residual features", "colour", residual_net, COLOURS, .limit = 1e11},
    {"flat: backbone, batch", "colour", batch_backbone, COLOURS},
    {"flat: backbone, instance", "colour", instance_backbone, COLOURS},
};

const lf_stability_table lf_stability_images = {cases, sizeof cases / sizeof *cases};
