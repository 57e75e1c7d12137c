/* main.c: elf-eval. Reads the command line and hands over to one of its jobs. */
#include <omp.h>

#include "eval/check_data.h"
#include "eval/compare.h"
#include "eval/compare_runs.h"
#include "eval/curves.h"
#include "eval/equivariance.h"
#include "eval/measure.h"
#include "eval/options.h"
#include "eval/reproduction.h"
#include "eval/speed_error.h"
#include "models/checkpoint.h"
#include "train/openmp.h"
#include "train/run_dir.h"

static lf_status run_compare(const lf_arguments *a, lf_error *err)
{
    if (a->words != 3)
        return lf_fail(err, LF_BAD_INPUT,
                       "compare-meshes takes two mesh files: the predicted and "
                       "the true one");
    static const int used[] = {OPT_JSON,  OPT_EXACT, OPT_NORMALISE, OPT_SAMPLES, OPT_THREADS,
                               OPT_QUIET, 0};
    LF_TRY(lf_options_only(a, "compare-meshes", used, err));
    lf_compare_options options = lf_compare_defaults();
    options.normalise = a->normalise;
    options.metric.exact = a->evaluate.exact;
    options.json = a->evaluate.json;
    if (a->samples)
        options.metric.samples = a->samples;
    if (options.json)
        LF_TRY(lf_options_report(options.json, err));
    return lf_compare_meshes(a->word[1], a->word[2], &options, a->evaluate.quiet ? NULL : stdout,
                             err);
}

static lf_status run_compare_images(const lf_arguments *a, lf_error *err)
{
    if (a->words != 3)
        return lf_fail(err, LF_BAD_INPUT, "compare-images takes two image files of one size");
    static const int used[] = {OPT_JSON,    OPT_LPIPS_WEIGHTS, OPT_LPIPS_NET,
                               OPT_THREADS, OPT_QUIET,         0};
    LF_TRY(lf_options_only(a, "compare-images", used, err));
    if (!a->images.weights && lf_option_given(a, OPT_LPIPS_NET))
        return lf_fail(err, LF_BAD_INPUT,
                       "--lpips-net says whose the weights are: give --lpips-weights as well");
    lf_compare_images_options options = a->images;
    options.json = a->evaluate.json;
    if (options.json)
        LF_TRY(lf_options_report(options.json, err));
    return lf_compare_images(a->word[1], a->word[2], &options, a->evaluate.quiet ? NULL : stdout,
                             err);
}

static lf_status run_recon(const lf_arguments *a, lf_error *err)
{
    static const int score[] = {
        OPT_CHECKPOINT, OPT_SETTING,  OPT_SPLIT, OPT_SHAPES,       OPT_JSON,
        OPT_OUT,        OPT_PICTURES, OPT_ROLL,  OPT_DENSE,        OPT_EXACT,
        OPT_SET,        OPT_THREADS,  OPT_QUIET, OPT_NO_BASELINES, 0};
    static const int check[] = {OPT_CHECKPOINT, OPT_SPLIT, OPT_SHAPES, OPT_JSON, OPT_SET,
                                OPT_THREADS,    OPT_QUIET, OPT_CHECK,  0};
    static const int measure[] = {OPT_CHECKPOINT, OPT_SETTING, OPT_SPLIT,   OPT_SHAPES, OPT_SET,
                                  OPT_THREADS,    OPT_QUIET,   OPT_MEASURE, 0};
    LF_TRY(a->measure ? lf_options_only(a, "--measure of a reconstruction", measure, err)
           : a->check ? lf_options_only(a, "--check-equivariance", check, err)
                      : lf_options_only(a, "the scores of a checkpoint", score, err));
    lf_loaded loaded;
    LF_TRY(lf_loaded_open(a->checkpoint, a->sets, a->set, &loaded, err));
    lf_status status;
    if (a->measure) {
        const lf_measure_options options = {a->evaluate.split, a->evaluate.setting, a->measure,
                                            a->evaluate.shapes};
        status = lf_measure_shapes(&loaded, &options, err);
    } else if (a->check) {
        const lf_equivariance_options options = {
            a->check, a->evaluate.shapes ? a->evaluate.shapes : 4, a->evaluate.split,
            a->evaluate.json, a->evaluate.quiet};
        status = lf_check_equivariance(&loaded, &options, err);
    } else {
        status = lf_evaluate(&loaded, &a->evaluate, err);
    }
    lf_loaded_close(&loaded);
    return status;
}

