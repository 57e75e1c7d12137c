/* options.c: the command line of elf-eval, its help. See options.h. */
#include <errno.h>
#include <getopt.h>
#include <sys/stat.h>
#include <unistd.h>

#include "eval/image_metrics.h"
#include "eval/metrics.h"
#include "eval/options.h"

static void print_help(FILE *out)
{
    fputs(
        "elf-eval --checkpoint F [options]         score a model on a split, write its meshes\n"
        "elf-eval --checkpoint F --path P [options]  render a path through the scenes (renderers)\n"
        "elf-eval --checkpoint F --check-equivariance N\n"
        "                                          what the trained model keeps of its symmetry\n"
        "elf-eval --checkpoint F --speed-error     seconds and memory of every saving against the\n"
        "                                          error to the exact result "
        "(docs/speed-error.md)\n"
        "elf-eval compare-meshes A B [options]     score mesh A (predicted) against B (truth)\n"
        "elf-eval check-data PATH [--out F.png]    say what a folder of photographs is, draw\n"
        "                                          its cameras and epipolar lines\n"
        "elf-eval compare-images A B [options]     PSNR, SSIM and LPIPS of two images\n"
        "elf-eval make-scene KIND --out DIR        write a made-up scene: glossy, diffuse or "
        "forward\n"
        "elf-eval reproduction DIR [--out F.md]    the paper's figures and the results in DIR, a "
        "table each\n"
        "elf-eval compare-runs RUN... --out F.png  what several trained systems make of the same "
        "shapes or\n"
        "                                          views; RUN,RUN: of several parts; none\n"
        "elf-eval curves RUN... --out F.png        their losses against steps and seconds\n"
        "\n"
        "  --checkpoint F    a checkpoint, or a run's folder (its newest checkpoint)\n"
        "  --setting S       I, Z, R, Y or SO3 (default: the training's); renderers: I or SO3, "
        "which\n"
        "                    turns the frame six times; compare-runs: several, as I,Z\n"
        "  --split S         train, val or test (default test)\n"
        "  --shapes N        at most N shapes (renderers: scenes)\n"
        "  --json F          write the report as JSON (compare-* print it as well)\n"
        "  --out DIR         write meshes (PLY) and a picture of the first shapes, montage.png;\n"
        "                    renderers: the rendered views and montage.png\n"
        "  --views N         renderers: at most N views of a scene; make-scene: views in all\n"
        "  --path P          spiral or orbit: numbered frames in --out, and how to make a video\n"
        "  --frames N        frames of the path (default 60)\n"
        "  --no-baselines    do not score what learns nothing: of shapes the visual hull of the "
        "views and\n"
        "                    the mean of the training shapes, of renderers a copy, a mean and a "
        "plane sweep of the sources\n"
        "  --pictures N      rows of the picture (default 6); compare-runs: shapes or views of a "
        "part (2)\n"
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
        "  --repeats N       --speed-error: times each setting is evaluated (default 3)\n"
        "  --measure F       write what the network gives, unscored, with seconds and memory: "
        "what\n"
        "                    --speed-error starts for each setting (docs/formats.md)\n"
        "  --names A,B,...   compare-runs, curves: what the runs are called (default: their "
        "folders)\n"
        "  --readme F        reproduction: rewrite the block between its marks in F as well\n"
        "  --quiet, --help, --help-config, --version\n"
        "\n"
        "Metrics:\n",
        out);
    fputs(lf_metric_text(), out);
    fputs(lf_image_metric_text(), out);
    fputs(lf_lpips_text(), out);
    fputs("\nExit codes: 0 done, 1 failed while running, 2 wrong use, config or input.\n", out);
}

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

