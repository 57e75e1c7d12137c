/* lpips_reference.c: LPIPS in plain loops.                                   [lpips_reference.h] */
#include <string.h>

#include "autograd/random.h"
#include "tests/close.h"
#include "tests/lpips_reference.h"

/* ---- networks as lists of what stands in torchvision's Sequential -----------------------------
 */

/* Convolutions: out channels > 0; pooling: 0; taps after the ReLU of a convolution. */
typedef struct part {
    int index, in, out, size, stride, pad, tap;
} part;

static const part alex_parts[] = {{0, 3, 64, 11, 4, 2, 1},   {2, 0, 0, 3, 2, 0, 0},
                                  {3, 64, 192, 5, 1, 2, 1},  {5, 0, 0, 3, 2, 0, 0},
                                  {6, 192, 384, 3, 1, 1, 1}, {8, 384, 256, 3, 1, 1, 1},
                                  {10, 256, 256, 3, 1, 1, 1}};
static const part vgg_parts[] = {
    {0, 3, 64, 3, 1, 1, 0},     {2, 64, 64, 3, 1, 1, 1},    {4, 0, 0, 2, 2, 0, 0},
    {5, 64, 128, 3, 1, 1, 0},   {7, 128, 128, 3, 1, 1, 1},  {9, 0, 0, 2, 2, 0, 0},
    {10, 128, 256, 3, 1, 1, 0}, {12, 256, 256, 3, 1, 1, 0}, {14, 256, 256, 3, 1, 1, 1},
    {16, 0, 0, 2, 2, 0, 0},     {17, 256, 512, 3, 1, 1, 0}, {19, 512, 512, 3, 1, 1, 0},
    {21, 512, 512, 3, 1, 1, 1}, {23, 0, 0, 2, 2, 0, 0},     {24, 512, 512, 3, 1, 1, 0},
    {26, 512, 512, 3, 1, 1, 0}, {28, 512, 512, 3, 1, 1, 1}};

typedef struct network {
    const part *parts;
    int count;
} network;

static network network_of(lf_lpips_net net)
{
    return net == LF_LPIPS_ALEX
               ? (network){alex_parts, (int)(sizeof alex_parts / sizeof *alex_parts)}
               : (network){vgg_parts, (int)(sizeof vgg_parts / sizeof *vgg_parts)};
}

/* ---- files of random weights ------------------------------------------------------------------
 */

/* Append mean + deviation * normal numbers. */
static float *add(weights *w, const char *name, int rank, const long *dim, double mean,
                  double deviation)
{
    const int k = w->count++;
    long n = 1;
    snprintf(w->name[k], sizeof w->name[k], "%s", name);
    w->array[k] = (lf_array){.name = w->name[k], .dtype = LF_F32, .rank = rank};
    for (int i = 0; i < rank; i++)
        n *= w->array[k].dim[i] = dim[i];
    float *x = malloc((size_t)n * sizeof *x);
    lf_stream s = lf_stream_at(9, LF_RANDOM_TEST, 1, (uint64_t)k);
    for (long i = 0; i < n; i++)
        x[i] = (float)(mean + deviation * lf_normal(&s));
    w->array[k].data = x;
    return x;
}

void random_weights(lf_lpips_net net, weights *w)
{
    const network n = network_of(net);
    int block = 0;
    *w = (weights){0};
    for (int k = 0; k < n.count; k++) {
        const part *p = &n.parts[k];
        char name[40];
        if (!p->out)
            continue;
        const long dim[] = {p->out, p->in, p->size, p->size};
        snprintf(name, sizeof name, "features.%d.weight", p->index);
        add(w, name, 4, dim, 0, sqrt(2.0 / (p->in * p->size * p->size)));
        snprintf(name, sizeof name, "features.%d.bias", p->index);
        add(w, name, 1, dim, 0, 0.1);
        if (!p->tap)
            continue;
        const long linear[] = {1, p->out, 1, 1};
        snprintf(name, sizeof name, "lin%d.model.1.weight", block++);
        float *x = add(w, name, 4, linear, 0, 1);
        for (int i = 0; i < p->out; i++)
            x[i] = fabsf(x[i]);
    }
}

lf_array *array_of(weights *w, const char *name)
{
    for (int k = 0; k < w->count; k++)
        if (strcmp(w->name[k], name) == 0)
            return &w->array[k];
    fail_msg("no array %s", name);
    return NULL;
}

void free_weights(weights *w)
{
    for (int k = 0; k < w->count; k++)
        free((void *)w->array[k].data);
}

void write_weights(const weights *w, const char *path)
{
    lf_error err = {""};
    if (lf_safetensors_write(path, w->array, w->count, NULL, 0, NULL, &err) != LF_OK)
        fail_msg("%s", err.text);
}