static lf_status check_render_options(const lf_arguments *a, lf_error *err)
{
    static const int score[] = {
        OPT_CHECKPOINT, OPT_SETTING,       OPT_SPLIT,     OPT_SHAPES,       OPT_JSON,
        OPT_OUT,        OPT_PICTURES,      OPT_SET,       OPT_THREADS,      OPT_QUIET,
        OPT_VIEWS,      OPT_LPIPS_WEIGHTS, OPT_LPIPS_NET, OPT_NO_BASELINES, 0};
    static const int path[] = {OPT_CHECKPOINT, OPT_SPLIT, OPT_SHAPES, OPT_OUT,    OPT_SET,
                               OPT_THREADS,    OPT_QUIET, OPT_PATH,   OPT_FRAMES, 0};
    static const int check[] = {OPT_CHECKPOINT, OPT_SPLIT, OPT_SHAPES, OPT_JSON, OPT_SET,
                                OPT_THREADS,    OPT_QUIET, OPT_CHECK,  0};
    static const int measure[] = {OPT_CHECKPOINT, OPT_SPLIT, OPT_SHAPES,  OPT_VIEWS, OPT_SET,
                                  OPT_THREADS,    OPT_QUIET, OPT_MEASURE, 0};
    if (a->measure)
        return lf_options_only(a, "--measure of a renderer", measure, err);
    if (a->check)
        return lf_options_only(a, "--check-equivariance of a renderer", check, err);
    if (a->render.path)
        return lf_options_only(a, "a path", path, err);
    return lf_options_only(a, "the scores of a renderer", score, err);
}

/* Takes over cfg. */
static lf_status run_renderer(const lf_arguments *a, const char *checkpoint, lf_config *cfg,
                              lf_error *err)
{
    lf_loaded_renderer loaded = {.cfg = cfg};
    lf_render_job job = a->render;
    job.setting = a->evaluate.setting;
    job.split = a->evaluate.split;
    job.json = a->evaluate.json;
    job.out = a->evaluate.out;
    job.lpips_weights = a->images.weights;
    job.lpips_net = a->images.net;
    job.scenes = a->evaluate.shapes;
    job.pictures = a->evaluate.pictures;
    job.quiet = a->evaluate.quiet;
    const lf_measure_options measure = {job.split, NULL, a->measure, job.scenes};
    char views[64];
    snprintf(views, sizeof views, "eval.views=%ld", a->views);
    lf_status status = a->views ? lf_config_set(cfg, views, err) : LF_OK;
    if (status == LF_OK)
        status = check_render_options(a, err);
    if (status == LF_OK)
        status = lf_loaded_renderer_open(checkpoint, cfg, &loaded, err);
    if (status == LF_OK)
        status = a->measure       ? lf_measure_views(&loaded, &measure, err)
                 : a->check       ? lf_render_check(&loaded, &job, a->check, err)
                 : a->render.path ? lf_render_path(&loaded, &job, err)
                                  : lf_render_evaluate(&loaded, &job, err);
    lf_loaded_renderer_close(&loaded);
    return status;
}

static lf_status run_speed(const lf_arguments *a, const char *checkpoint, lf_config *cfg,
                           lf_error *err)
{
    const bool renders = lf_config_renders(cfg);
    const int used[] = {OPT_CHECKPOINT,
                        OPT_SPLIT,
                        OPT_SHAPES,
                        OPT_JSON,
                        OPT_OUT,
                        OPT_SET,
                        OPT_THREADS,
                        OPT_QUIET,
                        OPT_SPEED_ERROR,
                        OPT_REPEATS,
                        renders ? OPT_VIEWS : OPT_SETTING,
                        0};
    LF_TRY(
        lf_options_only(a, renders ? "--speed-error of a renderer" : "--speed-error", used, err));
    const long views = a->views ? a->views : lf_config_int(cfg, "eval.views");
    char text[64];
    snprintf(text, sizeof text, "eval.views=%ld", views ? views : 1);
    LF_TRY(lf_config_set(cfg, text, err));
    const lf_speed_options options = {.checkpoint = checkpoint,
                                      .given = a->checkpoint,
                                      .sets = a->sets,
                                      .set = a->set,
                                      .split = a->evaluate.split,
                                      .setting = a->evaluate.setting,
                                      .json = a->evaluate.json,
                                      .out = a->evaluate.out,
                                      .items = a->evaluate.shapes ? a->evaluate.shapes : 3,
                                      .views = lf_config_int(cfg, "eval.views"),
                                      .repeats = a->repeats ? a->repeats : 3,
                                      .threads = a->threads,
                                      .quiet = a->evaluate.quiet};
    return lf_speed_error(cfg, &options, err);
}

