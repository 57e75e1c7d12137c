/* test_renderer.c: the renderers as a whole on a made-up scene: gradients, threads and tiles,
 * motions of all poses, the order of the sources, savings, pictures of two sizes.
 *                                                                        [method.md 5b, 6, 10] */
#include <omp.h>

#include "tests/render_fixture.h"

enum { FINE = 6 };

/* Behind the whole networks: no attention along the ray, scalars alone, more scalars than pairs. */
static const net_options kinds[] = {
    {.ibrnet = false},
    {.ibrnet = true},
    {.fine = FINE},
    {.ibrnet = true, .fine = FINE},
    {.alone = true},
    {.types = {.count = 1, .omega = {0}}},
    {.types = {.count = 3, .omega = {0, 2, 5}, .more = 2}},
};
enum { KINDS = sizeof kinds / sizeof *kinds };

/* Source 1 with a smaller picture of its own lens. */
static void make_two_sizes(stage *s)
{
    lf_camera c = s->camera[1];
    c.width = 17;
    c.height = 13;
    c.cx = 7.5;
    c.cy = 6.2;
    c.fx *= 0.7;
    c.fy *= 0.72;
    place_source(s, 1, c);
}

/* ---- gradients ---- */

static double loss_of(const net *n, const stage *s)
{
    const lf_render_batch b = batch_of(s);
    return lf_render_step(n->work, &b, NULL);
}

/* Places of fine samples follow the coarse weights, and what a place does to the loss is left out
 * of the gradient (the weights are constants there, as in IBRNet). So the loss of two networks is a
 * smooth function, with the gradient for its derivative, of what only the fine one reads. */
static bool checked(const lf_parameter *p, long k, bool fine)
{
    if (!fine || strncmp(p->name, "fine.", 5) == 0)
        return true;
    return strncmp(p->name, "features.out.", 13) == 0 && k % p->dim[p->rank - 1] >= 3;
}

/* (loss(x + h) - loss(x - h)) / 2h */
static double slope_of(const net *n, const stage *s, lf_real *x, double h)
{
    const lf_real before = *x;
    *x = before + (lf_real)h;
    const double up = loss_of(n, s);
    *x = before - (lf_real)h;
    const double down = loss_of(n, s);
    *x = before;
    return (up - down) / (2 * h);
}

/* Some numbers of one array; `all` is the largest gradient of any array. The profiles' ReLU bends
 * at places that a step may cross: then a shorter step decides. */
static void check_array(const net *n, const stage *s, const gradient *g, const lf_parameter *p,
                        double all)
{
    lf_stream r = lf_stream_at(2, LF_RANDOM_TEST, 7, lf_name_hash(p->name));
    double largest = 0;
    for (long k = 0; k < p->size; k++)
        largest = fmax(largest, fabs((double)g->value[p->offset + k]));
    for (int trial = 0; trial < 2; trial++) {
        const long k = lf_index(&r, p->size);
        if (!checked(p, k, n->model.networks > 1))
            continue;
        const double expected = (double)g->value[p->offset + k];
        const double allowed = 1e-6 * largest + 1e-9 * all;
        double slope = slope_of(n, s, lf_values(p) + k, 1e-5);
        if (!(fabs(slope - expected) <= allowed))
            slope = slope_of(n, s, lf_values(p) + k, 1e-6);
        if (!(fabs(slope - expected) <= allowed))
            fail_msg("%s[%ld]: gradient %.10g, slope %.10g", p->name, k, expected, slope);
    }
}

static void check_gradient(net_options o, bool two_sizes)
{
    net n;
    stage s;
    make_stage(&s);
    if (two_sizes)
        make_two_sizes(&s);
    s.rays = 4; /* of 10: for speed */
    o.tile = 2;
    open_net(&n, o);
    lf_render_work_check(n.work, false);
    gradient g = step_of(&n, &s);
    assert_true(g.counted == s.rays && g.loss > 1e-3);
    double all = 0;
    for (long k = 0; k < g.size; k++)
        all = fmax(all, fabs((double)g.value[k]));
    for (int i = 0; i < lf_store_count(n.store); i++)
        check_array(&n, &s, &g, lf_store_at(n.store, i), all);
    free(g.value);
    close_net(&n);
}

static void gradients_are_slopes(void **state)
{
    (void)state;
    const int most = omp_get_max_threads();
    omp_set_num_threads(1); /* the work is too small to share */
    for (int k = 0; EXACT && k < KINDS; k++)
        check_gradient(kinds[k], false);
    omp_set_num_threads(most);
}

