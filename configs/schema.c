/* schema.c: every key of every config: type, default, range or choices, help. To add a key, add a
 * row to its section; files, overrides, help and checkpoints follow. */
#include "configs/schema.h"

#define INT(name, standard, low, high, help)                                                       \
    {                                                                                              \
        name, LF_KEY_INT, standard, low, high, NULL, help                                          \
    }
#define REAL(name, standard, low, high, help)                                                      \
    {                                                                                              \
        name, LF_KEY_REAL, standard, low, high, NULL, help                                         \
    }
#define BOOL(name, standard, help)                                                                 \
    {                                                                                              \
        name, LF_KEY_BOOL, standard, 0, 0, NULL, help                                              \
    }
#define TEXT(name, standard, help)                                                                 \
    {                                                                                              \
        name, LF_KEY_TEXT, standard, 0, 0, NULL, help                                              \
    }
#define PATH(name, standard, help)                                                                 \
    {                                                                                              \
        name, LF_KEY_PATH, standard, 0, 0, NULL, help                                              \
    }
#define CHOICE(name, standard, choices, help)                                                      \
    {                                                                                              \
        name, LF_KEY_CHOICE, standard, 0, 0, choices, help                                         \
    }
#define INTS(name, standard, low, high, help)                                                      \
    {                                                                                              \
        name, LF_KEY_INTS, standard, low, high, NULL, help                                         \
    }

