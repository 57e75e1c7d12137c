/* backbone.h: residual network from images to a pyramid of scalar feature maps.  [method.md 5a.2]
 *
 *   images [N,H,W,C] -> stem (size x size, stride 2, norm, ReLU) -> max-pool 3x3 stride 2, if asked
 *   -> stages of residual blocks, the first of each stage strided -> from the stem's map (if asked)
 *   and each stage's last map one 1x1 layer with bias to `features` scalars. With `antialias` the
 *   images and these maps are smoothed (lf_blur) before anything reads them: next stage and layer.
 *
 * With c8 all inner maps are regular fields and the results are scalars: turning the images by 90
 * degrees turns the maps, exactly if H and W are 2^k m + 1, k the number of strides: 65, 129, 225.
 * Without c8 the same network has ordinary filters over plain_channels channels a field.
 *
 * Parameters are prefix.stem.*, prefix.stage<s>.block<b>.{conv1,conv2,conv3,shortcut}.*, s from 1,
 * b from 0, and prefix.head<m>.{weight,bias}, m = 0 for the stem's map, else the stage.
 */
#ifndef LF_MODELS_BACKBONE_H
#define LF_MODELS_BACKBONE_H

#include "layers/c8_block.h"

enum { LF_BACKBONE_STAGES = 8, LF_BACKBONE_MAPS = LF_BACKBONE_STAGES + 1 };

typedef struct lf_backbone_config {
    int in_channels;
    bool c8;            /* false: ordinary convolutions, */
    int plain_channels; /* so many channels a field: 8 costs the same time (unused with c8) */
    int stem_fields;
    int stem_size;  /* odd */
    bool stem_pool; /* 3x3 max-pool, stride 2, between stem and stages */
    int stages;     /* 1 .. LF_BACKBONE_STAGES */
    int blocks[LF_BACKBONE_STAGES], fields[LF_BACKBONE_STAGES];
    int first_stride; /* of the first stage; the others have 2 */
    bool bottleneck;  /* 1x1, 3x3, 1x1 with a quarter of the fields inside; false: 3x3, 3x3 */
    lf_c8_cutoff cutoff;
    int features;       /* scalars read out of each map */
    bool instance_norm; /* statistics of each image; false: batch, and running ones outside training
                         */
    double momentum;    /* of the running statistics */
    bool stem_map;      /* also read out the stem's map, after its ReLU */
    bool antialias;     /* smooth what is strided or sampled next */
} lf_backbone_config;

typedef struct lf_backbone {
    lf_backbone_config config;
    lf_unit stem;
    lf_block *block; /* of all stages in a row; owned */
    int block_count;
    lf_conv_layer head[LF_BACKBONE_MAPS]; /* 0: stem's map */
} lf_backbone;

/* Registers the parameters in `store`. The backbone owns its filter bases: free it once. */
void lf_backbone_init(lf_store *store, const char *prefix, const lf_backbone_config *config,
                      lf_backbone *backbone);
void lf_backbone_free(lf_backbone *backbone);

/* images [N, H, W, in_channels] -> inner maps [N, h, w, 8 fields] after their ReLU: maps[0] the
 * stem's (before pooling), maps[s] that of stage s. Returns their number, stages + 1. Training uses
 * the batch's statistics and updates the running ones. */
int lf_backbone_fields(lf_tape *tape, const lf_backbone *backbone, lf_tensor *images, bool training,
                       lf_tensor *maps[LF_BACKBONE_MAPS]);
/* Inner maps -> scalar maps [N, h, w, features], finest first; returns their number. */
int lf_backbone_scalars(lf_tape *tape, const lf_backbone *backbone, lf_tensor *const *inner,
                        lf_tensor *maps[LF_BACKBONE_MAPS]);
/* Both: images -> scalar maps. */
int lf_backbone_forward(lf_tape *tape, const lf_backbone *backbone, lf_tensor *images,
                        bool training, lf_tensor *maps[LF_BACKBONE_MAPS]);

typedef struct lf_backbone_cost {
    long parameters; /* trainable numbers */
    double macs;     /* multiply-adds of the convolutions of one image, forward */
    double kept;     /* numbers that training keeps of one image: outputs of convolutions */
    int maps;        /* scalar maps */
    long height[LF_BACKBONE_MAPS], width[LF_BACKBONE_MAPS]; /* of each */
} lf_backbone_cost;

/* What one image of height x width costs. Norms, ReLU, smoothing and the expansion of filters (a
 * few per cent) are not counted. */
lf_backbone_cost lf_backbone_macs(const lf_backbone *backbone, long height, long width);

#endif
