/* recon.h: the reconstruction model: posed images -> signed distance at any point. [method.md 5a]
 *
 *   images [N,H,W,C] -> backbone -> scalar maps, and the images themselves as one more map
 *   -> bilinear samples at the projections of a point (and its depth code)        [Q, V, F]
 *   -> ray -> point convolution -> blocks of ray update and attention -> (F0, F1) of each
 *   -> vector neuron readout, MLP -> 10 * signed distance                          [Q, 1]
 *
 * Without vectors the readout is left out; with max_pool all between samples and MLP but a maximum
 * over the views.                                                              [method.md 5a.10]
 *
 * A model is its config and pointers into a parameter store. It knows no cameras and no files: what
 * it is given of a point are its projections, unit directions, distances and visibility.
 */
#ifndef LF_MODELS_RECON_H
#define LF_MODELS_RECON_H

#include "configs/configs.h"
#include "layers/layers.h"
#include "models/backbone.h"

enum { LF_RECON_BLOCKS = 6 };

typedef struct lf_recon_config {
    lf_backbone_config backbone;
    long image_size;   /* pixels an edge */
    bool sample_image; /* the images are one more map */
    int depth_octaves; /* 0: no depth code; else 1 + 2 * octaves numbers a ray */
    bool max_pool;     /* no convolution, no blocks: the maximum over the views */
    lf_transformer_config block;
    int blocks; /* 0 with max_pool */
    int mlp_widths;
    long mlp[LF_MLP_MAX];
} lf_recon_config;

/* The [model] and [data] keys of a config. */
lf_recon_config lf_recon_config_from(const lf_config *cfg);

typedef struct lf_recon {
    lf_recon_config config;
    lf_store *store; /* the caller's */
    lf_backbone backbone;
    lf_ray_convolution convolution;
    lf_transformer_block block[LF_RECON_BLOCKS];
    lf_vector_neuron readout;
    bool has_readout;
    lf_mlp head;
    long feature_count; /* F: numbers a ray, depth code included */
    long head_first;    /* offset in the store of the first parameter behind the sampling */
} lf_recon;

/* Register all parameters in `store`, which must outlive the model. */
void lf_recon_init(lf_recon *model, lf_store *store, const lf_recon_config *config);
void lf_recon_free(lf_recon *model);

/* Maps of images [N, H, W, C], the images themselves last if they are sampled; returns their
 * number. */
int lf_recon_maps(lf_tape *tape, const lf_recon *model, lf_tensor *images, bool training,
                  lf_tensor *maps[LF_BACKBONE_MAPS + 1]);
/* Numbers a ray without the depth code: the maps' channels together. */
long lf_recon_sampled(const lf_recon *model);

/* Signed distance times 10 of Q points: seen [Q, V, lf_recon_sampled], distance [Q, V] from camera
 * to point (unit: box diagonal; used by the depth code only). -> [Q, 1]. `layers`, if not NULL,
 * gets the point features after the convolution (or the maximum) and each block (blocks + 1
 * fields). */
lf_tensor *lf_recon_sdf(lf_tape *tape, const lf_recon *model, lf_tensor *seen,
                        const lf_ray_geometry *rays, const double *distance, lf_field *layers);

#endif
