/* ibrnet_views.c: weights, moments and visibilities over the views of a point; colours
 *                                                                  [layers/ibrnet.h, method.md 5c]
 *   weights    a_v = m_v (e_v - e_least), e = exp(|s| x), x = dot - 1,
 *              w_v = a_v / (sum a + epsilon)
 *     ds  += sign(s) sum_v dw_v w_v (l_v - sum_u w_u l_u),  l = d log a / d|s|
 *   moments    mean = sum_v w_v x_v,  variance = sum_v w_v (x_v - mean)^2,  sum_v w_v / V
 *     g = dmean - 2 dvariance mean (1 - sum w),  h_v = x_v - mean
 *     dx_v += w_v (g + 2 dvariance h_v),  dw_v += sum_c x_v g + h_v^2 dvariance + d(sum w / V) / V
 *   residual   z = x + r_0..D-1,  y = z m sigmoid(r_D)
 *   visibility u_v = m_v sigmoid(t_v),  w_v = u_v / (sum u + epsilon)
 *   colour     p = softmax of t over the views with m = 1,  c = sum_v p_v x_v
 *
 * Shapes      layers/ibrnet.h: everything is in lanes but the features whose first three numbers
 *             are colours.
 * Keeps       results, and sums over the views.
 * Degenerate  no view, or one: the weights by direction are 0 (then a is 0), so are their moments.
 */
#include "layers/ibrnet.h"
#include "autograd/kernels/vector_math.h"

#define EPSILON ((lf_real)1e-8) /* of the sums of weights, as published */

LF_INLINE lf_vec at(const lf_real *x, long row)
{
    return lf_vec_load(x + row * LF_LANES);
}

LF_INLINE void put(lf_real *x, long row, lf_vec v)
{
    lf_vec_store(x + row * LF_LANES, v);
}

LF_INLINE void add(lf_real *x, long row, lf_vec v)
{
    put(x, row, at(x, row) + v);
}

static void require_rows(const char *op, const lf_tensor *x, long channels, const lf_lanes *lanes)
{
    LF_REQUIRE(x->rank == 3 && x->dim[0] == lanes->rows && x->dim[1] == channels &&
                   x->dim[2] == LF_LANES,
               "%s: %ld numbers for %ld rows of %ld channels", op, x->size, lanes->rows, channels);
}

/* w = a / (sum over the views of a + epsilon), the rows [first, last); in place or not. */
static void normalise(long first, long last, const lf_real *a, lf_real *w)
{
    lf_vec sum = lf_vec_all(EPSILON);
    for (long r = first; r < last; r++)
        sum += at(a, r);
    for (long r = first; r < last; r++)
        put(w, r, at(a, r) / sum);
}

/* sum over the rows of a b */
static lf_vec inner(long first, long last, const lf_real *a, const lf_real *b)
{
    lf_vec sum = {0};
    for (long r = first; r < last; r++)
        sum += at(a, r) * at(b, r);
    return sum;
}

/* ---- weights by direction ----------------------------------------------------------------------
 */

/* e - e_least of a row, not as a difference: views often look along nearly the same direction. */
LF_INLINE lf_vec above_least(lf_real size, lf_vec behind, lf_vec least)
{
    return -lf_vec_exp(size * behind) * lf_vec_expm1(size * (least - behind));
}

/* 1 / (1 - e^-z) - 1 / z for z >= 0: from 1/2 to 1. */
LF_INLINE lf_vec bend(lf_vec z)
{
    const lf_vec y = z * z;
    const lf_vec series =
        (lf_real)0.5 + z * ((lf_real)(1.0 / 12) -
                            y * ((lf_real)(1.0 / 720) - y * ((lf_real)(1.0 / 30240) -
                                                             y * ((lf_real)(1.0 / 1209600) -
                                                                  y * (lf_real)(1.0 / 47900160)))));
    const lf_vec few = lf_vec_all((lf_real)0.25), large = lf_vec_max(z, few);
    return lf_vec_select(z < few, series, -1 / lf_vec_expm1(-large) - 1 / large);
}

