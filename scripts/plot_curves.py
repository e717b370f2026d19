#!/usr/bin/env python3
"""Draws learning curves and statistics of runs, and writes the same numbers as Markdown tables.

    python scripts/plot_curves.py runs/Hopper-v4 --out figures
    python scripts/plot_curves.py 'runs/figure_2/*/*/seed-*' --out figures --baseline td3
    python scripts/plot_curves.py runs/figure_3ab --out ablation --figures curves --layout ablation

A run directory is <folder>/<method>/seed-<n>, as `mamf train` and `mamf sweep` lay it out; the name above seed-<n>
(or that of a directory called otherwise) is the name of its line. A panel is a task; where runs of one task lie in
several folders, each folder has its panel. Written to the folder --out:

  curves       learning curves: mean or IQM over seeds with a 95 % stratified-bootstrap band
  aggregate    median, IQM, mean and optimality gap of normalised final returns
  improvement  probability that a run of one method scores higher than one of another
  profiles     fraction of runs whose normalised final return is above a threshold
  efficiency   IQM of normalised scores along the steps
  table.md     the numbers of all of these, and notes

The final return of a run is the mean of its evaluations in the last tenth of its steps. Normalised scores count from
the untrained policy (0) to the best method's mean final return (1) on each task. The same runs and options give the
same bytes.
"""

import argparse
import os
import sys
from pathlib import Path

try:
    import arch  # noqa: F401  what rliable draws with; a TypeError with pandas 3
    import matplotlib  # noqa: F401
    import pandas  # noqa: F401
    import rliable  # noqa: F401
except (ImportError, TypeError) as error:
    sys.exit(f"error: {error}; install what is needed by `python -m pip install -r scripts/requirements.txt`")

import matplotlib.pyplot as plt

from curves import figures, table
from curves.runs import InputError, find_runs, panels_of, read_run
from curves.scores import (
    aggregates,
    efficiency,
    improvements,
    line_of,
    measured_scale,
    panel_notes,
    profiles,
    read_scales,
    scores_of,
    short,
)

FIGURES = ["curves", "aggregate", "improvement", "profiles", "efficiency"]
FORMATS = ["png", "svg"]


def list_of(choices):
    """A parser of comma-separated choices, "all" being all of them."""

    def parse(text):
        chosen = choices if text == "all" else text.split(",")
        for name in chosen:
            if name not in choices:
                raise argparse.ArgumentTypeError(f"`{name}` is none of {', '.join(choices)}, all")
        return [name for name in choices if name in chosen]

    return parse


def at_least(least):
    def parse(text):
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"`{text}` should be a whole number from {least} on")
        return int(text)

    return parse


def title_and_range(text):
    """ "Reacher-v4=-20:0" as ("Reacher-v4", (-20.0, 0.0))"""
    title, _, bounds = text.rpartition("=")
    try:
        low, high = map(float, bounds.split(":"))
    except ValueError:
        low = high = 0.0
    if not title or not low < high:
        raise argparse.ArgumentTypeError(f"`{text}` should be TASK=LOW:HIGH, as in Reacher-v4=-20:0")
    return title, (low, high)


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("runs", nargs="+", metavar="RUNS", help="run directory, folder above several, or glob")
    add("--out", type=Path, required=True, metavar="DIR", help="folder to write to; files of before are replaced")
    add(
        "--figures",
        type=list_of(FIGURES),
        metavar="LIST",
        help=f"comma-separated: {', '.join(FIGURES)}; by default all that the runs allow",
    )
    add("--format", type=list_of(FORMATS), default=FORMATS, metavar="LIST", help="png, svg or both (default)")
    add("--statistic", choices=["mean", "iqm"], default="mean", help="of learning curves (default: %(default)s)")
    add(
        "--metric",
        choices=list(figures.METRICS),
        default="return_mean",
        metavar="COLUMN",
        help=f"column of eval.csv: {', '.join(figures.METRICS)} (default: %(default)s)",
    )
    add("--smooth", type=at_least(1), default=1, metavar="N", help="draw the mean of the last N evaluations")
    add(
        "--range",
        type=title_and_range,
        action="append",
        default=[],
        metavar="TASK=LOW:HIGH",
        help="draw only this range of a panel's curves, or of the figure `efficiency`; may be repeated",
    )
    add("--baseline", metavar="METHOD", help="improvement over this one only, instead of all pairs")
    add("--reference", type=Path, metavar="FILE", help='TOML of "<task>" = [low, high]: what counts as 0 and 1')
    add("--merge", action="store_true", help="one panel a task, whatever folders its runs are in")
    add(
        "--layout",
        choices=["tasks", "ablation"],
        default="tasks",
        help="ablation: lettered panels, --full heavier",
    )
    add("--full", default="mamf", metavar="METHOD", help="whole method of an ablation (default: %(default)s)")
    add("--reps", type=at_least(100), default=2000, metavar="N", help="bootstrap resamples (default: %(default)s)")
    return parser.parse_args()


