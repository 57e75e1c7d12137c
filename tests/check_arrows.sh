#!/bin/sh
# check_arrows.sh ROOT: fails on an include that points up in the house, and on C++ outside the two
# wrappers. A folder may include its own headers, those of the folders named beside it, and no
# others; "autograd/status.h" and "autograd/random.h" need nothing, so everybody may.
set -u
root=${1:?usage: check_arrows.sh ROOT}
cd "$root" || exit 1
failed=0

# check FOLDER ALLOWED-FOLDER...: every #include "x/y.h" in FOLDER has x = FOLDER or allowed.
check() {
    folder=$1
    shift
    allowed="$folder $*"
    [ -d "$folder" ] || return 0
    includes=$(find "$folder" -type f \( -name '*.c' -o -name '*.h' -o -name '*.cc' \) \
        -exec grep -Hn '^[[:space:]]*#[[:space:]]*include[[:space:]]*"' {} +)
    bad=$(printf '%s\n' "$includes" | awk -v allowed="$allowed" '
        BEGIN { count = split(allowed, name, " "); for (i = 1; i <= count; i++) ok[name[i]] = 1 }
        NF {
            header = $0
            sub(/^[^"]*"/, "", header)
            sub(/".*$/, "", header)
            if (header == "autograd/status.h" || header == "autograd/random.h")
                next
            from = header
            if (!sub(/\/.*$/, "", from))
                from = "(no folder)"
            if (!(from in ok))
                print $0
        }')
    if [ -n "$bad" ]; then
        printf '%s may include only its own headers and those of: %s\n%s\n' "$folder" "${*:-none}" "$bad" >&2
        failed=1
    fi
}

check configs
check autograd
check layers autograd
check datasets
check models layers autograd configs
check train models layers autograd datasets configs
# evaluation reads data and runs as training does
check eval train models layers autograd datasets configs

cpp=$(find configs autograd layers datasets models train eval bench tests -type f \
    \( -name '*.cc' -o -name '*.cpp' -o -name '*.cxx' -o -name '*.hpp' \) 2>/dev/null |
    grep -v '^datasets/[a-z]*_oiio\.cc$' | grep -v '^datasets/[a-z]*_openmesh\.cc$')
if [ -n "$cpp" ]; then
    printf 'C++ belongs in datasets/*_oiio.cc and datasets/*_openmesh.cc only:\n%s\n' "$cpp" >&2
    failed=1
fi

# layers know no cameras or files
files=$(find layers -type f -name '*.[ch]' -exec grep -Hn 'fopen *(\|<fcntl.h>\|open *(' {} + 2>/dev/null)
if [ -n "$files" ]; then
    printf 'layers must not touch files:\n%s\n' "$files" >&2
    failed=1
fi
exit $failed
