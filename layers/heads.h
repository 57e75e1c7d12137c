/* heads.h: products, sums and softmax per attention head of features whose rows are planes of C
 * channels: head h has the channels [h C / H, (h + 1) C / H) of every plane. [layers/light_field.h]
 */
#ifndef LF_LAYERS_HEADS_H
#define LF_LAYERS_HEADS_H

#include "autograd/real.h"

enum { LF_HEAD_CHANNELS = 64 }; /* the most channels, and so the most heads */

/* sums[h] = <a, b> over the head; a, b [planes, c]. */
static inline void lf_head_products(long planes, long c, int heads, const lf_real *a,
                                    const lf_real *b, lf_real *sums)
{
    const long per = c / heads;
    lf_real sum[LF_HEAD_CHANNELS] = {0};
    for (long p = 0; p < planes; p++)
        for (long i = 0; i < c; i++)
            sum[i] += a[p * c + i] * b[p * c + i];
    for (int h = 0; h < heads; h++) {
        sums[h] = 0;
        for (long i = 0; i < per; i++)
            sums[h] += sum[h * per + i];
    }
}

/* y += number[h] x over the channels of head h; x, y [planes, c]. */
static inline void lf_head_add(long planes, long c, int heads, const lf_real *number,
                               const lf_real *x, lf_real *restrict y)
{
    const long per = c / heads;
    lf_real by[LF_HEAD_CHANNELS];
    for (long i = 0; i < c; i++)
        by[i] = number[i / per];
    for (long p = 0; p < planes; p++)
        for (long i = 0; i < c; i++)
            y[p * c + i] += by[i] * x[p * c + i];
}

/* Gradients of weights w [views, heads], a softmax over the views for each head, become those of
 * the logits times `scale`: w (g - sum w g). g is the gradient less that of the head's largest
 * weight: where that is nearly 1 the others keep their digits, and its own is made of theirs. */
static inline void lf_head_softmax_backward(long views, int heads, lf_real scale, const lf_real *w,
                                            lf_real *restrict d)
{
    lf_real largest[LF_HEAD_CHANNELS] = {0}, most[LF_HEAD_CHANNELS] = {0};
    lf_real pull[LF_HEAD_CHANNELS] = {0};
    for (long v = 0; v < views; v++)
        for (int h = 0; h < heads; h++) {
            most[h] = w[v * heads + h] > largest[h] ? d[v * heads + h] : most[h];
            largest[h] = w[v * heads + h] > largest[h] ? w[v * heads + h] : largest[h];
        }
    for (long v = 0; v < views; v++)
        for (int h = 0; h < heads; h++)
            pull[h] += w[v * heads + h] * (d[v * heads + h] - most[h]);
    for (long v = 0; v < views; v++)
        for (int h = 0; h < heads; h++)
            d[v * heads + h] = scale * w[v * heads + h] * (d[v * heads + h] - most[h] - pull[h]);
}

#endif
