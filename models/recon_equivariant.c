/* recon_equivariant.c: the paper's network, read as its pipeline. See recon_equivariant.h.
 *                                                                          [method.md 5a.3 - 5a.6]
 */
#include "models/recon_equivariant.h"

typedef struct equivariant {
    lf_ray_convolution convolution;
    lf_transformer_block block[LF_RECON_BLOCKS];
    lf_vector_neuron readout;
    bool has_readout;
    lf_mlp head;
    long inputs; /* numbers a ray, depth code included */
} equivariant;

/* Depth code: distances are centred at 2.5 and scaled by 0.5 (method.md 4.4): cameras of the
 * built-in views stand 2.5 box diagonals away and the object has radius 0.5. */
static const double depth_centre = 2.5, depth_half = 0.5;

static void configure(const lf_config *cfg, lf_recon_config *c)
{
    c->depth_octaves = (int)lf_config_int(cfg, "model.depth_octaves");
    c->max_pool = lf_config_is(cfg, "model.fusion", "max-pool");
    c->block = (lf_transformer_config){
        .scalars = lf_config_int(cfg, "model.scalars"),
        .vectors = lf_config_int(cfg, "model.vectors"),
        .heads = (int)lf_config_int(cfg, "model.heads"),
        .degree2 = lf_config_bool(cfg, "model.degree2"),
        .skip_linear = lf_config_is(cfg, "model.skip", "linear"),
        .nonlinearity = lf_config_is(cfg, "model.nonlinearity", "gated") ? LF_GATED : LF_NORM_RELU};
    c->blocks = (int)lf_config_int(cfg, "model.blocks");
    LF_REQUIRE(c->blocks <= LF_RECON_BLOCKS, "%d blocks", c->blocks);
}

static long depth_code_size(const lf_recon_config *c)
{
    return c->depth_octaves ? 1 + 2 * c->depth_octaves : 0;
}

/* What lies between samples and MLP; returns how many numbers of a point the MLP gets. */
static long init_fusion(lf_recon *model, equivariant *net)
{
    const lf_recon_config *c = &model->config;
    const long c0 = c->block.scalars, c1 = c->block.vectors, kept = c->blocks + 1;
    lf_store *store = model->store;
    model->layers = (int)kept;
    lf_ray_convolution_init(store, &net->convolution, "convolution", net->inputs, c0, c1);
    for (int b = 0; b < c->blocks; b++) {
        char name[32];
        snprintf(name, sizeof name, "block%d", b);
        const long ray0 = b ? c0 : net->inputs, ray1 = b ? c1 : 0;
        lf_transformer_block_init(store, &net->block[b], name, &c->block, ray0, ray1);
    }
    net->has_readout = c1 > 0;
    if (net->has_readout)
        lf_vector_neuron_init(store, &net->readout, "readout", kept * c1);
    return kept * (c0 + c1);
}

static void init(lf_recon *model)
{
    const lf_recon_config *c = &model->config;
    equivariant *net = calloc(1, sizeof *net);
    LF_REQUIRE(net, "out of memory");
    model->net = net;
    lf_recon_backbone_init(model, 0);
    model->head_first = lf_store_size(model->store);
    net->inputs = model->feature_count + depth_code_size(c);
    const long in = c->max_pool ? net->inputs : init_fusion(model, net);
    lf_mlp_init(model->store, &net->head, "head", in, c->mlp_widths, c->mlp, 1);
}

/* [s', sin 2^k pi s', cos 2^k pi s'], s' = (s - centre) / half.                    [method.md 5a.3]
 */
static lf_tensor *depth_code(lf_tape *tape, const lf_recon *model, const lf_recon_points *p)
{
    const int octaves = model->config.depth_octaves;
    const long n = depth_code_size(&model->config);
    lf_tensor *code = lf_tensor_new(tape, 3, LF_DIMS(p->count, p->views, n));
    for (long r = 0; r < p->count * p->views; r++) {
        lf_real *out = code->value + r * n;
        const double s = (p->distance[r] - depth_centre) / depth_half;
        out[0] = (lf_real)s;
        for (int k = 0; k < octaves; k++) {
            const double phase = (double)(1 << k) * 3.141592653589793 * s;
            out[1 + 2 * k] = (lf_real)sin(phase);
            out[2 + 2 * k] = (lf_real)cos(phase);
        }
    }
    return code;
}

