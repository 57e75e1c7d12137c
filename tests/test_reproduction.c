/* test_reproduction.c: the page of figures made of a small made-up folder, and what is refused. */
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "eval/reproduction.h"
#include "tests/close.h"
#include "tests/folder.h"

typedef struct folder {
    char path[64];
} folder;

static void put(const folder *f, const char *name, const char *text)
{
    char path[160];
    snprintf(path, sizeof path, "%s/%s", f->path, name);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(text, file);
    assert_int_equal(fclose(file), 0);
}

static const char paper[] =
    "{\"paper\": \"P\", \"tables\": [\n"
    " {\"name\": \"one\", \"title\": \"First\", \"source\": \"Table 9\", \"experiment\":\n"
    "  \"reconstruction\", \"figures\": [\"iou\", \"chamfer_l1\"], \"settings\": [\"I/I\", "
    "\"I/Z\"],\n"
    "  \"rows\": [{\"category\": \"chair\", \"system\": \"ours\", \"label\": \"Ours\",\n"
    "    \"values\": [[0.7, 0.09], [0.6, null]]},\n"
    "   {\"category\": \"chair\", \"system\": \"theirs\", \"label\": \"Theirs\"}]},\n"
    " {\"name\": \"two\", \"title\": \"Second\", \"source\": \"Table 10\", \"experiment\":\n"
    "  \"rendering\", \"figures\": [\"psnr\", \"lpips\"], \"settings\": [\"I/SO3\"],\n"
    "  \"rows\": [{\"category\": \"glossy\", \"system\": \"r\", \"label\": \"R\",\n"
    "    \"values\": [[26.9, 0.1]]}]}]}\n";

/* A result of system "ours" on chairs. */
static void put_run_on(const folder *f, const char *data, const char *name, const char *test,
                       int seed, int steps, double iou)
{
    char text[1024];
    snprintf(
        text, sizeof text,
        "{\"experiment\": \"reconstruction\", \"system\": \"ours\", \"config\": \"c\",\n"
        "\"keys\": \"\", \"size\": \"tiny\", \"size_keys\": \"a.b=1\", \"data\": \"%s\",\n"
        "\"category\": \"chair\", \"train_setting\": \"I\", \"eval_setting\": \"%s\",\n"
        "\"seed\": %d, \"steps\": %d, \"pixels\": 97, \"train_items\": 400, \"test_items\": 40,\n"
        "\"parameters\": 43633, \"train_seconds\": %d.5, \"peak_rss_mb\": 200, \"commit\":\n"
        "\"abc\", \"figures\": {\"iou\": %.17g, \"chamfer_l1\": 0.25, \"empty\": 1}}\n",
        data, test, seed, steps, 100 + seed, iou);
    put(f, name, text);
}

static void put_run(const folder *f, const char *name, const char *test, int seed, int steps,
                    double iou)
{
    put_run_on(f, "built-in", name, test, seed, steps, iou);
}

static int make_folder(void **state)
{
    folder *f = calloc(1, sizeof *f);
    strcpy(f->path, "/tmp/lf_reproduction_XXXXXX");
    if (!f || !mkdtemp(f->path))
        return -1;
    put(f, "paper.json", paper);
    put_run(f, "a.json", "I", 0, 10, 0.5);
    put_run(f, "b.json", "I", 1, 10, 0.7);
    *state = f;
    return 0;
}

static int remove_folder(void **state)
{
    folder *f = *state;
    const int left = remove_tree(f->path);
    free(f);
    return left;
}

/* The page; the caller frees it. */
static char *page_of(const folder *f)
{
    lf_results r;
    lf_error err = {""};
    char *page = NULL;
    size_t size = 0;
    if (lf_results_read(f->path, &r, &err) != LF_OK)
        fail_msg("%s", err.text);
    FILE *out = open_memstream(&page, &size);
    assert_non_null(out);
    lf_results_print(&r, out);
    fclose(out);
    lf_results_free(&r);
    if (!page)
        fail_msg("no page");
    return page;
}

static void assert_has(const char *page, const char *words)
{
    if (page && strstr(page, words))
        return;
    fail_msg("no \"%s\" in:\n%s", words, page ? page : "nothing");
}

