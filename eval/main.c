/* main.c: elf-eval. Reads the command line and hands over to one of its jobs. */
#include <errno.h>
#include <getopt.h>
#include <omp.h>
#include <sys/stat.h>
#include <unistd.h>

#include "eval/check_data.h"
#include "eval/compare.h"
#include "eval/compare_images.h"
#include "eval/equivariance.h"
#include "eval/evaluate.h"
#include "eval/image_metrics.h"
#include "eval/make_scene.h"
#include "eval/render_job.h"
#include "models/checkpoint.h"
#include "train/run_dir.h"
#include "train/openmp.h"

static void print_help(FILE *out)
{
    fputs(
        "elf-eval --checkpoint F [options]         score a model on a split, write its meshes\n"
        "elf-eval --checkpoint F --path P [options]  render a path through the scenes (renderers)\n"
        "elf-eval --checkpoint F --check-equivariance N\n"
        "                                          what the trained model keeps of its symmetry\n"
        "elf-eval compare-meshes A B [options]     score mesh A (predicted) against B (truth)\n"
        "elf-eval check-data PATH [--out F.png]    say what a folder of photographs is, draw\n"
        "                                          its cameras and epipolar lines\n"
        "elf-eval compare-images A B [options]     PSNR, SSIM and LPIPS of two images\n"
        "elf-eval make-scene KIND --out DIR        write a made-up scene: glossy, diffuse or "
        "forward\n"
        "\n"
        "  --checkpoint F    a checkpoint, or a run's folder (its newest checkpoint)\n"
        "  --setting S       I, Z, R, Y or SO3 (default: the training's); renderers: I or SO3, "
        "which\n"
        "                    turns the frame six times\n"
        "  --split S         train, val or test (default test)\n"
        "  --shapes N        at most N shapes (renderers: scenes)\n"
        "  --json F          write the report as JSON (compare-* print it as well)\n"
        "  --out DIR         write meshes (PLY) and a picture of the first shapes, montage.png;\n"
        "                    renderers: the rendered views and montage.png\n"
        "  --views N         renderers: at most N views of a scene; make-scene: views in all\n"
        "  --path P          spiral or orbit: numbered frames in --out, and how to make a video\n"
        "  --frames N        frames of the path (default 60)\n"
        "  --no-baselines    renderers: do not score what learns nothing\n"
        "  --pictures N      rows of the picture (default 6)\n"
        "  --roll DEGREES    roll every view by this as well and render it again\n"
        "  --dense           evaluate the whole grid instead of coarse to fine (the same mesh)\n"
        "  --exact           Chamfer to the surface instead of to its samples\n"
        "  --normalise       compare-meshes: first centre both boxes and scale to diagonal 1\n"
        "  --samples N       compare-meshes: points of each metric (default 100000)\n"
        "  --lpips-weights F compare-images, renderers: the weights of LPIPS (docs/lpips.md)\n"
        "  --lpips-net NET   vgg or alex (default vgg)\n"
        "  --layout L        make-scene: nerf-synthetic, llff, transforms, deepvoxels, "
        "colmap-text,\n"
        "                    colmap-binary (default nerf-synthetic; of forward: llff)\n"
        "  --index N         make-scene: another scene of the kind (default 0)\n"
        "  --seed N          make-scene: other scenes altogether (default 0)\n"
        "  --size N          make-scene: pixels along an edge (default 100)\n"
        "  --mesh F          make-scene: the object; without it a made-up shape\n"
        "  --set K=V         override a key of the checkpoint's config, e.g. data.root=DIR\n"
        "  --threads N       threads (default: all; the result does not depend on it)\n"
        "  --quiet, --help, --help-config, --version\n"
        "\n"
        "Metrics:\n",
        out);
    fputs(lf_metric_text(), out);
    fputs(lf_image_metric_text(), out);
    fputs(lf_lpips_text(), out);
    fputs("\nExit codes: 0 done, 1 failed while running, 2 wrong use, config or input.\n", out);
}

enum { MOST_SETS = 256 };

