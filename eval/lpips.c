/* lpips.c: LPIPS v0.1.                                                                 [lpips.h]
 *
 * Both images run as a batch of two. The layers go back and forth between two tapes, each forgotten
 * when the layer after it is done, so that two layers are in memory at a time.
 */
#include "eval/lpips.h"

#include <math.h>

#include "autograd/ops_image.h"
#include "autograd/safetensors.h"
#include "eval/image_metrics.h"

#define LPIPS_TEXT                                                                                 \
    "LPIPS v0.1: three channels over white, [0, 1] mapped to [-1, 1], the published shift and "    \
    "scale; features after the last ReLU of each of five blocks, of unit length over channels at " \
    "each position (eps 1e-10); squared differences times the linear weights, mean over "          \
    "positions, sum over blocks; no resizing"

enum { BLOCKS = 5, MOST_LAYERS = 13 };

/* One convolution with ReLU, and what stands before and after it. */
typedef struct layer {
    int index; /* N of features.N in torchvision */
    int in, out, size, stride, pad;
    int pool;    /* edge of the max pooling of stride 2 before it; 0: none */
    bool tapped; /* the last of its block: its output is compared */
} layer;

static const layer alex_layer[] = {
    {0, 3, 64, 11, 4, 2, 0, true},    {3, 64, 192, 5, 1, 2, 3, true},
    {6, 192, 384, 3, 1, 1, 3, true},  {8, 384, 256, 3, 1, 1, 0, true},
    {10, 256, 256, 3, 1, 1, 0, true},
};

static const layer vgg_layer[] = {
    {0, 3, 64, 3, 1, 1, 0, false},     {2, 64, 64, 3, 1, 1, 0, true},
    {5, 64, 128, 3, 1, 1, 2, false},   {7, 128, 128, 3, 1, 1, 0, true},
    {10, 128, 256, 3, 1, 1, 2, false}, {12, 256, 256, 3, 1, 1, 0, false},
    {14, 256, 256, 3, 1, 1, 0, true},  {17, 256, 512, 3, 1, 1, 2, false},
    {19, 512, 512, 3, 1, 1, 0, false}, {21, 512, 512, 3, 1, 1, 0, true},
    {24, 512, 512, 3, 1, 1, 2, false}, {26, 512, 512, 3, 1, 1, 0, false},
    {28, 512, 512, 3, 1, 1, 0, true},
};

struct lf_lpips {
    lf_lpips_net net;
    char *path;
    const layer *layer;
    int layers;
    lf_real *filter[MOST_LAYERS]; /* [size, size, in, out] */
    lf_real *bias[MOST_LAYERS];   /* [out] */
    lf_real *linear[BLOCKS];      /* [channels of the block] */
    lf_tape *tape[2];
};

const char *lf_lpips_net_name(lf_lpips_net net)
{
    return net == LF_LPIPS_ALEX ? "alex" : "vgg";
}

lf_status lf_lpips_net_parse(const char *name, lf_lpips_net *out, lf_error *err)
{
    for (int net = LF_LPIPS_VGG; net <= LF_LPIPS_ALEX; net++)
        if (strcmp(name, lf_lpips_net_name((lf_lpips_net)net)) == 0) {
            *out = (lf_lpips_net)net;
            return LF_OK;
        }
    return lf_fail(err, LF_BAD_INPUT, "%s is not a network of LPIPS: give vgg or alex", name);
}

int lf_lpips_smallest(lf_lpips_net net)
{
    return net == LF_LPIPS_ALEX ? 31 : 16;
}

const char *lf_lpips_text(void)
{
    return "LPIPS        v0.1: three channels over white, [0, 1] mapped to [-1, 1], the published\n"
           "             shift and scale; features after the last ReLU of each of five blocks, of\n"
           "             unit length over channels at each position (eps 1e-10); squared\n"
           "             differences times the linear weights, mean over positions, sum over\n"
           "             blocks; no resizing\n";
}

json_t *lf_lpips_json(const lf_lpips *lpips)
{
    if (lpips)
        return json_pack("{s:s,s:s,s:s}", "definition", LPIPS_TEXT, "net",
                         lf_lpips_net_name(lpips->net), "weights", lpips->path);
    return json_pack("{s:s,s:n,s:n,s:s}", "definition", LPIPS_TEXT, "net", "weights",
                     "not_available",
                     "no weights were given; docs/lpips.md says how to make the file");
}

/* ---- weights --------------------------------------------------------------------------------- */

