/* test_labels.c: texts beside points lie neither on each other nor on points. */
#include "tests/scene_fixture.h"

#include "autograd/random.h"
#include "eval/labels.h"

enum { POINTS = 24, WIDTH = 11, HEIGHT = 7 };

static const lf_label_room room = {0, 0, 640, 420, 3.5};

static lf_label at(double x, double y)
{
    return (lf_label){x, y, WIDTH, HEIGHT, -1, -1, false};
}

static bool apart(const lf_label *a, const lf_label *b)
{
    return a->left >= b->left + b->width || b->left >= a->left + a->width ||
           a->top >= b->top + b->height || b->top >= a->top + a->height;
}

/* From a point to a text. */
static double distance_to(const lf_label *l, double x, double y)
{
    const double dx = fmax(fmax(l->left - x, x - (l->left + l->width)), 0);
    const double dy = fmax(fmax(l->top - y, y - (l->top + l->height)), 0);
    return hypot(dx, dy);
}

static void assert_legible(long count, const lf_label *label)
{
    for (long i = 0; i < count; i++) {
        const lf_label *l = &label[i];
        assert_true(l->left >= room.left && l->top >= room.top &&
                    l->left + l->width <= room.right && l->top + l->height <= room.bottom);
        for (long j = 0; j < count; j++) {
            assert_true(distance_to(l, label[j].x, label[j].y) >= room.radius);
            assert_true(i == j || apart(l, &label[j]));
        }
    }
}

static void a_point_alone(void **state)
{
    (void)state;
    lf_label l = at(300, 200);
    lf_labels_place(&room, 1, &l);
    assert_legible(1, &l);
    assert_true(!l.led && l.left > 300 && l.top + l.height < 200); /* right and up */
}

static void corners(void **state)
{
    (void)state;
    lf_label label[] = {at(0, 0), at(639, 0), at(0, 419), at(639, 419)};
    lf_labels_place(&room, 4, label);
    assert_legible(4, label);
}

/* All at one place: some must go away, and are led. */
static void points_on_each_other(void **state)
{
    (void)state;
    lf_label label[POINTS];
    long led = 0;
    for (int i = 0; i < POINTS; i++)
        label[i] = at(320 + i % 3, 210);
    lf_labels_place(&room, POINTS, label);
    assert_legible(POINTS, label);
    for (int i = 0; i < POINTS; i++) {
        led += label[i].led;
        assert_true(label[i].led == (distance_to(&label[i], label[i].x, label[i].y) > 8));
    }
    assert_true(led > 0 && led < POINTS);
}

static void clouds(void **state)
{
    (void)state;
    for (uint64_t draw = 0; draw < 50; draw++) {
        lf_label label[POINTS];
        lf_stream s = lf_stream_at(1, LF_RANDOM_GROUP, draw, 0);
        for (int i = 0; i < POINTS; i++) {
            const double x = lf_uniform(&s), y = lf_uniform(&s);
            label[i] = at(200 + 120 * x, 350 + 60 * y);
        }
        lf_labels_place(&room, POINTS, label);
        assert_legible(POINTS, label);
    }
}

/* No place at all: beside the point, over whatever is there. */
static void no_room(void **state)
{
    (void)state;
    const lf_label_room narrow = {0, 0, 8, 8, 3.5};
    lf_label l = at(4, 4);
    lf_labels_place(&narrow, 1, &l);
    assert_true(!l.led && fabs(l.left - 4.0) < 20 && fabs(l.top - 4.0) < 20);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(a_point_alone), cmocka_unit_test(corners),
                                       cmocka_unit_test(points_on_each_other),
                                       cmocka_unit_test(clouds), cmocka_unit_test(no_room)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
