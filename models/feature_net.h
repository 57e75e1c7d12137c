/* feature_net.h: from pictures to the feature maps that the renderers sample.    [method.md 5b.1]
 *
 *   images [N, H, W, 3], values 0 to 1 -> features [N, h, w, C]
 *
 * SMALL, of width w; P stands for a reflected border of size / 2, and every map but the last ends
 * with ELU:
 *   x = 2 images - 1
 *   p = P3x3 w (P5x5 w stride 2 (x))                                  lines ceil(H / 2)
 *   q = P3x3 2w (P3x3 2w stride 2 (p))                                lines ceil(ceil(H / 2) / 2)
 *   y = 1x1 C (P3x3 2w ([q at p's size, corners not aligned; p]))     h = ceil(H / 2)
 *   No normalisation. 18 144 parameters at w = C = 12.
 *
 * RESNET34, of width w; every convolution is followed by a norm of each image with scale and shift:
 *   x1 = layers[0] blocks of w, the first with stride 2 (ReLU P7x7 w stride 2 (images))
 *   x2 = layers[1] blocks of 2w, x3 = layers[2] blocks of 4w, each stage with stride 2
 *   y2 = U 2w ([U 2w (x3 at x2's size); x2]),  y1 = U C ([U w (y2 at x1's size); x1])
 *   y = 1x1 C (y1)                                                    h = H / 4, rounded up twice
 *   A block is ReLU(x' + P3x3 (ReLU P3x3 (x))) with x' = x or a strided 1x1 of it; U is ELU P3x3;
 *   resizing has its corners aligned. 8 917 120 parameters at w = C = 64, layers 3, 4, 6. Mapping
 * the images to -1 .. 1 would change nothing but rounding: the first norm undoes it.
 *
 * Weights start normal with variance 1 / (3 fan in), biases at 0, scales at 1, shifts at 0.
 * Parameters: prefix.{down1 .. down4, join, out}.* (SMALL); prefix.stem.*,
 * prefix.stage<s>.block<b>.{conv1, conv2, shortcut}.*, prefix.{up3, join3, up2, join2, out}.*
 * (RESNET34); each has weight and, where it has them, bias, scale, shift.
 */
#ifndef LF_MODELS_FEATURE_NET_H
#define LF_MODELS_FEATURE_NET_H

#include "layers/conv.h"

typedef enum lf_feature_kind { LF_FEATURES_SMALL, LF_FEATURES_RESNET34 } lf_feature_kind;

enum { LF_FEATURE_STAGES = 3, LF_FEATURE_UNITS = 5 };

typedef struct lf_feature_config {
    lf_feature_kind kind;
    long width;                    /* w: 12, or 64 */
    long features;                 /* C, of all networks that sample the maps together */
    int layers[LF_FEATURE_STAGES]; /* RESNET34: blocks of each stage, 3, 4, 6 */
} lf_feature_config;

/* A convolution with a reflected border, and its norm. */
typedef struct lf_feature_unit {
    lf_conv_layer conv;
    const lf_parameter *scale, *shift; /* [out], or NULL: no norm */
} lf_feature_unit;

typedef struct lf_feature_block {
    lf_feature_unit conv1, conv2, shortcut;
    bool has_shortcut;
} lf_feature_block;

typedef struct lf_feature_net {
    lf_feature_config config;
    lf_feature_unit unit[LF_FEATURE_UNITS]; /* SMALL: down1 .. down4, join;
                                               RESNET34: stem, up3, join3, up2, join2 */
    lf_feature_unit out;
    lf_feature_block *block; /* RESNET34: of all stages in a row; owned */
    int block_count;
} lf_feature_net;

/* Registers the parameters in `store`. */
void lf_feature_net_init(lf_store *store, const char *prefix, const lf_feature_config *config,
                         lf_feature_net *net);
void lf_feature_net_free(lf_feature_net *net);

/* images [N, H, W, 3] -> [N, h, w, C]. H and W must be at least lf_feature_net_smallest; they need
 * not be even. SMALL gives no gradient to the images. */
lf_tensor *lf_feature_net_forward(lf_tape *tape, const lf_feature_net *net, lf_tensor *images);

/* Lines (or columns) that an image must have: 5, or 17. */
long lf_feature_net_smallest(const lf_feature_net *net);
/* Lines of the map of an image of `lines` lines; likewise columns. */
long lf_feature_net_lines(const lf_feature_net *net, long lines);

/* Image pixels from one line of the map to the next: 2, or 4. Filters are centred, their border is
 * half their size, so pixel (u, v), integers at pixel centres, lies at column u / stride and line
 * v / stride of the map: not at (u + 1/2) w / W - 1/2, which is up to half a line before it. That
 * is exact for the finest maps inside. What comes from coarser ones looks at places before it: with
 * SMALL half a line before where H is a multiple of 4 (its corners are not aligned), with RESNET34
 * by up to one line (x2) or three (x3) towards the end of even sizes. A map of m lines ends at line
 * stride (m - 1) of the image; the image's last line may lie behind that, by less than one line of
 * the map. */
long lf_feature_net_stride(const lf_feature_net *net);

/* Multiply-adds of the convolutions of one image, forward. */
double lf_feature_net_macs(const lf_feature_net *net, long height, long width);
/* Numbers that training keeps of one image: images with borders, results of convolutions, norms,
 * resized and joined maps. */
double lf_feature_net_kept(const lf_feature_net *net, long height, long width);

#endif