static lf_real *new_reals(long n)
{
    lf_real *x = malloc((size_t)n * sizeof *x);
    LF_REQUIRE(x, "no memory for %ld numbers", n);
    return x;
}

/* A finite array of the file in the file's own layout; *out is allocated. */
static lf_status read_array(const char *path, const lf_safetensors *file, const char *name,
                            int rank, const long *dim, lf_real **out, lf_error *err)
{
    long n = 1;
    for (int i = 0; i < rank; i++)
        n *= dim[i];
    lf_real *x = new_reals(n);
    lf_status status = lf_safetensors_copy(file, name, rank, dim, x, err);
    for (long i = 0; status == LF_OK && i < n; i++)
        if (!isfinite(x[i]))
            status =
                lf_fail(err, LF_BAD_INPUT, "%s: array %s: number %ld is not finite", path, name, i);
    if (status == LF_OK)
        *out = x;
    else
        free(x);
    return status;
}

/* [out, in, size, size] -> [size, size, in, out] */
static lf_real *channels_last(const layer *l, const lf_real *from)
{
    const long taps = (long)l->size * l->size;
    lf_real *to = new_reals(taps * l->in * l->out);
    for (long o = 0; o < l->out; o++)
        for (long i = 0; i < l->in; i++)
            for (long t = 0; t < taps; t++)
                to[(t * l->in + i) * l->out + o] = from[(o * l->in + i) * taps + t];
    return to;
}

static lf_status read_layer(lf_lpips *lpips, int k, const lf_safetensors *file, lf_error *err)
{
    const layer *l = &lpips->layer[k];
    char name[64];
    lf_real *filter;
    snprintf(name, sizeof name, "features.%d.weight", l->index);
    LF_TRY(read_array(lpips->path, file, name, 4, LF_DIMS(l->out, l->in, l->size, l->size), &filter,
                      err));
    lpips->filter[k] = channels_last(l, filter);
    free(filter);
    snprintf(name, sizeof name, "features.%d.bias", l->index);
    return read_array(lpips->path, file, name, 1, LF_DIMS(l->out), &lpips->bias[k], err);
}

static lf_status read_weights(lf_lpips *lpips, const lf_safetensors *file, lf_error *err)
{
    for (int k = 0, block = 0; k < lpips->layers; k++) {
        LF_TRY(read_layer(lpips, k, file, err));
        if (!lpips->layer[k].tapped)
            continue;
        char name[64];
        snprintf(name, sizeof name, "lin%d.model.1.weight", block);
        LF_TRY(read_array(lpips->path, file, name, 4, LF_DIMS(1, lpips->layer[k].out, 1, 1),
                          &lpips->linear[block++], err));
    }
    return LF_OK;
}

static lf_lpips *create(const char *path, lf_lpips_net net)
{
    lf_lpips *lpips = calloc(1, sizeof *lpips);
    LF_REQUIRE(lpips, "no memory");
    const bool alex = net == LF_LPIPS_ALEX;
    lpips->net = net;
    lpips->layer = alex ? alex_layer : vgg_layer;
    lpips->layers =
        (int)(alex ? sizeof alex_layer / sizeof *alex_layer : sizeof vgg_layer / sizeof *vgg_layer);
    lpips->path = strdup(path);
    LF_REQUIRE(lpips->path, "no memory");
    for (int i = 0; i < 2; i++) {
        lpips->tape[i] = lf_tape_create();
        lf_tape_set_grad(lpips->tape[i], false);
    }
    return lpips;
}

lf_status lf_lpips_open(const char *path, lf_lpips_net net, lf_lpips **out, lf_error *err)
{
    lf_safetensors *file;
    LF_TRY(lf_safetensors_open(path, &file, err));
    lf_lpips *lpips = create(path, net);
    const lf_status status = read_weights(lpips, file, err);
    lf_safetensors_close(file);
    if (status == LF_OK) {
        *out = lpips;
        return LF_OK;
    }
    lf_lpips_free(lpips);
    return lf_error_context(err, status, "weights of LPIPS with net %s (docs/lpips.md)",
                            lf_lpips_net_name(net));
}

void lf_lpips_free(lf_lpips *lpips)
{
    if (!lpips)
        return;
    for (int k = 0; k < MOST_LAYERS; k++) {
        free(lpips->filter[k]);
        free(lpips->bias[k]);
    }
    for (int k = 0; k < BLOCKS; k++)
        free(lpips->linear[k]);
    for (int i = 0; i < 2; i++)
        lf_tape_free(lpips->tape[i]);
    free(lpips->path);
    free(lpips);
}

