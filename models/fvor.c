/* fvor.c: see fvor.h. */
#include "models/fvor.h"

enum { OCTAVES = 2, CODE = 3 * (1 + 2 * OCTAVES), COORDINATES = 2, LEVELS = LF_FVOR_LEVELS };

typedef struct fvor {
    lf_unit enter, down[LEVELS][2], up[LEVELS]; /* 1 .. levels - 1; up[l] leads to level l - 1 */
    lf_conv_layer leave;
    lf_mlp decoder;
} fvor;

static void configure(const lf_config *cfg, lf_recon_config *c)
{
    const long *width = lf_config_ints(cfg, "model.volume", &c->fvor.levels);
    LF_REQUIRE(c->fvor.levels <= LEVELS, "%d levels of a volume", c->fvor.levels);
    for (int l = 0; l < c->fvor.levels; l++)
        c->fvor.fields[l] = (int)width[l];
    c->fvor.grid = lf_config_int(cfg, "model.grid");
}

/* ---- parameters ---- */

/* A unit of the volume: over three slices beside each other, or 1x1x1. Widths in fields. */
static void unit_init(lf_recon *model, lf_unit *unit, const char *name, int level, int size,
                      int in_channels, int out, int stride)
{
    const lf_unit_config config = {.momentum = model->config.backbone.momentum,
                                   .channels_per_field = LF_C8};
    char full[64];
    snprintf(full, sizeof full, "volume.%s%d", name, level);
    lf_unit_init(model->store, full, &config, true, in_channels, out, size, stride, unit);
}

static void volume_init(lf_recon *model, fvor *net)
{
    const int *w = model->config.fvor.fields, levels = model->config.fvor.levels;
    enum { SLICES = 3 * LF_C8 }; /* channels of a field on three slices */
    unit_init(model, &net->enter, "enter", 0, 1, (int)model->feature_count + CODE, w[0], 1);
    for (int l = 1; l < levels; l++) {
        unit_init(model, &net->down[l][0], "shrink", l, 3, SLICES * w[l - 1], w[l], 2);
        unit_init(model, &net->down[l][1], "down", l, 3, SLICES * w[l], w[l], 1);
        unit_init(model, &net->up[l], "up", l, 3, SLICES * w[l], w[l - 1], 1);
    }
    lf_conv_layer_init(model->store, "volume.leave", SLICES * w[0], LF_C8 * w[0], 3, 1, true, 0,
                       &net->leave);
}

static void init(lf_recon *model)
{
    const lf_recon_config *c = &model->config;
    fvor *net = calloc(1, sizeof *net);
    LF_REQUIRE(net, "out of memory");
    model->net = net;
    model->grid = c->fvor.grid;
    lf_recon_backbone_init(model, COORDINATES);
    volume_init(model, net);
    model->head_first = lf_store_size(model->store);
    lf_mlp_init(model->store, &net->decoder, "decoder",
                LF_C8 * c->fvor.fields[0] + model->feature_count + CODE, c->mlp_widths, c->mlp, 1);
}

/* ---- images ---- */

/* Column and row of every pixel, -1 to 1, as two more channels. */
static lf_tensor *view(lf_tape *tape, const lf_recon *model, lf_tensor *images)
{
    (void)model;
    const long height = images->dim[1], width = images->dim[2];
    lf_tensor *at = lf_tensor_new(tape, 4, LF_DIMS(images->dim[0], height, width, COORDINATES));
    for (long i = 0; i < at->size / COORDINATES; i++) {
        const double x = (double)(i % width), y = (double)(i / width % height);
        at->value[COORDINATES * i] = (lf_real)(2 * x / (double)(width - 1) - 1);
        at->value[COORDINATES * i + 1] = (lf_real)(2 * y / (double)(height - 1) - 1);
    }
    return lf_concat(tape, 2, (lf_tensor *[]){images, at});
}

/* ---- places ---- */

/* x, sin 2^k x, cos 2^k x of the three coordinates. */
static lf_tensor *place_code(lf_tape *tape, long points, const double *position)
{
    lf_tensor *code = lf_tensor_new(tape, 2, LF_DIMS(points, CODE));
    for (long q = 0; q < points; q++)
        for (int a = 0; a < 3; a++) {
            lf_real *row = code->value + q * CODE + a;
            const double x = position[3 * q + a];
            row[0] = (lf_real)x;
            for (int k = 0; k < OCTAVES; k++) {
                row[3 * (1 + 2 * k)] = (lf_real)sin((double)(1 << k) * x);
                row[3 * (2 + 2 * k)] = (lf_real)cos((double)(1 << k) * x);
            }
        }
    return code;
}

/* ---- the volume ---- */

static lf_tensor *to_volume(lf_tape *tape, lf_tensor *slices, long volumes)
{
    return lf_reshape(
        tape, slices, 5,
        LF_DIMS(volumes, slices->dim[0] / volumes, slices->dim[1], slices->dim[2], slices->dim[3]));
}

/* 3x3x3 (of a stride), norm, ReLU: volume -> volume. */
static lf_tensor *unit(lf_tape *tape, const lf_unit *u, lf_tensor *x, long stride, bool training)
{
    lf_tensor *slices = lf_volume_slices(tape, x, stride);
    return to_volume(tape, lf_unit_forward(tape, u, slices, NULL, true, training), x->dim[0]);
}

