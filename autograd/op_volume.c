/* op_volume.c: feature volumes: slices beside each other for 3-D convolutions, trilinear samples.
 *                                                                                  [method.md 5d.2]
 *   slices   y[n, i, .., 3 channels] = [x[n, s i - 1] | x[n, s i] | x[n, s i + 1]], zero outside:
 *            a 3x3 convolution of y is a 3x3x3 convolution of x with zero padding 1, stride s
 *            along D
 *   sample   z[q] = sum over 8 voxels t of w_t x[n_q][t], trilinear at (x, y, z) of p_q, corners at
 *            -1/2 and 1/2; beyond them the border's value
 *   backward the adjoints; samples volume by volume, each volume's points in order: the same bits
 *            for any number of threads
 *
 * Shapes     x [N, D, H, W, C]; y [N ceil(D / s), H, W, 3 C]; p [Q, 3], n [Q], z [Q, C].
 * Keeps      p and n (the caller's, until backward).
 */
#include "autograd/ops_image.h"

/* ---- slices ---- */

static void slices_backward(const lf_node *node)
{
    const long stride = *(const long *)node->saved;
    lf_tensor *x = node->in[0];
    const lf_tensor *y = node->out[0];
    const long depth = x->dim[1], c = lf_cols(x), pixels = x->dim[2] * x->dim[3];
    const long out = (depth + stride - 1) / stride;
#pragma omp parallel for schedule(static)
    for (long n = 0; n < x->dim[0]; n++)
        for (long i = 0; i < out; i++)
            for (long k = 0; k < 3; k++) {
                const long d = stride * i + k - 1;
                if (d < 0 || d >= depth)
                    continue;
                lf_real *restrict to = x->grad + (n * depth + d) * pixels * c;
                const lf_real *from = y->grad + (n * out + i) * pixels * 3 * c + k * c;
                for (long p = 0; p < pixels; p++)
                    for (long a = 0; a < c; a++)
                        to[p * c + a] += from[p * 3 * c + a];
            }
}

lf_tensor *lf_volume_slices(lf_tape *tape, lf_tensor *x, long stride)
{
    LF_REQUIRE(x->rank == 5 && stride >= 1, "lf_volume_slices: rank %d, stride %ld", x->rank,
               stride);
    const long depth = x->dim[1], c = lf_cols(x), pixels = x->dim[2] * x->dim[3];
    const long out = (depth + stride - 1) / stride;
    lf_tensor *y = lf_tensor_new(tape, 4, LF_DIMS(x->dim[0] * out, x->dim[2], x->dim[3], 3 * c));
#pragma omp parallel for schedule(static)
    for (long s = 0; s < x->dim[0] * out; s++)
        for (long k = 0; k < 3; k++) {
            const long d = stride * (s % out) + k - 1;
            const lf_real *from = x->value + (s / out * depth + d) * pixels * c;
            lf_real *to = y->value + s * pixels * 3 * c + k * c;
            for (long p = 0; p < pixels; p++) {
                if (d < 0 || d >= depth)
                    memset(to + p * 3 * c, 0, (size_t)c * sizeof *to);
                else
                    memcpy(to + p * 3 * c, from + p * c, (size_t)c * sizeof *to);
            }
        }
    long *kept = lf_alloc(tape, sizeof *kept);
    *kept = stride;
    lf_record(tape, "volume_slices", slices_backward, kept, LF_IN(x), LF_OUT(y));
    return y;
}

/* ---- samples ---- */

typedef struct sampling {
    const double *position;
    const long *volume;
} sampling;

typedef struct voxels {
    long offset[8]; /* in numbers, from the start of the volume */
    lf_real weight[8];
} voxels;

static voxels locate(const lf_tensor *x, const double *p)
{
    const long size[3] = {x->dim[3], x->dim[2], x->dim[1]};
    const long step[3] = {lf_cols(x), lf_cols(x) * x->dim[3], lf_cols(x) * x->dim[3] * x->dim[2]};
    voxels t = {.weight = {1}};
    int count = 1;
    for (int a = 0; a < 3; a++) {
        const double last = (double)(size[a] - 1), at = (p[a] + 0.5) * last;
        const double inside = at > 0 ? (at < last ? at : last) : 0; /* NaN: 0, as a place */
        const long low = size[a] > 1 && inside >= last ? size[a] - 2 : (long)inside;
        const lf_real part = (lf_real)(inside - (double)low);
        for (int k = 0; k < count; k++) {
            t.offset[k] += low * step[a];
            t.offset[count + k] = t.offset[k] + (size[a] > 1 ? step[a] : 0);
            t.weight[count + k] = t.weight[k] * part;
            t.weight[k] *= 1 - part;
        }
        count *= 2;
    }
    return t;
}

static void sample_backward(const lf_node *node)
{
    const sampling *s = node->saved;
    lf_tensor *x = node->in[0];
    const lf_tensor *y = node->out[0];
    const long c = lf_cols(x), numbers = x->size / x->dim[0];
#pragma omp parallel for schedule(static)
    for (long n = 0; n < x->dim[0]; n++)
        for (long q = 0; q < y->dim[0]; q++) {
            if (s->volume[q] != n)
                continue;
            const voxels t = locate(x, s->position + 3 * q);
            for (int k = 0; k < 8; k++)
                for (long i = 0; i < c; i++)
                    x->grad[n * numbers + t.offset[k] + i] += t.weight[k] * y->grad[q * c + i];
        }
}

lf_tensor *lf_sample_volume(lf_tape *tape, lf_tensor *x, long points, const double *position,
                            const long *volume)
{
    LF_REQUIRE(x->rank == 5, "lf_sample_volume: rank %d", x->rank);
    const long c = lf_cols(x), numbers = x->size / x->dim[0];
    lf_tensor *y = lf_tensor_new(tape, 2, LF_DIMS(points, c));
    sampling *s = lf_alloc(tape, sizeof *s);
    *s = (sampling){position, volume};
#pragma omp parallel for schedule(static)
    for (long q = 0; q < points; q++) {
        const voxels t = locate(x, position + 3 * q);
        const lf_real *base = x->value + volume[q] * numbers;
        lf_real *restrict row = y->value + q * c;
        memset(row, 0, (size_t)c * sizeof *row);
        for (int k = 0; k < 8; k++)
            for (long i = 0; i < c; i++)
                row[i] += t.weight[k] * base[t.offset[k] + i];
    }
    lf_products(tape, 8 * (double)y->size, x->wants ? 8 * (double)y->size : 0);
    lf_record(tape, "sample_volume", sample_backward, s, LF_IN(x), LF_OUT(y));
    return y;
}
