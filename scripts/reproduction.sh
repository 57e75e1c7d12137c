# reproduction.sh: what scripts/reproduce runs: systems, sizes, tables. Sourced by it; $size, $tables and
# $seeds are its options. The size test is that of tests/test_reproduce.sh.

# Config and keys of a system, into $config and $keys.
describe() {
    keys=""
    case $1 in
    equivariant) config=reconstruct-tiny ;;
    fvor | disn) config=reconstruct-$1 ;;
    without-se2) config=ablation-plain ;;
    without-se2-equal-cost) config=reconstruct-plain ;;
    max-pool | scalars) config=ablation-$1 ;;
    smoothed) config=reconstruct-tiny keys=model.antialias=true ;;
    ibrnet-sdf) config=reconstruct-ibrnet ;;
    ibrnet-sdf-plain)
        config=reconstruct-ibrnet
        keys="model.backbone=plain model.plain_channels=1 model.stem_fields=9 model.fields=9,18,36" ;;
    ibrnet-sdf-plain-equal-cost) config=reconstruct-ibrnet keys="model.backbone=plain" ;;
    renderer) config=render-tiny ;;
    ibrnet) config=render-tiny keys="model.type=ibrnet" ;;
    renderer-without-along-ray) config=render-tiny keys="render.along_ray=false" ;;
    renderer-scalars) # of about equal parameters
        config=render-tiny
        keys="render.types=0 render.scalars=0 render.channels=24" ;;
    renderer-wide) config=render-tiny keys="render.channels=8 render.scalars=32" ;; # of all types
    esac
}

# The keys that the size adds for a system.
size_keys() {
    case $1 in
    renderer* | ibrnet)
        case $size in
        test) echo train.steps=2 data.val_shapes=0 data.builtin_scenes=2 data.scene_size=24 render.samples=6 \
            render.sources=3 train.rays=8 ;;
        quick) echo train.steps=1500 data.val_shapes=0 data.builtin_scenes=24 ;;
        small) echo train.steps=50000 data.scene_size=200 data.longest=256 render.samples=64 render.features=16 ;;
        paper) echo train.steps=250000 data.scene_size=400 data.longest=0 render.samples=64 \
            render.fine_samples=64 render.sources=10 eval.sources=10 render.features=32 \
            render.feature_net=resnet34 render.feature_width=64 train.rays=512 ;;
        esac
        case $size-$1 in
        paper-renderer-scalars) echo render.channels=28 ;;
        paper-*) echo render.types=0,2,4,8,16,32,64,128 render.scalars=0 ;; # as published: as many of all types
        esac ;;
    *)
        case $size in
        test) echo train.steps=2 data.val_shapes=0 data.shapes=2 data.image_size=33 data.supersample=1 data.draws=1 \
            data.points_uniform=300 data.points_near=300 data.test_shapes=1 train.points_per_shape=32 \
            eval.resolution=16 eval.coarse=8 eval.points=500 ;;
        quick) echo train.steps=1500 data.val_shapes=0 data.shapes=150 data.test_shapes=8 data.draws=2 \
            data.points_uniform=3000 data.points_near=3000 eval.resolution=64 ;;
        small | paper) widths "$1" ;;
        esac ;;
    esac
}