static void gradients_with_pictures_of_two_sizes(void **state)
{
    (void)state;
    const int most = omp_get_max_threads();
    omp_set_num_threads(1);
    for (int k = 0; EXACT && k < 2; k++)
        check_gradient(kinds[k], true);
    omp_set_num_threads(most);
}

static void every_parameter_learns(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++) {
        net n;
        stage s;
        make_stage(&s);
        open_net(&n, kinds[k]);
        gradient g = step_of(&n, &s);
        for (int i = 0; i < lf_store_count(n.store); i++) {
            const lf_parameter *p = lf_store_at(n.store, i);
            double largest = 0;
            for (long j = 0; j < p->size; j++)
                largest = larger(largest, fabs((double)g.value[p->offset + j]));
            if (p->trainable && !(largest > 0))
                fail_msg("%s has no gradient", p->name);
        }
        free(g.value);
        close_net(&n);
    }
}

/* The fine network's error does not reach the coarse one: it learns as if it were alone. */
static void coarse_weights_are_detached(void **state)
{
    (void)state;
    for (int ibrnet = 0; ibrnet < 2; ibrnet++) {
        net one, two;
        stage s;
        make_stage(&s);
        open_net(&one, (net_options){.ibrnet = ibrnet, .wide = true});
        open_net(&two, (net_options){.ibrnet = ibrnet, .fine = FINE});
        gradient g = step_of(&one, &s), h = step_of(&two, &s);
        for (int i = 0; i < lf_store_count(one.store); i++) {
            const lf_parameter *p = lf_store_at(one.store, i);
            const lf_parameter *q = lf_store_find(two.store, p->name);
            assert_non_null(q);
            assert_memory_equal(lf_values(p), lf_values(q), (size_t)p->size * sizeof(lf_real));
            if (strncmp(p->name, "coarse.", 7) == 0)
                assert_memory_equal(lf_grads(p), lf_grads(q), (size_t)p->size * sizeof(lf_real));
        }
        assert_true(h.loss > g.loss);
        free(g.value);
        free(h.value);
        close_net(&one);
        close_net(&two);
    }
}

/* ---- threads and tiles ---- */

static void threads_do_not_change_a_bit(void **state)
{
    (void)state;
    const int most = omp_get_max_threads();
    for (int k = 0; k < KINDS; k++)
        for (int two_sizes = 0; two_sizes < 2; two_sizes++) {
            net n;
            stage s;
            make_stage(&s);
            if (two_sizes)
                make_two_sizes(&s);
            net_options o = kinds[k];
            o.tile = 1;
            open_net(&n, o);
            omp_set_num_threads(1);
            gradient one = step_of(&n, &s);
            const image first = render(&n, &s);
            for (int threads = 1; threads <= 3; threads++) {
                omp_set_num_threads(threads);
                gradient g = step_of(&n, &s);
                const image x = render(&n, &s);
                assert_true(same_step(&one, &g));
                assert_memory_equal(&first, &x, sizeof x);
                free(g.value);
            }
            omp_set_num_threads(most);
            free(one.value);
            close_net(&n);
        }
}

/* Which rays share a lane depends on the size of the tiles, and so does the order of the sums over
 * rays: the gradients agree up to rounding, not in every bit. */
static void tiles_change_only_rounding(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++) {
        gradient first = {0};
        image rendered = {0};
        for (long tile = 1; tile <= 5; tile += tile == 1 ? 1 : 3) {
            net n;
            stage s;
            net_options o = kinds[k];
            make_stage(&s);
            o.tile = tile;
            open_net(&n, o);
            gradient g = step_of(&n, &s);
            const image x = render(&n, &s);
            if (tile == 1) {
                first = g;
                rendered = x;
                close_net(&n);
                continue;
            }
            assert_below(step_difference(&g, &first), EXACT ? 1e-12 : 2e-5);
            assert_below(difference(&x, &rendered, s.far), EXACT ? 1e-7 : 2e-6);
            assert_int_equal(x.rows, rendered.rows);
            free(g.value);
            close_net(&n);
        }
        free(first.value);
    }
}

