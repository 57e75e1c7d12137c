#!/bin/bash
# test_reproduce.sh ELF_TRAIN ELF_EVAL SAME_ARRAYS SOURCE: scripts/reproduce with trainings of two steps:
# a table from nothing, killed half-way and started again, and what is refused.
. "$(dirname "$0")/programs.sh"
script=$source/scripts/reproduce
export OMP_NUM_THREADS=1 # busy machines
export ELF_BUILD=$here/build
mkdir -p build/train build/eval && ln -s "$train" build/train/elf-train && ln -s "$eval" build/eval/elf-eval
printf 'Front\n<!-- results: written by scripts/reproduce, edit nothing -->\n<!-- end of results -->\nBack\n' >front.md
reproduce() { "$script" --size test --only ibrnet-sdf --out runs --docs docs --readme front.md "$@"; }
results() { find "$1" -name 'result-*.json' 2>/dev/null | wc -l; }

### Stopped half-way, by a signal that can be caught and by one that cannot

"$script" --size test --only ibrnet-sdf --out runs --docs docs >out 2>err &
pid=$!
for _ in $(seq 600); do [ "$(results runs)" -ge 2 ] && break; sleep 0.05; done
kill -TERM $pid
wait $pid
[ $? = 130 ] || fail "a stopped script does not end with 130"
first=$(results runs)
[ "$first" -ge 2 ] && [ "$first" -lt 12 ] || fail "$first results where 2 to 11 were wanted"
flock -n runs/test/lock true || fail "the stopped script leaves its lock"
find runs docs -name 'result-*.json' | xargs md5sum >kept

"$script" --size test --only ibrnet-sdf --out runs --docs docs >out 2>err &
pid=$!
for _ in $(seq 600); do [ "$(results runs)" -gt "$first" ] && break; sleep 0.05; done
expect 2 "process [0-9]+ or [0-9]+ works there" reproduce
kill -KILL $pid
wait $pid 2>/dev/null
flock -w 30 runs/test/lock true || fail "what the killed script was running did not end"

### To the end; nothing is made twice