# Widths of the larger sizes. small: the equivariant network and its ablations twice as wide, so that what matches
# stays matched, and the others about so; paper: the published widths, where the paper or the compared systems' papers
# say them.
widths() {
    case $size-$1 in
    small-*) echo train.steps=30000 data.image_size=129 data.shapes=2000 data.cache_mb=8000 ;;
    paper-*) echo train.steps=300000 data.image_size=225 data.shapes=5000 data.cache_mb=64000 \
        train.points_per_shape=2048 train.shapes_per_step=4 ;;
    esac
    case $size-$1 in
    small-equivariant | small-smoothed | small-without-se2-equal-cost)
        echo model.stem_fields=8 model.fields=8,16,32 model.scalars=32 model.vectors=16 model.mlp=128,128 ;;
    small-without-se2)
        echo model.stem_fields=18 model.fields=18,36,72 model.scalars=32 model.vectors=16 model.mlp=128,128 ;;
    small-max-pool) echo model.stem_fields=8 model.fields=8,16,32 model.mlp=224,224 ;;
    small-scalars) echo model.stem_fields=8 model.fields=8,16,32 model.scalars=48 model.mlp=128,128 ;;
    small-ibrnet-sdf | small-ibrnet-sdf-plain-equal-cost)
        echo model.stem_fields=8 model.fields=8,16,32 model.width=32 model.mlp=32 ;;
    small-ibrnet-sdf-plain) echo model.stem_fields=18 model.fields=18,36,72 model.width=32 model.mlp=32 ;;
    small-disn) echo model.stem_fields=4 model.fields=4,6,8 model.point=32,64,128 model.global=128 model.mlp=128,128 ;;
    small-fvor) echo model.stem_fields=4 model.fields=4,6,8 model.grid=33 model.volume=2,4,4 model.mlp=128,128 ;;
    paper-equivariant | paper-smoothed | paper-without-se2-equal-cost)
        echo model.stem_fields=8 model.stages=2,2,2,2 model.fields=8,16,32,64 model.scalars=64 model.vectors=32 \
            model.blocks=3 model.mlp=256,256 ;;
    paper-without-se2)
        echo model.stem_fields=18 model.stages=2,2,2,2 model.fields=18,36,72,144 model.scalars=64 model.vectors=32 \
            model.blocks=3 model.mlp=256,256 ;;
    paper-max-pool)
        echo model.stem_fields=8 model.stages=2,2,2,2 model.fields=8,16,32,64 model.mlp=448,448 ;;
    paper-scalars)
        echo model.stem_fields=8 model.stages=2,2,2,2 model.fields=8,16,32,64 model.scalars=96 model.blocks=3 \
            model.mlp=256,256 ;;
    paper-ibrnet-sdf | paper-ibrnet-sdf-plain-equal-cost)
        echo model.stem_fields=8 model.stages=2,2,2,2 model.fields=8,16,32,64 ;;
    paper-ibrnet-sdf-plain)
        echo model.stem_fields=18 model.stages=2,2,2,2 model.fields=18,36,72,144 ;;
    paper-disn)
        echo model.stem_fields=8 model.stages=2,2,2,2 model.fields=8,16,32,64 model.point=64,256,512 \
            model.global=1024 model.mlp=512,256 ;;
    paper-fvor)
        echo model.stem_fields=8 model.stages=2,2,2,2 model.fields=8,16,32,64 model.grid=65 \
            model.volume=4,8,16,32,64,64,64 model.mlp=512,512,512,64 ;;
    esac
}

# The runs of a table: "data system category training-setting test-settings", a line each.
runs_of() {
    settings="I:I,Z,R R:R Y:Y,SO3 SO3:SO3" shapes=built-in
    [ -z "$shapes_at" ] || shapes=files
    case $1 in
    table1) systems="equivariant fvor disn" categories="chair airplane car" ;;
    ablation) systems="equivariant without-se2 without-se2-equal-cost max-pool scalars smoothed" categories=chair ;;
    ibrnet-sdf)
        systems="equivariant ibrnet-sdf-plain ibrnet-sdf-plain-equal-cost ibrnet-sdf" categories=chair
        settings="Y:Y,SO3 SO3:SO3" ;;
    rendering)
        for system in renderer ibrnet renderer-wide renderer-without-along-ray renderer-scalars; do
            echo "built-in $system all I I,SO3"
            # of real scenes the renderer is as wide already: configs/render-real.ini
            [ -z "$scenes_at" ] || [ $system = renderer-wide ] || echo "files $system all I I,SO3"
        done
        return ;;
    counts) return ;;
    esac
    present=""
    for category in $categories; do
        [ $shapes = built-in ] || [ -n "$(category_folder "$category")" ] || {
            echo "reproduce: $shapes_at has no $category: left out" >&2
            continue
        }
        present="$present $category"
    done
    # what fills the most columns comes first
    for pair in $settings; do
        for category in $present; do
            for system in $systems; do
                echo "$shapes $system $category ${pair%:*} ${pair#*:}"
            done
        done
    done
}

# All runs with their seeds, every training once, with the test settings of all tables.
plan() {
    for table in $tables; do runs_of "$table"; done | awk -v seeds="$seeds" '
        { key = $1 " " $2 " " $3 " " $4
          if (!(key in tests)) { order[++n] = key; tests[key] = $5 }
          else if (length($5) > length(tests[key])) tests[key] = $5 }
        END { for (s = 0; s < seeds; s++) for (i = 1; i <= n; i++) print order[i], tests[order[i]], s }'
}
