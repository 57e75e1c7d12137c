/* scene_make.h: built-in scenes: posed pictures of made-up objects, for training without data.
 *
 * Objects (GLOSSY, DIFFUSE): one object whose box has a diagonal of 1.9 to 2.5, centred at the
 * origin, z up; cameras at a distance of 3.8 to 4.2 over the sphere's cap z > -0.1, looking at the
 * origin; focal length 1.389 x size; near 2.6, far 5.6; white ground, alpha = coverage.
 * FORWARD: a closed room of 4.4 to 5.6 x 3 to 3.6 units, 6 deep, with four to six objects in it;
 * cameras on a patch of 2 x 1.2 before it that look along y at a common point; near and far
 * of a view are 0.95 and 1.05 times the least and largest depth that its pixel centres meet.
 *
 *   albedo(p)   = clamp((1 - m) face colour + m tint + sum_j a_j sin(k_j . p + phi_j)), 8 waves
 *   colour(p,v) = albedo (0.5 + 0.1 n_z + 0.45 max(0, n . l)) + g max(0, v . r)^24
 * n unit normal turned to the viewer, l to the light, r its mirror image at n, v to the viewer;
 * k_j ~ N(0, 7) radians a unit and coordinate, a_j ~ N(0, 0.16) a channel (the walls of a room:
 * half and 0.6 of it, the objects in it all and 0.8); g is 0.3 to 0.7, times `highlight`, for
 * GLOSSY where n . l > 0 and 0 otherwise, so that there a point looks the same from everywhere. No
 * shadows.
 *
 * (kind, seed, index) names a scene: the same for every number of threads; view i of a split does
 * not depend on how many there are. GLOSSY and DIFFUSE of one seed and index have the same object,
 * paint, light and cameras.
 */
#ifndef LF_DATASETS_SCENE_MAKE_H
#define LF_DATASETS_SCENE_MAKE_H

#include "datasets/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum lf_scene_kind {
    LF_KIND_GLOSSY,  /* an object on white with a highlight, cameras all around */
    LF_KIND_DIFFUSE, /* the same without */
    LF_KIND_FORWARD, /* a room, cameras on a patch; every pixel shows something */
    LF_SCENE_KINDS
} lf_scene_kind;

typedef struct lf_scene_make_options {
    lf_scene_kind kind;
    uint64_t seed, index;
    int size; /* 8 ... 4096: width = height; FORWARD: width, and height = 3/4 of it, made even */
    long train_views, test_views; /* at least 1, at least 0; 10000 together at most */
    int rays;                     /* rays x rays a pixel, 1 ... 16 */
    double highlight;             /* GLOSSY: times as strong, 0 ... 100; colours end at 1 */
    const char *mesh; /* file of the object (FORWARD: of the first one), y up; NULL: a chair, an
                         airplane or a car of procedural.h by turns of the index, the turns
                         shifted by one after each three */
} lf_scene_make_options;

/* GLOSSY, seed 0, index 0, 100 pixels, 35 and 5 views, 3 rays, highlight 1, no mesh. */
lf_scene_make_options lf_scene_make_defaults(void);

/* "glossy", "diffuse", "forward"; LF_BAD_INPUT names them. */
const char *lf_scene_kind_name(lf_scene_kind kind);
lf_status lf_scene_kind_parse(const char *name, lf_scene_kind *out, lf_error *err);

/* Make a scene in memory; the caller closes it. Train views follow a low-discrepancy sequence, test
 * views are random, both over the same cap or patch. Views 0, 8, 16, ... are the test views as long
 * as there are any, the rest of them come last: with test = ceil(all / 8) layouts without a split
 * read the same one. LF_BAD_INPUT: options out of range, the errors of lf_mesh_read,
 * lf_mesh_normalise and lf_surface_open with the path of the mesh. */
lf_status lf_scene_make(const lf_scene_make_options *options, lf_scene **out, lf_error *err);

#ifdef __cplusplus
}
#endif
#endif
