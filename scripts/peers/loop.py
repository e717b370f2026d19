#!/usr/bin/env python3
"""Compares the time of a whole training step of TD3: ours, Stable-Baselines3's and SBX's (JAX).

A step is an action with exploration noise, a step of HalfCheetah, and an update: batch 256, hidden layers of
256, one update a step, the same number of threads. The programs run in turn for several rounds, each in a
process of its own, so that a machine that warms up or has other work to do slows all of them. Give it a
quiet machine all the same.

    ~/peers/bin/python scripts/peers/loop.py --rounds 3 --threads 2

with the packages of `requirements.txt` beside this file. Ours is `target/release/mamf`, which is built first,
and its time is that of `timing.csv` without evaluations and checkpoints, of which the others make none.
"""

import argparse
import csv
import importlib.util
import json
import os
import statistics
import sys
import tempfile
from pathlib import Path

from compare import ROOT, machine, run, spread

LIBRARY = Path(__file__).resolve().with_name("library_loop.py")
RANDOM_STEPS, WARM_UP = 1000, 2000
# The preset's networks have layers of 256. Without coupling, they see what the others' see.
CONFIG = """
task = "HalfCheetah-v4"
method = "td3"
random_steps = {random_steps}
steps = {steps}
batch_size = 256
action_coupling = 1.0
networks.hidden = [256, 256]
evaluation.every = {every}
evaluation.episodes = 1
checkpoint.every = {steps}
replay.capacity = 100_000
compute.threads = {threads}
"""


def ours(binary, steps, threads, environment):
    """Runs `mamf train`; returns ms a step after the warm-up."""
    with tempfile.TemporaryDirectory() as directory:
        config, out = Path(directory, "td3.toml"), Path(directory, "run")
        numbers = {"random_steps": RANDOM_STEPS, "steps": WARM_UP + steps, "every": WARM_UP}
        config.write_text(CONFIG.format(threads=threads, **numbers))
        run([str(binary), "train", "--config", str(config), "--out", str(out)], environment)
        with open(out / "timing.csv", newline="") as file:
            rows = [row for row in csv.DictReader(file) if int(row["step"]) > WARM_UP]
    others = ["evaluation_seconds", "checkpoint_seconds"]
    seconds = [float(row["seconds"]) - sum(float(row[other]) for other in others) for row in rows]
    return 1e3 * sum(seconds) / steps


def library(name, steps, threads, environment):
    """Runs the loop of a library; returns ms a step after the warm-up."""
    command = [sys.executable, str(LIBRARY), "--library", name]
    command += ["--threads", str(threads), "--steps", str(steps)]
    command += ["--random-steps", str(RANDOM_STEPS), "--warm-up", str(WARM_UP)]
    return json.loads(run(command, environment).splitlines()[-1])["ms_a_step"]


def versions():
    from importlib.metadata import version

    packages = ["stable-baselines3", "torch", "sbx-rl", "jax", "gymnasium", "mujoco"]
    print(", ".join(f"{package} {version(package)}" for package in packages))


def main():
    parser = argparse.ArgumentParser(description="Compare the time of a training step of TD3.")
    parser.add_argument("--rounds", type=int, default=3, help="rounds of each (default: %(default)s)")
    parser.add_argument("--threads", type=int, default=2, help="threads of each (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=4000, help="steps timed (default: %(default)s)")
    arguments = parser.parse_args()
    if arguments.rounds < 1 or arguments.threads < 1:
        parser.error("--rounds and --threads must be at least 1")
    if arguments.steps < 1 or arguments.steps % WARM_UP != 0:
        parser.error(f"--steps must be a multiple of {WARM_UP}")
    missing = [name for name in ["stable_baselines3", "sbx", "gymnasium"] if not importlib.util.find_spec(name)]
    if missing:
        sys.exit(f"missing: {', '.join(missing)}; install them as {LIBRARY.with_name('requirements.txt')} says")

    machine()
    versions()
    environment = dict(os.environ)
    print("building mamf ...", file=sys.stderr)
    run(["cargo", "build", "--release"], environment)
    binary = ROOT / environment.get("CARGO_TARGET_DIR", "target") / "release" / "mamf"
    rest = (arguments.steps, arguments.threads, environment)
    programs = {
        "mamf": lambda: ours(binary, *rest),
        "Stable-Baselines3": lambda: library("sb3", *rest),
        "SBX": lambda: library("sbx", *rest),
    }
    times = {name: [] for name in programs}
    for round_number in range(arguments.rounds):
        print(f"round {round_number + 1} of {arguments.rounds} ...", file=sys.stderr)
        for name, program in programs.items():
            times[name].append(program())

    print(f"ms a step of TD3 on HalfCheetah, {arguments.threads} threads, {arguments.rounds} rounds")
    print(f"{'program':18} {'min':>8} {'median':>8} {'max':>8} {'/ mamf':>8}")
    base = statistics.median(times["mamf"])
    for name, values in times.items():
        print(f"{name:18} {spread(values)} {statistics.median(values) / base:8.2f}")


if __name__ == "__main__":
    main()
