/* test_profile.c: what a profile puts down: names, calls, products by formula, bytes, teams; that
 * it changes no bit of a step of the reconstruction model. No test looks at how long something
 * took, but that no time is counted twice. [autograd/profile.h] */
#include <omp.h>
#include <time.h>

#include "autograd/ops.h"
#include "tests/recon_scene.h"

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static const lf_profile_row *find(const lf_profile_row *row, int count, const char *scope,
                                  const char *op)
{
    for (int i = 0; i < count; i++)
        if (strcmp(row[i].scope, scope) == 0 &&
            (op ? row[i].op && strcmp(row[i].op, op) == 0 : !row[i].op))
            return &row[i];
    fail_msg("no row of %s, %s", scope, op ? op : "no op");
    return NULL;
}

static lf_profile_row sum(const lf_profile_row *row, int count)
{
    lf_profile_row s = {.op = NULL};
    for (int i = 0; i < count; i++) {
        assert_true(row[i].forward >= 0 && row[i].backward >= 0);
        s.calls += row[i].calls;
        s.forward += row[i].forward;
        s.backward += row[i].backward;
        s.products[0] += row[i].products[0];
        s.products[1] += row[i].products[1];
        s.bytes += row[i].bytes;
    }
    return s;
}

/* ---- one tape ---- */

enum { ROWS = 6, IN = 4, OUT = 5 };

/* Two linear maps and a ReLU in three scopes, the bytes of which are all that the tape holds. */
static void small_work(lf_tape *tape, lf_real *x, lf_real *w, lf_real *dw)
{
    lf_tape_reset(tape);
    lf_scope(tape, "outer");
    lf_tensor *a = lf_leaf(tape, 2, LF_DIMS(ROWS, IN), x, NULL);
    lf_tensor *m = lf_leaf(tape, 2, LF_DIMS(IN, OUT), w, dw);
    lf_tensor *y = lf_linear(tape, a, m, NULL, LF_IDENTITY);
    for (int i = 0; i < 2; i++) {
        lf_scope(tape, "part%d", i);
        y = lf_relu(tape, y);
        y = lf_linear(tape, y, lf_leaf(tape, 2, LF_DIMS(OUT, OUT), w, dw), NULL, LF_IDENTITY);
        lf_scope_end(tape);
    }
    lf_tensor *loss = lf_sum(tape, y);
    lf_scope_end(tape);
    lf_backward(tape, loss, 1);
}

/* Three times small_work, by part and op. */
static lf_profile_row check_rows(const lf_profile *profile)
{
    lf_profile_row *row;
    int count = lf_profile_rows(profile, LF_BY_BOTH, &row);
    const lf_profile_row *linear = find(row, count, "outer", "linear");
    assert_int_equal(linear->calls, 3);
    assert_true(linear->products[0] == 3 * ROWS * IN * OUT && linear->unknown == 0);
    assert_true(linear->products[1] == linear->products[0]); /* x wants none */
    linear = find(row, count, "outer/part1", "linear");
    assert_true(linear->products[0] == 3 * ROWS * OUT * OUT);
    assert_true(linear->products[1] == 2 * linear->products[0]);
    const lf_profile_row *relu = find(row, count, "outer/part0", "relu");
    assert_true(relu->calls == 3 && relu->unknown == 3 && relu->products[0] == 0);
    const lf_profile_row all = sum(row, count);
    free(row);
    return all;
}

/* The same by part, and by op. */
static void check_groups(const lf_profile *profile, const lf_profile_row *all)
{
    lf_profile_row *row;
    int count = lf_profile_rows(profile, LF_BY_SCOPE, &row);
    assert_int_equal(count, 3);
    assert_string_equal(row[0].scope, "outer");
    assert_string_equal(row[1].scope, "outer/part0");
    assert_string_equal(row[2].scope, "outer/part1");
    assert_true(sum(row, count).products[0] == all->products[0]);
    assert_true(sum(row, count).bytes == all->bytes);
    free(row);
    count = lf_profile_rows(profile, LF_BY_OP, &row);
    assert_int_equal(find(row, count, "", "linear")->calls, 9);
    assert_int_equal(find(row, count, "", "sum")->calls, 3);
    assert_close(sum(row, count).forward, all->forward, 1e-12, 0);
    free(row);
}

