/* test_c8.c: steerable filters, field norm, pooling: closed forms and symmetry. */
#include "autograd/random.h"
#include "layers/c8_block.h"
#include "tests/close.h"

static const double PI = 3.14159265358979323846;
static const double ROUNDING = sizeof(lf_real) == 8 ? 1e-12 : 1e-5;

static void fill_normal(lf_real *x, long n, uint64_t item)
{
    lf_stream s = lf_stream_at(1, LF_RANDOM_TEST, 0, item);
    for (long i = 0; i < n; i++)
        x[i] = (lf_real)lf_normal(&s);
}

static lf_tensor *normal(lf_tape *tape, int rank, const long *dim, uint64_t item)
{
    lf_tensor *t = lf_tensor_new(tape, rank, dim);
    fill_normal(t->value, t->size, item);
    t->grad = lf_alloc_reals(tape, t->size);
    t->wants = true;
    memset(t->grad, 0, (size_t)t->size * sizeof(lf_real));
    return t;
}

/* ---- the basis ------------------------------------------------------------------------------- */

static void test_basis_dimensions(void **state)
{
    (void)state;
    const int e2cnn[] = {8, 48, 88, 144}, redet[] = {8, 64, 168, 320};
    for (int i = 0; i < 4; i++) {
        lf_c8_basis b;
        lf_c8_basis_init(&b, 2 * i + 1, LF_C8_E2CNN);
        assert_int_equal(b.count * LF_C8, e2cnn[i]);
        lf_c8_basis_free(&b);
        lf_c8_basis_init(&b, 2 * i + 1, LF_C8_REDET);
        assert_int_equal(b.count * LF_C8, redet[i]);
        lf_c8_basis_free(&b);
    }
}

static double table_at(const lf_c8_basis *b, int p, int member, int a)
{
    return (double)b->table[(p * b->count + member) * LF_C8 + a];
}

static void test_basis_is_normalised(void **state)
{
    (void)state;
    for (int cutoff = 0; cutoff < 2; cutoff++) {
        lf_c8_basis b;
        lf_c8_basis_init(&b, 7, (lf_c8_cutoff)cutoff);
        const int rotations = cutoff == LF_C8_E2CNN ? 8 : 1;
        for (int m = 0; m < b.count; m++) {
            double energy = 0;
            for (int p = 0; p < 49; p++)
                for (int a = 0; a < rotations; a++)
                    energy += table_at(&b, p, m, a) * table_at(&b, p, m, a) / rotations;
            assert_close(energy, 1, ROUNDING, 0);
        }
        lf_c8_basis_free(&b);
    }
}

/* Ring 1 of the 3x3 basis at (x, y), x to the right and y up, turned by `turn`, before scaling. */
static double ring_harmonic(int m, bool sine, double x, double y, double turn)
{
    const double r = hypot(x, y), angle = m * (atan2(y, x) - turn);
    if (m > 0 && r == 0)
        return 0;
    return exp(-(r - 1) * (r - 1) / (2 * 0.4 * 0.4)) * (sine ? sin(angle) : cos(angle));
}

/* The 3x3 basis of the cutoff 3r written down from its definition: the centre, then ring 1 with
 * frequency 0 and cos, sin of 1, 2, 3, each of unit norm when it is not turned. */
static double explicit_basis(int b, int row, int col, int a)
{
    const int m = b / 2;
    const bool sine = b > 1 && b % 2;
    double energy = 0;
    if (b == 0)
        return row == 1 && col == 1;
    for (int p = 0; p < 9; p++)
        energy += pow(ring_harmonic(m, sine, p % 3 - 1, 1 - p / 3, 0), 2);
    return ring_harmonic(m, sine, col - 1, 1 - row, 2 * PI * a / 8) / sqrt(energy);
}

/* The filter of w as a tensor, without a node. */
static lf_tensor *expand(lf_tape *tape, const lf_c8_basis *basis, const lf_tensor *w)
{
    const lf_c8_filter s = lf_c8_filter_of(basis, w);
    lf_tensor *f = lf_tensor_new(tape, 4, LF_DIMS(s.size, s.size, s.in * s.turns, s.out * LF_C8));
    assert_int_equal(f->size, lf_c8_filter_size(&s));
    lf_c8_expand(&s, w->value, f->value, lf_alloc_reals(tape, lf_c8_filter_scratch(&s)));
    return f;
}

