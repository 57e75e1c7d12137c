/* recon_network.h: the face of a reconstruction network: what it is told of points, and what it
 * does. A network is a table of functions; recon.c lists them, recon_work.c runs any of them.
 *
 *   images -> maps of every view (and, for some networks, something of each object as a whole)
 *   points -> bilinear samples of the maps at their projections (and what is known of the object)
 *          -> 10 * signed distance
 *
 * Sizes: Q points, V views, F numbers of a point and view, G of a point without view. An object is
 * V images in a row: that of point q is number first[q] / V. Unit: the box diagonal of the object.
 */
#ifndef LF_MODELS_RECON_NETWORK_H
#define LF_MODELS_RECON_NETWORK_H

#include "configs/configs.h"
#include "layers/layers.h"
#include "models/backbone.h"

/* What is known of Q points and the views that may see them; all arrays are the caller's. The
 * object's frame is the one that shapes of a category share; the cameras' may be turned to it. */
typedef struct lf_recon_points {
    long count, views;
    const double *uv;        /* [Q, V, 2] pixels */
    const double *direction; /* [Q, V, 3] unit, camera to point, in the cameras' frame */
    const double *distance;  /* [Q, V] camera to point */
    const uint8_t *mask;     /* [Q, V] 1 = seen */
    const long *first;       /* [Q] the point's first image among the images */
    const double *position;  /* [Q, 3] in the object's frame */
    const double *bearing;   /* [Q, V, 3] the directions in the object's frame */
} lf_recon_points;

/* The points [from, from + count) of these. */
static inline lf_recon_points lf_recon_slice(const lf_recon_points *p, long from, long count)
{
    const long at = from * p->views;
    return (lf_recon_points){count,
                             p->views,
                             p->uv + 2 * at,
                             p->direction + 3 * at,
                             p->distance + at,
                             p->mask + at,
                             p->first + from,
                             p->position + 3 * from,
                             p->bearing + 3 * at};
}

/* What is computed once of all images: maps to sample, and what a network makes of them. */
typedef struct lf_recon_code {
    long views; /* of an object, in a row */
    int inner_maps, maps;
    lf_tensor *inner[LF_BACKBONE_MAPS];   /* the backbone's, before scalars are taken */
    lf_tensor *map[LF_BACKBONE_MAPS + 1]; /* scalar maps, the images last if they are sampled */
    lf_tensor *object;                    /* of every object, or NULL */
} lf_recon_code;

/* What a network gets of Q points. */
typedef struct lf_recon_inputs {
    lf_tensor *seen;               /* [Q, V, F] samples of the maps; 0 where masked */
    lf_tensor *known;              /* [Q, G] of the object as a whole, or NULL */
    lf_ray_geometry rays;          /* directions and mask of `points` as tensors */
    const lf_recon_points *points; /* these Q points */
} lf_recon_inputs;

typedef struct lf_recon lf_recon;               /* recon.h */
typedef struct lf_recon_config lf_recon_config; /* recon.h */

/* What one image, object and point cost, by formula. */
typedef struct lf_recon_cost {
    double image, object, point;                /* multiply-adds, useful ones, forward */
    double image_kept, object_kept, point_kept; /* numbers that training keeps, from below */
} lf_recon_cost;

typedef struct lf_recon_network {
    const char *type; /* the word of model.type */
    /* The network's keys, into its part of the config; images and backbone are read already. */
    void (*configure)(const lf_config *cfg, lf_recon_config *config);
    /* Register the parameters, in this order: of images and objects (lf_recon_backbone_init), then,
     * from model->head_first on, of points. Sets feature_count, and model->net to its own memory,
     * which is freed with the model. */
    void (*init)(lf_recon *model);
    /* What the backbone sees of images [N, H, W, C]; NULL: the images. */
    lf_tensor *(*view)(lf_tape *tape, const lf_recon *model, lf_tensor *images);
    /* Something of every object as a whole, from what is in `code` already; `grid` tells how the
     * views see the points of the network's grid (lf_recon_grid). And what is known of it at
     * points: [Q, G]. Both NULL: there is nothing. */
    lf_tensor *(*object)(lf_tape *tape, const lf_recon *model, bool training,
                         const lf_recon_code *code, const lf_recon_points *grid);
    lf_tensor *(*recall)(lf_tape *tape, const lf_recon *model, lf_tensor *object,
                         const lf_recon_points *points);
    /* 10 times the signed distance, [Q, 1]; `layers`, if not NULL, gets model->layers fields. */
    lf_tensor *(*sdf)(lf_tape *tape, const lf_recon *model, const lf_recon_inputs *in,
                      lf_field *layers);
    /* Adds to a cost that has the backbone and the sampling of points already. */
    void (*cost)(const lf_recon *model, long views, lf_recon_cost *cost);
} lf_recon_network;

#endif
