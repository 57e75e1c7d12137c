#!/bin/sh
# check_ops.sh ROOT: fails if a public op or layer has no gradient check: its name must be called in a
# row of tests/op_table_*.c, or, for layers of the backbone, in test_c8.c (the gradient of the whole
# backbone is checked in test_backbone.c).
set -u
root=${1:?usage: check_ops.sh ROOT}
cd "$root" || exit 1
failed=0
for header in autograd/ops.h autograd/ops_image.h layers/layers.h layers/light_field.h \
    layers/light_blocks.h layers/ibrnet.h layers/c8.h; do
    case $header in
    layers/c8.h) places="tests/op_table_*.c tests/test_c8.c" ;;
    *) places="tests/op_table_*.c" ;;
    esac
    # every function that takes a tape first and gives a tensor, a field or a change of fields
    for name in $(tr '\n' ' ' <"$header" | grep -o '\(lf_tensor \*\|lf_field \|lf_rendered \|lf_attended \|lf_ibrnet_[a-z]* \|void \)lf_[a-z0-9_]*(lf_tape \*tape' |
        grep -o 'lf_[a-z0-9_]*(' | tr -d '('); do
        if ! grep -q "$name(" $places; then
            echo "$header: $name is not checked in $places" >&2
            failed=1
        fi
    done
done
exit $failed
