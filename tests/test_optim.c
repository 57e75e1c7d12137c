/* test_optim.c: Adam and AdamW against a plain loop in double, gradient norm, clipping, schedules.
 */
#include "autograd/optim.h"
#include "autograd/random.h"
#include "tests/close.h"
#include "train/schedule.h"

enum { N = 37, STEPS = 20 };
#define EXACT (sizeof(lf_real) == 8)

typedef struct reference {
    double x[N], m[N], v[N];
} reference;

static void reference_step(reference *r, const lf_adam_config *c, const lf_real *grad, double lr,
                           int t)
{
    for (int i = 0; i < N; i++) {
        double g = (double)grad[i], x = r->x[i];
        if (!c->decoupled)
            g += c->weight_decay * x;
        r->m[i] = c->beta1 * r->m[i] + (1 - c->beta1) * g;
        r->v[i] = c->beta2 * r->v[i] + (1 - c->beta2) * g * g;
        const double m = r->m[i] / (1 - pow(c->beta1, t)), v = r->v[i] / (1 - pow(c->beta2, t));
        x -= lr * m / (sqrt(v) + c->eps);
        if (c->decoupled)
            x -= lr * c->weight_decay * r->x[i];
        r->x[i] = x;
    }
}

/* Largest difference after STEPS steps of noisy gradients with sizes from 1e-6 to 10. */
static double adam_error(const lf_adam_config *config)
{
    lf_store *store = lf_store_create(1);
    const lf_parameter *still = lf_store_add(store, "mean", 1, LF_DIMS(5), 3, 0, false);
    const lf_parameter *p = lf_store_add(store, "weight", 1, LF_DIMS(N), 0, 1, true);
    reference r = {{0}, {0}, {0}};
    for (int i = 0; i < N; i++)
        r.x[i] = (double)lf_values(p)[i];
    lf_adam adam;
    lf_adam_init(&adam, config, store);
    for (int t = 1; t <= STEPS; t++) {
        lf_stream s = lf_stream_at(4, LF_RANDOM_TEST, (uint64_t)t, 0);
        for (int i = 0; i < N; i++)
            lf_grads(p)[i] = (lf_real)(pow(10, i % 8 - 6) * (lf_normal(&s) + 0.5));
        for (int i = 0; i < 5; i++)
            lf_grads(still)[i] = 1;
        const double lr = 0.01 / t;
        lf_adam_step(&adam, store, lr);
        reference_step(&r, config, lf_grads(p), lr, t);
    }
    assert_int_equal(adam.steps, STEPS);
    for (int i = 0; i < 5; i++) {
        assert_true(lf_values(still)[i] == 3);
        assert_true(adam.m[still->offset + i] == 0 && adam.v[still->offset + i] == 0);
    }
    double worst = relative_error(lf_values(p), r.x, N);
    worst = larger(worst, relative_error(adam.m + p->offset, r.m, N));
    worst = larger(worst, relative_error(adam.v + p->offset, r.v, N));
    lf_adam_free(&adam);
    lf_store_free(store);
    return worst;
}

static void adam_is_the_formula(void **state)
{
    (void)state;
    static const lf_adam_config configs[] = {{0.9, 0.999, 1e-8, 0, false},
                                             {0.9, 0.999, 1e-8, 0.1, false},
                                             {0.9, 0.999, 1e-8, 0.1, true},
                                             {0.5, 0.9, 1e-3, 1, true},
                                             {0, 0, 1e-8, 0, false}};
    for (size_t i = 0; i < sizeof configs / sizeof *configs; i++)
        assert_below(adam_error(&configs[i]), EXACT ? 1e-14 : 2e-6);
}

/* The two decays are different things. */
static void decay_is_coupled_or_not(void **state)
{
    (void)state;
    for (int decoupled = 0; decoupled < 2; decoupled++) {
        const lf_adam_config config = {0.9, 0.999, 1e-8, 0.1, decoupled};
        lf_store *store = lf_store_create(1);
        const lf_parameter *p = lf_store_add(store, "weight", 1, LF_DIMS(1), 2, 0, true);
        lf_adam adam;
        lf_adam_init(&adam, &config, store);
        lf_adam_step(&adam, store, 0.01); /* gradient 0: only the decay acts */
        assert_close(lf_values(p)[0], decoupled ? 2 - 0.01 * 0.1 * 2 : 2 - 0.01, 1e-6, 0);
        lf_adam_free(&adam);
        lf_store_free(store);
    }
}

