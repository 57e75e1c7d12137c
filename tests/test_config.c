/* test_config.c: what configs/ reads, gives out, writes back and refuses, each refusal with its
 * words. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <glob.h>
#include <unistd.h>

#include "autograd/random.h"
#include "configs/configs.h"
#include "configs/schema.h"

static lf_config *defaults(void)
{
    lf_config *cfg = NULL;
    assert_int_equal(lf_config_load(NULL, &cfg, NULL), LF_OK);
    return cfg;
}

static lf_config *parse(const char *text)
{
    lf_config *cfg = NULL;
    lf_error err = {""};
    const lf_status status = lf_config_parse_text(text, "a.ini", &cfg, &err);
    if (status != LF_OK)
        fail_msg("%s", err.text);
    return cfg;
}

static void test_defaults(void **state)
{
    (void)state;
    int n;
    lf_config *cfg = defaults();
    assert_int_equal(lf_config_int(cfg, "train.steps"), 4000);
    assert_true(lf_config_real(cfg, "train.lr") == 5e-3);
    assert_true(lf_config_bool(cfg, "model.sample_image"));
    assert_string_equal(lf_config_string(cfg, "data.root"), "builtin");
    assert_string_equal(lf_config_choice(cfg, "model.type"), "equivariant");
    assert_true(lf_config_is(cfg, "train.schedule", "cosine"));
    assert_false(lf_config_is(cfg, "train.schedule", "step"));
    const long *fields = lf_config_ints(cfg, "model.fields", &n);
    assert_int_equal(n, 3);
    assert_int_equal(fields[2], 16);
    assert_false(lf_config_given(cfg, "train.steps"));
    assert_int_equal(lf_config_check(cfg, NULL), LF_OK);
    lf_config_free(cfg);
    lf_config_free(NULL);
}

static void test_schema_rows_are_sound(void **state)
{
    (void)state;
    for (int i = 0; i < lf_schema_size; i++) {
        assert_int_equal(lf_schema_find(lf_schema[i].name), i); /* no name twice */
        const size_t length = strlen(lf_schema[i].help);
        assert_true(length > 8 && length < 190 && lf_schema[i].help[length - 1] == '.');
    }
}

static void test_reads_a_file(void **state)
{
    (void)state;
    int n;
    lf_config *cfg = parse("\xEF\xBB\xBF# comment\r\n; comment\n\n[train]\r\nsteps = 10\r\n"
                           "lr=1e-4 ; behind a value\n[data]\nroot = /a b/c#d\nsetting: SO3\n"
                           "  # an indented comment\n   \n[model]\nfields = 4,8 , 16,32\n"
                           "stem_pool = yes\n[train]\nseed = 7");
    assert_int_equal(lf_config_int(cfg, "train.steps"), 10);
    assert_int_equal(lf_config_int(cfg, "train.seed"), 7);
    assert_true(lf_config_real(cfg, "train.lr") == 1e-4);
    assert_string_equal(lf_config_string(cfg, "data.root"), "/a b/c#d");
    assert_true(lf_config_is(cfg, "data.setting", "SO3"));
    assert_true(lf_config_bool(cfg, "model.stem_pool"));
    assert_int_equal(lf_config_ints(cfg, "model.fields", &n)[3], 32);
    assert_int_equal(n, 4);
    assert_true(lf_config_given(cfg, "train.steps"));
    assert_false(lf_config_given(cfg, "train.clip"));
    lf_config_free(cfg);
}

static void test_text_round_trips(void **state)
{
    (void)state;
    lf_config *cfg = defaults();
    const char *set[] = {"train.lr=0.1234567890123456789",
                         "train.eps = 1e-8",
                         "loss.scale=3e5",
                         "train.beta2=0.99999998",
                         "data.root=/a/b c/\xC3\xA4;d",
                         "model.mlp=7",
                         "train.weight_decay=4.9406564584124654e-324"};
    for (size_t i = 0; i < sizeof set / sizeof *set; i++)
        assert_int_equal(lf_config_set(cfg, set[i], NULL), LF_OK);
    char *text = lf_config_text(cfg);
    lf_config *again = parse(text);
    char *text2 = lf_config_text(again);
    assert_string_equal(text, text2);
    for (int i = 0; i < lf_schema_size; i++)
        if (lf_schema[i].type == LF_KEY_REAL) {
            const double a = lf_config_real(cfg, lf_schema[i].name);
            const double b = lf_config_real(again, lf_schema[i].name);
            assert_memory_equal(&a, &b, sizeof a);
        }
    assert_string_equal(lf_config_string(again, "data.root"), "/a/b c/\xC3\xA4;d");
    assert_non_null(strstr(text, "\nlr = 0.123456789012"));
    assert_non_null(strstr(text, "\neps = 1e-08\n"));
    free(text);
    free(text2);
    lf_config_free(again);
    lf_config_free(cfg);
}

