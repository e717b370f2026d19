"""Finds and reads run directories, and sorts them into panels and lines."""

import csv
import glob
import json
import math
import re
import tomllib
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

# Columns of eval.csv in the version of mamf that this script belongs to.
COLUMNS = [
    "step",
    "episodes",
    "return_mean",
    "return_std",
    "return_min",
    "return_max",
    "length_mean",
    "success_rate",
]
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
# Keys of config.toml that are needed here.
NEEDED = {"task": str, "seed": int, "steps": int, "evaluation.every": int, "doubled_actions.period": int}
MAY_BE_ABSENT = {"evaluation.every", "doubled_actions.period"}
# Empty where a task knows no success.
MAY_BE_EMPTY = {"success_rate"}


class InputError(Exception):
    """Runs or options that can't be used; the message names what, and what would be right."""


@dataclass(frozen=True)
class Run:
    """One run directory, read.

    `task` is the task's id, with the switching period where its actions are doubled; `group` the folder that
    holds the variants; `label` the variant; `planned` the step of the last evaluation that config.toml asks for;
    `curve` one column of eval.csv, indexed by environment steps.
    """

    path: Path
    task: str
    group: Path
    label: str
    seed: int
    planned: int
    curve: pd.Series

    @property
    def last(self):
        """Step of the last evaluation that there is."""
        return int(self.curve.index[-1])


@dataclass(frozen=True)
class Panel:
    """A task in one folder: a title and its lines, `{label: [Run, ...]}`, runs ordered by seed."""

    title: str
    task: str
    lines: dict


def find_runs(patterns):
    """Run directories among and below paths and globs, each once, in order."""
    found = {}
    for pattern in patterns:
        matches = sorted(glob.glob(pattern, recursive=True)) if glob.has_magic(pattern) else [pattern]
        if not matches:
            raise InputError(f"{pattern}: nothing matches; give run directories, or folders above them")
        folders = [Path(match) for match in matches]
        if glob.has_magic(pattern):
            # `runs/*` may match logs beside the folders.
            folders = [folder for folder in folders if folder.is_dir()]
        runs = [run for folder in folders for run in runs_below(folder)]
        if not runs:
            raise InputError(f"{pattern}: no run in it; a run directory holds config.toml, run.json and eval.csv")
        for run in runs:
            found.setdefault(run.resolve(), run)
    return list(found.values())


def runs_below(folder):
    """`folder` itself if it is a run directory, else those below it."""
    if not folder.is_dir():
        kind = "a file, not a directory" if folder.exists() else "no such directory"
        raise InputError(f"{folder}: {kind}; give run directories, or folders above them")
    # A checkpoint holds a config.toml too, but neither of these.
    marks = ("eval.csv", "run.json")
    if any((folder / mark).exists() for mark in marks):
        return [folder]
    return sorted({path.parent for mark in marks for path in folder.rglob(mark)})


def read_run(path, metric):
    """Reads a run directory, of its eval.csv the column `metric`."""
    config = read_config(path / "config.toml")
    task, label = config["task"], path.name
    group = path.resolve().parent
    if re.fullmatch(r"seed-\d+", path.name):
        label, group = group.name, group.parent
    if period := config["doubled_actions.period"]:
        task = f"{task}, period {period}"
        # The panel says it: the same method keeps one name in all of them.
        label = label.removesuffix(f"-period-{period}")
    steps, every = config["steps"], config["evaluation.every"] or 1
    return Run(path, task, group, label, config["seed"], steps - steps % every, read_curve(path, metric))


# What is read of a run directory.
RUN_FILES = ["config.toml", "run.json", "eval.csv"]


def read_text(path):
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        hint = "; a run directory holds config.toml, run.json and eval.csv"
        raise InputError(f"{path}: no such file{hint if path.name in RUN_FILES else ''}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: can't be read as text: {error}") from None


def read_config(path):
    """The needed keys of config.toml as `{key: value}`, None for one that is absent and may be."""
    text = read_text(path)
    try:
        config = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: damaged or cut short: {error}; copy it again from the run") from None
    settings = {}
    for key, kind in NEEDED.items():
        section, _, name = key.rpartition(".")
        value = config.get(section, {}) if section else config
        value = value.get(name) if isinstance(value, dict) else value
        if not isinstance(value, kind) and not (value is None and key in MAY_BE_ABSENT):
            what = "a string" if kind is str else "a whole number"
            raise InputError(f"{path}: `{key}` should be {what}, as `mamf train` writes it")
        settings[key] = value
    return settings


