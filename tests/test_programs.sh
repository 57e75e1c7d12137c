#!/bin/bash
# test_programs.sh ELF_TRAIN ELF_EVAL SAME_ARRAYS SOURCE: exit codes and messages of the programs, what
# bad input and a full disk do, and that stopped or killed runs end as if they had not been.
set -u
. "$4/tests/programs.sh"

# A model and data as small as they get.
cat >tiny.ini <<'END'
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
shapes = 3
val_shapes = 0
test_shapes = 2
points_uniform = 200
points_near = 200
[train]
steps = 6
warmup = 2
points_per_shape = 32
tile_points = 16
checkpoint_every = 3
log_every = 2
[eval]
resolution = 16
coarse = 8
points = 1000
END

checkpoint() { printf '%s/checkpoints/step-%08d.safetensors' "$1" "$2"; }

### Command lines

expect 2 'elf-train: no config given' "$train"
expect 2 'elf-eval: no --checkpoint given' "$eval"
expect 2 'unrecognized option' "$train" --nonsense
expect 2 'unrecognized option' "$eval" --nonsense
expect 2 'requires an argument' "$train" --out
expect 2 'one config is enough' "$train" a.ini b.ini
expect 2 'leave the config out' "$train" tiny.ini --resume x
expect 2 '--threads many: give a number from 1' "$train" tiny.ini --threads many
expect 2 '--threads 0: give a number from 1' "$eval" --threads 0
expect 2 '--profile 0: give a number from 1' "$train" tiny.ini --profile 0
expect 2 '--profile many: give a number from 1' "$train" tiny.ini --profile=many
expect 2 '--out none: --profile writes no run' "$train" tiny.ini --profile --out none
expect 2 '--count trains nothing' "$train" tiny.ini --count --profile
expect 2 'nonsense is not a job' "$eval" nonsense
expect 2 '--split all: give train, val or test' "$eval" --checkpoint x --split all
expect 2 '--shapes 0: give a number' "$eval" --checkpoint x --shapes 0
expect 2 '--roll far: give degrees' "$eval" --checkpoint x --roll far
for program in "$train" "$eval"; do
    expect 0 'Exit codes: 0 done, 1 failed' "$program" --help
    expect 0 '^checkpoint_every = 500' "$program" --help-config
    expect 0 '^elf-(train|eval) [0-9]+\.[0-9]+\.[0-9]+' "$program" --version
    [ -s err ] && fail "--version prints to standard error"
done
expect 0 'longest edge' "$eval" --help # the definitions of the metrics
# every option that a program takes stands in its help
for program in train eval; do
    options=$(grep -hoE '\{"[a-z-]+", (no|required|optional)_argument' "$source/$program/"*.c | cut -d '"' -f 2)
    [ "$(echo "$options" | wc -l)" -ge 10 ] || fail "options of elf-$program are not found"
    "${!program}" --help >out 2>err
    for option in $options; do
        grep -Eq -- "--$option([^a-z-]|\$)" out || fail "elf-$program --help lacks --$option"
    done
done

### Configs

bad() { # bad NUMBER_OF_LINE WORDS TEXT: a config that is refused with its file and line
    printf "$3" >bad.ini
    expect 2 "bad\.ini:$1: .*$2" "$train" bad.ini --out none
}
bad 2 'train\.steps' '[train]\nstep = 5\n'
bad 3 'learning' '\n[train]\nlearning = 5\n'
bad 1 'train' '[trian]\nsteps = 5\n'
bad 2 'train\.steps' '[train]\nsteps = many\n'
bad 2 'train\.lr' '[train]\nlr = 0.1.2\n'
bad 2 'train\.lr' '[train]\nlr = nan\n'
bad 2 '3 to 4097|from 3' '[data]\nimage_size = 0\n'
bad 2 'model\.stem_pool' '[model]\nstem_pool = perhaps\n'
bad 2 'I.*Z.*SO3' '[data]\nsetting = X\n'
bad 2 'key = value' '[train]\nsteps\n'
expect 2 'nothere\.ini: No such file' "$train" nothere.ini
expect 2 'train\.steps' "$train" tiny.ini --set train.step=5
expect 2 'image_size' "$train" tiny.ini --set data.image_size=0
expect 2 '--set' "$train" tiny.ini --set nonsense
expect 2 'teapot.*(chair|airplane)' "$train" tiny.ini --out none --set data.category=teapot
expect 2 'stages|fields' "$train" tiny.ini --out none --set model.fields=1,2,3
expect 2 'heads' "$train" tiny.ini --out none --set model.heads=3
expect 2 'data\.cache_mb' "$train" tiny.ini --out none --set data.cache_mb=1 --set data.points_near=1000000
[ -e none ] && fail "a refused config leaves a run folder"
for config in "$source"/configs/*.ini; do
    case $config in */render*) continue ;; esac # test_render_programs.sh
    expect 2 'no such folder of data|nowhere' "$train" "$config" --out none --set data.root=nowhere
