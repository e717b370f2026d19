#!/usr/bin/env bash
# Kills a real run again and again, resumes it each time, and compares what it ends with with a run that
# nobody disturbed: train.csv, eval.csv, the networks, the optimisers' moments and the replay buffer must be
# equal byte for byte, and no file may be left over.
#
#   scripts/torture.sh [ROUNDS] [CONFIG]      (5 rounds of configs/hopper.toml unless told otherwise)
#
# Signals are drawn at random: mostly KILL, sometimes TERM, INT or USR1. STEPS (default 4000) is the length of
# the run, LONGEST (default 5) the longest time in seconds that a process lives.
set -euo pipefail
cd "$(dirname "$0")/.."

rounds="${1:-5}"
config="${2:-configs/hopper.toml}"
steps="${STEPS:-4000}"
longest="${LONGEST:-5}"
program="${PROGRAM:-target/release/mamf}"
place="$(mktemp -d)"
trap 'rm -rf "$place"' EXIT

# The words of a new run into $1.
begin() {
  words=(train "--config=$config" --steps "$steps" --out "$1" --set random_steps=1000 --set model_start=500
    --set evaluation.every=500 --set evaluation.episodes=2 --set checkpoint.every=150 --set replay.capacity=2500)
}
names() { (cd "$1" && find . -type f | sort); }

begin "$place/whole"
"$program" "${words[@]}" >/dev/null 2>>"$place/log"
for round in $(seq "$rounds"); do
  run="$place/round-$round"
  kills=0
  while true; do
    if [ -e "$run/config.toml" ]; then words=(train --resume "$run"); else begin "$run"; fi
    "$program" "${words[@]}" >/dev/null 2>>"$place/log" &
    child=$!
    sleep "$(awk -v seed="$RANDOM" -v longest="$longest" 'BEGIN { srand(seed); print 0.05 + rand() * longest }')"
    case $((RANDOM % 6)) in 0) signal=TERM ;; 1) signal=INT ;; 2) signal=USR1 ;; *) signal=KILL ;; esac
    if kill -0 "$child" 2>/dev/null && kill -"$signal" "$child" 2>/dev/null; then kills=$((kills + 1)); fi
    code=0
    # The shell would tell of each killed process.
    { wait "$child"; } 2>/dev/null || code=$?
    case $code in
      0) break ;;
      75 | 130 | 137 | 138 | 143) ;; # saved at a signal, or killed, or by a signal before it could be heard
      *) echo "round $round: exit code $code after $kills signals" >&2; tail -n 3 "$place/log" >&2; exit 1 ;;
    esac
  done
  for file in train.csv eval.csv checkpoints/last/{weights,optimizers}.safetensors checkpoints/replay; do
    diff -rq "$place/whole/$file" "$run/$file"
  done
  diff <(names "$place/whole") <(names "$run")
  echo "round $round: $kills signals, same bytes"
  rm -rf "$run"
done
