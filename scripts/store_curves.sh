#!/usr/bin/env bash
# Copies what is kept of runs, that is configuration, provenance and curves, without checkpoints and replay buffers.
#
#   scripts/store_curves.sh runs/comparison results/comparison
#
# All runs below the first folder go to the same places below the second one. Runs that are there already with other curves
# are an error; nothing of them is replaced.
set -euo pipefail

if (($# != 2)) || [[ ! -d $1 ]]; then
    echo "store_curves.sh: two folders are needed: one of runs, and where their curves go" >&2
    exit 2
fi
from=${1%/} to=${2%/}
kept=(config.toml run.json train.csv eval.csv timing.csv)

mapfile -t runs < <(cd "$from" && find . -name eval.csv -printf '%P\n' | sed 's|/*eval.csv$||' | sort)
if ((${#runs[@]} == 0)); then
    echo "store_curves.sh: $from: no run there, that is, no directory that holds an eval.csv" >&2
    exit 2
fi
for run in "${runs[@]}"; do
    if [[ -e $to/$run/eval.csv ]] && ! cmp --silent "$from/$run/eval.csv" "$to/$run/eval.csv"; then
        echo "store_curves.sh: $to/$run: other curves are there; remove them first, or name another folder" >&2
        exit 1
    fi
done
for run in "${runs[@]}"; do
    mkdir -p "$to/$run"
    cp "${kept[@]/#/$from/$run/}" "$to/$run/"
done
echo "$to: curves of ${#runs[@]} runs"
