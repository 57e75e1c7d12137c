/* main.c: elf-train. Reads the command line, prepares a config, trains. */
#include <getopt.h>
#include <omp.h>
#include <signal.h>
#include <unistd.h>

#include "train/count.h"
#include "train/openmp.h"
#include "train/run_dir.h"
#include "train/trainer.h"

/* The only globals: a signal handler has no other way. */
static volatile sig_atomic_t stop_asked, steps_begun;

static void on_signal(int number)
{
    static const char text[] = "\nelf-train: stopped while making the data: no new step to save; "
                               "the same command starts again\n";
    (void)number;
    if (!steps_begun) {
        const ssize_t written = write(STDERR_FILENO, text, sizeof text - 1);
        (void)written; /* stderr may be closed */
        _exit(130);
    }
    stop_asked = 1;
}

static void print_help(FILE *out)
{
    fputs(
        "elf-train CONFIG.ini [options]        train a model from a config\n"
        "elf-train --resume RUN_OR_CHECKPOINT  go on with a run; the end is the same, bit for bit\n"
        "elf-train CONFIG.ini --count          parameters and operations of the model\n"
        "\n"
        "  --out DIR         run folder (default: runs/<name of the config>)\n"
        "  --resume PATH     a run's folder (its newest sound checkpoint) or one checkpoint;\n"
        "                    a checkpoint with --out starts a new run from it\n"
        "  --set K=V         override a key of the config, e.g. --set train.steps=100; repeatable\n"
        "  --threads N       threads (default: all; the result does not depend on it)\n"
        "  --overfit         train on the first batch alone: the loss must go to 0\n"
        "  --check-finite    look for NaN and infinities after every op and name the first "
        "(slower)\n"
        "  --count           print parameters and operations of the model's parts; train nothing\n"
        "  --profile [N]     instead of training, print where time and memory of a step go, by "
        "part\n"
        "                    of the model and by op, of the fastest quarter of N steps (20)\n"
        "  --json FILE       with --count or --profile: write it to FILE, too\n"
        "  --quiet           print only what went wrong\n"
        "  --help-config     print every key with type, range, default and meaning\n"
        "  --help, --version\n"
        "\n"
        "Ctrl-C saves a checkpoint and stops (again, or while the data are made: stops at once, "
        "the\n"
        "last one saved counts).\n"
        "A run's folder holds config.ini, metrics.jsonl (a JSON object a logged step),\n"
        "checkpoints/step-*.safetensors, latest and best.\n"
        "Exit codes: 0 done, 1 failed while running, 2 wrong use, config or input, 130 stopped.\n",
        out);
}

enum { MOST_SETS = 256 };

typedef struct arguments {
    const char *config, *out, *resume, *json, *set[MOST_SETS];
    int sets, threads;
    long profile; /* steps; 0: none */
    bool quiet, overfit, check_finite, count, done;
} arguments;

static lf_status parse_number(const char *option, const char *text, long most, long *n,
                              lf_error *err)
{
    char *end;
    const long found = strtol(text, &end, 10);
    if (*end || end == text || found < 1 || found > most)
        return lf_fail(err, LF_BAD_INPUT, "%s %s: give a number from 1 to %ld", option, text, most);
    *n = found;
    return LF_OK;
}

static lf_status parse_option(arguments *a, int option, lf_error *err)
{
    long n = 0;
    switch (option) {
    case 'o':
        a->out = optarg;
        return LF_OK;
    case 'r':
        a->resume = optarg;
        return LF_OK;
    case 's':
        if (a->sets == MOST_SETS)
            return lf_fail(err, LF_BAD_INPUT, "more than %d --set", MOST_SETS);
        a->set[a->sets++] = optarg;
        return LF_OK;
    case 't':
        LF_TRY(parse_number("--threads", optarg, 1024, &n, err));
        a->threads = (int)n;
        return LF_OK;
    case 'c':
        a->count = true;
        return LF_OK;
    case 'j':
        a->json = optarg;
        return LF_OK;
    case 'q':
        a->quiet = true;
        return LF_OK;
    case 'O':
        a->overfit = true;
        return LF_OK;
    case 'f':
        a->check_finite = true;
        return LF_OK;
    case 'p':
        a->profile = 20;
        return optarg ? parse_number("--profile", optarg, 1000, &a->profile, err) : LF_OK;
    case 'h':
        print_help(stdout);
        break;
    case 'H':
        lf_config_help(stdout);
        break;
    case 'v':
        printf("elf-train %s (%s)\n", ELF_VERSION, LF_REAL_NAME);
        break;
    default:
        return lf_fail(err, LF_BAD_INPUT, "see elf-train --help");
    }
    a->done = true;
    return LF_OK;
}

/* The number of --profile N stands apart or not at all; what is no number is a config. */
static void take_number(int argc, char **argv)
{
    if (!optarg && optind < argc && argv[optind][0] >= '0' && argv[optind][0] <= '9')
        optarg = argv[optind++];
}

/* What is asked instead of a training. */
static lf_status check_jobs(const arguments *a, lf_error *err)
{
    if (a->json && !a->count && !a->profile)
        return lf_fail(err, LF_BAD_INPUT, "--json means nothing without --count or --profile");
    if (a->count && (a->resume || a->out || a->overfit || a->check_finite || a->profile))
        return lf_fail(err, LF_BAD_INPUT,
                       "--count trains nothing: give a config, --set and --json alone");
    if (a->profile && a->out)
        return lf_fail(err, LF_BAD_INPUT,
                       "--out %s: --profile writes no run; leave it out, or see --json", a->out);
    return LF_OK;
}

