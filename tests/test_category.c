/* test_category.c: categories with lists, folders without, and what is wrong with others. */
#include "tests/close.h"
#include "tests/folder.h"

#include <sys/stat.h>
#include <unistd.h>

#include "datasets/category.h"

static int set_up(void **state)
{
    char *root = strdup("/tmp/lf_test_category_XXXXXX");
    *state = root;
    return mkdtemp(root) ? 0 : -1;
}

static int tear_down(void **state)
{
    const int left = remove_tree(*state);
    free(*state);
    return left;
}

/* Write a file under the root, making its folders. */
static void put(void **state, const char *name, const char *text)
{
    char path[256];
    snprintf(path, sizeof path, "%s/%s", (char *)*state, name);
    for (char *slash = path + strlen(*state) + 1; (slash = strchr(slash, '/')); slash++) {
        *slash = 0;
        mkdir(path, 0700);
        *slash = '/';
    }
    FILE *f = fopen(path, "w");
    assert_non_null(f);
    fputs(text, f);
    fclose(f);
}

static lf_category *open_good(void **state, const char *category, const char *split)
{
    lf_category *c = NULL;
    lf_error err = {"no message"};
    if (lf_category_open(*state, category, split, &c, &err) != LF_OK)
        fail_msg("%s", err.text);
    return c;
}

static void expect_bad(void **state, const char *category, const char *split, const char *message)
{
    lf_category *c = NULL;
    lf_error err = {"no message"};
    assert_int_equal(lf_category_open(*state, category, split, &c, &err), LF_BAD_INPUT);
    assert_null(c);
    if (!strstr(err.text, message))
        fail_msg("message '%s' lacks '%s'", err.text, message);
}

static void test_lists(void **state)
{
    put(state, "chair/b1/model.obj", "");
    put(state, "chair/a2/models/model_normalized.obj", "");
    put(state, "chair/c3/model.ply", "");
    put(state, "chair/unlisted/model.obj", "");
    put(state, "chair/train.lst", "# the training shapes\nb1\r\n\n  a2  # old\n");
    put(state, "chair/test.lst", "c3");
    lf_category *c = open_good(state, "chair", "train");
    assert_int_equal(c->count, 2);
    assert_false(c->drawn);
    assert_string_equal(c->item[0].id, "a2");
    assert_string_equal(c->item[1].id, "b1");
    assert_non_null(strstr(c->item[0].path, "/chair/a2/models/model_normalized.obj"));
    lf_category_close(c);
    c = open_good(state, "chair", "test");
    assert_int_equal(c->count, 1);
    assert_non_null(strstr(c->item[0].path, "/chair/c3/model.ply"));
    lf_category_close(c);
    expect_bad(state, "chair", "val", "val.lst: there is no such list");
    expect_bad(state, "chair", "all", "val.lst: there is no such list");
    put(state, "chair/val.lst", "");
    expect_bad(state, "chair", "val", "the split 'val' has no shape");
    put(state, "chair/val.lst", "unlisted\n");
    c = open_good(state, "chair", "all");
    assert_int_equal(c->count, 4);
    lf_category_close(c);
    lf_category_close(NULL);
}

static void test_bad_lists(void **state)
{
    put(state, "car/a/model.obj", "");
    put(state, "car/empty/readme", "");
    put(state, "car/train.lst", "a\n\nmissing\n");
    expect_bad(state, "car", "train", "train.lst:3: the shape 'missing' has no mesh");
    put(state, "car/train.lst", "a\nempty\n");
    expect_bad(state, "car", "train", "train.lst:2: the shape 'empty' has no mesh");
    put(state, "car/train.lst", "a\na\n");
    expect_bad(state, "car", "train", "train.lst:2: the id 'a' is listed twice");
    put(state, "car/train.lst", "../car/a\n");
    expect_bad(state, "car", "train", "train.lst:1: '../car/a' is no id");
    expect_bad(state, "car", "dev", "'dev' is no split; allowed are train, val, test, all");
    expect_bad(state, "boat", "train", "boat: there is no such folder");
    put(state, "file", "");
    expect_bad(state, "file", "train", "file: there is no such folder");
}

/* Lists may name files beside them, without the ending. */
static void test_lists_of_files(void **state)
{
    put(state, "lamp/b.off", "");
    put(state, "lamp/a.stl", "");
    put(state, "lamp/c.obj", "");
    put(state, "lamp/train.lst", "b\na\n");
    lf_category *c = open_good(state, "lamp", "train");
    assert_int_equal(c->count, 2);
    assert_false(c->drawn);
    assert_string_equal(c->item[0].id, "a");
    assert_non_null(strstr(c->item[0].path, "lamp/a.stl"));
    assert_non_null(strstr(c->item[1].path, "lamp/b.off"));
    lf_category_close(c);
    put(state, "lamp/train.lst", "b.off\n");
    expect_bad(state, "lamp", "train", "train.lst:1: the shape 'b.off' has no mesh");
}

static void test_folder_without_lists(void **state)
{
    char name[64];
    for (int i = 0; i < 300; i++) {
        static const char *const endings[] = {"obj", "PLY", "off", "stl"};
        snprintf(name, sizeof name, "any/shape_%03d.%s", i, endings[i % 4]);
        put(state, name, "");
    }
    put(state, "any/deep/model.obj", "");
    put(state, "any/notes.txt", "");
    put(state, "any/.hidden.obj", "");
    lf_category *all = open_good(state, "any", "all"), *part[3];
    static const char *const splits[3] = {"train", "val", "test"};
    static const double share[3] = {0.7, 0.1, 0.2};
    assert_int_equal(all->count, 301);
    assert_true(all->drawn);
    assert_string_equal(all->item[0].id, "deep");
    assert_string_equal(all->item[1].id, "shape_000");
    long sum = 0;
    for (int i = 0; i < 3; i++) {
        part[i] = open_good(state, "any", splits[i]);
        sum += part[i]->count;
        assert_close((double)part[i]->count / 301, share[i], 0, 0.07);
        for (long j = 0; j < part[i]->count; j++)
            assert_string_equal(lf_category_drawn_split(part[i]->item[j].id), splits[i]);
        lf_category_close(part[i]);
    }
    assert_int_equal(sum, 301);
    lf_category_close(all);
    put(state, "any/shape_000.off", "");
    expect_bad(state, "any", "all", "have the same id 'shape_000'");
}

static void test_folder_without_shapes(void **state)
{
    put(state, "bare/notes.txt", "");
    expect_bad(state, "bare", "all", "the split 'all' has no shape (no .lst file found");
    put(state, "one/a.obj", "");
    const char *other = strcmp(lf_category_drawn_split("a"), "train") ? "train" : "val";
    expect_bad(state, "one", other, "has no shape (no .lst file found");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lists),
        cmocka_unit_test(test_bad_lists),
        cmocka_unit_test(test_lists_of_files),
        cmocka_unit_test(test_folder_without_lists),
        cmocka_unit_test(test_folder_without_shapes),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
