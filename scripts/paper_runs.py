#!/usr/bin/env python3
"""Prints the `mamf train` commands of an experiment of configs/paper, one a run.

    python scripts/paper_runs.py configs/paper/figure_3c.toml
    python scripts/paper_runs.py configs/paper/figure_2.toml --steps 20000 --seeds 0 1 | xargs -P 2 -I{} sh -c "{}"

An experiment names configurations (files of configs/), seeds and variants: settings on top of a
configuration. `[on.<configuration>.<variant>]` holds settings of one variant on one task. Every run goes to
<out>/<experiment>/<configuration>/<variant>/seed-<n>.
"""

import argparse
import json
import shlex
import tomllib
from pathlib import Path


def commands(path, out, seeds, steps, program):
    experiment = tomllib.loads(path.read_text())
    for config in experiment["configs"]:
        for variant, settings in experiment["variants"].items():
            settings = settings | experiment.get("on", {}).get(config, {}).get(variant, {})
            for seed in seeds or experiment["seeds"]:
                run = Path(out) / path.stem / config / variant / f"seed-{seed}"
                words = [program, "train", "--config", str(path.parent.parent / f"{config}.toml")]
                for key, value in settings.items():
                    words += ["--set", f"{key}={value if isinstance(value, str) else json.dumps(value)}"]
                words += ["--seed", str(seed), "--threads", "1", "--out", str(run)]
                words += ["--steps", str(steps)] if steps else []
                yield shlex.join(words)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("experiment", type=Path, metavar="FILE")
    parser.add_argument("--out", default="runs", help="folder of the runs (default: %(default)s)")
    parser.add_argument("--seeds", type=int, nargs="+", help="instead of the experiment's")
    parser.add_argument("--steps", type=int, help="instead of the configurations'")
    parser.add_argument("--program", default="target/release/mamf", help="default: %(default)s")
    arguments = parser.parse_args()
    for line in commands(
        arguments.experiment, arguments.out, arguments.seeds, arguments.steps, arguments.program
    ):
        print(line)


if __name__ == "__main__":
    main()
