/* attention_lanes.h: attention of a point over its rays with all channels of a type in one vector,
 * one lane a channel; formulas in ray_attention.c, which alone includes this.
 *
 * Numbers of the heads stand in the first lanes of a vector. A head has 1, 2, 4, ... adjacent
 * channels, so its sum over them is a butterfly of shuffles. Measured with
 * 16 lanes: `elf-bench step-peer` takes 0.91 of the time that it takes with arrays.
 */
#ifndef LF_LAYERS_ATTENTION_LANES_H
#define LF_LAYERS_ATTENTION_LANES_H

#include "autograd/kernels/vector_math.h"
#include "layers/layers.h"

enum { LF_ATTENTION_VIEWS = 256 };

/* One type of `rows` components (1 or 3) with `channels` lanes; `per` channels a head. */
typedef struct lf_lane_type {
    int channels, rows, per;
    lf_vec_bits of_head, first; /* a channel's head; a head's first channel */
} lf_lane_type;

/* Numbers of one type at a point or ray. */
typedef struct lf_lane_value {
    lf_vec row[3];
} lf_lane_value;

static inline bool lf_lanes_fit(long channels, int heads)
{
    const long per = channels / heads;
    return channels <= LF_LANES && heads <= LF_LANES && (per & (per - 1)) == 0;
}

static inline lf_lane_type lf_lane_type_make(int channels, int rows, int heads)
{
    lf_lane_type t = {.channels = channels, .rows = rows, .per = channels / heads};
    for (int i = 0; i < LF_LANES; i++) {
        t.of_head[i] = channels ? i / t.per % heads : 0;
        t.first[i] = i < heads ? i * t.per : 0;
    }
    return t;
}

/* Rows of `channels` numbers, `step` apart; none without channels. */
LF_INLINE lf_lane_value lf_lane_load(const lf_lane_type *t, const lf_real *x, long step)
{
    lf_lane_value v = {{{0}}};
    for (long a = 0; t->channels && a < t->rows; a++)
        v.row[a] = lf_vec_load_part(x + a * step, t->channels);
    return v;
}

LF_INLINE void lf_lane_store(const lf_lane_type *t, const lf_lane_value *v, lf_real *x, long step)
{
    for (long a = 0; t->channels && a < t->rows; a++)
        lf_vec_store_part(x + a * step, t->channels, v->row[a]);
}

/* x += by v; `by` a number of every head. */
LF_INLINE void lf_lane_add(const lf_lane_type *t, lf_vec by, const lf_lane_value *v, lf_real *x,
                           long step)
{
    const lf_vec spread = __builtin_shuffle(by, t->of_head);
    for (long a = 0; t->channels && a < t->rows; a++) {
        lf_real *to = x + a * step;
        lf_vec_store_part(to, t->channels, lf_vec_load_part(to, t->channels) + spread * v->row[a]);
    }
}

LF_INLINE void lf_lane_sum(const lf_lane_type *t, lf_vec by, const lf_lane_value *v,
                           lf_lane_value *sum)
{
    const lf_vec spread = __builtin_shuffle(by, t->of_head);
    for (long a = 0; t->channels && a < t->rows; a++)
        sum->row[a] += spread * v->row[a];
}

/* <a, b> of every head. */
LF_INLINE lf_vec lf_lane_products(const lf_lane_type *t, const lf_lane_value *a,
                                  const lf_lane_value *b)
{
    const lf_vec_bits lane = LF_VEC_COUNT;
    lf_vec sum = {0};
    for (long r = 0; t->channels && r < t->rows; r++)
        sum += a->row[r] * b->row[r];
    for (int h = 1; h < t->per; h *= 2)
        sum += __builtin_shuffle(sum, lane ^ h);
    return __builtin_shuffle(sum, t->first);
}

/* Logits of all views to weights; mask [V]. */
LF_INLINE void lf_lane_softmax(long views, const lf_real *mask, lf_vec *w)
{
    const lf_vec none = {0};
    lf_vec largest = lf_vec_all(-INFINITY), sum = none;
    for (long v = 0; v < views; v++)
        largest = mask[v] > 0 ? lf_vec_select(w[v] > largest, w[v], largest) : largest;
    for (long v = 0; v < views; v++) {
        w[v] = mask[v] > 0 ? lf_vec_exp(w[v] - largest) : none;
        sum += w[v];
    }
    const lf_vec by = lf_vec_select(sum > 0, 1 / sum, none); /* sum >= 1, or no view */
    for (long v = 0; v < views; v++)
        w[v] *= by;
}

#endif
