#!/usr/bin/env bash
# Makes the learning curves under results/: each run's configuration, provenance and curves, and
# one picture. Takes about ten minutes on two cores.
#
#   scripts/results.sh [SEED...]      (seed 0 unless told otherwise)
#
# Runs that stand under results/ already are left alone; remove them to make them anew. The picture
# needs the Python packages of scripts/requirements.txt.
set -euo pipefail
cd "$(dirname "$0")/.."

cargo build --release
# A copy, so that another build does not change the program between two runs.
install -D target/release/mamf target/results/mamf

# Task, configuration and what differs from it. HalfCheetah's phase 1 is shortened from the
# published 25 000 steps, which would leave only 5 000 of the 30 000 to learn in.
runs() {
  for seed in "$@"; do
    for method in mamf td3; do
      echo "HalfCheetah-v4 $method $seed --config configs/half_cheetah.toml --steps 30000 --set random_steps=5000 --set model_start=1000"
      echo "InvertedPendulum-v4 $method $seed --config configs/inverted_pendulum.toml --steps 30000"
      echo "Reacher-v4 $method $seed --config configs/reacher.toml --steps 20000 --set evaluation.every=1000"
    done
  done
}

one() {
  read -r task method seed arguments <<<"$1"
  local run="$task/$method/seed-$seed"
  [ -e "results/$run" ] && { echo "kept: results/$run"; return; }
  # shellcheck disable=SC2086 # the arguments are words
  target/results/mamf train $arguments --set method="$method" --seed "$seed" --threads 1 \
    --out "target/results/$run" --force
  mkdir -p "results/$run"
  cp "target/results/$run"/{config.toml,run.json,train.csv,eval.csv,timing.csv} "results/$run/"
}
export -f one

[ $# -gt 0 ] || set -- 0
# One thread a run and one run a core: more steps a second in all than two threads a run.
runs "$@" | xargs -P "$(nproc)" -d '\n' -I{} bash -c 'one "{}"'
python3 scripts/plot.py results --out results/curves.png
