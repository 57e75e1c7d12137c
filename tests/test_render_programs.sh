#!/bin/bash
# test_render_programs.sh ELF_TRAIN ELF_EVAL SAME_ARRAYS SOURCE: what the programs do with scenes: made
# ones written to disk in every layout, training, resuming, scores, turned frames, paths, bad input.
set -u
. "$4/tests/programs.sh"

# is_png FILE WIDTH HEIGHT
is_png() {
    local size
    size=$(od -An -tu1 -j16 -N8 "$1" 2>/dev/null | awk '{print $3 * 256 + $4, $7 * 256 + $8}')
    [ "$size" = "$2 $3" ] || fail "$1 is no PNG of $2 x $3 ($size)"
}

cat >tiny.ini <<'END'
[model]
type = renderer
[render]
types = 0, 1
channels = 2
heads = 2
hidden = 4
feature_width = 2
features = 2
sources = 2
samples = 4
[data]
builtin_scenes = 2
test_builtin = 1
scene_size = 24
val_shapes = 2
[train]
steps = 6
warmup = 2
rays = 8
seen_samples = 1
checkpoint_every = 3
log_every = 2
val_every = 3
END
checkpoint() { printf '%s/checkpoints/step-%08d.safetensors' "$1" "$2"; }

### Scenes on disk, in each layout that can say them

for layout in nerf-synthetic llff transforms deepvoxels colmap-text colmap-binary; do
    expect 0 '' "$eval" make-scene diffuse --layout $layout --size 24 --views 16 --out scenes/$layout
    expect 0 'left out +0' "$eval" check-data scenes/$layout --out $layout.png
    [ -s $layout.png ] || fail "check-data draws no picture of $layout"
done
expect 0 'LLFF' "$eval" make-scene forward --size 24 --views 16 --out forward
expect 2 'glossy, diffuse' "$eval" make-scene shiny --out x
expect 2 'takes a kind' "$eval" make-scene
expect 2 'layout|nerf-synthetic' "$eval" make-scene diffuse --layout cube --out x
expect 2 '--out|folder' "$eval" make-scene diffuse
expect 2 'forward|empty' "$eval" make-scene diffuse --out forward
expect 2 '--size 3' "$eval" make-scene diffuse --size 3 --out x
expect 2 'nothere.obj' "$eval" make-scene diffuse --mesh nothere.obj --out x
expect 2 'means nothing to make-scene' "$eval" make-scene diffuse --out x --dense
[ -e x ] && fail "a refused make-scene leaves a folder"

### Training and resuming

for type in renderer ibrnet; do
    expect 0 '^coarse/volume +[0-9.]+ +[0-9.]+ ' "$train" tiny.ini --profile 2 --set model.type=$type
done
[ -e runs ] && fail "a profile leaves a run folder"
expect 0 'validation loss' "$train" tiny.ini --out whole
expect 0 'validation: on training views of 2 scenes of 2' "$train" tiny.ini --out said
grep -q '"val_split": *"train"' whole/metrics.jsonl || fail "metrics do not say what is validated on"
expect 0 '3/3' "$train" tiny.ini --out half --set train.steps=3
expect 0 'resuming' "$train" --resume half --set train.steps=6 --threads 1
# the schedule knows the number of steps, so a run of 3 steps is another run
expect 0 '' "$train" tiny.ini --out again --threads 1
expect 0 '' "$same" "$(checkpoint whole 6)" "$(checkpoint again 6)"
timeout -s INT 20 "$train" tiny.ini --out stopped --set train.steps=100000 --quiet >out 2>err &
pid=$!
for _ in $(seq 100); do
    [ -e "$(checkpoint stopped 3)" ] && break
    sleep 0.1
done
kill -INT $pid 2>/dev/null
wait $pid
[ $? = 130 ] || fail "an interrupted training does not end with 130"
expect 0 '' "$train" tiny.ini --out cut --set train.checkpoint_every=1
cp -r cut resumed
rm -f "$(checkpoint resumed 6)" "$(checkpoint resumed 5)"
expect 0 'step 4 of 6' "$train" --resume resumed
expect 0 '' "$same" "$(checkpoint cut 6)" "$(checkpoint resumed 6)"
for type in ibrnet renderer; do
    expect 0 'parameters' "$train" tiny.ini --out $type --set model.type=$type \
        --set render.fine_samples=3 --set data.scenes="scenes/llff, forward" --set data.builtin_scenes=1