static void assert_refused(const folder *f, const char *words)
{
    lf_results r;
    lf_error err = {""};
    assert_int_equal(lf_results_read(f->path, &r, &err), LF_BAD_INPUT);
    assert_has(err.text, words);
    assert_has(err.text, f->path);
}

/* mean 0.6, sample deviation 0.2 / sqrt 2; equal Chamfer distances have none */
static void test_means_and_spread(void **state)
{
    char *page = page_of(*state);
    assert_has(page, "| Ours | paper | 0.700 / 0.090 | 0.600 / – |\n"
                     "| | elf, tiny, built-in | 0.600 ± 0.141 / 0.250 ± 0.000 | not run |\n");
    assert_has(page, "| Theirs | paper | – / – | – / – |\n"
                     "| | elf | not run | not run |\n");
    assert_has(page, "| R | paper | 26.90 / 0.100 |\n| | elf | not run |\n");
    assert_has(page,
               "| tiny, built-in | ours | c | 43633 | 10 | 97 | 400 | 40 | 0 to 1 | 2 | 2 | 101 | "
               "200 | – | abc |");
    assert_has(page, "- tiny, ours: `a.b=1`\n");
    free(page);
}

/* A result of a system on chairs in a setting, IoU alone. */
static void put_system(const folder *f, const char *system, const char *test, int seed, double iou)
{
    char text[1024], name[64];
    snprintf(
        text, sizeof text,
        "{\"experiment\": \"reconstruction\", \"system\": \"%s\", \"config\": \"c\",\n"
        "\"keys\": \"\", \"size\": \"tiny\", \"size_keys\": \"a.b=1\", \"data\": \"built-in\",\n"
        "\"category\": \"chair\", \"train_setting\": \"I\", \"eval_setting\": \"%s\",\n"
        "\"seed\": %d, \"steps\": 10, \"pixels\": 97, \"train_items\": 400, \"test_items\": 40,\n"
        "\"parameters\": 43633, \"train_seconds\": 1.5, \"peak_rss_mb\": 200, \"commit\":\n"
        "\"abc\", \"figures\": {\"iou\": %.17g, \"chamfer_l1\": 0.25}}\n",
        system, test, seed, iou);
    snprintf(name, sizeof name, "%s-%s-%d.json", system, test, seed);
    put(f, name, text);
}

/* paper.json with "ours" as the system that the others are compared with. */
static void put_reference(const folder *f)
{
    char text[2048];
    const char *experiment = strstr(paper, "\"figures\""), *values = strstr(paper, "\"Theirs\"}");
    snprintf(text, sizeof text,
             "%.*s\"reference\": \"ours\", %.*s\"Theirs\", \"values\": [[0.6, 0.1], [0.2, "
             "0.3]]%s",
             (int)(experiment - paper), paper, (int)(values - experiment), experiment,
             values + strlen("\"Theirs\""));
    put(f, "paper.json", text);
}

/* 0.6 of seeds 0.5 and 0.7; the spread of a difference is the root of both variances. */
static void test_who_is_ahead(void **state)
{
    const folder *f = *state;
    char *page;
    put_reference(f);
    put_system(f, "theirs", "I", 0, 0.8);
    put_system(f, "theirs", "I", 1, 0.79);
    put_system(f, "theirs", "Z", 0, 0.35);
    page = page_of(f);
    assert_has(page, "**Ours** above the others in iou: difference");
    assert_has(page, "| | above | I/I | I/Z |\n|---|---|---|---|\n"
                     "| chair | Theirs | **-0.195** ± 0.142 / +0.100 | not run / +0.400 |\n");
    assert_has(page, "| | | I/Z of I/I |\n|---|---|---|\n| chair | Theirs | 44 % / 33 % |\n\n");
    assert_has(page, "### Order of the systems: tiny, built-in\n");
    free(page);
    /* nothing is kept of nothing, and a lead within the spread is not bold */
    put_system(f, "theirs", "I", 0, 0);
    put_system(f, "theirs", "I", 1, 0);
    page = page_of(f);
    assert_has(page, "| chair | Theirs | – / 33 % |\n");
    free(page);
    put_system(f, "theirs", "I", 0, 0.8);
    put_system(f, "theirs", "I", 1, 0.45);
    page = page_of(f);
    assert_has(page, "| chair | Theirs | -0.025 ± 0.285 / +0.100 |");
    free(page);
}