/* (x - x_least) bend(|s| (x - x_least)) of a row. What else there is of its d log a / d|s|, x_least
 * + 1 / |s|, is that of all views and cancels but for the epsilon. */
LF_INLINE lf_vec own_slope(const lf_lanes *lanes, long row, lf_real size, lf_vec least)
{
    const lf_vec apart = at(lanes->behind->value, row) - least;
    return apart * bend(size * apart);
}

static lf_vec weights_back(const lf_lanes *lanes, long b, lf_real size, const lf_real *w,
                           const lf_real *dw)
{
    const long first = lanes->first[b], last = lanes->first[b + 1];
    const lf_vec least = at(lanes->furthest->value, b), pull = inner(first, last, w, dw);
    lf_vec sum = lf_vec_all(EPSILON), mean = {0}, ds = {0};
    for (long r = first; r < last; r++) {
        const lf_vec behind = at(lanes->behind->value, r);
        sum += at(lanes->mask->value, r) * above_least(size, behind, least);
        mean += at(w, r) * own_slope(lanes, r, size, least);
    }
    for (long r = first; r < last; r++)
        ds += at(w, r) * (at(dw, r) - pull) * (own_slope(lanes, r, size, least) - mean);
    return ds + (mean + least + 1 / size) * (EPSILON / sum) * pull;
}

static void weights_backward(const lf_node *node)
{
    const lf_lanes *lanes = node->saved;
    lf_tensor *s = node->in[0];
    const lf_real size = LF_FABS(s->value[0]);
    lf_vec ds = {0};
    for (long b = 0; size > 0 && b < lanes->blocks; b++)
        ds += weights_back(lanes, b, size, node->out[0]->value, node->out[0]->grad);
    s->grad[0] += s->value[0] < 0 ? -lf_vec_total(ds) : lf_vec_total(ds);
}

lf_tensor *lf_ibrnet_weights(lf_tape *tape, lf_tensor *s, const lf_lanes *lanes)
{
    LF_REQUIRE(s->size == 1 && lanes->difference, "lf_ibrnet_weights: s of %ld%s", s->size,
               lanes->difference ? "" : ", lanes without differences");
    lf_tensor *w = lf_tensor_new(tape, 3, LF_DIMS(lanes->rows, 1, LF_LANES));
    const lf_real size = LF_FABS(s->value[0]);
    for (long b = 0; b < lanes->blocks; b++) {
        const lf_vec least = at(lanes->furthest->value, b);
        for (long r = lanes->first[b]; r < lanes->first[b + 1]; r++)
            put(w->value, r,
                at(lanes->mask->value, r) * above_least(size, at(lanes->behind->value, r), least));
        normalise(lanes->first[b], lanes->first[b + 1], w->value, w->value);
    }
    lf_record(tape, "ibrnet_weights", weights_backward, lf_lanes_keep(tape, lanes), LF_IN(s),
              LF_OUT(w));
    return w;
}

lf_tensor *lf_ibrnet_even_weights(lf_tape *tape, const lf_lanes *lanes)
{
    lf_tensor *w = lf_tensor_new(tape, 3, LF_DIMS(lanes->rows, 1, LF_LANES));
    for (long b = 0; b < lanes->blocks; b++)
        normalise(lanes->first[b], lanes->first[b + 1], lanes->mask->value, w->value);
    return w;
}

/* ---- moments -----------------------------------------------------------------------------------
 */

typedef struct moments {
    lf_lanes lanes;
    bool mean_weight;
} moments;

