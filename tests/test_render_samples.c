/* test_render_samples.c: samples on target rays, what source views see of them, and IBRNet's
 * differences, against closed forms.                                            [method.md 5b.1] */
#include "autograd/ops.h"
#include "datasets/camera.h"
#include "models/ray_samples.h"
#include "tests/close.h"

#define EXACT (sizeof(lf_real) == 8) /* the double build */

/* ---- depths ---- */

enum { STRATA = 12, FINE = 16 };

static void strata_rise_one_in_each(void **state)
{
    (void)state;
    static const double range[][2] = {{2, 6}, {0.001, 1}, {1e-6, 1e3}, {1e5, 1e5 + 1}};
    for (int k = 0; k < 4; k++)
        for (int draw = 0; draw < 20; draw++) {
            const double near = range[k][0], far = range[k][1];
            lf_stream s = lf_stream_at(3, LF_RANDOM_TEST, (uint64_t)k, (uint64_t)draw);
            double z[STRATA];
            lf_strata(STRATA, near, far, draw ? &s : NULL, z);
            for (int i = 0; i < STRATA; i++) {
                /* place in the strata, all of size 1 */
                const double t = STRATA * (1 / near - 1 / z[i]) / (1 / near - 1 / far);
                assert_true(t > i - 1e-6 && t < i + 1 + 1e-6);
                assert_true(z[i] > near * (1 - 1e-12) && z[i] < far * (1 + 1e-12));
                assert_true(i == 0 || z[i] > z[i - 1]);
                if (!draw)
                    assert_close(t, i + 0.5, 0, 1e-6);
            }
        }
}

static void one_stratum(void **state)
{
    (void)state;
    double z;
    lf_strata(1, 2, 6, NULL, &z);
    assert_close(z, 3, 1e-15, 0); /* the middle of 1/2 and 1/6 is 1/3 */
}

static bool among(double x, long n, const double *list)
{
    for (long i = 0; i < n; i++)
        if (x == list[i])
            return true;
    return false;
}

/* Sorted; the coarse depths are all in it. */
static void assert_refined(const double *coarse, const double *out)
{
    for (int i = 1; i < STRATA + FINE; i++)
        assert_true(out[i] >= out[i - 1]);
    for (int i = 0; i < STRATA; i++)
        assert_true(among(coarse[i], STRATA + FINE, out));
}

static void weight_in_one_bin_draws_all(void **state)
{
    (void)state;
    for (int bin = 0; bin < STRATA - 2; bin++)
        for (int random = 0; random < 2; random++) {
            lf_stream s = lf_stream_at(5, LF_RANDOM_TEST, 1, (uint64_t)bin);
            double z[STRATA], out[STRATA + FINE];
            lf_real weight[STRATA] = {0};
            lf_strata(STRATA, 2, 6, NULL, z);
            weight[bin + 1] = 1;
            weight[0] = weight[STRATA - 1] = 5; /* the outer ones are not read */
            lf_refine(STRATA, z, weight, FINE, random ? &s : NULL, out);
            assert_refined(z, out);
            const double near = 2 / (1 / z[bin] + 1 / z[bin + 1]);
            const double far = 2 / (1 / z[bin + 1] + 1 / z[bin + 2]);
            int inside = 0;
            for (int i = 0; i < STRATA + FINE; i++)
                inside += out[i] >= near && out[i] <= far && !among(out[i], STRATA, z);
            /* 1e-5 a bin lies elsewhere: a random place may fall there, an even one does not */
            assert_true(inside >= FINE - random);
        }
}

/* No weight at all: even in 1 / depth between the outer middles. */
static void no_weight_spreads_evenly(void **state)
{
    (void)state;
    double z[STRATA], out[STRATA + FINE], again[STRATA + FINE];
    const lf_real weight[STRATA] = {0};
    lf_strata(STRATA, 2, 6, NULL, z);
    lf_refine(STRATA, z, weight, FINE, NULL, out);
    lf_refine(STRATA, z, weight, FINE, NULL, again);
    assert_memory_equal(out, again, sizeof out);
    assert_refined(z, out);
    const double a = 0.5 * (1 / z[0] + 1 / z[1]), b = 0.5 * (1 / z[STRATA - 2] + 1 / z[STRATA - 1]);
    int k = 0;
    for (int i = 0; i < STRATA + FINE; i++)
        if (!among(out[i], STRATA, z)) {
            assert_close(1 / out[i], a + (k + 0.5) / FINE * (b - a), 1e-12, 0);
            k++;
        }
    assert_int_equal(k, FINE);
}

