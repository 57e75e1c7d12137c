/* scene_colmap.h: a sparse model in memory, between its files and a scene; own to scene_colmap*. */
#ifndef LF_DATASETS_SCENE_COLMAP_H
#define LF_DATASETS_SCENE_COLMAP_H

#include "datasets/scene_internal.h"

typedef struct lf_colmap_camera {
    long id;
    int width, height;
    double fx, fy, cx, cy;
} lf_colmap_camera;

typedef struct lf_colmap_seen {
    double u, v; /* file's pixels */
    int64_t point;
} lf_colmap_seen;

typedef struct lf_colmap_image {
    double q[4], t[3]; /* world to camera; w, x, y, z */
    long camera;
    char *name;
    long seen;
    lf_colmap_seen *observation; /* [seen], those with a point */
} lf_colmap_image;

typedef struct lf_colmap_point {
    int64_t id;
    double at[3];
} lf_colmap_point;

typedef struct lf_colmap {
    long cameras, images, points;
    lf_colmap_camera *camera;
    lf_colmap_image *image;
    lf_colmap_point *point;
} lf_colmap;

/* On failure the model holds what was read; lf_colmap_free frees it either way. points3D may be
 * missing. */
lf_status lf_colmap_read_text(const char *folder, lf_colmap *model, lf_error *err);
lf_status lf_colmap_read_binary(const char *folder, lf_colmap *model, lf_error *err);
void lf_colmap_free(lf_colmap *model);

/* Index of a camera model by name, or by COLMAP's number if name is NULL; -1: not read. */
int lf_colmap_model(const char *name, int id);
int lf_colmap_parameters(int model);
/* Focal lengths and centre from the parameters; refuses distortion. */
lf_status lf_colmap_set_lens(const char *where, int model, const double *parameter,
                             lf_colmap_camera *camera, lf_error *err);
/* Room for one more; the new element is 0. */
lf_colmap_camera *lf_colmap_more_cameras(lf_colmap *model);
lf_colmap_image *lf_colmap_more_images(lf_colmap *model);
lf_colmap_point *lf_colmap_more_points(lf_colmap *model);
void lf_colmap_see(lf_colmap_image *image, double u, double v, int64_t point);

#endif
