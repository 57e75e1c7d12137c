/* test_ibrnet.c: IBRNet's numbers against its published definition, and what must not matter to
 * them: the order of the views, what a view that does not see a point holds.      [method.md 5c]
 */
#include "autograd/random.h"
#include "models/ibrnet.h"
#include "tests/close.h"

#define EXACT (sizeof(lf_real) == 8) /* the double build */
enum { MOST = 4096 };

typedef struct samples {
    long n, s, v, f;
    lf_real seen[MOST], difference[MOST], mask[MOST], count[MOST];
} samples;

typedef struct result {
    lf_real colour[MOST], sigma[MOST], gradient[MOST]; /* of the sum of squares of both in seen */
    lf_real grads[1 << 15];                            /* in all parameters */
    long size;
} result;

static void count_views(samples *x)
{
    for (long i = 0; i < x->n * x->s; i++) {
        x->count[i] = 0;
        for (long v = 0; v < x->v; v++)
            x->count[i] += x->mask[i * x->v + v];
    }
}

/* Random features, differences and masks. */
static void random_samples(samples *x, long n, long s, long v, long f)
{
    *x = (samples){.n = n, .s = s, .v = v, .f = f};
    lf_stream r = lf_stream_at(4, LF_RANDOM_TEST, 40, (uint64_t)v);
    for (long i = 0; i < n * s * v; i++)
        x->mask[i] = lf_uniform(&r) < 0.7;
    for (long i = 0; i < n * s * v * f; i++)
        x->seen[i] = (lf_real)lf_uniform(&r) * x->mask[i / f];
    for (long i = 0; i < n * s * v * 4; i++)
        x->difference[i] = (lf_real)(2 * lf_uniform(&r) - 1);
    count_views(x);
}

static lf_tensor *leaf(lf_tape *tape, const lf_real *x, const samples *of, long cols, lf_real *grad)
{
    /* leaves without a gradient are only read */
    return lf_leaf(tape, 4, LF_DIMS(of->n, of->s, of->v, cols), (lf_real *)(uintptr_t)x, grad);
}

static void run(const lf_ibrnet *net, lf_store *store, const samples *x, result *y)
{
    lf_tape *tape = lf_tape_create();
    lf_tape_set_check(tape, true);
    memset(y, 0, sizeof *y);
    const lf_tensor *mask =
        lf_reshape(tape, leaf(tape, x->mask, x, 1, NULL), 3, LF_DIMS(x->n, x->s, x->v));
    const lf_tensor *count =
        lf_leaf(tape, 2, LF_DIMS(x->n, x->s), (lf_real *)(uintptr_t)x->count, NULL);
    const lf_light_geometry geometry = {
        .rays = x->n, .samples = x->s, .views = x->v, .mask = mask, .count = count};
    const lf_ray_inputs in = {leaf(tape, x->seen, x, x->f, y->gradient), &geometry,
                              leaf(tape, x->difference, x, 4, NULL)};
    lf_store_zero_grads(store);
    const lf_radiance out = lf_ibrnet_apply(tape, net, &in);
    memcpy(y->colour, out.colour->value, (size_t)out.colour->size * sizeof(lf_real));
    memcpy(y->sigma, out.sigma->value, (size_t)out.sigma->size * sizeof(lf_real));
    lf_tensor *loss = lf_add(tape, lf_sum(tape, lf_multiply(tape, out.colour, out.colour)),
                             lf_sum(tape, lf_multiply(tape, out.sigma, out.sigma)));
    lf_backward(tape, loss, 1);
    y->size = lf_store_size(store);
    assert_true(y->size <= 1 << 15);
    memcpy(y->grads, lf_store_grads(store), (size_t)y->size * sizeof(lf_real));
    assert_null(lf_tape_nonfinite(tape));
    lf_tape_free(tape);
}

/* ---- the published numbers ---- */

/* Number i of parameter p, in the store's order and layout, is sin(0.1 + 0.7 i + p) / sqrt(inputs);
 * 1 input for parameters of a layer norm and the sharpness. */
static void fill_by_formula(lf_store *store)
{
    double inputs = 1;
    for (int p = 0; p < lf_store_count(store); p++) {
        const lf_parameter *q = lf_store_at(store, p);
        const bool map = q->rank == 2 || strstr(q->name, ".bias");
        inputs = q->rank == 2 ? (double)q->dim[0] : map && strcmp(q->name, "net.bias") ? inputs : 1;
        for (long i = 0; i < q->size; i++)
            lf_values(q)[i] = (lf_real)(sin(0.1 + 0.7 * (double)i + p) / sqrt(inputs));
    }
}

/* Two rays of five samples, three views, six numbers: the third sample of the first ray is seen by
 * none, the fourth of the second by one. */
