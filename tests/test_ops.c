/* test_ops.c: the gradient of every op and layer by table (double build), and that every public op
 * has a row. */
#include "autograd/ops.h"
#include "autograd/ops_image.h"
#include "autograd/random.h"
#include "autograd/spare.h"
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

#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/asan_interface.h>

/* A sanitizer build would stop at a touch of what lies behind a piece, or was given back. */
static void pieces_are_guarded(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    const char *piece = lf_alloc(tape, 128);
    const lf_mark mark = lf_tape_mark(tape);
    const char *scratch = lf_alloc(tape, 64);
    assert_null(__asan_region_is_poisoned((void *)(uintptr_t)piece, 128));
    assert_true(__asan_address_is_poisoned(piece + 128));
    assert_false(__asan_address_is_poisoned(scratch));
    lf_tape_release(tape, mark);
    assert_true(__asan_address_is_poisoned(scratch));
    lf_tape_free(tape);
}
#endif

enum { GUARD = 64 }; /* bytes behind a piece, at most: a sanitizer build has them */

static void arena_reaches_its_size_once(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    for (int round = 0; round < 3; round++) {
        char *first = lf_alloc(tape, 3 << 20), *second = lf_alloc(tape, 5 << 20);
        memset(first, 1, 3 << 20);
        memset(second, 1, 5 << 20);
        if (round)
            assert_in_range(second - first, 3 << 20, (3 << 20) + GUARD); /* one block now */
        lf_tape_reset(tape);
    }
    assert_in_range(lf_tape_peak(tape), 8 << 20, (8 << 20) + 2 * GUARD);
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
            assert_in_range(scratch - first, 1 << 20, (1 << 20) + GUARD);
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

/* ---- the filter of a blur, by its definition ---- */

/* Pixel (i, j) of x [h, w, c]; beyond the border the nearest one. */
static double pixel_at(const lf_tensor *x, long n, long i, long j, long c)
{
    const long h = x->dim[1], w = x->dim[2];
    i = i < 0 ? 0 : i < h ? i : h - 1;
    j = j < 0 ? 0 : j < w ? j : w - 1;
    return (double)x->value[((n * h + i) * w + j) * x->dim[3] + c];
}

static void check_blur(lf_tape *tape, const long *dim)
{
    static const double filter[3] = {0.25, 0.5, 0.25};
    lf_stream s = lf_stream_at(2, LF_RANDOM_TEST, (uint64_t)dim[1], (uint64_t)dim[2]);
    lf_tensor *x = lf_tensor_new(tape, 4, dim);
    for (long k = 0; k < x->size; k++)
        x->value[k] = (lf_real)lf_normal(&s);
    const lf_real *y = lf_blur(tape, x)->value;
    for (long k = 0; k < x->size; k++) {
        const long c = k % dim[3], j = k / dim[3] % dim[2], i = k / dim[3] / dim[2] % dim[1];
        double expected = 0;
        for (int p = -1; p <= 1; p++)
            for (int q = -1; q <= 1; q++)
                expected += filter[p + 1] * filter[q + 1] *
                            pixel_at(x, k / dim[3] / dim[2] / dim[1], i + p, j + q, c);
        assert_close(y[k], expected, 0, sizeof(lf_real) == 8 ? 1e-14 : 1e-6);
    }
}

static void blur_by_its_definition(void **state)
{
    (void)state;
    static const long dim[][4] = {{1, 1, 1, 1}, {2, 1, 5, 3}, {2, 5, 1, 2}, {1, 2, 2, 1},
                                  {3, 3, 2, 7}, {1, 2, 3, 1}, {2, 7, 9, 5}};
    lf_tape *tape = lf_tape_create();
    for (size_t k = 0; k < sizeof dim / sizeof *dim; k++)
        check_blur(tape, dim[k]);
    lf_tape_free(tape);
}

/* ---- memory that is used again ---- */

static void spare_pieces_are_cut_and_joined(void **state)
{
    (void)state;
    enum { LINE = LF_SPARE_ALIGNMENT / sizeof(lf_real) };
    static lf_real memory[8 * LINE];
    lf_spares s = {.count = 0};
    assert_null(lf_spares_take(&s, 1));
    lf_spares_give(&s, memory, 4 * LINE);
    lf_spares_give(&s, memory + 6 * LINE, LINE + 1);               /* rounded up to two lines */
    assert_ptr_equal(lf_spares_take(&s, LINE), memory + 6 * LINE); /* the smallest that will do */
    assert_ptr_equal(lf_spares_take(&s, 3 * LINE), memory);
    lf_spares_give(&s, memory + 4 * LINE, 2 * LINE); /* joins the one before */
    assert_int_equal(s.count, 2);
    lf_spares_give(&s, memory + 6 * LINE, LINE); /* and both of these */
    lf_spares_give(&s, memory, 3 * LINE);
    assert_int_equal(s.count, 1);
    assert_ptr_equal(lf_spares_take(&s, 8 * LINE), memory);
    assert_null(lf_spares_take(&s, 1));
}

enum { NORM = 2 * 3 * 3 * 4 };

/* Gradients of two norms on top of each other, the first one's result also the residual of the
 * second and seen through a view; `drop`: of neither the values are kept. Two walks. */
static void walk_norms(lf_tape *tape, bool drop, const lf_real *x, lf_real *dx, lf_real *dparts)
{
    static lf_real ones[4] = {1, 2, -1, 0.5};
    const lf_field_norm_options options = {LF_NORM_BATCH, 1, 1e-5, 0.1, true, NULL, NULL};
    lf_tape_reset(tape);
    lf_tensor *in = lf_leaf(tape, 4, LF_DIMS(2, 3, 3, 4), (lf_real *)(uintptr_t)x, dx);
    lf_tensor *scale = lf_leaf(tape, 1, LF_DIMS(4), ones, dparts);
    lf_tensor *shift = lf_leaf(tape, 1, LF_DIMS(4), ones, dparts + 4);
    lf_tensor *a = lf_field_norm(tape, in, scale, shift, NULL, &options);
    lf_tensor *view = lf_reshape(tape, a, 2, LF_DIMS(18, 4));
    lf_tensor *squares = lf_multiply(tape, view, view);
    lf_tensor *b = lf_field_norm(tape, lf_multiply(tape, a, in), scale, shift, a, &options);
    lf_tensor *first = lf_sum(tape, squares), *second = lf_sum(tape, lf_multiply(tape, b, in));
    if (drop) {
        lf_drop(tape, a);
        lf_drop(tape, b);
        lf_drop(tape, in); /* a leaf stays */
        assert_true(!a->value && !b->value && in->value);
        lf_tensor_like(tape, in); /* is where a or b was */
    }
    lf_backward(tape, first, 1);
    lf_backward(tape, second, 1);
}

static void dropped_values_are_made_again(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    lf_real x[NORM], dx[2][NORM] = {{0}}, dparts[2][8] = {{0}};
    lf_stream s = lf_stream_at(1, LF_RANDOM_TEST, 0, 0);
    for (int i = 0; i < NORM; i++)
        x[i] = (lf_real)lf_normal(&s);
    for (int drop = 0; drop < 2; drop++)
        walk_norms(tape, drop, x, dx[drop], dparts[drop]);
    assert_true(dx[0][0] != 0);
    assert_memory_equal(dx[0], dx[1], sizeof dx[0]);
    assert_memory_equal(dparts[0], dparts[1], sizeof dparts[0]);
    lf_tape_free(tape);
}

static void gradient_in_the_place_of_values(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    lf_real x[4] = {1, 2, 3, 4}, grad[4] = {0};
    lf_tensor *y = lf_scale(tape, lf_leaf(tape, 1, LF_DIMS(4), x, grad), 2);
    lf_real *g = lf_grad_in_place(tape, y);
    assert_ptr_equal(g, y->value);
    for (int i = 0; i < 4; i++)
        g[i] = (lf_real)(10 * i);
    lf_backward_from(tape);
    for (int i = 0; i < 4; i++)
        assert_close(grad[i], 20 * i, 0, 0);
    lf_tensor *constant = lf_scale(tape, lf_leaf(tape, 1, LF_DIMS(4), x, NULL), 2);
    assert_null(lf_grad_in_place(tape, constant));
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
#ifdef __SANITIZE_ADDRESS__
        cmocka_unit_test(pieces_are_guarded),
#endif
        cmocka_unit_test(arena_reaches_its_size_once),
        cmocka_unit_test(arena_grows_for_scratch),
        cmocka_unit_test(two_walks_add_up),
        cmocka_unit_test(blur_by_its_definition),
        cmocka_unit_test(spare_pieces_are_cut_and_joined),
        cmocka_unit_test(dropped_values_are_made_again),
        cmocka_unit_test(gradient_in_the_place_of_values),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
