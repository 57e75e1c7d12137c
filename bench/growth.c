/* growth.c: measures how a training step and an evaluation grow. See growth.h.
 *
 * The sizes of a row run in turn, so that a machine that slows down slows all of them.
 */
#include "bench/growth.h"

#include <getopt.h>
#include <omp.h>

#include "bench/command_line.h"
#include "bench/report.h"
#include "bench/steps.h"

/* ---- what grows ------------------------------------------------------------------------------ */

enum { VIEWS, EDGE, POINTS, RAYS, SAMPLES, WIDTH, QUANTITIES };

static const char *const quantities[QUANTITIES] = {"views", "pixels",  "points",
                                                   "rays",  "samples", "width"};

/* Of each quantity four sizes, of which the second is the config's; of width three, from the first
 * on. 0: the work does not have the quantity. Pixels are those of a picture, by its edge. */
typedef struct work {
    const char *name;
    bool renders, evaluates;
    long size[QUANTITIES][LF_GROWTH_SIZES];
} work;

#define VIEWS_AND_EDGES                                                                            \
    {4, 8, 16, 32},                                                                                \
    {                                                                                              \
        65, 97, 129, 193                                                                           \
    }
#define SOURCES_AND_EDGES                                                                          \
    {3, 6, 12, 24},                                                                                \
    {                                                                                              \
        72, 100, 140, 200                                                                          \
    }
#define SAMPLES_AND_WIDTHS                                                                         \
    {20, 40, 80, 160},                                                                             \
    {                                                                                              \
        1, 2, 4                                                                                    \
    }

/* configs/reconstruct-tiny.ini and configs/render-tiny.ini (but with as many scalars as channels of
 * the other types); evaluated are more points, and the rays
 * of a row of a picture. */
static const work works[] = {
    {"step", false, false, {VIEWS_AND_EDGES, {256, 512, 1024, 2048}, {0}, {0}, {1, 2, 4}}},
    {"distances", false, true, {VIEWS_AND_EDGES, {2048, 4096, 8192, 16384}, {0}, {0}, {1, 2, 4}}},
    {"step", true, false, {SOURCES_AND_EDGES, {0}, {32, 64, 128, 256}, SAMPLES_AND_WIDTHS}},
    {"row", true, true, {SOURCES_AND_EDGES, {0}, {50, 100, 200, 400}, SAMPLES_AND_WIDTHS}},
};
enum { WORKS = sizeof works / sizeof *works };

/* Its config, as changes of the defaults: as in configs/. */
typedef struct network {
    const char *name;
    bool renders;
    const char *sets[8];
} network;

#define PLAIN                                                                                      \
    "model.backbone=plain", "model.stem_fields=2", "model.stages=2, 1, 1", "model.first_stride=1", \
        "model.fields=2, 3, 4", "model.sample_image=false"

static const network networks[] = {
    {"equivariant", false, {"model.type=equivariant"}},
    {"disn", false, {"model.type=disn", PLAIN}},
    {"fvor", false, {"model.type=fvor", PLAIN}},
    {"ibrnet-sdf", false, {"model.type=ibrnet-sdf", "model.mlp=16"}},
    {"renderer", true, {"model.type=renderer", "render.types=0, 1, 2, 4"}},
    {"ibrnet", true, {"model.type=ibrnet"}},
};
enum { NETWORKS = sizeof networks / sizeof *networks };

/* What width multiplies: numbers and lists. IBRNet has widths of 64, 32 and 16 besides. */
static const char *const widths[] = {"model.stem_fields", "model.features",       "model.scalars",
                                     "model.vectors",     "model.global",         "model.width",
                                     "render.features",   "render.feature_width", "render.hidden",
                                     "render.width",      "render.channels"};
static const char *const width_lists[] = {"model.fields", "model.mlp", "model.point",
                                          "model.volume"};

static int base_of(int quantity)
{
    return quantity == WIDTH ? 0 : 1;
}

static int sizes_of(int quantity)
{
    return quantity == WIDTH ? LF_GROWTH_SIZES - 1 : LF_GROWTH_SIZES;
}

/* How many there are. */
static double count_of(int quantity, long size)
{
    return quantity == EDGE ? (double)(size * size) : (double)size;
}

/* ---- work of a size -------------------------------------------------------------------------- */

