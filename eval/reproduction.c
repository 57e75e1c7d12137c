/* reproduction.c: the page of docs/reproduction.md. See reproduction.h. */
#include <math.h>
#include <unistd.h>

#include "autograd/atomic_file.h"
#include "eval/reproduction_cells.h"

/* ---- cells ----------------------------------------------------------------------------------- */

static int figure_at(const json_t *figures, size_t i)
{
    return lf_result_figure_of(json_string_value(json_array_get(figures, i)));
}

static void print_cell(const lf_results *r, const lf_cell *c, const json_t *figures, FILE *out)
{
    const lf_moments first = lf_moments_of(r, c, figure_at(figures, 0));
    if (first.n + first.lacking == 0) {
        fputs(" not run |", out);
        return;
    }
    for (size_t i = 0; i < json_array_size(figures); i++) {
        const int figure = figure_at(figures, i), digits = lf_figure_digits(figure);
        const lf_moments m = lf_moments_of(r, c, figure);
        fputs(i ? " / " : " ", out);
        if (m.n == 0 || m.lacking)
            fputs("–", out);
        else
            fprintf(out, "%.*f", digits, m.mean);
        if (m.n > 1 && !m.lacking)
            fprintf(out, " ± %.*f", digits, m.deviation);
    }
    fputs(" |", out);
}

static void print_paper_cell(const json_t *value, const json_t *figures, FILE *out)
{
    for (size_t i = 0; i < json_array_size(figures); i++) {
        const json_t *x = json_array_get(value, i);
        fputs(i ? " / " : " ", out);
        if (json_is_number(x))
            fprintf(out, "%.*f", lf_figure_digits(figure_at(figures, i)), json_number_value(x));
        else
            fputs("–", out);
    }
    fputs(" |", out);
}

/* ---- a table of the paper -------------------------------------------------------------------- */

/* Is there a result in any setting? */
static bool was_run(const lf_results *r, const json_t *table, const json_t *row, const lf_group *g)
{
    char train[32];
    for (size_t i = 0; i < json_array_size(json_object_get(table, "settings")); i++) {
        const lf_cell c = lf_cell_at(table, row, g, i, train);
        const lf_moments m = lf_moments_of(r, &c, figure_at(json_object_get(table, "figures"), 0));
        if (m.n + m.lacking > 0)
            return true;
    }
    return false;
}

/* A row of elf's figures: of a group, or of none. */
static void print_row(const lf_results *r, const json_t *table, const json_t *row,
                      const lf_group *g, FILE *out)
{
    char train[32];
    for (size_t i = 0; i < json_array_size(json_object_get(table, "settings")); i++) {
        const lf_cell c = lf_cell_at(table, row, g, i, train);
        print_cell(r, &c, json_object_get(table, "figures"), out);
    }
    fputc('\n', out);
}

static void print_system(const lf_results *r, const json_t *table, const json_t *row,
                         const lf_group *g, long groups, FILE *out)
{
    const json_t *values = json_object_get(row, "values");
    fprintf(out, "| %s | paper |", lf_text_of(row, "label"));
    for (size_t i = 0; i < json_array_size(json_object_get(table, "settings")); i++)
        print_paper_cell(json_array_get(values, i), json_object_get(table, "figures"), out);
    fputc('\n', out);
    bool any = false;
    for (long i = 0; i < groups; i++) {
        if (!was_run(r, table, row, &g[i]))
            continue;
        fprintf(out, "| | elf, %s, %s |", g[i].size, g[i].data);
        print_row(r, table, row, &g[i], out);
        any = true;
    }
    if (!any) {
        fputs("| | elf |", out);
        print_row(r, table, row, NULL, out);
    }
}

/* A picture of the folder, if it is there. */
static void print_picture(const lf_results *r, const lf_group *g, const char *name,
                          const char *what, FILE *out)
{
    char path[4400];
    snprintf(path, sizeof path, "%.4000s/%s-%s-%s.png", r->folder, g->size, g->data, name);
    if (access(path, R_OK) == 0)
        fprintf(out, "\n![%s, %s: %s](reproduction/%s-%s-%s.png)\n", g->size, g->data, what,
                g->size, g->data, name);
}

static void print_pictures(const lf_results *r, const json_t *table, const lf_group *g, long groups,
                           FILE *out)
{
    const bool renders = strcmp(lf_text_of(table, "experiment"), "rendering") == 0;
    const char *name = lf_text_of(table, "name");
    char curves[256];
    snprintf(curves, sizeof curves, "%.200s-curves", name);
    for (long i = 0; i < groups; i++) {
        print_picture(r, &g[i], name,
                      renders ? "true view; each system's, with the frame turned, the change"
                              : "input views, each system's mesh, true mesh",
                      out);
        print_picture(r, &g[i], curves,
                      "loss of each training against steps and seconds; seconds of a "
                      "machine that may have done other work, too",
                      out);
    }
}

static void print_table(const lf_results *r, const json_t *table, FILE *out)
{
    const json_t *rows = json_object_get(table, "rows"),
                 *figures = json_object_get(table, "figures");
    const lf_cell c = {.experiment = lf_text_of(table, "experiment")};
    const char *category = "";
    long groups;
    lf_group *g = lf_groups_of(r, &c, &groups);
    fprintf(out, "\n## %s\n\n%s. A cell:", lf_text_of(table, "title"), lf_text_of(table, "source"));
    for (size_t i = 0; i < json_array_size(figures); i++)
        fprintf(out, "%s %s", i ? " /" : "", json_string_value(json_array_get(figures, i)));
    fputs(".\n", out);
    for (size_t i = 0; i < json_array_size(rows); i++) {
        const json_t *row = json_array_get(rows, i);
        if (strcmp(category, lf_text_of(row, "category")) != 0) {
            category = lf_text_of(row, "category");
            fprintf(out, "\n### %s\n", category);
            fputs("\n| system | from |", out);
            lf_print_settings(table, out);
        }
        print_system(r, table, row, g, groups, out);
    }
    for (long i = 0; i < groups; i++)
        lf_results_print_order(r, table, &g[i], out);
    print_pictures(r, table, g, groups, out);
    free(g);
}

