/* test_safetensors.c: what is written reads back, bad files are refused with their words, and no
 * failure of the machine loses the file that was there. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <dirent.h>
#include <errno.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <unistd.h>

#include "autograd/safetensors.h"

static char folder[64], path[128];

static int make_folder(void **state)
{
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/lf-safetensors-XXXXXX");
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/a.safetensors", folder);
    return 0;
}

static int remove_folder(void **state)
{
    (void)state;
    unlink(path);
    assert_int_equal(rmdir(folder), 0); /* fails if a temporary file was left */
    return 0;
}

static int files_in(const char *name)
{
    int files = 0;
    DIR *d = opendir(name);
    assert_non_null(d);
    for (struct dirent *e = readdir(d); e; e = readdir(d))
        files += e->d_name[0] != '.';
    closedir(d);
    return files;
}

/* ---- round trip -------------------------------------------------------------------------------
 */

static const float f32[6] = {1, -2, 3.5f, 0, 1e-38f, 1e30f};
static const double f64[2] = {0.1, -1e300};
static const int64_t i64[1] = {-5};
static const uint8_t u8[3] = {0, 128, 255};

static const lf_array arrays[] = {
    {"bytes", LF_U8, 1, {3}, u8},      {"a.weight", LF_F32, 2, {2, 3}, f32},
    {"moment", LF_F64, 1, {2}, f64},   {"count", LF_I64, 0, {0}, i64},
    {"empty", LF_F32, 2, {0, 4}, f32},
};
static const lf_meta meta[] = {{"config", "[train]\nsteps = 4 \"\xC3\xA4\"\n"}, {"step", "12"}};

static lf_status write_sample(const char *step, const lf_fault *fault, lf_error *err)
{
    const lf_meta m[] = {meta[0], {"step", step}};
    return lf_safetensors_write(path, arrays, 5, m, 2, fault, err);
}

static void test_round_trip(void **state)
{
    (void)state;
    lf_safetensors *file = NULL;
    lf_error err = {""};
    assert_int_equal(write_sample("12", NULL, &err), LF_OK);
    assert_int_equal(lf_safetensors_open(path, &file, &err), LF_OK);
    assert_int_equal(lf_safetensors_count(file), 5);
    assert_true(lf_safetensors_checked(file));
    assert_string_equal(lf_safetensors_meta(file, "config"), meta[0].value);
    assert_string_equal(lf_safetensors_meta(file, "step"), "12");
    assert_null(lf_safetensors_meta(file, "nothing"));
    const lf_array *a = lf_safetensors_find(file, "a.weight");
    assert_int_equal(a->rank, 2);
    assert_int_equal(a->dim[1], 3);
    assert_memory_equal(a->data, f32, sizeof f32);
    assert_memory_equal(lf_safetensors_find(file, "moment")->data, f64, sizeof f64);
    assert_memory_equal(lf_safetensors_find(file, "count")->data, i64, sizeof i64);
    assert_memory_equal(lf_safetensors_find(file, "bytes")->data, u8, sizeof u8);
    assert_null(lf_safetensors_find(file, "nothing"));
    for (int i = 0; i < lf_safetensors_count(file); i++) {
        const lf_array *b = lf_safetensors_at(file, i);
        assert_int_equal((uintptr_t)b->data % lf_dtype_size(b->dtype), 0);
    }
    lf_safetensors_close(file);
    lf_safetensors_close(NULL);
}

static void test_copy(void **state)
{
    (void)state;
    lf_safetensors *file = NULL;
    lf_error err = {""};
    lf_real out[6] = {0};
    const long shape[] = {2, 3}, other[] = {3, 2};
    char expected[400];
    assert_int_equal(write_sample("1", NULL, &err), LF_OK);
    assert_int_equal(lf_safetensors_open(path, &file, &err), LF_OK);
    assert_int_equal(lf_safetensors_copy(file, "a.weight", 2, shape, out, &err), LF_OK);
    for (int i = 0; i < 6; i++)
        assert_true(out[i] == (lf_real)f32[i]);
    assert_int_equal(lf_safetensors_copy(file, "moment", 1, shape, out, &err), LF_OK);
    assert_true(out[0] == (lf_real)0.1);

    assert_int_equal(lf_safetensors_copy(file, "a.weight", 2, other, out, &err), LF_BAD_INPUT);
    snprintf(expected, sizeof expected, "%s: array a.weight has shape [2, 3]; expected is [3, 2]",
             path);
    assert_string_equal(err.text, expected);
    assert_int_equal(lf_safetensors_copy(file, "a.bias", 1, shape, out, &err), LF_BAD_INPUT);
    snprintf(expected, sizeof expected, "%s: array a.bias is missing", path);
    assert_string_equal(err.text, expected);
    assert_int_equal(lf_safetensors_copy(file, "count", 0, NULL, out, &err), LF_BAD_INPUT);
    snprintf(expected, sizeof expected, "%s: array count is I64; expected is F32 or F64", path);
    assert_string_equal(err.text, expected);
    lf_safetensors_close(file);
}