static void formula_samples(samples *x)
{
    *x = (samples){.n = 2, .s = 5, .v = 3, .f = 6};
    for (long i = 0; i < 30; i++)
        x->mask[i] = i % 4 != 1;
    for (int v = 0; v < 3; v++) {
        x->mask[6 + v] = 0;
        x->mask[24 + v] = v == 1;
    }
    for (long i = 0; i < 180; i++)
        x->seen[i] = (lf_real)(0.5 + 0.5 * sin(1.3 * (double)i)) * x->mask[i / 6];
    for (long i = 0; i < 120; i++)
        x->difference[i] = (lf_real)cos(0.9 * (double)i);
    count_views(x);
}

/* Made once with a PyTorch version of the published code, in double, with the same formulas, and
 * once more with the second visibility's bias lower by 2, where a view can be weighted out. Its
 * density ends in ReLU; with softplus there the colours are the same. */
static const double published_colour[2][10][3] = {
    {{0.530810287563, 0.44059945242, 0.437410558642},
     {0.18054526064, 0.583806106345, 0.864290809918},
     {0, 0, 0},
     {0.436259416805, 0.138328560486, 0.37024721036},
     {0.463463679055, 0.572140682916, 0.575131417297},
     {0.147432870372, 0.201626816191, 0.692938175305},
     {0.361296794522, 0.438410593302, 0.605753017183},
     {0.817657472228, 0.340425034138, 0.0969702948806},
     {0.609727333997, 0.999386551542, 0.65744330114},
     {0.3730323115, 0.0680784017385, 0.395890645315}},
    {{0.530833429552, 0.440192965692, 0.437169947206},
     {0.181452011726, 0.585335500667, 0.864202281211},
     {0, 0, 0},
     {0.434153034007, 0.138215966756, 0.372293355777},
     {0.463759426313, 0.571882673852, 0.574697635795},
     {0.147555783296, 0.199353843457, 0.691599227293},
     {0.360992944095, 0.440473714073, 0.607160632389},
     {0.819722491612, 0.341888019726, 0.0956879693584},
     {0.609727333997, 0.999386551542, 0.65744330114},
     {0.374782894687, 0.0665403794959, 0.393317223831}}};
static const double published_sigma[2][2][10] = {
    {{0.00623136722812, 0.23446308651, 0, 0.519928166883, 0.138682993382, 0.00602011401277,
      0.230642604453, 0.532663967983, 0.521244606838, 0.144420037457},
     {0.696267717908, 0.817234658918, 0, 0.986528044789, 0.764890874699, 0.696161767781,
      0.815103297596, 0.994534003816, 0.987353827653, 0.767962080104}},
    {{0.00623037955507, 0.234463578585, 0, 0.51992806925, 0.138682226397, 0.00601846247439,
      0.230643436424, 0.532664167453, 0.521244582264, 0.144418728793},
     {0.696267222533, 0.817234933667, 0, 0.98652798356, 0.764890464657, 0.696160939527,
      0.815103761342, 0.994534129502, 0.987353812235, 0.767961378605}}};
/* gradients of the sum of all squares, with softplus: all of `seen`, sharpness, base, query */
static const double published_gradient[2][3] = {
    {24.8440258366, 0.000559769055134, 0.0640097354409},
    {24.8453742812, 0.000556133487081, 0.0641953936318}};

static void published_numbers(void **state)
{
    (void)state;
    static samples x;
    static result y;
    formula_samples(&x);
    for (int k = 0; k < 4; k++) {
        const int softplus = k & 1, low = k >> 1;
        lf_store *store = lf_store_create(1);
        lf_ibrnet net;
        lf_ibrnet_init(store, &net, "net", &(lf_ibrnet_config){6, 16, softplus == 1});
        fill_by_formula(store);
        lf_values(net.views.again[1].bias)[0] -= (lf_real)(2 * low);
        run(&net, store, &x, &y);
        const double most = EXACT ? 1e-11 : 2e-5;
        for (int i = 0; i < 30; i++)
            assert_close(y.colour[i], published_colour[low][i / 3][i % 3], 0, most);
        for (int i = 0; i < 10; i++)
            assert_close(y.sigma[i], published_sigma[low][softplus][i], 0, most);
        if (softplus) {
            const double *gradient = published_gradient[low];
            double size = 0;
            for (int i = 0; i < 180; i++)
                size += fabs((double)y.gradient[i]);
            assert_close(size, gradient[0], 1e-4, 0);
            assert_close(lf_grads(net.sharpness)[0], gradient[1], 1e-3, 0);
            assert_close(lf_grads(net.views.base[0].weight)[0], gradient[2], 1e-4, 0);
            if (!low)
                assert_close(lf_grads(net.query.weight)[0], 0.0335314770999, 1e-3, 0);
        }
        lf_store_free(store);
    }
}

/* ---- laws ---- */

static lf_store *open_network(lf_ibrnet *net, long f, bool softplus)
{
    lf_store *store = lf_store_create(3);
    lf_ibrnet_init(store, net, "net", &(lf_ibrnet_config){f, 16, softplus});
    lf_values(net->sharpness)[0] = 2; /* so that the weights by direction differ */
    return store;
}

