/* labels.c: see labels.h. */
#include "eval/labels.h"

#include <math.h>

/* pixels: between rings; round a text; between texts, beside each other more than between letters
 */
enum { DIRECTIONS = 16, RINGS = 8, RING = 9, GAP = 1, SPACE = 5 };

/* Do text and dot touch? */
static bool on_point(const lf_label *l, double x, double y, double radius)
{
    const double dx = fmax(fmax(l->left - x, x - (l->left + l->width)), 0);
    const double dy = fmax(fmax(l->top - y, y - (l->top + l->height)), 0);
    return hypot(dx, dy) < radius + GAP;
}

static bool on_text(const lf_label *a, const lf_label *b)
{
    return a->left < b->left + b->width + SPACE && b->left < a->left + a->width + SPACE &&
           a->top < b->top + b->height + GAP && b->top < a->top + a->height + GAP;
}

static bool is_free(const lf_label_room *room, long count, const lf_label *label, long at)
{
    const lf_label *l = &label[at];
    if (l->left < room->left || l->top < room->top || l->left + l->width > room->right ||
        l->top + l->height > room->bottom)
        return false;
    for (long i = 0; i < count; i++)
        if (on_point(l, label[i].x, label[i].y, room->radius) || (i < at && on_text(l, &label[i])))
            return false;
    return true;
}

/* Put a text beside its point, `away` pixels between them, in direction k: right and up first, then
 * the others, turning both ways. */
static void put(lf_label *l, int k, double away)
{
    const double turn = 2 * 3.141592653589793 / DIRECTIONS;
    const double angle = turn * (DIRECTIONS / 8 + (k % 2 ? (k + 1) / 2 : -k / 2));
    const double u = cos(angle), v = -sin(angle);
    /* the middle of the text, so that its border is `away` from the point */
    const double half =
        fmin(l->width / 2.0 / fmax(fabs(u), 1e-9), l->height / 2.0 / fmax(fabs(v), 1e-9));
    l->left = (int)lround(l->x + (away + half) * u - l->width / 2.0);
    l->top = (int)lround(l->y + (away + half) * v - l->height / 2.0);
}

void lf_labels_place(const lf_label_room *room, long count, lf_label *label)
{
    for (long i = 0; i < count; i++) {
        bool found = false;
        for (int ring = 0; !found && ring < RINGS; ring++)
            for (int k = 0; !found && k < DIRECTIONS; k++) {
                put(&label[i], k, room->radius + 3 * GAP + ring * RING);
                label[i].led = ring > 0;
                found = is_free(room, count, label, i);
            }
        if (!found) {
            put(&label[i], 0, room->radius + 3 * GAP);
            label[i].led = false;
        }
    }
}
