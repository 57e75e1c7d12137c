/* peer_onednn.c: the same convolutions by oneDNN 2, in the memory layouts that it chooses itself
 * (what converting to and from them costs is not counted), for comparison with our own.
 */
#include <dnnl.h>
#include <stdlib.h>

#include "autograd/status.h"
#include "bench/bench.h"

enum { MAX_ARGS = 4, FORWARD = 0, DX, DW };

typedef struct peer {
    lf_bench_work base;
    dnnl_engine_t engine;
    dnnl_stream_t stream;
    dnnl_primitive_t primitive;
    dnnl_exec_arg_t args[MAX_ARGS];
    int count;
} peer;

static void must(dnnl_status_t status)
{
    LF_REQUIRE(status == dnnl_success, "oneDNN returned %d", (int)status);
}

/* The convolution's tensors and how it lies on them. */
typedef struct shape {
    dnnl_memory_desc_t src, weights, bias, dst;
    dnnl_dims_t strides, pad;
} shape;

static dnnl_memory_desc_t any(int rank, long a, long b, long c, long d)
{
    const dnnl_dims_t dims = {a, b, c, d};
    dnnl_memory_desc_t md;
    must(dnnl_memory_desc_init_by_tag(&md, rank, dims, dnnl_f32, dnnl_format_tag_any));
    return md;
}

/* size: images, side, in, out, filter, stride, pad */
static shape make_shape(const long *size)
{
    const long side = (size[1] + 2 * size[6] - size[4]) / size[5] + 1;
    return (shape){any(4, size[0], size[2], size[1], size[1]),
                   any(4, size[3], size[2], size[4], size[4]),
                   any(1, size[3], 0, 0, 0),
                   any(4, size[0], size[3], side, side),
                   {size[5], size[5]},
                   {size[6], size[6]}};
}

static dnnl_primitive_desc_t forward_desc(const shape *s, dnnl_engine_t engine)
{
    dnnl_convolution_desc_t d;
    dnnl_primitive_desc_t pd;
    must(dnnl_convolution_forward_desc_init(&d, dnnl_forward_training, dnnl_convolution_direct,
                                            &s->src, &s->weights, &s->bias, &s->dst, s->strides,
                                            s->pad, s->pad));
    must(dnnl_primitive_desc_create(&pd, &d, NULL, engine, NULL));
    return pd;
}

static dnnl_primitive_desc_t backward_desc(const shape *s, int variant, dnnl_engine_t engine)
{
    dnnl_convolution_desc_t d;
    dnnl_primitive_desc_t forward = forward_desc(s, engine), pd;
    if (variant == DX)
        must(dnnl_convolution_backward_data_desc_init(&d, dnnl_convolution_direct, &s->src,
                                                      &s->weights, &s->dst, s->strides, s->pad,
                                                      s->pad));
    else
        must(dnnl_convolution_backward_weights_desc_init(&d, dnnl_convolution_direct, &s->src,
                                                         &s->weights, &s->bias, &s->dst, s->strides,
                                                         s->pad, s->pad));
    must(dnnl_primitive_desc_create(&pd, &d, NULL, engine, forward));
    dnnl_primitive_desc_destroy(forward);
    return pd;
}

static void add_argument(peer *p, dnnl_primitive_desc_t pd, int arg)
{
    dnnl_memory_t memory;
    const dnnl_memory_desc_t *md = dnnl_primitive_desc_query_md(pd, dnnl_query_exec_arg_md, arg);
    must(dnnl_memory_create(&memory, md, p->engine, DNNL_MEMORY_ALLOCATE));
    void *data;
    must(dnnl_memory_get_data_handle(memory, &data));
    memset(data, 0, dnnl_memory_desc_get_size(md));
    p->args[p->count++] = (dnnl_exec_arg_t){arg, memory};
}

static void run_peer(lf_bench_work *work)
{
    const peer *p = (peer *)work;
    must(dnnl_primitive_execute(p->primitive, p->stream, p->count, p->args));
    must(dnnl_stream_wait(p->stream));
}

static void close_peer(lf_bench_work *work)
{
    peer *p = (peer *)work;
    for (int i = 0; i < p->count; i++)
        dnnl_memory_destroy(p->args[i].memory);
    dnnl_primitive_destroy(p->primitive);
    dnnl_stream_destroy(p->stream);
    dnnl_engine_destroy(p->engine);
    free(p);
}

static lf_bench_work *open_peer(const lf_bench_case *c)
{
    static const int arguments[3][MAX_ARGS] = {
        {DNNL_ARG_SRC, DNNL_ARG_WEIGHTS, DNNL_ARG_BIAS, DNNL_ARG_DST},
        {DNNL_ARG_DIFF_SRC, DNNL_ARG_WEIGHTS, DNNL_ARG_DIFF_DST, 0},
        {DNNL_ARG_SRC, DNNL_ARG_DIFF_WEIGHTS, DNNL_ARG_DIFF_BIAS, DNNL_ARG_DIFF_DST}};
    peer *p = calloc(1, sizeof *p);
    LF_REQUIRE(p, "no memory");
    must(dnnl_engine_create(&p->engine, dnnl_cpu, 0));
    must(dnnl_stream_create(&p->stream, p->engine, dnnl_stream_default_flags));
    const shape s = make_shape(c->size);
    dnnl_primitive_desc_t pd = c->variant == FORWARD ? forward_desc(&s, p->engine)
                                                     : backward_desc(&s, c->variant, p->engine);
    must(dnnl_primitive_create(&p->primitive, pd));
    for (int i = 0; i < MAX_ARGS && arguments[c->variant][i]; i++)
        add_argument(p, pd, arguments[c->variant][i]);
    dnnl_primitive_desc_destroy(pd);
    p->base = (lf_bench_work){.run = run_peer, .close = close_peer};
    p->base.flop = 2.0 * (double)(s.dst.dims[0] * s.dst.dims[1] * s.dst.dims[2] * s.dst.dims[3]) *
                   (double)(c->size[4] * c->size[4] * c->size[2]);
    return &p->base;
}

#define PEER(name, what, ...)                                                                      \
    {"onednn-" name, "oneDNN: " what, open_peer, {__VA_ARGS__}, FORWARD},                          \
        {"onednn-" name "-dx", "its gradient in x", open_peer, {__VA_ARGS__}, DX},                 \
    {                                                                                              \
        "onednn-" name "-dw", "its gradient in w and b", open_peer, {__VA_ARGS__}, DW              \
    }

static const lf_bench_case cases[] = {
    PEER("64", "3x3, 64 -> 64, 8 images 64x64", 8, 64, 64, 64, 3, 1, 1),
    PEER("17-32", "3x3, 32 -> 32, 8 images 17x17", 8, 17, 32, 32, 3, 1, 1),
    PEER("3-256", "3x3, 256 -> 256, 8 images 3x3", 8, 3, 256, 256, 3, 1, 1),
};

const lf_bench_table lf_bench_onednn = {"kernels", cases, sizeof cases / sizeof *cases, false};