static void moments_block(const moments *t, long b, const lf_tensor *x, const lf_real *w,
                          lf_tensor *y)
{
    const long first = t->lanes.first[b], last = t->lanes.first[b + 1], d = x->dim[1];
    lf_real *to = y->value + b * y->dim[1] * LF_LANES;
    for (long c = 0; c < d; c++) {
        lf_vec mean = {0}, variance = {0};
        for (long r = first; r < last; r++)
            mean += at(w, r) * at(x->value, r * d + c);
        for (long r = first; r < last; r++) {
            const lf_vec from_mean = at(x->value, r * d + c) - mean;
            variance += at(w, r) * from_mean * from_mean;
        }
        put(to, c, mean);
        put(to, d + c, variance);
    }
    if (!t->mean_weight)
        return;
    lf_vec sum = {0};
    for (long r = first; r < last; r++)
        sum += at(w, r);
    put(to, 2 * d, sum / (lf_real)t->lanes.views);
}

/* dw of the rows from the channels starts at d(mean weight) / V. */
static void moments_back(const moments *t, long b, const lf_tensor *x, const lf_tensor *w,
                         const lf_tensor *y)
{
    const long first = t->lanes.first[b], last = t->lanes.first[b + 1], d = x->dim[1];
    const lf_real *mean = y->value + b * y->dim[1] * LF_LANES;
    const lf_real *dy = y->grad + b * y->dim[1] * LF_LANES;
    lf_vec rest = lf_vec_all(1), share = {0};
    for (long r = first; r < last; r++)
        rest -= at(w->value, r);
    if (t->mean_weight)
        share = at(dy, 2 * d) / (lf_real)t->lanes.views;
    for (long r = first; r < last; r++) {
        const lf_vec weight = at(w->value, r);
        lf_vec dw = share;
        for (long c = 0; c < d; c++) {
            const lf_vec m = at(mean, c), value = at(x->value, r * d + c), h = value - m;
            const lf_vec dvariance = at(dy, d + c), g = at(dy, c) - 2 * dvariance * m * rest;
            dw += value * g + h * h * dvariance;
            if (x->grad)
                add(x->grad, r * d + c, weight * (g + 2 * dvariance * h));
        }
        if (w->grad)
            add(w->grad, r, dw);
    }
}

static void moments_backward(const lf_node *node)
{
    const moments *t = node->saved;
    for (long b = 0; b < t->lanes.blocks; b++)
        moments_back(t, b, node->in[0], node->in[1], node->out[0]);
}

lf_tensor *lf_ibrnet_moments(lf_tape *tape, lf_tensor *x, lf_tensor *w, const lf_lanes *lanes,
                             bool mean_weight)
{
    require_rows("lf_ibrnet_moments: x", x, x->dim[1], lanes);
    require_rows("lf_ibrnet_moments: w", w, 1, lanes);
    const long d = x->dim[1];
    lf_tensor *y = lf_tensor_new(tape, 3, LF_DIMS(lanes->blocks, 2 * d + mean_weight, LF_LANES));
    moments *t = lf_alloc(tape, sizeof *t);
    *t = (moments){*lanes, mean_weight};
    for (long b = 0; b < lanes->blocks; b++)
        moments_block(t, b, x, w->value, y);
    if (lf_profiled(tape)) { /* w x, h^2 and w h^2, h = x - mean; back twice that */
        const double pairs = lf_present(lanes->mask->size, lanes->mask->value);
        const double products = 3 * pairs * (double)d;
        lf_products_of(tape, products, x, w);
    }
    lf_record(tape, "ibrnet_moments", moments_backward, t, LF_IN(x, w), LF_OUT(y));
    return y;
}

/* ---- residual and first visibility -------------------------------------------------------------
 */

static void residual_backward(const lf_node *node)
{
    const lf_real *mask = node->saved;
    const lf_tensor *x = node->in[0], *r = node->in[1], *z = node->out[0], *y = node->out[1];
    const long d = x->dim[1];
    for (long row = 0; row < x->dim[0]; row++) {
        const lf_vec seen = at(mask, row), s = lf_vec_sigmoid(at(r->value, row * (d + 1) + d));
        lf_vec sum = {0};
        for (long c = 0; c < d; c++) {
            const lf_vec dy = at(y->grad, row * d + c);
            const lf_vec dz = at(z->grad, row * d + c) + seen * s * dy;
            sum += dy * at(z->value, row * d + c);
            if (x->grad)
                add(x->grad, row * d + c, dz);
            if (r->grad)
                add(r->grad, row * (d + 1) + c, dz);
        }
        if (r->grad)
            add(r->grad, row * (d + 1) + d, sum * seen * s * (1 - s));
    }
}