/* Without a spread a lead of the other sign is bold beyond 0.03. */
static void test_lead_of_one_seed(void **state)
{
    const folder *f = *state;
    put_reference(f);
    put_run(f, "z.json", "Z", 0, 10, 0.33);
    put_system(f, "theirs", "Z", 0, 0.35);
    char *page = page_of(f);
    assert_has(page, "| -0.020 / +0.400 |\n");
    free(page);
    put_system(f, "theirs", "Z", 0, 0.37);
    page = page_of(f);
    assert_has(page, "| **-0.040** / +0.400 |\n");
    free(page);
}

static void test_one_seed_has_no_spread(void **state)
{
    put_run(*state, "c.json", "Z", 0, 10, 0.4);
    char *page = page_of(*state);
    assert_has(page, "0.600 ± 0.141 / 0.250 ± 0.000 | 0.400 / 0.250 |\n");
    free(page);
}

static void test_renderers_and_counts(void **state)
{
    const folder *f = *state;
    put(f, "r.json",
        "{\"experiment\": \"rendering\", \"system\": \"r\", \"config\": \"c\", \"keys\": \"k=1\",\n"
        "\"size\": \"quick\", \"size_keys\": \"\", \"data\": \"files\", \"category\": \"glossy\",\n"
        "\"train_setting\": \"I\", \"eval_setting\": \"SO3\", \"seed\": 0, \"steps\": 5, "
        "\"pixels\": 9,\n"
        "\"train_items\": 2, \"test_items\": 3, \"parameters\": 4, \"train_seconds\": 1,\n"
        "\"peak_rss_mb\": 2, \"seconds_per_item\": 0.257, \"commit\": \"abc\", \"figures\": "
        "{\"psnr\": 31.256, \"ssim\": 0.9,\n"
        "\"lpips\": null, \"pixel_variance\": 0}}\n");
    put(f, "n.json",
        "{\"experiment\": \"count\", \"system\": \"r\", \"config\": \"c\", \"keys\": \"k=1\",\n"
        "\"size\": \"quick\", \"size_keys\": \"\", \"parameters\": 4, \"of\": \"2 rays\",\n"
        "\"flop_forward\": 2e9, \"flop\": 6e9, \"commit\": \"abc\"}\n");
    char *page = page_of(f);
    assert_has(page, "| | elf, quick, files | 31.26 / – |\n");
    assert_has(page, "| quick | r | c k=1 | 4 | 2.00 | 6.00 | 2 rays |\n");
    assert_has(page,
               "| quick, files | r | c k=1 | 4 | 5 | 9 | 2 | 3 | 0 | 1 | – | 1 | 2 | 0.26 | abc |");
    free(page);
}

static void test_job_replaces_the_page(void **state)
{
    const folder *f = *state;
    char path[160], line[64];
    lf_error err = {""};
    snprintf(path, sizeof path, "%s/page.md", f->path);
    assert_int_equal(lf_reproduction(f->path, path, NULL, &err), LF_OK);
    FILE *file = fopen(path, "r");
    assert_non_null(fgets(line, sizeof line, file));
    fclose(file);
    assert_string_equal(line, "# Reproduction\n");
    put(f, "broken.json", "{");
    assert_int_equal(lf_reproduction(f->path, path, NULL, &err), LF_BAD_INPUT);
    assert_int_equal(access(path, R_OK), 0); /* the old one is still there */
    assert_int_equal(lf_reproduction("/nowhere/at/all", path, NULL, &err), LF_BAD_INPUT);
}

/* ---- the front page ---- */

static const char front[] =
    "Above\n<!-- results: written by scripts/reproduce, edit nothing -->\nold\n"
    "<!-- end of results -->\nBelow\n";

