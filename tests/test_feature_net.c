/* test_feature_net.c: the renderers' feature networks: sizes, reference numbers, where a map looks,
 * gradient, threads. */
#include <fcntl.h>
#include <omp.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>
#include "autograd/random.h"
#include "models/feature_net.h"
#include "tests/close.h"

static lf_feature_config small(long width, long features)
{
    return (lf_feature_config){.kind = LF_FEATURES_SMALL, .width = width, .features = features};
}

static lf_feature_config resnet(long width, long features, int a, int b, int c)
{
    return (lf_feature_config){
        .kind = LF_FEATURES_RESNET34, .width = width, .features = features, .layers = {a, b, c}};
}

typedef struct net {
    lf_store *store;
    lf_tape *tape;
    lf_feature_net features;
} net;

static net open_net(lf_feature_config config)
{
    net n = {lf_store_create(5), lf_tape_create(), {.block = NULL}};
    lf_feature_net_init(n.store, "features", &config, &n.features);
    return n;
}

static void close_net(net *n)
{
    lf_feature_net_free(&n->features);
    lf_tape_free(n->tape);
    lf_store_free(n->store);
}

/* Numbers by formula, the same on every machine and in the script behind the reference numbers. */
static double wave(long i, int k)
{
    return sin(1.3 * k + 0.7 * (double)i + (double)(i * i % 1009));
}

static lf_tensor *images_of(lf_tape *tape, long count, long height, long width)
{
    lf_tensor *x = lf_tensor_new(tape, 4, LF_DIMS(count, height, width, 3));
    for (long i = 0; i < x->size; i++)
        x->value[i] = (lf_real)(0.5 + 0.5 * sin(0.9 * (double)i + (double)(i * i % 101)));
    return x;
}

/* Array k of the store is wave(., k): filters times sqrt(2 / fan in), scales 1 + 0.1, the rest 0.1.
 */
static void fill(net *n)
{
    for (int k = 0; k < lf_store_count(n->store); k++) {
        const lf_parameter *p = lf_store_at(n->store, k);
        const bool filter = p->rank == 4, scale = strstr(p->name, ".scale");
        const double a = filter ? sqrt(2.0 / (double)(p->dim[0] * p->dim[1] * p->dim[2])) : 0.1;
        for (long i = 0; i < p->size; i++)
            lf_values(p)[i] = (lf_real)((scale ? 1 : 0) + a * wave(i, k));
    }
}

/* ---- sizes ----------------------------------------------------------------------------------- */

static void check_sizes(lf_feature_config config, const long (*size)[2], int count)
{
    net n = open_net(config);
    lf_tape_set_grad(n.tape, false);
    for (int i = 0; i < count; i++) {
        lf_tape_reset(n.tape);
        const lf_tensor *y = lf_feature_net_forward(n.tape, &n.features,
                                                    images_of(n.tape, 2, size[i][0], size[i][1]));
        const long stride = lf_feature_net_stride(&n.features);
        assert_int_equal(y->dim[0], 2);
        assert_int_equal(y->dim[1], (size[i][0] + stride - 1) / stride);
        assert_int_equal(y->dim[2], (size[i][1] + stride - 1) / stride);
        assert_int_equal(y->dim[3], config.features);
        assert_int_equal(y->dim[1], lf_feature_net_lines(&n.features, size[i][0]));
        assert_int_equal(y->dim[2], lf_feature_net_lines(&n.features, size[i][1]));
        for (long j = 0; j < y->size; j++)
            assert_true(isfinite(y->value[j]));
    }
    close_net(&n);
}

static void test_sizes(void **state)
{
    (void)state;
    const long size[][2] = {{100, 100}, {112, 84}, {97, 65}, {17, 17}, {18, 19}, {6, 5}};
    check_sizes(small(12, 12), size, 6);
    const long least[][2] = {{5, 5}};
    check_sizes(small(12, 12), least, 1);
    check_sizes(resnet(8, 6, 1, 1, 1), size, 5);
}

static void test_parameters_and_cost(void **state)
{
    (void)state;
    net s = open_net(small(12, 12)), r = open_net(resnet(64, 64, 3, 4, 6));
    assert_int_equal(lf_store_trainable(s.store), 18144);
    assert_int_equal(lf_store_trainable(r.store), 8917120);
    assert_int_equal(lf_feature_net_smallest(&s.features), 5);
    assert_int_equal(lf_feature_net_smallest(&r.features), 17);
    const double half = 50 * 50, quarter = 25 * 25;
    assert_close(lf_feature_net_macs(&s.features, 100, 100),
                 half * (75 * 12 + 108 * 12 + 324 * 24 + 24 * 12) + quarter * (108 * 24 + 216 * 24),
                 0, 0);
    close_net(&s);
    close_net(&r);
}

