/* test_renderer_hard.c: the renderers where geometry degenerates: values and gradients stay finite,
 * and the equivariant one stays invariant.                                   [method.md 4, 10] */
#include "tests/render_fixture.h"

enum { FINE = 6 };

static const net_options kinds[] = {
    {.ibrnet = false},
    {.ibrnet = true},
    {.fine = FINE},
    {.ibrnet = true, .fine = FINE},
    {.types = {.count = 9, .omega = {0, 1, 2, 4, 8, 16, 32, 64, 128}}},
};
enum { KINDS = sizeof kinds / sizeof *kinds };

static void require_finite(const net *n, const stage *s, const image *x, const gradient *g)
{
    const char *found = lf_render_nonfinite(n->work);
    if (found)
        fail_msg("not finite: %s", found);
    assert_true(isfinite(g->loss));
    for (long i = 0; i < g->size; i++)
        assert_true(isfinite(g->value[i]));
    for (int i = 0; i < 3 * RAYS; i++) /* a blend of the pictures and the ground */
        assert_true(x->colour[i] >= -1e-6f && x->colour[i] <= 1 + 1e-6f);
    for (int i = 0; i < RAYS; i++) {
        assert_true(x->opacity[i] >= 0 && x->opacity[i] <= 1 + 1e-6f);
        assert_true(x->depth[i] >= (float)s->near * 0.99999f &&
                    x->depth[i] <= (float)s->far * 1.00001f);
    }
}

/* All kinds on this scene: finite, and of the equivariant ones the same after a motion. */
static void check(const stage *s)
{
    for (int k = 0; k < KINDS; k++) {
        net n;
        open_net(&n, kinds[k]);
        const image x = render(&n, s);
        gradient g = step_of(&n, s);
        require_finite(&n, s, &x, &g);
        if (!kinds[k].ibrnet) {
            stage moved = *s;
            lf_stream r = lf_stream_at(6, LF_RANDOM_GROUP, 1, 0);
            const lf_motion motion = lf_motion_random(&r, 2);
            move_stage(&moved, &motion);
            const image y = render(&n, &moved);
            gradient h = step_of(&n, &moved);
            require_finite(&n, s, &y, &h);
            assert_below(difference(&x, &y, s->far), EXACT ? 1e-6 : 1e-4);
            assert_below(fabs(h.loss - g.loss), EXACT ? 1e-8 : 1e-4);
            free(h.value);
        }
        free(g.value);
        close_net(&n);
    }
}

/* A camera at distance `at` along ray 0 of the target, `off` beside it, that looks along it
 * (direction 1) or against it (-1). */
static lf_camera on_ray(const stage *s, double at, double off, int direction)
{
    const double *m = s->target.rotation;
    double centre[3], to[3];
    for (int a = 0; a < 3; a++) {
        centre[a] = s->origin[a] + at * s->direction[a] + off * m[3 * a];
        to[a] = centre[a] + direction * s->direction[a];
    }
    lf_camera c = lf_camera_look_at(centre, to, 0.25, WIDTH);
    c = lf_camera_roll(&c, 0.3);
    c.height = HEIGHT;
    c.cy = 0.5 * (HEIGHT - 1) + 0.2;
    return c;
}

static void a_target_ray_parallel_to_a_source_ray(void **state)
{
    (void)state;
    stage s;
    make_stage(&s);
    place_source(&s, 0, on_ray(&s, -1.5, 0, 1));
    check(&s);
}

static void a_target_ray_antiparallel_to_a_source_ray(void **state)
{
    (void)state;
    stage s;
    make_stage(&s);
    place_source(&s, 0, on_ray(&s, 9, 0, -1));
    check(&s);
}

static void a_source_camera_on_the_target_ray(void **state)
{
    (void)state;
    stage s;
    make_stage(&s);
    place_source(&s, 0, on_ray(&s, 3.9, 0, 1));
    place_source(&s, 1, on_ray(&s, 4.2, 0, -1));
    check(&s);
}

/* Nearly on the ray, where the azimuth turns fast. */
static void nearly_parallel_rays_of_high_order(void **state)
{
    (void)state;
    for (double angle = 1e-3; angle > 5e-10; angle *= 0.1) {
        stage s;
        make_stage(&s);
        place_source(&s, 0, on_ray(&s, -1, angle * 5, 1));
        check(&s);
    }
}

/* Samples of ray 0, one of the evaluation and one of the step, each at a source's centre. */
static void a_sample_at_a_source_centre(void **state)
{
    (void)state;
    stage s;
    double depth[SAMPLES];
    make_stage(&s);
    const lf_render_batch b = batch_of(&s);
    lf_strata(SAMPLES, s.near, s.far, NULL, depth);
    place_source(&s, 0, on_ray(&s, depth[3] * s.stretch[0], 0, 1));
    lf_stream r = lf_stream_at(b.seed, LF_RANDOM_DEPTH, (uint64_t)b.step, 0);
    lf_strata(SAMPLES, s.near, s.far, &r, depth);
    place_source(&s, 1, on_ray(&s, depth[4] * s.stretch[0], 0, -1));
    check(&s);
}