/* Share of places up to a depth against the density's integral, for weights of every size. */
static void places_follow_the_weights(void **state)
{
    (void)state;
    enum { MANY = 4000 };
    static double out[STRATA + MANY];
    double z[STRATA], total = 0, below = 0;
    lf_real weight[STRATA];
    lf_stream s = lf_stream_at(5, LF_RANDOM_TEST, 2, 0);
    lf_strata(STRATA, 1, 50, &s, z);
    for (int i = 0; i < STRATA; i++) {
        weight[i] = (lf_real)(i % 4 == 3 ? 0 : lf_uniform(&s));
        total += i && i < STRATA - 1 ? (double)weight[i] + 1e-5 : 0;
    }
    lf_refine(STRATA, z, weight, MANY, NULL, out);
    for (int i = 1; i < STRATA - 1; i++) {
        const double edge = 2 / (1 / z[i] + 1 / z[i + 1]);
        long count = 0;
        below += (double)weight[i] + 1e-5;
        for (long k = 0; k < STRATA + MANY; k++)
            count += out[k] <= edge && !among(out[k], STRATA, z);
        assert_close((double)count / MANY, below / total, 0, 1.5 / MANY);
    }
}

static void refining_three_samples(void **state)
{
    (void)state;
    const double z[3] = {2, 3, 4};
    const lf_real weight[3] = {(lf_real)0.2, (lf_real)0.3, (lf_real)0.4};
    double out[4];
    lf_refine(3, z, weight, 1, NULL, out);
    /* one bin between 1/2 and 1/3, and 1/3 and 1/4; its middle */
    const double middle = 1 / (0.25 * (0.5 + 1 / 3.0) + 0.25 * (1 / 3.0 + 0.25));
    assert_true(out[0] == 2 && out[3] == 4);
    assert_true(among(3, 4, out));
    assert_close(larger(out[1] == 3 ? out[2] : out[1], 0), middle, 1e-12, 0);
}

/* No inner sample: even in 1 / depth between the two. */
static void refining_two_samples(void **state)
{
    (void)state;
    const double z[2] = {2, 4};
    const lf_real weight[2] = {1, 0};
    double out[4];
    lf_refine(2, z, weight, 2, NULL, out);
    assert_true(out[0] == 2 && out[3] == 4);
    assert_close(out[1], 16 / 7.0, 1e-12, 0);
    assert_close(out[2], 16 / 5.0, 1e-12, 0);
}

/* ---- projection ---- */

/* Camera at `centre` that looks along z, focal length 8, in powers of two: exact. */
static lf_source plain_source(double x, double y, double z)
{
    return (lf_source){
        {8, 0, 16, -8 * x - 16 * z, 0, 8, 8, -8 * y - 8 * z, 0, 0, 1, -z}, {x, y, z}, 33, 17, NULL};
}

/* Does the view see the point, and where. */
static bool look(const lf_source *source, double x, double y, double z, double uv[2])
{
    lf_tape *tape = lf_tape_create();
    const double origin[3] = {x, y, z}, direction[3] = {0, 0, 1}, stretch = 1, depth = 0;
    const lf_target_rays rays = {1, origin, direction, &stretch, 0.5, 8};
    const lf_seen_samples s = lf_see_samples(tape, &rays, 0, 1, 1, &depth, 1, source);
    const bool seen = s.seen[0];
    memcpy(uv, s.uv, 2 * sizeof *uv);
    assert_memory_equal(s.centres, source->centre, sizeof source->centre);
    assert_true(s.point[0] == x && s.point[1] == y && s.point[2] == z);
    lf_tape_free(tape);
    return seen;
}

static void pixel_centres_are_integers(void **state)
{
    (void)state;
    const lf_source s = plain_source(1, 2, -4);
    double uv[2];
    assert_true(look(&s, 1, 2, 4, uv)); /* on the axis: the principal point (16, 8) */
    assert_true(uv[0] == 16 && uv[1] == 8);
    assert_true(look(&s, 2, 2, 4, uv)); /* one to the right at depth 8 */
    assert_true(uv[0] == 17 && uv[1] == 8);
    assert_true(look(&s, 1, -1, 4, uv)); /* three up */
    assert_true(uv[0] == 16 && uv[1] == 5);
}