/* The config inside the checkpoint, with the overrides. */
static lf_status read_config(const lf_arguments *a, const char *checkpoint, lf_config **out,
                             lf_error *err)
{
    lf_config *cfg;
    LF_TRY(lf_checkpoint_config(checkpoint, &cfg, NULL, err));
    const lf_status status = lf_config_set_trained(cfg, a->sets, a->set, err);
    if (status == LF_OK)
        *out = cfg;
    else
        lf_config_free(cfg);
    return status;
}

static lf_status run_model(const lf_arguments *a, lf_error *err)
{
    lf_found found = {0};
    lf_config *cfg = NULL;
    if (a->evaluate.json)
        LF_TRY(lf_options_report(a->evaluate.json, err));
    LF_TRY(lf_run_find(a->checkpoint, &found, err));
    lf_status status = read_config(a, found.checkpoint, &cfg, err);
    if (status == LF_OK && a->speed) {
        if (found.note[0])
            fprintf(stderr, "elf-eval: %s\n", found.note);
        status = run_speed(a, found.checkpoint, cfg, err);
        lf_config_free(cfg);
    } else if (status == LF_OK && !lf_config_renders(cfg)) {
        lf_config_free(cfg);
        status = run_recon(a, err);
    } else if (status == LF_OK) {
        if (found.note[0])
            fprintf(stderr, "elf-eval: %s\n", found.note);
        status = run_renderer(a, found.checkpoint, cfg, err);
    }
    lf_found_free(&found);
    return status;
}

static lf_status run_check_data(const lf_arguments *a, lf_error *err)
{
    static const int used[] = {OPT_OUT, OPT_THREADS, OPT_QUIET, 0};
    if (a->words != 2)
        return lf_fail(err, LF_BAD_INPUT, "check-data takes one folder of posed photographs");
    LF_TRY(lf_options_only(a, "check-data", used, err));
    return lf_check_data(a->word[1], a->evaluate.out, a->evaluate.quiet ? NULL : stdout, err);
}

static lf_status run_reproduction(const lf_arguments *a, lf_error *err)
{
    static const int used[] = {OPT_OUT, OPT_README, OPT_QUIET, 0};
    if (a->words != 2)
        return lf_fail(err, LF_BAD_INPUT, "reproduction takes a folder of results");
    LF_TRY(lf_options_only(a, "reproduction", used, err));
    LF_TRY(lf_reproduction(a->word[1], a->evaluate.out, a->readme, err));
    if (a->evaluate.out && !a->evaluate.quiet)
        printf("%s\n", a->evaluate.out);
    return LF_OK;
}

static lf_status run_compare_runs(const lf_arguments *a, lf_error *err)
{
    static const int used[] = {OPT_OUT, OPT_NAMES,   OPT_SETTING, OPT_SPLIT, OPT_PICTURES,
                               OPT_SET, OPT_THREADS, OPT_QUIET,   0};
    lf_run_columns runs;
    LF_TRY(lf_options_only(a, "compare-runs", used, err));
    if (!a->evaluate.out)
        return lf_fail(err, LF_BAD_INPUT, "compare-runs: say with --out F.png where to draw");
    LF_TRY(lf_run_columns_parse(a->words - 1, a->word + 1, a->names, &runs, err));
    const lf_compare_runs_options options = {
        .runs = &runs,
        .split = a->evaluate.split,
        .settings = a->evaluate.setting,
        .sets = a->sets,
        .set = a->set,
        .items = lf_option_given(a, OPT_PICTURES) ? a->evaluate.pictures : 2,
        .out = a->evaluate.out,
        .quiet = a->evaluate.quiet};
    const lf_status status = lf_compare_runs(&options, err);
    lf_run_columns_free(&runs);
    return status;
}

