/* scene_make_paint.c: colour of a point of a built-in scene.          [scene_make.h has formulas]
 */
#include "datasets/scene_make_internal.h"

static const double pi = 3.14159265358979323846;
static const double wave_frequency = 7, wave_amplitude = 0.16;
static const double ambient = 0.5, from_above = 0.1, lambert = 0.45, exponent = 24;

lf_paint lf_paint_random(lf_stream *stream, double scale, double strength)
{
    lf_paint p;
    p.mix = 0.3 + 0.4 * lf_uniform(stream);
    for (int c = 0; c < 3; c++)
        p.tint[c] = 0.15 + 0.8 * lf_uniform(stream);
    for (int j = 0; j < LF_WAVES; j++) {
        p.phase[j] = lf_uniform(stream);
        for (int c = 0; c < 3; c++) {
            p.wave[c][j] = scale * wave_frequency / (2 * pi) * lf_normal(stream);
            p.amplitude[c][j] = strength * wave_amplitude * lf_normal(stream);
        }
    }
    return p;
}

/* sin(2 pi t) to 6e-8: t brought to [-1/4, 1/4], where Taylor's polynomial is taken. A loop over it
 * vectorises, which one over libm's sin does not. */
static inline double sine(double t)
{
    const double r = t - rint(t), mirror = copysign(0.5, r) - r;
    const double x = 2 * pi * (fabs(r) > 0.25 ? mirror : r), y = x * x;
    return x * (1 - y / 6 * (1 - y / 20 * (1 - y / 42 * (1 - y / 72 * (1 - y / 110)))));
}

static void albedo_of(const lf_paint *p, const float face[3], const double x[3], double out[3])
{
    double s[LF_WAVES];
    for (int j = 0; j < LF_WAVES; j++)
        s[j] =
            sine(p->wave[0][j] * x[0] + p->wave[1][j] * x[1] + p->wave[2][j] * x[2] + p->phase[j]);
    for (int c = 0; c < 3; c++) {
        double sum = (1 - p->mix) * (double)face[c] + p->mix * p->tint[c];
        for (int j = 0; j < LF_WAVES; j++)
            sum += p->amplitude[c][j] * s[j];
        out[c] = fmin(0.97, fmax(0.05, sum));
    }
}

static const lf_paint *paint_of(const lf_world *w, long face)
{
    int i = 0;
    while (i < w->paints - 1 && face >= w->first[i + 1])
        i++;
    return &w->paint[i];
}

void lf_world_shade(const void *world, const lf_hit *hit, const double point[3],
                    const double direction[3], double *sum)
{
    const lf_world *w = world;
    double albedo[3], n[3], nv = 0, nl = 0, rv = 0;
    for (int i = 0; i < 3; i++)
        nv -= hit->normal[i] * direction[i];
    for (int i = 0; i < 3; i++) {
        n[i] = nv < 0 ? -hit->normal[i] : hit->normal[i];
        nl += n[i] * w->light[i];
    }
    for (int i = 0; i < 3; i++)
        rv -= (2 * nl * n[i] - w->light[i]) * direction[i];
    const double shade = ambient + from_above * n[2] + lambert * fmax(0, nl);
    const double lobe = w->highlight > 0 && nl > 0 && rv > 0 ? w->highlight * pow(rv, exponent) : 0;
    albedo_of(paint_of(w, hit->face), lf_surface_mesh(w->surface)->colour[hit->face], point,
              albedo);
    for (int c = 0; c < 3; c++)
        sum[c] += fmin(1, shade * albedo[c] + lobe);
    sum[3] += 1;
}