static void test_expand_is_the_formula(void **state)
{
    (void)state;
    enum { OUT = 3, IN = 2, COUNT = 8 };
    lf_tape *tape = lf_tape_create();
    lf_c8_basis basis;
    lf_c8_basis_init(&basis, 3, LF_C8_REDET);
    const lf_tensor *w = normal(tape, 4, LF_DIMS(OUT, IN, 8, COUNT), 1);
    const lf_tensor *f = expand(tape, &basis, w);
    double worst = 0;
    for (int n = 0; n < f->size; n++) {
        const int a = n % 8, o = n / 8 % OUT, r = n / (8 * OUT) % 8, i = n / (64 * OUT) % IN;
        const int p = n / (64 * OUT * IN);
        double sum = 0;
        for (int b = 0; b < COUNT; b++)
            sum += (double)w->value[((o * IN + i) * 8 + (r - a + 8) % 8) * COUNT + b] *
                   explicit_basis(b, p / 3, p % 3, a);
        worst = larger(worst, fabs(sum - (double)f->value[n]));
    }
    assert_below(worst, 10 * ROUNDING);
    lf_c8_basis_free(&basis);
    lf_tape_free(tape);
}

static double dot(const lf_real *a, const lf_real *b, long n)
{
    double sum = 0;
    for (long i = 0; i < n; i++)
        sum += (double)a[i] * (double)b[i];
    return sum;
}

/* <expand(w), d> = <w, fold(d)> for lifts and regular filters of all sizes. */
static void test_expand_adjoint(void **state)
{
    (void)state;
    for (int c = 0; c < 16; c++) {
        const int size = 2 * (c % 4) + 1, lift = c / 8;
        lf_tape *tape = lf_tape_create();
        lf_c8_basis basis;
        lf_c8_basis_init(&basis, size, c / 4 % 2 ? LF_C8_REDET : LF_C8_E2CNN);
        const long dims[] = {3, 2, lift ? basis.count : 8, basis.count};
        const lf_tensor *w = normal(tape, lift ? 3 : 4, dims, 2);
        const lf_tensor *f = expand(tape, &basis, w), *d = normal(tape, 4, f->dim, 3);
        const lf_c8_filter s = lf_c8_filter_of(&basis, w);
        lf_real *dw = lf_alloc_reals(tape, w->size);
        memset(dw, 0, (size_t)w->size * sizeof *dw);
        lf_c8_fold(&s, d->value, dw, lf_alloc_reals(tape, lf_c8_filter_scratch(&s)));
        const double left = dot(f->value, d->value, f->size);
        const double right = dot(w->value, dw, w->size);
        assert_close(left, right, 0, 10 * ROUNDING * sqrt(dot(f->value, f->value, f->size)) * 10);
        lf_c8_basis_free(&basis);
        lf_tape_free(tape);
    }
}

/* Turning every filter by 90 degrees shifts both orientations by 2. */
static void test_quarter_turn_of_the_bank(void **state)
{
    (void)state;
    enum { F = 2, K = 5 };
    lf_tape *tape = lf_tape_create();
    lf_c8_basis basis;
    lf_c8_basis_init(&basis, K, LF_C8_REDET);
    const lf_tensor *f = expand(tape, &basis, normal(tape, 4, LF_DIMS(F, F, 8, basis.count), 4));
    double worst = 0;
    for (int n = 0; n < f->size; n++) {
        const int a = n % 8, o = n / 8 % F, r = n / (8 * F) % 8, i = n / (64 * F) % F;
        const int row = n / (64 * F * F * K), col = n / (64 * F * F) % K;
        const int turned =
            ((row * K + col) * F + i) * 64 * F; /* filter (r, a) at the turned pixel */
        const int from = (((col * K + (K - 1 - row)) * F + i) * 8 + (r + 6) % 8) * 8 * F;
        worst = larger(worst, fabs((double)f->value[turned + (r * F + o) * 8 + a] -
                                   (double)f->value[from + o * 8 + (a + 6) % 8]));
    }
    assert_below(worst, 10 * ROUNDING);
    lf_c8_basis_free(&basis);
    lf_tape_free(tape);
}