static void test_help_is_a_config(void **state)
{
    (void)state;
    char *help = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&help, &size);
    lf_config_help(out);
    fclose(out);
    lf_config *cfg = parse(help), *plain = defaults();
    char *text = lf_config_text(cfg), *expected = lf_config_text(plain);
    assert_string_equal(text, expected);
    assert_non_null(strstr(help, "\n[train]\n"));
    assert_non_null(strstr(help, "# Allowed: one of constant, cosine, step.\n"));
    for (int i = 0; i < lf_schema_size; i++)
        assert_non_null(strstr(help, lf_schema[i].help));
    free(text);
    free(expected);
    free(help);
    lf_config_free(cfg);
    lf_config_free(plain);
}

/* ---- refusals ------------------------------------------------------------------------------- */

#define X50 "xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx"

/* A bad file, and the whole message it must give. */
static const struct {
    const char *text, *message;
} bad_files[] = {
    {"[train]\nstepps = 4\n", "a.ini:2: unknown key train.stepps; the nearest is train.steps "
                              "(elf-train --help-config lists all)"},
    {"[train]\nsetting = Z\n", "a.ini:2: unknown key train.setting; the nearest is data.setting "
                               "(elf-train --help-config lists all)"},
    {"\n[trian]\n", "a.ini:2: unknown section [trian]; the nearest is [train]"},
    {"[" X50 "]\n", "a.ini:1: the section name has 50 bytes, allowed are 49"},
    {"steps = 4\n", "a.ini:1: key steps stands before any [section]"},
    {"[train]\nsteps = abc\n",
     "a.ini:2: train.steps = abc: allowed is a whole number from 0 to 1000000000"},
    {"[train]\nsteps = 4e3\n",
     "a.ini:2: train.steps = 4e3: allowed is a whole number from 0 to 1000000000"},
    {"[train]\nsteps =\n",
     "a.ini:2: train.steps = : allowed is a whole number from 0 to 1000000000"},
    {"[train]\nsteps = -1\n",
     "a.ini:2: train.steps = -1: allowed is a whole number from 0 to 1000000000"},
    {"[train]\nsteps = 99999999999999999999\n",
     "a.ini:2: train.steps = 99999999999999999999: allowed is a whole number from 0 to 1000000000"},
    {"[train]\nlr = nan\n", "a.ini:2: train.lr = nan: allowed is a number from 0 to 10"},
    {"[train]\nlr = 1e999\n", "a.ini:2: train.lr = 1e999: allowed is a number from 0 to 10"},
    {"[train]\nlr = 0x1p-3\n", "a.ini:2: train.lr = 0x1p-3: allowed is a number from 0 to 10"},
    {"[train]\nlr = 11\n", "a.ini:2: train.lr = 11: allowed is a number from 0 to 10"},
    {"[train]\nlr = 1e-3 # fast\n",
     "a.ini:2: train.lr = 1e-3 # fast: allowed is a number from 0 to 10"},
    {"[model]\nstem_pool = maybe\n", "a.ini:2: model.stem_pool = maybe: allowed is true or false"},
    {"[train]\nschedule = cos\n",
     "a.ini:2: train.schedule = cos: allowed is one of constant, cosine, step"},
    {"[model]\nfields = 4, 8,\n", "a.ini:2: model.fields = 4, 8,: allowed is 1 to 8 whole numbers "
                                  "from 1 to 256, with commas between"},
    {"[model]\nfields = 1,2,3,4,5,6,7,8,9\n",
     "a.ini:2: model.fields = 1,2,3,4,5,6,7,8,9: allowed is 1 to 8 whole numbers from 1 to 256, "
     "with commas between"},
    {"[model]\nfields = 4 8\n", "a.ini:2: model.fields = 4 8: allowed is 1 to 8 whole numbers from "
                                "1 to 256, with commas between"},
    {"[data]\nroot =\n", "a.ini:2: data.root = : allowed is a path of 1 to 160 bytes"},
    {"[data]\nroot = " X50 X50 X50 "xxxxxxxxxxx\n",
     "a.ini:2: data.root = " X50 X50 ": 161 bytes are too long, allowed is at most 160; use a "
     "shorter path or a symbolic link"},
    {"[data]\nroot = a\x01z\n", "a.ini:2: data.root = a\x01z: byte 0x01 is not allowed, only "
                                "printable characters in UTF-8"},
    {"[data]\nroot = a\xE4z\n", "a.ini:2: data.root = a\xE4z: byte 0xE4 is not allowed, only "
                                "printable characters in UTF-8"},
    {"[train]\nsteps = 4\nlr = 1\nsteps = 5\n",
     "a.ini:4: train.steps is given a second time, first in line 2"},
    {"[train]\n  steps = 4\n",
     "a.ini:2: the line begins with a blank; keys and sections begin in the first column"},
    {"[train]\nsteps = 4\n  5\n",
     "a.ini:3: the line begins with a blank; keys and sections begin in the first column"},
    {"[train]\nsteps 4\n", "a.ini:2: neither a [section] nor \"key = value\" nor a # comment"},
    {"[train\nsteps = 4\n", "a.ini:1: neither a [section] nor \"key = value\" nor a # comment"},
    {"[train]\n# " X50 X50 X50 X50 "\nstepps = 3\n",
     "a.ini:2: the line has 202 bytes, allowed are 198"},
};