lf_ibrnet_residual lf_ibrnet_residual_apply(lf_tape *tape, lf_tensor *x, lf_tensor *r,
                                            const lf_lanes *lanes)
{
    const long d = x->dim[1];
    require_rows("lf_ibrnet_residual_apply: x", x, d, lanes);
    require_rows("lf_ibrnet_residual_apply: r", r, d + 1, lanes);
    lf_ibrnet_residual out = {lf_tensor_like(tape, x), lf_tensor_like(tape, x)};
    for (long row = 0; row < lanes->rows; row++) {
        const lf_vec seen =
            at(lanes->mask->value, row) * lf_vec_sigmoid(at(r->value, row * (d + 1) + d));
        for (long c = 0; c < d; c++) {
            const lf_vec z = at(x->value, row * d + c) + at(r->value, row * (d + 1) + c);
            put(out.x->value, row * d + c, z);
            put(out.visible->value, row * d + c, seen * z);
        }
    }
    lf_record(tape, "ibrnet_residual", residual_backward, lanes->mask->value, LF_IN(x, r),
              LF_OUT(out.x, out.visible));
    return out;
}

/* ---- second visibility -------------------------------------------------------------------------
 */

static void visibility_backward(const lf_node *node)
{
    const lf_lanes *lanes = node->saved;
    const lf_tensor *t = node->in[0], *u = node->out[0], *w = node->out[1];
    for (long b = 0; b < lanes->blocks; b++) {
        const long first = lanes->first[b], last = lanes->first[b + 1];
        const lf_vec pull = inner(first, last, w->value, w->grad);
        lf_vec sum = lf_vec_all(EPSILON);
        for (long r = first; r < last; r++)
            sum += at(u->value, r);
        for (long r = first; r < last; r++) {
            const lf_vec s = at(u->value, r); /* 0 where masked */
            add(t->grad, r, (at(u->grad, r) + (at(w->grad, r) - pull) / sum) * s * (1 - s));
        }
    }
}

lf_ibrnet_visibility lf_ibrnet_visibility_apply(lf_tape *tape, lf_tensor *t, const lf_lanes *lanes)
{
    require_rows("lf_ibrnet_visibility_apply: t", t, 1, lanes);
    lf_ibrnet_visibility out = {lf_tensor_like(tape, t), lf_tensor_like(tape, t)};
    for (long r = 0; r < lanes->rows; r++)
        put(out.visibility->value, r, at(lanes->mask->value, r) * lf_vec_sigmoid(at(t->value, r)));
    for (long b = 0; b < lanes->blocks; b++)
        normalise(lanes->first[b], lanes->first[b + 1], out.visibility->value, out.weight->value);
    lf_record(tape, "ibrnet_visibility", visibility_backward, lf_lanes_keep(tape, lanes), LF_IN(t),
              LF_OUT(out.visibility, out.weight));
    return out;
}

/* ---- colours -----------------------------------------------------------------------------------
 */

typedef struct colours {
    lf_lanes lanes;
    lf_real *share; /* [R, L] the softmax */
} colours;

static void softmax_views(const lf_lanes *lanes, long b, const lf_real *t, lf_real *p)
{
    const long first = lanes->first[b], last = lanes->first[b + 1];
    const lf_vec none = lf_vec_all(-INFINITY);
    lf_vec most = none, sum = {0};
    for (long r = first; r < last; r++) {
        const lf_vec x = lf_vec_select(at(lanes->mask->value, r) > 0, at(t, r), none);
        most = lf_vec_select(most > x, most, x); /* a NaN wins */
    }
    for (long r = first; r < last; r++) {
        const lf_vec e = lf_vec_exp(at(t, r) - most), zero = {0};
        put(p, r, lf_vec_select(at(lanes->mask->value, r) > 0, e, zero));
        sum += at(p, r);
    }
    sum = lf_vec_select(sum == 0, lf_vec_all(1), sum); /* else >= 1 */
    for (long r = first; r < last; r++)
        put(p, r, at(p, r) / sum);
}

