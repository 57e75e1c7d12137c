/* validate.c: loss and sign agreement on shapes that are not trained on. */
#include "train/recon_data.h"

enum { V = LF_CUBE_VIEWS, POINTS = 2048 };

typedef struct overlap {
    double loss;
    long both, either;
} overlap;

/* NaN stays NaN, so that a broken model never is the best one. */
static double clip(double x, double most)
{
    return x < -most ? -most : x > most ? most : x;
}

/* The first POINTS / 2 stored points of either kind; IoU over the uniform ones. */
static overlap validate_shape(lf_recon_work *work, const lf_config *cfg, const lf_shapes *shapes,
                              long index, lf_projection *projection)
{
    const long stored_uniform = lf_config_int(cfg, "data.points_uniform");
    const long stored_near = lf_config_int(cfg, "data.points_near");
    const long uniform = stored_uniform < POINTS / 2 ? stored_uniform : POINTS / 2;
    const long near = stored_near < POINTS / 2 ? stored_near : POINTS / 2;
    const lf_shape_views *views = lf_shapes_views(shapes, index, 0);
    const float(*samples)[4] = lf_shapes_samples(shapes, index);
    double(*point)[3] = calloc(POINTS, sizeof *point);
    float truth[POINTS], sdf[POINTS];
    LF_REQUIRE(point, "out of memory for %d points", POINTS);
    const long n = uniform + near;
    for (long i = 0; i < n; i++) {
        const long k = i < uniform ? i : stored_uniform + i - uniform;
        for (int a = 0; a < 3; a++)
            point[i][a] = (double)samples[k][a];
        truth[i] = samples[k][3];
    }
    lf_projection_fill(projection, 0, n, (const double(*)[3])point, views, 0);
    const lf_recon_points points = lf_seen_points(projection, n);
    const double scale = lf_config_real(cfg, "loss.scale"),
                 clamp = lf_config_real(cfg, "loss.clamp");
    lf_recon_predict(work, &points, scale, sdf, NULL);
    overlap a = {0};
    for (long i = 0; i < n; i++) {
        const double t = clip((double)truth[i], clamp), p = clip((double)sdf[i], clamp);
        const double w = (double)truth[i] <= lf_config_real(cfg, "loss.near")
                             ? lf_config_real(cfg, "loss.near_weight")
                             : 1;
        a.loss += w * scale * fabs(t - p) / (double)n;
        a.both += i < uniform && truth[i] < 0 && sdf[i] < 0;
        a.either += i < uniform && (truth[i] < 0 || sdf[i] < 0);
    }
    free(point);
    return a;
}

lf_agreement lf_validate_shapes(lf_recon_work *work, const lf_recon *model, const lf_config *cfg,
                                const lf_shapes *shapes)
{
    const long size = lf_config_int(cfg, "data.image_size"), count = lf_shapes_count(shapes);
    const long numbers = V * size * size * (lf_config_is(cfg, "data.channels", "colour") ? 4 : 2);
    float *pixels = calloc((size_t)numbers, sizeof *pixels);
    lf_real *image = calloc((size_t)numbers, sizeof *image);
    LF_REQUIRE(pixels && image, "out of memory for %ld pixels", numbers);
    lf_projection projection = lf_projection_create(POINTS);
    lf_seen_grid grid = lf_seen_grid_create(model, 1);
    lf_agreement v = {0};
    for (long s = 0; s < count; s++) {
        lf_shapes_pixels(lf_shapes_views(shapes, s, 0)->images, numbers, pixels);
        for (long i = 0; i < numbers; i++)
            image[i] = (lf_real)pixels[i];
        lf_seen_grid_fill(&grid, 0, lf_shapes_views(shapes, s, 0), 0);
        const lf_recon_images images = {V, V, image, lf_seen_grid_points(&grid)};
        lf_recon_encode(work, &images);
        const overlap a = validate_shape(work, cfg, shapes, s, &projection);
        v.loss += a.loss / (double)count;
        v.iou += (a.either ? (double)a.both / (double)a.either : 1) / (double)count;
    }
    lf_seen_grid_free(&grid);
    lf_projection_free(&projection);
    free(pixels);
    free(image);
    return v;
}