/* The front page of the folder, made of `before`; the caller frees it. */
static char *front_of(const folder *f, const char *before)
{
    char path[160], *page = NULL;
    lf_results r;
    lf_error err = {""};
    put(f, "front.md", before);
    snprintf(path, sizeof path, "%s/front.md", f->path);
    if (lf_results_read(f->path, &r, &err) != LF_OK ||
        lf_results_front_page(&r, path, &page, &err) != LF_OK)
        fail_msg("%s", err.text);
    lf_results_free(&r);
    return page;
}

static void put_front_paper(const folder *f)
{
    put(f, "paper.json",
        "{\"paper\": \"P\", \"tables\": [\n"
        " {\"name\": \"table1\", \"title\": \"T\", \"source\": \"S\", \"experiment\":\n"
        "  \"reconstruction\", \"figures\": [\"chamfer_l1\", \"iou\"], \"settings\":\n"
        "  [\"I/Z\", \"I/I\"], \"rows\": [{\"category\": \"chair\", \"system\": \"ours\",\n"
        "  \"label\": \"Ours\", \"values\": [[0.1, 0.61], [0.2, 0.71]]},\n"
        "  {\"category\": \"car\", \"system\": \"ours\", \"label\": \"Ours\",\n"
        "  \"values\": [[0.1, 0.61], [0.2, 0.71]]}]}]}\n");
}

/* Means and spread of the largest size, the paper's figure beside; what was not run says so. */
static void test_front_page(void **state)
{
    const folder *f = *state;
    put_front_paper(f);
    char *page = front_of(f, front);
    assert_has(page, "Above\n<!-- results: written by scripts/reproduce, edit nothing -->\n");
    assert_has(page, "(size tiny, built-in data: 10 steps, 400 shapes trained on, 40 tested):\n");
    assert_has(page, "| chair | Ours | 0.600 ± 0.141 / 0.710 | not run / 0.610 | not run / – | not "
                     "run / – |\n");
    assert_has(page, "\nNot run: car.\n");
    assert_has(page, "\nRendering: not run.\n\n<!-- end of results -->\nBelow\n");
    assert_null(strstr(page, "old"));
    char *again = front_of(f, page);
    assert_string_equal(again, page);
    free(page);
    free(again);
    /* other data of the same size: a table of their own, behind */
    put_run_on(f, "files", "d.json", "I", 0, 10, 0.4);
    page = front_of(f, front);
    assert_has(page, "| chair | Ours | 0.600 ± 0.141 / 0.710 |");
    assert_has(strstr(page, "0.600 ± 0.141"), "(size tiny, data from files: 10 steps");
    assert_has(strstr(page, "from files"), "| chair | Ours | 0.400 / 0.710 |");
    free(page);
}

static void test_front_page_is_left(void **state)
{
    const folder *f = *state;
    char path[160], *page = front_of(f, front); /* paper.json has neither table */
    assert_string_equal(page, front);
    free(page);
    lf_results r;
    lf_error err = {""};
    put(f, "front.md", "Above\nBelow\n");
    snprintf(path, sizeof path, "%s/front.md", f->path);
    assert_int_equal(lf_results_read(f->path, &r, &err), LF_OK);
    assert_int_equal(lf_results_front_page(&r, path, &page, &err), LF_BAD_INPUT);
    assert_has(err.text, "front.md");
    lf_results_free(&r);
}

static void test_pictures_that_are_there(void **state)
{
    const folder *f = *state;
    put(f, "tiny-built-in-one.png", "");
    char *page = page_of(f);
    assert_has(page, "(reproduction/tiny-built-in-one.png)\n");
    assert_null(strstr(page, "one-curves"));
    assert_null(strstr(page, "built-in-two"));
    free(page);
}

