/* speed_error.c: settings in turn, and combinations of those that cost little. See speed_error.h.
 */
#include <math.h>
#include <omp.h>

#include "eval/report.h"
#include "eval/speed_error.h"
#include "eval/speed_report.h"
#include "train/progress.h"
#include "train/run_dir.h"

typedef struct trial {
    const lf_speed_options *options;
    lf_speed_runner runner;
    lf_speed_truth *truth;
    lf_raw *exact;
    lf_speed_report report;
    double *best; /* [rows][items][2] seconds, CPU seconds */
    lf_progress progress;
    double started;
    long done;
} trial;

/* ---- one evaluation ---------------------------------------------------------------------------
 */

/* Results of row i: the first ones are scored; seconds are the best of all, memory the most. */
static lf_status note(trial *t, long i, bool first, const lf_raw *raw, lf_error *err)
{
    lf_speed_row *row = &t->report.row[i];
    const long items = lf_speed_items(t->truth);
    double *best = t->best + 2 * i * items, seconds = 0, cpu = 0, above = 0, peak = 0;
    if (first)
        LF_TRY(lf_speed_score(t->truth, t->exact, raw, &row->figures, err));
    for (long k = 0; k < items; k++) {
        const lf_raw_item *item = &raw->item[k];
        best[2 * k] = first ? item->seconds : fmin(best[2 * k], item->seconds);
        best[2 * k + 1] = first ? item->cpu_seconds : fmin(best[2 * k + 1], item->cpu_seconds);
        seconds += best[2 * k] / (double)items;
        cpu += best[2 * k + 1] / (double)items;
        peak = fmax(peak, item->peak_mb);
        above = fmax(above, item->peak_mb - raw->item[0].before_mb);
    }
    row->figures.seconds = seconds;
    row->figures.cpu_seconds = cpu;
    row->figures.memory_mb = first ? above : fmax(above, row->figures.memory_mb);
    row->figures.peak_mb = first ? peak : fmax(peak, row->figures.peak_mb);
    t->report.whole_process |= raw->whole_process;
    return LF_OK;
}

static lf_status measure(trial *t, long i, bool first, lf_error *err)
{
    lf_raw *raw;
    const lf_speed_setting *s = &t->report.row[i].setting;
    LF_TRY(lf_speed_run(&t->runner, s, &raw, err));
    if (i == LF_SPEED_EXACT)
        t->exact = raw;
    const lf_status status = note(t, i, first, raw, err);
    if (i != LF_SPEED_EXACT)
        lf_raw_free(raw);
    lf_progress_update(&t->progress, ++t->done, lf_seconds_now() - t->started, "%s", s->name);
    return status;
}

/* A new row, with room for its times. */
static long add_row(trial *t, const lf_speed_setting *s)
{
    lf_speed_report_add(&t->report, s);
    t->best = realloc(t->best, (size_t)(2 * t->report.rows * lf_speed_items(t->truth) + 1) *
                                   sizeof *t->best);
    LF_REQUIRE(t->best, "out of memory");
    return t->report.rows - 1;
}

/* The exact result once, all others in turn. */
static lf_status measure_settings(trial *t, const lf_config *cfg, lf_error *err)
{
    long count;
    lf_speed_setting *setting = lf_speed_settings(cfg, &count);
    for (long i = 0; i < count; i++)
        add_row(t, &setting[i]);
    free(setting);
    const long repeats = t->options->repeats;
    t->progress =
        lf_progress_start(stdout, "evaluation", 0, 1 + (count - 1) * repeats, t->options->quiet);
    lf_status status = measure(t, LF_SPEED_EXACT, true, err);
    for (long r = 0; status == LF_OK && r < repeats; r++)
        for (long i = LF_SPEED_CONFIG; status == LF_OK && i < count; i++)
            status = measure(t, i, r == 0, err);
    lf_progress_end(&t->progress);
    return status;
}

/* ---- combinations -----------------------------------------------------------------------------
 */

/* A saving counts if it takes less than this share of the time: repeats differ by less. */
static const double clear_gain = 0.97;

/* Of each saving the fastest good row that is clearly faster than the config's, the fastest first.
 * Returns how many. */
static long candidates(const lf_speed_report *r, long *out)
{
    const double most = r->row[LF_SPEED_CONFIG].figures.seconds;
    long count = 0;
    for (long i = LF_SPEED_FIRST; i < r->rows; i++) {
        const lf_speed_row *row = &r->row[i];
        const double seconds = row->figures.seconds;
        if (row->setting.f64 || row->setting.keys == 0 || !strcmp(row->setting.saving, "all") ||
            !(seconds < clear_gain * most) || !lf_speed_good(r, row))
            continue;
        long same = 0;
        while (same < count && strcmp(r->row[out[same]].setting.saving, row->setting.saving))
            same++;
        if (same == count)
            count++;
        else if (!(seconds < r->row[out[same]].figures.seconds))
            continue;
        out[same] = i;
    }
    for (long i = 1; i < count; i++) /* few: sort by insertion */
        for (long k = i;
             k > 0 && r->row[out[k]].figures.seconds < r->row[out[k - 1]].figures.seconds; k--) {
            const long swap = out[k];
            out[k] = out[k - 1];
            out[k - 1] = swap;
        }
    return count;
}