/* clang-format off */
const lf_key lf_schema[] = {
    CHOICE("model.type", "equivariant", "equivariant|disn|fvor|ibrnet-sdf|renderer|ibrnet",
           "The system: equivariant reconstruction, DISN, FvOR or IBRNet to distances (these are told positions or directions in the object's frame); the equivariant renderer, or IBRNet."),
    CHOICE("model.backbone", "c8", "c8|plain",
           "Features of the views: equivariant to eighth turns, or ordinary convolutions of equal size."),
    INT("model.plain_channels", "8", 1, 64,
        "backbone = plain: channels that stand for a field. 8: as much time as c8; for as many parameters see configs/ablation-plain.ini."),
    INT("model.stem_fields", "4", 1, 256, "Fields (of 8 channels) after the first convolution."),
    INT("model.stem_size", "7", 1, 15, "Pixels of the first convolution's kernel, odd."),
    BOOL("model.stem_pool", "false", "Max-pooling 3x3 with stride 2 after the first convolution."),
    INTS("model.stages", "1, 1, 1", 1, 64, "Residual blocks of each stage; a number a stage."),
    INT("model.first_stride", "2", 1, 2, "Stride of the first stage; later stages have 2."),
    INTS("model.fields", "4, 8, 16", 1, 256, "Fields (of 8 channels) of each stage; a number a stage."),
    CHOICE("model.block", "basic", "basic|bottleneck", "Kind of residual block."),
    CHOICE("model.cutoff", "e2cnn", "e2cnn|redet",
           "Angular frequencies kept in a ring of the kernel basis; redet keeps more."),
    BOOL("model.antialias", "false", "Smooth pictures and maps before strides and sampling: turned views lose less."),
    CHOICE("model.norm", "batch", "batch|instance", "Normalisation in the backbone, for each field."),
    REAL("model.norm_momentum", "0.02", 0, 1, "Weight of the newest batch in the running statistics."),
    INT("model.features", "8", 1, 256, "Scalar channels taken from the stem's and each stage's map."),
    BOOL("model.stem_features", "true", "Take features from the stem's map as well as from the stages'."),
    BOOL("model.sample_image", "true", "Sample the picture itself as a further map."),
    INT("model.depth_octaves", "0", 0, 16, "Octaves of the depth's sine and cosine code; 0: none."),
    CHOICE("model.fusion", "transformer", "transformer|max-pool",
           "How the rays of a point are joined: convolution and transformer, or their maximum over the views and the MLP alone."),
    INT("model.scalars", "16", 1, 256, "Scalar channels of the head."),
    INT("model.vectors", "8", 0, 256, "Vector channels of the head; 0: scalars alone, which know no directions."),
    INT("model.blocks", "2", 0, 6, "Attention blocks of the head."),
    INT("model.heads", "4", 1, 32, "Attention heads; they divide scalars and vectors."),
    BOOL("model.degree2", "false", "The degree-2 path from vectors to vectors in the SE(3) kernels."),
    CHOICE("model.nonlinearity", "norm", "norm|gated", "Nonlinearity of vectors in the head."),
    CHOICE("model.skip", "identity", "identity|linear", "The residual path around attention."),
    INT("model.width", "16", 1, 256, "ibrnet-sdf: numbers of a point behind the aggregation over its views."),
    INTS("model.mlp", "64, 64", 1, 4096, "Widths of the hidden layers of the last MLP (disn: of both)."),
    INTS("model.point", "16, 32, 64", 1, 4096, "disn: widths of the layers on the position of a point, for each stream."),
    INT("model.grid", "17", 3, 257, "fvor: voxels along an edge of the feature volume; 2^(levels - 1) m + 1."),
    INTS("model.volume", "1, 2, 2", 1, 256, "fvor: fields (of 8 channels) of each level of the volume's U-Net, finest first."),
    INT("model.global", "64", 1, 4096, "disn: numbers of the whole object, for the global stream."),

    INTS("render.types", "0, 2, 4, 8, 16, 32, 64, 128", 0, 1024,
         "renderer: angular types omega of the fields along a ray; 0, then rising."),
    INT("render.channels", "4", 1, 64, "renderer: channels of each type."),
    INT("render.scalars", "0", 0, 64,
        "renderer: channels of type 0, a multiple of render.channels; 0: as of the other types."),
    INT("render.heads", "4", 1, 64, "renderer: attention heads; they divide the channels."),
    INT("render.hidden", "16", 1, 1024, "renderer: hidden width of the kernels' profiles over the angle."),
    BOOL("render.layer_norm", "true", "renderer: invariant layer norms; long trainings need them."),
    BOOL("render.along_ray", "true", "renderer: attention along the ray; without it densities know no context."),
    INT("render.width", "16", 4, 256, "ibrnet: numbers of a sample in the ray transformer, a multiple of 4."),
    CHOICE("render.feature_net", "small", "small|resnet34",
           "Features of the source views: a small U-Net at half size, or IBRNet's at a quarter."),
    INT("render.feature_width", "12", 1, 512, "Channels of the feature network's first convolution (resnet34: 64)."),
    INT("render.features", "12", 1, 256, "Feature channels sampled by each network (coarse, fine)."),
    INT("render.sources", "6", 1, 64, "Source views of a target view."),
    INT("render.samples", "24", 2, 1024, "Samples of a ray, in strata of inverse depth."),
    INT("render.fine_samples", "0", 0, 1024,
        "Samples added where the coarse network found density, for a second network; 0: no second network."),

    PATH("data.root", "builtin",
         "Folder of the categories (for renderers: where paths of scenes begin), or the word builtin."),
    TEXT("data.scenes", "none", "Renderers: folders of scenes to train on, with commas between; a folder of scenes counts as all of them; or the word none."),
    TEXT("data.val_scenes", "none", "Renderers: scenes to validate on; none: the val views of the training scenes. A scene without val views is validated on its training views."),
    TEXT("data.test_scenes", "none", "Renderers: scenes to evaluate on; none: the test views of the training scenes. A scene without test views is evaluated on its training views."),
    INT("data.builtin_scenes", "0", 0, 100000, "Renderers: built-in scenes to train on, ray-traced; the same for every seed."),
    INT("data.test_builtin", "0", 0, 100000, "Renderers: unseen built-in scenes to evaluate on."),
    CHOICE("data.kinds", "all", "all|objects|glossy|diffuse|forward",
           "Kinds of built-in scenes: glossy and diffuse objects from all around, forward-facing ones, or some of them in turn."),
    PATH("data.scene_meshes", "none", "Renderers: folder of meshes to make built-in scenes from: all in it and three folders down, whatever its lists say; none: procedural shapes."),
    INT("data.scene_size", "100", 16, 4096, "Pixels along an edge of the pictures of built-in scenes."),
    REAL("data.highlight", "1", 0, 100, "Built-in scenes: strength of the glossy objects' highlights, times the usual."),
    INT("data.longest", "128", 0, 32768,
        "Renderers: pictures are reduced by the least whole factor that leaves at most this many pixels along the longer edge; 0: not."),
    INT("data.factor", "0", 0, 64, "Renderers: pictures are reduced by this factor; 0: by data.longest."),
    INT("data.hold_out", "8", 0, 1000, "Renderers: every so-manieth view of a scene without splits is for testing; 0: none."),
    CHOICE("data.bounds", "auto", "auto|file",
           "Near and far: shrunk to a sphere around what objects on white ground show, or as the files say, times the factors."),
    REAL("data.near_factor", "0.9", 0.001, 1000, "Renderers: factor of the nearest depth that the files of a scene say."),
    REAL("data.far_factor", "1.2", 0.001, 1000, "Renderers: factor of the median farthest depth that the files of a scene say."),
    CHOICE("data.nearness", "auto", "auto|angle|distance",
           "Source views are the nearest by angle at the scene's centre, or by distance; auto: by angle if the cameras surround it."),
    CHOICE("data.background", "auto", "auto|white|black",
           "What shines through where nothing is dense; auto: white where pictures are transparent or have a white rim."),
    REAL("data.real_share", "0.5", 0, 1, "Share of the steps that take a scene from files where built-in ones are mixed in."),
    TEXT("data.category", "chair", "Folder below the root; built-in shapes are chair, airplane and car."),
    CHOICE("data.setting", "I", "I|Z|R|Y|SO3",
           "How views are turned: not; each rolled; look-at points moved and rolled; object about y; object freely. Renderers: I."),
    INT("data.image_size", "65", 3, 4097, "Pixels along an edge of a view; 32 k + 1 keeps quarter turns exact."),
    CHOICE("data.channels", "shade-mask", "shade-mask|colour",
           "Channels of a view: shade and mask, or red, green, blue and mask."),
    INT("data.supersample", "3", 1, 16, "Rays along an edge of a pixel, averaged."),
    CHOICE("data.light", "world", "world|head",
           "Light fixed in the world, or at the camera (hides the edges of boxes)."),
    INT("data.shapes", "400", 1, 1000000, "Built-in shapes to train on."),
    INT("data.val_shapes", "12", 0, 100000, "Most shapes (renderers: views) to validate on; 0: no validation."),
    INT("data.test_shapes", "40", 1, 100000, "Built-in shapes to test on."),
    INT("data.extra_builtin", "0", 0, 1000000, "Built-in shapes added to the training shapes of a real category."),
    INT("data.real_repeat", "6", 1, 1000, "How often an epoch draws a real shape where built-in ones are added."),
    INT("data.draws", "4", 1, 1000,
        "Random draws of the settings Z, R, Y and SO3 kept for a training shape; an epoch takes the next one."),
    INT("data.points_uniform", "6000", 1, 10000000, "Points in the cube stored for a shape."),
    INT("data.points_near", "6000", 1, 10000000, "Points near the surface stored for a shape."),
    REAL("data.thickness", "-1", -1, 0.1,
         "Taken off the distances, so that open sheets have an inside; -1: 0.004 for files, 0 for built-in shapes."),
    CHOICE("data.sign", "auto", "auto|escape|winding",
           "Inside or outside: by rays that escape, by winding number, or chosen by the mesh."),
    INT("data.cache_mb", "2000", 1, 1000000, "Most memory for stored views and points, in MB; renderers: for pictures of the scenes of a split."),

    REAL("loss.clamp", "0.1", 1e-6, 10, "Distances are clamped to plus or minus this, on both sides."),
    REAL("loss.near", "0.01", -10, 10, "Points with a distance up to this get the weight near_weight."),
    REAL("loss.near_weight", "4", 0, 1000, "Weight of points near or inside the surface; others have 1."),
    REAL("loss.scale", "10", 1e-3, 1e6, "The network predicts the distance times this."),

    INT("train.steps", "4000", 0, 1000000000, "Steps of the whole training."),
    INT("train.shapes_per_step", "2", 1, 1024, "Shapes of a step."),
    INT("train.points_per_shape", "256", 1, 1000000, "Query points of each shape of a step."),
    INT("train.rays", "64", 1, 1000000, "Renderers: target rays of a step, all of one picture."),
    INT("train.tile_rays", "2", 1, 1024, "Renderers: rays a worker takes at once; its memory should fit the L2 cache."),
    INTS("train.pool", "40, 40, 20", 0, 100,
         "Renderers: per cent of steps that draw the sources from the nearest 1, 2 and 3 times as many views."),
    REAL("train.white_share", "0.8", 0, 1, "Renderers: share of pure white pixels that are put at the end of the draw, on a white ground."),
    INT("train.seen_samples", "4", 0, 1024, "Renderers: a ray counts if more than so many of its samples are seen by two views."),
    REAL("train.near_fraction", "0.5", 0, 1, "Share of query points near the surface; others fill the cube."),
    REAL("train.lr", "5e-3", 0, 10, "Learning rate after the warm-up."),
    CHOICE("train.schedule", "cosine", "constant|cosine|step", "How the learning rate falls after the warm-up."),
    INT("train.warmup", "100", 0, 1000000000, "Steps over which the learning rate rises from 0."),
    REAL("train.final_lr", "0.01", 0, 1, "cosine: learning rate at the last step, as a share of lr."),
    INT("train.decay_every", "1000", 1, 1000000000, "step: steps between two decays."),
    REAL("train.decay_factor", "0.5", 0, 1, "step: factor of the learning rate at each decay."),
    CHOICE("train.optimizer", "adam", "adam|adamw", "adamw decays weights apart from the gradient."),
    REAL("train.beta1", "0.9", 0, 0.999999, "Memory of the gradient's mean."),
    REAL("train.beta2", "0.999", 0, 0.99999999, "Memory of the gradient's square."),
    REAL("train.eps", "1e-8", 1e-30, 1, "Added to the root of the gradient's square."),
    REAL("train.weight_decay", "0", 0, 10, "Decay of the weights in a step, times lr."),
    REAL("train.clip", "0", 0, 1e9, "Largest norm of the whole gradient; 0: no clipping."),
    INT("train.seed", "0", 0, 2147483647, "Names all random numbers of the run."),
    INT("train.checkpoint_every", "500", 1, 1000000000, "Steps between two checkpoints; the last step has one too."),
    INT("train.keep", "3", 1, 100000, "Newest checkpoints kept, beside the best by validation."),
    INT("train.log_every", "50", 1, 1000000000, "Steps between two lines of metrics.jsonl."),
    INT("train.val_every", "500", 1, 1000000000, "Steps between two validations."),
    INT("train.tile_points", "32", 1, 65536, "Query points a worker takes at once; its memory should fit the L2 cache."),
    INT("train.max_bad_steps", "10", 1, 1000000, "Steps in a row with a non-finite loss or gradient that stop the run."),

    INT("eval.resolution", "128", 8, 1024, "Cells along an edge of the grid that meshes are taken from."),
    REAL("eval.lipschitz", "1", 0, 100, "Slope of the field that leaving out grid cells relies on; 2 is safer and takes half as long again."),
    INT("eval.coarse", "32", 4, 1024, "Cells of the first, coarse grid; resolution is it times a power of two."),
    INT("eval.views", "0", 0, 100000, "Renderers: most views of a scene to evaluate; 0: all."),
    INT("eval.sources", "0", 0, 64, "Source views of an evaluated view, 0: render.sources; reconstruction: how many of the 8 views are used, 0: all. The networks take any number."),
    INT("eval.shrink", "1", 1, 16, "Renderers: pictures are rendered at 1/this of their size and enlarged."),
    BOOL("eval.skip_unseen", "true", "renderer: samples that no source view sees are not computed (exact)."),
    BOOL("eval.skip_outside", "false", "Renderers: samples outside the ball that outlines leave for the scene are not computed."),
    REAL("eval.empty", "-1", -1, 1, "Renderers: no fine samples on rays whose coarse opacity is at most this; -1: everywhere."),
    REAL("eval.stop", "0", 0, 1, "Renderers: fine samples behind which the coarse network leaves less than this much light are left out; 0: none."),
    INT("eval.points", "100000", 1, 100000000, "Points of the IoU in the cube, and of Chamfer on each surface."),
};
/* clang-format on */
const int lf_schema_size = (int)(sizeof lf_schema / sizeof *lf_schema);

