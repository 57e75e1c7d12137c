/* speed_report.c: see speed_report.h. */
#include "eval/speed_report.h"

#include <math.h>

#include "eval/pareto.h"

/* ---- rows -------------------------------------------------------------------------------------
 */

lf_speed_row *lf_speed_report_add(lf_speed_report *r, const lf_speed_setting *setting)
{
    if (r->rows == r->room) {
        r->room = r->room ? 2 * r->room : 32;
        r->row = realloc(r->row, (size_t)r->room * sizeof *r->row);
        LF_REQUIRE(r->row, "out of memory for %ld settings", r->room);
    }
    lf_speed_row *row = &r->row[r->rows++];
    *row = (lf_speed_row){.setting = *setting};
    return row;
}

void lf_speed_report_clear(lf_speed_report *r)
{
    free(r->row);
    r->row = NULL;
    r->rows = r->room = 0;
}

double lf_speed_tolerance(bool rendering)
{
    return rendering ? 0.05 : 0.005;
}

bool lf_speed_good(const lf_speed_report *r, const lf_speed_row *row)
{
    return row->figures.metric >= r->row[LF_SPEED_EXACT].figures.metric - r->tolerance;
}

void lf_speed_report_finish(lf_speed_report *r)
{
    const long n = r->rows;
    double *axis[4]; /* seconds, memory, error, -metric */
    bool *on = calloc((size_t)n, sizeof *on);
    for (int i = 0; i < 4; i++)
        axis[i] = calloc((size_t)n, sizeof *axis[i]);
    LF_REQUIRE(on && axis[0] && axis[1] && axis[2] && axis[3], "out of memory");
    for (long i = 0; i < n; i++) {
        const lf_speed_figures *f = &r->row[i].figures;
        axis[0][i] = f->seconds;
        axis[1][i] = f->memory_mb;
        axis[2][i] = i == LF_SPEED_EXACT ? NAN : f->error; /* nothing is measured against itself */
        axis[3][i] = i == LF_SPEED_EXACT ? NAN : -f->metric;
    }
    for (int k = 0; k < LF_SPEED_FRONTS; k++) {
        lf_pareto_front(n, axis[k / 2], axis[2 + k % 2], on);
        for (long i = 0; i < n; i++)
            r->row[i].front[k] = on[i];
    }
    for (long i = 0; i < n; i++)
        axis[3][i] = r->row[i].figures.metric;
    r->recommended = lf_pareto_choose(n, axis[0], axis[3], axis[3][LF_SPEED_EXACT], r->tolerance);
    LF_REQUIRE(r->recommended >= 0, "the exact result is not within the tolerance of itself");
    for (int i = 0; i < 4; i++)
        free(axis[i]);
    free(on);
}

/* ---- texts ------------------------------------------------------------------------------------
 */

static const char *metric_name(const lf_speed_report *r)
{
    return r->rendering ? "PSNR" : "IoU";
}

