/* scene_make_internal.h: the world of a built-in scene; own to datasets/scene_make*. */
#ifndef LF_DATASETS_SCENE_MAKE_INTERNAL_H
#define LF_DATASETS_SCENE_MAKE_INTERNAL_H

#include "datasets/render.h"
#include "datasets/scene_make.h"

enum { LF_WAVES = 8, LF_PAINTS_MAX = 8 };

/* What a random number of (seed, LF_RANDOM_SCENE, part, index) is for; views and paints add their
 * number. */
enum {
    LF_PART_WORLD,
    LF_PART_VIEWS,
    LF_PART_PAINT = 16,
    LF_PART_TRAIN = 1 << 16,
    LF_PART_TEST = 1 << 24
};

/* albedo = (1 - mix) face colour + mix tint + sum of waves              [scene_make.h] */
typedef struct lf_paint {
    double mix, tint[3];
    /* turns a unit along x, y, z; turns; of red, green, blue */
    double wave[3][LF_WAVES], phase[LF_WAVES], amplitude[3][LF_WAVES];
} lf_paint;

typedef struct lf_world {
    lf_mesh *mesh; /* z up */
    lf_surface *surface;
    int paints; /* paint i covers the faces [first[i], first[i + 1]) */
    long first[LF_PAINTS_MAX + 1];
    lf_paint paint[LF_PAINTS_MAX];
    double light[3];  /* unit, towards it */
    double highlight; /* strength of the lobe, 0: none */
    double depth;     /* FORWARD: of the back wall */
} lf_world;

/* What the options name; free it with lf_world_free. Errors as lf_scene_make. */
lf_status lf_world_make(const lf_scene_make_options *options, lf_world **out, lf_error *err);
void lf_world_free(lf_world *world);

/* Waves of `scale` times the usual frequency and `strength` times the amplitude, mix 0.3 to 0.7. */
lf_paint lf_paint_random(lf_stream *stream, double scale, double strength);

/* lf_shader with context lf_world: red, green, blue of the point, coverage. */
void lf_world_shade(const void *world, const lf_hit *hit, const double point[3],
                    const double direction[3], double *sum);

/* Camera of view `number` of a split (train or test). */
lf_camera lf_world_camera(const lf_world *world, const lf_scene_make_options *options, bool test,
                          long number);

/* x, y, z of a world with y up in the one with z up: (x, -z, y). */
void lf_world_turn(double rotation[9]);

#endif