int lf_schema_find(const char *name)
{
    for (int i = 0; i < lf_schema_size; i++)
        if (!strcmp(lf_schema[i].name, name))
            return i;
    return -1;
}

static size_t section_length(const char *name)
{
    return strcspn(name, ".");
}

bool lf_schema_section(const char *section)
{
    for (int i = 0; i < lf_schema_size; i++)
        if (section_length(lf_schema[i].name) == strlen(section) &&
            !strncmp(lf_schema[i].name, section, strlen(section)))
            return true;
    return false;
}

/* Levenshtein's distance of a and b, of which the first 63 bytes count. */
static int distance(const char *a, const char *b)
{
    int row[64];
    const int na = (int)strnlen(a, 63), nb = (int)strnlen(b, 63);
    for (int j = 0; j <= nb; j++)
        row[j] = j;
    for (int i = 1; i <= na; i++) {
        int diagonal = row[0];
        row[0] = i;
        for (int j = 1; j <= nb; j++) {
            const int replace = diagonal + (a[i - 1] != b[j - 1]);
            const int insert = 1 + (row[j] < row[j - 1] ? row[j] : row[j - 1]);
            diagonal = row[j];
            row[j] = replace < insert ? replace : insert;
        }
    }
    return row[nb];
}

/* The right key in a wrong section is one mistake. */
static int key_distance(const char *name, const char *known)
{
    const char *a = strchr(name, '.'), *b = strchr(known, '.');
    const int whole = distance(name, known);
    const int part = 1 + distance(a ? a + 1 : name, b ? b + 1 : known);
    return part < whole ? part : whole;
}

const char *lf_schema_nearest(const char *name)
{
    int best = 0;
    for (int i = 1; i < lf_schema_size; i++)
        if (key_distance(name, lf_schema[i].name) < key_distance(name, lf_schema[best].name))
            best = i;
    return lf_schema[best].name;
}

void lf_schema_nearest_section(const char *section, char nearest[64])
{
    int best = 1 << 20;
    for (int i = 0; i < lf_schema_size; i++) {
        char known[64];
        snprintf(known, sizeof known, "%.*s", (int)section_length(lf_schema[i].name),
                 lf_schema[i].name);
        const int d = distance(section, known);
        if (d < best) {
            best = d;
            memcpy(nearest, known, sizeof known);
        }
    }
}
