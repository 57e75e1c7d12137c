/* labels.h: where small texts beside points go, so that none lies on another or on a point.
 *
 * Greedy, in the order of the points: of places round the point, near ones first, the first one
 * that is free and inside the picture. A text that had to go away from its point is `led`: a line
 * should be drawn to it. Where no place is free the text stays beside its point. Pixels; row 0 is
 * the top one.
 */
#ifndef LF_EVAL_LABELS_H
#define LF_EVAL_LABELS_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct lf_label {
    double x, y;       /* of the point */
    int width, height; /* of the text */
    int left, top;     /* set: its corner */
    bool led;          /* set */
} lf_label;

/* Points are dots of this radius; texts keep within left ... right, top ... bottom. */
typedef struct lf_label_room {
    int left, top, right, bottom;
    double radius;
} lf_label_room;

void lf_labels_place(const lf_label_room *room, long count, lf_label *label);

#ifdef __cplusplus
}
#endif
#endif