static void the_border_belongs_to_the_picture(void **state)
{
    (void)state;
    const lf_source s = plain_source(0, 0, 0);
    const double e = 1e-9;
    double uv[2];
    assert_true(look(&s, -16, 0, 8, uv) && uv[0] == 0);
    assert_true(look(&s, 16, 0, 8, uv) && uv[0] == 32);
    assert_true(look(&s, 0, -8, 8, uv) && uv[1] == 0);
    assert_true(look(&s, 0, 8, 8, uv) && uv[1] == 16);
    assert_false(look(&s, -16 - e, 0, 8, uv));
    assert_true(uv[0] == 0 && uv[1] == 0); /* a safe place to read */
    assert_false(look(&s, 16 + e, 0, 8, uv));
    assert_false(look(&s, 0, -8 - e, 8, uv));
    assert_false(look(&s, 0, 8 + e, 8, uv));
}

static void behind_a_camera_is_unseen(void **state)
{
    (void)state;
    const lf_source s = plain_source(0, 0, 0);
    double uv[2];
    assert_false(look(&s, 0, 0, -4, uv)); /* would fall onto the principal point */
    assert_false(look(&s, 1, 1, -8, uv));
    assert_false(look(&s, 0, 0, 0, uv)); /* the centre itself */
    assert_true(uv[0] == 0 && uv[1] == 0);
    assert_false(look(&s, 0, 0, 1e-7 * 8, uv)); /* nearer than 1e-6 far */
    assert_false(look(&s, 1, 0, 0, uv));
}

static lf_source source_of(const lf_camera *c)
{
    lf_source s = {.width = c->width, .height = c->height};
    memcpy(s.centre, c->centre, sizeof s.centre);
    for (int j = 0; j < 4; j++) {
        double q[3];
        for (int i = 0; i < 3; i++)
            q[i] = j < 3 ? c->rotation[3 * j + i]
                         : -c->rotation[i] * c->centre[0] - c->rotation[3 + i] * c->centre[1] -
                               c->rotation[6 + i] * c->centre[2];
        s.projection[j] = c->fx * q[0] + c->cx * q[2];
        s.projection[4 + j] = c->fy * q[1] + c->cy * q[2];
        s.projection[8 + j] = q[2];
    }
    return s;
}

enum { RAYS = 7, VIEWS = 5 };

/* Rays of a camera and views around the origin, random. */
typedef struct view_set {
    lf_camera target, camera[VIEWS];
    lf_source source[VIEWS];
    double origin[3 * RAYS], direction[3 * RAYS], stretch[RAYS], depth[RAYS * STRATA];
    lf_target_rays rays;
} view_set;

static lf_camera random_camera(lf_stream *s, int width, int height)
{
    const double centre[3] = {3 + lf_uniform(s), lf_normal(s), lf_normal(s)};
    const double at[3] = {0.2 * lf_normal(s), 0.2 * lf_normal(s), 0};
    lf_camera c = lf_camera_look_at(centre, at, 0.3, width);
    c = lf_camera_roll(&c, 6 * lf_uniform(s));
    c.height = height;
    c.cy = 0.5 * (height - 1);
    c.fx *= 1.1;
    return c;
}

static void make_set(view_set *x, uint64_t seed)
{
    lf_stream s = lf_stream_at(seed, LF_RANDOM_TEST, 3, 0);
    x->target = random_camera(&s, 24, 20);
    for (int v = 0; v < VIEWS; v++) {
        x->camera[v] = random_camera(&s, 24 + v, 20 - v);
        x->source[v] = source_of(&x->camera[v]);
    }
    for (int r = 0; r < RAYS; r++) {
        double *d = x->direction + 3 * r;
        lf_camera_ray(&x->target, 23 * lf_uniform(&s), 19 * lf_uniform(&s), d);
        memcpy(x->origin + 3 * r, x->target.centre, sizeof x->target.centre);
        x->stretch[r] = 1 / (x->target.rotation[2] * d[0] + x->target.rotation[5] * d[1] +
                             x->target.rotation[8] * d[2]);
        lf_strata(STRATA, 1, 9, &s, x->depth + r * STRATA);
    }
    x->rays = (lf_target_rays){RAYS, x->origin, x->direction, x->stretch, 1, 9};
}

