/* test_stability.c: the hard cases of elf-bench stability in one precision: all numbers are finite,
 * those with a closed form are right to the last places that their condition leaves, gradients are
 * those of central differences (in double).                              [docs/stability.md]
 * Float against double is elf-bench's own check, which the test `stability_errors` runs.
 */
#include "bench/stability.h"
#include "tests/close.h"

static void check_array(const lf_stability *s, const lf_stability_array *a)
{
    if (!isnan(a->ulps) && !(a->ulps <= lf_stability_limit(s->c)))
        fail_msg("%s, %s %g: %s%s errs by %.3g, %.3g last places", s->c->name, s->c->parameter,
                 s->parameter, a->gradient ? "gradient of " : "", a->name, a->error, a->ulps);
    if (isnan(a->ulps) && !isnan(a->error) && !(a->error <= LF_STABILITY_DIFFERENCE))
        fail_msg("%s, %s %g: gradient of %s differs from differences by %.3g", s->c->name,
                 s->c->parameter, s->parameter, a->name, a->error);
}

static void check_case(const lf_stability_case *c, double parameter)
{
    lf_stability *s = lf_stability_open(c, parameter);
    if (!lf_stability_finite(s))
        fail_msg("%s, %s %g: a number is not finite", c->name, c->parameter, parameter);
    lf_stability_measure(s);
    for (int a = 0; a < s->arrays; a++)
        check_array(s, &s->array[a]);
    lf_stability_close(s);
}

static void all_cases(void **state)
{
    (void)state;
    const lf_stability_case *c;
    for (int i = 0; (c = lf_stability_at(i)); i++)
        for (int at = 0; at < c->count; at++)
            check_case(c, c->at[at]);
}

/* What the suite calls an error: a case that loses a share of its digits is found. */
static void lossy(lf_stability *s)
{
    const double value[2] = {1 + s->parameter, 2};
    const long double exact[2] = {1, 2};
    lf_stability_numbers(s, "value", 2, value, exact);
}

static void errors_are_seen(void **state)
{
    (void)state;
    static const lf_stability_case c = {"lossy", "loss", lossy, LF_STABILITY_AT(0)};
    for (double loss = 0; loss < 1; loss += 0.25) {
        lf_stability *s = lf_stability_open(&c, loss);
        lf_stability_measure(s);
        assert_close(s->array[0].error, loss / 2, 1e-12, 0);
        assert_close(s->array[0].ulps * lf_stability_unit(s, 1), loss / 2, 1e-12, 0);
        lf_stability_close(s);
    }
    lf_stability *s = lf_stability_open(&c, NAN);
    assert_false(lf_stability_finite(s));
    lf_stability_close(s);
}

static void names_are_unique(void **state)
{
    (void)state;
    const lf_stability_case *c;
    for (int i = 0; (c = lf_stability_at(i)); i++)
        assert_ptr_equal(lf_stability_find(c->name), c);
    assert_null(lf_stability_find("no such case"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_cases),
        cmocka_unit_test(errors_are_seen),
        cmocka_unit_test(names_are_unique),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
