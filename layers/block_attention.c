/* block_attention.c: attention over the views of points in blocks, and the layers made of it
 *                                                                          [layers/light_blocks.h]
 * Formulas as in cross_attention.c; each point of a block has its own softmax over the groups.
 *
 * Shapes      q, y [B, 1, P C, W], k, val [G, 1, P C, W], weight [N, S, V].
 * Keeps       the weights [G, H, W].
 * Degenerate  no view: zeros, no gradient. Huge logits: the largest is taken off first.
 */
#include "layers/block_groups.h"
#include "layers/heads.h"

enum { W = LF_BLOCK_POINTS, HEADS = LF_HEAD_CHANNELS };

typedef struct attention {
    lf_blocks blocks;
    long planes, c, n; /* n = planes c */
    int heads;
    lf_real scale;
    lf_real *weight; /* [G, H, W] */
} attention;

/* <a, b> over the numbers of one head. */
static lf_vec head_product(const attention *t, int head, const lf_real *a, const lf_real *b, int h)
{
    const long per = t->c / t->heads;
    lf_vec sum = {0}, more = {0};
    for (long i = head * per; i < (head + 1) * per; i++) {
        long p = 0;
        for (; p + 1 < t->planes; p += 2) {
            sum += lf_block_get(a, p * t->c + i, h) * lf_block_get(b, p * t->c + i, h);
            more += lf_block_get(a, (p + 1) * t->c + i, h) * lf_block_get(b, (p + 1) * t->c + i, h);
        }
        for (; p < t->planes; p++)
            sum += lf_block_get(a, p * t->c + i, h) * lf_block_get(b, p * t->c + i, h);
    }
    return sum + more;
}

/* y += number x over one head. */
static void head_add(const attention *t, int head, lf_vec number, const lf_real *x, lf_real *y,
                     int h)
{
    const long per = t->c / t->heads;
    for (long p = 0; p < t->planes; p++)
        for (long i = p * t->c + head * per; i < p * t->c + (head + 1) * per; i++)
            lf_block_add(y, i, h, number * lf_block_get(x, i, h));
}

static lf_real *weight_at(const attention *t, long g)
{
    return t->weight + g * t->heads * W;
}

/* Logits to weights, for one head of one block. */
static void softmax_groups(const attention *t, long b, int head, int h)
{
    const long first = t->blocks.first[b], last = t->blocks.first[b + 1];
    const lf_vec none = {0};
    lf_vec largest = lf_vec_all(-INFINITY), sum = none;
    for (long g = first; g < last; g++) {
        const lf_vec x = lf_block_get(weight_at(t, g), head, h);
        const lf_vec mask = lf_block_get(t->blocks.mask, g, h);
        largest = lf_vec_select((mask > 0) & (x > largest), x, largest);
    }
    for (long g = first; g < last; g++) {
        const lf_vec mask = lf_block_get(t->blocks.mask, g, h);
        const lf_vec x = lf_block_get(weight_at(t, g), head, h);
        const lf_vec e = lf_vec_select(mask > 0, lf_vec_exp(x - largest), none);
        lf_block_set(weight_at(t, g), head, h, e);
        sum += e;
    }
    const lf_vec by = lf_vec_select(sum > 0, 1 / sum, none); /* sum >= 1, or no view */
    for (long g = first; g < last; g++)
        lf_block_set(weight_at(t, g), head, h, by * lf_block_get(weight_at(t, g), head, h));
}

static void forward_block(const attention *t, long b, lf_tensor *const *in, lf_real *y)
{
    const long first = t->blocks.first[b], last = t->blocks.first[b + 1], row = t->n * W;
    const lf_real *q = in[0]->value + b * row;
    memset(y, 0, (size_t)row * sizeof *y);
    for (int head = 0; head < t->heads; head++)
        for (int h = 0; h < LF_PARTS; h++) {
            for (long g = first; g < last; g++)
                lf_block_set(weight_at(t, g), head, h,
                             t->scale * head_product(t, head, q, in[1]->value + g * row, h));
            softmax_groups(t, b, head, h);
            for (long g = first; g < last; g++)
                head_add(t, head, lf_block_get(weight_at(t, g), head, h), in[2]->value + g * row, y,
                         h);
        }
}

/* Means over the heads, in rows. */
static void mean_weights(const attention *t, lf_real *weight)
{
    const long views = t->blocks.rays->views;
    memset(weight, 0, (size_t)(t->blocks.points * views) * sizeof *weight);
    for (long b = 0; b < t->blocks.blocks; b++)
        for (long g = t->blocks.first[b]; g < t->blocks.first[b + 1]; g++)
            for (long p = b * W; p < (b + 1) * W && p < t->blocks.points; p++) {
                lf_real sum = 0;
                for (int head = 0; head < t->heads; head++)
                    sum += weight_at(t, g)[head * W + p % W];
                weight[p * views + t->blocks.view[g]] = sum / (lf_real)t->heads;
            }
}

/* Gradient of the mean weight of group g, over the number of heads. */
static void mean_gradient(const attention *t, long b, long g, const lf_real *dmean, lf_real *d)
{
    for (long l = 0; l < W; l++) {
        const long p = b * W + l;
        d[l] = p < t->blocks.points
                   ? dmean[p * t->blocks.rays->views + t->blocks.view[g]] / (lf_real)t->heads
                   : 0;
    }
}