static void norm_and_scale(void **state)
{
    (void)state;
    lf_store *store = lf_store_create(1);
    const lf_parameter *a = lf_store_add(store, "a", 1, LF_DIMS(3), 0, 1, true);
    const lf_parameter *still = lf_store_add(store, "b", 1, LF_DIMS(2), 0, 1, false);
    const lf_parameter *c = lf_store_add(store, "c", 2, LF_DIMS(1, 2), 0, 1, true);
    lf_store_zero_grads(store);
    assert_true(lf_gradient_norm(store) == 0);
    lf_grads(a)[1] = 3;
    lf_grads(c)[1] = -4;
    lf_grads(still)[0] = 100; /* no part of the norm */
    assert_close(lf_gradient_norm(store), 5, 1e-15, 0);
    lf_gradient_scale(store, 0.5);
    assert_true(lf_grads(a)[1] == (lf_real)1.5 && lf_grads(c)[1] == -2 && lf_grads(a)[0] == 0);
    assert_close(lf_gradient_norm(store), 2.5, 1e-15, 0);
    lf_grads(a)[0] = (lf_real)1e30; /* its square is no float */
    assert_close(lf_gradient_norm(store), 1e30, 1e-6, 0);
    lf_grads(a)[0] = NAN;
    assert_true(!isfinite(lf_gradient_norm(store)));
    lf_grads(a)[0] = INFINITY;
    assert_true(!isfinite(lf_gradient_norm(store)));
    lf_store_free(store);
}

static lf_config *schedule(const char *kind, const char *steps, const char *warmup)
{
    char text[3][64];
    snprintf(text[0], 64, "train.schedule=%s", kind);
    snprintf(text[1], 64, "train.steps=%s", steps);
    snprintf(text[2], 64, "train.warmup=%s", warmup);
    static const char *const more[] = {"train.lr=0.02", "train.final_lr=0.1",
                                       "train.decay_every=10", "train.decay_factor=0.5"};
    lf_config *cfg;
    lf_error err;
    assert_int_equal(lf_config_load(NULL, &cfg, &err), LF_OK);
    for (int i = 0; i < 3; i++)
        assert_int_equal(lf_config_set(cfg, text[i], &err), LF_OK);
    for (int i = 0; i < 4; i++)
        assert_int_equal(lf_config_set(cfg, more[i], &err), LF_OK);
    return cfg;
}

static void warm_up_rises_in_a_line(void **state)
{
    (void)state;
    static const char *const kinds[] = {"constant", "cosine", "step"};
    for (int k = 0; k < 3; k++) {
        lf_config *cfg = schedule(kinds[k], "100", "4");
        for (int s = 0; s < 4; s++)
            assert_close(lf_learning_rate(cfg, s), 0.02 * (s + 1) / 4, 1e-14, 0);
        assert_close(lf_learning_rate(cfg, 4), 0.02, 1e-14, 0); /* the whole rate at once */
        lf_config_free(cfg);
    }
}

static void constant_stays(void **state)
{
    (void)state;
    lf_config *cfg = schedule("constant", "100", "0");
    for (int s = 0; s < 100; s += 9)
        assert_true(lf_learning_rate(cfg, s) == 0.02);
    lf_config_free(cfg);
}

static void cosine_ends_at_the_final_rate(void **state)
{
    (void)state;
    lf_config *cfg = schedule("cosine", "101", "0");
    assert_close(lf_learning_rate(cfg, 0), 0.02, 1e-14, 0);
    assert_close(lf_learning_rate(cfg, 50), 0.02 * 0.55, 1e-12, 0);
    assert_close(lf_learning_rate(cfg, 100), 0.002, 1e-12, 0);
    for (int s = 1; s <= 100; s++)
        assert_true(lf_learning_rate(cfg, s) < lf_learning_rate(cfg, s - 1));
    assert_close(lf_learning_rate(cfg, 1000), 0.002, 1e-12, 0); /* past the end */
    lf_config_free(cfg);
}

static void steps_halve(void **state)
{
    (void)state;
    lf_config *cfg = schedule("step", "100", "0");
    for (int s = 0; s < 100; s++)
        assert_close(lf_learning_rate(cfg, s), 0.02 * pow(0.5, s / 10), 1e-14, 0);
    lf_config_free(cfg);
}

/* No step, one step, all steps warm-up: never a division by 0. */
static void short_runs(void **state)
{
    (void)state;
    static const char *const kinds[] = {"constant", "cosine", "step"};
    static const char *const runs[][2] = {{"0", "0"}, {"1", "0"}, {"1", "1"}, {"5", "100"}};
    for (int k = 0; k < 3; k++)
        for (int r = 0; r < 4; r++) {
            lf_config *cfg = schedule(kinds[k], runs[r][0], runs[r][1]);
            for (int s = 0; s < 6; s++) {
                const double lr = lf_learning_rate(cfg, s);
                assert_true(lr > 0 && lr <= 0.02);
            }
            lf_config_free(cfg);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(adam_is_the_formula), cmocka_unit_test(decay_is_coupled_or_not),
        cmocka_unit_test(norm_and_scale),      cmocka_unit_test(warm_up_rises_in_a_line),
        cmocka_unit_test(constant_stays),      cmocka_unit_test(cosine_ends_at_the_final_rate),
        cmocka_unit_test(steps_halve),         cmocka_unit_test(short_runs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
