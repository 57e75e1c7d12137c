/* test_ray_frame.c: rays, section and twist against their definitions.  [method.md 1.1 - 1.6, 10]
 * All in double. Scene of size 1: points, moments and translations are of order 1. */
#include "tests/close.h"

#include "autograd/random.h"
#include "layers/ray_frame.h"

enum { PAIRS = 10000 };

static const double limit = 1e-11;

static void random_unit(lf_stream *s, double d[3])
{
    double n = 0;
    for (int i = 0; i < 3; i++) {
        d[i] = lf_normal(s);
        n += d[i] * d[i];
    }
    for (int i = 0; i < 3; i++)
        d[i] /= sqrt(n);
}

static void random_point(lf_stream *s, double p[3])
{
    for (int i = 0; i < 3; i++)
        p[i] = 2 * lf_uniform(s) - 1;
}

/* A rotation from a unit quaternion, a translation in the cube. */
static lf_frame random_motion(lf_stream *s)
{
    double q[4], n = 0;
    lf_frame g;
    for (int i = 0; i < 4; i++) {
        q[i] = lf_normal(s);
        n += q[i] * q[i];
    }
    for (int i = 0; i < 4; i++)
        q[i] /= sqrt(n);
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double r[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                         2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                         2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
    for (int i = 0; i < 9; i++)
        g.rotation[i] = r[i];
    random_point(s, g.origin);
    return g;
}

static lf_ray random_ray(lf_stream *s)
{
    double p[3], d[3];
    random_point(s, p);
    random_unit(s, d);
    return lf_ray_through(p, d);
}

static double ray_error(const lf_ray *a, const lf_ray *b)
{
    double worst = 0;
    for (int i = 0; i < 3; i++)
        worst = larger(worst, larger(fabs(a->direction[i] - b->direction[i]),
                                     fabs(a->moment[i] - b->moment[i])));
    return worst;
}

static double frame_error(const lf_frame *a, const lf_frame *b)
{
    double worst = 0;
    for (int i = 0; i < 9; i++)
        worst = larger(worst, fabs(a->rotation[i] - b->rotation[i]));
    for (int i = 0; i < 3; i++)
        worst = larger(worst, fabs(a->origin[i] - b->origin[i]));
    return worst;
}

static double twist_error(const lf_twist *a, const lf_twist *b)
{
    return larger(fabs(a->shift - b->shift),
                  larger(fabs(a->cosine - b->cosine), fabs(a->sine - b->sine)));
}

static lf_twist stabiliser(double gamma, double shift)
{
    return (lf_twist){cos(gamma), sin(gamma), shift};
}

static double axes_defect(const double s[9])
{
    double worst = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const double p = s[i] * s[j] + s[3 + i] * s[3 + j] + s[6 + i] * s[6 + j];
            worst = larger(worst, fabs(p - (i == j)));
        }
    return worst;
}

/* ---- rays ---- */

static void test_action(void **state)
{
    (void)state;
    double worst = 0;
    for (int k = 0; k < PAIRS; k++) {
        lf_stream s = lf_stream_at(1, LF_RANDOM_TEST, 0, (uint64_t)k);
        double p[3], d[3], moved[3];
        random_point(&s, p);
        random_unit(&s, d);
        const lf_frame g = random_motion(&s), h = random_motion(&s);
        const lf_ray x = lf_ray_through(p, d), hx = lf_ray_move(&h, &x), ghx = lf_ray_move(&g, &hx);
        const lf_frame gh = lf_frame_compose(&g, &h), back = lf_frame_inverse(&gh);
        const lf_ray once = lf_ray_move(&gh, &x), home = lf_ray_move(&back, &once);
        lf_frame_apply(&gh, p, moved);
        const lf_ray of_points = lf_ray_through(moved, once.direction);
        const lf_ray at_point = lf_ray_about(&x, p);
        worst = larger(worst, larger(ray_error(&ghx, &once), ray_error(&home, &x)));
        worst = larger(worst, ray_error(&of_points, &once));
        for (int i = 0; i < 3; i++) /* a ray through p has no moment about p */
            worst = larger(worst, fabs(at_point.moment[i]));
    }
    assert_below(worst, limit);
}

static void test_points_of_a_ray(void **state)
{
    (void)state;
    double worst = 0;
    for (int k = 0; k < PAIRS; k++) {
        lf_stream s = lf_stream_at(2, LF_RANDOM_TEST, 0, (uint64_t)k);
        double p[3], d[3], again[3], moved[3], foot[3];
        random_point(&s, p);
        random_unit(&s, d);
        const lf_frame g = random_motion(&s);
        const lf_ray x = lf_ray_through(p, d), y = lf_ray_move(&g, &x);
        const double t = lf_ray_parameter(&x, p);
        lf_ray_point(&x, t, again);
        lf_frame_apply(&g, p, moved);
        lf_ray_foot(&x, foot);
        worst = larger(worst, fabs(lf_ray_parameter(&x, foot)));
        for (int i = 0; i < 3; i++)
            worst = larger(worst, fabs(again[i] - p[i]));
        /* the parameter shifts by the twist's translation */
        const double shift = lf_ray_twist(&g, &x).shift;
        worst = larger(worst, fabs(lf_ray_parameter(&y, moved) - t - shift));
    }
    assert_below(worst, limit);
}

