#!/usr/bin/env python3
"""Draws learning curves from run directories.

A run directory is `<task>/<method>/seed-<n>` and holds an `eval.csv`. The picture has one panel a
task and in it one line a method: the mean over the seeds, with a band from the lowest to the highest seed
(or one standard deviation to both sides). Any folder above run directories stands for all
runs in it.

    python scripts/plot.py runs
    python scripts/plot.py runs/Hopper-v4/mamf/seed-* runs/Hopper-v4/td3/seed-* --band std --out hopper.png
"""

import argparse
import csv
import sys
from collections import defaultdict
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator

# Colours that colour-blind readers can tell apart (Okabe and Ito); a method keeps its own everywhere.
COLOURS = {
    "mamf": "#0072B2",
    "td3": "#D55E00",
    "sac": "#009E73",
    "mve-td3": "#CC79A7",
    "ma-td3": "#56B4E9",
    "mamf-sac": "#F0E442",
    "ddpg": "#999999",
    "td3-critic2": "#000000",
}
OTHER_COLOURS = ["#E69F00", "#7B4B94", "#8C564B", "#4D4D4D", "#17BECF", "#BCBD22"]
LABELS = {
    "step": "environment steps",
    "episodes": "episodes",
    "return_mean": "return",
    "length_mean": "episode length",
    "success_rate": "success rate",
}
BANDS = {"minmax": "lowest to highest seed", "std": "± one standard deviation"}


class RunError(Exception):
    """A run directory that can't be drawn; the message says why."""


def find_runs(paths):
    """Run directories among and below the given paths, each once, in order."""
    runs = []
    for path in paths:
        if not path.is_dir():
            raise RunError(f"{path}: no such directory")
        found = [path] if (path / "eval.csv").exists() else sorted(x.parent for x in path.rglob("eval.csv"))
        if not found:
            raise RunError(f"{path}: no eval.csv in it, nor in any directory below")
        runs += [run.resolve() for run in found]
    return list(dict.fromkeys(runs))


def task_and_method(run):
    """("Hopper-v4", "mamf") of `.../Hopper-v4/mamf/seed-3`."""
    if not run.name.startswith("seed-") or len(run.parts) < 4:
        raise RunError(f"{run}: a run directory is laid out as <task>/<method>/seed-<n>")
    return run.parent.parent.name, run.parent.name


def read_curve(run, x, metric):
    """Two columns of a run's eval.csv as {x: value}; empty cells are left out."""
    path = run / "eval.csv"
    with path.open(newline="") as file:
        rows = csv.DictReader(file)
        if rows.fieldnames is None:
            raise RunError(f"{path}: the file is empty")
        for column in (x, metric):
            if column not in rows.fieldnames:
                raise RunError(f"{path}: no column `{column}`; there are {', '.join(rows.fieldnames)}")
        curve = {}
        for row in rows:
            if not row[x] or not row[metric]:
                continue
            try:
                curve[float(row[x])] = float(row[metric])
            except ValueError:
                raise RunError(
                    f"{path}, line {rows.line_num}: `{row[x]}`, `{row[metric]}` are not two numbers"
                ) from None
    if not curve:
        raise RunError(f"{path}: no values of `{metric}`")
    return curve


def average(curves, band, smooth, what):
    """Mean over seeds and the band's bounds, where all seeds have a value.

    With `smooth` > 1 every seed's curve is first replaced by the mean of the last `smooth` points
    (of fewer at the beginning).
    """
    shared = sorted(set.intersection(*(set(curve) for curve in curves)))
    if not shared:
        raise RunError(f"{what}: its seeds have no point in common")
    longest = max(len(curve) for curve in curves)
    if len(shared) < longest:
        print(
            f"{what}: drawn up to {shared[-1]:g}; only {len(shared)} of up to {longest} points"
            " exist for every seed",
            file=sys.stderr,
        )
    values = np.array([[curve[x] for x in shared] for curve in curves])
    values = np.array([values[:, max(0, end - smooth) : end].mean(1) for end in range(1, len(shared) + 1)]).T
    mean = values.mean(0)
    if band == "minmax":
        return np.array(shared), mean, values.min(0), values.max(0)
    deviation = values.std(0)
    return np.array(shared), mean, mean - deviation, mean + deviation


def short_number(value, _position):
    """1500000 -> 1.5M, 20000 -> 20k"""
    for size, letter in ((1e6, "M"), (1e3, "k")):
        if abs(value) >= size:
            return f"{value / size:g}{letter}"
    return f"{value:g}"