static void all_sources_masked(void **state)
{
    (void)state;
    stage s;
    make_stage(&s);
    for (int v = 0; v < SOURCES; v++) {
        const double *c = s.camera[v].centre;
        const double beyond[3] = {2 * c[0], 2 * c[1], 2 * c[2]};
        lf_camera away = lf_camera_look_at(c, beyond, 0.25, WIDTH);
        away.height = HEIGHT;
        place_source(&s, v, away);
    }
    for (int white = 0; white < 2; white++) {
        s.white = white;
        check(&s);
        for (int k = 0; k < KINDS; k++) {
            net n;
            open_net(&n, kinds[k]);
            gradient g = step_of(&n, &s);
            assert_true(g.counted == 0 && g.loss == 0);
            const image x = render(&n, &s);
            for (int i = 0; i < 3 * RAYS; i++)
                assert_true(x.colour[i] == (float)white);
            for (int i = 0; i < RAYS; i++)
                assert_true(x.opacity[i] == 0 && x.depth[i] == (float)s.far);
            free(g.value);
            close_net(&n);
        }
    }
}

/* Of ten rays one is seen by nobody, beside rays that count. */
static void one_ray_that_nobody_sees(void **state)
{
    (void)state;
    stage s;
    make_stage(&s);
    for (int a = 0; a < 3; a++)
        s.direction[a] *= -1;
    check(&s);
    net n;
    open_net(&n, kinds[0]);
    const image x = render(&n, &s);
    assert_true(x.colour[0] == 1 && x.opacity[0] == 0 && x.opacity[1] > 0);
    close_net(&n);
}

static void one_source(void **state)
{
    (void)state;
    stage s;
    make_stage(&s);
    s.views = 1;
    check(&s); /* no ray counts: two views must see a sample */
    for (int k = 0; k < KINDS; k++) {
        net n;
        open_net(&n, kinds[k]);
        const image x = render(&n, &s);
        assert_true(x.opacity[3] > 0); /* but it renders */
        close_net(&n);
    }
}

static void two_equal_sources(void **state)
{
    (void)state;
    stage s;
    make_stage(&s);
    s.source[1] = s.source[0];
    s.source[2] = s.source[0];
    s.camera[1] = s.camera[2] = s.camera[0];
    memcpy(s.rgb[1], s.rgb[0], sizeof s.rgb[0]);
    memcpy(s.rgb[2], s.rgb[0], sizeof s.rgb[0]);
    check(&s);
}

/* Samples project onto the pixel of their ray; here between pixel centres, away from the rim. */
static void the_target_is_a_source(void **state)
{
    (void)state;
    stage s;
    make_stage(&s);
    place_source(&s, 0, s.target);
    check(&s);
    for (int v = 1; v < SOURCES; v++)
        place_source(&s, v, s.target); /* and nothing else */
    check(&s);
}

static void near_is_tiny(void **state)
{
    (void)state;
    static const double share[] = {1e-3, 1e-6};
    for (int i = 0; i < 2; i++) {
        stage s;
        make_stage(&s);
        s.near = share[i] * s.far;
        check(&s);
    }
}

/* Samples that would project into the picture of a camera which they lie behind. */
static void a_point_behind_a_camera(void **state)
{
    (void)state;
    stage s, without;
    make_stage(&s);
    place_source(&s, 0, on_ray(&s, 9, 0, 1));
    check(&s);
    without = s; /* the same centre, looking aside */
    lf_camera aside = s.camera[0];
    double turn[9];
    lf_rotation_axis(0, 1.2, turn);
    lf_rotation_multiply(aside.rotation, turn, aside.rotation);
    place_source(&without, 0, aside);
    for (int k = 0; k < KINDS; k++) {
        net n;
        open_net(&n, kinds[k]);
        const image x = render(&n, &s), y = render(&n, &without);
        assert_true(memcmp(x.colour, y.colour, sizeof x.colour) == 0);
        close_net(&n);
    }
}

/* The world's origin far away and recentred as scenes are: the same picture. */
static void a_scene_far_from_the_origin(void **state)
{
    (void)state;
    const double far[3] = {6e4, -5e4, 6e4}, back[3] = {-6e4, 5e4, -6e4};
    stage here, there;
    make_stage(&here);
    there = here;
    const lf_motion away = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {far[0], far[1], far[2]}};
    move_stage(&there, &away);
    const lf_motion home = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {back[0], back[1], back[2]}};
    move_stage(&there, &home); /* what the cameras lost to rounding stays lost */
    check(&there);
    for (int k = 0; k < KINDS; k++) {
        net n;
        open_net(&n, kinds[k]);
        const image x = render(&n, &here), y = render(&n, &there);
        assert_below(difference(&x, &y, here.far), EXACT ? 1e-6 : 1e-4);
        close_net(&n);
    }
}

