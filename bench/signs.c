/* signs.c: elf-signs prints the sign errors of docs/figures.md: watertight shapes with faces
 * removed, by each method, against closed forms; and the built-in shapes against their exact inside
 * test.
 *
 * A sign counts where the true distance is above 0.001; points are half uniform in a cube of edge
 * 1.1 and half within 0.01 or 0.03 of the surface (normal offsets).
 */
#include <math.h>
#include <stdlib.h>

#include "autograd/random.h"
#include "datasets/procedural.h"
#include "datasets/sdf.h"

enum { POINTS = 40000, SHAPES = 40, SAMPLES = 16384 };

static const double low[3] = {-0.2, -0.3, -0.35}, high[3] = {0.2, 0.3, 0.35};

static double sphere(const double *p)
{
    return sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]) - 0.2886;
}

static double box(const double *p)
{
    double outside = 0, inside = -1;
    for (int a = 0; a < 3; a++) {
        const double q = fabs(p[a]) - high[a];
        outside += q > 0 ? q * q : 0;
        inside = fmax(inside, q);
    }
    return sqrt(outside) + fmin(inside, 0);
}

static double torus(const double *p)
{
    return hypot(hypot(p[0], p[2]) - 0.25, p[1]) - 0.1;
}

/* Every face cut into four at the middles of its edges. */
static lf_mesh *divide(lf_mesh *m)
{
    lf_mesh *q = lf_mesh_create(m->vertices + 3 * m->faces, 4 * m->faces);
    memcpy(q->vertex, m->vertex, (size_t)m->vertices * sizeof *q->vertex);
    for (long t = 0; t < m->faces; t++) {
        const int32_t *f = m->face[t], a = (int32_t)(m->vertices + 3 * t);
        for (int e = 0; e < 3; e++)
            for (int c = 0; c < 3; c++)
                q->vertex[a + e][c] = (m->vertex[f[e]][c] + m->vertex[f[(e + 1) % 3]][c]) / 2;
        const int32_t part[4][3] = {
            {f[0], a, a + 2}, {a, f[1], a + 1}, {a + 2, a + 1, f[2]}, {a, a + 1, a + 2}};
        memcpy(q->face[4 * t], part, sizeof part);
    }
    lf_mesh_free(m);
    return q;
}

static lf_mesh *without(const lf_mesh *mesh, double share)
{
    lf_mesh *out = lf_mesh_copy(mesh);
    long n = 0;
    for (long f = 0; f < mesh->faces; f++) {
        lf_stream s = lf_stream_at(3, LF_RANDOM_TEST, 0, (uint64_t)f);
        if (lf_uniform(&s) >= share)
            memcpy(out->face[n++], mesh->face[f], sizeof *out->face);
    }
    out->faces = n;
    return out;
}

static void draw(const lf_mesh *mesh, double (*p)[3])
{
    lf_error err = {""};
    const lf_status status =
        lf_mesh_sample_surface(mesh, POINTS / 2, 5, 0, p + POINTS / 2, NULL, &err);
    LF_REQUIRE(status == LF_OK, "%s", err.text);
    for (long i = 0; i < POINTS; i++) {
        lf_stream s = lf_stream_at(7, LF_RANDOM_TEST, 1, (uint64_t)i);
        const double sigma = lf_uniform(&s) < 0.5 ? 0.01 : 0.03;
        for (int a = 0; a < 3; a++)
            p[i][a] =
                i < POINTS / 2 ? 1.1 * (lf_uniform(&s) - 0.5) : p[i][a] + sigma * lf_normal(&s);
    }
}

static lf_sdf *open_sdf(const lf_mesh *mesh, lf_sdf_method method)
{
    lf_sdf_options options = lf_sdf_defaults();
    lf_sdf *sdf = NULL;
    lf_error err = {""};
    options.method = method;
    const lf_status status = lf_sdf_open(mesh, &options, &sdf, &err);
    LF_REQUIRE(status == LF_OK, "%s", err.text);
    return sdf;
}

