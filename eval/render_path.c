/* render_path.c: frames along a path, and how far a moved frame moves the picture. */
#include <limits.h>

#include "eval/file_names.h"
#include "eval/image_metrics.h"
#include "eval/render_job.h"
#include "eval/report.h"
#include "train/progress.h"
#include "train/run_dir.h"

/* ---- a path ------------------------------------------------------------------------------------
 */

static lf_status render_frame(lf_loaded_renderer *l, const lf_scene_entry *entry,
                              const lf_camera *camera, const char *path, lf_error *err)
{
    const lf_render_view_options o = {.sources = lf_render_sources(l)};
    lf_render_view v;
    LF_TRY(lf_render_camera_open(entry, camera, &o, &v, err));
    lf_rendering r = lf_render_whole(l, &v);
    const lf_status status = lf_image_write_png(path, r.image, err);
    lf_rendering_free(&r);
    lf_render_view_release(&v);
    return status;
}

static lf_status render_scene(lf_loaded_renderer *l, const lf_render_job *job, lf_path_kind kind,
                              const lf_scene_entry *entry, const char *name, lf_error *err)
{
    char folder[PATH_MAX / 2], path[PATH_MAX], line[PATH_MAX + 256];
    const int length = snprintf(folder, sizeof folder, "%s/%s", job->out, name);
    if (length < 0 || length >= (int)sizeof folder)
        return lf_fail(err, LF_BAD_INPUT, "--out %s: the name is too long", job->out);
    LF_TRY(lf_make_folders(folder, err));
    lf_camera *camera = calloc((size_t)job->frames, sizeof *camera);
    LF_REQUIRE(camera, "out of memory for %ld frames", job->frames);
    lf_status status = lf_camera_path(kind, entry->scene, entry->centre, job->frames, camera, err);
    const double started = lf_seconds_now();
    lf_progress progress = lf_progress_start(stdout, "frame", 0, job->frames, job->quiet);
    for (long i = 0; status == LF_OK && i < job->frames; i++) {
        snprintf(path, sizeof path, "%s/frame-%04ld.png", folder, i);
        status = render_frame(l, entry, &camera[i], path, err);
        lf_progress_update(&progress, i + 1, lf_seconds_now() - started, "%s", name);
    }
    lf_progress_end(&progress);
    free(camera);
    lf_camera_path_ffmpeg(line, sizeof line, folder, 24);
    if (status == LF_OK && !job->quiet)
        printf("frames: %s; a video of them:\n%s\n", folder, line);
    return status == LF_OK ? LF_OK : lf_error_context(err, status, "%s", entry->name);
}

lf_status lf_render_path(lf_loaded_renderer *l, const lf_render_job *job, lf_error *err)
{
    lf_path_kind kind;
    lf_scene_set *set;
    LF_TRY(lf_path_kind_parse(job->path, &kind, err));
    if (!job->out)
        return lf_fail(err, LF_BAD_INPUT, "--path %s: give --out for the frames", job->path);
    LF_TRY(lf_render_job_scenes(l, job, &set, err));
    lf_status status = LF_OK;
    char **name = lf_scene_file_names(set);
    const long scenes = job->scenes > 0 && job->scenes < set->count ? job->scenes : set->count;
    for (long i = 0; status == LF_OK && i < scenes; i++)
        status = render_scene(l, job, kind, &set->entry[i], name[i], err);
    lf_file_names_free(set->count, name);
    lf_scene_set_close(set);
    return status;
}

/* ---- a moved frame -----------------------------------------------------------------------------
 */

typedef struct moved {
    double colour, depth; /* largest difference; of the depth, relative to far - near */
    double psnr_low, psnr_high;
    double variance;
} moved;

static void compare(const lf_rendering *a, const lf_rendering *b, double range, moved *m)
{
    const long n = (long)a->image->width * a->image->height;
    for (long i = 0; i < 3 * n; i++)
        m->colour = fmax(m->colour, fabs((double)a->image->pixel[i] - (double)b->image->pixel[i]));
    for (long i = 0; i < n; i++)
        if (isfinite(a->depth[i]) && isfinite(b->depth[i]))
            m->depth = fmax(m->depth, fabs((double)a->depth[i] - (double)b->depth[i]) / range);
}