/* A step repeats itself; another step draws other depths. */
static void a_step_is_a_function_of_its_number(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++) {
        net n;
        stage s;
        make_stage(&s);
        open_net(&n, kinds[k]);
        lf_render_batch b = batch_of(&s);
        const double first = lf_render_step(n.work, &b, NULL);
        b.step++;
        assert_true(lf_render_step(n.work, &b, NULL) != first);
        b.step--;
        b.seed++;
        assert_true(lf_render_step(n.work, &b, NULL) != first);
        b.seed--;
        render(&n, &s); /* an evaluation between steps leaves nothing behind */
        assert_true(lf_render_step(n.work, &b, NULL) == first);
        close_net(&n);
    }
}

/* ---- motions ---- */

static lf_motion some_motion(int i)
{
    static const double far[] = {0, 1, 1e3};
    lf_stream r = lf_stream_at(6, LF_RANDOM_GROUP, 0, (uint64_t)i);
    lf_motion g = lf_motion_random(&r, 1);
    const double size = hypot(hypot(g.translation[0], g.translation[1]), g.translation[2]);
    for (int a = 0; a < 3; a++)
        g.translation[a] *= far[i % 3] / size;
    return g;
}

static void moved_poses_render_the_same(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++) {
        net n;
        stage s;
        if (kinds[k].ibrnet)
            continue;
        make_stage(&s);
        open_net(&n, kinds[k]);
        gradient here = step_of(&n, &s);
        const image still = render(&n, &s);
        for (int i = 0; i < 100; i++) {
            stage moved = s;
            const lf_motion g = some_motion(i);
            move_stage(&moved, &g);
            const image x = render(&n, &moved);
            /* colours are floats: 1e-8 shows in the loss alone */
            assert_below(difference(&x, &still, s.far), EXACT ? 2e-7 : 1e-4);
            if (i % 10)
                continue;
            gradient there = step_of(&n, &moved);
            assert_below(fabs(there.loss - here.loss), EXACT ? 1e-8 : 1e-4);
            assert_below(relative_error(there.value, here.value, here.size), EXACT ? 1e-7 : 1e-3);
            free(there.value);
        }
        free(here.value);
        close_net(&n);
    }
}

static void ibrnet_sees_rotations(void **state)
{
    (void)state;
    net n;
    stage s;
    make_stage(&s);
    open_net(&n, (net_options){.ibrnet = true});
    const image still = render(&n, &s);
    double least = 1;
    for (int i = 0; i < 10; i++) {
        stage turned = s, shifted = s;
        lf_motion g = some_motion(3 * i + 1);
        const lf_motion shift = {{1, 0, 0, 0, 1, 0, 0, 0, 1},
                                 {g.translation[0], g.translation[1], g.translation[2]}};
        move_stage(&turned, &g);
        move_stage(&shifted, &shift);
        const image x = render(&n, &turned), y = render(&n, &shifted);
        least = fmin(least, difference(&x, &still, s.far));
        assert_below(difference(&y, &still, s.far), EXACT ? 2e-7 : 1e-4); /* nor translations */
    }
    assert_true(least > 1e-3);
    close_net(&n);
}

static void the_order_of_the_sources_is_nothing(void **state)
{
    (void)state;
    static const int order[][SOURCES] = {{3, 2, 1, 0}, {1, 2, 3, 0}, {2, 0, 3, 1}};
    for (int k = 0; k < KINDS; k++) {
        net n;
        stage s;
        make_stage(&s);
        make_two_sizes(&s);
        open_net(&n, kinds[k]);
        gradient here = step_of(&n, &s);
        const image still = render(&n, &s);
        for (int p = 0; p < 3; p++) {
            stage t = s;
            for (int v = 0; v < SOURCES; v++)
                t.source[v] = s.source[order[p][v]];
            gradient there = step_of(&n, &t);
            const image x = render(&n, &t);
            assert_below(fabs(there.loss - here.loss), EXACT ? 1e-12 : 1e-5);
            assert_below(step_difference(&there, &here), EXACT ? 1e-11 : 1e-4);
            assert_below(difference(&x, &still, s.far), EXACT ? 1e-7 : 1e-5);
            free(there.value);
        }
        free(here.value);
        close_net(&n);
    }
}

/* ---- batches ---- */

static void no_ray_counts(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++) {
        net n;
        stage s;
        make_stage(&s);
        open_net(&n, kinds[k]);
        for (long i = 0; i < lf_store_size(n.store); i++)
            lf_store_grads(n.store)[i] = 7;
        s.seen_samples = SAMPLES; /* more than so many are needed */
        gradient g = step_of(&n, &s);
        assert_int_equal(g.counted, 0);
        assert_true(g.loss == 0);
        for (long i = 0; i < g.size; i++)
            assert_true(g.value[i] == 0);
        free(g.value);
        close_net(&n);
    }
}

