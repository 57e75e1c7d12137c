/* test_random.c: Philox 4x32-10 against its published answers, and what random.h promises. */
#include <string.h>

#include "autograd/random.h"
#include "tests/close.h"

/* Known answers of Random123 1.14 (kat_vectors): counter, key, result. */
static const struct {
    uint32_t counter[4], key[2], result[4];
} answers[] = {
    {{0, 0, 0, 0}, {0, 0}, {0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}},
    {{0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff},
     {0xffffffff, 0xffffffff},
     {0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}},
    {{0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344},
     {0xa4093822, 0x299f31d0},
     {0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}},
};

static void known_answers(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof answers / sizeof *answers; i++) {
        lf_stream s = {.used = 4};
        memcpy(s.counter, answers[i].counter, sizeof s.counter);
        memcpy(s.key, answers[i].key, sizeof s.key);
        for (int k = 0; k < 4; k++)
            assert_int_equal(lf_bits(&s), answers[i].result[k]);
    }
}

/* Numbers of runs must stay what they are from version to version. */
static void a_stream_begins_as_ever(void **state)
{
    (void)state;
    lf_stream s = lf_stream_at(0, 0, 0, 0);
    for (int k = 0; k < 4; k++)
        assert_int_equal(lf_bits(&s), answers[0].result[k]);
    const uint64_t key = 7 ^ (0x9E3779B97F4A7C15u * (uint64_t)LF_RANDOM_POINTS);
    lf_stream a = lf_stream_at(7, LF_RANDOM_POINTS, 5, 0x100000002u);
    lf_stream b = {{(uint32_t)key, (uint32_t)(key >> 32)}, {0, 5, 2, 1}, {0}, 4};
    for (int k = 0; k < 9; k++)
        assert_int_equal(lf_bits(&a), lf_bits(&b));
}

static void uniform_is_open(void **state)
{
    (void)state;
    lf_stream low = {.block = {0}, .used = 0}, high = {.block = {0xffffffff}, .used = 0};
    assert_true(lf_uniform(&low) > 0);
    assert_true(lf_uniform(&high) < 1);
}

static void moments(void **state)
{
    (void)state;
    enum { N = 200000 };
    lf_stream s = lf_stream_at(3, LF_RANDOM_TEST, 0, 0);
    double u1 = 0, u2 = 0, n1 = 0, n2 = 0, n4 = 0;
    for (int i = 0; i < N; i++) {
        const double u = lf_uniform(&s), n = lf_normal(&s);
        assert_true(u > 0 && u < 1 && isfinite(n));
        u1 += u / N;
        u2 += u * u / N;
        n1 += n / N;
        n2 += n * n / N;
        n4 += n * n * n * n / N;
    }
    assert_close(u1, 0.5, 0, 4e-3);
    assert_close(u2, 1.0 / 3, 0, 4e-3);
    assert_close(n1, 0, 0, 0.012);
    assert_close(n2, 1, 0, 0.016);
    assert_close(n4, 3, 0, 0.12);
}

static void index_stays_below_n(void **state)
{
    (void)state;
    static const long sizes[] = {1, 2, 3, 10, 1000, 2147483647};
    lf_stream s = lf_stream_at(3, LF_RANDOM_TEST, 1, 0);
    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++) {
        lf_stream low = {.block = {0}, .used = 0}, high = {.block = {0xffffffff}, .used = 0};
        assert_int_equal(lf_index(&low, sizes[k]), 0);
        assert_int_equal(lf_index(&high, sizes[k]), sizes[k] - 1);
        for (int i = 0; i < 1000; i++) {
            const long x = lf_index(&s, sizes[k]);
            assert_true(x >= 0 && x < sizes[k]);
        }
    }
    long count[10] = {0};
    for (int i = 0; i < 100000; i++)
        count[lf_index(&s, 10)]++;
    for (int i = 0; i < 10; i++)
        assert_close(count[i], 10000, 0.05, 0);
}

static int same_start(lf_stream a, lf_stream b)
{
    int same = 0;
    for (int k = 0; k < 8; k++)
        same += lf_bits(&a) == lf_bits(&b);
    return same;
}

static void every_name_has_its_own_numbers(void **state)
{
    (void)state;
    const lf_stream s = lf_stream_at(1, LF_RANDOM_POINTS, 10, 20);
    assert_int_equal(same_start(s, lf_stream_at(1, LF_RANDOM_POINTS, 10, 20)), 8);
    assert_int_equal(same_start(s, lf_stream_at(2, LF_RANDOM_POINTS, 10, 20)), 0);
    assert_int_equal(same_start(s, lf_stream_at(1, LF_RANDOM_SETTING, 10, 20)), 0);
    assert_int_equal(same_start(s, lf_stream_at(1, LF_RANDOM_POINTS, 11, 20)), 0);
    assert_int_equal(same_start(s, lf_stream_at(1, LF_RANDOM_POINTS, 10, 21)), 0);
    assert_int_equal(same_start(s, lf_stream_at(1, LF_RANDOM_POINTS, 20, 10)), 0);
    assert_int_equal(same_start(s, lf_stream_at(1, LF_RANDOM_POINTS, 10, 20 + (1ull << 32))), 0);
}

static void names_have_their_own_hash(void **state)
{
    (void)state;
    assert_true(lf_name_hash("a") != lf_name_hash("b"));
    assert_true(lf_name_hash("chair-train-0001") != lf_name_hash("chair-train-0010"));
    assert_true(lf_name_hash("") == 1469598103934665603u);
    assert_true(lf_name_hash("\xff") != lf_name_hash("\x7f")); /* bytes, not signed chars */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(known_answers),
        cmocka_unit_test(a_stream_begins_as_ever),
        cmocka_unit_test(uniform_is_open),
        cmocka_unit_test(moments),
        cmocka_unit_test(index_stays_below_n),
        cmocka_unit_test(every_name_has_its_own_numbers),
        cmocka_unit_test(names_have_their_own_hash),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
