"""What `mamf curves --json` computed, as the figures need it. No statistics are made here."""

import json
import subprocess
from dataclasses import dataclass

import numpy as np

# What the columns that can be drawn are called in figures.
METRICS = {
    "return_mean": "return",
    "return_std": "deviation of returns",
    "return_min": "lowest return",
    "return_max": "highest return",
    "length_mean": "episode length",
    "success_rate": "success rate",
}
# Figures that there are, in the order in which they are made.
FIGURES = ["curves", "aggregate", "improvement", "profiles", "efficiency"]
# The aggregate metrics: their names in figures, and those of `mamf curves`.
AGGREGATES = {"median": "median", "IQM": "iqm", "mean": "mean", "optimality gap": "optimality_gap"}
# Thresholds of the performance profiles that the table states.
ROUND_THRESHOLDS = [0.0, 0.25, 0.5, 0.75, 1.0]


class InputError(Exception):
    """Runs or options that can't be used; the message names what, and what would be right."""


class Refused(Exception):
    """`mamf` ended with an error, which it told itself; `code` is its exit code."""

    def __init__(self, code):
        super().__init__(code)
        self.code = code


@dataclass(frozen=True)
class Estimate:
    """A figure at each of some places; `low` and `high` bound the intervals, None where there is but one run."""

    value: np.ndarray
    low: np.ndarray | None = None
    high: np.ndarray | None = None


def estimate(items):
    """The Estimate of a list of {"value": x, "interval": {"low": x, "high": x} or null}."""
    value = np.array([item["value"] for item in items])
    if any(item["interval"] is None for item in items):
        return Estimate(value)
    return Estimate(value, *(np.array([item["interval"][end] for item in items]) for end in ("low", "high")))


@dataclass(frozen=True)
class Line:
    """The curve of one label in one panel: an estimate over `seeds` runs at each of `steps`, and `runs` [runs, steps]."""

    steps: np.ndarray
    estimate: Estimate
    runs: np.ndarray
    seeds: int
    last: list
    final: Estimate


@dataclass(frozen=True)
class Panel:
    """A task in one folder: a title and its lines, `{label: Line}`."""

    title: str
    lines: dict


@dataclass(frozen=True)
class Scores:
    """Normalised scores of every label: `runs` a task, `lowest` final score, `aggregates` in the order of AGGREGATES, `profiles`
    at `thresholds`, `efficiency` at `steps`, each `{label: ...}`; `improvements` is `{(X, Y): Estimate}`."""

    titles: list
    scales: dict
    runs: dict
    lowest: dict
    aggregates: dict
    thresholds: np.ndarray
    profiles: dict
    steps: np.ndarray
    longest: int
    efficiency: dict
    improvements: dict
    notes: list


@dataclass(frozen=True)
class Curves:
    """All of it. `notes` are (title, text that follows it); `scores` is None where `no_scores` says why."""

    panels: list
    notes: list
    scores: Scores | None
    no_scores: str | None


def compute(mamf, options):
    """Runs `mamf curves` with these options and reads what it prints."""
    try:
        ended = subprocess.run([mamf, "curves", "--json", *options], stdout=subprocess.PIPE, check=False)
    except OSError as error:
        raise InputError(f"{mamf}: can't be run: {error.strerror}; build it (cargo build --release) or name it by --mamf") from None
    if ended.returncode != 0:
        raise Refused(ended.returncode)
    return curves_of(json.loads(ended.stdout))


def curves_of(found):
    panels = [
        Panel(panel["title"], {label: line_of(line) for label, line in panel["lines"].items()})
        for panel in found["panels"]
    ]
    notes = [(note["panel"], note["text"]) for note in found["notes"]]
    scores = found["scores"] and scores_of(found["scores"])
    return Curves(panels, notes, scores, found["no_scores"])


def line_of(line):
    final = estimate([line["final_mean"], line["final_iqm"]])
    runs = np.array(line["runs"])
    return Line(np.array(line["steps"]), estimate(line["curve"]), runs, len(runs), line["last"], final)


def scores_of(scores):
    methods = scores["methods"]

    def each(of):
        return {label: of(method) for label, method in methods.items()}

    return Scores(
        scores["titles"],
        scores["scales"],
        each(lambda method: method["runs"]),
        each(lambda method: method["lowest"]),
        each(lambda method: estimate([method[name] for name in AGGREGATES.values()])),
        np.array(scores["thresholds"]),
        each(lambda method: estimate(method["profile"])),
        np.array(scores["steps"]),
        scores["longest"],
        each(lambda method: estimate(method["efficiency"])),
        {(x["method"], x["over"]): estimate([x["probability"]]) for x in scores["improvements"]},
        scores["notes"],
    )


def short(number):
    """1500000 -> 1.5M, 20000 -> 20k"""
    for size, letter in ((1e6, "M"), (1e3, "k")):
        if abs(number) >= size:
            return f"{number / size:g}{letter}"
    return f"{number:g}"
