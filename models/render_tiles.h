/* render_tiles.h: what training and evaluation of the renderers share. Internal to models/. */
#ifndef LF_MODELS_RENDER_TILES_H
#define LF_MODELS_RENDER_TILES_H

#include "models/render_work.h"

typedef struct lf_render_lane {
    lf_real *grad; /* of the networks */
    lf_real *maps; /* gradient of the feature maps */
    long maps_room;
    double loss;
    char nonfinite[64]; /* of the first tile that had one; the tape forgets it at the next tile */
} lf_render_lane;

struct lf_render_work {
    const lf_renderer *model;
    long tile, head_size;
    lf_tape *features;
    lf_tape *worker[LF_RENDER_LANES]; /* one a thread; any tile may run on any of them */
    lf_render_lane lane[LF_RENDER_LANES];
    long views, views_room;
    const lf_source *source;
    lf_view_map *view; /* [views] */
    lf_tensor **map;   /* [views] on `features`; one tensor for all where they have one size */
    long batches;      /* tensors in map */
    lf_real *maps;     /* all maps, one after the other */
    long maps_size, maps_room;
};

/* Rays of a tile with the depths of their samples. */
typedef struct lf_ray_tile {
    const lf_target_rays *rays;
    long from, count, samples;
    const double *depth; /* [count, samples] */
    bool white;
} lf_ray_tile;

typedef struct lf_passed {
    lf_rendered rendered;
    const lf_light_geometry *geometry; /* the tape's: backward looks at it */
} lf_passed;

/* Threads that take tiles: at most one a lane. */
int lf_render_workers(void);
/* Maps of the views on the features' tape, together, or one by one where sizes differ. */
void lf_render_maps(lf_render_work *work, long views, const lf_source *source);
/* One network on the rays of a tile; `maps` is a leaf of work->maps. */
lf_passed lf_render_pass(lf_tape *tape, const lf_render_work *work, const lf_ray_tile *tile,
                         int network, lf_tensor *maps);

#endif
