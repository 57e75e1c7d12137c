/* test_backbone.c: the whole image network: sizes, symmetry, gradient, threads. */
#include <omp.h>
#include "autograd/random.h"
#include "models/backbone.h"
#include "tests/close.h"

static const double ROUNDING = sizeof(lf_real) == 8 ? 1e-12 : 1e-5;

static lf_backbone_config tiny(bool c8)
{
    return (lf_backbone_config){.in_channels = 3,
                                .c8 = c8,
                                .plain_channels = 8,
                                .stem_fields = 4,
                                .stem_size = 7,
                                .stages = 3,
                                .blocks = {1, 1, 1},
                                .fields = {4, 8, 16},
                                .first_stride = 2,
                                .features = 8,
                                .momentum = 0.1,
                                .stem_map = true};
}

static lf_backbone_config pooled(void)
{
    return (lf_backbone_config){.in_channels = 3,
                                .c8 = true,
                                .stem_fields = 2,
                                .stem_size = 5,
                                .stem_pool = true,
                                .stages = 3,
                                .blocks = {2, 1, 1},
                                .fields = {4, 4, 8},
                                .first_stride = 1,
                                .bottleneck = true,
                                .cutoff = LF_C8_REDET,
                                .features = 5,
                                .instance_norm = true};
}

static lf_backbone_config antialiased(lf_backbone_config config)
{
    config.antialias = true;
    return config;
}

typedef struct net {
    lf_store *store;
    lf_tape *tape;
    lf_backbone backbone;
} net;

/* A backbone whose norms have scales and shifts of their own. */
static net open_net(lf_backbone_config config)
{
    net n = {lf_store_create(5), lf_tape_create(), {.block = NULL}};
    lf_backbone_init(n.store, "backbone", &config, &n.backbone);
    for (int i = 0; i < lf_store_count(n.store); i++) {
        const lf_parameter *p = lf_store_at(n.store, i);
        lf_stream s = lf_stream_at(9, LF_RANDOM_TEST, 3, (uint64_t)i);
        for (long j = 0; p->rank == 1 && j < p->size; j++)
            lf_values(p)[j] += (lf_real)(0.3 * lf_uniform(&s));
    }
    return n;
}

static void close_net(net *n)
{
    lf_backbone_free(&n->backbone);
    lf_tape_free(n->tape);
    lf_store_free(n->store);
}

static lf_tensor *random_images(lf_tape *tape, long count, long size)
{
    lf_tensor *x = lf_tensor_new(tape, 4, LF_DIMS(count, size, size, 3));
    lf_stream s = lf_stream_at(1, LF_RANDOM_TEST, 0, (uint64_t)size);
    for (long i = 0; i < x->size; i++)
        x->value[i] = (lf_real)lf_uniform(&s);
    return x;
}

/* The images turned by 90 degrees counter-clockwise; `group` 8 shifts the orientations too. */
static lf_tensor *turned(lf_tape *tape, const lf_tensor *x, long group)
{
    lf_tensor *y = lf_tensor_like(tape, x);
    const long size = x->dim[1], channels = x->dim[3], shift = group / 4;
    for (long n = 0; n < x->dim[0]; n++)
        for (long i = 0; i < size; i++)
            for (long j = 0; j < size; j++)
                for (long c = 0; c < channels; c++) {
                    const long from = c / group * group + (c % group + group - shift) % group;
                    y->value[((n * size + i) * size + j) * channels + c] =
                        x->value[((n * size + j) * size + size - 1 - i) * channels + from];
                }
    return y;
}

/* Largest relative difference, over all maps, between the maps of the turned images and the turned
 * maps, for three quarter turns in a row. */
static double turn_defect(net *n, long size, bool training)
{
    double worst = 0;
    lf_tape_reset(n->tape);
    lf_tensor *x = random_images(n->tape, 2, size), *want[2 * LF_BACKBONE_MAPS],
              *fields[LF_BACKBONE_MAPS];
    int maps = lf_backbone_forward(n->tape, &n->backbone, x, training, want);
    const int inner = lf_backbone_fields(n->tape, &n->backbone, x, training, fields);
    for (int m = 0; m < inner; m++)
        want[maps + m] = fields[m];
    for (int quarter = 0; quarter < 3; quarter++) {
        lf_tensor *got[LF_BACKBONE_MAPS];
        x = turned(n->tape, x, 1);
        lf_backbone_forward(n->tape, &n->backbone, x, training, got);
        lf_backbone_fields(n->tape, &n->backbone, x, training, fields);
        for (int m = 0; m < maps + inner; m++) {
            want[m] = turned(n->tape, want[m], m < maps ? 1 : LF_C8);
            const lf_tensor *g = m < maps ? got[m] : fields[m - maps];
            worst = larger(worst, relative_error(g->value, want[m]->value, g->size));
        }
    }
    return worst;
}