typedef struct arguments {
    const char *checkpoint, *set[MOST_SETS];
    int sets, threads;
    uint64_t given; /* bits 1 << (option - CHECKPOINT) */
    long check;     /* elements of --check-equivariance; 0: not asked */
    long samples;
    bool normalise, done;
    lf_evaluate_options evaluate;
    lf_compare_images_options images;
    lf_render_job render; /* path, frames, baselines; the rest is in evaluate and images */
    long views;
    lf_make_scene_options scene;
    int words;
    char **word; /* what is not an option */
} arguments;

static lf_status parse_number(const char *name, const char *text, long low, long high, long *out,
                              lf_error *err)
{
    char *end;
    const long n = strtol(text, &end, 10);
    if (*end || end == text || n < low || n > high)
        return lf_fail(err, LF_BAD_INPUT, "--%s %s: give a number from %ld to %ld", name, text, low,
                       high);
    *out = n;
    return LF_OK;
}

enum {
    CHECKPOINT = 256,
    SETTING,
    SPLIT,
    SHAPES,
    JSON,
    OUT,
    PICTURES,
    ROLL,
    DENSE,
    EXACT,
    NORMALISE,
    SAMPLES,
    LPIPS_WEIGHTS,
    LPIPS_NET,
    SET,
    VIEWS,
    PATH,
    FRAMES,
    NO_BASELINES,
    LAYOUT,
    INDEX,
    SEED,
    SIZE,
    MESH,
    THREADS,
    QUIET,
    CHECK,
    HELP,
    HELP_CONFIG,
    VERSION
};

static const struct option option_table[] = {
    {"checkpoint", required_argument, NULL, CHECKPOINT},
    {"setting", required_argument, NULL, SETTING},
    {"split", required_argument, NULL, SPLIT},
    {"shapes", required_argument, NULL, SHAPES},
    {"json", required_argument, NULL, JSON},
    {"out", required_argument, NULL, OUT},
    {"pictures", required_argument, NULL, PICTURES},
    {"roll", required_argument, NULL, ROLL},
    {"dense", no_argument, NULL, DENSE},
    {"exact", no_argument, NULL, EXACT},
    {"normalise", no_argument, NULL, NORMALISE},
    {"samples", required_argument, NULL, SAMPLES},
    {"lpips-weights", required_argument, NULL, LPIPS_WEIGHTS},
    {"lpips-net", required_argument, NULL, LPIPS_NET},
    {"set", required_argument, NULL, SET},
    {"views", required_argument, NULL, VIEWS},
    {"path", required_argument, NULL, PATH},
    {"frames", required_argument, NULL, FRAMES},
    {"no-baselines", no_argument, NULL, NO_BASELINES},
    {"layout", required_argument, NULL, LAYOUT},
    {"index", required_argument, NULL, INDEX},
    {"seed", required_argument, NULL, SEED},
    {"size", required_argument, NULL, SIZE},
    {"mesh", required_argument, NULL, MESH},
    {"threads", required_argument, NULL, THREADS},
    {"quiet", no_argument, NULL, QUIET},
    {"check-equivariance", required_argument, NULL, CHECK},
    {"help", no_argument, NULL, HELP},
    {"help-config", no_argument, NULL, HELP_CONFIG},
    {"version", no_argument, NULL, VERSION},
    {NULL, 0, NULL, 0}};

static lf_status parse_roll(const char *text, double *out, lf_error *err)
{
    char *end;
    const double x = strtod(text, &end);
    if (*end || end == text || !(x >= -360 && x <= 360))
        return lf_fail(err, LF_BAD_INPUT, "--roll %s: give degrees from -360 to 360", text);
    *out = x;
    return LF_OK;
}

static lf_status parse_net(const char *text, lf_lpips_net *out, lf_error *err)
{
    const lf_status status = lf_lpips_net_parse(text, out, err);
    return status == LF_OK ? LF_OK : lf_error_context(err, status, "--lpips-net");
}