def together(notes):
    """(title, text that follows it) pairs as lines, panels with the same text on one."""
    titles = {}
    for title, text in notes:
        titles.setdefault(text, []).append(title)
    return [f"{', '.join(panels)}{text}" for text, panels in titles.items()]


def read_panels(arguments):
    """Panels, and all labels in the order in which they are listed."""
    runs = [read_run(path, arguments.metric) for path in find_runs(arguments.runs)]
    panels = panels_of(runs, arguments.merge)
    labels = figures.ordered({run.label for run in runs})
    asked = [("--baseline", arguments.baseline)]
    if arguments.layout == "ablation":
        asked.append(("--full", arguments.full))
    for option, label in asked:
        if label and label not in labels:
            raise InputError(f"{option} {label}: no such method among the runs; there are {', '.join(labels)}")
    titles = [panel.title for panel in panels]
    for title, _ in arguments.range:
        if title not in [*titles, "efficiency"]:
            raise InputError(f"--range {title}: no such panel; there are {', '.join(titles)}, efficiency")
    if arguments.layout == "ablation":
        labels = [arguments.full] + [label for label in labels if label != arguments.full]
    return panels, labels


def draw_curves(panels, labels, arguments):
    """The figure of learning curves, its table and its notes."""
    lines, notes = {}, []
    for panel in panels:
        lines[panel.title] = {}
        for label, runs in panel.lines.items():
            line, said = line_of(runs, arguments.statistic, arguments.smooth, arguments.reps)
            lines[panel.title][label] = line
            notes += [(panel.title, text) for text in said]
        notes += [(panel.title, text) for text in panel_notes(panel, labels)]
    ranges = dict(arguments.range)
    notes = together(notes + range_notes(lines, ranges))
    statistic = "IQM" if arguments.statistic == "iqm" else "mean"
    counts = [len(runs) for panel in panels for runs in panel.lines.values()]
    how = f"Line: {statistic} over seeds. Band: {interval_text(arguments)}.{caution(counts)}"
    if max(counts) == 1:
        how = "Line: the only seed; no bands."
    if arguments.smooth > 1:
        how += f" Every point is the mean of the last {arguments.smooth} evaluations of a seed."
    if arguments.statistic == "iqm" and min(counts) < 4:
        how += " The IQM of fewer than 4 seeds is their mean."
    full = arguments.full if arguments.layout == "ablation" else None
    what = figures.METRICS[arguments.metric]
    figure = figures.curves(panels, labels, lines, what, [how, *notes], ranges, full)
    section = table.curve_section(panels, labels, lines, arguments.metric, arguments.statistic)
    return figure, section, notes


def range_notes(lines, ranges):
    """Which lines leave the ranges that are drawn."""
    notes = []
    for title in lines:
        if title in ranges:
            estimates = {label: line.estimate for label, line in lines[title].items()}
            notes += [(title, f": {text}") for text in beyond(estimates, ranges[title])]
    return notes


def beyond(estimates, limits):
    """A note on the labels that go beyond the limits, if any does."""
    low, high = limits
    outside = [label for label, x in estimates.items() if extent(x)[0] < low or extent(x)[1] > high]
    return (
        [f"only {low:g} to {high:g} is drawn, beyond which are parts of {', '.join(outside)}"] if outside else []
    )


def extent(estimate):
    """Lowest and highest number of an estimate and its band."""
    bounds = [x for x in (estimate.value, estimate.low, estimate.high) if x is not None]
    return min(x.min() for x in bounds), max(x.max() for x in bounds)


def caution(counts):
    """What bootstrap intervals of few seeds are worth."""
    return " Those of 2 to 4 seeds tend to be too narrow." if any(1 < count < 5 for count in counts) else ""


def interval_text(arguments):
    return f"95 % stratified-bootstrap interval ({arguments.reps} resamples)"