def draw(groups, x, metric, band, smooth, out):
    """One panel a task, one line a method; a legend for all panels below them."""
    tasks = sorted(groups)
    present = {method for methods in groups.values() for method in methods}
    known = [method for method in COLOURS if method in present]
    unknown = sorted(present - set(COLOURS))
    colours = COLOURS | {
        method: OTHER_COLOURS[number % len(OTHER_COLOURS)] for number, method in enumerate(unknown)
    }

    columns = {1: 1, 2: 2, 4: 2}.get(len(tasks), 3 if len(tasks) <= 6 else 4)
    lines = -(-len(tasks) // columns)
    width, height = (6.4, 4.3) if len(tasks) == 1 else (3.7 * columns, 2.9 * lines + 0.5)
    figure, axes = plt.subplots(lines, columns, figsize=(width, height), squeeze=False, layout="constrained")
    for number, axis in enumerate(axes.flat):
        if number >= len(tasks):
            axis.set_visible(False)
            continue
        task = tasks[number]
        for method in [method for method in known + unknown if method in groups[task]]:
            curves = groups[task][method]
            at, mean, low, high = average(curves, band, smooth, f"{task}, {method}")
            axis.fill_between(at, low, high, color=colours[method], alpha=0.18, linewidth=0)
            # A single evaluation makes no line: mark the points of short curves.
            marker = "o" if len(at) < 3 else None
            axis.plot(at, mean, color=colours[method], linewidth=1.4, marker=marker, markersize=4)
        axis.set_title(task, fontsize=11)
        axis.xaxis.set_major_formatter(FuncFormatter(short_number))
        axis.yaxis.set_major_formatter(FuncFormatter(short_number))
        axis.xaxis.set_major_locator(MaxNLocator(6))
        axis.grid(alpha=0.25, linewidth=0.6)
        axis.spines[["top", "right"]].set_visible(False)
        axis.margins(x=0)
        if number % columns == 0:
            axis.set_ylabel(LABELS.get(metric, metric))
        if number + columns >= len(tasks):
            axis.set_xlabel(LABELS.get(x, x))

    handles = []
    for method in known + unknown:
        counts = sorted({len(groups[task][method]) for task in tasks if method in groups[task]})
        number = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
        label = f"{method} ({number} seed{'' if counts == [1] else 's'})"
        handles.append(Line2D([], [], color=colours[method], linewidth=1.8, label=label))
    legend_rows = -(-len(handles) // max(1, int(width / 2)))
    smoothed = f"; mean of {smooth} evaluations" if smooth > 1 else ""
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=-(-len(handles) // legend_rows),
        frameon=False,
        fontsize=10,
        title=f"mean over seeds, band: {BANDS[band]}{smoothed}",
        title_fontsize=9,
    )
    figure.savefig(out, dpi=160)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description="Draw learning curves: a panel a task, a line a method.")
    parser.add_argument(
        "runs", nargs="+", type=Path, metavar="RUN_DIR", help="run directory, or a folder above several"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("curves.png"), help="picture to write (default: %(default)s)"
    )
    parser.add_argument("--x", default="step", metavar="COLUMN", help="column across (default: %(default)s)")
    parser.add_argument(
        "--metric", default="return_mean", metavar="COLUMN", help="column up (default: %(default)s)"
    )
    parser.add_argument(
        "--band", choices=list(BANDS), default="minmax", help="what is shaded (default: %(default)s)"
    )
    parser.add_argument(
        "--smooth",
        type=int,
        default=1,
        metavar="N",
        help="show the mean of the last N evaluations of a seed (default: %(default)s, nothing smoothed)",
    )
    arguments = parser.parse_args()
    if arguments.smooth < 1:
        parser.error("--smooth must be at least 1")

    groups = defaultdict(lambda: defaultdict(list))  # task -> method -> curves
    try:
        for run in find_runs(arguments.runs):
            task, method = task_and_method(run)
            groups[task][method].append(read_curve(run, arguments.x, arguments.metric))
        draw(groups, arguments.x, arguments.metric, arguments.band, arguments.smooth, arguments.out)
    except (RunError, OSError) as error:
        sys.exit(f"error: {error}")
    except ValueError as error:  # matplotlib: a file format it does not write
        sys.exit(f"error: {arguments.out}: {error}")
    print(f"{arguments.out}: {len(groups)} panel{'' if len(groups) == 1 else 's'}")


if __name__ == "__main__":
    main()
