/* check.c: keys that must fit each other, and values worth a warning. */
#include "configs/configs.h"

bool lf_config_renders(const lf_config *cfg)
{
    return lf_config_is(cfg, "model.type", "renderer") || lf_config_is(cfg, "model.type", "ibrnet");
}

/* How many pixels of the view lie between two pixels of the last map. */
static long total_stride(const lf_config *cfg)
{
    int stages;
    lf_config_ints(cfg, "model.stages", &stages);
    const long stem = lf_config_bool(cfg, "model.stem_pool") ? 4 : 2;
    return (stem * lf_config_int(cfg, "model.first_stride")) << (stages - 1);
}

static lf_status check_backbone(const lf_config *cfg, lf_error *err)
{
    int stages, fields;
    lf_config_ints(cfg, "model.stages", &stages);
    lf_config_ints(cfg, "model.fields", &fields);
    if (stages != fields)
        return lf_fail(
            err, LF_BAD_INPUT,
            "model.stages has %d numbers and model.fields %d: give both a number a stage", stages,
            fields);
    if (lf_config_int(cfg, "model.stem_size") % 2 == 0)
        return lf_fail(err, LF_BAD_INPUT, "model.stem_size = %ld: allowed is an odd number",
                       lf_config_int(cfg, "model.stem_size"));
    const long size = lf_config_int(cfg, "data.image_size"), stride = total_stride(cfg);
    if (size - 1 < stride)
        return lf_fail(err, LF_BAD_INPUT,
                       "data.image_size = %ld: the strides of this backbone multiply to %ld, so "
                       "allowed is %ld or more",
                       size, stride, stride + 1);
    return LF_OK;
}

/* How much fits into one list of maps, and the parts of a bottleneck. */
static lf_status check_sizes(const lf_config *cfg, lf_error *err)
{
    enum { MAPS = 8, WIDTHS = 7 };
    int stages, widths;
    const long *fields = lf_config_ints(cfg, "model.fields", &stages);
    lf_config_ints(cfg, "model.mlp", &widths);
    const int maps = stages + lf_config_bool(cfg, "model.stem_features") +
                     lf_config_bool(cfg, "model.sample_image");
    if (maps > MAPS)
        return lf_fail(err, LF_BAD_INPUT,
                       "%d stages, model.stem_features and model.sample_image make %d maps: "
                       "allowed are %d",
                       stages, maps, MAPS);
    if (widths > WIDTHS)
        return lf_fail(err, LF_BAD_INPUT, "model.mlp has %d numbers: allowed are %d", widths,
                       WIDTHS);
    for (int s = 0; s < stages && lf_config_is(cfg, "model.block", "bottleneck"); s++)
        if (fields[s] % 4)
            return lf_fail(
                err, LF_BAD_INPUT,
                "model.fields has %ld: with model.block = bottleneck, whose inside has a "
                "quarter of the fields, allowed are multiples of 4",
                fields[s]);
    return LF_OK;
}

static lf_status check_volume(const lf_config *cfg, lf_error *err)
{
    int levels;
    lf_config_ints(cfg, "model.volume", &levels);
    const long grid = lf_config_int(cfg, "model.grid"), stride = 1L << (levels - 1);
    if ((grid - 1) % stride)
        return lf_fail(err, LF_BAD_INPUT,
                       "model.grid = %ld: with %d levels in model.volume, allowed is a multiple of "
                       "%ld, plus 1",
                       grid, levels, stride);
    return LF_OK;
}

static lf_status check_grid(const lf_config *cfg, lf_error *err)
{
    const long fine = lf_config_int(cfg, "eval.resolution"),
               coarse = lf_config_int(cfg, "eval.coarse");
    long n = coarse;
    while (n < fine)
        n *= 2;
    if (n != fine)
        return lf_fail(err, LF_BAD_INPUT,
                       "eval.resolution = %ld: allowed is eval.coarse = %ld times a power of two",
                       fine, coarse);
    return LF_OK;
}

static lf_status check_head(const lf_config *cfg, const char *key, lf_error *err)
{
    const long channels = lf_config_int(cfg, key), heads = lf_config_int(cfg, "model.heads");
    if (channels % heads)
        return lf_fail(err, LF_BAD_INPUT, "%s = %ld: allowed is a multiple of model.heads = %ld",
                       key, channels, heads);
    return LF_OK;
}

static lf_status check_fusion(const lf_config *cfg, lf_error *err)
{
    LF_TRY(check_head(cfg, "model.scalars", err));
    LF_TRY(check_head(cfg, "model.vectors", err));
    if (lf_config_int(cfg, "model.vectors") == 0 && lf_config_bool(cfg, "model.degree2"))
        return lf_fail(err, LF_BAD_INPUT,
                       "model.degree2 = true: it is a path between vectors, and model.vectors = 0");
    return LF_OK;
}

static lf_status check_data(const lf_config *cfg, lf_error *err)
{
    const char *category = lf_config_string(cfg, "data.category");
    const bool builtin = !strcmp(lf_config_string(cfg, "data.root"), "builtin");
    const bool family =
        !strcmp(category, "chair") || !strcmp(category, "airplane") || !strcmp(category, "car");
    if (!family && (builtin || lf_config_int(cfg, "data.extra_builtin") > 0))
        return lf_fail(err, LF_BAD_INPUT,
                       "data.category = %s: built-in shapes (%s) are chair, airplane and car",
                       category, builtin ? "data.root = builtin" : "data.extra_builtin");
    const double thickness = lf_config_real(cfg, "data.thickness");
    if (thickness < 0 && thickness != -1)
        return lf_fail(err, LF_BAD_INPUT,
                       "data.thickness = %g: allowed is -1 or a number from 0 to 0.1", thickness);
    return LF_OK;
}