/* A depth is a z of the target; what a view sees is what its camera projects. */
static void views_see_as_cameras_project(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    long seen = 0, all = 0;
    for (uint64_t seed = 0; seed < 20; seed++) {
        view_set x;
        make_set(&x, seed);
        lf_tape_reset(tape);
        const long from = 2, count = RAYS - 2;
        const lf_seen_samples s = lf_see_samples(tape, &x.rays, from, count, STRATA,
                                                 x.depth + from * STRATA, VIEWS, x.source);
        for (long i = 0; i < count * STRATA; i++) {
            const double *p = s.point + 3 * i;
            double uv[2], depth;
            assert_true(lf_camera_project(&x.target, p, 0.1, uv, &depth));
            assert_close(depth, x.depth[from * STRATA + i], 1e-12, 0);
            assert_close(s.along[i], depth * x.stretch[from + i / STRATA], 1e-12, 0);
            for (int v = 0; v < VIEWS; v++, all++) {
                const lf_camera *c = &x.camera[v];
                const bool there = lf_camera_project(c, p, 9e-6, uv, &depth) && uv[0] >= 0 &&
                                   uv[1] >= 0 && uv[0] <= c->width - 1 && uv[1] <= c->height - 1;
                assert_int_equal(s.seen[i * VIEWS + v], there);
                seen += there;
                for (int a = 0; a < 2; a++)
                    assert_close(s.uv[2 * (i * VIEWS + v) + a], there ? uv[a] : 0, 0, 1e-10);
            }
        }
    }
    assert_true(seen > all / 8 && seen < all - all / 8); /* or it says little */
    lf_tape_free(tape);
}

/* ---- IBRNet's differences ---- */

static void differences_are_the_definition(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    view_set x;
    make_set(&x, 77);
    const long from = 3, count = RAYS - 3;
    const lf_seen_samples s = lf_see_samples(tape, &x.rays, from, count, STRATA,
                                             x.depth + from * STRATA, VIEWS, x.source);
    const lf_tensor *y = lf_ray_differences(tape, &x.rays, from, count, STRATA, &s, VIEWS);
    for (long i = 0; i < count * STRATA * VIEWS; i++) {
        double a[3], b[3], na = 0, nb = 0, size = 0;
        for (int k = 0; k < 3; k++) {
            a[k] = x.target.centre[k] - s.point[3 * (i / VIEWS) + k];
            b[k] = x.camera[i % VIEWS].centre[k] - s.point[3 * (i / VIEWS) + k];
            na += a[k] * a[k];
            nb += b[k] * b[k];
        }
        for (int k = 0; k < 3; k++) {
            a[k] /= sqrt(na);
            b[k] /= sqrt(nb);
            size += (a[k] - b[k]) * (a[k] - b[k]);
        }
        for (int k = 0; k < 3; k++)
            assert_close(y->value[4 * i + k], (a[k] - b[k]) / sqrt(size), 0, EXACT ? 1e-10 : 1e-6);
        /* <a, b> - 1, with as many digits where they agree */
        assert_close(y->value[4 * i + 3], -size / 2, EXACT ? 1e-10 : 1e-6, 0);
    }
    lf_tape_free(tape);
}

static void same_and_opposite_directions(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    const double origin[3] = {0, 0, 0}, direction[3] = {0, 0, 1}, stretch = 1, depth = 4;
    const lf_target_rays rays = {1, origin, direction, &stretch, 1, 8};
    /* at the target, behind it on its ray, beyond the sample, and at the sample */
    const lf_source source[] = {plain_source(0, 0, 0), plain_source(0, 0, -3),
                                plain_source(0, 0, 7), plain_source(0, 0, 4)};
    static const double expected[4][4] = {{0, 0, 0, 0}, {0, 0, 0, 0}, {0, 0, -1, -2}, {0, 0, 0, 0}};
    const lf_seen_samples s = lf_see_samples(tape, &rays, 0, 1, 1, &depth, 4, source);
    const lf_tensor *y = lf_ray_differences(tape, &rays, 0, 1, 1, &s, 4);
    for (int v = 0; v < 4; v++)
        for (int k = 0; k < 4; k++)
            assert_close(y->value[4 * v + k], expected[v][k], 0, 1e-15);
    lf_tape_free(tape);
}

