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
[[ ! $from -ef $to ]] || fail "$to: the runs are there; name another folder"
kept=(config.toml run.json train.csv eval.csv timing.csv)

# Links are followed; one that leads round in a circle is an error, which find tells.
found=$(cd "$from" && find -L . -name eval.csv -printf '%P\n') || fail "$from: can't be searched; nothing is copied"
mapfile -t runs < <(sed '/^$/d; s|/*eval.csv$||' <<<"$found" | sort)
((${#runs[@]} > 0)) || fail "$from: no run there, that is, no directory that holds an eval.csv"
for run in "${runs[@]}"; do
    for file in "${kept[@]}"; do
        [[ -f $from/$run/$file ]] || fail "$from/$run: $file is missing; nothing is copied"
        if [[ -e $to/$run/$file ]] && ! cmp --silent "$from/$run/$file" "$to/$run/$file"; then
            fail "$to/$run: another run is there, with another $file; remove it first, or name another folder"
        fi
    done
done
for run in "${runs[@]}"; do
    mkdir -p "$to/$run"
    cp "${kept[@]/#/$from/$run/}" "$to/$run/"
done
echo "$to: curves of ${#runs[@]} runs"
