/* baselines.c: see baselines.h.
 *
 * The point at depth z of the target's pixel p = (u, v, 1) lies in source k at the homogeneous
 * pixel h = z A_k p + b_k,   A_k = K_k R_k' R K^-1,   b_k = K_k R_k' (c - c_k),   K = (f 0 c; 0 0
 * 1), at h_0 / h_2, h_1 / h_2 and at depth h_2: two products a pixel and source, one sum a sample.
 */
#include "eval/baselines.h"
#include "eval/image_resize.h"

static const char *const names[LF_BASELINES] = {"copy", "mean", "sweep"};

const char *lf_baseline_name(lf_baseline kind)
{
    LF_REQUIRE(kind >= 0 && kind < LF_BASELINES, "lf_baseline_name: %d", (int)kind);
    return names[kind];
}

static lf_status check(const lf_baseline_views *v, lf_error *err)
{
    if (v->sources < 1 || v->samples < 1 || !(v->near > 0 && v->near < v->far && isfinite(v->far)))
        return lf_fail(err, LF_BAD_INPUT,
                       "baselines: %d sources, %d samples (1 at least), near %g, far %g (0 < near "
                       "< far)",
                       v->sources, v->samples, v->near, v->far);
    LF_TRY(lf_camera_check(&v->target, "baselines: the target", err));
    for (int k = 0; k < v->sources; k++) {
        LF_TRY(lf_camera_check(&v->camera[k], "baselines: a source", err));
        LF_REQUIRE(v->camera[k].width == v->pixels[k].width &&
                       v->camera[k].height == v->pixels[k].height,
                   "source %d: camera %d x %d, pixels %d x %d", k, v->camera[k].width,
                   v->camera[k].height, v->pixels[k].width, v->pixels[k].height);
    }
    return LF_OK;
}

/* ---- copy --------------------------------------------------------------------------------- */

static lf_image *copy_nearest(const lf_baseline_views *v)
{
    const lf_pixels *p = &v->pixels[0];
    lf_image *image = lf_image_create(p->width, p->height, 3);
    for (long i = 0; i < 3L * p->width * p->height; i++)
        image->pixel[i] = (float)p->rgb[i] / 255;
    lf_image *out = lf_image_resize(image, v->target.width, v->target.height);
    lf_image_free(image);
    return out;
}

/* ---- mean and sweep ----------------------------------------------------------------------- */

typedef struct warp {
    double a[9], b[3];
    const lf_pixels *pixels;
} warp;

/* x <- K x. */
static void apply_lens(const lf_camera *c, double x[3])
{
    x[0] = c->fx * x[0] + c->cx * x[2];
    x[1] = c->fy * x[1] + c->cy * x[2];
}

static warp make_warp(const lf_camera *target, const lf_camera *source, const lf_pixels *pixels)
{
    const double unit[3][3] = {{1 / target->fx, 0, 0},
                               {0, 1 / target->fy, 0},
                               {-target->cx / target->fx, -target->cy / target->fy, 1}};
    warp w = {.pixels = pixels};
    for (int j = 0; j < 3; j++) {
        double x[3]; /* column j of A */
        lf_rotation_apply(target->rotation, unit[j], x);
        lf_rotation_apply_transposed(source->rotation, x, x);
        apply_lens(source, x);
        for (int i = 0; i < 3; i++)
            w.a[3 * i + j] = x[i];
        w.b[j] = target->centre[j] - source->centre[j];
    }
    lf_rotation_apply_transposed(source->rotation, w.b, w.b);
    apply_lens(source, w.b);
    return w;
}

/* The colour at pixel (u, v), 0..1; false outside the picture. */
static bool look_up(const lf_pixels *p, double u, double v, double colour[3])
{
    const double slack = 1e-6, right = p->width - 1, bottom = p->height - 1;
    if (!(u >= -slack && v >= -slack && u <= right + slack && v <= bottom + slack))
        return false;
    u = fmin(fmax(u, 0), right);
    v = fmin(fmax(v, 0), bottom);
    const int i = (int)u, j = (int)v;
    const double a = u - i, b = v - j;
    const long across = i < p->width - 1 ? 3 : 0, down = j < p->height - 1 ? 3L * p->width : 0;
    const uint8_t *at = p->rgb + 3 * ((long)j * p->width + i);
    for (int c = 0; c < 3; c++)
        colour[c] = ((1 - b) * ((1 - a) * at[c] + a * at[c + across]) +
                     b * ((1 - a) * at[c + down] + a * at[c + down + across])) /
                    255;
    return true;
}