/* dl [groups of the block, W]: first the means' gradients, then those of the head's logits. */
static void backward_head(const attention *t, const lf_node *node, long b, int head, int h,
                          const lf_real *means, lf_real *dl)
{
    const lf_tensor *q = node->in[0], *k = node->in[1], *val = node->in[2];
    const long first = t->blocks.first[b], last = t->blocks.first[b + 1], row = t->n * W;
    const lf_real *dy = node->out[0]->grad + b * row;
    lf_vec pull = {0}, largest = {0}, most = {0}; /* most: of the largest weight, see heads.h */
    for (long g = first; g < last; g++) {
        const lf_vec w = lf_block_get(weight_at(t, g), head, h);
        const lf_vec d =
            lf_block_get(means, g - first, h) + head_product(t, head, dy, val->value + g * row, h);
        most = lf_vec_select(w > largest, d, most);
        largest = lf_vec_max(w, largest);
        lf_block_set(dl, g - first, h, d);
    }
    for (long g = first; g < last; g++) {
        const lf_vec d = lf_block_get(dl, g - first, h) - most;
        pull += lf_block_get(weight_at(t, g), head, h) * d;
        lf_block_set(dl, g - first, h, d);
    }
    for (long g = first; g < last; g++) {
        const lf_vec w = lf_block_get(weight_at(t, g), head, h);
        const lf_vec d = t->scale * w * (lf_block_get(dl, g - first, h) - pull);
        if (q->grad)
            head_add(t, head, d, k->value + g * row, q->grad + b * row, h);
        if (k->grad)
            head_add(t, head, d, q->value + b * row, k->grad + g * row, h);
        if (val->grad)
            head_add(t, head, w, dy, val->grad + g * row, h);
    }
}

static void backward(const lf_node *node)
{
    const attention *t = node->saved;
    const long views = t->blocks.rays->views;
    lf_real *means = lf_alloc_reals(node->tape, views * W);
    lf_real *dl = lf_alloc_reals(node->tape, views * W);
    for (long b = 0; b < t->blocks.blocks; b++) {
        const long first = t->blocks.first[b];
        for (long g = first; g < t->blocks.first[b + 1]; g++)
            mean_gradient(t, b, g, node->out[1]->grad, means + (g - first) * W);
        for (int head = 0; head < t->heads; head++)
            for (int h = 0; h < LF_PARTS; h++)
                backward_head(t, node, b, head, h, means, dl);
    }
}

lf_attended lf_blocks_attention(lf_tape *tape, const lf_blocks *blocks, lf_tensor *q, lf_tensor *k,
                                lf_tensor *val, int heads)
{
    const lf_light_geometry *rays = blocks->rays;
    const long planes = lf_types_planes(&blocks->types), n = q->dim[2], c = n / planes;
    LF_REQUIRE(heads >= 1 && heads <= HEADS && c % heads == 0 && n == planes * c &&
                   q->dim[0] == blocks->blocks && k->size == blocks->groups * n * W &&
                   val->size == k->size,
               "lf_blocks_attention: %d heads over %ld channels, q of %ld, k of %ld, values of %ld",
               heads, c, q->size, k->size, val->size);
    attention *t = lf_alloc(tape, sizeof *t);
    *t = (attention){*blocks,
                     planes,
                     c,
                     n,
                     heads,
                     (lf_real)(1 / sqrt((double)n / heads)),
                     lf_alloc_reals(tape, blocks->groups * heads * W)};
    lf_tensor *in[] = {q, k, val};
    const lf_attended y = {lf_tensor_like(tape, q),
                           lf_tensor_new(tape, 3, LF_DIMS(rays->rays, rays->samples, rays->views))};
    lf_tensor *out[] = {y.field, y.weight};
    for (long b = 0; b < blocks->blocks; b++)
        forward_block(t, b, in, y.field->value + b * n * W);
    mean_weights(t, y.weight->value);
    if (lf_profiled(tape)) { /* logits and sum; back dw, dq, dk, dval */
        const double half = lf_blocks_pairs(blocks) * (double)n;
        lf_products(tape, 2 * half, half * (1 + q->wants + k->wants + val->wants));
    }
    lf_record(tape, "blocks_attention", backward, t, 3, in, 2, out);
    return y;
}

/* ---- the layers --------------------------------------------------------------------------------
 */

lf_attended lf_blocks_cross(lf_tape *tape, const lf_blocks *blocks,
                            const lf_cross_attention_layer *layer, lf_tensor *f, lf_tensor *point)
{
    lf_tensor *q = lf_blocks_map(tape, &blocks->types, &layer->query, point), *kv[2];
    for (int i = 0; i < 2; i++) {
        kv[i] = lf_blocks_convolution(tape, blocks, &layer->kernel[i], f, false);
        kv[i] = lf_blocks_update(tape, blocks, &layer->update[i], kv[i], q);
    }
    lf_attended y = lf_blocks_attention(tape, blocks, q, kv[0], kv[1], layer->heads);
    y.field = lf_add(tape, point, y.field);
    return y;
}

lf_tensor *lf_blocks_along(lf_tape *tape, const lf_blocks *blocks, const lf_along_ray_layer *layer,
                           lf_tensor *x)
{
    const lf_types *types = &blocks->types;
    lf_tensor *y = lf_blocks_along_attention(
        tape, blocks, lf_blocks_map(tape, types, &layer->query, x),
        lf_blocks_map(tape, types, &layer->key, x), lf_blocks_map(tape, types, &layer->value, x),
        lf_param(tape, layer->profile[0]), lf_param(tape, layer->profile[1]), layer->heads);
    return lf_blocks_map(tape, types, &layer->join, y);
}