/* ---- the reference ----------------------------------------------------------------------------
 */

typedef struct map {
    int channels, height, width;
    double *value; /* [channels][height][width] */
} map;

static map new_map(int channels, int height, int width)
{
    return (map){channels, height, width,
                 calloc((size_t)channels * (size_t)height * (size_t)width, sizeof(double))};
}

/* out[o] += the plane `in` correlated with the filter w[size][size]. */
static void correlate(const part *p, const map *x, const double *in, const float *w, const map *y,
                      double *out)
{
    for (int i = 0; i < y->height; i++)
        for (int a = 0; a < p->size; a++) {
            const int row = i * p->stride + a - p->pad;
            if (row < 0 || row >= x->height)
                continue;
            for (int b = 0; b < p->size; b++)
                for (int j = 0; j < y->width; j++) {
                    const int column = j * p->stride + b - p->pad;
                    if (column >= 0 && column < x->width)
                        out[i * y->width + j] += w[a * p->size + b] * in[row * x->width + column];
                }
        }
}

static void convolve(const part *p, const map *x, const float *w, const float *bias, const map *y)
{
    const long plane = (long)y->height * y->width, from = (long)x->height * x->width;
    const long taps = (long)p->size * p->size;
    for (int o = 0; o < p->out; o++) {
        double *out = y->value + o * plane;
        for (int i = 0; i < p->in; i++)
            correlate(p, x, x->value + i * from, w + (o * p->in + i) * taps, y, out);
        for (long i = 0; i < plane; i++)
            out[i] = fmax(out[i] + bias[o], 0);
    }
}

static void pool(const part *p, const map *x, const map *y)
{
    for (int c = 0; c < y->channels; c++)
        for (int i = 0; i < y->height; i++)
            for (int j = 0; j < y->width; j++) {
                double most = -INFINITY;
                for (int k = 0; k < p->size * p->size; k++) {
                    const int row = i * p->stride + k / p->size;
                    const int column = j * p->stride + k % p->size;
                    most = fmax(most, x->value[(c * x->height + row) * x->width + column]);
                }
                y->value[(c * y->height + i) * y->width + j] = most;
            }
}

static map next_map(const part *p, const map *x, weights *w)
{
    const map y =
        new_map(p->out ? p->out : x->channels, (x->height + 2 * p->pad - p->size) / p->stride + 1,
                (x->width + 2 * p->pad - p->size) / p->stride + 1);
    char filter[40], bias[40];
    snprintf(filter, sizeof filter, "features.%d.weight", p->index);
    snprintf(bias, sizeof bias, "features.%d.bias", p->index);
    if (p->out)
        convolve(p, x, array_of(w, filter)->data, array_of(w, bias)->data, &y);
    else
        pool(p, x, &y);
    free(x->value);
    return y;
}

static map input_map(const lf_image *image)
{
    const double shift[] = {-.030, -.088, -.188}, scale[] = {.458, .448, .450};
    const map x = new_map(3, image->height, image->width);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < image->height * image->width; i++)
            x.value[c * image->height * image->width + i] =
                (2 * (double)image->pixel[3 * i + c] - 1 - shift[c]) / scale[c];
    return x;
}

static double compare_maps(const map *a, const map *b, const float *linear)
{
    const long plane = (long)a->height * a->width;
    double sum = 0;
    for (long i = 0; i < plane; i++) {
        double aa = 0, bb = 0;
        for (long c = 0; c < a->channels; c++) {
            aa += a->value[c * plane + i] * a->value[c * plane + i];
            bb += b->value[c * plane + i] * b->value[c * plane + i];
        }
        for (long c = 0; c < a->channels; c++)
            sum += linear[c] * pow(a->value[c * plane + i] / (sqrt(aa) + 1e-10) -
                                       b->value[c * plane + i] / (sqrt(bb) + 1e-10),
                                   2);
    }
    return sum / (double)plane;
}

double lpips_reference(lf_lpips_net net, weights *w, const lf_image *a, const lf_image *b)
{
    const network n = network_of(net);
    map x = input_map(a), y = input_map(b);
    double sum = 0;
    int block = 0;
    for (int k = 0; k < n.count; k++) {
        x = next_map(&n.parts[k], &x, w);
        y = next_map(&n.parts[k], &y, w);
        char name[40];
        snprintf(name, sizeof name, "lin%d.model.1.weight", block);
        block += n.parts[k].tap;
        if (n.parts[k].tap)
            sum += compare_maps(&x, &y, array_of(w, name)->data);
    }
    free(x.value);
    free(y.value);
    return sum;
}