static void test_one_tape(void **state)
{
    (void)state;
    lf_real x[ROWS * IN], w[OUT * OUT], dw[OUT * OUT] = {0}, without[OUT * OUT] = {0};
    lf_profile *profile = lf_profile_create();
    lf_tape *tape = lf_tape_create();
    for (int i = 0; i < OUT * OUT; i++)
        x[i % (ROWS * IN)] = w[i] = (lf_real)(0.1 * (i % 7));
    small_work(tape, x, w, without); /* unwatched */
    assert_false(lf_profiled(tape));
    const size_t held = lf_tape_bytes(tape);
    lf_profile_watch(profile, tape, 0);
    assert_true(lf_profiled(tape));
    const double start = now();
    for (int i = 0; i < 3; i++) {
        memset(dw, 0, sizeof dw);
        small_work(tape, x, w, dw);
    }
    const double wall = now() - start;
    assert_memory_equal(dw, without, sizeof dw);
    lf_profile_watch(NULL, tape, 0);
    small_work(tape, x, w, dw); /* no longer put down */

    const lf_profile_row all = check_rows(profile);
    assert_true(all.forward + all.backward <= wall);
    assert_true(all.bytes <= held && all.bytes > held / 2); /* the backward makes the rest */
    check_groups(profile, &all);
    lf_tape_free(tape);
    lf_profile_free(profile);
}

/* Two profiles of the same work are one of twice the work. */
static void test_join(void **state)
{
    (void)state;
    lf_real x[ROWS * IN] = {0}, w[OUT * OUT] = {0}, dw[OUT * OUT] = {0};
    lf_profile *profile[2];
    lf_tape *tape = lf_tape_create();
    for (int i = 0; i < 2; i++) {
        profile[i] = lf_profile_create();
        lf_profile_watch(profile[i], tape, 0);
        small_work(tape, x, w, dw);
    }
    lf_profile_watch(NULL, tape, 0);
    lf_profile_join(profile[0], profile[1]);
    lf_profile_row *row;
    assert_int_equal(lf_profile_rows(profile[1], LF_BY_SCOPE, &row), 0);
    free(row);
    const int count = lf_profile_rows(profile[0], LF_BY_BOTH, &row);
    assert_int_equal(find(row, count, "outer/part0", "linear")->calls, 2);
    free(row);
    lf_profile_join(profile[0], profile[1]); /* empty */
    lf_tape_free(tape);
    lf_profile_free(profile[0]);
    lf_profile_free(profile[1]);
}

/* Bytes are the most between two resets, and not counted where a backward takes them. */
static void test_bytes(void **state)
{
    (void)state;
    enum { MOST = 40 };
    lf_real x[MOST * IN] = {0}, dx[MOST * IN] = {0};
    lf_profile *profile = lf_profile_create();
    lf_tape *tape = lf_tape_create();
    lf_profile_watch(profile, tape, 0);
    size_t held = 0;
    for (int i = 0; i < 3; i++) {
        const long rows = i == 1 ? MOST : 7;
        lf_tape_reset(tape);
        lf_scope(tape, "s");
        lf_tensor *a = lf_leaf(tape, 2, LF_DIMS(rows, IN), x, dx);
        lf_tensor *loss = lf_sum(tape, lf_relu(tape, a));
        lf_scope_end(tape);
        held = i == 1 ? lf_tape_bytes(tape) : held;
        lf_backward(tape, loss, 1);
    }
    lf_profile_row *row;
    const int count = lf_profile_rows(profile, LF_BY_SCOPE, &row);
    assert_int_equal(count, 1);
    assert_int_equal(row->bytes, held);
    free(row);
    lf_tape_free(tape);
    lf_profile_free(profile);
}

/* Two tapes of a team of two: half of their time, the rest is waiting; nothing is counted twice. */
static void test_team(void **state)
{
    (void)state;
    lf_real x[ROWS * IN] = {0}, w[OUT * OUT] = {0}, dw[OUT * OUT] = {0};
    lf_profile *profile = lf_profile_create();
    lf_tape *tape[3];
    for (int i = 0; i < 3; i++) {
        tape[i] = lf_tape_create();
        lf_profile_watch(profile, tape[i], i ? 2 : 0);
    }
    const double start = now();
    small_work(tape[0], x, w, dw);
    lf_scope(tape[0], LF_SCOPE_TEAM);
    for (int i = 0; i < 10; i++)
        for (int k = 1; k < 3; k++)
            small_work(tape[k], x, w, dw);
    lf_scope_end(tape[0]);
    lf_scope(tape[0], "last");
    lf_scope_end(tape[0]);
    const double wall = now() - start;
    lf_profile_row *row;
    int count = lf_profile_rows(profile, LF_BY_SCOPE, &row);
    assert_int_equal(find(row, count, "outer", NULL)->calls, 2 * 21);
    assert_true(find(row, count, LF_SCOPE_TEAM, NULL)->forward >= 0);
    const lf_profile_row all = sum(row, count);
    assert_true(all.forward + all.backward <= wall);
    assert_string_equal(row[count - 1].scope, "last");
    free(row);
    count = lf_profile_rows(profile, LF_BY_OP, &row);
    assert_true(find(row, count, LF_SCOPE_TEAM, NULL)->calls == 0);
    free(row);
    for (int i = 0; i < 3; i++)
        lf_tape_free(tape[i]);
    lf_profile_free(profile);
}

/* ---- a step of the reconstruction models ---- */

enum { TILE = 16 };