done

### A profile

expect 0 '^block0/rays +[0-9.]+ +[0-9.]+ ' "$train" tiny.ini --profile 2 --json p.json
for key in model threads limit_gflops step tape_mb parts ops parts_and_ops forward_ms limit_share mb; do
    grep -q "\"$key\":" p.json || fail "no $key in a profile"
done
grep -q '"part": "backbone/stage2"' p.json && grep -q '"op": "conv2d"' p.json || fail "no parts or ops in a profile"
[ -e runs ] && fail "a profile leaves a run folder"

### Counting

expect 0 'GFLOP|MFLOP' "$train" tiny.ini --count --json count.json
grep -q '"flop_forward":' count.json || fail "no operations in the JSON of --count"
[ -e runs ] && fail "--count makes a run folder"
expect 2 '--json means nothing without --count' "$train" tiny.ini --json x.json
expect 2 '--count trains nothing' "$train" tiny.ini --count --out none
expect 2 '--count trains nothing' "$train" --count --resume none
expect 2 'fields' "$train" tiny.ini --count --set model.fields=1,2,3
expect 2 'nowhere' "$train" tiny.ini --count --json nowhere/x.json

### A run and its evaluation

expect 0 'memory: .* MB of tapes' "$train" tiny.ini --out run
for file in config.ini metrics.jsonl latest "$(basename "$(checkpoint run 6)")"; do
    [ -n "$(find run -name "$file" -size +0)" ] || fail "no $file in a run's folder"
done
for key in step seconds loss lr grad_norm steps_per_s peak_rss_mb; do
    [ "$(grep -c "\"$key\":" run/metrics.jsonl)" = "$(wc -l <run/metrics.jsonl)" ] || fail "no $key in metrics.jsonl"
done
expect 0 'IoU over 1000 points' "$eval" --checkpoint run --setting Z --json e.json --out meshes --pictures 1
for key in experiment model category train_setting eval_setting split shapes iou chamfer_l1 seconds_per_shape \
    peak_rss_mb per_shape; do
    grep -q "\"$key\":" e.json || fail "no $key in the report"