done

for keys in render.along_ray=false render.types=0 render.scalars=6; do # ablations, more scalars
    expect 0 'parameters' "$train" tiny.ini --out less --threads 1 --set $keys --set train.steps=3
    expect 0 'SO3' "$eval" --checkpoint less --setting SO3 --views 1 --no-baselines --json less.json
    awk '/"pixel_variance": [0-9]/ { gsub(",", ""); if ($2 > 1e-4) bad = 1; seen = 1 }
         END { exit bad || !seen }' less.json || fail "the renderer with $keys varies with the frame"
    expect 2 'another model|shape|has not|missing' "$eval" --checkpoint whole --set $keys
    rm -r less
done

### Scores, turned frames, paths

expect 0 'mean over scenes' "$eval" --checkpoint whole --out views --json report.json
grep -q '"mean_over_scenes"' report.json || fail "no means in the report"
is_png views/"$(ls views | grep -m1 rendered)" 24 24
[ -s views/montage.png ] || fail "no montage"
expect 0 'SO3' "$eval" --checkpoint renderer --setting SO3 --views 1 --no-baselines --json turned.json
# scenes from files are described; what has no test views is scored, and reported, on training views
expect 0 'scenes/llff: 14 \+ 0 \+ 2 views' "$eval" --checkpoint renderer --views 1 --no-baselines \
    --set data.test_builtin=0 --json held.json
grep -q '"split": "test"' held.json || fail "the report of test views does not say test"
expect 0 '2 scenes of 2 have no test views' "$eval" --checkpoint renderer --views 1 --no-baselines \
    --set data.test_scenes="scenes/llff, forward" --set data.test_builtin=0 --set data.hold_out=0 --json held.json
grep -q '"split": "train"' held.json || fail "the report of training views says test"
expect 0 'split test, train' "$eval" --checkpoint renderer --views 1 --no-baselines \
    --set data.test_scenes="scenes/llff" --set data.test_builtin=1 --set data.hold_out=0
# scenes of one name are two scenes, and their files do not overwrite each other
mkdir a b && cp -r scenes/llff a/room && cp -r scenes/llff b/room
expect 0 '^b-room +mean of 1' "$eval" --checkpoint renderer --views 1 --no-baselines --out rooms \
    --set data.test_scenes="a/room, b/room" --set data.test_builtin=0
for room in a-room b-room; do
    ls rooms/$room-*-rendered.png >out 2>err || fail "no picture of $room"
done
awk '/"pixel_variance": [0-9]/ { gsub(",", ""); if ($2 > 1e-4) bad = 1; seen = 1 }
     END { exit bad || !seen }' turned.json || fail "the equivariant renderer varies with the frame"
expect 0 'SO3' "$eval" --checkpoint ibrnet --setting SO3 --views 1 --no-baselines
expect 0 'colour moves' "$eval" --checkpoint renderer --check-equivariance 3 --shapes 1 --json moved.json
grep -q '"experiment": "rendering equivariance"' moved.json || fail "moved.json does not say what it is"
grep -q '"pixel_variance"' moved.json || fail "--check-equivariance writes no JSON"
# several renderers in one picture
expect 0 'ibrnet' "$eval" compare-runs renderer ibrnet none --names ours,theirs,none --pictures 1 --out several.png
[ -s several.png ] || fail "no picture of several renderers"
expect 0 '' "$eval" curves renderer ibrnet --out curves.png
is_png curves.png 1440 388
expect 2 'always shown' "$eval" compare-runs renderer ibrnet --setting Z --out no.png
expect 0 'parameters' "$train" tiny.ini --out small --set data.scene_size=20 --set train.steps=2
expect 2 'scenes differ' "$eval" compare-runs renderer small --out no.png
[ -e no.png ] && fail "a refused picture was written"
for path in orbit spiral; do
    expect 0 'ffmpeg' "$eval" --checkpoint whole --path $path --frames 2 --out $path \
        --set data.test_scenes=forward --set data.test_builtin=0
    is_png $path/forward/frame-0001.png 24 18