static void test_quarter_turns_are_exact_on_odd_sizes(void **state)
{
    (void)state;
    const long sizes[] = {33, 65};
    for (int i = 0; i < 8; i++) {
        const lf_backbone_config config = i / 2 % 2 ? pooled() : tiny(true);
        net n = open_net(i / 4 ? antialiased(config) : config);
        lf_tape_set_grad(n.tape, false);
        assert_below(turn_defect(&n, sizes[i % 2], true), ROUNDING);
        assert_below(turn_defect(&n, sizes[i % 2], false), ROUNDING);
        close_net(&n);
    }
}

/* One channel of an image of ten bars, 2 pixels wide, with sharp edges, turned about its middle. */
static void draw_bars(uint64_t trial, double turn, long size, lf_real *x)
{
    enum { BARS = 10, RAYS = 3 };
    lf_stream s = lf_stream_at(8, LF_RANDOM_TEST, 4, trial);
    for (int bar = 0; bar < BARS; bar++) {
        const double angle = 6.283185307179586 * lf_uniform(&s) + turn;
        const double c = cos(angle), q = sin(angle), away = 40 * lf_uniform(&s) - 20;
        for (long p = 0; p < size * size * RAYS * RAYS; p++) {
            const long line = size * RAYS, middle = line / 2,
                       at = p / line / RAYS * size + p % line / RAYS;
            const double u = (double)(p % line - middle) / RAYS,
                         v = (double)(middle - p / line) / RAYS;
            if (fabs(c * u + q * v - away) < 1 && fabs(c * v - q * u) < 8)
                x[3 * at] += (lf_real)1 / (RAYS * RAYS);
        }
    }
}

/* How far the scalars at the middle of each map are from those of the image turned by 45 degrees,
 * against how far they are from those of other images. */
static double eighth_turn_defect(lf_backbone_config config)
{
    enum { IMAGES = 12, SIZE = 65 };
    net n = open_net(config);
    lf_tape_set_grad(n.tape, false);
    lf_tensor *x = lf_tensor_new(n.tape, 4, LF_DIMS(2 * IMAGES, SIZE, SIZE, 3)),
              *maps[LF_BACKBONE_MAPS];
    memset(x->value, 0, (size_t)x->size * sizeof(lf_real));
    for (int i = 0; i < 2 * IMAGES; i++)
        draw_bars((uint64_t)(i % IMAGES), i / IMAGES * 0.7853981633974483, SIZE,
                  x->value + i * SIZE * SIZE * 3);
    const int count = lf_backbone_forward(n.tape, &n.backbone, x, true, maps);
    double difference = 0, spread = 0;
    for (int m = 0; m < count; m++) {
        const long *d = maps[m]->dim, image = d[1] * d[2] * d[3];
        const lf_real *middle = maps[m]->value + (d[1] / 2 * d[2] + d[2] / 2) * d[3];
        for (long k = 0; k < IMAGES * d[3]; k++) {
            const lf_real *a = middle + k / d[3] * image + k % d[3];
            const double turned = (double)(a[IMAGES * image] - a[0]);
            const double other =
                (double)(middle[(k / d[3] + 1) % IMAGES * image + k % d[3]] - a[0]);
            difference += turned * turned;
            spread += other * other;
        }
    }
    close_net(&n);
    return sqrt(difference / spread);
}

static void test_smoothing_keeps_more_of_eighth_turns(void **state)
{
    (void)state;
    const double aliased = eighth_turn_defect(tiny(true));
    const double smooth = eighth_turn_defect(antialiased(tiny(true)));
    const double plain = eighth_turn_defect(antialiased(tiny(false)));
    print_message("eighth turns: %.3f aliased, %.3f smoothed, %.3f ordinary filters\n", aliased,
                  smooth, plain);
    assert_true(smooth < 0.3 * aliased);
    assert_true(plain > 5 * smooth);
}

static void test_even_sizes_and_plain_filters_break_turns(void **state)
{
    (void)state;
    net n = open_net(tiny(true)), plain = open_net(tiny(false));
    assert_true(turn_defect(&n, 64, false) > 0.05);
    assert_true(turn_defect(&plain, 65, false) > 0.05);
    close_net(&n);
    close_net(&plain);
}