static void set_numbers(lf_config *cfg, const char *key, int count, const long *x, long times)
{
    char text[256];
    lf_error err;
    int at = snprintf(text, sizeof text, "%s=", key);
    for (int i = 0; i < count; i++)
        at += snprintf(text + at, sizeof text - (size_t)at, "%s%ld", i ? ", " : "", x[i] * times);
    LF_REQUIRE(lf_config_set(cfg, text, &err) == LF_OK, "%s", err.text);
}

static void widen(lf_config *cfg, long times)
{
    for (size_t i = 0; i < sizeof widths / sizeof *widths; i++) {
        const long x = lf_config_int(cfg, widths[i]);
        set_numbers(cfg, widths[i], 1, &x, times);
    }
    for (size_t i = 0; i < sizeof width_lists / sizeof *width_lists; i++) {
        int count;
        const long *x = lf_config_ints(cfg, width_lists[i], &count);
        set_numbers(cfg, width_lists[i], count, x, times);
    }
}

/* All quantities as in the config but one, at its size number `at`. */
static lf_bench_work *open_work(const network *n, const work *w, int quantity, int at)
{
    enum { OBJECTS = 2 };
    long x[QUANTITIES];
    int sets = 0;
    for (int q = 0; q < QUANTITIES; q++)
        x[q] = w->size[q][q == quantity ? at : base_of(q)];
    while (n->sets[sets])
        sets++;
    lf_config *cfg = lf_bench_config(n->sets, sets);
    widen(cfg, x[WIDTH]);
    lf_bench_work *out;
    if (w->renders) {
        set_numbers(cfg, "render.sources", 1, &x[VIEWS], 1);
        set_numbers(cfg, "render.samples", 1, &x[SAMPLES], 1);
        out =
            lf_bench_render_open(cfg, &(lf_bench_render){x[RAYS], x[EDGE], x[EDGE], w->evaluates});
    } else {
        set_numbers(cfg, "data.image_size", 1, &x[EDGE], 1);
        out = lf_bench_recon_open(
            cfg, &(lf_bench_recon){w->evaluates ? 1 : OBJECTS, x[VIEWS], x[POINTS],
                                   lf_config_int(cfg, "train.tile_points"), 2, w->evaluates});
    }
    lf_config_free(cfg);
    return out;
}

static void measure(const network *n, const work *w, int quantity, int repeats, lf_growth_row *row)
{
    lf_bench_work *size[LF_GROWTH_SIZES];
    *row = (lf_growth_row){.system = n->name,
                           .work = w->name,
                           .quantity = quantities[quantity],
                           .count = sizes_of(quantity),
                           .base = base_of(quantity)};
    for (int k = 0; k < row->count; k++) {
        size[k] = open_work(n, w, quantity, k);
        size[k]->run(size[k]); /* warms up */
        row->size[k] = count_of(quantity, w->size[quantity][k]);
        row->seconds[k] = INFINITY;
    }
    for (int i = 0; i < repeats; i++)
        for (int k = 0; k < row->count; k++) {
            const double start = lf_bench_now();
            size[k]->run(size[k]);
            row->seconds[k] = fmin(row->seconds[k], lf_bench_now() - start);
        }
    for (int k = 0; k < row->count; k++) {
        row->bytes[k] = size[k]->memory;
        size[k]->close(size[k]);
    }
}

/* ---- the program ----------------------------------------------------------------------------- */

typedef struct options {
    bool list;
    const char *json, *picture, *network[NETWORKS];
    int networks, threads, repeats, count;
    char **names; /* of quantities */
} options;

static bool chosen(const char *name, int count, const char *const *names)
{
    for (int i = 0; i < count; i++)
        if (strcmp(name, names[i]) == 0)
            return true;
    return count == 0;
}

static void run_work(const options *o, const network *n, const work *w, lf_growth_row *rows,
                     int *count)
{
    for (int q = 0; q < QUANTITIES; q++) {
        if (w->size[q][0] == 0 || !chosen(quantities[q], o->count, (const char *const *)o->names))
            continue;
        LF_REQUIRE(*count < LF_GROWTH_ROWS, "more than %d rows", LF_GROWTH_ROWS);
        if (o->list) {
            printf("%-11s %-8s %s\n", n->name, w->name, quantities[q]);
            ++*count;
            continue;
        }
        if (*count == 0)
            lf_growth_head(stdout);
        measure(n, w, q, o->repeats, &rows[*count]);
        lf_growth_line(stdout, &rows[(*count)++]);
    }
}