static void test_bad_files(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof bad_files / sizeof *bad_files; i++) {
        lf_config *cfg = NULL;
        lf_error err = {""};
        assert_int_equal(lf_config_parse_text(bad_files[i].text, "a.ini", &cfg, &err),
                         LF_BAD_INPUT);
        assert_string_equal(err.text, bad_files[i].message);
        assert_int_equal(lf_config_parse_text(bad_files[i].text, "a.ini", &cfg, NULL),
                         LF_BAD_INPUT);
        assert_null(cfg);
    }
}

static const struct {
    const char *set, *message;
} bad_sets[] = {
    {"train.steps", "--set train.steps: allowed is section.key=value"},
    {"train.step=4", "--set: unknown key train.step; the nearest is train.steps (elf-train "
                     "--help-config lists all)"},
    {"train.steps = x", "--set: train.steps = x: allowed is a whole number from 0 to 1000000000"},
    {"=4", "--set: unknown key ; the nearest is train.lr (elf-train --help-config lists all)"},
    {"data.root=a ;b", "--set: data.root = a ;b: a ';' at the start or after a blank begins a "
                       "comment, and blanks at the ends are lost: not allowed in text"},
    {"data.root=a\nb",
     "--set: data.root = a\nb: byte 0x0A is not allowed, only printable characters in UTF-8"},
};

static void test_bad_sets(void **state)
{
    (void)state;
    lf_config *cfg = defaults();
    char *before = lf_config_text(cfg);
    for (size_t i = 0; i < sizeof bad_sets / sizeof *bad_sets; i++) {
        lf_error err = {""};
        assert_int_equal(lf_config_set(cfg, bad_sets[i].set, &err), LF_BAD_INPUT);
        assert_string_equal(err.text, bad_sets[i].message);
    }
    char *after = lf_config_text(cfg);
    assert_string_equal(before, after);
    assert_false(lf_config_given(cfg, "train.steps"));
    free(before);
    free(after);
    lf_config_free(cfg);
}