static void test_bad_results(void **state)
{
    static const struct {
        const char *text, *words;
    } bad[] = {
        {"{\"experiment\": \"reconstruction\",\n", "x.json: line 2"},
        {"[]", "experiment"},
        {"{\"experiment\": \"dancing\"}", "\"experiment\" must be"},
        {"{\"experiment\": \"count\", \"system\": \"r\"}", "config"},
        {"{\"experiment\": \"count\", \"system\": \"r\", \"config\": \"c\", \"keys\": \"\", "
         "\"size\": \"q\",\n"
         "\"size_keys\": \"\", \"parameters\": 4, \"of\": \"x\", \"flop_forward\": 2, \"flop\": "
         "6,\n"
         "\"commit\": \"abc\", \"colour\": 1}",
         "colour"},
        {"{\"experiment\": \"count\", \"system\": \"r\", \"config\": \"c\", \"keys\": \"\", "
         "\"size\": \"q\",\n"
         "\"size_keys\": \"\", \"parameters\": \"4\", \"of\": \"x\", \"flop_forward\": 2, "
         "\"flop\": 6,\n"
         "\"commit\": \"abc\"}",
         "parameters"},
        {"{\"experiment\": \"count\", \"experiment\": \"count\"}", "duplicate"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        put(*state, "x.json", bad[i].text);
        assert_refused(*state, bad[i].words);
        assert_refused(*state, "x.json");
    }
}

static void test_seeds_that_do_not_belong_together(void **state)
{
    put_run(*state, "c.json", "I", 1, 10, 0.4);
    assert_refused(*state, "b.json and c.json: the same run and seed twice");
    put_run(*state, "c.json", "I", 2, 11, 0.4);
    assert_refused(*state, "differ in steps");
}

static void test_bad_paper(void **state)
{
    static const char head[] =
        "{\"paper\": \"P\", \"tables\": [{\"name\": \"one\", \"title\": \"F\",\n"
        "\"source\": \"T\", \"experiment\": \"reconstruction\", ";
    static const struct {
        const char *rest, *words;
    } bad[] = {
        {"\"figures\": [\"iou\"], \"settings\": [\"II\"], \"rows\": []}]}", "training/test"},
        {"\"figures\": [\"depth\"], \"settings\": [\"I/I\"], \"rows\": []}]}", "depth"},
        {"\"figures\": [], \"settings\": [\"I/I\"], \"rows\": []}]}", "list of texts"},
        {"\"figures\": [\"iou\"], \"settings\": [\"I/I\"], \"rows\": [{\"category\": \"c\", "
         "\"system\":\n"
         "\"s\", \"label\": \"l\", \"values\": [[1], [2]]}]}]}",
         "2 values for 1"},
        {"\"figures\": [\"iou\"], \"settings\": [\"I/I\"], \"rows\": [{\"category\": \"c\", "
         "\"system\":\n"
         "\"s\", \"label\": \"l\", \"values\": [[1, 2]]}]}]}",
         "value 1 must be 1 figures"},
        {"\"figures\": [\"iou\"], \"settings\": [\"I/I\"], \"rows\": [], \"more\": 1}]}", "more"},
        {"\"figures\": [\"iou\"], \"settings\": [\"I/I\"], \"rows\": 3}]}", "rows must be a list"},
        {"\"reference\": \"s\", \"figures\": [\"iou\"], \"settings\": [\"I/I\"], \"rows\": []}]}",
         "reference \"s\" has no row"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        char text[1024];
        snprintf(text, sizeof text, "%s%s", head, bad[i].rest);
        put(*state, "paper.json", text);
        assert_refused(*state, bad[i].words);
        assert_refused(*state, "paper.json");
    }
}

/* The paper's own tables, as they stand in the repository. */
static void test_stored_results(void **state)
{
    lf_results r;
    lf_error err = {""};
    if (lf_results_read(*state, &r, &err) != LF_OK)
        fail_msg("%s", err.text);
    assert_int_equal(json_array_size(json_object_get(r.paper, "tables")), 4);
    lf_results_free(&r);
}

int main(int argc, char **argv)
{
    assert_int_equal(argc, 2);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_means_and_spread, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_lead_of_one_seed, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_one_seed_has_no_spread, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_who_is_ahead, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_renderers_and_counts, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_job_replaces_the_page, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_front_page, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_front_page_is_left, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_pictures_that_are_there, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_bad_results, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_seeds_that_do_not_belong_together, make_folder,
                                        remove_folder),
        cmocka_unit_test_setup_teardown(test_bad_paper, make_folder, remove_folder),
        cmocka_unit_test_prestate(test_stored_results, argv[1]),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