/* A ray that does not count has no part in the loss, whatever its colour. */
static void a_ray_that_does_not_count(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++) {
        net n;
        stage s, t;
        make_stage(&s);
        make_stage(&t);
        open_net(&n, kinds[k]);
        for (int a = 0; a < 3; a++) { /* ray 4 looks away */
            s.direction[12 + a] = t.direction[12 + a] *= -1;
            t.colour[12 + a] = 1e6f;
        }
        gradient g = step_of(&n, &s), h = step_of(&n, &t);
        assert_int_equal(g.counted, RAYS - 1);
        assert_true(same_step(&g, &h));
        free(g.value);
        free(h.value);
        close_net(&n);
    }
}

/* ---- pictures of two sizes ---- */

/* A source that looks away, of the others' size or not: the others' features are the same. */
static void features_do_not_depend_on_the_others(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++) {
        net n;
        stage s;
        make_stage(&s);
        open_net(&n, kinds[k]);
        lf_camera away =
            lf_camera_look_at(s.camera[3].centre, (const double[3]){4, 0.6, 6.6}, 0.25, WIDTH);
        away.height = HEIGHT;
        place_source(&s, 3, away);
        gradient same = step_of(&n, &s);
        const image first = render(&n, &s);
        away.width = 14;
        away.height = 9;
        place_source(&s, 3, away);
        gradient other = step_of(&n, &s);
        const image x = render(&n, &s);
        assert_below(fabs(other.loss - same.loss), EXACT ? 1e-12 : 1e-6);
        assert_below(step_difference(&other, &same), EXACT ? 1e-11 : 1e-4);
        assert_below(difference(&x, &first, s.far), EXACT ? 1e-7 : 1e-6);
        free(same.value);
        free(other.value);
        close_net(&n);
    }
}

/* ---- savings ---- */

/* From before what any view sees to behind it. */
static void widen(stage *s)
{
    s->near = 1;
    s->far = 9;
}

static void unseen_samples_are_exactly_nothing(void **state)
{
    (void)state;
    for (long fine = 0; fine <= FINE; fine += FINE)
        for (int alone = 0; alone < 2; alone++) {
            net n;
            stage s;
            make_stage(&s);
            widen(&s);
            open_net(&n, (net_options){.fine = fine, .alone = alone});
            const image all = render(&n, &s);
            lf_render_savings savings = lf_render_savings_none();
            savings.unseen = true;
            const image x = render_saving(&n, &s, &savings);
            assert_below(difference(&x, &all, s.far), EXACT ? 1e-7 : 2e-6);
            assert_true(x.rows < all.rows && x.rows > 0);
            close_net(&n);
        }
}

/* Radius of the least ball round the origin with all that a view sees of the rays in it. */
static double seen_radius(const stage *s)
{
    double radius = 0;
    for (int r = 0; r < RAYS; r++)
        for (double z = s->near; z < s->far; z += 0.002) {
            double p[3], uv[2], depth;
            for (int a = 0; a < 3; a++)
                p[a] = s->origin[3 * r + a] + z * s->stretch[r] * s->direction[3 * r + a];
            for (long v = 0; v < s->views; v++) {
                const lf_camera *c = &s->camera[v];
                if (lf_camera_project(c, p, 1e-3, uv, &depth) && uv[0] >= 0 &&
                    uv[0] <= c->width - 1 && uv[1] >= 0 && uv[1] <= c->height - 1)
                    radius = fmax(radius, hypot(hypot(p[0], p[1]), p[2]));
            }
        }
    return radius;
}

/* Sources that look across the target's rays and see them near the origin alone. */
static void look_across(stage *s)
{
    place_source(s, 0, camera_at(0.3, 3.6, 0, 0));
    place_source(s, 1, camera_at(0, -3.7, 0.4, 1));
    place_source(s, 2, camera_at(-0.2, 2.7, 2.6, 2));
    place_source(s, 3, camera_at(0.5, -3, -2.2, 3));
}