/* Overrides that do not fit each other. */
static const struct {
    const char *set[3], *message;
} misfits[] = {
    {{"model.stages=1,1"},
     "model.stages has 2 numbers and model.fields 3: give both a number a stage"},
    {{"model.stem_size=6"}, "model.stem_size = 6: allowed is an odd number"},
    {{"data.image_size=16"},
     "data.image_size = 16: the strides of this backbone multiply to 16, so allowed is 17 or more"},
    {{"model.heads=3"}, "model.scalars = 16: allowed is a multiple of model.heads = 3"},
    {{"model.vectors=6"}, "model.vectors = 6: allowed is a multiple of model.heads = 4"},
    {{"model.vectors=0", "model.degree2=true"},
     "model.degree2 = true: it is a path between vectors, and model.vectors = 0"},
    {{"data.category=sofa"},
     "data.category = sofa: built-in shapes (data.root = builtin) are chair, airplane and car"},
    {{"data.thickness=-0.5"}, "data.thickness = -0.5: allowed is -1 or a number from 0 to 0.1"},
    {{"model.mlp=8,8,8,8,8,8,8,8"}, "model.mlp has 8 numbers: allowed are 7"},
    {{"model.stages=1,1,1,1,1,1,1", "model.fields=1,1,1,1,1,1,1", "data.image_size=257"},
     "7 stages, model.stem_features and model.sample_image make 9 maps: allowed are 8"},
    {{"model.block=bottleneck", "model.fields=4,8,6"},
     "model.fields has 6: with model.block = bottleneck, whose inside has a quarter of the fields, "
     "allowed are multiples of 4"},
    {{"eval.resolution=96"},
     "eval.resolution = 96: allowed is eval.coarse = 32 times a power of two"},
    {{"eval.coarse=48"}, "eval.resolution = 128: allowed is eval.coarse = 48 times a power of two"},
};

static void test_misfits(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof misfits / sizeof *misfits; i++) {
        lf_config *cfg = defaults();
        lf_error err = {""};
        for (int k = 0; k < 3 && misfits[i].set[k]; k++)
            assert_int_equal(lf_config_set(cfg, misfits[i].set[k], &err), LF_OK);
        assert_int_equal(lf_config_check(cfg, &err), LF_BAD_INPUT);
        assert_string_equal(err.text, misfits[i].message);
        lf_config_free(cfg);
    }
}

/* Of a trained network what it is stays; how it is used may change. All or nothing. */
static void test_overrides_of_a_trained_network(void **state)
{
    (void)state;
    static const char *const use[] = {"render.sources=4", "render.samples=9", "eval.sources=3",
                                      "model.heads=4" /* as it is */, "train.steps=50"};
    static const char *const other[][2] = {{"train.steps=60", "loss.scale=5"},
                                           {"train.steps=60", "model.antialias=true"},
                                           {"render.heads=2", "train.steps=60"},
                                           {"model.scalars=8", "train.steps=60"},
                                           {"train.steps=60", "data.image_size=3"}};
    lf_config *cfg = defaults();
    lf_error err;
    assert_int_equal(lf_config_set_trained(cfg, 5, use, &err), LF_OK);
    assert_int_equal(lf_config_int(cfg, "render.sources"), 4);
    for (size_t i = 0; i < 5; i++) {
        assert_int_equal(lf_config_set_trained(cfg, 2, other[i], &err), LF_BAD_INPUT);
        assert_int_equal(lf_config_int(cfg, "train.steps"), 50);
        if (i < 4)
            assert_non_null(strstr(err.text, "another model"));
    }
    lf_config_free(cfg);
}

static void test_warnings(void **state)
{
    (void)state;
    char *text = NULL;
    size_t size = 0;
    lf_config *cfg = defaults();
    FILE *out = open_memstream(&text, &size);
    assert_int_equal(lf_config_warn(cfg, out), 0);
    lf_config_set(cfg, "data.image_size=64", NULL);
    lf_config_set(cfg, "train.steps=50", NULL);
    lf_config_set(cfg, "data.light=head", NULL);
    lf_config_set(cfg, "train.val_every=300", NULL);
    assert_int_equal(lf_config_warn(cfg, out), 4);
    fclose(out);
    assert_non_null(strstr(text, "data.image_size = 64: only sizes 16 k + 1 keep"));
    assert_non_null(strstr(text, "train.warmup = 100: "));
    assert_non_null(strstr(text, "train.checkpoint_every = 500 does not go with "));
    free(text);
    lf_config_free(cfg);
}

/* ---- files ----------------------------------------------------------------------------------- */

