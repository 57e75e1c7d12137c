#!/bin/bash
# test_speed_error.sh ELF_TRAIN ELF_EVAL SAME_ARRAYS SOURCE ELF_EVAL_F64: savings against the exact result,
# for both families, on models as small as they get; what the programs in float and double agree on.
set -u
eval64=$(realpath "$5")
. "$4/tests/programs.sh"

cat >recon.ini <<'END'
[model]
stages = 1, 1
fields = 1, 2
stem_fields = 1
features = 2
scalars = 4
vectors = 4
mlp = 8
blocks = 1
[data]
image_size = 33
supersample = 1
shapes = 2
val_shapes = 0
test_shapes = 2
points_uniform = 200
points_near = 200
[train]
steps = 60
warmup = 2
points_per_shape = 64
log_every = 50
[eval]
resolution = 16
coarse = 8
points = 1000
END
cat >render.ini <<'END'
[render]
types = 0, 1
channels = 2
heads = 2
hidden = 4
feature_width = 2
features = 2
sources = 2
samples = 4
fine_samples = 4
[data]
builtin_scenes = 1
test_builtin = 1
scene_size = 24
val_shapes = 0
[train]
steps = 4
warmup = 2
rays = 8
seen_samples = 1
log_every = 2
END
expect 0 '' "$train" recon.ini --out recon
for type in renderer ibrnet; do
    expect 0 '' "$train" render.ini --out $type --set model.type=$type
done

# value FILE NAME KEY: of the first setting whose name begins with NAME
value() {
    awk -v name="\"name\": \"$2" -v key="\"$3\":" '
        index($0, name) { on = 1 }
        on && index($0, key) { sub(/.*: /, ""); sub(/,$/, ""); print; exit }' "$1"
}
# below VALUE LIMIT WHAT
below() { awk -v x="$1" -v most="$2" 'BEGIN { exit !(x != "" && x + 0 <= most + 0) }' || fail "$3: $1, not below $2"; }
# check_report FILE: what both families have
check_report() {
    local name
    for name in experiment family model split items threads repeats metric tolerance definitions settings recommended \
        seconds cpu_seconds memory_mb peak_rss_mb work error mean_difference largest_difference front seconds_error command; do
        grep -q "\"$name\":" "$1" || fail "no $name in $1"
    done
    [ "$(value "$1" exact error)" = 0.0 ] || fail "the exact result has an error in $1"
    [ "$(value "$1" 'in double' error)" = 0.0 ] || [ "$2" = ibrnet ] || fail "coarse to fine in double is not exact"
    below "$(value "$1" 'as configured' largest_difference)" 1e-4 "float against double, $1"
    below "$(value "$1" 'in double' largest_difference)" 1e-12 "double against double, $1"
    awk '/"(seconds|memory_mb|peak_rss_mb|work)": [0-9]/ { sub(/.*: /, ""); if (!($0 + 0 > 0)) bad = 1 } END { exit bad }' "$1" ||
        fail "a time, memory or count is not positive in $1"
}

### Reconstruction

expect 0 'recommended: .*times as fast as configured' "$eval" --checkpoint recon --speed-error --shapes 1 --repeats 2 \
    --out recon-speed --json recon.json --threads 1
grep -q 'elf-eval.* --checkpoint recon' out || fail "no command is recommended"
check_report recon.json recon
[ -s recon-speed/speed-error.png ] || fail "no picture"
[ "$(value recon.json 'dense grid' work)" = 4913.0 ] || fail "the dense grid is not dense"
[ "$(value recon.json 'as configured' error)" = "$(value recon.json 'dense grid' error)" ] ||
    fail "coarse to fine gives another mesh than the dense grid"
below 1e-6 "$(value recon.json '1 source view' mean_difference)" "one source view gives what eight do"
# what is recommended is a command line that works, here in the words of another setting
expect 0 'IoU' "$eval" --checkpoint recon --shapes 1 --set eval.sources=2
expect 0 'IoU' "$eval64" --checkpoint recon --shapes 1
expect 0 'f64' "$eval64" --version
# networks that have a grid, or know the whole object, take fewer views, too
for type in disn fvor ibrnet-sdf; do
    expect 0 '' "$train" recon.ini --out $type --set model.type=$type --set model.grid=5 --set model.volume=1,1 --set train.steps=2
    expect 0 'IoU' "$eval" --checkpoint $type --shapes 1 --set eval.sources=2
done
expect 0 'recommended' "$eval" --checkpoint fvor --speed-error --shapes 1 --repeats 1
expect 2 'an object has 8 views' "$eval" --checkpoint recon --set eval.sources=9
expect 0 '' "$eval" --checkpoint recon --speed-error --shapes 1 --repeats 1 --setting Z --quiet --set eval.sources=4 --json z.json
[ -s out ] && fail "--quiet prints"
grep -q '"eval_setting": "Z"' z.json && grep -q 'exact savings only' z.json || fail "wrong report: $(head -c 500 z.json)"