/* What only the renderers' keys must keep to. */
static lf_status check_render(const lf_config *cfg, lf_error *err)
{
    int types, pools;
    const long *type = lf_config_ints(cfg, "render.types", &types);
    const long *pool = lf_config_ints(cfg, "train.pool", &pools);
    for (int i = 0; i < types; i++)
        if (i == 0 ? type[0] != 0 : type[i] <= type[i - 1])
            return lf_fail(err, LF_BAD_INPUT,
                           "render.types: number %d is %ld: allowed is 0 first, then rising", i + 1,
                           type[i]);
    const long channels = lf_config_int(cfg, "render.channels");
    if (channels % lf_config_int(cfg, "render.heads"))
        return lf_fail(err, LF_BAD_INPUT,
                       "render.channels = %ld: allowed is a multiple of render.heads = %ld",
                       channels, lf_config_int(cfg, "render.heads"));
    const long scalars = lf_config_int(cfg, "render.scalars");
    if (scalars % channels != 0)
        return lf_fail(err, LF_BAD_INPUT,
                       "render.scalars = %ld: allowed is a multiple of render.channels = %ld, or 0",
                       scalars, channels);
    if (lf_config_int(cfg, "render.width") % 4)
        return lf_fail(err, LF_BAD_INPUT, "render.width = %ld: allowed is a multiple of 4",
                       lf_config_int(cfg, "render.width"));
    if (lf_config_int(cfg, "render.sources") < 2)
        return lf_fail(err, LF_BAD_INPUT,
                       "render.sources = 1: allowed is 2 and more, as a ray trains only where two "
                       "views see it (an evaluated view may have eval.sources = 1)");
    if (lf_config_int(cfg, "train.seen_samples") >= lf_config_int(cfg, "render.samples"))
        return lf_fail(err, LF_BAD_INPUT,
                       "train.seen_samples = %ld: allowed is less than render.samples = %ld, or no "
                       "ray counts",
                       lf_config_int(cfg, "train.seen_samples"),
                       lf_config_int(cfg, "render.samples"));
    if (pools != 3 || pool[0] + pool[1] + pool[2] != 100)
        return lf_fail(err, LF_BAD_INPUT,
                       "train.pool: allowed are three numbers that add up to 100");
    if (!lf_config_is(cfg, "data.setting", "I"))
        return lf_fail(err, LF_BAD_INPUT,
                       "data.setting = %s: allowed is I: renderers train on cameras as they are; "
                       "elf-eval --setting SO3 turns the frame",
                       lf_config_choice(cfg, "data.setting"));
    if (lf_config_int(cfg, "data.builtin_scenes") == 0 &&
        strcmp(lf_config_string(cfg, "data.scenes"), "none") == 0)
        return lf_fail(err, LF_BAD_INPUT,
                       "no scenes to train on: give data.scenes, or data.builtin_scenes above 0");
    return LF_OK;
}

lf_status lf_config_check(const lf_config *cfg, lf_error *err)
{
    if (lf_config_renders(cfg))
        return check_render(cfg, err);
    LF_TRY(check_backbone(cfg, err));
    LF_TRY(check_sizes(cfg, err));
    if (lf_config_is(cfg, "model.type", "equivariant"))
        LF_TRY(check_fusion(cfg, err));
    if (lf_config_is(cfg, "model.type", "fvor"))
        LF_TRY(check_volume(cfg, err));
    LF_TRY(check_data(cfg, err));
    if (lf_config_int(cfg, "eval.sources") > 8)
        return lf_fail(err, LF_BAD_INPUT, "eval.sources = %ld: an object has 8 views",
                       lf_config_int(cfg, "eval.sources"));
    return check_grid(cfg, err);
}

static int warn_views(const lf_config *cfg, FILE *out)
{
    int warnings = 0;
    const long size = lf_config_int(cfg, "data.image_size"), stride = total_stride(cfg);
    if ((size - 1) % stride) {
        fprintf(out,
                "data.image_size = %ld: only sizes %ld k + 1 keep every map symmetric; quarter "
                "turns of the views will not be exact\n",
                size, stride);
        warnings++;
    }
    if (lf_config_is(cfg, "data.light", "head")) {
        fprintf(out, "data.light = head: the faces of a box are equally bright from the cube's "
                     "corners, so its edges vanish\n");
        warnings++;
    }
    return warnings;
}

static int warn_steps(const lf_config *cfg, FILE *out)
{
    int warnings = 0;
    const long warmup = lf_config_int(cfg, "train.warmup"),
               steps = lf_config_int(cfg, "train.steps");
    if (warmup >= steps && steps > 0) {
        fprintf(out, "train.warmup = %ld: the learning rate still rises at the last step, %ld\n",
                warmup, steps);
        warnings++;
    }
    const long save = lf_config_int(cfg, "train.checkpoint_every"),
               validate = lf_config_int(cfg, "train.val_every");
    if (lf_config_int(cfg, "data.val_shapes") > 0 && save % validate && validate % save) {
        fprintf(out,
                "train.checkpoint_every = %ld does not go with train.val_every = %ld: only "
                "checkpoints of steps that are validated can be kept as the best\n",
                save, validate);
        warnings++;
    }
    return warnings;
}

int lf_config_warn(const lf_config *cfg, FILE *out)
{
    if (lf_config_renders(cfg))
        return warn_steps(cfg, out);
    return warn_views(cfg, out) + warn_steps(cfg, out);
}