static lf_status check_view(lf_loaded_renderer *l, const lf_scene_entry *entry, long target,
                            long count, moved *m, lf_error *err)
{
    lf_rendering *r = calloc((size_t)count + 1, sizeof *r);
    const lf_image **image = calloc((size_t)count + 1, sizeof *image);
    LF_REQUIRE(r && image, "out of memory");
    lf_image *truth = NULL;
    lf_status status = LF_OK;
    for (long k = 0; status == LF_OK && k <= count; k++) {
        lf_stream s = lf_stream_at(1, LF_RANDOM_GROUP, (uint64_t)k, 5);
        const lf_motion motion = lf_motion_random(&s, 1000 * fmax(entry->radius, 1));
        const lf_render_view_options o = {.sources = lf_render_sources(l),
                                          .motion = k ? &motion : NULL};
        lf_render_view v;
        status = lf_render_view_open(entry, target, &o, &v, err);
        if (status != LF_OK)
            break;
        if (!truth)
            truth = lf_picture_of(&v.pixels);
        r[k] = lf_render_whole(l, &v);
        image[k] = r[k].image;
        double psnr;
        status = lf_psnr(r[k].image, truth, &psnr, err);
        m->psnr_low = k ? fmin(m->psnr_low, psnr) : psnr;
        m->psnr_high = k ? fmax(m->psnr_high, psnr) : psnr;
        compare(&r[0], &r[k], v.far - v.near, m);
        lf_render_view_release(&v);
    }
    if (status == LF_OK)
        status = lf_pixel_variance((int)count + 1, image, &m->variance, err);
    for (long k = 0; k <= count; k++)
        lf_rendering_free(&r[k]);
    lf_image_free(truth);
    free(r);
    free(image);
    return status;
}

lf_status lf_render_check(lf_loaded_renderer *l, const lf_render_job *job, long count,
                          lf_error *err)
{
    lf_scene_set *set;
    LF_TRY(lf_render_job_scenes(l, job, &set, err));
    json_t *rows = json_array();
    char **name = lf_scene_file_names(set);
    lf_status status = LF_OK;
    if (!job->quiet)
        printf("%ld random motions of the frame, translations to 1000 radii; one view a "
               "scene\n%-16s %14s %14s %18s %16s\n",
               count, "scene", "colour moves", "depth moves", "PSNR, dB", "pixel variance");
    const long scenes = job->scenes > 0 && job->scenes < set->count ? job->scenes : set->count;
    for (long i = 0; status == LF_OK && i < scenes; i++) {
        long targets;
        const long *target = lf_render_targets(&set->entry[i], job->split, &targets);
        moved m = {0};
        status = check_view(l, &set->entry[i], target[0], count, &m, err);
        if (status != LF_OK)
            break;
        if (!job->quiet)
            printf("%-16s %14.2g %14.2g %8.3f - %7.3f %16.3g\n", name[i], m.colour, m.depth,
                   m.psnr_low, m.psnr_high, m.variance);
        json_t *row = json_object();
        json_object_set_new(row, "scene", json_string(name[i]));
        json_object_set_new(row, "colour", json_real(m.colour));
        json_object_set_new(row, "depth", json_real(m.depth));
        json_object_set_new(row, "psnr_lowest", json_real(m.psnr_low));
        json_object_set_new(row, "psnr_highest", json_real(m.psnr_high));
        json_object_set_new(row, "pixel_variance", json_real(m.variance));
        json_array_append_new(rows, row);
    }
    lf_file_names_free(set->count, name);
    lf_scene_set_close(set);
    json_t *all = json_object();
    json_object_set_new(all, "experiment", json_string("rendering equivariance"));
    json_object_set_new(all, "motions", json_integer(count));
    json_object_set_new(all, "scenes", rows);
    if (status == LF_OK && job->json)
        status = lf_json_write(job->json, all, err);
    json_decref(all);
    return status;
}