static void expect_load(const char *path, const char *bytes, size_t size, const char *message)
{
    lf_config *cfg = NULL;
    lf_error err = {""};
    char expected[1200];
    if (bytes) {
        FILE *file = fopen(path, "wb");
        fwrite(bytes, 1, size, file);
        fclose(file);
    }
    snprintf(expected, sizeof expected, "%s%s", path, message);
    assert_int_equal(lf_config_load(path, &cfg, &err), LF_BAD_INPUT);
    assert_string_equal(err.text, expected);
}

static void test_bad_paths(void **state)
{
    (void)state;
    char folder[] = "/tmp/lf-config-XXXXXX", path[64];
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/a.ini", folder);
    expect_load(path, NULL, 0, ": No such file or directory");
    expect_load(folder, NULL, 0, ": Is a directory");
    expect_load(path, "[train]\nsteps = 4\0\n", 19, ":2: a NUL byte; a config is plain text");
    const size_t large = (1 << 20) + 1;
    char *bytes = malloc(large);
    assert_non_null(bytes);
    memset(bytes, '\n', large);
    expect_load(path, bytes, large, ": more than 1048576 bytes are no config");
    free(bytes);
    unlink(path);
    rmdir(folder);
}

/* Random changes of a whole config: taken or refused with a line, never a crash. */
static void test_random_damage(void **state)
{
    (void)state;
    lf_config *cfg = defaults();
    char *text = lf_config_text(cfg);
    const long length = (long)strlen(text);
    lf_config_free(cfg);
    int refused = 0;
    for (uint64_t i = 0; i < 3000; i++) {
        lf_stream s = lf_stream_at(1, LF_RANDOM_TEST, 0, i);
        char *copy = strdup(text);
        assert_non_null(copy);
        for (int k = 0; k < 3; k++)
            copy[lf_index(&s, length)] = "\n\r\t[]=;#:. \xC3-9e"[lf_index(&s, 15)];
        lf_error err = {""};
        const lf_status status = lf_config_parse_text(copy, "a.ini", &cfg, &err);
        if (status == LF_OK) {
            lf_config_check(cfg, NULL);
            lf_config_free(cfg);
        } else {
            assert_int_equal(status, LF_BAD_INPUT);
            assert_int_equal(strncmp(err.text, "a.ini:", 6), 0);
            refused++;
        }
        free(copy);
    }
    assert_true(refused > 1000);
    free(text);
}

/* Every INI file that comes with the project; the folder is the program's argument. */
static void test_shipped_files(void **state)
{
    glob_t found;
    char pattern[512];
    snprintf(pattern, sizeof pattern, "%s/*.ini", (const char *)*state);
    assert_int_equal(glob(pattern, 0, NULL, &found), 0);
    assert_true(found.gl_pathc >= 6);
    for (size_t i = 0; i < found.gl_pathc; i++) {
        lf_config *cfg = NULL;
        lf_error err = {""};
        if (lf_config_load(found.gl_pathv[i], &cfg, &err) || lf_config_check(cfg, &err))
            fail_msg("%s", err.text);
        /* scripts rely on these, the last three where shapes are reconstructed */
        const char *keys[] = {
            "train.steps",     "train.lr",  "train.seed",    "train.checkpoint_every",
            "train.log_every", "data.root", "data.category", "data.setting"};
        const size_t count = lf_config_renders(cfg) ? 5 : 8;
        for (size_t k = 0; k < count; k++)
            assert_true(lf_config_given(cfg, keys[k]));
        lf_config_free(cfg);
    }
    globfree(&found);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_defaults),
        cmocka_unit_test(test_schema_rows_are_sound),
        cmocka_unit_test(test_reads_a_file),
        cmocka_unit_test(test_text_round_trips),
        cmocka_unit_test(test_help_is_a_config),
        cmocka_unit_test(test_bad_files),
        cmocka_unit_test(test_bad_sets),
        cmocka_unit_test(test_misfits),
        cmocka_unit_test(test_overrides_of_a_trained_network),
        cmocka_unit_test(test_warnings),
        cmocka_unit_test(test_bad_paths),
        cmocka_unit_test(test_random_damage),
        cmocka_unit_test_prestate(test_shipped_files, argc > 1 ? argv[1] : "configs"),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
