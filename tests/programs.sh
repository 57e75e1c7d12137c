# programs.sh: what the tests of the programs share; sourced with the arguments of the test.
# Afterwards the shell stands in a folder of its own, which is removed at the end.
train=$(realpath "$1") eval=$(realpath "$2") same=$(realpath "$3") source=$(realpath "$4")
here=$(mktemp -d /tmp/elf-test-XXXXXX) || exit 1
trap 'rm -rf "$here"' EXIT
cd "$here" || exit 1
failures=0
export OMP_WAIT_POLICY=passive

fail() {
    echo "FAILED: $1"
    sed 's/^/    /' out err 2>/dev/null | head -20
    failures=$((failures + 1))
}

# expect CODE WORDS COMMAND...: the exit code, and WORDS (extended regular expression) in what the
# command prints. A refusal (code 1 or 2) is one line on standard error, or two with a note.
expect() {
    local code=$1 words=$2 got
    shift 2
    "$@" >out 2>err </dev/null
    got=$?
    [ "$got" = "$code" ] || { fail "exit code $got, not $code: $*"; return; }
    [ -z "$words" ] || cat out err | grep -Eq -- "$words" || { fail "no \"$words\" from: $*"; return; }
    if [ "$code" = 1 ] || [ "$code" = 2 ]; then
        [ "$(wc -l <err)" -le 2 ] || fail "more than one message from: $*"
    fi
}