def draw_scores(panels, labels, wanted, arguments):
    """Figures of normalised scores, by name; their tables and notes."""
    if arguments.reference:
        scales, given = (
            read_scales(arguments.reference, panels),
            f"low and high are those of {arguments.reference.name}",
        )
    else:
        scales = {panel.title: measured_scale(panel) for panel in panels}
        given = "low is the untrained policy's return, high the best method's mean final return"
    scores = scores_of(panels, labels, scales, arguments.smooth)
    tasks = f"{len(scores.titles)} task{'' if len(scores.titles) == 1 else 's'}"
    runs = {label: len(final) for label, final in scores.final.items()}
    some = f". Intervals: {interval_text(arguments)}.{caution(runs.values())}"
    how = f"{tasks}{some if max(runs.values()) > 1 else ', single runs: no intervals.'}"
    scale = f"Score: 0 is low, 1 is high; {given} of each task (see table.md)."
    notes = [how, scale, *scores.notes]
    drawn, sections = {}, table.scale_section(scores, given)
    if "aggregate" in wanted:
        estimates = aggregates(scores, arguments.reps)
        drawn["aggregate"] = figures.aggregate(estimates, labels, runs, notes)
        sections += table.aggregate_section(estimates, labels)
    if "improvement" in wanted:
        estimates = improvements(scores, arguments.baseline, arguments.reps)
        drawn["improvement"] = figures.improvement(estimates, labels, [how, *scores.notes])
        sections += table.improvement_section(estimates)
    if "profiles" in wanted:
        thresholds, estimates = profiles(scores, arguments.reps)
        drawn["profiles"] = figures.profile(thresholds, estimates, labels, runs, notes)
        sections += table.profile_section(thresholds, estimates, labels)
    if "efficiency" in wanted:
        estimates = efficiency(scores, arguments.reps)
        limits = dict(arguments.range).get("efficiency")
        said = [f"Sample efficiency: {text}" for text in beyond(estimates, limits)] if limits else []
        if scores.steps[-1] < scores.longest:
            end, longest = short(int(scores.steps[-1])), short(scores.longest)
            said.append(f"Drawn to {end} of {longest} steps, the last one at which all runs have an evaluation.")
        drawn["efficiency"] = figures.efficiency(scores.steps, estimates, labels, runs, notes + said, limits)
        scores.notes.extend(said)
        sections += table.efficiency_section(scores.steps, estimates, labels)
    return drawn, sections, scores.notes


def draw(arguments):
    """All figures by name, and the text of the table."""
    if arguments.out.exists() and not arguments.out.is_dir():
        raise InputError(f"--out {arguments.out}: a file; give a folder")
    panels, labels = read_panels(arguments)
    wanted = arguments.figures or list(FIGURES)
    if len(labels) == 1 and "improvement" in wanted:
        if arguments.figures:
            raise InputError(f"--figures improvement: needs two methods; there is {labels[0]} only")
        wanted.remove("improvement")
    drawn, sections, notes = {}, table.final_section(panels, labels, arguments.metric, arguments.reps), []
    if "curves" in wanted:
        drawn["curves"], section, notes = draw_curves(panels, labels, arguments)
        sections += section
    if set(wanted) - {"curves"}:
        try:
            others, section, more = draw_scores(panels, labels, wanted, arguments)
        except InputError as error:
            if arguments.figures or arguments.reference:
                raise
            others, section, more = {}, [], [f"No figures of scores: {error}"]
        drawn |= others
        sections += section
        notes = notes + more
    head = ["# Numbers of the figures", "", f"Brackets: {interval_text(arguments)}; none for a single run.", ""]
    return drawn, "\n".join(head + sections + table.notes_section(notes))


def write(drawn, text, out, formats):
    """Writes all files beside their places, then moves them there: an error leaves what was there before."""
    out.mkdir(parents=True, exist_ok=True)
    made = {}
    try:
        for name, figure in drawn.items():
            for kind in formats:
                path = out / f"{name}.{kind}"
                made[path] = path.with_suffix(f".{kind}.tmp")
                figures.save(figure, made[path], kind)
            plt.close(figure)
        made[out / "table.md"] = out / "table.md.tmp"
        made[out / "table.md"].write_text(text, encoding="utf-8")
        for path, temporary in made.items():
            os.replace(temporary, path)
    finally:
        for temporary in made.values():
            temporary.unlink(missing_ok=True)
    return list(made)


def main():
    arguments = parse_arguments()
    try:
        drawn, text = draw(arguments)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    try:
        for path in write(drawn, text, arguments.out, arguments.format):
            print(path)
    except OSError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