/* Percent of wrong signs among the uniform and the near points. */
static void print_errors(const lf_mesh *mesh, lf_sdf_method method, const double (*p)[3],
                         double (*form)(const double *))
{
    double *value = malloc(POINTS * sizeof *value);
    LF_REQUIRE(value, "out of memory for %d values", POINTS);
    long wrong[2] = {0}, all[2] = {0};
    lf_sdf *sdf = open_sdf(mesh, method);
    lf_sdf_eval(sdf, POINTS, p, value, NULL);
    for (long i = 0; i < POINTS; i++) {
        const double d = form(p[i]);
        const int near = i >= POINTS / 2;
        all[near] += fabs(d) > 0.001;
        wrong[near] += fabs(d) > 0.001 && (d < 0) != (value[i] < 0);
    }
    printf("  %6.3f / %6.3f", 100.0 * (double)wrong[0] / (double)all[0],
           100.0 * (double)wrong[1] / (double)all[1]);
    lf_sdf_close(sdf);
    free(value);
}

static void print_holes(const char *name, lf_mesh *mesh, double (*form)(const double *))
{
    static const double share[] = {0, 0.05, 0.1, 0.2, 0.3};
    double(*p)[3] = malloc(POINTS * sizeof *p);
    LF_REQUIRE(p, "out of memory for %d points", POINTS);
    draw(mesh, p);
    for (int k = 0; k < 5; k++) {
        lf_mesh *holed = without(mesh, share[k]);
        printf("%-8s %3.0f %%", name, 100 * share[k]);
        print_errors(holed, LF_SDF_COMBINED, (const double(*)[3])p, form);
        print_errors(holed, LF_SDF_WINDING, (const double(*)[3])p, form);
        print_errors(holed, LF_SDF_ESCAPE, (const double(*)[3])p, form);
        printf("\n");
        lf_mesh_free(holed);
    }
    free(p);
    lf_mesh_free(mesh);
}

static void print_builtin(const char *family)
{
    float(*sample)[4] = malloc(SAMPLES * sizeof *sample);
    LF_REQUIRE(sample, "out of memory for %d samples", SAMPLES);
    long wrong = 0, all = 0;
    for (uint64_t i = 0; i < SHAPES; i++) {
        lf_mesh *mesh = NULL;
        lf_parts parts;
        lf_error err = {""};
        const lf_status status = lf_procedural_mesh(family, 1, i, &mesh, &parts, &err);
        LF_REQUIRE(status == LF_OK, "%s", err.text);
        lf_sdf *sdf = open_sdf(mesh, LF_SDF_COMBINED);
        lf_sdf_samples(sdf, SAMPLES / 2, SAMPLES / 2, 1, i, sample, NULL);
        for (long k = 0; k < SAMPLES; k += 4) {
            const double p[3] = {(double)sample[k][0], (double)sample[k][1], (double)sample[k][2]};
            if (fabsf(sample[k][3]) < 0.001f)
                continue;
            all++;
            wrong += (sample[k][3] < 0) != lf_procedural_inside(mesh, &parts, p);
        }
        lf_sdf_close(sdf);
        lf_mesh_free(mesh);
    }
    free(sample);
    printf("%-8s %.4f %% of %ld points\n", family, 100.0 * (double)wrong / (double)all, all);
}

int main(void)
{
    static const double zero[3] = {0, 0, 0};
    printf("wrong signs in %%, uniform / near\nshape  removed  combined         winding          "
           "escape\n");
    print_holes("sphere", lf_mesh_sphere(3, 0.2886, zero), sphere);
    print_holes("box", divide(divide(divide(lf_mesh_box(low, high)))), box);
    print_holes("torus", lf_mesh_torus(0.25, 0.1, 48, 20), torus);
    printf("\nbuilt-in shapes, wrong signs against the exact inside test\n");
    print_builtin("chair");
    print_builtin("airplane");
    print_builtin("car");
    return 0;
}