static void test_not_utf8(void **state)
{
    (void)state;
    const lf_meta bad = {"config", "\xE4"};
    const lf_array name = {"\xE4", LF_U8, 1, {3}, u8};
    lf_error err = {""};
    assert_int_equal(lf_safetensors_write(path, arrays, 1, &bad, 1, NULL, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, "a.safetensors: metadata config is no UTF-8 text"));
    assert_int_equal(lf_safetensors_write(path, &name, 1, NULL, 0, NULL, &err), LF_BAD_INPUT);
    assert_non_null(strstr(err.text, " is no UTF-8 text"));
    assert_int_equal(files_in(folder), 0);
}

/* ---- bad files --------------------------------------------------------------------------------
 */

static void expect_refused(const void *bytes, size_t size, const char *message)
{
    lf_safetensors *file = NULL;
    lf_error err = {""};
    FILE *out = fopen(path, "wb");
    assert_non_null(out);
    assert_int_equal(fwrite(bytes, 1, size, out), size);
    fclose(out);
    assert_int_equal(lf_safetensors_open(path, &file, &err), LF_BAD_INPUT);
    assert_null(file);
    assert_int_equal(strncmp(err.text, path, strlen(path)), 0);
    assert_string_equal(err.text + strlen(path), message);
}

/* A header, and what must be said about it when 8 bytes of data follow. */
static const struct {
    const char *header, *message;
} bad_headers[] = {
    {"", ": the header is no JSON: '[' or '{' expected near end of file (byte 0 of the header)"},
    {"{\"a\": }", ": the header is no JSON: unexpected token near '}' (byte 7 of the header)"},
    {"[1]", ": the header is no JSON object"},
    {"{\"a\":1,\"a\":2}",
     ": the header is no JSON: duplicate object key near '\"a\"' (byte 10 of the header)"},
    {"{\"a\":1}", ": array a: dtype is missing; allowed are F32, F64, I64 and U8"},
    {"{\"a\":{\"dtype\":\"BF16\"}}", ": array a: dtype BF16; allowed are F32, F64, I64 and U8"},
    {"{\"a\":{\"dtype\":\"F64\"}}", ": array a: shape is missing or no list"},
    {"{\"a\":{\"dtype\":\"F64\",\"shape\":[1,1,1,1,1,1,1,1,1]}}",
     ": array a: shape has more than 8 dims"},
    {"{\"a\":{\"dtype\":\"F64\",\"shape\":[-1]}}",
     ": array a: shape has a dim that is no whole number >= 0"},
    {"{\"a\":{\"dtype\":\"F64\",\"shape\":[1.5]}}",
     ": array a: shape has a dim that is no whole number >= 0"},
    {"{\"a\":{\"dtype\":\"F64\",\"shape\":[4294967296,4294967296]}}",
     ": array a: shape has more bytes than can be counted"},
    {"{\"a\":{\"dtype\":\"F64\",\"shape\":[99999999999999999999]}}",
     ": the header is no JSON: too big integer near '99999999999999999999' (byte 49 of the "
     "header)"},
    {"{\"a\":{\"dtype\":\"F64\",\"shape\":[1]}}", ": array a: data_offsets is not [begin, end]"},
    {"{\"a\":{\"dtype\":\"F64\",\"shape\":[1],\"data_offsets\":[8,0]}}",
     ": array a: data_offsets end before they begin"},
    {"{\"a\":{\"dtype\":\"F64\",\"shape\":[1],\"data_offsets\":[-8,0]}}",
     ": array a: data_offsets end before they begin"},
    {"{\"a\":{\"dtype\":\"F64\",\"shape\":[2],\"data_offsets\":[0,16]}}",
     ": truncated: array a ends at byte 16 of 8 bytes of data"},
    {"{\"a\":{\"dtype\":\"F64\",\"shape\":[2],\"data_offsets\":[0,8]}}",
     ": array a: data_offsets do not fit the shape"},
    {"{\"a\":{\"dtype\":\"F32\",\"shape\":[1],\"data_offsets\":[4,8]}}",
     ": array a: stands behind a gap"},
    {"{\"a\":{\"dtype\":\"F32\",\"shape\":[1],\"data_offsets\":[0,4]}}",
     ": 4 bytes behind the last array"},
    {"{\"a\":{\"dtype\":\"F64\",\"shape\":[1],\"data_offsets\":[0,8]},"
     "\"b\":{\"dtype\":\"F32\",\"shape\":[1],\"data_offsets\":[4,8]}}",
     ": array b: overlaps another array"},
    {"{\"__metadata__\":3,\"a\":{\"dtype\":\"F64\",\"shape\":[1],\"data_offsets\":[0,8]}}",
     ": __metadata__ is no JSON object"},
    {"{\"__metadata__\":{\"k\":3},\"a\":{\"dtype\":\"F64\",\"shape\":[1],\"data_offsets\":[0,8]}}",
     ": metadata k is no text"},
    {"{\"__metadata__\":{\"xxh3_128\":\"12\"},"
     "\"a\":{\"dtype\":\"F64\",\"shape\":[1],\"data_offsets\":[0,8]}}",
     ": damaged: the checksum of its data is 2c0a8a99dc147d5445c3b49d035665b2, its header says 12"},
};