def version_of(run):
    """What run.json says about the version that wrote a run, for messages."""
    try:
        return f"run.json says mamf {json.loads((run / 'run.json').read_text())['mamf']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "run.json names no version"


def read_curve(run, metric):
    """One column of a run's eval.csv as a series over steps. Every line of the file is checked."""
    path = run / "eval.csv"
    text = read_text(path)
    expected = ",".join(COLUMNS)
    if not text:
        raise InputError(f"{path}: empty; its first line should be {expected}")
    lines = text.splitlines()
    if not text.endswith("\n"):
        raise InputError(
            f"{path}, line {len(lines)}: cut short, a whole line ends with a line break; copy the file again"
            f" from the run, or go on with the run by `mamf train --resume`"
        )
    check_header(run, path, lines[0].split(","))
    steps, values = [], []
    for number, fields in enumerate(csv.reader(lines[1:]), start=2):
        where = f"{path}, line {number}"
        row = read_row(where, fields)
        if steps and row["step"] <= steps[-1]:
            raise InputError(f"{where}: step {row['step']:g} after step {steps[-1]:g}; steps should increase")
        if row[metric] is None:
            raise InputError(f"{where}: no `{metric}`; this task knows none, choose another --metric")
        steps.append(row["step"])
        values.append(row[metric])
    if not steps:
        raise InputError(
            f"{path}: no evaluation yet, only the header; wait for the first one or leave the run out"
        )
    return pd.Series(values, index=pd.Index([int(step) for step in steps], name="step"), name=metric)


def check_header(run, path, header):
    if header == COLUMNS:
        return
    missing = [column for column in COLUMNS if column not in header]
    unknown = [column for column in header if column not in COLUMNS]
    parts = [f"missing {', '.join(missing)}"] * bool(missing) + [f"unknown {', '.join(unknown)}"] * bool(unknown)
    raise InputError(
        f"{path}, line 1: columns of another version of mamf ({version_of(run)}):"
        f" {'; '.join(parts) or 'in another order'}; expected {','.join(COLUMNS)}"
    )


def read_row(where, fields):
    """A row as `{column: number}`; None for an empty field that may be empty."""
    if len(fields) != len(COLUMNS):
        raise InputError(
            f"{where}: cut short or damaged, {len(fields)} fields instead of {len(COLUMNS)}; copy the file again"
        )
    row = {}
    for column, field in zip(COLUMNS, fields, strict=True):
        if not field and column in MAY_BE_EMPTY:
            row[column] = None
            continue
        try:
            row[column] = float(field)
        except ValueError:
            row[column] = math.nan
        if not math.isfinite(row[column]):
            raise InputError(f"{where}: `{column}` is `{field}`; it should be a finite number")
    return row


def panels_of(runs, merge):
    """Sorts runs into panels by task and group, or with `merge` by task alone; ordered by title."""
    by_panel = defaultdict(lambda: defaultdict(dict))  # (task, group) -> label -> seed -> run
    for run in runs:
        line = by_panel[run.task, None if merge else run.group][run.label]
        if run.seed in line:
            raise InputError(
                f"{run.path}: seed {run.seed} of {run.label} on {run.task} a second time, after"
                f" {line[run.seed].path}; leave one of them out"
            )
        line[run.seed] = run
    panels = []
    for (task, group), lines in by_panel.items():
        others = [other for name, other in by_panel if name == task]
        ordered = {label: [line[seed] for seed in sorted(line)] for label, line in lines.items()}
        panels.append(Panel(title(task, group, others), task, ordered))
    return sorted(panels, key=lambda panel: by_number(panel.title))


def by_number(text):
    """A key that sorts "period 50" before "period 200"."""
    return [(int(part), "") if part.isdecimal() else (0, part) for part in re.split(r"(\d+)", text)]


def title(task, group, groups):
    """The task, and where several groups have it also the end of the group's path that tells them apart."""
    if len(groups) == 1:
        return task
    for length in range(1, len(group.parts) + 1):
        name = "/".join(group.parts[-length:])
        if sum("/".join(other.parts[-length:]) == name for other in groups) == 1:
            break
    return name if name.startswith(task) else f"{task} ({name})"