/* Invariants of all kept point features, joined.                                   [method.md 5a.6]
 */
static lf_tensor *invariants(lf_tape *tape, const equivariant *net, const lf_field *kept, int count)
{
    lf_tensor *scalars[LF_RECON_BLOCKS + 2], *vectors[LF_RECON_BLOCKS + 1];
    for (int i = 0; i < count; i++) {
        scalars[i] = kept[i].scalar;
        vectors[i] = kept[i].vector;
    }
    if (!net->has_readout)
        return lf_concat(tape, count, scalars);
    lf_scope(tape, "invariants");
    lf_tensor *all = lf_concat(tape, count, vectors);
    scalars[count] = lf_vector_neuron_apply(tape, &net->readout, all);
    all = lf_concat(tape, count + 1, scalars);
    lf_scope_end(tape);
    return all;
}

static lf_tensor *read_out(lf_tape *tape, const equivariant *net, lf_tensor *x)
{
    lf_scope(tape, "head");
    x = lf_mlp_apply(tape, &net->head, x);
    lf_scope_end(tape);
    return x;
}

static lf_tensor *sdf(lf_tape *tape, const lf_recon *model, const lf_recon_inputs *in,
                      lf_field *layers)
{
    const lf_recon_config *c = &model->config;
    const equivariant *net = model->net;
    const lf_ray_geometry *rays = &in->rays;
    lf_tensor *ray = in->seen; /* 5a.3 */
    lf_scope(tape, "rays");
    if (c->depth_octaves)
        ray = lf_concat(tape, 2, (lf_tensor *[]){in->seen, depth_code(tape, model, in->points)});
    if (c->max_pool)
        ray = lf_pool_views(tape, ray, rays->mask, LF_POOL_MAX);
    lf_scope_end(tape);
    if (c->max_pool) /* 5a.10 */
        return read_out(tape, net, ray);
    lf_scope(tape, "ray convolution"); /* 5a.4 */
    lf_field point = lf_ray_convolution_apply(tape, &net->convolution, ray, rays);
    lf_scope_end(tape);
    lf_field on_rays = {ray, NULL}, kept[LF_RECON_LAYERS] = {point};
    for (int b = 0; b < c->blocks; b++) { /* 5a.5 */
        lf_scope(tape, "block%d", b);
        lf_transformer_block_apply(tape, &net->block[b], &on_rays, &point, rays);
        lf_scope_end(tape);
        kept[b + 1] = point;
    }
    for (int i = 0; layers && i <= c->blocks; i++)
        layers[i] = kept[i];
    return read_out(tape, net, invariants(tape, net, kept, c->blocks + 1)); /* 5a.6 */
}

/* Products of one block a point with V views. */
static double block_macs(const lf_transformer_config *c, double views, double ray0, double ray1)
{
    const double c0 = (double)c->scalars, c1 = (double)c->vectors;
    const double update = ray0 * c0 + 3 * ray1 * c1 + c0 * c0 + 3 * c1 * c1; /* a ray */
    const double paths = c0 + (c->degree2 ? 3 : 2) * c1;
    const double keys = (c0 + c1) * 2 * c0 + 3 * paths * 2 * c1, attend = 2 * (c0 + 3 * c1);
    const double point = 3 * (c0 * c0 + 3 * c1 * c1); /* from_point, query, mix */
    return views * (update + keys + attend) + point;
}

/* Products of a point between its samples and the MLP: convolution, blocks, readout. */
static double fusion_macs(const lf_recon_config *c, double f, double views)
{
    const double c0 = (double)c->block.scalars, c1 = (double)c->block.vectors;
    const double kept = (double)(c->blocks + 1);
    double point = f * c0 + 3 * f * c1;
    for (int b = 0; b < c->blocks; b++)
        point += block_macs(&c->block, views, b ? c0 : f, b ? c1 : 0);
    return point + 2 * 3 * kept * c1 * kept * c1;
}

static void cost(const lf_recon *model, long views, lf_recon_cost *cost)
{
    const lf_recon_config *c = &model->config;
    const equivariant *net = model->net;
    if (!c->max_pool)
        cost->point += fusion_macs(c, (double)net->inputs, (double)views);
    cost->point += lf_mlp_macs(&net->head);
}

const lf_recon_network lf_recon_equivariant = {
    .type = "equivariant", .configure = configure, .init = init, .sdf = sdf, .cost = cost};