/* Response of a lift at the middle of an image of smooth blobs, image turned by 45 degrees. */
static double eighth_turn_defect(int size, double width)
{
    lf_store *store = lf_store_create(3);
    lf_tape *tape = lf_tape_create();
    lf_c8_conv layer;
    lf_c8_conv_init(store, "lift", true, 1, 8, size, 1, LF_C8_E2CNN, &layer);
    double difference = 0, sum = 0;
    for (uint64_t trial = 0; trial < 10; trial++) {
        lf_tensor *x = normal(tape, 4, LF_DIMS(2, size, size, 1), 0);
        memset(x->value, 0, (size_t)x->size * sizeof(lf_real));
        lf_stream s = lf_stream_at(2, LF_RANDOM_TEST, 0, trial);
        for (int blob = 0; blob < 30; blob++) {
            const double u = 6 * lf_normal(&s), v = 6 * lf_normal(&s), h = lf_normal(&s);
            for (int n = 0; n < 2 * size * size; n++) {
                const int row = n / size % size, col = n % size, turned = n / (size * size);
                const double c = turned ? sqrt(0.5) : 1, q = turned ? sqrt(0.5) : 0;
                const double bx = c * u - q * v, by = q * u + c * v;
                const double dx = col - size / 2 - bx, dy = size / 2 - row - by;
                x->value[n] += (lf_real)(h * exp(-(dx * dx + dy * dy) / (2 * width * width)));
            }
        }
        const lf_tensor *y = lf_c8_conv_forward(tape, &layer, x);
        const long middle = (size / 2 * size + size / 2) * 64;
        for (int n = 0; n < 64; n++) {
            const double a = (double)y->value[middle + n];
            const double b =
                (double)y->value[size * size * 64 + middle + n / 8 * 8 + (n % 8 + 1) % 8];
            difference += (a - b) * (a - b);
            sum += a * a;
        }
    }
    lf_c8_conv_free(&layer);
    lf_tape_free(tape);
    lf_store_free(store);
    return sqrt(difference / sum);
}

static void test_eighth_turn_of_smooth_images(void **state)
{
    (void)state;
    assert_below(eighth_turn_defect(3, 4), 0.01);
    assert_below(eighth_turn_defect(7, 4), 0.01);
    assert_below(eighth_turn_defect(3, 16), 0.001);
}

/* ---- norm ------------------------------------------------------------------------------------ */

static const long SHAPE[] = {3, 5, 4, 16};

static lf_tensor *norm_of(lf_tape *tape, lf_tensor *x, lf_norm_mode mode, lf_real *mean,
                          lf_real *variance)
{
    lf_tensor *gamma = lf_tensor_new(tape, 1, LF_DIMS(2)), *beta = lf_tensor_like(tape, gamma);
    for (int f = 0; f < 2; f++) {
        gamma->value[f] = 1;
        beta->value[f] = 0;
    }
    return lf_field_norm(tape, x, gamma, beta, NULL,
                         &(lf_field_norm_options){.mode = mode,
                                                  .group = 8,
                                                  .epsilon = 1e-5,
                                                  .momentum = 0.25,
                                                  .running_mean = mean,
                                                  .running_var = variance});
}

/* Mean and variance of field f, over images [first, end). */
static void moments(const lf_tensor *t, int f, long first, long end, double out[2])
{
    const long pixels = t->dim[1] * t->dim[2];
    out[0] = out[1] = 0;
    for (int pass = 0; pass < 2; pass++)
        for (long n = first * pixels; n < end * pixels; n++)
            for (int a = 0; a < 8; a++) {
                const double v = (double)t->value[n * 16 + f * 8 + a] - (pass ? out[0] : 0);
                out[pass] += (pass ? v * v : v) / (double)((end - first) * pixels * 8);
            }
}

static void test_norm_gives_unit_fields(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    lf_tensor *x = normal(tape, 4, SHAPE, 5);
    for (long i = 0; i < x->size; i++)
        x->value[i] = 100 + 3 * x->value[i]; /* a large mean must not spoil the variance */
    lf_real mean[2] = {0, 1}, variance[2] = {1, 2};
    const lf_tensor *y = norm_of(tape, x, LF_NORM_BATCH, mean, variance);
    for (int f = 0; f < 2; f++) {
        double in[2], out[2];
        moments(x, f, 0, 3, in);
        moments(y, f, 0, 3, out);
        assert_close(out[0], 0, 0, 10 * ROUNDING);
        assert_close(out[1], in[1] / (in[1] + 1e-5), 10 * ROUNDING, 0);
        assert_close(mean[f], 0.75 * f + 0.25 * in[0], ROUNDING, 0);
        assert_close(variance[f], 0.75 * (f + 1) + 0.25 * in[1], ROUNDING, 0);
    }
    const lf_tensor *z = norm_of(tape, x, LF_NORM_INSTANCE, NULL, NULL);
    for (int n = 0; n < 6; n++) {
        double out[2];
        moments(z, n % 2, n / 2, n / 2 + 1, out);
        assert_close(out[0], 0, 0, 10 * ROUNDING);
        assert_close(out[1], 1, 2e-6 + 10 * ROUNDING, 0);
    }
    lf_tape_free(tape);
}

