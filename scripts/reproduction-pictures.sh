# reproduction-pictures.sh: pictures and curves of a table's finished trainings, seed 0. Sourced by
# scripts/reproduce, whose functions and variables it uses.

# Training setting, test settings, and of built-in scenes their keys, into $shown_train, $shown_tests, $shown_keys.
shown_of() { # DATA TABLE
    shown_train=I shown_tests=I,Z shown_keys=""
    case $1-$2 in
    *-ibrnet-sdf) shown_train=Y shown_tests=Y,SO3 ;;
    built-in-rendering) shown_tests="" shown_keys="data.kinds=all data.test_builtin=3" ;;
    files-rendering)
        shown_tests=""
        shown_keys="data.test_builtin=0
            data.test_scenes=$(scene_of glossy),$(scene_of forward),$(scene_of diffuse)" ;;
    esac
}

trained_folder() { # DATA SYSTEM CATEGORY: the folder, or nothing
    take "$1" "$2" "$3" "$shown_train" "" 0
    [ ! -e "$folder/trained" ] || echo "$folder"
}

# Categories with at least two systems trained, into $parts; with WHOLE nothing unless all are.
take_parts() { # DATA WHOLE; $rows: "system category" a line
    parts=""
    for category in $(echo "$rows" | awk '!seen[$2]++ { print $2 }'); do
        there=0 all=0
        for system in $(echo "$rows" | awk -v c="$category" '$2 == c { print $1 }'); do
            all=$((all + 1))
            [ -z "$(trained_folder "$1" "$system" "$category")" ] || there=$((there + 1))
        done
        if [ -n "$2" ] && [ $there -lt $all ]; then parts="" && return; fi
        [ $there -lt 2 ] || parts="$parts $category"
    done
}

# Is FILE.png made of these columns, and no training newer?
up_to_date() { # FILE COLUMNS...
    picture=$1
    shift
    [ -e "$picture.png" ] && [ -e "$picture-curves.png" ] && [ "$(cat "$drawn" 2>/dev/null)" = "$*" ] || return 1
    for one in $(echo "$*" | tr , ' '); do
        if [ "$one" != none ] && [ "$one/trained" -nt "$picture.png" ]; then return 1; fi
    done
}

draw() { # NAMES COLUMNS...
    names=$1
    shift
    up_to_date "$picture" "$@" && return 0
    echo "picture: $picture.png"
    shapes=2
    case $parts in *\ *\ *) shapes=1 ;; esac
    [ "$size" != test ] || shapes=1
    case $table in
    rendering) with_keys="--pictures 3" ;;
    *) with_keys="--setting $shown_tests --pictures $shapes" ;;
    esac
    for word in $shown_keys; do with_keys="$with_keys --set $word"; done
    # words of $with_keys, none of which has a space
    logged "$out/$size/pictures.log" "$elf_eval" compare-runs "$@" --names "$names" $with_keys --out "$picture.png" &&
        logged "$out/$size/pictures.log" "$elf_eval" curves "$@" --names "$names" --out "$picture-curves.png" &&
        echo "$*" | put "$drawn"
}

draw_table() { # DATA TABLE WHOLE
    from=$1 table=$2
    shown_of "$from" "$table"
    rows=$(runs_of "$table" 2>/dev/null | awk -v d="$from" -v t="$shown_train" '$1 == d && $4 == t { print $2, $3 }')
    take_parts "$from" "$3"
    [ -n "$parts" ] || return 0
    picture=$docs/reproduction/$size-$from-$table drawn=$out/$size/$from-$table.drawn names=""
    set --
    for system in $(echo "$rows" | awk '!seen[$1]++ { print $1 }'); do
        column="" any=""
        for category in $parts; do
            one=$(trained_folder "$from" "$system" "$category")
            any=$any$one column=$column,${one:-none}
        done
        [ -n "$any" ] || continue
        set -- "$@" "${column#,}"
        names=$names,$system
    done
    draw "${names#,}" "$@"
}

# Of all tables; with WHOLE of those alone whose trainings are all there. A picture that fails stops nothing.
pictures() { # WHOLE
    case $out in *,* | *\ *)
        [ -n "$1" ] || echo "reproduce: no pictures, since $out has a comma or a space" >&2 # said once, at the end
        return 0 ;;
    esac
    mild=1
    for one_table in $tables; do
        for one_data in built-in files; do
            draw_table $one_data "$one_table" "$1" || failed_pictures=1
        done
    done
    mild=""
}