static void a_ball_round_all_that_is_seen(void **state)
{
    (void)state;
    for (long fine = 0; fine <= FINE; fine += FINE) {
        net n;
        stage s;
        make_stage(&s);
        widen(&s);
        look_across(&s);
        open_net(&n, (net_options){.fine = fine});
        const image all = render(&n, &s);
        lf_render_savings savings = lf_render_savings_none();
        savings.bounds.radius = seen_radius(&s) + 0.01;
        const image x = render_saving(&n, &s, &savings);
        assert_below(difference(&x, &all, s.far), EXACT ? 1e-7 : 2e-6);
        assert_true(x.rows < all.rows && x.rows > 0);
        savings.bounds.radius = 1e-6; /* a ball with nothing in it: the background */
        const image none = render_saving(&n, &s, &savings);
        for (int i = 0; i < 3 * RAYS; i++)
            assert_true(none.colour[i] == 1);
        assert_int_equal(none.rows, 0);
        close_net(&n);
    }
}

/* The fine network made equal to the coarse one, blind to the features. */
static void make_twins(net *n)
{
    for (int i = 0; i < lf_store_count(n->store); i++) {
        const lf_parameter *p = lf_store_at(n->store, i);
        char name[96];
        if (strncmp(p->name, "features.out.", 13) == 0)
            memset(lf_values(p), 0, (size_t)p->size * sizeof(lf_real));
        if (strncmp(p->name, "fine.", 5))
            continue;
        snprintf(name, sizeof name, "coarse.%s", p->name + 5);
        memcpy(lf_values(p), lf_values(lf_store_find(n->store, name)),
               (size_t)p->size * sizeof(lf_real));
    }
}

/* Where both networks are one and samples do not see each other, the fine samples hold all coarse
 * ones, so behind a depth no more light is left for them than the coarse pass says: less than
 * `stop` is lost, and the background gains it. For other networks there is no such bound. */
static void stopping_loses_less_than_it_says(void **state)
{
    (void)state;
    static const double stops[] = {0.5, 0.1, 0.01, 1e-3};
    net n;
    stage s;
    make_stage(&s);
    open_net(&n, (net_options){.fine = FINE, .alone = true});
    make_twins(&n);
    shift_density(&n, 3);
    const image all = render(&n, &s);
    long rows = 0;
    for (int i = 0; i < 4; i++) {
        lf_render_savings savings = lf_render_savings_none();
        savings.stop = stops[i];
        const image x = render_saving(&n, &s, &savings);
        for (int k = 0; k < 3 * RAYS; k++)
            assert_below(fabs((double)x.colour[k] - (double)all.colour[k]), stops[i] + 1e-6);
        assert_true(x.rows < all.rows && x.rows >= rows);
        rows = x.rows;
    }
    close_net(&n);
}

/* Rays whose coarse pass meets nothing keep its colour. */
static void empty_rays_are_not_refined(void **state)
{
    (void)state;
    net n;
    stage s;
    make_stage(&s);
    open_net(&n, (net_options){.fine = FINE});
    shift_density(&n, -30);
    lf_render_savings savings = lf_render_savings_none();
    savings.empty = 1e-6;
    const image all = render(&n, &s), x = render_saving(&n, &s, &savings);
    assert_below(difference(&x, &all, s.far), 1e-6);
    assert_int_equal(x.rows, RAYS * SAMPLES * SOURCES);
    assert_int_equal(all.rows, RAYS * (2 * SAMPLES + FINE) * SOURCES);
    close_net(&n);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gradients_are_slopes),
        cmocka_unit_test(gradients_with_pictures_of_two_sizes),
        cmocka_unit_test(every_parameter_learns),
        cmocka_unit_test(coarse_weights_are_detached),
        cmocka_unit_test(threads_do_not_change_a_bit),
        cmocka_unit_test(tiles_change_only_rounding),
        cmocka_unit_test(a_step_is_a_function_of_its_number),
        cmocka_unit_test(moved_poses_render_the_same),
        cmocka_unit_test(ibrnet_sees_rotations),
        cmocka_unit_test(the_order_of_the_sources_is_nothing),
        cmocka_unit_test(no_ray_counts),
        cmocka_unit_test(a_ray_that_does_not_count),
        cmocka_unit_test(features_do_not_depend_on_the_others),
        cmocka_unit_test(unseen_samples_are_exactly_nothing),
        cmocka_unit_test(a_ball_round_all_that_is_seen),
        cmocka_unit_test(stopping_loses_less_than_it_says),
        cmocka_unit_test(empty_rays_are_not_refined),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