static void test_norm_with_running_statistics(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    lf_tensor *x = normal(tape, 4, SHAPE, 6);
    lf_real mean[2] = {(lf_real)0.5, -1}, variance[2] = {4, (lf_real)0.25};
    const lf_tensor *y = norm_of(tape, x, LF_NORM_RUNNING, mean, variance);
    for (long i = 0; i < x->size; i++) {
        const int f = i % 16 >= 8;
        const double expected =
            ((double)x->value[i] - (double)mean[f]) / sqrt((double)variance[f] + 1e-5);
        assert_close(y->value[i], expected, ROUNDING, ROUNDING);
    }
    assert_close(mean[0], 0.5, 0, 0); /* untouched */
    lf_tape_free(tape);
}

static void test_norm_of_constants_is_zero(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    lf_tensor *x = normal(tape, 4, SHAPE, 7);
    for (long i = 0; i < x->size; i++)
        x->value[i] = i % 16 >= 8 ? 3 : -7;
    const lf_tensor *y = norm_of(tape, x, LF_NORM_BATCH, NULL, NULL);
    for (long i = 0; i < y->size; i++)
        assert_close(y->value[i], 0, 0, 1e-4);
    lf_tape_free(tape);
}

static void test_norm_adds_residual_before_relu(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    lf_tensor *x = normal(tape, 4, SHAPE, 8), *r = normal(tape, 4, SHAPE, 9);
    const lf_tensor *plain = norm_of(tape, x, LF_NORM_BATCH, NULL, NULL);
    lf_tensor *gamma = normal(tape, 1, LF_DIMS(2), 10), *beta = normal(tape, 1, LF_DIMS(2), 11);
    const lf_tensor *y = lf_field_norm(
        tape, x, gamma, beta, r,
        &(lf_field_norm_options){.mode = LF_NORM_BATCH, .group = 8, .epsilon = 1e-5, .relu = true});
    for (long i = 0; i < y->size; i++) {
        const int f = i % 16 >= 8;
        const double u = (double)gamma->value[f] * (double)plain->value[i] +
                         (double)beta->value[f] + (double)r->value[i];
        assert_close(y->value[i], u > 0 ? u : 0, ROUNDING, ROUNDING);
    }
    lf_tape_free(tape);
}

/* ---- pooling --------------------------------------------------------------------------------- */

static void test_max_pool_picks_the_first_of_equals(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    lf_real value[9] = {1, 5, 2, 5, 0, -1, -3, -2, -2}, grad[9] = {0};
    lf_tensor *x = lf_leaf(tape, 4, LF_DIMS(1, 3, 3, 1), value, grad);
    lf_tensor *y = lf_max_pool(tape, x, 3, 2, 1);
    const double expected[4] = {5, 5, 5, 0}, arrived[9] = {0, 3, 0, 4, 8, 0, 0, 0, 0};
    assert_int_equal(y->size, 4);
    for (int i = 0; i < 4; i++) {
        assert_close(y->value[i], expected[i], 0, 0);
        lf_grad(tape, y)[i] = (lf_real)(1 << i);
    }
    lf_backward_from(tape);
    for (int i = 0; i < 9; i++)
        assert_close(grad[i], arrived[i], 0, 0);
    lf_tape_free(tape);
}

static void test_group_sum(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    lf_tensor *x = normal(tape, 4, SHAPE, 12);
    for (long i = 0; i < x->size; i++)
        x->value[i] = (lf_real)(i % 8 + (i % 16 >= 8 ? 100 : 0));
    const lf_tensor *y = lf_group_sum(tape, x, 8);
    assert_int_equal(y->dim[3], 2);
    for (long i = 0; i < y->size; i++)
        assert_close(y->value[i], i % 2 ? 828 : 28, 0, 0);
    lf_tape_free(tape);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_basis_dimensions),
        cmocka_unit_test(test_basis_is_normalised),
        cmocka_unit_test(test_expand_is_the_formula),
        cmocka_unit_test(test_expand_adjoint),
        cmocka_unit_test(test_quarter_turn_of_the_bank),
        cmocka_unit_test(test_eighth_turn_of_smooth_images),
        cmocka_unit_test(test_norm_gives_unit_fields),
        cmocka_unit_test(test_norm_with_running_statistics),
        cmocka_unit_test(test_norm_of_constants_is_zero),
        cmocka_unit_test(test_norm_adds_residual_before_relu),
        cmocka_unit_test(test_max_pool_picks_the_first_of_equals),
        cmocka_unit_test(test_group_sum),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