/* Loss; gradients stay in the store. */
static double watched_step(const net *n, const sight *t, const scene *s, lf_profile *profile)
{
    lf_recon_work *work = lf_recon_work_create(&n->model, TILE);
    lf_recon_work_watch(work, profile);
    const double loss = lf_recon_step(work, &t->images, &t->points, s->sdf, &loss_config);
    lf_recon_work_free(work);
    return loss;
}

static void check_images(const net *n, const lf_profile_row *row, int count)
{
    const lf_recon_config *c = &n->model.config;
    const lf_unit *stem = &n->model.backbone.stem;
    const double images = V * lf_backbone_macs(&n->model.backbone, SIZE, SIZE).macs;
    const double edge = (SIZE + 1) / 2, size = (double)stem->steerable.basis.size;
    const double first = V * edge * edge * size * size * CHANNELS * 8 * c->backbone.stem_fields;
    const lf_profile_row *heads = find(row, count, "", "conv2d");
    const lf_profile_row *conv = find(row, count, "", "c8_conv2d");
    assert_true(conv->products[0] + heads->products[0] == images);
    assert_true(conv->products[1] + heads->products[1] ==
                2 * images - first); /* images want no gradient */
    const double sampled = 4.0 * Q * V * (double)n->model.feature_count;
    const lf_profile_row *samples = find(row, count, "", "sample_maps");
    assert_true(samples->products[0] == sampled);
    assert_true(samples->products[1] == sampled - 4.0 * Q * V * (c->sample_image ? CHANNELS : 0));
}

/* The paper's network: all products of a point but those of sampling. */
static void check_points(const net *n, const lf_profile_row *row, int count)
{
    const lf_recon_cost cost = lf_recon_costs(&n->model, V);
    const double sampled = 4.0 * V * (double)n->model.feature_count;
    const lf_profile_row *linear = find(row, count, "", "linear");
    const lf_profile_row *attention = find(row, count, "", "ray_attention");
    assert_true(linear->products[0] + attention->products[0] == Q * (cost.point - sampled));
    assert_true(linear->products[1] == 2 * linear->products[0]);
    assert_true(attention->products[1] == 2 * attention->products[0]);
    assert_int_equal(attention->calls, n->model.config.blocks * ((Q + TILE - 1) / TILE));
    assert_true(find(row, count, "", "ray_moments")->products[0] == Q * sampled);
}

static void check_network(const net *n, const lf_profile *profile)
{
    static const char *const scopes[] = {
        "backbone/stem", "backbone/stage2",  "backbone/heads", "samples", "ray convolution",
        "block0/rays",   "block0/attention", "head",           "loss",    LF_SCOPE_TEAM};
    lf_profile_row *row;
    int count = lf_profile_rows(profile, LF_BY_OP, &row);
    check_images(n, row, count);
    check_points(n, row, count);
    free(row);
    count = lf_profile_rows(profile, LF_BY_SCOPE, &row);
    for (size_t i = 0; i < sizeof scopes / sizeof *scopes; i++)
        find(row, count, scopes[i], NULL);
    free(row);
}

/* Of any network: the same bits, the same products, with any number of threads; no op outside its
 * parts. */
static void check_steps(const char *more, bool papers)
{
    net n;
    sight t;
    open_net(&n, more);
    scene *s = make_scene();
    open_sight(&t, &n.model, s);
    const int most = omp_get_max_threads();
    const size_t size = (size_t)lf_store_size(n.store) * sizeof(lf_real);
    lf_real *gradient = malloc(size);
    assert_non_null(gradient);
    const double loss = watched_step(&n, &t, s, NULL);
    memcpy(gradient, lf_store_grads(n.store), size);
    double products = 0;
    for (int threads = 1; threads <= 3; threads += 2) {
        lf_profile *profile = lf_profile_create();
        omp_set_num_threads(threads);
        assert_true(watched_step(&n, &t, s, profile) == loss);
        assert_memory_equal(gradient, lf_store_grads(n.store), size);
        lf_profile_row *row;
        const int count = lf_profile_rows(profile, LF_BY_SCOPE, &row);
        for (int i = 0; i < count; i++)
            assert_true(row[i].scope[0]);
        const lf_profile_row all = sum(row, count);
        assert_true(threads == 1 || all.products[0] == products);
        products = all.products[0];
        free(row);
        if (papers)
            check_network(&n, profile);
        lf_profile_free(profile);
    }
    omp_set_num_threads(most);
    free(gradient);
    close_sight(&t);
    free(s);
    close_net(&n);
}

static void test_reconstruction(void **state)
{
    (void)state;
    check_steps(NULL, true);
    check_steps("model.degree2=true;model.nonlinearity=gated", false);
    check_steps("model.fusion=max-pool", false);
    check_steps("model.type=disn", false);
    check_steps("model.type=fvor", false);
    check_steps("model.type=ibrnet-sdf", false);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_one_tape),       cmocka_unit_test(test_join),
        cmocka_unit_test(test_bytes),          cmocka_unit_test(test_team),
        cmocka_unit_test(test_reconstruction),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
