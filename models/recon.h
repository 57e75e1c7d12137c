/* recon.h: the reconstruction models: posed images -> signed distance at any point. [method.md 5a]
 *
 *   images [N,H,W,C] -> backbone -> scalar maps, and the images themselves as one more map
 *   -> bilinear samples at the projections of a point                              [Q, V, F]
 *   -> the network of the config (recon_network.h) -> 10 * signed distance         [Q, 1]
 *
 * A model is its config and pointers into a parameter store. It knows no cameras and no files: what
 * it is given of a point is in lf_recon_points.
 */
#ifndef LF_MODELS_RECON_H
#define LF_MODELS_RECON_H

#include "models/recon_network.h"

enum { LF_RECON_BLOCKS = 6, LF_RECON_LAYERS = LF_RECON_BLOCKS + 1, LF_FVOR_LEVELS = 8 };

struct lf_recon_config {
    const lf_recon_network *network;
    lf_backbone_config backbone; /* its in_channels: those of the images */
    long image_size;             /* pixels an edge */
    bool sample_image;           /* the images are one more map */
    int mlp_widths;              /* of the last MLP */
    long mlp[LF_MLP_MAX];
    long width; /* ibrnet-sdf: numbers of a point behind the aggregation */
    /* equivariant */
    int depth_octaves; /* 0: no depth code; else 1 + 2 * octaves numbers a ray */
    bool max_pool;     /* no convolution, no blocks: the maximum over the views */
    lf_transformer_config block;
    int blocks;
    /* disn */
    struct {
        int point_widths;
        long point[LF_MLP_MAX]; /* widths of the MLP on positions */
        long global;            /* numbers of an object */
    } disn;
    /* fvor */
    struct {
        int levels, fields[LF_FVOR_LEVELS]; /* of the volume's U-Net, 8 channels each */
        long grid;                          /* voxels along an edge */
    } fvor;
};

/* The [model] and [data] keys of a config. */
lf_recon_config lf_recon_config_from(const lf_config *cfg);

struct lf_recon {
    lf_recon_config config;
    lf_store *store; /* the caller's */
    lf_backbone backbone;
    void *net;          /* the network's own */
    long feature_count; /* F */
    long head_first;    /* offset in the store of the first parameter behind the sampling */
    int layers;         /* fields that lf_recon_sdf can show, at most LF_RECON_LAYERS */
    long grid;          /* points along an edge of the network's grid; 0: none */
};

/* Register all parameters in `store`, which must outlive the model. */
void lf_recon_init(lf_recon *model, lf_store *store, const lf_recon_config *config);
void lf_recon_free(lf_recon *model);

/* For a network's init: the backbone, for images of so many more channels, and feature_count. */
void lf_recon_backbone_init(lf_recon *model, int more_channels);

/* The points of a network's grid, grid^3 of them, x fastest, in the object's frame: over the cube
 * of edge 1 at the origin, corners included. */
void lf_recon_grid(const lf_recon *model, double (*point)[3]);

/* Maps (and objects) of images [N, H, W, C], `views` in a row of each object; `grid` as in
 * lf_recon_network, NULL where there is no grid. The code's tensors are the tape's. */
void lf_recon_encode_images(lf_tape *tape, const lf_recon *model, lf_tensor *images, long views,
                            const lf_recon_points *grid, bool training, lf_recon_code *code);
/* What the images show of the points, and what is known of their objects there, on `tape`. The
 * arrays of `points` are used until the backward is done. */
lf_recon_inputs lf_recon_look(lf_tape *tape, const lf_recon *model, const lf_recon_code *code,
                              const lf_recon_points *points);
/* Signed distance times 10 of Q points -> [Q, 1]. `layers`, if not NULL, gets the point features
 * inside the network, model->layers of them. */
lf_tensor *lf_recon_sdf(lf_tape *tape, const lf_recon *model, const lf_recon_inputs *in,
                        lf_field *layers);

/* For a network's recall: the number of each point's object, [Q] on the tape. */
const long *lf_recon_objects(lf_tape *tape, const lf_recon_points *points);

lf_recon_cost lf_recon_costs(const lf_recon *model, long views);

#endif
