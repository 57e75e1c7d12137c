# reproduction-run.sh: a run of scripts/reproduce: a training, its tests, and what of them goes to the documents.
# Sourced by it, whose functions and variables it uses.

# The value of KEY in a JSON file of elf's own making, INDENT spaces deep: the first one.
value() { sed -n "s/^ \{$3\}\"$2\": \(.*[^,]\),\{0,1\}\$/\1/p" "$1" | sed 1q; }
logged_value() { sed -n '$s/.*"'"$2"'":\([^,}]*\).*/\1/p' "$1/metrics.jsonl"; }
config_value() { sed -n "s/^$2 = //p" "$1/config.ini" | sed 1q; }

# Config and keys of a training, into $config and $all_keys: DATA SYSTEM CATEGORY SETTING SEED.
training_sets() {
    describe "$2"
    where="" added=""
    case $1-$2 in
    files-renderer* | files-ibrnet)
        config=render-real
        [ "$2" != renderer-scalars ] || keys="render.types=0 render.channels=28" ;; # of render-real's parameters
    files-*)
        added=$(few_shapes "$3")
        where=" data.category=$(category_folder "$3") data.setting=$4$added" ;;
    *-renderer* | *-ibrnet) ;;
    *) where=" data.category=$3 data.setting=$4" ;;
    esac
    all_keys="$keys $(size_keys "$2" | tr '\n' ' ')$where train.seed=$5 train.keep=1"
    keys=$keys$added # what a result says
    keys=${keys# }
}

with_sets() { # PROGRAM ARGUMENTS...: run with --set of every word of $all_keys and the paths of $data
    for word in $all_keys; do set -- "$@" --set "$word"; done
    case $run_data-$run_system in
    files-renderer* | files-ibrnet)
        set -- "$@" --set "data.root=$scenes_at"
        [ -z "$shapes_at" ] || set -- "$@" --set "data.scene_meshes=$shapes_at" ;;
    files-*) set -- "$@" --set "data.root=$shapes_at" ;;
    esac
    "$@"
}

# Train into $folder, or go on, unless it is done. Checkpoints, logs and results live there.
train() {
    training_sets "$run_data" "$run_system" "$run_category" "$run_setting" "$run_seed"
    mkdir -p "$folder"
    settings=$(sed 's/[;#].*//; s/[ \t]*$//; /^$/d' "configs/$config.ini" | cksum)
    echo "$config ${settings%% *} $all_keys$([ "$run_data" = built-in ] || echo " $data")" >"$folder/arguments.tmp"
    if [ -e "$folder/arguments" ] && ! cmp -s "$folder/arguments" "$folder/arguments.tmp"; then
        refuse "$folder: was begun with another config or other keys (see arguments and arguments.tmp there):" \
            "move it away, or give --out"
    fi
    mv "$folder/arguments.tmp" "$folder/arguments"
    [ ! -e "$folder/trained" ] || return 0
    if ls "$folder"/checkpoints/step-*.safetensors >/dev/null 2>&1; then
        logged "$folder/train.log" "$elf_train" --resume "$folder" || return 1
    else
        # killed before its first checkpoint: nothing to lose
        rm -rf "$folder/checkpoints" "$folder/config.ini" "$folder/metrics.jsonl" "$folder/latest" "$folder/best"
        with_sets logged "$folder/train.log" "$elf_train" "configs/$config.ini" --out "$folder" || return 1
    fi
    with_sets logged "$folder/train.log" "$elf_train" "configs/$config.ini" --count --json "$folder/count.json" ||
        return 1
    : >"$folder/trained"
}

# How many shapes or scenes were trained on, as elf-train says it: the last time, if it was resumed.
trained_on() { sed -n 's/^train: \([0-9]*\) s[hc][a-z]*.*/\1/p' "$folder/train.log" | tail -n 1; }

# The part of a result before its figures: EXPERIMENT PIXELS TEST-ITEMS SECONDS-PER-ITEM.
result_head() {
    cat <<END
{
  "experiment": "$1",
  "system": "$run_system",
  "config": "$config",
  "keys": "$keys",
  "size": "$size",
  "size_keys": "$(size_keys "$run_system" | tr '\n' ' ' | sed 's/ $//')",
  "data": "$run_data",
  "category": "$result_category",
  "train_setting": "$run_setting",
  "eval_setting": "$result_setting",
  "seed": $run_seed,
  "steps": $(logged_value "$folder" step),
  "pixels": $2,
  "train_items": $(trained_on),
  "test_items": $3,
  "parameters": $(value "$folder/count.json" parameters 2),
  "train_seconds": $(logged_value "$folder" seconds),
  "peak_rss_mb": $(logged_value "$folder" peak_rss_mb),
  "seconds_per_item": $4,
  "commit": "$commit",
END
}

# The results of the run, a word each: NAME:CATEGORY:SETTING, of result-NAME.json. A renderer has one for each kind of
# scenes, and the categories of its tables are the kinds.
results() {
    for setting in $(echo "$run_tests" | tr , ' '); do
        case $run_system in
        renderer* | ibrnet) for kind in glossy forward diffuse; do echo "$kind-$setting:$kind:$setting"; done ;;
        *) echo "$setting:$run_category:$setting" ;;
        esac
    done
}