static void test_bad_headers(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof bad_headers / sizeof *bad_headers; i++) {
        const size_t length = strlen(bad_headers[i].header);
        char bytes[512] = {(char)length};
        memcpy(bytes + 8, bad_headers[i].header, length);
        memset(bytes + 8 + length, 0, 8);
        expect_refused(bytes, length + 16, bad_headers[i].message);
    }
}

static void test_bad_lengths(void **state)
{
    (void)state;
    const unsigned char huge[16] = {0, 0, 0, 0, 0, 0, 0, 0x80, '{', '}'};
    const unsigned char longer[16] = {9, 0, 0, 0, 0, 0, 0, 0, '{', '}'};
    expect_refused("", 0, ": 0 bytes are too few for a safetensors file: truncated?");
    expect_refused(huge, 7, ": 7 bytes are too few for a safetensors file: truncated?");
    expect_refused(huge, 16,
                   ": a header of 9223372036854775808 bytes; at most 100000000 are allowed: no "
                   "safetensors file");
    expect_refused(longer, 16, ": truncated: the header needs 17 bytes, the file has 16");
    lf_safetensors *file = NULL;
    lf_error err = {""};
    assert_int_equal(lf_safetensors_open(folder, &file, &err), LF_BAD_INPUT);
    assert_string_equal(err.text + strlen(folder), ": not a file");
    unlink(path);
    assert_int_equal(lf_safetensors_open(path, &file, &err), LF_BAD_INPUT);
    assert_string_equal(err.text + strlen(path), ": No such file or directory");
}

static char *read_file(size_t *size)
{
    FILE *in = fopen(path, "rb");
    assert_non_null(in);
    char *bytes = malloc(4096);
    assert_non_null(bytes);
    *size = fread(bytes, 1, 4096, in);
    fclose(in);
    return bytes;
}

/* Every truncation is refused, and so is every changed byte of the data. */
static void test_damage(void **state)
{
    (void)state;
    size_t size;
    lf_safetensors *file = NULL;
    assert_int_equal(write_sample("12", NULL, NULL), LF_OK);
    char *bytes = read_file(&size);
    for (size_t n = 0; n < size; n++) {
        assert_int_equal(truncate(path, (off_t)(size - 1 - n)), 0);
        assert_int_equal(lf_safetensors_open(path, &file, NULL), LF_BAD_INPUT);
    }
    const size_t data = 3 + 24 + 16 + 8;
    for (size_t i = 0; i < size; i++) {
        bytes[i] ^= 0x10;
        FILE *out = fopen(path, "wb");
        fwrite(bytes, 1, size, out);
        fclose(out);
        bytes[i] ^= 0x10;
        /* in the header a change may go unseen (a name), but it must not be believed blindly */
        const lf_status status = lf_safetensors_open(path, &file, NULL);
        if (i >= size - data)
            assert_int_equal(status, LF_BAD_INPUT);
        if (status == LF_OK)
            lf_safetensors_close(file);
    }
    free(bytes);
}

static void test_reads_other_writers(void **state)
{
    (void)state;
    const char header[] = "{\"a\":{\"shape\":[1],\"data_offsets\":[0,4],\"dtype\":\"F32\"}}  ";
    char bytes[128] = {sizeof header - 1};
    const float x = 2.5f;
    lf_real out = 0;
    lf_safetensors *file = NULL;
    memcpy(bytes + 8, header, sizeof header - 1);
    memcpy(bytes + 8 + sizeof header - 1, &x, 4);
    FILE *f = fopen(path, "wb");
    fwrite(bytes, 1, 8 + sizeof header - 1 + 4, f);
    fclose(f);
    assert_int_equal(lf_safetensors_open(path, &file, NULL), LF_OK);
    assert_false(lf_safetensors_checked(file));
    assert_null(lf_safetensors_meta(file, "config"));
    assert_int_equal(lf_safetensors_copy(file, "a", 1, (const long[]){1}, &out, NULL), LF_OK);
    assert_true(out == (lf_real)2.5);
    lf_safetensors_close(file);
}