/* ---- section ---- */

static void test_section(void **state)
{
    (void)state;
    const lf_ray base = lf_ray_base();
    double worst = 0;
    for (int k = 0; k < PAIRS; k++) {
        lf_stream s = lf_stream_at(3, LF_RANDOM_TEST, 0, (uint64_t)k);
        const lf_ray x = random_ray(&s);
        const lf_frame section = lf_ray_section(&x);
        const lf_ray y = lf_ray_move(&section, &base);
        const double *r = section.rotation;
        const double det = r[0] * (r[4] * r[8] - r[5] * r[7]) - r[1] * (r[3] * r[8] - r[5] * r[6]) +
                           r[2] * (r[3] * r[7] - r[4] * r[6]);
        worst = larger(worst, larger(ray_error(&x, &y), larger(axes_defect(r), fabs(det - 1))));
    }
    assert_below(worst, limit);
}

static void test_exact_poles(void **state)
{
    (void)state;
    static const double up[3][3] = {{0, 0, 1}, {-0.0, 0, 1}, {0, -0.0, 1}};
    const double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, down[9] = {-1, 0, 0, 0, 1, 0, 0, 0, -1};
    double axes[9];
    for (int k = 0; k < 3; k++) {
        lf_ray_axes(up[k], axes);
        for (int i = 0; i < 9; i++)
            assert_true(axes[i] == identity[i]);
        lf_ray_axes((const double[3]){up[k][0], up[k][1], -1}, axes);
        for (int i = 0; i < 9; i++)
            assert_true(axes[i] == down[i]);
    }
}

/* d_z = +-(1 - 1e-12): frames stay orthonormal, the twist is right to rounding over rho. */
static void test_near_poles(void **state)
{
    (void)state;
    for (int k = 0; k < 1000; k++) {
        lf_stream s = lf_stream_at(4, LF_RANDOM_TEST, 0, (uint64_t)k);
        const double away = 1e-12, rho = sqrt(away * (2 - away)), alpha = 6.3 * lf_uniform(&s);
        const double d[3] = {rho * cos(alpha), rho * sin(alpha), k % 2 ? 1 - away : away - 1};
        double p[3];
        random_point(&s, p);
        const lf_ray x = lf_ray_through(p, d);
        const lf_frame g = random_motion(&s), back = lf_frame_inverse(&g);
        const lf_ray y = lf_ray_move(&g, &x);
        const lf_twist there = lf_ray_twist(&g, &x), home = lf_ray_twist(&back, &y);
        const lf_twist both = lf_twist_compose(&home, &there), none = stabiliser(0, 0);
        const lf_frame section = lf_ray_section(&x);
        assert_below(axes_defect(section.rotation), 1e-15);
        assert_below(twist_error(&both, &none), 1e-15 / rho);
    }
}

/* ---- twist ---- */

/* s(g x)^-1 g s(x) as a motion is the rotation and the shift that the twist says. */
static void test_twist_is_the_definition(void **state)
{
    (void)state;
    double worst = 0;
    for (int k = 0; k < PAIRS; k++) {
        lf_stream s = lf_stream_at(5, LF_RANDOM_TEST, 0, (uint64_t)k);
        const lf_ray x = random_ray(&s);
        const lf_frame g = random_motion(&s);
        const lf_ray y = lf_ray_move(&g, &x);
        const lf_frame of_x = lf_ray_section(&x), of_y = lf_ray_section(&y);
        const lf_frame from_y = lf_frame_inverse(&of_y), moved = lf_frame_compose(&g, &of_x);
        const lf_frame left = lf_frame_compose(&from_y, &moved);
        const lf_twist h = lf_ray_twist(&g, &x);
        const lf_frame as_frame = lf_twist_frame(&h);
        worst = larger(worst, frame_error(&left, &as_frame));
    }
    assert_below(worst, limit);
}