static lf_status write_files(const options *o, const lf_growth_row *rows, int count, lf_error *err)
{
    if (o->json) {
        json_t *report = lf_growth_json(rows, count, o->threads);
        const lf_status status = lf_bench_json_write(o->json, report, err);
        json_decref(report);
        LF_TRY(status);
    }
#ifndef LF_DOUBLE
    if (o->picture)
        LF_TRY(lf_growth_picture(o->picture, rows, count, err));
#endif
    return LF_OK;
}

static lf_status run_all(const options *o, lf_error *err)
{
    lf_growth_row *rows = lf_bench_room(LF_GROWTH_ROWS, sizeof *rows);
    int count = 0;
    for (int i = 0; i < NETWORKS; i++)
        for (int k = 0; k < WORKS; k++)
            if (networks[i].renders == works[k].renders &&
                chosen(networks[i].name, o->networks, o->network))
                run_work(o, &networks[i], &works[k], rows, &count);
    lf_status status =
        count ? LF_OK
              : lf_fail(err, LF_BAD_INPUT,
                        "these systems have none of these; elf-bench growth --list says what has");
    if (status == LF_OK && !o->list)
        status = write_files(o, rows, count, err);
    free(rows);
    return status;
}

static void usage(void)
{
    printf("usage: elf-bench growth [QUANTITY...] [options]\n"
           "How time and memory grow with the number of views, pixels (of a view), points, rays,\n"
           "samples (of a ray), and with the width of all layers; the others stay those of\n"
           "reconstruct-tiny.ini and render-tiny.ini (with 4 scalars). Of a training step, and of\n"
           "what evaluation does once the views' maps are made: distances at points, a row of a "
           "picture.\n"
           "  --system NAME   this one alone (again: and that one): equivariant, disn, fvor,\n"
           "                  ibrnet-sdf, renderer, ibrnet\n"
           "  --list          say what there is\n"
           "  --threads N     (default: all)\n"
           "  --repeats N     runs of each size, of which the best counts (default: 15)\n"
           "  --json FILE     all of it\n"
           "  --picture FILE  PNG: time over size, a panel for each system and work\n"
           "Columns: sizes; the best time, and the memory held, of each; the exponent p of n^p,\n"
           "over all sizes (fit) and between the two largest (last).\n");
}

static lf_status add_network(options *o, const char *name, lf_error *err)
{
    for (int i = 0; i < NETWORKS; i++)
        if (strcmp(networks[i].name, name) == 0 && o->networks < NETWORKS) {
            o->network[o->networks++] = networks[i].name;
            return LF_OK;
        }
    return lf_fail(err, LF_BAD_INPUT, "--system %s: elf-bench growth --help names them", name);
}

static lf_status set_option(int letter, options *o, lf_error *err)
{
    switch (letter) {
    case 'l':
        o->list = true;
        return LF_OK;
    case 's':
        return add_network(o, optarg, err);
    case 'j':
        o->json = optarg;
        return lf_bench_check_file(optarg, err);
    case 'p':
        o->picture = optarg;
        return lf_bench_check_picture(optarg, err);
    case 't':
        return lf_bench_positive("--threads", optarg, &o->threads, err);
    case 'r':
        return lf_bench_positive("--repeats", optarg, &o->repeats, err);
    case 'h':
        usage();
        exit(0);
    default:
        return lf_fail(err, LF_BAD_INPUT, "elf-bench growth --help shows what is allowed");
    }
}

static lf_status parse(int argc, char **argv, options *o, lf_error *err)
{
    static const struct option known[] = {
        {"list", no_argument, NULL, 'l'},          {"system", required_argument, NULL, 's'},
        {"json", required_argument, NULL, 'j'},    {"picture", required_argument, NULL, 'p'},
        {"threads", required_argument, NULL, 't'}, {"repeats", required_argument, NULL, 'r'},
        {"help", no_argument, NULL, 'h'},          {0}};
    for (int c; (c = getopt_long(argc, argv, "", known, NULL)) != -1;)
        LF_TRY(set_option(c, o, err));
    o->names = argv + optind;
    o->count = argc - optind;
    for (int i = 0; i < o->count; i++)
        if (!chosen(o->names[i], QUANTITIES, quantities))
            return lf_fail(err, LF_BAD_INPUT,
                           "%s: what grows is views, pixels, points, rays, samples or width",
                           o->names[i]);
    return LF_OK;
}

lf_status lf_growth_main(int argc, char **argv, lf_error *err)
{
    options o = {.repeats = 15, .threads = omp_get_max_threads()};
    LF_TRY(parse(argc, argv, &o, err));
    omp_set_num_threads(o.threads);
    return run_all(&o, err);
}
