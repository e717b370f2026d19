#!/usr/bin/env bash
# Draws every task (sparse variants look like their dense ones) to results/tasks/<id>.png, and all of them on
# one sheet, results/tasks.png. Pictures that stand there are made anew.
#
#   scripts/contact_sheet.sh
#
# Needs a renderer (scripts/setup.sh --render), and for the sheet the Python packages of
# scripts/requirements.txt (scripts/setup.sh --plots makes .venv with them).
set -euo pipefail
cd "$(dirname "$0")/.."

cargo build --release
mamf=${CARGO_TARGET_DIR:-target}/release/mamf

pictures=results/tasks
rm -rf "$pictures"
mkdir -p "$pictures"
"$mamf" envs | awk '/-v[0-9]/ { print $1 }' | grep -v Sparse | while read -r id; do
    # A few random steps, so that no limb hides another.
    "$mamf" render --task "$id" --actions random --steps 8 --size 320x240 --out "$pictures/$id.png"
done
python=python3
[ -x .venv/bin/python ] && python=.venv/bin/python
"$python" scripts/contact_sheet.py "$pictures"/*.png --out results/tasks.png
