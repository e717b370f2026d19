#!/usr/bin/env bash
# Copies what is kept of runs, that is configuration, provenance and curves, without checkpoints and replay buffers.
#
#   scripts/store_curves.sh runs/comparison results/comparison
#
# All runs below the first folder go to the same places below the second one. Where another run is there already,
# nothing is copied at all.
set -euo pipefail

fail() {
    echo "store_curves.sh: $*" >&2
    exit 2
}

(($# == 2)) && [[ -d $1 ]] || fail "two folders are needed: one of runs, and where their curves go"
from=${1%/} to=${2%/}
# Whatever they begin with, they are no options.
[[ $from == -* ]] && from=./$from
[[ $to == -* ]] && to=./$to
[[ ! $from -ef $to ]] || fail "$to: the runs are there; name another folder"
kept=(config.toml run.json train.csv eval.csv timing.csv)

# Links are followed; one that leads round in a circle is an error, which find tells. A name may hold a newline.
found=$(mktemp)
trap 'rm -f -- "$found"' EXIT
find -L "$from" -name eval.csv -printf '%P\0' | sort -z >"$found" || fail "$from: can't be searched; nothing is copied"
mapfile -d '' -t runs <"$found"
((${#runs[@]} > 0)) || fail "$from: no run there, that is, no directory that holds an eval.csv"
for curve in "${runs[@]}"; do
    run=${curve%eval.csv}
    for file in "${kept[@]}"; do
        [[ -f $from/$run$file ]] || fail "$from/$run: $file is missing; nothing is copied"
        if [[ -e $to/$run$file ]] && ! cmp --silent "$from/$run$file" "$to/$run$file"; then
            fail "$to/$run: another run is there, with another $file; remove it first, or name another folder"
        fi
    done
done
for curve in "${runs[@]}"; do
    run=${curve%eval.csv}
    mkdir -p "$to/$run"
    cp "${kept[@]/#/$from/$run}" "$to/$run"
done
# Nobody need listen: all is done.
echo "$to: curves of ${#runs[@]} runs" || true
