# reproduction-data.sh: the shapes and scenes of scripts/reproduce --data. Sourced by it; $data, $here, $size and
# $tables are its variables.

# Folders with categories of shapes and with scenes: in $data, or it is one of them itself.
shapes_at="" scenes_at=""

# The folder of a category below $1: its name, or the number that ShapeNet has for it; nothing if there is none.
folder_below() { # FOLDER CATEGORY
    case $2 in chair) number=03001627 ;; airplane) number=02691156 ;; car) number=02958343 ;; esac
    for name in "$2" $number; do
        [ ! -d "$1/$name" ] || { echo "$name" && return; }
    done
}

category_folder() { folder_below "$shapes_at" "$1"; }

# Keys that a training on few shapes of a category gets: few real chairs are at hand (configs/reconstruct-chair.ini).
few_shapes() { # CATEGORY
    [ "$(category_folder "$1")" = chair ] && [ "$(ls "$shapes_at/chair" | wc -l)" -lt 500 ] || return 0
    case $size in
    test) echo " data.extra_builtin=1" ;;
    quick) echo " data.extra_builtin=100" ;;
    *) echo " data.extra_builtin=400" ;;
    esac
}

# The real scene that is tested for one of the paper's kinds.
scene_of() {
    case $1 in
    glossy) echo nerf_synthetic/chair ;;
    forward) echo llff/fern ;;
    diffuse) echo deepvoxels_format/train/toycar ;;
    esac
}

# Find the folders.
open_data() {
    [ -n "$data" ] || return 0
    given=$data
    data=$(cd "$here" && cd "$data" 2>/dev/null && pwd -P) || refuse "--data $given: no such folder"
    [ ! -d "$data/shapes" ] || shapes_at=$data/shapes
    [ ! -d "$data/scenes" ] || scenes_at=$data/scenes
    if [ -z "$shapes_at$scenes_at" ]; then
        [ ! -d "$data/nerf_synthetic" ] || scenes_at=$data
        for category in chair airplane car; do
            [ -z "$(folder_below "$data" "$category")" ] || shapes_at=$data
        done
    fi
    [ -n "$shapes_at$scenes_at" ] || refuse "--data $data: has neither shapes/ nor scenes/, nor is one of them"
}

# Refuse what would fail after hours: scenes that are not there, or a table of which nothing can be run. Say what
# --data does not have.
check_data() {
    [ -n "$data" ] || return 0
    absent=""
    case " $tables " in
    *" rendering "*)
        [ -n "$scenes_at" ] || echo "reproduce: $data has no scenes: built-in ones alone" >&2
        for scene in $(sed -n 's/[;#].*//; s/^\(test_\)\{0,1\}scenes *= *//p' configs/render-real.ini | tr , ' ') \
            "$(scene_of glossy)" "$(scene_of forward)" "$(scene_of diffuse)"; do
            case "$absent " in *" $scene "*) continue ;; esac
            [ -z "$scenes_at" ] || [ -d "$scenes_at/$scene" ] || absent="$absent $scene"
        done ;;
    esac
    [ -z "$absent" ] || refuse "$scenes_at: has no$absent: give another --data, or the other tables by --only"
    case " $tables " in
    *" table1 "* | *" ablation "* | *" ibrnet-sdf "*)
        [ -n "$shapes_at" ] || echo "reproduce: $data has no shapes: built-in ones instead" >&2 ;;
    esac
    [ "$tables" = counts ] || [ -n "$(plan 2>/dev/null)" ] ||
        refuse "$shapes_at: has none of the categories of $tables: nothing to run"
}

open_data