take_result() { # a word of results: the variables of a result
    result_name=${1%%:*} result_category=${1#*:} result_setting=${1##*:}
    result_category=${result_category%:*}
    result=$folder/result-$result_name.json report=$folder/report-$result_name.json
}

# Is the result there, with LPIPS if its weights are given?
result_done() { [ -e "$result" ] && { [ -z "$lpips" ] || ! grep -q '"lpips": null' "$result"; }; }

# Evaluate; the result is the last thing written.
evaluate_shapes() {
    case $size in test) most="--shapes 1" ;; quick) most="--shapes 8" ;; *) most="" ;; esac
    logged "$folder/eval.log" "$elf_eval" --checkpoint "$folder" --setting "$result_setting" $most --no-baselines \
        --json "$report" || return 1
    {
        result_head reconstruction "$(config_value "$folder" image_size)" \
            "$(value "$report" shapes 2)" "$(value "$report" seconds_per_shape 2)"
        printf '  "figures": {"iou": %s, "chamfer_l1": %s, "empty": %s}\n}\n' "$(value "$report" iou 2)" \
            "$(value "$report" chamfer_l1 2)" "$(value "$report" empty 2)"
    } | put_result "$result"
}

evaluate_scenes() {
    case $size in test) views=1 scenes=1 ;; quick) views=2 scenes=2 ;; *) views=3 scenes=2 ;; esac
    where=data.kinds=$result_category edge=scene_size
    if [ "$run_data" = files ]; then where=data.test_scenes=$(scene_of "$result_category") scenes=0 edge=longest; fi
    set -- --setting "$result_setting" --views $views --set "$where" --set data.test_builtin=$scenes --json "$report"
    [ -z "$lpips" ] || set -- "$@" --lpips-weights "$lpips"
    logged "$folder/eval.log" "$elf_eval" --checkpoint "$folder" --no-baselines "$@" || return 1
    {
        result_head rendering "$(config_value "$folder" $edge)" "$(value "$report" images 2)" "$(value "$report" seconds 4)"
        printf '  "figures": {"psnr": %s, "ssim": %s, "lpips": %s, "pixel_variance": %s}\n}\n' \
            "$(value "$report" psnr 4)" "$(value "$report" ssim 4)" "$(value "$report" lpips 4)" \
            "$(value "$report" pixel_variance 4)"
    } | put_result "$result"
}

# Copy the result to the documents; results of old have no seconds a test item, but their reports do.
publish() {
    to=$docs/reproduction/$size-$run_data-$run_system-$result_category-$run_setting-$result_setting-$run_seed.json
    seconds=$(value "$report" seconds_per_shape 2 2>/dev/null)
    [ -n "$seconds" ] || seconds=$(value "$report" seconds 4 2>/dev/null)
    awk -v seconds="$seconds" '/"seconds_per_item"/ { told = 1 }
        /^  "commit"/ && !told && seconds { print "  \"seconds_per_item\": " seconds "," }
        { print }' "$result" >"$to.tmp" && mv "$to.tmp" "$to"
}

report() {
    set -- "$docs/reproduction" --out "$docs/reproduction.md" --quiet
    [ -z "$readme" ] || set -- "$@" --readme "$readme"
    "$elf_eval" reproduction "$@"
}

results_missing() { # how many results of the run are not there
    missing=0
    for word in $(results); do
        take_result "$word"
        result_done || missing=$((missing + 1))
    done
    echo $missing
}

publish_there() { # what the run has, without running anything
    for word in $(results); do
        take_result "$word"
        [ ! -e "$result" ] || publish
    done
}

take() { # DATA SYSTEM CATEGORY SETTING TESTS SEED: the variables of a run
    run_data=$1 run_system=$2 run_category=$3 run_setting=$4 run_tests=$5 run_seed=$6
    folder=$out/$size/$run_data/$run_system-$run_category-$run_setting-$run_seed
}

do_run() {
    train || return 1
    for word in $(results); do
        take_result "$word"
        if ! result_done; then
            case $run_system in
            renderer* | ibrnet) evaluate_scenes || return 1 ;;
            *) evaluate_shapes || return 1 ;;
            esac
        fi
        publish || return 1
    done
}

count_models() {
    mkdir -p "$out/$size/counts"
    for run_system in equivariant fvor disn without-se2 without-se2-equal-cost max-pool scalars smoothed ibrnet-sdf \
        ibrnet-sdf-plain ibrnet-sdf-plain-equal-cost renderer ibrnet renderer-wide renderer-without-along-ray \
        renderer-scalars; do
        run_data=built-in
        describe "$run_system"
        all_keys="$keys $(size_keys "$run_system" | tr '\n' ' ')"
        count=$out/$size/counts/$run_system.json
        with_sets logged "$out/$size/counts/log" "$elf_train" "configs/$config.ini" --count --json "$count" || return 1
        put_result "$docs/reproduction/$size-count-$run_system.json" <<END || return 1
{
  "experiment": "count",
  "system": "$run_system",
  "config": "$config",
  "keys": "$keys",
  "size": "$size",
  "size_keys": "$(size_keys "$run_system" | tr '\n' ' ' | sed 's/ $//')",
  "parameters": $(value "$count" parameters 2),
  "of": $(value "$count" of 4),
  "flop_forward": $(value "$count" flop_forward 4),
  "flop": $(value "$count" flop 4),
  "commit": "$commit"
}
END
    done
    echo "counted the parameters and operations of every model"
}
