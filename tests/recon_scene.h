/* recon_scene.h: random images and points for the tests of whole reconstruction models, and what
 * one does with them: predict, step, roll, compare gradients with differences.
 */
#ifndef LF_TESTS_RECON_SCENE_H
#define LF_TESTS_RECON_SCENE_H

#include "datasets/projection.h"
#include "models/recon_work.h"
#include "tests/recon_net.h"

enum { V = LF_CUBE_VIEWS, Q = 40, SIZE = 33, CHANNELS = 2, PIXELS = V * SIZE * SIZE * CHANNELS };
#define EXACT (sizeof(lf_real) == 8) /* the double build */

typedef struct scene {
    lf_shape_views views; /* cameras; the object is not turned */
    double point[Q][3];
    float sdf[Q];
    lf_real image[PIXELS];
} scene;

static inline scene *make_scene(void)
{
    scene *s = calloc(1, sizeof *s);
    assert_non_null(s);
    lf_camera_cube(SIZE, s->views.camera);
    lf_rotation_identity(s->views.object);
    lf_stream r = lf_stream_at(4, LF_RANDOM_TEST, 0, 0);
    for (int q = 0; q < Q; q++) {
        for (int a = 0; a < 3; a++)
            s->point[q][a] = 0.57 * (lf_uniform(&r) - 0.5);
        s->sdf[q] = (float)(0.2 * (lf_uniform(&r) - 0.5));
    }
    for (int i = 0; i < PIXELS; i++)
        s->image[i] = (lf_real)lf_uniform(&r);
    return s;
}

static inline lf_recon_points points_of(const lf_projection *p, long count)
{
    return (lf_recon_points){count,   V,        p->uv,       p->direction, p->distance,
                             p->mask, p->first, p->position, p->bearing};
}

/* How the views of a scene see its points, and the grid of a model that has one. */
typedef struct sight {
    lf_projection projection, on_grid;
    lf_recon_points points, grid;
    lf_recon_images images;
} sight;

static inline void open_sight(sight *t, const lf_recon *model, const scene *s)
{
    const long n = model->grid * model->grid * model->grid;
    *t = (sight){.projection = lf_projection_create(Q)};
    lf_projection_fill(&t->projection, 0, Q, s->point, &s->views, 0);
    t->points = points_of(&t->projection, Q);
    t->images = (lf_recon_images){V, V, s->image, n > 0 ? &t->grid : NULL};
    if (n == 0)
        return;
    double(*point)[3] = calloc((size_t)n, sizeof *point);
    assert_non_null(point);
    lf_recon_grid(model, point);
    t->on_grid = lf_projection_create(n);
    lf_projection_fill(&t->on_grid, 0, n, (const double(*)[3])point, &s->views, 0);
    t->grid = points_of(&t->on_grid, n);
    free(point);
}

static inline void close_sight(sight *t)
{
    lf_projection_free(&t->projection);
    lf_projection_free(&t->on_grid);
}

/* 10 times the distance at every point, all on one tape. */
static inline lf_tensor *forward(lf_tape *tape, const lf_recon *model, const sight *t,
                                 bool training)
{
    lf_tensor *x = lf_leaf(tape, 4, LF_DIMS(V, SIZE, SIZE, CHANNELS),
                           (lf_real *)(uintptr_t)t->images.pixel, NULL); /* only read */
    lf_recon_code code;
    lf_recon_encode_images(tape, model, x, V, t->images.grid, training, &code);
    const lf_recon_inputs in = lf_recon_look(tape, model, &code, &t->points);
    return lf_recon_sdf(tape, model, &in, NULL);
}

static inline void distances(const net *n, const scene *s, double out[Q])
{
    lf_tape *tape = lf_tape_create();
    lf_tape_set_grad(tape, false);
    sight t;
    open_sight(&t, &n->model, s);
    for (long i = 0; i < Q * V; i++)
        assert_int_equal(t.points.mask[i], 1);
    const lf_tensor *x = forward(tape, &n->model, &t, false);
    for (int q = 0; q < Q; q++)
        out[q] = (double)x->value[q];
    close_sight(&t);
    lf_tape_free(tape);
}

/* Largest change of the predictions, relative to the largest of them. */
static inline double change(const net *n, const scene *from, const scene *to)
{
    double before[Q], after[Q];
    distances(n, from, before);
    distances(n, to, after);
    return relative_error(after, before, Q);
}

/* ---- transformations ---- */

/* Cameras and points moved together. */
static inline void move(const scene *s, const lf_motion *g, scene *moved)
{
    *moved = *s;
    for (int v = 0; v < V; v++)
        moved->views.camera[v] = lf_camera_move(&s->views.camera[v], g);
    for (int q = 0; q < Q; q++)
        lf_motion_apply(g, s->point[q], moved->point[q]);
}

/* Camera v rolled by quarters[v] * 90 degrees, its image turned to match: a pixel of the rolled
 * camera at (column, row) was at (size - 1 - row, column), a quarter ago. */