/* Options that take no number or text of their own. */
static bool parse_flag(arguments *a, int option)
{
    switch (option) {
    case DENSE:
        return a->evaluate.dense = true;
    case EXACT:
        return a->evaluate.exact = true;
    case NORMALISE:
        return a->normalise = true;
    case NO_BASELINES:
        a->render.baselines = false;
        return true;
    case QUIET:
        return a->evaluate.quiet = true;
    case HELP:
        print_help(stdout);
        return a->done = true;
    case HELP_CONFIG:
        lf_config_help(stdout);
        return a->done = true;
    case VERSION:
        printf("elf-eval %s (%s)\n", ELF_VERSION, LF_REAL_NAME);
        return a->done = true;
    default:
        return false;
    }
}

/* Options of make-scene alone. */
static lf_status parse_scene_option(arguments *a, int option, lf_error *err)
{
    long n = 0;
    switch (option) {
    case LAYOUT:
        a->scene.layout = optarg;
        return LF_OK;
    case MESH:
        a->scene.mesh = optarg;
        return LF_OK;
    case INDEX:
        LF_TRY(parse_number("index", optarg, 0, 1000000000, &n, err));
        a->scene.index = (uint64_t)n;
        return LF_OK;
    case SEED:
        LF_TRY(parse_number("seed", optarg, 0, 2147483647, &n, err));
        a->scene.seed = (uint64_t)n;
        return LF_OK;
    case SIZE:
        LF_TRY(parse_number("size", optarg, 8, 4096, &n, err));
        a->scene.size = (int)n;
        return LF_OK;
    default:
        return parse_flag(a, option) ? LF_OK : lf_fail(err, LF_BAD_INPUT, "see elf-eval --help");
    }
}

static lf_status parse_option(arguments *a, int option, lf_error *err)
{
    long threads = 0;
    switch (option) {
    case CHECKPOINT:
        a->checkpoint = optarg;
        return LF_OK;
    case SETTING:
        a->evaluate.setting = optarg;
        return LF_OK;
    case SPLIT:
        a->evaluate.split = optarg;
        return LF_OK;
    case JSON:
        a->evaluate.json = optarg;
        return LF_OK;
    case OUT:
        a->evaluate.out = optarg;
        return LF_OK;
    case PATH:
        a->render.path = optarg;
        return LF_OK;
    case FRAMES:
        return parse_number("frames", optarg, 1, 10000, &a->render.frames, err);
    case VIEWS:
        return parse_number("views", optarg, 1, 100000, &a->views, err);
    case LPIPS_WEIGHTS:
        a->images.weights = optarg;
        return LF_OK;
    case LPIPS_NET:
        return parse_net(optarg, &a->images.net, err);
    case SHAPES:
        return parse_number("shapes", optarg, 1, 1000000, &a->evaluate.shapes, err);
    case PICTURES:
        return parse_number("pictures", optarg, 0, 100, &a->evaluate.pictures, err);
    case SAMPLES:
        return parse_number("samples", optarg, 1, LF_METRIC_SAMPLES_MAX, &a->samples, err);
    case CHECK:
        return parse_number("check-equivariance", optarg, 1, 100000, &a->check, err);
    case ROLL:
        return parse_roll(optarg, &a->evaluate.roll, err);
    case THREADS:
        LF_TRY(parse_number("threads", optarg, 1, 1024, &threads, err));
        a->threads = (int)threads;
        return LF_OK;
    case SET:
        if (a->sets == MOST_SETS)
            return lf_fail(err, LF_BAD_INPUT, "more than %d --set", MOST_SETS);
        a->set[a->sets++] = optarg;
        return LF_OK;
    default:
        return parse_scene_option(a, option, err);
    }
}

static lf_status parse(int argc, char **argv, arguments *a, lf_error *err)
{
    int option;
    while (!a->done && (option = getopt_long(argc, argv, "", option_table, NULL)) != -1) {
        LF_TRY(parse_option(a, option, err));
        a->given |= (uint64_t)1 << (option - CHECKPOINT);
    }
    a->words = argc - optind;
    a->word = argv + optind;
    return LF_OK;
}