/* Colours of one point, added one by one (Welford). */
typedef struct spread {
    int count;
    double mean[3], squares; /* sum over channels of squared distances from the mean */
} spread;

static void spread_add(spread *s, const double colour[3])
{
    s->count++;
    for (int c = 0; c < 3; c++) {
        const double off = colour[c] - s->mean[c];
        s->mean[c] += off / s->count;
        s->squares += off * (colour[c] - s->mean[c]);
    }
}

/* What the sources see at depth z of a pixel; ray[k] = A_k p. */
static spread look(const lf_baseline_views *v, const warp *w, const double (*ray)[3], double z)
{
    spread s = {0};
    for (int k = 0; k < v->sources; k++) {
        const double depth = z * ray[k][2] + w[k].b[2];
        double colour[3];
        if (depth > 0 && look_up(w[k].pixels, (z * ray[k][0] + w[k].b[0]) / depth,
                                 (z * ray[k][1] + w[k].b[1]) / depth, colour))
            spread_add(&s, colour);
    }
    return s;
}

static void render_pixel(lf_baseline kind, const lf_baseline_views *v, const warp *w,
                         const double (*ray)[3], float out[3])
{
    double sum[3] = {0}, least = INFINITY;
    spread best = {0};
    long count = 0;
    for (int i = 0; i < v->samples; i++) {
        const double t = (i + 0.5) / v->samples;
        const spread s = look(v, w, ray, 1 / ((1 - t) / v->near + t / v->far));
        count += s.count;
        for (int c = 0; c < 3; c++)
            sum[c] += s.count * s.mean[c];
        if (s.count >= 2 && s.squares / s.count < least) {
            least = s.squares / s.count;
            best = s;
        }
    }
    const bool swept = kind == LF_BASELINE_SWEEP && best.count > 0;
    for (int c = 0; c < 3; c++)
        out[c] = !count ? v->ground : (float)(swept ? best.mean[c] : sum[c] / (double)count);
}

static void *room(int count, size_t size)
{
    void *p = malloc((size_t)count * size);
    LF_REQUIRE(p, "out of memory for %d times %zu bytes", count, size);
    return p;
}

static void render_row(lf_baseline kind, const lf_baseline_views *v, const warp *w, int row,
                       lf_image *out)
{
    double(*ray)[3] = room(v->sources, sizeof *ray);
    for (int column = 0; column < out->width; column++) {
        for (int k = 0; k < v->sources; k++)
            for (int i = 0; i < 3; i++)
                ray[k][i] = w[k].a[3 * i] * column + w[k].a[3 * i + 1] * row + w[k].a[3 * i + 2];
        render_pixel(kind, v, w, (const double(*)[3])ray, lf_image_at(out, column, row));
    }
    free(ray);
}

lf_status lf_baseline_render(lf_baseline kind, const lf_baseline_views *views, lf_image **out,
                             lf_error *err)
{
    LF_REQUIRE(kind >= 0 && kind < LF_BASELINES, "lf_baseline_render: %d", (int)kind);
    LF_TRY(check(views, err));
    if (kind == LF_BASELINE_COPY) {
        *out = copy_nearest(views);
        return LF_OK;
    }
    warp *w = room(views->sources, sizeof *w);
    for (int k = 0; k < views->sources; k++)
        w[k] = make_warp(&views->target, &views->camera[k], &views->pixels[k]);
    lf_image *image = lf_image_create(views->target.width, views->target.height, 3);
#pragma omp parallel for schedule(dynamic)
    for (int row = 0; row < image->height; row++)
        render_row(kind, views, w, row, image);
    free(w);
    *out = image;
    return LF_OK;
}