static void views_have_no_order(void **state)
{
    (void)state;
    enum { N = 3, S = 7, V = 5, F = 8 };
    static const int order[V] = {3, 0, 4, 2, 1};
    static samples x, turned;
    static result a, b;
    lf_ibrnet net;
    lf_store *store = open_network(&net, F, true);
    random_samples(&x, N, S, V, F);
    turned = x;
    for (long i = 0; i < N * S; i++)
        for (int v = 0; v < V; v++) {
            const long to = i * V + v, from = i * V + order[v];
            turned.mask[to] = x.mask[from];
            memcpy(turned.seen + to * F, x.seen + from * F, F * sizeof(lf_real));
            memcpy(turned.difference + to * 4, x.difference + from * 4, 4 * sizeof(lf_real));
        }
    run(&net, store, &x, &a);
    run(&net, store, &turned, &b);
    const double most = EXACT ? 1e-12 : 1e-5;
    assert_below(relative_error(b.colour, a.colour, N * S * 3), most);
    assert_below(relative_error(b.sigma, a.sigma, N * S), most);
    assert_below(relative_error(b.grads, a.grads, a.size), 10 * most);
    lf_store_free(store);
}

/* Features where a view does not see the point are no input. */
static void unseen_is_unread(void **state)
{
    (void)state;
    enum { N = 2, S = 20, V = 3, F = 5 };
    static samples x;
    static result a, b;
    lf_ibrnet net;
    lf_store *store = open_network(&net, F, false);
    random_samples(&x, N, S, V, F);
    for (int i = 0; i < 2 * V; i++) /* two samples that no view sees */
        x.mask[i] = 0;
    count_views(&x);
    run(&net, store, &x, &a);
    for (long i = 0; i < N * S * V * F; i++)
        x.seen[i] = x.mask[i / F] > 0 ? x.seen[i] : 7;
    run(&net, store, &x, &b);
    assert_memory_equal(a.colour, b.colour, sizeof a.colour);
    assert_memory_equal(a.sigma, b.sigma, sizeof a.sigma);
    for (long i = 0; i < N * S * V * F; i++)
        assert_true(x.mask[i / F] > 0 || b.gradient[i] == 0);
    for (int i = 0; i < 6; i++)
        assert_true(a.colour[i] == 0 && a.sigma[i / 3] == 0);
    lf_store_free(store);
}

/* One view shows its own colour. No view at all: black and empty. */
static void one_view_and_none(void **state)
{
    (void)state;
    enum { N = 1, S = 19, F = 4 };
    static samples x;
    static result y;
    lf_ibrnet net;
    lf_store *store = open_network(&net, F, true);
    random_samples(&x, N, S, 1, F);
    run(&net, store, &x, &y);
    for (long i = 0; i < N * S; i++)
        for (int c = 0; c < 3; c++)
            assert_close(y.colour[3 * i + c], x.seen[i * F + c], 1e-6, 0);
    for (long i = 0; i < N * S; i++)
        assert_true((y.sigma[i] > 0) == (x.mask[i] > 0));
    memset(x.mask, 0, sizeof x.mask);
    count_views(&x);
    run(&net, store, &x, &y);
    for (long i = 0; i < N * S; i++)
        assert_true(y.sigma[i] == 0 && y.colour[3 * i] == 0);
    lf_store_free(store);
}

/* Rays do not hear each other, wherever the blocks of lanes cut them. */
static void rays_are_apart(void **state)
{
    (void)state;
    enum { N = 3, S = 11, V = 3, F = 6 };
    static samples x, one;
    static result all, alone;
    lf_ibrnet net;
    lf_store *store = open_network(&net, F, true);
    random_samples(&x, N, S, V, F);
    run(&net, store, &x, &all);
    one = (samples){.n = 1, .s = S, .v = V, .f = F};
    memcpy(one.seen, x.seen + S * V * F, S * V * F * sizeof(lf_real));
    memcpy(one.difference, x.difference + S * V * 4, S * V * 4 * sizeof(lf_real));
    memcpy(one.mask, x.mask + S * V, S * V * sizeof(lf_real));
    count_views(&one);
    run(&net, store, &one, &alone);
    const double most = EXACT ? 1e-12 : 1e-5;
    assert_below(relative_error(all.colour + 3 * S, alone.colour, 3 * S), most);
    assert_below(relative_error(all.sigma + S, alone.sigma, S), most);
    lf_store_free(store);
}

static void cost_is_counted(void **state)
{
    (void)state;
    lf_ibrnet net;
    lf_store *store = open_network(&net, 35, true);
    /* per view 4 16 + 16 35 + 35 64 + 64 32 + 32 32 + 32 33 + 32 32 + 32 + 37 16 + 16 8 + 8 and
     * 4 (35 + 32) + 3; per point 70 64 + 65 64 + 64 16 + 4 16 16 + 2 32 16 + 16 16 + 16 */
    assert_true(lf_ibrnet_macs(&net, 32, 8) == 8 * (8776.0 + 271) + 11984);
    lf_store_free(store);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(published_numbers), cmocka_unit_test(views_have_no_order),
        cmocka_unit_test(unseen_is_unread),  cmocka_unit_test(one_view_and_none),
        cmocka_unit_test(rays_are_apart),    cmocka_unit_test(cost_is_counted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