/* An image below the smallest size aborts, with both sizes printed. */
static void check_too_small(lf_feature_config config)
{
    net n = open_net(config);
    const long smallest = lf_feature_net_smallest(&n.features);
    fflush(NULL);
    const pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        dup2(open("/dev/null", O_WRONLY), STDERR_FILENO);
        signal(SIGABRT, SIG_DFL);
        lf_feature_net_forward(n.tape, &n.features, images_of(n.tape, 1, smallest, smallest - 1));
        _exit(0);
    }
    int status = 0;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFSIGNALED(status) && WTERMSIG(status) == SIGABRT);
    close_net(&n);
}

static void test_too_small(void **state)
{
    (void)state;
    check_too_small(small(12, 12));
    check_too_small(resnet(8, 6, 1, 1, 1));
}

/* What training keeps, against what the tape holds, which has unused ends of blocks besides. */
static void check_kept(lf_feature_config config)
{
    net n = open_net(config);
    lf_feature_net_forward(n.tape, &n.features, images_of(n.tape, 1, 96, 80));
    const double images = 96 * 80 * 3;
    const double kept = lf_feature_net_kept(&n.features, 96, 80) + images;
    const double held = (double)lf_tape_bytes(n.tape) / sizeof(lf_real);
    assert_true(held >= kept && held < 1.25 * kept);
    close_net(&n);
}

static void test_kept(void **state)
{
    (void)state;
    check_kept(small(12, 12));
    check_kept(resnet(8, 6, 3, 4, 6));
}

/* ---- reference ------------------------------------------------------------------------------- */

/* Made with PyTorch 1.13 in double: the same layers (Conv2d with padding_mode "reflect",
 * InstanceNorm2d affine, interpolate bilinear with align_corners false and true), filled with the
 * numbers of `fill` in the store's order and layout. Numbers size * j / 7 + j of the result,
 * and the square root of the sum of all squares. */
static void check_reference(lf_feature_config config, long height, long width, const double *want)
{
    net n = open_net(config);
    fill(&n);
    lf_tape_set_grad(n.tape, false);
    const lf_tensor *y =
        lf_feature_net_forward(n.tape, &n.features, images_of(n.tape, 2, height, width));
    const double tolerance = sizeof(lf_real) == 8 ? 2e-9 : 1e-4;
    double squares = 0;
    for (int j = 0; j < 7; j++)
        assert_close(y->value[y->size * j / 7 + j], want[j], 0, tolerance);
    for (long i = 0; i < y->size; i++)
        squares += (double)y->value[i] * (double)y->value[i];
    assert_close(sqrt(squares), want[7], tolerance, 0);
    close_net(&n);
}

static void test_reference(void **state)
{
    (void)state;
    const double of_small[] = {0.5772582585,  0.03444676994, 0.01609807886, 0.1492783607,
                               -0.3775196814, 0.4790348248,  0.081518119,   14.55172138};
    const double of_resnet[] = {-0.3470262388, 0.9626823142,  -0.5671247315, 0.4852508643,
                                -0.935939565,  -0.6256829624, -0.6509162929, 29.45951715};
    check_reference(small(12, 12), 18, 15, of_small);
    check_reference(resnet(8, 6, 1, 2, 1), 34, 37, of_resnet);
}

/* ---- where a map looks ----------------------------------------------------------------------- */

/* The map's middle line with image column c (or none: -1) brighter. All filters are positive means,
 * so that ELU changes nothing and the network is linear. */
static const lf_real *middle_line(net *n, long height, long width, long c)
{
    for (int k = 0; k < lf_store_count(n->store); k++) {
        const lf_parameter *p = lf_store_at(n->store, k);
        for (long i = 0; p->rank == 4 && i < p->size; i++)
            lf_values(p)[i] = (lf_real)(1.0 / (double)(p->dim[0] * p->dim[1] * p->dim[2]));
    }
    lf_tensor *x = lf_tensor_new(n->tape, 4, LF_DIMS(1, height, width, 3));
    for (long i = 0; i < x->size; i++)
        x->value[i] = i / 3 % width == c ? 1 : (lf_real)0.75;
    const lf_tensor *y = lf_feature_net_forward(n->tape, &n->features, x);
    return y->value + y->dim[1] / 2 * y->dim[2] * y->dim[3];
}