/* ---- colours and features at the places ---- */

typedef struct size {
    long width, height;
} size;

/* Bilinear value of channel c of an image [h, w, channels] at (x, y), cut to it. */
static double bilinear(size s, long channels, long c, const double *image, double x, double y)
{
    double sum = 0;
    x = fmin(fmax(x, 0), (double)(s.width - 1));
    y = fmin(fmax(y, 0), (double)(s.height - 1));
    for (long j = 0; j < s.height; j++)
        for (long i = 0; i < s.width; i++)
            sum += fmax(0, 1 - fabs(x - (double)i)) * fmax(0, 1 - fabs(y - (double)j)) *
                   image[(j * s.width + i) * channels + c];
    return sum;
}

static void views_of_two_sizes_are_sampled(void **state)
{
    (void)state;
    enum { C = 5, FIRST = 1, USED = 3, POINTS = 60, MOST = 24 * 20 };
    const size picture[2] = {{24, 20}, {15, 1}}, map[2] = {{12, 10}, {8, 1}};
    static uint8_t rgb[2][3 * MOST];
    static double rgb_reals[2][3 * MOST], map_reals[2][C * MOST];
    static lf_real maps[C * 128];
    double uv[POINTS * 2 * 2];
    lf_real mask[POINTS * 2];
    lf_stream s = lf_stream_at(8, LF_RANDOM_TEST, 4, 0);
    lf_view_map view[2];
    long offset = 0;
    for (int v = 0; v < 2; v++) {
        for (long i = 0; i < 3 * MOST; i++)
            rgb_reals[v][i] = rgb[v][i] = (uint8_t)lf_index(&s, 256);
        view[v] = (lf_view_map){
            rgb[v], picture[v].height, picture[v].width, 2, map[v].height, map[v].width, C, offset};
        for (long i = 0; i < map[v].width * map[v].height * C; i++)
            map_reals[v][i] = (double)(maps[offset++] = (lf_real)lf_normal(&s));
    }
    for (long i = 0; i < POINTS * 2; i++) {
        const size p = picture[i % 2];
        mask[i] = (lf_real)(i % 7 != 3);
        uv[2 * i] = i < 4 ? (double)(p.width - 1) : lf_uniform(&s) * (double)(p.width - 1);
        uv[2 * i + 1] = i < 6 ? (double)(p.height - 1) : lf_uniform(&s) * (double)(p.height - 1);
    }
    lf_tape *tape = lf_tape_create();
    const lf_tensor *y = lf_sample_views(tape, lf_leaf(tape, 1, LF_DIMS(offset), maps, NULL), 2,
                                         view, FIRST, USED, POINTS, uv, mask);
    for (long i = 0; i < POINTS * 2; i++)
        for (long c = 0; c < 3 + USED; c++) {
            const int v = (int)(i % 2);
            const double expected =
                c < 3 ? bilinear(picture[v], 3, c, rgb_reals[v], uv[2 * i], uv[2 * i + 1]) / 255
                      : bilinear(map[v], C, FIRST + c - 3, map_reals[v], uv[2 * i] / 2,
                                 uv[2 * i + 1] / 2);
            assert_close(y->value[i * (3 + USED) + c], mask[i] > 0 ? expected : 0, 0,
                         EXACT ? 1e-13 : 2e-6);
        }
    lf_tape_free(tape);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(strata_rise_one_in_each),
        cmocka_unit_test(one_stratum),
        cmocka_unit_test(weight_in_one_bin_draws_all),
        cmocka_unit_test(no_weight_spreads_evenly),
        cmocka_unit_test(places_follow_the_weights),
        cmocka_unit_test(refining_three_samples),
        cmocka_unit_test(refining_two_samples),
        cmocka_unit_test(pixel_centres_are_integers),
        cmocka_unit_test(the_border_belongs_to_the_picture),
        cmocka_unit_test(behind_a_camera_is_unseen),
        cmocka_unit_test(views_see_as_cameras_project),
        cmocka_unit_test(differences_are_the_definition),
        cmocka_unit_test(same_and_opposite_directions),
        cmocka_unit_test(views_of_two_sizes_are_sampled),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