static lf_status combine(trial *t, const lf_config *cfg, lf_error *err)
{
    lf_speed_report *r = &t->report;
    long *list = calloc((size_t)r->rows, sizeof *list);
    LF_REQUIRE(list, "out of memory");
    const long count = candidates(r, list), repeats = t->options->repeats;
    long best = count ? list[0] : LF_SPEED_CONFIG;
    t->done = 0;
    t->started = lf_seconds_now();
    t->progress = lf_progress_start(stdout, "evaluation of combinations", 0,
                                    count > 1 ? (count - 1) * repeats : 0, t->options->quiet);
    lf_status status = LF_OK;
    for (long k = 1; status == LF_OK && k < count; k++) {
        const lf_speed_setting both =
            lf_speed_join(&r->row[best].setting, &r->row[list[k]].setting);
        if (!lf_speed_allowed(cfg, &both))
            continue;
        const long row = add_row(t, &both);
        for (long n = 0; status == LF_OK && n < repeats; n++)
            status = measure(t, row, n == 0, err);
        if (status == LF_OK && lf_speed_good(r, &r->row[row]) &&
            r->row[row].figures.seconds < clear_gain * r->row[best].figures.seconds)
            best = row;
    }
    lf_progress_end(&t->progress);
    free(list);
    return status;
}

/* ---- the whole --------------------------------------------------------------------------------
 */

static lf_status write_results(trial *t, lf_error *err)
{
    const lf_speed_options *o = t->options;
    lf_speed_report *r = &t->report;
    lf_speed_report_finish(r);
    if (!o->quiet)
        lf_speed_report_print(r, stdout);
    if (o->json) {
        json_t *json = lf_speed_report_json(r);
        const lf_status status = lf_json_write(o->json, json, err);
        json_decref(json);
        LF_TRY(status);
    }
    if (!o->out)
        return LF_OK;
    char path[4096];
    if (snprintf(path, sizeof path, "%s/speed-error.png", o->out) >= (int)sizeof path)
        return lf_fail(err, LF_BAD_INPUT, "--out %.200s...: the name is too long", o->out);
    LF_TRY(lf_speed_report_plot(r, path, err));
    if (!o->quiet)
        printf("picture: %s\n", path);
    return LF_OK;
}

static lf_status run(trial *t, const lf_config *cfg, lf_error *err)
{
    const long items = lf_speed_items(t->truth);
    const char **name = calloc((size_t)items + 1, sizeof *name);
    LF_REQUIRE(name, "out of memory");
    for (long i = 0; i < items; i++)
        name[i] = lf_speed_item_name(t->truth, i);
    t->report.items = items;
    t->report.item = name;
    t->started = lf_seconds_now();
    lf_status status = measure_settings(t, cfg, err);
    if (status == LF_OK)
        status = combine(t, cfg, err);
    if (status == LF_OK)
        status = write_results(t, err);
    free(name);
    return status;
}

lf_status lf_speed_error(const lf_config *cfg, const lf_speed_options *o, lf_error *err)
{
    const bool rendering = lf_config_renders(cfg);
    trial t = {.options = o,
               .report = {.rendering = rendering,
                          .model = lf_config_choice(cfg, "model.type"),
                          .split = o->split,
                          .eval_setting = o->setting,
                          .checkpoint = o->given,
                          .sets = o->sets,
                          .set = o->set,
                          .repeats = o->repeats,
                          .threads = o->threads ? o->threads : omp_get_max_threads(),
                          .tolerance = lf_speed_tolerance(rendering)}};
    if (o->out)
        LF_TRY(lf_make_folders(o->out, err));
    LF_TRY(lf_speed_runner_open(o, &t.runner, err));
    lf_status status = lf_speed_truth_open(cfg, o->split, o->setting, o->items, &t.truth, err);
    if (status == LF_OK && lf_speed_items(t.truth) == 0)
        status = lf_fail(err, LF_BAD_INPUT, "the split %s has nothing to evaluate", o->split);
    if (status == LF_OK)
        status = run(&t, cfg, err);
    lf_speed_truth_close(t.truth);
    lf_speed_runner_close(&t.runner);
    lf_speed_report_clear(&t.report);
    lf_raw_free(t.exact);
    free(t.best);
    return status;
}
