#!/usr/bin/env bash
# Shows that two builds of mamf train alike: makes short runs with both and compares the bytes of their curves. Columns
# that the newer one adds at the end of a curve are left out.
#
#   scripts/same_curves.sh OLD_MAMF NEW_MAMF
#
# The runs: every method, with one thread and with two, hands with and without demonstrations and goals, doubled
# actions, learned rewards, a replay buffer that wraps, the ndarray backend.
set -euo pipefail
if (($# != 2)); then
    sed -n '2,/^set/{/^#/s/^# \{0,1\}//p}' "$0" >&2
    exit 2
fi
old=$(realpath -- "$1") new=$(realpath -- "$2")
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
place=$(mktemp -d)
trap 'rm -rf -- "$place"' EXIT

small=(steps=400 random_steps=200 model_start=100 batch_size=33 "networks.hidden=[32, 32]"
    "model.hidden=[32, 32, 32]" evaluation.every=100 evaluation.episodes=2 checkpoint.every=150)
# Said to both of methods that imagine: what was a default once is none any more.
readings=(imagination.target_comparison=greater imagination.uncertainty_scale=batch_max
    imagination.imaginary_loss_mean=batch)
tiny=(steps=200 random_steps=80 model_start=50 evaluation.every=50 evaluation.episodes=1)
failed=0 made=0

# The first columns of both, as many as the older one has, without two whose meaning has changed since: the errors of imagined states
# leave out what is known beforehand.
same_columns() {
    local width
    width=$(head -n 1 "$1" | tr ',' '\n' | wc -l)
    cmp -s <(columns "$width" "$1") <(columns "$width" "$2")
}

columns() {
    awk -F, -v OFS=, -v width="$1" '
        NR == 1 { for (i = 1; i <= width; i++) keep[i] = $i !~ /^(kept|dropped)_state_error$/ }
        { line = ""; for (i = 1; i <= width; i++) if (keep[i]) line = line $i OFS; print line }' "$2"
}

# compare CONFIG SETTING...
compare() {
    local config=$1 which options=() setting curve
    shift
    for setting in "${small[@]}" rules.velocity=start "$@"; do
        options+=(--set "$setting")
    done
    case " $* " in
        *" method=td3 "* | *" method=td3-critic2 "* | *" method=mve-td3 "* | *" method=ddpg "* | *" method=sac "*) ;;
        *) for setting in "${readings[@]}"; do options+=(--set "$setting"); done ;;
    esac
    made=$((made + 1))
    for which in old new; do
        "${!which}" train --config "$root/configs/$config.toml" "${options[@]}" --out "$place/$which-$made" \
            >"$place/log" 2>&1 || { cat "$place/log" >&2; exit 1; }
    done
    for curve in train.csv eval.csv; do
        if same_columns "$place/old-$made/$curve" "$place/new-$made/$curve"; then
            echo "same       $config $* $curve"
        else
            echo "DIFFERENT  $config $* $curve"
            failed=1
        fi
    done
}

for method in mamf mamf-sac td3 td3-critic2 mve-td3 ma-td3 ddpg sac; do
    compare hopper "method=$method" compute.threads=1
    compare half_cheetah "method=$method" compute.threads=2
done
recorded=$root/tests/fixtures/rollouts
compare pen_spin "${tiny[@]}"
compare pen_spin "${tiny[@]}" method=td3 "demonstrations.path=$recorded/PenSpin.npz"
compare pen_spin "${tiny[@]}" "demonstrations.path=$recorded/PenSpin.npz"
compare egg_hand_over "${tiny[@]}" "demonstrations.path=$recorded/EggHandOver.npz"
compare egg_catch_underarm_hard "${tiny[@]}"
compare humanoid "${tiny[@]}" rules.reward=learned
compare pusher doubled_actions.period=7 action_coupling=1
compare ant replay.capacity=50 scaling.enabled=false
compare walker2d compute.backend=ndarray telemetry.states=0
compare hopper model.predict=delta
exit "$failed"