/* Refuse a report that could not be written before the work, not after it. */
static lf_status check_report(const char *path, lf_error *err)
{
    char *folder = strdup(path);
    LF_REQUIRE(folder, "out of memory");
    char *slash = strrchr(folder, '/');
    if (slash)
        slash[slash == folder] = 0;
    struct stat info;
    lf_status status = LF_OK;
    if (stat(path, &info) == 0 && S_ISDIR(info.st_mode))
        status = lf_fail(err, LF_BAD_INPUT, "--json %s: is a folder; give a file", path);
    else if (access(slash ? folder : ".", W_OK) != 0)
        status =
            lf_fail(err, LF_BAD_INPUT, "--json %s: cannot write there: %s", path, strerror(errno));
    free(folder);
    return status;
}

/* Refuse options that the job has no use for: `used` lists those it has. */
static lf_status check_given(const arguments *a, const char *job, const int *used, lf_error *err)
{
    uint64_t left = a->given;
    for (; *used; used++)
        left &= ~((uint64_t)1 << (*used - CHECKPOINT));
    for (const struct option *o = option_table; o->name; o++)
        if (left & (uint64_t)1 << (o->val - CHECKPOINT))
            return lf_fail(err, LF_BAD_INPUT, "--%s means nothing to %s; see elf-eval --help",
                           o->name, job);
    return LF_OK;
}

static lf_status run_compare(const arguments *a, lf_error *err)
{
    if (a->words != 3)
        return lf_fail(err, LF_BAD_INPUT,
                       "compare-meshes takes two mesh files: the predicted and "
                       "the true one");
    static const int used[] = {JSON, EXACT, NORMALISE, SAMPLES, THREADS, QUIET, 0};
    LF_TRY(check_given(a, "compare-meshes", used, err));
    lf_compare_options options = lf_compare_defaults();
    options.normalise = a->normalise;
    options.metric.exact = a->evaluate.exact;
    options.json = a->evaluate.json;
    if (a->samples)
        options.metric.samples = a->samples;
    if (options.json)
        LF_TRY(check_report(options.json, err));
    return lf_compare_meshes(a->word[1], a->word[2], &options, a->evaluate.quiet ? NULL : stdout,
                             err);
}

static lf_status run_compare_images(const arguments *a, lf_error *err)
{
    if (a->words != 3)
        return lf_fail(err, LF_BAD_INPUT, "compare-images takes two image files of one size");
    static const int used[] = {JSON, LPIPS_WEIGHTS, LPIPS_NET, THREADS, QUIET, 0};
    LF_TRY(check_given(a, "compare-images", used, err));
    if (!a->images.weights && a->given & (uint64_t)1 << (LPIPS_NET - CHECKPOINT))
        return lf_fail(err, LF_BAD_INPUT,
                       "--lpips-net says whose the weights are: give --lpips-weights as well");
    lf_compare_images_options options = a->images;
    options.json = a->evaluate.json;
    if (options.json)
        LF_TRY(check_report(options.json, err));
    return lf_compare_images(a->word[1], a->word[2], &options, a->evaluate.quiet ? NULL : stdout,
                             err);
}

