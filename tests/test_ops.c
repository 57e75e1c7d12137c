/* test_ops.c: the gradient of every op and layer by table (double build), and that every public op
 * has a row. */
#include "autograd/ops.h"
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

static void light_fields(void **state)
{
    (void)state;
    check_table(light_field_cases, light_field_case_count);
}

static void ibrnet(void **state)
{
    (void)state;
    check_table(ibrnet_cases, ibrnet_case_count);
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

/* Scratch that is given back before the reset counts as well. */
static void arena_grows_for_scratch(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    for (int round = 0; round < 3; round++) {
        char *first = lf_alloc(tape, 1 << 20);
        const lf_mark mark = lf_tape_mark(tape);
        char *scratch = lf_alloc(tape, 5 << 20);
        memset(scratch, 1, 5 << 20);
        if (round)
            assert_true(scratch == first + (1 << 20));
        lf_tape_release(tape, mark);
        lf_tape_reset(tape);
    }
    lf_tape_free(tape);
}

/* Two losses on one tape, both through a view of what neither owns. */
static void two_walks_add_up(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    lf_real x[4] = {1, 2, 3, 4}, grad[4] = {0};
    lf_tensor *doubled = lf_scale(tape, lf_leaf(tape, 1, LF_DIMS(4), x, grad), 2);
    lf_tensor *view = lf_reshape(tape, doubled, 2, LF_DIMS(2, 2));
    lf_tensor *first = lf_sum(tape, view), *second = lf_sum(tape, lf_scale(tape, view, 3));
    lf_backward(tape, first, 1);
    lf_backward(tape, second, 1);
    for (int i = 0; i < 4; i++)
        assert_close(grad[i], 2 + 6, 0, 0);
    lf_tape_free(tape);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(core),
        cmocka_unit_test(layers),
        cmocka_unit_test(images),
        cmocka_unit_test(light_fields),
        cmocka_unit_test(ibrnet),
        cmocka_unit_test(arena_reaches_its_size_once),
        cmocka_unit_test(arena_grows_for_scratch),
        cmocka_unit_test(two_walks_add_up),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
