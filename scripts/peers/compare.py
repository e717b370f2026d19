#!/usr/bin/env python3
"""Compares the time of one update, ours against PyTorch's, on this machine.

Ours is the criterion benchmark `update` (ids `update/td3` and `update/mamf`), PyTorch's is
`torch_update.py` beside this file. Both run alternately for several rounds, in changing order, so that a
machine that warms up or has other work to do slows both. Give it a quiet machine all the same.

    python scripts/peers/compare.py --rounds 3 --threads 2

The benchmark is told the number of threads by the environment variable MAMF_BENCH_THREADS.
"""

import argparse
import importlib.util
import json
import os
import platform
import statistics
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PEER = Path(__file__).resolve().with_name("torch_update.py")
METHODS = ["td3", "mamf"]


def ours(method, environment):
    """Runs one criterion benchmark; returns its median in ms an update."""
    command = ["cargo", "bench", "--bench", "update", "--", f"^update/{method}$"]
    started = time.time()
    run(command, environment)
    target = Path(environment.get("CARGO_TARGET_DIR", "target"))
    estimates = ROOT / target / "criterion" / "update" / method / "new" / "estimates.json"
    if not estimates.exists() or estimates.stat().st_mtime < started - 1:
        sys.exit(
            f"`{' '.join(command)}` left no new {estimates}: does the benchmark `update/{method}` exist?"
        )
    median = json.loads(estimates.read_text())["median"]["point_estimate"]
    return median / 1e6  # criterion counts in ns


def peer(method, threads, environment):
    """Runs the PyTorch update in a process of its own; returns its median in ms an update."""
    command = [sys.executable, str(PEER), "--method", method, "--threads", str(threads), "--json"]
    return json.loads(run(command, environment))["median_ms"]


def run(command, environment):
    """Standard output of a command; stops with the end of its messages when it fails."""
    try:
        result = subprocess.run(
            command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
        )
    except FileNotFoundError:
        sys.exit(f"{command[0]} was not found: install Rust from https://rustup.rs")
    if result.returncode != 0:
        sys.exit(f"`{' '.join(command)}` failed:\n{result.stderr.strip()[-2000:]}")
    return result.stdout


def machine():
    """Processor, cores and load, for the record."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [line for line in cpuinfo.read_text().splitlines() if line.startswith("model name")]
        if names:
            model = names[0].split(":", 1)[1].strip()
    cores, load = os.cpu_count(), os.getloadavg()[0]
    print(f"{model}, {cores} cores, load {load:.1f} before the start")
    if load > cores / 2:
        print(
            "warning: this machine was busy within the last minute; busy machines give poor figures",
            file=sys.stderr,
        )


def spread(values):
    return f"{min(values):8.2f} {statistics.median(values):8.2f} {max(values):8.2f}"


def main():
    parser = argparse.ArgumentParser(description="Compare the time of one update with PyTorch's.")
    parser.add_argument("--rounds", type=int, default=3, help="rounds of each (default: %(default)s)")
    parser.add_argument("--threads", type=int, default=2, help="threads of both (default: %(default)s)")
    parser.add_argument("--skip-ours", action="store_true", help="time PyTorch only")
    arguments = parser.parse_args()
    if arguments.rounds < 1 or arguments.threads < 1:
        parser.error("--rounds and --threads must be at least 1")
    if importlib.util.find_spec("torch") is None or importlib.util.find_spec("numpy") is None:
        sys.exit(
            "PyTorch or NumPy is missing: install them with `python -m pip install torch numpy"
            " --extra-index-url https://download.pytorch.org/whl/cpu`."
        )

    machine()
    environment = os.environ | {"MAMF_BENCH_THREADS": str(arguments.threads)}
    programs = {"PyTorch": lambda method: peer(method, arguments.threads, environment)}
    if not arguments.skip_ours:
        print("building the benchmark ...", file=sys.stderr)
        run(["cargo", "bench", "--bench", "update", "--no-run"], environment)
        programs = {"ours": lambda method: ours(method, environment)} | programs

    times = {(method, name): [] for method in METHODS for name in programs}
    for round_number in range(arguments.rounds):
        print(f"round {round_number + 1} of {arguments.rounds} ...", file=sys.stderr)
        order = list(programs) if round_number % 2 == 0 else list(reversed(programs))
        for method in METHODS:
            for name in order:
                times[method, name].append(programs[name](method))

    print(f"ms an update, {arguments.threads} threads, {arguments.rounds} rounds")
    print(f"{'update':8} {'program':8} {'min':>8} {'median':>8} {'max':>8}")
    for (method, name), values in times.items():
        print(f"{method:8} {name:8} {spread(values)}")
    if not arguments.skip_ours:
        print("PyTorch's time / ours, round by round")
        for method in METHODS:
            ratios = [b / a for a, b in zip(times[method, "ours"], times[method, "PyTorch"])]
            print(f"{method:8} {'ratio':8} {spread(ratios)}")


if __name__ == "__main__":
    main()