static lf_status run_recon(const arguments *a, lf_error *err)
{
    static const int score[] = {CHECKPOINT, SETTING, SPLIT, SHAPES, JSON,    OUT,   PICTURES,
                                ROLL,       DENSE,   EXACT, SET,    THREADS, QUIET, 0};
    static const int check[] = {CHECKPOINT, SPLIT, SHAPES, JSON, SET, THREADS, QUIET, CHECK, 0};
    LF_TRY(a->check ? check_given(a, "--check-equivariance", check, err)
                    : check_given(a, "the scores of a checkpoint", score, err));
    lf_loaded loaded;
    LF_TRY(lf_loaded_open(a->checkpoint, a->sets, a->set, &loaded, err));
    lf_status status;
    if (a->check) {
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

static lf_status check_render_options(const arguments *a, lf_error *err)
{
    static const int score[] = {CHECKPOINT, SETTING,       SPLIT,     SHAPES,       JSON,
                                OUT,        PICTURES,      SET,       THREADS,      QUIET,
                                VIEWS,      LPIPS_WEIGHTS, LPIPS_NET, NO_BASELINES, 0};
    static const int path[] = {CHECKPOINT, SPLIT, SHAPES, OUT,    SET,
                               THREADS,    QUIET, PATH,   FRAMES, 0};
    static const int check[] = {CHECKPOINT, SPLIT, SHAPES, JSON, SET, THREADS, QUIET, CHECK, 0};
    if (a->check)
        return check_given(a, "--check-equivariance of a renderer", check, err);
    if (a->render.path)
        return check_given(a, "a path", path, err);
    return check_given(a, "the scores of a renderer", score, err);
}

/* Takes over cfg. */
static lf_status run_renderer(const arguments *a, const char *checkpoint, lf_config *cfg,
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
    char views[64];
    snprintf(views, sizeof views, "eval.views=%ld", a->views);
    lf_status status = a->views ? lf_config_set(cfg, views, err) : LF_OK;
    if (status == LF_OK)
        status = check_render_options(a, err);
    if (status == LF_OK)
        status = lf_loaded_renderer_open(checkpoint, cfg, &loaded, err);
    if (status == LF_OK)
        status = a->check         ? lf_render_check(&loaded, &job, a->check, err)
                 : a->render.path ? lf_render_path(&loaded, &job, err)
                                  : lf_render_evaluate(&loaded, &job, err);
    lf_loaded_renderer_close(&loaded);
    return status;
}

/* The config inside the checkpoint, with the overrides. */
static lf_status read_config(const arguments *a, const char *checkpoint, lf_config **out,
                             lf_error *err)
{
    lf_config *cfg;
    LF_TRY(lf_checkpoint_config(checkpoint, &cfg, NULL, err));
    lf_status status = LF_OK;
    for (int i = 0; status == LF_OK && i < a->sets; i++)
        status = lf_config_set(cfg, a->set[i], err);
    if (status == LF_OK)
        status = lf_config_check(cfg, err);
    if (status == LF_OK)
        *out = cfg;
    else
        lf_config_free(cfg);
    return status;
}

static lf_status run_model(const arguments *a, lf_error *err)
{
    lf_found found = {0};
    lf_config *cfg = NULL;
    if (a->evaluate.json)
        LF_TRY(check_report(a->evaluate.json, err));
    LF_TRY(lf_run_find(a->checkpoint, &found, err));
    lf_status status = read_config(a, found.checkpoint, &cfg, err);
    if (status == LF_OK && !lf_config_renders(cfg)) {
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

static lf_status run_check_data(const arguments *a, lf_error *err)
{
    static const int used[] = {OUT, THREADS, QUIET, 0};
    if (a->words != 2)
        return lf_fail(err, LF_BAD_INPUT, "check-data takes one folder of posed photographs");
    LF_TRY(check_given(a, "check-data", used, err));
    return lf_check_data(a->word[1], a->evaluate.out, a->evaluate.quiet ? NULL : stdout, err);
}

static lf_status run_make_scene(const arguments *a, lf_error *err)
{
    static const int used[] = {OUT, LAYOUT, INDEX, SEED, SIZE, MESH, VIEWS, THREADS, QUIET, 0};
    if (a->words != 2)
        return lf_fail(err, LF_BAD_INPUT, "make-scene takes a kind: glossy, diffuse or forward");
    LF_TRY(check_given(a, "make-scene", used, err));
    lf_make_scene_options options = a->scene;
    options.kind = a->word[1];
    options.folder = a->evaluate.out;
    if (a->views)
        options.views = a->views;
    return lf_make_scene_job(&options, a->evaluate.quiet ? NULL : stdout, err);
}

static lf_status run(const arguments *a, lf_error *err)
{
    if (a->words > 0 && strcmp(a->word[0], "make-scene") == 0)
        return run_make_scene(a, err);
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
    arguments a = {.evaluate = {.split = "test", .pictures = 6},
                   .render = {.frames = 60, .baselines = true},
                   .scene = lf_make_scene_defaults()};
    lf_status status = parse(argc, argv, &a, &err);
    if (status == LF_OK && !a.done) {
        if (a.threads)
            omp_set_num_threads(a.threads);
        status = run(&a, &err);
    }
    if (status != LF_OK)
        fprintf(stderr, "elf-eval: %s\n", err.text);
    return (int)status;
}
