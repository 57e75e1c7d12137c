/* test_render_profile.c: what a profile puts down of the renderers: parts, products by formula;
 * that it changes no bit of a step. [autograd/profile.h] */
#include <omp.h>

#include "tests/render_fixture.h"

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

/* ---- whole steps ---- */

static const char *const equivariant_parts[] = {"coarse/ray convolution", "coarse/cross attention",
                                                "coarse/along ray", "fine/readout"};
static const char *const ibrnet_parts[] = {"coarse/base", "coarse/visibility", "coarse/colour",
                                           "fine/density/along ray"};

static void check_parts(const net *n, const stage *s, const lf_profile *profile)
{
    static const char *const both[] = {"features/down",  "features/up", "places", "coarse/geometry",
                                       "coarse/samples", "fine/volume", "loss",   "lanes"};
    lf_profile_row *row;
    int count = lf_profile_rows(profile, LF_BY_SCOPE, &row);
    for (size_t i = 0; i < sizeof both / sizeof *both; i++)
        find(row, count, both[i], NULL);
    for (int i = 0; i < 4; i++)
        find(row, count, n->model.config.equivariant ? equivariant_parts[i] : ibrnet_parts[i],
             NULL);
    free(row);
    count = lf_profile_rows(profile, LF_BY_OP, &row);
    double macs = 0;
    for (long v = 0; v < s->views; v++)
        macs += lf_renderer_picture_macs(&n->model, s->source[v].height, s->source[v].width);
    assert_true(find(row, count, "", "conv2d")->products[0] == macs);
    free(row);
}

static void check_steps(net_options o)
{
    net n;
    stage s;
    const int most = omp_get_max_threads();
    make_stage(&s);
    open_net(&n, o);
    gradient plain = step_of(&n, &s);
    for (int threads = 1; threads <= 3; threads += 2) {
        lf_profile *profile = lf_profile_create();
        omp_set_num_threads(threads);
        lf_render_work_watch(n.work, profile);
        gradient g = step_of(&n, &s);
        lf_render_work_watch(n.work, NULL);
        assert_true(same_step(&g, &plain));
        check_parts(&n, &s, profile);
        lf_profile_free(profile);
        free(g.value);
    }
    omp_set_num_threads(most);
    free(plain.value);
    close_net(&n);
}

static void test_steps(void **state)
{
    (void)state;
    check_steps((net_options){.fine = 6});
    check_steps((net_options){.ibrnet = true, .fine = 6});
}

/* ---- products of the networks, all samples seen by all views ---- */

enum { N = 2, S = 16, V = 3, F = LF_RGB + 3, POINTS = N * S, SEEN = POINTS * V };

typedef struct scene {
    double origin[3 * N], direction[3 * N], depth[POINTS], centre[3 * V];
    uint8_t seen[SEEN];
    lf_real feature[SEEN * F], gradient[SEEN * F], difference[SEEN * 4];
} scene;

static void make_scene(scene *s)
{
    lf_stream r = lf_stream_at(8, LF_RANDOM_TEST, 81, 0);
    *s = (scene){.origin = {0}};
    for (int i = 0; i < N; i++) {
        s->origin[3 * i + 2] = -3;
        s->direction[3 * i] = 0.1 * i;
        s->direction[3 * i + 2] = sqrt(1 - 0.01 * i * i);
    }
    for (int i = 0; i < POINTS; i++)
        s->depth[i] = 2 + 2 * (i % S + lf_uniform(&r)) / S;
    for (int i = 0; i < 3 * V; i++)
        s->centre[i] = 3 + lf_uniform(&r);
    memset(s->seen, 1, sizeof s->seen);
    for (int i = 0; i < SEEN * F; i++)
        s->feature[i] = (lf_real)lf_uniform(&r);
    for (int i = 0; i < SEEN * 4; i++)
        s->difference[i] = (lf_real)(0.5 * lf_uniform(&r));
}

/* Products of a network, forward and backward, of the sum of colours and densities. */
static lf_profile_row products_of(const net *n, scene *s)
{
    const lf_light_rays rays = {N,        S,         V,       s->origin, s->direction,
                                s->depth, s->centre, s->seen, 2,         4};
    const lf_types types = lf_renderer_types(&n->model);
    lf_tape *tape = lf_tape_create();
    lf_profile *profile = lf_profile_create();
    lf_profile_watch(profile, tape, 0);
    const lf_light_geometry geometry = lf_light_geometry_make(tape, &types, &rays);
    const lf_ray_inputs in = {lf_leaf(tape, 4, LF_DIMS(N, S, V, F), s->feature, s->gradient),
                              &geometry,
                              lf_leaf(tape, 4, LF_DIMS(N, S, V, 4), s->difference, NULL)};
    const lf_radiance out = lf_renderer_radiance(tape, &n->model, LF_COARSE, &in);
    lf_backward(tape, lf_add(tape, lf_sum(tape, out.colour), lf_sum(tape, out.sigma)), 1);
    lf_profile_row *row, sum = {.op = NULL};
    const int count = lf_profile_rows(profile, LF_BY_SCOPE, &row);
    for (int i = 0; i < count; i++) {
        sum.products[0] += row[i].products[0];
        sum.products[1] += row[i].products[1];
    }
    free(row);
    lf_tape_free(tape);
    lf_profile_free(profile);
    return sum;
}

/* The angles of the three profiles have no gradient: 3 x hidden products a pair less. */
static void test_equivariant_products(void **state)
{
    (void)state;
    for (int more = 0; more <= 3; more += 3) {
        net n;
        scene s;
        open_net(&n, (net_options){.types = {.count = 4, .omega = {0, 1, 2, 5}, .more = more}});
        make_scene(&s);
        const lf_profile_row r = products_of(&n, &s);
        const lf_ray_equivariant *model = &n.model.equivariant[LF_COARSE];
        const double angles = 3.0 * SEEN * 3 * (double)model->config.hidden;
        assert_true(r.products[0] == POINTS * lf_ray_equivariant_macs(model, S, V));
        assert_true(r.products[1] == 2 * r.products[0] - angles);
        close_net(&n);
    }
}

/* lf_ibrnet_macs counts moments as 4 a number, which are 3 products, and the blend of colours. */
static void test_ibrnet_products(void **state)
{
    (void)state;
    net n;
    scene s;
    open_net(&n, (net_options){.ibrnet = true});
    make_scene(&s);
    const lf_profile_row r = products_of(&n, &s);
    const lf_ibrnet *model = &n.model.ibrnet[LF_COARSE];
    const double less = V * ((double)model->config.inputs + 32 + 3);
    assert_true(r.products[0] == POINTS * (lf_ibrnet_macs(model, S, V) - less));
    close_net(&n);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_steps),
        cmocka_unit_test(test_equivariant_products),
        cmocka_unit_test(test_ibrnet_products),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