/* For each point l of row r that its view sees: its features, colours first. */
static long features_of(const lf_lanes *lanes, long b, long r, long l, long c)
{
    return ((b * LF_LANES + l) * lanes->views + lanes->view[r]) * c;
}

/* dt += p (dp - sum p dp), of dp less that of the largest share (see heads.h), in place. */
static void softmax_views_backward(long first, long last, const lf_real *p, lf_real *dp,
                                   lf_real *dt)
{
    lf_vec largest = {0}, most = {0};
    for (long r = first; r < last; r++) {
        most = lf_vec_select(at(p, r) > largest, at(dp, r), most);
        largest = lf_vec_max(at(p, r), largest);
    }
    for (long r = first; r < last; r++)
        put(dp, r, at(dp, r) - most);
    const lf_vec pull = inner(first, last, p, dp);
    for (long r = first; r < last; r++)
        add(dt, r, at(p, r) * (at(dp, r) - pull));
}

static void colour_backward(const lf_node *node)
{
    const colours *k = node->saved;
    const lf_lanes *lanes = &k->lanes;
    const lf_tensor *t = node->in[0], *x = node->in[1];
    lf_real *dp = lf_alloc_reals(node->tape, t->size);
    memset(dp, 0, (size_t)t->size * sizeof *dp);
    for (long b = 0; b < lanes->blocks; b++) {
        const long first = lanes->first[b], last = lanes->first[b + 1];
        for (long r = first; r < last; r++)
            for (long l = 0; l < LF_LANES && b * LF_LANES + l < lanes->points; l++) {
                const long from = features_of(lanes, b, r, l, lf_cols(x));
                const lf_real *g = node->out[0]->grad + 3 * (b * LF_LANES + l);
                for (int i = 0; i < 3; i++) {
                    dp[r * LF_LANES + l] += g[i] * x->value[from + i];
                    if (x->grad)
                        x->grad[from + i] += g[i] * k->share[r * LF_LANES + l];
                }
            }
        if (t->grad)
            softmax_views_backward(first, last, k->share, dp, t->grad);
    }
}

lf_tensor *lf_ibrnet_colour(lf_tape *tape, lf_tensor *t, lf_tensor *x, const lf_lanes *lanes)
{
    require_rows("lf_ibrnet_colour: t", t, 1, lanes);
    LF_REQUIRE(lf_cols(x) >= 3 && lf_rows(x) == lanes->points * lanes->views,
               "lf_ibrnet_colour: %ld rows of %ld features", lf_rows(x), lf_cols(x));
    colours *k = lf_alloc(tape, sizeof *k);
    *k = (colours){*lanes, lf_alloc_reals(tape, t->size)};
    lf_tensor *y = lf_tensor_new(tape, 3, LF_DIMS(lanes->rays, lanes->samples, 3));
    memset(y->value, 0, (size_t)y->size * sizeof *y->value);
    for (long b = 0; b < lanes->blocks; b++) {
        softmax_views(lanes, b, t->value, k->share);
        for (long r = lanes->first[b]; r < lanes->first[b + 1]; r++)
            for (long l = 0; l < LF_LANES && b * LF_LANES + l < lanes->points; l++)
                for (int i = 0; i < 3; i++)
                    y->value[3 * (b * LF_LANES + l) + i] +=
                        k->share[r * LF_LANES + l] *
                        x->value[features_of(lanes, b, r, l, lf_cols(x)) + i];
    }
    lf_record(tape, "ibrnet_colour", colour_backward, k, LF_IN(t, x), LF_OUT(y));
    return y;
}