static void print_intro(FILE *out)
{
    fputs(
        "# Reproduction\n"
        "\n"
        "The paper's figures and elf's side by side. Made by `elf-eval reproduction` from the "
        "files in\n"
        "[reproduction/](reproduction/), which `scripts/reproduce` writes: edit neither. The "
        "paper's\n"
        "figures are of ShapeNet and of the published scenes, with larger networks and longer "
        "trainings; elf's\n"
        "are of the sizes and data that the rows name, so compare the order of systems and what a "
        "setting\n"
        "costs, not the numbers. Data: built-in are shapes and scenes that elf makes; files are "
        "meshes and\n"
        "photographs of `--data`, those of these results named in\n"
        "[reproduction/README.md](reproduction/README.md).\n"
        "\n"
        "A/B: trained in setting A, tested in B. iou, psnr, ssim: more is better; chamfer_l1 "
        "(times 10),\n"
        "lpips, pixel_variance (0 ... 255): less is. ± is the sample standard deviation over "
        "seeds, where\n"
        "there are two or more. \"not run\": no result yet; sizes and data of which a system has "
        "no result at all\nhave no row. –: not in the paper, or not available (lpips without its "
        "weights).\n",
        out);
}

/* What the tests check of each system, with random weights, in double and in float. */
static void print_promises(FILE *out)
{
    fputs(
        "\n## What leaves each system's answer as it is\n"
        "\n"
        "Checked by the tests with random weights and random transformations: the largest change, "
        "relative,\n"
        "stays below the number in double / in float; **changes**: by more than 1e-3. Systems by "
        "the names of the\n"
        "table of runs below, with the backbone that their config has.\n"
        "\n"
        "| system | views in another order | frame turned | frame shifted | each view rolled by "
        "quarter turns |\n"
        "|---|---|---|---|---|\n"
        "| equivariant, smoothed, max-pool, scalars | 1e-11 / 2e-5 | 1e-9 / 1e-4 | 1e-9 / 1e-4 | "
        "1e-11 / "
        "2e-5 |\n"
        "| without-se2, without-se2-equal-cost | 1e-11 / 2e-5 | 1e-9 / 1e-4 | 1e-9 / 1e-4 | "
        "**changes** |\n"
        "| ibrnet-sdf | 1e-11 / 2e-5 | **changes** | 1e-9 / 1e-4 | 1e-11 / 2e-5 |\n"
        "| ibrnet-sdf-plain, ibrnet-sdf-plain-equal-cost | 1e-11 / 2e-5 | **changes** | 1e-9 / "
        "1e-4 "
        "| **changes** |\n"
        "| disn, fvor | 1e-11 / 2e-5 | **changes** | **changes** | **changes** |\n"
        "| renderer, renderer-wide, renderer-without-along-ray, renderer-scalars | 1e-7 / 1e-5 | "
        "2e-7 / 1e-4 | 2e-7 / 1e-4 | – |\n"
        "| ibrnet | 1e-7 / 1e-5 | **changes** | 2e-7 / 1e-4 | – |\n"
        "\n"
        "–: not promised. Frame turned, shifted: cameras and points moved while the object's own "
        "frame stays;\n"
        "checked with the C8 network in front of equivariant and with ordinary filters in front "
        "of the others,\n"
        "which is the same to them: no filter is told the frame. Renderers: all cameras moved, up "
        "to 1000 scene\n"
        "radii, colours as floats, whose last place is 1e-7. Turning the object with its cameras "
        "changes no\n"
        "network for reconstruction (1e-11 / 2e-5). `tests/test_compared.c`, `test_recon.c`, "
        "`test_renderer.c`;\n"
        "[method.md](method.md) 5d.3 and 10. On a trained model: `elf-eval --checkpoint RUN "
        "--check-equivariance 20`.\n",
        out);
}

void lf_results_print(const lf_results *r, FILE *out)
{
    const json_t *tables = json_object_get(r->paper, "tables");
    print_intro(out);
    for (size_t i = 0; i < json_array_size(tables); i++)
        print_table(r, json_array_get(tables, i), out);
    print_promises(out);
    lf_results_print_counts(r, out);
    lf_results_print_runs(r, out);
}

static lf_status write_page(const char *path, const char *page, lf_error *err)
{
    const lf_bytes piece = {page, strlen(page)};
    return lf_atomic_write(path, &piece, 1, NULL, err);
}

static char *page_of(const lf_results *r)
{
    char *page = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&page, &size);
    LF_REQUIRE(out, "out of memory");
    lf_results_print(r, out);
    LF_REQUIRE(fclose(out) == 0 && page, "out of memory");
    return page;
}

lf_status lf_reproduction(const char *folder, const char *path, const char *readme, lf_error *err)
{
    lf_results r;
    char *front = NULL;
    LF_TRY(lf_results_read(folder, &r, err));
    lf_status status = readme ? lf_results_front_page(&r, readme, &front, err) : LF_OK;
    if (status == LF_OK) { /* nothing is written before all is read */
        char *page = page_of(&r);
        if (path)
            status = write_page(path, page, err);
        else if (fputs(page, stdout) < 0 || fflush(stdout))
            status = lf_fail(err, LF_FAILED, "the page could not be written");
        free(page);
    }
    if (status == LF_OK && front)
        status = write_page(readme, front, err);
    free(front);
    lf_results_free(&r);
    return status;
}
