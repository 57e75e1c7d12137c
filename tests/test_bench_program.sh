#!/bin/bash
# test_bench_program.sh ELF_TRAIN ELF_EVAL SAME_ARRAYS SOURCE ELF_BENCH: elf-bench's options and files, and
# how it asks its double. Nothing here depends on how fast anything is.
set -u
bench=$(realpath "$5")
. "$4/tests/programs.sh"
few=(--repeats 1 --threads 1)

### Command lines

expect 2 'unrecognized option' "$bench" --nonsense
expect 2 'requires an argument' "$bench" --json
expect 2 '--threads 0: a number from 1' "$bench" --threads 0
expect 2 '--repeats many: a number from 1' "$bench" --repeats many
expect 2 'no such case.*--list' "$bench" nonsense
expect 2 'no such case' "$bench" gemm --exact
expect 2 'no such case' "$bench" --reference gemm
expect 2 'nowhere/a.json: its folder' "$bench" gemm-512 --json nowhere/a.json
expect 2 'nowhere/a.png: its folder' "$bench" gemm-512 --picture nowhere/a.png
expect 2 '--picture a.jpg: a name that ends in' "$bench" gemm-512 --picture a.jpg
expect 2 '--ratio takes two cases, 1 given' "$bench" --ratio gemm-512
expect 2 'nonsense: no such case' "$bench" --ratio gemm-512 nonsense
expect 2 '--ratio paper-render: this case runs once' "$bench" --ratio gemm-512 paper-render
expect 2 '--ratio goes with' "$bench" --ratio gemm-512 gemm-1024 --scaling
expect 2 'elf-bench draws it' "$bench-f64" linear-16 --picture a.png
expect 0 'Exit codes' "$bench" --help
expect 0 '^paper-reconstruct ' "$bench" --list # and has not run it
expect 0 '^gemm-512 ' "$bench" gemm --list
[ "$(wc -l <out)" = 2 ] || fail "gemm picks more than gemm-512 and gemm-1024"

### Hard cases

expect 2 'no such case; elf-bench stability --list' "$bench" stability nonsense
expect 2 'unrecognized option' "$bench" stability --nonsense
expect 2 'folder does not exist' "$bench" stability softmax --json nowhere/hard.json
expect 2 'elf-bench compares' "$bench-f64" stability
expect 2 'no such case' "$bench-f64" stability --reference softmax 99
expect 0 '^softmax +7 values' "$bench" stability --list
expect 0 '^softmax +logits 10000 .*yes$' "$bench" stability softmax --check --json hard.json
grep -q '"case": "softmax"' hard.json || fail "no softmax in hard.json"

### Growth

expect 2 'nonsense: what grows is views' "$bench" growth nonsense
expect 2 'unrecognized option' "$bench" growth --nonsense
expect 2 '--system nonsense: ' "$bench" growth --system nonsense
expect 2 '--repeats 0: a number from 1' "$bench" growth --repeats 0
expect 2 'none of these; elf-bench growth --list' "$bench" growth rays --system disn
expect 2 'nowhere/a.json: its folder' "$bench" growth --json nowhere/a.json
expect 2 '--picture a.jpg: a name that ends in' "$bench" growth --picture a.jpg
expect 2 'elf-bench draws it' "$bench-f64" growth --picture a.png
expect 0 'reconstruct-tiny.ini' "$bench" growth --help
expect 0 '^ibrnet +row +samples$' "$bench" growth --list
[ "$(wc -l <out)" = 52 ] || fail "growth lists other rows"
expect 0 '^fvor +distances points +2048 4096 8192 16384 ' \
    "$bench" growth points --system fvor "${few[@]}" --json grown.json --picture grown.png
grep -q '"exponent_of_time": {' grown.json || fail "no exponent in grown.json"
[ "$(head -c 4 grown.png | tail -c 3)" = PNG ] || fail "the picture of growth is no PNG"
expect 0 '^ibrnet +row +rays +50 100 200 400 ' "$bench-f64" growth rays --system ibrnet "${few[@]}"

### Errors against double

error='[0-9.]+e-0[5-9]'
expect 0 "^linear-16 .*$error +$error y" "$bench" "${few[@]}" --exact linear-16
expect 0 "^linear-16-dw .*$error +$error d[wb]" "$bench" "${few[@]}" linear-16-dw
expect 0 "^conv-9-1x1 .*$error +$error y" "$bench" "${few[@]}" --exact conv-9-1x1
expect 0 "^equivariant-16 .*$error +$error [a-z]" "$bench" "${few[@]}" equivariant-16
expect 0 '^linear-16 .*% [fm] +- +- +- +-$' "$bench" "${few[@]}" --exact linear-16 --no-errors
expect 0 '^linear-16 .*% [fm] +- +- +- +-$' "$bench-f64" "${few[@]}" --exact linear-16 # is the reference
expect 0 "^\\| linear-16 \\| .* y $error, $error \\|$" "$bench" --errors --exact linear-16 --threads 1
expect 2 '--errors: of elf-bench' "$bench" --errors linear-16 --scaling
mkdir alone
cp "$bench" alone/elf-bench
unmeasured() { # unmeasured WORDS OPTIONS...: a message in place of the error, and no number
    local words=$1
    shift
    expect 0 "^linear-16 .* - not measured: .*$words" alone/elf-bench "${few[@]}" --exact linear-16 "$@"
}
unmeasured 'elf-bench-f64: No such file' --json alone.json
grep -q '"error": null' alone.json || fail "an error that was not measured has a number"
grep -q '"error_missing": ".*elf-bench-f64' alone.json || fail "the JSON does not say why there is no error"
fake() { printf '#!/bin/sh\n%s\n' "$1" >alone/elf-bench-f64 && chmod +x alone/elf-bench-f64; }
fake 'exit 1'
unmeasured 'no outputs'
fake 'echo these are forty words that are no numbers'
unmeasured 'these are no outputs'
fake "$bench-f64"' "$@" | head -c 2000'
unmeasured 'end early or are damaged'
fake "$bench-f64"' "$@"; exit 1'
unmeasured 'ended with code 1'
fake 'kill -KILL $$'
unmeasured 'ended by a signal'

### Ratio, scaling, memory

expect 0 '^linear-16 .* ms, linear-32 .* ms: ratio [0-9.]+$' "$bench" "${few[@]}" --ratio linear-16 linear-32
expect 0 '^linear-16 .* [0-9.]+ +- +-  resident [0-9.]+ MB' \
    "$bench" "${few[@]}" --exact linear-16 --no-errors --scaling --memory

### Files

expect 0 '' "$bench" "${few[@]}" linear-16 conv-9-1x1 --json b.json --picture b.png
for word in '"precision": "f32"' '"threads": 1' '"gflops":' '"268435456":' '"case": "linear-16-dw"' '"share":' \
    '"error": [0-9.e-]*[0-9]' '"db": \{'; do
    grep -Eq "$word" b.json || fail "no $word in the JSON"
done
[ "$(head -c 4 b.png | tail -c 3)" = PNG ] || fail "the picture is no PNG"
expect 2 'no case to draw' "$bench" "${few[@]}" --exact limit-1 --picture none.png
[ -e none.png ] && fail "a picture of nothing"

### Beside PyTorch: what is missing is said

against="$source/bench/against_pytorch"
expect 2 'usage: against_pytorch PEERS' "$against"
expect 2 'no bench_torch.py there' "$against" .
touch bench_torch.py
expect 2 'nothing: build it, or set BENCH' env BENCH=nothing "$against" .

[ $failures = 0 ] || echo "$failures failures"
[ $failures = 0 ]