/* Trilinear to the size of `like`, corners aligned: within slices, then across them. */
static lf_tensor *enlarge(lf_tape *tape, lf_tensor *x, const lf_tensor *like)
{
    const long n = x->dim[0], depth = x->dim[1], c = lf_cols(x);
    const long d = like->dim[1], h = like->dim[2], w = like->dim[3];
    lf_tensor *y = lf_reshape(tape, x, 4, LF_DIMS(n * depth, x->dim[2], x->dim[3], c));
    y = lf_resize(tape, y, h, w, true);
    y = lf_reshape(tape, y, 4, LF_DIMS(n, depth, h * w, c));
    y = lf_resize(tape, y, d, h * w, true);
    return lf_reshape(tape, y, 5, LF_DIMS(n, d, h, w, c));
}

static lf_tensor *u_net(lf_tape *tape, const lf_recon *model, lf_tensor *x, bool training)
{
    const fvor *net = model->net;
    const int levels = model->config.fvor.levels;
    const long volumes = x->dim[0], n = x->dim[1];
    lf_tensor *kept[LEVELS];
    x = lf_reshape(tape, x, 4, LF_DIMS(volumes * n, n, n, lf_cols(x)));
    x = to_volume(tape, lf_unit_forward(tape, &net->enter, x, NULL, true, training), volumes);
    kept[0] = x;
    for (int l = 1; l < levels; l++) {
        x = unit(tape, &net->down[l][0], x, 2, training);
        kept[l] = x = unit(tape, &net->down[l][1], x, 1, training);
    }
    for (int l = levels - 1; l > 0; l--) {
        x = unit(tape, &net->up[l], enlarge(tape, x, kept[l - 1]), 1, training);
        x = lf_add(tape, x, kept[l - 1]);
    }
    x = lf_conv_layer_forward(tape, &net->leave, lf_volume_slices(tape, x, 1));
    return to_volume(tape, x, volumes);
}

/* The volume of every object, [S, n, n, n, G]. */
static lf_tensor *object(lf_tape *tape, const lf_recon *model, bool training,
                         const lf_recon_code *code, const lf_recon_points *grid)
{
    const long n = model->grid, size = model->config.image_size;
    lf_scope(tape, "samples");
    lf_tensor *mask = lf_tensor_new(tape, 2, LF_DIMS(grid->count, grid->views));
    for (long i = 0; i < mask->size; i++)
        mask->value[i] = grid->mask[i];
    lf_tensor *x = lf_sample_maps(tape, code->maps, (lf_tensor *const *)code->map, size, size,
                                  grid->count, grid->views, grid->uv, mask->value, grid->first);
    x = lf_pool_views(tape, x, mask, LF_POOL_MEAN);
    x = lf_concat(tape, 2, (lf_tensor *[]){x, place_code(tape, grid->count, grid->position)});
    x = lf_reshape(tape, x, 5, LF_DIMS(grid->count / (n * n * n), n, n, n, lf_cols(x)));
    lf_scope_end(tape);
    lf_scope(tape, "volume");
    x = u_net(tape, model, x, training);
    lf_scope_end(tape);
    return x;
}

/* ---- points ---- */

static lf_tensor *recall(lf_tape *tape, const lf_recon *model, lf_tensor *object,
                         const lf_recon_points *p)
{
    (void)model;
    return lf_sample_volume(tape, object, p->count, p->position, lf_recon_objects(tape, p));
}

static lf_tensor *sdf(lf_tape *tape, const lf_recon *model, const lf_recon_inputs *in,
                      lf_field *layers)
{
    (void)layers;
    const fvor *net = model->net;
    lf_scope(tape, "views");
    lf_tensor *pixel = lf_pool_views(tape, in->seen, in->rays.mask, LF_POOL_MEAN);
    lf_tensor *code = place_code(tape, in->points->count, in->points->position);
    lf_tensor *x = lf_concat(tape, 3, (lf_tensor *[]){in->known, pixel, code});
    lf_scope_end(tape);
    lf_scope(tape, "decoder");
    x = lf_mlp_apply(tape, &net->decoder, x);
    lf_scope_end(tape);
    return x;
}

/* ---- cost ---- */

static void cost(const lf_recon *model, long views, lf_recon_cost *cost)
{
    const fvor *net = model->net;
    const int levels = model->config.fvor.levels, *w = model->config.fvor.fields;
    const double f = (double)model->feature_count;
    long n = model->grid;
    const double first = (double)(n * n * n);
    cost->object += first * ((double)views * 4 * f + (double)net->enter.plain.weight->size +
                             (double)net->leave.weight->size);
    cost->object_kept += first * (2 * (double)views * f + LF_C8 * 6.0 * w[0]);
    for (int l = 1; l < levels; l++) {
        const double above = (double)(n * n * n);
        n = (n + 1) / 2;
        const double here = (double)(n * n * n);
        cost->object += here * (double)(net->down[l][0].plain.weight->size +
                                        net->down[l][1].plain.weight->size) +
                        above * (double)net->up[l].plain.weight->size;
        cost->object_kept += LF_C8 * (above * 8 * w[l] + here * 8 * w[l]);
    }
    cost->point += 8 * LF_C8 * (double)w[0] + lf_mlp_macs(&net->decoder);
}

const lf_recon_network lf_fvor = {.type = "fvor",
                                  .configure = configure,
                                  .init = init,
                                  .view = view,
                                  .object = object,
                                  .recall = recall,
                                  .sdf = sdf,
                                  .cost = cost};