/* A word as a shell takes it. */
static void put_word(FILE *out, const char *word)
{
    static const char plain[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                                "_-+=./,:@%";
    if (word[0] && strspn(word, plain) == strlen(word)) {
        fprintf(out, " %s", word);
        return;
    }
    fputs(" '", out);
    for (; *word; word++)
        fputs(*word == '\'' ? "'\\''" : (char[]){*word, 0}, out);
    fputc('\'', out);
}

char *lf_speed_command(const lf_speed_report *r, const lf_speed_row *row)
{
    char *text = NULL;
    size_t size;
    FILE *out = open_memstream(&text, &size);
    LF_REQUIRE(out, "out of memory");
    fprintf(out, "elf-eval%s --checkpoint", row->setting.f64 ? "-f64" : "");
    put_word(out, r->checkpoint);
    for (int i = 0; i < r->sets + row->setting.keys; i++) {
        fputs(" --set", out);
        put_word(out, i < r->sets ? r->set[i] : row->setting.key[i - r->sets]);
    }
    LF_REQUIRE(fclose(out) == 0 && text, "out of memory");
    return text;
}

static void print_row(const lf_speed_report *r, long i, FILE *out)
{
    const lf_speed_row *row = &r->row[i];
    const lf_speed_figures *f = &row->figures;
    fprintf(out, "%3ld  %-40.40s %9.4f %6.2f %9.4f %8.1f %10.2e %10.2e %9.4f %s%s\n", i,
            row->setting.name, f->seconds, r->row[LF_SPEED_CONFIG].figures.seconds / f->seconds,
            f->cpu_seconds, f->memory_mb, f->error, f->point_largest, f->metric,
            row->front[LF_SECONDS_ERROR] ? "*" : " ", i == r->recommended ? "<" : "");
}

void lf_speed_report_print(const lf_speed_report *r, FILE *out)
{
    const lf_speed_row *chosen = &r->row[r->recommended], *config = &r->row[LF_SPEED_CONFIG];
    fprintf(out, "%s, %s, split %s: %ld %s, %ld threads, best of %ld\n",
            r->rendering ? "rendering" : "reconstruction", r->model, r->split, r->items,
            r->rendering ? "views" : "shapes", r->threads, r->repeats);
    fprintf(out, "%3s  %-40s %9s %6s %9s %8s %10s %10s %9s\n", "", "setting", "seconds", "faster",
            "CPU s", "MB", "error", "largest", metric_name(r));
    for (long i = 0; i < r->rows; i++)
        print_row(r, i, out);
    fputs(r->rendering
              ? "error: RMS difference of the colours (0..1) from the exact picture; largest: of a "
                "colour; PSNR in dB\n"
              : "error: Chamfer distance to the exact surface, in longest edges of the true box; "
                "largest: of the distances at 4096 fixed points; IoU against the truth\n",
          out);
    fprintf(out,
            "seconds of an item; faster: times as configured; CPU s: of all threads; MB: most "
            "resident memory above what the "
            "process held before%s; *: on the front of seconds and error; <: recommended\n",
            r->whole_process ? ", reading of data included" : "");
    char *command = lf_speed_command(r, chosen);
    fprintf(out,
            "recommended: %s: %.2f times as fast as configured, %s %.4f (exact %.4f, tolerance "
            "%g)\n  %s\n",
            chosen->setting.name, config->figures.seconds / chosen->figures.seconds, metric_name(r),
            chosen->figures.metric, r->row[LF_SPEED_EXACT].figures.metric, r->tolerance, command);
    free(command);
}

/* ---- JSON -------------------------------------------------------------------------------------
 */

static json_t *number_json(double x)
{
    return isfinite(x) ? json_real(x) : json_null();
}

/* A text of the user's; bytes beyond ASCII become '?' where it is not UTF-8. */
static json_t *text_json(const char *text)
{
    json_t *json = json_string(text);
    if (json)
        return json;
    char *ascii = strdup(text);
    LF_REQUIRE(ascii, "out of memory");
    for (char *c = ascii; *c; c++)
        if (*c & 0x80)
            *c = '?';
    json = json_string(ascii);
    free(ascii);
    return json;
}

static json_t *keys_json(const lf_speed_setting *s)
{
    json_t *keys = json_array();
    for (int i = 0; i < s->keys; i++)
        json_array_append_new(keys, json_string(s->key[i]));
    return keys;
}

static json_t *row_json(const lf_speed_report *r, long i)
{
    static const char *const front[LF_SPEED_FRONTS] = {"seconds_error", "seconds_metric",
                                                       "memory_error", "memory_metric"};
    const lf_speed_row *row = &r->row[i];
    const lf_speed_figures *f = &row->figures;
    json_t *json =
        json_pack("{s:I,s:s,s:s,s:s,s:o}", "number", (json_int_t)i, "name", row->setting.name,
                  "saving", row->setting.saving, "program",
                  row->setting.f64 ? "elf-eval-f64" : "elf-eval", "set", keys_json(&row->setting));
    json_t *on = json_object();
    for (int k = 0; k < LF_SPEED_FRONTS; k++)
        json_object_set_new(on, front[k], json_boolean(row->front[k]));
    json_object_set_new(json, "seconds", number_json(f->seconds));
    json_object_set_new(json, "cpu_seconds", number_json(f->cpu_seconds));
    json_object_set_new(json, "memory_mb", number_json(f->memory_mb));
    json_object_set_new(json, "peak_rss_mb", number_json(f->peak_mb));
    json_object_set_new(json, "work", number_json(f->work));
    json_object_set_new(json, "error", number_json(f->error));
    json_object_set_new(json, "mean_difference", number_json(f->point_mean));
    json_object_set_new(json, "largest_difference", number_json(f->point_largest));
    json_object_set_new(json, "unseen", number_json(f->unseen));
    json_object_set_new(json, "metric", number_json(f->metric));
    if (!r->rendering)
        json_object_set_new(json, "chamfer_l1", number_json(10 * f->chamfer));
    json_object_set_new(json, "front", on);
    return json;
}

static json_t *definitions_json(const lf_speed_report *r)
{
    return json_pack(
        "{s:s,s:s,s:s,s:s,s:s,s:s,s:s,s:s,s:s}", "seconds",
        "of an item, from its views to mesh or picture: the best of the repeats, mean over items",
        "cpu_seconds", "the same of all threads together: what a shared machine disturbs less",
        "memory_mb",
        "peak_rss_mb less what was resident before the first item, when model and data were there",
        "peak_rss_mb",
        r->whole_process
            ? "largest resident set of a process for this setting alone, 10^6 bytes; reading of "
              "the data included, as the system cannot reset the high-water mark"
            : "largest resident set during any item, in a process for this setting alone, 10^6 "
              "bytes; high-water mark reset before each item",
        "work",
        r->rendering ? "(sample, source view) pairs that a network computed, of an item"
                     : "points at which the network was evaluated, of an item",
        "error",
        r->rendering ? "RMS difference of the colours, 0..1, from the exact picture"
                     : "Chamfer distance, Euclidean and to the surface, between the mesh and the "
                       "exact one, in longest edges of the true box",
        "differences",
        r->rendering
            ? "of the colours from the exact ones: mean and largest"
            : "of the distances at 4096 fixed points from the exact ones, in longest edges "
              "of the true box: mean and largest; unseen: share of points that only the "
              "exact result sees",
        "metric",
        r->rendering ? "PSNR against the photograph, dB, mean over items"
                     : "IoU against the truth, mean over items",
        "front", "no other setting is better in both; the exact result is left out");
}

json_t *lf_speed_report_json(const lf_speed_report *r)
{
    json_t *items = json_array(), *rows = json_array();
    char *command = lf_speed_command(r, &r->row[r->recommended]);
    for (long i = 0; i < r->items; i++)
        json_array_append_new(items, text_json(r->item[i]));
    for (long i = 0; i < r->rows; i++)
        json_array_append_new(rows, row_json(r, i));
    json_t *chosen = row_json(r, r->recommended);
    json_object_set_new(chosen, "command", text_json(command));
    json_object_set_new(chosen, "faster",
                        number_json(r->row[LF_SPEED_CONFIG].figures.seconds /
                                    r->row[r->recommended].figures.seconds));
    free(command);
    return json_pack("{s:s,s:s,s:s,s:s,s:s?,s:o,s:I,s:I,s:s,s:f,s:o,s:o,s:o}", /**/
                     "experiment", "speed-error", "family",
                     r->rendering ? "rendering" : "reconstruction", "model", r->model, "split",
                     r->split, "eval_setting", r->eval_setting, "items", items, "threads",
                     (json_int_t)r->threads, "repeats", (json_int_t)r->repeats, "metric",
                     r->rendering ? "psnr" : "iou", "tolerance", r->tolerance, "definitions",
                     definitions_json(r), "settings", rows, "recommended", chosen);
}