/* ---- failures of the machine ------------------------------------------------------------------
 */

typedef struct countdown {
    int left; /* calls that still succeed */
    bool for_ever, struck;
} countdown;

static int strike(void *user, const char *call)
{
    countdown *c = user;
    (void)call;
    if (c->left-- > 0 || (c->struck && !c->for_ever))
        return 0;
    c->struck = true;
    return ENOSPC;
}

static void expect_step(const char *step)
{
    lf_safetensors *file = NULL;
    lf_error err = {""};
    if (lf_safetensors_open(path, &file, &err) != LF_OK)
        fail_msg("%s", err.text);
    assert_string_equal(lf_safetensors_meta(file, "step"), step);
    lf_safetensors_close(file);
}

/* Let the k-th system call fail, k = 0, 1, ..., until none does; then the same with all that
 * follow. The old file stays, or the new one is complete; no temporary file is left. */
static void test_failing_calls(void **state)
{
    (void)state;
    for (int for_ever = 0; for_ever < 2; for_ever++) {
        assert_int_equal(write_sample("old", NULL, NULL), LF_OK);
        int failures = 0;
        for (int k = 0;; k++) {
            countdown c = {k, for_ever, false};
            const lf_fault fault = {strike, &c};
            lf_error err = {""};
            const lf_status status = write_sample("new", &fault, &err);
            assert_int_equal(files_in(folder), 1);
            if (!c.struck) {
                assert_int_equal(status, LF_OK);
                break;
            }
            failures++;
            assert_int_equal(status, LF_FAILED);
            assert_non_null(strstr(err.text, "No space left on device"));
            assert_int_equal(strncmp(err.text, path, strlen(path)), 0);
            const bool renamed = strstr(err.text, "syncing the folder") != NULL;
            expect_step(renamed ? "new" : "old");
            if (renamed)
                assert_int_equal(write_sample("old", NULL, NULL), LF_OK);
        }
        expect_step("new");
        assert_true(failures >= 9); /* open, 5 writes, fsync, close, rename, folder */
    }
}

static void test_folder_missing(void **state)
{
    (void)state;
    lf_error err = {""};
    assert_int_equal(
        lf_safetensors_write("/tmp/lf-no-such-folder/a", arrays, 1, NULL, 0, NULL, &err),
        LF_BAD_INPUT);
    assert_string_equal(err.text, "/tmp/lf-no-such-folder/a: cannot write: No such file or "
                                  "directory (the folder does not exist)");
}

/* A real full disk: a file system of 64 KB in memory. Needs root; skipped otherwise. */
static void test_full_disk(void **state)
{
    (void)state;
    char disk[96], file[128];
    lf_error err = {""};
    static float big[65536];
    const lf_array large = {"large", LF_F32, 1, {65536}, big};
    snprintf(disk, sizeof disk, "%s/disk", folder);
    snprintf(file, sizeof file, "%s/b.safetensors", disk);
    assert_int_equal(mkdir(disk, 0700), 0);
    if (mount("tmpfs", disk, "tmpfs", 0, "size=64k")) {
        rmdir(disk);
        skip();
    }
    const lf_status first = lf_safetensors_write(file, arrays, 5, meta, 2, NULL, &err);
    const lf_status second = lf_safetensors_write(file, &large, 1, NULL, 0, NULL, &err);
    lf_safetensors *old = NULL;
    const lf_status third = lf_safetensors_open(file, &old, NULL);
    lf_safetensors_close(old);
    const int files = files_in(disk);
    umount(disk);
    rmdir(disk);
    assert_int_equal(first, LF_OK);
    assert_int_equal(second, LF_FAILED);
    assert_non_null(strstr(err.text, "cannot write (write: No space left on device); what was "
                                     "there is unchanged"));
    assert_int_equal(third, LF_OK);
    assert_int_equal(files, 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_round_trip, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_copy, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_not_utf8, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_bad_headers, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_bad_lengths, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_damage, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_reads_other_writers, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_failing_calls, make_folder, remove_folder),
        cmocka_unit_test(test_folder_missing),
        cmocka_unit_test_setup_teardown(test_full_disk, make_folder, remove_folder),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
