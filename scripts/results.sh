#!/usr/bin/env bash
# Makes the single-seed runs under results/: configuration, provenance and curves of each, and the
# figures. Takes about twenty minutes on two cores.
#
#   scripts/results.sh [SEED...]      (seed 0 unless told otherwise)
#
# With DEMONSTRATIONS set to a folder that holds recordings in PenSpin-v0/, PenSpin is also run with
# demonstrations. They are not part of the repository. Its path is absolute, or relative to the root of the repository.
# Runs that stand under results/ already are left alone; remove them to make them anew. Then all figures are
# made by scripts/figures.sh, which needs the Python packages of scripts/requirements.txt.
set -euo pipefail
cd "$(dirname "$0")/.."

cargo build --release
# A copy, so that another build does not change the program between two runs.
install -D target/release/mamf target/results/mamf

# Name, configuration and what differs from it. Phase 1 of HalfCheetah and PenSpin is shortened from
# the published 25 000 steps, which would leave nothing or little of so short a run to learn in.
runs() {
  for seed in "$@"; do
    for method in mamf td3; do
      spin="--config configs/pen_spin.toml --steps 20000 --set random_steps=5000 --set model_start=2000 --set evaluation.every=1000"
      echo "PenSpin-v0 $method $seed $spin"
      if [ -n "${DEMONSTRATIONS:-}" ]; then
        echo "PenSpin-v0-demonstrations $method $seed $spin"
      fi
      echo "HalfCheetah-v4 $method $seed --config configs/half_cheetah.toml --steps 30000 --set random_steps=5000 --set model_start=1000"
      echo "InvertedPendulum-v4 $method $seed --config configs/inverted_pendulum.toml --steps 30000"
      echo "Reacher-v4 $method $seed --config configs/reacher.toml --steps 20000 --set evaluation.every=1000"
    done
  done
}

one() {
  read -r name method seed arguments <<<"$1"
  local run="$name/$method/seed-$seed"
  [ -e "results/$run" ] && { echo "kept: results/$run"; return; }
  local demonstrations=()
  if [[ $name == *-demonstrations ]]; then
    # Not among the words of a line: a path may hold anything.
    demonstrations=(--set "demonstrations.path=$DEMONSTRATIONS/PenSpin-v0")
  fi
  # shellcheck disable=SC2086 # the arguments are words
  target/results/mamf train $arguments "${demonstrations[@]}" --set method="$method" --seed "$seed" --threads 1 \
    --out "target/results/$run" --force
  mkdir -p "results/$run"
  cp "target/results/$run"/{config.toml,run.json,train.csv,eval.csv,timing.csv} "results/$run/"
}
export -f one
export DEMONSTRATIONS="${DEMONSTRATIONS:-}"

[ $# -gt 0 ] || set -- 0
# One thread a run and one run a core: more steps a second in all than two threads a run.
runs "$@" | xargs -P "$(nproc)" -d '\n' -n 1 bash -c 'one "$1"' one
scripts/figures.sh