/* The mean image column that map column j depends on, weighted by how much it does. */
static double centre_of(net *n, long height, long width, long j)
{
    double sum = 0, first = 0;
    lf_tape_reset(n->tape);
    const lf_real *rest = middle_line(n, height, width, -1);
    for (long c = 0; c < width; c++) {
        const double d = (double)(middle_line(n, height, width, c)[j] - rest[j]);
        sum += d;
        first += d * (double)c;
    }
    return first / sum;
}

static void test_where_a_map_looks(void **state)
{
    (void)state;
    net n = open_net(small(2, 1));
    lf_tape_set_grad(n.tape, false);
    /* a third of the last filter looks at p, centred on column 2 j; the rest at q, a pixel before,
       or on average there where the width is 4 m + 1 */
    for (long j = 12; j <= 20; j += 4)
        assert_close(centre_of(&n, 16, 64, j), 2.0 * (double)j - 2.0 / 3, 0, 1e-3);
    assert_close(centre_of(&n, 17, 65, 16), 32, 0, 1e-3);
    close_net(&n);
}

/* ---- gradient and threads -------------------------------------------------------------------- */

/* Sum of fixed weights times the map. */
static double loss_of(net *n, long height, long width, bool backward)
{
    lf_tape_reset(n->tape);
    lf_tensor *y =
        lf_feature_net_forward(n->tape, &n->features, images_of(n->tape, 3, height, width));
    lf_stream s = lf_stream_at(4, LF_RANDOM_TEST, 1, 0);
    double loss = 0;
    for (long i = 0; i < y->size; i++) {
        const double w = lf_normal(&s);
        loss += w * (double)y->value[i];
        if (y->wants)
            lf_grad(n->tape, y)[i] = (lf_real)w;
    }
    if (backward)
        lf_backward_from(n->tape);
    return loss;
}

/* One number of every array, against central differences. */
static void check_gradient(lf_feature_config config, long height, long width)
{
    net n = open_net(config);
    fill(&n);
    lf_store_zero_grads(n.store);
    loss_of(&n, height, width, true);
    double worst = 0, size = 0;
    for (int k = 0; k < lf_store_count(n.store); k++) {
        const lf_parameter *p = lf_store_at(n.store, k);
        const double step = 1e-6;
        lf_real *at = lf_values(p) + p->size * 2 / 3;
        const lf_real before = *at;
        *at = before + (lf_real)step;
        const double up = loss_of(&n, height, width, false);
        *at = before - (lf_real)step;
        const double down = loss_of(&n, height, width, false);
        *at = before;
        const double slope = (double)lf_grads(p)[p->size * 2 / 3];
        worst = larger(worst, fabs((up - down) / (2 * step) - slope));
        size = fmax(size, fabs(slope));
    }
    assert_below(worst / size, 1e-6);
    close_net(&n);
}

static void test_gradient(void **state)
{
    (void)state;
    if (sizeof(lf_real) != 8)
        skip();
    check_gradient(small(4, 3), 14, 11);
    check_gradient(small(12, 12), 9, 16);
    check_gradient(resnet(4, 3, 1, 2, 1), 22, 19);
}

/* Loss and gradients on 1 thread and on `threads`: the same bits. */
static void compare_threads(lf_feature_config config, int threads)
{
    net one = open_net(config), more = open_net(config);
    const int before = omp_get_max_threads();
    omp_set_num_threads(1);
    const double a = loss_of(&one, 34, 33, true);
    omp_set_num_threads(threads);
    const double b = loss_of(&more, 34, 33, true);
    omp_set_num_threads(before);
    const size_t bytes = (size_t)lf_store_size(one.store) * sizeof(lf_real);
    assert_memory_equal(&a, &b, sizeof a);
    assert_memory_equal(lf_store_grads(one.store), lf_store_grads(more.store), bytes);
    close_net(&one);
    close_net(&more);
}

static void test_threads_change_no_bit(void **state)
{
    (void)state;
    for (int threads = 2; threads <= 3; threads++) {
        compare_threads(small(12, 12), threads);
        compare_threads(resnet(8, 6, 1, 2, 1), threads);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sizes),     cmocka_unit_test(test_parameters_and_cost),
        cmocka_unit_test(test_too_small), cmocka_unit_test(test_kept),
        cmocka_unit_test(test_reference), cmocka_unit_test(test_where_a_map_looks),
        cmocka_unit_test(test_gradient),  cmocka_unit_test(test_threads_change_no_bit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
