/* render_report.h: the figures of a rendering evaluation as JSON and as a table; docs/formats.md
 * has the format.
 *
 * JSON keys: experiment ("rendering"), model, train_setting, eval_setting, split, sources, samples,
 * scenes, images, mean_over_scenes, mean_over_images, peak_rss_mb, metric, per_scene, per_image.
 * Means are plain: of a scene over its images; mean_over_scenes over those means, so that each
 * scene weighs the same; mean_over_images over all images, so that each image does. A figure that
 * an image lacks is NaN here and null in JSON, and so is every mean over that image.
 */
#ifndef LF_EVAL_RENDER_REPORT_H
#define LF_EVAL_RENDER_REPORT_H

#include <stdio.h>

#include <jansson.h>

#include "eval/baselines.h"
#include "eval/lpips.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Of one image, or means. NaN: not available. */
typedef struct lf_render_figures {
    double psnr;           /* dB */
    double ssim, lpips;    /* lpips only with weights */
    double pixel_variance; /* of renderings in several frames, values 0..255; setting SO3 only */
    double seconds;        /* for the whole image */
    double rows; /* (sample, source view) pairs given to the networks, coarse and fine, seen or
                    not; a whole number for an image */
    double baseline[LF_BASELINES]; /* PSNR of copy, mean, sweep, dB */
} lf_render_figures;

typedef struct lf_render_image {
    long number;                /* of the scene: what tells scenes apart */
    char scene[256], view[256]; /* UTF-8; longer names are cut */
    lf_render_figures figures;
} lf_render_image;

/* Fill the strings (borrowed; NULL is written as "") and numbers; images come by
 * lf_render_report_add. */
typedef struct lf_render_report {
    const char *model, *train_setting, *eval_setting, *split;
    int sources, samples;  /* source views an image, samples a ray */
    const lf_lpips *lpips; /* borrowed, for its definition; NULL: not available */
    double peak_rss_mb;
    long images, room;
    lf_render_image *image;
} lf_render_report;

/* All NaN: fill in what is known. */
lf_render_figures lf_render_figures_none(void);
/* Append one image of scene `number`; psnr, ssim, seconds and rows must be finite. */
void lf_render_report_add(lf_render_report *report, long number, const char *scene,
                          const char *view, const lf_render_figures *figures);
/* Free the images; the report may be filled again. */
void lf_render_report_clear(lf_render_report *report);

/* Is image `image` the first of its scene? Scenes are counted in the order in which they come. */
bool lf_render_report_new_scene(const lf_render_report *report, long image);
/* Means over the images of scene `number`, or over all images if it is -1; all NaN if there are
 * none. */
lf_render_figures lf_render_report_mean(const lf_render_report *report, long number);
/* Mean over scenes of their means. */
lf_render_figures lf_render_report_scene_mean(const lf_render_report *report);

/* The whole report, a new reference; NULL if the file of the LPIPS weights is not named in UTF-8.
 */
json_t *lf_render_report_json(const lf_render_report *report);
/* Replace the file whole or not at all (lf_json_write). */
lf_status lf_render_report_write(const lf_render_report *report, const char *path, lf_error *err);
/* Draw seconds against millions of rows, a dot an image: what is left out costs nothing. PNG;
 * errors of lf_plot_write. */
lf_status lf_render_report_plot(const lf_render_report *report, const char *png, lf_error *err);
/* The same as a table: images, scenes, both means, and what the columns mean. "-": not available.
 */
void lf_render_report_print(const lf_render_report *report, FILE *out);

#ifdef __cplusplus
}
#endif
#endif