static lf_status parse(int argc, char **argv, arguments *a, lf_error *err)
{
    static const struct option options[] = {
        {"out", required_argument, NULL, 'o'},  {"resume", required_argument, NULL, 'r'},
        {"set", required_argument, NULL, 's'},  {"threads", required_argument, NULL, 't'},
        {"count", no_argument, NULL, 'c'},      {"profile", optional_argument, NULL, 'p'},
        {"json", required_argument, NULL, 'j'}, {"quiet", no_argument, NULL, 'q'},
        {"overfit", no_argument, NULL, 'O'},    {"check-finite", no_argument, NULL, 'f'},
        {"help", no_argument, NULL, 'h'},       {"help-config", no_argument, NULL, 'H'},
        {"version", no_argument, NULL, 'v'},    {NULL, 0, NULL, 0}};
    int option;
    while (!a->done && (option = getopt_long(argc, argv, "h", options, NULL)) != -1) {
        if (option == 'p')
            take_number(argc, argv);
        LF_TRY(parse_option(a, option, err));
    }
    if (a->done)
        return LF_OK;
    if (optind < argc)
        a->config = argv[optind++];
    if (optind < argc)
        return lf_fail(err, LF_BAD_INPUT,
                       "one config is enough, found also %s; see elf-train --help", argv[optind]);
    if (!a->config && !a->resume)
        return lf_fail(err, LF_BAD_INPUT,
                       "no config given; try elf-train configs/reconstruct-tiny.ini");
    LF_TRY(check_jobs(a, err));
    if (a->config && a->resume)
        return lf_fail(err, LF_BAD_INPUT,
                       "%s and --resume: a resumed run has its config in the checkpoint; leave the "
                       "config out, and change keys with --set",
                       a->config);
    return LF_OK;
}

/* runs/<config's file name without its ending>, malloc'd. */
static char *default_out(const char *config)
{
    const char *slash = strrchr(config, '/'), *name = slash ? slash + 1 : config;
    const char *dot = strrchr(name, '.');
    char *out = NULL;
    const int length = dot ? (int)(dot - name) : (int)strlen(name);
    LF_REQUIRE(asprintf(&out, "runs/%.*s", length, name) >= 0, "out of memory");
    return out;
}

static lf_status apply_sets(const arguments *a, lf_config *cfg, lf_error *err)
{
    for (int i = 0; i < a->sets; i++)
        LF_TRY(lf_config_set(cfg, a->set[i], err));
    LF_TRY(lf_config_check(cfg, err));
    lf_config_warn(cfg, stderr);
    return LF_OK;
}

static void catch_signals(void)
{
    struct sigaction action = {.sa_handler = on_signal, .sa_flags = (int)SA_RESETHAND};
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
}

static lf_status train(const arguments *a, const lf_config *cfg, lf_train_options *options,
                       lf_error *err)
{
    options->quiet = a->quiet;
    options->overfit = a->overfit;
    options->check_finite = a->check_finite;
    options->stop = &stop_asked;
    options->begun = &steps_begun;
    options->profile = a->profile;
    options->json = a->json;
    catch_signals();
    return lf_train(cfg, options, err);
}

static lf_status start(const arguments *a, lf_error *err)
{
    lf_config *cfg;
    LF_TRY(lf_config_load(a->config, &cfg, err));
    lf_status status = apply_sets(a, cfg, err);
    if (a->count) {
        if (status == LF_OK)
            status = lf_count(cfg, a->quiet ? NULL : stdout, a->json, err);
        lf_config_free(cfg);
        return status;
    }
    char *out = a->out ? strdup(a->out) : default_out(a->config);
    lf_train_options options = {.out = out};
    if (status == LF_OK)
        status = train(a, cfg, &options, err);
    free(out);
    lf_config_free(cfg);
    return status;
}

/* Into the run's own folder, or with --out into a new one that begins at the checkpoint. */
static lf_status resume_found(const arguments *a, const lf_found *found, lf_error *err)
{
    lf_config *cfg;
    lf_training_state state;
    LF_TRY(lf_checkpoint_config(found->checkpoint, &cfg, &state, err));
    lf_train_options options = {.out = a->out ? a->out : found->directory,
                                .resume = found->checkpoint,
                                .start = state,
                                .fresh = a->out != NULL};
    lf_status status = lf_config_set_trained(cfg, a->sets, a->set, err);
    if (status == LF_OK)
        lf_config_warn(cfg, stderr);
    if (status == LF_OK && !options.out && !a->profile)
        status =
            lf_fail(err, LF_BAD_INPUT, "%s is not in a run's folder: give --out for the new run",
                    found->checkpoint);
    if (status == LF_OK && !a->quiet)
        printf("resuming from %s: step %ld of %ld, parameters, moments, schedule and order of the "
               "data as they were\n",
               found->checkpoint, state.step, lf_config_int(cfg, "train.steps"));
    if (status == LF_OK)
        status = train(a, cfg, &options, err);
    lf_config_free(cfg);
    return status;
}

static lf_status resume(const arguments *a, lf_error *err)
{
    lf_found found = {0};
    LF_TRY(lf_run_find(a->resume, &found, err));
    if (found.note[0])
        fprintf(stderr, "elf-train: %s\n", found.note);
    const lf_status status = resume_found(a, &found, err);
    lf_found_free(&found);
    return status;
}

int main(int argc, char **argv)
{
    lf_openmp_wait_briefly(argv);
    lf_error err = {""};
    arguments a = {0};
    lf_status status = parse(argc, argv, &a, &err);
    if (status == LF_OK && !a.done) {
        if (a.threads)
            omp_set_num_threads(a.threads);
        status = a.resume ? resume(&a, &err) : start(&a, &err);
    }
    if (status != LF_OK)
        fprintf(stderr, "elf-train: %s\n", err.text);
    return (int)status;
}