done
expect 0 'mean over scenes' "$eval" --checkpoint whole --views 1 --set data.test_scenes=scenes \
    --set data.test_builtin=0 --set eval.skip_outside=true --set eval.skip_unseen=false

### Bad input

expect 2 'renderers have I and SO3' "$eval" --checkpoint whole --setting Z
expect 2 'spiral.*orbit|orbit.*spiral' "$eval" --checkpoint whole --path zigzag --out x
expect 2 'give --out' "$eval" --checkpoint whole --path orbit
expect 2 'means nothing' "$eval" --checkpoint whole --dense
expect 2 'nothere' "$eval" --checkpoint whole --lpips-weights nothere.safetensors
expect 2 'nowhere' "$eval" --checkpoint whole --set data.test_scenes=nowhere
expect 2 'another model' "$eval" --checkpoint whole --set model.type=ibrnet
expect 2 'another model' "$eval" --checkpoint whole --set render.channels=4
expect 2 'another model' "$eval" --checkpoint whole --set render.heads=1
expect 2 'render\.sources = 40' "$eval" --checkpoint whole --set render.sources=40
expect 2 'render\.sources = 40' "$train" tiny.ini --out none --set render.sources=40
expect 2 'no scenes to train on' "$train" tiny.ini --out none --set data.builtin_scenes=0
expect 2 'nowhere' "$train" tiny.ini --out none --set data.scenes=nowhere
expect 2 'tiny\.ini' "$train" tiny.ini --out none --set data.scenes=tiny.ini
expect 2 'number 2 is 0' "$train" tiny.ini --out none --set render.types=0,0
expect 2 'first' "$train" tiny.ini --out none --set render.types=1,2
expect 2 'render\.heads' "$train" tiny.ini --out none --set render.heads=3
expect 2 'multiple of render.channels' "$train" tiny.ini --out none --set render.scalars=3
expect 2 'data\.setting = Z' "$train" tiny.ini --out none --set data.setting=Z
expect 2 'train\.pool' "$train" tiny.ini --out none --set train.pool=50,20
expect 2 'mesh' "$train" tiny.ini --out none --set data.scene_meshes="$here/scenes"
mkdir two && cp -r scenes/nerf-synthetic two/one
expect 2 'data\.hold_out|training views' "$train" tiny.ini --out none --set data.builtin_scenes=0 \
    --set data.scenes=two --set render.sources=30
# a frame without its picture, a picture without its frame, a pose that is none
rm two/one/train/"$(ls two/one/train | head -1)"
expect 0 'left out +1' "$eval" check-data two/one
cp -r scenes/transforms broken
sed -i '0,/"transform_matrix"/s//"transform_matriks"/' broken/transforms.json
expect 2 'transforms\.json.*transform_matrix' "$train" tiny.ini --out none --set data.scenes=broken
printf '{ "frames": [ ' >broken/transforms.json
expect 2 'transforms\.json:1' "$train" tiny.ini --out none --set data.scenes=broken
head -c 100 scenes/llff/poses_bounds.npy >short.npy
cp -r scenes/llff cut-llff && cp short.npy cut-llff/poses_bounds.npy
expect 2 'poses_bounds\.npy' "$train" tiny.ini --out none --set data.scenes=cut-llff
cp -r scenes/colmap-binary cut-colmap
find cut-colmap -name images.bin -exec truncate -s 50 {} \;
expect 2 'images\.bin' "$train" tiny.ini --out none --set data.scenes=cut-colmap
[ -e none ] && fail "a refused training leaves a run folder"
for config in "$source"/configs/render*.ini; do
    expect 2 'nowhere' "$train" "$config" --out none --set data.root=nowhere --set data.scenes=scene
done

if [ $failures = 0 ]; then
    echo "all checks of rendering passed"
else
    echo "$failures checks failed"
    exit 1
fi