static inline void roll(scene *s, const int quarters[V])
{
    enum { N = SIZE * SIZE * CHANNELS };
    lf_real *old = malloc(N * sizeof *old);
    assert_non_null(old);
    for (int v = 0; v < V; v++) {
        lf_real *image = s->image + v * N;
        s->views.camera[v] = lf_camera_roll(&s->views.camera[v], quarters[v] * acos(-1) / 2);
        for (int k = 0; k < quarters[v]; k++) {
            memcpy(old, image, N * sizeof *old);
            for (int row = 0; row < SIZE; row++)
                for (int column = 0; column < SIZE; column++)
                    for (int c = 0; c < CHANNELS; c++)
                        image[(row * SIZE + column) * CHANNELS + c] =
                            old[(column * SIZE + SIZE - 1 - row) * CHANNELS + c];
        }
    }
    free(old);
}

/* ---- steps ---- */

static const lf_sdf_loss_config loss_config = {10, 0.1, 0.01, 4};

typedef struct stepped {
    double loss;
    lf_real *grad, *values; /* after the step: running statistics */
    long size;
} stepped;

static inline stepped step(net *n, const scene *s, long tile)
{
    stepped r = {.size = lf_store_size(n->store)};
    const size_t bytes = (size_t)r.size * sizeof(lf_real);
    lf_real *before = malloc(bytes);
    r.grad = malloc(bytes);
    r.values = malloc(bytes);
    assert_true(before && r.grad && r.values);
    memcpy(before, lf_store_values(n->store), bytes);
    sight t;
    open_sight(&t, &n->model, s);
    lf_recon_work *work = lf_recon_work_create(&n->model, tile);
    r.loss = lf_recon_step(work, &t.images, &t.points, s->sdf, &loss_config);
    assert_true(lf_recon_work_bytes(work) > 0);
    memcpy(r.grad, lf_store_grads(n->store), bytes);
    memcpy(r.values, lf_store_values(n->store), bytes);
    memcpy(lf_store_values(n->store), before, bytes);
    lf_recon_work_free(work);
    close_sight(&t);
    free(before);
    return r;
}

static inline void free_step(stepped *r)
{
    free(r->grad);
    free(r->values);
}

/* Mean loss on one tape without tiles; with gradients if `backward`. */
static inline double plain_step(net *n, const scene *s, bool backward)
{
    lf_tape *tape = lf_tape_create();
    sight t;
    open_sight(&t, &n->model, s);
    lf_store_zero_grads(n->store);
    lf_tensor *x = forward(tape, &n->model, &t, true);
    lf_tensor *loss = lf_sdf_loss(tape, x, s->sdf, &loss_config);
    if (backward)
        lf_backward(tape, loss, (lf_real)(1.0 / Q));
    const double mean = (double)loss->value[0] / Q;
    close_sight(&t);
    lf_tape_free(tape);
    return mean;
}

/* Difference of `slope` from the derivative of the mean loss by one parameter: the least over three
 * steps, for a long one runs into the kinks of ReLU and a short one into rounding; `enough` ends
 * the search. */
static inline double slope_error(net *n, const scene *s, lf_real *x, double slope, double enough)
{
    const lf_real old = *x;
    double least = INFINITY;
    for (double h = 1e-5; h > 5e-8 && least > enough; h /= 10) {
        *x = old + (lf_real)h;
        const double up = plain_step(n, s, false);
        *x = old - (lf_real)h;
        const double down = plain_step(n, s, false);
        least = fmin(least, fabs((up - down) / (2 * h) - slope));
    }
    *x = old;
    return least;
}

static inline double largest(const lf_real *x, long n)
{
    double most = 0;
    for (long k = 0; k < n; k++)
        most = fmax(most, fabs((double)x[k]));
    return most;
}

/* A number of every array against central differences, relative to the array's largest gradient
 * or a hundredth of the model's, whichever is larger. */
static inline double gradient_defect(const char *more)
{
    net n;
    open_net(&n, more);
    scene *s = make_scene();
    stepped a = step(&n, s, 16);
    const double all = largest(a.grad, a.size);
    double worst = 0;
    for (int i = 0; i < lf_store_count(n.store); i++) {
        const lf_parameter *p = lf_store_at(n.store, i);
        const lf_real *grad = a.grad + p->offset;
        const double size = fmax(largest(grad, p->size), 0.01 * all);
        lf_stream r = lf_stream_at(2, LF_RANDOM_TEST, 6, (uint64_t)i);
        const long at = lf_index(&r, p->size);
        if (!p->trainable)
            continue;
        const double e =
            slope_error(&n, s, lf_values(p) + at, (double)grad[at], 1e-7 * size) / size;
        worst = e > worst || isnan(e) ? e : worst;
    }
    free_step(&a);
    free(s);
    close_net(&n);
    return worst;
}

#endif