static lf_status run_curves(const lf_arguments *a, lf_error *err)
{
    static const int used[] = {OPT_OUT, OPT_NAMES, OPT_QUIET, 0};
    lf_run_columns runs;
    char **title;
    LF_TRY(lf_options_only(a, "curves", used, err));
    if (!a->evaluate.out)
        return lf_fail(err, LF_BAD_INPUT, "curves: say with --out F.png where to draw");
    LF_TRY(lf_run_columns_parse(a->words - 1, a->word + 1, a->names, &runs, err));
    lf_status status = lf_run_titles(&runs, &title, NULL, err);
    if (status == LF_OK) {
        status = lf_curves_write(&runs, (const char *const *)title, a->evaluate.out, err);
        lf_run_titles_free(&runs, title);
    }
    lf_run_columns_free(&runs);
    return status;
}

static lf_status run_make_scene(const lf_arguments *a, lf_error *err)
{
    static const int used[] = {OPT_OUT,  OPT_LAYOUT, OPT_INDEX,   OPT_SEED,  OPT_SIZE,
                               OPT_MESH, OPT_VIEWS,  OPT_THREADS, OPT_QUIET, 0};
    if (a->words != 2)
        return lf_fail(err, LF_BAD_INPUT, "make-scene takes a kind: glossy, diffuse or forward");
    LF_TRY(lf_options_only(a, "make-scene", used, err));
    lf_make_scene_options options = a->scene;
    options.kind = a->word[1];
    options.folder = a->evaluate.out;
    if (a->views)
        options.views = a->views;
    return lf_make_scene_job(&options, a->evaluate.quiet ? NULL : stdout, err);
}

static lf_status run(const lf_arguments *a, lf_error *err)
{
    if (a->words > 0 && strcmp(a->word[0], "make-scene") == 0)
        return run_make_scene(a, err);
    if (a->words > 0 && strcmp(a->word[0], "reproduction") == 0)
        return run_reproduction(a, err);
    if (a->words > 0 && strcmp(a->word[0], "compare-runs") == 0)
        return run_compare_runs(a, err);
    if (a->words > 0 && strcmp(a->word[0], "curves") == 0)
        return run_curves(a, err);
    if (a->words > 0 && strcmp(a->word[0], "check-data") == 0)
        return run_check_data(a, err);
    if (a->words > 0 && strcmp(a->word[0], "compare-meshes") == 0)
        return run_compare(a, err);
    if (a->words > 0 && strcmp(a->word[0], "compare-images") == 0)
        return run_compare_images(a, err);
    if (a->words > 0)
        return lf_fail(err, LF_BAD_INPUT, "%s is not a job of elf-eval; see elf-eval --help",
                       a->word[0]);
    if (!a->checkpoint)
        return lf_fail(err, LF_BAD_INPUT, "no --checkpoint given; see elf-eval --help");
    const char *split = a->evaluate.split;
    if (strcmp(split, "train") != 0 && strcmp(split, "val") != 0 && strcmp(split, "test") != 0)
        return lf_fail(err, LF_BAD_INPUT, "--split %s: give train, val or test", split);
    return run_model(a, err);
}

int main(int argc, char **argv)
{
    lf_openmp_wait_briefly(argv);
    lf_error err = {""};
    lf_arguments a = {.evaluate = {.split = "test", .pictures = 6, .baselines = true},
                      .render = {.frames = 60, .baselines = true},
                      .scene = lf_make_scene_defaults()};
    lf_status status = lf_options_parse(argc, argv, &a, &err);
    if (status == LF_OK && !a.done) {
        if (a.threads)
            omp_set_num_threads(a.threads);
        status = run(&a, &err);
    }
    if (status != LF_OK)
        fprintf(stderr, "elf-eval: %s\n", err.text);
    return (int)status;
}