/* ---- distance -------------------------------------------------------------------------------- */

/* (2 v - 1 - shift) / scale of an image of three channels. */
static void scale_image(const lf_image *image, lf_real *out)
{
    static const double shift[] = {-0.030, -0.088, -0.188}, scale[] = {0.458, 0.448, 0.450};
    const long n = 3L * image->width * image->height;
    for (long i = 0; i < n; i++)
        out[i] = (lf_real)((2.0 * image->pixel[i] - 1 - shift[i % 3]) / scale[i % 3]);
}

/* The network's input [2, height, width, 3]. */
static lf_tensor *input(lf_tape *tape, const lf_image *a, const lf_image *b)
{
    lf_tensor *x = lf_tensor_new(tape, 4, LF_DIMS(2, a->height, a->width, 3));
    const lf_image *const both[] = {a, b};
    for (int i = 0; i < 2; i++) {
        lf_image *image = lf_image_for_metrics(both[i]);
        scale_image(image, x->value + i * x->size / 2);
        lf_image_free(image);
    }
    return x;
}

static lf_tensor *run_layer(const lf_lpips *lpips, int k, lf_tape *tape, lf_tensor *x)
{
    const layer *l = &lpips->layer[k];
    lf_tensor *w =
        lf_leaf(tape, 4, LF_DIMS(l->size, l->size, l->in, l->out), lpips->filter[k], NULL);
    lf_tensor *b = lf_leaf(tape, 1, LF_DIMS(l->out), lpips->bias[k], NULL);
    if (l->pool)
        x = lf_max_pool(tape, x, l->pool, 2, 0);
    return lf_conv2d(tape, x, w, b, l->stride, l->pad, LF_RELU);
}

static double length(long n, const lf_real *f)
{
    double sum = 0;
    for (long c = 0; c < n; c++)
        sum += (double)f[c] * f[c];
    return sqrt(sum);
}

/* sum_c w_c (a_c / |a| - b_c / |b|)^2 at one position. Divisions, since a product with 1 / |a|
 * would be joined with the subtraction and leave a rest for a = b. */
static double position_distance(long n, const lf_real *a, const lf_real *b, const lf_real *w)
{
    const double length_a = length(n, a) + 1e-10, length_b = length(n, b) + 1e-10;
    double sum = 0;
    for (long c = 0; c < n; c++) {
        const double d = a[c] / length_a - b[c] / length_b;
        sum += w[c] * d * d;
    }
    return sum;
}

/* Mean over the positions of features f [2, h, w, C]; summed by rows, the rows in order. */
static double block_distance(const lf_tensor *f, const lf_real *w)
{
    const long height = f->dim[1], width = f->dim[2], channels = f->dim[3], row = width * channels;
    double *sum = calloc((size_t)height, sizeof *sum), all = 0;
    LF_REQUIRE(sum, "no memory for %ld rows", height);
#pragma omp parallel for schedule(static)
    for (long i = 0; i < height; i++)
        for (long j = 0; j < width; j++) {
            const lf_real *a = f->value + i * row + j * channels;
            sum[i] += position_distance(channels, a, a + height * row, w);
        }
    for (long i = 0; i < height; i++)
        all += sum[i];
    free(sum);
    return all / (double)(height * width);
}

static double distance(const lf_lpips *lpips, const lf_image *a, const lf_image *b)
{
    lf_tensor *x = input(lpips->tape[1], a, b);
    double sum = 0;
    for (int k = 0, block = 0; k < lpips->layers; k++) {
        x = run_layer(lpips, k, lpips->tape[k % 2], x);
        lf_tape_reset(lpips->tape[1 - k % 2]);
        if (lpips->layer[k].tapped)
            sum += block_distance(x, lpips->linear[block++]);
    }
    lf_tape_reset(lpips->tape[0]);
    lf_tape_reset(lpips->tape[1]);
    return sum;
}

lf_status lf_lpips_distance(lf_lpips *lpips, const lf_image *a, const lf_image *b, double *out,
                            lf_error *err)
{
    LF_TRY(lf_images_agree(a, b, err));
    const int least = lf_lpips_smallest(lpips->net);
    if (a->width < least || a->height < least)
        return lf_fail(err, LF_BAD_INPUT,
                       "LPIPS with net %s needs at least %d x %d pixels, the images are %d x %d",
                       lf_lpips_net_name(lpips->net), least, least, a->width, a->height);
    *out = distance(lpips, a, b);
    return LF_OK;
}