done
grep -q '"eval_setting": "Z"' e.json && grep -q '"shapes": 2' e.json || fail "wrong report: $(cat e.json)"
ls meshes/*-predicted.ply meshes/*-true.ply meshes/montage.png >/dev/null || fail "no meshes or no picture"
expect 0 'visual hull of the same views: IoU 0\.[0-9]*[1-9], Chamfer' "$eval" --checkpoint run --setting Z --json with.json
grep -q 'mean shape of the training split: IoU 0\.[0-9]*[1-9], Chamfer' out || fail "no mean shape: $(cat out)"
expect 0 'IoU over 1000 points' "$eval" --checkpoint run --setting Z --no-baselines --json without.json
grep -q 'visual hull\|mean shape' out && fail "a baseline with --no-baselines"
[ "$(grep -c '"hull": null' without.json)" = 3 ] && [ "$(grep -c '"mean_shape": null' without.json)" = 3 ] ||
    fail "wrong baselines in the report: $(cat without.json)"
for key in iou chamfer_l1 empty; do
    [ "$(grep "^  \"$key\":" with.json)" = "$(grep "^  \"$key\":" without.json)" ] ||
        fail "$key changes with the baselines"
done
truth=$(ls meshes/*-true.ply | head -1)
expect 0 '"iou": 1,|"iou": 1\.0' "$eval" compare-meshes "$truth" "$truth" --samples 2000
expect 0 '"chamfer_l1":' "$eval" compare-meshes "$truth" "$(ls meshes/*-true.ply | tail -1)" --samples 2000
expect 0 '' "$eval" compare-meshes "$truth" "$truth" --samples 2000 --normalise --quiet --json c.json
grep -q 'box diagonal 1"' c.json || fail "the report does not say that both meshes were normalised"
expect 2 '--dense means nothing to compare-meshes' "$eval" compare-meshes "$truth" "$truth" --dense
expect 2 'compare-meshes|two meshes|A B' "$eval" compare-meshes "$truth"
expect 2 'nothere\.ply' "$eval" compare-meshes "$truth" nothere.ply
expect 2 'tiny\.ini' "$eval" compare-meshes "$truth" tiny.ini
expect 0 'signed distance' "$eval" --checkpoint "$(checkpoint run 6)" --check-equivariance 1 --shapes 1 --json q.json
cp run/metrics.jsonl before.jsonl
expect 0 '^head ' "$train" --profile 1 --resume run --set train.lr=1e-3
cmp before.jsonl run/metrics.jsonl || fail "a profile writes to the run that it starts from"
grep -q '"quarter":' q.json || fail "no quarter turns in the report on equivariance"
expect 2 'setting' "$eval" --checkpoint run --setting X
for keys in model.backbone=plain,model.plain_channels=3 model.fusion=max-pool model.vectors=0 model.type=ibrnet-sdf \
    model.type=ibrnet-sdf,model.backbone=plain; do
    sets="--set ${keys//,/ --set }"
    expect 0 'memory: .* MB of tapes' "$train" tiny.ini --out other --threads 1 $sets
    expect 0 'IoU over 1000 points' "$eval" --checkpoint other --threads 1 --setting Z
    expect 0 'signed distance' "$eval" --checkpoint other --threads 1 --check-equivariance 1 --shapes 1
    expect 2 'another model|shape|has not|lacks|missing' "$eval" --checkpoint run $sets
    rm -r other
done
expect 2 'data\.val_shapes' "$eval" --checkpoint run --split val # the config has none
expect 2 'tiny\.ini: is no folder' "$eval" --checkpoint run --out tiny.ini
expect 2 'cannot make the folder' "$eval" --checkpoint run --out tiny.ini/there
expect 2 '--normalise means nothing' "$eval" --checkpoint run --normalise
expect 2 'cannot write there' "$eval" --checkpoint run --json not/there.json
expect 2 'is a folder' "$eval" --checkpoint run --json meshes
expect 0 'nothing to do' "$train" --resume run

### Folders that hold another run

cp -r run before
expect 2 'run holds another run' "$train" tiny.ini --out run
expect 2 'run holds another run' "$train" --resume run --out run
expect 2 'tiny\.ini' "$train" tiny.ini --out tiny.ini
diff -r before run >out 2>err || fail "a refused run changed the folder"

### Checkpoints

good=$(checkpoint run 6)
size=$(stat -c %s "$good")
refused() { # refused WORDS FILE
    expect 2 "$1" "$eval" --checkpoint "$2" --shapes 1
    grep -q -- "$2" err || fail "no name of the file $2"
    expect 2 "$1" "$train" --resume "$2" --out other
    [ -e other ] && fail "a refused checkpoint leaves a run folder"
}
head -c $((size / 2)) "$good" >cut.safetensors
refused 'shorter|truncated|holds|bytes' cut.safetensors
head -c 5 "$good" >short.safetensors
refused 'safetensors|bytes|short' short.safetensors
: >empty.safetensors
refused 'empty.safetensors' empty.safetensors
cp "$good" flipped.safetensors
printf '\377' | dd of=flipped.safetensors bs=1 seek=$((size - 3)) conv=notrunc 2>err
cmp -s flipped.safetensors "$good" && printf '\001' | dd of=flipped.safetensors bs=1 seek=$((size - 3)) conv=notrunc 2>err
refused 'checksum' flipped.safetensors
{ printf '\000\000\000\000\000\000\000\200' && tail -c +9 "$good"; } >huge.safetensors
refused 'header' huge.safetensors
refused 'tiny.ini' tiny.ini
header='{"x":{"dtype":"F32","shape":[1],"data_offsets":[0,4]}}'
{ printf "\\$(printf %03o ${#header})\\000\\000\\000\\000\\000\\000\\000" && printf '%sabcd' "$header"; } >foreign.safetensors
refused 'not a checkpoint of elf' foreign.safetensors
refused 'No such file' missing.safetensors
mkdir hollow
refused 'no checkpoint' hollow
expect 2 'model\.scalars=8: the network was trained with 4, .*another model' "$eval" --checkpoint run --set model.scalars=8
expect 2 'model\.blocks=2: .*another model' "$train" --resume run --out other --set model.blocks=2
# keys that no parameter tells from their other value
expect 2 'model\.antialias=true: .*another model' "$eval" --checkpoint run --set model.antialias=true
expect 2 'model\.scalar' "$eval" --checkpoint run --set model.scalar=8
cp -r run damaged # its newest checkpoint is broken: the one before counts, with a note
cp cut.safetensors "$(checkpoint damaged 6)"
expect 0 'passed over' "$eval" --checkpoint damaged --shapes 1
expect 0 'passed over' "$train" --resume damaged
$same "$(checkpoint damaged 6)" "$good" >out || fail "a run resumed over a damaged checkpoint ends otherwise"

### The compared systems

for type in disn fvor; do
    other=$([ $type = disn ] && echo fvor || echo disn)
    expect 0 'memory: .* MB of tapes' "$train" tiny.ini --out $type --set model.type=$type --set model.backbone=plain \
        --set model.grid=9
    expect 0 "reconstruction $type" "$eval" --checkpoint $type --setting SO3 --json $type.json --out $type.meshes
    grep -q "\"model\": \"$type\"" $type.json || fail "the report does not name $type: $(cat $type.json)"
    expect 0 'features of the object' "$eval" --checkpoint $type --check-equivariance 1 --shapes 1
    for wrong in $other equivariant; do
        expect 2 "model.type=$wrong: .*trained with $type.*another model" "$eval" --checkpoint $type \
            --set model.type=$wrong
        expect 2 'another model' "$train" --resume $type --out other --set model.type=$wrong
    done
    [ -e other ] && fail "a checkpoint of another system leaves a run folder"
done
expect 2 'model\.grid = 8: .*multiple of 4, plus 1' "$train" tiny.ini --out none --set model.type=fvor --set model.grid=8
expect 2 'would keep at least .* model\.grid' "$train" tiny.ini --out none --set model.type=fvor --set model.grid=257 \
    --set train.shapes_per_step=64
expect 0 'step 1' "$train" tiny.ini --out long --set model.type=disn --set model.point=1,1,1,1,1,1,1,1 --set train.steps=1

### Data

mkdir -p data/things/a data/things/b data/listless data/half
tetrahedron='v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n'
printf "$tetrahedron" >data/things/a/model.obj
printf 'a\nb\n' | tee data/things/train.lst >data/things/test.lst
things=(--set data.root=data --set data.category=things --set data.shapes=1)
bad_mesh() { # bad_mesh TEXT: both programs name the file
    printf "$1" >data/things/b/model.obj
    expect 2 'data/things/b/model\.obj' "$train" tiny.ini --out none "${things[@]}"
    expect 2 'data/things/b/model\.obj' "$eval" --checkpoint run "${things[@]}"
    [ -e none ] && fail "bad data leaves a run folder"
}
expect 2 "train\.lst:2: the shape 'b' has no mesh" "$train" tiny.ini --out none "${things[@]}" # no mesh at all
bad_mesh ''
bad_mesh 'v 0 0 0\nv 1 0 0\nv 0 1 0\n'
bad_mesh 'v 0 0 0\nv nan 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n'
bad_mesh 'v 0 0 0\nv inf 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n'
bad_mesh 'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n'
bad_mesh 'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n'
bad_mesh 'v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n'
printf "$tetrahedron" >data/things/b/model.obj
if [ "$(id -u)" != 0 ]; then
    chmod 000 data/things/b/model.obj
    expect 2 'data/things/b/model\.obj' "$train" tiny.ini --out none "${things[@]}"
    chmod 644 data/things/b/model.obj
fi
expect 0 'train: 2 shapes' "$train" tiny.ini --out files "${things[@]}"
mv data/things/train.lst . # the model without its training shapes
expect 0 'no mean of the training shapes beside the model: .*train' "$eval" --checkpoint files --json lone.json
grep -q '"mean_shape": null' lone.json && grep -q '"hull": {' lone.json || fail "wrong baselines: $(cat lone.json)"
mv train.lst data/things
expect 2 'val' "$train" tiny.ini --out none "${things[@]}" --set data.val_shapes=1 # no val.lst
expect 2 'data/nothing' "$train" tiny.ini --out none "${things[@]}" --set data.category=nothing
expect 2 'data/listless' "$train" tiny.ini --out none "${things[@]}" --set data.category=listless

### A disk that refuses

cp -r run full
limited() { # no file larger than 4 kB: less than a checkpoint, more than a line of metrics
    (trap '' XFSZ; ulimit -f 4; exec "$train" --resume full --set train.steps=12)
}
expect 1 'full/checkpoints/.*(File too large|No space)' limited
expect 0 'IoU' "$eval" --checkpoint full --shapes 1
expect 0 'step 6 of 12' "$train" --resume full --set train.steps=12
[ "$(find full -type f | grep -Evc 'config.ini|metrics.jsonl|latest|best|step-[0-9]{8}.safetensors$')" = 0 ] ||
    fail "temporary files stay: $(find full)"
mkdir disk
if unshare -rm mount -t tmpfs -o size=1m none disk 2>err; then
    small_disk() { # 1 MB: four checkpoints and a half of this model
        unshare -rm bash -c "mount -t tmpfs -o size=1m none disk && $train tiny.ini --out disk/run \
            --set model.scalars=32 --set model.vectors=32 --set train.keep=100 --set train.steps=60
            code=\$?; cp -r disk/run rescued; exit \$code"
    }
    expect 1 'No space left' small_disk
    expect 0 'IoU' "$eval" --checkpoint rescued --shapes 1
else
    echo "skipped: no right to mount a small disk"
fi

### Stopping and killing

long=(tiny.ini --set train.steps=400 --set train.checkpoint_every=50 --set train.keep=100 --quiet)
expect 0 '' "$train" "${long[@]}" --out whole
# Start a run in the background, wait for its first checkpoint, send SIGNAL; its exit code in $code.
interrupt() { # interrupt SIGNAL FOLDER
    "$train" "${long[@]}" --out "$2" >out 2>err &
    local process=$!
    for _ in $(seq 2000); do
        [ -s "$2/latest" ] && break
        kill -0 $process 2>/dev/null || break
        sleep 0.01
    done
    kill -"$1" $process
    wait $process
    code=$?
}
"$train" tiny.ini --out early --set data.shapes=4000 >out 2>err & # data for a minute
process=$!
for _ in $(seq 6000); do grep -q 'sampling shapes' out && break; sleep 0.01; done
grep -q 'sampling shapes' out || fail "no data are made: $(cat out err)"
kill -TERM $process
wait $process
code=$?
[ $code = 130 ] || fail "exit code $code after an interrupt while the data are made"
grep -q 'no new step to save' err || fail "an early interrupt says: $(cat err)"
[ -e early ] && fail "a run stopped before its first step leaves $(find early)"

interrupt INT stopped 2>/dev/null
[ $code = 130 ] || fail "exit code $code after Ctrl-C, not 130"
grep -q 'stopped after step [0-9]* of 400, saved; go on with: elf-train --resume stopped' err || fail "no word on how to go on"
expect 0 '' "$train" --resume stopped --quiet
$same "$(checkpoint stopped 400)" "$(checkpoint whole 400)" >out || fail "stopped and resumed differs from a whole run"
interrupt KILL killed 2>/dev/null
[ $code = 137 ] || fail "exit code $code after kill -9"
expect 0 'resuming from killed/checkpoints' "$train" --resume killed --threads 1
$same "$(checkpoint killed 400)" "$(checkpoint whole 400)" >out || fail "killed and resumed differs from a whole run"

### The mesh of a model

# mesh FOLDER OPTIONS...: of one unseen shape by the long run
mesh() {
    local folder=$1
    shift
    expect 0 '' "$eval" --checkpoint whole --shapes 1 --pictures 0 --out "$folder" --quiet "$@"
}
predicted=chair-test-0000-predicted.ply
mesh one --threads 1
mesh two --threads 2
grep -aq '^element face [0-9][0-9][0-9]' one/$predicted || fail "an empty mesh tests nothing"
cmp one/$predicted two/$predicted >out 2>err || fail "the mesh depends on the number of threads"
mesh rolled --roll 90
expect 0 '"chamfer_l1": ([0-9.]+e-(0?[5-9]|[1-9][0-9])|0(\.0)?,)' "$eval" compare-meshes rolled/$predicted one/$predicted --exact

losses() { sed 's/.*\("step": *[0-9]*\).*\("loss": *[^,]*\).*/\1 \2/' "$1/metrics.jsonl"; }
for run in stopped killed; do
    [ "$(losses $run)" = "$(losses whole)" ] || fail "metrics of the $run run differ from a whole run's"
done

[ $failures = 0 ] || echo "$failures failures"
[ $failures = 0 ]