static void test_cocycle(void **state)
{
    (void)state;
    double worst = 0;
    for (int k = 0; k < PAIRS; k++) {
        lf_stream s = lf_stream_at(6, LF_RANDOM_TEST, 0, (uint64_t)k);
        const lf_ray x = random_ray(&s);
        const lf_frame a = random_motion(&s), b = random_motion(&s);
        const lf_frame ab = lf_frame_compose(&a, &b), back = lf_frame_inverse(&b);
        const lf_ray bx = lf_ray_move(&b, &x);
        const lf_twist first = lf_ray_twist(&b, &x), second = lf_ray_twist(&a, &bx);
        const lf_twist both = lf_twist_compose(&second, &first), whole = lf_ray_twist(&ab, &x);
        const lf_twist home = lf_ray_twist(&back, &bx), opposite = lf_twist_inverse(&first);
        worst = larger(worst, larger(twist_error(&both, &whole), twist_error(&home, &opposite)));
    }
    assert_below(worst, limit);
}

/* h(s(x)^-1, y): its shift is -<foot of x, d_y>. Two rays in one frame need it. */
static void test_twist_of_a_section(void **state)
{
    (void)state;
    double worst = 0;
    for (int k = 0; k < PAIRS; k++) {
        lf_stream s = lf_stream_at(7, LF_RANDOM_TEST, 0, (uint64_t)k);
        const lf_ray x = random_ray(&s), y = random_ray(&s), base = lf_ray_base();
        const lf_frame of_x = lf_ray_section(&x), of_y = lf_ray_section(&y);
        const lf_frame into = lf_frame_inverse(&of_x), both = lf_frame_compose(&into, &of_y);
        const lf_twist h = lf_ray_twist(&into, &y), of_both = lf_ray_twist(&both, &base);
        double foot[3];
        lf_ray_foot(&x, foot);
        worst = larger(worst, fabs(h.shift + lf_ray_parameter(&y, foot)));
        worst = larger(worst, twist_error(&h, &of_both)); /* h(s(x)^-1 s(y), base) */
    }
    assert_below(worst, limit);
}

/* Rotations about the base ray twist no ray but the base ray and its opposite. */
static void test_stabiliser(void **state)
{
    (void)state;
    for (int k = 0; k < 1000; k++) {
        lf_stream s = lf_stream_at(8, LF_RANDOM_TEST, 0, (uint64_t)k);
        const double gamma = 6.3 * (lf_uniform(&s) - 0.5), t = 2 * lf_uniform(&s) - 1;
        const lf_twist h = stabiliser(gamma, t);
        const lf_frame g = lf_twist_frame(&h);
        double p[3];
        random_point(&s, p);
        const lf_ray x = random_ray(&s), up = lf_ray_through(p, (const double[3]){0, 0, 1}),
                     down = lf_ray_through(p, (const double[3]){0, 0, -1});
        const lf_twist generic = lf_ray_twist(&g, &x), is_generic = {1, 0, t * x.direction[2]};
        const lf_twist at_up = lf_ray_twist(&g, &up), at_down = lf_ray_twist(&g, &down);
        const lf_twist opposite = lf_twist_inverse(&h);
        assert_below(twist_error(&generic, &is_generic), limit);
        assert_below(twist_error(&at_up, &h), 1e-15);
        assert_below(twist_error(&at_down, &opposite), 1e-15);
    }
}

/* The coordinates of a tangent vector along the frame's first two axes turn by +gamma. */
static void test_tangent_vectors_turn_by_gamma(void **state)
{
    (void)state;
    double worst = 0;
    for (int k = 0; k < PAIRS; k++) {
        lf_stream s = lf_stream_at(9, LF_RANDOM_TEST, 0, (uint64_t)k);
        const lf_ray x = random_ray(&s);
        const lf_frame g = random_motion(&s);
        const lf_ray y = lf_ray_move(&g, &x);
        const lf_twist h = lf_ray_twist(&g, &x);
        const double u[2] = {lf_normal(&s), lf_normal(&s)};
        double before[9], after[9], v[3], moved[3];
        lf_ray_axes(x.direction, before);
        lf_ray_axes(y.direction, after);
        for (int i = 0; i < 3; i++)
            v[i] = u[0] * before[3 * i] + u[1] * before[3 * i + 1];
        for (int i = 0; i < 3; i++)
            moved[i] = g.rotation[3 * i] * v[0] + g.rotation[3 * i + 1] * v[1] +
                       g.rotation[3 * i + 2] * v[2];
        const double w[2] = {h.cosine * u[0] - h.sine * u[1], h.sine * u[0] + h.cosine * u[1]};
        for (int i = 0; i < 3; i++)
            worst = larger(worst, fabs(moved[i] - w[0] * after[3 * i] - w[1] * after[3 * i + 1]));
    }
    assert_below(worst, limit);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_action),     cmocka_unit_test(test_points_of_a_ray),
        cmocka_unit_test(test_section),    cmocka_unit_test(test_exact_poles),
        cmocka_unit_test(test_near_poles), cmocka_unit_test(test_twist_is_the_definition),
        cmocka_unit_test(test_cocycle),    cmocka_unit_test(test_twist_of_a_section),
        cmocka_unit_test(test_stabiliser), cmocka_unit_test(test_tangent_vectors_turn_by_gamma),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
