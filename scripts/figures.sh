#!/usr/bin/env bash
# Makes every figure and table under results/ from the stored curves. The same curves give the same bytes. About a
# minute on one core.
#
#   scripts/figures.sh
#
# Needs the program (cargo build --release), whose `mamf curves` computes all numbers, and the Python packages of
# scripts/requirements.txt: of .venv if there is one (scripts/setup.sh --plots makes it),
# else of python3.
set -euo pipefail
cd "$(dirname "$0")/.."

python=python3
[ -x .venv/bin/python ] && python=.venv/bin/python
plot() { "$python" scripts/plot_curves.py "$@"; }

# Single seeds: curves alone, scores of them would say nothing.
plot 'results/*-v*' --figures curves --out results/figures
# One method's collapse would flatten all other curves on Reacher; the figures say what they leave out.
plot results/methods --baseline td3 --range Reacher-v4=-25:0 --range aggregate=-0.5:1.2 --range efficiency=-1:2 --out results/methods/figures
plot results/comparison --range Reacher-v4=-25:0 --range efficiency=-1:2 --out results/comparison/figures
