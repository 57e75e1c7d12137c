/* test_volume.c: feature volumes against their definitions: a 3-D convolution, trilinear samples.
 *                                                                                 [method.md 5d.2]
 */
#include "autograd/ops_image.h"
#include "autograd/random.h"
#include "tests/close.h"

#define EXACT (sizeof(lf_real) == 8)
enum { N = 2, D = 5, H = 4, W = 3, C = 2, OUT = 3 };

static lf_tensor *random_tensor(lf_tape *tape, int rank, const long *dim, uint64_t item)
{
    lf_tensor *x = lf_tensor_new(tape, rank, dim);
    lf_stream s = lf_stream_at(1, LF_RANDOM_TEST, 0, item);
    for (long i = 0; i < x->size; i++)
        x->value[i] = (lf_real)lf_normal(&s);
    return x;
}

static double voxel(const lf_tensor *x, long n, long d, long h, long w, long c)
{
    if (d < 0 || d >= D || h < 0 || h >= H || w < 0 || w >= W)
        return 0;
    return (double)x->value[(((n * D + d) * H + h) * W + w) * C + c];
}

/* sum over (k, i, j, c) of x[n, s d + k - 1, s h + i - 1, s w + j - 1, c] weight[i, j, (k, c), o]
 */
static double convolved(const lf_tensor *x, const lf_tensor *weight, const long at[4], long stride,
                        long o)
{
    double sum = 0;
    for (long k = 0; k < 3; k++)
        for (long i = 0; i < 3; i++)
            for (long j = 0; j < 3; j++)
                for (long c = 0; c < C; c++)
                    sum += voxel(x, at[0], stride * at[1] + k - 1, stride * at[2] + i - 1,
                                 stride * at[3] + j - 1, c) *
                           (double)weight->value[((i * 3 + j) * 3 * C + k * C + c) * OUT + o];
    return sum;
}

static void slices_make_a_3d_convolution(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    lf_tensor *x = random_tensor(tape, 5, LF_DIMS(N, D, H, W, C), 0);
    lf_tensor *weight = random_tensor(tape, 4, LF_DIMS(3, 3, 3 * C, OUT), 1);
    for (long stride = 1; stride <= 2; stride++) {
        lf_tensor *slices = lf_volume_slices(tape, x, stride);
        const lf_tensor *y = lf_conv2d(tape, slices, weight, NULL, stride, 1, LF_IDENTITY);
        const long d = (D + stride - 1) / stride, h = y->dim[1], w = y->dim[2];
        assert_int_equal(y->dim[0], N * d);
        for (long i = 0; i < y->size; i++) {
            const long o = i % OUT, p = i / OUT;
            const long at[4] = {p / w / h / d, p / w / h % d, p / w % h, p % w};
            assert_close(y->value[i], convolved(x, weight, at, stride, o), EXACT ? 1e-12 : 1e-5,
                         EXACT ? 1e-12 : 1e-4);
        }
    }
    lf_tape_free(tape);
}

/* A volume that is linear in the place, and its product, is sampled exactly; outside, the border.
 */
static void samples_of_a_multilinear_volume_are_exact(void **state)
{
    (void)state;
    lf_tape *tape = lf_tape_create();
    lf_tensor *x = lf_tensor_new(tape, 5, LF_DIMS(N, D, H, W, C));
    for (long i = 0; i < x->size / C; i++) {
        const double at[3] = {(double)(i % W) / (W - 1) - 0.5, (double)(i / W % H) / (H - 1) - 0.5,
                              (double)(i / W / H % D) / (D - 1) - 0.5};
        const double n = (double)(i / W / H / D);
        x->value[C * i] = (lf_real)(1 + n + at[0] - 2 * at[1] + 3 * at[2]);
        x->value[C * i + 1] = (lf_real)(n - at[0] * at[1] * at[2]);
    }
    enum { POINTS = 40 };
    double position[3 * POINTS];
    long volume[POINTS];
    lf_stream s = lf_stream_at(2, LF_RANDOM_TEST, 0, 0);
    for (long q = 0; q < POINTS; q++) {
        volume[q] = lf_index(&s, N);
        for (int a = 0; a < 3; a++)
            position[3 * q + a] = q < 2 ? (q ? 0.5 : -0.5) : 1.3 * (lf_uniform(&s) - 0.5);
    }
    const lf_tensor *y = lf_sample_volume(tape, x, POINTS, position, volume);
    for (long q = 0; q < POINTS; q++) {
        double at[3];
        for (int a = 0; a < 3; a++)
            at[a] = fmin(fmax(position[3 * q + a], -0.5), 0.5);
        const double n = (double)volume[q];
        assert_close(y->value[C * q], 1 + n + at[0] - 2 * at[1] + 3 * at[2], 0,
                     EXACT ? 1e-14 : 1e-5);
        assert_close(y->value[C * q + 1], n - at[0] * at[1] * at[2], 0, EXACT ? 1e-14 : 1e-5);
    }
    lf_tape_free(tape);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(slices_make_a_3d_convolution),
        cmocka_unit_test(samples_of_a_multilinear_volume_are_exact),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
