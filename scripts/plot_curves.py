#!/usr/bin/env python3
"""Draws learning curves and statistics of runs, and writes the same numbers as Markdown tables. All numbers are those
of `mamf curves`.

    python scripts/plot_curves.py runs/Hopper-v4 --out figures
    python scripts/plot_curves.py 'runs/figure_2/*/*/seed-*' --out figures --baseline td3
    python scripts/plot_curves.py runs/figure_3ab --out ablation --figures curves --layout ablation

A run directory is <folder>/<method>/seed-<n>, as `mamf train` and `mamf sweep` lay it out; the name above seed-<n>
(or that of a directory called otherwise) is the name of its line. A panel is a task; where runs of one task lie in
several folders, each folder has its panel. Written to the folder --out:

  curves       learning curves: mean or IQM over seeds, with a 95 % band of Student's t from 5 seeds on
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

NEEDED = "what is needed is installed, for Python 3.11 or newer, by `pip install -r scripts/requirements.txt`"
try:
    from curves.data import FIGURES, METRICS, InputError, Refused, compute
except ImportError as error:
    sys.exit(f"error: {error}; {NEEDED}")

ROOT = Path(__file__).resolve().parent.parent
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
        choices=list(METRICS),
        default="return_mean",
        metavar="COLUMN",
        help=f"column of eval.csv: {', '.join(METRICS)} (default: %(default)s)",
    )
    add("--smooth", type=at_least(1), default=1, metavar="N", help="draw the mean of the last N evaluations")
    add(
        "--range",
        type=title_and_range,
        action="append",
        default=[],
        metavar="TASK=LOW:HIGH",
        help="draw only this range of a panel's curves, or of the figures `aggregate` and `efficiency`; may be repeated",
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
    add("--mamf", metavar="FILE", help="the program (default: that of target/release, else of the PATH)")
    add("--reps", type=at_least(100), default=2000, metavar="N", help="bootstrap resamples (default: %(default)s)")
    return parser.parse_args()


def find_mamf():
    """The program that was built here, or that of the PATH."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    built = target / "release" / "mamf"
    return str(built) if built.exists() else "mamf"


def options_of(arguments):
    """The options of `mamf curves`."""
    options = ["--metric", arguments.metric, "--statistic", arguments.statistic]
    options += ["--smooth", str(arguments.smooth), "--repetitions", str(arguments.reps)]
    if arguments.merge:
        options.append("--merge")
    if arguments.reference:
        # Its name may begin with a dash.
        options.append(f"--reference={arguments.reference}")
    return [*options, "--", *arguments.runs]


def check(panels, arguments):
    """Checks the options that name something of the runs."""
    labels = sorted({label for panel in panels for label in panel.lines})
    titles = [panel.title for panel in panels]
    asked = [("--range", title, [*titles, "aggregate", "efficiency"]) for title, _ in arguments.range]
    if arguments.baseline:
        asked.append(("--baseline", arguments.baseline, labels))
    if arguments.layout == "ablation":
        asked.append(("--full", arguments.full, labels))
    for option, name, names in asked:
        if name not in names:
            raise InputError(f"{option} {name}: not among the runs; there are {', '.join(names)}")
    if len(labels) == 1 and "improvement" in (arguments.figures or []):
        raise InputError(f"--figures improvement: needs two methods; there is {labels[0]} only")


def load():
    """The modules that draw. They take a second to load, so that mistakes in the runs are told first."""
    try:
        from curves import figures, report
    except ImportError as error:
        sys.exit(f"error: {error}; {NEEDED}")
    return figures, report


def write(save, drawn, text, out, formats):
    """Writes all files beside their places, then moves them there: an error leaves what was there before."""
    out.mkdir(parents=True, exist_ok=True)
    made = {}
    try:
        for name, figure in drawn.items():
            for kind in formats:
                path = out / f"{name}.{kind}"
                made[path] = path.with_suffix(f".{kind}.tmp")
                save(figure, made[path], kind)
        made[out / "table.md"] = out / "table.md.tmp"
        made[out / "table.md"].write_text(text, encoding="utf-8")
        for path, temporary in made.items():
            os.replace(temporary, path)
    finally:
        for temporary in made.values():
            temporary.unlink(missing_ok=True)
    return list(made)


def say(paths):
    """Names what was written. A path is bytes, and nobody need listen: all is done."""
    try:
        sys.stdout.buffer.write(b"".join(os.fsencode(path) + b"\n" for path in paths))
        sys.stdout.flush()
    except OSError:
        # Else Python tries again when it ends, and complains.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main():
    arguments = parse_arguments()
    try:
        if arguments.out.exists() and not arguments.out.is_dir():
            raise InputError(f"--out {arguments.out}: a file; give a folder")
        curves = compute(arguments.mamf or find_mamf(), options_of(arguments))
        check(curves.panels, arguments)
        figures, report = load()
        drawn, text = report.draw(curves, arguments)
    except Refused as refused:
        sys.exit(refused.code)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    try:
        written = write(figures.save, drawn, text, arguments.out, arguments.format)
    except OSError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
    say(written)


if __name__ == "__main__":
    main()