static const struct option option_table[] = {
    {"checkpoint", required_argument, NULL, OPT_CHECKPOINT},
    {"setting", required_argument, NULL, OPT_SETTING},
    {"split", required_argument, NULL, OPT_SPLIT},
    {"shapes", required_argument, NULL, OPT_SHAPES},
    {"json", required_argument, NULL, OPT_JSON},
    {"out", required_argument, NULL, OPT_OUT},
    {"pictures", required_argument, NULL, OPT_PICTURES},
    {"roll", required_argument, NULL, OPT_ROLL},
    {"dense", no_argument, NULL, OPT_DENSE},
    {"exact", no_argument, NULL, OPT_EXACT},
    {"normalise", no_argument, NULL, OPT_NORMALISE},
    {"samples", required_argument, NULL, OPT_SAMPLES},
    {"lpips-weights", required_argument, NULL, OPT_LPIPS_WEIGHTS},
    {"lpips-net", required_argument, NULL, OPT_LPIPS_NET},
    {"set", required_argument, NULL, OPT_SET},
    {"views", required_argument, NULL, OPT_VIEWS},
    {"path", required_argument, NULL, OPT_PATH},
    {"frames", required_argument, NULL, OPT_FRAMES},
    {"no-baselines", no_argument, NULL, OPT_NO_BASELINES},
    {"layout", required_argument, NULL, OPT_LAYOUT},
    {"index", required_argument, NULL, OPT_INDEX},
    {"seed", required_argument, NULL, OPT_SEED},
    {"size", required_argument, NULL, OPT_SIZE},
    {"mesh", required_argument, NULL, OPT_MESH},
    {"threads", required_argument, NULL, OPT_THREADS},
    {"quiet", no_argument, NULL, OPT_QUIET},
    {"check-equivariance", required_argument, NULL, OPT_CHECK},
    {"speed-error", no_argument, NULL, OPT_SPEED_ERROR},
    {"repeats", required_argument, NULL, OPT_REPEATS},
    {"measure", required_argument, NULL, OPT_MEASURE},
    {"names", required_argument, NULL, OPT_NAMES},
    {"readme", required_argument, NULL, OPT_README},
    {"help", no_argument, NULL, OPT_HELP},
    {"help-config", no_argument, NULL, OPT_HELP_CONFIG},
    {"version", no_argument, NULL, OPT_VERSION},
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
static bool parse_flag(lf_arguments *a, int option)
{
    switch (option) {
    case OPT_DENSE:
        return a->evaluate.dense = true;
    case OPT_EXACT:
        return a->evaluate.exact = true;
    case OPT_NORMALISE:
        return a->normalise = true;
    case OPT_NO_BASELINES:
        a->evaluate.baselines = a->render.baselines = false;
        return true;
    case OPT_QUIET:
        return a->evaluate.quiet = true;
    case OPT_SPEED_ERROR:
        return a->speed = true;
    case OPT_HELP:
        print_help(stdout);
        return a->done = true;
    case OPT_HELP_CONFIG:
        lf_config_help(stdout);
        return a->done = true;
    case OPT_VERSION:
        printf("elf-eval %s (%s)\n", ELF_VERSION, LF_REAL_NAME);
        return a->done = true;
    default:
        return false;
    }
}

/* Options of make-scene alone. */
static lf_status parse_scene_option(lf_arguments *a, int option, lf_error *err)
{
    long n = 0;
    switch (option) {
    case OPT_LAYOUT:
        a->scene.layout = optarg;
        return LF_OK;
    case OPT_MESH:
        a->scene.mesh = optarg;
        return LF_OK;
    case OPT_INDEX:
        LF_TRY(parse_number("index", optarg, 0, 1000000000, &n, err));
        a->scene.index = (uint64_t)n;
        return LF_OK;
    case OPT_SEED:
        LF_TRY(parse_number("seed", optarg, 0, 2147483647, &n, err));
        a->scene.seed = (uint64_t)n;
        return LF_OK;
    case OPT_SIZE:
        LF_TRY(parse_number("size", optarg, 8, 4096, &n, err));
        a->scene.size = (int)n;
        return LF_OK;
    default:
        return parse_flag(a, option) ? LF_OK : lf_fail(err, LF_BAD_INPUT, "see elf-eval --help");
    }
}

static lf_status parse_option(lf_arguments *a, int option, lf_error *err)
{
    long threads = 0;
    switch (option) {
    case OPT_CHECKPOINT:
        a->checkpoint = optarg;
        return LF_OK;
    case OPT_SETTING:
        a->evaluate.setting = optarg;
        return LF_OK;
    case OPT_SPLIT:
        a->evaluate.split = optarg;
        return LF_OK;
    case OPT_JSON:
        a->evaluate.json = optarg;
        return LF_OK;
    case OPT_OUT:
        a->evaluate.out = optarg;
        return LF_OK;
    case OPT_PATH:
        a->render.path = optarg;
        return LF_OK;
    case OPT_FRAMES:
        return parse_number("frames", optarg, 1, 10000, &a->render.frames, err);
    case OPT_VIEWS:
        return parse_number("views", optarg, 1, 100000, &a->views, err);
    case OPT_LPIPS_WEIGHTS:
        a->images.weights = optarg;
        return LF_OK;
    case OPT_LPIPS_NET:
        return parse_net(optarg, &a->images.net, err);
    case OPT_SHAPES:
        return parse_number("shapes", optarg, 1, 1000000, &a->evaluate.shapes, err);
    case OPT_PICTURES:
        return parse_number("pictures", optarg, 0, 100, &a->evaluate.pictures, err);
    case OPT_SAMPLES:
        return parse_number("samples", optarg, 1, LF_METRIC_SAMPLES_MAX, &a->samples, err);
    case OPT_CHECK:
        return parse_number("check-equivariance", optarg, 1, 100000, &a->check, err);
    case OPT_REPEATS:
        return parse_number("repeats", optarg, 1, 100, &a->repeats, err);
    case OPT_MEASURE:
        a->measure = optarg;
        return LF_OK;
    case OPT_NAMES:
        a->names = optarg;
        return LF_OK;
    case OPT_README:
        a->readme = optarg;
        return LF_OK;
    case OPT_ROLL:
        return parse_roll(optarg, &a->evaluate.roll, err);
    case OPT_THREADS:
        LF_TRY(parse_number("threads", optarg, 1, 1024, &threads, err));
        a->threads = (int)threads;
        return LF_OK;
    case OPT_SET:
        if (a->sets == LF_MOST_SETS)
            return lf_fail(err, LF_BAD_INPUT, "more than %d --set", LF_MOST_SETS);
        a->set[a->sets++] = optarg;
        return LF_OK;
    default:
        return parse_scene_option(a, option, err);
    }
}

lf_status lf_options_parse(int argc, char **argv, lf_arguments *a, lf_error *err)
{
    int option;
    while (!a->done && (option = getopt_long(argc, argv, "", option_table, NULL)) != -1) {
        LF_TRY(parse_option(a, option, err));
        a->given |= (uint64_t)1 << (option - OPT_CHECKPOINT);
    }
    a->words = argc - optind;
    a->word = argv + optind;
    return LF_OK;
}

lf_status lf_options_report(const char *path, lf_error *err)
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

bool lf_option_given(const lf_arguments *a, int option)
{
    return a->given & (uint64_t)1 << (option - OPT_CHECKPOINT);
}

lf_status lf_options_only(const lf_arguments *a, const char *job, const int *used, lf_error *err)
{
    uint64_t left = a->given;
    for (; *used; used++)
        left &= ~((uint64_t)1 << (*used - OPT_CHECKPOINT));
    for (const struct option *o = option_table; o->name; o++)
        if (left & (uint64_t)1 << (o->val - OPT_CHECKPOINT))
            return lf_fail(err, LF_BAD_INPUT, "--%s means nothing to %s; see elf-eval --help",
                           o->name, job);
    return LF_OK;
}