expect 0 'run 8 of 8' reproduce
[ "$(results runs)" = 12 ] || fail "$(results runs) results, not 12"
md5sum -c --quiet kept >out 2>err || fail "a finished result was made again"
[ "$(ls docs/reproduction/test-*.json | wc -l)" = 12 ] || fail "not all results are in docs"
ls docs/reproduction/*.tmp >out 2>&1 && fail "a temporary file stays behind"
grep -q '^| | elf, test, built-in | 0\.[0-9]* | 0\.[0-9]* | 0\.[0-9]* |$' docs/reproduction.md || fail "no figures on the page"
grep -q '0.689 | 0.432 | 0.611' docs/reproduction.md || fail "the paper's figures are not on the page"
cp docs/reproduction.md page.md
rm docs/reproduction/test-*.json # results come back from the runs
expect 0 '8 runs, 8 done before' reproduce
cat out | grep -q '^run ' && fail "a finished run was run again"
cmp -s page.md docs/reproduction.md || fail "the same results make another page"

### Pictures: made once, of all four systems, on the page; again if one is lost or a training is newer

picture=docs/reproduction/test-built-in-ibrnet-sdf
for file in $picture.png $picture-curves.png; do
    [ -s $file ] && [ "$(wc -c <$file)" -le 400000 ] || fail "$file: not there, or too large"
    grep -q "(${file#docs/})" docs/reproduction.md || fail "$file is not on the page"
done
grep -q '^picture: ' out && fail "a picture was made again"
grep -q '^| chair | equivariant | not run / 0.731 | not run / 0.631 | not run / 0.592 | 0\.[0-9]* / 0.674 |$' front.md ||
    fail "the front page does not say what was run"
grep -q '^Back$' front.md || fail "the front page lost its end"
rm $picture-curves.png
expect 0 '^picture: ' reproduce --draw
[ -s $picture-curves.png ] || fail "a lost picture was not made again"
touch runs/test/built-in/ibrnet-sdf-chair-Y-0/trained
expect 0 '^picture: ' reproduce --draw
expect 0 'what was run so far' reproduce --draw
grep -q '^picture: ' out && fail "a picture was made again"
expect 0 'run so far' "$script" --size test --only table1 --draw --out runs --docs docs --readme front.md
[ -e docs/reproduction/test-built-in-table1.png ] && fail "a picture of one system" # equivariant, in Y

run_of() { echo runs/test/built-in/$1-chair-Y-0; }
expect 0 '' "$eval" compare-runs $(run_of ibrnet-sdf),$(run_of equivariant) none,$(run_of ibrnet-sdf) --names a,b \
    --pictures 1 --quiet --out two.png
[ -s two.png ] || fail "no picture of two parts"
expect 2 'column 2, "a,b": every column must have 1' "$eval" compare-runs $(run_of equivariant) a,b --out no.png
expect 2 'give 1 names' "$eval" compare-runs $(run_of equivariant) --names a,b --out no.png
expect 2 'part 1 has no run' "$eval" compare-runs none --out no.png
expect 2 'must end in .png' "$eval" compare-runs $(run_of equivariant) --out no.jpg
expect 2 'nowhere' "$eval" compare-runs nowhere --out no.png
expect 2 'unknown|setting|give' "$eval" compare-runs $(run_of equivariant) --setting I,Q --out no.png
expect 2 'say with --out' "$eval" curves $(run_of equivariant)
expect 2 'at most 6' "$eval" curves $(for _ in 1 2 3 4 5 6 7; do run_of equivariant; done) --out no.png
[ -e no.png ] && fail "a refused picture was written"

# killed before its first checkpoint: a folder without one is begun again
run=runs/test/built-in/ibrnet-sdf-chair-SO3-0
rm -rf $run/checkpoints $run/result-*.json $run/trained
# a program that crashes, or whose report lacks a number: one failed run, the others are done
mkdir -p crash/train crash/eval lack/train lack/eval
ln -s "$eval" crash/eval/elf-eval && ln -s "$train" lack/train/elf-train
printf '#!/bin/sh\nkill -ABRT $$\n' >crash/train/elf-train
cat >lack/eval/elf-eval <<END
#!/bin/sh
[ "\$1" = --checkpoint ] || exec "$eval" "\$@"
for last; do :; done
echo '{}' >"\$last"
END
chmod +x crash/train/elf-train lack/eval/elf-eval
for fault in crash lack; do
    ELF_BUILD=$here/$fault reproduce >out 2>err
    [ $? = 1 ] && grep -q '1 runs failed' err || fail "$fault: not one failed run"
    [ -e $run/result-SO3.json ] && fail "$fault: left a result"
done
grep -q 'result-SO3.json.tmp: a value is missing' err || fail "the result that lacks a number is not named"
[ -e $run/trained ] || fail "the run without a checkpoint was not begun again"
expect 0 '8 runs, 7 done before' reproduce
[ -e $run/result-SO3.json ] || fail "the failed run was not done again"
# other keys than it was begun with
echo "other keys" >$run/arguments
rm $run/result-SO3.json
expect 2 'begun with another config or other keys' reproduce

### Renderers, and shapes of --data: the results of a first training, in folders with spaces

# first RESULTS ARGUMENTS...: run until so many results are in the documents, stop
first() {
    local wanted=$1
    shift
    rm -rf "some docs"
    "$script" --size test --out "$here/some runs" --docs "$here/some docs" "$@" >out 2>err &
    pid=$!
    for _ in $(seq 1200); do
        [ "$(find "some docs" -name 'test-*.json' 2>/dev/null | wc -l)" -ge "$wanted" ] && break
        kill -0 $pid 2>/dev/null || break
        sleep 0.05
    done
    kill -TERM $pid
    wait $pid
}
first 6 --only rendering
for kind in glossy forward diffuse; do
    for setting in I SO3; do
        result="some docs/reproduction/test-built-in-renderer-$kind-I-$setting-0.json"
        grep -q '"figures": {"psnr": [0-9.]*, "ssim": [-0-9.]*, "lpips": null, "pixel_variance": [0-9null.e-]*}' \
            "$result" || fail "$result: not there, or not its figures"
    done
done
# a file that is no weights of LPIPS is refused before any work
with_weights() { "$script" --size test --only rendering --out "some runs" --docs "some docs" --lpips-weights front.md; }
expect 2 'front.md' with_weights
grep -q ' done before' out && fail "wrong weights are not refused first"
# results without LPIPS are tested again once there are weights: here of an elf-eval that does not look at them first
mkdir -p weights/train weights/eval && ln -s "$train" weights/train/elf-train
printf '#!/bin/sh\n[ "$1" = compare-images ] || exec "%s" "$@"\n' "$eval" >weights/eval/elf-eval && chmod +x weights/eval/elf-eval
ELF_BUILD=$here/weights expect 2 '5 runs, 0 done before' with_weights
grep -q 'front.md' err || fail "the weights are not used"
mkdir -p "some data/shapes/chair"
for i in 1 2 3 4 5 6 7 8 9 10 11 12; do
    printf 'OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 %d\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n' $i >"some data/shapes/chair/$i.off"
done
first 1 --only ibrnet-sdf --data "some data"
result="some docs/reproduction/test-files-equivariant-chair-Y-Y-0.json"
grep -q '"keys": "data.extra_builtin=1"' "$result" || fail "$result does not say that built-in chairs were added"
grep -q '"iou": [0-9.]*' "$result" || fail "$result has no IoU"

### Counts, lists, refusals

expect 0 'counted' "$script" --size test --only counts --out runs --docs docs
[ "$(ls docs/reproduction/test-count-*.json | wc -l)" = 16 ] || fail "not every model is counted"
[ "$("$script" --quick --only table1 --list | wc -l)" = 36 ] || fail "table1 has not 36 trainings"
[ "$("$script" --only ablation --seeds 2 --list | wc -l)" = 48 ] || fail "the ablation has not 48 trainings with two seeds"
mkdir -p data/shapes/car data/scenes/nerf_synthetic number/02691156
for given in data data/shapes; do # the folder with shapes/, or that one itself
    [ "$("$script" --only table1 --data $given --list 2>err | grep -c '^files .* car ')" = 12 ] || fail "no cars in $given"
    grep -q 'no airplane: left out' err || fail "a missing category is not named"
done
[ "$("$script" --only table1 --data number --list 2>err | grep -c '^files .* airplane ')" = 12 ] || fail "no ShapeNet number"
expect 2 'nothing to run' "$script" --only ablation --data number --list
expect 0 'has no scenes: built-in ones alone' "$script" --only rendering --data number --list
expect 2 'has no nerf_synthetic/lego llff/flower' "$script" --data data --list
for scene in nerf_synthetic/lego nerf_synthetic/chair llff/flower llff/sceaux llff/monstree llff/fern \
    deepvoxels_format/train/armchair deepvoxels_format/train/toycar; do
    mkdir -p data/scenes/$scene
done
for given in data data/scenes; do
    [ "$("$script" --only rendering --data $given --list | grep -c ^files)" = 4 ] || fail "no scenes in $given"
done
expect 0 'has no shapes: built-in ones instead' "$script" --data data/scenes --list
expect 2 'weights .*none: no such file' "$script" --lpips-weights none
expect 2 'data: takes a folder' "$script" --data "" --list
expect 0 'table1' "$script" --help
expect 2 '\-\-only table9' "$script" --only table9
expect 2 '\-\-seeds 0' "$script" --seeds 0
expect 2 '\-\-size huge' "$script" --size huge
expect 2 'nowhere: no such folder' "$script" --data nowhere
expect 2 'neither shapes/ nor scenes/' "$script" --data runs
expect 2 'takes a value' "$script" --only
expect 2 'no lines between which' "$script" --readme page.md
expect 2 'not an option' "$script" --fast
cp docs/reproduction/test-built-in-ibrnet-sdf-chair-Y-Y-0.json docs/reproduction/twice.json
expect 2 'twice\.json' "$eval" reproduction docs/reproduction --out page.md
expect 2 'folder of results' "$eval" reproduction
expect 2 'means nothing' "$eval" reproduction docs/reproduction --setting Z

if [ $failures = 0 ]; then
    echo "all checks of scripts/reproduce passed"
else
    echo "$failures checks failed"
    exit 1
fi
