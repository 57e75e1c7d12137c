/* test_count.c: parameters and operations as elf-train --count tells them: by hand for a network
 * small enough, sums for every shipped config, and ablations of equal parameters. The folder of the
 * configs is the program's argument. */
#include <glob.h>
#include <jansson.h>
#include <unistd.h>

#include "tests/close.h"
#include "tests/folder.h"
#include "train/count.h"

static char folder[64];
static const char *configs = "configs";

static int make_folder(void **state)
{
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/elf-test-count-XXXXXX");
    return mkdtemp(folder) ? 0 : 1;
}

static int remove_folder(void **state)
{
    (void)state;
    return remove_tree(folder);
}

/* What --count writes of the config `path` (NULL: defaults) with `more` (ends with NULL). */
static json_t *count_of(const char *path, const char *const *more)
{
    char file[96];
    lf_config *cfg;
    lf_error err = {""};
    snprintf(file, sizeof file, "%s/count.json", folder);
    if (lf_config_load(path, &cfg, &err) != LF_OK)
        fail_msg("%s", err.text);
    for (; more && *more; more++)
        if (lf_config_set(cfg, *more, &err) != LF_OK)
            fail_msg("%s", err.text);
    if (lf_config_check(cfg, &err) != LF_OK || lf_count(cfg, NULL, file, &err) != LF_OK)
        fail_msg("%s", err.text);
    lf_config_free(cfg);
    json_t *json = json_load_file(file, 0, NULL);
    assert_non_null(json);
    return json;
}

static json_t *shipped(const char *name, const char *const *more)
{
    char path[512];
    snprintf(path, sizeof path, "%s/%s.ini", configs, name);
    return count_of(path, more);
}

static double number(const json_t *json, const char *key)
{
    assert_true(json_is_number(json_object_get(json, key)));
    return json_number_value(json_object_get(json, key));
}

static long parameters(const char *name, const char *const *more)
{
    json_t *json = shipped(name, more);
    const long n = (long)number(json, "parameters");
    json_decref(json);
    return n;
}

/* Stem 3x3, 2 -> 2, to 5 x 5; a block 3x3 2 -> 3, 3x3 3 -> 3, shortcut; heads of 2 features; the
 * image sampled too: 6 numbers; their maximum; 6 -> 5 -> 1. */
static void a_small_network_by_hand(void **state)
{
    (void)state;
    static const char *const sets[] = {"model.backbone=plain",     "model.plain_channels=1",
                                       "model.stem_fields=2",      "model.stem_size=3",
                                       "model.stages=1",           "model.fields=3",
                                       "model.first_stride=1",     "model.features=2",
                                       "model.fusion=max-pool",    "model.mlp=5",
                                       "data.image_size=9",        "train.shapes_per_step=3",
                                       "train.points_per_shape=7", NULL};
    json_t *json = count_of(NULL, sets);
    const json_t *parts = json_object_get(json, "parts");
    assert_int_equal(json_array_size(parts), 2);
    const json_t *backbone = json_array_get(parts, 0), *head = json_array_get(parts, 1);
    const double filters = 36 + 54 + 81 + 6, norms = 4 + 6 + 6 + 6, heads = 6 + 8;
    assert_true(number(backbone, "parameters") == filters + norms + heads);
    assert_true(number(backbone, "flop_forward") == 2 * 25 * (filters + 4 + 6));
    assert_true(number(head, "parameters") == 6 * 5 + 5 + 5 + 1);
    const double point = 8 * 4 * 6 + 6 * 5 + 5;
    assert_true(number(head, "flop_forward") == 2 * point);
    const json_t *step = json_object_get(json, "step");
    const double forward = 3 * 8 * number(backbone, "flop_forward") + 3 * 7 * 2 * point;
    assert_true(number(step, "flop_forward") == forward && number(step, "flop") == 3 * forward);
    json_decref(json);
}

static void parts_add_up_to_the_whole(void **state)
{
    (void)state;
    glob_t found;
    char pattern[512];
    snprintf(pattern, sizeof pattern, "%s/*.ini", configs);
    assert_int_equal(glob(pattern, 0, NULL, &found), 0);
    for (size_t i = 0; i < found.gl_pathc; i++) {
        json_t *json = count_of(found.gl_pathv[i], NULL);
        const json_t *parts = json_object_get(json, "parts"), *part;
        size_t k;
        double sum = 0;
        json_array_foreach(parts, k, part)
        {
            assert_true(number(part, "flop_forward") > 0);
            assert_true(json_is_string(json_object_get(part, "of")));
            sum += number(part, "parameters");
        }
        if (!(sum > 0 && sum == number(json, "parameters")))
            fail_msg("%s: parts of %g, the whole %g", found.gl_pathv[i], sum,
                     number(json, "parameters"));
        json_decref(json);
    }
    globfree(&found);
}

static void ablations_have_as_many_parameters(void **state)
{
    (void)state;
    static const char *const plain[] = {"model.backbone=plain", "model.plain_channels=1",
                                        "model.stem_fields=9", "model.fields=9, 18, 36", NULL};
    const double full = (double)parameters("reconstruct-tiny", NULL);
    static const char *const names[] = {"ablation-plain", "ablation-max-pool", "ablation-scalars",
                                        "reconstruct-ibrnet"};
    for (int i = 0; i < 4; i++) {
        const double n = (double)parameters(names[i], NULL);
        if (fabs(n - full) > 0.03 * full)
            fail_msg("%s has %g parameters, reconstruct-tiny %g", names[i], n, full);
    }
    const double n = (double)parameters("reconstruct-ibrnet", plain);
    assert_true(fabs(n - full) <= 0.03 * full);
    /* channels are whole numbers */
    static const char *const scalars[] = {"render.types=0", "render.scalars=0",
                                          "render.channels=24", NULL};
    const double types = (double)parameters("render-tiny", NULL);
    assert_true(fabs((double)parameters("render-tiny", scalars) - types) <= 0.03 * types);
}

/* By time instead: the plain network of the same fields. */
static void the_plain_network_takes_as_many_operations(void **state)
{
    (void)state;
    json_t *c8 = shipped("reconstruct-tiny", NULL), *plain = shipped("reconstruct-plain", NULL);
    const double a = number(json_object_get(c8, "step"), "flop"),
                 b = number(json_object_get(plain, "step"), "flop");
    assert_true(fabs(a - b) < 0.03 * a);
    json_decref(c8);
    json_decref(plain);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_small_network_by_hand),
        cmocka_unit_test(parts_add_up_to_the_whole),
        cmocka_unit_test(ablations_have_as_many_parameters),
        cmocka_unit_test(the_plain_network_takes_as_many_operations),
    };
    if (argc > 1)
        configs = argv[1];
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