static void test_sizes_and_cost(void **state)
{
    (void)state;
    net n = open_net(tiny(true)), plain = open_net(tiny(false));
    const long sizes[] = {33, 17, 9, 5};
    lf_tensor *maps[LF_BACKBONE_MAPS];
    const lf_backbone_cost cost = lf_backbone_macs(&n.backbone, 65, 65);
    const lf_backbone_cost other = lf_backbone_macs(&plain.backbone, 65, 65);
    assert_int_equal(
        lf_backbone_forward(n.tape, &n.backbone, random_images(n.tape, 2, 65), true, maps), 4);
    assert_int_equal(cost.maps, 4);
    for (int m = 0; m < 4; m++) {
        assert_int_equal(maps[m]->dim[1], sizes[m]);
        assert_int_equal(maps[m]->dim[3], 8);
        assert_int_equal(cost.height[m], sizes[m]);
        assert_int_equal(cost.width[m], sizes[m]);
    }
    assert_int_equal(cost.parameters, lf_store_trainable(n.store));
    assert_int_equal(other.parameters, lf_store_trainable(plain.store));
    /* equal filters: only the heads differ, 8 times fewer products with C8 */
    const double heads = 8 * (33 * 33 * 4 + 17 * 17 * 4 + 9 * 9 * 8 + 5 * 5 * 16);
    assert_close(other.macs - cost.macs, 7 * heads, 0, 0);
    close_net(&n);
    close_net(&plain);
}

/* Sum of fixed weights times all maps. */
static double loss_of(net *n, long size, bool backward)
{
    lf_tape_reset(n->tape);
    lf_tensor *maps[LF_BACKBONE_MAPS];
    const int count =
        lf_backbone_forward(n->tape, &n->backbone, random_images(n->tape, 3, size), true, maps);
    lf_stream s = lf_stream_at(4, LF_RANDOM_TEST, 1, 0);
    double loss = 0;
    for (int m = 0; m < count; m++)
        for (long i = 0; i < maps[m]->size; i++) {
            const double w = lf_normal(&s);
            loss += w * (double)maps[m]->value[i];
            if (maps[m]->wants)
                lf_grad(n->tape, maps[m])[i] = (lf_real)w;
        }
    if (backward)
        lf_backward_from(n->tape);
    return loss;
}

/* Add step times a fixed random direction to one parameter; returns its product with the gradient.
 */
static double move(const lf_parameter *p, double step)
{
    lf_stream s = lf_stream_at(6, LF_RANDOM_TEST, 2, lf_name_hash(p->name));
    double product = 0;
    for (long i = 0; i < p->size; i++) {
        const double d = lf_normal(&s);
        lf_values(p)[i] += (lf_real)(step * d);
        product += d * (double)lf_grads(p)[i];
    }
    return product;
}

/* Every parameter's gradient along a random direction, against central differences. */
static void check_gradient(lf_backbone_config config)
{
    net n = open_net(config);
    double worst = 0, size = 0;
    const double step = 1e-7;
    lf_store_zero_grads(n.store);
    loss_of(&n, 17, true);
    for (int i = 0; i < lf_store_count(n.store); i++) {
        const lf_parameter *p = lf_store_at(n.store, i);
        if (!p->trainable)
            continue;
        const double slope = move(p, step);
        const double up = loss_of(&n, 17, false);
        move(p, -2 * step);
        const double down = loss_of(&n, 17, false);
        move(p, step);
        worst = larger(worst, fabs((up - down) / (2 * step) - slope));
        size = fmax(size, fabs(slope));
    }
    assert_below(worst / size, 1e-7);
    close_net(&n);
}

static void test_gradient_of_the_whole(void **state)
{
    (void)state;
    if (sizeof(lf_real) != 8)
        skip();
    check_gradient(tiny(true));
    check_gradient(tiny(false));
    check_gradient(pooled());
    check_gradient(antialiased(tiny(true)));
    check_gradient(antialiased(pooled()));
}

/* Loss, gradients and running statistics on 1 thread and on `threads`: the same bits. */
static void compare_threads(lf_backbone_config config, int threads)
{
    net one = open_net(config), more = open_net(config);
    const int before = omp_get_max_threads();
    omp_set_num_threads(1);
    const double a = loss_of(&one, 33, true);
    omp_set_num_threads(threads);
    const double b = loss_of(&more, 33, true);
    omp_set_num_threads(before);
    const size_t bytes = (size_t)lf_store_size(one.store) * sizeof(lf_real);
    assert_memory_equal(&a, &b, sizeof a);
    assert_memory_equal(lf_store_grads(one.store), lf_store_grads(more.store), bytes);
    assert_memory_equal(lf_store_values(one.store), lf_store_values(more.store), bytes);
    close_net(&one);
    close_net(&more);
}

static void test_threads_change_no_bit(void **state)
{
    (void)state;
    for (int threads = 2; threads <= 3; threads++) {
        compare_threads(tiny(true), threads);
        compare_threads(tiny(false), threads);
        compare_threads(pooled(), threads);
        compare_threads(antialiased(tiny(true)), threads);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_quarter_turns_are_exact_on_odd_sizes),
        cmocka_unit_test(test_smoothing_keeps_more_of_eighth_turns),
        cmocka_unit_test(test_even_sizes_and_plain_filters_break_turns),
        cmocka_unit_test(test_sizes_and_cost),
        cmocka_unit_test(test_gradient_of_the_whole),
        cmocka_unit_test(test_threads_change_no_bit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