/* Pictures of one colour: no variance between views. */
static void flat_pictures(void **state)
{
    (void)state;
    for (int grey = 0; grey < 256; grey += 255) {
        stage s;
        make_stage(&s);
        memset(s.rgb, grey, sizeof s.rgb);
        check(&s);
    }
}

static void an_empty_scene(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++)
        for (int white = 0; white < 2; white++) {
            net n;
            stage s;
            make_stage(&s);
            s.white = white;
            open_net(&n, kinds[k]);
            shift_density(&n, -60);
            const image x = render(&n, &s);
            gradient g = step_of(&n, &s);
            require_finite(&n, &s, &x, &g);
            for (int i = 0; i < 3 * RAYS; i++)
                assert_close(x.colour[i], white, 0, 1e-6);
            for (int i = 0; i < RAYS; i++)
                assert_close(x.depth[i], s.far, 0, 1e-6);
            free(g.value);
            close_net(&n);
        }
}

/* Bilinear colour of view 0 at pixel coordinates. */
static double colour_at(const stage *s, const double uv[2], int a)
{
    const long x = uv[0] < WIDTH - 1 ? (long)uv[0] : WIDTH - 2;
    const long y = uv[1] < HEIGHT - 1 ? (long)uv[1] : HEIGHT - 2;
    const double fx = uv[0] - (double)x, fy = uv[1] - (double)y;
    const uint8_t *p = s->rgb[0] + 3 * (y * WIDTH + x) + a;
    return ((1 - fy) * ((1 - fx) * p[0] + fx * p[3]) +
            fy * ((1 - fx) * p[3 * WIDTH] + fx * p[3 * WIDTH + 3])) /
           255;
}

/* One view: the first sample that it sees has its colour and hides the others. */
static void an_opaque_scene(void **state)
{
    (void)state;
    for (int k = 0; k < 2; k++) {
        net n;
        stage s;
        make_stage(&s);
        s.near = 1;
        s.far = 9;
        s.views = 1;
        open_net(&n, kinds[k]);
        shift_density(&n, 1e4);
        const image x = render(&n, &s);
        gradient g = step_of(&n, &s);
        require_finite(&n, &s, &x, &g);
        double depth[SAMPLES];
        lf_tape *tape = lf_tape_create();
        const lf_render_batch b = batch_of(&s);
        lf_strata(SAMPLES, s.near, s.far, NULL, depth);
        int met = 0;
        for (int r = 0; r < RAYS; r++) {
            const lf_seen_samples seen =
                lf_see_samples(tape, &b.rays, r, 1, SAMPLES, depth, 1, s.source);
            int first = 0;
            while (first < SAMPLES && !seen.seen[first])
                first++;
            met += first < SAMPLES;
            assert_close(x.opacity[r], first < SAMPLES, 0, 1e-6);
            assert_close(x.depth[r], first < SAMPLES ? depth[first] : s.far, 1e-6, 0);
            for (int a = 0; a < 3; a++)
                assert_close(x.colour[3 * r + a],
                             first < SAMPLES ? colour_at(&s, seen.uv + 2 * first, a) : 1, 0, 1e-5);
        }
        assert_true(met >= 3);
        lf_tape_free(tape);
        free(g.value);
        close_net(&n);
    }
}

/* All kinds, all sources: opaque, finite, and not deeper than the first stratum that is seen. */
static void an_opaque_scene_of_all_sources(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++) {
        net n;
        stage s;
        make_stage(&s);
        open_net(&n, kinds[k]);
        shift_density(&n, 1e4);
        const image x = render(&n, &s);
        gradient g = step_of(&n, &s);
        require_finite(&n, &s, &x, &g);
        for (int r = 0; r < RAYS; r++)
            assert_close(x.opacity[r], 1, 0, 1e-6);
        free(g.value);
        close_net(&n);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_target_ray_parallel_to_a_source_ray),
        cmocka_unit_test(a_target_ray_antiparallel_to_a_source_ray),
        cmocka_unit_test(a_source_camera_on_the_target_ray),
        cmocka_unit_test(nearly_parallel_rays_of_high_order),
        cmocka_unit_test(a_sample_at_a_source_centre),
        cmocka_unit_test(all_sources_masked),
        cmocka_unit_test(one_ray_that_nobody_sees),
        cmocka_unit_test(one_source),
        cmocka_unit_test(two_equal_sources),
        cmocka_unit_test(the_target_is_a_source),
        cmocka_unit_test(near_is_tiny),
        cmocka_unit_test(a_point_behind_a_camera),
        cmocka_unit_test(a_scene_far_from_the_origin),
        cmocka_unit_test(flat_pictures),
        cmocka_unit_test(an_empty_scene),
        cmocka_unit_test(an_opaque_scene),
        cmocka_unit_test(an_opaque_scene_of_all_sources),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