# every network of the family, with a grid or without one
for type in disn fvor ibrnet-sdf equivariant,model.fusion=max-pool; do
    name=${type%,*}
    IFS=, read -ra keys <<<"model.type=$type"
    expect 0 '' "$train" recon.ini --out "$name-net" --set train.steps=8 --set model.grid=5 --set model.volume=1,1 \
        "${keys[@]/#/--set=}"
    expect 0 'recommended' "$eval" --checkpoint "$name-net" --speed-error --shapes 1 --repeats 1 --json $name-net.json
    check_report "$name-net.json" "$name"
    grep -q '"family": "reconstruction"' "$name-net.json" || fail "$name is no reconstruction"
    below 1e-9 "$(value "$name-net.json" '1 source view' mean_difference)" "$name: one source view gives what eight do"
done

### Rendering

for type in renderer ibrnet; do
    expect 0 'recommended' "$eval" --checkpoint $type --speed-error --shapes 1 --repeats 1 --out $type-speed --json $type.json
    check_report $type.json $type
    [ -s $type-speed/speed-error.png ] || fail "no picture of $type"
    below "$(value $type.json '2 + 2 samples' work)" "$(value $type.json 'as configured' work)" "work with fewer samples"
    below "$(value $type.json 'pictures at' work)" "$(value $type.json 'as configured' work)" "work for a smaller picture"
done
below "$(value renderer.json 'skip_unseen off' largest_difference)" 1e-4 "skip_unseen is exact"
expect 0 'mean over' "$eval" --checkpoint renderer --views 1 --set eval.shrink=2 --out small --no-baselines
[ "$(od -An -tu1 -j16 -N8 small/*rendered.png | awk '{print $4, $8}')" = "24 24" ] || fail "a picture is not enlarged again"
expect 2 'eval\.shrink' "$eval" --checkpoint renderer --set eval.shrink=0

### The programs that are started

expect 0 '' "$eval" --checkpoint recon --measure a.safetensors --shapes 1 --threads 1
expect 0 '' "$eval" --checkpoint recon --measure b.safetensors --shapes 1 --threads 2
expect 0 '' "$eval64" --checkpoint renderer --measure c.safetensors --shapes 1 --views 1
head -c 3000 c.safetensors | grep -aq '"precision":"f64"' || fail "no precision in the file of --measure"
expect 130 "" timeout --preserve-status -s INT 1 "$eval" --checkpoint recon --speed-error --repeats 50
"$eval" --checkpoint recon --speed-error --set data.root=nowhere >out 2>err &
process=$!
wait $process
ls -d /tmp/elf-speed-error-$process-* >out 2>err && fail "a temporary folder stays"

### Bad input

expect 2 'another model' "$eval" --checkpoint recon --speed-error --set model.scalars=8
# a checkpoint whose config is not that of its arrays: found when the network is made
checkpoint=$(ls recon/checkpoints/step-*.safetensors | tail -n 1)
LC_ALL=C sed 's/scalars = 4/scalars = 8/' "$checkpoint" >other.safetensors
cmp -s "$checkpoint" other.safetensors && fail "the checkpoint does not say its scalars"
expect 2 'another model|shape|missing' "$eval" --checkpoint other.safetensors --speed-error
grep -q "the setting 'exact" err || fail "the message does not say which setting failed"
expect 2 'means nothing to --speed-error' "$eval" --checkpoint recon --speed-error --dense
expect 2 'means nothing to --speed-error' "$eval" --checkpoint recon --speed-error --views 2
expect 2 'means nothing to --speed-error of a renderer' "$eval" --checkpoint renderer --speed-error --setting SO3
expect 2 'means nothing to the scores' "$eval" --checkpoint recon --repeats 2
expect 2 'means nothing to --measure' "$eval" --checkpoint recon --measure x --json y
expect 2 '--repeats 0: give a number' "$eval" --checkpoint recon --speed-error --repeats 0
expect 2 'setting' "$eval" --checkpoint recon --speed-error --setting X
expect 2 'data\.val_shapes' "$eval" --checkpoint recon --speed-error --split val
expect 2 'is no folder' "$eval" --checkpoint recon --speed-error --out recon.ini
expect 2 'cannot write there' "$eval" --checkpoint recon --speed-error --json not/there.json
expect 2 'nowhere' "$eval" --checkpoint renderer --speed-error --set data.test_scenes=nowhere
expect 2 'not/there' "$eval" --checkpoint recon --measure not/there --shapes 1
mkdir alone && cp "$eval" alone/elf-eval
expect 2 'elf-eval-f64.*needed beside' alone/elf-eval --checkpoint recon --speed-error
printf '#!/bin/sh\nkill -9 $$\n' >alone/elf-eval-f64 && chmod +x alone/elf-eval-f64
expect 1 'signal 9' alone/elf-eval --checkpoint recon --speed-error --shapes 1

[ $failures = 0 ] || echo "$failures failures"
[ $failures = 0 ]
